//! The layers of a map: everything in a frame that lies in a plane, and its pose.

use super::grid::frame_of;
use super::track::{Alignment, Placed, WGS84, local_enu};
use crate::clip::Near;
use crate::texture::SameMessage;
use crate::view::rate_hz;
use ocu_ui::stale::is_stale;
use rcs_geom::{Enu, Pose, TransformError};
use rcs_msg::foxglove::{PointCloud, PoseInFrame, PosesInFrame};
use rcs_msg::{AnyMessage, Stamp};
use rcs_runtime::Role;
use rcs_runtime::source::{Frame, Topic, Track};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Content of a layer.
#[derive(Clone, Copy)]
pub(super) enum Kind<'a> {
    /// A grid of cells.
    Grid(&'a AnyMessage),
    /// A point cloud.
    Cloud(&'a PointCloud),
    /// A planned path.
    Path(&'a PosesInFrame),
    /// A goal.
    Goal(&'a PoseInFrame),
    /// The track of a moving object.
    Track(&'a Arc<Track>),
}

/// One layer.
#[derive(Clone)]
pub(super) struct Layer<'a> {
    /// Name in layouts and on the screen: that of the topic.
    pub(super) name: String,
    /// Its content.
    pub(super) kind: Kind<'a>,
    /// Its coordinate frame.
    pub(super) frame_id: &'a str,
    /// Time for which the content is valid.
    pub(super) stamp: Stamp,
    /// The topic; a track may exist without one.
    pub(super) topic: Option<&'a Topic>,
}

impl Layer<'_> {
    /// Whether it is the ground truth of a simulation.
    pub(super) fn is_ground_truth(&self) -> bool {
        self.topic.is_some_and(Topic::is_ground_truth)
    }

    /// Whether it is a fused map.
    pub(super) fn is_map(&self) -> bool {
        !self.is_ground_truth() && self.topic.is_some_and(|topic| topic.role() == Some(Role::Map))
    }

    /// Whether a map already contains it: costs of one source, or the cloud from which they come.
    pub(super) fn is_part_of_a_map(&self) -> bool {
        self.topic.is_some_and(|topic| matches!(topic.role(), Some(Role::Cost | Role::Cloud)))
    }

    /// Whether it is outdated relative to its rate.
    pub(super) fn is_stale(&self, now: Stamp) -> bool {
        self.topic.is_some_and(|topic| topic.age_s(now).is_some_and(|age_s| is_stale(age_s, rate_hz(topic))))
    }

    /// The message that it shows; `None` for a track, which consists of many.
    pub(super) fn message(&self) -> Option<SameMessage> {
        Some(SameMessage(self.topic?.canonical()?.clone()))
    }
}

/// Whether the topic contains a goal, whose positions are not a track.
fn is_goal(topic: &Topic) -> bool {
    topic.role() == Some(Role::Goal) && topic.type_name() == "foxglove.PoseInFrame"
}

/// All layers of a frame from bottom to top; ground truth is on top of its kind.
pub(super) fn layers(frame: &Frame) -> Vec<Layer<'_>> {
    let (mut grids, mut clouds, mut paths) = (Vec::new(), Vec::new(), Vec::new());
    for topic in frame.topics.iter() {
        let Some(sample) = &topic.latest else { continue };
        let stamp = sample.header.acq_time;
        let layer = |kind, frame_id| {
            let name = crate::toolbar::topic_label(frame, topic);
            Layer { name, kind, frame_id, stamp, topic: Some(topic) }
        };
        match topic.type_name() {
            "foxglove.Grid" => {
                let message = topic.canonical();
                let named = message.and_then(|message| Some((message, frame_of(message)?)));
                grids.extend(named.map(|(message, frame_id)| layer(Kind::Grid(message), frame_id)));
            }
            "foxglove.PointCloud" => {
                clouds.extend(
                    topic.get::<PointCloud>().map(|cloud| layer(Kind::Cloud(cloud), &cloud.frame_id)),
                );
            }
            "foxglove.PosesInFrame" => {
                paths.extend(topic.get::<PosesInFrame>().map(|path| layer(Kind::Path(path), &path.frame_id)));
            }
            "foxglove.PoseInFrame" if is_goal(topic) => {
                paths.extend(topic.get::<PoseInFrame>().map(|goal| layer(Kind::Goal(goal), &goal.frame_id)));
            }
            _ => {}
        }
    }
    let tracks = frame.tracks.values().filter(|track| !track.points.is_empty()).map(|track| Layer {
        name: track.topic.to_string(),
        kind: Kind::Track(track),
        frame_id: &track.frame_id,
        stamp: frame.now,
        topic: frame.topic(&track.topic),
    });
    let tracks = tracks.filter(|layer| !layer.topic.is_some_and(is_goal));
    let mut layers: Vec<_> = grids.into_iter().chain(clouds).chain(paths).chain(tracks).collect();
    layers.sort_by_key(Layer::is_ground_truth);
    layers
}

/// Frames in which a map can be drawn: those of its layers, then those of the transforms.
pub(super) fn frames<'a>(frame: &'a Frame, layers: &[Layer<'a>]) -> Vec<&'a str> {
    let mut frames: Vec<&str> = Vec::new();
    let transforms = frame.transforms.frames();
    for name in layers.iter().map(|layer| layer.frame_id).chain(transforms) {
        if !frames.contains(&name) {
            frames.push(name);
        }
    }
    frames
}

/// The default frame of a map: that of a grid, otherwise the local east-north-up frame where positions are geodetic,
/// otherwise that of a track, otherwise the root above the first cloud.
pub(super) fn default_frame<'a>(frame: &'a Frame, layers: &[Layer<'a>]) -> Option<&'a str> {
    let find =
        |is: &dyn Fn(&Layer<'_>) -> bool| layers.iter().find(|layer| !layer.is_ground_truth() && is(layer));
    let grid = find(&|layer| matches!(layer.kind, Kind::Grid(_)));
    let degrees = find(&|layer| layer.frame_id == WGS84);
    let track = find(&|layer| matches!(layer.kind, Kind::Track(_)));
    if let Some(layer) = grid.or(degrees).or(track) {
        return Some(layer.frame_id);
    }
    let mut root = layers.first()?.frame_id;
    for _ in 0..64 {
        let Some(parent) = frame.transforms.parent(root) else { break };
        root = parent;
    }
    Some(root)
}

/// Displayed name of a frame.
pub(super) fn frame_label(name: &str) -> &str {
    match name {
        WGS84 => "east-north at first fix",
        "" => "(no name)",
        name => name,
    }
}

/// Pose of a layer in the map's frame; the error says that no transform connects them.
pub(super) fn map_from_layer(frame: &Frame, map: &str, layer: &Layer<'_>) -> Result<Pose, String> {
    if map == layer.frame_id {
        return Ok(Pose::IDENTITY);
    }
    let transforms = &frame.transforms;
    let found = transforms.lookup(map, layer.frame_id, layer.stamp.0).or_else(|error| match error {
        // Before the first transform and after the last one, the nearest is used.
        TransformError::OutsideData { .. } => match transforms.newest(map, layer.frame_id)? {
            Some(newest) => transforms.lookup(map, layer.frame_id, newest),
            None => Err(error),
        },
        error => Err(error),
    });
    found.map_err(|_| {
        format!("frame {:?} is not connected to {:?}", frame_label(layer.frame_id), frame_label(map))
    })
}

/// A track ready to be drawn.
#[derive(Clone, Debug, Default)]
pub(super) struct PlacedTrack {
    /// Its points in the plane of the map.
    pub(super) placed: Placed,
    /// How it was aligned with another track, where no transform gives its pose.
    pub(super) alignment: Option<Alignment>,
    /// Why it cannot be drawn.
    pub(super) error: Option<String>,
    /// Bounds of its plausible points; `None` while there are no points.
    pub(super) near: Option<Near>,
    /// Number of its implausible points.
    pub(super) far: usize,
}

impl PlacedTrack {
    /// Determines which of its points are plausible.
    fn judged(mut self) -> Self {
        let points = || self.placed.points.iter().map(|p| [p[0], p[1]]);
        let near = Near::of(points());
        self.far = points().filter(|point| !near.has(*point)).count();
        self.near = Some(near);
        self
    }
}

#[derive(PartialEq)]
struct Key {
    map: String,
    align: bool,
    /// Address, length and transform of each track. The cache keeps the tracks alive, so an address identifies a track.
    tracks: Vec<(usize, usize, Result<Pose, String>)>,
}

/// All tracks in the plane of the map, computed again when one of them or the map's frame changes.
#[derive(Default)]
pub(super) struct Tracks {
    key: Option<Key>,
    alive: Vec<Arc<Track>>,
    /// Tracks by topic.
    pub(super) placed: BTreeMap<String, PlacedTrack>,
    /// Local frame for geodetic positions.
    pub(super) enu: Option<Enu>,
}

impl Tracks {
    /// Places every track; with `align`, tracks without a transform are aligned with the longest one that has one.
    pub(super) fn update(&mut self, frame: &Frame, map: &str, layers: &[Layer<'_>], align: bool) {
        let tracks: Vec<_> = layers
            .iter()
            .filter_map(|layer| match layer.kind {
                Kind::Track(track) => Some((layer, track, map_from_layer(frame, map, layer))),
                _ => None,
            })
            .collect();
        let key = Key {
            map: map.to_owned(),
            align,
            tracks: tracks
                .iter()
                .map(|(_, track, pose)| (Arc::as_ptr(track) as usize, track.points.len(), pose.clone()))
                .collect(),
        };
        if self.key.as_ref() == Some(&key) {
            return;
        }
        self.enu = tracks
            .iter()
            .find(|(_, track, _)| track.frame_id == WGS84)
            .and_then(|(_, track, _)| local_enu(track));
        self.alive = tracks.iter().map(|(_, track, _)| Arc::clone(track)).collect();
        self.placed.clear();
        let place = |track: &Track, pose: &Pose| {
            let enu = self.enu.as_ref().filter(|_| track.frame_id == WGS84);
            Placed::new(track, enu, pose)
        };
        for (layer, track, pose) in &tracks {
            if let Ok(pose) = pose {
                let placed = PlacedTrack { placed: place(track, pose), ..PlacedTrack::default() };
                self.placed.insert(layer.name.clone(), placed.judged());
            }
        }
        let reference = self
            .placed
            .values()
            .max_by_key(|track| track.placed.points.len())
            .map(|track| track.placed.clone());
        for (layer, track, pose) in &tracks {
            let Err(error) = pose else { continue };
            let loose = place(track, &Pose::IDENTITY);
            let alignment = reference.as_ref().filter(|_| align).and_then(|reference| loose.align(reference));
            let placed = match alignment {
                Some(alignment) => {
                    let placed = loose.aligned(&alignment);
                    PlacedTrack { placed, alignment: Some(alignment), ..PlacedTrack::default() }.judged()
                }
                None => PlacedTrack { error: Some(error.clone()), ..PlacedTrack::default() },
            };
            self.placed.insert(layer.name.clone(), placed);
        }
        self.key = Some(key);
    }
}
