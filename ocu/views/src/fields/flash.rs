//! Values that have changed flash and settle.

use rcs_msg::Stamp;
use std::collections::BTreeMap;

/// How long a change is seen, s of the window's clock.
const FADE_S: f64 = 0.8;

/// The texts of the rows that are visible, and when each one changed.
#[derive(Default)]
pub(super) struct Flashes {
    rows: BTreeMap<String, Seen>,
    next: BTreeMap<String, Seen>,
    /// What is shown: another buffer, or a jump back in time, is no change.
    of: String,
    stamp: Stamp,
    forgets: bool,
}

struct Seen {
    text: String,
    changed: Option<f64>,
}

impl Flashes {
    /// Begins a pass over the rows of a message.
    pub(super) fn begin(&mut self, of: &str, stamp: Stamp) {
        self.rows = std::mem::take(&mut self.next);
        self.forgets = self.of != of || stamp < self.stamp;
        if self.of != of {
            of.clone_into(&mut self.of);
        }
        self.stamp = stamp;
    }

    /// How fresh the change of a row is, from 1 to 0. `now` is the window's clock.
    pub(super) fn of(&mut self, key: &str, text: &str, now: f64) -> f32 {
        let before = self.rows.remove(key).filter(|_| !self.forgets);
        let changed = match before {
            Some(seen) if seen.text == text => seen.changed,
            Some(_) => Some(now),
            None => None,
        };
        let changed = changed.filter(|changed| now - changed < FADE_S);
        self.next.insert(key.to_owned(), Seen { text: text.to_owned(), changed });
        changed.map_or(0.0, |changed| (1.0 - (now - changed) / FADE_S) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_fades_and_another_buffer_or_going_back_is_none() {
        let mut flashes = Flashes::default();
        let mut at = |of: &str, stamp: u64, text: &str, now: f64| {
            flashes.begin(of, Stamp(stamp));
            flashes.of(".x", text, now)
        };
        assert_eq!(at("/a", 1, "1", 0.0), 0.0);
        assert_eq!(at("/a", 2, "1", 0.1), 0.0);
        assert_eq!(at("/a", 3, "2", 0.2), 1.0);
        let later = at("/a", 4, "2", 0.6);
        assert!((later - 0.5).abs() < 1e-6, "{later}");
        assert_eq!(at("/a", 5, "2", 1.1), 0.0);
        assert_eq!(at("/b", 6, "3", 1.2), 0.0);
        assert_eq!(at("/b", 5, "4", 1.3), 0.0, "the past");
        assert_eq!(at("/b", 7, "5", 1.4), 1.0);
    }
}
