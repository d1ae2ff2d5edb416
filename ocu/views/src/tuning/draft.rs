//! Edited parameters of one process: the changes that were not sent, what was sent, and the kept sets A and B.

use crate::edit::text::text_of;
use rcs_msg::params::{ParamSpec, specs, with_params};
use rcs_msg::{AnyMessage, FieldPath, Stamp, Value, rcs};
use rcs_runtime::source::RunTag;
use std::collections::BTreeMap;

/// Number of messages that can be taken back.
const MOST: usize = 50;
/// For this time of the source after parameters were sent, a fault of the process is taken as due to them, ns. A process
/// takes them in its next cycle.
const DUE_NS: u64 = 3_000_000_000;
/// A refused command is told for this time of the source after the last refusal, ns.
const REFUSED_NS: u64 = 1_000_000_000;
/// For this time of the window, parameters that were sent are awaited to be in force, s. After that they count as lost.
const ON_ITS_WAY_S: f64 = 5.0;

/// A message that was sent.
#[derive(Clone, Debug)]
struct Sent {
    /// The parameters that it replaced.
    before: AnyMessage,
    written: AnyMessage,
}

/// A message that was sent and is not in force yet.
#[derive(Clone, Debug)]
struct OnItsWay {
    written: AnyMessage,
    /// The run of the parameters in force when it was sent.
    run: RunTag,
    /// Time of the window when it was sent, s.
    sent_s: f64,
}

/// A fault of the process that followed something that was sent.
#[derive(Clone, Debug)]
struct Fault {
    text: String,
    /// Of a refused command: when the last one was refused, and how many were until then.
    refused: Option<(Stamp, u64)>,
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
    /// What was sent last, until it is in force.
    on_its_way: Option<OnItsWay>,
    /// The parameters that were in force in the last pass.
    followed: Option<AnyMessage>,
    /// Why the last change was refused.
    refused: Option<String>,
    /// When something was sent last, and the number of the process's faults then.
    sent_at: Option<(Stamp, u64)>,
    /// The fault of the process that followed.
    fault: Option<Fault>,
    /// What the parameters are.
    specs: Vec<ParamSpec>,
}

impl Draft {
    /// Drops changes that are in force by now, and what was refused or on its way under other parameters. Returns whether
    /// the parameters in force are others than in the last pass.
    pub(super) fn follow(&mut self, in_force: &AnyMessage, now: &Value) -> bool {
        let is_replaced = self.followed.as_ref().is_some_and(|followed| !is_equal(followed, in_force));
        if is_replaced {
            (self.refused, self.on_its_way) = (None, None);
        }
        self.followed = Some(in_force.clone());
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
        is_replaced
    }

    /// Awaits no longer what was sent to another run, or some seconds ago; `now_s` is the time of the window.
    pub(super) fn follow_sent(&mut self, run: RunTag, now_s: f64) {
        let is_over = |sent: &OnItsWay| sent.run != run || now_s > sent.sent_s + ON_ITS_WAY_S;
        if self.on_its_way.as_ref().is_some_and(is_over) {
            self.on_its_way = None;
        }
    }

    /// What was sent and is not in force yet.
    pub(super) fn on_its_way(&self) -> Option<&AnyMessage> {
        self.on_its_way.as_ref().map(|sent| &sent.written)
    }

    /// Whether something is on its way, and nothing was changed since.
    pub(super) fn is_sending(&self, in_force: &AnyMessage) -> bool {
        let is_shown = |written| !self.is_changed() || is_equal(written, &self.message(in_force));
        self.on_its_way().is_some_and(is_shown)
    }

    /// `written` is sent to this run at this time of the window.
    pub(super) fn await_in_force(&mut self, written: &AnyMessage, run: RunTag, now_s: f64) {
        self.on_its_way = Some(OnItsWay { written: written.clone(), run, sent_s: now_s });
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

    /// Takes the values of kept parameters as changes of those in force. Where more than single values differ, such as the
    /// length of a list, nothing is changed, and the reason is shown.
    pub(super) fn take(&mut self, in_force: &AnyMessage, kept: &AnyMessage) {
        let mut changes = BTreeMap::new();
        let is_alike = match (in_force.value(), kept.value()) {
            (Ok(now), Ok(kept)) => differences("", &now, &kept, &mut changes),
            _ => false,
        };
        if !is_alike {
            let reason = "the kept parameters differ in whole lists from those here: they cannot be shown";
            self.refused = Some(reason.to_owned());
            return;
        }
        let before = std::mem::replace(&mut self.changes, changes);
        (self.made, self.refused) = (None, None);
        if let Err(error) = self.make(in_force) {
            self.changes = before;
            self.refused = Some(error);
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

    /// Why nothing can be taken back; `None` if the last message can, which is in force.
    pub(super) fn cannot_undo(&self, in_force: &AnyMessage) -> Option<&'static str> {
        match self.sent.last() {
            None => Some("Nothing was sent from here."),
            Some(sent) if is_equal(in_force, &sent.written) => None,
            Some(_) => Some("What was sent last is not in force here: nothing to undo."),
        }
    }

    /// The parameters that the last message replaced, where that message is in force.
    pub(super) fn undo(&mut self, in_force: &AnyMessage) -> Option<AnyMessage> {
        if self.cannot_undo(in_force).is_some() {
            return None;
        }
        self.refused = None;
        self.sent.pop().map(|sent| sent.before)
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
        (self.last, self.on_its_way) = (None, None);
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
        self.fault.as_ref().map(|fault| fault.text.as_str())
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
            self.fault = Some(Fault { text: status.last_fault.clone(), refused: None });
        }
    }

    /// Forgets the fault where it is that of a refused command, and the vehicle has refused none for some time.
    pub(super) fn forget_refusal(&mut self, now: Stamp, status: &rcs::Status, vehicle: &rcs::VehicleStatus) {
        let Some(fault) = &mut self.fault else { return };
        let reason = &vehicle.last_refusal;
        match fault.refused {
            None if reason.is_empty() || !fault.text.starts_with(reason) => {}
            Some((at, refused)) if refused == vehicle.refused => {
                if now < at || now > at.after_ns(REFUSED_NS) {
                    self.fault = None;
                    self.sent_at = self.sent_at.map(|(sent, _)| (sent, status.faults));
                }
            }
            _ => fault.refused = Some((now, vehicle.refused)),
        }
    }
}

/// Whether two messages are the same, or equal.
pub(crate) fn is_equal(one: &AnyMessage, other: &AnyMessage) -> bool {
    one.same(other) || one.bytes() == other.bytes()
}

/// Adds path and text of each plain value that differs from the one now; returns whether that is all that differs.
fn differences(path: &str, now: &Value, other: &Value, changes: &mut BTreeMap<String, String>) -> bool {
    match (now, other) {
        (Value::Message(_), Value::Message(fields)) => fields.iter().all(|(name, other)| {
            let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            now.field(name).is_some_and(|now| differences(&path, now, other, changes))
        }),
        (Value::List(items), Value::List(others)) => {
            let mut pairs = items.iter().zip(others).enumerate();
            items.len() == others.len()
                && pairs.all(|(i, (now, other))| differences(&format!("{path}[{i}]"), now, other, changes))
        }
        _ => match (text_of(now), text_of(other)) {
            (Some(now), Some(text)) => {
                if now != text {
                    changes.insert(path.to_owned(), text);
                }
                true
            }
            _ => now == other,
        },
    }
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
    fn a_refused_command_is_told_until_none_was_refused_for_a_second() {
        let at = |ms: u64| Stamp(ms * 1_000_000);
        let vehicle = |refused: u64| {
            let last_refusal = "drive: speed is 1 m/s".to_owned();
            rcs::VehicleStatus { refused, last_refusal, ..rcs::VehicleStatus::default() }
        };
        let text = "drive: speed is 1 m/s; refused";
        let mut draft = Draft::default();
        draft.await_fault(at(0), 2);
        for (now_ms, faults, refused, told) in [
            (100, 3, 1, Some(text)),
            (900, 4, 2, Some(text)),
            (1_800, 4, 2, Some(text)),
            (2_000, 4, 2, None),
            (2_100, 4, 2, None),
            (2_200, 5, 3, Some(text)),
            (3_300, 5, 3, None),
        ] {
            let status = status(faults, text);
            draft.take_fault(at(now_ms), &status);
            draft.forget_refusal(at(now_ms), &status, &vehicle(refused));
            assert_eq!(draft.fault(), told, "{now_ms} ms");
        }
        // Of another fault there is no telling whether it still applies.
        draft.await_fault(at(4_000), 5);
        for now_ms in [4_100, 9_000] {
            let status = status(6, "parameters refused");
            draft.take_fault(at(now_ms), &status);
            draft.forget_refusal(at(now_ms), &status, &vehicle(3));
            assert_eq!(draft.fault(), Some("parameters refused"), "{now_ms} ms");
        }
    }

    #[test]
    fn what_was_refused_is_told_until_other_parameters_are_in_force() {
        let mut draft = Draft::default();
        let follow = |draft: &mut Draft, in_force: f64| {
            draft.follow(&speed(in_force), &speed(in_force).value().unwrap());
        };
        follow(&mut draft, 1.0);
        draft.set(&speed(1.0), "max_speed_mps", "fast".to_owned());
        for (in_force, is_told) in [(1.0, true), (2.0, false)] {
            follow(&mut draft, in_force);
            assert_eq!(draft.refused().is_some(), is_told, "{in_force}");
        }
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
    fn values_that_differ_are_found_in_lists_of_the_same_length_only() {
        let params = |weights: &[f64]| {
            let weight = |weight: &f64| Value::Message(vec![("weight".to_owned(), Value::Float(*weight))]);
            let list = Value::List(weights.iter().map(weight).collect());
            Value::Message(vec![("sources".to_owned(), list)])
        };
        let found = |now: &[f64], other: &[f64]| {
            let mut changes = BTreeMap::new();
            let is_all = differences("", &params(now), &params(other), &mut changes);
            is_all.then_some(changes)
        };
        let expected = BTreeMap::from([("sources[1].weight".to_owned(), "0.25".to_owned())]);
        assert_eq!(found(&[1.0, 0.5], &[1.0, 0.25]), Some(expected));
        assert_eq!(found(&[1.0, 0.5], &[1.0]), None);
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
        assert!(draft.cannot_undo(&speed(2.0)).is_none() && draft.fault().is_some());
        let other = draft.cannot_undo(&speed(1.0));
        assert!(other.is_some_and(|why| why.contains("not in force")), "{other:?}");
        draft.forget_sent();
        draft.take_fault(at(12), &status(4, "late"));
        assert_eq!(draft.cannot_undo(&speed(2.0)), Some("Nothing was sent from here."));
        assert_eq!(draft.fault(), None);
        assert!(draft.is_changed() && draft.kept(0).is_some());
    }
}
