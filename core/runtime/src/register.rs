//! The command register: the commands that a process has got, and from whom. It is part of the process's state.
//!
//! The register decides about each command when it arrives, in the order in which commands were written:
//!
//! 1. The writer is the operator, the supervisor, or neither; in the last case the command is refused.
//! 2. A serial that is not greater than the writer's last one is refused.
//! 3. Either the operator or the supervisor has the authority. The operator takes it from the supervisor with any
//!    command; the supervisor is refused while the operator has it. The operator loses it by `RELEASE`, or after
//!    `authority_s` of the stack without a command, in simulated time. Losing it does not change what the process does.
//! 4. The command must be one of the process's, with parameters of its type and within their ranges. A command of the
//!    process's own requires that the process runs, and a process that panicked obeys `INIT` only.
//!
//! A command that fails at 1 to 3 is a fault and is reported in `Status.refused`; the owner's last command stays in
//! force. A command that fails at 4 came from the owner: its serial is echoed with `ERROR` and the reason, until a
//! command is accepted. An accepted command is echoed together with `EXEC` in the next status, before the process can
//! report anything else. A one-shot does not end the command of the process's own that is in force: the status goes on
//! naming that.

use crate::command::{CommandDef, Decode, HALT, INIT, RELEASE, RUN, TAKE, Typed, no_parameters};
use crate::status::{Obeyed, StatusCell};
use rcs_bus::{Sample, WriterId};
use rcs_msg::{Stamp, rcs};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::Arc;

/// Which function of the process is called.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Phase {
    /// Before its first command.
    #[default]
    Uninitialized,
    /// `Process::init`
    Init,
    /// `Process::cycle`
    Run,
    /// `Process::halt`
    Halt,
}

/// The two commanders of a process; the greater one takes the authority from the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) enum Authority {
    Supervisor,
    Operator,
}

/// The commanders of one process, and how long the operator's authority lasts without a command.
pub(crate) struct CommandSources {
    /// `None` below the viewer: then the operator is the only commander.
    pub(crate) supervisor: Option<WriterId>,
    pub(crate) lease_ns: u64,
    /// Names of the writers of the run.
    pub(crate) names: Arc<[Arc<str>]>,
}

impl CommandSources {
    fn authority(&self, writer: WriterId) -> Option<Authority> {
        if writer == WriterId::OPERATOR {
            Some(Authority::Operator)
        } else if Some(writer) == self.supervisor {
            Some(Authority::Supervisor)
        } else {
            None
        }
    }

    fn name(&self, writer: WriterId) -> &str {
        self.names.get(usize::from(writer.0)).map_or("unknown", |name| name)
    }

    fn name_of(&self, owner: Option<Authority>) -> &str {
        match owner {
            Some(Authority::Operator) => self.name(WriterId::OPERATOR),
            Some(Authority::Supervisor) => self.supervisor.map_or("", |writer| self.name(writer)),
            None => "",
        }
    }

    fn expected(&self) -> String {
        let supervisor = self.supervisor.map(|writer| format!(" or {}", self.name(writer)));
        format!("{}{}", self.name(WriterId::OPERATOR), supervisor.unwrap_or_default())
    }
}

/// An accepted command of the process's own.
#[derive(Clone)]
struct Accepted {
    message: Arc<rcs::Command>,
    /// The decoded command; `None` if the register was read from disk and is not restored into a node yet.
    typed: Option<Typed>,
}

/// The commands of a process: part of its state.
#[derive(Clone, Default)]
pub(crate) struct Register {
    phase: Phase,
    owner: Option<Authority>,
    /// Time of the owner's last command.
    heard: Stamp,
    /// Last serial of the supervisor and of the operator.
    serials: [u64; 2],
    /// The process's own commands that it has not read.
    pending: VecDeque<Accepted>,
    /// The own command in force; a one-shot is none.
    standing: Option<Accepted>,
    /// Whether a command was accepted since the last cycle.
    is_new: bool,
    /// Whether `RUN` was among those.
    is_run_new: bool,
}

/// Effect of a command on the node.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum CommandOutcome {
    /// None.
    Unchanged,
    /// The process continues with another phase.
    Accepted,
    /// The state is to be created again.
    Reset,
}

impl Register {
    pub(crate) fn phase(&self) -> Phase {
        self.phase
    }

    pub(crate) fn is_new(&self) -> bool {
        self.is_new
    }

    pub(crate) fn is_run_new(&self) -> bool {
        self.is_run_new
    }

    /// The next unread own command.
    pub(crate) fn next(&mut self) -> Option<Typed> {
        self.pending.pop_front()?.typed
    }

    /// The own command in force.
    pub(crate) fn standing(&self) -> Option<&Typed> {
        self.standing.as_ref()?.typed.as_ref()
    }

    /// Called after a cycle: discards the own commands that the process did not read.
    pub(crate) fn end_cycle(&mut self) {
        if self.is_new {
            (self.is_new, self.is_run_new) = (false, false);
            self.pending.clear();
        }
    }

    /// Takes the authority from an operator who has sent no command for too long.
    pub(crate) fn lapse(&mut self, now: Stamp, sources: &CommandSources, status: &mut StatusCell) {
        if self.has_lapsed(now, sources) {
            self.owner = None;
            status.obeyed_mut().owner.clear();
        }
    }

    fn has_lapsed(&self, now: Stamp, sources: &CommandSources) -> bool {
        // Below the viewer there is no other commander.
        self.owner == Some(Authority::Operator)
            && sources.supervisor.is_some()
            && now >= self.heard.after_ns(sources.lease_ns)
    }

    /// Decides about a command that arrives, and shows the result in the status.
    pub(crate) fn take(
        &mut self,
        sample: &Sample,
        sources: &CommandSources,
        (decode, commands): (Decode, &[CommandDef]),
        panicked: bool,
        status: &mut StatusCell,
    ) -> CommandOutcome {
        let writer = sources.name(sample.header.writer).to_owned();
        let Some(command) = sample.message.to::<rcs::Command>() else {
            let none = rcs::Command::default();
            refuse(
                status,
                &writer,
                &none,
                Denied { reason: "it does not decode".to_owned(), no_authority: false },
            );
            return CommandOutcome::Unchanged;
        };
        let at = sample.header.log_time;
        let who = match self.admit(sample.header.writer, command.serial, at, sources) {
            Ok(who) => who,
            Err(denied) => {
                self.show_serials(sources, status.obeyed_mut());
                refuse(status, &writer, &command, denied);
                return CommandOutcome::Unchanged;
            }
        };
        if command.name == RELEASE {
            let supervisor = sources.supervisor.map(|_| Authority::Supervisor);
            self.owner = supervisor.filter(|_| who == Authority::Operator);
        }
        let obeyed = status.obeyed_mut();
        sources.name_of(self.owner).clone_into(&mut obeyed.owner);
        self.show_serials(sources, obeyed);
        if [TAKE, RELEASE].contains(&command.name.as_str()) {
            return CommandOutcome::Unchanged;
        }
        obeyed.command.clone_from(&command.name);
        obeyed.commander.clone_from(&writer);
        obeyed.echo_serial = command.serial;
        match self.accept(&command, (decode, commands), panicked, status.text()) {
            Ok(outcome) => {
                self.is_new = true;
                let obeyed = status.obeyed_mut();
                obeyed.rejected = None;
                if let Some(standing) = &self.standing {
                    obeyed.command.clone_from(&standing.message.name);
                }
                status.set(rcs::ProcessState::Exec, format!("obeys {}", command.name).into());
                outcome
            }
            Err(reason) => {
                status.reject(reason.clone());
                note(status, &writer, &command, Denied { reason, no_authority: false });
                CommandOutcome::Unchanged
            }
        }
    }

    /// Shows the last serial of each commander, which the echo does not where both of them command.
    fn show_serials(&self, sources: &CommandSources, obeyed: &mut Obeyed) {
        obeyed.supervisor_serial = self.serials[Authority::Supervisor as usize];
        if sources.supervisor.is_some() {
            obeyed.operator_serial = self.serials[Authority::Operator as usize];
        }
    }

    /// Whether the writer may command the process now.
    fn admit(
        &mut self,
        writer: WriterId,
        serial: u64,
        at: Stamp,
        sources: &CommandSources,
    ) -> Result<Authority, Denied> {
        let Some(who) = sources.authority(writer) else {
            let expected = sources.expected();
            let reason =
                format!("{} may not command this process; expected {expected}", sources.name(writer));
            return Err(Denied { reason, no_authority: true });
        };
        let last = self.serials[who as usize];
        if serial <= last {
            let reason = format!("serial {serial} is old; expected more than {last}");
            return Err(Denied { reason, no_authority: false });
        }
        self.serials[who as usize] = serial;
        if self.owner.is_some_and(|owner| owner > who) && !self.has_lapsed(at, sources) {
            let owner = sources.name_of(self.owner);
            let reason = format!("{owner} has the authority over this process");
            return Err(Denied { reason, no_authority: true });
        }
        self.owner = Some(who);
        self.heard = at;
        Ok(who)
    }

    /// Whether the process can obey the command.
    fn accept(
        &mut self,
        command: &rcs::Command,
        (decode, commands): (Decode, &[CommandDef]),
        panicked: bool,
        state_text: &str,
    ) -> Result<CommandOutcome, String> {
        let name = command.name.as_str();
        let phase = match name {
            INIT => Some(Phase::Init),
            RUN => Some(Phase::Run),
            HALT => Some(Phase::Halt),
            _ => None,
        };
        let typed = match phase {
            Some(_) => {
                no_parameters(command)?;
                None
            }
            None => Some(decode(command)?),
        };
        if panicked && phase != Some(Phase::Init) {
            return Err(format!("{name} needs a process that works; this one {state_text}; expected INIT"));
        }
        let Some(typed) = typed else {
            self.phase = phase.unwrap_or_default();
            self.standing = None;
            self.is_run_new = self.phase == Phase::Run;
            if self.phase != Phase::Run {
                self.pending.clear();
            }
            return Ok(if self.phase == Phase::Init {
                CommandOutcome::Reset
            } else {
                CommandOutcome::Accepted
            });
        };
        if self.phase != Phase::Run {
            return Err(format!("{name} needs a process that runs; expected RUN before it"));
        }
        let accepted = Accepted { message: Arc::new(command.clone()), typed: Some(typed) };
        self.pending.push_back(accepted.clone());
        if !commands.iter().any(|known| known.is_one_shot && known.name == name) {
            self.standing = Some(accepted);
        }
        Ok(CommandOutcome::Accepted)
    }

    /// Decodes the commands of a register from disk; an error if they belong to another kind of process.
    pub(crate) fn decode(&mut self, decode: Decode) -> Result<(), String> {
        for accepted in self.pending.iter_mut().chain(&mut self.standing) {
            if accepted.typed.is_none() {
                accepted.typed = Some(decode(&accepted.message)?);
            }
        }
        Ok(())
    }
}

/// Why a command is not obeyed.
struct Denied {
    reason: String,
    /// Another commander has the authority.
    no_authority: bool,
}

/// Counts a refused command, and records the reason.
fn refuse(status: &mut StatusCell, writer: &str, command: &rcs::Command, denied: Denied) {
    let (name, serial, reason) = (&command.name, command.serial, &denied.reason);
    status.fault(format!("command {name} {serial} of {writer} refused: {reason}").into());
    note(status, writer, command, denied);
}

fn note(status: &mut StatusCell, writer: &str, command: &rcs::Command, denied: Denied) {
    status.obeyed_mut().refused = Some(rcs::Refusal {
        writer: writer.to_owned(),
        serial: command.serial,
        command: command.name.clone(),
        reason: denied.reason,
        no_authority: denied.no_authority,
    });
}

/// [`Register`] in its form on disk.
#[derive(Serialize, Deserialize)]
pub(crate) struct RegisterOnDisk {
    phase: Phase,
    owner: Option<Authority>,
    heard: Stamp,
    serials: [u64; 2],
    pending: Vec<Vec<u8>>,
    standing: Option<Vec<u8>>,
    is_new: bool,
    is_run_new: bool,
}

impl From<&Register> for RegisterOnDisk {
    fn from(register: &Register) -> Self {
        let bytes = |accepted: &Accepted| prost::Message::encode_to_vec(&*accepted.message);
        Self {
            phase: register.phase,
            owner: register.owner,
            heard: register.heard,
            serials: register.serials,
            pending: register.pending.iter().map(bytes).collect(),
            standing: register.standing.as_ref().map(bytes),
            is_new: register.is_new,
            is_run_new: register.is_run_new,
        }
    }
}

impl TryFrom<&RegisterOnDisk> for Register {
    type Error = prost::DecodeError;

    fn try_from(disk: &RegisterOnDisk) -> Result<Self, Self::Error> {
        let accepted = |bytes: &Vec<u8>| -> Result<Accepted, prost::DecodeError> {
            Ok(Accepted { message: Arc::new(prost::Message::decode(bytes.as_slice())?), typed: None })
        };
        Ok(Self {
            phase: disk.phase,
            owner: disk.owner,
            heard: disk.heard,
            serials: disk.serials,
            pending: disk.pending.iter().map(accepted).collect::<Result<_, _>>()?,
            standing: disk.standing.as_ref().map(accepted).transpose()?,
            is_new: disk.is_new,
            is_run_new: disk.is_run_new,
        })
    }
}
