//! Several series as one table of text (comma-separated values, RFC 4180).

use crate::points::Points;
use rcs_msg::Stamp;
use std::fmt::Write as _;
use std::ops::RangeInclusive;

/// Calls `take` for each time between two times at which one of the series has a value, with the value of each; `None`
/// where a series has none at that time. Of several values at one time each has a row.
pub fn rows(columns: &[&Points], times: &RangeInclusive<Stamp>, mut take: impl FnMut(Stamp, &[Option<f64>])) {
    let first = |points: &&Points| points.stamps.partition_point(|stamp| stamp < times.start());
    let mut next: Vec<usize> = columns.iter().map(first).collect();
    let mut row = vec![None; columns.len()];
    let at = |column: usize, next: &[usize]| columns[column].stamps.get(next[column]).copied();
    loop {
        let now = (0..columns.len()).filter_map(|column| at(column, &next)).min();
        let Some(now) = now.filter(|now| now <= times.end()) else { return };
        for column in 0..columns.len() {
            row[column] = (at(column, &next) == Some(now)).then(|| columns[column].values[next[column]]);
            next[column] += usize::from(row[column].is_some());
        }
        take(now, &row);
    }
}

/// The values of named series between two times ([`rows`]), with the time in seconds since `start` and in nanoseconds.
/// States and texts are written by name. The cell of a value that is not a number is empty.
pub fn csv(columns: &[(String, &Points)], times: &RangeInclusive<Stamp>, start: Stamp) -> String {
    let mut text = String::from("time_s,time_ns");
    for (name, _) in columns {
        text.push(',');
        cell(&mut text, name);
    }
    text.push_str("\r\n");
    let points: Vec<&Points> = columns.iter().map(|(_, points)| *points).collect();
    rows(&points, times, |stamp, row| {
        let _ = write!(text, "{:.9},{}", stamp.seconds_since(start), stamp.0);
        for (value, points) in row.iter().zip(&points) {
            text.push(',');
            match value.filter(|value| !value.is_nan()).map(|value| (value, points.name(value))) {
                Some((_, Some(name))) => cell(&mut text, name),
                Some((value, None)) => drop(write!(text, "{value}")),
                None => {}
            }
        }
        text.push_str("\r\n");
    });
    text
}

/// A cell, in quotes where it needs them.
fn cell(text: &mut String, content: &str) {
    if content.contains([',', '"', '\n', '\r']) {
        let _ = write!(text, "\"{}\"", content.replace('"', "\"\""));
    } else {
        text.push_str(content);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn every_value_in_the_range_has_its_row_and_its_name() {
        let a = Points::from_seconds(&[(0.0, 1.0), (1.0, 2.5), (1.0, 3.0), (2.0, f64::NAN)]);
        let names = Arc::new([(0, Arc::from("DONE")), (1, Arc::from("a \"b\", c"))].into());
        let b = Points { names, ..Points::from_seconds(&[(1.0, 1.0), (2.5, 0.0), (9.0, 0.0)]) };
        let columns = [("/a.x".to_owned(), &a), ("x, y".to_owned(), &b)];
        let text = csv(&columns, &(Stamp(500_000_000)..=Stamp(3_000_000_000)), Stamp(500_000_000));
        let wanted = [
            "time_s,time_ns,/a.x,\"x, y\"",
            "0.500000000,1000000000,2.5,\"a \"\"b\"\", c\"",
            "0.500000000,1000000000,3,",
            "1.500000000,2000000000,,",
            "2.000000000,2500000000,,DONE",
            "",
        ];
        assert_eq!(text, wanted.join("\r\n"));
    }
}
