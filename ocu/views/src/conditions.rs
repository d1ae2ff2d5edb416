//! Conditions view: formulas over fields at which a run stops (data breakpoints), and the times at which they begin to
//! hold: forward or back, in a run or in a whole recording.
//!
//! A condition is gathered like a curve of a plot. Where a run has not been executed yet, going forward plays it until
//! the condition holds; the window then goes to exactly that time, which the run keeps. So it does where that becomes
//! known late: a long formula is computed in the background, and one of several buffers waits for their next messages.

use crate::series::{Shelf, Shown};
use crate::view::{RunChoice, SavedState, View, ViewContext};
use egui::{Align, Layout, RichText, ScrollArea, TextEdit, Ui};
use ocu_ui::{format, icons, tokens, typing, widgets};
use rcs_formula::{FieldRef, Formula, Over};
use rcs_msg::{FieldPath, Stamp, rcs};
use rcs_runtime::source::{Control, FieldPoint, Frame, Series, SourceKind};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Width below which a formula has a line of its own above its buttons, screen points.
const NARROW: f32 = 400.0;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    conditions: Vec<Condition>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Condition {
    /// The formula; it holds where its value is neither 0 nor missing.
    formula: String,
    /// Whether playing stops where it begins to hold.
    stops: bool,
}

/// The times at which a series begins to hold, found as it grows.
#[derive(Default)]
struct Hits {
    of: Series<FieldPoint>,
    scanned: usize,
    holds: bool,
    times: Vec<Stamp>,
}

impl Hits {
    /// Looks at the points that were added; at all of them if it is another series.
    fn follow(&mut self, points: &Series<FieldPoint>) {
        if !self.of.same(points) || points.len() < self.scanned {
            *self = Self { of: points.clone(), ..Self::default() };
        }
        let Self { scanned, holds, times, .. } = self;
        points.each(*scanned..points.len(), |point| {
            let now = point.value != 0.0 && point.value.is_finite();
            if now && !*holds {
                times.push(point.stamp);
            }
            *holds = now;
        });
        *scanned = points.len();
    }

    /// The last time before `now` at which it began to hold.
    fn before(&self, now: Stamp) -> Option<Stamp> {
        self.times[..self.times.partition_point(|&time| time < now)].last().copied()
    }

    /// The first time after `now` at which it begins to hold, as far as is known.
    fn after(&self, now: Stamp) -> Option<Stamp> {
        self.times.get(self.times.partition_point(|&time| time <= now)).copied()
    }
}

/// The conditions view.
#[derive(Default)]
pub(crate) struct Conditions {
    saved: Saved,
    shelf: Shelf,
    hits: BTreeMap<String, Hits>,
    /// The formula that playing goes on to.
    until: Option<String>,
    stops: Stops,
    /// What was reached last.
    reached: Option<(String, Stamp)>,
}

/// What stops the source as it plays.
#[derive(Default)]
struct Stops {
    /// From where it plays (`Playback::from`); `None` while it does not.
    from: Option<Stamp>,
    /// The viewed time of the last pass.
    now: Stamp,
    /// The formulas that stop it, and the time after which each of them does: where playing began or jumped to, or where
    /// the formula was chosen.
    after: BTreeMap<String, Stamp>,
    /// Whether the source was asked to stop. Until it obeys, frames say that it plays.
    is_asked: bool,
}

impl Stops {
    /// The first time at which one of `formulas` began to hold since the time after which it stops, and that formula.
    fn reached<'a>(
        &mut self,
        frame: &Frame,
        formulas: impl Iterator<Item = &'a str>,
        hits: &BTreeMap<String, Hits>,
    ) -> Option<(String, Stamp)> {
        if !frame.playback.playing {
            *self = Self::default();
            return None;
        }
        let from = frame.playback.from;
        let begins = self.from != Some(from) || frame.now < self.now;
        if begins {
            *self = Self { from: Some(from), ..Self::default() };
        }
        self.now = frame.now;
        let known = std::mem::take(&mut self.after);
        let since = if begins { from } else { frame.now };
        let after = |formula: &str| known.get(formula).copied().unwrap_or(since);
        self.after = formulas.map(|formula| (formula.to_owned(), after(formula))).collect();
        if self.is_asked {
            return None;
        }
        let reached = self.after.iter().filter_map(|(formula, after)| {
            let at = hits.get(formula)?.after(*after).filter(|at| *at <= frame.now)?;
            Some((formula.clone(), at))
        });
        let reached = reached.min_by_key(|(_, at)| *at);
        self.is_asked = reached.is_some();
        reached
    }
}

impl View for Conditions {
    fn title(&self, _frame: &Frame) -> String {
        "Conditions".to_owned()
    }

    fn fields(&self) -> Vec<FieldRef> {
        let parsed =
            self.saved.conditions.iter().filter_map(|condition| condition.formula.parse::<Formula>().ok());
        parsed.flat_map(|formula| formula.fields().to_vec()).collect()
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        Ok(())
    }

    fn watch(&mut self, ctx: &egui::Context, cx: &mut ViewContext<'_>) {
        self.find(ctx, cx.frame);
        self.stop(cx);
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        self.entry(ui, cx.frame, &mut cx.selection.drafts.condition);
        let shown = self.find(ui.ctx(), cx.frame);
        if self.saved.conditions.is_empty() {
            let [state, faults] = ["state", "faults"].map(|field| example(cx.frame, field));
            let hint = format!("Write one above, such as {state} == ERROR or {faults} > 0.");
            return widgets::empty(ui, icons::ICON_RULE, "No conditions", &hint);
        }
        let mut removed = None;
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            let mut names = widgets::RowNames::default();
            for (index, found) in shown.iter().enumerate() {
                // Notes of those before it come and go.
                let formula = self.saved.conditions[index].formula.clone();
                if names.named(ui, formula, |ui| self.row(ui, cx, index, found)) {
                    removed = Some(index);
                }
            }
        });
        if let Some(index) = removed {
            self.saved.conditions.remove(index);
        }
        let conditions = &self.saved.conditions;
        let is_used = |text: &str| conditions.iter().any(|condition| condition.formula == text);
        self.shelf.keep(is_used);
        self.hits.retain(|text, _| is_used(text));
    }
}

/// A field of the status of a process of the source, as a formula contains it: of one that supervises others, else of the
/// first one.
fn example(frame: &Frame, field: &str) -> String {
    let has_status = |info: &&rcs::ProcessInfo| frame.topic(&info.status_buffer).is_some();
    let supervises =
        |info: &&rcs::ProcessInfo| frame.processes.iter().any(|other| other.supervisor == info.name);
    let known: Vec<&rcs::ProcessInfo> = frame.processes.iter().filter(has_status).collect();
    let found = known.iter().copied().find(supervises).or(known.first().copied());
    let topic = found.map_or("/robot/status", |info| info.status_buffer.as_str()).to_owned();
    FieldRef { topic, path: FieldPath::root().field(field) }.to_string()
}

impl Conditions {
    /// The line for a new condition, with its text.
    fn entry(&mut self, ui: &mut Ui, frame: &Frame, new: &mut String) {
        egui::Frame::new().inner_margin(egui::Margin::symmetric(8, 4)).show(ui, |ui| {
            let parsed = new.parse::<Formula>();
            ui.horizontal(|ui| {
                let edit = TextEdit::singleline(new)
                    .font(egui::TextStyle::Monospace)
                    .hint_text(format!("a condition, such as {} > 0", example(frame, "faults")))
                    .desired_width((ui.available_width() - 64.0).max(64.0));
                let response = ui.add(edit);
                ui.ctx().accesskit_node_builder(response.id, |node| node.set_label("New condition"));
                let entered = typing::entered(&response);
                if (ui.add_enabled(parsed.is_ok(), egui::Button::new("Add")).clicked() || entered)
                    && parsed.is_ok()
                {
                    let formula = std::mem::take(new).trim().to_owned();
                    self.saved.conditions.push(Condition { formula, stops: true });
                }
            });
            if let Err(error) = parsed
                && !new.trim().is_empty()
            {
                ui.label(RichText::new(error.to_string()).small().color(tokens(ui).weak));
            }
        });
    }

    /// The values of each condition; notes where it begins to hold.
    fn find(&mut self, ctx: &egui::Context, frame: &Frame) -> Vec<Shown> {
        let mut shown = Vec::new();
        for condition in &self.saved.conditions {
            let mut found = self.shelf.shown(ctx, frame, &condition.formula, RunChoice::Shown);
            if found.over == Over::Frequency {
                let problem = Some("a spectrum is over frequency, which has no time to stop at".into());
                found = Shown { problem, ..Shown::default() };
            }
            self.hits.entry(condition.formula.clone()).or_default().follow(&found.points);
            shown.push(found);
        }
        shown
    }

    /// Stops where a condition began to hold.
    fn stop(&mut self, cx: &mut ViewContext<'_>) {
        let until = self.until.as_deref();
        let conditions = self.saved.conditions.iter();
        let stopping = conditions.filter(|condition| condition.stops || Some(&*condition.formula) == until);
        let formulas = stopping.map(|condition| condition.formula.as_str());
        if let Some((formula, at)) = self.stops.reached(cx.frame, formulas, &self.hits) {
            cx.controls.extend(Control::pause_at(at));
            self.reached = Some((formula, at));
            self.until = None;
        }
    }

    /// A condition; `true` to remove it.
    fn row(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>, index: usize, found: &Shown) -> bool {
        let tokens = tokens(ui);
        let frame = cx.frame;
        let condition = &mut self.saved.conditions[index];
        let formula = condition.formula.clone();
        let hits = self.hits.entry(formula.clone()).or_default();
        let mut removed = false;
        let is_narrow = ui.available_width() < NARROW;
        if is_narrow {
            egui::Frame::new().inner_margin(egui::Margin::symmetric(8, 0)).show(ui, |ui| {
                ui.with_layout(Layout::right_to_left(Align::TOP), |ui| {
                    removed = remove(ui, &formula);
                    // The first line of the formula is in one line with the button.
                    let line = ui.text_style_height(&egui::TextStyle::Monospace);
                    let above = ((ui.min_rect().height() - line) * 0.5).max(0.0);
                    ui.with_layout(Layout::top_down(Align::LEFT), |ui| {
                        ui.add_space(above);
                        ui.add(egui::Label::new(widgets::mono(&formula)).wrap());
                    });
                });
            });
        }
        ui.horizontal(|ui| {
            ui.add_space(8.0);
            ui.checkbox(&mut condition.stops, "")
                .on_hover_text("Stop playing where it begins to hold")
                .widget_info(|| {
                    egui::WidgetInfo::selected(
                        egui::Role::CheckBox,
                        true,
                        condition.stops,
                        format!("Stop at {formula}"),
                    )
                });
            let known =
                found.points.count_until(frame.now).checked_sub(1).and_then(|at| found.points.get(at));
            let (word, color) = match (&found.problem, known) {
                (Some(_), None) => ("unknown", tokens.warning),
                (_, Some(point)) if point.value.is_nan() => ("no value", tokens.unknown),
                (_, Some(point)) if point.value != 0.0 => ("holds", tokens.ok),
                (_, Some(_)) => ("does not hold", tokens.weak),
                (None, None) => ("no value", tokens.unknown),
            };
            widgets::tag(ui, word, color);
            if widgets::icon_button(
                ui,
                icons::ICON_SKIP_PREVIOUS,
                &format!("Back to where {formula} began to hold"),
            )
            .clicked()
                && let Some(at) = hits.before(frame.now)
            {
                cx.controls.extend(Control::pause_at(at));
            }
            if widgets::icon_button(ui, icons::ICON_SKIP_NEXT, &format!("On until {formula} holds")).clicked()
            {
                match hits.after(frame.now) {
                    Some(at) => cx.controls.extend(Control::pause_at(at)),
                    None if frame.info.kind == SourceKind::Log => {}
                    None => {
                        self.until = Some(formula.clone());
                        // If it plays already; otherwise it counts from where playing begins.
                        self.stops.after.entry(formula.clone()).or_insert(frame.now);
                        cx.controls.push(Control::Play);
                    }
                }
            }
            ui.label(RichText::new(format!("{}×", hits.times.len())).small().color(tokens.weak))
                .on_hover_text("how often it began to hold, as far as is known");
            if !is_narrow {
                removed = remove(ui, &formula);
                ui.add(egui::Label::new(widgets::mono(&formula)).truncate());
            }
        });
        let note = match (&found.problem, &self.reached) {
            (Some(problem), _) => Some((problem.to_string(), tokens.warning)),
            (None, Some((reached, at))) if *reached == formula => {
                let at = format::elapsed(at.seconds_since(frame.info.start));
                Some((format!("stopped here at {at}"), tokens.accent))
            }
            _ => None,
        };
        if let Some((text, color)) = note {
            ui.horizontal(|ui| {
                ui.add_space(32.0);
                ui.add(egui::Label::new(RichText::new(text).small().color(color)).wrap());
            });
        }
        removed
    }
}

/// A button that removes a condition; whether it was pressed.
fn remove(ui: &mut Ui, formula: &str) -> bool {
    widgets::icon_button(ui, icons::ICON_CLOSE, &format!("Remove {formula}")).clicked()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use crate::view::Selection;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use rcs_runtime::source::{FieldSeries, Playback, RunTag};
    use std::cell::RefCell;
    use std::sync::Arc;

    fn field(text: &str, points: &[(u64, f64)]) -> FieldSeries {
        FieldSeries {
            field: text.parse::<Formula>().unwrap().fields()[0].clone(),
            run: RunTag::FIRST,
            points: points.iter().map(|&(time, value)| FieldPoint { stamp: Stamp(time), value }).collect(),
            names: Arc::default(),
            states: Arc::default(),
            reading: None,
            problem: None,
        }
    }

    /// A frame of a source that has played from a time.
    fn played(from: u64, now: u64, fields: &[FieldSeries]) -> Frame {
        let mut frame = samples::empty();
        (frame.now, frame.fields) = (Stamp(now), fields.to_vec().into());
        (frame.playback.playing, frame.playback.from) = (true, Stamp(from));
        frame
    }

    /// Where a view stops the source.
    fn stop(view: &mut Conditions, frame: &Frame) -> Option<Stamp> {
        let (mut controls, mut wishes, mut selection) = (Vec::new(), Vec::new(), Selection::default());
        let mut cx =
            ViewContext { frame, controls: &mut controls, selection: &mut selection, wishes: &mut wishes };
        view.watch(&egui::Context::default(), &mut cx);
        match controls.as_slice() {
            [] => None,
            [Control::Pause, Control::Seek(at)] => Some(*at),
            other => panic!("expected a pause and a seek, got {other:?}"),
        }
    }

    fn watching(formula: &str, stops: bool) -> Conditions {
        let conditions = vec![Condition { formula: formula.to_owned(), stops }];
        Conditions { saved: Saved { conditions }, ..Conditions::default() }
    }

    #[test]
    fn a_condition_that_becomes_known_late_stops_once_where_it_began_to_hold() {
        let mut view = watching("/a.x - /b.y > 0.5", true);
        let a: Vec<(u64, f64)> =
            (1..=12).map(|i| (i * 10, f64::from(u8::from((6..12).contains(&i))))).collect();
        let b = [(5, 0.0), (55, 0.0), (105, 0.0)];
        // From 60 on it holds, which is known when the next message of b comes.
        let early = [field("/a.x", &a[..10]), field("/b.y", &b[..2])];
        assert_eq!(stop(&mut view, &played(1, 90, &early)), None);
        assert_eq!(stop(&mut view, &played(1, 100, &early)), None);
        let late = [field("/a.x", &a[..11]), field("/b.y", &b)];
        assert_eq!(stop(&mut view, &played(1, 110, &late)), Some(Stamp(60)));
        assert_eq!(stop(&mut view, &played(1, 115, &late)), None, "it has been asked to stop");
        let paused = Frame { now: Stamp(60), playback: Playback::default(), ..played(1, 60, &late) };
        assert_eq!(stop(&mut view, &paused), None);
        assert_eq!(stop(&mut view, &played(60, 70, &late)), None, "it stopped there before");
        assert_eq!(stop(&mut view, &played(1, 70, &late)), Some(Stamp(60)), "played again from before");
    }

    #[test]
    fn a_condition_stops_from_where_playing_began_or_jumped_to_or_it_was_chosen() {
        let fields = [field("/a.x", &[(10, 0.0), (20, 1.0), (30, 0.0), (40, 1.0), (50, 0.0)])];
        let mut view = watching("/a.x", true);
        assert_eq!(stop(&mut view, &played(15, 25, &fields)), Some(Stamp(20)), "before the first pass");
        let mut view = watching("/a.x", true);
        assert_eq!(stop(&mut view, &played(11, 12, &fields)), None);
        assert_eq!(stop(&mut view, &played(45, 46, &fields)), None, "a seek over it");
        assert_eq!(stop(&mut view, &played(11, 41, &fields)), Some(Stamp(20)), "a seek back");
        let mut view = watching("/a.x", false);
        assert_eq!(stop(&mut view, &played(11, 35, &fields)), None);
        view.saved.conditions[0].stops = true;
        assert_eq!(stop(&mut view, &played(11, 38, &fields)), None, "it was ticked later");
        assert_eq!(stop(&mut view, &played(11, 48, &fields)), Some(Stamp(40)));
    }

    #[test]
    fn the_example_names_a_field_that_a_process_of_the_source_has() {
        let frame = samples::full();
        let [state, faults] = ["state", "faults"].map(|field| example(&frame, field));
        for text in [format!("{state} == ERROR"), format!("{faults} > 0")] {
            let formula: Formula = text.parse().unwrap();
            let field = &formula.fields()[0];
            let status = &frame.topic(&field.topic).expect(&text).latest.as_ref().unwrap().message;
            assert!(status.value().unwrap().get(&field.path).is_ok(), "{text}");
        }
        assert_eq!(example(&samples::empty(), "state"), "/robot/status.state");
    }

    #[test]
    fn a_press_removes_no_other_condition_that_a_note_moves_to_its_place() {
        let formulas = ["/a.x", "/b.x", "/c.x"];
        let fields = formulas.map(|formula| field(formula, &[(10, 0.0), (20, 1.0)]));
        let frame = played(1, 90, &fields);
        let conditions =
            formulas.map(|formula| Condition { formula: formula.to_owned(), stops: false }).to_vec();
        let reached = |formula: &str| Some((formula.to_owned(), Stamp(20)));
        for then in ["/a.x", "/c.x"] {
            let saved = Saved { conditions: conditions.clone() };
            let view = RefCell::new(Conditions { saved, reached: reached("/a.x"), ..Conditions::default() });
            let mut harness = Harness::builder()
                .with_size(egui::Vec2::new(500.0, 200.0))
                .with_context_setup(ocu_ui::install)
                .build_ui(|ui| {
                    let (mut controls, mut wishes) = (Vec::new(), Vec::new());
                    let mut selection = Selection::default();
                    let mut cx = ViewContext {
                        frame: &frame,
                        controls: &mut controls,
                        selection: &mut selection,
                        wishes: &mut wishes,
                    };
                    view.borrow_mut().ui(ui, &mut cx);
                });
            harness.run_steps(3);
            let at = harness.get_by_label("Remove /b.x").rect().center();
            harness.drag_at(at);
            harness.step();
            view.borrow_mut().reached = reached(then);
            harness.step();
            harness.drop_at(at);
            harness.step();
            drop(harness);
            let saved = view.into_inner().saved;
            let left: Vec<&str> =
                saved.conditions.iter().map(|condition| condition.formula.as_str()).collect();
            assert_eq!(left, ["/a.x", "/c.x"], "stopped at {then}");
        }
    }

    fn series(values: &[f64]) -> Series<FieldPoint> {
        let points = values.iter().zip(1..);
        points.map(|(&value, i)| FieldPoint { stamp: Stamp(i * 10), value }).collect()
    }

    #[test]
    fn a_condition_begins_to_hold_at_each_change_to_true() {
        let mut hits = Hits::default();
        let points = series(&[1.0, 1.0, 0.0, 2.0, f64::NAN, 1.0, 0.0]);
        hits.follow(&points);
        assert_eq!(hits.times, [Stamp(10), Stamp(40), Stamp(60)]);
        assert_eq!(hits.after(Stamp(10)), Some(Stamp(40)));
        assert_eq!(hits.after(Stamp(60)), None);
        assert_eq!(hits.before(Stamp(40)), Some(Stamp(10)));
        assert_eq!(hits.before(Stamp(10)), None);
        hits.follow(&points);
        assert_eq!(hits.times.len(), 3, "nothing was added");
        hits.follow(&series(&[0.0]));
        assert!(hits.times.is_empty(), "another series");
    }
}
