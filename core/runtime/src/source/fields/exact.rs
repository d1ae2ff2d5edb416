//! Whole numbers that are too large for the values of a series. A double holds each whole number up to 2^53; identifiers
//! and times in nanoseconds are larger. The messages are read a second time for them, and for no other field.

use super::FieldSeries;
use super::channels::{alike, choose};
use rcs_formula::Points;
use rcs_log::{CursorOptions, Log, Reassembly};
use rcs_msg::{AnyMessage, FieldPath, Stamp, Value};
use std::ops::RangeInclusive;
use std::sync::Arc;

/// The least whole number beside which a double does not hold every other one.
const LARGE: f64 = 9_007_199_254_740_992.0;

/// All values of a field that [`super::read_fields`] has read from this log between these times, with its whole numbers
/// as they are stored, where they are too large for a double ([`Points::whole`]).
pub fn exact_points(log: &Log, series: &FieldSeries, times: &RangeInclusive<Stamp>) -> Points {
    let points = series.all();
    let is_large = |value: &f64| value.is_finite() && value.abs() >= LARGE;
    if points.are_states() || !points.values.iter().any(is_large) {
        return points;
    }
    let whole = whole_numbers(log, series, times, &points).unwrap_or_default();
    Points { whole, ..points }
}

/// The whole number of each point; `None` if the field has other numbers, or its messages cannot be read again.
fn whole_numbers(
    log: &Log,
    series: &FieldSeries,
    times: &RangeInclusive<Stamp>,
    points: &Points,
) -> Option<Arc<[Option<i128>]>> {
    let (field, reassembly) = (&series.field, Reassembly::new(log));
    let groups = alike(log.info().topics_named(&field.topic), &reassembly);
    let channels = choose(&field.topic, &groups, &field.path).ok()?.channels;
    if channels.ids.iter().any(|id| reassembly.takes(*id)) {
        return None;
    }
    let options = CursorOptions { topics: Some(channels.ids), start: *times.start(), end: *times.end() };
    let mut whole = Vec::with_capacity(points.len());
    // What cannot be read has been reported, and the points do not contain it either.
    for message in log.cursor(options).filter_map(Result::ok) {
        let at = whole.len();
        let (Some(&stamp), Some(&value)) = (points.stamps.get(at), points.values.get(at)) else {
            return None;
        };
        let encoded = AnyMessage::encoded(Arc::clone(&channels.schema), message.data);
        let number = whole_number(&encoded, &field.path);
        // Otherwise it is a number of another kind, or not the message that the point is of.
        let is_same = number.map_or(value.is_nan(), |number| number as f64 == value);
        if stamp != message.log_time || !is_same {
            return None;
        }
        whole.push(number);
    }
    (whole.len() == points.len()).then(|| whole.into())
}

/// The whole number at a path; `None` if there is none.
fn whole_number(message: &AnyMessage, path: &FieldPath) -> Option<i128> {
    let root = message.value().ok()?;
    match &*root.get(path).ok()? {
        Value::Int(number) => Some(i128::from(*number)),
        Value::Uint(number) => Some(i128::from(*number)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::read_fields;
    use super::*;
    use rcs_formula::FieldRef;
    use rcs_log::{LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::{MessageEncoding, Schema};
    use std::collections::BTreeMap;

    /// A log with these messages in JSON at 1, 2, 3 … ns, on the channels with these types in turn.
    fn log(folder: &std::path::Path, types: &[&str], messages: &[&str]) -> Log {
        let path = folder.join("log.mcap");
        let mut writer =
            LogWriter::create(&path, WriterOptions { replace: true, ..WriterOptions::default() }).unwrap();
        let channels: Vec<_> = (0..)
            .zip(types)
            .map(|(number, name)| {
                let schema = Schema::new(*name, MessageEncoding::Json, "jsonschema", (&b"{}"[..]).into());
                // Channels that differ in nothing are one.
                let metadata = BTreeMap::from([("writer".to_owned(), format!("{number}"))]);
                writer.add_channel("/a", &schema, &metadata).unwrap()
            })
            .collect();
        for (i, message) in messages.iter().enumerate() {
            let time = Stamp(i as u64 + 1);
            let header = WriteHeader { sequence: 0, log_time: time, publish_time: time };
            writer.write(channels[i % channels.len()], header, message.as_bytes()).unwrap();
        }
        writer.finish().unwrap();
        Log::open(path).unwrap()
    }

    fn read(log: &Log, path: &str, times: RangeInclusive<u64>) -> (FieldSeries, Points) {
        let field = FieldRef { topic: "/a".to_owned(), path: path.parse().unwrap() };
        let times = Stamp(*times.start())..=Stamp(*times.end());
        let series = read_fields(log, &[field], times.clone()).remove(0);
        let points = exact_points(log, &series, &times);
        (series, points)
    }

    #[test]
    fn whole_numbers_that_are_too_large_for_a_double_are_exact() {
        let folder = tempfile::tempdir().unwrap();
        let messages = [
            r#"{"n": 9007199254740993, "x": 1e300, "small": 1}"#,
            r#"{"x": 2.5, "small": 2}"#,
            r#"{"n": 18446744073709551615, "x": 1, "small": 3}"#,
            r#"{"n": -9007199254740995, "x": 0, "small": 4}"#,
        ];
        let log = log(folder.path(), &["Any"], &messages);
        let whole = |path, times| read(&log, path, times).1.whole.to_vec();
        let [first, third, fourth]: [i128; 3] = [(1 << 53) + 1, u64::MAX.into(), -(1 << 53) - 3];
        assert_eq!(whole(".n", 1..=4), [Some(first), None, Some(third), Some(fourth)]);
        assert_eq!(whole(".n", 2..=3), [None, Some(third)]);
        // Other numbers are what the doubles are.
        assert!(whole(".x", 1..=4).is_empty() && whole(".small", 1..=4).is_empty());
    }

    #[test]
    fn channels_with_one_name_are_read_together_and_those_of_another_type_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let messages = [r#"{"n": 1}"#, r#"{"n": 2}"#, r#"{"n": 3}"#, r#"{"n": 4}"#, r#"{"n": 5}"#];
        let log_of = |types: &[&str]| read(&log(folder.path(), types, &messages), ".n", 1..=5);
        let (series, points) = log_of(&["Any", "Any"]);
        assert_eq!((&*points.values, &series.problem), (&[1.0, 2.0, 3.0, 4.0, 5.0][..], &None));
        let (series, points) = log_of(&["Any", "Other"]);
        assert_eq!(*points.values, [1.0, 3.0, 5.0]);
        let problem = series.problem.unwrap();
        assert!(
            problem.contains("messages of type Any are read") && problem.contains("2 of Other"),
            "{problem}"
        );
    }
}
