//! The functions of formulas by name: those of the diagnostics tool (Albus 2006a, 6.2), and the usual ones of numbers.
//!
//! The diagnostics tool's own integral lacks the time between points, and its deviation the square root; ours have them.

use crate::moments::{Moments, trapezoid};
use crate::points::Points;
use crate::window::moving;
use rcs_msg::Stamp;

/// Width of a moving window where a formula gives none, s.
pub(crate) const WIDTH_S: f64 = 1.0;

/// A function as the window lists it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Function {
    /// Its name.
    pub name: &'static str,
    /// How it is called.
    pub call: &'static str,
    /// What it gives.
    pub summary: &'static str,
}

const fn function(name: &'static str, call: &'static str, summary: &'static str) -> Function {
    Function { name, call, summary }
}

/// All functions, those over time first.
pub fn functions() -> &'static [Function] {
    const FUNCTIONS: &[Function] = &[
        function("smooth", "smooth(a, width_s)", "mean of the window around each point; 1 s wide by default"),
        function("deviation", "deviation(a, width_s)", "standard deviation of the window around each point"),
        function("derivative", "derivative(a)", "change per second"),
        function("integral", "integral(a)", "sum over time by trapezoids, per second"),
        function("difference", "difference(a)", "change since the point before"),
        function(
            "spectrum",
            "spectrum(a)",
            "amplitude of each frequency, over frequency (Hann window, mean removed)",
        ),
        function("angle_difference", "angle_difference(a, b)", "a - b between -π and π"),
        function("absolute", "absolute(a)", "size without sign"),
        function("negative", "negative(a)", "with the other sign"),
        function("square_root", "square_root(a)", "square root"),
        function("sine", "sine(a)", "sine of an angle in radians"),
        function("cosine", "cosine(a)", "cosine of an angle in radians"),
        function("arc_tangent", "arc_tangent(y, x)", "angle of (x, y) in radians"),
        function("degrees", "degrees(a)", "radians in degrees"),
        function("exponential", "exponential(a)", "e to the power of a"),
        function("logarithm", "logarithm(a)", "natural logarithm"),
        function("round", "round(a)", "the nearest whole number"),
        function("minimum", "minimum(a, b)", "the smaller one"),
        function("maximum", "maximum(a, b)", "the greater one"),
    ];
    FUNCTIONS
}

/// The mean of a window around each point.
pub(crate) fn smooth(points: &Points, width_s: f64) -> Points {
    points.with(moving(points, width_s, Moments::mean))
}

/// The standard deviation of a window around each point.
pub(crate) fn deviation(points: &Points, width_s: f64) -> Points {
    points.with(moving(points, width_s, Moments::deviation))
}

/// The change per second: second-order differences over unequal steps within each part without gaps, one-sided at its
/// ends; NaN where a part is a single point. Of several values at one time the last counts.
pub(crate) fn derivative(points: &Points) -> Points {
    let (mut stamps, mut values): (Vec<Stamp>, Vec<f64>) = (Vec::new(), Vec::new());
    for (&stamp, &value) in points.stamps.iter().zip(points.values.iter()) {
        if stamps.last() == Some(&stamp) {
            values.pop();
        } else {
            stamps.push(stamp);
        }
        values.push(value);
    }
    let slope = |a: usize, b: usize| (values[b] - values[a]) / stamps[b].seconds_since(stamps[a]);
    let derivative = |i: usize| {
        let before = i.checked_sub(1).filter(|&before| values[before].is_finite());
        let after = Some(i + 1).filter(|&after| values.get(after).is_some_and(|value| value.is_finite()));
        match (before, after) {
            _ if !values[i].is_finite() => f64::NAN,
            (Some(a), Some(b)) => {
                let (left, right) = (stamps[i].seconds_since(stamps[a]), stamps[b].seconds_since(stamps[i]));
                (slope(a, i) * right + slope(i, b) * left) / (left + right)
            }
            (Some(a), None) => slope(a, i),
            (None, Some(b)) => slope(i, b),
            (None, None) => f64::NAN,
        }
    };
    let slopes: Vec<f64> = (0..values.len()).map(derivative).collect();
    Points::new(stamps, slopes)
}

/// The integral over time from the first point, by trapezoids. Beside a gap nothing is added, and in it there is no
/// value.
pub(crate) fn integral(points: &Points) -> Points {
    let (mut sum, mut before) = (0.0, None);
    let all = points.stamps.iter().copied().zip(points.values.iter().copied());
    let sums = all.map(|point| {
        sum += before.map_or(0.0, |before| trapezoid(before, point));
        before = Some(point);
        if point.1.is_finite() { sum } else { f64::NAN }
    });
    points.with(sums.collect())
}

/// The change since the point before; the first one has none.
pub(crate) fn difference(points: &Points) -> Points {
    let values = &points.values;
    points.with(
        (0..values.len())
            .map(|i| i.checked_sub(1).map_or(f64::NAN, |before| values[i] - values[before]))
            .collect(),
    )
}

/// `a - b` as an angle from -π to π.
pub(crate) fn angle_difference(a: f64, b: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (a - b + PI).rem_euclid(TAU) - PI
}
