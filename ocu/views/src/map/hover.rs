//! Readout of the position under the pointer, or of one that is kept: coordinates, and what the cell holds.

use super::Map;
use super::cell::Content;
use super::grid::Cells;
use super::layers::{self, Kind, Layer};
use super::plan;
use crate::canvas::Viewport;
use crate::view::{Hover, HoverPoint, TopicKey, ViewContext};
use egui::{Align2, Pos2, Rect, Response, Stroke, Ui, Vec2};
use ocu_ui::widgets::{icon_button, mono};
use ocu_ui::{icons, legend, tokens};
use rcs_geom::{DVec3, Utm};
use rcs_runtime::source::{Control, Frame, Step, Topic};

/// Part of the height of the map that the read-out takes at most, as far as the costs of the sources allow it, and
/// height of one of its lines, screen points.
const MOST_OF_CANVAS: f32 = 0.6;
const LINE: f32 = 16.0;
/// Distance from a track at which the pointer means it, screen points.
const NEAR: f64 = 6.0;
/// Where the scale bar ends, below the upper edge of the map, screen points.
const BELOW_SCALE: f32 = 36.0;

impl Map {
    /// Says what is under the pointer, and marks what other views say.
    pub(super) fn point_at(
        &mut self,
        ui: &Ui,
        cx: &mut ViewContext<'_>,
        map: &str,
        shown: &[&Layer<'_>],
        response: &Response,
        viewport: Viewport,
    ) {
        let canvas = response.rect;
        if let Some(kept) = self.kept {
            let at = viewport.to_screen(canvas, kept);
            ui.painter_at(canvas).circle_stroke(at, 5.0, Stroke::new(1.5, tokens(ui).strong));
        }
        // What lies below the read-out of a kept cell is not meant.
        let is_meant = |at: &Pos2| self.kept.and(self.kept_plate).is_none_or(|plate| !plate.contains(*at));
        if let Some(at) = response.hover_pos().filter(is_meant) {
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
            if response.clicked() && !self.measuring && self.draft.is_none() && self.example.is_none() {
                match hover.time {
                    Some(time) => cx.controls.push(Control::Seek(time)),
                    // A click beside the cell that is kept lets go of it.
                    None if self.kept.take().is_some() => {}
                    None => self.kept = hover.cell.map(|_| [x, y]),
                }
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

    /// The panel in the corner: where the pointer is, and what the cell there holds. A click keeps the panel at its
    /// place; then each source leads to the message that made the cell.
    #[expect(clippy::too_many_arguments, reason = "what is read, and where that is on the screen")]
    pub(super) fn read_out(
        &mut self,
        ui: &mut Ui,
        cx: &mut ViewContext<'_>,
        map: &str,
        shown: &[&Layer<'_>],
        pointer: Option<[f64; 2]>,
        viewport: Viewport,
        canvas: Rect,
    ) {
        let Some([x, y]) = self.kept.or(pointer) else { return };
        let (is_kept, frame) = (self.kept.is_some(), cx.frame);
        // Who draws looks at what is drawn, not at numbers that lie over it.
        let draws = self.measuring || self.draft.is_some() || self.example.is_some();
        // It does not lie over what it tells of.
        let is_below = viewport.to_screen(canvas, [x, y]).y > canvas.center().y && !draws;
        let (corner, top) =
            if is_below { (Align2::RIGHT_TOP, BELOW_SCALE) } else { (Align2::RIGHT_BOTTOM, 0.0) };
        let place = Rect::from_min_max(canvas.min + Vec2::new(0.0, top), canvas.max);
        let mut close = false;
        let mut wanted = None;
        let ((), plate) = legend::plate(ui, place, corner, |ui| {
            ui.style_mut().interaction.selectable_labels = false;
            ui.horizontal(|ui| {
                ui.label(mono(format!("x {x:8.2} m  y {y:8.2} m")));
                if is_kept {
                    close = icon_button(ui, icons::ICON_CLOSE, "Close the cell").clicked();
                }
            });
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
            if draws {
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
                    let edited = self.edited_weights(layer).cloned();
                    let is_edited = edited.is_some();
                    let weights = edited.or_else(|| super::cell::weights(frame, layer));
                    let content = Content { frame, cells: &cells, cell, weights, is_edited };
                    content.title(ui, &layer.name, is_top && !is_kept);
                    if std::mem::take(&mut is_top) {
                        let clicked = content.show(ui, most_lines, is_kept);
                        wanted = clicked.and_then(|source| source.message(frame, layer));
                    } else {
                        content.brief(ui);
                    }
                }
            }
        });
        self.kept_plate = is_kept.then_some(plate);
        if close {
            self.kept = None;
        }
        if let Some((topic, sequence)) = wanted {
            cx.selection.topic = Some(TopicKey::of(topic));
            self.saved.layers.entry(topic.name.to_string()).or_default().shown = true;
            cx.controls.push(Control::Step(Step::BackTo { topic: topic.name.to_string(), sequence }));
        }
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
