//! Conditions view: formulas over fields at which a run stops (data breakpoints), and the times at which they begin to
//! hold: forward or back, in a run or in a whole recording.
//!
//! A condition is gathered like a curve of a plot. Where a run has not been executed yet, going forward plays it until
//! the condition holds; the window then goes to exactly that time, which the run keeps.

use crate::series::{Shelf, Shown};
use crate::view::{RunChoice, SavedState, View, ViewContext};
use egui::{RichText, ScrollArea, TextEdit, Ui};
use ocu_ui::{format, icons, tokens, widgets};
use rcs_formula::{FieldRef, Formula, Over};
use rcs_msg::Stamp;
use rcs_runtime::source::{Control, FieldPoint, Frame, Series, SourceKind};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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
    new: String,
    /// The formula that playing goes on to, from a time.
    until: Option<(String, Stamp)>,
    /// The viewed time of the last pass while playing.
    played: Option<Stamp>,
    /// What was reached last.
    reached: Option<(String, Stamp)>,
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

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        self.entry(ui);
        let mut shown = Vec::new();
        for condition in &self.saved.conditions {
            let mut found = self.shelf.shown(ui.ctx(), cx.frame, &condition.formula, RunChoice::Shown);
            if found.over == Over::Frequency {
                let problem = Some("a spectrum is over frequency, which has no time to stop at".into());
                found = Shown { problem, ..Shown::default() };
            }
            self.hits.entry(condition.formula.clone()).or_default().follow(&found.points);
            shown.push(found);
        }
        self.stop(cx);
        if self.saved.conditions.is_empty() {
            let hint =
                "Write one above, such as /supervisor/status.state == ERROR or /wm1/status.faults > 0.";
            return widgets::empty(ui, icons::ICON_RULE, "No conditions", hint);
        }
        let mut removed = None;
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            for (index, found) in shown.iter().enumerate() {
                if self.row(ui, cx, index, found) {
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

impl Conditions {
    /// The line for a new condition.
    fn entry(&mut self, ui: &mut Ui) {
        egui::Frame::new().inner_margin(egui::Margin::symmetric(8, 4)).show(ui, |ui| {
            let parsed = self.new.parse::<Formula>();
            ui.horizontal(|ui| {
                let edit = TextEdit::singleline(&mut self.new)
                    .font(egui::TextStyle::Monospace)
                    .hint_text("a condition, such as /wm1/status.faults > 0")
                    .desired_width((ui.available_width() - 64.0).max(64.0));
                let response = ui.add(edit);
                ui.ctx().accesskit_node_builder(response.id, |node| node.set_label("New condition"));
                let entered = response.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
                if (ui.add_enabled(parsed.is_ok(), egui::Button::new("Add")).clicked() || entered)
                    && parsed.is_ok()
                {
                    let formula = std::mem::take(&mut self.new).trim().to_owned();
                    self.saved.conditions.push(Condition { formula, stops: true });
                }
            });
            if let Err(error) = parsed
                && !self.new.trim().is_empty()
            {
                ui.label(RichText::new(error.to_string()).small().color(tokens(ui).weak));
            }
        });
    }

    /// Stops where a condition began to hold since the last pass.
    fn stop(&mut self, cx: &mut ViewContext<'_>) {
        let frame = cx.frame;
        let from = self.played.replace(frame.now).filter(|from| *from <= frame.now);
        if !frame.playback.playing {
            self.played = None;
            return;
        }
        let Some(from) = from.or_else(|| self.until.as_ref().map(|(_, from)| *from)) else { return };
        let until = self.until.as_ref().map(|(formula, _)| formula.as_str());
        let stops = self.saved.conditions.iter().filter(|c| c.stops || Some(c.formula.as_str()) == until);
        let reached = stops.filter_map(|condition| {
            let at = self.hits.get(&condition.formula)?.after(from).filter(|at| *at <= frame.now)?;
            Some((condition.formula.clone(), at))
        });
        if let Some((formula, at)) = reached.min_by_key(|(_, at)| *at) {
            cx.controls.push(Control::Pause);
            cx.controls.push(Control::Seek(at));
            self.reached = Some((formula, at));
            (self.until, self.played) = (None, None);
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
                cx.controls.push(Control::Seek(at));
            }
            if widgets::icon_button(ui, icons::ICON_SKIP_NEXT, &format!("On until {formula} holds")).clicked()
            {
                match hits.after(frame.now) {
                    Some(at) => cx.controls.push(Control::Seek(at)),
                    None if frame.info.kind == SourceKind::Log => {}
                    None => {
                        self.until = Some((formula.clone(), frame.now));
                        cx.controls.push(Control::Play);
                    }
                }
            }
            ui.label(RichText::new(format!("{}×", hits.times.len())).small().color(tokens.weak))
                .on_hover_text("how often it began to hold, as far as is known");
            removed = widgets::icon_button(ui, icons::ICON_CLOSE, &format!("Remove {formula}")).clicked();
            ui.add(egui::Label::new(widgets::mono(&formula)).truncate());
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
                ui.label(RichText::new(text).small().color(color));
            });
        }
        removed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
