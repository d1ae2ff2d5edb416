//! The keys of the commands: the defaults, and what the user has changed, in a file of its own.
//!
//! One rule says what a key means where several things could use it:
//! - Escape stops the vehicle where there is one that can be stopped, and then does nothing else; elsewhere it closes
//!   menus and dialogs and leaves fields.
//! - While a text is typed, or a menu or a dialog with a text field is open, only keys that cannot be typed act.
//! - A widget with the keyboard focus keeps the keys that operate it (space, enter, tab, arrows, home, end).

use super::commands::{COMMANDS, Command, Entry};
use super::shortcut::Shortcut;
use crate::layout::write_whole;
use egui::{Event, Key};
use ocu_ui::typing;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// A key that comes down within this time after the window got the focus may have been held in another window before,
/// s: a held key repeats after at most this time.
const FOCUS_S: f64 = 0.7;

/// The keys of all commands.
#[derive(Debug, Default)]
pub(super) struct Keymap {
    /// The keys that differ from the defaults, by the command's name in files.
    changed: BTreeMap<String, Vec<Shortcut>>,
    file: Option<PathBuf>,
    /// Whether the file cannot be used. It is not written over until the user asks for the defaults.
    is_unreadable: bool,
    /// The keys that are down, by their place on the keyboard.
    down: BTreeSet<Key>,
    /// What the keys mean that were held before the window got the focus, and still are, by their place.
    from_elsewhere: BTreeMap<Key, Key>,
    /// When the window got the focus, in egui's time, s.
    focused_s: Option<f64>,
}

impl Keymap {
    /// Reads the user's keys; also an error for what cannot be used.
    pub(super) fn load(file: Option<PathBuf>) -> (Self, Option<String>) {
        let mut keymap = Self { file, ..Self::default() };
        let Some(path) = keymap.file.clone().filter(|path| path.exists()) else { return (keymap, None) };
        let shown = path.display().to_string();
        let read = crate::assets::read_text(&path);
        let error = match read.and_then(|text| parse(&text)) {
            Ok(changed) => {
                keymap.changed = changed;
                None
            }
            Err(error) => {
                keymap.is_unreadable = true;
                let text = "the keys that were changed cannot be used, and no change is kept until the file \
                            is mended, or set aside by The usual keys in the list of keys";
                Some(format!("{text}: {error}: {shown}"))
            }
        };
        (keymap, error)
    }

    /// The keys of a command.
    pub(super) fn keys<'a>(&'a self, entry: &'a Entry) -> &'a [Shortcut] {
        self.changed.get(entry.id).map_or(entry.keys, Vec::as_slice)
    }

    /// The first key of a command as text; empty if it has none.
    pub(super) fn text(&self, command: Command) -> String {
        let entry = super::commands::entry_of(command);
        let first = entry.and_then(|entry| self.keys(entry).first());
        first.map(ToString::to_string).unwrap_or_default()
    }

    /// The command with this key.
    pub(super) fn owner(&self, shortcut: Shortcut) -> Option<&'static Entry> {
        COMMANDS.iter().find(|entry| self.keys(entry).contains(&shortcut))
    }

    /// Whether there is anything to reset: keys that differ from the defaults, or a file that cannot be used.
    pub(super) fn can_be_reset(&self) -> bool {
        !self.changed.is_empty() || self.is_unreadable
    }

    /// Gives a command one key, which another command loses. The emergency stop keeps its key.
    pub(super) fn set(&mut self, entry: &Entry, shortcut: Shortcut) -> Result<(), String> {
        if entry.command == Command::EmergencyStop || shortcut.key == Key::Escape {
            return Err("the emergency stop keeps esc, and esc stays its key".to_owned());
        }
        if [Key::W, Key::A, Key::S, Key::D].contains(&shortcut.key) && !shortcut.is_untypable() {
            return Err(format!("{shortcut} drives"));
        }
        if let Some(owner) = self.owner(shortcut).filter(|owner| owner.id != entry.id) {
            let rest = self.keys(owner).iter().copied().filter(|key| *key != shortcut).collect();
            self.changed.insert(owner.id.to_owned(), rest);
        }
        self.changed.insert(entry.id.to_owned(), vec![shortcut]);
        self.save()
    }

    /// Returns to the defaults. A file that cannot be used is kept with `.old` at the end of its name.
    pub(super) fn reset(&mut self) -> Result<(), String> {
        self.changed.clear();
        if let Some(path) = self.file.as_ref().filter(|path| self.is_unreadable && path.exists()) {
            let set_aside = std::fs::rename(path, path.with_extension("ron.old"));
            set_aside.map_err(|error| format!("cannot be set aside: {error}: {}", path.display()))?;
        }
        self.is_unreadable = false;
        self.save()
    }

    fn save(&self) -> Result<(), String> {
        let Some(path) = &self.file else { return Ok(()) };
        if self.is_unreadable {
            return Err("not kept: keys.ron cannot be read".to_owned());
        }
        let texts = |keys: &Vec<Shortcut>| keys.iter().map(ToString::to_string).collect::<Vec<_>>();
        let changed: BTreeMap<&String, Vec<String>> =
            self.changed.iter().map(|(id, keys)| (id, texts(keys))).collect();
        let text = ron::ser::to_string_pretty(&changed, ron::ser::PrettyConfig::new());
        let text = text.map_err(|error| error.to_string())?;
        write_whole(path, &(text + "\n")).map_err(|error| error.to_string())
    }

    /// Marks which presses of this pass are repeats of a key that is held, by its place on the keyboard. egui marks them by
    /// what the key means: a question mark that is released without shift, as a slash, would stay down. Also notes the
    /// keys that are held while another window has the focus: they repeat in this one as soon as it has the focus.
    pub(super) fn mark_repeats(&mut self, ctx: &egui::Context) {
        ctx.input_mut(|input| {
            let now_s = input.time;
            for event in &mut input.events {
                match event {
                    Event::Key { key, physical_key, pressed, repeat, .. } => {
                        let place = physical_key.unwrap_or(*key);
                        if *pressed {
                            *repeat = !self.down.insert(place);
                            let is_new = self.focused_s.is_some_and(|since_s| now_s - since_s < FOCUS_S);
                            if is_new && !*repeat && *key != Key::Escape {
                                self.from_elsewhere.insert(place, *key);
                            }
                        } else {
                            self.down.remove(&place);
                            self.from_elsewhere.remove(&place);
                        }
                    }
                    // What is released elsewhere is not told.
                    Event::WindowFocused(false) => {
                        self.down.clear();
                        self.from_elsewhere.clear();
                    }
                    Event::WindowFocused(true) => self.focused_s = Some(now_s),
                    _ => {}
                }
            }
        });
    }

    /// Whether one of these keys was held before the window got the focus, and still is.
    pub(super) fn is_from_elsewhere(&self, keys: &[Key]) -> bool {
        self.from_elsewhere.values().any(|key| keys.contains(key))
    }

    /// The commands of the keys that were pressed in this pass; their events are consumed. `stops` says whether there
    /// is a vehicle that Escape stops.
    pub(super) fn pressed(&self, ctx: &egui::Context, stops: bool) -> Vec<Command> {
        let types = typing::takes_keys(ctx);
        let has_focus = ctx.memory(|memory| memory.focused().is_some());
        let mut commands = Vec::new();
        ctx.input_mut(|input| {
            input.events.retain(|event| {
                let Event::Key { key, physical_key, pressed: true, modifiers, repeat } = event else {
                    return true;
                };
                // The modifiers of this event are used: with slow passes they may have been released by now.
                if *key == Key::Escape {
                    if stops {
                        commands.push(Command::EmergencyStop);
                    }
                    return !stops;
                }
                if self.from_elsewhere.contains_key(&physical_key.unwrap_or(*key)) {
                    return true;
                }
                let found = COMMANDS.iter().find_map(|entry| {
                    let mut keys = self.keys(entry).iter().copied();
                    Some((entry, keys.find(|keys| keys.is(*modifiers, *key))?))
                });
                let Some((entry, shortcut)) = found else { return true };
                if (types && !shortcut.is_untypable()) || (has_focus && shortcut.belongs_to_focus()) {
                    return true;
                }
                let repeats = matches!(
                    entry.command,
                    Command::Step { .. }
                        | Command::StepCycle { .. }
                        | Command::StepSecond { .. }
                        | Command::Larger
                        | Command::Smaller
                );
                if !repeat || repeats {
                    commands.push(entry.command);
                }
                false
            });
        });
        commands
    }
}

fn parse(text: &str) -> Result<BTreeMap<String, Vec<Shortcut>>, String> {
    let read: BTreeMap<String, Vec<String>> = ron::from_str(text).map_err(|error| error.to_string())?;
    let mut changed = BTreeMap::new();
    for (id, keys) in read {
        if !COMMANDS.iter().any(|entry| entry.id == id) {
            return Err(format!("no command is called {id:?}"));
        }
        let keys = keys.iter().map(|key| Shortcut::parse(key)).collect::<Result<Vec<_>, _>>()?;
        changed.insert(id, keys);
    }
    Ok(changed)
}

#[cfg(test)]
mod tests {
    use super::super::commands::entry_of;
    use super::*;
    use egui::Modifiers;

    /// The commands of a pass with one event.
    fn commands_of(ctx: &egui::Context, keymap: &mut Keymap, event: Event) -> Vec<Command> {
        commands_at(ctx, keymap, event, None)
    }

    /// The commands of a pass with one event at this time, s, where a vehicle can be stopped if it has a time.
    fn commands_at(
        ctx: &egui::Context,
        keymap: &mut Keymap,
        event: Event,
        time_s: Option<f64>,
    ) -> Vec<Command> {
        let input = egui::RawInput { events: vec![event], time: time_s, ..egui::RawInput::default() };
        let mut commands = Vec::new();
        let output = ctx.run_ui(input, |ui| {
            keymap.mark_repeats(ui.ctx());
            commands.extend(keymap.pressed(ui.ctx(), time_s.is_some()));
        });
        output.drop_without_applying_deltas();
        commands
    }

    #[test]
    fn changed_keys_survive_a_restart_and_the_old_owner_loses_its_key() {
        let dir = tempfile::tempdir().unwrap();
        let file = Some(dir.path().join("keys.ron"));
        let (mut keymap, error) = Keymap::load(file.clone());
        assert_eq!(error, None);
        let (play, looped) = (entry_of(Command::PlayPause).unwrap(), entry_of(Command::Loop).unwrap());
        keymap.set(play, Shortcut::parse("L").unwrap()).unwrap();
        let (again, error) = Keymap::load(file.clone());
        assert_eq!(error, None);
        assert_eq!((again.text(Command::PlayPause), again.text(Command::Loop)), ("L".into(), String::new()));
        assert_eq!(again.owner(Shortcut::parse("L").unwrap()).map(|entry| entry.id), Some(play.id));
        keymap.reset().unwrap();
        assert_eq!(Keymap::load(file.clone()).0.keys(looped), looped.keys);

        for (text, part) in [("{\"fly\": [\"L\"]}", "fly"), ("{\"play\": [\"hyper\"]}", "hyper"), ("}", "")] {
            std::fs::write(file.as_ref().unwrap(), text).unwrap();
            let (keymap, error) = Keymap::load(file.clone());
            assert!(error.unwrap().contains(part) && keymap.changed.is_empty());
        }
    }

    #[test]
    fn a_file_with_an_unknown_command_is_kept_until_the_usual_keys_set_it_aside() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("keys.ron");
        let text = "{\"fly\": [\"L\"], \"loop\": [\"F8\"]}";
        std::fs::write(&file, text).unwrap();
        let (mut keymap, error) = Keymap::load(Some(file.clone()));
        assert!(keymap.can_be_reset() && error.unwrap().contains("The usual keys"));
        let (play, f9) = (entry_of(Command::PlayPause).unwrap(), Shortcut::parse("F9").unwrap());
        assert_eq!(keymap.set(play, f9).unwrap_err(), "not kept: keys.ron cannot be read");
        assert_eq!(keymap.text(Command::PlayPause), "F9");
        assert_eq!(std::fs::read_to_string(&file).unwrap(), text);

        keymap.reset().unwrap();
        assert_eq!(std::fs::read_to_string(dir.path().join("keys.ron.old")).unwrap(), text);
        keymap.set(play, f9).unwrap();
        let (again, error) = Keymap::load(Some(file));
        assert_eq!((again.text(Command::PlayPause).as_str(), error), ("F9", None));
    }

    #[test]
    fn a_shifted_key_that_is_released_after_shift_acts_again_and_one_that_is_held_acts_once() {
        let (ctx, mut keymap) = (egui::Context::default(), Keymap::default());
        let mut commands = |key, pressed, modifiers| {
            let physical_key = Some(Key::Slash);
            let event = Event::Key { key, physical_key, pressed, repeat: false, modifiers };
            commands_of(&ctx, &mut keymap, event)
        };
        for _ in 0..2 {
            assert_eq!(commands(Key::Questionmark, true, Modifiers::SHIFT), [Command::Keys]);
            assert!(commands(Key::Questionmark, true, Modifiers::SHIFT).is_empty(), "it is held");
            assert!(commands(Key::Slash, false, Modifiers::NONE).is_empty(), "it is released");
        }
    }

    #[test]
    fn a_held_key_of_the_size_acts_again_and_plus_acts_also_where_it_needs_shift() {
        let (ctx, mut keymap) = (egui::Context::default(), Keymap::default());
        for (key, modifiers, command) in [
            (Key::Plus, Modifiers::COMMAND, Command::Larger),
            (Key::Plus, Modifiers::COMMAND | Modifiers::SHIFT, Command::Larger),
            (Key::Equals, Modifiers::COMMAND, Command::Larger),
            (Key::Minus, Modifiers::COMMAND, Command::Smaller),
        ] {
            let event = Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers };
            for _ in 0..2 {
                assert_eq!(commands_of(&ctx, &mut keymap, event.clone()), [command], "{key:?}");
            }
        }
    }

    #[test]
    fn a_key_that_is_held_when_the_window_gets_the_focus_acts_only_after_it_was_let_go_and_escape_stops() {
        let (ctx, mut keymap) = (egui::Context::default(), Keymap::default());
        let modifiers = Modifiers::NONE;
        let key = |key, pressed| Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
        for (event, time_s, commands) in [
            (Event::WindowFocused(true), 10.0, vec![]),
            (key(Key::Space, true), 10.3, vec![]),
            (key(Key::ArrowRight, true), 10.4, vec![]),
            (key(Key::Escape, true), 10.5, vec![Command::EmergencyStop]),
            (key(Key::ArrowRight, true), 11.0, vec![]),
            (key(Key::Space, true), 11.1, vec![]),
            (key(Key::Space, false), 11.2, vec![]),
            (key(Key::Space, true), 11.3, vec![Command::PlayPause]),
            (Event::WindowFocused(false), 12.0, vec![]),
            (Event::WindowFocused(true), 13.0, vec![]),
            (key(Key::Space, true), 13.6, vec![]),
            (key(Key::Space, false), 13.65, vec![]),
            (key(Key::Space, true), 14.0, vec![Command::PlayPause]),
        ] {
            let found = commands_at(&ctx, &mut keymap, event.clone(), Some(time_s));
            assert_eq!(found, commands, "{event:?} at {time_s} s");
        }
    }

    #[test]
    fn the_keys_of_stopping_and_driving_are_nobody_elses() {
        let mut keymap = Keymap::default();
        let play = entry_of(Command::PlayPause).unwrap();
        for keys in ["esc", "W", "shift D"] {
            assert!(keymap.set(play, Shortcut::parse(keys).unwrap()).is_err(), "{keys}");
        }
        let stop = entry_of(Command::EmergencyStop).unwrap();
        assert!(keymap.set(stop, Shortcut::parse("F9").unwrap()).is_err());
    }
}
