//! What a process says of itself: RCS's status.
//!
//! A status echoes the serial of the command that the process obeys. While the last command of its owner is refused,
//! the status says `ERROR` with the reason, whatever the process itself says meanwhile.

use rcs_msg::{Stamp, rcs};
use serde::{Deserialize, Serialize};
use std::panic::Location;
use std::sync::Arc;

/// A line for a person, cheap to clone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Text {
    /// Known at compile time.
    Static(&'static str),
    /// Made at run time.
    Shared(Arc<str>),
}

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

/// File and line, as a status tells it. Made once a transition, not once a cycle.
fn source_line(location: &Location<'_>) -> Arc<str> {
    format!("{}:{}", location.file(), location.line()).into()
}

/// What a status says of commands. It changes when a command arrives, not when a cycle is run: cells share it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Obeyed {
    pub(crate) command: String,
    pub(crate) echo_serial: u64,
    pub(crate) owner: String,
    pub(crate) commander: String,
    pub(crate) supervisor_serial: u64,
    pub(crate) refused: Option<rcs::Refusal>,
    /// The owner's last command was refused: the text and the source line of the `ERROR` that is shown until it sends
    /// one that is accepted.
    pub(crate) rejected: Option<(Text, Arc<str>)>,
}

/// What a process says of itself, kept from cycle to cycle.
#[derive(Clone, Debug)]
pub(crate) struct StatusCell {
    pub(crate) process: Arc<str>,
    pub(crate) obeyed: Arc<Obeyed>,
    state: rcs::ProcessState,
    text: Text,
    source_line: Arc<str>,
    pub(crate) cycle: u64,
    faults: u64,
    last_fault: Text,
}

impl StatusCell {
    #[track_caller]
    pub(crate) fn new(process: Arc<str>) -> Self {
        Self {
            process,
            obeyed: Arc::default(),
            state: rcs::ProcessState::Uninitialized,
            text: Text::Static("waits for its first command"),
            source_line: source_line(Location::caller()),
            cycle: 0,
            faults: 0,
            last_fault: Text::default(),
        }
    }

    fn from_status(status: &rcs::Status) -> Self {
        let obeyed = Obeyed {
            command: status.command.clone(),
            echo_serial: status.echo_serial,
            owner: status.owner.clone(),
            commander: status.commander.clone(),
            supervisor_serial: status.supervisor_serial,
            refused: status.refused.clone(),
            rejected: None,
        };
        Self {
            process: status.process.as_str().into(),
            obeyed: Arc::new(obeyed),
            state: status.state(),
            text: status.state_text.clone().into(),
            source_line: status.source_line.as_str().into(),
            cycle: status.cycle,
            faults: status.faults,
            last_fault: status.last_fault.clone().into(),
        }
    }

    /// The state that is shown.
    pub(crate) fn state(&self) -> rcs::ProcessState {
        if self.obeyed.rejected.is_some() { rcs::ProcessState::Error } else { self.state }
    }

    /// What the process itself says, whatever is shown.
    pub(crate) fn text(&self) -> &str {
        self.text.as_str()
    }

    #[track_caller]
    pub(crate) fn set(&mut self, state: rcs::ProcessState, text: Text) {
        if state != self.state || text != self.text {
            self.source_line = source_line(Location::caller());
            self.state = state;
            self.text = text;
        }
    }

    /// Shows `ERROR` with this text until a command is accepted.
    #[track_caller]
    pub(crate) fn reject(&mut self, text: String) {
        Arc::make_mut(&mut self.obeyed).rejected = Some((text.into(), source_line(Location::caller())));
    }

    pub(crate) fn fault(&mut self, text: Text) {
        self.faults += 1;
        self.last_fault = text;
    }

    /// The status as a message at that time; it costs a few reference counts until someone looks at it.
    pub(crate) fn record(&self, now: Stamp) -> StatusRecord {
        StatusRecord { now, cell: self.clone() }
    }
}

/// A status that becomes an [`rcs::Status`] when someone looks at it.
#[derive(Clone, Debug)]
pub(crate) struct StatusRecord {
    now: Stamp,
    cell: StatusCell,
}

impl From<StatusRecord> for rcs::Status {
    fn from(record: StatusRecord) -> Self {
        let StatusRecord { now, cell } = record;
        let state = cell.state();
        let obeyed = &*cell.obeyed;
        let (text, source_line) = match &obeyed.rejected {
            Some((text, source_line)) => (text, source_line),
            None => (&cell.text, &cell.source_line),
        };
        rcs::Status {
            timestamp: Some(now.to_proto()),
            process: cell.process.to_string(),
            command: obeyed.command.clone(),
            echo_serial: obeyed.echo_serial,
            state: state.into(),
            state_text: text.as_str().to_owned(),
            source_line: source_line.to_string(),
            cycle: cell.cycle,
            faults: cell.faults,
            last_fault: cell.last_fault.as_str().to_owned(),
            owner: obeyed.owner.clone(),
            commander: obeyed.commander.clone(),
            supervisor_serial: obeyed.supervisor_serial,
            refused: obeyed.refused.clone(),
        }
    }
}

impl StatusRecord {
    /// The record that became this status.
    pub(crate) fn from_status(status: &rcs::Status) -> Self {
        let now = status.timestamp.as_ref().and_then(Stamp::from_proto).unwrap_or_default();
        Self { now, cell: StatusCell::from_status(status) }
    }
}

/// [`StatusCell`] as it is written to disk: what the process says, and the refusal that hides it.
#[derive(Serialize, Deserialize)]
pub(crate) struct StatusOnDisk {
    status: Vec<u8>,
    rejected: Option<(String, String)>,
}

impl From<&StatusCell> for StatusOnDisk {
    fn from(cell: &StatusCell) -> Self {
        let mut own = cell.clone();
        let rejected = Arc::make_mut(&mut own.obeyed).rejected.take();
        let status: rcs::Status = own.record(Stamp(0)).into();
        Self {
            status: prost::Message::encode_to_vec(&status),
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
            Arc::make_mut(&mut cell.obeyed).rejected = Some((text.clone().into(), line.as_str().into()));
        }
        Ok(cell)
    }
}
