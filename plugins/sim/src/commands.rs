//! Which wheel commands the vehicle obeys: those that are valid, in order and recent. Without one it brakes.

use crate::drive::Drive;
use crate::spec::VehicleSpec;
use crate::vehicle::DriveCommand;
use rcs_msg::Stamp;
use rcs_msg::rcs::WheelCommand;
use serde::{Deserialize, Serialize};

/// Maximum time by which a command's timestamp may be ahead of the vehicle's clock, s.
const EARLY_S: f64 = 0.05;
/// Wheel speeds of a vehicle with steering that is told to drive straight differ by at most this, m/s.
const STRAIGHT_MPS: f64 = 0.1;

/// Why a command was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A number is NaN or infinite.
    #[error("wheels at {left} and {right} m/s with curvature {curvature} 1/m, expected finite numbers")]
    NotFinite {
        /// m/s.
        left: f64,
        /// m/s.
        right: f64,
        /// 1/m.
        curvature: f64,
    },
    /// A wheel speed exceeds the limit of the vehicle.
    #[error("wheel at {got} m/s, expected at most {limit} m/s")]
    TooFast {
        /// m/s.
        got: f64,
        /// m/s.
        limit: f64,
    },
    /// The command turns a vehicle with steering by its wheel speeds alone.
    #[error("wheels at {left} and {right} m/s without curvature, expected one: the vehicle has steering")]
    NotSteered {
        /// m/s.
        left: f64,
        /// m/s.
        right: f64,
    },
    /// The command has no timestamp.
    #[error("no timestamp")]
    NoTime,
    /// The command is older than the previous one.
    #[error("command is {age_s:.3} s older than the one before")]
    OutOfOrder {
        /// s.
        age_s: f64,
    },
    /// The command is too old.
    #[error("command is {age_s:.3} s old, expected at most {limit_s} s")]
    Stale {
        /// s.
        age_s: f64,
        /// s.
        limit_s: f64,
    },
    /// The command is from the future.
    #[error("command is from {ahead_s:.3} s ahead, expected at most {EARLY_S} s")]
    Early {
        /// s.
        ahead_s: f64,
    },
}

/// The active command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Commands {
    /// Its time, wheel speeds and curvature.
    obeyed: Option<(Stamp, [f64; 2], f64)>,
    /// The time of the newest valid command, active or not.
    newest: Option<Stamp>,
}

impl Commands {
    /// Takes a command at time `now`. One with impossible values also ends the previous command, because its sender can
    /// no longer be trusted.
    pub fn take(
        &mut self,
        spec: &VehicleSpec,
        command: &WheelCommand,
        now: Stamp,
        timeout_s: f64,
    ) -> Result<(), Refusal> {
        let (left, right, curvature) = (command.left_mps, command.right_mps, command.curvature_per_m);
        if ![left, right, curvature].iter().all(|value| value.is_finite()) {
            self.obeyed = None;
            return Err(Refusal::NotFinite { left, right, curvature });
        }
        let limit = spec.wheels.max_wheel_speed_mps;
        if let Some(&got) = [left, right].iter().find(|speed| speed.abs() > limit) {
            self.obeyed = None;
            return Err(Refusal::TooFast { got, limit });
        }
        if spec.steering.is_some() && curvature == 0.0 && (left - right).abs() > STRAIGHT_MPS {
            self.obeyed = None;
            return Err(Refusal::NotSteered { left, right });
        }
        let time = command.timestamp.as_ref().and_then(Stamp::from_proto).ok_or(Refusal::NoTime)?;
        let age_s = now.seconds_since(time);
        if age_s > timeout_s {
            return Err(Refusal::Stale { age_s, limit_s: timeout_s });
        }
        if age_s < -EARLY_S {
            return Err(Refusal::Early { ahead_s: -age_s });
        }
        if let Some(newest) = self.newest.filter(|&newest| time < newest) {
            return Err(Refusal::OutOfOrder { age_s: newest.seconds_since(time) });
        }
        self.newest = Some(time);
        self.obeyed = Some((time, [left, right], curvature));
        Ok(())
    }

    /// The command to the drive at a time.
    pub fn command(&self, spec: &VehicleSpec, now: Stamp, timeout_s: f64) -> DriveCommand {
        let curvature_per_m = self.obeyed.map_or(0.0, |(_, _, curvature)| curvature);
        match self.obeyed {
            Some((time, speeds, _)) if now.seconds_since(time) <= timeout_s => {
                // Limit of the vehicle's speed: both wheels are slowed by the same factor, which preserves the
                // curvature.
                let speed = 0.5 * (speeds[0] + speeds[1]).abs();
                let part = (spec.wheels.max_speed_mps / speed.max(1e-9)).min(1.0);
                DriveCommand { drive: Drive::Speeds(speeds.map(|speed| speed * part)), curvature_per_m }
            }
            _ => DriveCommand { drive: Drive::Brake, curvature_per_m },
        }
    }
}
