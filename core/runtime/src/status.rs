//! Statuses of processes.
//!
//! A status echoes the serial of the command that the process obeys. While the owner's last command is refused, the
//! status is `ERROR` with the reason, whatever state the process itself sets.

use prost::Message as _;
use rcs_msg::{DeferredSource, Stamp, rcs};
use serde::{Deserialize, Serialize};
use std::panic::Location;
use std::sync::{Arc, OnceLock};

/// A line of text, cheap to clone.
#[derive(Clone, Debug)]
pub enum Text {
    /// Known at compile time.
    Static(&'static str),
    /// Made at run time.
    Shared(Arc<str>),
}

/// Compares the text, because a text that was read from disk is no longer static.
impl PartialEq for Text {
    fn eq(&self, other: &Self) -> bool {
        let (a, b) = (self.as_str(), other.as_str());
        std::ptr::eq(a, b) || a == b
    }
}

impl Eq for Text {}

impl Text {
    /// The text.
    pub fn as_str(&self) -> &str {
        match self {
            Text::Static(text) => text,
            Text::Shared(text) => text,
        }
    }
}

impl Default for Text {
    fn default() -> Self {
        Text::Static("")
    }
}

impl From<&'static str> for Text {
    fn from(text: &'static str) -> Self {
        Text::Static(text)
    }
}

impl From<String> for Text {
    fn from(text: String) -> Self {
        Text::Shared(text.into())
    }
}

impl Serialize for Text {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_str())
    }
}

impl<'de> Deserialize<'de> for Text {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer).map(Text::from)
    }
}

/// File and line, for a status. Created once per transition, not once per cycle.
fn source_line(location: &Location<'_>) -> Arc<str> {
    format!("{}:{}", location.file(), location.line()).into()
}

/// The part of a status about commands. It changes when a command arrives, not with every cycle.
#[derive(Clone, Debug, Default)]
pub(crate) struct Obeyed {
    pub(crate) command: String,
    pub(crate) echo_serial: u64,
    pub(crate) owner: String,
    pub(crate) commander: String,
    pub(crate) supervisor_serial: u64,
    pub(crate) operator_serial: u64,
    pub(crate) refused: Option<rcs::Refusal>,
    /// If the owner's last command was refused: text and source line of the `ERROR` that is shown until a command is
    /// accepted.
    pub(crate) rejected: Option<(Text, Arc<str>)>,
}

/// Everything in a status except time and cycle; the statuses of many cycles share it.
#[derive(Debug)]
struct StatusContent {
    process: Arc<str>,
    obeyed: Arc<Obeyed>,
    state: rcs::ProcessState,
    text: Text,
    source_line: Arc<str>,
    faults: u64,
    last_fault: Text,
    /// Encoded fields before and after the cycle. Created when a status is first encoded.
    encoded: OnceLock<[Vec<u8>; 2]>,
}

impl Clone for StatusContent {
    /// Used for a change, so the encoded fields are not copied.
    fn clone(&self) -> Self {
        Self {
            process: Arc::clone(&self.process),
            obeyed: Arc::clone(&self.obeyed),
            state: self.state,
            text: self.text.clone(),
            source_line: Arc::clone(&self.source_line),
            faults: self.faults,
            last_fault: self.last_fault.clone(),
            encoded: OnceLock::new(),
        }
    }
}

impl StatusContent {
    fn shown_state(&self) -> rcs::ProcessState {
        if self.obeyed.rejected.is_some() { rcs::ProcessState::Error } else { self.state }
    }

    /// The text about the shown state, and the source line that set it.
    fn shown_text(&self) -> (&Text, &Arc<str>) {
        match &self.obeyed.rejected {
            Some((text, source_line)) => (text, source_line),
            None => (&self.text, &self.source_line),
        }
    }

    /// The fields before the cycle, without the time.
    fn head(&self) -> rcs::Status {
        let obeyed = &*self.obeyed;
        let (text, source_line) = self.shown_text();
        rcs::Status {
            process: self.process.to_string(),
            command: obeyed.command.clone(),
            echo_serial: obeyed.echo_serial,
            state: self.shown_state().into(),
            state_text: text.as_str().to_owned(),
            source_line: source_line.to_string(),
            ..rcs::Status::default()
        }
    }

    /// Appends the fields after the cycle to `head`.
    fn with_tail(&self, head: rcs::Status) -> rcs::Status {
        let obeyed = &*self.obeyed;
        rcs::Status {
            faults: self.faults,
            last_fault: self.last_fault.as_str().to_owned(),
            owner: obeyed.owner.clone(),
            commander: obeyed.commander.clone(),
            supervisor_serial: obeyed.supervisor_serial,
            refused: obeyed.refused.clone(),
            operator_serial: obeyed.operator_serial,
            ..head
        }
    }

    fn encoded(&self) -> &[Vec<u8>; 2] {
        let tail = || self.with_tail(rcs::Status::default());
        self.encoded.get_or_init(|| [self.head().encode_to_vec(), tail().encode_to_vec()])
    }
}

/// The status of a process, kept from cycle to cycle.
#[derive(Clone, Debug)]
pub(crate) struct StatusCell {
    content: Arc<StatusContent>,
    pub(crate) cycle: u64,
}

impl StatusCell {
    #[track_caller]
    pub(crate) fn new(process: Arc<str>) -> Self {
        let content = StatusContent {
            process,
            obeyed: Arc::default(),
            state: rcs::ProcessState::Uninitialized,
            text: Text::Static("waits for its first command"),
            source_line: source_line(Location::caller()),
            faults: 0,
            last_fault: Text::default(),
            encoded: OnceLock::new(),
        };
        Self { content: Arc::new(content), cycle: 0 }
    }

    fn from_status(status: &rcs::Status) -> Self {
        let obeyed = Obeyed {
            command: status.command.clone(),
            echo_serial: status.echo_serial,
            owner: status.owner.clone(),
            commander: status.commander.clone(),
            supervisor_serial: status.supervisor_serial,
            operator_serial: status.operator_serial,
            refused: status.refused.clone(),
            rejected: None,
        };
        let content = StatusContent {
            process: status.process.as_str().into(),
            obeyed: Arc::new(obeyed),
            state: status.state(),
            text: status.state_text.clone().into(),
            source_line: status.source_line.as_str().into(),
            faults: status.faults,
            last_fault: status.last_fault.clone().into(),
            encoded: OnceLock::new(),
        };
        Self { content: Arc::new(content), cycle: status.cycle }
    }

    /// Name of the process.
    pub(crate) fn process(&self) -> &Arc<str> {
        &self.content.process
    }

    /// The part about commands, to change it.
    pub(crate) fn obeyed_mut(&mut self) -> &mut Obeyed {
        Arc::make_mut(&mut self.content_mut().obeyed)
    }

    fn content_mut(&mut self) -> &mut StatusContent {
        let content = Arc::make_mut(&mut self.content);
        content.encoded.take();
        content
    }

    /// The state in the status.
    pub(crate) fn state(&self) -> rcs::ProcessState {
        self.content.shown_state()
    }

    /// What the status says about its state.
    pub(crate) fn shown_text(&self) -> &str {
        self.content.shown_text().0.as_str()
    }

    /// The state that the process itself has set.
    pub(crate) fn text(&self) -> &str {
        self.content.text.as_str()
    }

    /// Faults so far.
    pub(crate) fn faults(&self) -> u64 {
        self.content.faults
    }

    /// The last of them; empty where there was none.
    pub(crate) fn last_fault(&self) -> &str {
        self.content.last_fault.as_str()
    }

    #[track_caller]
    pub(crate) fn set(&mut self, state: rcs::ProcessState, text: Text) {
        if state != self.content.state || text != self.content.text {
            let caller = Location::caller();
            let content = self.content_mut();
            content.source_line = source_line(caller);
            content.state = state;
            content.text = text;
        }
    }

    /// Shows `ERROR` with this text until a command is accepted.
    #[track_caller]
    pub(crate) fn reject(&mut self, text: String) {
        let line = source_line(Location::caller());
        self.obeyed_mut().rejected = Some((text.into(), line));
    }

    pub(crate) fn fault(&mut self, text: Text) {
        let content = self.content_mut();
        content.faults += 1;
        content.last_fault = text;
    }

    /// The status as a message; it costs one reference count until it is accessed.
    pub(crate) fn record(&self, now: Stamp) -> StatusRecord {
        StatusRecord { now, cell: self.clone() }
    }
}

/// A status that is converted to an [`rcs::Status`] at the first access.
#[derive(Clone, Debug)]
pub(crate) struct StatusRecord {
    now: Stamp,
    cell: StatusCell,
}

impl DeferredSource<rcs::Status> for StatusRecord {
    fn to_message(&self) -> rcs::Status {
        let content = &*self.cell.content;
        let cycle = self.cell.cycle;
        rcs::Status { timestamp: Some(self.now.to_proto()), cycle, ..content.with_tail(content.head()) }
    }

    /// Encodes it directly; the bytes equal those of the message, because the fields are in the same order.
    fn encode(&self) -> Vec<u8> {
        let [head, tail] = self.cell.content.encoded();
        let time = rcs::Status { timestamp: Some(self.now.to_proto()), ..rcs::Status::default() };
        let cycle = rcs::Status { cycle: self.cell.cycle, ..rcs::Status::default() };
        // Time and cycle take at most 27 bytes.
        let mut bytes = Vec::with_capacity(27 + head.len() + tail.len());
        time.encode_raw(&mut bytes);
        bytes.extend_from_slice(head);
        cycle.encode_raw(&mut bytes);
        bytes.extend_from_slice(tail);
        bytes
    }
}

impl StatusRecord {
    /// The content of this status.
    pub(crate) fn from_status(status: &rcs::Status) -> Self {
        let now = status.timestamp.as_ref().and_then(Stamp::from_proto).unwrap_or_default();
        Self { now, cell: StatusCell::from_status(status) }
    }
}

/// [`StatusCell`] in its form on disk: what the process has set, and the refusal that hides it.
#[derive(Serialize, Deserialize)]
pub(crate) struct StatusOnDisk {
    status: Vec<u8>,
    rejected: Option<(String, String)>,
}

impl From<&StatusCell> for StatusOnDisk {
    fn from(cell: &StatusCell) -> Self {
        let mut own = cell.clone();
        let rejected = own.obeyed_mut().rejected.take();
        let status = own.record(Stamp(0)).to_message();
        Self {
            status: status.encode_to_vec(),
            rejected: rejected.map(|(text, line)| (text.as_str().to_owned(), line.to_string())),
        }
    }
}

impl TryFrom<&StatusOnDisk> for StatusCell {
    type Error = prost::DecodeError;

    fn try_from(disk: &StatusOnDisk) -> Result<Self, Self::Error> {
        let status: rcs::Status = prost::Message::decode(disk.status.as_slice())?;
        let mut cell = Self::from_status(&status);
        if let Some((text, line)) = &disk.rejected {
            cell.obeyed_mut().rejected = Some((text.clone().into(), line.as_str().into()));
        }
        Ok(cell)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_status_is_encoded_as_its_message_is_whatever_it_says_and_when_it_changes() {
        let mut cell = StatusCell::new("p".into());
        let same = |cell: &StatusCell, now: u64| {
            let record = cell.record(Stamp(now));
            assert_eq!(record.encode(), record.to_message().encode_to_vec());
            record.to_message()
        };
        assert_eq!(same(&cell, 0).process, "p");
        cell.cycle = 300;
        cell.set(rcs::ProcessState::Exec, "works".into());
        let kept = cell.record(Stamp(5));
        assert_eq!(same(&cell, 1_500_000_000).state_text, "works");
        cell.fault("bad input".into());
        *cell.obeyed_mut() = Obeyed {
            command: "RUN".to_owned(),
            echo_serial: 7,
            owner: "operator".to_owned(),
            operator_serial: 7,
            refused: Some(rcs::Refusal { serial: 3, ..rcs::Refusal::default() }),
            ..Obeyed::default()
        };
        let status = same(&cell, u64::MAX / 2);
        assert_eq!((status.faults, status.echo_serial, status.cycle), (1, 7, 300));
        cell.reject("no such command".to_owned());
        assert_eq!(same(&cell, 9).state(), rcs::ProcessState::Error);
        assert_eq!(kept.to_message().faults, 0, "what was recorded before stays as it was");
    }

    #[test]
    fn a_text_that_came_back_from_disk_is_the_same_text() {
        let mut cell = StatusCell::new("p".into());
        cell.set(rcs::ProcessState::Exec, "works".into());
        let mut back = StatusCell::try_from(&StatusOnDisk::from(&cell)).unwrap();
        let line = |cell: &StatusCell| cell.record(Stamp(0)).to_message().source_line;
        back.set(rcs::ProcessState::Exec, "works".into());
        assert_eq!(line(&back), line(&cell));
    }
}
