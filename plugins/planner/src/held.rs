//! Whether something other than the follower holds the vehicle or drives it.

use rcs_msg::rcs::VehicleStatus;
use rcs_sense::stop_reason;

/// Reasons of the vehicle interface to stop the vehicle that follow from a silence of the follower, from a turn on the
/// spot that the vehicle cannot make, or from a bumper hit, with which a mode begins that is to go on. A refused command
/// is not among them: no mode gets the vehicle going again.
const OWN_REASONS: [&str; 3] = [stop_reason::BUMPER, stop_reason::NO_COMMAND, stop_reason::ON_THE_SPOT];

/// Whether something other than the follower holds the vehicle, drives it by hand, or slows it down so much that it would be
/// taken for stuck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Held {
    Not,
    Otherwise,
    /// The operator drives it by hand: no mode drives it, nor bars a place.
    ByHand,
    ByEmergency,
}

impl Held {
    /// By the vehicle's status and the lowest speed at which it is not too slow, m/s.
    pub(crate) fn of(vehicle: Option<&VehicleStatus>, min_speed_mps: f64) -> Held {
        let Some(vehicle) = vehicle else { return Held::Not };
        let is_held = vehicle.stopped && !OWN_REASONS.contains(&vehicle.stop_reason.as_str());
        // 0 where the vehicle states no limit.
        let is_slow = vehicle.max_speed_mps > 0.0 && vehicle.max_speed_mps < min_speed_mps;
        match vehicle {
            _ if vehicle.emergency_stopped => Held::ByEmergency,
            _ if vehicle.teleoperated => Held::ByHand,
            _ if is_held || is_slow => Held::Otherwise,
            _ => Held::Not,
        }
    }

    /// Whether no mode may be active meanwhile.
    pub(crate) fn ends_modes(self) -> bool {
        matches!(self, Held::ByHand | Held::ByEmergency)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_follows_from_its_own_commands_does_not_hold_it_and_an_operator_who_drives_does() {
        let status = |stop_reason: &str, teleoperated: bool| VehicleStatus {
            stopped: !stop_reason.is_empty(),
            stop_reason: stop_reason.to_owned(),
            teleoperated,
            ..VehicleStatus::default()
        };
        let held = |status: &VehicleStatus| Held::of(Some(status), 0.0);
        assert_eq!(Held::of(None, 0.0), Held::Not);
        assert_eq!(held(&status("", false)), Held::Not);
        assert_eq!(held(&status(stop_reason::BUMPER, false)), Held::Not);
        assert_eq!(held(&status(stop_reason::ON_THE_SPOT, false)), Held::Not);
        assert_eq!(held(&status(stop_reason::REFUSED, false)), Held::Otherwise);
        assert_eq!(held(&status("imu silent for 1.0 s", false)), Held::Otherwise);
        assert_eq!(held(&status("the speed limit is 0 m/s", false)), Held::Otherwise);
        assert_eq!(held(&status("", true)), Held::ByHand);
        assert_eq!(held(&status(stop_reason::BUMPER, true)), Held::ByHand, "the operator touches something");
        let stopped = VehicleStatus { emergency_stopped: true, ..status("emergency stop: a person", false) };
        assert_eq!(held(&stopped), Held::ByEmergency);
        let slow = VehicleStatus { max_speed_mps: 0.1, ..VehicleStatus::default() };
        assert_eq!((held(&slow), Held::of(Some(&slow), 0.25)), (Held::Not, Held::Otherwise));
    }
}
