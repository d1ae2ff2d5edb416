//! Several series as one table of text (comma-separated values, RFC 4180).

use crate::points::Points;
use rcs_msg::Stamp;
use std::fmt::Write as _;
use std::ops::RangeInclusive;

/// Calls `take` for each time between two times at which one of the series has a value, with the index of the value of
/// each; `None` where a series has none at that time. Of several values at one time each has a row.
pub fn rows(
    columns: &[&Points],
    times: &RangeInclusive<Stamp>,
    mut take: impl FnMut(Stamp, &[Option<usize>]),
) {
    let first = |points: &&Points| points.stamps.partition_point(|stamp| stamp < times.start());
    let mut next: Vec<usize> = columns.iter().map(first).collect();
    let mut row = vec![None; columns.len()];
    let at = |column: usize, next: &[usize]| columns[column].stamps.get(next[column]).copied();
    loop {
        let now = (0..columns.len()).filter_map(|column| at(column, &next)).min();
        let Some(now) = now.filter(|now| now <= times.end()) else { return };
        for column in 0..columns.len() {
            row[column] = (at(column, &next) == Some(now)).then_some(next[column]);
            next[column] += usize::from(row[column].is_some());
        }
        take(now, &row);
    }
}

/// The values of named series between two times ([`rows`]), with the time in seconds since `start` and in nanoseconds.
/// States and texts are written by name, and whole numbers exactly where the series has them ([`Points::whole`]). The
/// cell of a value that is not a number is empty.
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
        for (index, points) in row.iter().zip(&points) {
            text.push(',');
            let Some(index) = *index else { continue };
            let value = points.values[index];
            match (points.name(value), points.whole_at(index)) {
                (Some(name), _) => cell(&mut text, name),
                (None, Some(whole)) => drop(write!(text, "{whole}")),
                (None, None) if !value.is_nan() => drop(write!(text, "{value}")),
                (None, None) => {}
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

    #[test]
    fn whole_numbers_that_a_double_cannot_hold_keep_their_digits() {
        let large = (1_i128 << 63) + 1;
        let seconds = [(1.0, large as f64), (2.0, f64::NAN), (3.0, 7.0)];
        let whole: Arc<[Option<i128>]> = Arc::from([Some(large), None, Some(7)]);
        let points = Points { whole, ..Points::from_seconds(&seconds) };
        let times = Stamp(0)..=Stamp(9_000_000_000);
        let values = |points: Points| {
            let text = csv(&[("/a.id".to_owned(), &points)], &times, Stamp(0));
            text.lines().skip(1).map(|line| line.rsplit(',').next().unwrap().to_owned()).collect::<Vec<_>>()
        };
        // What is computed from them has the values of doubles.
        let computed = points.with(points.values.to_vec());
        assert_eq!(values(points), ["9223372036854775809", "", "7"]);
        assert_eq!(values(computed), ["9223372036854776000", "", "7"]);
    }
}
