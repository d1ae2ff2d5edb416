//! The expected ground level: a straight line fitted to the last metre of ground.

use std::collections::VecDeque;

/// Length of ground, back from the newest point, to which the line is fitted, m.
pub(crate) const LEVEL_BASE_M: f32 = 1.0;
/// Minimum number of points for a line, and their minimum extent, m.
const LEVEL_POINTS: i64 = 6;
const LEVEL_SPAN_M: f32 = 0.3;

/// Least-squares line through points (distance, height). Sums are kept in whole millimetres, so that adding and
/// removing points is exact and the line does not depend on removed points.
#[derive(Clone, Debug, Default)]
pub(crate) struct Level {
    points: VecDeque<[i64; 2]>,
    n: i64,
    r: i64,
    z: i64,
    rr: i64,
    rz: i64,
}

/// Clamped to 10 km, so that the sums cannot overflow for any number of image rows.
fn millimetres(metres: f32) -> i64 {
    // Rounds as `f32::round`, without a call of the library: the sum is exact in f64.
    let millimetres = f64::from(metres * 1000.0).clamp(-1e7, 1e7);
    (millimetres + 0.5_f64.copysign(millimetres)) as i64
}

/// The difference of two products, rounded once.
fn minor([a, b]: [i64; 2], [c, d]: [i64; 2]) -> f64 {
    let narrow = || a.checked_mul(b)?.checked_sub(c.checked_mul(d)?);
    narrow().map_or_else(|| wide_minor([a, b], [c, d]), |number| number as f64)
}

/// The same for products of more than 64 bits. Apart, because the conversion is a slow library call, which would be made
/// for every product if it were inlined.
#[cold]
#[inline(never)]
fn wide_minor([a, b]: [i64; 2], [c, d]: [i64; 2]) -> f64 {
    (i128::from(a) * i128::from(b) - i128::from(c) * i128::from(d)) as f64
}

impl Level {
    pub(crate) fn clear(&mut self) {
        self.points.clear();
        (self.n, self.r, self.z, self.rr, self.rz) = (0, 0, 0, 0, 0);
    }

    fn count(&mut self, [r, z]: [i64; 2], sign: i64) {
        self.n += sign;
        self.r += sign * r;
        self.z += sign * z;
        self.rr += sign * r * r;
        self.rz += sign * r * z;
    }

    /// Adds a point and removes those too far behind it.
    pub(crate) fn add(&mut self, rho: f32, z: f32) {
        let point = [millimetres(rho), millimetres(z)];
        self.points.push_back(point);
        self.count(point, 1);
        let base = millimetres(LEVEL_BASE_M);
        while let Some(old) = self.points.pop_front_if(|old| point[0] - old[0] > base) {
            self.count(old, -1);
        }
    }

    /// Distance of the newest point, m.
    pub(crate) fn last(&self) -> Option<f32> {
        self.points.back().map(|point| point[0] as f32 / 1000.0)
    }

    /// Slope of the line, clamped to ±`limit`; `None` while too little ground is known.
    pub(crate) fn slope(&self, limit: f32) -> Option<f32> {
        let span = self.points.back()?[0] - self.points.front()?[0];
        if self.n < LEVEL_POINTS || span < millimetres(LEVEL_SPAN_M) {
            return None;
        }
        let determinant = minor([self.n, self.rr], [self.r, self.r]);
        let slope = minor([self.n, self.rz], [self.r, self.z]) / determinant.max(1.0);
        Some((slope as f32).clamp(-limit, limit))
    }

    /// Height of the line at a distance, m.
    pub(crate) fn at(&self, rho: f32, limit: f32) -> Option<f32> {
        let slope = f64::from(self.slope(limit)?);
        let ahead = f64::from(rho) * 1000.0 * self.n as f64 - self.r as f64;
        Some(((self.z as f64 + slope * ahead) / self.n as f64 / 1000.0) as f32)
    }
}
