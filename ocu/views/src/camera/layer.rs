//! One image of a camera view: decoded and painted by another thread when its message or its appearance changes.

use crate::cached::SameMessage;
use crate::image::{DecodedImage, Pixels, Tint, decode};
use crate::prepare::{Painted, prepared};
use egui::{Color32, Context, Id, TextureId, TextureOptions};
use ocu_ui::legend::round_step;
use ocu_ui::palette::{Classes, Label, MapPalette};
use rcs_msg::Stamp;
use rcs_msg::classes::LabelClass;
use rcs_msg::foxglove::{CompressedImage, RawImage};
use rcs_runtime::Role;
use rcs_runtime::source::{Frame, Topic, frame_name};
use std::collections::BTreeSet;
use std::sync::Arc;

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
    if let Some(role) = topic.role() {
        return matches!(role, Role::Depth | Role::Disparity);
    }
    let is_depth = |raw: &RawImage| matches!(&*raw.encoding, "16UC1" | "32FC1" | "64FC1");
    topic.get::<RawImage>().is_some_and(is_depth)
}

/// The label classes in the topic's metadata.
fn classes(topic: &Topic) -> Classes {
    let label = |class: LabelClass| {
        let [r, g, b] = class.color;
        Label { value: class.value, name: class.name.into_owned(), color: Color32::from_rgb(r, g, b) }
    };
    topic.classes().into_iter().map(label).collect()
}

/// The coordinate frame in which an image was taken, without a slash at its start.
pub(super) fn optical_frame(image: &Topic) -> Option<&str> {
    let raw = image.get::<RawImage>().map(|raw| raw.frame_id.as_str());
    raw.or_else(|| image.get::<CompressedImage>().map(|compressed| compressed.frame_id.as_str()))
        .map(frame_name)
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

/// The image of a topic's newest message, with costs in the colours of `palette`; `depth_step_m` is the size of one step
/// of a depth image with whole numbers. `None` before the first message, and until the first image is decoded; the error
/// says why it cannot be shown. Views share it.
pub(super) fn layer(
    ctx: &Context,
    topic: &Topic,
    palette: MapPalette,
    depth_step_m: f64,
) -> Result<Option<Arc<Layer>>, String> {
    let Some(sample) = &topic.latest else { return Ok(None) };
    let most = ctx.input(|input| input.max_texture_side);
    let slot = Id::unique(("image", &*topic.name, topic.run, palette, depth_step_m.to_bits()));
    let key = (SameMessage(sample.message.clone()), Arc::clone(&topic.metadata), most);
    let topic = topic.clone();
    let made =
        prepared(ctx, slot, key, move || Layer::new(&topic, palette, depth_step_m, most).map(Arc::new));
    made.map(|made| (*made).clone()).transpose()
}

/// A decoded image and its texture.
pub(super) struct Layer {
    pub(super) image: DecodedImage,
    /// The coordinate frame in which it was taken.
    pub(super) optical_frame: String,
    /// When it was taken, and when it was logged.
    pub(super) taken: Stamp,
    pub(super) log_time: Stamp,
    pub(super) look: Look,
    /// The classes of labels; of other images, none.
    pub(super) classes: Classes,
    /// Number of values that cannot be.
    pub(super) implausible: usize,
    /// The ranges at the ends of the colour scale, m, rounded so that colours do not flicker between images.
    pub(super) range_m: Option<[f64; 2]>,
    /// Size of one step of the image's values, m.
    unit_m: f64,
    painted: Painted,
}

impl Layer {
    fn new(topic: &Topic, palette: MapPalette, depth_step_m: f64, most: usize) -> Result<Self, String> {
        let undecodable = || topic.undecodable.as_deref().unwrap_or("its message does not decode").to_owned();
        let image = decode(topic.canonical().ok_or_else(undecodable)?)?;
        let unit_m = match image.pixels {
            Pixels::Values { whole: true, .. } => depth_step_m,
            _ => 1.0,
        };
        let range_m = image.value_range().map(|range| {
            let [low, high] = range.map(|value| f64::from(value) * unit_m);
            let step = round_step((high - low) / 8.0);
            [(low / step).floor() * step, (high / step).ceil() * step]
        });
        let range = range_m.map_or([0.0, 1.0], |range| range.map(|metres| (metres / unit_m) as f32));
        let look = look(topic);
        let classes = if look == Look::Labels { classes(topic) } else { Classes::default() };
        let tint = match look {
            Look::Image => Tint::Plain,
            Look::Labels => Tint::Labels(classes.clone()),
            Look::Cost => Tint::Cost(palette),
        };
        Ok(Self {
            optical_frame: optical_frame(topic).unwrap_or_default().to_owned(),
            taken: topic.acq_time().unwrap_or_default(),
            log_time: topic.latest.as_ref().map(|sample| sample.header.log_time).unwrap_or_default(),
            look,
            classes,
            implausible: image.implausible(),
            range_m,
            unit_m,
            painted: Painted::new(image.paint(&tint, range, most)),
            image,
        })
    }

    pub(super) fn texture(&self, ctx: &Context, options: TextureOptions) -> TextureId {
        self.painted.texture(ctx, options)
    }

    /// The range at a position, given as fractions of width and height, m.
    pub(super) fn value_m(&self, at: [f64; 2]) -> Option<f64> {
        let index = self.index(at)?;
        let Pixels::Values { values, .. } = &self.image.pixels else { return None };
        let metres = f64::from(values[index]) * self.unit_m;
        (metres.is_finite() && metres > 0.0).then_some(metres)
    }

    /// Text for a position, given as fractions of width and height.
    pub(super) fn describe(&self, at: [f64; 2]) -> Option<String> {
        let index = self.index(at)?;
        Some(match (&self.image.pixels, self.look) {
            (Pixels::Bytes(bytes), Look::Labels) => self.classes.name(bytes[index]),
            (Pixels::Bytes(bytes), Look::Cost) if bytes[index] > 250 => "cost unknown".to_owned(),
            (Pixels::Bytes(bytes), Look::Cost) => format!("cost {:3}", bytes[index]),
            (Pixels::Bytes(bytes), Look::Image) => format!("grey {:3}", bytes[index]),
            (Pixels::Values { values, .. }, _) if values[index].is_nan() => "no range".to_owned(),
            (Pixels::Values { values, .. }, _) => {
                let metres = f64::from(values[index]) * self.unit_m;
                format!("{metres:7.3} m")
            }
            (Pixels::Color(colors), _) => {
                let [r, g, b, _] = colors[index].to_array();
                format!("rgb {r:3} {g:3} {b:3}")
            }
        })
    }

    fn index(&self, at: [f64; 2]) -> Option<usize> {
        self.image.index(at[0] * self.image.width as f64, at[1] * self.image.height as f64)
    }
}
