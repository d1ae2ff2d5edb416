//! `ocu latency`: how old messages are when they become visible.
//!
//! The age of a message is its `log_time` less the time at which what it tells of was sensed: its `publish_time` where this
//! program has recorded it, else its own stamp, else its `publish_time`, unless that repeats the `log_time`. Where there is
//! none of them, or the stamps are after the log time or long before it, as those of another clock are, a buffer has no age,
//! and the reason is said. A hop is from a process's input to its output: messages belong together that tell of the same
//! moment. Where one of the two buffers has no age, there is none, because their stamps are of two clocks.
//!
//! A buffer with several writers does not say which of them wrote a message. Each process publishes what it wrote, and
//! then its status, at one time: the writer is the one whose status comes next.

use crate::cli::LatencyArgs;
use crate::table::{Align, Table};
use crate::{Ended, stacks};
use anyhow::Context as _;
use rcs_log::{CursorOptions, Log, LogMessage, LogTopic, TopicId};
use rcs_msg::channel::WRITER;
use rcs_msg::{AnyMessage, Stamp, header_stamp, rcs, schema_of};
use rcs_runtime::states_acquisition;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;

/// Moments of one buffer that are remembered to find where an output came from.
const MOMENTS: usize = 20_000;
/// Least age that the median of a buffer can be, ms: a second in the future.
const LEAST_MS: f64 = -1e3;
/// Greatest age that the median of a buffer can be, ms: an hour; a year where there is a single message, which may be from
/// when the robot was started, such as a map.
const MOST_MS: f64 = 3.6e6;
const MOST_OF_ONE_MS: f64 = 365.0 * 24.0 * 3.6e6;

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

/// Durations of so many messages; `None` where they are unknown, for a reason.
#[derive(Debug, Serialize)]
struct Spread {
    messages: usize,
    p50_ms: Option<f64>,
    p95_ms: Option<f64>,
    max_ms: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<&'static str>,
}

impl Spread {
    /// Of the durations of those of so many messages that have one, in nanoseconds.
    fn of_durations(messages: usize, durations_ns: &[i64]) -> Self {
        let mut sorted = durations_ns.to_vec();
        sorted.sort_unstable();
        let at = |percent: usize| {
            let index = (sorted.len() * percent).div_ceil(100).saturating_sub(1);
            sorted.get(index).map(|&ns| ns as f64 * 1e-6)
        };
        Self { messages, p50_ms: at(50), p95_ms: at(95), max_ms: at(100), reason: None }
    }

    /// Of the ages of those of so many messages that have a stamp, in nanoseconds; unknown where they cannot be ages.
    fn of_ages(messages: usize, ages_ns: &[i64]) -> Self {
        let spread = Self::of_durations(messages, ages_ns);
        let most_ms = if ages_ns.len() > 1 { MOST_MS } else { MOST_OF_ONE_MS };
        let reason = match spread.p50_ms {
            None => "no stamp",
            Some(median_ms) if median_ms < LEAST_MS => "stamps after the log time",
            Some(median_ms) if median_ms > most_ms => "stamps more than an hour before the log time",
            Some(_) => return spread,
        };
        Self { messages, p50_ms: None, p95_ms: None, max_ms: None, reason: Some(reason) }
    }
}

/// Prints the ages of a recording's messages.
pub fn latency(args: &LatencyArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let log = Log::open_parts(&crate::parts::of(&args.log)?)?;
    stacks::check_full(&log, &args.log)?;
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
    acq_ns: Option<u64>,
}

/// Messages of one buffer by one writer.
#[derive(Default)]
struct Counted {
    messages: usize,
    /// The ages of those of which it is known.
    ages_ns: Vec<i64>,
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
    buffers: BTreeMap<(String, String), Counted>,
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
        let acq_ns = acquired(topic, message).map(|stamp| stamp.0);
        if self.waiting.first().is_some_and(|waiting| waiting.log_ns != log_ns) {
            self.settle(None);
        }
        if let Some(acq_ns) = acq_ns {
            let seen = self.seen.entry(buffer.clone()).or_default();
            seen.entry(acq_ns).or_insert(log_ns);
            if seen.len() > MOMENTS {
                seen.pop_first();
            }
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

    fn count(&mut self, buffer: String, writer: String, log_ns: u64, acq_ns: Option<u64>) {
        let since = |earlier_ns: u64| duration_ns(earlier_ns, log_ns);
        if let (Some(info), Some(acq_ns)) = (self.processes.get(&writer), acq_ns) {
            for input in info.inputs.iter().filter(|input| input.buffer != buffer) {
                let shown = self.seen.get(&input.buffer).and_then(|seen| seen.get(&acq_ns));
                let Some(&shown_ns) = shown.filter(|&&shown_ns| shown_ns <= log_ns) else { continue };
                let hop = (buffer.clone(), writer.clone(), input.buffer.clone());
                self.hops.entry(hop).or_default().push(since(shown_ns));
            }
        }
        let counted = self.buffers.entry((buffer, writer)).or_default();
        counted.messages += 1;
        counted.ages_ns.extend(acq_ns.map(since));
    }

    fn report(&self) -> Report {
        let age = |counted: &Counted| Spread::of_ages(counted.messages, &counted.ages_ns);
        let ageless = self.buffers.iter().filter(|(_, counted)| age(counted).reason.is_some());
        let ageless: BTreeSet<&str> = ageless.map(|((buffer, _), _)| buffer.as_str()).collect();
        // Stamps of two clocks are equal by chance only.
        let have_one_clock = |a: &str, b: &str| ageless.contains(a) == ageless.contains(b);
        let of_hop = |took: &Vec<i64>| Spread::of_durations(took.len(), took);
        let hops = |key: &(String, String)| {
            let of = self.hops.iter().filter(|((buffer, writer, from), _)| {
                (buffer, writer) == (&key.0, &key.1) && have_one_clock(from, buffer)
            });
            of.map(|((_, _, from), took)| HopReport { from: from.clone(), took: of_hop(took) }).collect()
        };
        let buffer = |(key, counted): (&(String, String), &Counted)| BufferReport {
            buffer: key.0.clone(),
            writer: key.1.clone(),
            age: age(counted),
            hops: hops(key),
        };
        Report { buffers: self.buffers.iter().map(buffer).collect() }
    }
}

/// When what a message tells was sensed, if anything says so. A stamp of 0 is none.
fn acquired(topic: &LogTopic, message: &LogMessage) -> Option<Stamp> {
    if states_acquisition(&topic.metadata) {
        return Some(message.publish_time);
    }
    let stored = AnyMessage::encoded(topic.schema.clone(), message.data.clone());
    let published = Some(message.publish_time).filter(|time| *time != message.log_time);
    [header_stamp(&stored), published].into_iter().flatten().find(|stamp| stamp.0 != 0)
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
        ("note", Align::Left),
    ]);
    let cells = |spread: &Spread| {
        let ms = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.1} ms"));
        let [p50, p95, max] = [spread.p50_ms, spread.p95_ms, spread.max_ms].map(ms);
        [spread.messages.to_string(), p50, p95, max, spread.reason.unwrap_or_default().to_owned()]
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
    use rcs_msg::foxglove::{RawImage, Vector2};
    use rcs_testkit::logs::hand_made;
    use serde_json::json;

    #[test]
    fn an_age_that_no_stamp_near_the_log_time_tells_is_null_and_has_a_reason() {
        const S: u64 = 1_000_000_000;
        let image = |stamp_ns: u64| {
            AnyMessage::new(RawImage { timestamp: Some(Stamp(stamp_ns).to_proto()), ..RawImage::default() })
        };
        let now = Stamp(1_700_000_000 * S);
        let messages = [
            ("/ahead", image(now.0 + 2 * S)),
            ("/bare", AnyMessage::new(Vector2::default())),
            ("/boot", image(5 * S)),
            ("/late", image(now.0 - 7_200 * S)),
            ("/late", image(now.0 - 7_200 * S)),
            // Sent when the robot was started.
            ("/map", image(now.0 - 7_200 * S)),
            ("/own", image(now.0 - S / 8)),
            ("/zero", image(0)),
        ];
        let images = ["/ahead", "/boot", "/late", "/map", "/own", "/zero"];
        let images = images.map(|topic| (topic, schema_of::<RawImage>()));
        let topics = [&images[..], &[("/bare", schema_of::<Vector2>())]].concat();
        let log = hand_made(&topics, messages.iter().map(|(topic, message)| (now, *topic, message)));
        let report = Ages::of(&log).unwrap().report();
        let of = |buffer: &BufferReport| serde_json::to_value(&buffer.age).unwrap();
        let ages: Vec<_> = report.buffers.iter().map(of).collect();
        let unknown = |messages: usize, reason: &str| json!({ "messages": messages, "p50_ms": null, "p95_ms": null, "max_ms": null, "reason": reason });
        let known = |ms: f64| json!({ "messages": 1, "p50_ms": ms, "p95_ms": ms, "max_ms": ms });
        let before = "stamps more than an hour before the log time";
        let expect = [
            unknown(1, "stamps after the log time"),
            unknown(1, "no stamp"),
            unknown(1, before),
            unknown(2, before),
            known(7_200_000.0),
            known(125.0),
            unknown(1, "no stamp"),
        ];
        assert_eq!(ages, expect);
        // A process may hold what it was told for hours.
        assert_eq!(Spread::of_durations(2, &[7_200_000_000_000; 2]).p50_ms, Some(7_200_000.0));
        let mut out = Vec::new();
        human(&report, &mut out).unwrap();
        let out = String::from_utf8(out).unwrap();
        let line = |buffer: &str| {
            let line = out.lines().find(|line| line.starts_with(buffer)).unwrap();
            line.split_whitespace().collect::<Vec<_>>().join(" ")
        };
        assert_eq!(line("/boot"), "/boot 1 – – – stamps more than an hour before the log time");
        assert_eq!(line("/own"), "/own 1 125.0 ms 125.0 ms 125.0 ms");
    }

    #[test]
    fn there_is_no_hop_between_buffers_whose_stamps_are_of_two_clocks() {
        const S: u64 = 1_000_000_000;
        let port = |buffer: &str| rcs::PortInfo { buffer: buffer.to_owned(), ..rcs::PortInfo::default() };
        let inputs = ["/ahead", "/in"].map(port).into();
        let reader = rcs::ProcessInfo { name: "reader".to_owned(), inputs, ..rcs::ProcessInfo::default() };
        let mut ages = Ages::default();
        ages.processes.insert(reader.name.clone(), reader);
        for log_ns in (10..20).map(|second| second * S) {
            for (input, stamp_ns) in [("/ahead", log_ns + 3 * S), ("/in", log_ns)] {
                ages.seen.entry(input.to_owned()).or_default().insert(stamp_ns, log_ns);
                ages.count(input.to_owned(), String::new(), log_ns, Some(stamp_ns));
            }
            ages.count("/out".to_owned(), "reader".to_owned(), log_ns, Some(log_ns));
        }
        let report = ages.report();
        let out = report.buffers.iter().find(|buffer| buffer.buffer == "/out").unwrap();
        let from: Vec<&str> = out.hops.iter().map(|hop| hop.from.as_str()).collect();
        assert_eq!(from, ["/in"]);
    }

    #[test]
    fn a_duration_between_any_two_stamps_is_the_nearest_that_fits() {
        assert_eq!([duration_ns(3, 8), duration_ns(8, 3)], [5, -5]);
        // The stamps of one recording may be on both sides of the largest signed number.
        assert_eq!(duration_ns(i64::MAX as u64 - 1, i64::MAX as u64 + 2), 3);
        assert_eq!([duration_ns(0, u64::MAX), duration_ns(u64::MAX, 0)], [i64::MAX, i64::MIN]);
    }
}
