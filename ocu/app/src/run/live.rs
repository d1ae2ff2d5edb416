//! `ocu run --live`: runs a stack on threads in real time, without a window.

use super::acts::{self, Act};
use super::report::{Outcome, Report};
use super::{Done, save_one, what};
use crate::cli::RunArgs;
use crate::runs::{self, RunReport};
use crate::{Ended, stacks, usage};
use anyhow::Context as _;
use rcs_msg::rcs::fault::Kind;
use rcs_msg::rcs::{CourseOutcome, Override};
use rcs_runtime::{Live, LiveOptions, Plan, RunOptions};
use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Interval at which the referee is checked.
const ASK_EVERY: Duration = Duration::from_millis(100);

/// Runs the stack until `--until` or until the referee of a course has decided, and prints the report; `told` are the
/// warnings before the run.
pub(super) fn run(
    args: &RunArgs,
    plan: Arc<Plan>,
    referee: Option<usize>,
    acts: &[Act],
    told: Vec<String>,
    out: &mut dyn Write,
) -> anyhow::Result<Ended> {
    let is_late = |change: &Override| change.fault.as_ref().is_some_and(|fault| fault.kind() == Kind::Late);
    if acts.iter().any(|act| act.event.message.get::<Override>().is_some_and(is_late)) {
        return Err(usage(
            "a live run cannot deliver messages late; expected another fault, or a stepped run",
        ));
    }
    let base = stacks::options();
    let seed = args.seed.unwrap_or(0);
    let threads = args.threads.map_or(base.threads, usize::from);
    let options = LiveOptions {
        run: RunOptions { seed, threads, hash: true, ..base },
        record: args.record.clone(),
        what: what(args),
        replace: args.force,
        ..LiveOptions::default()
    };
    let live = Live::start(plan, &options).context("the stack cannot run")?;
    let clock = Instant::now();
    let buffer = |name: &str| live.bus().get(name).cloned();
    let saves: Vec<_> = args.save.iter().map(|save| (save, buffer(&save.buffer))).collect();
    let referee = referee.and_then(|index| buffer(&live.plan().buffers[index].spec.name));
    let (undone, mut failure) = match drive(&live, args, referee.as_ref(), acts) {
        Ok(undone) => (undone, None),
        Err(error) => (Vec::new(), Some(error)),
    };
    let stopped = live.stop();
    match stopped.recording {
        Some(Err(error)) => {
            failure.get_or_insert(error.into());
        }
        Some(Ok(recording)) if recording.dropped > 0 => {
            let dropped = recording.dropped;
            tracing::warn!("{dropped} messages are not in the recording: the disk did not keep up");
        }
        _ => {}
    }
    for (save, buffer) in saves {
        let newest = buffer.and_then(|buffer| buffer.latest());
        if let Err(error) = save_one(newest, &save.buffer, &save.path, args.force) {
            failure.get_or_insert(error);
        }
    }
    for process in &stopped.hung {
        tracing::warn!("{process} hung and was left behind");
    }
    let outcome = if failure.is_some() || !stopped.hung.is_empty() { Outcome::Error } else { Outcome::End };
    let mut report =
        Report::new(stopped.summary, outcome, clock.elapsed().as_secs_f64()).with_timings(&stopped.timings);
    report.warnings.extend(undone);
    let verdict = referee.as_ref().and_then(runs::verdict);
    report.runs.extend(verdict.map(|verdict| RunReport::new(seed, &verdict, report.hash.clone())));
    let memory = crate::remembered::Remembered::default();
    Done { report, verdict: None, failure, unsaved: None, memory }.print(args, told, out)
}

/// Executes the actions of the operator, each at its times, until the end. Returns warnings about those that it did not
/// reach.
fn drive(
    live: &Live,
    args: &RunArgs,
    referee: Option<&Arc<rcs_bus::Buffer>>,
    acts: &[Act],
) -> anyhow::Result<Vec<String>> {
    let until_s = args.until;
    let recording_error = || live.recording().filter(|_| !args.keep_going).and_then(|status| status.error);
    let decided = || {
        let verdict = referee.filter(|_| until_s.is_none()).and_then(runs::verdict);
        verdict.is_some_and(|verdict| verdict.outcome() != CourseOutcome::CourseRunning)
    };
    let wait_until = |at_ns: Option<u64>| {
        loop {
            let passed = live.now().0.saturating_sub(live.started().0);
            let left =
                at_ns.map_or(Duration::MAX, |at_ns| Duration::from_nanos(at_ns.saturating_sub(passed)));
            if left.is_zero() || decided() || recording_error().is_some() {
                return;
            }
            std::thread::sleep(left.min(ASK_EVERY));
        }
    };
    let end_ns = until_s.map(|seconds| (seconds * 1e9).round() as u64);
    let mut left = None;
    for (at_ns, index) in acts::times(acts) {
        let is_after_end = end_ns.is_some_and(|end_ns| at_ns > end_ns);
        if !is_after_end {
            wait_until(Some(at_ns));
        }
        if is_after_end || decided() || recording_error().is_some() {
            left = Some((at_ns, index));
            break;
        }
        let act = &acts[index];
        let newest = live.bus().get(&act.event.buffer).and_then(|buffer| buffer.latest());
        let event = act.event_after(newest);
        event.and_then(|event| Ok(live.take(event)?)).with_context(|| act.name(at_ns))?;
    }
    if recording_error().is_none() {
        wait_until(end_ns);
    }
    if let Some(error) = recording_error() {
        return Err(anyhow::anyhow!("the recording failed: {error}"));
    }
    let end_s = live.now().seconds_since(live.started());
    Ok(left.map(|from| acts::undone(acts, from, end_s)).unwrap_or_default())
}
