//! Runs of a course, as reported by the referee of the simulation.

use crate::usage;
use rcs_bus::Buffer;
use rcs_log::Log;
use rcs_msg::rcs::{CourseOutcome, CourseRun};
use rcs_msg::{Stamp, schema_of};
use rcs_runtime::{Plan, Recording, RunError, Stepped};
use serde::Serialize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Interval at which the referee is checked, simulated time; fixed, so that a run always ends at the same time.
const ASK_EVERY_NS: u64 = 200_000_000;

/// One run of a course: an entry of `runs` in `ocu run --json`.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct RunReport {
    pub(crate) seed: u64,
    pub(crate) outcome: &'static str,
    pub(crate) time_s: f64,
    pub(crate) distance_m: f64,
    pub(crate) remaining_m: f64,
    pub(crate) collisions: u32,
    pub(crate) bumper_hits: u32,
    pub(crate) slip_s: f64,
    pub(crate) hash: String,
}

impl RunReport {
    /// From the last report of the referee.
    pub(crate) fn new(seed: u64, run: &CourseRun, hash: String) -> Self {
        Self {
            seed,
            outcome: match run.outcome() {
                CourseOutcome::CourseRunning => "unfinished",
                CourseOutcome::CourseReached => "reached",
                CourseOutcome::CourseTimeOut => "time_limit",
                CourseOutcome::CourseLost => "lost",
            },
            time_s: run.time_s,
            distance_m: run.distance_m,
            remaining_m: run.remaining_m,
            collisions: run.collisions,
            bumper_hits: run.bumper_hits,
            slip_s: run.slip_s,
            hash,
        }
    }
}

/// The buffer in which the referee of a stack reports; `None` if the stack is not a simulation.
pub(crate) fn referee(plan: &Plan) -> Option<usize> {
    plan.buffers.iter().position(|buffer| buffer.spec.schema.name() == schema_of::<CourseRun>().name())
}

/// Refuses a stack that cannot run, or that would run on for ever: it reads a recording that is not there or lacks topics
/// of it, or nothing ends it.
pub(crate) fn check(
    plan: &Plan,
    log: Option<&Log>,
    until_s: Option<f64>,
    course: bool,
) -> anyhow::Result<()> {
    let stack = plan.file.name();
    if log.is_none()
        && let Some(input) = plan.inputs.first()
    {
        let topic = &input.topic;
        return Err(usage(format!(
            "the stack {stack} reads the topic {topic} of a recording; expected --log"
        )));
    }
    let missing = log.map(|log| plan.check_log(log.info())).unwrap_or_default();
    if !missing.is_empty() {
        return Err(RunError::Inputs(missing).into());
    }
    let has_referee = referee(plan).is_some();
    if log.is_none() && until_s.is_none() && !has_referee {
        return Err(usage(
            "a stack without a recording runs on for ever: expected --log, --course or --until",
        ));
    }
    // On a recording, a course gives the vehicle and the goal.
    if course && !has_referee && log.is_none() {
        return Err(usage(format!("the stack {stack} runs no course: nothing in it reports one")));
    }
    Ok(())
}

/// When a run that has begun ends: when the recording that it reads has no more messages, and at the latest after
/// `until_s`. `None` if only the referee ends it.
pub(crate) fn end(run: &Stepped, until_s: Option<f64>) -> Option<Stamp> {
    let until = until_s.map(|seconds| run.start().after_ns((seconds * 1e9).round() as u64));
    [run.horizon(), until].into_iter().flatten().min()
}

/// What ends a run early.
#[derive(Clone, Copy, Default)]
pub(crate) struct Stop<'a> {
    /// A recording, when it fails.
    pub(crate) recording: Option<&'a Recording>,
    /// A flag, when it is set.
    pub(crate) cancelled: Option<&'a AtomicBool>,
}

impl Stop<'_> {
    /// Whether a recording has failed, after which outputs would be lost, or the run was cancelled. The cause of a
    /// failure is reported when the recording is closed.
    fn is_due(self) -> bool {
        self.recording.is_some_and(|recording| recording.status().error.is_some())
            || self.cancelled.is_some_and(|cancelled| cancelled.load(Ordering::Relaxed))
    }
}

/// Runs until `to`, but not beyond its [`end`]; if it has none, until the referee has decided. Returns whether the run may
/// continue.
pub(crate) fn go_to(
    run: &mut Stepped,
    end: Option<Stamp>,
    to: Stamp,
    stop: Stop<'_>,
) -> Result<bool, RunError> {
    match (referee(run.plan()), end) {
        (Some(referee), None) => to_the_verdict(run, referee, to, stop),
        (_, end) => to_a_time(run, end.map_or(to, |end| to.min(end)), stop),
    }
}

/// The last report of the referee.
pub(crate) fn verdict(buffer: &Arc<Buffer>) -> Option<CourseRun> {
    buffer.latest().and_then(|sample| sample.message.to())
}

/// Runs until the referee has decided, or until a time. Returns whether the run may continue: not once it is decided.
fn to_the_verdict(run: &mut Stepped, referee: usize, to: Stamp, stop: Stop<'_>) -> Result<bool, RunError> {
    let decided = |run: &Stepped| {
        verdict(&run.buffers()[referee])
            .is_some_and(|verdict| verdict.outcome() != CourseOutcome::CourseRunning)
    };
    // The referee is checked at whole multiples of the interval from the start, wherever the run is now.
    let asked = run.now().0.saturating_sub(run.start().0) / ASK_EVERY_NS;
    let mut until = run.start().after_ns(asked * ASK_EVERY_NS);
    while !decided(run) && until < to {
        if stop.is_due() {
            return Ok(false);
        }
        until = until.after_ns(ASK_EVERY_NS);
        if !run.run_until(until.min(to))? {
            break;
        }
    }
    Ok(!decided(run))
}

/// Runs until a time. Returns whether the run may continue.
fn to_a_time(run: &mut Stepped, to: Stamp, stop: Stop<'_>) -> Result<bool, RunError> {
    while let Some(next) = run.next_time()?.filter(|next| *next <= to) {
        if stop.is_due() {
            return Ok(false);
        }
        run.run_until(next.after_ns(ASK_EVERY_NS).min(to))?;
    }
    run.run_until(to)?;
    Ok(true)
}
