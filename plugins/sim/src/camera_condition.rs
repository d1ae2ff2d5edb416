//! The condition of a simulated pair or camera: how it is turned from its calibration, its exposure, its clock.

use crate::exposure::Exposure;
use crate::sensors::normal;
use crate::spec::CameraSpec;
use rand_core::RngCore;
use rcs_geom::{DVec3, Pose};
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// Condition of the cameras, from the first image on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Condition {
    /// Rotation of each camera relative to its calibration: roll, pitch and yaw in its optical frame, rad.
    turned_rad: [[f64; 3]; 2],
    /// Gain of the exposure control.
    gain: f64,
    /// Time of the last image.
    taken: Option<Stamp>,
}

impl Condition {
    /// Draws the directions in which the cameras are turned.
    pub fn new(spec: &CameraSpec, rng: &mut impl RngCore) -> Condition {
        let turned_rad = [0, 1].map(|_| {
            // Nothing is drawn without an error, so that perfect cameras keep their noise.
            if spec.calibration_error_rad == 0.0 {
                return [0.0; 3];
            }
            let axis = DVec3::from_array([(); 3].map(|()| normal(rng)));
            (axis.try_normalize().unwrap_or(DVec3::Y) * spec.calibration_error_rad).to_array()
        });
        Condition { turned_rad, gain: 1.0, taken: None }
    }

    /// Pose of a camera as it is, relative to where its calibration says that it is.
    pub fn camera_from_turned(&self, side: usize) -> Pose {
        let [roll, pitch, yaw] = self.turned_rad[side];
        Pose::from_rpy(DVec3::ZERO, roll, pitch, yaw)
    }

    /// Exposures of the cameras in the next frame: equal for both, except for the difference between their sensors.
    pub fn exposures(&self, spec: &CameraSpec, rng: &mut impl RngCore) -> [Exposure; 2] {
        let frame = self.gain * (1.0 + spec.exposure_noise * normal(rng));
        let differ = 0.5 * spec.camera_difference * normal(rng);
        [1.0, -1.0].map(|sign| Exposure { gain: frame * (1.0 + sign * differ), key: rng.next_u64() })
    }

    /// Sets the exposure of the next frame by the pixels of the left image of this one.
    pub fn control(&mut self, spec: &CameraSpec, pixels: &[u8], time: Stamp) {
        let elapsed_s = self.taken.map_or(0.0, |taken| time.seconds_since(taken));
        self.taken = Some(time);
        if let Some(control) = &spec.exposure_control {
            self.gain = control.next_gain(self.gain, pixels, elapsed_s);
        }
    }
}

/// The stamp of images that were taken at `time`.
pub fn stamped(spec: &CameraSpec, time: Stamp, rng: &mut impl RngCore) -> Stamp {
    if spec.stamp_jitter_s == 0.0 {
        return time;
    }
    let share = (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
    Stamp(time.0.saturating_add_signed(((2.0 * share - 1.0) * spec.stamp_jitter_s * 1e9) as i64))
}
