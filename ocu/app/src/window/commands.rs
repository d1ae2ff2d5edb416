//! The table of the window's commands. Menus, palette, keys and their list are made from it.

use super::shortcut::Shortcut;
use egui::{Key, Modifiers};

/// What a command does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Command {
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
    /// Go to the next event.
    NextEvent {
        back: bool,
    },
    /// Set a bookmark, or remove it.
    Bookmark,
    ToStart,
    ToEnd,
    Loop,
    Open,
    /// Open the simulation on its own course.
    Simulation,
    Restart,
    /// Start the next run with what this one remembers.
    NextRun,
    /// Save what this run remembers.
    SaveRemembered,
    /// Begin to record, or end the recording.
    Record,
    /// Silence the alarms that there are.
    Silence,
    /// Switch the sound of alarms on or off.
    AlarmSound,
    /// Undo the last write into the run.
    TakeBack,
    EmergencyStop,
    /// Close menus and dialogs, and leave a field.
    Cancel,
    Buffers,
    FittingLayout,
    ResetLayout,
    UndoLayout,
    RedoLayout,
    Theme,
    /// Everything in the window larger.
    Larger,
    /// Everything in the window smaller.
    Smaller,
    /// Everything in the window in its usual size.
    UsualSize,
    Palette,
    Keys,
}

/// What a command needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Needs {
    Nothing,
    /// An open source that can be played.
    Source,
    /// A stack that runs.
    Stack,
    /// A vehicle with an emergency stop.
    Vehicle,
}

/// Heading in the list of keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Group {
    Safety,
    Time,
    Source,
    Window,
}

impl Group {
    pub(super) const ALL: [Self; 4] = [Self::Safety, Self::Time, Self::Source, Self::Window];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Safety => "Vehicle",
            Self::Time => "Time",
            Self::Source => "Source",
            Self::Window => "Window",
        }
    }
}

/// One command.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    pub(super) command: Command,
    /// Name in files; it must never change.
    pub(super) id: &'static str,
    /// Name as shown.
    pub(super) name: &'static str,
    pub(super) group: Group,
    pub(super) needs: Needs,
    /// The keys by default.
    pub(super) keys: &'static [Shortcut],
}

/// A key with its modifiers, one or two: `key!(SHIFT ArrowLeft)`.
macro_rules! key {
    ($modifiers:ident $key:ident) => {
        Shortcut { modifiers: Modifiers::$modifiers, key: Key::$key }
    };
    ($first:ident $second:ident $key:ident) => {
        Shortcut { modifiers: Modifiers::$first.plus(Modifiers::$second), key: Key::$key }
    };
}

const fn entry(
    command: Command,
    id: &'static str,
    name: &'static str,
    group: Group,
    needs: Needs,
    keys: &'static [Shortcut],
) -> Entry {
    Entry { command, id, name, group, needs, keys }
}

/// All commands, in the order of lists.
pub(super) const COMMANDS: &[Entry] = {
    use Command as C;
    use Group::{Safety, Source, Time, Window};
    use Needs as N;
    &[
        entry(C::EmergencyStop, "emergency_stop", "Emergency stop", Safety, N::Vehicle, &[key!(NONE Escape)]),
        entry(C::Silence, "silence", "Silence the alarms", Safety, N::Stack, &[key!(COMMAND M)]),
        entry(C::AlarmSound, "alarm_sound", "Sound of alarms on or off", Safety, N::Nothing, &[]),
        entry(C::PlayPause, "play", "Play or pause", Time, N::Source, &[key!(NONE Space)]),
        entry(C::Step { back: false }, "forward", "Step forward", Time, N::Source, &[key!(NONE ArrowRight)]),
        entry(C::Step { back: true }, "back", "Step back", Time, N::Source, &[key!(NONE ArrowLeft)]),
        entry(
            C::StepCycle { back: false },
            "cycle_forward",
            "Forward by a cycle of a process",
            Time,
            N::Source,
            &[key!(SHIFT ArrowRight)],
        ),
        entry(
            C::StepCycle { back: true },
            "cycle_back",
            "Back by a cycle of a process",
            Time,
            N::Source,
            &[key!(SHIFT ArrowLeft)],
        ),
        entry(
            C::StepSecond { back: false },
            "second_forward",
            "Forward by a second",
            Time,
            N::Source,
            &[key!(NONE Period)],
        ),
        entry(
            C::StepSecond { back: true },
            "second_back",
            "Back by a second",
            Time,
            N::Source,
            &[key!(NONE Comma)],
        ),
        entry(
            C::NextEvent { back: false },
            "next_event",
            "To the next event",
            Time,
            N::Source,
            &[key!(NONE N)],
        ),
        entry(
            C::NextEvent { back: true },
            "last_event",
            "To the event before",
            Time,
            N::Source,
            &[key!(SHIFT N)],
        ),
        entry(C::Bookmark, "bookmark", "Set a bookmark, or remove it", Time, N::Source, &[key!(NONE M)]),
        entry(C::ToStart, "start", "To the start", Time, N::Source, &[key!(NONE Home)]),
        entry(C::ToEnd, "end", "To the end", Time, N::Source, &[key!(NONE End)]),
        entry(C::Loop, "loop", "Start again at the end, or stop there", Time, N::Source, &[key!(NONE L)]),
        entry(C::Open, "open", "Open a recording or a stack", Source, N::Nothing, &[key!(COMMAND O)]),
        entry(C::Simulation, "simulation", "Open the simulation", Source, N::Nothing, &[]),
        entry(C::Restart, "restart", "Start again from the beginning", Source, N::Stack, &[]),
        entry(C::NextRun, "next_run", "Next run, with what this one remembers", Source, N::Stack, &[]),
        entry(C::SaveRemembered, "save_remembered", "Save what this run remembers…", Source, N::Source, &[]),
        entry(C::TakeBack, "take_back", "Take the last write back", Source, N::Stack, &[]),
        entry(
            C::Record,
            "record",
            "Record the run, or end the recording",
            Source,
            N::Stack,
            &[key!(COMMAND R)],
        ),
        entry(C::Palette, "palette", "Find a command", Window, N::Nothing, &[key!(COMMAND K)]),
        entry(
            C::Keys,
            "keys",
            "List the keys",
            Window,
            N::Nothing,
            &[key!(NONE Questionmark), key!(SHIFT Questionmark)],
        ),
        entry(
            C::Cancel,
            "cancel",
            "Close menus and dialogs, leave a field",
            Window,
            N::Nothing,
            &[key!(COMMAND Period)],
        ),
        entry(C::Buffers, "buffers", "Show or hide the buffers", Window, N::Nothing, &[key!(NONE B)]),
        entry(
            C::UndoLayout,
            "undo_layout",
            "Undo the last change of the layout",
            Window,
            N::Nothing,
            &[key!(COMMAND Z)],
        ),
        entry(
            C::RedoLayout,
            "redo_layout",
            "Redo the change of the layout",
            Window,
            N::Nothing,
            &[key!(COMMAND Y)],
        ),
        entry(C::FittingLayout, "fitting_layout", "The layout that fits the source", Window, N::Source, &[]),
        entry(C::ResetLayout, "reset_layout", "Reset the layout to how it comes", Window, N::Nothing, &[]),
        entry(C::Theme, "theme", "Dark or light colours", Window, N::Nothing, &[]),
        // On an English keyboard, `=` is the key of `+`, which needs shift.
        entry(
            C::Larger,
            "larger",
            "Larger (zoom of the window)",
            Window,
            N::Nothing,
            &[key!(COMMAND Plus), key!(COMMAND SHIFT Plus), key!(COMMAND Equals)],
        ),
        entry(
            C::Smaller,
            "smaller",
            "Smaller (zoom of the window)",
            Window,
            N::Nothing,
            &[key!(COMMAND Minus)],
        ),
        entry(
            C::UsualSize,
            "usual_size",
            "Usual size (zoom of the window)",
            Window,
            N::Nothing,
            &[key!(COMMAND Num0)],
        ),
    ]
};

/// The entry of a command.
pub(super) fn entry_of(command: Command) -> Option<&'static Entry> {
    COMMANDS.iter().find(|entry| entry.command == command)
}

/// Keys that act while they are held, for the list of keys.
pub(super) const HELD: &[(&str, &str)] =
    &[("W A S D", "Drive, while time runs and the stack can be driven by hand"), ("shift", "Drive slowly")];

#[cfg(test)]
mod tests {
    use super::*;

    /// All commands of the enum, in both directions where they have one. It does not compile without each of them.
    macro_rules! every {
        (@both $name:ident) => { vec![Command::$name] };
        (@both $name:ident $back:ident) => {
            vec![Command::$name { $back: false }, Command::$name { $back: true }]
        };
        ($($name:ident $({ $back:ident })?),+ $(,)?) => {{
            for entry in COMMANDS {
                let ($(Command::$name $({ $back: _ })?)|+) = entry.command;
            }
            [$(every!(@both $name $($back)?)),+].concat()
        }};
    }

    #[test]
    fn every_command_is_listed_once_and_no_two_have_one_key() {
        let every = every![
            PlayPause,
            Step { back },
            StepCycle { back },
            StepSecond { back },
            NextEvent { back },
            Bookmark,
            ToStart,
            ToEnd,
            Loop,
            Open,
            Simulation,
            Restart,
            NextRun,
            SaveRemembered,
            Record,
            Silence,
            AlarmSound,
            TakeBack,
            EmergencyStop,
            Cancel,
            Buffers,
            FittingLayout,
            ResetLayout,
            UndoLayout,
            RedoLayout,
            Theme,
            Larger,
            Smaller,
            UsualSize,
            Palette,
            Keys,
        ];
        for command in every {
            assert!(entry_of(command).is_some(), "{command:?} is not listed");
        }
        for (index, entry) in COMMANDS.iter().enumerate() {
            for other in &COMMANDS[..index] {
                assert!(entry.id != other.id && entry.command != other.command, "{}", entry.id);
                assert_ne!(entry.name, other.name);
                let both = entry.keys.iter().find(|key| other.keys.contains(key));
                assert!(both.is_none(), "{} and {}", entry.id, other.id);
            }
        }
    }

    #[test]
    fn no_key_of_driving_is_the_key_of_a_command() {
        for key in [Key::W, Key::A, Key::S, Key::D] {
            let taken = COMMANDS.iter().flat_map(|entry| entry.keys).any(|shortcut| shortcut.key == key);
            assert!(!taken, "{key:?}");
        }
    }
}
