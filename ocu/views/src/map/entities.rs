//! Entities of scenes, such as RViz's markers, on the map: solids and triangles as what is seen of them from above, lines,
//! and texts.
//!
//! Each entity is placed by its own frame: one that is locked to it at the viewed time, any other at the time of its stamp.

use super::labels::Labels;
use super::layers::{Kind, Layer, map_from_frame, placing_time};
use crate::canvas::Viewport;
use crate::clip::{self, is_place};
use crate::prepare::{Same, prepared, shared};
use crate::primitives::{PlacedEntities, PlacedText, Primitives, Solid, Width};
use egui::{Color32, Context, Id, Mesh, Painter, Pos2, Rect, Shape, Stroke};
use rcs_geom::{DVec3, Pose};
use rcs_msg::Stamp;
use rcs_runtime::source::{Entity, Frame, Topic, frame_name};
use std::sync::Arc;

/// More solids than these are painted without their edges.
const MOST_EDGED: usize = 1_000;
/// Width of a line, at least and at most, screen points.
const LINE_WIDTHS: [f64; 2] = [1.5, 32.0];

/// Entities with their places in a frame.
pub(super) struct Placement {
    pub(super) placed: PlacedEntities,
    /// Number of entities whose frame nothing connects.
    pub(super) loose: usize,
    /// Why the first of them is loose.
    pub(super) reason: Option<String>,
}

/// The entities of a layer in the frame of the map; `None` for another layer. All views share what is placed once in a
/// frame.
pub(super) fn placement(
    ctx: &Context,
    frame: &Frame,
    map: &str,
    layer: &Layer<'_>,
) -> Option<Arc<Placement>> {
    let (Kind::Entities(entities), Some(topic)) = (layer.kind, layer.topic) else { return None };
    let slot = slot("placed entities", frame, map, topic);
    // Frames that differ in the state of playing alone may have one number.
    let list = (entities.as_ptr().addr(), entities.len());
    let key = (frame.generation, frame.now, list, Same(Arc::clone(&frame.transforms)));
    Some(shared(ctx, slot, key, || place(frame, map, entities)))
}

/// Views of one run in one frame of coordinates share what is made of a topic.
fn slot(name: &str, frame: &Frame, map: &str, topic: &Topic) -> Id {
    Id::unique((name, &*topic.name, topic.run, frame.runs.current(), map))
}

/// Places the entities that exist at the viewed time.
fn place(frame: &Frame, map: &str, entities: &[Arc<Entity>]) -> Placement {
    let (mut placed, mut loose, mut reason) = (Vec::new(), 0, None);
    // Most entities of a topic have one frame and one time.
    let mut last: Option<(&str, Stamp, Result<Pose, String>)> = None;
    for entity in entities.iter().filter(|entity| entity.is_alive(frame.now)) {
        let (name, at) = (frame_name(&entity.content.frame_id), placing_time(frame, entity));
        let known = last.take().filter(|(last_name, last_at, _)| (*last_name, *last_at) == (name, at));
        let found = || (name, at, map_from_frame(frame, map, name, at));
        let (_, _, pose) = last.insert(known.unwrap_or_else(found));
        match pose {
            Ok(pose) => placed.push((Arc::clone(entity), *pose)),
            Err(error) => {
                loose += 1;
                reason.get_or_insert_with(|| error.clone());
            }
        }
    }
    Placement { placed: PlacedEntities(placed.into()), loose, reason }
}

/// The entities of a layer on the map.
pub(super) struct OnMap {
    /// Number of entities that are placed.
    pub(super) count: usize,
    /// Number of entities whose frame nothing connects.
    pub(super) loose: usize,
    /// Why the first of them is loose.
    pub(super) reason: Option<String>,
    /// Number of entities that are nowhere shown, because too many others existed.
    pub(super) left_out: usize,
    /// Whether they are all that exist, and not those of the newest message alone.
    pub(super) is_complete: bool,
    /// What is painted; `None` until it is made.
    pub(super) flat: Option<Arc<Flat>>,
}

impl OnMap {
    /// `None` for another layer.
    pub(super) fn of(ctx: &Context, frame: &Frame, map: &str, layer: &Layer<'_>) -> Option<Self> {
        let (placement, topic) = (placement(ctx, frame, map, layer)?, layer.topic?);
        let (loose, reason, placed) = (placement.loose, placement.reason.clone(), placement.placed.clone());
        let (count, left_out) = (placed.0.len(), frame.entities_left_out(topic));
        let is_complete = frame.has_all_entities(topic) != Some(false);
        let slot = slot("entities", frame, map, topic);
        let flat = prepared(ctx, slot, placed.clone(), move || Flat::of(&placed));
        Some(Self { count, loose, reason, left_out, is_complete, flat })
    }

    /// What is said of them below the name of the layer, and whether it is a warning.
    pub(super) fn notes(&self) -> Vec<(String, bool)> {
        let mut notes = Vec::new();
        match self.count {
            0 => {}
            1 => notes.push(("1 entity".to_owned(), false)),
            count => notes.push((format!("{count} entities"), false)),
        }
        if !self.is_complete {
            let text =
                "those of the newest message alone: earlier ones have not been read yet, or were forgotten";
            notes.push((text.to_owned(), false));
        }
        // Where none is placed, the panel says why, as of any layer.
        if let Some(reason) = self.reason.as_ref().filter(|_| self.count > 0) {
            notes.push((format!("not drawn: {} of {}: {reason}", self.loose, self.loose + self.count), true));
        }
        let (models, left_out) = self.flat.as_ref().map_or((0, 0), |flat| (flat.models, flat.left_out));
        if models > 0 {
            notes.push((format!("not drawn: models (meshes), {models} of them"), false));
        }
        if left_out > 0 {
            notes.push((format!("not drawn: {left_out} primitives, because there are too many"), true));
        }
        if self.left_out > 0 {
            let all = format!("{} entities of all times", self.left_out);
            notes.push((format!("not drawn: {all}, because too many others existed"), true));
        }
        notes
    }
}

/// Entities seen from above, in the frame of the map.
#[derive(Debug, Default)]
pub(super) struct Flat {
    /// Outlines of solids, counter-clockwise, from the lowest to the highest.
    solids: Vec<(Vec<[f64; 2]>, Color32)>,
    triangles: Vec<[([f64; 2], Color32); 3]>,
    lines: Vec<(Vec<[f64; 2]>, Color32, Width)>,
    texts: Vec<PlacedText>,
    /// Least and greatest x and y, m.
    pub(super) bounds: Option<([f64; 2], [f64; 2])>,
    /// Number of primitives with numbers that cannot be.
    pub(super) far: usize,
    /// Number of models, which are not drawn.
    pub(super) models: usize,
    /// Number of primitives that exceed the greatest amounts.
    pub(super) left_out: usize,
}

impl Flat {
    fn of(placed: &PlacedEntities) -> Self {
        let mut all = Primitives::of(placed, DVec3::ZERO);
        let sides = all.sides();
        all.solids.sort_by(|a, b| a.pose.translation.z.total_cmp(&b.pose.translation.z));
        let flat = |p: DVec3| [p.x, p.y];
        let solids = all.solids.iter().map(|solid| (outline(solid, sides), solid.color)).collect();
        let triangles = all.triangles.iter().map(|corners| corners.map(|(p, color)| (flat(p), color)));
        let lines = all.lines.into_iter().map(|line| {
            let points = line.points.into_iter().map(flat).collect();
            (points, line.color, line.width)
        });
        let (triangles, lines) = (triangles.collect(), lines.collect());
        let (far, models, left_out) = (all.far, all.models, all.left_out);
        let mut flat =
            Self { solids, triangles, lines, texts: placed.texts(), far, models, left_out, bounds: None };
        flat.bounds = flat.extent();
        flat
    }

    fn extent(&self) -> Option<([f64; 2], [f64; 2])> {
        let solids = self.solids.iter().flat_map(|(outline, _)| outline.iter().copied());
        let triangles = self.triangles.iter().flatten().map(|(p, _)| *p);
        let lines = self.lines.iter().flat_map(|(points, ..)| points.iter().copied());
        let texts = self.texts.iter().map(|text| [text.at.x, text.at.y]);
        let all = solids.chain(triangles).chain(lines).chain(texts).filter(|p| is_place(p));
        all.fold(None, |bounds, p| {
            let (min, max) = bounds.unwrap_or((p, p));
            let with =
                |other: [f64; 2], pick: fn(f64, f64) -> f64| [pick(other[0], p[0]), pick(other[1], p[1])];
            Some((with(min, f64::min), with(max, f64::max)))
        })
    }

    pub(super) fn paint(&self, painter: &Painter, viewport: Viewport, canvas: Rect, labels: &mut Labels) {
        let screen = |p: [f64; 2]| viewport.to_screen(canvas, p);
        let mut mesh = Mesh::default();
        for triangle in &self.triangles {
            let corners = triangle.map(|(p, color)| (screen(p), color));
            fan(&mut mesh, &corners, canvas);
        }
        let has_edges = self.solids.len() <= MOST_EDGED;
        let mut edged = Vec::new();
        for (outline, color) in &self.solids {
            let corners: Vec<Pos2> = outline.iter().map(|p| screen(*p)).collect();
            let is_visible = Rect::from_points(&corners).expand(1.0).intersects(canvas);
            if has_edges && is_visible && corners.len() > 1 {
                let edge = Stroke::new(1.0, color.gamma_multiply(0.8));
                edged.push(Shape::convex_polygon(corners, color.gamma_multiply(0.6), edge));
            } else if is_visible {
                let corners: Vec<(Pos2, Color32)> = corners.into_iter().map(|at| (at, *color)).collect();
                fan(&mut mesh, &corners, canvas);
            }
        }
        if !mesh.is_empty() {
            painter.add(Shape::mesh(mesh));
        }
        painter.extend(edged);
        for (points, color, width) in &self.lines {
            let width = match width {
                Width::Metres(width) => width * viewport.scale,
                Width::ScreenPoints(width) => *width,
            };
            let [least, most] = LINE_WIDTHS;
            let width = if width.is_finite() { width.clamp(least, most) } else { least };
            let stroke = Stroke::new(width as f32, *color);
            let parts = clip::line(points.iter().copied(), viewport, canvas);
            painter.extend(parts.into_iter().map(|part| Shape::line(part, stroke)));
        }
        for text in &self.texts {
            let at = screen([text.at.x, text.at.y]);
            if canvas.contains(at) {
                labels.add(at, text.text.clone(), text.color);
            }
        }
    }
}

/// Adds a convex polygon, if it is in the canvas.
fn fan(mesh: &mut Mesh, corners: &[(Pos2, Color32)], canvas: Rect) {
    let mut bounds = Rect::NOTHING;
    for (at, _) in corners {
        bounds.extend_with(*at);
    }
    if corners.len() < 3 || !bounds.intersects(canvas) {
        return;
    }
    let first = mesh.vertices.len() as u32;
    for (at, color) in corners {
        mesh.colored_vertex(*at, *color);
    }
    for corner in 2..corners.len() as u32 {
        mesh.add_triangle(first, first + corner - 1, first + corner);
    }
}

/// The outline of a solid seen from above, counter-clockwise; two points where it is seen edge-on.
fn outline(solid: &Solid, sides: usize) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = solid.faces(sides).corners.iter().map(|p| [p.x, p.y]).collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let mut outline = half(points.iter().copied());
    outline.extend(half(points.iter().rev().copied()));
    outline
}

/// One half of the convex hull of points in the order along an axis (Andrew's monotone chain), without its last point.
fn half(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut kept: Vec<[f64; 2]> = Vec::new();
    for p in points {
        while let [.., a, b] = kept.as_slice()
            && (b[0] - a[0]) * (p[1] - a[1]) <= (b[1] - a[1]) * (p[0] - a[0])
        {
            kept.pop();
        }
        kept.push(p);
    }
    kept.pop();
    kept
}

#[cfg(test)]
#[path = "entities_tests.rs"]
mod tests;
