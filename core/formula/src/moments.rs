//! Statistics of consecutive points, which join without loss of precision (Chan 1983).

use rcs_msg::Stamp;

/// Statistics of consecutive points. Values that are not finite count in `points` only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// Number of points.
    pub points: usize,
    /// Number of finite values.
    pub finite: usize,
    /// Least value; infinite if there is none.
    pub min: f64,
    /// Greatest value; minus infinity if there is none.
    pub max: f64,
    /// Arithmetic mean of the values; 0 if there is none.
    pub mean: f64,
    /// Sum of the squared differences from the mean.
    pub squares: f64,
    /// Integral over time (trapezoids between neighbours that are both finite), in units of the value times seconds.
    pub integral: f64,
    /// The first point.
    pub first: (Stamp, f64),
    /// The last point.
    pub last: (Stamp, f64),
}

impl Moments {
    /// The statistics of one point.
    pub fn of(stamp: Stamp, value: f64) -> Self {
        let finite = value.is_finite();
        Self {
            points: 1,
            finite: usize::from(finite),
            min: if finite { value } else { f64::INFINITY },
            max: if finite { value } else { f64::NEG_INFINITY },
            mean: if finite { value } else { 0.0 },
            squares: 0.0,
            integral: 0.0,
            first: (stamp, value),
            last: (stamp, value),
        }
    }

    /// The statistics of two consecutive parts.
    #[must_use]
    pub fn join(self, next: Self) -> Self {
        let (mean, squares) = match (self.finite, next.finite) {
            (_, 0) => (self.mean, self.squares),
            (0, _) => (next.mean, next.squares),
            (a, b) => {
                let (a, b) = (a as f64, b as f64);
                let delta = next.mean - self.mean;
                let mean = self.mean + delta * (b / (a + b));
                (mean, self.squares + next.squares + delta * delta * (a * b / (a + b)))
            }
        };
        Self {
            points: self.points + next.points,
            finite: self.finite + next.finite,
            min: self.min.min(next.min),
            max: self.max.max(next.max),
            mean,
            squares,
            integral: self.integral + next.integral + trapezoid(self.last, next.first),
            first: self.first,
            last: next.last,
        }
    }

    /// Mean of the values; `None` if there is none.
    pub fn mean(&self) -> Option<f64> {
        (self.finite > 0).then_some(self.mean)
    }

    /// Standard deviation of the values (of the whole population); `None` if there is none.
    pub fn deviation(&self) -> Option<f64> {
        (self.finite > 0).then(|| libm::sqrt(self.squares / self.finite as f64))
    }

    /// Seconds from the first to the last point.
    pub fn duration_s(&self) -> f64 {
        self.last.0.seconds_since(self.first.0)
    }
}

/// Area below the line between two points, in units of the value times seconds; 0 if a value is not finite.
pub(crate) fn trapezoid(from: (Stamp, f64), to: (Stamp, f64)) -> f64 {
    if from.1.is_finite() && to.1.is_finite() {
        to.0.seconds_since(from.0) * (0.5 * from.1 + 0.5 * to.1)
    } else {
        0.0
    }
}
