//! The layers of a map: everything in a frame that lies in a plane, and its pose.

use super::grid::{Extent, frame_of, is_empty};
use super::robot::own_frame;
use super::track::{Aligned, Alignment, Judged, Plane, course, nearest};
use crate::cached::SameMessage;
use crate::view::{is_old, is_twin};
use ocu_ui::format;
use rcs_geom::{DVec3, Enu, Geodetic, Pose};
use rcs_msg::foxglove::{PointCloud, PoseInFrame, PosesInFrame};
use rcs_msg::rcs::{ArcChoice, Mission, Plan};
use rcs_msg::{AnyMessage, Stamp};
use rcs_runtime::Role;
use rcs_runtime::source::{Entity, Frame, Place, RunTag, Topic, Track, WGS84, frame_name};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::Arc;

/// Content of a layer.
#[derive(Clone, Copy)]
pub(super) enum Kind<'a> {
    /// A grid of cells.
    Grid(&'a AnyMessage),
    /// A point cloud.
    Cloud,
    /// Entities of a scene, each in a frame of its own; the frame of the layer is that of the first one.
    Entities(&'a [Arc<Entity>]),
    /// A planned path.
    Path(&'a PosesInFrame),
    /// Poses of which none follows another, such as the particles of a filter.
    Poses(&'a PosesInFrame),
    /// A goal.
    Goal(&'a PoseInFrame),
    /// A plan: the chosen and the best rejected path.
    Plan(&'a Plan),
    /// The arcs that were considered.
    Arcs(&'a ArcChoice),
    /// Goals, and the bounds of driving.
    Mission(&'a Mission),
    /// The track of a moving object.
    Track {
        /// The track.
        track: &'a Track,
        /// Whether it is that of the run from which this one branched.
        is_ghost: bool,
    },
}

/// One layer.
#[derive(Clone)]
pub(super) struct Layer<'a> {
    /// Name in layouts and on the screen: that of the topic.
    pub(super) name: String,
    /// Its content.
    pub(super) kind: Kind<'a>,
    /// Its coordinate frame, without a slash at its start.
    pub(super) frame_id: &'a str,
    /// Time for which the content is valid, by the clock of the transforms ([`Frame::placing_time`]). A mission and a track
    /// hold at the viewed time.
    pub(super) stamp: Stamp,
    /// The topic; a track may exist without one.
    pub(super) topic: Option<&'a Topic>,
    /// Whether it was recorded, and the run has computed a message of the same topic; never of a track.
    pub(super) is_twin: bool,
}

impl Layer<'_> {
    /// Whether it is the ground truth of a simulation.
    pub(super) fn is_ground_truth(&self) -> bool {
        self.topic.is_some_and(Topic::is_ground_truth)
    }

    /// Whether it was read from the recording.
    pub(super) fn is_recorded(&self) -> bool {
        self.topic.is_some_and(|topic| topic.run.is_recorded())
    }

    /// Whether it is a fused map.
    pub(super) fn is_map(&self) -> bool {
        !self.is_ground_truth() && self.topic.is_some_and(|topic| topic.role() == Some(Role::Map))
    }

    /// Whether a map already contains it: costs of one source, or the cloud from which they come.
    pub(super) fn is_part_of_a_map(&self) -> bool {
        self.topic.is_some_and(|topic| matches!(topic.role(), Some(Role::Cost | Role::Cloud)))
    }

    /// Whether it is what a vehicle planned or estimated at one time: a path, a plan, the arcs that were considered, or a
    /// set of poses.
    pub(super) fn is_of_one_time(&self) -> bool {
        matches!(self.kind, Kind::Path(_) | Kind::Poses(_) | Kind::Plan(_) | Kind::Arcs(_))
    }

    /// Whether it is outdated relative to its rate.
    pub(super) fn is_stale(&self, now: Stamp) -> bool {
        self.topic.is_some_and(|topic| is_old(topic, now))
    }

    /// Whether it shows this topic.
    pub(super) fn is_of(&self, topic: &Topic) -> bool {
        self.topic.is_some_and(|own| own.name == topic.name && own.run == topic.run)
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

/// Whether the poses of a topic are a set. Those of other types are a path: Foxglove's message does not say which they
/// are.
fn is_set_of_poses(topic: &Topic) -> bool {
    matches!(topic.schema.name(), "geometry_msgs/PoseArray" | "geometry_msgs/msg/PoseArray")
}

/// All layers of a frame from bottom to top; ground truth is on top of its kind.
pub(super) fn layers(frame: &Frame) -> Vec<Layer<'_>> {
    let (mut grids, mut clouds, mut scenes, mut paths) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for topic in frame.topics.iter() {
        let Some(sample) = &topic.latest else { continue };
        let layer_at = |kind, frame_id, stamp| {
            let name = crate::toolbar::topic_label(frame, topic);
            let is_twin = is_twin(frame, topic);
            Layer { name, kind, frame_id: frame_name(frame_id), stamp, topic: Some(topic), is_twin }
        };
        let layer = |kind, frame_id| {
            let acquired = topic.acq_time().unwrap_or(sample.header.acq_time);
            layer_at(kind, frame_id, frame.placing_time(acquired, sample.header.log_time))
        };
        match topic.type_name() {
            "foxglove.Grid" => {
                let message = topic.canonical().filter(|message| !is_empty(message));
                let named = message.and_then(|message| Some((message, frame_of(message)?)));
                grids.extend(named.map(|(message, frame_id)| layer(Kind::Grid(message), frame_id)));
            }
            "foxglove.PointCloud" => {
                clouds.extend(topic.get::<PointCloud>().map(|cloud| layer(Kind::Cloud, &cloud.frame_id)));
            }
            "foxglove.SceneUpdate" => {
                let entities = frame.entities(topic);
                let first = entities.iter().find(|entity| entity.is_alive(frame.now));
                scenes.extend(first.map(|first| {
                    let at = placing_time(frame, first);
                    layer_at(Kind::Entities(entities), &first.content.frame_id, at)
                }));
            }
            "foxglove.PosesInFrame" => {
                paths.extend(topic.get::<PosesInFrame>().map(|poses| {
                    let kind = if is_set_of_poses(topic) { Kind::Poses(poses) } else { Kind::Path(poses) };
                    layer(kind, &poses.frame_id)
                }));
            }
            "rcs.Plan" => {
                paths.extend(topic.get::<Plan>().map(|plan| layer(Kind::Plan(plan), &plan.frame_id)));
            }
            "rcs.ArcChoice" => {
                paths.extend(topic.get::<ArcChoice>().map(|arcs| layer(Kind::Arcs(arcs), &arcs.frame_id)));
            }
            "rcs.Mission" if topic.role() == Some(Role::Mission) => {
                let mission = topic.get::<Mission>();
                let stated = mission.map(|mission| layer(Kind::Mission(mission), &mission.frame_id));
                // A vehicle states its mission only when it changes, and its frame may have moved since.
                let stamp = frame.transform_time(frame.now);
                paths.extend(stated.map(|stated| Layer { stamp, ..stated }));
            }
            "foxglove.PoseInFrame" if is_goal(topic) => {
                paths.extend(topic.get::<PoseInFrame>().map(|goal| layer(Kind::Goal(goal), &goal.frame_id)));
            }
            _ => {}
        }
    }
    // A fine map lies above a coarse one, which shows where the fine one knows nothing.
    let mut grids: Vec<_> = grids.into_iter().map(|layer| (cell_m(&layer), layer)).collect();
    grids.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let grids = grids.into_iter().map(|(_, layer)| layer);
    let tracks = tracks(frame);
    let mut layers: Vec<_> = grids.chain(clouds).chain(scenes).chain(paths).chain(tracks).collect();
    layers.sort_by_key(Layer::is_ground_truth);
    layers
}

/// The time by the clock of the transforms at which an entity is placed.
pub(super) fn placing_time(frame: &Frame, entity: &Entity) -> Stamp {
    if entity.content.frame_locked {
        return frame.transform_time(frame.now);
    }
    frame.placing_time(entity.stamp.unwrap_or(entity.from), entity.from)
}

/// Side of the cells of a grid, m; 0 for other layers.
fn cell_m(layer: &Layer<'_>) -> f64 {
    let Kind::Grid(grid) = layer.kind else { return 0.0 };
    Extent::of(grid).map_or(0.0, |extent| extent.cell_m)
}

/// The tracks of the recording, of the viewed run, and of the run from which it branched, which lies below the others.
fn tracks(frame: &Frame) -> Vec<Layer<'_>> {
    let current = frame.runs.current();
    let summary = frame.runs.all.iter().find(|run| run.id == current);
    let parent = summary.and_then(|run| run.branched_from).map(|(moment, _)| RunTag::Run(moment.run));
    let mut layers = Vec::new();
    for track in frame.tracks.iter().filter(|track| !track.points.is_empty()) {
        let is_ghost = Some(track.run) == parent;
        if !is_ghost && track.run != RunTag::Run(current) && !track.run.is_recorded() {
            continue;
        }
        let topic = frame.topic_of(&track.topic, track.run).or_else(|| frame.topic(&track.topic));
        if topic.is_some_and(is_goal) {
            continue;
        }
        let twice = || frame.track(&track.topic, RunTag::Run(current)).is_some();
        let name = match track.run {
            RunTag::Run(run) if is_ghost => format!("{} ({run})", track.topic),
            RunTag::Recorded if twice() => format!("{} (recorded)", track.topic),
            _ => track.topic.to_string(),
        };
        let kind = Kind::Track { track, is_ghost };
        let stamp = frame.transform_time(frame.now);
        // A recorded track is compared with that of the run, and hides nothing.
        let is_twin = false;
        layers.push(Layer { name, kind, frame_id: &track.frame_id, stamp, topic, is_twin });
    }
    layers.sort_by_key(|layer| !matches!(layer.kind, Kind::Track { is_ghost: true, .. }));
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

/// The frame of a map: the chosen one as long as there is such a frame, else the default one.
pub(super) fn map_frame<'a>(frame: &'a Frame, layers: &[Layer<'a>], chosen: Option<&str>) -> Option<&'a str> {
    let chosen = chosen.and_then(|chosen| frames(frame, layers).into_iter().find(|name| *name == chosen));
    chosen.or_else(|| default_frame(frame, layers))
}

/// The default frame of a map: of the frames of grids, geodetic positions and tracks the one in which most layers are
/// drawn, in this order where several draw as many; otherwise the root above the first cloud, or above the robot where
/// there are transforms alone.
fn default_frame<'a>(frame: &'a Frame, layers: &[Layer<'a>]) -> Option<&'a str> {
    let own = || layers.iter().filter(|layer| !layer.is_ground_truth());
    let rank = |layer: &Layer<'_>| match layer.kind {
        Kind::Grid(_) => Some(2),
        _ if layer.frame_id == WGS84 => Some(1),
        Kind::Track { is_ghost: false, .. } => Some(0),
        _ => None,
    };
    let drawn = |map: &str| own().filter(|layer| map_from_layer(frame, map, layer).is_ok()).count();
    let candidates = own().filter_map(|layer| Some((rank(layer)?, layer.frame_id)));
    // The first of several equal ones: `max_by_key` returns the last.
    let candidates: Vec<_> = candidates.collect();
    if let Some((_, best)) = candidates.iter().rev().max_by_key(|(rank, name)| (drawn(name), *rank)) {
        return Some(*best);
    }
    let first = layers.first().map(|layer| layer.frame_id).or_else(|| own_frame(frame))?;
    Some(root_above(frame, first))
}

/// The frame that lies above this one and below no other.
pub(super) fn root_above<'a>(frame: &'a Frame, name: &'a str) -> &'a str {
    let mut root = name;
    for _ in 0..64 {
        let Some(parent) = frame.transforms.parent(root) else { break };
        root = parent;
    }
    root
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
    map_from_frame(frame, map, layer.frame_id, layer.stamp)
}

/// Pose of a coordinate frame in the map's at a time by the clock of the transforms; each transform counts before its first
/// sample with the first, and after its last with the last. The error says that no transform connects them.
pub(super) fn map_from_frame(frame: &Frame, map: &str, frame_id: &str, at: Stamp) -> Result<Pose, String> {
    let (map, frame_id) = (frame_name(map), frame_name(frame_id));
    if map == frame_id {
        return Ok(Pose::IDENTITY);
    }
    let found = frame.transforms.lookup_nearest(map, frame_id, at.0);
    found.map_err(|_| format!("frame {:?} is not connected to {:?}", frame_label(frame_id), frame_label(map)))
}

/// How a track lies on the map.
#[derive(Clone, Debug, Default)]
pub(super) struct PlacedTrack {
    /// Pose of the track's positions in the plane of the map; `None` if it cannot be drawn.
    pub(super) map_from_track: Option<Pose>,
    /// How it was aligned with another track, where no transform gives its pose.
    pub(super) alignment: Option<Alignment>,
    /// Why it cannot be drawn.
    pub(super) error: Option<String>,
    /// Which of its positions are plausible.
    pub(super) judged: Judged,
    /// Local frame of its positions, if it is a geodetic one that is no ghost of another run.
    enu: Option<Enu>,
    aligned: Aligned,
}

impl PlacedTrack {
    /// Transform into the plane of the map.
    pub(super) fn plane(&self) -> Option<Plane> {
        self.map_from_track.map(Plane::new)
    }
}

/// All tracks in the plane of the map. The cost of an update does not depend on their length.
#[derive(Default)]
pub(super) struct Tracks {
    /// By name of the layer.
    pub(super) placed: BTreeMap<String, PlacedTrack>,
    /// Local frame of geodetic positions on the map.
    pub(super) enu: Option<Enu>,
}

impl Tracks {
    /// Places every track; with `align`, tracks without a transform are aligned with the longest one of their run that has
    /// one, or where there is none, with that of another run.
    pub(super) fn update(&mut self, frame: &Frame, map: &str, layers: &[Layer<'_>], align: bool) {
        let tracks: Vec<_> = layers
            .iter()
            .filter_map(|layer| match layer.kind {
                Kind::Track { track, .. } => Some((layer, track, map_from_layer(frame, map, layer))),
                _ => None,
            })
            .collect();
        self.placed.retain(|name, _| tracks.iter().any(|(layer, ..)| layer.name == *name));
        self.enu = tracks.iter().find_map(|(_, track, _)| track.origin);
        for (layer, track, pose) in &tracks {
            let map_from_origin = self.map_from_origin(track);
            let placed = self.placed.entry(layer.name.clone()).or_default();
            placed.judged.update(&track.points);
            placed.enu = track.origin.filter(|_| matches!(layer.kind, Kind::Track { is_ghost: false, .. }));
            (placed.alignment, placed.error) = (None, pose.as_ref().err().cloned());
            placed.map_from_track = pose.as_ref().ok().map(|&pose| pose * map_from_origin);
        }
        for (layer, track, _) in tracks.iter().filter(|(.., pose)| align && pose.is_err()) {
            // Rounded, so that the choice seldom changes while tracks grow.
            let suits = |other: &Track| (other.run == track.run, other.points.len().next_power_of_two());
            let connected = tracks.iter().filter(|(.., pose)| pose.is_ok());
            let reference = connected
                .max_by_key(|(_, other, _)| suits(other))
                .and_then(|(layer, other, _)| Some((self.placed.get(&layer.name)?.map_from_track?, *other)));
            let Some((map_from_reference, reference)) = reference else { continue };
            let Some(placed) = self.placed.get_mut(&layer.name) else { continue };
            placed.aligned.update(&track.points, &reference.points);
            let Some(alignment) = placed.aligned.alignment else { continue };
            if alignment.is_plausible() {
                placed.map_from_track = Some(map_from_reference * alignment.pose());
                (placed.alignment, placed.error) = (Some(alignment), None);
            } else if let Some(error) = &mut placed.error {
                let of = [alignment.rms_m, alignment.length_m].map(|length_m| format::metres(length_m, 1));
                let _ = write!(error, ", and aligned at its start it is {} off over {}", of[0], of[1]);
            }
        }
    }

    /// Pose of the local frame of a geodetic track in that of the map; the identity for other tracks.
    fn map_from_origin(&self, track: &Track) -> Pose {
        match (&self.enu, &track.origin) {
            (Some(map), Some(origin)) => map.ecef_from_enu().inverse() * origin.ecef_from_enu(),
            _ => Pose::IDENTITY,
        }
    }

    /// Time at which the nearest track passes a point of the map; `None` if none passes within `reach_m`.
    pub(super) fn time_at(&self, shown: &[&Layer<'_>], point: [f64; 2], reach_m: f64) -> Option<Stamp> {
        let found = shown.iter().filter_map(|layer| {
            let Kind::Track { track, is_ghost: false } = layer.kind else { return None };
            nearest(&track.points, &self.placed.get(&layer.name)?.plane()?, point, reach_m)
        });
        found.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, time)| time)
    }

    /// Latitude and longitude of a point of the map, from a geodetic track, shown or not; and whether that lies on the map by
    /// its transform rather than by an alignment. `None` where no such track lies on the map.
    pub(super) fn geodetic(&self, map: &str, [x, y]: [f64; 2]) -> Option<(Geodetic, bool)> {
        let p = DVec3::new(x, y, 0.0);
        if let Some(enu) = self.enu.as_ref().filter(|_| map == WGS84) {
            return Some((enu.geodetic_from_enu(p), true));
        }
        let found = self.placed.values().filter_map(|placed| {
            let place = placed.enu?.geodetic_from_enu(placed.map_from_track?.inverse() * p);
            Some((place, placed.alignment.is_none()))
        });
        found.max_by_key(|(_, is_exact)| *is_exact)
    }

    /// Where the tracks are at a time, on the map.
    pub(super) fn places_at(&self, shown: &[&Layer<'_>], time: Stamp) -> Vec<[f64; 2]> {
        let place = |layer: &&Layer<'_>| {
            let Kind::Track { track, is_ghost: false } = layer.kind else { return None };
            let point = track.points.get(track.points.count_until(time).checked_sub(1)?)?;
            Some(self.placed.get(&layer.name)?.plane()?.point(point.position_m))
        };
        shown.iter().filter_map(place).collect()
    }

    /// Position and heading of what a track belongs to, on the map: from the newest message, never from the track,
    /// which may be read later or belong to another run. `None` without a message or a transform.
    pub(super) fn here(&self, frame: &Frame, layer: &Layer<'_>) -> Option<[f64; 3]> {
        let Kind::Track { track, is_ghost: false } = layer.kind else { return None };
        let map_from_track = self.placed.get(&layer.name)?.map_from_track?;
        let place =
            Place::of(layer.topic?.canonical()?).filter(|place| *place.frame_id == *track.frame_id)?;
        let p = map_from_track * track.metres(&place.position, frame.now);
        let yaw_rad = if place.yaw_rad.is_nan() {
            course(&track.points, track.points.count_until(frame.now).saturating_sub(1))
        } else {
            place.yaw_rad
        };
        p.is_finite().then_some([p.x, p.y, yaw_rad + map_from_track.yaw()])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Map;
    use crate::samples;
    use crate::view::View;
    use rcs_geom::TransformTree;
    use rcs_msg::{MessageEncoding, Schema};
    use rcs_runtime::source::{Runs, TrackPoint};
    use rcs_runtime::{Moment, RunId, RunSummary};

    #[test]
    fn before_the_first_transform_and_after_the_last_one_the_nearer_one_is_used() {
        let mut tree = TransformTree::new();
        for (time_ns, x) in [(10, 1.0), (20, 2.0)] {
            tree.insert("odom", "base", time_ns, Pose::from_xy_yaw(x, 0.0, 0.0)).unwrap();
        }
        let frame = Frame { transforms: Arc::new(tree), ..samples::empty() };
        let x = |at: u64| map_from_frame(&frame, "odom", "/base", Stamp(at)).unwrap().translation.x;
        assert_eq!([5, 15, 25].map(x), [1.0, 1.5, 2.0]);
    }

    #[test]
    fn a_recording_with_transforms_alone_has_a_map_in_the_frame_above_its_robot() {
        let mut tree = TransformTree::new();
        for (parent, child) in [("map", "odom"), ("odom", "base_link"), ("base_link", "lidar")] {
            tree.set_static(parent, child, Pose::IDENTITY).unwrap();
        }
        let frame = Frame { transforms: Arc::new(tree), ..samples::empty() };
        assert_eq!(default_frame(&frame, &layers(&frame)), Some("map"));
    }

    #[test]
    fn a_grid_without_cells_is_no_layer() {
        let grid = |columns| {
            let message = rcs_msg::foxglove::Grid { column_count: columns, ..Default::default() };
            samples::topic("/map", 1.0, 0.0, message)
        };
        let count = |topic| layers(&Frame { topics: Arc::new([topic]), ..samples::empty() }).len();
        assert_eq!(count(grid(0)), 0);
        assert_eq!(count(grid(5)), 1, "a grid that lacks its data is shown as faulty");
    }

    #[test]
    fn a_recorded_layer_that_the_run_computes_is_offered_and_off() {
        let mut frame = samples::driving();
        frame.tracks = Arc::new([]);
        let of_run = frame.topic("/wm1/map").unwrap().clone();
        let mut recorded = of_run.clone();
        recorded.run = RunTag::Recorded;
        let shown = |map: &Map, of_run: &Topic| {
            let topics = Arc::new([recorded.clone(), of_run.clone()]);
            let frame = Frame { topics, ..frame.clone() };
            let layers = layers(&frame);
            let shown = layers.iter().filter(|layer| map.state(layer).shown);
            (layers.len(), shown.map(|layer| layer.name.clone()).collect::<Vec<_>>())
        };
        let mut map = Map::default();
        assert_eq!(shown(&map, &of_run), (2, vec!["/wm1/map".to_owned()]));
        // Before the run has made a map, the recorded one is all there is.
        let nothing = Topic::new("/wm1/map", RunTag::FIRST, Arc::clone(&of_run.schema));
        assert_eq!(shown(&map, &nothing), (1, vec!["/wm1/map (recorded)".to_owned()]));
        map.drop_topic(&recorded);
        assert_eq!(shown(&map, &of_run).1.len(), 2, "it was asked for");
    }

    #[test]
    fn a_run_that_leaves_the_track_of_its_parent_has_geographic_coordinates() {
        let origin = Enu::new(Geodetic::new(48.0, 8.0, 120.0).unwrap());
        // Both drive 2 m to the east in 2 s; then each has a speed of its own.
        let tracks = [(0, 5.0_f64, 200_u32), (1, 0.3, 100)].map(|(run, speed_mps, count)| {
            let track = |topic: &str, frame_id: &str, origin: Option<Enu>| {
                let point = |i: u32| {
                    let time_s = f64::from(i) * 0.1;
                    let x_m = time_s.min(2.0) + speed_mps * (time_s - 2.0).max(0.0);
                    let stamp = Stamp(u64::from(i) * 100_000_000);
                    TrackPoint { stamp, position_m: [x_m, 0.0, 0.0], yaw_rad: f64::NAN }
                };
                Track {
                    topic: topic.into(),
                    run: RunTag::Run(RunId(run)),
                    frame_id: frame_id.into(),
                    origin,
                    points: (0..count).map(point).collect(),
                }
            };
            [track("/localization/local", "local", None), track("/gps/fix", WGS84, Some(origin))]
        });
        let summary = |id: u32| RunSummary {
            id: RunId(id),
            branched_from: (id == 1).then_some((Moment::default(), Stamp(2_000_000_000))),
            end: samples::NOW,
            events: 0,
            writes: 0,
        };
        let moment = Moment { run: RunId(1), ..Moment::default() };
        let runs = Runs { all: [summary(0), summary(1)].into(), moment, ..Runs::default() };
        let frame = Frame { runs, tracks: tracks.into_iter().flatten().collect(), ..samples::empty() };
        let mut tracks = Tracks::default();
        tracks.update(&frame, "local", &layers(&frame), true);
        let (place, is_exact) = tracks.geodetic("local", [0.0, 0.0]).unwrap();
        let off_deg = [place.latitude_deg - 48.0, place.longitude_deg - 8.0];
        assert!(off_deg.iter().all(|off_deg| off_deg.abs() < 1e-6) && !is_exact, "{place:?}");
    }

    #[test]
    fn the_poses_of_an_array_are_a_set_and_those_of_foxglove_a_path() {
        let path = samples::topic("/path", 1.0, 0.0, PosesInFrame::default());
        let array = |name: &str| {
            let schema = Arc::new(Schema::new(name, MessageEncoding::Cdr, "ros2idl", Vec::new().into()));
            Topic::new("/particles", RunTag::Recorded, schema).with_latest(path.latest.clone().unwrap())
        };
        for name in ["geometry_msgs/msg/PoseArray", "geometry_msgs/PoseArray"] {
            let frame = Frame { topics: Arc::new([array(name), path.clone()]), ..samples::empty() };
            let kinds: Vec<_> = layers(&frame).into_iter().map(|layer| layer.kind).collect();
            assert!(matches!(kinds[..], [Kind::Poses(_), Kind::Path(_)]), "{name}");
        }
    }

    #[test]
    fn the_frame_of_the_map_is_the_one_that_draws_most() {
        let mut frame = samples::full();
        let chosen = |frame: &Frame| default_frame(frame, &layers(frame)).map(str::to_owned);
        assert_eq!(chosen(&frame).as_deref(), Some("local"));
        // Without the grid, degrees would draw one track, and the local frame three layers.
        frame.topics = frame.topics.iter().filter(|topic| &*topic.name != "/wm1/map").cloned().collect();
        assert_eq!(chosen(&frame).as_deref(), Some("local"));
        frame.tracks =
            frame.tracks.iter().filter(|track| track.frame_id.as_ref() == WGS84).cloned().collect();
        frame.topics = Arc::new([]);
        assert_eq!(chosen(&frame).as_deref(), Some(WGS84));
    }
}
