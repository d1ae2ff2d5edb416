//! Asks before a run is left that would be lost: one with commands, parameters or driving of the user.

use crate::open::Request;
use egui::Align2;
use rcs_runtime::source::{Frame, SourceKind};

/// Number of writes into the runs of a source that nothing else has.
pub(super) fn lost_with(frame: &Frame) -> u64 {
    match frame.info.kind {
        SourceKind::Log => 0,
        SourceKind::Replay | SourceKind::Stack => frame.runs.all.iter().map(|run| run.writes as u64).sum(),
    }
}

/// The question, while it is open.
#[derive(Debug)]
pub(super) struct Leaving {
    /// What is to be opened instead.
    request: Request,
    writes: u64,
}

/// The answer.
pub(super) enum Answer {
    Open,
    Stay,
    Leave(Request),
}

impl Leaving {
    pub(super) fn new(request: Request, writes: u64) -> Self {
        Self { request, writes }
    }

    /// Paints the question.
    pub(super) fn ui(&self, ctx: &egui::Context) -> Answer {
        let mut answer = Answer::Open;
        let mut open = true;
        egui::Window::new("Leave this run?")
            .collapsible(false)
            .resizable(false)
            .anchor(Align2::CENTER_CENTER, egui::Vec2::ZERO)
            .open(&mut open)
            .show(ctx, |ui| {
                ui.set_max_width(360.0);
                let what = if self.writes == 1 { "act of yours is" } else { "acts of yours are" };
                let text = format!(
                    "{} {what} in it, and it is not recorded: it cannot be shown again.",
                    self.writes
                );
                ui.add(egui::Label::new(text).wrap());
                ui.add_space(8.0);
                ui.horizontal(|ui| {
                    let stay = ui.button("Stay");
                    if ui.memory(|memory| memory.focused().is_none()) {
                        stay.request_focus();
                    }
                    if stay.clicked() {
                        answer = Answer::Stay;
                    }
                    if ui.button(format!("Leave it, open {}", self.request.title())).clicked() {
                        answer = Answer::Leave(self.request.clone());
                    }
                });
            });
        let escaped = ctx.input(|input| input.key_pressed(egui::Key::Escape));
        match answer {
            Answer::Open if !open || escaped => Answer::Stay,
            answer => answer,
        }
    }
}
