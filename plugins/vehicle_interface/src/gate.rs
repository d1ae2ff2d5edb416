//! Which commands are accepted, and for how long.
//!
//! Each input has its own [`Gate`]. A refused command stops the vehicle until a valid one arrives on that input or the
//! refusal expires: after an invalid command, the sender's earlier commands are no longer trusted.

use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// A checked request of a driver: all numbers are finite and within the limits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DriveRequest {
    /// Speed along the vehicle's x axis, m/s.
    pub speed_mps: f64,
    /// Desired turn.
    pub turn: Turn,
}

/// How a request describes a turn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Turn {
    /// Heading in the local frame, radians counter-clockwise from east.
    Heading(f64),
    /// Turn rate, rad/s counter-clockwise.
    Rate(f64),
}

/// Limits of what a command may request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Maximum speed, forward or backward, m/s.
    pub speed_mps: f64,
    /// Maximum turn rate in either direction, rad/s.
    pub yaw_rate_radps: f64,
    /// Age at which a command expires, s.
    pub timeout_s: f64,
}

/// Why a command was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A number is NaN or infinite.
    #[error("{what} is {got}, expected a finite number")]
    NotFinite {
        /// Which number.
        what: &'static str,
        /// Its value.
        got: f64,
    },
    /// A number exceeds its limit.
    #[error("{what} is {got} {unit}, expected at most {limit} either way")]
    TooFast {
        /// Which number.
        what: &'static str,
        /// Its value, rounded.
        got: f64,
        /// Its unit.
        unit: &'static str,
        /// The limit, rounded.
        limit: f64,
    },
    /// Older than a command that was accepted before.
    #[error("command is {by_s:.3} s older than the one before, expected none from the past")]
    OutOfOrder {
        /// How much older, s.
        by_s: f64,
    },
    /// The command is too old.
    #[error("command is {age_s:.3} s old, expected less than {timeout_s} s")]
    Old {
        /// Its age, s.
        age_s: f64,
        /// Age at which commands expire, s.
        timeout_s: f64,
    },
    /// The time of the command is in the future.
    #[error("command is {ahead_s:.3} s ahead of the clock, expected none from the future")]
    Future {
        /// How far ahead, s.
        ahead_s: f64,
    },
}

/// The last event on an input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
enum Last {
    #[default]
    Silent,
    Good(Stamp, DriveRequest),
    Refused(Stamp),
}

/// What an input requests now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LastRequest {
    /// No command, or an expired one.
    Nothing,
    /// Drive as requested.
    Drive(DriveRequest),
    /// The last command was refused.
    Refused,
}

/// The gate of one command input: the last command, and the time of the newest accepted command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Gate {
    last: Last,
    newest: Option<Stamp>,
}

impl Gate {
    /// Takes a command with time `given`. If it is refused, returns why, and the input counts as refused.
    pub fn take(
        &mut self,
        request: DriveRequest,
        given: Stamp,
        now: Stamp,
        limits: &Limits,
    ) -> Result<(), Refusal> {
        match self.judge(&request, given, now, limits) {
            Ok(()) => {
                self.newest = Some(given);
                self.last = Last::Good(given, request);
                Ok(())
            }
            Err(refusal) => {
                self.last = Last::Refused(now);
                Err(refusal)
            }
        }
    }

    fn judge(
        &self,
        request: &DriveRequest,
        given: Stamp,
        now: Stamp,
        limits: &Limits,
    ) -> Result<(), Refusal> {
        within("speed", request.speed_mps, "m/s", limits.speed_mps)?;
        match request.turn {
            Turn::Heading(got) if !got.is_finite() => {
                return Err(Refusal::NotFinite { what: "heading", got });
            }
            Turn::Heading(_) => {}
            Turn::Rate(got) => within("turn rate", got, "rad/s", limits.yaw_rate_radps)?,
        }
        if given > now {
            return Err(Refusal::Future { ahead_s: given.seconds_since(now) });
        }
        if let Some(newest) = self.newest.filter(|&newest| given < newest) {
            return Err(Refusal::OutOfOrder { by_s: newest.seconds_since(given) });
        }
        let age_s = now.seconds_since(given);
        if age_s >= limits.timeout_s {
            return Err(Refusal::Old { age_s, timeout_s: limits.timeout_s });
        }
        Ok(())
    }

    /// The request of the input at `now`; commands and refusals expire when they are `timeout_s` old.
    pub fn last_request(&self, now: Stamp, timeout_s: f64) -> LastRequest {
        let is_fresh = |at: Stamp| now.seconds_since(at) < timeout_s;
        match self.last {
            Last::Good(given, request) if is_fresh(given) => LastRequest::Drive(request),
            Last::Refused(at) if is_fresh(at) => LastRequest::Refused,
            _ => LastRequest::Nothing,
        }
    }

    /// Forgets the last request; commands older than an accepted one are still refused.
    pub fn forget(&mut self) {
        self.last = Last::Silent;
    }
}

fn within(what: &'static str, got: f64, unit: &'static str, limit: f64) -> Result<(), Refusal> {
    if !got.is_finite() {
        return Err(Refusal::NotFinite { what, got });
    }
    if got.abs() > limit {
        let [got, limit] = rounded(got, limit);
        return Err(Refusal::TooFast { what, got, unit, limit });
    }
    Ok(())
}

/// A number and the limit that it exceeds with two decimals, or with as many more as tell them apart.
fn rounded(got: f64, limit: f64) -> [f64; 2] {
    let to = |scale: f64| [got, limit].map(|value| (value * scale).round() / scale);
    let is_apart = |[got, limit]: &[f64; 2]| got.is_finite() && got.abs() > *limit;
    [1e2, 1e3, 1e4, 1e6].into_iter().map(to).find(is_apart).unwrap_or([got, limit])
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { speed_mps: 1.3, yaw_rate_radps: 1.2, timeout_s: 0.2 };

    fn at_ms(ms: u64) -> Stamp {
        Stamp(ms * 1_000_000)
    }

    fn go(speed_mps: f64) -> DriveRequest {
        DriveRequest { speed_mps, turn: Turn::Heading(0.0) }
    }

    /// Gives a command to a gate that has accepted one at 1 s, and compares the refusal.
    fn check(request: DriveRequest, given_ms: u64, now_ms: u64, refusal: &str) {
        let mut gate = Gate::default();
        gate.take(go(0.5), at_ms(1_000), at_ms(1_000), &LIMITS).unwrap();
        let result = gate.take(request, at_ms(given_ms), at_ms(now_ms), &LIMITS);
        match result {
            Ok(()) => assert_eq!(refusal, ""),
            Err(error) => {
                assert!(!refusal.is_empty() && error.to_string().contains(refusal), "{error}");
                assert_eq!(
                    gate.last_request(at_ms(now_ms), 0.2),
                    LastRequest::Refused,
                    "nothing is obeyed after {error}"
                );
            }
        }
    }

    #[test]
    fn numbers_that_are_none_or_too_large_are_refused() {
        check(go(1.3), 1_020, 1_020, "");
        check(go(-1.3), 1_020, 1_020, "");
        check(go(f64::NAN), 1_020, 1_020, "speed is NaN");
        check(go(10.0), 1_020, 1_020, "speed is 10 m/s");
        check(go(f64::NEG_INFINITY), 1_020, 1_020, "finite");
        check(go(5.0 / 3.0), 1_020, 1_020, "speed is 1.67 m/s, expected at most 1.3 either way");
        check(go(-1.300_41), 1_020, 1_020, "speed is -1.3004 m/s, expected at most 1.3 either way");
        check(DriveRequest { speed_mps: 0.0, turn: Turn::Heading(f64::NAN) }, 1_020, 1_020, "heading is NaN");
        check(DriveRequest { speed_mps: 0.0, turn: Turn::Rate(f64::NAN) }, 1_020, 1_020, "turn rate is NaN");
        check(DriveRequest { speed_mps: 0.0, turn: Turn::Rate(-1.3) }, 1_020, 1_020, "turn rate is -1.3");
    }

    #[test]
    fn commands_of_another_time_are_refused() {
        check(go(1.0), 980, 1_020, "0.020 s older");
        check(go(1.0), 1_000, 1_020, "");
        check(go(1.0), 1_100, 1_300, "0.200 s old");
        check(go(1.0), 1_040, 1_020, "0.020 s ahead");
    }

    #[test]
    fn a_command_holds_until_it_is_too_old_and_a_refusal_ends_it_at_once() {
        let mut gate = Gate::default();
        assert_eq!(gate.last_request(at_ms(0), 0.2), LastRequest::Nothing);
        gate.take(go(1.0), at_ms(0), at_ms(20), &LIMITS).unwrap();
        assert_eq!(gate.last_request(at_ms(199), 0.2), LastRequest::Drive(go(1.0)));
        assert_eq!(gate.last_request(at_ms(200), 0.2), LastRequest::Nothing);
        gate.take(go(f64::NAN), at_ms(100), at_ms(100), &LIMITS).unwrap_err();
        assert_eq!(gate.last_request(at_ms(120), 0.2), LastRequest::Refused);
        gate.take(go(0.7), at_ms(120), at_ms(120), &LIMITS).unwrap();
        assert_eq!(gate.last_request(at_ms(120), 0.2), LastRequest::Drive(go(0.7)));
        gate.forget();
        assert_eq!(gate.last_request(at_ms(120), 0.2), LastRequest::Nothing);
    }
}
