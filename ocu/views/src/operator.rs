//! Actions of an operator on a running robot: which buffers expect commands of an operator, and the messages to write.
//!
//! The buffers are found from the process list: inputs for teleoperation and emergency stop that no process writes.

use rcs_msg::{AnyMessage, Stamp, rcs};
use rcs_runtime::InputRole;
use rcs_runtime::source::{Frame, HeldControl, SourceKind, Topic};
use std::sync::Arc;

/// Source time between two drive commands: 20 per second.
const EVERY_NS: u64 = 50_000_000;
/// Factor on the speed while Shift is held.
const SLOW: f64 = 0.3;
/// Factor on the speed backward, where visibility is worse.
const BACKWARD: f64 = 0.5;

/// The buffers that expect commands of an operator.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// Drive commands of the operator.
    pub teleop: Option<Arc<str>>,
    /// The emergency stop.
    pub emergency_stop: Option<Arc<str>>,
    /// Goals, and the bounds of driving.
    pub mission: Option<Arc<str>>,
    /// Places from which processes learn.
    pub training: Option<Arc<str>>,
}

impl Inputs {
    /// The inputs in a frame; none where no stack runs, and in a run beside the viewed one.
    pub fn of(frame: &Frame) -> Self {
        if frame.info.kind == SourceKind::Log || frame.is_beside {
            return Self::default();
        }
        let find = |role: InputRole| {
            let inputs = frame.processes.iter().flat_map(|process| &process.inputs);
            inputs
                .filter(|input| input.role == role.name())
                .map(|input| input.buffer.as_str())
                .find(|buffer| !buffer.is_empty() && !is_written(frame, buffer))
                .map(Arc::from)
        };
        Self {
            teleop: find(InputRole::Teleoperation),
            emergency_stop: find(InputRole::EmergencyStop),
            mission: find(InputRole::Mission),
            training: find(InputRole::Training),
        }
    }
}

/// Whether the process that the operator drives by hand also obeys drive commands of the stack. Then the stack takes over
/// again when the operator lets go.
pub fn stack_drives(frame: &Frame) -> bool {
    let is_teleop = |input: &rcs::PortInfo| input.role == InputRole::Teleoperation.name();
    let driven = frame.processes.iter().filter(|process| process.inputs.iter().any(is_teleop));
    let mut inputs = driven.flat_map(|process| &process.inputs);
    inputs.any(|input| {
        input.schema == "rcs.DriveCommand" && !is_teleop(input) && is_written(frame, &input.buffer)
    })
}

/// Whether a process writes a buffer.
fn is_written(frame: &Frame, buffer: &str) -> bool {
    let mut outputs = frame.processes.iter().flat_map(|process| &process.outputs);
    outputs.any(|output| output.buffer == buffer)
}

/// The vehicle status, with its topic.
pub fn vehicle(frame: &Frame) -> Option<(&Topic, &rcs::VehicleStatus)> {
    frame.topics_of_type("rcs.VehicleStatus").find_map(|topic| Some((topic, topic.get()?)))
}

/// A message that sets or releases the emergency stop.
pub fn emergency_stop(now: Stamp, active: bool) -> AnyMessage {
    let reason = if active { "the operator" } else { "" }.to_owned();
    AnyMessage::new(rcs::EmergencyStop { timestamp: Some(now.to_proto()), active, reason })
}

/// Deflection of the controls: keys, buttons on the screen, or a joystick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hand {
    /// -1 (backward) to 1 (forward).
    pub forward: f64,
    /// -1 (right) to 1 (left).
    pub left: f64,
    /// Slow mode.
    pub slow: bool,
}

impl Hand {
    /// Whether there is any deflection.
    pub fn pushes(&self) -> bool {
        self.forward != 0.0 || self.left != 0.0
    }

    /// The sum of two inputs.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self {
            forward: (self.forward + other.forward).clamp(-1.0, 1.0),
            left: (self.left + other.left).clamp(-1.0, 1.0),
            slow: self.slow || other.slow,
        }
    }
}

/// Speeds of manual driving.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveSettings {
    /// Speed at full deflection forward, m/s.
    pub speed_mps: f64,
    /// Turn rate at full deflection to the left, rad/s.
    pub turn_radps: f64,
}

/// Limits of drive commands, as the vehicle states them; the defaults where it states none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveLimits {
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Turn rate, rad/s.
    pub turn_radps: f64,
}

impl DriveLimits {
    /// The limits in a frame.
    pub fn of(frame: &Frame) -> Self {
        let status = vehicle(frame).map(|(_, status)| status);
        let stated = |limit: fn(&rcs::VehicleStatus) -> f64, usual: f64| {
            status.map(limit).filter(|limit| (0.01..=100.0).contains(limit)).unwrap_or(usual)
        };
        Self {
            speed_mps: stated(|status| status.max_speed_mps, 1.0),
            turn_radps: stated(|status| status.max_yaw_rate_radps, std::f64::consts::FRAC_PI_4),
        }
    }
}

impl Default for DriveSettings {
    fn default() -> Self {
        Self { speed_mps: 1.0, turn_radps: std::f64::consts::FRAC_PI_4 }
    }
}

impl DriveSettings {
    /// The same speeds, but none that the vehicle would refuse.
    #[must_use]
    pub fn within(self, limits: DriveLimits) -> Self {
        Self {
            speed_mps: self.speed_mps.min(limits.speed_mps),
            turn_radps: self.turn_radps.min(limits.turn_radps),
        }
    }

    /// Speed (m/s) and turn rate (rad/s, counter-clockwise) for a deflection.
    pub fn wanted(&self, hand: Hand) -> [f64; 2] {
        let part = if hand.slow { SLOW } else { 1.0 };
        let speed = self.speed_mps * hand.forward * if hand.forward < 0.0 { BACKWARD } else { 1.0 };
        [speed * part, self.turn_radps * hand.left * part]
    }
}

/// A drive command that is repeated for as long as it is held.
pub fn drive(buffer: &str, [speed_mps, yaw_rate_radps]: [f64; 2]) -> HeldControl {
    HeldControl {
        buffer: buffer.to_owned(),
        every_ns: EVERY_NS,
        make: Arc::new(move |now| {
            AnyMessage::new(rcs::DriveCommand {
                timestamp: Some(now.to_proto()),
                heading_rad: 0.0,
                speed_mps,
                yaw_rate_radps: Some(yaw_rate_radps),
            })
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;

    #[test]
    fn inputs_are_found_by_role_where_a_stack_runs_and_nobody_else_writes_them() {
        let frame = samples::driving();
        let inputs = Inputs::of(&frame);
        assert_eq!(inputs.teleop.as_deref(), Some("/operator/teleop"));
        assert_eq!(inputs.emergency_stop.as_deref(), Some("/operator/emergency_stop"));
        assert_eq!(Inputs::of(&samples::full()), Inputs::default(), "a recording cannot be driven");

        let mut written = frame.clone();
        let mut processes = written.processes.to_vec();
        let role = InputRole::Teleoperation.name();
        let teleop = processes[0].inputs.iter().find(|input| input.role == role).cloned();
        processes[1].outputs.extend(teleop);
        written.processes = processes.into();
        assert_eq!(Inputs::of(&written).teleop, None);
    }

    #[test]
    fn a_stack_drives_where_it_writes_drive_commands_to_what_is_driven_by_hand() {
        let mut frame = samples::driving();
        assert!(stack_drives(&frame));
        let only_by_hand = frame.processes.iter().filter(|process| process.name != "driver").cloned();
        frame.processes = only_by_hand.collect();
        assert!(!stack_drives(&frame));
    }

    #[test]
    fn a_hand_asks_for_less_when_slow_and_backward_and_two_hands_do_not_add_up_beyond_full() {
        let settings = DriveSettings { speed_mps: 2.0, turn_radps: 1.0 };
        let hand = |forward, left, slow| Hand { forward, left, slow };
        assert_eq!(settings.wanted(hand(1.0, 0.0, false)), [2.0, 0.0]);
        assert_eq!(settings.wanted(hand(-1.0, 0.5, false)), [-1.0, 0.5]);
        let [speed, turn] = settings.wanted(hand(1.0, -1.0, true));
        assert!((speed - 0.6).abs() < 1e-12 && (turn + 0.3).abs() < 1e-12);
        assert_eq!(hand(1.0, 1.0, false).with(hand(1.0, -1.0, true)), hand(1.0, 0.0, true));
    }

    #[test]
    fn nothing_is_commanded_that_the_vehicle_would_refuse() {
        let settings = DriveSettings { speed_mps: 3.0, turn_radps: 2.0 };
        let frame = samples::driving();
        let limits = DriveLimits::of(&frame);
        assert_eq!(limits, DriveLimits { speed_mps: 1.3, turn_radps: 1.2 });
        assert_eq!(settings.within(limits).wanted(Hand { forward: 1.0, left: 1.0, slow: false }), [1.3, 1.2]);
        assert_eq!(DriveSettings::default().within(limits), DriveSettings::default());
        assert_eq!(DriveLimits::of(&samples::full()).speed_mps, 1.0, "nothing is stated");
    }

    #[test]
    fn what_is_held_is_a_command_with_the_time_at_which_it_is_written() {
        let message = (drive("/operator/teleop", [0.5, -0.2]).make)(Stamp(7_000_000_001));
        let command: &rcs::DriveCommand = message.get().unwrap();
        assert_eq!(command.timestamp.as_ref().and_then(Stamp::from_proto), Some(Stamp(7_000_000_001)));
        assert_eq!((command.speed_mps, command.yaw_rate_radps), (0.5, Some(-0.2)));
    }
}
