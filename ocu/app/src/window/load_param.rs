//! Loading a file into a parameter of a process: learned models, for example.

use super::dialog::{PathRow, Purpose, dialog};
use rcs_msg::AnyMessage;
use rcs_msg::params::with_params;
use std::sync::Arc;

/// The dialog, while it is open.
pub(super) struct LoadParam {
    process: Arc<str>,
    field: String,
    in_force: AnyMessage,
    path: PathRow,
}

/// What became of the dialog.
pub(super) enum Loaded {
    Cancelled,
    /// The parameters of a process, to be written.
    Params {
        process: Arc<str>,
        message: AnyMessage,
    },
}

impl LoadParam {
    /// Asks for the file whose text becomes the parameter `field`.
    pub(super) fn new(process: Arc<str>, field: String, in_force: AnyMessage) -> Self {
        Self { process, field, in_force, path: PathRow::new("") }
    }

    /// Paints the dialog; `None` while it is open.
    pub(super) fn ui(&mut self, ctx: &egui::Context) -> Option<Loaded> {
        let mut loaded = None;
        let Self { process, field, in_force, path } = self;
        let open = dialog(ctx, &format!("Load {field} of {process}"), |ui| {
            loaded = path.ui(ui, Purpose::Load, true, |path| {
                let text = crate::assets::read_text(path);
                let text = text.map_err(|error| anyhow::anyhow!("{error}: {}", path.display()))?;
                let message = with_params(in_force, [(field.as_str(), text.as_str())])?;
                Ok(Loaded::Params { process: Arc::clone(process), message })
            });
        });
        loaded.or_else(|| (!open).then_some(Loaded::Cancelled))
    }
}
