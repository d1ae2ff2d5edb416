//! What is known of a topic in which events are found, with the messages at which it changed: a run that branches from
//! another one begins with what was known then, not with what became known later.

use super::per_run::Written;
use bytes::Bytes;
use rcs_msg::Stamp;
use std::collections::BTreeMap;

/// A value and the former ones, each with the number of messages of the run when it was set.
pub(super) struct Changes<T>(Vec<(u64, T)>);

impl<T> Default for Changes<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Clone + PartialEq> Changes<T> {
    /// The newest value; `None` before the first one.
    pub(super) fn get(&self) -> Option<&T> {
        self.0.last().map(|(_, value)| value)
    }

    /// Sets the value from `at` on. Whether it differs from the one before.
    pub(super) fn set(&mut self, at: Written, value: T) -> bool {
        let differs = self.get() != Some(&value);
        if differs {
            self.0.push((at.messages, value));
        }
        differs
    }

    fn fork(&self, at: Written) -> Self {
        Self(self.0.iter().filter(|(from, _)| *from <= at.messages).cloned().collect())
    }
}

/// The periods in which something was seen again and again: the number of messages of the run when each began, and the
/// last time of each.
#[derive(Default)]
pub(super) struct Periods(Vec<(u64, Stamp)>);

impl Periods {
    /// It is seen at `at`. Whether it was also seen less than `gap_s` seconds before, so that the period goes on.
    pub(super) fn goes_on(&mut self, at: Written, gap_s: f64) -> bool {
        match self.0.last_mut() {
            Some((_, last)) if at.time.seconds_since(*last) < gap_s => {
                *last = at.time;
                true
            }
            _ => {
                self.0.push((at.messages, at.time));
                false
            }
        }
    }

    /// A period that goes on at `at` counts as seen then.
    fn fork(&self, at: Written) -> Self {
        let before = self.0.iter().filter(|(first, _)| *first <= at.messages);
        Self(before.map(|&(first, last)| (first, last.min(at.time))).collect())
    }
}

/// What is known of a topic, so that only changes are events.
#[derive(Default)]
pub(super) struct Known {
    /// State and command of a process.
    pub(super) state: Changes<(i32, String)>,
    /// Texts of states, without numbers, and when each was seen.
    pub(super) texts: BTreeMap<String, Periods>,
    /// Number of faults that was told last.
    pub(super) faults: Changes<u64>,
    /// The refused command: writer, serial, name.
    pub(super) refused: Changes<(String, u64, String)>,
    /// Serial of a command.
    pub(super) serial: Changes<u64>,
    /// Whether the emergency stop is active.
    pub(super) is_stopped: Changes<bool>,
    /// Number of messages that the vehicle refused.
    pub(super) refusals: Changes<u64>,
    /// Whether the bumper is pressed, left and right.
    pub(super) bumper: Changes<[bool; 2]>,
    /// When the operator drove by hand.
    pub(super) driven: Periods,
    /// Parameters that the operator has sent, by buffer.
    pub(super) params: BTreeMap<String, Changes<Bytes>>,
    /// Levels in diagnostics by the name and the hardware of a part.
    pub(super) parts: BTreeMap<(String, String), Changes<i32>>,
}

impl Known {
    /// What was known at `at`.
    pub(super) fn fork(&self, at: Written) -> Self {
        let texts = self.texts.iter().map(|(text, seen)| (text.clone(), seen.fork(at)));
        let params = self.params.iter().map(|(buffer, sent)| (buffer.clone(), sent.fork(at)));
        let parts = self.parts.iter().map(|(part, levels)| (part.clone(), levels.fork(at)));
        Self {
            state: self.state.fork(at),
            texts: texts.filter(|(_, seen)| !seen.0.is_empty()).collect(),
            faults: self.faults.fork(at),
            refused: self.refused.fork(at),
            serial: self.serial.fork(at),
            is_stopped: self.is_stopped.fork(at),
            refusals: self.refusals.fork(at),
            bumper: self.bumper.fork(at),
            driven: self.driven.fork(at),
            params: params.collect(),
            parts: parts.filter(|(_, levels)| !levels.0.is_empty()).collect(),
        }
    }
}
