//! Tracks: positions from messages with poses, and the transforms of a log.
//!
//! A transform counts with its stamp. One of 0 is none where the log times are not near 0, too: such a transform counts with
//! its log time. Stamps of another clock than that of the log are translated by [`TransformClock`].

use super::per_run::{Gathered, Written};
use super::run_tag::RunTag;
use super::series::{Record, Series, SeriesWriter};
use super::transform_clock::{BEGINS_AGAIN_NS, SAME_NS, TransformClock};
use rcs_geom::{DVec3, Enu, Geodetic, Pose, PoseError, TransformTree};
use rcs_msg::{AnyMessage, Stamp, foxglove};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Types of messages with a pose.
const POSE_TYPES: [&str; 3] = ["foxglove.Odometry", "foxglove.PoseInFrame", "foxglove.LocationFix"];
const TRANSFORM_TYPES: [&str; 2] = ["foxglove.FrameTransforms", "foxglove.FrameTransform"];
/// Number of refused transforms that are told, of different frames.
const MOST_REFUSED: usize = 12;
/// Coordinate frame of geodetic positions.
pub const WGS84: &str = "wgs84";

pub(crate) fn is_pose_type(name: &str) -> bool {
    POSE_TYPES.contains(&name)
}

pub(crate) fn is_transform_type(name: &str) -> bool {
    TRANSFORM_TYPES.contains(&name)
}

/// A coordinate frame by the name under which it is placed: like ROS 2, without a slash at its start.
pub fn frame_name(frame_id: &str) -> &str {
    frame_id.strip_prefix('/').unwrap_or(frame_id)
}

/// One position of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackPoint {
    /// Log time.
    pub stamp: Stamp,
    /// Position, m: x, y, z in the track's frame, or east, north, up of its [`Track::origin`].
    pub position_m: [f64; 3],
    /// Heading, rad; NaN if it is unknown.
    pub yaw_rad: f64,
}

/// The box that contains consecutive positions; numbers that are not finite are left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackBounds {
    /// Least coordinates, m.
    pub min_m: [f64; 3],
    /// Greatest coordinates, m.
    pub max_m: [f64; 3],
}

impl Record for TrackPoint {
    type Summary = TrackBounds;

    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn summary(&self) -> TrackBounds {
        TrackBounds { min_m: self.position_m, max_m: self.position_m }
    }

    fn join(a: TrackBounds, b: TrackBounds) -> TrackBounds {
        // `f64::min` and `f64::max` prefer a number to NaN.
        TrackBounds {
            min_m: std::array::from_fn(|axis| a.min_m[axis].min(b.min_m[axis])),
            max_m: std::array::from_fn(|axis| a.max_m[axis].max(b.max_m[axis])),
        }
    }
}

/// A track: every position of a topic with poses.
#[derive(Clone, Debug)]
pub struct Track {
    /// The topic.
    pub topic: Arc<str>,
    /// Its run.
    pub run: RunTag,
    /// Coordinate frame; [`WGS84`] for geodetic positions.
    pub frame_id: Arc<str>,
    /// The local frame of geodetic positions: that of the first fix, at the first altitude that is stated.
    pub origin: Option<Enu>,
    /// Its positions.
    pub points: Series<TrackPoint>,
}

impl Track {
    /// A position at `time`, m, in the coordinates of [`Track::points`]. Without an altitude it is as high as the last point
    /// until then.
    pub fn metres(&self, position: &Position, time: Stamp) -> DVec3 {
        let last = self.points.count_until(time).checked_sub(1).and_then(|index| self.points.get(index));
        position.metres(self.origin.as_ref(), last)
    }
}

/// The position of a message with a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Place<'a> {
    /// Coordinate frame.
    pub frame_id: &'a str,
    /// Where it is.
    pub position: Position,
    /// Heading, rad; NaN if it is unknown.
    pub yaw_rad: f64,
}

/// A position in a frame, or on the Earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Position {
    /// x, y, z in m.
    Local(DVec3),
    /// Latitude, longitude, altitude.
    Geodetic {
        /// The position; its altitude is 0 if it is unknown.
        fix: Geodetic,
        /// Whether the altitude is known: some receivers measure none.
        has_altitude: bool,
    },
}

impl Position {
    /// In metres: in its own frame, or in the local frame of a geodetic track, where a position without an altitude is as
    /// high as the point before it, else at 0.
    fn metres(&self, origin: Option<&Enu>, before: Option<TrackPoint>) -> DVec3 {
        match (self, origin) {
            (Self::Local(position), _) => *position,
            (Self::Geodetic { fix, has_altitude: true }, Some(origin)) => origin.enu_from_geodetic(fix),
            (Self::Geodetic { fix, has_altitude: false }, Some(origin)) => {
                let fix = Geodetic { altitude_m: origin.origin().altitude_m, ..*fix };
                let z = before.map(|point| point.position_m[2]).filter(|z| z.is_finite()).unwrap_or(0.0);
                DVec3 { z, ..origin.enu_from_geodetic(&fix) }
            }
            (Self::Geodetic { .. }, None) => DVec3::NAN,
        }
    }
}

impl<'a> Place<'a> {
    /// The place that a canonical message states; `None` for other messages, for impossible poses, and where a receiver
    /// says that it has no position fix.
    pub fn of(message: &'a AnyMessage) -> Option<Self> {
        let local = |frame_id: &'a str, pose: &Option<foxglove::Pose>| {
            let (position, yaw_rad) = pose.as_ref().and_then(position_and_yaw)?;
            Some(Self { frame_id: frame_name(frame_id), position: Position::Local(position), yaw_rad })
        };
        if let Some(odometry) = message.get::<foxglove::Odometry>() {
            local(&odometry.frame_id, &odometry.pose)
        } else if let Some(stamped) = message.get::<foxglove::PoseInFrame>() {
            local(&stamped.frame_id, &stamped.pose)
        } else {
            let fix = message.get::<foxglove::LocationFix>()?;
            if fix.is_without_position() {
                return None;
            }
            // A receiver that measures no height says NaN.
            let has_altitude = !fix.altitude.is_nan();
            let altitude_m = if has_altitude { fix.altitude } else { 0.0 };
            let fix = Geodetic::new(fix.latitude, fix.longitude, altitude_m).ok()?;
            let position = Position::Geodetic { fix, has_altitude };
            Some(Self { frame_id: WGS84, position, yaw_rad: f64::NAN })
        }
    }
}

/// The transforms that were refused, by their frames.
#[derive(Default)]
pub(crate) struct Refused {
    /// Parents and children; one more than [`MOST_REFUSED`] where it was told that there are more.
    frames: BTreeSet<(String, String)>,
}

impl Refused {
    /// What is to be told of a transform that was refused: once for its frames, and of more than [`MOST_REFUSED`] only
    /// that there are some.
    pub(crate) fn tell(&mut self, topic: &str, parent: &str, child: &str, why: &str) -> Option<String> {
        if self.len() > MOST_REFUSED || !self.frames.insert((parent.to_owned(), child.to_owned())) {
            return None;
        }
        Some(if self.len() > MOST_REFUSED {
            "further transforms were refused; skipped".to_owned()
        } else {
            format!("{topic}: {why}; skipped")
        })
    }

    fn len(&self) -> usize {
        self.frames.len()
    }
}

struct Growing {
    frame_id: Arc<str>,
    origin: Option<Enu>,
    /// Whether a position has stated the altitude of the origin.
    has_altitude: bool,
    points: SeriesWriter<TrackPoint>,
    /// For each position, the number of messages of the run up to the one that has it. Empty for a recording, from which
    /// no run branches.
    found_at: Vec<u64>,
}

/// Tracks and transforms that grow message by message.
#[derive(Default)]
pub(crate) struct Tracks {
    by_topic: BTreeMap<Arc<str>, Growing>,
    tree: TransformTree,
    clock: TransformClock,
    /// Transforms implied by odometry, used for frames of which no message gives one.
    implied: TransformTree,
    implied_clock: TransformClock,
    /// Number of transforms in `tree`; one that came again counts again.
    transforms: usize,
    /// The topic that moves a frame, by its name; and whether another one does, too.
    moved_by: BTreeMap<String, (Arc<str>, bool)>,
    refused: Refused,
    /// What is doubtful about the transforms, one line each.
    doubts: Vec<String>,
}

impl Gathered for Tracks {
    fn takes(type_name: &str) -> bool {
        is_pose_type(type_name)
    }

    fn take(&mut self, topic: &Arc<str>, at: Written, message: &AnyMessage) {
        self.add(topic, at.time, message, false);
        if let Some(track) = self.by_topic.get_mut(topic) {
            track.found_at.resize(track.points.read().len(), at.messages);
        }
    }

    fn fork(&self, at: Written) -> Self {
        let fork = |(topic, track): (&Arc<str>, &Growing)| {
            let shared = track.found_at.partition_point(|&messages| messages <= at.messages);
            let begun = Growing {
                frame_id: Arc::clone(&track.frame_id),
                origin: track.origin,
                has_altitude: track.has_altitude,
                points: track.points.fork_first(shared),
                found_at: track.found_at[..shared].to_vec(),
            };
            (Arc::clone(topic), begun)
        };
        Self { by_topic: self.by_topic.iter().map(fork).collect(), ..Self::default() }
    }
}

impl Tracks {
    /// Adds a canonical message with this log time on `topic`.
    pub(crate) fn add(&mut self, topic: &Arc<str>, log_time: Stamp, message: &AnyMessage, is_static: bool) {
        if let Some(place) = Place::of(message) {
            self.push(topic, log_time, &place);
        }
        if let Some(odometry) = message.get::<foxglove::Odometry>() {
            let (parent, child) = (frame_name(&odometry.frame_id), frame_name(&odometry.body_frame_id));
            if let Some(pose) = odometry.pose.as_ref().and_then(to_pose)
                && !parent.is_empty()
                && !child.is_empty()
            {
                let time = time_of(odometry.timestamp.as_ref().and_then(Stamp::from_proto), log_time);
                self.implied_clock.add(child, log_time, time);
                let kept = self.latest_kept(log_time, time);
                // A loop or a number that is not finite: the track still shows it.
                let _ = self.implied.insert_as_of(parent, child, time.0, pose, kept.0);
            }
        } else if let Some(list) = message.get::<foxglove::FrameTransforms>() {
            for transform in &list.transforms {
                self.transform(topic, transform, log_time, is_static);
            }
        } else if let Some(transform) = message.get::<foxglove::FrameTransform>() {
            self.transform(topic, transform, log_time, is_static);
        }
    }

    fn push(&mut self, topic: &Arc<str>, stamp: Stamp, place: &Place<'_>) {
        let track = self.by_topic.entry(Arc::clone(topic)).or_insert_with(|| Growing {
            frame_id: place.frame_id.into(),
            origin: match &place.position {
                Position::Geodetic { fix, .. } => Some(Enu::new(*fix)),
                Position::Local(_) => None,
            },
            has_altitude: false,
            points: SeriesWriter::default(),
            found_at: Vec::new(),
        });
        if let Position::Geodetic { fix, has_altitude: true } = &place.position
            && let Some(origin) = track.origin.filter(|_| !track.has_altitude)
        {
            // The points before have no altitude of their own: they lie as high as this one.
            let altitude_m = fix.altitude_m;
            track.origin = Some(Enu::new(Geodetic { altitude_m, ..origin.origin() }));
            track.has_altitude = true;
        }
        let before = track.points.read().last();
        let position_m = place.position.metres(track.origin.as_ref(), before).to_array();
        track.points.push(TrackPoint { stamp, position_m, yaw_rad: place.yaw_rad });
    }

    fn transform(
        &mut self,
        topic: &Arc<str>,
        transform: &foxglove::FrameTransform,
        log_time: Stamp,
        is_static: bool,
    ) {
        let parent = frame_name(&transform.parent_frame_id);
        let child = frame_name(&transform.child_frame_id);
        if let Err(why) = self.place(parent, child, transform, log_time, is_static) {
            self.doubts.extend(self.refused.tell(topic, parent, child, &why));
            return;
        }
        self.transforms += 1;
        if is_static {
            return;
        }
        match self.moved_by.get_mut(child) {
            None => {
                self.moved_by.insert(child.to_owned(), (Arc::clone(topic), false));
            }
            Some((first, is_told)) if **first != **topic && !*is_told => {
                *is_told = true;
                self.doubts.push(format!(
                    "{parent}→{child} comes from {first} and {topic}: their transforms are mixed"
                ));
            }
            Some(_) => {}
        }
    }

    /// Adds the pose of a frame. If it is refused, the pose of the frame does not change.
    fn place(
        &mut self,
        parent: &str,
        child: &str,
        transform: &foxglove::FrameTransform,
        log_time: Stamp,
        is_static: bool,
    ) -> Result<(), String> {
        let pose = pose_stated(transform)?;
        let placed = if is_static {
            self.tree.set_static(parent, child, pose)
        } else {
            let time = time_of(transform.timestamp.as_ref().and_then(Stamp::from_proto), log_time);
            self.clock.add(child, log_time, time);
            let kept = self.latest_kept(log_time, time);
            self.tree.insert_as_of(parent, child, time.0, pose, kept.0)
        };
        placed.map_err(|error| error.to_string())
    }

    /// Transforms of a frame that are later than this are forgotten when one with this log time and time is added. Shortly
    /// after the clock has begun again, a publisher may still send transforms of before, until its first new one.
    fn latest_kept(&self, log_time: Stamp, time: Stamp) -> Stamp {
        if self.clock.has_just_begun(log_time) { time.after_ns(BEGINS_AGAIN_NS) } else { Stamp::MAX }
    }

    /// Ends here, because the clock began again at this log time, and gives what goes on from there: no transforms, the
    /// positions since then, which are no longer among these, and the origins of geodetic tracks. `doubt` says where it is.
    pub(crate) fn begin_again(&mut self, begun: Stamp, doubt: Option<String>) -> Self {
        let mut by_topic = BTreeMap::new();
        for (topic, track) in &mut self.by_topic {
            let known = track.points.read();
            let kept = known.count_before(begun);
            let points = SeriesWriter::default();
            if kept < known.len() {
                known.each(kept..known.len(), |point| points.push(*point));
                track.points = track.points.fork_first(kept);
            } else if track.origin.is_none() {
                continue;
            }
            let Growing { origin, has_altitude, .. } = *track;
            let frame_id = Arc::clone(&track.frame_id);
            let next = Growing { frame_id, origin, has_altitude, points, found_at: Vec::new() };
            by_topic.insert(Arc::clone(topic), next);
        }
        let moved_by = std::mem::take(&mut self.moved_by);
        let refused = std::mem::take(&mut self.refused);
        let mut doubts = std::mem::take(&mut self.doubts);
        doubts.extend(doubt);
        let [clock, implied_clock] = [begun; 2].map(TransformClock::begun_at);
        Self { by_topic, clock, implied_clock, moved_by, refused, doubts, ..Self::default() }
    }

    /// Whether a message with transforms, not only odometry, moves or places this frame.
    pub(crate) fn has_transform(&self, frame: &str) -> bool {
        self.tree.parent(frame).is_some()
    }

    /// Number of positions and transforms.
    pub(crate) fn len(&self) -> usize {
        let positions = self.by_topic.values().map(|track| track.points.read().len());
        positions.sum::<usize>() + self.transforms
    }

    /// What is doubtful about the transforms, one line each; it only grows.
    pub(crate) fn doubts(&self) -> &[String] {
        &self.doubts
    }

    /// All tracks up to now, as those of a run.
    pub(crate) fn read(&self, run: RunTag) -> impl Iterator<Item = Track> + '_ {
        self.by_topic.iter().map(move |(topic, track)| Track {
            topic: Arc::clone(topic),
            run,
            frame_id: Arc::clone(&track.frame_id),
            origin: track.origin,
            points: track.points.read(),
        })
    }

    /// All transforms, shared; those implied by odometry only of frames of which no message gives one.
    pub(crate) fn tree(&self) -> TransformTree {
        let mut tree = self.tree.clone();
        tree.take_missing(&self.implied);
        tree
    }

    /// The clock of [`Tracks::tree`]: that of the messages with transforms, or without any, of the odometry.
    pub(crate) fn clock(&self) -> &TransformClock {
        if self.clock.is_empty() { &self.implied_clock } else { &self.clock }
    }
}

/// The stamp of a message; `None` for one of 0 in a log that is not at 0, which states none.
pub(crate) fn stated(stamp: Option<Stamp>, log_time: Stamp) -> Option<Stamp> {
    stamp.filter(|stamp| stamp.0 != 0 || log_time.0 <= SAME_NS)
}

/// The time with which a transform counts.
pub(crate) fn time_of(stamp: Option<Stamp>, log_time: Stamp) -> Stamp {
    stated(stamp, log_time).unwrap_or(log_time)
}

/// Position, m, and heading, rad, of a pose. Four zeros are an orientation that was never set: the heading is NaN. `None`
/// for an impossible pose.
fn position_and_yaw(pose: &foxglove::Pose) -> Option<(DVec3, f64)> {
    let (position, rotation) = (pose.position.as_ref()?, pose.orientation.as_ref()?);
    if [rotation.x, rotation.y, rotation.z, rotation.w] == [0.0; 4] {
        let position = DVec3::new(position.x, position.y, position.z);
        return position.is_finite().then_some((position, f64::NAN));
    }
    let pose = pose_of(position, rotation).ok()?;
    Some((pose.translation, pose.yaw()))
}

pub(crate) fn to_pose(pose: &foxglove::Pose) -> Option<Pose> {
    pose_of(pose.position.as_ref()?, pose.orientation.as_ref()?).ok()
}

/// The pose that a message with a transform states; the error names its frames.
pub(crate) fn pose_stated(transform: &foxglove::FrameTransform) -> Result<Pose, String> {
    let parent = frame_name(&transform.parent_frame_id);
    let child = frame_name(&transform.child_frame_id);
    let (Some(translation), Some(rotation)) = (&transform.translation, &transform.rotation) else {
        return Err(format!("transform from \"{child}\" to \"{parent}\" lacks translation or rotation"));
    };
    pose_of(translation, rotation)
        .map_err(|error| format!("transform from \"{child}\" to \"{parent}\": {error}"))
}

/// A rigid transform; an error if a number is not finite or the rotation is not valid.
pub(crate) fn pose_of(
    translation: &foxglove::Vector3,
    rotation: &foxglove::Quaternion,
) -> Result<Pose, PoseError> {
    let translation = [translation.x, translation.y, translation.z];
    Pose::from_parts(translation, [rotation.x, rotation.y, rotation.z, rotation.w])
}

#[cfg(test)]
#[path = "tracks_tests.rs"]
pub(super) mod tests;
