//! The layers of a map: what a frame has that lies in a plane, and where it lies.

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

/// What a layer shows.
#[derive(Clone, Copy)]
pub(super) enum Kind<'a> {
    /// A grid of cells.
    Grid(&'a AnyMessage),
    /// A point cloud.
    Cloud(&'a PointCloud),
    /// A planned path.
    Path(&'a PosesInFrame),
    /// Where something is to go.
    Goal(&'a PoseInFrame),
    /// Where something has been.
    Track(&'a Arc<Track>),
}

/// One layer.
#[derive(Clone)]
pub(super) struct Layer<'a> {
    /// Name in layouts, and for a person: that of the topic.
    pub(super) name: String,
    /// What it shows.
    pub(super) kind: Kind<'a>,
    /// Its coordinate frame.
    pub(super) frame_id: &'a str,
    /// When what it shows was so.
    pub(super) stamp: Stamp,
    /// The topic; a track's may not be there.
    pub(super) topic: Option<&'a Topic>,
}

impl Layer<'_> {
    /// Whether it is the ground truth of a simulation.
    pub(super) fn is_ground_truth(&self) -> bool {
        self.topic.is_some_and(Topic::is_ground_truth)
    }

    /// Whether it is a map that others are fused into.
    pub(super) fn is_map(&self) -> bool {
        !self.is_ground_truth() && self.topic.is_some_and(|topic| topic.role() == Some(Role::Map))
    }

    /// Whether a map shows it already: costs of one source, and the cloud that they come from.
    pub(super) fn is_part_of_a_map(&self) -> bool {
        self.topic.is_some_and(|topic| matches!(topic.role(), Some(Role::Cost | Role::Cloud)))
    }

    /// Whether it is older than its rate allows.
    pub(super) fn is_stale(&self, now: Stamp) -> bool {
        self.topic.is_some_and(|topic| topic.age_s(now).is_some_and(|age_s| is_stale(age_s, rate_hz(topic))))
    }

    /// The message that it shows; a track is many.
    pub(super) fn message(&self) -> Option<SameMessage> {
        Some(SameMessage(self.topic?.canonical()?.clone()))
    }
}

/// Whether the topic says where something is to go; its positions are no track.
fn is_goal(topic: &Topic) -> bool {
    topic.role() == Some(Role::Goal) && topic.type_name() == "foxglove.PoseInFrame"
}

/// All layers of a frame, the lowest first: the ground truth lies over everything else of its kind.
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

/// Frames that a map can be drawn in: those of its layers first, then those of the transforms.
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

/// The frame that a person wants who has not chosen one: a grid's, else north-up where there are degrees, else a
/// track's, else the root above the first cloud.
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

/// Name of a frame for a person.
pub(super) fn frame_label(name: &str) -> &str {
    match name {
        WGS84 => "east-north at first fix",
        "" => "(no name)",
        name => name,
    }
}

/// Where a layer lies in the map's frame; a sentence where nothing connects the two.
pub(super) fn map_from_layer(frame: &Frame, map: &str, layer: &Layer<'_>) -> Result<Pose, String> {
    if map == layer.frame_id {
        return Ok(Pose::IDENTITY);
    }
    let transforms = &frame.transforms;
    let found = transforms.lookup(map, layer.frame_id, layer.stamp.0).or_else(|error| match error {
        // What was seen before the first transform, or after the last, is drawn by the nearest one.
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

/// A track as it is drawn.
#[derive(Clone, Debug, Default)]
pub(super) struct PlacedTrack {
    /// Its points in the map's plane.
    pub(super) placed: Placed,
    /// What laid it on another track, where no transform says where it lies.
    pub(super) alignment: Option<Alignment>,
    /// Why it cannot be drawn.
    pub(super) error: Option<String>,
    /// Which of its places are fitted to the window; all, while there are none.
    pub(super) near: Option<Near>,
    /// How many are not.
    pub(super) far: usize,
}

impl PlacedTrack {
    /// Judges which of its places can be.
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
    /// Address, length and transform of each track. An address is that of a track that this cache keeps alive.
    tracks: Vec<(usize, usize, Result<Pose, String>)>,
}

/// All tracks in the map's plane, computed when one of them or the map's frame changes.
#[derive(Default)]
pub(super) struct Tracks {
    key: Option<Key>,
    alive: Vec<Arc<Track>>,
    /// By topic.
    pub(super) placed: BTreeMap<String, PlacedTrack>,
    /// Local frame of the degrees.
    pub(super) enu: Option<Enu>,
}

impl Tracks {
    /// Places every track; with `align`, those that nothing connects are laid on the longest that is.
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
