//! Keyboard shortcuts, and their list.

use egui::{Key, Modifiers};

/// Action of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    PlayPause,
    /// Step by the unit selected in the timeline.
    Step {
        back: bool,
    },
    /// Step by a cycle of the selected process, or of any.
    StepCycle {
        back: bool,
    },
    /// Step by a second.
    StepSecond {
        back: bool,
    },
    ToStart,
    ToEnd,
    Loop,
    Open,
    Help,
}

impl Action {
    /// Whether the action belongs to an arrow key.
    pub(super) fn is_arrow(self) -> bool {
        matches!(self, Self::Step { .. } | Self::StepCycle { .. })
    }
}

/// Keys that act while they are held, or elsewhere, with descriptions.
const OTHERS: &[(&str, &str)] = &[
    ("W A S D ↑ ← ↓ →", "drive, while time runs and the stack can be driven by hand"),
    ("shift", "drive slowly"),
    ("esc", "emergency stop"),
];

/// All keys that act when pressed, with descriptions and actions.
pub(super) const KEYS: &[(Modifiers, Key, &str, &str, Action)] = &[
    (Modifiers::NONE, Key::Space, "space", "play or pause", Action::PlayPause),
    (Modifiers::NONE, Key::ArrowRight, "→", "step forward", Action::Step { back: false }),
    (Modifiers::NONE, Key::ArrowLeft, "←", "step back", Action::Step { back: true }),
    (
        Modifiers::SHIFT,
        Key::ArrowRight,
        "shift →",
        "forward by a cycle of a process",
        Action::StepCycle { back: false },
    ),
    (
        Modifiers::SHIFT,
        Key::ArrowLeft,
        "shift ←",
        "back by a cycle of a process",
        Action::StepCycle { back: true },
    ),
    (Modifiers::NONE, Key::Period, ".", "forward by a second", Action::StepSecond { back: false }),
    (Modifiers::NONE, Key::Comma, ",", "back by a second", Action::StepSecond { back: true }),
    (Modifiers::NONE, Key::Home, "home", "to the start", Action::ToStart),
    (Modifiers::NONE, Key::End, "end", "to the end", Action::ToEnd),
    (Modifiers::NONE, Key::L, "L", "start again at the end, or stop there", Action::Loop),
    (Modifiers::COMMAND, Key::O, "ctrl O", "open a recording or a stack", Action::Open),
    (Modifiers::SHIFT, Key::Questionmark, "?", "list the keys", Action::Help),
    (Modifiers::NONE, Key::Questionmark, "?", "list the keys", Action::Help),
];

/// Actions of the keys pressed in this pass; none while text is being typed.
pub(super) fn pressed(ui: &egui::Ui) -> Vec<Action> {
    if ui.ctx().egui_wants_keyboard_input() {
        return Vec::new();
    }
    let mut actions = Vec::new();
    ui.input_mut(|input| {
        input.events.retain(|event| {
            let egui::Event::Key { key, pressed: true, modifiers, .. } = event else { return true };
            // The modifiers of this event are used, because with slow passes they may have been released by the end of
            // the pass. They must match exactly, so that a shifted arrow is not a plain one.
            let entry = KEYS.iter().find(|(wanted, k, ..)| k == key && modifiers.matches_exact(*wanted));
            actions.extend(entry.map(|&(.., action)| action));
            entry.is_none()
        });
    });
    actions
}

/// The list of keys, for a menu.
pub(super) fn list(ui: &mut egui::Ui) {
    egui::Grid::new("keys").num_columns(2).spacing([16.0, 4.0]).show(ui, |ui| {
        let mut last = "";
        for (_, _, name, help, _) in KEYS {
            if *name != last {
                ui.label(ocu_ui::widgets::mono(*name));
                ui.label(*help);
                ui.end_row();
            }
            last = name;
        }
        for (name, help) in OTHERS {
            ui.label(ocu_ui::widgets::mono(*name));
            ui.label(*help);
            ui.end_row();
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_entries_claim_one_key() {
        for (index, (modifiers, key, ..)) in KEYS.iter().enumerate() {
            let again = KEYS[..index].iter().any(|(m, k, ..)| m == modifiers && k == key);
            assert!(!again, "{key:?}");
        }
    }
}
