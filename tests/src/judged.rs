//! Runs of stacks whose maps are judged as `ocu eval obstacles` does.

use crate::bundled;
use rcs_eval::obstacles::{Judge, Report, Settings};
use rcs_log::Log;
use rcs_msg::foxglove::{Grid, Odometry, PoseInFrame};
use rcs_msg::{AnyMessage, Stamp};
use rcs_runtime::{Plan, RunOptions, Stepped};
use rcs_sense::pose_of;
use rcs_world::{GridView, MapMessage, Source, Sources};
use std::sync::Arc;

/// Buffers of the simulation with ground truth.
pub(crate) const TRUTH: [(&str, &str); 2] =
    [("/vehicle/ground_truth_map", "foxglove.Grid"), ("/vehicle/ground_truth_pose", "foxglove.Odometry")];

/// Drives a course with a stack for so many seconds.
pub(crate) fn simulated(
    stack: &str,
    course: &str,
    seed: u64,
    seconds: f64,
    params: &[(&str, &str)],
) -> Report {
    ablated(stack, course, seed, seconds, params, &[]).0
}

/// The same, and for each of these sources the fused map without it: the drive is the same, and its maps are fused anew
/// with the weight of the source at 0.
pub(crate) fn ablated(
    stack: &str,
    course: &str,
    seed: u64,
    seconds: f64,
    params: &[(&str, &str)],
    without: &[Source],
) -> (Report, Vec<Report>) {
    let options = RunOptions { seed, ..RunOptions::default() };
    judged(Stepped::new(bundled::plan(stack, course, params), None, options).unwrap(), seconds, without)
}

/// Runs a plan on a log to its end.
#[allow(dead_code, reason = "the tests simulate")]
pub(crate) fn replayed(plan: Arc<Plan>, log: &Log) -> Report {
    judged(Stepped::new(plan, Some(log), RunOptions::default()).unwrap(), f64::MAX, &[]).0
}

/// Runs until so many seconds after the start or the end of the log, and judges each map of the process `wm1`.
fn judged(mut run: Stepped, seconds: f64, without: &[Source]) -> (Report, Vec<Report>) {
    run.begin().unwrap();
    let mut judges = vec![Judge::new(&Settings::default()); 1 + without.len()];
    let until = if seconds < 1e6 { Some(Stamp((seconds * 1e9) as u64)) } else { None };
    let end = run.horizon().or(until).unwrap();
    let names = [TRUTH[0].0, TRUTH[1].0, "/wm1/vehicle", "/wm1/map"];
    let buffers = names.map(|name| run.bus().get(name).unwrap().clone());
    let mut seen = [0; 4];
    while run.next_time().unwrap().is_some_and(|time| time <= end) {
        run.advance().unwrap();
        for (place, buffer) in buffers.iter().enumerate() {
            if buffer.newest() == seen[place] {
                continue;
            }
            seen[place] = buffer.newest();
            let Some(sample) = buffer.latest() else { continue };
            let time =
                |stamp: Option<&_>| stamp.and_then(Stamp::from_proto).unwrap_or(sample.header.acq_time);
            match place {
                0 => {
                    let truth: Grid = sample.message.to().unwrap();
                    for judge in &mut judges {
                        judge.take_truth(truth.clone()).unwrap();
                    }
                }
                1 => {
                    let pose: Odometry = sample.message.to().unwrap();
                    let time = time(pose.timestamp.as_ref());
                    let pose = pose_of(pose.pose.as_ref(), "").unwrap();
                    for judge in &mut judges {
                        judge.take_true_pose(time, pose);
                    }
                }
                2 => {
                    let pose: PoseInFrame = sample.message.to().unwrap();
                    let time = time(pose.timestamp.as_ref());
                    let pose = pose_of(pose.pose.as_ref(), "").unwrap();
                    for judge in &mut judges {
                        judge.take_pose(time, pose);
                    }
                }
                _ => {
                    judges[0].take_map(run.now(), &GridView::of(&sample.message).unwrap()).unwrap();
                    for (judge, &source) in judges[1..].iter_mut().zip(without) {
                        let map = fused_without(&sample.message, source);
                        judge.take_map(run.now(), &GridView::of(&map).unwrap()).unwrap();
                    }
                }
            }
        }
    }
    let mut reports = judges.iter().map(|judge| judge.report().unwrap());
    (reports.next().unwrap(), reports.collect())
}

/// A map fused without a source. Its message names no sources, so that only the fused map is judged.
fn fused_without(message: &AnyMessage, source: Source) -> AnyMessage {
    let map = message.source::<MapMessage>().unwrap().clone();
    let mut options = map.options().clone();
    options.weights = options.weights.with(source, 0.0);
    options.sources = Sources::default();
    map.with_options(options).into_message()
}
