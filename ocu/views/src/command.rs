//! Commands of the operator to processes.

use rcs_msg::AnyMessage;
use rcs_msg::rcs::{Command, ProcessInfo};
use rcs_runtime::source::{Control, Frame};

/// The serial of the next command to a process: greater than every one that was sent to it or echoed by it.
pub(crate) fn next_serial(frame: &Frame, process: &ProcessInfo) -> u64 {
    let sent = frame.topic(&process.command_buffer).and_then(|topic| topic.get::<Command>());
    let status = frame.status(process);
    let echoed = status.map(|status| status.echo_serial.max(status.supervisor_serial));
    let refused = status.and_then(|status| status.refused.as_ref()).map(|refused| refused.serial);
    let known = [sent.map(|command| command.serial), echoed, refused];
    1 + known.into_iter().flatten().max().unwrap_or(0)
}

/// A command to a process; `serial` must be at least [`next_serial`].
pub(crate) fn send(
    frame: &Frame,
    process: &ProcessInfo,
    serial: u64,
    name: &str,
    parameters: Option<&AnyMessage>,
) -> Control {
    let command = Command {
        timestamp: Some(frame.now.to_proto()),
        serial,
        name: name.to_owned(),
        parameters_schema: parameters.map_or_else(String::new, |message| message.schema().name().to_owned()),
        parameters: parameters.map(AnyMessage::bytes).unwrap_or_default(),
    };
    Control::Write { buffer: process.command_buffer.clone(), message: AnyMessage::new(command) }
}

/// Why nothing can be written here; `None` if it can.
pub(crate) fn refusal(frame: &Frame) -> Option<&'static str> {
    if frame.is_beside {
        Some("This run is shown beside the viewed one: nothing can be written to it.")
    } else if frame.info.kind == rcs_runtime::source::SourceKind::Log {
        Some("A recording cannot be written to; run a stack on it.")
    } else {
        None
    }
}
