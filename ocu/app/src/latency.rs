//! `ocu latency`: how old messages are when they become visible.
//!
//! The age of a message is its `log_time` less the time at which what it tells of was sensed: its `publish_time` where this
//! program has recorded it, else its own stamp, if it has one. A hop is from a process's input to its output: messages
//! belong together that tell of the same moment.
//!
//! A buffer with several writers does not say which of them wrote a message. Each process publishes what it wrote, and
//! then its status, at one time: the writer is the one whose status comes next.

use crate::Ended;
use crate::cli::LatencyArgs;
use crate::table::{Align, Table};
use anyhow::Context as _;
use rcs_log::{CursorOptions, Log, LogMessage, LogTopic, TopicId};
use rcs_msg::channel::WRITER;
use rcs_msg::{AnyMessage, Stamp, rcs, schema_of};
use rcs_runtime::{acquisition_time, states_acquisition};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;

/// Moments of one buffer that are remembered to find where an output came from.
const MOMENTS: usize = 20_000;

/// `ocu latency --json`.
#[derive(Debug, Serialize)]
struct Report {
    buffers: Vec<BufferReport>,
}

/// A buffer and one of its writers.
#[derive(Debug, Serialize)]
struct BufferReport {
    buffer: String,
    writer: String,
    #[serde(flatten)]
    age: Spread,
    /// From the inputs of the writer to this buffer.
    hops: Vec<HopReport>,
}

#[derive(Debug, Serialize)]
struct HopReport {
    from: String,
    #[serde(flatten)]
    took: Spread,
}

/// Durations of so many messages.
#[derive(Debug, Serialize)]
struct Spread {
    messages: usize,
    p50_ms: f64,
    p95_ms: f64,
    max_ms: f64,
}

impl Spread {
    /// Of durations in nanoseconds, one at least.
    fn new(durations_ns: &[i64]) -> Self {
        let mut sorted = durations_ns.to_vec();
        sorted.sort_unstable();
        let at = |percent: usize| {
            let index = (sorted.len() * percent).div_ceil(100).saturating_sub(1);
            sorted.get(index).map_or(0.0, |&ns| ns as f64 * 1e-6)
        };
        Self { messages: sorted.len(), p50_ms: at(50), p95_ms: at(95), max_ms: at(100) }
    }
}

/// Prints the ages of a recording's messages.
pub fn latency(args: &LatencyArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let log = Log::open_parts(&crate::parts::of(&args.log)?)?;
    let report = Ages::of(&log)?.report();
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &report).context("cannot write the report")?;
        writeln!(out)?;
    } else {
        human(&report, out)?;
    }
    Ok(Ended::after(Some(&log)))
}

/// A message whose writer is not known yet.
struct Waiting {
    buffer: String,
    log_ns: u64,
    acq_ns: u64,
}

/// What is known while a recording is read.
#[derive(Default)]
struct Ages {
    processes: BTreeMap<String, rcs::ProcessInfo>,
    /// Processes by the buffer of their status.
    statuses: BTreeMap<String, String>,
    /// When a buffer first showed what was sensed at a moment.
    seen: BTreeMap<String, BTreeMap<u64, u64>>,
    waiting: Vec<Waiting>,
    /// By buffer and writer.
    buffers: BTreeMap<(String, String), Vec<i64>>,
    /// By buffer, writer and input.
    hops: BTreeMap<(String, String, String), Vec<i64>>,
}

impl Ages {
    fn of(log: &Log) -> anyhow::Result<Self> {
        let mut ages = Self::default();
        ages.read_processes(log)?;
        let topics: BTreeMap<TopicId, &LogTopic> = log.info().topics.iter().map(|t| (t.id, t)).collect();
        for message in log.cursor(CursorOptions::default()) {
            let message = message?;
            let Some(topic) = topics.get(&message.topic) else { continue };
            ages.take(topic, &message);
        }
        ages.settle(None);
        Ok(ages)
    }

    /// The processes of the run that was recorded; none where it is another program's recording.
    fn read_processes(&mut self, log: &Log) -> anyhow::Result<()> {
        let schema = schema_of::<rcs::ProcessInfo>();
        let is_info = |topic: &&LogTopic| topic.schema.name() == schema.name();
        let topics: Vec<_> = log.info().topics.iter().filter(is_info).map(|topic| topic.id).collect();
        if topics.is_empty() {
            return Ok(());
        }
        for message in log.cursor(CursorOptions { topics: Some(topics), ..CursorOptions::default() }) {
            let info = AnyMessage::encoded(schema.clone(), message?.data).to::<rcs::ProcessInfo>();
            let info = info.context("a message of /runtime/processes cannot be read")?;
            self.statuses.insert(info.status_buffer.clone(), info.name.clone());
            self.processes.insert(info.name.clone(), info);
        }
        Ok(())
    }

    fn take(&mut self, topic: &LogTopic, message: &LogMessage) {
        let log_ns = message.log_time.0;
        if let Some(process) = self.statuses.get(&topic.name).cloned() {
            self.settle(Some((&process, log_ns)));
            return;
        }
        // A map is recorded as key frames and, beside them, deltas: both are messages of its buffer.
        let buffer = topic.metadata.get("rcs.delta_of").unwrap_or(&topic.name).clone();
        if buffer.starts_with("/runtime/") || self.is_control(&buffer) {
            return;
        }
        let acq_ns = acquired(topic, message).0;
        if self.waiting.first().is_some_and(|waiting| waiting.log_ns != log_ns) {
            self.settle(None);
        }
        let seen = self.seen.entry(buffer.clone()).or_default();
        seen.entry(acq_ns).or_insert(log_ns);
        if seen.len() > MOMENTS {
            seen.pop_first();
        }
        let writers = self.writers(&buffer);
        if writers.len() > 1 {
            self.waiting.push(Waiting { buffer, log_ns, acq_ns });
        } else {
            let named = topic.metadata.get(WRITER).cloned().unwrap_or_default();
            let writer = writers.into_iter().next().map_or(named, str::to_owned);
            self.count(buffer, writer, log_ns, acq_ns);
        }
    }

    /// Whether a buffer holds commands or parameters.
    fn is_control(&self, buffer: &str) -> bool {
        self.processes.values().any(|info| info.command_buffer == buffer || info.params_buffer == buffer)
    }

    /// Processes that write a buffer.
    fn writers(&self, buffer: &str) -> BTreeSet<&str> {
        let writes = |info: &&rcs::ProcessInfo| info.outputs.iter().any(|port| port.buffer == buffer);
        self.processes.values().filter(writes).map(|info| info.name.as_str()).collect()
    }

    /// A process has published what it wrote at this time; with `None`, time has gone on.
    fn settle(&mut self, published: Option<(&str, u64)>) {
        for waiting in std::mem::take(&mut self.waiting) {
            let Waiting { buffer, log_ns, acq_ns } = waiting;
            let writers = self.writers(&buffer);
            match published {
                None => {
                    let one_of = writers.into_iter().collect::<Vec<_>>().join(" or ");
                    self.count(buffer, one_of, log_ns, acq_ns);
                }
                Some((process, time_ns)) if time_ns == log_ns && writers.contains(process) => {
                    self.count(buffer, process.to_owned(), log_ns, acq_ns);
                }
                Some(_) => self.waiting.push(Waiting { buffer, log_ns, acq_ns }),
            }
        }
    }

    fn count(&mut self, buffer: String, writer: String, log_ns: u64, acq_ns: u64) {
        let since = |earlier_ns: u64| duration_ns(earlier_ns, log_ns);
        if let Some(info) = self.processes.get(&writer) {
            for input in info.inputs.iter().filter(|input| input.buffer != buffer) {
                let shown = self.seen.get(&input.buffer).and_then(|seen| seen.get(&acq_ns));
                let Some(&shown_ns) = shown.filter(|&&shown_ns| shown_ns <= log_ns) else { continue };
                let hop = (buffer.clone(), writer.clone(), input.buffer.clone());
                self.hops.entry(hop).or_default().push(since(shown_ns));
            }
        }
        self.buffers.entry((buffer, writer)).or_default().push(since(acq_ns));
    }

    fn report(&self) -> Report {
        let hops = |key: &(String, String)| {
            let of = self.hops.iter().filter(|((buffer, writer, _), _)| (buffer, writer) == (&key.0, &key.1));
            of.map(|((_, _, from), took)| HopReport { from: from.clone(), took: Spread::new(took) }).collect()
        };
        let buffer = |(key, ages): (&(String, String), &Vec<i64>)| BufferReport {
            buffer: key.0.clone(),
            writer: key.1.clone(),
            age: Spread::new(ages),
            hops: hops(key),
        };
        Report { buffers: self.buffers.iter().map(buffer).collect() }
    }
}

/// When what a message tells was sensed.
fn acquired(topic: &LogTopic, message: &LogMessage) -> Stamp {
    if states_acquisition(&topic.metadata) {
        return message.publish_time;
    }
    let stored = AnyMessage::encoded(topic.schema.clone(), message.data.clone());
    acquisition_time(&stored, message.publish_time, message.log_time)
}

/// Time from one stamp to another; the nearest one that fits where they are too far apart.
fn duration_ns(from_ns: u64, to_ns: u64) -> i64 {
    (i128::from(to_ns) - i128::from(from_ns)).clamp(i64::MIN.into(), i64::MAX.into()) as i64
}

fn human(report: &Report, out: &mut dyn Write) -> anyhow::Result<()> {
    let mut table = Table::new(&[
        ("buffer", Align::Left),
        ("writer", Align::Left),
        ("messages", Align::Right),
        ("p50", Align::Right),
        ("p95", Align::Right),
        ("max", Align::Right),
    ]);
    let cells = |spread: &Spread| {
        let ms = |value: f64| format!("{value:.1} ms");
        [spread.messages.to_string(), ms(spread.p50_ms), ms(spread.p95_ms), ms(spread.max_ms)]
    };
    for buffer in &report.buffers {
        let named = [buffer.buffer.clone(), buffer.writer.clone()];
        table.row(named.into_iter().chain(cells(&buffer.age)));
        for hop in &buffer.hops {
            let named = [format!("  from {}", hop.from), String::new()];
            table.row(named.into_iter().chain(cells(&hop.took)));
        }
    }
    table.write(out)?;
    writeln!(
        out,
        "\nAge: from when it was sensed until it became visible. From: since that input showed the same moment."
    )?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_between_any_two_stamps_is_the_nearest_that_fits() {
        assert_eq!([duration_ns(3, 8), duration_ns(8, 3)], [5, -5]);
        // The stamps of one recording may be on both sides of the largest signed number.
        assert_eq!(duration_ns(i64::MAX as u64 - 1, i64::MAX as u64 + 2), 3);
        assert_eq!([duration_ns(0, u64::MAX), duration_ns(u64::MAX, 0)], [i64::MAX, i64::MIN]);
    }
}
