//! Camera view: an image with overlays computed from it.
//!
//! Overlays are topics whose `rcs.overlay_of` names the image's topic; topics of labels, costs or shapes without that
//! metadata are offered for every image, and are on for the camera whose name begins like theirs. An overlay smaller than
//! its image is scaled to it. Ground truth is off until it is switched on. What lies in space (horizon, planned path,
//! cells of the map) is projected into the image where a calibration and transforms say how. The readout under the
//! pointer shows the pixel and the value or name in each layer.

mod annotations;
mod layer;
mod overlays;
mod projected;

use crate::badge;
use crate::canvas::Viewport;
use crate::view::{Draws, Hover, HoverPoint, SavedState, TopicKey, View, ViewContext, is_old};
use egui::{Align2, Id, Rect, Response, Role, Sense, TextureOptions, Ui, Vec2, WidgetInfo};
use layer::{Layer, Look, Overlay};
use ocu_ui::bar::{self, Bar, Fit, Form};
use ocu_ui::palette::MapPalette;
use ocu_ui::widgets::{self, mono};
use ocu_ui::{format, icons, legend, stale, tokens};
use projected::{Prepared, Projected, Seen};
use rcs_runtime::source::{Frame, Topic};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Size of a canvas below which it has no room for the name of a topic, screen points.
const SMALL: Vec2 = Vec2::new(240.0, 120.0);

/// Saved settings of an overlay, for all images of the view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct SavedOverlay {
    /// Whether it is shown; `None` for what is usual, which differs between images.
    shown: Option<bool>,
    opacity: f32,
}

impl Default for SavedOverlay {
    fn default() -> Self {
        Self { shown: None, opacity: 0.45 }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// The image to show; the first one where none is named.
    topic: Option<TopicKey>,
    /// Overlays that were changed by hand, by topic.
    overlays: BTreeMap<String, SavedOverlay>,
    /// Colours of costs.
    palette: MapPalette,
    /// Size of one step of a depth image with whole numbers, m.
    depth_step_m: f64,
    /// Where it looks; `None` to fit the image to the canvas.
    viewport: Option<Viewport>,
}

impl Default for Saved {
    fn default() -> Self {
        Self {
            topic: None,
            overlays: BTreeMap::new(),
            palette: MapPalette::default(),
            depth_step_m: 0.001,
            viewport: None,
        }
    }
}

/// The camera view.
#[derive(Default)]
pub(crate) struct Camera {
    saved: Saved,
    prepared: Prepared,
}

impl View for Camera {
    fn title(&self, frame: &Frame) -> String {
        let named = self.saved.topic.as_ref().map(|key| key.name.clone());
        let shown = || base(&self.saved, frame).map(|topic| topic.name.to_string());
        named.or_else(shown).unwrap_or_else(|| "Camera".to_owned())
    }

    fn accepts(&self, topic: &Topic) -> bool {
        layer::is_image(topic)
    }

    fn draws(&self, frame: &Frame, topic: &Topic) -> Draws {
        let is_shown = base(&self.saved, frame).is_some_and(|shown| TopicKey::of(topic).is(shown));
        if is_shown { Draws::Now } else { Draws::Never }
    }

    fn drop_topic(&mut self, topic: &Topic) {
        self.saved.topic = Some(TopicKey::of(topic));
        self.saved.viewport = None;
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let Some(topic) = base(&self.saved, cx.frame) else { return self.no_image(ui, cx.frame) };
        let overlays = layer::overlays(cx.frame, topic);
        self.toolbar(ui, cx.frame, Some(topic));
        let base = self.layer(ui.ctx(), topic);
        let image = base.as_ref().ok().and_then(Option::as_deref);
        let seen = image.and_then(|layer| Seen::of(ui.ctx(), cx.frame, topic, layer, &mut self.prepared));
        let (seen, unusable) = match seen.transpose() {
            Ok(seen) => (seen, None),
            Err(unusable) => (None, Some(unusable)),
        };
        let projected = projected::offered(seen.as_ref());
        let image = image.map(|layer| &layer.image);
        self.overlay_bar(ui, topic, image, &overlays, &projected, unusable.as_deref());
        self.canvas(ui, cx, topic, base, &overlays, seen.as_ref());
    }
}

/// The cameras of a source, the most telling first: those with overlays where there are any, otherwise all. Of one that is
/// both recorded and computed, that of the run.
pub fn cameras(frame: &Frame) -> Vec<TopicKey> {
    let images: Vec<_> = layer::images(frame).into_iter().filter(|topic| layer::is_camera(topic)).collect();
    let is_lain_on = |image: &&Topic| {
        layer::overlays(frame, image).iter().any(|overlay| layer::lies_on(overlay.topic, image))
    };
    let with_overlays: Vec<_> = images.iter().copied().filter(|image| is_lain_on(image)).collect();
    let mut chosen = if with_overlays.is_empty() { images } else { with_overlays };
    let mut names = BTreeSet::new();
    chosen.retain(|topic| names.insert(&*topic.name));
    chosen.into_iter().map(|topic| TopicKey::of(frame.topic(&topic.name).unwrap_or(topic))).collect()
}

/// The image to show: the selected one, or the first where none is selected. No other one takes the place of a selected
/// one that is not there.
fn base<'a>(saved: &Saved, frame: &'a Frame) -> Option<&'a Topic> {
    match &saved.topic {
        Some(key) => key.find(frame).filter(|topic| layer::is_image(topic)),
        None => layer::images(frame).into_iter().next(),
    }
}

/// An image, and its topic.
type Shown<'a> = (&'a Topic, Arc<Layer>);

impl Camera {
    fn layer(&self, ctx: &egui::Context, topic: &Topic) -> Result<Option<Arc<Layer>>, String> {
        layer::layer(ctx, topic, self.saved.palette, self.saved.depth_step_m)
    }

    /// Says why there is no image, and offers those that are there.
    fn no_image(&mut self, ui: &mut Ui, frame: &Frame) {
        let has_images = frame.topics.iter().any(layer::is_image);
        let (title, hint) = match self.saved.topic.as_ref().filter(|_| has_images) {
            None => (
                "No images here".to_owned(),
                "A topic of images would fill it: open a log with a camera, or run a stack that has one."
                    .to_owned(),
            ),
            Some(key) => match key.find(frame) {
                Some(topic) => (
                    format!("{} is no image", topic.name),
                    format!("Its messages are {}. Choose an image above.", topic.type_name()),
                ),
                None => (
                    format!("No topic {} here", key.name),
                    "It was not recorded, or no process writes it. Choose an image above.".to_owned(),
                ),
            },
        };
        if has_images {
            self.toolbar(ui, frame, None);
        }
        widgets::empty(ui, icons::ICON_NO_PHOTOGRAPHY, &title, &hint);
    }

    fn toolbar(&mut self, ui: &mut Ui, frame: &Frame, selected: Option<&Topic>) {
        let images = layer::images(frame);
        let mut bar: Bar<'_, (Option<TopicKey>, bool)> = Bar::new("toolbar");
        // Tabs where they fit, else a list.
        bar.left("images", Fit::Shrinks, |ui, form, (chosen, _)| {
            if form == Form::Full {
                for topic in &images {
                    let on = selected.is_some_and(|selected| TopicKey::of(topic).is(selected));
                    if ui.selectable_label(on, crate::toolbar::topic_label(frame, topic)).clicked() {
                        *chosen = Some(TopicKey::of(topic));
                    }
                }
            } else if let Some(key) =
                crate::toolbar::topic_choice(ui, form, frame, "Image", selected, &images)
            {
                *chosen = Some(key);
            }
        });
        bar.right("fit", Fit::Leaves(50), |ui, form, (_, fit)| {
            *fit |= bar::tool(ui, form, icons::ICON_FIT_SCREEN, "Fit the image").clicked();
        });
        let mut wishes = (None, false);
        crate::toolbar::show(ui, bar, &mut wishes);
        let (chosen, fit) = wishes;
        if fit {
            self.saved.viewport = None;
        }
        if let Some(key) = chosen {
            self.saved.topic = Some(key);
            self.saved.viewport = None;
        }
    }

    fn canvas(
        &mut self,
        ui: &mut Ui,
        cx: &mut ViewContext<'_>,
        topic: &Topic,
        base: Result<Option<Arc<Layer>>, String>,
        overlays: &[Overlay<'_>],
        seen: Option<&Seen>,
    ) {
        let (canvas, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        let name = format!("Image of {}", topic.name);
        response.widget_info(|| WidgetInfo::labeled(Role::Image, true, &name));
        let tokens = tokens(ui);
        ui.painter().rect_filled(canvas, 0.0, tokens.canvas());

        let base = match base {
            Ok(Some(layer)) => layer,
            // It is being decoded.
            Ok(None) if topic.latest.is_some() => return,
            state => return waiting(ui, canvas, cx, topic, state.err().as_ref()),
        };
        let (width, height) = (base.image.width as f64, base.image.height as f64);
        let fitted = Viewport::fit([0.0, 0.0], [width, height], canvas, 0.0, false);
        // A stored viewport may be one of another image.
        let stored = self.saved.viewport.filter(|at| at.is_valid() && at.meets(fitted, canvas));
        let mut viewport = stored.unwrap_or(fitted);
        if viewport.interact(ui, &response, [fitted.scale * 0.2, fitted.scale.max(1.0) * 64.0], true) {
            self.saved.viewport = Some(viewport);
        }
        if response.double_clicked() {
            self.saved.viewport = None;
        }
        let rect = Rect::from_two_pos(
            viewport.to_screen(canvas, [0.0, 0.0]),
            viewport.to_screen(canvas, [width, height]),
        );
        let magnified = viewport.scale > 4.0;
        let options = if magnified { TextureOptions::NEAREST } else { TextureOptions::LINEAR };
        let painter = ui.painter_at(canvas);
        let uv = Rect::from_min_max(egui::Pos2::ZERO, egui::Pos2::new(1.0, 1.0));
        painter.image(base.texture(ui.ctx(), options), rect, uv, egui::Color32::WHITE);
        let mut implausible = vec![(base.implausible, &*topic.name)];
        let mut shown: Vec<Shown<'_>> = vec![(topic, base)];
        for overlay in overlays {
            let state = self.overlay_state(overlay);
            if !state.shown {
                continue;
            }
            let overlay = overlay.topic;
            if let Some(shapes) = overlay.get() {
                // Overlays are clipped to the image.
                let inside = painter.with_clip_rect(painter.clip_rect().intersect(rect));
                let count = annotations::paint(&inside, shapes, viewport, canvas, state.opacity);
                implausible.push((count, &*overlay.name));
                continue;
            }
            if let Ok(Some(layer)) = self.layer(ui.ctx(), overlay) {
                implausible.push((layer.implausible, &*overlay.name));
                let texture = layer.texture(ui.ctx(), TextureOptions::NEAREST);
                painter.image(texture, rect, uv, egui::Color32::WHITE.gamma_multiply(state.opacity));
                shown.push((overlay, layer));
            }
        }
        if let Some(seen) = seen {
            // Overlays are clipped to the image.
            let inside = painter.with_clip_rect(painter.clip_rect().intersect(rect));
            let place = projected::Place { viewport, canvas };
            let slot = Id::unique(("projected", &*topic.name, topic.run, self.saved.palette));
            for what in projected::offered(Some(seen)) {
                let state = self.projected_state(what);
                if state.shown {
                    let look = (state.opacity, self.saved.palette);
                    projected::paint(&inside, what, seen, slot, place, look, tokens);
                }
            }
        }
        if is_old(topic, cx.frame.now) {
            stale::cover(ui, rect.intersect(canvas), topic.age_s(cx.frame.now).unwrap_or(0.0));
        }
        badge::implausible(ui, canvas, badge::DOWN, "values", implausible);
        self.legends(ui, canvas, &shown);
        let pixel = response.hover_pos().map(|at| viewport.to_plane(canvas, at));
        let base = &shown[0];
        let place =
            pixel.zip(seen).and_then(|(pixel, seen)| self.place(ui.ctx(), cx.frame, base, pixel, seen));
        read_out(ui, canvas, rect, pixel, &shown, place.as_ref());
        point_at(ui, cx, topic, &response, viewport, canvas, rect, place.map(|(point, _)| point), seen);
    }

    /// The legends of the images; the first one lies below the others.
    fn legends(&self, ui: &mut Ui, canvas: Rect, shown: &[Shown<'_>]) {
        let range = shown.first().and_then(|(_, base)| Some((base.quantity, base.range?)));
        let has = |look: Look| shown.iter().any(|(_, layer)| layer.look == look);
        // Of a small image the legend would hide too much; the read-out names what is under the pointer.
        if !(has(Look::Labels) || has(Look::Cost) || range.is_some()) || canvas.height() < 180.0 {
            return;
        }
        legend::plate(ui, canvas, Align2::LEFT_BOTTOM, |ui| {
            if let Some((quantity, ends)) = range {
                let [low, high] = ends.map(|value| format!("{value:.1} {}", quantity.unit()));
                legend::band(ui, 120.0, &low, &high, |fraction| quantity.color(fraction));
            }
            let labels = shown.iter().find(|(_, layer)| layer.look == Look::Labels);
            let classes = labels.map(|(_, layer)| layer.classes.legend()).unwrap_or_default();
            ui.set_max_width((canvas.width() - 32.0).max(64.0));
            legend::swatches(ui, classes.iter().map(|label| (label.color, label.name.clone())));
            if has(Look::Cost) {
                crate::toolbar::cost_legend(ui, self.saved.palette);
            }
        });
    }

    /// The place that a pixel shows, and how that is known: from an image of ranges of the same camera, else from where
    /// its ray meets the ground.
    fn place(
        &self,
        ctx: &egui::Context,
        frame: &Frame,
        (topic, base): &Shown<'_>,
        pixel: [f64; 2],
        seen: &Seen,
    ) -> Option<(HoverPoint, &'static str)> {
        let part = [pixel[0] / base.image.width as f64, pixel[1] / base.image.height as f64];
        if !part.iter().all(|part| (0.0..1.0).contains(part)) {
            return None;
        }
        let mut depth_m = None;
        if let Some(ranges) = projected::ranges(frame, topic, base) {
            depth_m = self.layer(ctx, ranges).ok().flatten().and_then(|layer| layer.value_m(part));
        }
        let how = if depth_m.is_some() { "by its range" } else { "if it is ground" };
        let p = seen.place(pixel, depth_m)?;
        let frame_id = seen.ground().scene.clone();
        Some((HoverPoint { frame_id, position_m: p.to_array() }, how))
    }
}

/// The values under the pointer, at a fixed position, so that they can be read while the pointer moves; without it, the
/// size of the image, unless that would hide much of it. `rect` is where the image is.
fn read_out(
    ui: &mut Ui,
    canvas: Rect,
    rect: Rect,
    pixel: Option<[f64; 2]>,
    shown: &[Shown<'_>],
    place: Option<&(HoverPoint, &'static str)>,
) {
    let Some((_, base)) = shown.first() else { return };
    let image = &base.image;
    let inside = pixel.filter(|[x, y]| image.index(*x, *y).is_some());
    let size = format!("{} × {}  {}", image.width, image.height, image.encoding);
    if inside.is_none() && !hides_little(ui, &size, canvas, rect.intersect(canvas)) {
        return;
    }
    legend::plate(ui, canvas, Align2::RIGHT_TOP, |ui| {
        ui.style_mut().interaction.selectable_labels = false;
        let Some([x, y]) = inside else {
            return drop(ui.label(mono(size).small().color(tokens(ui).weak)));
        };
        ui.label(mono(format!("{:4} {:4} px", x as usize, y as usize)));
        for (topic, layer) in shown {
            let at = [x / image.width as f64, y / image.height as f64];
            let Some(text) = layer.describe(at) else { continue };
            ui.label(mono(text)).on_hover_text(&*topic.name);
        }
        if let Some((point, how)) = place {
            let [x, y, z] = point.position_m;
            ui.label(mono(format!("x {x:7.2} y {y:7.2} z {z:6.2} m")));
            let text = format!("in {}, {how}", point.frame_id);
            ui.label(mono(text).small().color(tokens(ui).weak));
        }
    });
}

/// Whether a plate with a small text, in the upper right corner of the canvas, hides at most a third of an image.
fn hides_little(ui: &Ui, text: &str, canvas: Rect, image: Rect) -> bool {
    /// Distance of a plate from the edge of the canvas, and its margins on both sides.
    const BESIDE: f32 = 8.0 + 18.0;
    let font = egui::TextStyle::Small.resolve(ui.style());
    let text = ui.painter().layout_no_wrap(text.to_owned(), font, tokens(ui).weak);
    let left = canvas.right() - BESIDE - text.size().x;
    image.right() - left <= image.width() / 3.0
}

/// Says which pixel is under the pointer, and the place that it shows; marks the pixel that another view of the same
/// image points at, and the place of any other view.
#[expect(clippy::too_many_arguments, reason = "what is pointed at, and where that is on the screen")]
fn point_at(
    ui: &Ui,
    cx: &mut ViewContext<'_>,
    topic: &Topic,
    response: &Response,
    viewport: Viewport,
    canvas: Rect,
    image: Rect,
    point: Option<HoverPoint>,
    seen: Option<&Seen>,
) {
    let key = TopicKey::of(topic);
    if let Some(at) = response.hover_pos() {
        let pixel = Some(viewport.to_plane(canvas, at));
        cx.selection.hovered.set(Hover { topic: Some(key), pixel, point, ..Hover::default() });
        return;
    }
    let hover = cx.selection.hovered.get();
    let same = hover.pixel.filter(|_| hover.topic.as_ref() == Some(&key));
    let placed = || {
        let (point, seen) = (hover.point.as_ref()?, seen?);
        let scene = &seen.ground().scene;
        let p = seen.grounded(point.position_m);
        let is_here = point.frame_id == *scene;
        let at = cx.frame.transform_time(cx.frame.now).0;
        let p = if is_here { p } else { cx.frame.transforms.lookup(scene, &point.frame_id, at).ok()? * p };
        seen.pixel(p)
    };
    if let Some(pixel) = same.or_else(placed) {
        let stroke = egui::Stroke::new(1.5, tokens(ui).accent);
        // A place beside the image is not in it.
        ui.painter_at(canvas.intersect(image)).circle_stroke(viewport.to_screen(canvas, pixel), 6.0, stroke);
    }
}

/// A canvas without an image: no message has arrived, or it cannot be decoded.
fn waiting(ui: &mut Ui, canvas: Rect, cx: &ViewContext<'_>, topic: &Topic, error: Option<&String>) {
    let is_small = canvas.height() < SMALL.y || canvas.width() < SMALL.x;
    let (title, hint) = if let Some(error) = error {
        ("This image cannot be shown".to_owned(), error.clone())
    } else {
        let at = format::elapsed(cx.frame.time_s());
        // The toolbar has the name of the topic.
        let title = if is_small {
            "No image yet".to_owned()
        } else {
            format!("No image of {} yet at {at}", topic.name)
        };
        (title, "Play or step on to the first one.".to_owned())
    };
    let margin = if is_small { 4.0 } else { 16.0 };
    let builder = egui::UiBuilder::new().max_rect(canvas.shrink(margin));
    ui.scope_builder(builder, |ui| widgets::empty(ui, icons::ICON_IMAGE, &title, &hint));
}
