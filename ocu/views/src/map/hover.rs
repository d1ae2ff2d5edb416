//! Readout of the position under the pointer: coordinates, all fields of the cell, and the frame from which they come.

use super::Map;
use super::grid::Cells;
use super::layers::{self, Kind, Layer};
use super::plan;
use crate::canvas::Viewport;
use crate::view::{Hover, HoverPoint, TopicKey, ViewContext};
use egui::{Align2, Rect, Response, RichText, Stroke, Ui};
use ocu_ui::widgets::mono;
use ocu_ui::{format, legend, tokens};
use rcs_geom::{DVec3, Utm};
use rcs_msg::Stamp;
use rcs_runtime::source::{Control, Frame, Topic};
use rcs_world::Label;
use std::collections::BTreeSet;

/// Part of the height of the map that the read-out takes at most, as far as the costs of the sources allow it, and
/// height of one of its lines, screen points.
const MOST_OF_CANVAS: f32 = 0.6;
const LINE: f32 = 16.0;
/// Distance from a track at which the pointer means it, screen points.
const NEAR: f64 = 6.0;

impl Map {
    /// Says what is under the pointer, and marks what other views say.
    pub(super) fn point_at(
        &self,
        ui: &Ui,
        cx: &mut ViewContext<'_>,
        map: &str,
        shown: &[&Layer<'_>],
        response: &Response,
        viewport: Viewport,
    ) {
        let canvas = response.rect;
        if let Some(at) = response.hover_pos() {
            let [x, y] = viewport.to_plane(canvas, at);
            let point = HoverPoint { frame_id: map.to_owned(), position_m: [x, y, f64::NAN] };
            let mut hover = Hover { point: Some(point), ..Hover::default() };
            let arc = shown.iter().rev().find_map(|layer| {
                let map_from_layer = layers::map_from_layer(cx.frame, map, layer).ok()?;
                plan::pointed(layer, at, plan::At { map_from_layer, viewport, canvas })
            });
            if let Some(arc) = arc {
                (hover.topic, hover.field) = (arc.topic, arc.field);
            } else if let Some((topic, cell)) = top_cell(cx.frame, map, shown, [x, y]) {
                (hover.topic, hover.cell) = (Some(TopicKey::of(topic)), Some(cell));
            }
            hover.time = self.tracks.time_at(shown, [x, y], NEAR / viewport.scale);
            if let Some(time) = hover.time
                && response.clicked()
                && !self.measuring
                && self.draft.is_none()
                && self.example.is_none()
            {
                cx.controls.push(Control::Seek(time));
            }
            cx.selection.hovered.set(hover);
            return;
        }
        let hover = cx.selection.hovered.get();
        let painter = ui.painter_at(canvas);
        let stroke = Stroke::new(1.5, tokens(ui).accent);
        if let Some(point) = hover.point.as_ref().and_then(|point| on_map(cx.frame, map, point)) {
            painter.circle_stroke(viewport.to_screen(canvas, point), 6.0, stroke);
        }
        if let Some(time) = hover.time {
            for place in self.tracks.places_at(shown, time) {
                painter.circle_stroke(viewport.to_screen(canvas, place), 5.0, stroke);
            }
        }
    }

    /// The panel in the corner with the readout.
    pub(super) fn read_out(
        &self,
        ui: &mut Ui,
        frame: &Frame,
        map: &str,
        shown: &[&Layer<'_>],
        pointer: Option<[f64; 2]>,
        canvas: Rect,
    ) {
        let Some([x, y]) = pointer else { return };
        legend::plate(ui, canvas, Align2::RIGHT_BOTTOM, |ui| {
            ui.style_mut().interaction.selectable_labels = false;
            ui.label(mono(format!("x {x:8.2} m  y {y:8.2} m")));
            if let Some((place, is_exact)) = self.tracks.geodetic(shown, map, [x, y]) {
                let about = if is_exact { "" } else { "≈ " };
                let (latitude, longitude) = (place.latitude_deg, place.longitude_deg);
                ui.label(mono(format!("{about}{latitude:11.6}°  {longitude:11.6}°")));
                let mgrs =
                    Utm::from_geodetic(&place).and_then(|utm| utm.to_mgrs(if is_exact { 5 } else { 4 }));
                ui.label(mono(mgrs.map_or_else(
                    |_| "outside of MGRS".to_owned(),
                    |text| about.to_owned() + &spaced(&text),
                )));
            }
            // Who draws looks at what is drawn, not at numbers that lie over it.
            if self.measuring || self.draft.is_some() || self.example.is_some() {
                return;
            }
            let mut is_top = true;
            let most_lines = (MOST_OF_CANVAS * canvas.height() / LINE) as usize;
            for layer in shown.iter().rev() {
                if let Kind::Grid(grid) = layer.kind
                    && let Ok(cells) = Cells::new(grid)
                    && let Ok(map_from_grid) = layers::map_from_layer(frame, map, layer)
                    && let Some(cell) = cells.cell_at(map_from_grid.inverse() * DVec3::new(x, y, 0.0))
                {
                    cell_lines(ui, frame, layer, &cells, cell, is_top, most_lines);
                    is_top = false;
                }
            }
        });
    }
}

/// An MGRS text with blanks between square, easting and northing.
fn spaced(text: &str) -> String {
    let digits = text.len().saturating_sub(5) / 2;
    match (text.get(..5), text.get(5..5 + digits), text.get(5 + digits..)) {
        (Some(square), Some(easting), Some(northing)) => format!("{square} {easting} {northing}"),
        _ => text.to_owned(),
    }
}

/// A position of another view in the plane of the map.
fn on_map(frame: &Frame, map: &str, point: &HoverPoint) -> Option<[f64; 2]> {
    let p = DVec3::from_array(point.position_m.map(|v| if v.is_nan() { 0.0 } else { v }));
    if point.frame_id == map {
        return Some([p.x, p.y]);
    }
    let map_from_point = frame.transforms.lookup(map, &point.frame_id, frame.now.0).ok()?;
    let p = map_from_point * p;
    Some([p.x, p.y])
}

/// The cell under a position, of the uppermost grid that has one there.
fn top_cell<'a>(
    frame: &Frame,
    map: &str,
    shown: &[&Layer<'a>],
    [x, y]: [f64; 2],
) -> Option<(&'a Topic, [usize; 2])> {
    shown.iter().rev().find_map(|layer| {
        let Kind::Grid(grid) = layer.kind else { return None };
        let cells = Cells::new(grid).ok()?;
        let map_from_grid = layers::map_from_layer(frame, map, layer).ok()?;
        Some((layer.topic?, cells.cell_at(map_from_grid.inverse() * DVec3::new(x, y, 0.0))?))
    })
}

/// All fields of a cell: each cost with its confidence and source frame on one line. Of a grid below another one, only
/// the fused cost, if it has one. What finds no room in `most_lines` is counted.
fn cell_lines(
    ui: &mut Ui,
    frame: &Frame,
    layer: &Layer<'_>,
    cells: &Cells<'_>,
    cell: [usize; 2],
    is_top: bool,
    most_lines: usize,
) {
    let value = |name: &str| cells.read(name, cell);
    let mut told = BTreeSet::new();
    let mut tell = |name: &str| {
        told.insert(name.to_owned());
        value(name)
    };
    let weak = tokens(ui).weak;
    ui.label(RichText::new(format!("{}  cell {}, {}", layer.name, cell[0], cell[1])).small().color(weak));
    if let Some(fused) = tell("cost") {
        let confidence = tell("confidence").map(|conf| format!("  conf {conf:3}")).unwrap_or_default();
        let place = tell("source").unwrap_or(f64::NAN);
        let mut sources = cells.names().filter_map(|name| name.strip_prefix("cost."));
        let source = if place >= 0.0 { sources.nth(place as usize) } else { None };
        let by = source.map(|source| format!(" by {source}")).unwrap_or_default();
        let label = match tell("label") {
            Some(label) if label == f64::from(Label::Ground as u8) => "  ground",
            Some(label) if label == f64::from(Label::Obstacle as u8) => "  obstacle",
            _ => "",
        };
        ui.label(mono(format!("fused      {}{confidence}{label}{by}", cost(fused))));
        if !is_top {
            return;
        }
    }
    for name in cells.names() {
        let Some(source) = name.strip_prefix("cost.") else { continue };
        let cost = tell(name).map(cost).unwrap_or_default();
        let confidence =
            tell(&format!("conf.{source}")).map(|conf| format!("  conf {conf:3}")).unwrap_or_default();
        let made_by = match tell(&format!("seq.{source}")) {
            Some(sequence) if sequence > 0.0 => format!("  by frame {sequence}"),
            Some(_) => "  never seen".to_owned(),
            None => String::new(),
        };
        ui.label(mono(format!("{source:<10} {cost}{confidence}{made_by}")));
    }
    if let (Some(seconds), Some(nanos)) = (tell("updated_s"), tell("updated_ns")) {
        let changed = Stamp(seconds as u64 * 1_000_000_000 + nanos as u64);
        let text = match changed.0 {
            0 => "never".to_owned(),
            _ => format!(
                "{} ago, at {}",
                format::age(frame.now.seconds_since(changed)),
                format::clock(changed.0)
            ),
        };
        ui.label(mono(format!("changed    {text}")));
    }
    let rest: Vec<_> = cells.names().filter(|name| !told.contains(*name)).collect();
    // Position, title, fused cost and time of the change take six lines, and each source one.
    let sources = cells.names().filter(|name| name.starts_with("cost.")).count();
    let (listed, hidden) = rest.split_at(rest.len().min(2 * most_lines.saturating_sub(6 + sources)));
    for pair in listed.chunks(2) {
        let one = |name: &str| format!("{name:<18} {:<10}", value(name).map(known).unwrap_or_default());
        let text = pair.iter().map(|name| one(name)).collect::<Vec<_>>().join(" ");
        ui.label(mono(text.trim_end()));
    }
    if !hidden.is_empty() {
        let text = format!("{} numbers more in a larger map", hidden.len());
        ui.label(RichText::new(text).small().color(weak));
    }
}

/// A number of a cell; a dash where it is unknown.
fn known(value: f64) -> String {
    if value.is_nan() { "–".to_owned() } else { format::number(value) }
}

fn cost(value: f64) -> String {
    if value > 250.0 { "unknown ".to_owned() } else { format!("cost {value:3}") }
}
