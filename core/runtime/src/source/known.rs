//! What is known of a topic in which events are found, with the times at which it changed: a run that branches from
//! another one begins with what was known then, not with what became known later.

use rcs_msg::Stamp;
use std::collections::BTreeMap;

/// A value, with the times from which on it had this value and former ones.
pub(super) struct Changes<T>(Vec<(Stamp, T)>);

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

    /// Sets the value from `stamp` on. Whether it differs from the one before.
    pub(super) fn set(&mut self, stamp: Stamp, value: T) -> bool {
        let differs = self.get() != Some(&value);
        if differs {
            self.0.push((stamp, value));
        }
        differs
    }

    fn fork(&self, time: Stamp) -> Self {
        Self(self.0.iter().filter(|(from, _)| *from <= time).cloned().collect())
    }
}

/// The periods in which something was seen again and again: the first and the last time of each.
#[derive(Default)]
pub(super) struct Periods(Vec<(Stamp, Stamp)>);

impl Periods {
    /// It is seen at `stamp`. Whether it was also seen less than `gap_s` seconds before, so that the period goes on.
    pub(super) fn goes_on(&mut self, stamp: Stamp, gap_s: f64) -> bool {
        match self.0.last_mut() {
            Some((_, last)) if stamp.seconds_since(*last) < gap_s => {
                *last = stamp;
                true
            }
            _ => {
                self.0.push((stamp, stamp));
                false
            }
        }
    }

    /// A period that goes on at `time` counts as seen then.
    fn fork(&self, time: Stamp) -> Self {
        let before = self.0.iter().filter(|(first, _)| *first <= time);
        Self(before.map(|&(first, last)| (first, last.min(time))).collect())
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
}

impl Known {
    /// What was known at `time`.
    pub(super) fn fork(&self, time: Stamp) -> Self {
        let texts = self.texts.iter().map(|(text, seen)| (text.clone(), seen.fork(time)));
        Self {
            state: self.state.fork(time),
            texts: texts.filter(|(_, seen)| !seen.0.is_empty()).collect(),
            faults: self.faults.fork(time),
            refused: self.refused.fork(time),
            serial: self.serial.fork(time),
            is_stopped: self.is_stopped.fork(time),
            refusals: self.refusals.fork(time),
            bumper: self.bumper.fork(time),
            driven: self.driven.fork(time),
        }
    }
}
