//! Axes: the mapping of values to points of the screen, and their round marks.

use egui::Rangef;
use ocu_ui::format;
use ocu_ui::legend::decimals;

/// A day, s.
const DAY_S: f64 = 86_400.0;
/// Number of characters that find room beside a vertical axis.
pub(super) const MOST_CHARACTERS: usize = 8;

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
        self.marks_with(round_step(self.per_point() * f64::from(apart)))
    }

    /// Round times at least `apart` screen points from each other, with their step, in seconds.
    pub(super) fn time_marks(&self, apart: f32) -> (Vec<f64>, f64) {
        self.marks_with(round_time_step_s(self.per_point() * f64::from(apart)))
    }

    /// The multiples of a step.
    fn marks_with(&self, step: f64) -> (Vec<f64>, f64) {
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

/// A round step of time that is not below `least_s`. Above ten seconds it is round in minutes, hours or days.
fn round_time_step_s(least_s: f64) -> f64 {
    const STEPS_S: [f64; 11] =
        [15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 21_600.0, DAY_S];
    // As in `round_step`, a step may be slightly too small.
    let about_s = least_s * 0.999;
    if about_s <= 10.0 {
        return round_step(least_s);
    }
    let step_s = STEPS_S.into_iter().find(|step_s| *step_s >= about_s);
    step_s.unwrap_or_else(|| (about_s / DAY_S).ceil() * DAY_S)
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

/// A value as a mark says it, with the digits that the step needs. It has an exponent where that makes it shorter.
pub(super) fn mark_text(value: f64, step: f64) -> String {
    let size = value.abs().max(step);
    if size < 1e-4 || (size >= 1e6 && step >= 1e4) {
        let digits = (size.log10().floor() - step.log10().floor()).clamp(0.0, 17.0) as usize;
        return if value == 0.0 { "0".to_owned() } else { format!("{value:.digits$e}") };
    }
    let decimals = decimals(step);
    format!("{:.decimals$}", if value == 0.0 { 0.0 } else { value })
}

/// A value of a curve with five digits; where these hardly tell its values apart, with at least three of their spread, the
/// difference between its greatest and its least value.
pub(super) fn among(value: f64, spread: f64) -> String {
    if !(spread > 0.0 && spread < 1e-2 * value.abs()) {
        return format::number(value);
    }
    mark_text(value, 10_f64.powf(spread.log10().floor() - 2.0))
}

/// A number's text of at most this many characters: of a longer one `…` and its end, in which neighbouring marks differ.
pub(super) fn shortened(text: &str, most: usize) -> String {
    let count = text.chars().count();
    if count <= most {
        return text.to_owned();
    }
    std::iter::once('…').chain(text.chars().skip(count + 1 - most)).collect()
}

/// Times since the start as the marks of one axis say them, all in one format: seconds, with minutes where one of them is
/// a minute or longer, and with hours where one is an hour or longer.
pub(super) fn time_texts(marks: &[f64], step: f64) -> Vec<String> {
    let longest_s = marks.iter().fold(0.0, |longest: f64, mark| longest.max(mark.abs()));
    marks.iter().map(|mark| time_text(*mark, step, longest_s)).collect()
}

fn time_text(seconds: f64, step: f64, longest_s: f64) -> String {
    if longest_s < 60.0 {
        return format!("{} s", mark_text(seconds, step));
    }
    let decimals = decimals(step);
    // Whole units of the last digit, so that no text says 60 seconds.
    let per_second = 10_f64.powi(decimals as i32);
    let units = (seconds.abs() * per_second).round();
    let sign = if seconds < 0.0 && units > 0.0 { "-" } else { "" };
    let rest_s = units % (60.0 * per_second) / per_second;
    let minutes = (units / per_second / 60.0 - rest_s / 60.0).round() as u64;
    let width = if decimals == 0 { 2 } else { decimals + 3 };
    let text = format!("{:02}:{rest_s:0width$.decimals$}", minutes % 60);
    if longest_s < 3600.0 { format!("{sign}{text}") } else { format!("{sign}{}:{text}", minutes / 60) }
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
        assert_eq!(mark_text(3.2e7, 1e6), "3.2e7");
    }

    #[test]
    fn the_marks_of_an_axis_differ_however_great_its_values_are() {
        assert_eq!([5_300_110.0, 5_300_120.0].map(|value| mark_text(value, 10.0)), ["5300110", "5300120"]);
        assert_eq!(mark_text(1_234_567.5, 0.5), "1234567.5");
        assert_eq!([4.001e8, 4.002e8].map(|value| mark_text(value, 1e5)), ["4.001e8", "4.002e8"]);
        assert_eq!([3.051e-5, 3.052e-5].map(|value| mark_text(value, 1e-8)), ["3.051e-5", "3.052e-5"]);
    }

    #[test]
    fn long_marks_are_shortened_at_their_beginning_and_neighbours_still_differ() {
        assert_eq!(
            ["5300110", "-71.0945", "1700000010", "1.70000000012e18"]
                .map(|text| shortened(text, MOST_CHARACTERS)),
            ["5300110", "-71.0945", "…0000010", "…0012e18"]
        );
        for (from, length) in [
            (1_700_000_000.0, 60.0),
            (1.7e18, 6e10),
            (1.7e18, 9e3),
            (-1.234_567e9, 3.0),
            (-71.094_57, 5e-4),
            (1.0, 1e-9),
            (-1e-9, 2e-9),
            (-9.4e-10, 1e-10),
            (1e-4, 1e-12),
            (-1e300, 2e300),
        ] {
            let (marks, step) = Axis::vertical(from, from + length, Rangef::new(0.0, 300.0)).marks(34.0);
            let text = |mark: &f64| shortened(&mark_text(*mark, step), MOST_CHARACTERS);
            let texts: Vec<String> = marks.iter().map(text).collect();
            assert!(texts.len() > 2, "{from}: {texts:?}");
            assert!(texts.iter().all(|text| text.chars().count() <= MOST_CHARACTERS), "{texts:?}");
            assert!(texts.windows(2).all(|pair| pair[0] != pair[1]), "{texts:?}");
        }
    }

    #[test]
    fn steps_of_time_are_round_in_minutes() {
        for (least_s, step_s) in [
            (0.03, 0.05),
            (10.0, 10.0),
            (11.0, 15.0),
            (20.0, 30.0),
            (50.0, 60.0),
            (100.0, 120.0),
            (200.0, 300.0),
            (1e5, 2.0 * DAY_S),
        ] {
            assert!((round_time_step_s(least_s) / step_s - 1.0).abs() < 1e-9, "{least_s}");
        }
        let axis = Axis::horizontal(0.0, 200.0, Rangef::new(0.0, 200.0));
        assert_eq!(axis.time_marks(80.0), (vec![0.0, 120.0], 120.0));
    }

    #[test]
    fn the_times_of_an_axis_have_one_format() {
        assert_eq!(time_texts(&[0.0, 15.0, 30.0, 45.0], 15.0), ["0 s", "15 s", "30 s", "45 s"]);
        assert_eq!(time_texts(&[0.0, 30.0, 60.0], 30.0), ["00:00", "00:30", "01:00"]);
        assert_eq!(time_texts(&[-30.0, 0.0, 90.0], 30.0), ["-00:30", "00:00", "01:30"]);
        assert_eq!(time_texts(&[75.2, 75.25], 0.05), ["01:15.20", "01:15.25"]);
        assert_eq!(time_texts(&[59.999_999_999, 60.0], 1.0), ["01:00", "01:00"]);
        assert_eq!(time_texts(&[3000.0, 3600.0, 4500.0], 600.0), ["0:50:00", "1:00:00", "1:15:00"]);
        assert!(time_texts(&[], 1.0).is_empty());
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
