//! The report of `ocu run`, for all kinds of runs.

use crate::check::Lost;
use crate::comparison::Comparison;
use crate::plain::plain;
use crate::runs::RunReport;
use crate::table::{Align, Table};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_log::Log;
use rcs_msg::rcs::{ProcessState, ProcessTiming};
use rcs_runtime::{ProcessSummary, Summary};
use serde::Serialize;
use std::io::Write;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Outcome {
    /// It ended as planned: the recording ended, the course was decided, or the time of `--until` was reached.
    End,
    /// A process ended in `ERROR`, or the request could not be completed.
    Error,
}

/// `ocu run --json`.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    pub(super) outcome: Outcome,
    time_s: f64,
    wall_s: f64,
    processes: Vec<ProcessReport>,
    /// Processes that did nothing useful, and why; what the run did not reach; as JSON also what was told before the run.
    pub(super) warnings: Vec<String>,
    buffers: Vec<BufferReport>,
    pub(super) hash: String,
    /// Damage of the recording that was read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) log: Option<LogDamage>,
    /// Runs of a course, in order; the rest of the report is about the last one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) runs: Vec<RunReport>,
    /// With `--replay`: whether the run equals the recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) replay: Option<Comparison>,
}

#[derive(Debug, Serialize)]
struct ProcessReport {
    name: String,
    state: &'static str,
    /// Why it is in `ERROR`.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
    cycles: u64,
    mean_us: f64,
    max_us: f64,
    overruns: u64,
    faults: u64,
    last_fault: String,
    /// With `--live`: how punctual it was.
    #[serde(flatten)]
    live: Option<LiveTiming>,
}

/// Timing of a process in a live run.
#[derive(Clone, Copy, Debug, Serialize)]
struct LiveTiming {
    /// Time from when a cycle was due until it had read its inputs, 99th percentile.
    start_late_p99_ms: f64,
    /// Time from when a cycle was due until its thread ran, 99th percentile.
    wake_late_p99_ms: f64,
    /// Time waiting for the lock of the run, to read inputs and to publish, 99th percentile.
    lock_wait_p99_ms: f64,
    /// Number of cycles skipped because the previous one had not finished.
    missed: u64,
    /// Number of these that would not have been skipped without waiting for the lock.
    missed_by_lock: u64,
}

#[derive(Debug, Serialize)]
struct BufferReport {
    name: String,
    schema: String,
    messages: u64,
    bytes: u64,
    hash: String,
}

/// Damage of the recording that a run reads.
#[derive(Debug, Serialize)]
pub(crate) struct LogDamage {
    lost: Lost,
    problems: Vec<String>,
}

impl LogDamage {
    /// Damage found while opening and reading; `None` without damage.
    pub(crate) fn of(log: &Log) -> Option<Self> {
        let (lost, problems) = (log.lost(), log.problems());
        let is_damaged = lost != rcs_log::Lost::default() || !problems.is_empty();
        is_damaged.then(|| Self { lost: lost.into(), problems })
    }
}

/// A process that did nothing useful: each message of an input was a fault, or it wrote nothing. The last fault says why,
/// else the last status.
fn warning(process: &ProcessSummary) -> Option<String> {
    let ProcessSummary { name, cycles, faults, last_fault, state_text, .. } = process;
    let last = match (last_fault.as_str(), state_text.as_str()) {
        ("", "") => String::new(),
        ("", status) => format!("; its status: {status}"),
        (fault, _) => format!("; the last one: {fault}"),
    };
    if let Some(input) = &process.refused_input {
        return Some(format!("{name} could use no message of its input {input}: {faults} faults{last}"));
    }
    let is_silent = process.written == Some(0) && *cycles > 0;
    is_silent.then(|| format!("{name} wrote nothing in {cycles} cycles, with {faults} faults{last}"))
}

impl Report {
    pub(super) fn new(summary: Summary, outcome: Outcome, wall_s: f64) -> Self {
        let failed = summary.processes.iter().any(|process| process.state == ProcessState::Error);
        let warnings = summary.processes.iter().filter_map(warning).collect();
        Self {
            warnings,
            outcome: if failed { Outcome::Error } else { outcome },
            time_s: summary.time_s,
            wall_s,
            processes: summary
                .processes
                .into_iter()
                .map(|process| ProcessReport {
                    name: process.name,
                    state: process.state.as_str_name(),
                    error: (process.state == ProcessState::Error).then_some(process.state_text),
                    cycles: process.cycles,
                    mean_us: process.mean_us,
                    max_us: process.max_us,
                    overruns: process.overruns,
                    live: None,
                    faults: process.faults,
                    last_fault: process.last_fault,
                })
                .collect(),
            buffers: summary
                .buffers
                .into_iter()
                .map(|buffer| BufferReport {
                    name: buffer.name,
                    schema: buffer.schema,
                    messages: buffer.messages,
                    bytes: buffer.bytes.unwrap_or(0),
                    hash: buffer.hash.unwrap_or_default(),
                })
                .collect(),
            hash: summary.hash.unwrap_or_default(),
            log: None,
            runs: Vec::new(),
            replay: None,
        }
    }

    /// The processes that are in `ERROR`, and why.
    pub(super) fn errors(&self) -> impl Iterator<Item = String> {
        let failed =
            self.processes.iter().filter_map(|process| Some((&process.name, process.error.as_ref()?)));
        failed.map(|(name, error)| format!("{name} is in ERROR: {error}"))
    }

    /// Adds the timing of each process of a live run.
    pub(super) fn with_timings(mut self, timings: &[ProcessTiming]) -> Self {
        for process in &mut self.processes {
            let timing = timings.iter().find(|timing| timing.process == process.name);
            process.live = timing.map(|timing| LiveTiming {
                start_late_p99_ms: timing.start_late_p99_us * 1e-3,
                wake_late_p99_ms: timing.wake_late_p99_us * 1e-3,
                lock_wait_p99_ms: timing.lock_wait_p99_us * 1e-3,
                missed: timing.missed,
                missed_by_lock: timing.missed_by_lock,
            });
        }
        self
    }

    /// The same, as an error where there are warnings and `--fail-on-fault` is given.
    pub(super) fn judged(mut self, fail_on_fault: bool) -> Self {
        if fail_on_fault && !self.warnings.is_empty() {
            self.outcome = Outcome::Error;
        }
        self
    }

    /// Prints the report, as JSON or for a person. Of the last one of several runs (`is_last`), a person is told what is of
    /// this run alone.
    pub(super) fn print(&self, json: bool, is_last: bool, out: &mut dyn Write) -> anyhow::Result<()> {
        if json {
            serde_json::to_writer_pretty(&mut *out, self).context("cannot write the report")?;
            writeln!(out)?;
            return Ok(());
        }
        self.human(is_last, out)
    }

    fn human(&self, is_last: bool, out: &mut dyn Write) -> anyhow::Result<()> {
        let outcome = match self.outcome {
            Outcome::End => "end",
            Outcome::Error => "error",
        };
        let of_last = if is_last { " of the last run" } else { "" };
        let speed = self.time_s / self.wall_s.max(1e-9);
        writeln!(out, "outcome  {outcome}")?;
        let (time, wall) = (format::elapsed(self.time_s), format::elapsed(self.wall_s));
        let speed = format::number((speed * 10.0).round() / 10.0);
        writeln!(out, "time     {time} in {wall} (× {speed}){of_last}")?;
        writeln!(out, "hash     {}{of_last}", self.hash)?;
        if let Some(log) = &self.log {
            let lost = format!("{}, {} messages known", format::bytes(log.lost.bytes), log.lost.messages);
            writeln!(out, "log      damaged; lost {lost}")?;
            for problem in &log.problems {
                writeln!(out, "         {}", plain(problem))?;
            }
        }
        if let Some(replay) = &self.replay {
            writeln!(out, "replay   {}", replay.line())?;
        }
        writeln!(out)?;
        if !self.runs.is_empty() {
            human_runs(&self.runs, out)?;
        }
        if is_last {
            writeln!(out, "processes{of_last}")?;
        }
        self.human_processes(out)?;
        for (name, error) in self.processes.iter().filter_map(|it| Some((&it.name, it.error.as_ref()?))) {
            writeln!(out, "error: {name} is in ERROR: {}", plain(error))?;
        }
        for warning in &self.warnings {
            writeln!(out, "warning: {warning}")?;
        }
        writeln!(out)?;
        if is_last {
            writeln!(out, "buffers{of_last}")?;
        }
        self.human_buffers(out)
    }

    fn human_processes(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let mut columns = vec![
            ("process", Align::Left),
            ("state", Align::Left),
            ("cycles", Align::Right),
            ("mean", Align::Right),
            ("max", Align::Right),
            ("overruns", Align::Right),
        ];
        let is_live = self.processes.iter().any(|process| process.live.is_some());
        if is_live {
            columns.extend([
                ("late p99", Align::Right),
                ("wake p99", Align::Right),
                ("lock p99", Align::Right),
                ("missed", Align::Right),
                ("by lock", Align::Right),
            ]);
        }
        columns.extend([("faults", Align::Right), ("last fault", Align::Left)]);
        let mut table = Table::new(&columns);
        for process in &self.processes {
            let mut row = vec![
                process.name.clone(),
                process.state.to_owned(),
                process.cycles.to_string(),
                format!("{:.0} µs", process.mean_us),
                format!("{:.0} µs", process.max_us),
                process.overruns.to_string(),
            ];
            if is_live {
                row.extend(process.live.map_or_else(
                    || ["–"; 5].map(str::to_owned),
                    |live| {
                        let ms = |value: f64| format!("{value:.2} ms");
                        let late = [live.start_late_p99_ms, live.wake_late_p99_ms, live.lock_wait_p99_ms];
                        let [start, wake, lock] = late.map(ms);
                        [start, wake, lock, live.missed.to_string(), live.missed_by_lock.to_string()]
                    },
                ));
            }
            row.extend([process.faults.to_string(), process.last_fault.clone()]);
            table.row(row);
        }
        table.write(out)?;
        Ok(())
    }

    fn human_buffers(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let mut table = Table::new(&[
            ("buffer", Align::Left),
            ("schema", Align::Left),
            ("messages", Align::Right),
            ("size", Align::Right),
            ("hash", Align::Left),
        ]);
        for buffer in self.buffers.iter().filter(|buffer| buffer.messages > 0) {
            table.row([
                buffer.name.clone(),
                buffer.schema.clone(),
                buffer.messages.to_string(),
                format::bytes(buffer.bytes),
                buffer.hash.clone(),
            ]);
        }
        table.write(out)?;
        Ok(())
    }
}

fn human_runs(runs: &[RunReport], out: &mut dyn Write) -> anyhow::Result<()> {
    let mut table = Table::new(&[
        ("seed", Align::Right),
        ("course", Align::Left),
        ("time", Align::Right),
        ("distance", Align::Right),
        ("remaining", Align::Right),
        ("collisions", Align::Right),
        ("bumper hits", Align::Right),
        ("slip", Align::Right),
    ]);
    for run in runs {
        table.row([
            run.seed.to_string(),
            run.outcome.to_owned(),
            format!("{:.1} s", run.time_s),
            format!("{:.1} m", run.distance_m),
            format!("{:.1} m", run.remaining_m),
            run.collisions.to_string(),
            run.bumper_hits.to_string(),
            format!("{:.1} s", run.slip_s),
        ]);
    }
    table.write(out)?;
    writeln!(out)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_without_a_fault_that_wrote_nothing_is_told_with_its_last_status() {
        let process = |faults: u64, last_fault: &str| ProcessSummary {
            name: "wm1".to_owned(),
            state: ProcessState::Exec,
            state_text: "waits for the vehicle's pose".to_owned(),
            cycles: 202,
            mean_us: 1.0,
            max_us: 1.0,
            overruns: 0,
            faults,
            last_fault: last_fault.to_owned(),
            written: Some(0),
            refused_input: None,
        };
        let told = warning(&process(0, "")).unwrap();
        assert!(told.ends_with("with 0 faults; its status: waits for the vehicle's pose"), "{told}");
        let told = warning(&process(3, "no calibration")).unwrap();
        assert!(told.ends_with("with 3 faults; the last one: no calibration"), "{told}");
    }
}
