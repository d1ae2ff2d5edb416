//! Manual driving and the emergency stop: converts keys and joystick to controls for the source.

use super::joystick::Joystick;
use egui::Key;
use ocu_views::Selection;
use ocu_views::operator::{self, Hand, Inputs};
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
}

impl Operating {
    /// Whether manual driving is possible now: a stack that expects commands of an operator is running.
    pub(super) fn drives(frame: &Frame) -> bool {
        frame.playback.playing && Inputs::of(frame).teleop.is_some()
    }

    /// Resets the state for another source.
    pub(super) fn forget(&mut self) {
        (self.held, self.asked) = (None, None);
    }

    /// The deflection from keys and joystick. Escape requests an emergency stop.
    pub(super) fn take_keys(&mut self, ui: &egui::Ui, frame: &Frame, controls: &mut Vec<Control>) -> Hand {
        let inputs = Inputs::of(frame);
        if inputs.emergency_stop.is_some() && ui.input(|input| input.key_pressed(Key::Escape)) {
            self.emergency_stop(frame, true, controls);
        }
        if inputs.teleop.is_none() || !frame.playback.playing {
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
        let teleop = Inputs::of(frame).teleop.filter(|_| frame.playback.playing && selection.hand.pushes());
        let Some(teleop) = teleop else {
            if let Some((_, held)) = self.held.take() {
                controls.push(Control::LetGo(operator::drive(&held.buffer, [0.0; 2])));
            }
            return;
        };
        let wanted = selection.drive.wanted(selection.hand);
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

/// The deflection from held keys: letters unless text is being typed, arrows unless they move the keyboard focus.
fn keys(ui: &egui::Ui) -> Hand {
    let letters = !ui.ctx().text_edit_focused();
    let arrows = !ui.ctx().egui_wants_keyboard_input();
    ui.input(|input| {
        if input.modifiers.command || input.modifiers.alt {
            return Hand::default();
        }
        let down = |letter: Key, arrow: Key| {
            (letters && input.key_down(letter)) || (arrows && input.key_down(arrow))
        };
        let axis = |plus: bool, minus: bool| f64::from(i8::from(plus) - i8::from(minus));
        Hand {
            forward: axis(down(Key::W, Key::ArrowUp), down(Key::S, Key::ArrowDown)),
            left: axis(down(Key::A, Key::ArrowLeft), down(Key::D, Key::ArrowRight)),
            slow: input.modifiers.shift,
        }
    })
}
