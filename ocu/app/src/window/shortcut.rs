//! A key with its modifiers, as text and from text.

use egui::{Key, Modifiers};
use std::fmt;

/// A key with its modifiers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shortcut {
    pub(super) modifiers: Modifiers,
    pub(super) key: Key,
}

impl Shortcut {
    /// What a press of a key with these modifiers is.
    pub(super) fn of_press(modifiers: Modifiers, key: Key) -> Self {
        let mut pattern = Modifiers::NONE;
        for (held, one) in [
            (modifiers.command || modifiers.ctrl, Modifiers::COMMAND),
            (modifiers.shift, Modifiers::SHIFT),
            (modifiers.alt, Modifiers::ALT),
        ] {
            if held {
                pattern |= one;
            }
        }
        Self { modifiers: pattern, key }
    }

    /// Whether a press of `key` with these modifiers is meant. The modifiers must be exactly these, so that a shifted
    /// arrow is not a plain one.
    pub(super) fn is(self, modifiers: Modifiers, key: Key) -> bool {
        self.key == key && modifiers.matches_exact(self.modifiers)
    }

    /// Whether it cannot be typed into a field of text.
    pub(super) fn is_untypable(self) -> bool {
        self.modifiers.command || self.modifiers.ctrl || self.modifiers.alt || is_function_key(self.key)
    }

    /// Whether a button with the keyboard focus uses it.
    pub(super) fn belongs_to_focus(self) -> bool {
        const KEYS: [Key; 9] = [
            Key::Space,
            Key::Enter,
            Key::Tab,
            Key::ArrowUp,
            Key::ArrowDown,
            Key::ArrowLeft,
            Key::ArrowRight,
            Key::Home,
            Key::End,
        ];
        !self.is_untypable() && KEYS.contains(&self.key)
    }

    /// Reads what [`Shortcut`] is shown as: `ctrl shift Z`.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let mut modifiers = Modifiers::NONE;
        let mut key = None;
        for word in text.split_whitespace() {
            match word.to_ascii_lowercase().as_str() {
                "ctrl" => modifiers |= Modifiers::COMMAND,
                "shift" => modifiers |= Modifiers::SHIFT,
                "alt" => modifiers |= Modifiers::ALT,
                _ => {
                    let word = if word.eq_ignore_ascii_case("esc") { "Escape" } else { word };
                    let found = Key::from_name(word).or_else(|| {
                        Key::ALL
                            .iter()
                            .copied()
                            .find(|key| key.name().eq_ignore_ascii_case(word) || shown(*key) == word)
                    });
                    let found = found.ok_or_else(|| format!("no key is called {word:?}, in {text:?}"))?;
                    if key.replace(found).is_some() {
                        return Err(format!("more than one key in {text:?}"));
                    }
                }
            }
        }
        Ok(Self { modifiers, key: key.ok_or_else(|| format!("no key in {text:?}"))? })
    }
}

fn is_function_key(key: Key) -> bool {
    let name = key.name();
    name.len() > 1 && name.starts_with('F') && name[1..].bytes().all(|byte| byte.is_ascii_digit())
}

impl fmt::Display for Shortcut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (held, name) in [
            (self.modifiers.command || self.modifiers.ctrl, "ctrl "),
            (self.modifiers.shift, "shift "),
            (self.modifiers.alt, "alt "),
        ] {
            if held {
                f.write_str(name)?;
            }
        }
        f.write_str(shown(self.key))
    }
}

/// A key as it is written in menus and in the file of shortcuts. The monospaced font has no glyphs for the triangles
/// that egui uses for arrow keys.
fn shown(key: Key) -> &'static str {
    match key {
        Key::Escape => "esc",
        Key::Space => "space",
        Key::Home => "home",
        Key::End => "end",
        Key::ArrowLeft => "←",
        Key::ArrowRight => "→",
        Key::ArrowUp => "↑",
        Key::ArrowDown => "↓",
        key => key.symbol_or_name(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::commands::COMMANDS;

    #[test]
    fn every_shortcut_is_read_back_from_what_it_is_shown_as() {
        for shortcut in COMMANDS.iter().flat_map(|entry| entry.keys) {
            assert_eq!(Shortcut::parse(&shortcut.to_string()).unwrap(), *shortcut, "{shortcut}");
        }
        for key in Key::ALL {
            let shortcut = Shortcut { modifiers: Modifiers::COMMAND | Modifiers::SHIFT, key: *key };
            assert_eq!(Shortcut::parse(&shortcut.to_string()).unwrap(), shortcut, "{shortcut}");
        }
        for wrong in ["", "ctrl", "A B", "hyper A"] {
            assert!(Shortcut::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_could_be_typed_is_told_from_what_could_not() {
        assert!(!Shortcut::parse("L").unwrap().is_untypable());
        assert!(!Shortcut::parse("shift L").unwrap().is_untypable());
        assert!(!Shortcut::parse("F").unwrap().is_untypable());
        assert!(Shortcut::parse("ctrl L").unwrap().is_untypable());
        assert!(Shortcut::parse("F5").unwrap().is_untypable());
    }
}
