//! Tuning view: the parameters of any process as typed controls. Changes are shown by other views before they are sent
//! (fusion weights fuse the shown map again) and until a map is made with them, sent as one message, taken back, kept as A
//! and B to switch between, and saved to the stack file.

mod controls;
pub(crate) mod draft;
mod fused;
mod number;

use crate::command::refusal;
use crate::operator;
use crate::view::{Preview, PreviewStage, SavedState, View, ViewContext, Wish, run_beside};
use controls::Row;
use draft::Draft;
pub(crate) use draft::is_equal;
use egui::{Align, Layout, RichText, Role, ScrollArea, Sense, Ui, UiBuilder, Vec2, WidgetInfo};
use fused::Counting;
use ocu_ui::bar::{self, Bar, Choice, Fit};
use ocu_ui::{icons, tokens, widgets};
use rcs_msg::params::ParamSpec;
use rcs_msg::{AnyMessage, Value, rcs};
use rcs_runtime::source::{Control, Frame, RunTag, SourceKind};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

pub(crate) use controls::{Row as ParamRow, Rows as ParamRows};

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// The process; the selected one, or the one that fuses maps, where none is named.
    process: Option<String>,
    /// What names or help must hold to be listed.
    search: String,
    /// Whether each change is sent when the control is let go.
    at_once: bool,
}

/// The tuning view.
#[derive(Default)]
pub(crate) struct Tuning {
    saved: Saved,
    /// Address of a list of processes, and the process of it that fuses maps, or has parameters at all.
    usual: Option<(usize, String)>,
    /// Weights that count instead of those of the parameters.
    counting: Counting,
    /// Stands for this view where it states a preview.
    own: Arc<()>,
}

impl View for Tuning {
    fn title(&self, frame: &Frame) -> String {
        let process =
            self.saved.process.as_ref().filter(|name| tunable(frame).any(|info| info.name == **name));
        process.map_or_else(|| "Tuning".to_owned(), |name| format!("Tuning {name}"))
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let chosen = self.chosen(cx).map(|info| (info, in_force(cx.frame, info)));
        let Some((info, Some(in_force))) = chosen else {
            cx.selection.preview.end(&self.own, None);
            let hint = "A stack has parameters: run one, on a recording or in a simulation. \
                        A recording of a stack shows those with which it ran.";
            return widgets::empty(ui, icons::ICON_TUNE, "No parameters here", hint);
        };
        self.toolbar(ui, cx.frame, info);
        let Ok(now) = in_force.value() else {
            let text = format!("The parameters of {} cannot be read", info.name);
            return widgets::empty(ui, icons::ICON_ERROR, &text, &info.params_schema);
        };
        let key = (info.name.clone(), run_beside(cx.frame));
        let mut draft = cx.selection.drafts.params.remove(&key).unwrap_or_default();
        let is_replaced = draft.follow(&in_force, &now);
        let now_s = ui.input(|input| input.time);
        draft.follow_sent(run_of(cx.frame, info), now_s);
        if draft.on_its_way().is_some() {
            // What is lost is awaited for some seconds only, also where nothing else repaints.
            ui.ctx().request_repaint_after(Duration::from_secs(1));
        }
        if let Some(status) = cx.frame.status(info) {
            draft.take_fault(cx.frame.now, status);
            if let Some((_, vehicle)) = operator::vehicle(cx.frame) {
                draft.forget_refusal(cx.frame.now, status, vehicle);
            }
        }
        let may_send = refusal(cx.frame).is_none();
        actions(ui, cx, info, &mut draft, &in_force, self.saved.at_once);
        notes(ui, cx.frame, info, &draft);
        let specs = draft.specs().to_vec();
        let value = draft.message(&in_force).value().unwrap_or(now.clone());
        let search = self.saved.search.trim().to_lowercase();
        let given = given(cx.frame, info, &in_force);
        let learned = fused::learned(cx.frame, info);
        let counting = self.counting.follow(&in_force, fused::weights(cx.frame, info), learned);
        let mut edits = Vec::new();
        let mut let_go = false;
        // An id of its own: a note that comes or goes above would cut off a slider that is being dragged.
        let list = UiBuilder::new().scope_id(ui.scope_id().with(("parameters", &info.name)));
        ui.scope_builder(list, |ui| {
            ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
                ui.add_space(4.0);
                let mut rows = controls::Rows {
                    search: &search,
                    now: &now,
                    given: given.as_ref(),
                    counting: Some(counting),
                    is_replaced,
                    edits: &mut edits,
                    let_go: &mut let_go,
                };
                for spec in &specs {
                    let row = Row { spec, path: spec.name.clone(), value: value.field(&spec.name) };
                    rows.ui(ui, &row, 0);
                }
                if rows_are_hidden(&specs, &search) {
                    let text = "No parameter has this in its name or help.";
                    ui.label(RichText::new(text).color(tokens(ui).weak));
                }
            });
        });
        for (path, text) in edits {
            draft.set(&in_force, &path, text);
        }
        if let_go {
            // A control that was let go unchanged states what is in force.
            draft.follow(&in_force, &now);
        }
        let is_to_be_sent = draft.is_changed() && !draft.is_sending(&in_force);
        if self.saved.at_once && let_go && may_send && is_to_be_sent {
            send(cx, info, &mut draft, &in_force, now_s);
        }
        self.preview(cx, info, &draft, &in_force);
        cx.selection.drafts.params.insert(key, draft);
    }
}

impl Tuning {
    /// The process whose parameters are shown.
    fn chosen<'a>(&mut self, cx: &ViewContext<'a>) -> Option<&'a rcs::ProcessInfo> {
        let frame = cx.frame;
        let named = |name: &str| tunable(frame).find(|info| info.name == name);
        let chosen = self.saved.process.as_deref().and_then(named);
        if let Some(info) = chosen.or_else(|| cx.selection.process.as_deref().and_then(named)) {
            return Some(info);
        }
        let list = frame.processes.as_ptr().addr();
        if let Some((of, name)) = &self.usual
            && *of == list
            && let Some(info) = named(name)
        {
            return Some(info);
        }
        let fuses = |info: &&rcs::ProcessInfo| {
            in_force(frame, info).is_some_and(|params| rcs_world::weights_of(&params).is_some())
        };
        let info = tunable(frame).find(fuses).or_else(|| tunable(frame).next())?;
        self.usual = Some((list, info.name.clone()));
        Some(info)
    }

    fn toolbar(&mut self, ui: &mut Ui, frame: &Frame, shown: &rcs::ProcessInfo) {
        let mut bar: Bar<'_, Saved> = Bar::new("toolbar");
        bar.left("process", Fit::Stays, |ui, form, saved| {
            bar::choice(ui, form, Choice::new("Process", &shown.name, [72.0, 128.0]), |ui| {
                for info in tunable(frame) {
                    let label = ui.selectable_label(info.name == shown.name, &info.name);
                    if widgets::help_beside(label, &info.summary).clicked() {
                        saved.process = Some(info.name.clone());
                    }
                }
            });
        });
        bar.left("at once", Fit::Leaves(10), |ui, form, saved| {
            let help = "At once: each change goes out when its control is let go";
            bar::tool_toggle(ui, form, icons::ICON_BOLT, help, &mut saved.at_once);
        });
        bar.left("search", Fit::Stretches(64.0), |ui, _, saved| {
            widgets::search(ui, &mut saved.search, "Search parameters");
        });
        crate::toolbar::show(ui, bar, &mut self.saved);
    }

    /// Tells other views what is being edited, or was sent, by whomever, and counts in no map yet.
    fn preview(
        &self,
        cx: &mut ViewContext<'_>,
        info: &rcs::ProcessInfo,
        draft: &Draft,
        in_force: &AnyMessage,
    ) {
        let replaced = draft.replaced(in_force).or(self.counting.made_with());
        let replaced = replaced.filter(|_| fused::awaits_map(cx.frame, info));
        let coming = draft.on_its_way().filter(|_| draft.is_sending(in_force));
        let stage = match coming {
            Some(_) => PreviewStage::OnItsWay,
            None if draft.is_changed() => PreviewStage::Edited,
            None => PreviewStage::InForce,
        };
        if stage == PreviewStage::InForce && replaced.is_none() {
            return cx.selection.preview.end(&self.own, Some(&info.name));
        }
        let preview = Preview {
            process: info.name.as_str().into(),
            run: run_of(cx.frame, info),
            params: coming.cloned().unwrap_or_else(|| draft.message(in_force)),
            before: replaced.unwrap_or(in_force).clone(),
            stage,
        };
        cx.selection.preview.set(&self.own, preview);
    }
}

/// The processes that have parameters, in the order of the stack.
fn tunable(frame: &Frame) -> impl Iterator<Item = &rcs::ProcessInfo> {
    frame.processes.iter().filter(|info| {
        in_force(frame, info).is_some_and(|params| {
            params.schema().descriptor().is_some_and(|descriptor| descriptor.fields().len() > 0)
        })
    })
}

/// The newest parameters of a process.
pub(crate) fn in_force(frame: &Frame, info: &rcs::ProcessInfo) -> Option<AnyMessage> {
    if info.params_buffer.is_empty() {
        return None;
    }
    frame.topic(&info.params_buffer)?.canonical().cloned()
}

/// The parameters with which a process began its run, as the stack gave them; `None` if the run does not state them.
fn given(frame: &Frame, info: &rcs::ProcessInfo, in_force: &AnyMessage) -> Option<Value> {
    let begun = frame.run_info(frame.topic(&info.params_buffer)?.run)?;
    let given = begun.params.iter().find(|given| given.process == info.name)?;
    in_force.schema().value(&given.params).ok()
}

/// The run of the parameters of a process.
fn run_of(frame: &Frame, info: &rcs::ProcessInfo) -> RunTag {
    frame.topic(&info.params_buffer).map_or(RunTag::FIRST, |params| params.run)
}

/// Whether the stack of a process is known, to which its parameters can be saved: that of a run is.
fn has_stack(frame: &Frame, info: &rcs::ProcessInfo) -> bool {
    frame.info.kind != SourceKind::Log
        || frame.run_info(run_of(frame, info)).is_some_and(|run| !run.stack_text.is_empty())
}

/// Sends all changes at this time of the window.
fn send(
    cx: &mut ViewContext<'_>,
    info: &rcs::ProcessInfo,
    draft: &mut Draft,
    in_force: &AnyMessage,
    now_s: f64,
) {
    let message = draft.message(in_force);
    draft.sent(in_force, &message);
    write(cx, info, draft, in_force, message, now_s);
}

/// Writes parameters in place of those in force at this time of the window; a fault of the process that follows is shown.
fn write(
    cx: &mut ViewContext<'_>,
    info: &rcs::ProcessInfo,
    draft: &mut Draft,
    in_force: &AnyMessage,
    message: AnyMessage,
    now_s: f64,
) {
    draft.written(in_force, &message, fused::awaits_map(cx.frame, info));
    draft.await_in_force(&message, run_of(cx.frame, info), now_s);
    draft.await_fault(cx.frame.now, cx.frame.status(info).map_or(0, |status| status.faults));
    cx.controls.push(Control::Write { buffer: info.params_buffer.clone(), message });
}

/// Size of the buttons A and B and of the one that forgets them, with the gaps between them: they are in one line.
const KEPT_SETS: Vec2 = Vec2::new(88.0, 20.0);

/// Send, take back, A and B, save.
fn actions(
    ui: &mut Ui,
    cx: &mut ViewContext<'_>,
    info: &rcs::ProcessInfo,
    draft: &mut Draft,
    in_force: &AnyMessage,
    at_once: bool,
) {
    let refused = refusal(cx.frame);
    let is_sending = draft.is_sending(in_force);
    let now_s = ui.input(|input| input.time);
    ui.add_space(4.0);
    // A margin, so that all lines of them begin at one place.
    let margin = egui::Frame::new().inner_margin(egui::Margin::symmetric(8, 0));
    let row = |ui: &mut Ui| {
        let can = refused.is_none() && draft.is_changed() && !is_sending;
        let text = match draft.count() {
            _ if is_sending => "Sending…".to_owned(),
            0 => "Send".to_owned(),
            count => format!("Send {count}"),
        };
        let button = egui::Button::new(format!("{}  {text}", icons::ICON_SEND.codepoint))
            .min_size(egui::vec2(84.0, 20.0));
        let sent = "What was sent is not in force yet.";
        let why = refused.unwrap_or(if is_sending { sent } else { "Nothing has been changed." });
        let response = ui.add_enabled(can, button).on_disabled_hover_text(why);
        let help = if cx.frame.runs.is_at_end {
            "Send all changes as one message, which is recorded"
        } else {
            "Send all changes as one message, which is recorded and begins another run"
        };
        if response.on_hover_text(help).clicked() {
            send(cx, info, draft, in_force, now_s);
        }
        let drop = ui.add_enabled(draft.is_changed() && !is_sending, egui::Button::new("Discard"));
        if drop.on_hover_text("Forget the changes that were not sent").clicked() {
            draft.discard();
        }
        let why = refused.or(draft.on_its_way().map(|_| sent)).or_else(|| draft.cannot_undo(in_force));
        let undo = egui::Button::new(format!("{}  Undo", icons::ICON_UNDO.codepoint));
        let undo = ui.add_enabled(why.is_none(), undo).on_disabled_hover_text(why.unwrap_or_default());
        if undo.on_hover_text("Send the parameters from before the last change").clicked()
            && let Some(before) = draft.undo(in_force)
        {
            write(cx, info, draft, in_force, before, now_s);
        }
        ui.separator();
        ui.allocate_ui_with_layout(KEPT_SETS, Layout::left_to_right(Align::Center), |ui| {
            for (slot, name) in ["A", "B"].into_iter().enumerate() {
                kept_set(ui, cx, info, draft, in_force, (slot, name));
            }
            // The place of the button is there without it, too, and is no higher than the line.
            let (place, _) = ui.allocate_exact_size(Vec2::splat(20.0), Sense::hover());
            let centered = Layout::left_to_right(Align::Center);
            let place = UiBuilder::new().max_rect(place.expand2(Vec2::new(0.0, 4.0))).layout(centered);
            let mut place = ui.new_child(place);
            let any = (0..2).any(|slot| draft.kept(slot).is_some());
            if any && widgets::icon_button(&mut place, icons::ICON_CLOSE, "Forget A and B").clicked() {
                draft.forget_kept();
            }
        });
        let button = egui::Button::new(format!("{}  Save…", icons::ICON_SAVE.codepoint));
        let why = "The recording does not say which stack ran, so there is no file to write to.";
        let save = ui.add_enabled(has_stack(cx.frame, info), button).on_disabled_hover_text(why);
        let help = "Write these parameters into the stack file; the difference is shown first";
        if save.on_hover_text(help).clicked() {
            let params = draft.message(in_force);
            cx.wishes.push(Wish::SaveParams { process: info.name.as_str().into(), params });
        }
        if at_once {
            ui.label(RichText::new("sends at once").small().color(tokens(ui).warning));
        }
    };
    margin.show(ui, |ui| ui.horizontal_wrapped(row));
}

/// Keeps what is shown as A or B, or switches to what was kept: it is sent, or shown where nothing can be sent.
fn kept_set(
    ui: &mut Ui,
    cx: &mut ViewContext<'_>,
    info: &rcs::ProcessInfo,
    draft: &mut Draft,
    in_force: &AnyMessage,
    (slot, name): (usize, &str),
) {
    let kept = draft.kept(slot).cloned();
    let coming = draft.on_its_way().unwrap_or(in_force).clone();
    let shown = if draft.is_changed() { draft.message(in_force) } else { coming.clone() };
    let is_on = kept.as_ref().is_some_and(|kept| is_equal(kept, &shown));
    let is_coming = kept.as_ref().is_some_and(|kept| is_equal(kept, &coming));
    let can_send = refusal(cx.frame).is_none();
    let response = ui.add(egui::Button::selectable(is_on, name).min_size(egui::vec2(24.0, 20.0)));
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, is_on, format!("Parameters {name}")));
    let help = match &kept {
        None => format!("Keep what is shown as {name}"),
        Some(_) if is_on && is_coming && draft.on_its_way().is_some() => format!("{name} is being sent"),
        Some(_) if is_on && is_coming => format!("{name} is in force"),
        Some(_) if is_coming => format!("Back to {name}, which is in force"),
        Some(_) if can_send => format!("Send {name}"),
        Some(_) if is_on => format!("{name} is shown"),
        Some(_) => format!("Show {name}"),
    };
    if !response.on_hover_text(help).clicked() {
        return;
    }
    match kept {
        None => draft.keep(slot, draft.message(in_force)),
        Some(_) if is_on && (is_coming || !can_send) => {}
        Some(_) if is_coming => draft.discard(),
        Some(kept) if can_send => {
            let now_s = ui.input(|input| input.time);
            draft.discard();
            draft.sent(in_force, &kept);
            write(cx, info, draft, in_force, kept, now_s);
        }
        Some(kept) => draft.take(in_force, &kept),
    }
}

/// What the user must know: why nothing can be sent, that a branch begins, what was refused.
fn notes(ui: &mut Ui, frame: &Frame, info: &rcs::ProcessInfo, draft: &Draft) {
    let tokens = tokens(ui);
    let mut note = |text: String, color| {
        ui.horizontal(|ui| {
            ui.add_space(8.0);
            ui.add(egui::Label::new(RichText::new(text).small().color(color)).wrap());
        });
    };
    if let Some(refused) = refusal(frame) {
        note(refused.to_owned(), tokens.weak);
    } else if !frame.runs.is_at_end {
        // Also before anything is changed: the rows must not move while a slider is dragged.
        let text = "Sending here begins another run: what was driven after this moment is kept, and drawn beside it.";
        note(text.to_owned(), tokens.warning);
    }
    if let Some(refused) = draft.refused() {
        note(refused.to_owned(), tokens.error);
    }
    if let Some(fault) = draft.fault() {
        note(format!("{}: {fault}", info.name), tokens.error);
    }
}

/// Whether a search hides every parameter.
fn rows_are_hidden(specs: &[ParamSpec], search: &str) -> bool {
    !specs.iter().any(|spec| controls::is_found(spec, search))
}
