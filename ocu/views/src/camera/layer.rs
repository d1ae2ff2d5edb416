//! One image of a camera view: decoded when its message changes, painted when its appearance changes.

use crate::image::{DecodedImage, Pixels, Tint, decode};
use crate::texture::{CachedTexture, SameMessage};
use egui::{Color32, Context, TextureId, TextureOptions};
use ocu_ui::legend::round_step;
use ocu_ui::palette::{Classes, Label, MapPalette};
use rcs_msg::classes::LabelClass;
use rcs_msg::foxglove::RawImage;
use rcs_runtime::Role;
use rcs_runtime::source::{Frame, Topic};
use std::collections::BTreeSet;

/// Key of a channel that names the image on which its own lies.
const OVERLAY_OF: &str = "rcs.overlay_of";

/// How an image is painted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Look {
    /// Colours, or ranges.
    Image,
    /// One label per pixel.
    Labels,
    /// One cost per pixel.
    Cost,
}

/// Derived from the topic's metadata.
pub(super) fn look(topic: &Topic) -> Look {
    match topic.role() {
        Some(Role::Labels) => Look::Labels,
        Some(Role::Cost) => Look::Cost,
        _ => Look::Image,
    }
}

/// Whether the image contains ranges: by its role, or by its encoding where a log has no role metadata.
pub(super) fn is_range(topic: &Topic) -> bool {
    match topic.role() {
        Some(role) => matches!(role, Role::Depth | Role::Disparity),
        None => topic.get::<RawImage>().is_some_and(|raw| matches!(&*raw.encoding, "16UC1" | "32FC1")),
    }
}

/// The label classes in the topic's metadata.
pub(super) fn classes(topic: &Topic) -> Classes {
    let label = |class: LabelClass| {
        let [r, g, b] = class.color;
        Label { value: class.value, name: class.name.into_owned(), color: Color32::from_rgb(r, g, b) }
    };
    topic.classes().into_iter().map(label).collect()
}

/// How pixel values of the topic are converted to colours.
pub(super) fn tint(topic: &Topic, palette: MapPalette) -> Tint {
    match look(topic) {
        Look::Image => Tint::Plain,
        Look::Labels => Tint::Labels(classes(topic)),
        Look::Cost => Tint::Cost(palette),
    }
}

/// Whether the topic's messages are images.
pub(super) fn is_image(topic: &Topic) -> bool {
    matches!(topic.type_name(), "foxglove.RawImage" | "foxglove.CompressedImage")
}

/// Whether the topic's messages are shapes drawn on an image.
pub(super) fn is_annotation(topic: &Topic) -> bool {
    topic.type_name() == "foxglove.ImageAnnotations"
}

/// Whether a topic says that it lies on this image.
pub(super) fn lies_on(topic: &Topic, image: &Topic) -> bool {
    topic.metadata.get(OVERLAY_OF).is_some_and(|name| **name == *image.name)
}

/// All images, in this order: those with overlays, other camera images, depth images, derived images, ground truth.
pub(super) fn images(frame: &Frame) -> Vec<&Topic> {
    let mut images: Vec<_> = frame.topics.iter().filter(|topic| is_image(topic)).collect();
    let overlays = frame.topics.iter().filter(|topic| !topic.is_ground_truth());
    let overlaid: BTreeSet<&str> =
        overlays.filter_map(|topic| Some(topic.metadata.get(OVERLAY_OF)?.as_str())).collect();
    images.sort_by_cached_key(|topic| match look(topic) {
        _ if topic.is_ground_truth() => 4,
        _ if overlaid.contains(&*topic.name) => 0,
        Look::Image if is_range(topic) => 2,
        Look::Image => 1,
        _ => 3,
    });
    images
}

/// The overlays of an image: labels, then other derived images, then shapes, then ground truth.
pub(super) fn overlays<'a>(frame: &'a Frame, base: &Topic) -> Vec<&'a Topic> {
    let lies_on = |topic: &Topic| match topic.metadata.get(OVERLAY_OF) {
        Some(name) => **name == *base.name,
        // Label topics of a scan contain no images, and may have no messages at all.
        None => (look(topic) != Look::Image || is_annotation(topic)) && topic.latest.is_some(),
    };
    let other = |topic: &&Topic| topic.name != base.name || topic.run != base.run;
    let can = |topic: &&Topic| (is_image(topic) || is_annotation(topic)) && lies_on(topic);
    let mut overlays: Vec<_> = frame.topics.iter().filter(can).filter(other).collect();
    overlays.sort_by_cached_key(|topic| match look(topic) {
        _ if topic.is_ground_truth() => 3,
        _ if is_annotation(topic) => 2,
        Look::Labels => 0,
        _ => 1,
    });
    overlays
}

/// A decoded image and its texture.
#[derive(Default)]
pub(super) struct Layer {
    message: Option<SameMessage>,
    /// `None` before the first message.
    decoded: Option<Result<DecodedImage, String>>,
    /// The 2nd and 98th percentile of the values, in the image's own unit.
    range: Option<[f32; 2]>,
    /// Number of implausible values.
    implausible: usize,
    texture: CachedTexture<(SameMessage, Tint, TextureOptions, u64)>,
}

impl Layer {
    /// Decodes the topic's newest message, if it is a new one.
    pub(super) fn update(&mut self, topic: &Topic) {
        let Some(message) = topic.canonical().map(|message| SameMessage(message.clone())) else {
            let undecodable = topic.undecodable.as_deref().unwrap_or("its message does not decode");
            *self = Self {
                decoded: topic.latest.as_ref().map(|_| Err(undecodable.to_owned())),
                ..Self::default()
            };
            return;
        };
        if self.message.as_ref() != Some(&message) {
            let decoded = decode(&message.0);
            self.implausible = decoded.as_ref().map_or(0, DecodedImage::implausible);
            self.range = decoded.as_ref().ok().and_then(DecodedImage::value_range);
            self.decoded = Some(decoded);
            self.message = Some(message);
        }
    }

    /// The decoded image; `None` before the first message, an error where it cannot be shown.
    pub(super) fn state(&self) -> Result<Option<&DecodedImage>, &String> {
        self.decoded.as_ref().map(Result::as_ref).transpose()
    }

    /// Number of values of the image that cannot be.
    pub(super) fn implausible(&self) -> usize {
        self.implausible
    }

    /// The decoded image, if any.
    pub(super) fn image(&self) -> Option<&DecodedImage> {
        self.state().ok().flatten()
    }

    /// Size of one step of the image's values, m; for whole numbers `depth_step_m` is assumed.
    fn unit_m(&self, depth_step_m: f64) -> f64 {
        match self.image().map(|image| &image.pixels) {
            Some(Pixels::Values { whole: true, .. }) => depth_step_m,
            _ => 1.0,
        }
    }

    /// The ranges at the ends of the colour scale, m, rounded so that colours do not flicker between images.
    pub(super) fn range_m(&self, depth_step_m: f64) -> Option<[f64; 2]> {
        let [low, high] = self.range?.map(|value| f64::from(value) * self.unit_m(depth_step_m));
        let step = round_step((high - low) / 8.0);
        Some([(low / step).floor() * step, (high / step).ceil() * step])
    }

    /// The texture of the image with this appearance.
    pub(super) fn texture(
        &mut self,
        ctx: &Context,
        tint: &Tint,
        options: TextureOptions,
        depth_step_m: f64,
    ) -> Option<TextureId> {
        let unit_m = self.unit_m(depth_step_m);
        let range = self
            .range_m(depth_step_m)
            .map_or([0.0, 1.0], |range| range.map(|metres| (metres / unit_m) as f32));
        let (message, image) = (self.message.clone()?, self.decoded.as_ref()?.as_ref().ok()?);
        let most = ctx.input(|input| input.max_texture_side);
        let key = (message, tint.clone(), options, unit_m.to_bits());
        let make = || Some(image.paint(tint, range, most));
        self.texture.get(ctx, key, options, make).map(egui::TextureHandle::id)
    }

    /// The range at a position, given as fractions of width and height, m.
    pub(super) fn value_m(&self, at: [f64; 2], depth_step_m: f64) -> Option<f64> {
        let image = self.image()?;
        let index = image.index(at[0] * image.width as f64, at[1] * image.height as f64)?;
        let Pixels::Values { values, .. } = &image.pixels else { return None };
        let metres = f64::from(values[index]) * self.unit_m(depth_step_m);
        (metres.is_finite() && metres > 0.0).then_some(metres)
    }

    /// Text for a position, given as fractions of width and height.
    pub(super) fn describe(&self, at: [f64; 2], topic: &Topic, depth_step_m: f64) -> Option<String> {
        let look = look(topic);
        let image = self.image()?;
        let index = image.index(at[0] * image.width as f64, at[1] * image.height as f64)?;
        Some(match (&image.pixels, look) {
            (Pixels::Bytes(bytes), Look::Labels) => classes(topic).name(bytes[index]),
            (Pixels::Bytes(bytes), Look::Cost) if bytes[index] > 250 => "cost unknown".to_owned(),
            (Pixels::Bytes(bytes), Look::Cost) => format!("cost {:3}", bytes[index]),
            (Pixels::Bytes(bytes), Look::Image) => format!("grey {:3}", bytes[index]),
            (Pixels::Values { values, .. }, _) if values[index].is_nan() => "no range".to_owned(),
            (Pixels::Values { values, whole }, _) => {
                let metres = f64::from(values[index]) * if *whole { depth_step_m } else { 1.0 };
                format!("{metres:7.3} m")
            }
            (Pixels::Color(colors), _) => {
                let [r, g, b, _] = colors[index].to_array();
                format!("rgb {r:3} {g:3} {b:3}")
            }
        })
    }
}
