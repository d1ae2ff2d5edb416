//! Compare view: two runs of one log or course, or a run and a recording: since when they differ, how the difference
//! spreads from buffer to buffer, and how their maps and tracks differ at the viewed time.
//!
//! The source compares in the background ([`Comparison`]); the view shows its frames. What is compared is chosen by
//! default: a branch with the run that it left, another recording that was opened for it, or a recording with the run
//! that repeats it.

mod map;
mod side;
mod table;

use crate::canvas::Viewport;
use crate::toolbar;
use crate::view::{SavedState, View, ViewContext, Wish};
use egui::{Color32, FontId, Rect, Sense, Ui, UiBuilder, Vec2};
use ocu_ui::bar::{self, Bar, Choice, Fit, Form};
use ocu_ui::{format, icons, tokens, widgets};
use rcs_runtime::RunId;
use rcs_runtime::source::{Compared, Comparison, Control, Frame};
use serde::{Deserialize, Serialize};

/// Height of the line that says since when they differ.
const LINE: f32 = 26.0;
/// From this width on the map is beside the table.
const WIDE: f32 = 1000.0;
/// Least height of the view with a map below the table.
const TALL: f32 = 300.0;
/// Least room in which a text of that line is begun.
const LEAST_TEXT: f32 = 24.0;
/// Width of the choice of a side in a narrow view.
const SHORT_CHOICE: f32 = 68.0;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// What is compared; `None` to choose automatically.
    sides: Option<[Compared; 2]>,
    /// Whether the maps are shown.
    map: bool,
    /// Where the map looks; `None` to fit everything.
    viewport: Option<Viewport>,
}

impl Default for Saved {
    fn default() -> Self {
        Self { sides: None, map: true, viewport: None }
    }
}

/// The compare view.
#[derive(Default)]
pub(crate) struct Compare {
    saved: Saved,
    /// What was shown in the last pass.
    shown: Option<[Compared; 2]>,
}

impl View for Compare {
    fn title(&self, _frame: &Frame) -> String {
        "Compare".to_owned()
    }

    fn compares(&self) -> Option<[Compared; 2]> {
        self.shown
    }

    fn shows_other(&self) -> bool {
        self.saved.map && self.shown.is_some_and(|sides| sides.contains(&Compared::Other))
    }

    fn runs(&self) -> Vec<RunId> {
        let runs = self.shown.iter().flatten().filter_map(|side| match side {
            Compared::Run(run) => Some(*run),
            Compared::Recorded | Compared::Other => None,
        });
        runs.filter(|_| self.saved.map).collect()
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let choices = side::choices(cx.frame);
        let is_there = |sides: &[Compared; 2]| sides.iter().all(|side| choices.contains(side));
        self.shown = self.saved.sides.filter(is_there).or_else(|| side::usual(cx.frame));
        self.toolbar(ui, cx, &choices);
        let Some(sides) = self.shown else {
            let hint = "Change something in the past of a run, which begins another run, or choose another recording \
                        above.";
            return widgets::empty(ui, icons::ICON_COMPARE, "Nothing to compare", hint);
        };
        let Some(comparison) = cx.frame.comparison(sides) else {
            return widgets::empty(ui, icons::ICON_COMPARE, "Comparing…", "Both sides are being opened.");
        };
        summary(ui, cx, comparison);
        let area = ui.available_rect_before_wrap();
        let names = sides.map(|side| side::name(cx.frame, side));
        let frames = [side::frame(cx.frame, sides[0]), side::frame(cx.frame, sides[1])];
        let maps = match &frames {
            [Some(first), Some(second)] if self.saved.map => Some([&**first, &**second]),
            _ => None,
        };
        let (table, map) = split(area, maps.is_some_and(map::is_there));
        within(ui, table, |ui| table::ui(ui, cx, comparison, &names));
        if let (Some(frames), Some(map)) = (maps, map) {
            let tokens = tokens(ui);
            if map.left() > table.left() {
                ui.painter().vline(map.left(), map.y_range(), egui::Stroke::new(1.0, tokens.line));
            } else {
                ui.painter().hline(map.x_range(), map.top(), egui::Stroke::new(1.0, tokens.line));
            }
            let canvas = map.shrink(0.5);
            let ended = [0, 1].map(|index: usize| ended(cx.frame, comparison, index, &names[index]));
            within(ui, canvas, |ui| map::ui(ui, canvas, frames, &names, &ended, &mut self.saved.viewport));
        }
        ui.advance_cursor_after_rect(area);
    }
}

/// Says when a side ended, where that was before the viewed time.
fn ended(frame: &Frame, comparison: &Comparison, index: usize, name: &str) -> Option<String> {
    let end = side::ended(frame, comparison, index, frame.now)?;
    Some(format!("{name} ended at {:.2} s", end.seconds_since(frame.info.start)))
}

/// The place of the table, and that of the map where there is room for it.
fn split(area: Rect, has_map: bool) -> (Rect, Option<Rect>) {
    if !has_map {
        return (area, None);
    }
    if area.width() >= WIDE {
        let (table, map) = area.split_left_right_at_fraction(0.58);
        return (table, Some(map));
    }
    if area.height() < TALL {
        return (area, None);
    }
    let (table, map) = area.split_top_bottom_at_fraction(0.45);
    (table, Some(map))
}

fn within(ui: &mut Ui, rect: Rect, paint: impl FnOnce(&mut Ui)) {
    let mut child = ui.new_child(UiBuilder::new().max_rect(rect));
    child.set_clip_rect(rect.intersect(ui.clip_rect()));
    paint(&mut child);
}

impl Compare {
    fn toolbar(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>, choices: &[Compared]) {
        let shown = self.shown;
        let mut bar: Bar<'_, (&mut Saved, &mut ViewContext<'_>)> = Bar::new("toolbar");
        for (index, name) in [(0, "First"), (1, "Second")] {
            bar.left(name, Fit::Shrinks, move |ui, form, (saved, cx)| {
                side_choice(ui, form, cx.frame, name, shown, index, choices, saved);
            });
        }
        bar.right("other", Fit::Leaves(40), |ui, form, (_, cx)| {
            let name = "Compare with another recording";
            if bar::tool(ui, form, icons::ICON_FOLDER_OPEN, name).clicked() {
                cx.wishes.push(Wish::ChooseOther);
            }
        });
        bar.right("map", Fit::Leaves(20), |ui, form, (saved, _)| {
            bar::tool_toggle(ui, form, icons::ICON_MAP, "Show how the maps differ", &mut saved.map);
        });
        toolbar::show(ui, bar, &mut (&mut self.saved, cx));
    }
}

/// The choice of one side.
#[expect(clippy::too_many_arguments, reason = "a control with its state")]
fn side_choice(
    ui: &mut Ui,
    form: Form,
    frame: &Frame,
    name: &str,
    shown: Option<[Compared; 2]>,
    index: usize,
    choices: &[Compared],
    saved: &mut Saved,
) {
    let text = shown.map_or_else(|| "–".to_owned(), |sides| side::name(frame, sides[index]));
    let ink = color(ui, index);
    let is_short = form == Form::Short;
    if is_short {
        // A long name must not take the room of the other side.
        ui.set_max_width(SHORT_CHOICE);
        ui.spacing_mut().button_padding.x = 4.0;
    } else {
        let (swatch, _) = ui.allocate_exact_size(Vec2::new(10.0, 10.0), Sense::hover());
        ui.painter().rect_filled(swatch, 2.0, ink);
    }
    let name = format!("{name} of the two");
    let list = bar::choice(ui, form, Choice::new(&name, &text, [SHORT_CHOICE, 150.0]), |ui| {
        for &choice in choices {
            let is_on = shown.is_some_and(|sides| sides[index] == choice);
            if ui.selectable_label(is_on, side::name(frame, choice)).clicked() && !is_on {
                saved.sides = Some(with(shown, index, choice, choices));
            }
        }
    });
    if is_short {
        // In place of the swatch.
        let place = list.response.rect;
        ui.painter().hline(place.x_range(), place.bottom() - 1.0, egui::Stroke::new(2.0, ink));
    }
}

/// The sides after one of them was chosen. If it is the other one already, they change places.
fn with(shown: Option<[Compared; 2]>, index: usize, choice: Compared, choices: &[Compared]) -> [Compared; 2] {
    let mut sides = shown.unwrap_or_else(|| {
        let another = choices.iter().copied().find(|other| *other != choice).unwrap_or(choice);
        [another; 2]
    });
    if sides[1 - index] == choice {
        sides[1 - index] = sides[index];
    }
    sides[index] = choice;
    sides
}

/// The colour of a side.
fn color(ui: &Ui, index: usize) -> Color32 {
    tokens(ui).series(index)
}

/// The line that says whether they are equal, and if not, since when.
fn summary(ui: &mut Ui, cx: &mut ViewContext<'_>, comparison: &Comparison) {
    let tokens = tokens(ui);
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), LINE), Sense::hover());
    let start = cx.frame.info.start;
    let until = comparison.until.map(|until| format::elapsed(until.seconds_since(start)));
    let first = comparison.differences.first();
    let (word, color) = match (first, &comparison.problem, &until) {
        (Some(_), ..) => ("differ", tokens.error),
        (None, Some(_), None) => ("not compared", tokens.warning),
        (None, _, None) => ("comparing", tokens.unknown),
        (None, Some(_), _) => ("equal so far", tokens.warning),
        (None, None, _) if !comparison.gaps.is_empty() => ("equal where kept", tokens.warning),
        (None, None, _) => ("bit-equal", tokens.ok),
    };
    let mut child = ui.new_child(
        UiBuilder::new()
            .max_rect(rect.shrink2(Vec2::new(8.0, 2.0)))
            .layout(egui::Layout::left_to_right(egui::Align::Center)),
    );
    child.set_clip_rect(rect.intersect(ui.clip_rect()));
    let ui = &mut child;
    let tag = widgets::tag(ui, word, color);
    let mut rest = Vec::new();
    if let Some(first) = first {
        let since = format::elapsed(first.time.seconds_since(start));
        let text = format!("since {since}");
        let link = ui.link(widgets::mono(&text)).on_hover_text("Go to the first difference");
        if link.clicked() {
            cx.controls.extend(Control::pause_at(first.time));
        }
        rest.push(widgets::mono(&first.buffer).color(tokens.text));
    } else if let Some(until) = &until {
        rest.push(egui::RichText::new(format!("up to {until}")).color(tokens.text));
    }
    let notes = notes(cx.frame, comparison, first.is_some().then_some(until.as_deref()).flatten());
    rest.extend(notes.into_iter().map(|note| egui::RichText::new(note).small().color(tokens.weak)));
    let all: Vec<&str> = rest.iter().map(egui::RichText::text).collect();
    if !all.is_empty() {
        tag.on_hover_text(all.join("\n"));
    }
    for text in rest {
        if ui.available_width() < LEAST_TEXT {
            break;
        }
        ui.add(egui::Label::new(text).truncate());
    }
}

/// What else is to be known of a comparison.
fn notes(frame: &Frame, comparison: &Comparison, until: Option<&str>) -> Vec<String> {
    let mut notes = Vec::new();
    if let Some(problem) = &comparison.problem {
        notes.push(problem.to_string());
    }
    if let Some(progress) = comparison.progress {
        notes.push(format!("{:.0} % compared", 100.0 * progress));
    } else if let Some(until) = until {
        let at_end = side::first_end(frame, comparison).filter(|(_, end)| comparison.until == Some(*end));
        let why = at_end.map(|(name, _)| format!(", where {name} ends")).unwrap_or_default();
        notes.push(format!("compared up to {until}{why}"));
    }
    let lost_s: f64 = comparison
        .gaps
        .iter()
        .map(|(from, to)| to.seconds_since((*from).max(frame.info.start)).max(0.0))
        .sum();
    if lost_s > 0.0 {
        notes.push(format!("{lost_s:.1} s were not kept"));
    }
    for (count, side) in comparison.left_out.iter().zip(comparison.sides) {
        if *count > 0 {
            notes.push(format!("{count} buffers only in {}", side::name(frame, side)));
        }
    }
    notes
}

/// A font for the cells of tables.
fn font() -> FontId {
    FontId::monospace(11.5)
}
