//! The layout that fits what a source has: no view without anything to show, and every camera. One that was kept for a
//! source with other names of images takes over those of this one.

use crate::layout::{Layout, Node};
use ocu_views::{RunChoice, SavedState, TopicKey, cameras, operator};
use rcs_runtime::source::{Frame, SourceKind, Topic};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

/// Most cameras that a layout shows at once.
const MOST_CAMERAS: usize = 4;

/// Types of messages that a map draws.
const DRAWN: [&str; 6] = [
    "foxglove.Odometry",
    "foxglove.PoseInFrame",
    "foxglove.LocationFix",
    "foxglove.PointCloud",
    "foxglove.Grid",
    "foxglove.PosesInFrame",
];

/// The layout for a source: a bundled one whose views all have something to show, or one that is made for it.
pub(crate) fn fitting(frame: &Frame) -> Layout {
    let cameras = cameras(frame);
    let is_drawn = |topic: &Topic| DRAWN.contains(&topic.type_name()) && !topic.is_ground_truth();
    let has = Content {
        map: frame.topics.iter().any(is_drawn),
        vehicle: operator::Inputs::of(frame) != operator::Inputs::default(),
        processes: !frame.processes.is_empty(),
        cameras,
    };
    let bundled = has.bundled(frame).and_then(Layout::bundled).and_then(Result::ok);
    if let Some(layout) = bundled.filter(|layout| names_only_what_is_there(&layout.root, frame)) {
        return layout;
    }
    let root = match (has.pictures(), has.map) {
        (Some(pictures), true) => {
            let left = Node::Column(vec![(3.0, pictures), (2.0, has.rest(true))]);
            Node::Row(vec![(5.0, left), (4.0, view("map"))])
        }
        (Some(pictures), false) => Node::Column(vec![(3.0, pictures), (2.0, has.rest(true))]),
        // Without pictures the map is what is looked at.
        (None, true) => Node::Row(vec![(3.0, view("map")), (2.0, has.rest(false))]),
        (None, false) => has.rest(true),
    };
    // A person who drives looks at the vehicle, and opens the list when it is needed.
    Layout { name: has.name(), buffers: !has.vehicle, root, ..Layout::empty() }
}

/// The layout for a source that is compared with another one: the view *Compare* alone.
pub(crate) fn comparing() -> Layout {
    Layout { name: "compare".to_owned(), buffers: false, root: view("compare"), ..Layout::empty() }
}

/// What a source has.
struct Content {
    cameras: Vec<TopicKey>,
    map: bool,
    vehicle: bool,
    processes: bool,
}

impl Content {
    /// The bundled layout that fits exactly.
    fn bundled(&self, frame: &Frame) -> Option<&'static str> {
        let images = self.cameras.len();
        match (frame.info.kind, self.processes) {
            (SourceKind::Stack, _) if self.vehicle && self.map && images > 0 => Some("simulation"),
            (SourceKind::Stack, _) => None,
            (_, true) if self.map && images == 1 => Some("default"),
            (_, true) => None,
            (_, false) => match (images, self.map) {
                (0, true) => Some("tracks"),
                (0, false) => Some("fields"),
                (1, true) => Some("recording"),
                _ => None,
            },
        }
    }

    /// The name of a layout that is made, under which it is kept as the person arranges it.
    fn name(&self) -> String {
        let base = match (self.vehicle, self.processes) {
            (true, _) => "vehicle",
            (false, true) => "processes",
            (false, false) => "recording",
        };
        match self.cameras.len() {
            0 => format!("{base} without cameras"),
            1 => format!("{base} with a camera"),
            count => format!("{base} with {count} cameras"),
        }
    }

    /// The cameras, each in a view of its own.
    fn pictures(&self) -> Option<Node> {
        let camera = |key: &TopicKey| {
            let state = serde_json::json!({ "topic": key });
            Node::View { kind: "camera".to_owned(), state, run: RunChoice::Shown, id: 0 }
        };
        let mut views: Vec<Node> = self.cameras.iter().take(MOST_CAMERAS).map(camera).collect();
        match views.len() {
            0 => None,
            1 => Some(views.remove(0)),
            _ => Some(Node::grid(views)),
        }
    }

    /// The views of numbers and texts, side by side where they have the width.
    fn rest(&self, is_wide: bool) -> Node {
        let mut tabs = vec![view("fields")];
        if self.processes {
            tabs.splice(0..0, [view("hierarchy"), view("tuning"), view("log")]);
        }
        let tabs = if tabs.len() == 1 { tabs.remove(0) } else { Node::Tabs { active: 0, tiles: tabs } };
        match (self.vehicle, is_wide) {
            (false, _) => tabs,
            (true, true) => Node::Row(vec![(1.0, view("drive")), (1.0, tabs)]),
            (true, false) => Node::Column(vec![(1.0, view("drive")), (1.0, tabs)]),
        }
    }
}

/// The layout with images of this source in the camera views that name topics it does not have. A view for which there is
/// no image says what is missing.
pub(crate) fn with_images_of(mut layout: Layout, frame: &Frame) -> Layout {
    let mut views = Vec::new();
    camera_views(&mut layout.root, &mut views);
    let named = views.iter().filter_map(|(state, _)| named_topic(state).map(str::to_owned));
    let images = replacements(&named.collect::<Vec<_>>(), frame);
    for (state, id) in views {
        if let Some(image) = named_topic(state).and_then(|name| images.get(name)) {
            state["topic"] = serde_json::json!(image);
            // A view that is open would keep what it shows.
            *id = 0;
        }
    }
    layout
}

/// An image for each name of which the source has no topic, as far as there are images that nobody names: those whose
/// names end most alike first; then the next camera, because a depth image or labels show something else.
fn replacements(named: &[String], frame: &Frame) -> BTreeMap<String, TopicKey> {
    let cameras = cameras(frame);
    let is_image = |topic: &&Topic| {
        matches!(topic.type_name(), "foxglove.RawImage" | "foxglove.CompressedImage")
            && !topic.is_ground_truth()
    };
    let others = frame.topics.iter().filter(is_image).map(TopicKey::of);
    let images: Vec<TopicKey> = cameras.iter().cloned().chain(others).collect();
    let missing: Vec<&str> =
        named.iter().map(String::as_str).filter(|name| frame.topic(name).is_none()).collect();
    let mut alike: Vec<(usize, &str, &TopicKey)> = Vec::new();
    for name in &missing {
        alike.extend(images.iter().map(|image| (common_end(name, &image.name), *name, image)));
    }
    alike.retain(|(parts, ..)| *parts > 0);
    // Of several that are as much alike, a camera comes first.
    alike.sort_by_key(|(parts, ..)| Reverse(*parts));
    let next = missing.iter().flat_map(|name| cameras.iter().map(move |image| (*name, image)));
    let mut taken: BTreeSet<&str> = named.iter().map(String::as_str).collect();
    let mut found: BTreeMap<String, TopicKey> = BTreeMap::new();
    for (name, image) in alike.iter().map(|(_, name, image)| (*name, *image)).chain(next) {
        if !found.contains_key(name) && taken.insert(&image.name) {
            found.insert(name.to_owned(), image.clone());
        }
    }
    found
}

/// In how many parts between slashes two names agree from their end. The kind of message, such as `image_raw` and
/// `compressed`, is no part of the name of a camera.
fn common_end(a: &str, b: &str) -> usize {
    let is_own = |part: &&str| !(part.starts_with("image") || part.starts_with("compressed"));
    let [a, b] = [a, b].map(|name| name.trim_start_matches('/').rsplit('/').filter(is_own));
    a.zip(b).take_while(|(a, b)| a == b).count()
}

/// The states and identities of all camera views.
fn camera_views<'a>(node: &'a mut Node, views: &mut Vec<(&'a mut SavedState, &'a mut u64)>) {
    match node {
        Node::Row(parts) | Node::Column(parts) => {
            for (_, node) in parts {
                camera_views(node, views);
            }
        }
        Node::Grid(nodes) | Node::Tabs { tiles: nodes, .. } => {
            for node in nodes {
                camera_views(node, views);
            }
        }
        Node::View { kind, state, id, .. } if *kind == "camera" => views.push((state, id)),
        Node::View { .. } => {}
    }
}

/// The name of the topic that a view shows, if it names one.
fn named_topic(state: &SavedState) -> Option<&str> {
    state.pointer("/topic/name").and_then(serde_json::Value::as_str)
}

/// Whether every topic that a view of the layout names exists.
fn names_only_what_is_there(node: &Node, frame: &Frame) -> bool {
    match node {
        Node::Row(parts) | Node::Column(parts) => {
            parts.iter().all(|(_, node)| names_only_what_is_there(node, frame))
        }
        Node::Grid(nodes) | Node::Tabs { tiles: nodes, .. } => {
            nodes.iter().all(|node| names_only_what_is_there(node, frame))
        }
        Node::View { state, .. } => named_topic(state).is_none_or(|name| frame.topic(name).is_some()),
    }
}

fn view(kind: &str) -> Node {
    Node::View { kind: kind.to_owned(), state: SavedState::Null, run: RunChoice::Shown, id: 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::{foxglove, schema_of};
    use rcs_runtime::source::RunTag;
    use std::sync::Arc;

    fn kinds(node: &Node) -> Vec<&str> {
        match node {
            Node::Row(parts) | Node::Column(parts) => {
                parts.iter().flat_map(|(_, node)| kinds(node)).collect()
            }
            Node::Grid(nodes) | Node::Tabs { tiles: nodes, .. } => nodes.iter().flat_map(kinds).collect(),
            Node::View { kind, .. } => vec![kind],
        }
    }

    /// A log with so many cameras, perhaps with odometry.
    fn log(images: usize, has_odometry: bool) -> Frame {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("drive.mcap");
        crate::sample::write(&path, 0.5, false).unwrap();
        let request = crate::open::Request { log: Some(path), ..crate::open::Request::default() };
        let mut frame = crate::render::frame_at(&request, 0.0).unwrap();
        let image = schema_of::<foxglove::CompressedImage>();
        let topics =
            (0..images).map(|i| Topic::new(&format!("/cam{i}"), RunTag::Recorded, Arc::clone(image)));
        let odometry = schema_of::<foxglove::Odometry>();
        let odometry = has_odometry.then(|| Topic::new("/odom", RunTag::Recorded, Arc::clone(odometry)));
        frame.topics = topics.chain(odometry).collect();
        frame.processes = Arc::new([]);
        frame
    }

    /// A layout with a camera view for each name, whose identities are 7, 8, …
    fn with_cameras(names: &[&str]) -> Layout {
        let view = |(name, id): (&&str, u64)| {
            let state = serde_json::json!({ "topic": { "name": name }, "depth_step_m": 0.002 });
            (1.0, Node::View { kind: "camera".to_owned(), state, run: RunChoice::Shown, id })
        };
        Layout { root: Node::Row(names.iter().zip(7..).map(view).collect()), ..Layout::empty() }
    }

    /// What the camera views of a layout show, and their identities.
    fn shown(mut layout: Layout) -> Vec<(String, u64)> {
        let mut views = Vec::new();
        camera_views(&mut layout.root, &mut views);
        let of = |(state, id): &(&mut SavedState, &mut u64)| {
            assert_eq!(state["depth_step_m"], 0.002);
            (named_topic(state).unwrap().to_owned(), **id)
        };
        views.iter().map(of).collect()
    }

    #[test]
    fn a_layout_that_was_kept_for_a_source_with_other_cameras_shows_those_of_this_one() {
        let layout = with_cameras(&["/left", "/cam0", "/right"]);
        let expect = [("/cam1", 0), ("/cam0", 8), ("/right", 9)].map(|(name, id)| (name.to_owned(), id));
        assert_eq!(shown(with_images_of(layout, &log(2, false))), expect);
    }

    #[test]
    fn images_that_are_named_alike_take_the_place_of_each_other_and_give_it_back() {
        let (base, image) = (log(0, false), schema_of::<foxglove::RawImage>());
        let source = |names: &[&str]| {
            let topic = |name: &&str| {
                let mut topic = Topic::new(name, RunTag::Recorded, Arc::clone(image));
                if name.contains("depth") {
                    let role = ("rcs.role".to_owned(), "depth".to_owned());
                    topic.metadata = Arc::new(BTreeMap::from([role]));
                }
                topic
            };
            Frame { topics: names.iter().map(topic).collect(), ..base.clone() }
        };
        let names = |layout: &Layout| {
            shown(layout.clone()).into_iter().map(|(name, _)| name).collect::<Vec<String>>()
        };
        let a = source(&["/a/left/image", "/a/right/image", "/a/depth/image"]);
        let b = source(&["/b/left/image_raw", "/b/right/image_raw", "/b/depth/image_rect"]);
        // The tiles were exchanged.
        let own = with_cameras(&["/a/right/image", "/a/left/image", "/a/depth/image"]);
        let in_b = with_images_of(own.clone(), &b);
        assert_eq!(names(&in_b), ["/b/right/image_raw", "/b/left/image_raw", "/b/depth/image_rect"]);
        assert_eq!(names(&with_images_of(in_b, &a)), names(&own));
        // No depth image takes the place of a camera, and what is missing stays named.
        let c = source(&["/cam0", "/c/depth/image"]);
        let in_c = with_images_of(with_cameras(&["/a/left/image", "/a/right/image"]), &c);
        assert_eq!(names(&in_c), ["/cam0", "/a/right/image"]);
    }

    #[test]
    fn a_camera_that_is_recorded_and_computed_is_counted_once_as_that_of_the_run() {
        let mut frame = log(2, false);
        let recorded = Arc::clone(&frame.topics);
        let of_run =
            recorded.iter().map(|topic| Topic::new(&topic.name, RunTag::FIRST, Arc::clone(&topic.schema)));
        frame.topics = recorded.iter().cloned().chain(of_run).collect();
        let mut layout = fitting(&frame);
        assert_eq!(layout.name, "recording with 2 cameras");
        let mut views = Vec::new();
        camera_views(&mut layout.root, &mut views);
        let keys: Vec<_> = views.iter().map(|(state, _)| state["topic"].clone()).collect();
        assert_eq!(keys, ["/cam0", "/cam1"].map(|name| serde_json::json!(TopicKey::shown(name))));
    }

    #[test]
    fn a_log_opens_with_every_camera_and_without_empty_views() {
        for images in 0..7 {
            for has_odometry in [false, true] {
                let layout = fitting(&log(images, has_odometry));
                let kinds = kinds(&layout.root);
                let count = |wanted: &str| kinds.iter().filter(|kind| **kind == wanted).count();
                assert_eq!(count("camera"), images.min(MOST_CAMERAS), "{images}: {kinds:?}");
                assert_eq!(count("map"), usize::from(has_odometry), "{images}: {kinds:?}");
                assert_eq!((count("fields"), count("hierarchy"), count("drive")), (1, 0, 0), "{kinds:?}");
            }
        }
    }
}
