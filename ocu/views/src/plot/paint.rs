//! Paints one graph: axes, curves, bands of states, cursors.

use super::axis::{Axis, GraphKind, MOST_CHARACTERS, around, mark_text, shortened, time_texts};
use super::columns::{Column, Kept, bands, strokes, visible};
use crate::series::Shown;
use egui::{Color32, FontId, Mesh, Painter, Pos2, Rect, Shape, Stroke, Vec2};
use ocu_ui::Tokens;
use rcs_msg::Stamp;
use rcs_runtime::source::{FieldPoint, Series};

/// Height of a band of states.
pub(super) const BAND: f32 = 18.0;
/// Curves with at most this many visible points are drawn with their points.
const DOTS: usize = 60;
/// Size of the letters of marks, points.
pub(super) const MARK: f32 = 10.5;
/// Width of the lines of curves.
pub(super) const LINE: f32 = 1.25;

/// Times of a source as seconds since its start.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    pub(super) start: Stamp,
}

impl Clock {
    pub(super) fn seconds(self, stamp: Stamp) -> f64 {
        // Times before the start are negative.
        stamp.seconds_since(self.start)
    }

    pub(super) fn stamp(self, seconds: f64) -> Stamp {
        let ns = (seconds * 1e9).clamp(-9e18, 9e18);
        if ns >= 0.0 { self.start.after_ns(ns as u64) } else { self.start.before_ns((-ns) as u64) }
    }
}

/// A curve over time, reduced to what the screen shows.
pub(super) struct Reduced {
    columns: Vec<Column>,
    bands: Vec<(f32, f32, Option<i64>)>,
}

impl Reduced {
    pub(super) fn new(shown: &Shown, axis: &Axis, clock: Clock, kept: &mut Kept) -> Self {
        let seconds = |stamp| clock.seconds(stamp);
        let (from, to) = (clock.stamp(axis.from), clock.stamp(axis.to));
        let range = visible(&shown.points, from, to);
        if shown.are_states() {
            let bands = bands(&shown.points, range, axis, axis.screen.1, seconds);
            return Self { columns: Vec::new(), bands };
        }
        Self { columns: kept.columns(&shown.points, range, axis, seconds), bands: Vec::new() }
    }

    /// Least and greatest visible value.
    pub(super) fn bounds(&self) -> (f64, f64) {
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        self.columns.iter().fold(start, |(min, max), column| (min.min(column.min), max.max(column.max)))
    }

    /// Difference of the greatest and the least visible value; negative without any.
    pub(super) fn spread(&self) -> f64 {
        let (min, max) = self.bounds();
        max - min
    }
}

/// The range of an axis: fixed, or around the visible values of its curves.
pub(super) fn value_range(fixed: Option<(f64, f64)>, curves: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    match fixed {
        Some((from, to)) if from.is_finite() && to.is_finite() && from < to => (from, to),
        _ => {
            let start = (f64::INFINITY, f64::NEG_INFINITY);
            let (min, max) = curves.fold(start, |(min, max), (low, high)| (min.min(low), max.max(high)));
            around(min, max)
        }
    }
}

/// Draws a curve of quantities.
pub(super) fn curve(painter: &Painter, reduced: &Reduced, y: &Axis, color: Color32) {
    let points: usize = reduced.columns.iter().map(|column| column.points).sum();
    let strokes = strokes(&reduced.columns, y);
    if !strokes.bars.is_empty() {
        painter.add(bars(&strokes.bars, color));
    }
    for line in strokes.lines {
        if line.len() == 1 || points <= DOTS {
            for at in &line {
                painter.circle_filled(*at, 2.0, color);
            }
        }
        if line.len() > 1 {
            painter.add(Shape::line(line, Stroke::new(LINE, color)));
        }
    }
}

/// Bars as thick as a line, with ends that fade over a screen point as the edges of a line do.
fn bars(bars: &[Rect], color: Color32) -> Mesh {
    let mut mesh = Mesh::default();
    for bar in bars {
        let inside = (LINE - 1.0) / 2.0;
        let (top, bottom) = (bar.top() - inside, bar.bottom() + inside);
        let start = mesh.vertices.len() as u32;
        let faded = Color32::TRANSPARENT;
        for (y, color) in [(top - 1.0, faded), (top, color), (bottom, color), (bottom + 1.0, faded)] {
            mesh.colored_vertex(Pos2::new(bar.left(), y), color);
            mesh.colored_vertex(Pos2::new(bar.right(), y), color);
        }
        for left in [start, start + 2, start + 4] {
            mesh.add_triangle(left, left + 1, left + 2);
            mesh.add_triangle(left + 1, left + 2, left + 3);
        }
    }
    mesh
}

/// Draws the states of a curve as a band.
pub(super) fn band(painter: &Painter, reduced: &Reduced, shown: &Shown, rect: Rect, tokens: &Tokens) {
    let font = FontId::proportional(11.0);
    for (from, to, state) in &reduced.bands {
        let (left, right) = (from.max(rect.left()), to.min(rect.right()));
        if right <= left {
            continue;
        }
        let area = Rect::from_x_y_ranges(left..=right, rect.y_range());
        let Some(state) = state else {
            painter.rect_filled(area, 0.0, tokens.unknown.gamma_multiply(0.5));
            continue;
        };
        let name = shown.names.get(state).map_or_else(|| state.to_string(), ToString::to_string);
        let color = tokens.series(*state as usize);
        painter.rect_filled(area, 0.0, color.gamma_multiply(0.28));
        painter.vline(area.left(), area.y_range(), Stroke::new(1.0, color));
        if area.width() > 24.0 {
            let mut job = egui::text::LayoutJob::simple_singleline(name, font.clone(), tokens.text);
            job.wrap = egui::text::TextWrapping::truncate_at_width(area.width() - 8.0);
            let galley = painter.layout_job(job);
            let at = Pos2::new(area.left() + 4.0, area.center().y - galley.size().y / 2.0);
            painter.galley(at, galley, tokens.text);
        }
    }
}

/// Draws the grid and the marks of a vertical axis; returns the whole texts of the marks, from above, if some of them find
/// no room.
pub(super) fn vertical_axis(
    painter: &Painter,
    plot: Rect,
    axis: &Axis,
    at_right: bool,
    tokens: &Tokens,
) -> Option<String> {
    let (marks, step) = axis.marks(34.0);
    let font = FontId::monospace(MARK);
    let room = painter.clip_rect();
    let mut whole = Vec::new();
    let mut is_shortened = false;
    for mark in marks.into_iter().rev() {
        let y = axis.at(mark);
        let text = mark_text(mark, step);
        let shown = shortened(&text, MOST_CHARACTERS);
        is_shortened |= shown != text;
        whole.push(text);
        let galley = painter.layout_no_wrap(shown, font.clone(), tokens.weak);
        let (width, height) = (galley.size().x, galley.size().y);
        let left = if at_right {
            painter.hline(plot.right()..=plot.right() + 4.0, y, Stroke::new(1.0, tokens.line));
            (plot.right() + 7.0).min(room.right() - width)
        } else {
            painter.hline(plot.x_range(), y, Stroke::new(1.0, tokens.line.gamma_multiply(0.55)));
            (plot.left() - 6.0 - width).max(room.left())
        };
        painter.galley(Pos2::new(left, y - height / 2.0), galley, tokens.weak);
    }
    is_shortened.then(|| whole.join("\n"))
}

/// The marks of a horizontal axis, with their texts.
fn horizontal_marks(axis: &Axis, kind: GraphKind) -> Vec<(f64, String)> {
    const APART: f32 = 80.0;
    if kind == GraphKind::Time {
        let (marks, step) = axis.time_marks(APART);
        let texts = time_texts(&marks, step);
        return marks.into_iter().zip(texts).collect();
    }
    let (marks, step) = axis.marks(APART);
    let unit = if kind == GraphKind::Frequency { " Hz" } else { "" };
    marks.into_iter().map(|mark| (mark, mark_text(mark, step) + unit)).collect()
}

/// Draws the grid of the horizontal axis, and its marks below the plot if there is room.
pub(super) fn horizontal_axis(
    painter: &Painter,
    plot: Rect,
    axis: &Axis,
    kind: GraphKind,
    labelled: bool,
    tokens: &Tokens,
) {
    for (mark, text) in horizontal_marks(axis, kind) {
        let x = axis.at(mark);
        painter.vline(x, plot.y_range(), Stroke::new(1.0, tokens.line.gamma_multiply(0.55)));
        if labelled {
            let galley = painter.layout_no_wrap(text, FontId::monospace(MARK), tokens.weak);
            // At the ends of the axis a mark stands beside its line rather than outside of what is painted.
            let (room, width) = (painter.clip_rect(), galley.size().x);
            let most = room.right() - width - 2.0;
            let left = (x - width / 2.0).clamp((room.left() + 2.0).min(most), most);
            painter.galley(Pos2::new(left, plot.bottom() + 4.0), galley, tokens.weak);
        }
    }
}

/// Draws a line of time with a flag at its top.
pub(super) fn time_line(
    painter: &Painter,
    plot: Rect,
    x: f32,
    color: Color32,
    flag: Option<&str>,
    on: Color32,
) {
    if !plot.x_range().expand(0.5).contains(x) {
        return;
    }
    painter.vline(x, plot.y_range(), Stroke::new(1.0, color));
    if let Some(flag) = flag {
        let galley = painter.layout_no_wrap(flag.to_owned(), FontId::proportional(10.0), on);
        let rect = Rect::from_min_size(Pos2::new(x, plot.top()), galley.size() + Vec2::new(6.0, 0.0));
        painter.rect_filled(rect, 0.0, color);
        painter.galley(rect.min + Vec2::new(3.0, 0.0), galley, on);
    }
}

/// Points of one series against another, without those that fall on the same spot of the screen.
pub(super) fn against(
    x: &Series<FieldPoint>,
    y: &Series<FieldPoint>,
    axes: (&Axis, &Axis),
) -> Vec<Vec<Pos2>> {
    let (mut lines, mut line): (Vec<Vec<Pos2>>, Vec<Pos2>) = (Vec::new(), Vec::new());
    for (x, y) in pairs(x, y) {
        if !x.is_finite() || !y.is_finite() {
            lines.push(std::mem::take(&mut line));
            continue;
        }
        let at = Pos2::new(axes.0.at(x), axes.1.at(y));
        if line.last().is_none_or(|last| (*last - at).length_sq() > 0.25) {
            line.push(at);
        }
    }
    lines.push(line);
    lines.retain(|line| !line.is_empty());
    lines
}

/// The values of two series at the times of the second.
pub(super) fn pairs(x: &Series<FieldPoint>, y: &Series<FieldPoint>) -> Vec<(f64, f64)> {
    let points = |series: &Series<FieldPoint>| {
        let (mut stamps, mut values) = (Vec::new(), Vec::new());
        series.each(0..series.len(), |point| {
            stamps.push(point.stamp);
            values.push(point.value);
        });
        rcs_formula::Points::new(stamps, values)
    };
    let (x, y) = (points(x), points(y));
    let x = x.at(&y.stamps);
    x.iter().copied().zip(y.values.iter().copied()).collect()
}
