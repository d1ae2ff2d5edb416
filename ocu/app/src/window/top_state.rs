//! What the bar at the top shows, and what it asks for.

use super::alarm_sound::AlarmSound;
use super::commands::Command;
use super::document::Document;
use super::follow::Growth;
use super::keymap::Keymap;
use super::layout_store::LayoutStore;
use super::operate::StopState;
use crate::open::Request;
use ocu_views::ViewType;
use rcs_runtime::RunId;
use rcs_runtime::source::Frame;
use std::path::PathBuf;

/// What the bar shows.
pub(super) struct State<'a> {
    pub(super) frame: Option<&'a Frame>,
    pub(super) current: &'a Request,
    pub(super) opening: Option<String>,
    pub(super) recent: &'a [Request],
    pub(super) buffers_open: bool,
    pub(super) layout_name: &'a str,
    pub(super) layouts: &'a LayoutStore,
    /// The arrangement with its history.
    pub(super) document: &'a Document,
    pub(super) keymap: &'a Keymap,
    pub(super) stop: StopState,
    /// Whether a control of manual driving is deflected.
    pub(super) pushed: bool,
    /// Alarms of the viewed run up to this time are known to the user.
    pub(super) known_until: rcs_msg::Stamp,
    pub(super) alarm_sound: &'a AlarmSound,
    /// Whether the recording is still being written.
    pub(super) growth: Growth,
}

/// An action requested by the user.
pub(super) enum TopBarAction {
    Ask,
    Open(Request),
    /// Restart the source.
    Restart,
    /// Set or release the emergency stop.
    EmergencyStop(bool),
    /// Begin to record to this file.
    Record(PathBuf),
    /// End the recording.
    StopRecording,
    /// Go to the time of something that happened, and pause there.
    PauseAt(rcs_msg::Stamp),
    /// Go to the newest time of the run that is shown.
    ToNewest,
    /// The alarms of the viewed run up to this time are known.
    Acknowledge(rcs_msg::Stamp),
    /// Show another run of the stack.
    SwitchRun(RunId),
    /// Undo the last write.
    Undo,
    /// Release what is held: the override with this number, or all of them.
    Release(Option<u64>),
    ToggleBuffers,
    ToggleTheme,
    Help,
    AddView(&'static ViewType),
    Layout(String),
    /// Keep the arrangement under this name.
    SaveLayout(String),
    /// Delete the user's layout with this name.
    DeleteLayout(String),
    FittingLayout,
    Palette,
    /// Carry out a command of the table.
    Run(Command),
}

/// The actions of one pass.
pub(super) type Actions = Vec<TopBarAction>;
