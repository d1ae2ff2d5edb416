//! The values of single fields over time, for plots, exports and data breakpoints.
//!
//! A source gathers the fields that views name ([`super::Control::Gather`]): a log is read whole on a thread of its own,
//! and a run is followed as its messages are written, with what it wrote before from what was kept of its past. A
//! number is read from the encoded message without decoding the rest of it.

mod channels;
mod exact;
mod extract;
mod log_scan;
mod pieces;
mod reader;
mod run_fields;

pub use exact::exact_points;
pub use log_scan::read_fields;

pub(crate) use channels::alike;
pub(crate) use log_scan::LogFields;
pub(super) use run_fields::RunFields;

use super::run_tag::RunTag;
use super::series::{Record, Series};
use rcs_formula::{FieldRef, Moments, Names, Points, States};
use rcs_msg::Stamp;
use std::sync::Arc;

/// The value of a field in one message. A message without the field, or with text that is not a number, has NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldPoint {
    /// Log time.
    pub stamp: Stamp,
    /// The number; for a state or a text its key in [`FieldSeries::names`].
    pub value: f64,
}

impl Record for FieldPoint {
    type Summary = Moments;

    const FIRST: usize = 32;

    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn summary(&self) -> Moments {
        Moments::of(self.stamp, self.value)
    }

    fn join(a: Moments, b: Moments) -> Moments {
        a.join(b)
    }
}

/// A field over time in one run, as far as it is known.
#[derive(Clone, Debug)]
pub struct FieldSeries {
    /// The field.
    pub field: FieldRef,
    /// Its run.
    pub run: RunTag,
    /// Its values.
    pub points: Series<FieldPoint>,
    /// Names of its values, if it is a state, a boolean or a text.
    pub names: Names,
    /// The names of all states that it can have, if it is an enum and its definition is known.
    pub states: States,
    /// Progress of reading, 0 to 1; `None` when everything was read.
    pub reading: Option<f64>,
    /// Why there are no values, or not all of them.
    pub problem: Option<Arc<str>>,
}

impl FieldSeries {
    /// All values up to now.
    pub fn all(&self) -> Points {
        Points { states: Arc::clone(&self.states), ..points_of(&self.points, &self.names) }
    }
}

/// All values of a series, with their names.
pub fn points_of(series: &Series<FieldPoint>, names: &Names) -> Points {
    let mut stamps = Vec::with_capacity(series.len());
    let mut values = Vec::with_capacity(series.len());
    series.each(0..series.len(), |point| {
        stamps.push(point.stamp);
        values.push(point.value);
    });
    Points { names: Arc::clone(names), ..Points::new(stamps, values) }
}

/// A series of these points.
pub fn series_of(points: &Points) -> Series<FieldPoint> {
    let points = points.stamps.iter().zip(points.values.iter());
    points.map(|(&stamp, &value)| FieldPoint { stamp, value }).collect()
}

/// The statistics of a range of a series; `None` if it is empty. The work depends on the length by its logarithm.
pub fn moments(points: &Series<FieldPoint>, range: std::ops::Range<usize>) -> Option<Moments> {
    let mut all: Option<Moments> = None;
    // The summary of a part that the range cuts, or that has grown since, counts more records than the part has.
    let is_exact = |part: &super::series::Part<FieldPoint>| part.summary.points == part.to - part.from;
    points.walk(range, is_exact, |part| {
        all = Some(all.map_or(part.summary, |all| all.join(part.summary)));
        std::ops::ControlFlow::Continue(())
    });
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_any_range_are_those_of_its_points() {
        let point = |i: u64| FieldPoint { stamp: Stamp(i * i), value: ((i * 7919) % 1000) as f64 };
        for count in [0_u64, 1, 9, 700, 5000] {
            let series: Series<FieldPoint> = (0..count).map(point).collect();
            for range in [0..count, count / 3..count / 2, count / 7..count] {
                let reference = range.clone().map(|i| point(i).summary()).reduce(Moments::join);
                let got = moments(&series, range.start as usize..range.end as usize);
                let (Some(got), Some(wanted)) = (got, reference) else {
                    assert!(got.is_none() && reference.is_none());
                    continue;
                };
                assert_eq!((got.points, got.min, got.max), (wanted.points, wanted.min, wanted.max));
                assert!((got.mean - wanted.mean).abs() < 1e-9);
                assert!((got.squares - wanted.squares).abs() <= 1e-9 * wanted.squares);
                assert!((got.integral - wanted.integral).abs() <= 1e-9 * wanted.integral);
            }
        }
    }
}
