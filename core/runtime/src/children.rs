//! Children of a supervisor: their states as it sees them, and the commands that it sends them.
//!
//! A process declares the children that it can have beside its ports. A stack assigns a child by `supervisor = "x"`,
//! and the plan wires the commands and statuses. The state of a child follows the rules of RCS: it is `EXEC` until its
//! status echoes the serial of the last command, so that an old `DONE` is never taken for a new one, and it is silent
//! if there was no status for several of its periods.

use crate::command::{BUILT_IN, CommandDef, NoCommands};
use rcs_msg::{Stamp, rcs};
use serde::{Deserialize, Serialize};
use std::marker::PhantomData;
use std::sync::Arc;

/// A child, or a set of children, that a process can have.
#[derive(Clone, Copy, Debug)]
pub struct ChildDef {
    /// Name in the stack file: `as = "…"`.
    pub name: &'static str,
    /// One sentence.
    pub help: &'static str,
    /// Whether a stack must assign one.
    pub required: bool,
    /// Whether there may be more than one.
    pub many: bool,
    /// Commands that it must obey in addition to those of the runtime.
    pub commands: &'static [CommandDef],
}

/// Handle of a child whose own commands are `C`.
#[derive(Debug)]
pub struct Child<C> {
    pub(crate) slot: usize,
    pub(crate) place: usize,
    commands: PhantomData<fn(C)>,
}

/// Handle of any number of children whose own commands are `C`.
#[derive(Debug)]
pub struct Children<C = NoCommands> {
    pub(crate) slot: usize,
    commands: PhantomData<fn(C)>,
}

impl<C> Child<C> {
    pub(crate) fn new(slot: usize, place: usize) -> Self {
        Self { slot, place, commands: PhantomData }
    }

    /// The same child, for the commands that every process obeys.
    pub fn plain(&self) -> Child<NoCommands> {
        Child::new(self.slot, self.place)
    }
}

impl<C> Children<C> {
    pub(crate) fn new(slot: usize) -> Self {
        Self { slot, commands: PhantomData }
    }
}

impl<C> Clone for Child<C> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<C> Copy for Child<C> {}

/// Who has the authority over a child.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    /// This supervisor.
    Us,
    /// The operator.
    Another,
    /// Nobody: that of the operator has lapsed, or the child has posted no status.
    Nobody,
}

/// State of a child as its supervisor must treat it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChildState {
    /// It waits for its first command.
    Uninitialized,
    /// It is executing, or has not answered the last command yet.
    Exec,
    /// It has completed the last command.
    Done,
    /// It cannot continue, or refused the last command.
    Error,
    /// It has posted no status for several of its periods.
    Silent,
}

/// A child as its supervisor sees it.
#[derive(Clone, Debug)]
pub struct ChildReport {
    /// Name of the process.
    pub name: Arc<str>,
    /// Its state.
    pub state: ChildState,
    /// One line: its own status text, or the reason for its state.
    pub text: String,
    /// Who has the authority over it.
    pub owner: Owner,
    /// The sender of the command that it obeys, if that is not this supervisor: the operator. Then `state` is the
    /// child's own.
    pub obeys_another: Option<String>,
    /// Whether its status shows that it has accepted the last command of this supervisor and obeys it.
    pub obeys_last: bool,
    /// Whether the last command of this supervisor has arrived, and the child obeys another one: it refused that
    /// command because the operator had the authority, or the operator has commanded it since.
    pub is_overruled: bool,
    /// The kind of the command that it obeys, if that is one of its own. Then it runs.
    pub own_command: Option<OwnCommand>,
}

/// A kind of command of a child's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OwnCommand {
    /// In force until `RUN` or another one.
    Lasting,
    /// A one-shot: the child runs on as before it.
    OneShot,
}

impl ChildReport {
    /// Whether an order that it does not obey is sent again, because the operator no longer has it. When the operator's
    /// authority has lapsed, that is `HALT` alone: what the operator halted stays halted until it is commanded again.
    pub fn is_ordered_again(&self, is_halt: bool) -> bool {
        self.is_overruled
            && match self.owner {
                Owner::Us => true,
                Owner::Nobody => is_halt,
                Owner::Another => false,
            }
    }

    /// Whether it runs as before a one-shot of the operator, who does not have it any more.
    pub fn runs_on(&self) -> bool {
        self.own_command == Some(OwnCommand::OneShot) && self.owner != Owner::Another
    }

    /// What is wrong with the child, if it has failed: its name and its reason.
    pub fn failure(&self) -> Option<String> {
        let word = match self.state {
            ChildState::Error => "is in ERROR",
            ChildState::Silent => "is silent",
            ChildState::Uninitialized | ChildState::Exec | ChildState::Done => return None,
        };
        Some(format!("{} {word}: {}", self.name, self.text))
    }
}

/// The children of a node: where their statuses and commands are, and what was sent to them.
#[derive(Default)]
pub(crate) struct ChildLinks {
    pub(crate) me: Arc<str>,
    pub(crate) links: Vec<Link>,
    pub(crate) state: ChildLinksState,
}

/// One child of a node.
pub(crate) struct Link {
    pub(crate) slot: usize,
    pub(crate) name: Arc<str>,
    /// Index among the inputs of the node, and among its outputs.
    pub(crate) input: usize,
    pub(crate) output: usize,
    pub(crate) silent_ns: u64,
    /// The commands of its own.
    pub(crate) commands: &'static [CommandDef],
}

impl Link {
    /// Adds a child whose status is one of the node's inputs, and whose commands are one of its outputs.
    pub(crate) fn new(
        slot: usize,
        name: Arc<str>,
        at: [usize; 2],
        [period_ns, latency_ns]: [u64; 2],
        commands: &'static [CommandDef],
    ) -> Self {
        let [input, output] = at;
        let silent_ns = (SILENT_PERIODS * period_ns + latency_ns).max(SILENT_NS);
        Self { slot, name, input, output, silent_ns, commands }
    }

    /// The kind of the command that the child obeys, if that is one of its own: it accepts such a command only while it
    /// runs. One in `ERROR` may have refused it.
    pub(crate) fn own_command(&self, status: &rcs::Status) -> Option<OwnCommand> {
        let is_built_in = BUILT_IN.iter().any(|known| known.name == status.command);
        if status.command.is_empty() || is_built_in || status.state() == rcs::ProcessState::Error {
            return None;
        }
        let is_one_shot = |known: &CommandDef| known.is_one_shot && known.name == status.command;
        Some(if self.commands.iter().any(is_one_shot) { OwnCommand::OneShot } else { OwnCommand::Lasting })
    }
}

/// State of a node concerning its children: part of a snapshot.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct ChildLinksState {
    /// Serial of the last command to each child.
    pub(crate) sent: Vec<u64>,
    /// Time of the first cycle, from which on a child without any status counts as silent.
    pub(crate) since: Option<Stamp>,
}

/// A child is silent after this many of its periods, and at least after this time.
const SILENT_PERIODS: u64 = 5;
const SILENT_NS: u64 = 500_000_000;

impl ChildLinks {
    pub(crate) fn new(me: Arc<str>, links: Vec<Link>) -> Self {
        let state = ChildLinksState { sent: vec![0; links.len()], since: None };
        Self { me, links, state }
    }

    pub(crate) fn begin_cycle(&mut self, now: Stamp) {
        if self.state.since.is_none() {
            self.state.since = Some(now);
        }
    }

    pub(crate) fn index(&self, slot: usize, place: usize) -> Option<usize> {
        let mut of_slot = self.links.iter().enumerate().filter(|(_, link)| link.slot == slot);
        of_slot.nth(place).map(|(index, _)| index)
    }

    /// The refusal of the last command sent, if the child cannot obey it.
    pub(crate) fn refusal<'s>(&self, status: &'s rcs::Status, sent: u64) -> Option<&'s rcs::Refusal> {
        let ours = |refused: &&rcs::Refusal| refused.serial == sent && *refused.writer == *self.me;
        status.refused.as_ref().filter(|refused| sent > 0 && !refused.no_authority && ours(refused))
    }

    /// Whether it obeys another commander, who has the authority over it, or had it when the last command arrived.
    pub(crate) fn obeys_another(&self, status: &rcs::Status, sent: u64) -> bool {
        self.is_another(&status.commander)
            && (self.is_another(&status.owner) || status.supervisor_serial >= sent)
    }

    /// Whether it has accepted the last command sent, and no other one since.
    pub(crate) fn obeys_last(&self, status: &rcs::Status, sent: u64) -> bool {
        let is_echoed = *status.commander == *self.me && status.echo_serial == sent;
        sent > 0 && is_echoed && self.refusal(status, sent).is_none()
    }

    /// Whether the last command sent has arrived, and it obeys another one: of the operator, or an older one.
    pub(crate) fn is_overruled(&self, status: &rcs::Status, sent: u64) -> bool {
        if self.is_another(&status.commander) {
            return status.supervisor_serial >= sent;
        }
        sent > 0 && status.supervisor_serial == sent && status.echo_serial != sent
    }

    fn is_another(&self, name: &str) -> bool {
        !name.is_empty() && *name != *self.me
    }

    /// State of a child that is not silent.
    pub(crate) fn state_of(&self, index: usize, status: Option<&rcs::Status>) -> ChildState {
        let sent = self.state.sent[index];
        let Some(status) = status else {
            return if sent > 0 { ChildState::Exec } else { ChildState::Uninitialized };
        };
        if self.refusal(status, sent).is_some() {
            return ChildState::Error;
        }
        let answered = status.supervisor_serial >= sent && status.echo_serial == sent;
        if sent > 0 && !answered && !self.obeys_another(status, sent) {
            return ChildState::Exec;
        }
        match status.state() {
            rcs::ProcessState::Uninitialized => ChildState::Uninitialized,
            rcs::ProcessState::Exec => ChildState::Exec,
            rcs::ProcessState::Done => ChildState::Done,
            rcs::ProcessState::Error => ChildState::Error,
        }
    }
}

/// The text of a status, if it answers the last command sent. A child that executes the command before that one still
/// does what it says until it has read the last one.
pub(crate) fn answer(status: &rcs::Status, sent: u64) -> Option<&str> {
    let serial = status.supervisor_serial;
    let is_one_behind = serial > 0 && sent.saturating_sub(serial) == 1;
    let executes = status.state() == rcs::ProcessState::Exec;
    (serial >= sent || is_one_behind && executes).then_some(status.state_text.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs::ProcessState::{Done, Error, Exec};

    fn status(
        state: rcs::ProcessState,
        commander: &str,
        echo_serial: u64,
        supervisor_serial: u64,
    ) -> rcs::Status {
        let commander = commander.to_owned();
        rcs::Status {
            state: state.into(),
            commander,
            echo_serial,
            supervisor_serial,
            ..rcs::Status::default()
        }
    }

    fn seen(sent: u64, status: Option<&rcs::Status>) -> ChildState {
        let name = "child".into();
        let link = Link { slot: 0, name, input: 0, output: 0, silent_ns: SILENT_NS, commands: &[] };
        let state = ChildLinksState { sent: vec![sent], since: None };
        ChildLinks { me: "boss".into(), links: vec![link], state }.state_of(0, status)
    }

    #[test]
    fn a_child_is_exec_until_its_echo_equals_the_serial_that_was_sent() {
        assert_eq!(seen(0, None), ChildState::Uninitialized);
        assert_eq!(seen(5, None), ChildState::Exec);
        assert_eq!(seen(5, Some(&status(Done, "boss", 4, 4))), ChildState::Exec, "an old DONE");
        assert_eq!(seen(5, Some(&status(Error, "boss", 4, 4))), ChildState::Exec, "an old ERROR");
        assert_eq!(seen(5, Some(&status(Done, "boss", 5, 5))), ChildState::Done);
        assert_eq!(seen(5, Some(&status(Error, "boss", 5, 5))), ChildState::Error);
    }

    #[test]
    fn a_child_that_executes_keeps_its_text_until_it_has_read_the_next_command() {
        let text = |state, serial| {
            let state_text = "path of 4.9 m".to_owned();
            let status = rcs::Status { state_text, ..status(state, "boss", serial, serial) };
            answer(&status, 5).map(str::to_owned)
        };
        let known = Some("path of 4.9 m".to_owned());
        assert_eq!(text(Exec, 5), known);
        assert_eq!(text(Error, 5), known);
        assert_eq!(text(Exec, 4), known, "it is one command behind");
        assert_eq!(text(Exec, 3), None, "it does not answer");
        assert_eq!((text(Done, 4), text(Error, 4)), (None, None), "what it says is of an old command");
        assert_eq!(answer(&status(Exec, "", 0, 0), 1), None, "it has not answered any command");
    }

    #[test]
    fn an_equal_serial_of_the_operators_is_no_answer() {
        assert_eq!(seen(5, Some(&status(Done, "operator", 5, 4))), ChildState::Exec);
        let taken = status(Done, "operator", 9, 5);
        assert_eq!(seen(5, Some(&taken)), ChildState::Done, "it has seen 5 and obeys the operator");
    }

    #[test]
    fn a_refusal_of_what_was_sent_is_an_error_unless_someone_else_has_the_authority() {
        let refused = |no_authority| {
            let writer = "boss".to_owned();
            let refused = rcs::Refusal { writer, serial: 5, no_authority, ..rcs::Refusal::default() };
            rcs::Status { refused: Some(refused), ..status(Exec, "operator", 3, 5) }
        };
        assert_eq!(seen(5, Some(&refused(false))), ChildState::Error);
        assert_eq!(seen(5, Some(&refused(true))), ChildState::Exec, "the operator's command holds");
        assert_eq!(seen(6, Some(&refused(false))), ChildState::Exec, "that was the command before");
    }

    #[test]
    fn a_command_is_overruled_when_it_has_arrived_and_the_child_obeys_another_one() {
        let links = ChildLinks { me: "boss".into(), ..ChildLinks::default() };
        let answer = |status: &rcs::Status| (links.obeys_last(status, 5), links.is_overruled(status, 5));
        let waits = (false, false);
        let (obeys, overruled) = ((true, false), (false, true));
        assert_eq!(answer(&status(Exec, "boss", 5, 5)), obeys);
        assert_eq!(answer(&status(Exec, "boss", 4, 4)), waits, "it has not arrived");
        assert_eq!(answer(&status(Exec, "operator", 9, 4)), waits, "it has not arrived");
        assert_eq!(answer(&status(Exec, "boss", 4, 5)), overruled, "refused, and the one before is in force");
        assert_eq!(answer(&status(Exec, "", 0, 5)), overruled, "refused, and there was none before");
        assert_eq!(answer(&status(Exec, "operator", 5, 5)), overruled, "an equal serial of the operator's");
        let writer = "boss".to_owned();
        let refused = Some(rcs::Refusal { writer, serial: 5, ..rcs::Refusal::default() });
        let invalid = rcs::Status { refused, ..status(Error, "boss", 5, 5) };
        assert_eq!(answer(&invalid), waits, "it cannot obey the command, and nobody overruled it");
    }

    #[test]
    fn a_failure_has_the_name_of_the_child_and_its_reason() {
        let failure = |state| {
            let report = ChildReport {
                name: "child".into(),
                state,
                text: "blind".to_owned(),
                owner: Owner::Us,
                obeys_another: None,
                obeys_last: true,
                is_overruled: false,
                own_command: None,
            };
            report.failure()
        };
        assert_eq!(failure(ChildState::Error).as_deref(), Some("child is in ERROR: blind"));
        assert_eq!(failure(ChildState::Silent).as_deref(), Some("child is silent: blind"));
        for state in [ChildState::Uninitialized, ChildState::Exec, ChildState::Done] {
            assert_eq!(failure(state), None);
        }
    }
}
