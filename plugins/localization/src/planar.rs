//! Position and heading with covariance: dead reckoning, and a Kalman filter with position fixes (Albus 2006a, 4).
//!
//! State: east, north (m), heading (rad). A step of length `ds` along the heading and a turn `dθ` from the gyro move
//! it, and its covariance becomes `F·P·Fᵀ + Q`, with `F` the Jacobian of the step; a fix of the antenna corrects it.
//! The local and the global estimate use the same motion model. The local one receives no fixes, so it is smooth and
//! drifts; the global one does, so it is noisy and does not drift.

use glam::{DMat3, DVec2, DVec3};
use rcs_geom::wrap_angle;
use serde::{Deserialize, Serialize};

/// Greatest distance from the origin of a frame, m: UTM coordinates differ by no more.
const FARTHEST_M: f64 = 1e7;

/// Position and heading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Planar {
    /// East and north, m.
    pub at: DVec2,
    /// Counter-clockwise from east, rad.
    pub yaw_rad: f64,
    /// Covariance of (east, north, heading), m² and rad².
    pub covariance: DMat3,
}

/// Noise of the motion model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionNoise {
    /// Standard deviation of the distance after one metre, m; its variance grows with distance.
    pub distance: f64,
    /// Standard deviation of the heading after one second, rad.
    pub heading_rad: f64,
}

/// A fix of the antenna.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// East and north, m.
    pub at: DVec2,
    /// Position of the antenna relative to the vehicle's origin, in level axes of the vehicle: ahead and left, m.
    pub arm: DVec2,
    /// Variance stated by the receiver, m².
    pub variance: f64,
    /// Factor by which the variance is enlarged for the correction, because the errors of consecutive fixes are
    /// correlated.
    pub alike: f64,
}

impl Planar {
    /// State with known variances of position, m², and heading, rad².
    pub fn new(at: DVec2, yaw_rad: f64, variance: f64, yaw_variance: f64) -> Planar {
        let covariance = DMat3::from_diagonal(DVec3::new(variance, variance, yaw_variance));
        Planar { at, yaw_rad, covariance }
    }

    /// Whether these are numbers that can be: finite, not too far from the origin, and without negative variances.
    pub fn is_sound(&self) -> bool {
        let covariance = &self.covariance;
        let least = covariance.x_axis.x.min(covariance.y_axis.y).min(covariance.z_axis.z);
        let is_placed = self.at.length() <= FARTHEST_M && self.yaw_rad.is_finite();
        is_placed && covariance.is_finite() && least >= 0.0
    }

    /// Advances the state by a step ahead, m, and a turn, rad, within a time, s.
    pub fn advance(&mut self, noise: &MotionNoise, step_m: f64, turn_rad: f64, elapsed_s: f64) {
        let (sin, cos) = libm::sincos(self.yaw_rad + 0.5 * turn_rad);
        let ahead = DVec2::new(cos, sin);
        self.at += ahead * step_m;
        self.yaw_rad = wrap_angle(self.yaw_rad + turn_rad);
        // Columns of the Jacobian of the step.
        let f = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(-sin * step_m, cos * step_m, 1.0));
        let along = noise.distance * noise.distance * step_m.abs();
        let grown = DMat3::from_cols(
            DVec3::new(along * cos * cos, along * sin * cos, 0.0),
            DVec3::new(along * sin * cos, along * sin * sin, 0.0),
            DVec3::new(0.0, 0.0, noise.heading_rad * noise.heading_rad * elapsed_s),
        );
        self.covariance = f * self.covariance * f.transpose() + grown;
    }

    /// Adds a variance along the heading, m².
    pub fn widen(&mut self, variance: f64) {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        let ahead = DVec3::new(cos, sin, 0.0);
        self.covariance += outer(ahead, ahead) * variance;
    }

    /// Squared error of a fix, normalised by the covariances of state and fix: for a good fix it is chi-squared
    /// distributed with two degrees of freedom.
    pub fn surprise(&self, fix: &Fix) -> f64 {
        let (rows, error) = self.innovation(fix);
        let s = self.spread(&rows, fix.variance);
        let inverse = invert(s);
        error.x * (inverse[0] * error.x + inverse[1] * error.y)
            + error.y * (inverse[1] * error.x + inverse[2] * error.y)
    }

    /// Corrects the state by a fix (Joseph form, which keeps the covariance symmetric and positive).
    pub fn correct(&mut self, fix: &Fix) {
        let (rows, error) = self.innovation(fix);
        let variance = fix.variance * fix.alike;
        let inverse = invert(self.spread(&rows, variance));
        let columns = rows.map(|row| self.covariance * row);
        let gain = [
            columns[0] * inverse[0] + columns[1] * inverse[1],
            columns[0] * inverse[1] + columns[1] * inverse[2],
        ];
        let change = gain[0] * error.x + gain[1] * error.y;
        self.at += change.truncate();
        self.yaw_rad = wrap_angle(self.yaw_rad + change.z);
        let kept = DMat3::IDENTITY - outer(gain[0], rows[0]) - outer(gain[1], rows[1]);
        let noise = outer(gain[0], gain[0]) + outer(gain[1], gain[1]);
        self.covariance = kept * self.covariance * kept.transpose() + noise * variance;
    }

    /// Rows of the measurement Jacobian, and the innovation, m.
    fn innovation(&self, fix: &Fix) -> ([DVec3; 2], DVec2) {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        let arm = DVec2::new(cos * fix.arm.x - sin * fix.arm.y, sin * fix.arm.x + cos * fix.arm.y);
        ([DVec3::new(1.0, 0.0, -arm.y), DVec3::new(0.0, 1.0, arm.x)], fix.at - (self.at + arm))
    }

    /// Covariance of the innovation: xx, xy, yy.
    fn spread(&self, rows: &[DVec3; 2], variance: f64) -> [f64; 3] {
        let [a, b] = rows.map(|row| self.covariance * row);
        [rows[0].dot(a) + variance, rows[0].dot(b), rows[1].dot(b) + variance]
    }
}

/// Inverse of a symmetric matrix (xx, xy, yy).
fn invert([xx, xy, yy]: [f64; 3]) -> [f64; 3] {
    let determinant = xx * yy - xy * xy;
    [yy / determinant, -xy / determinant, xx / determinant]
}

/// `a·bᵀ`.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: MotionNoise = MotionNoise { distance: 0.05, heading_rad: 0.01 };

    fn fix(at: DVec2, variance: f64) -> Fix {
        Fix { at, arm: DVec2::ZERO, variance, alike: 1.0 }
    }

    #[test]
    fn covariance_grows_as_that_of_many_random_drives() {
        // Reference: Monte Carlo simulation of 4000 drives with random errors.
        let mut seed = 1_u64;
        let mut normal = || {
            let mut sum = -6.0;
            for _ in 0..12 {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                sum += (seed >> 11) as f64 / (1_u64 << 53) as f64;
            }
            sum
        };
        let (steps, step_m, turn, dt) = (50, 0.2, 0.02, 0.2);
        let mut filter = Planar::new(DVec2::ZERO, 0.3, 0.0, 0.0);
        for _ in 0..steps {
            filter.advance(&NOISE, step_m, turn, dt);
        }
        let drives: Vec<DVec3> = (0..4000)
            .map(|_| {
                let mut drive = Planar::new(DVec2::ZERO, 0.3, 0.0, 0.0);
                for _ in 0..steps {
                    let step = step_m + NOISE.distance * f64::sqrt(step_m) * normal();
                    let turned = turn + NOISE.heading_rad * f64::sqrt(dt) * normal();
                    drive.advance(&NOISE, step, turned, dt);
                }
                drive.at.extend(drive.yaw_rad)
            })
            .collect();
        let mean = drives.iter().sum::<DVec3>() / drives.len() as f64;
        let spread = drives.iter().map(|d| outer(*d - mean, *d - mean)).sum::<DMat3>();
        let spread = spread * (1.0 / drives.len() as f64);
        for column in 0..3 {
            for row in 0..3 {
                let (got, expected) = (filter.covariance.col(column)[row], spread.col(column)[row]);
                let scale = (spread.col(column)[column] * spread.col(row)[row]).sqrt();
                assert!(
                    (got - expected).abs() < 0.1 * scale,
                    "{column},{row}: got {got}, expected {expected}"
                );
            }
        }
    }

    #[test]
    fn fixes_teach_the_heading_while_it_drives() {
        let mut filter = Planar::new(DVec2::ZERO, 0.4, 1.0, 0.25);
        let mut truth = DVec2::ZERO;
        for _ in 0..200 {
            truth.x += 0.25;
            filter.advance(&NOISE, 0.25, 0.0, 0.25);
            filter.correct(&fix(truth, 1.0));
        }
        assert!(filter.yaw_rad.abs() < 0.05, "{}", filter.yaw_rad);
        assert!(filter.at.distance(truth) < 0.2);
    }

    #[test]
    fn the_antenna_may_sit_off_the_origin() {
        let mut filter = Planar::new(DVec2::ZERO, std::f64::consts::FRAC_PI_2, 1.0, 1e-9);
        let arm = DVec2::new(-0.5, 0.2);
        for _ in 0..200 {
            filter.correct(&Fix { at: DVec2::new(2.8, 3.5), arm, variance: 0.01, alike: 1.0 });
        }
        // Ahead is north, left is west.
        assert!(filter.at.abs_diff_eq(DVec2::new(3.0, 4.0), 0.01), "{}", filter.at);
    }

    #[test]
    fn an_outlier_surprises_and_a_good_fix_does_not() {
        let filter = Planar::new(DVec2::ZERO, 0.0, 1.0, 0.01);
        assert!(filter.surprise(&fix(DVec2::new(1.0, -1.0), 2.0)) < 1.0);
        let expected = 15.0 * 15.0 / 3.0;
        assert!((filter.surprise(&fix(DVec2::new(15.0, 0.0), 2.0)) - expected).abs() < 1e-9);
    }
}
