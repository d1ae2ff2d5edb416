//! Evaluates what a planner feels of a map: whether vehicle-wide arcs that are truly free are called blocked, whether
//! truly blocked ones are called free, and how early each thing in the way blocks an arc.
//!
//! Along a drive, each map is compared with the true map at the vehicle's pose. A fan of arcs of constant curvature
//! leaves the vehicle ([`Vehicle`]); an arc covers the cells whose middles lie under the vehicle's width, from its front
//! on. The true map and the judged map are read in the vehicle frame, each with its own pose of the vehicle, so that
//! drift of the local frame does not count.
//!
//! - An arc is truly blocked if a blocked cell lies under the vehicle's width, and truly free if none lies within the
//!   tolerance around it either. Arcs between the two graze a thing and are not counted.
//! - It is called blocked if a cell under the vehicle's width has a cost of at least [`rcs_world::OBSTACLE_COST`]. A
//!   truly blocked arc also counts as called blocked if such a cell lies within the tolerance.
//! - An arc of which the fused map knows too little, and which it does not block, is not judged.
//! - Each source alone is judged on the same arcs as the fused map; what it does not know blocks nothing.
//! - A thing is in the way while it is the first true thing on an arc. It blocks the arc when an obstacle cell lies
//!   within 0.6 m of it along the arc.
//! - A thing in the way is sighted from a pose 2 m to 5 m before it if it is in view of the cameras and has been so over
//!   the last 0.5 m. Whether it blocks the arc is counted for each of these poses, so that a thing that the vehicle
//!   keeps away from is judged, too.

mod arc;
mod judge;
mod report;
mod sightings;
mod truth;
mod vehicle;

pub use judge::{FUSED, Judge};
pub use report::{
    ArcCounts, BANDS_M, Band, FirstBlock, JudgedFor, Layer, Report, Shares, ThingReport, ThingSightings,
};
pub use vehicle::Vehicle;

use crate::EvalError;
use crate::messages::each_whole;
use rcs_geom::Pose;
use rcs_log::{CursorOptions, Log, LogTopic, TopicId};
use rcs_msg::foxglove::{self, Grid, Odometry, PoseInFrame};
use rcs_msg::{AnyMessage, Payload, Stamp, schema_of};
use rcs_sense::pose_of;
use rcs_world::{GridView, MapMessage};
use std::collections::BTreeMap;
use truth::Truth;

/// The arcs, and what counts as known.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Lengths of the arcs from the front of the vehicle, m.
    pub lengths_m: Vec<f64>,
    /// Width of the vehicle, m.
    pub width_m: f64,
    /// Distance of the vehicle's front ahead of the origin of its frame, m.
    pub front_m: f64,
    /// Number of arcs.
    pub arcs: usize,
    /// Greatest curvature, 1/m.
    pub curvature_per_m: f64,
    /// Tolerance around things, m: one cell.
    pub tolerance_m: f64,
    /// Least share of the cells of an arc that the fused map must know, 0 to 1.
    pub least_known: f64,
    /// Distance driven between two judged maps, m.
    pub step_m: f64,
    /// Angle of view of all cameras together, half of it to either side of straight ahead, rad.
    pub view_rad: f64,
    /// Height of the cameras above the ground, m.
    pub eye_height_m: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            lengths_m: vec![3.0, 5.0],
            width_m: 0.7,
            front_m: 0.24,
            arcs: 9,
            curvature_per_m: 0.4,
            tolerance_m: 0.2,
            least_known: 0.9,
            step_m: 0.1,
            // Where both stereo pairs of the vehicle `lagr` have range: 59° to the right, 50° to the left.
            view_rad: 100_f64.to_radians(),
            eye_height_m: 0.95,
        }
    }
}

/// What is evaluated; a topic that is `None` is found by its role.
#[derive(Clone, Debug, Default)]
pub struct Job {
    /// Topic of the maps.
    pub map: Option<String>,
    /// Topic of the true map: a grid with the field `blocked`.
    pub true_map: Option<String>,
    /// Topic of the true poses of the vehicle, in the frame of the true map.
    pub true_pose: Option<String>,
    /// Topic of the vehicle's poses in the frame of the maps.
    pub pose: Option<String>,
    /// The vehicle. What is not given is that of the recorded run, else that of the settings.
    pub vehicle: Vehicle,
    /// The arcs.
    pub settings: Settings,
}

/// Evaluates the maps of a recording.
pub fn recording(job: &Job, log: &Log) -> Result<Report, EvalError> {
    let topics = Topics::find(job, log)?;
    let vehicle = job.vehicle.or(Vehicle::recorded(log)?);
    let mut judge = Judge::new(&vehicle.settings(&job.settings));
    let wanted: Vec<TopicId> = topics.parts.keys().copied().collect();
    each_whole(log, &wanted, |topic, message, time| match topics.parts.get(&topic) {
        Some(&part) => take(&mut judge, part, message, time, &topics),
        None => Ok(()),
    })?;
    judge.report()
}

/// What a topic is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    TrueMap,
    TruePose,
    Map,
    Pose,
}

struct Topics {
    parts: BTreeMap<TopicId, Part>,
    /// Frame of the maps.
    frame: String,
}

fn take(
    judge: &mut Judge,
    part: Part,
    message: &AnyMessage,
    time: Stamp,
    topics: &Topics,
) -> Result<(), EvalError> {
    match part {
        Part::TrueMap => match message.to::<Grid>().filter(Truth::is_one) {
            Some(grid) => judge.take_truth(grid)?,
            None => return Err(EvalError::refused("the true map is no grid with the field \"blocked\"")),
        },
        Part::TruePose => {
            if let Some((time, pose, _)) = pose(message, time) {
                judge.take_true_pose(time, pose);
            }
        }
        Part::Pose => {
            if let Some((time, pose, frame)) = pose(message, time)
                && frame == topics.frame
            {
                judge.take_pose(time, pose);
            }
        }
        Part::Map => {
            // A message of a log is bytes until it is decoded; one put together from deltas is a map.
            let map = message.source::<MapMessage>();
            let stored = if map.is_some() { None } else { message.to::<Grid>() };
            let stamp = stored.as_ref().and_then(|grid| Stamp::from_proto(grid.timestamp.as_ref()?));
            let time = map.map(MapMessage::time).or(stamp).unwrap_or(time);
            let view = stored.as_ref().map_or_else(|| GridView::of(message), GridView::new);
            judge.take_map(time, &view.map_err(|error| EvalError::nothing(error.to_string()))?)?;
        }
    }
    Ok(())
}

/// Time, pose and frame of a message of odometry or of a pose.
fn pose(message: &AnyMessage, otherwise: Stamp) -> Option<(Stamp, Pose, String)> {
    let of = |time: Option<&_>, pose: Option<&foxglove::Pose>, frame: &str| {
        let time = time.and_then(Stamp::from_proto).unwrap_or(otherwise);
        Some((time, pose_of(pose, frame).ok()?, frame.to_owned()))
    };
    if let Some(odometry) = message.to::<Odometry>() {
        return of(odometry.timestamp.as_ref(), odometry.pose.as_ref(), &odometry.frame_id);
    }
    let pose = message.to::<PoseInFrame>()?;
    of(pose.timestamp.as_ref(), pose.pose.as_ref(), &pose.frame_id)
}

/// What a topic is needed for, and how it is found.
struct Need {
    /// For errors.
    what: &'static str,
    /// The option that names it.
    option: &'static str,
    /// Its role.
    role: &'static str,
    /// Whether it holds the ground truth.
    is_true: bool,
    /// Whether a topic is of the type.
    fits: fn(&LogTopic) -> bool,
    /// The type, for errors.
    expected: &'static str,
}

const MAP: Need = Need {
    what: "map",
    option: "--map",
    role: "map",
    is_true: false,
    fits: is_of::<Grid>,
    expected: "foxglove.Grid",
};
const TRUE_MAP: Need = Need { what: "true map", option: "--truth-map", is_true: true, ..MAP };
const POSE: Need = Need {
    what: "pose of the vehicle",
    option: "--pose",
    role: "pose",
    is_true: false,
    fits: is_pose,
    expected: "foxglove.Odometry or foxglove.PoseInFrame",
};
const TRUE_POSE: Need = Need { what: "true pose", option: "--truth-pose", is_true: true, ..POSE };

impl Need {
    /// The topics whose metadata says what they are. One without messages is none of them: a recording has all topics
    /// that its stack may have written.
    fn found<'a>(&self, log: &'a Log) -> Vec<&'a LogTopic> {
        let says = |topic: &LogTopic, key: &str, value: &str| {
            topic.metadata.get(key).is_some_and(|found| found == value)
        };
        let is_one = |topic: &&LogTopic| {
            let is_known = says(topic, "rcs.role", self.role) && (self.fits)(topic);
            is_known && topic.messages > 0 && says(topic, "rcs.ground_truth", "true") == self.is_true
        };
        log.info().topics.iter().filter(is_one).collect()
    }

    /// The topics of a name and the type, at least one.
    fn named<'a>(&self, log: &'a Log, name: &'a str) -> Result<Vec<&'a LogTopic>, EvalError> {
        let all: Vec<&LogTopic> = log.info().topics_named(name).collect();
        let fitting: Vec<&LogTopic> = all.iter().copied().filter(|topic| (self.fits)(topic)).collect();
        let Some(first) = all.first() else {
            return Err(EvalError::refused(format!("the recording has no topic {name}")));
        };
        if fitting.is_empty() {
            let (option, got, expected) = (self.option, first.schema.name(), self.expected);
            return Err(EvalError::refused(format!("{option}: {name} holds {got:?}, expected {expected}")));
        }
        Ok(fitting)
    }

    /// The topic of a name, else the only one that is found.
    fn one(&self, log: &Log, name: Option<&String>) -> Result<TopicId, EvalError> {
        let topics: Vec<&LogTopic> = match name {
            Some(name) => self.named(log, name)?.into_iter().take(1).collect(),
            None => self.found(log),
        };
        let Need { what, option, .. } = self;
        let names = || topics.iter().map(|topic| topic.name.as_str()).collect::<Vec<_>>().join(", ");
        match topics.as_slice() {
            [topic] => Ok(topic.id),
            [] => Err(EvalError::refused(format!("the recording has no {what}; expected {option}"))),
            _ => Err(EvalError::refused(format!("expected {option} with one of {}", names()))),
        }
    }
}

impl Topics {
    /// The topics that were named, or those whose metadata says what they are.
    fn find(job: &Job, log: &Log) -> Result<Topics, EvalError> {
        let true_map = TRUE_MAP.one(log, job.true_map.as_ref())?;
        let true_pose = TRUE_POSE.one(log, job.true_pose.as_ref())?;
        let map = MAP.one(log, job.map.as_ref())?;
        if map == true_map {
            return Err(taken_twice(log, map, "the true map and as the map"));
        }
        let mut parts: BTreeMap<TopicId, Part> =
            [(true_map, Part::TrueMap), (true_pose, Part::TruePose), (map, Part::Map)].into();
        // Any pose in the frame of the maps will do; poses of other frames are skipped one by one.
        let poses = match &job.pose {
            Some(name) => POSE.named(log, name)?,
            None => POSE.found(log),
        };
        if poses.is_empty() {
            let Need { what, option, .. } = POSE;
            return Err(EvalError::refused(format!("the recording has no {what}; expected {option}")));
        }
        if poses.iter().all(|pose| pose.id == true_pose) {
            return Err(taken_twice(log, true_pose, "the true pose and as the pose of the vehicle"));
        }
        for pose in poses {
            parts.entry(pose.id).or_insert(Part::Pose);
        }
        Ok(Topics { parts, frame: frame_of(log, map)? })
    }
}

/// The error for a topic that was named for two parts.
fn taken_twice(log: &Log, topic: TopicId, parts: &str) -> EvalError {
    let name = log.info().topic(topic).map_or("", |topic| topic.name.as_str());
    EvalError::refused(format!("got {name} as {parts}, expected two topics"))
}

/// Frame of the first map of a topic.
fn frame_of(log: &Log, map: TopicId) -> Result<String, EvalError> {
    let topic = log.info().topic(map);
    let name = topic.map_or("the map", |topic| topic.name.as_str());
    let options = CursorOptions { topics: Some(vec![map]), ..CursorOptions::default() };
    let Some((first, topic)) = log.cursor(options).next().transpose()?.zip(topic) else {
        return Err(EvalError::nothing(format!("{name} has no messages, expected maps")));
    };
    let grid = AnyMessage::encoded(topic.schema.clone(), first.data).to::<Grid>();
    let refused = format!("the first message of {name} does not decode, expected a map");
    grid.map(|grid| grid.frame_id).ok_or_else(|| EvalError::nothing(refused))
}

fn is_pose(topic: &LogTopic) -> bool {
    is_of::<Odometry>(topic) || is_of::<PoseInFrame>(topic)
}

fn is_of<T: Payload>(topic: &LogTopic) -> bool {
    topic.schema.name() == schema_of::<T>().name()
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
