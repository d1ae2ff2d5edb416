//! Evaluates what a planner feels of a map: whether vehicle-wide arcs that are truly free are called blocked, whether
//! truly blocked ones are called free, and how early each thing in the way blocks an arc.
//!
//! Along a drive, each map is compared with the true map at the vehicle's pose. A fan of arcs of constant curvature
//! leaves the vehicle; an arc covers the cells whose middles lie under the vehicle's width, from its front on. The true
//! map and the judged map are read in the vehicle frame, each with its own pose of the vehicle, so that drift of the
//! local frame does not count.
//!
//! - An arc is truly blocked if a blocked cell lies under the vehicle's width, and truly free if none lies within the
//!   tolerance around it either. Arcs between the two graze a thing and are not counted.
//! - It is called blocked if a cell under the vehicle's width has a cost of at least [`rcs_world::OBSTACLE_COST`]. A
//!   truly blocked arc also counts as called blocked if such a cell lies within the tolerance.
//! - An arc of which the fused map knows too little, and which it does not block, is not judged.
//! - Each source alone is judged on the same arcs as the fused map; what it does not know blocks nothing.
//! - A thing is in the way while it is the first true thing on an arc. It blocks the arc when an obstacle cell lies
//!   within 0.6 m of it along the arc.

mod arc;
mod judge;
mod report;
mod truth;

pub use judge::{FUSED, Judge};
pub use report::{ArcCounts, FirstBlock, Layer, Report, Shares, ThingReport};

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
    /// The arcs.
    pub settings: Settings,
}

/// Evaluates the maps of a recording.
pub fn recording(job: &Job, log: &Log) -> Result<Report, EvalError> {
    let topics = Topics::find(job, log)?;
    let mut judge = Judge::new(&job.settings);
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

impl Topics {
    /// The topics that were named, or those whose metadata says what they are.
    fn find(job: &Job, log: &Log) -> Result<Topics, EvalError> {
        let all = || log.info().topics.iter();
        let says = |topic: &LogTopic, key: &str, value: &str| {
            topic.metadata.get(key).is_some_and(|found| found == value)
        };
        let is_true = |topic: &&LogTopic| says(topic, "rcs.ground_truth", "true");
        let is_map = |topic: &&LogTopic| says(topic, "rcs.role", "map") && is_of::<Grid>(topic);
        let is_pose = |topic: &&LogTopic| {
            says(topic, "rcs.role", "pose") && (is_of::<Odometry>(topic) || is_of::<PoseInFrame>(topic))
        };
        let one = |what: &str, option: &str, named: Option<&String>, found: Vec<&LogTopic>| {
            let names: Vec<&str> = found.iter().map(|topic| topic.name.as_str()).collect();
            match (named, found.as_slice()) {
                (Some(name), _) => log
                    .info()
                    .topics_named(name)
                    .next()
                    .map(|topic| topic.id)
                    .ok_or_else(|| EvalError::refused(format!("the recording has no topic {name}"))),
                (None, [topic]) => Ok(topic.id),
                (None, []) => {
                    Err(EvalError::refused(format!("the recording has no {what}; expected {option}")))
                }
                (None, _) => {
                    Err(EvalError::refused(format!("expected {option} with one of {}", names.join(", "))))
                }
            }
        };
        let true_maps = all().filter(is_true).filter(is_map).collect();
        let true_poses = all().filter(is_true).filter(is_pose).collect();
        let maps = all().filter(|topic| !is_true(topic)).filter(is_map).collect();
        let true_map = one("true map", "--truth-map", job.true_map.as_ref(), true_maps)?;
        let true_pose = one("true pose", "--truth-pose", job.true_pose.as_ref(), true_poses)?;
        let map = one("map", "--map", job.map.as_ref(), maps)?;
        let mut parts: BTreeMap<TopicId, Part> =
            [(true_map, Part::TrueMap), (true_pose, Part::TruePose), (map, Part::Map)].into();
        // Any pose in the frame of the maps will do; poses of other frames are skipped one by one.
        let poses: Vec<TopicId> = match &job.pose {
            Some(name) => log.info().topics_named(name).map(|topic| topic.id).collect(),
            None => all().filter(|topic| !is_true(topic)).filter(is_pose).map(|topic| topic.id).collect(),
        };
        if poses.is_empty() {
            let what = job
                .pose
                .as_ref()
                .map_or("no pose of the vehicle".to_owned(), |name| format!("no topic {name}"));
            return Err(EvalError::refused(format!("the recording has {what}; expected --pose")));
        }
        for pose in poses {
            parts.entry(pose).or_insert(Part::Pose);
        }
        let options = CursorOptions { topics: Some(vec![map]), ..CursorOptions::default() };
        let schema = log.info().topic(map).map(|topic| topic.schema.clone());
        let first = log.cursor(options).next().transpose()?.zip(schema);
        let grid = first.and_then(|(first, schema)| AnyMessage::encoded(schema, first.data).to::<Grid>());
        let frame = grid.ok_or_else(|| EvalError::nothing("the recording has no map that decodes"))?.frame_id;
        Ok(Topics { parts, frame })
    }
}

fn is_of<T: Payload>(topic: &LogTopic) -> bool {
    topic.schema.name() == schema_of::<T>().name()
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
