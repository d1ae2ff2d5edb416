//! Manual driving and the emergency stop: converts keys and joystick to controls for the source.

use super::joystick::Joystick;
use egui::Key;
use ocu_views::Selection;
use ocu_views::operator::{self, DriveLimits, Hand, Inputs};
use rcs_runtime::source::{Control, Frame, HeldControl};
use std::time::{Duration, Instant};

/// Interval at which a held command is repeated.
const RENEW: Duration = Duration::from_millis(100);
/// Interval at which an unconfirmed emergency stop is sent again.
const RESEND: Duration = Duration::from_millis(500);
/// After this time, a missing confirmation is shown as an alarm.
const LATE: Duration = Duration::from_secs(1);

/// State of the emergency stop, from the user's request and the vehicle's status.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum StopState {
    /// No process has an emergency stop.
    #[default]
    None,
    /// The vehicle may move.
    Clear,
    /// The vehicle reports that it is stopped.
    Stopped,
    /// The stop (or its release) was requested, and the vehicle has not confirmed it yet.
    Asked {
        /// Whether a stop was requested, rather than a release.
        active: bool,
        /// Whether the confirmation is overdue.
        late: bool,
    },
}

/// A request that the vehicle has not confirmed.
#[derive(Debug)]
struct Asked {
    active: bool,
    since: Instant,
    sent: Instant,
}

/// State of manual operation.
#[derive(Debug, Default)]
pub(super) struct Operating {
    /// The command being held, and the deflection from which it was made.
    held: Option<([f64; 2], HeldControl)>,
    asked: Option<Asked>,
    joystick: Joystick,
    /// Whether the controls must be neutral before they drive: after a stop, a pause, and at the start.
    wait_for_neutral: bool,
    /// Whether a control was deflected in the last pass.
    pushed: bool,
}

impl Operating {
    /// Resets the state for another source.
    pub(super) fn forget(&mut self) {
        (self.held, self.asked) = (None, None);
        (self.wait_for_neutral, self.pushed) = (true, false);
    }

    /// Whether a control is deflected that must be let go before anything drives.
    pub(super) fn is_blocked(&self) -> bool {
        self.wait_for_neutral && self.pushed
    }

    /// Whether a control is deflected.
    pub(super) fn is_pushed(&self) -> bool {
        self.pushed
    }

    /// The deflection from keys and joystick.
    pub(super) fn take_keys(&mut self, ui: &egui::Ui, frame: &Frame) -> Hand {
        let inputs = Inputs::of(frame);
        if inputs.teleop.is_none() {
            return Hand::default();
        }
        self.joystick.start(ui.ctx());
        keys(ui).with(self.joystick.hand())
    }

    /// Requests an emergency stop, or its release.
    pub(super) fn emergency_stop(&mut self, frame: &Frame, active: bool, controls: &mut Vec<Control>) {
        let now = Instant::now();
        let since = match &self.asked {
            Some(asked) if asked.active == active => asked.since,
            _ => now,
        };
        self.asked = Some(Asked { active, since, sent: now });
        send(frame, active, controls);
    }

    /// State of the emergency stop.
    pub(super) fn stop_state(&self, frame: &Frame) -> StopState {
        if Inputs::of(frame).emergency_stop.is_none() {
            return StopState::None;
        }
        match &self.asked {
            Some(asked) if Some(asked.active) != confirmed(frame) => StopState::Asked {
                active: asked.active,
                late: frame.playback.playing && asked.since.elapsed() > LATE,
            },
            _ if confirmed(frame) == Some(true) => StopState::Stopped,
            _ => StopState::Clear,
        }
    }

    /// Called after each pass: sends the drive command for the deflection, and repeats an unconfirmed stop.
    pub(super) fn finish(
        &mut self,
        ui: &egui::Ui,
        frame: &Frame,
        selection: &Selection,
        controls: &mut Vec<Control>,
    ) {
        if let Some(asked) = &mut self.asked {
            if confirmed(frame) == Some(asked.active) {
                self.asked = None;
            } else if frame.playback.playing {
                ui.ctx().request_repaint_after(RESEND);
                if asked.sent.elapsed() >= RESEND {
                    asked.sent = Instant::now();
                    send(frame, asked.active, controls);
                }
            }
        }
        let inputs = Inputs::of(frame);
        let may_drive =
            frame.playback.playing && matches!(self.stop_state(frame), StopState::None | StopState::Clear);
        self.pushed = selection.hand.pushes();
        // Releasing a stop, or letting time run, must not start motion because a control is still deflected.
        self.wait_for_neutral = !may_drive || (self.wait_for_neutral && self.pushed);
        let teleop = inputs.teleop.filter(|_| self.pushed && !self.wait_for_neutral);
        let Some(teleop) = teleop else {
            if let Some((_, held)) = self.held.take() {
                controls.push(Control::LetGo(operator::drive(&held.buffer, [0.0; 2])));
            }
            return;
        };
        let wanted = selection.drive.within(DriveLimits::of(frame)).wanted(selection.hand);
        let held = match &self.held {
            Some((same, held)) if *same == wanted && *held.buffer == *teleop => held.clone(),
            _ => operator::drive(&teleop, wanted),
        };
        self.held = Some((wanted, held.clone()));
        controls.push(Control::Hold(held));
        ui.ctx().request_repaint_after(RENEW);
    }
}

/// The emergency stop as reported by the vehicle; `None` without a report.
fn confirmed(frame: &Frame) -> Option<bool> {
    operator::vehicle(frame).map(|(_, status)| status.emergency_stopped)
}

fn send(frame: &Frame, active: bool, controls: &mut Vec<Control>) {
    if let Some(buffer) = Inputs::of(frame).emergency_stop {
        let message = operator::emergency_stop(frame.now, active);
        controls.push(Control::Write { buffer: buffer.to_string(), message });
    }
}

/// The deflection from held keys; none while text is typed. Arrow keys never drive: they step.
fn keys(ui: &egui::Ui) -> Hand {
    if ui.ctx().text_edit_focused() {
        return Hand::default();
    }
    ui.input(|input| {
        if input.modifiers.command || input.modifiers.alt {
            return Hand::default();
        }
        let axis = |plus: Key, minus: Key| {
            f64::from(i8::from(input.key_down(plus)) - i8::from(input.key_down(minus)))
        };
        Hand { forward: axis(Key::W, Key::S), left: axis(Key::A, Key::D), slow: input.modifiers.shift }
    })
}
