//! Scene view: clouds, grids with heights, paths, tracks, entities of scenes (such as markers), coordinate frames and the
//! vehicle in three dimensions.
//!
//! It is drawn by a thread of its own through wgpu, offscreen, and shown as a texture, so that it works under either
//! renderer of the window, and its cost is not that of the interface. What is under the pointer is found by the depth of
//! the picture, and said to the other views as a place.

mod camera;
mod gpu;
mod menu;
mod shapes;
mod worker;

use crate::cached::SameMessage;
use crate::cloud_look::CloudLook;
use crate::map::{self, Placed, Thing};
use crate::prepare;
use crate::view::{Draws, Hover, HoverPoint, SavedState, View, ViewContext};
use camera::{Camera, project, unproject};
use egui::{Align2, Color32, FontId, Rect, RichText, Role, Sense, TextureOptions, Ui, Vec2, WidgetInfo};
use ocu_ui::bar::{self, Bar, Choice, Fit, Form};
use ocu_ui::legend::round_step;
use ocu_ui::palette::MapPalette;
use ocu_ui::{format, icons, legend, tokens, widgets};
use rcs_geom::{DVec3, Pose};
use rcs_runtime::source::{Frame, Topic};
use serde::{Deserialize, Serialize};
use shapes::Shapes;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use worker::{Content, Layer, Picture, Request, Worker};

/// How long a pass of `ocu render` or of a test waits for the very first picture. A window never waits.
const FIRST: Duration = Duration::from_millis(120);
/// How long such a pass waits for the next one while time stands still.
const NEXT: Duration = Duration::from_millis(12);
/// Everything is fitted again when it needs this many times the distance: a run begins with little.
const OUTGROWN: f64 = 1.5;
/// Most notes of each kind over the picture; the others are counted.
const MOST_NOTES: usize = 3;
/// Height of the button below the reason why there is no picture, and of the gaps around it, screen points.
const AGAIN: f32 = 36.0;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// Frame of the scene; `None` to select one automatically.
    frame: Option<String>,
    /// Where it is looked at from; `None` to fit everything.
    camera: Option<Camera>,
    /// Whether the camera moves with the vehicle.
    follows: bool,
    /// Whether coordinate frames are shown.
    axes: bool,
    palette: MapPalette,
    /// Layers that were switched by hand, by name.
    layers: BTreeMap<String, bool>,
    /// Looks of clouds that were changed by hand, by name.
    clouds: BTreeMap<String, CloudLook>,
}

impl Default for Saved {
    fn default() -> Self {
        Self {
            frame: None,
            camera: None,
            follows: false,
            axes: true,
            palette: MapPalette::default(),
            layers: BTreeMap::new(),
            clouds: BTreeMap::new(),
        }
    }
}

/// What a picture shows: it is drawn again when this changes.
type Key = (u64, Option<Camera>, [u32; 2], bool, String);

/// The scene view.
#[derive(Default)]
pub(crate) struct Scene {
    saved: Saved,
    worker: Option<Worker>,
    asked: Option<Key>,
    number: u64,
    picture: Option<Picture>,
    texture: Option<egui::TextureHandle>,
    /// Why nothing can be drawn, until a person tries again; there is no worker and no picture then.
    failed: Option<String>,
    /// The camera that fitted everything, which stays until it is asked for again, or much more is there.
    fitted: Option<Camera>,
    /// Pictures up to this number were asked for before everything was to be fitted.
    fit_after: u64,
    /// The vehicle when the camera last followed it.
    followed: Option<DVec3>,
    /// Frame of the scene in the previous pass.
    frame_id: String,
}

impl View for Scene {
    fn title(&self, _frame: &Frame) -> String {
        "Scene".to_owned()
    }

    fn accepts(&self, topic: &Topic) -> bool {
        const TYPES: [&str; 6] =
            ["Grid", "PointCloud", "PosesInFrame", "SceneUpdate", "Odometry", "PoseInFrame"];
        topic.type_name().strip_prefix("foxglove.").is_some_and(|name| TYPES.contains(&name))
    }

    fn draws(&self, frame: &Frame, topic: &Topic) -> Draws {
        if !self.accepts(topic) {
            return Draws::Never;
        }
        map::in_scene(frame, self.saved.frame.as_deref(), &self.saved.layers, topic)
    }

    fn open_for(&mut self, frame: &Frame, topic: &Topic) {
        self.drop_topic(topic);
        if self.draws(frame, topic) == Draws::Never {
            self.saved.frame = map::frame_for(frame, topic);
        }
    }

    fn drop_topic(&mut self, topic: &Topic) {
        self.saved.layers.insert(topic.name.to_string(), true);
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        self.saved.camera = self.saved.camera.filter(Camera::is_valid);
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let Some((scene, placed)) = map::placed(ui.ctx(), cx.frame, self.saved.frame.as_deref()) else {
            let hint =
                "Clouds, maps, poses, paths or markers would fill it: play on, or open a log that has some.";
            return widgets::empty(ui, icons::ICON_VIEW_IN_AR, "Nothing to draw in space", hint);
        };
        if self.frame_id != scene {
            (self.followed, self.asked, self.fitted) = (None, None, None);
            self.frame_id.clone_from(&scene);
        }
        self.toolbar(ui, cx.frame, &scene, &placed);
        let area = ui.available_rect_before_wrap();
        self.canvas(ui, cx, &scene, &placed, area);
        ui.advance_cursor_after_rect(area);
    }
}

impl Scene {
    fn toolbar(&mut self, ui: &mut Ui, frame: &Frame, scene: &str, placed: &[Placed<'_>]) {
        let mut bar: Bar<'_, Self> = Bar::new("toolbar");
        bar.left("frame", Fit::Leaves(60), |ui, form, view| view.frame_choice(ui, form, frame, scene));
        bar.left("layers", Fit::Leaves(50), |ui, form, view| {
            bar::menu(ui, form, icons::ICON_LAYERS, "Layers", |ui| {
                view.layers_menu(ui, placed);
            });
        });
        bar.right("fit", Fit::Leaves(40), |ui, form, view| {
            if bar::tool(ui, form, icons::ICON_FIT_SCREEN, "Fit everything").clicked() {
                view.fit();
            }
        });
        bar.right("follow", Fit::Leaves(30), |ui, form, view| {
            let name = "Follow the vehicle";
            if bar::tool_toggle(ui, form, icons::ICON_MY_LOCATION, name, &mut view.saved.follows).clicked() {
                view.followed = None;
            }
        });
        bar.right("palette", Fit::Leaves(10), |ui, form, view| {
            let mut even = view.saved.palette == MapPalette::Even;
            let name = "Even colours, for colour-blind people";
            if bar::tool_toggle(ui, form, icons::ICON_PALETTE, name, &mut even).clicked() {
                view.saved.palette = if even { MapPalette::Even } else { MapPalette::Papers };
            }
        });
        crate::toolbar::show(ui, bar, self);
    }

    fn frame_choice(&mut self, ui: &mut Ui, form: Form, frame: &Frame, scene: &str) {
        bar::choice(ui, form, Choice::new("Frame of the scene", scene, [72.0, 160.0]), |ui| {
            for name in map::frames(frame) {
                if ui.selectable_label(name == scene, &name).clicked() {
                    self.saved.frame = Some(name);
                    self.fit();
                }
            }
        });
    }

    /// Looks at everything again.
    fn fit(&mut self) {
        (self.saved.camera, self.fitted, self.followed) = (None, None, None);
        self.fit_after = self.number;
    }

    /// Where it is looked at from, once that is known.
    fn camera(&self) -> Option<Camera> {
        self.saved.camera.or(self.fitted)
    }

    fn shows(&self, layer: &Placed<'_>) -> bool {
        self.saved.layers.get(&layer.name).copied().unwrap_or(layer.is_usual)
    }

    fn canvas(
        &mut self,
        ui: &mut Ui,
        cx: &mut ViewContext<'_>,
        scene: &str,
        placed: &[Placed<'_>],
        canvas: Rect,
    ) {
        let response = ui.interact(canvas, ui.scope_id().with("scene canvas"), Sense::click_and_drag());
        response.widget_info(|| WidgetInfo::labeled(Role::Image, true, "Scene"));
        ui.painter().rect_filled(canvas, 0.0, tokens(ui).canvas());
        self.interact(ui, &response, canvas);
        if response.double_clicked() {
            self.fit();
        }
        let shown: Vec<&Placed<'_>> = placed.iter().filter(|layer| self.shows(layer)).collect();
        self.follow(&shown);
        self.draw(ui, cx.frame, scene, &shown, canvas);
        if let Some(reason) = &self.failed {
            if cannot_be_drawn(ui, canvas, reason) {
                self.failed = None;
                ui.ctx().request_repaint();
            }
            return;
        }
        let Some(picture) = &self.picture else { return };
        if let Some(texture) = &self.texture {
            let uv = Rect::from_min_max(egui::Pos2::ZERO, egui::pos2(1.0, 1.0));
            ui.painter_at(canvas).image(texture.id(), canvas, uv, Color32::WHITE);
        }
        let aspect = f64::from(canvas.width() / canvas.height().max(1.0));
        let matrix = picture.camera.clip_from_world(aspect);
        if self.saved.axes {
            frame_names(ui, cx.frame, scene, &matrix, canvas);
        }
        entity_texts(ui, &shown, &matrix, canvas);
        let pointed = response.hover_pos().and_then(|at| {
            let part = (at - canvas.min) / canvas.size();
            let [width, height] = picture.image.size;
            let (column, row) = ((part.x * width as f32) as usize, (part.y * height as f32) as usize);
            let depth = *picture.depth.get(row.min(height - 1) * width + column.min(width - 1))?;
            unproject(&matrix, canvas, at, depth)
        });
        if let Some(p) = pointed {
            let point = Some(HoverPoint { frame_id: scene.to_owned(), position_m: p.to_array() });
            cx.selection.hovered.set(Hover { point, ..Hover::default() });
            legend::plate(ui, canvas, Align2::RIGHT_BOTTOM, |ui| {
                let text = format!("x {:8.2} m  y {:8.2} m  z {:6.2} m", p.x, p.y, p.z);
                ui.label(widgets::mono(text));
            });
        } else if let Some(at) = Self::meant(cx, scene).and_then(|p| project(&matrix, canvas, p)) {
            let stroke = egui::Stroke::new(1.5, tokens(ui).accent);
            ui.painter_at(canvas).circle_stroke(at, 6.0, stroke);
        }
        notes(ui, canvas, &picture.problems, &shown);
    }

    /// The place at which another view points.
    fn meant(cx: &ViewContext<'_>, scene: &str) -> Option<DVec3> {
        let point = cx.selection.hovered.get().point.as_ref()?;
        let p = DVec3::from_array(point.position_m.map(|v| if v.is_nan() { 0.0 } else { v }));
        if point.frame_id == scene {
            return Some(p);
        }
        let now = cx.frame.transform_time(cx.frame.now);
        Some(cx.frame.transforms.lookup(scene, &point.frame_id, now.0).ok()? * p)
    }

    /// Turns with the pointer, moves with the second button or with shift, zooms with the wheel.
    fn interact(&mut self, ui: &Ui, response: &egui::Response, canvas: Rect) {
        let Some(now) = self.camera() else { return };
        let mut camera = now;
        let (shift, scroll, pinch) =
            ui.input(|input| (input.modifiers.shift, input.smooth_scroll_delta().y, input.zoom_delta()));
        let by = response.drag_delta();
        if response.dragged() {
            let moves = shift
                || response.dragged_by(egui::PointerButton::Secondary)
                || response.dragged_by(egui::PointerButton::Middle);
            if moves {
                camera.pan(by, canvas.height());
            } else {
                camera.turn(by);
            }
        }
        if response.hovered() {
            camera.zoom((f64::from(scroll) * 0.004).exp() * f64::from(pinch));
        }
        if camera != now {
            self.saved.camera = Some(camera);
        }
    }

    /// Moves the camera as far as the vehicle has moved.
    fn follow(&mut self, shown: &[&Placed<'_>]) {
        if !self.saved.follows {
            return;
        }
        let here = shown.iter().find_map(|layer| match &layer.thing {
            Thing::Track { here: Some((p, _)), .. } => Some(layer.scene_from_layer * DVec3::from_array(*p)),
            _ => None,
        });
        let Some(here) = here.filter(|p| p.is_finite()) else { return };
        let Some(mut camera) = self.camera() else { return };
        let center = if let Some(before) = self.followed {
            DVec3::from_array(camera.center) + (here - before)
        } else {
            // It begins at the vehicle, from near.
            camera.distance_m = camera.distance_m.min(14.0);
            here
        };
        camera.center = center.to_array();
        (self.saved.camera, self.followed) = (Some(camera), Some(here));
    }

    /// Asks for a picture where something has changed, and takes the newest one.
    fn draw(&mut self, ui: &Ui, frame: &Frame, scene: &str, shown: &[&Placed<'_>], canvas: Rect) {
        let per_point = ui.pixels_per_point();
        let size = [canvas.width(), canvas.height()].map(|v| (v * per_point).round().max(1.0) as u32);
        let looks = shown.iter().map(|layer| (&layer.name, self.saved.clouds.get(&layer.name)));
        let names = looks.map(|look| format!("{look:?}")).collect::<Vec<_>>().join("\n");
        let content = format!("{scene}\n{:?}\n{names}", self.saved.palette);
        let dark = ui.visuals().dark_mode;
        let key: Key = (frame.generation, self.camera(), size, self.saved.axes ^ dark, content);
        if self.worker.is_none() && self.failed.is_none() {
            match Worker::start(ui.ctx().clone()) {
                Ok(worker) => self.worker = Some(worker),
                Err(error) => self.failed = Some(error.to_string()),
            }
        }
        let Some(worker) = self.worker.as_ref().filter(|_| self.failed.is_none()) else { return };
        if self.asked.as_ref() != Some(&key) {
            self.asked = Some(key);
            self.number += 1;
            let layers = self.layers(ui, frame, scene, shown);
            let background = tokens(ui).canvas().to_array().map(|v| f64::from(v) / 255.0);
            worker.ask(Request {
                number: self.number,
                layers,
                camera: self.camera(),
                size,
                per_point,
                background: [background[0], background[1], background[2]],
                palette: self.saved.palette,
            });
        }
        let is_old = self.picture.as_ref().is_none_or(|picture| picture.number < self.number);
        let is_window = prepare::has_threads(ui.ctx());
        let taken = match (self.picture.is_none(), is_old && !frame.playback.playing) {
            (true, _) if !is_window => worker.wait(FIRST),
            (false, true) if !is_window => worker.wait(NEXT),
            _ => worker.take(),
        };
        match taken {
            None => {}
            Some(Ok(picture)) => {
                let image = Arc::clone(&picture.image);
                match &mut self.texture {
                    Some(texture) => texture.set(image, TextureOptions::LINEAR),
                    none => *none = Some(ui.ctx().load_texture("scene", image, TextureOptions::LINEAR)),
                }
                let outgrown = |known: Camera| picture.fit.distance_m > OUTGROWN * known.distance_m;
                if picture.number > self.fit_after && self.fitted.is_none_or(outgrown) {
                    self.fitted = Some(picture.fit);
                    // The next pass asks for the picture that is seen from there, with the ground.
                    ui.ctx().request_repaint();
                }
                self.picture = Some(picture);
            }
            Some(Err(error)) => {
                (self.worker, self.picture, self.asked) = (None, None, None);
                self.failed = Some(error);
            }
        }
        let is_old = self.picture.as_ref().is_none_or(|picture| picture.number < self.number);
        // The worker wakes a window; where there is none, the next pass comes at once.
        if self.failed.is_none() && is_old && !is_window {
            let is_still = self.picture.is_none() || !frame.playback.playing;
            ui.ctx().request_repaint_after(if is_still { Duration::ZERO } else { FIRST });
        }
    }

    /// What is drawn.
    fn layers(&self, ui: &Ui, frame: &Frame, scene: &str, shown: &[&Placed<'_>]) -> Vec<Layer> {
        let tokens = tokens(ui);
        let mut layers = Vec::new();
        let camera = self.camera();
        // Shapes that are made here are precise where they are looked at.
        let around = |pose: Pose| match camera {
            Some(camera) => Shapes::around(pose.inverse() * DVec3::from_array(camera.center)),
            None => Shapes::default(),
        };
        let mut vehicles = around(Pose::IDENTITY);
        for layer in shown {
            let color = if layer.is_stale { tokens.stale } else { tokens.series(layer.series) };
            let pose = layer.scene_from_layer;
            let content = match &layer.thing {
                Thing::Grid(message) => Content::Grid(SameMessage((*message).clone())),
                Thing::Cloud(message) => {
                    let look = self.saved.clouds.get(&layer.name).cloned().unwrap_or_default();
                    Content::Cloud(SameMessage((*message).clone()), look)
                }
                Thing::Entities(placed) => Content::Entities(placed.clone()),
                Thing::Path(points) => {
                    let mut shapes = around(pose);
                    shapes.strip(points.iter().map(|p| *p + DVec3::Z * 0.1), color, 3.0);
                    Content::Made(Arc::new(shapes.finish()))
                }
                Thing::Poses(poses) => {
                    let mut shapes = around(pose);
                    for ends in poses.iter().flat_map(|pose| crate::pose::arrow(pose, crate::pose::ARROW_M)) {
                        shapes.line(ends.map(|p| p + DVec3::Z * 0.1), color, 1.5);
                    }
                    Content::Made(Arc::new(shapes.finish()))
                }
                Thing::Track { points, here } => {
                    let mut shapes = around(pose);
                    shapes.strip(points.iter().map(|p| *p + DVec3::Z * 0.05), color, 2.0);
                    if let Some((p, yaw)) = here {
                        let p = pose * DVec3::from_array(*p);
                        vehicles.vehicle(p.to_array(), yaw + pose.yaw(), color);
                    }
                    Content::Made(Arc::new(shapes.finish()))
                }
                Thing::Nothing => continue,
            };
            layers.push(Layer { name: layer.name.clone(), content, pose });
        }
        layers.push(made("vehicles", vehicles.finish()));
        if self.saved.axes {
            let length = camera.map_or(1.0, |camera| (camera.distance_m * 0.03).clamp(0.3, 50.0));
            let mut axes = around(Pose::IDENTITY);
            for (_, pose) in frame_poses(frame, scene) {
                axes.axes(&pose, length);
            }
            // The origin of a global frame may be far from everything else.
            let has_others = layers.iter().any(Layer::has_content);
            layers.push(made("frames", if has_others { axes } else { axes.finish() }));
        }
        if let Some(camera) = camera {
            let step = round_step(camera.distance_m / 12.0);
            let color = tokens.surface[2];
            let ground =
                Shapes::ground(DVec3::from_array(camera.center), camera.distance_m * 2.0, step, color);
            layers.push(made("ground", ground));
        }
        layers
    }
}

/// What could not be read or placed, and what is shown and old, over the picture.
fn notes(ui: &mut Ui, canvas: Rect, problems: &[String], shown: &[&Placed<'_>]) {
    let note = |layer: &&Placed<'_>| Some(format!("{}: old, {}", layer.name, format::age(layer.age_s?)));
    let is_old = |layer: &&&Placed<'_>| layer.is_stale && !matches!(layer.thing, Thing::Nothing);
    let old: Vec<String> = shown.iter().filter(is_old).filter_map(note).collect();
    let loose = |layer: &&Placed<'_>| {
        layer.loose.as_ref().map(|loose| format!("{}: not drawn: {}", layer.name, loose.reason))
    };
    let problems: Vec<String> = problems.iter().cloned().chain(shown.iter().filter_map(loose)).collect();
    if problems.is_empty() && old.is_empty() {
        return;
    }
    let tokens = tokens(ui);
    legend::plate(ui, canvas, Align2::LEFT_TOP, |ui| {
        ui.style_mut().interaction.selectable_labels = false;
        for (texts, color) in [(problems.as_slice(), tokens.warning), (old.as_slice(), tokens.stale)] {
            for text in texts.iter().take(MOST_NOTES) {
                ui.label(RichText::new(text).small().color(color));
            }
            let more = texts.len().saturating_sub(MOST_NOTES);
            if more > 0 {
                ui.label(RichText::new(format!("and {more} more")).small().color(color));
            }
        }
    });
}

/// Says in place of a picture why there is none; returns whether to try again.
fn cannot_be_drawn(ui: &mut Ui, canvas: Rect, reason: &str) -> bool {
    let above = canvas.with_max_y((canvas.bottom() - AGAIN).max(canvas.top()));
    let mut child = ui.new_child(egui::UiBuilder::new().max_rect(above));
    widgets::empty(&mut child, icons::ICON_ERROR, "The scene cannot be drawn", reason);
    child.vertical_centered(|ui| ui.button("Try again").clicked()).inner
}

fn made(name: &str, shapes: Shapes) -> Layer {
    let content = Content::Made(Arc::new(shapes));
    Layer { name: format!("({name})"), content, pose: Pose::IDENTITY }
}

/// Poses of the coordinate frames that are connected to the scene, now or by the nearest sample of each transform.
fn frame_poses(frame: &Frame, scene: &str) -> Vec<(String, Pose)> {
    let (tree, now) = (&frame.transforms, frame.transform_time(frame.now));
    let pose = |name: &str| tree.lookup_nearest(scene, name, now.0).ok();
    let names = tree.frames().into_iter();
    names.filter_map(|name| Some((name.to_owned(), pose(name)?))).collect()
}

/// The names of the coordinate frames beside their origins.
fn frame_names(ui: &Ui, frame: &Frame, scene: &str, matrix: &glam::DMat4, canvas: Rect) {
    let (tokens, painter) = (tokens(ui), ui.painter_at(canvas));
    let mut taken: Vec<Rect> = Vec::new();
    for (name, pose) in frame_poses(frame, scene) {
        let Some(at) = project(matrix, canvas, pose.translation).filter(|at| canvas.contains(*at)) else {
            continue;
        };
        let galley = painter.layout_no_wrap(name, FontId::proportional(11.0), tokens.text);
        let place = Rect::from_min_size(at + Vec2::new(6.0, -galley.size().y / 2.0), galley.size());
        // Names that would lie on others are left out.
        if taken.iter().any(|other| other.intersects(place)) {
            continue;
        }
        taken.push(place);
        painter.rect_filled(place.expand2(Vec2::new(3.0, 0.0)), 2.0, tokens.surface[3].gamma_multiply(0.7));
        painter.galley(place.min, galley, tokens.text);
    }
}

/// The texts of entities, of one size on the screen.
fn entity_texts(ui: &Ui, shown: &[&Placed<'_>], matrix: &glam::DMat4, canvas: Rect) {
    let (tokens, painter) = (tokens(ui), ui.painter_at(canvas));
    for layer in shown {
        let Thing::Entities(placed) = &layer.thing else { continue };
        for text in placed.texts() {
            let Some(at) = project(matrix, canvas, text.at).filter(|at| canvas.contains(*at)) else {
                continue;
            };
            let color = tokens.legible(text.color);
            let galley = painter.layout_no_wrap(text.text, FontId::proportional(12.0), color);
            let place = Align2::CENTER_CENTER.anchor_size(at, galley.size());
            let plate = place.expand2(Vec2::new(3.0, 0.0));
            painter.rect_filled(plate, 2.0, tokens.surface[3].gamma_multiply(0.7));
            painter.galley(place.min, galley, color);
        }
    }
}

#[cfg(test)]
mod tests;
