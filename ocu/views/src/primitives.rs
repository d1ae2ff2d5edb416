//! The primitives of scene entities, placed in one coordinate frame: solids, triangles, lines and texts.
//!
//! Numbers that cannot be are left out and counted, and so is what exceeds the greatest amounts, so that the cost of a
//! view is bounded whatever a message holds. Models are not drawn. A primitive without a colour is grey; one that is
//! completely transparent is not drawn.

use crate::clip::is_place;
use crate::pose::from_message;
use egui::Color32;
use rcs_geom::{DQuat, DVec3, Pose};
use rcs_msg::foxglove::line_primitive::Type as LineType;
use rcs_msg::foxglove::{
    self, ArrowPrimitive, LinePrimitive, Point3, SceneEntity, TextPrimitive, TriangleListPrimitive,
};
use rcs_runtime::source::Entity;
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4, PI, TAU};
use std::sync::Arc;

/// Greatest numbers of solids, of triangles and of ends of lines.
const MOST_SOLIDS: usize = 20_000;
const MOST_TRIANGLES: usize = 100_000;
const MOST_ENDS: usize = 200_000;
/// Greatest number of lines; each has one colour, and beyond it a line keeps its first one.
const MOST_LINES: usize = 10_000;
/// Greatest number of texts, and of the characters of one.
const MOST_TEXTS: usize = 200;
const MOST_CHARACTERS: usize = 80;
/// More solids than these are drawn with fewer sides.
const MANY_SOLIDS: usize = 1_000;
/// The colour of what has none.
const NO_COLOR: Color32 = Color32::from_gray(160);

/// Entities with the poses of their frames.
#[derive(Clone)]
pub(crate) struct PlacedEntities(pub(crate) Arc<[(Arc<Entity>, Pose)]>);

/// Equal if they are the same entities at the same places.
impl PartialEq for PlacedEntities {
    fn eq(&self, other: &Self) -> bool {
        if Arc::ptr_eq(&self.0, &other.0) {
            return true;
        }
        let mut pairs = self.0.iter().zip(other.0.iter());
        self.0.len() == other.0.len() && pairs.all(|(a, b)| Arc::ptr_eq(&a.0, &b.0) && a.1 == b.1)
    }
}

impl PlacedEntities {
    /// A place among them, from which coordinates are small enough for numbers of 32 bits.
    pub(crate) fn anchor(&self) -> DVec3 {
        let anchor = self.0.iter().find_map(|(entity, pose)| {
            let p = *pose * first_place(&entity.content)?;
            is_place(&p.to_array()).then_some(p)
        });
        anchor.unwrap_or(DVec3::ZERO)
    }

    /// The texts and where they are.
    pub(crate) fn texts(&self) -> Vec<PlacedText> {
        let texts =
            self.0.iter().flat_map(|(entity, pose)| entity.content.texts.iter().map(move |t| (t, pose)));
        texts.filter_map(|(text, pose)| PlacedText::of(text, pose)).take(MOST_TEXTS).collect()
    }
}

/// The place of the first primitive of an entity, in its frame.
fn first_place(entity: &SceneEntity) -> Option<DVec3> {
    let poses = entity.arrows.iter().map(|arrow| arrow.pose);
    let poses = poses.chain(entity.cubes.iter().map(|cube| cube.pose));
    let poses = poses.chain(entity.spheres.iter().map(|sphere| sphere.pose));
    let mut poses = poses.chain(entity.cylinders.iter().map(|cylinder| cylinder.pose));
    let placed = |pose: Option<&foxglove::Pose>| from_message(pose).ok();
    let of_points =
        |pose: Option<&foxglove::Pose>, points: &[Point3]| Some(placed(pose)? * vector(points.first()?));
    let first = poses.next().and_then(|pose| Some(placed(pose.as_ref())?.translation));
    let lines = || entity.lines.iter().find_map(|line| of_points(line.pose.as_ref(), &line.points));
    let triangles = || entity.triangles.iter().find_map(|list| of_points(list.pose.as_ref(), &list.points));
    first.or_else(lines).or_else(triangles)
}

/// A text that faces the viewer.
#[derive(Debug, PartialEq)]
pub(crate) struct PlacedText {
    pub(crate) at: DVec3,
    pub(crate) text: String,
    pub(crate) color: Color32,
}

impl PlacedText {
    fn of(text: &TextPrimitive, frame: &Pose) -> Option<Self> {
        let at = (*frame * from_message(text.pose.as_ref()).ok()?).translation;
        let color = color_of(text.color.as_ref());
        let is_drawn = is_place(&at.to_array()) && color != Color32::TRANSPARENT && !text.text.is_empty();
        let mut shown: String = text.text.chars().take(MOST_CHARACTERS).collect();
        if shown.len() < text.text.len() {
            shown.push('…');
        }
        is_drawn.then_some(Self { at, text: shown, color })
    }
}

/// The form of a solid, within a cube of side 1 around the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Form {
    Cube,
    Sphere,
    /// Around the z axis, with these parts of the greatest diameter at its bottom and top, 0 to 1.
    Cylinder {
        bottom: f64,
        top: f64,
    },
}

/// A convex solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Solid {
    pub(crate) form: Form,
    pub(crate) pose: Pose,
    /// Along its own axes, m.
    pub(crate) size: DVec3,
    pub(crate) color: Color32,
}

/// Corners, and the indices of the corners of each face, counter-clockwise from outside.
pub(crate) struct Faces {
    pub(crate) corners: Vec<DVec3>,
    pub(crate) faces: Vec<[usize; 3]>,
}

impl Solid {
    /// Its surface, where round ones have this number of sides.
    pub(crate) fn faces(&self, sides: usize) -> Faces {
        let mut faces = match self.form {
            Form::Cube => {
                turned(&[[0.0, -0.5], [FRAC_1_SQRT_2, -0.5], [FRAC_1_SQRT_2, 0.5], [0.0, 0.5]], 4, FRAC_PI_4)
            }
            Form::Sphere => {
                let rings = sides / 2;
                let ring = |i: usize| {
                    let (sin, cos) = (PI * i as f64 / rings as f64).sin_cos();
                    let radius = if i == 0 || i == rings { 0.0 } else { sin / 2.0 };
                    [radius, -cos / 2.0]
                };
                turned(&(0..=rings).map(ring).collect::<Vec<_>>(), sides, 0.0)
            }
            Form::Cylinder { bottom, top } => {
                turned(&[[0.0, -0.5], [bottom / 2.0, -0.5], [top / 2.0, 0.5], [0.0, 0.5]], sides, 0.0)
            }
        };
        faces.corners.iter_mut().for_each(|corner| *corner = self.pose * (*corner * self.size));
        faces
    }

    /// Half of the extent along the axes of its frame, m.
    pub(crate) fn reach(&self) -> DVec3 {
        let (axes, half) = (self.pose.rotation_matrix(), self.size.abs() / 2.0);
        axes.x_axis.abs() * half.x + axes.y_axis.abs() * half.y + axes.z_axis.abs() * half.z
    }
}

/// The surface that a line (distances from the z axis, and heights) leaves as it turns around the z axis.
fn turned(line: &[[f64; 2]], sides: usize, first_rad: f64) -> Faces {
    let corner = |[radius, z]: [f64; 2], side: usize| {
        let (sin, cos) = (first_rad + TAU * side as f64 / sides as f64).sin_cos();
        DVec3::new(radius * cos, radius * sin, z)
    };
    let corners = line.iter().flat_map(|&at| (0..sides).map(move |side| corner(at, side))).collect();
    let mut faces = Vec::new();
    for (ring, pair) in line.windows(2).enumerate() {
        for side in 0..sides {
            let [a, b] = [side, (side + 1) % sides].map(|side| ring * sides + side);
            // At the axis, all corners of a ring are one.
            if pair[0][0] > 0.0 {
                faces.push([a, b, b + sides]);
            }
            if pair[1][0] > 0.0 {
                faces.push([a, b + sides, a + sides]);
            }
        }
    }
    Faces { corners, faces }
}

/// A line through points; one that is not finite interrupts it.
#[derive(Debug, PartialEq)]
pub(crate) struct Line {
    pub(crate) points: Vec<DVec3>,
    pub(crate) color: Color32,
    pub(crate) width: Width,
}

/// The width of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Width {
    Metres(f64),
    ScreenPoints(f64),
}

/// The primitives of entities. Texts are apart: [`PlacedEntities::texts`].
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Primitives {
    pub(crate) solids: Vec<Solid>,
    pub(crate) triangles: Vec<[(DVec3, Color32); 3]>,
    pub(crate) lines: Vec<Line>,
    /// Number of primitives with numbers that cannot be.
    pub(crate) far: usize,
    /// Number of models.
    pub(crate) models: usize,
    /// Number of primitives that exceed the greatest amounts.
    pub(crate) left_out: usize,
    ends: usize,
}

impl Primitives {
    /// All primitives, relative to an origin.
    pub(crate) fn of(placed: &PlacedEntities, origin: DVec3) -> Self {
        let mut all = Self::default();
        for (entity, pose) in placed.0.iter() {
            let frame = Pose { translation: pose.translation - origin, ..*pose };
            all.add(&entity.content, &frame);
        }
        all
    }

    /// Number of sides of round solids.
    pub(crate) fn sides(&self) -> usize {
        if self.solids.len() > MANY_SOLIDS { 8 } else { 16 }
    }

    fn add(&mut self, entity: &SceneEntity, frame: &Pose) {
        self.models += entity.models.len();
        for arrow in &entity.arrows {
            self.arrow(arrow, frame);
        }
        for cube in &entity.cubes {
            self.solid(Form::Cube, frame, cube.pose.as_ref(), cube.size.as_ref(), cube.color.as_ref());
        }
        for sphere in &entity.spheres {
            self.solid(
                Form::Sphere,
                frame,
                sphere.pose.as_ref(),
                sphere.size.as_ref(),
                sphere.color.as_ref(),
            );
        }
        for it in &entity.cylinders {
            let [bottom, top] = [it.bottom_scale, it.top_scale].map(|scale| scale.clamp(0.0, 1.0));
            let form = Form::Cylinder { bottom, top };
            self.solid(form, frame, it.pose.as_ref(), it.size.as_ref(), it.color.as_ref());
        }
        for line in &entity.lines {
            self.line(line, frame);
        }
        for list in &entity.triangles {
            self.triangle_list(list, frame);
        }
    }

    fn solid(
        &mut self,
        form: Form,
        frame: &Pose,
        pose: Option<&foxglove::Pose>,
        size: Option<&foxglove::Vector3>,
        color: Option<&foxglove::Color>,
    ) {
        let size = size.map_or(DVec3::ZERO, |size| DVec3::new(size.x, size.y, size.z));
        match from_message(pose) {
            Ok(pose) => self.push(Solid { form, pose: *frame * pose, size, color: color_of(color) }),
            Err(_) => self.far += 1,
        }
    }

    fn push(&mut self, solid: Solid) {
        let is_whole = match solid.form {
            Form::Cylinder { bottom, top } => bottom.is_finite() && top.is_finite(),
            Form::Cube | Form::Sphere => true,
        };
        let places = [solid.pose.translation.to_array(), solid.size.to_array()];
        if !(is_whole && places.iter().all(|place| is_place(place))) {
            self.far += 1;
        } else if self.solids.len() >= MOST_SOLIDS {
            self.left_out += 1;
        } else if solid.color != Color32::TRANSPARENT {
            self.solids.push(solid);
        }
    }

    /// A shaft and a head around the x axis.
    fn arrow(&mut self, arrow: &ArrowPrimitive, frame: &Pose) {
        let Ok(pose) = from_message(arrow.pose.as_ref()) else {
            self.far += 1;
            return;
        };
        let color = color_of(arrow.color.as_ref());
        let parts = [
            (0.0, arrow.shaft_length, arrow.shaft_diameter, Form::Cylinder { bottom: 1.0, top: 1.0 }),
            (
                arrow.shaft_length,
                arrow.head_length,
                arrow.head_diameter,
                Form::Cylinder { bottom: 1.0, top: 0.0 },
            ),
        ];
        for (from, length, diameter, form) in parts {
            // What lies along z of the form lies along x of the arrow.
            let middle = DVec3::X * (from + length / 2.0);
            let part = Pose::new(DQuat::from_rotation_y(FRAC_PI_2), middle);
            let size = DVec3::new(diameter, diameter, length);
            self.push(Solid { form, pose: *frame * pose * part, size, color });
        }
    }

    fn line(&mut self, line: &LinePrimitive, frame: &Pose) {
        if self.lines.len() >= MOST_LINES {
            self.left_out += 1;
            return;
        }
        let Ok(pose) = from_message(line.pose.as_ref()) else {
            self.far += 1;
            return;
        };
        let vertices =
            Vertices::of(&line.points, &line.colors, &line.indices, line.color.as_ref(), *frame * pose);
        let count = vertices.count();
        let (segments, step) = match line.r#type() {
            LineType::LineStrip => (count.saturating_sub(1), 1),
            LineType::LineLoop => (if count > 1 { count } else { 0 }, 1),
            LineType::LineList => (count / 2, 2),
        };
        let width = if line.scale_invariant {
            Width::ScreenPoints(line.thickness)
        } else {
            Width::Metres(line.thickness)
        };
        // The line that goes on, and the vertex at which it ends.
        let mut open: Option<(Line, usize)> = None;
        for segment in 0..segments {
            if self.ends + 2 > MOST_ENDS {
                self.left_out += segments - segment;
                break;
            }
            let (from, to) = (segment * step, (segment * step + 1) % count);
            let (Some((a, color)), Some((b, _))) = (vertices.get(from), vertices.get(to)) else {
                self.far += 1;
                continue;
            };
            if color == Color32::TRANSPARENT {
                continue;
            }
            self.ends += 2;
            match &mut open {
                Some((line, end)) if line.color == color || self.lines.len() >= MOST_LINES => {
                    if *end != from {
                        line.points.extend([DVec3::NAN, a]);
                    }
                    line.points.push(b);
                    *end = to;
                }
                _ => {
                    let begun = Line { points: vec![a, b], color, width };
                    self.lines.extend(open.replace((begun, to)).map(|(line, _)| line));
                }
            }
        }
        self.lines.extend(open.map(|(line, _)| line));
    }

    fn triangle_list(&mut self, list: &TriangleListPrimitive, frame: &Pose) {
        let Ok(pose) = from_message(list.pose.as_ref()) else {
            self.far += 1;
            return;
        };
        let vertices =
            Vertices::of(&list.points, &list.colors, &list.indices, list.color.as_ref(), *frame * pose);
        let count = vertices.count() / 3;
        for triangle in 0..count {
            if self.triangles.len() >= MOST_TRIANGLES {
                self.left_out += count - triangle;
                return;
            }
            match [0, 1, 2].map(|corner| vertices.get(3 * triangle + corner)) {
                [Some(a), Some(b), Some(c)] => self.triangles.push([a, b, c]),
                _ => self.far += 1,
            }
        }
    }
}

/// The vertices of a line or of triangles.
struct Vertices<'a> {
    points: &'a [Point3],
    /// One for each point, or none.
    colors: &'a [foxglove::Color],
    /// Which points are the vertices; none for all of them in order.
    indices: &'a [u32],
    color: Color32,
    pose: Pose,
}

impl<'a> Vertices<'a> {
    fn of(
        points: &'a [Point3],
        colors: &'a [foxglove::Color],
        indices: &'a [u32],
        color: Option<&foxglove::Color>,
        pose: Pose,
    ) -> Self {
        let colors = if colors.len() == points.len() { colors } else { &[] };
        Self { points, colors, indices, color: color_of(color), pose }
    }

    fn count(&self) -> usize {
        if self.indices.is_empty() { self.points.len() } else { self.indices.len() }
    }

    /// `None` where there is no such point, or it cannot be.
    fn get(&self, vertex: usize) -> Option<(DVec3, Color32)> {
        let index = if self.indices.is_empty() { vertex } else { *self.indices.get(vertex)? as usize };
        let p = self.pose * vector(self.points.get(index)?);
        let color = self.colors.get(index).map_or(self.color, |color| color_of(Some(color)));
        is_place(&p.to_array()).then_some((p, color))
    }
}

fn vector(p: &Point3) -> DVec3 {
    DVec3::new(p.x, p.y, p.z)
}

fn color_of(color: Option<&foxglove::Color>) -> Color32 {
    let Some(color) = color else { return NO_COLOR };
    // A number that is none becomes 0.
    let [r, g, b, a] =
        [color.r, color.g, color.b, color.a].map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8);
    Color32::from_rgba_unmultiplied(r, g, b, a)
}

#[cfg(test)]
#[path = "primitives_tests.rs"]
mod tests;
