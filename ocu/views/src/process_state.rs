//! How the state of a process looks everywhere: its word, its colour, and until when a status is valid.

use egui::Color32;
use ocu_ui::stale::LEAST_S;
use rcs_msg::rcs::{ProcessInfo, ProcessState};
use rcs_runtime::source::Frame;

/// The words for the state of a process of which a recording that was begun in the middle of its run has no status yet.
pub const NOT_RECORDED: &str = "NOT RECORDED YET";

/// The word for a state.
pub fn state_name(state: ProcessState) -> &'static str {
    match state {
        ProcessState::Uninitialized => "UNINITIALIZED",
        ProcessState::Exec => "EXEC",
        ProcessState::Done => "DONE",
        ProcessState::Error => "ERROR",
    }
}

/// The colour of a state (Albus 2006a, figure 15), for dark text on it.
pub fn state_color(state: ProcessState) -> Color32 {
    match state {
        ProcessState::Uninitialized => Color32::from_rgb(238, 160, 190),
        ProcessState::Exec => Color32::from_rgb(92, 184, 108),
        ProcessState::Done => Color32::from_rgb(240, 242, 243),
        ProcessState::Error => Color32::from_rgb(226, 84, 76),
    }
}

/// The age, s, from which a status is outdated: three periods and the latency of the process, and a margin; [`LEAST_S`] where
/// the period is not known.
pub fn status_limit_s(process: &ProcessInfo) -> f64 {
    match process.period_ns {
        0 => LEAST_S,
        period_ns => (3 * period_ns + process.latency_ns) as f64 * 1e-9 + 0.1,
    }
}

/// The age of the newest status of a process, s, where it is outdated: the process posts none any more. `None` also for a
/// process that never posted one, and while its status at the viewed moment is being computed.
pub fn silent_s(frame: &Frame, process: &ProcessInfo) -> Option<f64> {
    let topic = frame.topic(&process.status_buffer).filter(|topic| !topic.pending)?;
    topic.age_s(frame.now).filter(|age_s| *age_s > status_limit_s(process))
}
