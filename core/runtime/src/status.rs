//! RCS's contract of status and command.
//!
//! A command carries a serial. A status echoes it. A supervisor treats a child as `EXEC` until the echo equals what it
//! sent, so that an old `DONE` is never mistaken for the new one: [`child_state`].

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

/// What a process says of itself, kept from cycle to cycle.
#[derive(Clone, Debug)]
pub(crate) struct StatusCell {
    pub(crate) process: Arc<str>,
    pub(crate) command: Arc<str>,
    pub(crate) echo_serial: u64,
    pub(crate) state: rcs::ProcessState,
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
            command: "".into(),
            echo_serial: 0,
            state: rcs::ProcessState::Uninitialized,
            text: Text::Static("waits for its first command"),
            source_line: source_line(Location::caller()),
            cycle: 0,
            faults: 0,
            last_fault: Text::default(),
        }
    }

    fn from_status(status: &rcs::Status) -> Self {
        Self {
            process: status.process.as_str().into(),
            command: status.command.as_str().into(),
            echo_serial: status.echo_serial,
            state: status.state(),
            text: status.state_text.clone().into(),
            source_line: status.source_line.as_str().into(),
            cycle: status.cycle,
            faults: status.faults,
            last_fault: status.last_fault.clone().into(),
        }
    }

    #[track_caller]
    pub(crate) fn set(&mut self, state: rcs::ProcessState, text: Text) {
        if state != self.state || text != self.text {
            self.source_line = source_line(Location::caller());
            self.state = state;
            self.text = text;
        }
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
        rcs::Status {
            timestamp: Some(now.to_proto()),
            process: cell.process.to_string(),
            command: cell.command.to_string(),
            echo_serial: cell.echo_serial,
            state: cell.state.into(),
            state_text: cell.text.as_str().to_owned(),
            source_line: cell.source_line.to_string(),
            cycle: cell.cycle,
            faults: cell.faults,
            last_fault: cell.last_fault.as_str().to_owned(),
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

/// [`StatusCell`] as it is written to disk.
#[derive(Serialize, Deserialize)]
pub(crate) struct StatusOnDisk(Vec<u8>);

impl From<&StatusCell> for StatusOnDisk {
    fn from(cell: &StatusCell) -> Self {
        let status: rcs::Status = cell.record(Stamp(0)).into();
        Self(prost::Message::encode_to_vec(&status))
    }
}

impl TryFrom<&StatusOnDisk> for StatusCell {
    type Error = prost::DecodeError;

    fn try_from(disk: &StatusOnDisk) -> Result<Self, Self::Error> {
        let status: rcs::Status = prost::Message::decode(disk.0.as_slice())?;
        Ok(Self::from_status(&status))
    }
}

/// How a supervisor must see a child to which it sent `sent_serial`: `EXEC` until the echo equals it.
pub fn child_state(sent_serial: u64, status: Option<&rcs::Status>) -> rcs::ProcessState {
    match status {
        Some(status) if status.echo_serial == sent_serial => status.state(),
        _ => rcs::ProcessState::Exec,
    }
}
