//! One graph: what it draws, its legend, and what the pointer does on it.

use super::axis::{Axis, GraphKind, among};
use super::columns::Kept;
use super::menu::{self, Asked};
use super::paint::{self, BAND, Clock, Reduced};
use super::saved::{Curve, Graph, Saved};
use super::{GUTTER, color_of, run_label};
use crate::series::{Shelf, Shown, array};
use crate::view::{Hover, ViewContext};
use egui::{Align2, Color32, FontId, Pos2, Rect, Response, Sense, Shape, Stroke, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, tokens};
use rcs_formula::Over;
use rcs_msg::Stamp;
use rcs_runtime::source::Frame;

const LEGEND_ROW: f32 = 16.0;
/// Number of frequencies among which the legend finds the greatest amplitude.
const MOST_PEAK: usize = 65_536;

/// What a curve draws.
pub(super) struct DrawnCurve {
    pub(super) label: String,
    pub(super) color: Color32,
    pub(super) right: bool,
    pub(super) shown: Shown,
}

/// What a graph draws.
pub(super) struct Drawn {
    pub(super) kind: GraphKind,
    pub(super) curves: Vec<DrawnCurve>,
    /// The horizontal axis of [`GraphKind::Against`].
    against: Option<(String, Shown)>,
}

impl Drawn {
    pub(super) fn new(ui: &Ui, frame: &Frame, shelf: &mut Shelf, graph: &Graph, color: &mut usize) -> Self {
        let mut curves = Vec::new();
        // What the values of each curve are over.
        let mut over = Vec::new();
        for curve in &graph.curves {
            let (ctx, run) = (ui.ctx(), curve.run);
            let mut shown = shelf.shown(ctx, frame, &curve.formula, run);
            let mut of = match shown.over {
                Over::Time => GraphKind::Time,
                Over::Frequency => GraphKind::Frequency,
            };
            if shown.points.is_empty()
                && let Ok(formula) = shelf.formula(&curve.formula)
                && let Some(found) = formula.as_field().and_then(|field| array(ctx, frame, field, run))
            {
                match found {
                    Ok(found) => (shown, of) = (found, GraphKind::Index),
                    // It may be no array, so that it does not displace curves over time.
                    Err(problem) if shown.problem.is_some() => shown.problem = Some(problem.into()),
                    Err(_) => {}
                }
            }
            over.push(of);
            let label = format!("{}{}", curve.formula, run_label(curve.run));
            curves.push(DrawnCurve { label, color: color_of(ui, *color), right: curve.right, shown });
            *color += 1;
        }
        let kind = if graph.against.is_some() {
            GraphKind::Against
        } else if over.contains(&GraphKind::Index) {
            GraphKind::Index
        } else if !over.is_empty() && over.iter().all(|of| *of == GraphKind::Frequency) {
            GraphKind::Frequency
        } else {
            GraphKind::Time
        };
        let fits = |of: GraphKind| of == kind || (of, kind) == (GraphKind::Time, GraphKind::Against);
        for (curve, of) in curves.iter_mut().zip(over).filter(|(_, of)| !fits(*of)) {
            let problem = match of {
                GraphKind::Frequency => "a spectrum is over frequency; give it a graph of its own",
                GraphKind::Index => "an array is over its index; give it a graph of its own",
                // Why it has no values is said already.
                _ if curve.shown.points.is_empty() => continue,
                _ => "it is over time, and the array beside it over its index; give it a graph of its own",
            };
            curve.shown = Shown { problem: Some(problem.into()), ..Shown::default() };
        }
        let run = graph.curves.first().map(|curve| curve.run).unwrap_or_default();
        let against =
            graph.against.as_ref().map(|text| (text.clone(), shelf.shown(ui.ctx(), frame, text, run)));
        Self { kind, curves, against }
    }

    pub(super) fn has_right_axis(&self) -> bool {
        self.curves.iter().any(|curve| curve.right && !curve.shown.are_states())
    }
}

/// Where a graph is.
pub(super) struct Place {
    pub(super) index: usize,
    pub(super) plot: Rect,
    /// Whether the horizontal axis has marks.
    pub(super) labelled: bool,
    /// The visible time, in seconds.
    pub(super) time: (f64, f64),
    pub(super) clock: Clock,
}

/// What the pointer asked for.
pub(super) enum Act {
    Time(f64, f64),
    Values { graph: usize, side: usize, range: (f64, f64) },
    Across { graph: usize, range: (f64, f64) },
    Cursors(Option<(f64, f64)>),
    Fit,
    Seek(Stamp),
    Curve { graph: usize, curve: usize, asked: Asked },
}

/// The axes of a graph: horizontal, left and right.
struct Axes {
    x: Axis,
    y: [Axis; 2],
}

/// Paints a graph and takes what the pointer does.
pub(super) fn ui(
    ui: &mut Ui,
    cx: &mut ViewContext<'_>,
    saved: &Saved,
    drawn: &Drawn,
    place: &Place,
    cursors: Option<(f64, f64)>,
) -> Vec<Act> {
    let (tokens, plot) = (tokens(ui), place.plot);
    let graph = &saved.graphs[place.index];
    let response = ui.interact(plot, ui.scope_id().with(("graph", place.index)), Sense::click_and_drag());
    let names: Vec<&str> = drawn.curves.iter().map(|curve| curve.label.as_str()).collect();
    response.widget_info(|| {
        WidgetInfo::labeled(egui::Role::Image, true, format!("Graph of {}", names.join(", ")))
    });
    ui.painter().rect_filled(plot, 0.0, tokens.canvas());

    let is_from_zero = matches!(drawn.kind, GraphKind::Index | GraphKind::Frequency);
    let clock = if is_from_zero { Clock { start: Stamp(0) } } else { place.clock };
    let x = horizontal(drawn, graph, place);
    let bands = drawn.curves.iter().filter(|curve| curve.shown.are_states()).count();
    let quantities = plot.with_max_y(plot.bottom() - BAND * bands as f32);
    let reduced: Vec<Reduced> = if drawn.kind == GraphKind::Against {
        Vec::new()
    } else {
        let curves = drawn.curves.iter().enumerate();
        curves.map(|(index, curve)| reduced(ui, (place.index, index), &curve.shown, &x, clock)).collect()
    };
    let y = [false, true].map(|right| {
        let of_side = drawn.curves.iter().enumerate().filter(|(_, curve)| curve.right == right);
        let bounds = of_side.map(|(index, curve)| match reduced.get(index) {
            Some(reduced) => reduced.bounds(),
            None => value_bounds(&curve.shown),
        });
        let (from, to) = paint::value_range(graph.ranges[usize::from(right)], bounds);
        Axis::vertical(from, to, quantities.y_range())
    });
    let axes = Axes { x, y };
    let painter = ui.painter().with_clip_rect(plot.expand2(Vec2::new(60.0, 24.0)).intersect(ui.clip_rect()));
    paint::horizontal_axis(&painter, plot, &axes.x, drawn.kind, place.labelled, tokens);
    let has_axis = [bands < drawn.curves.len(), drawn.has_right_axis()];
    for side in (0..2).filter(|side| has_axis[*side]) {
        vertical_axis(ui, &painter, place, quantities, &axes.y[side], side);
    }
    ui.painter().rect_stroke(plot, 0.0, Stroke::new(1.0, tokens.line), egui::StrokeKind::Outside);

    let inside = ui.painter().with_clip_rect(plot.intersect(ui.clip_rect()));
    if let (Some((from, to)), GraphKind::Time) = (cursors, drawn.kind) {
        let area = Rect::from_x_y_ranges(axes.x.at(from)..=axes.x.at(to), plot.y_range());
        inside.rect_filled(area.intersect(plot), 0.0, tokens.accent.gamma_multiply(0.12));
        for (at, flag) in [(from, "A"), (to, "B")] {
            paint::time_line(&inside, plot, axes.x.at(at), tokens.accent, Some(flag), tokens.canvas());
        }
    }
    curves(&inside, drawn, &reduced, &axes, quantities, tokens);
    let mut acts = pointer(ui, graph, drawn, place, &response, &axes);
    let at = times(ui, cx, drawn, place, &response, &axes, &inside);
    acts.extend(legend(ui, saved, drawn, &reduced, place, at));
    acts
}

/// Paints a vertical axis, the left one (0) or the right one (1). Where marks find no room beside the plot, the axis says
/// them whole when the pointer rests on it.
fn vertical_axis(
    ui: &Ui,
    painter: &egui::Painter,
    place: &Place,
    quantities: Rect,
    axis: &Axis,
    side: usize,
) {
    let Some(whole) = paint::vertical_axis(painter, quantities, axis, side == 1, tokens(ui)) else { return };
    let (left, right) = (quantities.left(), quantities.right());
    let gutter = if side == 1 { right..=right + GUTTER } else { left - GUTTER..=left };
    let beside = Rect::from_x_y_ranges(gutter, quantities.y_range());
    let id = ui.scope_id().with(("axis", place.index, side));
    ui.interact(beside, id, Sense::hover()).on_hover_text_at_pointer(whole);
}

/// A curve reduced to what the screen shows; what was drawn last is kept with the graph.
fn reduced(ui: &Ui, curve: (usize, usize), shown: &Shown, x: &Axis, clock: Clock) -> Reduced {
    let id = ui.scope_id().with(("columns", curve));
    let mut kept: Kept = ui.data_mut(|data| data.remove_temp(id)).unwrap_or_default();
    let reduced = Reduced::new(shown, x, clock, &mut kept);
    ui.data_mut(|data| data.insert_temp(id, kept));
    reduced
}

/// The horizontal axis.
fn horizontal(drawn: &Drawn, graph: &Graph, place: &Place) -> Axis {
    let (from, to) = match drawn.kind {
        GraphKind::Time => place.time,
        GraphKind::Index | GraphKind::Frequency => {
            let ends = drawn.curves.iter().filter_map(|curve| curve.shown.points.last());
            let most = ends.map(|end| end.stamp.0 as f64 * 1e-9).fold(0.0, f64::max);
            paint::value_range(graph.across, std::iter::once((0.0, most)))
        }
        GraphKind::Against => {
            let bounds = drawn.against.iter().map(|(_, shown)| value_bounds(shown));
            paint::value_range(graph.across, bounds)
        }
    };
    Axis::horizontal(from, to, place.plot.x_range())
}

/// Least and greatest value of all.
fn value_bounds(shown: &Shown) -> (f64, f64) {
    rcs_runtime::source::moments(&shown.points, 0..shown.points.len())
        .map_or((f64::INFINITY, f64::NEG_INFINITY), |moments| (moments.min, moments.max))
}

fn curves(
    painter: &egui::Painter,
    drawn: &Drawn,
    reduced: &[Reduced],
    axes: &Axes,
    quantities: Rect,
    tokens: &ocu_ui::Tokens,
) {
    let mut bottom = quantities.bottom();
    for (index, curve) in drawn.curves.iter().enumerate() {
        let y = &axes.y[usize::from(curve.right)];
        match (reduced.get(index), &drawn.against) {
            (Some(reduced), _) if curve.shown.are_states() => {
                let rect = Rect::from_x_y_ranges(quantities.x_range(), bottom..=bottom + BAND - 2.0);
                paint::band(painter, reduced, &curve.shown, rect, tokens);
                bottom += BAND;
            }
            (Some(reduced), _) => paint::curve(
                &painter.with_clip_rect(quantities.intersect(painter.clip_rect())),
                reduced,
                y,
                curve.color,
            ),
            (None, Some((_, across))) => {
                for line in paint::against(&across.points, &curve.shown.points, (&axes.x, y)) {
                    if let [one] = line.as_slice() {
                        painter.circle_filled(*one, 2.0, curve.color);
                    } else {
                        painter.add(Shape::line(line, Stroke::new(paint::LINE, curve.color)));
                    }
                }
            }
            (None, None) => {}
        }
    }
}

/// The lines of the viewed and of the hovered time; returns the time at which the legend reads.
fn times(
    ui: &Ui,
    cx: &mut ViewContext<'_>,
    drawn: &Drawn,
    place: &Place,
    response: &Response,
    axes: &Axes,
    painter: &egui::Painter,
) -> Option<Stamp> {
    if drawn.kind != GraphKind::Time {
        return None;
    }
    let tokens = tokens(ui);
    let (plot, clock) = (place.plot, place.clock);
    paint::time_line(
        painter,
        plot,
        axes.x.at(clock.seconds(cx.frame.now)),
        tokens.strong,
        None,
        tokens.canvas(),
    );
    if let Some(at) = response.hover_pos() {
        let time = clock.stamp(axes.x.value(at.x));
        cx.selection.hovered.set(Hover { time: Some(time), ..Hover::default() });
    }
    let hovered = cx.selection.hovered.get().time;
    if let Some(time) = hovered {
        paint::time_line(painter, plot, axes.x.at(clock.seconds(time)), tokens.weak, None, tokens.canvas());
    }
    Some(hovered.unwrap_or(cx.frame.now))
}

/// What the pointer does on the graph.
fn pointer(
    ui: &Ui,
    graph: &Graph,
    drawn: &Drawn,
    place: &Place,
    response: &Response,
    axes: &Axes,
) -> Vec<Act> {
    let mut acts = Vec::new();
    let is_time = drawn.kind == GraphKind::Time;
    let across = |range: (f64, f64)| {
        if is_time { Act::Time(range.0, range.1) } else { Act::Across { graph: place.index, range } }
    };
    let shift = ui.input(|input| input.modifiers.shift);
    if response.double_clicked() {
        acts.push(Act::Fit);
    } else if response.clicked() && is_time {
        match response.interact_pointer_pos() {
            Some(_) if shift => acts.push(Act::Cursors(None)),
            Some(at) => acts.push(Act::Seek(place.clock.stamp(axes.x.value(at.x)))),
            None => {}
        }
    }
    if response.dragged_by(egui::PointerButton::Primary) {
        let (at, delta) = (response.interact_pointer_pos(), response.drag_delta());
        let origin = ui.input(|input| input.pointer.press_origin());
        match (at, origin) {
            (Some(at), Some(origin)) if shift && is_time => {
                let (a, b) = (axes.x.value(origin.x), axes.x.value(at.x));
                acts.push(Act::Cursors((a != b).then(|| (a.min(b), a.max(b)))));
            }
            _ => {
                if delta.x != 0.0 {
                    acts.push(across(axes.x.moved(delta.x)));
                }
                // An axis that fits itself stays so.
                for side in 0..2 {
                    if graph.ranges[side].is_some() && delta.y != 0.0 {
                        acts.push(Act::Values {
                            graph: place.index,
                            side,
                            range: axes.y[side].moved(delta.y),
                        });
                    }
                }
            }
        }
    }
    if let Some(at) = response.hover_pos() {
        let (scroll, pinch) = ui.input(|input| (input.smooth_scroll_delta(), f64::from(input.zoom_delta())));
        let factor = (f64::from(scroll.y) / 240.0).exp();
        if (factor - 1.0).abs() > 1e-6 {
            acts.push(across(axes.x.zoomed(at.x, factor)));
        }
        if scroll.x != 0.0 {
            acts.push(across(axes.x.moved(scroll.x)));
        }
        if (pinch - 1.0).abs() > 1e-6 {
            for side in 0..2 {
                let range = axes.y[side].zoomed(at.y, pinch);
                acts.push(Act::Values { graph: place.index, side, range });
            }
        }
    }
    acts
}

/// The names of the curves with their values at a time, and their menus.
fn legend(
    ui: &mut Ui,
    saved: &Saved,
    drawn: &Drawn,
    reduced: &[Reduced],
    place: &Place,
    at: Option<Stamp>,
) -> Vec<Act> {
    let tokens = tokens(ui);
    let mut acts = Vec::new();
    let most = ((place.plot.height() - 8.0) / LEGEND_ROW).max(1.0) as usize;
    for (index, curve) in drawn.curves.iter().enumerate().take(most) {
        let top = place.plot.top() + 4.0 + LEGEND_ROW * index as f32;
        let spread = reduced.get(index).map_or(0.0, Reduced::spread);
        let (value, is_problem) = reading(drawn, curve, spread, at);
        let font = FontId::proportional(11.0);
        let name = match &drawn.against {
            Some((against, _)) => format!("{} against {against}", curve.label),
            None => curve.label.clone(),
        };
        let room = (place.plot.width() - 32.0).max(8.0);
        // Some values are there, and others are not.
        let lacks = curve.shown.problem.as_ref().filter(|_| !is_problem);
        let color = if is_problem || lacks.is_some() { tokens.warning } else { tokens.strong };
        let layout = |text: String, font: FontId, color: Color32, width: f32| {
            let mut job = egui::text::LayoutJob::simple_singleline(text, font, color);
            job.wrap = egui::text::TextWrapping::truncate_at_width(width.max(8.0));
            ui.painter().layout_job(job)
        };
        let whole = match lacks {
            Some(problem) if value.is_empty() => problem.to_string(),
            Some(problem) => format!("{value}; {problem}"),
            None => value.clone(),
        };
        let value = layout(value, FontId::monospace(11.0), color, 0.6 * room);
        let label = layout(name.clone(), font, tokens.text, room - value.size().x - 12.0);
        let width = 20.0 + label.size().x + 12.0 + value.size().x;
        let rect = Rect::from_min_size(Pos2::new(place.plot.left() + 6.0, top), Vec2::new(width, LEGEND_ROW));
        let mut response =
            ui.interact(rect, ui.scope_id().with(("legend", place.index, index)), Sense::click());
        if label.elided || value.elided || curve.shown.problem.is_some() {
            response = response.on_hover_text(format!("{name}: {whole}"));
        }
        let said = format!("Curve {name}");
        response.widget_info(|| WidgetInfo::labeled(egui::Role::Button, true, &said));
        let fill = if response.hovered() { tokens.surface[2] } else { tokens.canvas().gamma_multiply(0.8) };
        ui.painter().rect_filled(rect.expand2(Vec2::new(2.0, 0.0)), 2.0, fill);
        let (left, middle) = (rect.left(), rect.center().y);
        ui.painter().hline(left + 2.0..=left + 14.0, middle, Stroke::new(2.5, curve.color));
        let mut x = left + 20.0;
        for (galley, gap) in [(label, 12.0), (value, 0.0)] {
            let at = Pos2::new(x, middle - galley.size().y / 2.0);
            x += galley.size().x + gap;
            ui.painter().galley(at, galley, tokens.text);
        }
        let saved_curve: &Curve = &saved.graphs[place.index].curves[index];
        let mut asked = None;
        response.context_menu(|ui| asked = menu::ui(ui, saved, saved_curve));
        if response.clicked() {
            asked = Some(Asked::Edit);
        }
        acts.extend(asked.map(|asked| Act::Curve { graph: place.index, curve: index, asked }));
    }
    if drawn.curves.len() > most {
        let at = place.plot.right_top() + Vec2::new(-6.0, 4.0);
        let text = format!("{} more", drawn.curves.len() - most);
        ui.painter().text(at, Align2::RIGHT_TOP, text, FontId::proportional(11.0), tokens.weak);
    }
    acts
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
