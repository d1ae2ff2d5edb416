//! Traction: whether the wheels grip or spin, or a motor stalls.
//!
//! The encoders give the speed of the wheels, the inertial sensors the change of the vehicle's speed. The inertial
//! speed integrates the acceleration along the vehicle (gravity removed by the pitch) and is drawn towards the wheel
//! speed with a time constant of seconds, much more slowly while the wheels spin. Where the wheels turn around, it is
//! set to their speed: for that moment they do not spin. The accelerometer's offset (to which an error of pitch is
//! equivalent) is estimated while the vehicle stands, and, while the wheels grip, from the remaining difference between
//! both speeds. With the gyro's turn rate the inertial speed is split into the ground speeds of the two wheels. Slip is
//! the share of a wheel's motion that exceeds its ground speed; the greater of the two wheels is reported.
//!
//! Readings that are more than 0.1 s apart are not integrated: an inertial sensor slower than that tells no slip, and the
//! state is unknown.
//!
//! Limits: slip that builds up as slowly as the memory forgets, and slip that lasts, are not detected. A localization
//! that does not notice a loss of speed takes the deceleration for a tilt for a moment; therefore, after two seconds or
//! more, wheels that spin on the spot are taken to roll again. The start of the spinning is counted.

use rcs_msg::Stamp;
use rcs_sense::ClockWatch;
use serde::{Deserialize, Serialize};

/// Standard gravity, m/s².
const GRAVITY_MPS2: f64 = 9.806_65;
/// Wheels slower than this stand still, m/s.
const STANDS_MPS: f64 = 0.01;
/// With a turn rate below this the vehicle may stand still, rad/s.
const STANDS_RADPS: f64 = 0.03;
/// Averaging time of the accelerometer's offset while the vehicle stands, s.
const OFFSET_S: f64 = 1.0;
/// The offset is estimated only after this time of standing, s, because encoder readings arrive later than
/// accelerations.
const STOOD_S: f64 = 0.5;
/// Longest gap between two inertial readings that is integrated over, s.
const LONGEST_STEP_S: f64 = 0.1;
/// Factor on the time constant of the inertial speed while the wheels spin.
const SPIN_PATIENCE: f64 = 10.0;
/// Hysteresis: spinning ends when slip falls below this share of the threshold at which it starts.
const STILL_SPINS: f64 = 0.5;
/// Time constant of the offset estimate while the wheels grip, in time constants of the speed; from 4 on it does not
/// oscillate.
const OFFSET_MEMORIES: f64 = 5.0;

/// Rules of the estimate; see the parameters of the process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Distance between the driven wheels, m.
    pub track_m: f64,
    /// Time constant with which the inertial speed follows the wheel speed, s.
    pub memory_s: f64,
    /// Slip at which wheels are said to spin.
    pub spin_slip: f64,
    /// Wheels slower than this have no defined slip, m/s.
    pub min_speed_mps: f64,
    /// Current above which a motor is under high load, A.
    pub stall_current_a: f64,
    /// Wheels slower than this count as stalled, m/s.
    pub stall_speed_mps: f64,
    /// Time that a condition must last before it is reported, s.
    pub settle_s: f64,
}

/// One reading of the inertial sensors in the vehicle's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertial {
    /// Acquisition time.
    pub time: Stamp,
    /// When it came, by the clock of the run.
    pub arrived: Stamp,
    /// Specific force along the vehicle's x axis, gravity included, m/s².
    pub acceleration_mps2: f64,
    /// Turn rate about the z axis, rad/s.
    pub yaw_rate_radps: f64,
    /// Pitch; positive lowers the front, rad.
    pub pitch_rad: f64,
}

/// State of the wheels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum State {
    /// Too slow to decide, or without data.
    #[default]
    Unknown,
    /// They roll.
    Grips,
    /// They turn faster than the vehicle moves.
    Spins,
    /// A motor draws a high current while its wheel hardly turns.
    Stalled,
}

/// A condition that is reported once it has lasted; counts its starts and its total duration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Lasting {
    since: Option<Stamp>,
    is_said: bool,
    /// Number of starts.
    pub count: u64,
    /// Total duration, s.
    pub time_s: f64,
}

impl Lasting {
    /// Whether the condition is reported, given its value at `now`, `dt_s` after the previous call.
    fn look(&mut self, is_so: bool, now: Stamp, dt_s: f64, settle_s: f64) -> bool {
        if !is_so {
            (self.since, self.is_said) = (None, false);
            return false;
        }
        let since = *self.since.get_or_insert(now);
        if !self.is_said && now.seconds_since(since) >= settle_s {
            self.is_said = true;
            self.count += 1;
            self.time_s += now.seconds_since(since);
        } else if self.is_said {
            self.time_s += dt_s;
        }
        self.is_said
    }
}

/// The traction estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Traction {
    /// Speeds of the left and right wheel, m/s.
    pub wheels_mps: [f64; 2],
    /// Currents of the left and right motor, A; 0 where they are not known.
    pub motors_a: [f64; 2],
    /// Speed along the vehicle by the inertial sensors, m/s.
    pub inertial_mps: f64,
    /// Turn rate by the gyro, rad/s.
    pub yaw_rate_radps: f64,
    /// Slip, 0 to 1.
    pub slip: f64,
    /// State of the wheels.
    pub state: State,
    /// Spinning wheels.
    pub spin: Lasting,
    /// Stalled motors.
    pub stall: Lasting,
    offset_mps2: f64,
    /// How long the vehicle has stood, s.
    stood_s: f64,
    /// Mean speed of the wheels at the last inertial reading, m/s.
    before_mps: f64,
    last_inertial: Option<Stamp>,
    /// The clock of the inertial readings.
    clock: ClockWatch,
    /// The time of that reading, and at most its arrival: by it, the sensor is silent or not.
    heard: Option<Stamp>,
    /// Whether the inertial speed is more than the wheels' speed: since the start or a gap, a reading was integrated, or the
    /// vehicle stood.
    is_integrated: bool,
    last_look: Option<Stamp>,
    /// Whether slip was found in the last call, reported or not.
    slips: bool,
}

impl Traction {
    /// Mean speed of the wheels, m/s.
    pub fn wheel_speed_mps(&self) -> f64 {
        f64::midpoint(self.wheels_mps[0], self.wheels_mps[1])
    }

    /// Turn rate by the wheels, rad/s.
    pub fn wheel_yaw_rate_radps(&self, rules: &Rules) -> f64 {
        (self.wheels_mps[1] - self.wheels_mps[0]) / rules.track_m
    }

    /// Takes inertial readings in chronological order; readings older than the last one are ignored, unless that one is from
    /// the future: by it, all others would be older until the clock is there. Returns whether the clock has begun again; such a
    /// reading is one after a gap.
    pub fn take_inertial(&mut self, reading: &Inertial, rules: &Rules) -> bool {
        let Inertial { time, arrived, .. } = *reading;
        self.last_inertial = self.last_inertial.filter(|&last| last <= arrived || time > arrived);
        let begins_again = self.clock.begins_again(self.last_inertial, time);
        if begins_again {
            self.lose_inertial();
        }
        self.integrate(reading, rules);
        begins_again
    }

    fn integrate(&mut self, reading: &Inertial, rules: &Rules) {
        let Inertial { time, arrived, .. } = *reading;
        self.heard = self.heard.max(Some(time.min(arrived)));
        let dt_s = self.last_inertial.map(|last| reading.time.seconds_since(last));
        self.last_inertial = Some(self.last_inertial.map_or(reading.time, |last| last.max(reading.time)));
        let wheels = self.wheel_speed_mps();
        // At rest and level the sensor measures nothing along x; with the front down, gravity accelerates it forward.
        let free = reading.acceleration_mps2 + GRAVITY_MPS2 * libm::sin(reading.pitch_rad);
        // At the start and after a gap, the wheel speed is the best estimate.
        if dt_s.is_some_and(|dt_s| dt_s <= 0.0) {
            return;
        }
        self.yaw_rate_radps = reading.yaw_rate_radps;
        let Some(dt_s) = dt_s.filter(|&dt_s| dt_s <= LONGEST_STEP_S) else {
            (self.inertial_mps, self.is_integrated) = (wheels, false);
            return;
        };
        self.is_integrated = true;
        let stand = self.wheels_mps.iter().all(|speed| speed.abs() < STANDS_MPS);
        if stand && reading.yaw_rate_radps.abs() < STANDS_RADPS {
            self.stood_s += dt_s;
        } else {
            self.stood_s = 0.0;
        }
        if self.stood_s > STOOD_S {
            self.offset_mps2 += (free - self.offset_mps2) * (dt_s / OFFSET_S);
            self.inertial_mps = 0.0;
            return;
        }
        // Wheels that turn around do not spin at that moment: the vehicle stands with them.
        if wheels * self.before_mps < 0.0 {
            self.inertial_mps = wheels;
        }
        // Wheels that are braked to 0 have not turned around: the vehicle may still roll.
        if wheels != 0.0 {
            self.before_mps = wheels;
        }
        let memory_s = if self.slips { rules.memory_s * SPIN_PATIENCE } else { rules.memory_s };
        self.inertial_mps += (free - self.offset_mps2) * dt_s;
        let pull = (wheels - self.inertial_mps) * (dt_s / memory_s).min(1.0);
        self.inertial_mps += pull;
        if !self.slips {
            self.offset_mps2 -= pull / (OFFSET_MEMORIES * rules.memory_s);
        }
    }

    /// Without a pitch, the wheel speed is the only estimate of the speed.
    pub fn lose_inertial(&mut self) {
        (self.last_inertial, self.heard) = (None, None);
    }

    /// Evaluates the state at `now`.
    pub fn look(&mut self, now: Stamp, inertial_timeout_s: f64, rules: &Rules) {
        let dt_s = self.last_look.map_or(0.0, |last| now.seconds_since(last).max(0.0));
        self.last_look = Some(now);
        let is_inertial = self.is_integrated
            && self.heard.is_some_and(|heard| now.seconds_since(heard) <= inertial_timeout_s);
        let slip = if is_inertial { self.slip_now(rules) } else { None };
        self.slip = slip.unwrap_or(0.0);
        let least = if self.slips { rules.spin_slip * STILL_SPINS } else { rules.spin_slip };
        self.slips = slip.is_some_and(|slip| slip >= least);
        let spins = self.spin.look(self.slips, now, dt_s, rules.settle_s);
        let is_stalled = self.wheels_mps.iter().zip(&self.motors_a).any(|(speed, current)| {
            current.abs() > rules.stall_current_a && speed.abs() < rules.stall_speed_mps
        });
        let stalled = self.stall.look(is_stalled, now, dt_s, rules.settle_s);
        self.state = match (stalled, spins, slip) {
            (true, ..) => State::Stalled,
            (_, true, _) => State::Spins,
            (_, _, Some(_)) => State::Grips,
            _ => State::Unknown,
        };
    }

    /// The greater slip of the two wheels; `None` where neither is fast enough.
    fn slip_now(&self, rules: &Rules) -> Option<f64> {
        let half = self.yaw_rate_radps * rules.track_m / 2.0;
        let ground = [self.inertial_mps - half, self.inertial_mps + half];
        let fast = self.wheels_mps.iter().zip(ground).filter(|(wheel, _)| wheel.abs() >= rules.min_speed_mps);
        fast.map(|(wheel, ground)| (1.0 - ground / wheel).clamp(0.0, 1.0)).reduce(f64::max)
    }
}

#[cfg(test)]
#[path = "traction_tests.rs"]
mod tests;
