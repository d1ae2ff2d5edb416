//! Driving by hand and the emergency stop: keys and stick come in, controls for the source go out.

use super::joystick::Joystick;
use egui::Key;
use ocu_views::Selection;
use ocu_views::operator::{self, Hand, Inputs};
use rcs_runtime::source::{Control, Frame, Held};
use std::time::{Duration, Instant};

/// What is held is said anew this often.
const RENEW: Duration = Duration::from_millis(100);
/// An emergency stop that is not confirmed is sent again this often.
const RESEND: Duration = Duration::from_millis(500);
/// Longer than this, a confirmation that has not come is an alarm.
const LATE: Duration = Duration::from_secs(1);

/// How the emergency stop stands, by what was asked and by what the vehicle says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum StopState {
    /// There is nothing to stop.
    #[default]
    None,
    /// The vehicle may move.
    Clear,
    /// The vehicle is stopped, as it says itself.
    Stopped,
    /// It was asked to stop (or to go on), and has not said so yet.
    Asked {
        /// To stop.
        active: bool,
        /// For longer than it should take.
        late: bool,
    },
}

/// What a person asked for that the vehicle has not confirmed.
#[derive(Debug)]
struct Asked {
    active: bool,
    since: Instant,
    sent: Instant,
}

/// A person's hands on a robot.
#[derive(Debug, Default)]
pub(super) struct Operating {
    /// What is being held now, and what it asks for.
    held: Option<([f64; 2], Held)>,
    asked: Option<Asked>,
    joystick: Joystick,
}

impl Operating {
    /// Whether hands drive something now: a stack that waits for them runs.
    pub(super) fn drives(frame: &Frame) -> bool {
        frame.playback.playing && Inputs::of(frame).teleop.is_some()
    }

    /// Another source is shown: nothing of it is held, and nothing was asked of it.
    pub(super) fn forget(&mut self) {
        (self.held, self.asked) = (None, None);
    }

    /// Where keys and stick push. Escape stops.
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

    /// Asks for an emergency stop, or to let the vehicle go again.
    pub(super) fn emergency_stop(&mut self, frame: &Frame, active: bool, controls: &mut Vec<Control>) {
        let now = Instant::now();
        let since = match &self.asked {
            Some(asked) if asked.active == active => asked.since,
            _ => now,
        };
        self.asked = Some(Asked { active, since, sent: now });
        send(frame, active, controls);
    }

    /// How the emergency stop stands.
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

    /// After a pass: drives by where the hands push, and sends a stop again that has not been confirmed.
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

/// What the vehicle says of its emergency stop; `None` while it has said nothing.
fn confirmed(frame: &Frame) -> Option<bool> {
    operator::vehicle(frame).map(|(_, status)| status.emergency_stopped)
}

fn send(frame: &Frame, active: bool, controls: &mut Vec<Control>) {
    if let Some(buffer) = Inputs::of(frame).emergency_stop {
        let message = operator::emergency_stop(frame.now, active);
        controls.push(Control::Write { buffer: buffer.to_string(), message });
    }
}

/// Where the keys push that are held: letters unless text is being typed, arrows unless they move between widgets.
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
