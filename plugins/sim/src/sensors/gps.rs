//! Position receiver: white noise, slow drift, outliers, dropouts; trees make all of them worse.

use super::{normal, uniform};
use crate::spec::GpsSpec;
use glam::DVec3;
use rand_core::RngCore;
use serde::{Deserialize, Serialize};

/// State of the receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Gps {
    /// Current slow error, m.
    drift: DVec3,
    /// Remaining time of the current dropout, s.
    dropout_s: f64,
}

/// Which errors are simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpsSwitches {
    /// White noise and drift.
    pub noise: bool,
    /// Fixes with large errors.
    pub outliers: bool,
    /// Periods without fixes.
    pub dropouts: bool,
}

/// A position fix of the receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpsFix {
    /// Position of the antenna, frame `global`, m.
    pub position: DVec3,
    /// Variances stated by the receiver, east, north and up, m².
    pub variances: DVec3,
}

/// Maximum number of trees that have an effect.
const MOST_TREES: usize = 4;

impl Gps {
    /// Draws the initial slow error.
    pub fn new(spec: &GpsSpec, rng: &mut impl RngCore) -> Gps {
        Gps { drift: normals(spec, rng) * spec.drift_m, dropout_s: 0.0 }
    }

    /// One reading, `1 / rate_hz` after the previous one, with this number of trees nearby; `None` during a dropout.
    ///
    /// The same random numbers are drawn whatever is switched on, so that a switch affects nothing but its own error.
    pub fn measure(
        &mut self,
        spec: &GpsSpec,
        antenna: DVec3,
        trees: usize,
        switches: GpsSwitches,
        rng: &mut impl RngCore,
    ) -> Option<GpsFix> {
        let elapsed_s = 1.0 / spec.rate_hz;
        let worse = (0..trees.min(MOST_TREES)).fold(1.0, |factor, _| factor * spec.tree_factor);
        let kept = libm::exp(-elapsed_s / spec.drift_s);
        let renewed = (1.0 - kept * kept).sqrt();
        self.drift = self.drift * kept + normals(spec, rng) * (spec.drift_m * renewed);
        let white = normals(spec, rng) * (spec.noise_m * worse);
        let is_outlier = uniform(rng) <= (spec.outliers * worse).min(0.5);
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * uniform(rng));
        let jump_m = spec.outlier_m * (0.5 + uniform(rng));
        let begins = uniform(rng) <= spec.dropouts_per_hour / 3600.0 * elapsed_s * worse;
        let lasts_s = spec.dropout_s[0] + uniform(rng) * (spec.dropout_s[1] - spec.dropout_s[0]);
        if begins && self.dropout_s <= 0.0 {
            self.dropout_s = lasts_s;
        }
        let is_lost = self.dropout_s > 0.0;
        self.dropout_s -= elapsed_s;
        if is_lost && switches.dropouts {
            return None;
        }
        let mut position = antenna;
        if switches.noise {
            position += self.drift + white;
        }
        if is_outlier && switches.outliers {
            position += DVec3::new(cos, sin, 0.0) * jump_m;
        }
        let level = spec.stated_m * spec.stated_m;
        let up = level * spec.vertical_factor * spec.vertical_factor;
        Some(GpsFix { position, variances: DVec3::new(level, level, up) })
    }
}

fn normals(spec: &GpsSpec, rng: &mut impl RngCore) -> DVec3 {
    DVec3::new(normal(rng), normal(rng), normal(rng) * spec.vertical_factor)
}
