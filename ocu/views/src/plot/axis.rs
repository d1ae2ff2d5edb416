//! Axes: the mapping of values to points of the screen, and their round marks.

use egui::Rangef;
use ocu_ui::format;

/// What the horizontal axis of a graph is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GraphKind {
    Time,
    /// The index of an array.
    Index,
    /// The frequency of a spectrum.
    Frequency,
    /// Another formula.
    Against,
}

/// A range of values on a range of the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axis {
    /// Value at the beginning.
    pub(super) from: f64,
    /// Value at the end; greater than `from`.
    pub(super) to: f64,
    /// Where the beginning and the end are on the screen; of a vertical axis the end is above.
    pub(super) screen: (f32, f32),
}

impl Axis {
    pub(super) fn horizontal(from: f64, to: f64, screen: Rangef) -> Self {
        Self { from, to, screen: (screen.min, screen.max) }
    }

    pub(super) fn vertical(from: f64, to: f64, screen: Rangef) -> Self {
        Self { from, to, screen: (screen.max, screen.min) }
    }

    /// Screen position of a value, within a range that sums of coordinates can bear.
    pub(super) fn at(&self, value: f64) -> f32 {
        let share = (value - self.from) / (self.to - self.from);
        let (a, b) = (f64::from(self.screen.0), f64::from(self.screen.1));
        (a + share * (b - a)).clamp(-1e6, 1e6) as f32
    }

    /// The value at a screen position.
    pub(super) fn value(&self, at: f32) -> f64 {
        let (a, b) = self.screen;
        self.from + f64::from((at - a) / (b - a)) * (self.to - self.from)
    }

    /// Values per screen point.
    pub(super) fn per_point(&self) -> f64 {
        ((self.to - self.from) / f64::from(self.screen.1 - self.screen.0)).abs()
    }

    /// The range zoomed by a factor about a screen position, which keeps its value.
    pub(super) fn zoomed(&self, at: f32, factor: f64) -> (f64, f64) {
        let fixed = self.value(at);
        (fixed + (self.from - fixed) / factor, fixed + (self.to - fixed) / factor)
    }

    /// The range moved by a distance on the screen.
    pub(super) fn moved(&self, by: f32) -> (f64, f64) {
        let (a, b) = self.screen;
        let by = f64::from(by / (b - a)) * (self.to - self.from);
        (self.from - by, self.to - by)
    }

    /// Round values at least `apart` screen points from each other, with their step.
    pub(super) fn marks(&self, apart: f32) -> (Vec<f64>, f64) {
        let step = round_step(self.per_point() * f64::from(apart));
        let (first, last) = ((self.from / step).ceil(), (self.to / step).floor());
        // A range that floating-point numbers cannot divide has no marks.
        if last - first >= 1000.0 || (last - first).is_nan() || first + 1.0 == first {
            return (Vec::new(), step);
        }
        ((0..=(last - first) as u64).map(|i| (first + i as f64) * step).collect(), step)
    }
}

/// The least of 1, 2 and 5 times a power of ten that is not below `least`.
fn round_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.max(1e-300).log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|times| times * power)
        .find(|step| *step >= least * 0.999)
        .unwrap_or(power)
}

/// A range around values, with a margin; a range of its own where they are all equal, and 0 to 1 where there are none.
pub(super) fn around(min: f64, max: f64) -> (f64, f64) {
    if min > max || !min.is_finite() || !max.is_finite() {
        return (0.0, 1.0);
    }
    let room = (max - min).max(1e-9 * min.abs().max(max.abs()));
    // Of huge values the difference may not be finite.
    let margin = if room > 0.0 && room.is_finite() { 0.06 * room } else { 0.5 };
    (min - margin, max + margin)
}

/// A value as a mark says it, with the digits that the step needs.
pub(super) fn mark_text(value: f64, step: f64) -> String {
    let size = value.abs().max(step);
    if !(1e-4..1e6).contains(&size) {
        return if value == 0.0 { "0".to_owned() } else { format!("{value:.2e}") };
    }
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{:.decimals$}", if value == 0.0 { 0.0 } else { value })
}

/// A time since the start as a mark says it.
pub(super) fn time_text(seconds: f64, step: f64) -> String {
    if step < 1.0 || seconds.abs() < 60.0 && step < 60.0 {
        return format!("{} s", mark_text(seconds, step.min(1.0)));
    }
    let text = format::elapsed(seconds);
    let text = text.strip_suffix(".000").unwrap_or(&text).to_owned();
    match text.strip_prefix("00:") {
        Some(short) => short.to_owned(),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_round_and_inside() {
        let axis = Axis::horizontal(-0.3, 12.2, Rangef::new(100.0, 600.0));
        let (marks, step) = axis.marks(60.0);
        assert_eq!((marks.clone(), step), (vec![0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0], 2.0));
        assert!(marks.iter().all(|mark| (axis.value(axis.at(*mark)) - mark).abs() < 1e-3));
        let far = Axis::vertical(1.7e18, 1.7e18 + 512.0, Rangef::new(0.0, 100.0));
        assert!(far.marks(40.0).0.len() < 1000);
    }

    #[test]
    fn zooming_keeps_the_value_and_moving_the_length() {
        let axis = Axis::vertical(2.0, 10.0, Rangef::new(0.0, 400.0));
        let (from, to) = axis.zoomed(100.0, 2.0);
        assert_eq!((from, to), (5.0, 9.0));
        let (from, to) = axis.moved(-100.0);
        assert_eq!(to - from, 8.0);
        assert_eq!(from, 0.0, "what is dragged up shows lower values");
    }

    #[test]
    fn texts_have_the_digits_of_their_step() {
        assert_eq!(mark_text(0.1 + 0.2, 0.1), "0.3");
        assert_eq!(mark_text(1200.0, 200.0), "1200");
        assert_eq!(mark_text(-0.0, 1.0), "0");
        assert_eq!(mark_text(3.2e7, 1e6), "3.20e7");
        assert_eq!(time_text(75.0, 5.0), "01:15");
        assert_eq!(time_text(12.0, 2.0), "12 s");
        assert_eq!(time_text(75.25, 0.05), "75.25 s");
    }

    #[test]
    fn any_values_have_a_range() {
        for (min, max) in
            [(1.0, 1.0), (0.0, 0.0), (f64::INFINITY, f64::NEG_INFINITY), (-1e308, 1e308), (4e9, 4e9)]
        {
            let (from, to) = around(min, max);
            assert!(from < to && from.is_finite() && to.is_finite(), "{min} {max}: {from} {to}");
        }
    }
}
