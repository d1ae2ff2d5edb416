//! The legend of a graph: the names of its curves with their values at a time, and their menus.

use super::axis::{GraphKind, among};
use super::drawn::{Drawn, DrawnCurve, Place};
use super::menu::{self, Asked};
use super::paint::Reduced;
use super::saved::Saved;
use crate::series::Shown;
use egui::text::{LayoutJob, TextWrapping};
use egui::{
    Align, Color32, FontId, Frame, Layout, Pos2, Rect, RichText, ScrollArea, Sense, Stroke, Ui, UiBuilder,
    Vec2, WidgetInfo,
};
use ocu_ui::{format, icons, tokens, widgets};
use rcs_msg::Stamp;

/// Height of a row, points.
const ROW: f32 = 16.0;
/// Distance of the legend from the upper and the left edge of the graph, points.
const TOP: f32 = 4.0;
const LEFT: f32 = 6.0;
/// Most height of the list of all curves, points.
const LIST: f32 = 400.0;
/// Number of frequencies among which the legend finds the greatest amplitude.
const MOST_PEAK: usize = 65_536;

/// What the legend says of a curve.
struct Entry<'a> {
    curve: &'a DrawnCurve,
    name: String,
    value: String,
    /// Whether the value says why there is none.
    is_problem: bool,
}

impl<'a> Entry<'a> {
    fn new(drawn: &Drawn, curve: &'a DrawnCurve, spread: f64, at: Option<Stamp>) -> Self {
        let (value, is_problem) = reading(drawn, curve, spread, at);
        let name = match &drawn.against {
            Some((against, _)) => format!("{} against {against}", curve.label),
            None => curve.label.clone(),
        };
        Self { curve, name, value, is_problem }
    }

    /// Why some values are not there, although others are.
    fn lacks(&self) -> Option<&str> {
        self.curve.shown.problem.as_deref().filter(|_| !self.is_problem)
    }

    /// Name and value, and what is wrong with them.
    fn whole(&self) -> String {
        let (name, value) = (&self.name, &self.value);
        match self.lacks() {
            Some(problem) if value.is_empty() => format!("{name}: {problem}"),
            Some(problem) => format!("{name}: {value}; {problem}"),
            None => format!("{name}: {value}"),
        }
    }
}

/// Paints the legend. Where its rows would take more than half of the height, those below are left out, and the last row
/// is a button that lists all curves. Returns what was asked for, and of which curve.
pub(super) fn ui(
    ui: &mut Ui,
    saved: &Saved,
    drawn: &Drawn,
    reduced: &[Reduced],
    place: &Place,
    at: Option<Stamp>,
) -> Vec<(usize, Asked)> {
    let spread = |index: usize| reduced.get(index).map_or(0.0, Reduced::spread);
    let curves = drawn.curves.iter().enumerate();
    let entries: Vec<Entry<'_>> =
        curves.map(|(index, curve)| Entry::new(drawn, curve, spread(index), at)).collect();
    let count = shown(entries.len(), place.plot.height());
    let rows = entries.iter().enumerate().take(count);
    let mut asked: Vec<_> =
        rows.filter_map(|(index, entry)| Some((index, row(ui, saved, entry, place, index)?))).collect();
    if count < entries.len() {
        asked.extend(all(ui, &entries, place, count));
    }
    asked
}

/// Number of curves that have a row of their own in a graph of this height.
fn shown(curves: usize, height: f32) -> usize {
    let fit = |height: f32| ((height - TOP) / ROW).max(1.0) as usize;
    // One curve and the button, where the graph is as high as that.
    let rows = fit(0.5 * height).max(fit(height).min(2));
    if curves <= rows { curves } else { rows - 1 }
}

/// Where a row of the legend begins.
fn row_at(place: &Place, row: usize) -> Pos2 {
    place.plot.left_top() + Vec2::new(LEFT, TOP + ROW * row as f32)
}

/// The row of a curve; returns what was asked for.
fn row(ui: &Ui, saved: &Saved, entry: &Entry<'_>, place: &Place, index: usize) -> Option<Asked> {
    let tokens = tokens(ui);
    let room = (place.plot.width() - 32.0).max(8.0);
    let color = if entry.is_problem || entry.lacks().is_some() { tokens.warning } else { tokens.strong };
    let layout = |text: &str, font: FontId, color: Color32, width: f32| {
        let mut job = LayoutJob::simple_singleline(text.to_owned(), font, color);
        job.wrap = TextWrapping::truncate_at_width(width.max(8.0));
        ui.painter().layout_job(job)
    };
    let value = layout(&entry.value, FontId::monospace(11.0), color, 0.6 * room);
    let label = layout(&entry.name, FontId::proportional(11.0), tokens.text, room - value.size().x - 12.0);
    let width = 20.0 + label.size().x + 12.0 + value.size().x;
    let rect = Rect::from_min_size(row_at(place, index), Vec2::new(width, ROW));
    let mut response = ui.interact(rect, ui.scope_id().with(("legend", place.index, index)), Sense::click());
    if label.elided || value.elided || entry.curve.shown.problem.is_some() {
        response = response.on_hover_text(entry.whole());
    }
    let said = format!("Curve {}", entry.name);
    response.widget_info(|| WidgetInfo::labeled(egui::Role::Button, true, &said));
    let fill = if response.hovered() { tokens.surface[2] } else { tokens.canvas().gamma_multiply(0.8) };
    ui.painter().rect_filled(rect.expand2(Vec2::new(2.0, 0.0)), 2.0, fill);
    let (left, middle) = (rect.left(), rect.center().y);
    ui.painter().hline(left + 2.0..=left + 14.0, middle, Stroke::new(2.5, entry.curve.color));
    let mut x = left + 20.0;
    for (galley, gap) in [(label, 12.0), (value, 0.0)] {
        let at = Pos2::new(x, middle - galley.size().y / 2.0);
        x += galley.size().x + gap;
        ui.painter().galley(at, galley, tokens.text);
    }
    let mut asked = None;
    response.context_menu(|ui| asked = menu::ui(ui, saved, &saved.graphs[place.index].curves[index]));
    if response.clicked() {
        asked = Some(Asked::Edit);
    }
    asked
}

/// The button below the rows, of which there are `count`. It lists all curves with their values: a click edits one, and
/// a button removes it.
fn all(ui: &mut Ui, entries: &[Entry<'_>], place: &Place, count: usize) -> Option<(usize, Asked)> {
    let what = if count == 0 { "curves" } else { "more" };
    let text = format!("{} {what}", entries.len() - count);
    let rect = Rect::from_min_size(row_at(place, count), Vec2::new(place.plot.width() - LEFT, ROW));
    let layout = Layout::left_to_right(Align::Center);
    let builder = UiBuilder::new().id_salt(("legend", place.index, "all")).max_rect(rect).layout(layout);
    let mut child = ui.new_child(builder);
    child.spacing_mut().button_padding = Vec2::new(4.0, 0.0);
    child.spacing_mut().interact_size.y = ROW;
    let mut asked = None;
    let list = |ui: &mut Ui| {
        for (index, entry) in entries.iter().enumerate() {
            let line = icons::ICON_SHOW_CHART.rich_text().color(entry.curve.color);
            ui.horizontal(|ui| {
                if widgets::icon_button(ui, icons::ICON_CLOSE, &format!("Remove {}", entry.name)).clicked() {
                    asked = Some((index, Asked::Remove));
                }
                if ui.button((line, entry.whole())).clicked() {
                    asked = Some((index, Asked::Edit));
                }
            });
        }
    };
    // Curves lie below the button.
    let ground = Frame::new().fill(tokens(ui).surface[3]).corner_radius(2.0);
    let button = |ui: &mut Ui| {
        let text = RichText::new(text).size(11.0);
        let menu = ui.menu_button(text, |ui| ScrollArea::vertical().max_height(LIST).show(ui, list).inner);
        menu.response.on_hover_text("All curves of this graph, with their values");
    };
    ground.show(&mut child, button);
    asked
}

/// The greatest amplitude of a spectrum and its frequency, without those of the trend: the first two.
fn peak(shown: &Shown) -> String {
    let points = (2..shown.points.len().min(MOST_PEAK)).filter_map(|index| shown.points.get(index));
    let greatest = points.max_by(|a, b| a.value.total_cmp(&b.value));
    greatest.map_or_else(String::new, |point| {
        let hertz = point.stamp.0 as f64 * 1e-9;
        format!("{} at {} Hz", format::number(point.value), format::number(hertz))
    })
}

/// What the legend says beside a name, and whether that is a problem. A value has the digits that tell it from others of
/// the curve, whose visible values have this spread.
fn reading(drawn: &Drawn, curve: &DrawnCurve, spread: f64, at: Option<Stamp>) -> (String, bool) {
    let shown = &curve.shown;
    if let Some(problem) = shown.problem.as_ref().filter(|_| shown.points.is_empty()) {
        return (problem.to_string(), true);
    }
    if let Some(reading) = shown.reading {
        return (format!("{:.0} %", reading * 100.0), false);
    }
    let value = match (drawn.kind, at) {
        (GraphKind::Time, Some(at)) => {
            let index = shown.points.count_until(at);
            index.checked_sub(1).and_then(|index| shown.points.get(index)).map(|point| point.value)
        }
        (GraphKind::Frequency, _) => return (peak(shown), false),
        (GraphKind::Index, _) => return (format!("{} values", shown.points.len()), false),
        _ => None,
    };
    let text = match value {
        Some(value) => match shown.names.get(&(value as i64)).filter(|_| value.is_finite()) {
            Some(name) => name.to_string(),
            None if value.is_finite() => among(value, spread),
            None => "–".to_owned(),
        },
        None if drawn.kind == GraphKind::Time => "–".to_owned(),
        None => String::new(),
    };
    (text, false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::axis::Axis;
    use crate::plot::columns::Kept;
    use crate::plot::paint::Clock;
    use egui::Rangef;
    use rcs_runtime::source::FieldPoint;

    /// What the legend says at 1 s of a curve with these values, one each second.
    fn said(values: [f64; 3]) -> String {
        let point = |(value, i): (f64, u64)| FieldPoint { stamp: Stamp(i * 1_000_000_000), value };
        let points = values.into_iter().zip(0..).map(point).collect();
        let shown = Shown { points, ..Shown::default() };
        let axis = Axis::horizontal(0.0, 2.0, Rangef::new(0.0, 300.0));
        let reduced = Reduced::new(&shown, &axis, Clock { start: Stamp(0) }, &mut Kept::default());
        let curve = DrawnCurve { label: "/a.x".to_owned(), color: Color32::WHITE, right: false, shown };
        let drawn = Drawn { kind: GraphKind::Time, curves: Vec::new(), against: None };
        reading(&drawn, &curve, reduced.spread(), Some(Stamp(1_000_000_000))).0
    }

    #[test]
    fn a_great_value_in_the_legend_has_the_digits_by_which_the_visible_ones_differ() {
        assert_eq!(said([4_332_120.0, 4_332_123.456, 4_332_150.0]), "4332123.5");
        assert_eq!(said([4_332_123.0, 4_332_123.456, 4_332_123.9]), "4332123.456");
        assert_eq!(said([1.7e18, 1.7e18 + 3e10, 1.7e18 + 6e10]), "1.7000000300e18");
        assert_eq!(said([0.5, 1.25, 2.0]), "1.25");
        assert_eq!(said([7.0; 3]), "7");
    }
}
