//! When each of the processes that write to one input was heard last: several cameras can write what they see to one
//! buffer, and one that stops must not be hidden by the others.

use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// The writers of an input.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Sensors {
    /// Number of each writer, and the acquisition time of its newest message.
    heard: Vec<(u16, Stamp)>,
}

/// Writers from this number on are processes; below it are the operator and the runtime.
const FIRST_PROCESS: u16 = 2;

impl Sensors {
    /// Notes a message.
    pub(crate) fn hear(&mut self, writer: u16, time: Stamp) {
        match self.heard.iter_mut().find(|(other, _)| *other == writer) {
            Some((_, newest)) => *newest = (*newest).max(time),
            None => self.heard.push((writer, time)),
        }
    }

    /// Acquisition time of the newest message of the process that has been silent longest; what an operator wrote
    /// counts only where no process writes. `None` before the first message.
    pub(crate) fn oldest(&self) -> Option<Stamp> {
        let times = |of: fn(u16) -> bool| {
            self.heard.iter().filter(move |(writer, _)| of(*writer)).map(|&(_, time)| time)
        };
        times(|writer| writer >= FIRST_PROCESS).min().or_else(|| times(|writer| writer < FIRST_PROCESS).max())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_process_that_has_been_silent_longest_counts() {
        let mut sensors = Sensors::default();
        assert_eq!(sensors.oldest(), None);
        sensors.hear(0, Stamp(1));
        assert_eq!(sensors.oldest(), Some(Stamp(1)), "the operator alone");
        sensors.hear(7, Stamp(5));
        sensors.hear(8, Stamp(6));
        sensors.hear(8, Stamp(9));
        assert_eq!(sensors.oldest(), Some(Stamp(5)), "the other one goes on");
        sensors.hear(7, Stamp(8));
        sensors.hear(7, Stamp(7));
        assert_eq!(sensors.oldest(), Some(Stamp(8)), "an older message changes nothing");
    }
}
