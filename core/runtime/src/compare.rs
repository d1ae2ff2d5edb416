//! Compares the messages of two runs, and finds the first difference.
//!
//! Messages of one buffer correspond by their sequence. Of several differences at the same time, the one that was
//! written first counts. Measured times are excluded, because they differ from run to run. Messages are compared time
//! by time, and none is kept longer than that.

use crate::stack::names;
use rcs_log::{Cursor, CursorOptions, Log, LogError, LogMessage, Reassembly};
use rcs_msg::{AnyMessage, FieldPath, Stamp, Value, rcs};
use std::collections::{BTreeMap, VecDeque};
use std::iter::Peekable;

/// The first message in which two runs differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Time at which it became visible, in seconds since the start of the first run.
    pub time_s: f64,
    /// Its buffer.
    pub buffer: String,
    /// Its sequence in the buffer.
    pub sequence: u64,
    /// Path of the field; `log_time`, `acq_time` or `schema` if the value is the same; `message` if only one run has
    /// it.
    pub field: String,
    /// Both values, or the cycle whose inputs differ, as text.
    pub detail: String,
}

/// A message with everything that is compared.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub(crate) sequence: u32,
    pub(crate) log_time: Stamp,
    pub(crate) acq_time: Stamp,
    pub(crate) message: AnyMessage,
}

impl Entry {
    /// A recorded message, reassembled if it was stored as a delta; `None` if that fails.
    pub(crate) fn of(stored: &LogMessage, log: &Log, reassembly: &mut Reassembly) -> Option<(String, Self)> {
        let (topic, message) = if reassembly.takes(stored.topic) {
            let whole = reassembly.take(stored)?;
            (log.info().topic(whole.topic)?, whole.message)
        } else {
            let topic = log.info().topic(stored.topic)?;
            (topic, AnyMessage::encoded(topic.schema.clone(), stored.data.clone()))
        };
        let entry = Self {
            sequence: stored.sequence,
            log_time: stored.log_time,
            acq_time: stored.publish_time,
            message,
        };
        Some((topic.name.clone(), entry))
    }
}

/// Which run a message belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    First,
    Second,
}

/// The messages of one buffer at one time, each with its position among all messages.
#[derive(Default)]
struct Pair {
    first: VecDeque<(u64, Entry)>,
    second: VecDeque<(u64, Entry)>,
    /// Whether the first run may lack messages of this buffer, because it was recorded at a reduced rate or with drops.
    thinned: bool,
}

/// Pairs the messages of two runs.
pub(crate) struct Matcher {
    start: Stamp,
    buffers: BTreeMap<String, Pair>,
    order: u64,
}

impl Matcher {
    pub(crate) fn new(start: Stamp) -> Self {
        Self { start, buffers: BTreeMap::new(), order: 0 }
    }

    /// Allows the first run to lack messages of a buffer.
    pub(crate) fn thin(&mut self, buffer: &str) {
        self.buffers.entry(buffer.to_owned()).or_default().thinned = true;
    }

    pub(crate) fn put(&mut self, side: Side, buffer: &str, entry: Entry) {
        self.order += 1;
        if !self.buffers.contains_key(buffer) {
            self.buffers.insert(buffer.to_owned(), Pair::default());
        }
        if let Some(pair) = self.buffers.get_mut(buffer) {
            let queue = if side == Side::First { &mut pair.first } else { &mut pair.second };
            queue.push_back((self.order, entry));
        }
    }

    /// Forgets what was added since the last call.
    pub(crate) fn forget(&mut self) {
        for pair in self.buffers.values_mut() {
            pair.first.clear();
            pair.second.clear();
        }
    }

    /// Compares what was added since the last call. To be called when both runs have reached the same time.
    pub(crate) fn settle(&mut self) -> Option<Difference> {
        let mut found: Option<(Stamp, u64, Difference)> = None;
        for (buffer, pair) in &mut self.buffers {
            let Some((order, entry, field, detail)) = pair.settle() else { continue };
            if found.as_ref().is_some_and(|(time, first, _)| (*time, *first) <= (entry.log_time, order)) {
                continue;
            }
            let difference = Difference {
                time_s: entry.log_time.seconds_since(self.start),
                buffer: buffer.clone(),
                sequence: u64::from(entry.sequence),
                field,
                detail,
            };
            found = Some((entry.log_time, order, difference));
        }
        found.map(|(_, _, difference)| difference)
    }
}

impl Pair {
    /// Returns the first difference and empties both sides.
    fn settle(&mut self) -> Option<(u64, Entry, String, String)> {
        let only = |side: &str| ("message".to_owned(), format!("only the {side} has it"));
        let found = loop {
            match (self.first.front(), self.second.front()) {
                (Some((_, a)), Some((order, b))) if a.sequence == b.sequence => {
                    if let Some((field, detail)) = difference(a, b) {
                        let order = self.first.front().map_or(*order, |(order, _)| *order);
                        break (order, a.clone(), field, detail);
                    }
                    self.first.pop_front();
                    self.second.pop_front();
                }
                (first, Some((order, b))) if first.is_none_or(|(_, a)| b.sequence < a.sequence) => {
                    if !self.thinned {
                        let (field, detail) = only("second");
                        break (*order, b.clone(), field, detail);
                    }
                    self.second.pop_front();
                }
                (Some((order, a)), _) => {
                    let (field, detail) = only("first");
                    break (*order, a.clone(), field, detail);
                }
                // Both are empty: a message on the second side alone was handled above.
                (None, _) => return None,
            }
        };
        self.first.clear();
        self.second.clear();
        Some(found)
    }
}

/// The difference between two corresponding messages.
fn difference(a: &Entry, b: &Entry) -> Option<(String, String)> {
    let said = |field: &str, a: &dyn std::fmt::Display, b: &dyn std::fmt::Display| {
        Some((field.to_owned(), format!("{a} in the first, {b} in the second")))
    };
    if a.log_time != b.log_time {
        return said("log_time", &a.log_time, &b.log_time);
    }
    let (one, other) = (a.message.schema(), b.message.schema());
    if one.name() != other.name() {
        return said("schema", &one.name(), &other.name());
    }
    if a.message.bytes() != b.message.bytes() {
        let (field, detail) = differing_field(&a.message, &b.message);
        let cycle = a.message.to::<rcs::CycleRecord>().filter(|_| field.starts_with(".input_sequence"));
        let cycle =
            cycle.map(|record| format!("cycle {} of {} has other inputs: ", record.cycle, record.process));
        return Some((field, cycle.unwrap_or_default() + &detail));
    }
    if a.acq_time != b.acq_time {
        return said("acq_time", &a.acq_time, &b.acq_time);
    }
    None
}

/// The first field in which two messages of one type differ.
fn differing_field(a: &AnyMessage, b: &AnyMessage) -> (String, String) {
    let (one, other) = match (a.value(), b.value()) {
        (Ok(one), Ok(other)) => (one, other),
        (Err(error), _) => return (String::new(), format!("the first does not decode: {error}")),
        (_, Err(error)) => return (String::new(), format!("the second does not decode: {error}")),
    };
    let (mut ones, mut others) = (one.leaves(), other.leaves());
    loop {
        match (ones.next(), others.next()) {
            (Some((path, a)), Some((other, b))) if path == other => {
                if let Some((path, detail)) = differing_leaf(&path, a, b) {
                    return (path.to_string(), detail);
                }
            }
            (Some((path, _)), _) => return (path.to_string(), "only the first has it".to_owned()),
            (None, Some((path, _))) => return (path.to_string(), "only the second has it".to_owned()),
            // The bytes differ in something that no field shows: unknown fields, or the order of fields.
            (None, None) => return (String::new(), "the same fields, other bytes".to_owned()),
        }
    }
}

fn differing_leaf(path: &FieldPath, a: &Value, b: &Value) -> Option<(FieldPath, String)> {
    if let (Some(count), Some(other)) = (a.len(), b.len())
        && !matches!(a, Value::Text(_))
    {
        if count != other {
            return Some((path.length(), format!("{count} in the first, {other} in the second")));
        }
        let item = |index: usize| Some((a.item(index)?, b.item(index)?));
        let at = (0..count).find(|&index| item(index).is_some_and(|(a, b)| !same(&a, &b)))?;
        let (a, b) = item(at)?;
        return Some((path.index(at), format!("{} in the first, {} in the second", show(&a), show(&b))));
    }
    (!same(a, b)).then(|| (path.clone(), format!("{} in the first, {} in the second", show(a), show(b))))
}

fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        // Bits are compared: NaN equals NaN, and -0 differs from 0.
        (Value::Float(a), Value::Float(b)) => a.to_bits() == b.to_bits(),
        (a, b) => a == b,
    }
}

fn show(value: &Value) -> String {
    match value {
        Value::Null => "nothing".to_owned(),
        Value::Bool(v) => v.to_string(),
        Value::Int(v) => v.to_string(),
        Value::Uint(v) => v.to_string(),
        Value::Float(v) => v.to_string(),
        Value::Enum { number, name } if name.is_empty() => number.to_string(),
        Value::Enum { name, .. } => name.clone(),
        Value::Text(text) if text.chars().count() <= 60 => format!("{text:?}"),
        other => other.kind().to_owned(),
    }
}

/// Whether messages of a topic are measured times, which are not compared.
pub(crate) fn is_measured(topic: &str) -> bool {
    topic == names::TIMING
}

/// The first message in which two recordings differ; `None` if they agree. Reads both in one pass, in parallel.
pub fn diff(a: &Log, b: &Log) -> Result<Option<Difference>, LogError> {
    let cursor = |log: &Log| log.cursor(CursorOptions::default()).peekable();
    let (mut ones, mut others) = (cursor(a), cursor(b));
    let mut reassembly = [a, b].map(Reassembly::new);
    let mut matcher = Matcher::new(a.info().start);
    loop {
        let (one, other) = (next_time(&mut ones)?, next_time(&mut others)?);
        let Some(time) = one.into_iter().chain(other).min() else { return Ok(None) };
        put_until(&mut matcher, Side::First, a, &mut reassembly[0], &mut ones, time)?;
        put_until(&mut matcher, Side::Second, b, &mut reassembly[1], &mut others, time)?;
        if let Some(difference) = matcher.settle() {
            return Ok(Some(difference));
        }
    }
}

/// Time of the next message.
pub(crate) fn next_time(cursor: &mut Peekable<Cursor>) -> Result<Option<Stamp>, LogError> {
    match cursor.peek() {
        None => Ok(None),
        Some(Ok(message)) => Ok(Some(message.log_time)),
        Some(Err(_)) => cursor.next().transpose().map(|_| None),
    }
}

/// Adds every message up to and including a time, except measured times.
pub(crate) fn put_until(
    matcher: &mut Matcher,
    side: Side,
    log: &Log,
    reassembly: &mut Reassembly,
    cursor: &mut Peekable<Cursor>,
    time: Stamp,
) -> Result<(), LogError> {
    while next_time(cursor)?.is_some_and(|next| next <= time) {
        let Some(message) = cursor.next().transpose()? else { return Ok(()) };
        let entry = Entry::of(&message, log, reassembly);
        if let Some((topic, entry)) = entry.filter(|(topic, _)| !is_measured(topic)) {
            matcher.put(side, &topic, entry);
        }
    }
    Ok(())
}
