//! The draft of a mission that the maps of a source share in a frame: opened, closed and opened again, and followed on its
//! way to the vehicle also while no map shows it.

use super::draft::Draft;
use super::{Map, mission};
use crate::operator::Inputs;
use crate::view::{Drafts, ViewContext};
use egui::Ui;
use rcs_runtime::source::Frame;

impl Map {
    /// Takes the draft that the maps of the source share in this frame for the pass, and the one that was closed. While
    /// something else is drawn or measured here, clicks are not for it.
    pub(super) fn take_draft(&mut self, ui: &Ui, cx: &mut ViewContext<'_>, map: &str) {
        follow_sendings(ui, cx);
        let is_drawn = Inputs::of(cx.frame).mission.is_some() && self.example.is_none() && !self.measuring;
        let drafts = &mut cx.selection.drafts;
        self.draft = if is_drawn { drafts.missions.remove(map) } else { None };
        // While one is open and hidden, that one is shown again instead.
        let is_hidden = drafts.missions.contains_key(map);
        self.closed = if is_hidden { None } else { drafts.closed_missions.remove(map) };
    }

    /// Ends what [`Self::take_draft`] began. One that was not taken stays.
    pub(super) fn give_draft_back(&mut self, cx: &mut ViewContext<'_>, map: &str) {
        let drafts = &mut cx.selection.drafts;
        if let Some(draft) = self.draft.take() {
            drafts.missions.entry(map.to_owned()).or_insert(draft);
        }
        if let Some(closed) = self.closed.take() {
            drafts.closed_missions.insert(map.to_owned(), closed);
        }
    }

    /// Closes the draft; or opens the one that was closed with changes that were not sent, or else one of the mission that is
    /// obeyed, unless none can be drawn on the map.
    pub(super) fn toggle_draft(&mut self, frame: &Frame, map: &str, buffer: &str) {
        if self.draft.is_some() {
            return self.close_draft();
        }
        let draft = self.closed.take().or_else(|| mission::begin(frame, map, buffer).ok());
        self.open_draft(draft);
    }

    /// Draws a mission, unless there is none, and nothing else.
    pub(super) fn open_draft(&mut self, draft: Option<Draft>) {
        self.draft = draft;
        self.measuring = false;
        self.example = None;
    }

    /// Closes the draft. What was not sent, or is on its way and may be lost, is kept, to be opened again.
    pub(super) fn close_draft(&mut self) {
        self.closed = self.draft.take().filter(|draft| !draft.is_as_sent() || draft.is_on_its_way());
    }

    /// Whether a mission that was sent on any map is on its way. `drafts` are those that were not taken for the pass.
    pub(super) fn awaits_mission(&self, drafts: &Drafts) -> bool {
        let taken = self.draft.iter().chain(&self.closed);
        let Drafts { missions, closed_missions, .. } = drafts;
        taken.chain(missions.values()).chain(closed_missions.values()).any(Draft::is_on_its_way)
    }
}

/// Follows the missions that were sent, on all maps. One that was closed on its way is dropped when it has come to its
/// buffer.
fn follow_sendings(ui: &Ui, cx: &mut ViewContext<'_>) {
    let Some(buffer) = Inputs::of(cx.frame).mission else { return };
    let (newest, now_s) = (mission::newest(cx.frame, &buffer), ui.input(|input| input.time));
    let Drafts { missions, closed_missions, .. } = &mut cx.selection.drafts;
    for draft in missions.values_mut() {
        draft.follow_sending(newest, now_s);
    }
    closed_missions.retain(|_, draft| {
        let has_come = draft.follow_sending(newest, now_s);
        !(has_come && draft.is_as_sent())
    });
}
