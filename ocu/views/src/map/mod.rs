//! Map view: grids, clouds, entities of scenes, paths and tracks from above; up is north, or where the vehicle heads.
//!
//! Everything is drawn in one frame, using the transforms of the log or the run. Layers without a transform are listed
//! with that reason; a track can be aligned with another one by its first metres, and is marked as such. Ground truth
//! is drawn on top, half transparent, and is off until it is switched on.

mod badges;
mod cell;
mod cloud;
pub(crate) mod draft;
mod entities;
pub(crate) mod example;
mod for_camera;
mod for_scene;
mod goals;
mod grid;
mod hover;
mod labels;
mod layers;
mod mission;
mod outline;
mod paint;
mod panel;
mod picture;
mod plan;
mod preview;
mod robot;
mod saved;
mod shared_draft;
mod toolbar;
mod topics;
mod track;
mod training;
mod uncertainty;
mod undrawn;

use crate::canvas::Viewport;
use crate::clip::is_place;
use crate::view::{Draws, Preview, SavedState, View, ViewContext};
use egui::{Context, Pos2, Rect, Response, Role, Sense, Ui, Vec2, WidgetInfo};
use entities::OnMap;
pub(crate) use for_camera::{Floor, Ground, OnGround};
pub(crate) use for_scene::{CellColors, Placed, Thing, frames, loose_frames, placed};
use grid::Extent;
use labels::Labels;
use layers::{Kind, Layer, Tracks};
use ocu_ui::legend::{self, round_step};
use ocu_ui::{icons, tokens, widgets};
use preview::Edited;
use rcs_geom::Pose;
use rcs_msg::Stamp;
use rcs_runtime::source::{Frame, SourceKind, Topic, WGS84};
use rcs_world::Weights;
use robot::Robot;
use saved::{LayerState, Saved};
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
pub(crate) use topics::{frame_for, in_scene};

/// Least width and height that the map of a run shows until a person zooms, m.
const LEAST_OF_A_RUN_M: f64 = 20.0;

/// The map view.
#[derive(Default)]
pub(crate) struct Map {
    saved: Saved,
    /// End points of the measuring line, in the map's frame.
    measured: Option<[[f64; 2]; 2]>,
    measuring: bool,
    /// The layer that is to fill the canvas.
    zoom_to: Option<String>,
    /// A mission that is being drawn, during a pass: it belongs to the source ([`crate::view::Drafts`]).
    draft: Option<draft::Draft>,
    /// The mission that was closed last, if it had changes that were not sent or is on its way; also during a pass.
    closed: Option<draft::Draft>,
    /// Whether a point of it is being dragged on this map.
    drags: bool,
    /// An example for learning that is being drawn, as the mission.
    example: Option<example::Example>,
    /// The place of the legend in the previous pass.
    legend: Option<Rect>,
    /// The place whose cell stays in the read-out, in the map's frame.
    kept: Option<[f64; 2]>,
    /// Where its read-out was in the previous pass.
    kept_plate: Option<Rect>,
    /// The layer that its read-out led to.
    led: Option<hover::Led>,
    /// Size of the read-out in the previous pass.
    read_out_size: Vec2,
    /// Angle by which the map was turned in the previous pass, rad.
    turned_rad: f64,
    /// Where the menu was opened, in the map's frame.
    menu_at: Option<[f64; 2]>,
    tracks: Tracks,
    /// The visible entities in this pass, by layer.
    entities: BTreeMap<String, OnMap>,
    /// Title and start of the source to which the viewport belongs.
    looked_at: Option<(String, Stamp)>,
    /// Middle of the surroundings of the robot that were shown last, in the map's frame.
    around: Option<[f64; 2]>,
    /// Map frame in the previous pass.
    frame_id: String,
    /// Whether the layers in the previous pass contained a fused map.
    fused: bool,
    /// Parameters that count in no map yet.
    preview: Option<Edited>,
    /// The values at the ends of the colour scales of grids in this pass, by layer.
    ranges: BTreeMap<String, [f64; 2]>,
}

impl View for Map {
    fn title(&self, _frame: &Frame) -> String {
        "Map".to_owned()
    }

    fn accepts(&self, topic: &Topic) -> bool {
        const TYPES: [&str; 7] =
            ["Grid", "PointCloud", "PosesInFrame", "SceneUpdate", "Odometry", "PoseInFrame", "LocationFix"];
        let is_ours = matches!(topic.type_name(), "rcs.Plan" | "rcs.ArcChoice" | "rcs.Mission");
        is_ours || topic.type_name().strip_prefix("foxglove.").is_some_and(|name| TYPES.contains(&name))
    }

    fn draws(&self, frame: &Frame, topic: &Topic) -> Draws {
        if self.accepts(topic) { topics::on_map(self, frame, topic) } else { Draws::Never }
    }

    fn open_for(&mut self, frame: &Frame, topic: &Topic) {
        self.drop_topic(topic);
        if self.draws(frame, topic) == Draws::Never {
            self.saved.frame = frame_for(frame, topic);
        }
    }

    fn drop_topic(&mut self, topic: &Topic) {
        // Beside a computed topic of the same name, a layer that was recorded has a name of its own.
        let recorded = topic.run.is_recorded().then(|| crate::toolbar::recorded_label(&topic.name));
        for name in recorded.into_iter().chain([topic.name.to_string()]) {
            self.saved.layers.entry(name).or_default().shown = true;
        }
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let layers = layers::layers(cx.frame);
        let frames = layers::frames(cx.frame, &layers);
        let Some(map) = layers::map_frame(cx.frame, &layers, self.saved.frame.as_deref()) else {
            let hint =
                "Tracks, maps, clouds, paths or markers would fill it: play on, or open a log that has some.";
            let hint = undrawn::with_hint(hint, ui.ctx(), cx.frame);
            return widgets::empty(ui, icons::ICON_MAP, "Nothing to draw on a map", &hint);
        };
        self.look_in(map);
        self.end_led(cx.frame.now);
        self.take_example(cx, map);
        self.take_draft(ui, cx, map);
        self.fused = layers.iter().any(Layer::is_map);
        self.follow_preview(cx.selection.preview.get().filter(|preview| preview::holds(preview, cx.frame)));
        self.tracks.update(cx.frame, map, &layers, self.saved.align);
        let visible = layers.iter().filter(|layer| self.state(layer).shown);
        let on_map =
            |layer: &Layer<'_>| Some((layer.name.clone(), OnMap::of(ui.ctx(), cx.frame, map, layer)?));
        self.entities = visible.filter_map(on_map).collect();
        let roomy = ui.available_width() >= 560.0;
        self.toolbar(ui, cx.frame, map, &frames, roomy);
        let area = ui.available_rect_before_wrap();
        let listed = self.saved.panel.unwrap_or(roomy);
        let panel_width = if listed { 216.0_f32.min(area.width() * 0.6).floor() } else { 0.0 };
        let canvas = Rect::from_min_max(area.min, Pos2::new(area.right() - panel_width, area.bottom()));
        if panel_width > 0.0 {
            let panel = Rect::from_min_max(Pos2::new(canvas.right(), area.top()), area.max);
            self.panel(ui, cx.frame, map, &layers, panel);
        }
        self.canvas(ui, cx, map, &layers, canvas, panel_width > 0.0);
        self.give_example_back(cx, map);
        self.give_draft_back(cx, map);
        ui.advance_cursor_after_rect(area);
    }
}

impl Map {
    /// Takes over the frame of the map. What was measured has positions in the frame before, and is dropped.
    fn look_in(&mut self, map: &str) {
        if self.frame_id != map && !self.frame_id.is_empty() {
            (self.measured, self.kept, self.around) = (None, None, None);
        }
        map.clone_into(&mut self.frame_id);
    }

    /// Takes the parameters that are being edited, or were sent, if they changed.
    fn follow_preview(&mut self, preview: Option<&Preview>) {
        if self.preview.as_ref().map(|edited| &edited.preview) != preview {
            self.preview = preview.map(Edited::of);
        }
    }

    /// The weights with which a layer is shown instead of those with which it was fused.
    fn edited_weights(&self, layer: &Layer<'_>) -> Option<Weights> {
        self.preview.as_ref()?.weights_for(layer)
    }

    /// Visible layers from bottom to top: a map with edited weights lies above the other grids, so that their effect is
    /// seen.
    fn by_preview<'a, 'b>(&self, shown: &[&'a Layer<'b>]) -> Vec<&'a Layer<'b>> {
        let mut layers = shown.to_vec();
        layers.sort_by_key(|layer| {
            let is_grid = matches!(layer.kind, Kind::Grid(_));
            (layer.is_ground_truth(), !is_grid, self.edited_weights(layer).is_some())
        });
        layers
    }

    /// Settings of a layer. Initially ground truth is off, and so are the sources of a fused map, and what was recorded of
    /// a topic that the run computes. The track of an earlier run is shown where that of the viewed run is.
    fn state(&self, layer: &Layer<'_>) -> LayerState {
        let is_part = self.fused && layer.is_part_of_a_map();
        let shown = !(layer.is_ground_truth() || layer.is_twin || is_part);
        let opacity = if layer.is_ground_truth() && matches!(layer.kind, Kind::Grid(_)) { 0.5 } else { 1.0 };
        let usual = LayerState { shown, opacity, ..LayerState::default() };
        let own = self.saved.layers.get(&layer.name);
        let of_topic = match &layer.kind {
            Kind::Track { track, .. } => self.saved.layers.get(&*track.topic),
            _ => None,
        };
        let mut state = own.or(of_topic).cloned().unwrap_or(usual);
        state.shown |= self.led.as_ref().is_some_and(|led| led.layer == layer.name);
        state
    }

    fn canvas(
        &mut self,
        ui: &mut Ui,
        cx: &mut ViewContext<'_>,
        map: &str,
        layers: &[Layer<'_>],
        canvas: Rect,
        listed: bool,
    ) {
        let response = ui.interact(canvas, ui.scope_id().with("map canvas"), Sense::click_and_drag());
        response.widget_info(|| WidgetInfo::labeled(Role::Image, true, "Map"));
        ui.painter().rect_filled(canvas, 0.0, tokens(ui).canvas());
        let shown: Vec<_> = layers.iter().filter(|layer| self.state(layer).shown).collect();
        let (robot, vehicle) = Robot::beside(cx.frame, map, &self.places(cx.frame, &shown));
        let viewport = self.look(ui, cx.frame, map, &shown, vehicle, &response);
        self.measure(&response, viewport, canvas);

        let painter = ui.painter_at(canvas);
        let place = |layer: &Layer<'_>| layers::map_from_layer(cx.frame, map, layer);
        let mut is_over = false;
        self.ranges.clear();
        for layer in self.by_preview(&shown) {
            match (layer.kind, place(layer)) {
                (Kind::Grid(grid), Ok(_)) => {
                    self.paint_grid(ui, cx.frame, layer, grid, map, viewport, canvas, is_over);
                    is_over = true;
                }
                (Kind::Cloud, Ok(pose)) => {
                    self.paint_cloud(ui, layer, map, pose, viewport, canvas, response.id);
                }
                _ => {}
            }
        }
        let numbers = paint::metre_lines(ui, viewport, canvas);
        let mut labels = self.labels(canvas);
        let mut goals = goals::of(cx.frame, map, &shown);
        let (mut missions, mut marks) = (Vec::new(), Vec::new());
        for (index, layer) in layers.iter().enumerate().filter(|(_, layer)| self.state(layer).shown) {
            let is_old = layer.is_of_one_time() && layer.is_stale(cx.frame.now);
            let color =
                if is_old { tokens(ui).stale } else { tokens(ui).series(panel::series(layers, index)) };
            match (layer.kind, place(layer)) {
                (Kind::Entities(_), _) => {
                    self.flat(layer).iter().for_each(|it| it.paint(&painter, viewport, canvas, &mut labels));
                }
                (Kind::Path(path), Ok(pose)) => paint::path(&painter, path, &pose, viewport, canvas, color),
                (Kind::Poses(set), Ok(pose)) => paint::poses(&painter, set, &pose, viewport, canvas, color),
                (Kind::Plan(plan), Ok(map_from_layer)) => {
                    let at = plan::At { map_from_layer, viewport, canvas };
                    plan::paths(&painter, plan, at, tokens(ui), color, is_old, &mut labels);
                }
                (Kind::Arcs(choice), Ok(map_from_layer)) => {
                    let meant = plan::meant(layer, cx.selection.hovered.get());
                    let at = plan::At { map_from_layer, viewport, canvas };
                    plan::arcs(&painter, choice, at, tokens(ui), meant, is_old);
                }
                (Kind::Mission(mission), Ok(map_from_layer)) => {
                    let at = plan::At { map_from_layer, viewport, canvas };
                    mission::paint_obeyed(&painter, mission, self.draft.as_ref(), at, tokens(ui));
                    missions.push((mission, at));
                }
                (Kind::Track { .. }, _) => {
                    let mark = self.paint_track(ui, layer, cx.frame, viewport, canvas, color, &mut labels);
                    marks.extend(mark);
                }
                // All at once, because several may be one.
                (Kind::Goal(_), Ok(_)) => {
                    let goals = std::mem::take(&mut goals);
                    goals::paint(ui, &goals, vehicle, viewport, canvas, &mut labels);
                }
                _ => {}
            }
        }
        marks.extend(robot.map(|robot| paint::robot(ui, robot, viewport, canvas, &mut labels)));
        // Numbers are read above flags and tracks. The goals of a draft take the place of those that are obeyed.
        for (mission, at) in missions.into_iter().filter(|_| self.draft.is_none()) {
            mission::paint_goals(&painter, mission, at, tokens(ui), &mut labels);
        }
        let at = plan::At { map_from_layer: Pose::IDENTITY, viewport, canvas };
        self.draw_mission(ui, cx, map, &response, at, &mut labels);
        for mark in &marks {
            mark.paint(&painter);
        }
        paint::metre_numbers(ui, canvas, numbers);
        let preview_down = self.badges(ui, cx.frame, map, &shown, viewport, canvas);
        self.paint_measured(ui, viewport, canvas, &mut labels);
        self.command_mission(ui, cx, map, &response, at, vehicle);
        self.draw_example(ui, cx, map, &response, at);
        // The numbers of the metre lines are at the left and at the top.
        let free = Rect::from_min_max(canvas.min + Vec2::new(32.0, 16.0), canvas.max - Vec2::splat(4.0));
        labels.paint(&painter, free, tokens(ui));
        self.point_at(ui, cx, map, &shown, &response, viewport);
        self.offer_undo(ui, cx, map, canvas);
        legend::scale_bar(ui, paint::scale_bar_at(canvas), viewport.scale);
        paint::north(ui, canvas.left_top() + Vec2::new(20.0, 24.0), viewport, map == WGS84);
        // In a narrow map the read-out takes the place of the legend, and in a low one it would hide too much.
        let reads_out = response.hovered() || self.kept.is_some();
        let has_legend = canvas.height() >= 200.0 && (canvas.width() >= 560.0 || !reads_out);
        self.legend =
            if has_legend { self.legend(ui, cx.frame, layers, &shown, canvas, listed) } else { None };
        let pointer = response.hover_pos().filter(|_| !response.context_menu_opened());
        let pointer = pointer.map(|at| viewport.to_plane(canvas, at));
        self.read_out(ui, cx, map, &shown, pointer, viewport, canvas, preview_down);
    }

    /// Where the map looks in this pass: at what was chosen or at everything, after the vehicle, turned and moved.
    fn look(
        &mut self,
        ui: &Ui,
        frame: &Frame,
        map: &str,
        shown: &[&Layer<'_>],
        vehicle: Option<[f64; 3]>,
        response: &Response,
    ) -> Viewport {
        let canvas = response.rect;
        self.check_viewport(ui.ctx(), frame, map, shown, canvas);
        if let Some(name) = self.zoom_to.take() {
            let alone: Vec<_> = shown.iter().copied().filter(|layer| layer.name == name).collect();
            self.saved.viewport = Some(self.fitted(ui.ctx(), frame, map, &alone, canvas));
            self.saved.follows = false;
        }
        let mut viewport = match self.saved.viewport {
            Some(viewport) => viewport,
            None => self.fitted(ui.ctx(), frame, map, shown, canvas),
        };
        let here = if self.saved.follows { vehicle } else { None };
        if let Some([x, y, _]) = here {
            viewport.center = [x, y];
        }
        // While the heading is unknown, the map stays as it is.
        let heading_rad = vehicle.map(|[_, _, yaw]| yaw).filter(|yaw| yaw.is_finite());
        self.turned_rad = match (self.saved.vehicle_up, heading_rad) {
            (true, Some(heading_rad)) => FRAC_PI_2 - heading_rad,
            (true, None) => self.turned_rad,
            (false, _) => 0.0,
        };
        viewport.turned_rad = self.turned_rad;
        let pans = !self.measuring && !self.drag_draft(response, viewport);
        if viewport.interact(ui, response, [0.01, 5000.0], pans) {
            if pans && response.dragged() {
                // Who drags the map looks elsewhere.
                self.saved.follows = false;
            } else if let Some([x, y, _]) = here {
                viewport.center = [x, y];
            }
            self.saved.viewport = Some(viewport);
        }
        let draws = self.draft.is_some() || self.example.is_some();
        if response.double_clicked() && !draws {
            self.saved.viewport = None;
        }
        viewport
    }

    /// The entities of a layer from above, if it has some and is visible.
    fn flat(&self, layer: &Layer<'_>) -> Option<&entities::Flat> {
        self.entities.get(&layer.name)?.flat.as_deref()
    }

    /// The places on which no text lies: north, the scale, and the legend.
    fn labels(&self, canvas: Rect) -> Labels {
        let mut labels = Labels::default();
        labels
            .keep_free(Rect::from_center_size(canvas.left_top() + Vec2::new(32.0, 32.0), Vec2::splat(28.0)));
        let scale = canvas.right_top() + Vec2::new(-160.0, 0.0);
        labels.keep_free(Rect::from_min_size(scale, Vec2::new(160.0, 40.0)));
        self.legend.into_iter().for_each(|legend| labels.keep_free(legend));
        labels
    }

    /// A stored viewport may be one of another source: where it shows nothing of this one, everything is fitted.
    fn check_viewport(
        &mut self,
        ctx: &Context,
        frame: &Frame,
        map: &str,
        shown: &[&Layer<'_>],
        canvas: Rect,
    ) {
        let source = (frame.info.title.clone(), frame.info.start);
        if self.looked_at.as_ref() == Some(&source) {
            return;
        }
        (self.kept, self.around) = (None, None);
        if let Some(viewport) = self.saved.viewport
            && !(viewport.is_valid() && viewport.meets(self.fitted(ctx, frame, map, shown, canvas), canvas))
        {
            self.saved.viewport = None;
        }
        self.looked_at = Some(source);
    }

    /// Current positions and headings of what the visible tracks belong to, without ground truth, and the ages of their
    /// messages, s: those of the run, then recorded ones.
    fn places(&self, frame: &Frame, shown: &[&Layer<'_>]) -> Vec<([f64; 3], f64)> {
        let mut layers: Vec<_> = shown.iter().filter(|layer| !layer.is_ground_truth()).collect();
        layers.sort_by_key(|layer| layer.is_recorded());
        let place = |layer: &&Layer<'_>| {
            let age_s = layer.topic?.age_s(frame.now)?;
            Some((self.tracks.here(frame, layer)?, age_s))
        };
        layers.into_iter().filter_map(place).collect()
    }

    /// A viewport that shows all layers: of a running stack the smallest of its fused maps, in which the vehicle is. Its
    /// borders are rounded, so that it does not drift while things move.
    fn fitted(
        &mut self,
        ctx: &Context,
        frame: &Frame,
        map: &str,
        shown: &[&Layer<'_>],
        canvas: Rect,
    ) -> Viewport {
        let mut bounds: Option<([f64; 2], [f64; 2])> = None;
        let mut add = |point: [f64; 2]| {
            if !is_place(&point) {
                return;
            }
            let (min, max) = bounds.get_or_insert((point, point));
            for axis in 0..2 {
                min[axis] = min[axis].min(point[axis]);
                max[axis] = max[axis].max(point[axis]);
            }
        };
        let runs = frame.info.kind == SourceKind::Stack;
        let near = if runs { nearest_map(frame, map, shown) } else { None };
        let mut loose = Vec::new();
        for layer in shown.iter().filter(|layer| near.is_none_or(|near| near == layer.name)) {
            let pose = layers::map_from_layer(frame, map, layer);
            match (layer.kind, pose) {
                (Kind::Grid(grid), Ok(pose)) => {
                    let corners = Extent::of(grid).map(|extent| extent.corners).unwrap_or_default();
                    corners.iter().map(|p| pose * *p).for_each(|p| add([p.x, p.y]));
                }
                (Kind::Cloud, Ok(pose)) => {
                    let cloud = picture::cloud(ctx, layer, map, pose, &self.state(layer).cloud);
                    if let Some((min, max)) = cloud.and_then(|cloud| cloud.bounds) {
                        add(min);
                        add(max);
                    }
                }
                (Kind::Entities(_), _) => {
                    if let Some((min, max)) = self.flat(layer).and_then(|flat| flat.bounds) {
                        add(min);
                        add(max);
                    }
                }
                (Kind::Track { .. }, _) => {
                    let Some(track) = self.tracks.placed.get(&layer.name) else { continue };
                    match track.plane().and_then(|plane| track.judged.extent(&plane)) {
                        Some(extent) if track.alignment.is_some() => loose.push(extent),
                        Some((min, max)) => [min, max].into_iter().for_each(&mut add),
                        None => {}
                    }
                }
                _ => {}
            }
        }
        let bounds = bounds.or_else(|| loose.pop());
        let bounds = bounds.unwrap_or_else(|| robot::surroundings(frame, map, &mut self.around));
        // A run begins with a vehicle and nothing else.
        let least = if runs { LEAST_OF_A_RUN_M } else { 2.0 };
        let (mut min, mut max) = track::widened(bounds, &loose, least);
        for axis in 0..2 {
            let missing = (least - (max[axis] - min[axis])).max(0.0);
            (min[axis], max[axis]) = (min[axis] - missing / 2.0, max[axis] + missing / 2.0);
        }
        let size = (max[0] - min[0]).max(max[1] - min[1]);
        let step = round_step(size / 20.0);
        for axis in 0..2 {
            min[axis] = (min[axis] / step).floor() * step;
            max[axis] = (max[axis] / step).ceil() * step;
        }
        Viewport::fit(min, max, canvas, 24.0, true)
    }
}

/// The smallest of the fused maps of a run; if there is none, of its other grids. It lies around the vehicle.
fn nearest_map<'a>(frame: &Frame, map: &str, shown: &[&'a Layer<'_>]) -> Option<&'a str> {
    let area = |layer: &&&Layer<'_>| {
        let Kind::Grid(grid) = layer.kind else { return None };
        if layer.is_ground_truth() || layers::map_from_layer(frame, map, layer).is_err() {
            return None;
        }
        let [a, b, c, _] = Extent::of(grid)?.corners;
        Some((!layer.is_map(), a.distance(b) * b.distance(c)))
    };
    let sized = shown.iter().filter_map(|layer| Some((layer, area(&layer)?)));
    let nearest = sized.min_by(|(_, a), (_, b)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    nearest.map(|(layer, _)| layer.name.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_measured_is_dropped_where_the_frame_of_the_map_changes() {
        let place = Some([1.0, 2.0]);
        let mut map = Map { measured: Some([[0.0; 2]; 2]), kept: place, around: place, ..Map::default() };
        map.look_in("local");
        map.look_in("local");
        assert!(map.measured.is_some() && map.kept.is_some() && map.around.is_some());
        map.look_in("global");
        assert!(map.measured.is_none() && map.kept.is_none() && map.around.is_none());
    }
}
