//! One image of a camera view: decoded and painted by another thread when its message or its appearance changes.

use crate::cached::SameMessage;
use crate::image::{DecodedImage, Pixels, Tint, decode};
use crate::prepare::{Painted, prepared_after};
use crate::view::{is_computed, is_twin};
use egui::{Color32, Context, Id, TextureId, TextureOptions};
use ocu_ui::legend::round_step;
use ocu_ui::palette::{self, Classes, Label, MapPalette};
use rcs_msg::Stamp;
use rcs_msg::classes::LabelClass;
use rcs_msg::foxglove::{CompressedImage, RawImage};
use rcs_runtime::Role;
use rcs_runtime::source::{Frame, Topic, frame_name};
use std::collections::BTreeSet;
use std::ops::Range;
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

/// What the numbers of an image are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quantity {
    /// Ranges, m: small ones are near.
    Range,
    /// Disparities, px: large ones are near.
    Disparity,
}

impl Quantity {
    /// By the topic's role, or by its type where a log has no role metadata.
    pub(super) fn of(topic: &Topic) -> Self {
        let is_disparity = topic.role().map_or_else(
            || matches!(topic.schema.name(), "stereo_msgs/DisparityImage" | "stereo_msgs/msg/DisparityImage"),
            |role| role == Role::Disparity,
        );
        if is_disparity { Self::Disparity } else { Self::Range }
    }

    /// Name of one of them.
    fn name(self) -> &'static str {
        match self {
            Self::Range => "range",
            Self::Disparity => "disparity",
        }
    }

    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::Range => "m",
            Self::Disparity => "px",
        }
    }

    /// Colour at a fraction of the scale, 0 to 1: what is near has one colour in images of both kinds.
    pub(super) fn color(self, fraction: f64) -> Color32 {
        match self {
            Self::Range => palette::range(fraction),
            Self::Disparity => palette::even(fraction),
        }
    }
}

/// Whether the image contains ranges, or disparities: by its role, or by its encoding where a log has no role metadata.
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

/// Whether the topic's messages are images of a camera.
pub(super) fn is_camera(topic: &Topic) -> bool {
    is_image(topic) && look(topic) == Look::Image && !is_range(topic) && !topic.is_ground_truth()
}

/// Number of parts between slashes in which two names agree from their start.
fn common_parts(a: &str, b: &str) -> usize {
    let [a, b] = [a, b].map(|name| name.trim_start_matches('/').split('/'));
    a.zip(b).take_while(|(a, b)| a == b).count()
}

/// Whether two images are of one camera: they were taken in one coordinate frame, or the name of one is that of the
/// other with a further part, such as `/compressed`.
fn are_of_one_camera(a: &Topic, b: &Topic) -> bool {
    let begins = |long: &str, short: &str| {
        long.strip_prefix(short).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    };
    begins(&a.name, &b.name)
        || begins(&b.name, &a.name)
        || optical_frame(a).is_some_and(|name| !name.is_empty() && optical_frame(b) == Some(name))
}

/// Whether a topic says that it lies on this image.
pub(super) fn lies_on(topic: &Topic, image: &Topic) -> bool {
    topic.metadata.get(OVERLAY_OF).is_some_and(|name| **name == *image.name)
}

/// All images, in this order: those with overlays, other camera images, depth images, derived images, ground truth. Of each
/// kind, recorded ones that the run computes, too, are the last.
pub(super) fn images(frame: &Frame) -> Vec<&Topic> {
    let mut images: Vec<_> = frame.topics.iter().filter(|topic| is_image(topic)).collect();
    let overlays = frame.topics.iter().filter(|topic| !topic.is_ground_truth());
    let overlaid: BTreeSet<&str> =
        overlays.filter_map(|topic| Some(topic.metadata.get(OVERLAY_OF)?.as_str())).collect();
    images.sort_by_cached_key(|topic| {
        let rank = match look(topic) {
            _ if topic.is_ground_truth() => 4,
            _ if overlaid.contains(&*topic.name) => 0,
            Look::Image if is_range(topic) => 2,
            Look::Image => 1,
            _ => 3,
        };
        (rank, is_twin(frame, topic))
    });
    images
}

/// Whether an image goes with the recorded topic of this name, where one is both recorded and computed: a recorded image that
/// the run computes, too, and any recorded image until the run has computed a message of the topic. Else it goes with the
/// computed one.
pub(super) fn takes_recorded(frame: &Frame, image: &Topic, name: &str) -> bool {
    is_twin(frame, image) || (image.run.is_recorded() && !is_computed(frame, name))
}

/// A topic that can lie over an image.
pub(super) struct Overlay<'a> {
    pub(super) topic: &'a Topic,
    /// Whether it is shown until a person switches it off.
    pub(super) is_usual: bool,
}

/// The overlays of an image: labels, then other derived images, then shapes, then ground truth.
///
/// Of those of this camera the first one and shapes are usual, but for what is predicted and ground truth. One that names
/// no image is of this camera where its name has more parts in common with that of the image than with those of all other
/// cameras; so it is of the only camera, and of none where several have as many.
///
/// Of one that is both recorded and computed, one is among them: see [`takes_recorded`].
pub(super) fn overlays<'a>(frame: &'a Frame, base: &Topic) -> Vec<Overlay<'a>> {
    let lies_on = |topic: &Topic| match topic.metadata.get(OVERLAY_OF) {
        Some(name) => **name == *base.name,
        // Label topics of a scan contain no images, and may have no messages at all.
        None => (look(topic) != Look::Image || is_annotation(topic)) && topic.latest.is_some(),
    };
    let other = |topic: &&Topic| topic.name != base.name;
    let can = |topic: &&Topic| (is_image(topic) || is_annotation(topic)) && lies_on(topic);
    let mut overlays: Vec<_> = frame.topics.iter().filter(can).filter(other).collect();
    let found: BTreeSet<_> = overlays.iter().map(|&topic| (&*topic.name, topic.run.is_recorded())).collect();
    overlays.retain(|topic| {
        let as_recorded = takes_recorded(frame, base, &topic.name);
        topic.run.is_recorded() == as_recorded || !found.contains(&(&*topic.name, as_recorded))
    });
    // Looking for cameras may convert messages, so that is done only where an overlay names no image.
    let is_unnamed = |topic: &&Topic| !topic.metadata.contains_key(OVERLAY_OF);
    let are_compared = overlays.iter().any(is_unnamed);
    let is_other = |topic: &&Topic| are_compared && is_camera(topic) && !are_of_one_camera(topic, base);
    let others: Vec<&Topic> = frame.topics.iter().filter(is_other).collect();
    let is_own = |topic: &Topic| {
        let own = common_parts(&topic.name, &base.name);
        !is_unnamed(&topic) || others.iter().all(|other| common_parts(&topic.name, &other.name) < own)
    };
    overlays.sort_by_cached_key(|topic| {
        let rank = match look(topic) {
            _ if topic.is_ground_truth() => 3,
            _ if is_annotation(topic) => 2,
            Look::Labels => 0,
            _ => 1,
        };
        (rank, !is_own(topic))
    });
    let first = overlays.iter().find(|topic| is_own(topic)).map(|first| &*first.name);
    let is_usual = |topic: &Topic| {
        (first == Some(&*topic.name) || is_annotation(topic))
            && is_own(topic)
            && topic.role() != Some(Role::Prediction)
            && !topic.is_ground_truth()
    };
    overlays.iter().map(|&topic| Overlay { topic, is_usual: is_usual(topic) }).collect()
}

/// A layer, or why it cannot be shown.
type Made = Result<Arc<Layer>, String>;

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
    let made = prepared_after(ctx, slot, key, move |last: Option<Arc<Made>>| {
        let greys = last.and_then(|last| (*last).as_ref().ok()?.image.grey_range());
        Layer::new(&topic, palette, depth_step_m, most, greys.as_ref()).map(Arc::new)
    });
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
    pub(super) quantity: Quantity,
    /// The values at the ends of the colour scale, in the unit of the quantity, rounded so that colours do not flicker
    /// between images.
    pub(super) range: Option<[f64; 2]>,
    /// Size of one step of the image's values, in that unit.
    step: f64,
    painted: Painted,
}

impl Layer {
    /// `greys` are the grey levels that were shown last.
    fn new(
        topic: &Topic,
        palette: MapPalette,
        depth_step_m: f64,
        most: usize,
        greys: Option<&Range<u32>>,
    ) -> Result<Self, String> {
        let undecodable = || topic.undecodable.as_deref().unwrap_or("its message does not decode").to_owned();
        let image = decode(topic.canonical().ok_or_else(undecodable)?, greys)?;
        let quantity = Quantity::of(topic);
        let step = match image.pixels {
            Pixels::Values { whole: true, .. } if quantity == Quantity::Range => depth_step_m,
            _ => 1.0,
        };
        let range = image.value_range().map(|range| {
            let [low, high] = range.map(|value| f64::from(value) * step);
            let round = round_step((high - low) / 8.0);
            [(low / round).floor() * round, (high / round).ceil() * round]
        });
        let ends = range.map_or([0.0, 1.0], |range| range.map(|value| (value / step) as f32));
        let look = look(topic);
        let classes = if look == Look::Labels { classes(topic) } else { Classes::default() };
        let tint = match look {
            Look::Image if quantity == Quantity::Disparity => Tint::Disparity,
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
            quantity,
            range,
            step,
            painted: Painted::new(image.paint(&tint, ends, most)),
            image,
        })
    }

    pub(super) fn texture(&self, ctx: &Context, options: TextureOptions) -> TextureId {
        self.painted.texture(ctx, options)
    }

    /// The range at a position of an image of ranges, given as fractions of width and height, m.
    pub(super) fn value_m(&self, at: [f64; 2]) -> Option<f64> {
        let index = self.index(at)?;
        let Pixels::Values { values, .. } = &self.image.pixels else { return None };
        let metres = f64::from(values[index]) * self.step;
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
            (Pixels::Greys { values, .. }, _) => format!("grey {:5}", values[index]),
            (Pixels::Values { values, .. }, _) if values[index].is_nan() => {
                format!("no {}", self.quantity.name())
            }
            (Pixels::Values { values, .. }, _) => {
                let value = f64::from(values[index]) * self.step;
                format!("{value:7.3} {}", self.quantity.unit())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Saved, base};
    use crate::samples;
    use rcs_msg::foxglove::ImageAnnotations;
    use rcs_runtime::source::RunTag;

    fn image(name: &str) -> Topic {
        samples::topic(name, 5.0, 0.1, RawImage::default())
    }

    fn shapes(name: &str) -> Topic {
        samples::topic(name, 5.0, 0.1, ImageAnnotations::default())
    }

    /// An image with this metadata.
    fn derived(name: &str, metadata: &[(&str, &str)]) -> Topic {
        let pairs = metadata.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned()));
        let mut topic = image(name);
        topic.metadata = Arc::new(pairs.collect());
        topic
    }

    /// The same topic as it was recorded.
    fn recorded(topic: &Topic) -> Topic {
        let mut topic = topic.clone();
        topic.run = RunTag::Recorded;
        topic
    }

    fn of(topics: &[Topic]) -> Frame {
        Frame { topics: topics.into(), ..samples::empty() }
    }

    /// The overlays of an image that are usual, and the number of all.
    fn usual(frame: &Frame, image: &str) -> (Vec<String>, usize) {
        let overlays = overlays(frame, frame.topic(image).unwrap());
        let usual = overlays.iter().filter(|overlay| overlay.is_usual);
        (usual.map(|overlay| overlay.topic.name.to_string()).collect(), overlays.len())
    }

    #[test]
    fn shapes_that_name_no_image_are_shown_on_the_camera_that_is_named_like_them() {
        let (front, back) = (image("/CAM_FRONT/image"), image("/CAM_BACK/image"));
        let of_none = shapes("/detections");
        let two = of(&[
            front.clone(),
            back,
            shapes("/CAM_FRONT/annotations"),
            shapes("/CAM_BACK/annotations"),
            of_none.clone(),
        ]);
        // The others are offered.
        assert_eq!(usual(&two, "/CAM_FRONT/image"), (vec!["/CAM_FRONT/annotations".to_owned()], 3));
        assert_eq!(usual(&two, "/CAM_BACK/image"), (vec!["/CAM_BACK/annotations".to_owned()], 3));
        let one = of(&[front, of_none]);
        assert_eq!(usual(&one, "/CAM_FRONT/image"), (vec!["/detections".to_owned()], 1));
    }

    #[test]
    fn shapes_that_are_named_like_several_cameras_are_offered_on_all_and_shown_on_none() {
        for [first, second, boxes] in [
            ["/robot/front/image", "/robot/rear/image", "/robot/detections"],
            // Only whole parts of names count.
            ["/depth_cam/image", "/rgb/image", "/detections"],
        ] {
            let frame = of(&[image(first), image(second), shapes(boxes)]);
            assert_eq!(usual(&frame, first), (Vec::new(), 1), "{boxes}");
            assert_eq!(usual(&frame, second), (Vec::new(), 1), "{boxes}");
        }
    }

    #[test]
    fn several_images_of_one_camera_show_the_shapes_that_name_none() {
        let compressed = samples::topic("/camera/image_raw/compressed", 5.0, 0.1, CompressedImage::default());
        let in_frame = |name: &str| {
            let image = RawImage { frame_id: "/camera_optical".to_owned(), ..RawImage::default() };
            samples::topic(name, 5.0, 0.1, image)
        };
        for [first, second] in [
            [image("/camera/image_raw"), compressed],
            [in_frame("/camera/image_raw"), in_frame("/rectified/image")],
        ] {
            let frame = of(&[first.clone(), second.clone(), shapes("/detections")]);
            for image in [first, second] {
                assert_eq!(usual(&frame, &image.name), (vec!["/detections".to_owned()], 1), "{}", image.name);
            }
        }
    }

    #[test]
    fn labels_of_another_camera_do_not_hide_the_first_overlay_of_this_one() {
        let frame = of(&[
            image("/front/image"),
            image("/rear/image"),
            derived("/front/cost", &[("rcs.role", "cost"), (OVERLAY_OF, "/front/image")]),
            derived("/rear/labels", &[("rcs.role", "labels")]),
        ]);
        assert_eq!(usual(&frame, "/front/image"), (vec!["/front/cost".to_owned()], 2));
        assert_eq!(usual(&frame, "/rear/image"), (vec!["/rear/labels".to_owned()], 1));
    }

    #[test]
    fn of_an_overlay_that_is_recorded_and_computed_the_one_of_the_run_of_the_image_is_shown() {
        let of_run = image("/front/image");
        let labels = derived("/front/labels", &[("rcs.role", "labels"), (OVERLAY_OF, "/front/image")]);
        let [image, recorded_labels] = [&of_run, &labels].map(recorded);
        let runs = |topics: &[&Topic], base: &Topic| -> Vec<RunTag> {
            let topics: Vec<Topic> = topics.iter().copied().cloned().collect();
            overlays(&of(&topics), base).iter().map(|overlay| overlay.topic.run).collect()
        };
        let all = [&image, &of_run, &recorded_labels, &labels];
        assert_eq!(runs(&all, &of_run), [RunTag::FIRST]);
        assert_eq!(runs(&all, &image), [RunTag::Recorded]);
        // A stack that computes labels on recorded images.
        assert_eq!(runs(&[&image, &recorded_labels, &labels], &image), [RunTag::FIRST]);
        assert_eq!(runs(&[&image, &labels], &image), [RunTag::FIRST]);
        let mut none_yet = labels.clone();
        none_yet.latest = None;
        assert_eq!(runs(&[&image, &recorded_labels, &none_yet], &image), [RunTag::Recorded]);
    }

    #[test]
    fn recorded_labels_are_no_overlay_of_the_same_labels_of_the_run() {
        let labels = derived("/front/labels", &[("rcs.role", "labels")]);
        let frame = of(&[recorded(&labels), labels]);
        assert_eq!(usual(&frame, "/front/labels"), (Vec::new(), 0));
    }

    #[test]
    fn the_image_of_the_run_comes_before_the_recorded_one_once_there_is_one() {
        let of_run = image("/front/image");
        let shown = |of_run: &Topic| {
            let frame = of(&[recorded(&image("/front/image")), of_run.clone()]);
            base(&Saved::default(), &frame).map(|topic| topic.run)
        };
        assert_eq!(shown(&of_run), Some(RunTag::FIRST));
        let nothing = Topic::new("/front/image", RunTag::FIRST, Arc::clone(&of_run.schema));
        assert_eq!(shown(&nothing), Some(RunTag::Recorded));
    }
}
