//! One image of a camera view: decoded when its message changes, painted when its look changes.

use crate::image::{DecodedImage, Pixels, Tint, decode};
use crate::texture::{CachedTexture, SameMessage};
use egui::{Color32, Context, TextureId, TextureOptions};
use ocu_ui::legend::round_step;
use ocu_ui::palette::{Classes, Label, MapPalette};
use rcs_msg::classes::LabelClass;
use rcs_msg::foxglove::RawImage;
use rcs_runtime::Role;
use rcs_runtime::source::{Frame, Topic};

/// How an image is painted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Look {
    /// An image, or ranges.
    Image,
    /// One label a pixel.
    Labels,
    /// One cost a pixel.
    Cost,
}

/// What the topic's metadata say of it.
pub(super) fn look(topic: &Topic) -> Look {
    match topic.role() {
        Some(Role::Labels) => Look::Labels,
        Some(Role::Cost) => Look::Cost,
        _ => Look::Image,
    }
}

/// Whether the image holds ranges: by its role, or by its encoding where a log of others tells no role.
fn is_range(topic: &Topic) -> bool {
    match topic.role() {
        Some(role) => matches!(role, Role::Depth | Role::Disparity),
        None => topic.get::<RawImage>().is_some_and(|raw| matches!(&*raw.encoding, "16UC1" | "32FC1")),
    }
}

/// The classes that the topic's labels name.
pub(super) fn classes(topic: &Topic) -> Classes {
    let label = |class: LabelClass| {
        let [r, g, b] = class.color;
        Label { value: class.value, name: class.name.into_owned(), color: Color32::from_rgb(r, g, b) }
    };
    topic.classes().into_iter().map(label).collect()
}

/// How the topic's bytes become colours.
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

/// All images: first those that something lies on, then other pictures, then depths, then what was made of them, and at
/// the end the ground truth, which no robot has.
pub(super) fn images(frame: &Frame) -> Vec<&Topic> {
    let mut images: Vec<_> = frame.topics.iter().filter(|topic| is_image(topic)).collect();
    let has_overlay = |image: &Topic| {
        let lies_on =
            |topic: &&Topic| topic.metadata.get("rcs.overlay_of").is_some_and(|name| **name == *image.name);
        frame.topics.iter().filter(lies_on).any(|topic| !topic.is_ground_truth())
    };
    images.sort_by_key(|topic| match look(topic) {
        _ if topic.is_ground_truth() => 4,
        _ if has_overlay(topic) => 0,
        Look::Image if is_range(topic) => 2,
        Look::Image => 1,
        _ => 3,
    });
    images
}

/// What can be laid over an image: labels, then what else was made of it, then shapes, then the ground truth.
pub(super) fn overlays<'a>(frame: &'a Frame, base: &Topic) -> Vec<&'a Topic> {
    let lies_on = |topic: &Topic| match topic.metadata.get("rcs.overlay_of") {
        Some(name) => **name == *base.name,
        // Labels of a scan are no image: they may never come.
        None => (look(topic) != Look::Image || is_annotation(topic)) && topic.latest.is_some(),
    };
    let other = |topic: &&Topic| topic.name != base.name || topic.run != base.run;
    let can = |topic: &&Topic| (is_image(topic) || is_annotation(topic)) && lies_on(topic);
    let mut overlays: Vec<_> = frame.topics.iter().filter(can).filter(other).collect();
    overlays.sort_by_key(|topic| match look(topic) {
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
    /// `None` while no message has come.
    decoded: Option<Result<DecodedImage, String>>,
    /// The 2 % and 98 % values, in the image's own unit.
    range: Option<[f32; 2]>,
    texture: CachedTexture<(SameMessage, Tint, TextureOptions, u64)>,
}

impl Layer {
    /// Decodes the topic's newest message, if that is another one than before.
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
            self.range = decoded.as_ref().ok().and_then(DecodedImage::value_range);
            self.decoded = Some(decoded);
            self.message = Some(message);
        }
    }

    /// The decoded image; `None` while none has come, an error where it cannot be shown.
    pub(super) fn state(&self) -> Result<Option<&DecodedImage>, &String> {
        self.decoded.as_ref().map(Result::as_ref).transpose()
    }

    /// The decoded image, where there is one.
    pub(super) fn image(&self) -> Option<&DecodedImage> {
        self.state().ok().flatten()
    }

    /// What one step of the image's values is, in metres, where a whole number's is assumed to be `depth_step_m`.
    fn unit_m(&self, depth_step_m: f64) -> f64 {
        match self.image().map(|image| &image.pixels) {
            Some(Pixels::Values { whole: true, .. }) => depth_step_m,
            _ => 1.0,
        }
    }

    /// The ranges that the ends of the colour scale stand for, in metres: round numbers, so that colours do not
    /// flicker from image to image.
    pub(super) fn range_m(&self, depth_step_m: f64) -> Option<[f64; 2]> {
        let [low, high] = self.range?.map(|value| f64::from(value) * self.unit_m(depth_step_m));
        let step = round_step((high - low) / 8.0);
        Some([(low / step).floor() * step, (high / step).ceil() * step])
    }

    /// The texture of the image in this look.
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

    /// What the layer says of a place, given in parts of its width and height.
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
