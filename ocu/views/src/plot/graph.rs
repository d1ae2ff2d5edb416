//! One graph: what it draws, its legend, and what the pointer does on it.

use super::GUTTER;
use super::axis::{Axis, GraphKind};
use super::columns::Kept;
use super::drawn::{Drawn, Place};
use super::legend;
use super::menu::Asked;
use super::paint::{self, BAND, Clock, Reduced};
use super::saved::{Graph, Saved};
use crate::series::Shown;
use crate::view::{Hover, ViewContext};
use egui::{Rect, Response, Sense, Shape, Stroke, Ui, Vec2, WidgetInfo};
use ocu_ui::tokens;
use rcs_msg::Stamp;

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
    let of_curve = |(curve, asked)| Act::Curve { graph: place.index, curve, asked };
    acts.extend(legend::ui(ui, saved, drawn, &reduced, place, at).into_iter().map(of_curve));
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
