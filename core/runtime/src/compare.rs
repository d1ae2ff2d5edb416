//! Compares the messages of two runs, and finds the first difference.
//!
//! Messages of one buffer correspond by their sequence. Of several differences at the same time, the one that was
//! written first counts. Measured times are excluded, because they differ from run to run. Messages are compared time
//! by time, and none is kept longer than that.

use crate::stack::names;
use rcs_log::{Cursor, Log, LogError, LogMessage, Reassembly};
use rcs_msg::{AnyMessage, FieldPath, Stamp, Value, rcs};
use std::collections::{BTreeMap, VecDeque};
use std::fmt::Display;
use std::iter::Peekable;

/// Most characters that are shown of a text.
const SHOWN: usize = 60;
/// How many of them are the equal ones before the difference.
const BEFORE: usize = 15;

/// The first message in which two runs differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Time at which it became visible.
    pub time: Stamp,
    /// The same, in seconds since the start of the first run, to the nanosecond.
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
    /// The value in the first run and in the second, as text; empty where a run has none. Of long texts, the part with
    /// the first difference.
    pub values: [String; 2],
}

/// A field that differs, with both values and what they mean.
struct Found {
    field: String,
    values: [String; 2],
    detail: String,
}

impl Found {
    fn of(field: impl Into<String>, values: [&dyn Display; 2]) -> Self {
        let values = values.map(ToString::to_string);
        let detail = format!("{} in the first, {} in the second", values[0], values[1]);
        Self { field: field.into(), values, detail }
    }

    /// Two texts of which at least one is too long to be shown completely: the parts with the first difference.
    fn of_long_texts(field: impl Into<String>, texts: [&str; 2]) -> Self {
        let pairs = texts[0].chars().zip(texts[1].chars());
        let equal = pairs.take_while(|(one, other)| one == other).count();
        let [one, other] = texts.map(|text| part(text, equal.saturating_sub(BEFORE)));
        let found = Self::of(field, [&one, &other]);
        Self { detail: format!("from character {} on, {}", equal + 1, found.detail), ..found }
    }

    /// What only one side has.
    fn only(side: Side, field: impl Into<String>, value: &str) -> Self {
        let (name, values) = match side {
            Side::First => ("first", [value.to_owned(), String::new()]),
            Side::Second => ("second", [String::new(), value.to_owned()]),
        };
        Self { field: field.into(), values, detail: format!("only the {name} has it") }
    }

    /// A difference without values.
    fn said(detail: impl Into<String>) -> Self {
        Self { field: String::new(), values: Default::default(), detail: detail.into() }
    }
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Side {
    First,
    Second,
}

/// The messages of one buffer at one time, each with its position among all messages.
#[derive(Default)]
struct Pair {
    first: VecDeque<(u64, Entry)>,
    second: VecDeque<(u64, Entry)>,
    /// Whether a run may lack messages of this buffer, because it was recorded at a reduced rate or with drops.
    thinned: [bool; 2],
    /// Whether a difference was found, after which the buffer is not compared.
    differs: bool,
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

    /// Allows a run to lack messages of a buffer.
    pub(crate) fn thin(&mut self, side: Side, buffer: &str) {
        self.buffers.entry(buffer.to_owned()).or_default().thinned[side as usize] = true;
    }

    pub(crate) fn put(&mut self, side: Side, buffer: &str, entry: Entry) {
        self.order += 1;
        if !self.buffers.contains_key(buffer) {
            self.buffers.insert(buffer.to_owned(), Pair::default());
        }
        if let Some(pair) = self.buffers.get_mut(buffer).filter(|pair| !pair.differs) {
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

    /// Compares what was added since the last call, and returns the first difference. To be called when both runs have
    /// reached the same time.
    pub(crate) fn settle(&mut self) -> Option<Difference> {
        self.settle_each().into_iter().next()
    }

    /// Compares what was added since the last call, and returns the first difference of each buffer, in the order in
    /// which they were written. A buffer with a difference is not compared any more.
    pub(crate) fn settle_each(&mut self) -> Vec<Difference> {
        let mut all: Vec<(u64, Difference)> = Vec::new();
        for (buffer, pair) in &mut self.buffers {
            let Some((order, entry, found)) = pair.settle() else { continue };
            pair.differs = true;
            let difference = Difference {
                time: entry.log_time,
                time_s: to_the_nanosecond(entry.log_time.seconds_since(self.start)),
                buffer: buffer.clone(),
                sequence: u64::from(entry.sequence),
                field: found.field,
                detail: found.detail,
                values: found.values,
            };
            all.push((order, difference));
        }
        all.sort_by_key(|(order, difference)| (difference.time, *order));
        all.into_iter().map(|(_, difference)| difference).collect()
    }
}

impl Pair {
    /// Returns the first difference and empties both sides.
    fn settle(&mut self) -> Option<(u64, Entry, Found)> {
        let found = loop {
            match (self.first.front(), self.second.front()) {
                (Some((order, a)), Some((_, b))) if a.sequence == b.sequence => {
                    if let Some(found) = difference(a, b) {
                        break (*order, a.clone(), found);
                    }
                    self.first.pop_front();
                    self.second.pop_front();
                }
                (first, Some((order, b))) if first.is_none_or(|(_, a)| b.sequence < a.sequence) => {
                    if !self.thinned[0] {
                        break (*order, b.clone(), Found::only(Side::Second, "message", "a message"));
                    }
                    self.second.pop_front();
                }
                (Some((order, a)), _) => {
                    if !self.thinned[1] {
                        break (*order, a.clone(), Found::only(Side::First, "message", "a message"));
                    }
                    self.first.pop_front();
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
fn difference(a: &Entry, b: &Entry) -> Option<Found> {
    if a.log_time != b.log_time {
        return Some(Found::of("log_time", [&a.log_time, &b.log_time]));
    }
    let (one, other) = (a.message.schema(), b.message.schema());
    if one.name() != other.name() {
        return Some(Found::of("schema", [&one.name(), &other.name()]));
    }
    // The encoded messages are not needed again.
    if !a.message.same(&b.message) && a.message.encode() != b.message.encode() {
        let found = differing_field(&a.message, &b.message);
        let cycle = a.message.to::<rcs::CycleRecord>().filter(|_| found.field.starts_with(".input_sequence"));
        let cycle =
            cycle.map(|record| format!("cycle {} of {} has other inputs: ", record.cycle, record.process));
        return Some(Found { detail: cycle.unwrap_or_default() + &found.detail, ..found });
    }
    (a.acq_time != b.acq_time).then(|| Found::of("acq_time", [&a.acq_time, &b.acq_time]))
}

/// The first field in which two messages of one type differ.
fn differing_field(a: &AnyMessage, b: &AnyMessage) -> Found {
    let (one, other) = match (a.value(), b.value()) {
        (Ok(one), Ok(other)) => (one, other),
        (Err(error), _) => return Found::said(format!("the first does not decode: {error}")),
        (_, Err(error)) => return Found::said(format!("the second does not decode: {error}")),
    };
    let (mut ones, mut others) = (one.leaves(), other.leaves());
    loop {
        match (ones.next(), others.next()) {
            (Some((path, a)), Some((other, b))) if path == other => {
                if let Some(found) = differing_leaf(&path, a, b) {
                    return found;
                }
            }
            (Some((path, a)), _) => return Found::only(Side::First, path.to_string(), &show(a)),
            (None, Some((path, b))) => return Found::only(Side::Second, path.to_string(), &show(b)),
            // The bytes differ in something that no field shows: unknown fields, or the order of fields.
            (None, None) => return Found::said("the same fields, other bytes"),
        }
    }
}

fn differing_leaf(path: &FieldPath, a: &Value, b: &Value) -> Option<Found> {
    if let (Some(count), Some(other)) = (a.len(), b.len())
        && !matches!(a, Value::Text(_))
    {
        if count != other {
            return Some(Found::of(path.length().to_string(), [&count, &other]));
        }
        let item = |index: usize| Some((a.item(index)?, b.item(index)?));
        let at = (0..count).find(|&index| item(index).is_some_and(|(a, b)| !same(&a, &b)))?;
        let (a, b) = item(at)?;
        let [one, other] = show_both([&a, &b]);
        return Some(Found::of(path.index(at).to_string(), [&one, &other]));
    }
    if same(a, b) {
        return None;
    }
    if let (Value::Text(one), Value::Text(other)) = (a, b)
        && (is_long(one) || is_long(other))
    {
        return Some(Found::of_long_texts(path.to_string(), [one, other]));
    }
    let [one, other] = show_both([a, b]);
    Some(Found::of(path.to_string(), [&one, &other]))
}

fn is_long(text: &str) -> bool {
    text.chars().count() > SHOWN
}

/// A text from one of its characters on, in quotes. Dots mark where it is cut.
fn part(text: &str, from: usize) -> String {
    let mut rest = text.chars().skip(from);
    let shown: String = rest.by_ref().take(SHOWN).collect();
    let before = if from > 0 { "…" } else { "" };
    let after = if rest.next().is_some() { "…" } else { "" };
    format!("{before}{shown:?}{after}")
}

fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        // Bits are compared: NaN equals NaN, and -0 differs from 0.
        (Value::Float(a), Value::Float(b)) => a.to_bits() == b.to_bits(),
        (a, b) => a == b,
    }
}

/// The texts of two values that differ; those of numbers differ, too.
fn show_both([a, b]: [&Value; 2]) -> [String; 2] {
    match (a, b) {
        (Value::Float(a), Value::Float(b)) if number(*a) == number(*b) => [a.to_string(), b.to_string()],
        (a, b) => [show(a), show(b)],
    }
}

/// A number in the digits of a 32-bit float where it is one, as the fields of a message are shown: 0.1, not
/// 0.10000000149011612. A whole number has all of its digits.
fn number(value: f64) -> String {
    let narrow = value as f32;
    let is_narrow = value.fract() != 0.0 && f64::from(narrow) == value;
    if is_narrow { narrow.to_string() } else { value.to_string() }
}

/// A value as text.
pub(crate) fn show(value: &Value) -> String {
    match value {
        Value::Null => "nothing".to_owned(),
        Value::Bool(v) => v.to_string(),
        Value::Int(v) => v.to_string(),
        Value::Uint(v) => v.to_string(),
        Value::Float(v) => number(*v),
        Value::Enum { number, name } if name.is_empty() => number.to_string(),
        Value::Enum { name, .. } => name.clone(),
        Value::Text(text) => part(text, 0),
        other => other.kind().to_owned(),
    }
}

/// Seconds without the digits by which a product misses whole nanoseconds: 6.002, not 6.002000000000001.
pub(crate) fn to_the_nanosecond(seconds: f64) -> f64 {
    (seconds * 1e9).round() / 1e9
}

/// Whether messages of a topic are measured times, which are not compared.
pub(crate) fn is_measured(topic: &str) -> bool {
    topic == names::TIMING
}

/// Whether the messages of a buffer are compared between two runs: the identity of a run and measured times differ by
/// their nature.
pub(crate) fn is_compared(buffer: &str) -> bool {
    !is_measured(buffer) && buffer != names::RUN
}

/// The first field in which two messages of one type differ, and both values as text; empty where no field shows it.
pub(crate) fn differing(a: &AnyMessage, b: &AnyMessage) -> (String, [String; 2]) {
    let found = differing_field(a, b);
    (found.field, found.values)
}

/// All fields in which two messages of one type differ, and both values as text: in the order of the first message,
/// then those that only the second has. A value is empty where the message does not have the field.
pub(crate) fn differing_each(one: &Value, other: &Value) -> Vec<(String, [String; 2])> {
    let mut others: BTreeMap<FieldPath, &Value> = other.leaves().collect();
    let mut found: Vec<Found> = Vec::new();
    for (path, value) in one.leaves() {
        found.extend(match others.remove(&path) {
            Some(other) => differing_leaf(&path, value, other),
            None => Some(Found::only(Side::First, path.to_string(), &show(value))),
        });
    }
    let second = others.iter().map(|(path, value)| Found::only(Side::Second, path.to_string(), &show(value)));
    found.extend(second);
    found.into_iter().map(|found| (found.field, found.values)).collect()
}

/// Of two texts that differ, the parts with the first difference, in quotes.
pub(crate) fn differing_parts(texts: [&str; 2]) -> [String; 2] {
    Found::of_long_texts("", texts).values
}

/// Time of the next message.
pub(crate) fn next_time(cursor: &mut Peekable<Cursor>) -> Result<Option<Stamp>, LogError> {
    match cursor.peek() {
        None => Ok(None),
        Some(Ok(message)) => Ok(Some(message.log_time)),
        Some(Err(_)) => cursor.next().transpose().map(|_| None),
    }
}

/// Adds every message of the wanted buffers up to and including a time.
pub(crate) fn put_until(
    matcher: &mut Matcher,
    side: Side,
    log: &Log,
    reassembly: &mut Reassembly,
    cursor: &mut Peekable<Cursor>,
    time: Stamp,
    is_wanted: fn(&str) -> bool,
) -> Result<(), LogError> {
    while next_time(cursor)?.is_some_and(|next| next <= time) {
        let Some(message) = cursor.next().transpose()? else { return Ok(()) };
        let entry = Entry::of(&message, log, reassembly);
        if let Some((topic, entry)) = entry.filter(|(topic, _)| is_wanted(topic)) {
            matcher.put(side, &topic, entry);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The difference between two texts in the field `text`.
    fn texts(one: &str, other: &str) -> Found {
        let [one, other] = [one, other].map(|text| Value::Text(text.to_owned()));
        differing_leaf(&FieldPath::root().field("text"), &one, &other).unwrap()
    }

    #[test]
    fn short_texts_are_shown_completely() {
        let found = texts("a \"b\"", "");
        assert_eq!(found.field, ".text");
        assert_eq!(found.values, [r#""a \"b\"""#, r#""""#]);
        assert_eq!(found.detail, r#""a \"b\"" in the first, "" in the second"#);
        let longest = "x".repeat(SHOWN);
        assert_eq!(texts(&longest, "y").values, [format!("\"{longest}\""), "\"y\"".to_owned()]);
    }

    #[test]
    fn of_long_texts_the_part_with_the_first_difference_is_shown() {
        let text = |word: &str| format!("{}{word}{}", "x".repeat(1234), "y".repeat(100));
        let found = texts(&text("first"), &text("second"));
        let [before, after] = ["x".repeat(BEFORE), "y".repeat(40)];
        assert_eq!(found.field, ".text");
        assert_eq!(found.values[0], format!("…\"{before}first{after}\"…"));
        assert_eq!(found.values[1], format!("…\"{before}second{}\"…", &after[1..]));
        let [one, other] = &found.values;
        let detail = format!("from character 1235 on, {one} in the first, {other} in the second");
        assert_eq!(found.detail, detail);
    }

    #[test]
    fn a_float_that_was_widened_to_a_double_is_shown_with_its_own_digits() {
        let values = |a: f64, b: f64| {
            let [a, b] = [a, b].map(Value::Float);
            differing_leaf(&FieldPath::root().field("weight"), &a, &b).unwrap().values
        };
        let widened = f64::from(0.1_f32);
        assert_eq!(values(widened, 0.2), ["0.1", "0.2"]);
        assert_eq!(values(0.1, widened), ["0.1", "0.10000000149011612"], "they differ");
        assert_eq!(values(123_456_792.0, 0.1), ["123456792", "0.1"]);
    }

    #[test]
    fn the_place_is_counted_in_characters_and_not_in_bytes() {
        let before = "ä".repeat(70);
        let found = texts(&format!("{before}ö"), &format!("{before}ü€"));
        let shown = "ä".repeat(BEFORE);
        assert_eq!(found.values, [format!("…\"{shown}ö\""), format!("…\"{shown}ü€\"")]);
        assert!(found.detail.starts_with("from character 71 on, "), "{}", found.detail);
    }

    #[test]
    fn a_text_that_another_begins_with_ends_where_they_differ() {
        let text = "z".repeat(80);
        let found = texts(&text, &format!("{text}more"));
        let shown = "z".repeat(BEFORE);
        assert_eq!(found.values, [format!("…\"{shown}\""), format!("…\"{shown}more\"")]);
        assert!(found.detail.starts_with("from character 81 on, "), "{}", found.detail);
    }

    #[test]
    fn a_short_and_a_long_text_are_cut_at_the_same_place() {
        let long = "b".repeat(SHOWN + 1);
        let whole = format!("\"{}\"…", "b".repeat(SHOWN));
        assert_eq!(texts("ab", &long).values, ["\"ab\"".to_owned(), whole.clone()]);
        assert_eq!(texts(&long, "").values, [whole, "\"\"".to_owned()]);
        let found = texts(&"b".repeat(20), &long);
        assert_eq!(found.values[0], format!("…\"{}\"", "b".repeat(BEFORE)));
        assert_eq!(found.values[1], format!("…\"{}\"", "b".repeat(BEFORE + SHOWN - 19)));
        assert!(found.detail.starts_with("from character 21 on, "), "{}", found.detail);
    }
}
