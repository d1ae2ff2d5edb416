//! Painting of map layers.

use super::grid::Cells;
use super::labels::Labels;
use super::layers::{Kind, Layer, PlacedTrack};
use super::mission::hatch;
use super::picture::{self, CloudPicture, GridLook, GridPicture};
use super::robot::Robot;
use super::track::line;
use super::uncertainty::{self, Covariance};
use super::{LayerState, Map};
use crate::canvas::Viewport;
use crate::clip::{self, is_place};
use crate::pose;
use egui::epaint::Vertex;
use egui::{
    Align2, Color32, FontId, Id, Mesh, Painter, Pos2, Rect, Response, Shape, Stroke, TextureId, Ui, Vec2,
};
use ocu_ui::legend::{decimals, round_step};
use ocu_ui::{format, tokens};
use rcs_geom::{DVec3, Pose};
use rcs_msg::AnyMessage;
use rcs_msg::foxglove::PosesInFrame;
use rcs_runtime::source::{Frame, RunTag};
use std::f64::consts::FRAC_PI_2;
use std::ops::Range;

/// Least length of the arrow of a pose, screen points: it is seen where the map shows a lot.
const LEAST_ARROW: f64 = 6.0;
/// Radius of the dot of a position fix, relative to the width of a line in its place.
const DOT: f32 = 0.75;
/// Width of the edge of the track of the run from which this one branched, screen points.
const GHOST_EDGE: f32 = 3.5;
/// Where the arrow to the north ends, from the upper left corner of the map, screen points.
const NORTH: Vec2 = Vec2::splat(45.0);
/// Width that a note at the top has at least beside the scale bar, and its distance from it, screen points.
const LEAST_NOTE: f32 = 160.0;
const BESIDE: f32 = 4.0;

impl Map {
    /// Paints a grid as a textured quadrilateral. Of a grid that lies over another one, cells without a cost show what is
    /// below.
    #[expect(clippy::too_many_arguments, reason = "what a layer is and where it goes")]
    pub(super) fn paint_grid(
        &mut self,
        ui: &Ui,
        frame: &Frame,
        layer: &Layer<'_>,
        grid: &AnyMessage,
        map: &str,
        viewport: Viewport,
        canvas: Rect,
        is_over: bool,
    ) {
        let state = self.state(layer);
        let Ok(cells) = Cells::new(grid) else { return };
        let Some(shade) = cells.shade(state.shade.as_deref()) else { return };
        let weights = self.edited_weights(layer).filter(|_| shade.is_fused());
        // What edited weights take away would look as before, if the map below were seen there.
        let shows_below = is_over && weights.is_none() && cells.is_cost(&shade);
        let look = GridLook { shade, palette: self.saved.palette, weights, shows_below };
        let Some(picture) = GridPicture::of(ui.ctx(), layer, look) else { return };
        self.ranges.extend(picture.range.map(|range| (layer.name.clone(), range)));
        let Some(corners) = picture.corners(frame, map) else { return };
        if !corners.iter().all(|p| is_place(&p.to_array())) {
            return;
        }
        let corners = corners.map(|p| viewport.to_screen(canvas, [p.x, p.y]));
        let painter = ui.painter_at(canvas);
        painter.add(quadrilateral(picture.texture(ui.ctx()), corners, state.opacity));
        if layer.is_stale(frame.now) {
            let tokens = tokens(ui);
            let cover = tokens.surface[2].gamma_multiply(0.5);
            painter.add(Shape::convex_polygon(corners.to_vec(), cover, Stroke::NONE));
            hatch(&painter, &corners, tokens.stale.gamma_multiply(0.7));
        }
    }

    /// Paints a cloud as pixels of the canvas; `id` is that of the canvas.
    #[expect(clippy::too_many_arguments, reason = "what a layer is and where it goes")]
    pub(super) fn paint_cloud(
        &self,
        ui: &Ui,
        layer: &Layer<'_>,
        map: &str,
        map_from_cloud_frame: Pose,
        viewport: Viewport,
        canvas: Rect,
        id: Id,
    ) {
        let LayerState { opacity, cloud: look, .. } = self.state(layer);
        let Some(cloud) = picture::cloud(ui.ctx(), layer, map, map_from_cloud_frame, &look) else { return };
        let painted = (cloud, look.side());
        let picture = CloudPicture::of(ui.ctx(), layer, painted, id, viewport, canvas.size());
        let Some(picture) = picture else { return };
        let corners = picture.corners(viewport, canvas);
        let shape = quadrilateral(picture.texture(ui.ctx()), corners, opacity);
        ui.painter_at(canvas).add(shape);
    }

    /// Paints a track: past in full colour, future thin and weak. Fixes of a satellite receiver are dots, because a line
    /// through them would look like a way that was driven. Of the run from which this one branched, only what differs is
    /// painted, with its name. Returns the mark of the current position, which is hollow if that is outdated.
    #[expect(clippy::too_many_arguments, reason = "what a layer is and where it goes")]
    pub(super) fn paint_track(
        &self,
        ui: &Ui,
        layer: &Layer<'_>,
        frame: &Frame,
        viewport: Viewport,
        canvas: Rect,
        color: Color32,
        labels: &mut Labels,
    ) -> Option<Mark> {
        let Kind::Track { track, is_ghost } = layer.kind else { return None };
        let plane = self.tracks.placed.get(&layer.name).and_then(PlacedTrack::plane)?;
        let (painter, tokens) = (ui.painter_at(canvas), tokens(ui));
        let color = color.gamma_multiply(self.state(layer).opacity);
        let draw = |range: Range<usize>, end: Option<[f64; 2]>, stroke: Stroke| {
            let points = line(&track.points, range, &plane, viewport, canvas).into_iter().chain(end);
            if track.origin.is_some() {
                let places = points.map(|point| viewport.to_screen(canvas, point));
                let dot = |at: Pos2| Shape::circle_filled(at, stroke.width * DOT, stroke.color);
                painter.extend(places.filter(|at| canvas.contains(*at)).map(dot));
                return;
            }
            let parts = clip::line(points, viewport, canvas);
            painter.extend(parts.into_iter().map(|part| Shape::line(part, stroke)));
        };
        let weak = Stroke::new(1.0, color.gamma_multiply(0.4));
        if is_ghost {
            let current = frame.runs.all.iter().find(|run| run.id == frame.runs.current());
            let branch =
                current.and_then(|run| run.branched_from).map_or(0, |(_, at)| track.points.count_until(at));
            let differs = branch.saturating_sub(1)..track.points.len();
            draw(differs.clone(), None, Stroke::new(GHOST_EDGE, tokens.canvas()));
            draw(differs, None, Stroke::new(1.5, color));
            if let (RunTag::Run(run), Some(last)) = (track.run, track.points.last()) {
                labels.add(viewport.to_screen(canvas, plane.point(last.position_m)), run.to_string(), color);
            }
            return None;
        }
        let now = track.points.count_until(frame.now);
        let here = self.tracks.here(frame, layer);
        draw(now.saturating_sub(1)..track.points.len(), None, weak);
        draw(0..now, here.map(|[x, y, _]| [x, y]), Stroke::new(2.0, color));
        let [x, y, yaw] = here?;
        let at = viewport.to_screen(canvas, [x, y]);
        labels.keep_free_for_vehicle(at);
        let placed = self.tracks.placed.get(&layer.name).and_then(|placed| placed.map_from_track);
        if let (Some(covariance), Some(pose)) = (Covariance::of(layer), placed) {
            uncertainty::paint(&painter, &covariance, [x, y], &pose, viewport, canvas, color);
        }
        let is_current = !layer.is_stale(frame.now);
        let color = if is_current { color } else { tokens.stale };
        Some(Mark { at, forward: viewport.direction(yaw), color, is_current })
    }

    pub(super) fn measure(&mut self, response: &Response, viewport: Viewport, canvas: Rect) {
        if !self.measuring {
            return;
        }
        let Some(at) = response.interact_pointer_pos().map(|at| viewport.to_plane(canvas, at)) else {
            return;
        };
        if response.drag_started() || self.measured.is_none() {
            self.measured = Some([at, at]);
        } else if let Some(measured) = self.measured.as_mut().filter(|_| response.dragged()) {
            measured[1] = at;
        }
    }

    pub(super) fn paint_measured(&self, ui: &Ui, viewport: Viewport, canvas: Rect, labels: &mut Labels) {
        let Some([from, to]) = self.measured else { return };
        let tokens = tokens(ui);
        let painter = ui.painter_at(canvas);
        let ends = [from, to].map(|p| viewport.to_screen(canvas, p));
        painter.line_segment(ends, Stroke::new(4.0, tokens.canvas()));
        painter.line_segment(ends, Stroke::new(1.5, tokens.accent));
        for end in ends {
            painter.circle(end, 3.0, tokens.accent, Stroke::new(1.0, tokens.canvas()));
        }
        let (east, north) = (to[0] - from[0], to[1] - from[1]);
        let bearing = (90.0 - north.atan2(east).to_degrees()).rem_euclid(360.0);
        let text = format!("{}  {bearing:05.1}°", format::metres(east.hypot(north), 2));
        labels.add_towards(ends[1], Vec2::RIGHT, text, FontId::monospace(12.0), tokens.strong);
    }
}

/// Where the right end of the scale bar is.
pub(super) fn scale_bar_at(canvas: Rect) -> Pos2 {
    canvas.right_top() + Vec2::new(-12.0, 36.0)
}

/// A note at the top of the canvas, between the arrow to the north and the scale bar; below them where these leave little
/// room. Returns its plate.
pub(super) fn badge(ui: &Ui, canvas: Rect, scale_bar: Rect, icon: ocu_ui::Icon, text: &str) -> Rect {
    let (tokens, painter) = (tokens(ui), ui.painter_at(canvas));
    let (north, margin) = (canvas.min + NORTH, Vec2::new(6.0, 2.0));
    let between = Rect::from_min_max(
        Pos2::new(north.x + BESIDE, canvas.top() + 18.0),
        Pos2::new(scale_bar.left() - BESIDE, canvas.bottom()),
    );
    let below_corners = Pos2::new(canvas.left(), north.y.max(scale_bar.bottom()));
    let below = Rect::from_min_max(below_corners, canvas.max).shrink(BESIDE);
    let place = if between.width() >= LEAST_NOTE { between } else { below };
    let place = place.shrink2(margin);
    let text = format!("{}  {text}", icon.codepoint);
    let galley = painter.layout(text, FontId::proportional(12.0), tokens.warning, place.width().max(1.0));
    let centered = canvas.center().x - galley.size().x / 2.0;
    let left = centered.min(place.right() - galley.size().x).max(place.left());
    let at = Pos2::new(left, place.top());
    let plate = Rect::from_min_size(at, galley.size()).expand2(margin);
    painter.rect_filled(plate, 2.0, tokens.surface[3].gamma_multiply(0.92));
    painter.galley(at, galley, tokens.warning);
    plate
}

/// A planned path.
pub(super) fn path(
    painter: &Painter,
    path: &PosesInFrame,
    map_from_path: &Pose,
    viewport: Viewport,
    canvas: Rect,
    color: Color32,
) {
    let line = clip::line(path_points(path, map_from_path), viewport, canvas);
    painter.extend(clip::dashed(&line, Stroke::new(2.0, color), color));
}

/// A set of poses.
pub(super) fn poses(
    painter: &Painter,
    set: &PosesInFrame,
    map_from_set: &Pose,
    viewport: Viewport,
    canvas: Rect,
    color: Color32,
) {
    let length_m = pose::ARROW_M.max(LEAST_ARROW / viewport.scale);
    let visible = canvas.expand((length_m * viewport.scale) as f32);
    let screen = |p: DVec3| viewport.to_screen(canvas, [p.x, p.y]);
    for pose in pose::drawn(set).map(|pose| *map_from_set * pose) {
        if visible.contains(screen(pose.translation)) {
            for ends in pose::arrow(&pose, length_m) {
                painter.line_segment(ends.map(screen), Stroke::new(1.0, color));
            }
        }
    }
}

/// Points of a path on the map.
pub(super) fn path_points<'a>(
    path: &'a PosesInFrame,
    map_from_path: &'a Pose,
) -> impl Iterator<Item = [f64; 2]> + 'a {
    path.poses.iter().filter_map(|pose| {
        let p = *map_from_path * pose::from_message(Some(pose)).ok()?.translation;
        Some([p.x, p.y])
    })
}

/// Places along a path, in its own frame.
pub(super) fn path_places(path: &PosesInFrame) -> Vec<DVec3> {
    let place = |pose| Some(pose::from_message(Some(pose)).ok()?.translation);
    path.poses.iter().filter_map(place).collect()
}

/// A picture between four points of the screen, which belong to its upper left, upper right, lower right and lower left
/// corner.
fn quadrilateral(texture: TextureId, corners: [Pos2; 4], opacity: f32) -> Shape {
    let color = Color32::WHITE.gamma_multiply(opacity);
    let uv = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Pos2::from);
    let mut mesh = Mesh::with_texture(texture);
    mesh.vertices = corners.into_iter().zip(uv).map(|(pos, uv)| Vertex { pos, uv, color }).collect();
    mesh.indices = vec![0, 1, 2, 0, 2, 3];
    Shape::mesh(mesh)
}

/// The mark of a vehicle: an arrow at its position, in the direction of travel; a disc where that is unknown.
pub(super) struct Mark {
    at: Pos2,
    /// Direction of travel on the screen.
    forward: Vec2,
    color: Color32,
    /// Whether the position is current; otherwise the mark is hollow.
    is_current: bool,
}

impl Mark {
    /// Paints it. It comes after the discs of goals: a vehicle that stands on a goal is seen.
    pub(super) fn paint(&self, painter: &Painter) {
        let Self { at, forward, color, is_current } = *self;
        let fill = if is_current { color } else { Color32::TRANSPARENT };
        let edge = Stroke::new(1.5, if is_current { Color32::from_black_alpha(200) } else { color });
        if !forward.is_finite() {
            painter.circle(at, 5.0, fill, edge);
            return;
        }
        let left = forward.rot90() * 5.5;
        let (nose, tail) = (at + forward * 11.0, at - forward * 7.0);
        // Two triangles, because an arrowhead with a notch is not convex.
        let notch = at - forward * 3.0;
        painter.add(Shape::convex_polygon(vec![nose, tail + left, notch], fill, Stroke::NONE));
        painter.add(Shape::convex_polygon(vec![nose, notch, tail - left], fill, Stroke::NONE));
        painter.add(Shape::closed_line(vec![nose, tail + left, notch, tail - left], edge));
    }
}

/// The number of a grid line, where that meets the left or the upper edge.
pub(super) struct MetreNumber {
    at: Pos2,
    align: Align2,
    text: String,
}

/// The mark of a robot that is known by its transforms alone.
pub(super) fn robot(ui: &Ui, robot: Robot, viewport: Viewport, canvas: Rect, labels: &mut Labels) -> Mark {
    let (tokens, [x, y, yaw_rad]) = (tokens(ui), robot.place);
    let at = viewport.to_screen(canvas, [x, y]);
    labels.keep_free_for_vehicle(at);
    let color = if robot.is_current { tokens.accent } else { tokens.stale };
    Mark { at, forward: viewport.direction(yaw_rad), color, is_current: robot.is_current }
}

/// Grid lines at round metres. Returns their numbers, which lie above everything else ([`metre_numbers`]); on a turned map,
/// they say of which axis they are.
pub(super) fn metre_lines(ui: &Ui, viewport: Viewport, canvas: Rect) -> Vec<MetreNumber> {
    let tokens = tokens(ui);
    let painter = ui.painter_at(canvas);
    let step = round_step(96.0 / viewport.scale);
    let decimals = decimals(step);
    let (min, max) = viewport.bounds(canvas);
    let is_turned = viewport.turned_rad != 0.0;
    let mut numbers = Vec::new();
    for (axis, name) in ["x", "y"].into_iter().enumerate() {
        let first = (min[axis] / step).ceil() as i64;
        for i in first..=((max[axis] / step).floor() as i64).min(first.saturating_add(200)) {
            let value = i as f64 * step;
            let ends = [min, max].map(|end| {
                let at = if axis == 0 { [value, end[1]] } else { [end[0], value] };
                let at = viewport.to_screen(canvas, at);
                // Upright lines lie on pixels.
                if is_turned { at } else { at.round() }
            });
            let color = tokens.weak.gamma_multiply(if i == 0 { 0.5 } else { 0.18 });
            painter.line_segment(ends, Stroke::new(1.0, color));
            let number = format!("{value:.decimals$}");
            let text = if is_turned { format!("{name} {number}") } else { number };
            let [from, way] = [ends[0], (ends[1] - ends[0]).to_pos2()];
            // A line meets the upper edge if it is steep, else the left one.
            let (at, align) = if way.y.abs() > way.x.abs() {
                let x = from.x + way.x * (canvas.top() - from.y) / way.y;
                (Pos2::new(x + 3.0, canvas.top() + 2.0), Align2::LEFT_TOP)
            } else {
                let y = from.y + way.y * (canvas.left() - from.x) / way.x;
                (Pos2::new(canvas.left() + 3.0, y - 1.0), Align2::LEFT_BOTTOM)
            };
            numbers.push(MetreNumber { at, align, text });
        }
    }
    numbers
}

/// The numbers of the grid lines, each on a ground of the canvas's colour, so that they are read over clouds and tracks.
/// One for which there is no room below the upper edge is left out.
pub(super) fn metre_numbers(ui: &Ui, canvas: Rect, numbers: Vec<MetreNumber>) {
    let tokens = tokens(ui);
    let painter = ui.painter_at(canvas);
    for MetreNumber { at, align, text } in numbers {
        let galley = painter.layout_no_wrap(text, FontId::monospace(10.0), tokens.text);
        let place = align.anchor_size(at, galley.size());
        // The bar above would cut it in half.
        if place.top() < canvas.top() {
            continue;
        }
        painter.rect_filled(place.expand2(Vec2::new(2.0, 0.0)), 2.0, tokens.canvas().gamma_multiply(0.8));
        painter.galley(place.min, galley, tokens.text);
    }
}

/// The direction of north, or of the y axis of a frame that is not north-aligned.
pub(super) fn north(ui: &Ui, at: Pos2, viewport: Viewport, is_north: bool) {
    let tokens = tokens(ui);
    let painter = ui.painter();
    let at = at + Vec2::new(12.0, 8.0);
    painter.circle_filled(at, 13.0, tokens.surface[3].gamma_multiply(0.92));
    let way = viewport.direction(FRAC_PI_2);
    let right = way.rot90();
    let head = vec![at + way * 10.0, at + way * 3.0 + right * 4.0, at + way * 3.0 - right * 4.0];
    painter.add(Shape::convex_polygon(head, tokens.text, Stroke::NONE));
    let letter = if is_north { "N" } else { "y" };
    let font = FontId::proportional(11.0);
    painter.text(at - way * 4.0, Align2::CENTER_CENTER, letter, font, tokens.strong);
}

#[cfg(test)]
mod tests {
    use super::*;
    use ocu_ui::{icons, legend};

    #[test]
    fn a_note_at_the_top_lies_in_the_map_and_leaves_the_scale_bar_free() {
        for (width, points_per_m) in [(150.0, 6.5), (430.0, 6.5), (430.0, 12.5), (900.0, 12.5)] {
            let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::new(width, 300.0));
            let output = egui::Context::default().run_ui(egui::RawInput::default(), |ui| {
                let scale_bar = legend::scale_bar_place(ui, scale_bar_at(canvas), points_per_m);
                let text = "preview of /wm1/map: edited weights, not sent";
                let plate = badge(ui, canvas, scale_bar, icons::ICON_TUNE, text);
                assert!(canvas.contains_rect(plate) && !plate.intersects(scale_bar), "{plate} {scale_bar}");
            });
            output.drop_without_applying_deltas();
        }
    }

    #[test]
    fn a_number_that_would_reach_above_the_map_is_left_out() {
        let canvas = Rect::from_min_size(Pos2::new(0.0, 40.0), Vec2::splat(300.0));
        // The line of y = 1 m lies 5 points below the upper edge.
        let viewport = Viewport { center: [0.0, -0.45], scale: 100.0, y_up: true, turned_rad: 0.0 };
        let output = egui::Context::default().run_ui(egui::RawInput::default(), |ui| {
            let numbers = metre_lines(ui, viewport, canvas);
            metre_numbers(ui, canvas, numbers);
        });
        let mut texts = Vec::new();
        for clipped in &output.shapes {
            let Shape::Text(text) = &clipped.shape else { continue };
            assert!(text.pos.y >= canvas.top(), "{:?}", text.galley.text());
            texts.push(text.galley.text().to_owned());
        }
        texts.sort_unstable();
        assert_eq!(texts, ["-1", "-1", "0", "0", "1"]);
        output.drop_without_applying_deltas();
    }

    #[test]
    fn every_number_of_the_metre_lines_has_a_ground_below_it_and_the_digits_of_the_step() {
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(300.0));
        let (min, max) = ([308_200.0, 4_332_100.0], [308_201.5, 4_332_101.5]);
        let viewport = Viewport::fit(min, max, canvas, 0.0, true);
        let ctx = egui::Context::default();
        let output = ctx.run_ui(egui::RawInput::default(), |ui| {
            let numbers = metre_lines(ui, viewport, canvas);
            metre_numbers(ui, canvas, numbers);
        });
        let (mut grounds, mut texts) = (Vec::new(), Vec::new());
        for clipped in &output.shapes {
            match &clipped.shape {
                Shape::Rect(ground) if ground.rect.width() < 100.0 => grounds.push(ground.rect),
                Shape::Text(text) => {
                    let middle = clipped.shape.visual_bounding_rect().center();
                    assert!(grounds.iter().any(|ground| ground.contains(middle)), "{:?}", text.galley.text());
                    texts.push(text.galley.text().to_owned());
                }
                _ => {}
            }
        }
        for number in ["308200.5", "308201.0", "4332100.5", "4332101.0"] {
            assert!(texts.iter().any(|text| text == number), "{number}: {texts:?}");
        }
        output.drop_without_applying_deltas();
    }
}
