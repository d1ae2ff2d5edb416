//! Loading a file into a parameter of a process: learned models, for example.

use super::dialog::{PathRow, Purpose, dialog};
use rcs_msg::AnyMessage;
use rcs_msg::params::with_params;
use rcs_runtime::source::Frame;
use std::sync::Arc;

/// The dialog, while it is open.
pub(super) struct LoadParam {
    process: Arc<str>,
    field: String,
    path: PathRow,
}

/// What became of the dialog.
pub(super) enum Loaded {
    Cancelled,
    /// The parameters of the process, to be written to their buffer.
    Params {
        buffer: String,
        message: AnyMessage,
    },
}

impl LoadParam {
    /// Asks for the file whose text becomes the parameter `field`.
    pub(super) fn new(process: Arc<str>, field: String) -> Self {
        Self { process, field, path: PathRow::new("") }
    }

    /// Paints the dialog; `None` while it is open.
    pub(super) fn ui(&mut self, ctx: &egui::Context, frame: Option<&Frame>) -> Option<Loaded> {
        let mut loaded = None;
        let Self { process, field, path } = self;
        let open = dialog(ctx, &format!("Load {field} of {process}"), |ui| {
            loaded = path.ui(ui, Purpose::Load, true, |path| {
                let text = crate::assets::read_text(path);
                let text = text.map_err(|error| anyhow::anyhow!("{error}: {}", path.display()))?;
                anyhow::ensure!(
                    !text.trim().is_empty(),
                    "expected a text, got an empty file: {}",
                    path.display()
                );
                params(frame, process, field, &text)
            });
        });
        loaded.or_else(|| (!open).then_some(Loaded::Cancelled))
    }
}

/// The parameters in force in a frame, of which one has another text.
fn params(frame: Option<&Frame>, process: &str, field: &str, text: &str) -> anyhow::Result<Loaded> {
    let info = frame.and_then(|frame| frame.processes.iter().find(|info| info.name == process));
    let buffer = info.map(|info| info.params_buffer.clone()).unwrap_or_default();
    let in_force = frame.and_then(|frame| frame.topic(&buffer)?.canonical());
    let in_force = in_force.ok_or_else(|| anyhow::anyhow!("the parameters of {process} are not known"))?;
    let message = with_params(in_force, [(field, text)])?;
    Ok(Loaded::Params { buffer, message })
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message as _;
    use rcs_bus::{Header, Sample, WriterId};
    use rcs_msg::rcs::{ModelToDelete, ProcessInfo};
    use rcs_msg::{Stamp, schema_of};
    use rcs_runtime::source::{RunTag, Topic};

    /// A process whose parameters in force have this number.
    fn frame(number: u32) -> Frame {
        let now = Stamp(1_000_000_000);
        let header = Header { sequence: 1, log_time: now, acq_time: now, writer: WriterId::RUNTIME };
        let params = ModelToDelete { output: "kept".to_owned(), number, ..ModelToDelete::default() };
        let topic = Topic::new("/a/params", RunTag::FIRST, Arc::clone(schema_of::<ModelToDelete>()))
            .with_latest(Sample { header, message: AnyMessage::new(params) });
        let process =
            ProcessInfo { name: "a".into(), params_buffer: "/a/params".into(), ..ProcessInfo::default() };
        let empty = Frame::empty(Arc::default(), now);
        Frame { topics: Arc::new([topic]), processes: Arc::new([process]), ..empty }
    }

    #[test]
    fn a_file_changes_its_own_parameter_of_those_in_force_when_it_is_loaded() {
        for number in [3, 4] {
            let loaded = params(Some(&frame(number)), "a", "name", "grass").unwrap();
            let Loaded::Params { buffer, message } = loaded else { panic!("nothing is written") };
            let params = ModelToDelete::decode(message.bytes()).unwrap();
            assert_eq!(buffer, "/a/params");
            assert_eq!((&*params.output, params.number, &*params.name), ("kept", number, "grass"));
        }
        let error = params(Some(&frame(3)), "b", "name", "grass").err().map(|error| error.to_string());
        assert_eq!(error.as_deref(), Some("the parameters of b are not known"));
    }
}
