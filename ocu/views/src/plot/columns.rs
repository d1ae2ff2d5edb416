//! Reduces a series to what a screen can show: for each column of pixels the least and the greatest value of its points.
//!
//! The summaries of the series limit the work to the number of columns, however long the series is. Columns begin at
//! multiples of their width in time, so that those of a frame hold for the next one when the axis moves ([`Kept`]).

use super::axis::Axis;
use egui::{Pos2, Rangef, Rect};
use rcs_formula::Moments;
use rcs_msg::Stamp;
use rcs_runtime::source::{FieldPoint, Piece, Series};
use std::ops::{ControlFlow, Range};

/// From this number of records in a column of pixels on, it is composed of summaries.
const MANY: f64 = 128.0;

/// What a column of pixels shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Column {
    /// Position of the first point, in screen points.
    pub(super) x: f32,
    /// Least and greatest value; not in order if no value is finite.
    pub(super) min: f64,
    pub(super) max: f64,
    /// First and last value.
    pub(super) first: f64,
    pub(super) last: f64,
    /// Number of points.
    pub(super) points: usize,
}

/// The records of a series to be drawn between two times, with the neighbours outside, so that lines reach the edge.
pub(super) fn visible(points: &Series<FieldPoint>, from: Stamp, to: Stamp) -> Range<usize> {
    let first = points.count_before(from).saturating_sub(1);
    first..(points.count_until(to) + 1).min(points.len())
}

/// The columns of a curve as they were last drawn.
#[derive(Clone, Debug, Default)]
pub(super) struct Kept {
    points: Series<FieldPoint>,
    /// Seconds of a column.
    width_s: f64,
    /// Each with its first record and the indices of all of them.
    columns: Vec<(FieldPoint, Range<usize>, Column)>,
}

impl Kept {
    /// The columns of a range of a series; `seconds` gives the position of a time on the axis. Those that were drawn
    /// last and still hold are not gathered again.
    pub(super) fn columns(
        &mut self,
        points: &Series<FieldPoint>,
        range: Range<usize>,
        axis: &Axis,
        seconds: impl Fn(Stamp) -> f64,
    ) -> Vec<Column> {
        let width_s = (axis.to - axis.from) / f64::from(axis.screen.1 - axis.screen.0).max(1.0);
        // Moving an axis rounds its ends.
        if !self.points.same(points) || (self.width_s / width_s - 1.0).abs() > 1e-9 || !width_s.is_normal() {
            *self = Self { width_s, ..Self::default() };
        }
        // It may have grown.
        self.points = points.clone();
        let mut known = std::mem::take(&mut self.columns);
        // The range may have cut the first and the last one.
        known.pop();
        let inside = |(_, records, _): &(FieldPoint, Range<usize>, Column)| {
            range.start <= records.start && records.end <= range.end
        };
        let known: Vec<_> = known.into_iter().skip(1).filter(inside).collect();
        match (known.first(), known.last()) {
            (Some((_, first, _)), Some((_, last, _))) => {
                let (before, after) = (range.start..first.start, last.end..range.end);
                self.gather(before, &seconds);
                self.columns.extend(known);
                self.gather(after, &seconds);
            }
            _ => self.gather(range, &seconds),
        }
        let place = |(first, _, column): &(FieldPoint, Range<usize>, Column)| Column {
            x: axis.at(seconds(first.stamp)),
            ..*column
        };
        self.columns.iter().map(place).collect()
    }

    /// Adds the columns of these records. A column of very many records is composed of summaries that belong to the
    /// column in which they begin, of at most a quarter of its width: all points are in it, and none is farther than that
    /// from its place.
    fn gather(&mut self, range: Range<usize>, seconds: impl Fn(Stamp) -> f64) {
        let (Some(first), Some(last)) =
            (self.points.get(range.start), self.points.get(range.end.saturating_sub(1)))
        else {
            return;
        };
        let span_s = seconds(last.stamp) - seconds(first.stamp);
        if range.len() as f64 * self.width_s > MANY * span_s {
            self.gather_summaries(range, seconds);
        } else {
            self.gather_exactly(range, seconds);
        }
    }

    fn gather_summaries(&mut self, range: Range<usize>, seconds: impl Fn(Stamp) -> f64) {
        let Self { points, width_s, columns } = self;
        let (mut next, mut edge_s) = (range.start, f64::NEG_INFINITY);
        let is_fine =
            |summary: &Moments| seconds(summary.last.0) - seconds(summary.first.0) <= 0.25 * *width_s;
        points.pieces(range, is_fine, |piece| {
            let (stamp, first, last, min, max, count) = match piece {
                Piece::Summary(of, count) => (of.first.0, of.first.1, of.last.1, of.min, of.max, count),
                Piece::Record(&FieldPoint { stamp, value }) if value.is_finite() => {
                    (stamp, value, value, value, value, 1)
                }
                Piece::Record(&FieldPoint { stamp, value }) => {
                    (stamp, value, value, f64::INFINITY, f64::NEG_INFINITY, 1)
                }
            };
            let at_s = seconds(stamp);
            match columns.last_mut() {
                Some((_, records, column)) if at_s < edge_s => {
                    (column.min, column.max) = (column.min.min(min), column.max.max(max));
                    column.last = last;
                    column.points += count;
                    records.end += count;
                }
                _ => {
                    edge_s = ((at_s / *width_s).floor() + 1.0) * *width_s;
                    let column = Column { x: 0.0, min, max, first, last, points: count };
                    columns.push((FieldPoint { stamp, value: first }, next..next + count, column));
                }
            }
            next += count;
        });
    }

    fn gather_exactly(&mut self, range: Range<usize>, seconds: impl Fn(Stamp) -> f64) {
        let Self { points, width_s, columns } = self;
        let mut next = range.start;
        points.stretches(
            range,
            |point| (seconds(point.stamp) / *width_s).floor() as i64,
            |Values { min, max }, point| {
                if point.value.is_finite() {
                    (*min, *max) = (min.min(point.value), max.max(point.value));
                }
            },
            |Values { min, max }, summary| (*min, *max) = (min.min(summary.min), max.max(summary.max)),
            |stretch| {
                let column = Column {
                    x: 0.0,
                    min: stretch.sum.min,
                    max: stretch.sum.max,
                    first: stretch.first.value,
                    last: stretch.last.value,
                    points: stretch.count,
                };
                columns.push((stretch.first, next..next + stretch.count, column));
                next += stretch.count;
            },
        );
    }
}

/// Least and greatest of the values so far.
struct Values {
    min: f64,
    max: f64,
}

impl Default for Values {
    fn default() -> Self {
        Self { min: f64::INFINITY, max: f64::NEG_INFINITY }
    }
}

/// What draws a curve: lines, and areas where it fills its columns.
#[derive(Debug, Default)]
pub(super) struct Strokes {
    pub(super) lines: Vec<Vec<Pos2>>,
    /// Columns with many values, from the least to the greatest. A line to and fro would cover each pixel several times.
    pub(super) bars: Vec<Rect>,
}

/// Number of values from which on a column is drawn as a bar.
const FILLED: usize = 4;

/// Lines and bars through the columns, interrupted at gaps. A column with several values reaches from the least to the
/// greatest. What connects two bars is a part of the second one.
pub(super) fn strokes(columns: &[Column], axis: &Axis) -> Strokes {
    let mut strokes = Strokes::default();
    let mut line: Vec<Pos2> = Vec::new();
    // The last value of a bar that nothing follows yet.
    let mut bar_end: Option<Pos2> = None;
    for (index, column) in columns.iter().enumerate() {
        if column.min > column.max || !column.first.is_finite() {
            strokes.lines.push(std::mem::take(&mut line));
            bar_end = None;
        }
        if column.min > column.max {
            continue;
        }
        let (low, high) = (axis.at(column.min), axis.at(column.max));
        let at = |value: f64| Pos2::new(column.x, axis.at(value));
        if column.points >= FILLED && low - high >= 1.0 {
            let mut span = Rangef::new(high, low);
            if let Some(before) = bar_end {
                span = Rangef::new(span.min.min(before.y), span.max.max(before.y));
            } else if !line.is_empty() {
                line.push(at(column.first));
                strokes.lines.push(std::mem::take(&mut line));
            }
            let next = columns.get(index + 1).map_or(f32::INFINITY, |next| next.x);
            strokes.bars.push(Rect::from_x_y_ranges(column.x..=next.min(column.x + 1.5), span));
            bar_end = Some(at(column.last));
        } else {
            line.extend(bar_end.take());
            if low - high < 1.0 {
                line.push(at(if column.first.is_finite() { column.first } else { column.min }));
            } else {
                // Begin with the end that is nearer to the line so far.
                let before = line.last().map_or(low, |last| last.y);
                let is_near = (before - low).abs() <= (before - high).abs();
                let (a, b) = if is_near { (low, high) } else { (high, low) };
                line.push(Pos2::new(column.x, a));
                line.push(Pos2::new(column.x, b));
                if column.last.is_finite() && (axis.at(column.last) - b).abs() > 1.0 {
                    line.push(at(column.last));
                }
            }
        }
        if !column.last.is_finite() {
            strokes.lines.push(std::mem::take(&mut line));
            bar_end = None;
        }
    }
    strokes.lines.push(line);
    strokes.lines.retain(|line| !line.is_empty());
    strokes
}

/// Stretches of one state: positions of their beginning and end, and the state. Stretches below one screen point have no
/// state, and are joined with those without a state beside them; the last one keeps its state.
pub(super) fn bands(
    points: &Series<FieldPoint>,
    range: Range<usize>,
    axis: &Axis,
    end: f32,
    seconds: impl Fn(Stamp) -> f64,
) -> Vec<(f32, f32, Option<i64>)> {
    let at = |point: &FieldPoint| axis.at(seconds(point.stamp));
    let state = |point: &FieldPoint| point.value.is_finite().then_some(point.value as i64);
    let is_one = |of: &Moments| of.min == of.max && of.finite == of.points;
    // Where each stretch begins, and its state.
    let mut begins: Vec<(f32, Option<i64>)> = Vec::new();
    let mut begin = |x: f32, state: Option<i64>| {
        match begins.last_mut() {
            Some((_, known)) if *known == state => return,
            // Only where the next one begins is it known how wide this one is.
            Some((from, known)) if x - *from < 1.0 => *known = None,
            _ => {}
        }
        if matches!(begins[..], [.., (_, None), (_, None)]) {
            begins.pop();
        }
        if begins.last().is_none_or(|(_, known)| *known != state) {
            begins.push((x, state));
        }
    };
    points.walk(
        range,
        |part| {
            let exact = part.summary.points == part.to - part.from;
            exact && (is_one(&part.summary) || at(&part.first).floor() == at(&part.last).floor())
        },
        |part| {
            if !is_one(&part.summary) {
                begin(at(&part.first), None);
            }
            // Of a part with several states, the last one holds until the next part, however far away that is.
            let from = if is_one(&part.summary) { &part.first } else { &part.last };
            begin(at(from), state(from));
            ControlFlow::Continue(())
        },
    );
    let ends = begins.iter().skip(1).map(|(x, _)| *x).chain([end]);
    let bands = begins.iter().zip(ends).map(|(&(from, state), to)| (from, to, state));
    bands.filter(|(from, to, _)| to > from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(stamp: Stamp) -> f64 {
        stamp.0 as f64 * 1e-9
    }

    #[test]
    fn columns_hold_the_true_minima_and_maxima_of_a_million_points() {
        let value = |i: u64| if i == 617_283 { 1e3 } else { ((i * 7919) % 1000) as f64 * 1e-3 };
        let point = |i: u64| FieldPoint { stamp: Stamp(i * 1_000_000), value: value(i) };
        let series: Series<FieldPoint> = (0..1_000_000).map(point).collect();
        // The third and the following ones are the second one moved: most of their columns were kept.
        let ranges = [(0.0, 1000.0), (400.3, 700.9), (402.3, 702.9), (250.0, 550.6), (900.1, 1200.7)];
        let mut kept = Kept::default();
        for (from, to) in ranges.into_iter().chain([(617.28, 617.29)]) {
            let axis = Axis::horizontal(from, to, Rangef::new(50.0, 850.0));
            let range = visible(&series, Stamp((from * 1e9) as u64), Stamp((to * 1e9) as u64));
            let got = kept.columns(&series, range.clone(), &axis, seconds);
            // The reference: every point in the column of its own, or the one before if that is nearer than a quarter.
            let mut at = range.start;
            for (first, records, column) in &kept.columns {
                assert_eq!((records.start, records.len()), (at, column.points));
                assert_eq!(*first, point(at as u64));
                let of_column = |i: usize| seconds(point(i as u64).stamp) / kept.width_s;
                let number = of_column(at).floor();
                assert!(records.clone().all(|i| (number..=number + 1.25).contains(&of_column(i))));
                let values = || records.clone().map(|i| value(i as u64));
                let wanted = (values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max));
                assert_eq!((column.min, column.max), wanted);
                assert_eq!((column.first, column.last), (value(at as u64), value(records.end as u64 - 1)));
                at = records.end;
            }
            assert_eq!(at, range.end);
            assert!(got.iter().all(|c| (-100.0..1000.0).contains(&c.x)));
            assert!(got.len() < 810);
        }
    }

    #[test]
    fn columns_grow_with_their_series() {
        let writer = rcs_runtime::source::SeriesWriter::default();
        let axis = Axis::horizontal(0.0, 10.0, Rangef::new(0.0, 100.0));
        let mut kept = Kept::default();
        for i in 0..995_u64 {
            writer.append(FieldPoint { stamp: Stamp(i * 10_000_000), value: i as f64 });
            let series = writer.read();
            let got = kept.columns(&series, 0..series.len(), &axis, seconds);
            assert_eq!(got.iter().map(|column| column.points).sum::<usize>(), series.len());
            assert_eq!(got.last().map(|column| column.max), Some(i as f64));
        }
    }

    #[test]
    fn a_gap_interrupts_the_line_and_no_value_is_drawn_for_it() {
        let values = [1.0, 2.0, f64::NAN, 3.0, f64::INFINITY, 4.0];
        let series: Series<FieldPoint> = values
            .iter()
            .zip(1..)
            .map(|(&value, i)| FieldPoint { stamp: Stamp(i * 1_000_000_000), value })
            .collect();
        let axis = Axis::horizontal(0.0, 7.0, Rangef::new(0.0, 700.0));
        let columns = Kept::default().columns(&series, 0..6, &axis, seconds);
        let y = Axis::vertical(0.0, 5.0, Rangef::new(0.0, 500.0));
        let lines = strokes(&columns, &y).lines;
        assert_eq!(lines.iter().map(Vec::len).collect::<Vec<_>>(), [2, 1, 1]);
    }

    #[test]
    fn columns_of_many_values_are_bars_that_touch_each_other_and_the_lines_beside_them() {
        // Ten values a column between 10 and 20, between 40 and 50, one value, a gap, and a bar again.
        let noise = |low: f64| (0..10).map(move |i| low + f64::from(i * 7 % 11));
        let values =
            noise(10.0).chain(noise(40.0)).chain([60.0; 10]).chain([f64::NAN; 10]).chain(noise(10.0));
        let series: Series<FieldPoint> =
            values.zip(0..).map(|(value, i)| FieldPoint { stamp: Stamp(i * 100_000_000), value }).collect();
        let axis = Axis::horizontal(0.0, 5.0, Rangef::new(0.0, 5.0));
        let columns = Kept::default().columns(&series, 0..series.len(), &axis, seconds);
        let Strokes { lines, bars } = strokes(&columns, &Axis::vertical(0.0, 100.0, Rangef::new(0.0, 100.0)));
        let spans: Vec<_> = bars.iter().map(|bar| (bar.left(), bar.top(), bar.bottom())).collect();
        // The last value of the first bar is 18, and 0 is at the bottom.
        assert_eq!(spans, [(0.0, 80.0, 90.0), (1.0, 50.0, 82.0), (4.0, 80.0, 90.0)]);
        assert_eq!(lines, [vec![Pos2::new(1.0, 52.0), Pos2::new(2.0, 40.0)]]);
    }

    #[test]
    fn states_are_bands_from_change_to_change() {
        let states = [1.0, 1.0, 1.0, 2.0, 2.0, f64::NAN, 1.0];
        let series: Series<FieldPoint> = states
            .iter()
            .zip(0..)
            .map(|(&value, i)| FieldPoint { stamp: Stamp(i * 1_000_000_000), value })
            .collect();
        let axis = Axis::horizontal(0.0, 7.0, Rangef::new(0.0, 700.0));
        let bands = bands(&series, 0..7, &axis, 700.0, seconds);
        let wanted =
            [(0.0, 300.0, Some(1)), (300.0, 500.0, Some(2)), (500.0, 600.0, None), (600.0, 700.0, Some(1))];
        assert_eq!(bands, wanted);
    }

    #[test]
    fn a_state_soon_after_a_change_keeps_its_name() {
        let point = |(ms, value): (u64, f64)| FieldPoint { stamp: Stamp(ms * 1_000_000), value };
        let series: Series<FieldPoint> = [(0, 1.0), (20, 2.0)].into_iter().map(point).collect();
        let axis = Axis::horizontal(0.0, 60.0, Rangef::new(0.0, 800.0));
        let x = axis.at(0.02);
        assert!(x < 1.0);
        assert_eq!(bands(&series, 0..2, &axis, 800.0, seconds), [(0.0, x, None), (x, 800.0, Some(2))]);
        // Several of them between two that are wide.
        let states = [(0, 1.0), (30_000, 2.0), (30_020, 1.0), (30_040, 3.0), (30_060, 1.0)];
        let series: Series<FieldPoint> = states.into_iter().map(point).collect();
        let (from, to) = (axis.at(30.0), axis.at(30.06));
        let wanted = [(0.0, from, Some(1)), (from, to, None), (to, 800.0, Some(1))];
        assert_eq!(bands(&series, 0..5, &axis, 800.0, seconds), wanted);
    }

    #[test]
    fn a_change_within_a_summary_takes_no_more_than_a_point_of_the_states_beside_it() {
        // At the last record of a summary of 32, which are all on one point of the screen.
        for changed in [4095, 35_999] {
            let point = |i: u64| FieldPoint {
                stamp: Stamp(i * 100_000_000),
                value: if i < changed { 1.0 } else { 2.0 },
            };
            let series: Series<FieldPoint> = (0..36_000).map(point).collect();
            let axis = Axis::horizontal(0.0, 4000.0, Rangef::new(0.0, 800.0));
            let bands = bands(&series, 0..series.len(), &axis, 800.0, seconds);
            let states: Vec<Option<i64>> = bands.iter().map(|(.., state)| *state).collect();
            assert_eq!(states, [Some(1), None, Some(2)], "{changed}");
            assert!(bands[1].1 - bands[1].0 < 1.0, "{changed}: {bands:?}");
            assert_eq!(bands[2].1, 800.0);
        }
    }
}
