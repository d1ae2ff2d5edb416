//! Readout of the position under the pointer, or of one that is kept: coordinates, and what the cell holds.

use super::Map;
use super::cell::{Content, Room};
use super::grid::Cells;
use super::layers::{self, Kind, Layer};
use super::plan;
use crate::canvas::Viewport;
use crate::view::{Hover, HoverPoint, TopicKey, ViewContext};
use egui::{Align, Align2, Pos2, Rect, Response, Stroke, Ui, Vec2};
use ocu_ui::widgets::{icon_button, mono};
use ocu_ui::{icons, legend, tokens};
use rcs_geom::{DVec3, Utm};
use rcs_msg::Stamp;
use rcs_runtime::source::{Control, Frame, Step, Topic};

/// Part of the height of the map that the read-out takes at most, as far as the costs of the sources allow it, and
/// height of one of its lines, screen points.
const MOST_OF_CANVAS: f32 = 0.6;
const LINE: f32 = 16.0;
/// Distance from a track at which the pointer means it, screen points.
const NEAR: f64 = 6.0;
/// Where the scale bar ends, below the upper edge of the map, screen points.
const BELOW_SCALE: f32 = 36.0;
/// Height of a map below which a read-out may lie over the scale bar, screen points.
const LOW: f32 = 200.0;
/// Room that a plate has around it, and what it takes of the canvas beside its contents: that on both sides, its margin and
/// its edge; screen points.
const MARGIN: f32 = 8.0;
const PLATE: Vec2 = Vec2::new(34.0, 26.0);
/// Distance of a read-out from its place, screen points.
const AWAY: f32 = 16.0;
/// Characters in a line from which coordinates have a constant width.
const WIDE: usize = 30;
/// Lines that are left for a cell before those of latitude and longitude.
const LINES_OF_A_CELL: usize = 9;

/// A layer that is shown because a click in the read-out led to a message of it.
#[derive(Debug)]
pub(super) struct Led {
    /// Its name.
    pub(super) layer: String,
    /// The time of the click.
    from: Stamp,
    /// Whether a time before that of the click has been viewed since.
    was_left: bool,
}

impl Map {
    /// Ends what a click in the read-out shows: when the cell is closed, or the view is back at the time of the click.
    pub(super) fn end_led(&mut self, now: Stamp) {
        let Some(led) = &mut self.led else { return };
        led.was_left |= now < led.from;
        if self.kept.is_none() || (led.was_left && now >= led.from) {
            self.led = None;
        }
    }

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
                    Some(time) => cx.controls.extend(Control::pause_at(time)),
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
    /// place; then each source leads to the message that made the cell. `preview_down` is how far the note about a
    /// preview reaches down, from the upper edge of the map, screen points.
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
        preview_down: f32,
    ) {
        let Some(position) = self.kept.or(pointer) else { return };
        // Who draws looks at what is drawn, not at numbers that lie over it.
        let draws = self.measuring || self.draft.is_some() || self.example.is_some();
        let at = viewport.to_screen(canvas, position);
        let frame = cx.frame;
        let (corner, place) = if draws {
            (Align2::RIGHT_BOTTOM, canvas)
        } else {
            corner_for(canvas, at, self.read_out_size, self.legend, BELOW_SCALE.max(preview_down))
        };
        let clip = ui.clip_rect();
        ui.set_clip_rect(clip.intersect(canvas));
        let (clicks, plate) = legend::plate(ui, place, corner, |ui| {
            ui.style_mut().interaction.selectable_labels = false;
            ui.style_mut().wrap_mode = Some(egui::TextWrapMode::Wrap);
            ui.set_max_width((place.width() - PLATE.x).max(1.0));
            let mut room = room_at(ui, place, canvas);
            let closes = self.position(ui, &mut room, map, position);
            let wanted = if draws { None } else { self.contents(ui, &mut room, frame, map, shown, position) };
            Clicks { closes, wanted }
        });
        ui.set_clip_rect(clip);
        self.read_out_size = plate.size();
        self.kept_plate = self.kept.map(|_| plate);
        if clicks.closes {
            self.kept = None;
        }
        if let Some((topic, sequence)) = clicks.wanted {
            cx.selection.topic = Some(TopicKey::of(topic));
            self.led = Some(Led { layer: topic.name.to_string(), from: frame.now, was_left: false });
            cx.controls.push(Control::Step(Step::BackTo { topic: topic.name.to_string(), sequence }));
        }
    }

    /// The coordinates of a place; returns whether the kept cell is to be closed.
    fn position(&self, ui: &mut Ui, room: &mut Room, map: &str, [x, y]: [f64; 2]) -> bool {
        let mut closes = false;
        // The button is higher than a line.
        room.take(if self.kept.is_some() { 2 } else { 1 });
        ui.horizontal(|ui| {
            let text = if room.chars >= WIDE {
                format!("x {x:8.2} m  y {y:8.2} m")
            } else {
                format!("x {x:.2} y {y:.2}")
            };
            ui.label(mono(text));
            if self.kept.is_some() {
                closes = icon_button(ui, icons::ICON_CLOSE, "Close the cell").clicked();
            }
        });
        // On a small map the lines are for the cell.
        if room.lines < LINES_OF_A_CELL {
            return closes;
        }
        if let Some((place, is_exact)) = self.tracks.geodetic(map, [x, y]) {
            let about = if is_exact { "" } else { "≈ " };
            let (latitude, longitude) = (place.latitude_deg, place.longitude_deg);
            room.write(ui, &format!("{about}{latitude:11.6}°  {longitude:11.6}°"));
            let mgrs = Utm::from_geodetic(&place).and_then(|utm| utm.to_mgrs(if is_exact { 5 } else { 4 }));
            let mgrs = mgrs.map(|text| about.to_owned() + &spaced(&text));
            room.write(ui, mgrs.as_deref().unwrap_or("outside of MGRS"));
        }
        closes
    }

    /// What the cells at a place hold: everything of the uppermost one that is known, and a line of those below. Returns
    /// the topic and the number of the message that was clicked.
    fn contents<'f>(
        &self,
        ui: &mut Ui,
        room: &mut Room,
        frame: &'f Frame,
        map: &str,
        shown: &[&Layer<'_>],
        position: [f64; 2],
    ) -> Option<(&'f Topic, u64)> {
        let (is_kept, found) = (self.kept.is_some(), cells_at(frame, map, shown, position));
        let contents = found.iter().map(|(layer, cells, cell)| {
            let edited = self.edited_weights(layer);
            let is_edited = edited.is_some();
            let weights = edited.or_else(|| super::cell::weights(frame, layer));
            Content { frame, cells, cell: *cell, weights, is_edited }
        });
        let contents: Vec<Content<'_>> = contents.collect();
        let top = contents.iter().position(|content| !content.is_unknown()).unwrap_or(0);
        let mut wanted = None;
        for (index, content) in contents.iter().enumerate().skip(top) {
            let layer = found[index].0;
            if (index > top && content.is_unknown()) || room.lines < 2 {
                continue;
            }
            content.title(ui, room, &layer.name, index == top && !is_kept);
            if index == top {
                let clicked = content.show(ui, room, is_kept);
                wanted = clicked.and_then(|source| source.message(frame, layer));
            } else {
                content.brief(ui, room);
            }
        }
        wanted
    }
}

/// What was clicked in a read-out.
struct Clicks<'a> {
    closes: bool,
    /// The topic and the number of a message.
    wanted: Option<(&'a Topic, u64)>,
}

/// What finds room in a read-out at a place of the canvas.
fn room_at(ui: &Ui, place: Rect, canvas: Rect) -> Room {
    const SAMPLE: &str = "0000000000";
    let font = egui::TextStyle::Monospace.resolve(ui.style());
    let sample = ui.painter().layout_no_wrap(SAMPLE.to_owned(), font, tokens(ui).text);
    let character = (sample.size().x / SAMPLE.len() as f32).max(1.0);
    let size = place.size() - PLATE;
    Room {
        chars: ((size.x / character) as usize).max(1),
        lines: (size.y / LINE) as usize,
        usual: (MOST_OF_CANVAS * canvas.height() / LINE) as usize,
    }
}

/// The corner for a read-out that was of this size, and the part of the canvas in which it lies there: at the top `down`
/// below the upper edge, where scale bar and note end, screen points. It lies neither over the place that it tells of nor
/// over the legend; where no corner is free of both, it may lie over the legend. Corners in the other half of the map are
/// tried first.
fn corner_for(canvas: Rect, at: Pos2, size: Vec2, legend: Option<Rect>, down: f32) -> (Align2, Rect) {
    let top = [Align2::RIGHT_TOP, Align2::LEFT_TOP];
    let bottom = [Align2::RIGHT_BOTTOM, Align2::LEFT_BOTTOM];
    let corners = if at.y > canvas.center().y { [top, bottom] } else { [bottom, top] };
    let placed = corners.as_flattened().iter().map(|corner| {
        let is_below = corner.y() == Align::Min && canvas.height() >= LOW;
        let down = if is_below { down.min(canvas.height() / 2.0) } else { 0.0 };
        let place = Rect::from_min_max(canvas.min + Vec2::new(0.0, down), canvas.max);
        let plate = corner.align_size_within_rect(size, place.shrink(MARGIN));
        let covers = plate.expand(AWAY).contains(at);
        let covers_legend = legend.is_some_and(|legend| legend.intersects(plate));
        ((covers, covers_legend), (*corner, place))
    });
    // The first of several equal ones.
    placed.min_by_key(|(covered, _)| *covered).map_or((Align2::RIGHT_BOTTOM, canvas), |(_, place)| place)
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
    let now = frame.transform_time(frame.now);
    let map_from_point = frame.transforms.lookup(map, &point.frame_id, now.0).ok()?;
    let p = map_from_point * p;
    Some([p.x, p.y])
}

/// The cell under a position, of the uppermost grid that has one there.
fn top_cell<'a>(
    frame: &Frame,
    map: &str,
    shown: &[&Layer<'a>],
    position: [f64; 2],
) -> Option<(&'a Topic, [usize; 2])> {
    let topic_of = |layer: &&Layer<'a>| Some((layer.topic?, cell_at(frame, map, layer, position)?.1));
    shown.iter().rev().find_map(topic_of)
}

/// The cells under a position, that of the uppermost grid first.
fn cells_at<'s, 'a>(
    frame: &Frame,
    map: &str,
    shown: &[&'s Layer<'a>],
    position: [f64; 2],
) -> Vec<(&'s Layer<'a>, Cells<'a>, [usize; 2])> {
    let of = |layer: &&'s Layer<'a>| {
        let (cells, cell) = cell_at(frame, map, layer, position)?;
        Some((*layer, cells, cell))
    };
    shown.iter().rev().filter_map(of).collect()
}

/// The cell of a layer under a position.
fn cell_at<'a>(
    frame: &Frame,
    map: &str,
    layer: &Layer<'a>,
    [x, y]: [f64; 2],
) -> Option<(Cells<'a>, [usize; 2])> {
    let Kind::Grid(grid) = layer.kind else { return None };
    let cells = Cells::new(grid).ok()?;
    let map_from_grid = layers::map_from_layer(frame, map, layer).ok()?;
    let cell = cells.cell_at(map_from_grid.inverse() * DVec3::new(x, y, 0.0))?;
    Some((cells, cell))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_read_out_lies_away_from_its_place() {
        let canvas = Rect::from_min_size(Pos2::new(100.0, 50.0), Vec2::new(600.0, 400.0));
        let size = Vec2::new(280.0, 250.0);
        for at in
            [[150.0, 60.0], [690.0, 60.0], [690.0, 240.0], [690.0, 260.0], [110.0, 440.0], [690.0, 440.0]]
        {
            let at = Pos2::from(at);
            let (corner, place) = corner_for(canvas, at, size, None, BELOW_SCALE);
            let plate = corner.align_size_within_rect(size, place.shrink(MARGIN));
            assert!(canvas.contains_rect(plate) && !plate.contains(at), "{at}: {plate}");
        }
    }

    #[test]
    fn a_read_out_covers_neither_its_cell_nor_the_legend_while_a_corner_is_free() {
        let canvas = Rect::from_min_size(Pos2::new(100.0, 50.0), Vec2::new(600.0, 400.0));
        let legend = Rect::from_min_max(Pos2::new(108.0, 402.0), Pos2::new(350.0, 442.0));
        let size = Vec2::new(280.0, 250.0);
        let at = Pos2::new(690.0, 240.0);
        let (corner, place) = corner_for(canvas, at, size, Some(legend), BELOW_SCALE);
        let plate = corner.align_size_within_rect(size, place.shrink(MARGIN));
        assert!(!plate.contains(at) && !plate.intersects(legend), "{plate}");
        // A plate that is as high as the map lies over the legend rather than over the cell.
        let high = Vec2::new(280.0, 380.0);
        assert_eq!(corner_for(canvas, at, high, Some(legend), BELOW_SCALE).0, Align2::LEFT_BOTTOM);
    }
}
