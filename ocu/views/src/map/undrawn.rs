//! Topics that are expected on a map and are not drawn: those whose newest message cannot be read, with the reason, and
//! those of well-known types that no view draws. They are listed, so that nothing is missing without being mentioned.

use crate::cached::SameMessage;
use crate::prepare::shared;
use crate::toolbar::topic_label;
use egui::{Context, Id, Label, RichText, Ui};
use ocu_ui::tokens;
use rcs_runtime::source::{Frame, Topic};

/// Greatest number of topics that are listed.
const MOST: usize = 8;

/// Canonical types of which the map draws the newest message.
const DRAWN: [&str; 6] = [
    "foxglove.Grid",
    "foxglove.PointCloud",
    "foxglove.PosesInFrame",
    "foxglove.SceneUpdate",
    "rcs.Plan",
    "rcs.ArcChoice",
];

/// Canonical types of which the map draws the track of all messages.
const TRACKS: [&str; 3] = ["foxglove.Odometry", "foxglove.PoseInFrame", "foxglove.LocationFix"];

/// ROS types whose conversion is refused if the log defines them otherwise than ROS does; then they have no canonical
/// type.
const CONVERTED: [&str; 14] = [
    "geometry_msgs/PolygonStamped",
    "geometry_msgs/PoseArray",
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "grid_map_msgs/GridMap",
    "nav2_msgs/Costmap",
    "nav_msgs/OccupancyGrid",
    "nav_msgs/Odometry",
    "nav_msgs/Path",
    "sensor_msgs/LaserScan",
    "sensor_msgs/NavSatFix",
    "sensor_msgs/PointCloud2",
    "visualization_msgs/Marker",
    "visualization_msgs/MarkerArray",
];

/// Types that show something in space or in a picture, and that no view draws.
const NOT_DRAWN: [&str; 11] = [
    "foxglove.CompressedVideo",
    "foxglove.GeoJSON",
    "geometry_msgs/PointStamped",
    "map_msgs/OccupancyGridUpdate",
    "nav_msgs/GridCells",
    "octomap_msgs/Octomap",
    "sensor_msgs/PointCloud",
    "sensor_msgs/Range",
    "vision_msgs/Detection2DArray",
    "vision_msgs/Detection3D",
    "vision_msgs/Detection3DArray",
];

/// A topic that is not drawn.
#[derive(Debug, PartialEq)]
struct Undrawn {
    /// What is said of it.
    text: String,
    /// Whether it would be drawn if its message could be read.
    is_fault: bool,
}

/// The topics of a frame that are not drawn, first those that cannot be read; the last entry may say how many more there
/// are.
fn undrawn(ctx: &Context, frame: &Frame) -> Vec<Undrawn> {
    let mut all = Vec::new();
    for topic in frame.topics.iter() {
        let name = || topic_label(frame, topic);
        // A ROS type may be written with and without its folder.
        let type_name = topic.type_name().replacen("/msg/", "/", 1);
        if let Some(reason) = fault(ctx, frame, topic, &type_name) {
            all.push(Undrawn { text: format!("not drawn: {}: {reason}", name()), is_fault: true });
        } else if topic.messages > 0 && NOT_DRAWN.contains(&&*type_name) {
            all.push(Undrawn { text: format!("not drawn: {} ({type_name})", name()), is_fault: false });
        }
    }
    all.sort_by_key(|topic| !topic.is_fault);
    if all.len() > MOST {
        let more = all.drain(MOST..).count();
        all.push(Undrawn { text: format!("and {more} more"), is_fault: false });
    }
    all
}

/// Why the newest message of a topic that the map draws cannot be read; `None` if it can, or if there is none.
fn fault(ctx: &Context, frame: &Frame, topic: &Topic, type_name: &str) -> Option<String> {
    let sample = topic.latest.as_ref()?;
    let has_track = || frame.tracks.iter().any(|track| track.topic == topic.name && !track.points.is_empty());
    let is_expected = DRAWN.contains(&type_name)
        || CONVERTED.contains(&type_name)
        || (TRACKS.contains(&type_name) && !has_track());
    // Entities are gathered from messages that were read, so the newest one is not converted to find that out.
    let is_read = || frame.has_all_entities(topic) == Some(true) || topic.canonical().is_some();
    if !is_expected || is_read() {
        return None;
    }
    let slot = Id::unique(("undrawn", &*topic.name, topic.run));
    let reason = shared(ctx, slot, SameMessage(sample.message.clone()), || {
        let converted = rcs_msg::canonical(&sample.message.schema(), &sample.message.bytes());
        converted?.err().map(|error| error.to_string())
    });
    let known = || match &topic.undecodable {
        Some(reason) => reason.to_string(),
        None => format!("messages in {} are not converted", topic.schema.message_encoding().name()),
    };
    Some((*reason).clone().unwrap_or_else(known))
}

/// Lists the topics that are not drawn, at the end of the layer panel.
pub(super) fn list(ui: &mut Ui, frame: &Frame) {
    let all = undrawn(ui.ctx(), frame);
    if all.is_empty() {
        return;
    }
    let tokens = tokens(ui);
    ui.separator();
    for topic in all {
        let color = if topic.is_fault { tokens.warning } else { tokens.weak };
        ui.add(Label::new(RichText::new(topic.text).small().color(color)).wrap());
    }
}

/// The hint of a map that draws nothing, with the topics that are not drawn.
pub(super) fn with_hint(hint: &str, ctx: &Context, frame: &Frame) -> String {
    let topics = undrawn(ctx, frame).into_iter().map(|topic| topic.text);
    std::iter::once(hint.to_owned()).chain(topics).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use rcs_bus::{Header, Sample, WriterId};
    use rcs_msg::{AnyMessage, MessageEncoding, Schema};
    use rcs_runtime::source::RunTag;
    use std::sync::Arc;

    /// A topic of a recording with a message that is no CDR.
    fn ros(name: &str, schema: &str) -> Topic {
        // Nothing can be read from a ROS 2 definition in another language, so its name alone counts.
        let schema = Arc::new(Schema::new(schema, MessageEncoding::Cdr, "ros2idl", Vec::new().into()));
        let message = AnyMessage::encoded(Arc::clone(&schema), vec![1, 2, 3].into());
        let (now, writer) = (samples::NOW, WriterId::RUNTIME);
        let header = Header { sequence: 1, log_time: now, acq_time: now, writer };
        let mut topic = Topic::new(name, RunTag::Recorded, schema).with_latest(Sample { header, message });
        topic.messages = 7;
        topic
    }

    fn texts(topics: Vec<Topic>) -> Vec<String> {
        let mut frame = samples::empty();
        frame.topics = topics.into();
        undrawn(&Context::default(), &frame).into_iter().map(|topic| topic.text).collect()
    }

    #[test]
    fn a_cloud_that_cannot_be_read_is_listed_with_its_reason_before_types_that_no_view_draws() {
        let octomap = ros("/octomap", "octomap_msgs/msg/Octomap");
        let markers = ros("/markers", "visualization_msgs/msg/MarkerArray");
        let points = ros("/points", "sensor_msgs/msg/PointCloud2");
        let texts = texts(vec![octomap, markers, points, ros("/text", "a/msg/B")]);
        assert_eq!(texts.len(), 3, "{texts:?}");
        assert!(
            texts[0].starts_with("not drawn: /markers: visualization_msgs/msg/MarkerArray does not decode: ")
        );
        assert!(texts[1].starts_with("not drawn: /points: sensor_msgs/msg/PointCloud2 does not decode: "));
        assert_eq!(texts[2], "not drawn: /octomap (octomap_msgs/Octomap)");
    }

    #[test]
    fn only_topics_with_messages_are_listed_and_no_more_than_fit() {
        let empty = || {
            let mut topic = ros("/empty", "nav_msgs/msg/GridCells");
            topic.messages = 0;
            topic
        };
        assert!(texts(vec![empty()]).is_empty());
        let update = |i: usize| ros(&format!("/update_{i}"), "map_msgs/msg/OccupancyGridUpdate");
        let many = (0..11).map(update).chain([empty()]);
        let texts = texts(many.collect());
        assert_eq!((texts.len(), &*texts[8]), (9, "and 3 more"));
    }

    #[test]
    fn the_listed_ros_types_are_converted_and_those_that_no_view_draws_are_not() {
        for name in CONVERTED {
            assert!(ros("/a", name).type_name().starts_with("foxglove."), "{name}");
        }
        for name in NOT_DRAWN {
            assert_eq!(ros("/a", name).type_name(), name);
        }
    }

    #[test]
    fn what_is_drawn_is_not_listed() {
        let frame = samples::full();
        let listed = undrawn(&Context::default(), &frame);
        assert!(listed.is_empty(), "{listed:?}");
    }
}
