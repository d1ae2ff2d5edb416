//! Commands of the operator to processes.

use crate::view::ViewContext;
use rcs_msg::AnyMessage;
use rcs_msg::rcs::{Command, ProcessInfo, Status};
use rcs_runtime::source::{Control, Frame};

/// The serial of the next command to a process: greater than every one that a frame shows, of whoever sent it.
fn next_serial(frame: &Frame, process: &ProcessInfo) -> u64 {
    let sent = frame.topic(&process.command_buffer).and_then(|topic| topic.get::<Command>());
    let status = frame.status(process);
    let told = |status: &Status| status.echo_serial.max(status.supervisor_serial).max(status.operator_serial);
    let refused = status.and_then(|status| status.refused.as_ref()).map(|refused| refused.serial);
    let known = [sent.map(|command| command.serial), status.map(told), refused];
    1 + known.into_iter().flatten().max().unwrap_or(0)
}

/// Sends a command to a process.
pub(crate) fn send(
    cx: &mut ViewContext<'_>,
    process: &ProcessInfo,
    name: &str,
    parameters: Option<&AnyMessage>,
) {
    // No frame may have the last one yet.
    let last = cx.selection.serials.get(&process.name).copied().unwrap_or(0);
    let serial = next_serial(cx.frame, process).max(last + 1);
    cx.selection.serials.insert(process.name.clone(), serial);
    let command = Command {
        timestamp: Some(cx.frame.now.to_proto()),
        serial,
        name: name.to_owned(),
        parameters_schema: parameters.map_or_else(String::new, |message| message.schema().name().to_owned()),
        parameters: parameters.map(AnyMessage::bytes).unwrap_or_default(),
    };
    let message = AnyMessage::new(command);
    cx.controls.push(Control::Write { buffer: process.command_buffer.clone(), message });
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail")]
mod tests {
    use super::*;
    use crate::samples;
    use crate::view::Selection;

    #[test]
    fn a_serial_is_greater_than_those_of_both_commanders_and_than_one_that_no_frame_has_yet() {
        let (command_buffer, status_buffer) = ("/p/command".to_owned(), "/p/status".to_owned());
        let command = Command { serial: 2, ..Command::default() };
        let status = Status { echo_serial: 2, supervisor_serial: 2, operator_serial: 3, ..Status::default() };
        let topics = [
            samples::topic(&command_buffer, 0.0, 0.1, command),
            samples::topic(&status_buffer, 10.0, 0.1, status),
        ];
        let frame = Frame { topics: topics.into(), ..samples::empty() };
        let process =
            ProcessInfo { name: "p".to_owned(), command_buffer, status_buffer, ..ProcessInfo::default() };
        let (mut controls, mut selection, mut wishes) = (Vec::new(), Selection::default(), Vec::new());
        let mut cx = ViewContext {
            frame: &frame,
            controls: &mut controls,
            selection: &mut selection,
            wishes: &mut wishes,
        };
        send(&mut cx, &process, "RUN", None);
        send(&mut cx, &process, "HALT", None);
        let serial = |control: &Control| match control {
            Control::Write { message, .. } => message.get::<Command>().unwrap().serial,
            other => panic!("{other:?}"),
        };
        assert_eq!(controls.iter().map(serial).collect::<Vec<_>>(), [4, 5]);
    }
}
