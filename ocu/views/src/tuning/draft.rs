//! Edited parameters of one process: the changes that were not sent, what was sent, and the kept sets A and B.

use crate::edit::text::text_of;
use rcs_msg::params::{ParamSpec, specs, with_params};
use rcs_msg::{AnyMessage, FieldPath, Stamp, Value, rcs};
use std::collections::BTreeMap;

/// Number of messages that can be taken back.
const MOST: usize = 50;
/// For this time of the source after parameters were sent, a fault of the process is taken as due to them, ns. A process
/// takes them in its next cycle.
const DUE_NS: u64 = 3_000_000_000;

/// A message that was sent.
#[derive(Clone, Debug)]
struct Sent {
    /// The parameters that it replaced.
    before: AnyMessage,
    written: AnyMessage,
}

/// The edited parameters of a process.
#[derive(Clone, Debug, Default)]
pub(crate) struct Draft {
    /// The changes that were not sent: path and text.
    changes: BTreeMap<String, String>,
    /// The parameters with the changes, and those that they change.
    made: Option<(AnyMessage, AnyMessage)>,
    /// The messages that can be taken back, oldest first.
    sent: Vec<Sent>,
    kept: [Option<AnyMessage>; 2],
    /// What was sent last, also to take something back, and the parameters with which the newest map was made then.
    last: Option<Sent>,
    /// Why the last change was refused.
    refused: Option<String>,
    /// When something was sent last, and the number of the process's faults then.
    sent_at: Option<(Stamp, u64)>,
    /// The fault of the process that followed.
    fault: Option<String>,
    /// What the parameters are.
    specs: Vec<ParamSpec>,
}

impl Draft {
    /// Drops changes that are in force by now.
    pub(super) fn follow(&mut self, in_force: &AnyMessage, now: &Value) {
        let is_done = |path: &str, text: &str| {
            let at = path.parse::<FieldPath>().ok();
            let value = at.as_ref().and_then(|at| now.get(at).ok());
            value.is_some_and(|value| same(&value, text))
        };
        let before = self.changes.len();
        self.changes.retain(|path, text| !is_done(path, text));
        let is_other = self.made.as_ref().is_some_and(|(of, _)| !of.same(in_force));
        if before != self.changes.len() || is_other {
            self.made = None;
        }
        if self.made.is_none() && self.is_changed() {
            // A change that does not fit any more is shown as refused when it is sent.
            let _ = self.make(in_force);
        }
        if self.specs.is_empty() {
            self.specs = in_force.schema().descriptor().map(specs).unwrap_or_default();
        }
    }

    /// What the parameters are.
    pub(super) fn specs(&self) -> &[ParamSpec] {
        &self.specs
    }

    /// Changes a parameter; a refused change is not kept, and its reason is shown.
    pub(super) fn set(&mut self, in_force: &AnyMessage, path: &str, text: String) {
        let old = self.changes.insert(path.to_owned(), text);
        self.made = None;
        match self.make(in_force) {
            Ok(_) => self.refused = None,
            Err(error) => {
                self.refused = Some(error);
                match old {
                    Some(old) => self.changes.insert(path.to_owned(), old),
                    None => self.changes.remove(path),
                };
            }
        }
    }

    fn make(&mut self, in_force: &AnyMessage) -> Result<AnyMessage, String> {
        if let Some((_, made)) = self.made.as_ref().filter(|(of, _)| of.same(in_force)) {
            return Ok(made.clone());
        }
        let changes = self.changes.iter().map(|(path, text)| (path.as_str(), text.as_str()));
        let made = with_params(in_force, changes).map_err(|error| error.to_string())?;
        self.made = Some((in_force.clone(), made.clone()));
        Ok(made)
    }

    /// The parameters with the changes.
    pub(super) fn message(&self, in_force: &AnyMessage) -> AnyMessage {
        if self.changes.is_empty() {
            return in_force.clone();
        }
        let made = self.made.as_ref().filter(|(of, _)| of.same(in_force)).map(|(_, made)| made.clone());
        let changes = || self.changes.iter().map(|(path, text)| (path.as_str(), text.as_str()));
        made.or_else(|| with_params(in_force, changes()).ok()).unwrap_or_else(|| in_force.clone())
    }

    pub(super) fn is_changed(&self) -> bool {
        !self.changes.is_empty()
    }

    /// Number of parameters that were changed and not sent.
    pub(super) fn count(&self) -> usize {
        self.changes.len()
    }

    pub(super) fn discard(&mut self) {
        self.changes.clear();
        (self.made, self.refused) = (None, None);
        (self.sent_at, self.fault) = (None, None);
    }

    /// `written` is sent, and replaces `before`.
    pub(super) fn sent(&mut self, before: &AnyMessage, written: &AnyMessage) {
        self.refused = None;
        self.sent.push(Sent { before: before.clone(), written: written.clone() });
        let surplus = self.sent.len().saturating_sub(MOST);
        self.sent.drain(..surplus);
    }

    pub(super) fn can_undo(&self) -> bool {
        !self.sent.is_empty()
    }

    /// The parameters that the last message replaced. Where that message is not in force, nothing is taken back, and the
    /// reason is shown.
    pub(super) fn undo(&mut self, in_force: &AnyMessage) -> Option<AnyMessage> {
        let Sent { written, .. } = self.sent.last()?;
        if is_equal(in_force, written) {
            self.refused = None;
            return self.sent.pop().map(|sent| sent.before);
        }
        self.refused = Some("what was sent last is not in force here: nothing to undo".to_owned());
        None
    }

    /// `written` is sent. If a map with the parameters in force `is_awaited`, the newest one was made with older ones.
    pub(super) fn written(&mut self, in_force: &AnyMessage, written: &AnyMessage, is_awaited: bool) {
        let before = self.replaced(in_force).filter(|_| is_awaited).unwrap_or(in_force).clone();
        self.last = Some(Sent { before, written: written.clone() });
    }

    /// The parameters with which the newest map was made when those in force were sent; `None` if these are not what was
    /// sent last.
    pub(super) fn replaced(&self, in_force: &AnyMessage) -> Option<&AnyMessage> {
        self.last.as_ref().filter(|last| is_equal(in_force, &last.written)).map(|last| &last.before)
    }

    /// Forgets what was sent and what followed: the run to which it was sent has ended. Changes and kept sets stay.
    pub(crate) fn forget_sent(&mut self) {
        self.sent.clear();
        self.last = None;
        (self.sent_at, self.fault, self.refused) = (None, None, None);
    }

    pub(super) fn kept(&self, slot: usize) -> Option<&AnyMessage> {
        self.kept.get(slot)?.as_ref()
    }

    pub(super) fn keep(&mut self, slot: usize, params: AnyMessage) {
        self.kept[slot] = Some(params);
    }

    pub(super) fn forget_kept(&mut self) {
        self.kept = [None, None];
    }

    pub(super) fn refused(&self) -> Option<&str> {
        self.refused.as_deref()
    }

    /// The fault that followed what was sent last.
    pub(super) fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// Something is sent now to the process, which has had so many faults.
    pub(super) fn await_fault(&mut self, now: Stamp, faults: u64) {
        (self.sent_at, self.fault) = (Some((now, faults)), None);
    }

    /// Notes the first fault of the process shortly after something was sent.
    pub(super) fn take_fault(&mut self, now: Stamp, status: &rcs::Status) {
        let Some((sent, faults)) = self.sent_at else { return };
        let is_due = now >= sent && now <= sent.after_ns(DUE_NS);
        if is_due && self.fault.is_none() && status.faults > faults {
            self.fault = Some(status.last_fault.clone());
        }
    }
}

/// Whether two messages are the same, or equal.
pub(crate) fn is_equal(one: &AnyMessage, other: &AnyMessage) -> bool {
    one.same(other) || one.bytes() == other.bytes()
}

/// Whether a text means this value.
fn same(value: &Value, text: &str) -> bool {
    match (value.as_f64(), text.trim().parse::<f64>()) {
        (Some(a), Ok(b)) => a == b,
        _ => text_of(value).is_some_and(|value| value == text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::rcs::SpeedLimit;

    fn speed(max_speed_mps: f64) -> AnyMessage {
        AnyMessage::new(SpeedLimit { max_speed_mps })
    }

    fn status(faults: u64, last_fault: &str) -> rcs::Status {
        rcs::Status { faults, last_fault: last_fault.to_owned(), ..rcs::Status::default() }
    }

    #[test]
    fn a_fault_counts_as_due_to_parameters_only_shortly_after_they_were_sent() {
        let at = |s: u64| Stamp(s * 1_000_000_000);
        let mut draft = Draft::default();
        draft.take_fault(at(5), &status(2, "late"));
        draft.await_fault(at(10), 2);
        draft.take_fault(at(10), &status(2, "late"));
        assert_eq!(draft.fault(), None, "it was there before");
        draft.take_fault(at(11), &status(3, "refused"));
        draft.take_fault(at(70), &status(4, "late"));
        assert_eq!(draft.fault(), Some("refused"));
        draft.discard();
        assert_eq!(draft.fault(), None);
        draft.await_fault(at(80), 4);
        draft.take_fault(at(81), &status(4, "late"));
        draft.take_fault(at(200), &status(5, "late"));
        assert_eq!(draft.fault(), None, "minutes later");
    }

    #[test]
    fn parameters_that_were_sent_one_after_the_other_replace_those_of_the_newest_map() {
        let mut draft = Draft::default();
        assert!(draft.replaced(&speed(1.0)).is_none());
        draft.written(&speed(1.0), &speed(2.0), false);
        draft.written(&speed(2.0), &speed(3.0), true);
        let replaced = |draft: &Draft, in_force: f64| {
            draft.replaced(&speed(in_force)).map(|before| before.to::<SpeedLimit>().unwrap().max_speed_mps)
        };
        assert_eq!((replaced(&draft, 2.0), replaced(&draft, 3.0)), (None, Some(1.0)));
        draft.written(&speed(3.0), &speed(4.0), false);
        assert_eq!(replaced(&draft, 4.0), Some(3.0), "a map with 3 has come");
    }

    #[test]
    fn what_was_sent_to_a_run_that_has_ended_is_forgotten_and_what_was_not_sent_stays() {
        let at = |s: u64| Stamp(s * 1_000_000_000);
        let mut draft = Draft::default();
        draft.sent(&speed(1.0), &speed(2.0));
        draft.await_fault(at(10), 2);
        draft.take_fault(at(11), &status(3, "refused"));
        draft.keep(0, speed(1.0));
        draft.set(&speed(2.0), "max_speed_mps", "3".to_owned());
        assert!(draft.can_undo() && draft.fault().is_some());
        draft.forget_sent();
        draft.take_fault(at(12), &status(4, "late"));
        assert!(!draft.can_undo() && draft.fault().is_none());
        assert!(draft.is_changed() && draft.kept(0).is_some());
    }
}
