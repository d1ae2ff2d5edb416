//! What the scene draws, for the graphics processor: instances of points, lines, and boxes for the cells of grids, and
//! the triangles of surfaces.

use crate::cloud_colors::Colored;
use crate::cloud_look::CloudLook;
use crate::map::CellColors;
use crate::primitives::{Faces, PlacedEntities, Primitives, Solid, Width};
use egui::Color32;
use rcs_geom::{DVec3, Pose};
use rcs_msg::AnyMessage;
use rcs_msg::foxglove::PointCloud;
use rcs_world::GridView;

/// Most cells of a grid that are drawn one by one; of a larger one every second, third, … row and column.
const MOST_CELLS: usize = 400_000;
/// Most places from which the bounds of shapes are computed.
const MOST_PLACES: usize = 4_000;
/// Of at least so many places, the outermost one along each axis never counts.
const MANY: usize = 20;
/// Share of the places on either side of each axis that do not count.
const OUTLIERS: f64 = 0.01;

/// Instances of each kind. Their coordinates are 32-bit numbers relative to an origin near them, because such a number has
/// steps of half a metre at the northing of a UTM zone.
#[derive(Debug, Default)]
pub(super) struct Shapes {
    /// The origin in the shapes' own frame; without one, the first coordinates become it.
    origin: Option<DVec3>,
    /// x, y, z, colour.
    pub(super) points: Vec<u8>,
    /// Side of the points, screen points.
    pub(super) side: f32,
    /// Both ends, colour, width in points.
    pub(super) lines: Vec<u8>,
    /// Lower corner, extent, colour.
    pub(super) boxes: Vec<u8>,
    /// Corners of triangles: x, y, z, colour.
    pub(super) surfaces: Vec<u8>,
    /// Bounds without outliers, in the shapes' own frame, once the shapes are finished; `None` if they do not count for
    /// what the scene is fitted to.
    pub(super) bounds: Option<[DVec3; 2]>,
    /// What the bounds are made of.
    places: Vec<DVec3>,
}

/// Width of lines whose width is in metres, screen points.
const LINE_WIDTH: f32 = 2.0;
/// Direction from which surfaces are lit.
const LIGHT: DVec3 = DVec3::new(0.3, 0.2, 0.933);

/// Sizes of the instances and of a corner of a surface, bytes.
pub(super) const CORNER: usize = 16;
pub(super) const POINT: usize = 16;
pub(super) const LINE: usize = 32;
pub(super) const BOX: usize = 28;

impl Shapes {
    /// No shapes yet, but an origin for them.
    pub(super) fn around(origin: DVec3) -> Self {
        Self { origin: Some(origin), ..Self::default() }
    }

    /// The origin of the coordinates, in the shapes' own frame.
    pub(super) fn origin(&self) -> DVec3 {
        self.origin.unwrap_or_default()
    }

    /// Coordinates relative to the origin.
    fn relative(&mut self, p: DVec3) -> DVec3 {
        if p.is_finite() { p - *self.origin.get_or_insert(p) } else { p }
    }

    /// Adds a line of this width, screen points.
    pub(super) fn line(&mut self, ends: [DVec3; 2], color: Color32, width: f32) {
        self.places.extend(ends);
        self.mark(ends, color, width);
    }

    /// Adds a line that does not count for the bounds.
    fn mark(&mut self, ends: [DVec3; 2], color: Color32, width: f32) {
        for end in ends {
            let end = self.relative(end);
            floats(&mut self.lines, end);
        }
        self.lines.extend(color.to_array());
        self.lines.extend(width.to_ne_bytes());
    }

    /// Adds lines through points; a point that is no number interrupts them.
    pub(super) fn strip(&mut self, points: impl Iterator<Item = DVec3>, color: Color32, width: f32) {
        let mut before: Option<DVec3> = None;
        for p in points {
            if p.is_finite() {
                if let Some(before) = before.filter(|before| before.distance_squared(p) > 0.0) {
                    self.line([before, p], color, width);
                }
                before = Some(p);
            } else {
                before = None;
            }
        }
    }

    fn cell(&mut self, corner: DVec3, extent: DVec3, color: Color32) {
        self.places.extend([corner, corner + extent]);
        let corner = self.relative(corner);
        floats(&mut self.boxes, corner);
        floats(&mut self.boxes, extent);
        self.boxes.extend(color.to_array());
    }

    /// The points of a cloud.
    pub(super) fn cloud(cloud: &PointCloud, look: &CloudLook) -> Result<Self, String> {
        let Colored { points, .. } = Colored::new(cloud, &Pose::IDENTITY, look.by.as_deref())?;
        let bounds = spread(points.iter().map(|(place, _)| *place));
        let origin = bounds.map(|[low, high]| low.midpoint(high));
        let mut shapes = Self { origin, bounds, side: look.side(), ..Self::default() };
        for (place, color) in points {
            let place = shapes.relative(place);
            floats(&mut shapes.points, place);
            shapes.points.extend(color.to_array());
        }
        Ok(shapes)
    }

    /// The cells of a grid, in the grid's own frame (see [`grid_pose`]): on the ground where it states heights, obstacles
    /// as high as they are.
    pub(super) fn grid(grid: &AnyMessage, colors: &CellColors) -> Result<Self, String> {
        let view = GridView::of(grid).map_err(|error| error.to_string())?;
        let (columns, rows, cell_m) = (view.columns(), view.rows(), view.cell_size_m());
        let field = |names: &[&str]| names.iter().find_map(|name| view.field(name).ok());
        let ground = field(&["ground.mean", "height", "elevation", "z"]);
        let top = field(&["obstacle.max"]);
        let every = (columns * rows).div_ceil(MOST_CELLS).isqrt().max(1);
        let mut shapes = Self::default();
        for row in (0..rows).step_by(every) {
            for column in (0..columns).step_by(every) {
                let Some(color) = colors.at(column, row) else { continue };
                let number = |field: &Option<rcs_world::Field<'_>>| {
                    field.as_ref()?.get(column, row).filter(|v| v.is_finite() && v.abs() < 1e4)
                };
                let (ground, top) = (number(&ground), number(&top));
                let low = ground.or(top.map(|top| top - 0.3)).unwrap_or(0.0);
                let high = top.map_or(low, |top| top.max(low));
                let corner = DVec3::new(column as f64 * cell_m.x, row as f64 * cell_m.y, low);
                let side = cell_m * every as f64;
                shapes.cell(corner, DVec3::new(side.x, side.y, high - low), color);
            }
        }
        Ok(shapes.finish())
    }

    /// Entities of a scene relative to their anchor, without texts.
    pub(super) fn entities(placed: &PlacedEntities) -> Self {
        let all = Primitives::of(placed, placed.anchor());
        let mut shapes = Self::default();
        for solid in &all.solids {
            shapes.solid(solid, all.sides());
        }
        for triangle in &all.triangles {
            let corners = triangle.map(|(p, _)| p);
            shapes.places.extend(corners);
            // Both sides are seen.
            let shade = shade(corners).max(shade([corners[0], corners[2], corners[1]]));
            shapes.surface(triangle.map(|(p, color)| (p, shaded(color, shade))));
        }
        for line in &all.lines {
            let width = match line.width {
                Width::Metres(_) => LINE_WIDTH,
                Width::ScreenPoints(width) => width.clamp(1.0, 16.0) as f32,
            };
            shapes.strip(line.points.iter().copied(), line.color, width);
        }
        shapes.finish()
    }

    fn solid(&mut self, solid: &Solid, sides: usize) {
        let (middle, reach) = (solid.pose.translation, solid.reach());
        self.places.extend([middle - reach, middle + reach]);
        let Faces { corners, faces } = solid.faces(sides);
        for face in faces {
            let corners = face.map(|index| corners[index]);
            let color = shaded(solid.color, shade(corners));
            self.surface(corners.map(|p| (p, color)));
        }
    }

    fn surface(&mut self, corners: [(DVec3, Color32); 3]) {
        for (p, color) in corners {
            let p = self.relative(p);
            floats(&mut self.surfaces, p);
            self.surfaces.extend(color.to_array());
        }
    }

    /// The shapes with their bounds.
    pub(super) fn finish(mut self) -> Self {
        self.bounds = spread(std::mem::take(&mut self.places).into_iter());
        self
    }

    /// Axes of frames in red, green and blue; their origins count for the bounds.
    pub(super) fn axes(&mut self, pose: &Pose, length_m: f64) {
        let colors = [(230, 70, 60), (80, 190, 90), (90, 140, 255)];
        for ((r, g, b), axis) in colors.into_iter().zip([DVec3::X, DVec3::Y, DVec3::Z]) {
            let ends = [pose.translation, *pose * (axis * length_m)];
            self.mark(ends, Color32::from_rgb(r, g, b), 2.0);
        }
        self.places.push(pose.translation);
    }

    /// An arrow on the ground that shows where the vehicle is and heads.
    pub(super) fn vehicle(&mut self, [x, y, z]: [f64; 3], yaw_rad: f64, color: Color32) {
        let (sin, cos) = if yaw_rad.is_finite() { yaw_rad.sin_cos() } else { (0.0, 1.0) };
        let at = |ahead: f64, left: f64, up: f64| {
            DVec3::new(x + cos * ahead - sin * left, y + sin * ahead + cos * left, z + up)
        };
        for up in [0.05, 0.45] {
            let corners = [at(0.6, 0.0, up), at(-0.4, 0.35, up), at(-0.4, -0.35, up), at(0.6, 0.0, up)];
            self.strip(corners.into_iter(), color, 3.0);
        }
        for (ahead, left) in [(0.6, 0.0), (-0.4, 0.35), (-0.4, -0.35)] {
            self.line([at(ahead, left, 0.05), at(ahead, left, 0.45)], color, 3.0);
        }
    }

    /// Lines of a plane at whole steps; they have no bounds.
    pub(super) fn ground(center: DVec3, reach_m: f64, step_m: f64, color: Color32) -> Self {
        let mut shapes = Self::default();
        let round = |v: f64| (v / step_m).round() * step_m;
        let (x, y) = (round(center.x), round(center.y));
        let count = (reach_m / step_m).ceil().min(60.0) as i32;
        let reach = f64::from(count) * step_m;
        for line in -count..=count {
            let off = f64::from(line) * step_m;
            let north = [DVec3::new(x + off, y - reach, 0.0), DVec3::new(x + off, y + reach, 0.0)];
            let east = [DVec3::new(x - reach, y + off, 0.0), DVec3::new(x + reach, y + off, 0.0)];
            shapes.mark(north, color, 1.0);
            shapes.mark(east, color, 1.0);
        }
        shapes
    }
}

/// Brightness of a face that is seen from where its corners are counter-clockwise, 0 to 1.
fn shade([a, b, c]: [DVec3; 3]) -> f32 {
    (0.7 + 0.3 * (b - a).cross(c - a).normalize_or_zero().dot(LIGHT)) as f32
}

fn shaded(color: Color32, shade: f32) -> Color32 {
    let [r, g, b] = [color.r(), color.g(), color.b()].map(|v| (f32::from(v) * shade) as u8);
    Color32::from_rgba_premultiplied(r, g, b, color.a())
}

/// Pose of a grid's cells in the frame of its message; the identity for other messages.
pub(super) fn grid_pose(grid: &AnyMessage) -> Pose {
    GridView::of(grid).map_or(Pose::IDENTITY, |view| view.frame_from_grid())
}

/// Bounds of places without outliers, so that single ones far away do not decide what the scene is fitted to.
fn spread(places: impl ExactSizeIterator<Item = DVec3>) -> Option<[DVec3; 2]> {
    let every = (places.len() / MOST_PLACES).max(1);
    let places: Vec<DVec3> = places.step_by(every).filter(|p| p.is_finite()).collect();
    let last = places.len().checked_sub(1)?;
    let least = usize::from(places.len() >= MANY);
    let left_out = ((last as f64 * OUTLIERS).round() as usize).max(least);
    let along = |axis: usize| {
        let mut values: Vec<f64> = places.iter().map(|p| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        [values[left_out], values[last - left_out]]
    };
    let [x, y, z] = [0, 1, 2].map(along);
    Some([DVec3::new(x[0], y[0], z[0]), DVec3::new(x[1], y[1], z[1])])
}

fn floats(bytes: &mut Vec<u8>, p: DVec3) {
    for v in p.to_array() {
        bytes.extend((v as f32).to_ne_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use rcs_msg::{Stamp, foxglove};
    use rcs_runtime::source::Entity;

    #[test]
    fn every_plausible_point_becomes_an_instance_and_no_other() {
        let cloud = samples::cloud(&[[1.0, 2.0, 3.0], [f32::NAN, 0.0, 0.0], [1e30, 0.0, 0.0]]);
        let shapes = Shapes::cloud(&cloud, &CloudLook::default());
        let shapes = shapes.unwrap();
        assert_eq!(shapes.points.len(), POINT);
        assert_eq!(shapes.bounds, Some([DVec3::new(1.0, 2.0, 3.0); 2]));
    }

    #[test]
    fn coordinates_as_large_as_those_of_utm_keep_their_millimetres() {
        let utm = DVec3::new(308_200.125, 4_333_600.25, 180.0);
        let first = |bytes: &[u8]| {
            let number = |at: usize| f64::from(f32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap()));
            DVec3::new(number(0), number(4), number(8))
        };
        let mut track = Shapes::around(utm + DVec3::X * 50.0);
        track.strip([utm, utm + DVec3::Y * 0.001].into_iter(), Color32::RED, 1.0);
        let ends = [&track.lines[..], &track.lines[12..]].map(|bytes| track.origin() + first(bytes));
        assert!(ends[0].distance(utm) < 1e-4 && ends[1].distance(utm + DVec3::Y * 0.001) < 1e-4, "{ends:?}");

        let mut cloud = samples::cloud(&[[0.0, 0.0, 0.0], [0.25, 0.5, 0.75]]);
        let position = Some(foxglove::Vector3 { x: utm.x, y: utm.y, z: utm.z });
        cloud.pose = Some(foxglove::Pose { position, orientation: None });
        let shapes = Shapes::cloud(&cloud, &CloudLook::default()).unwrap();
        let last = shapes.origin() + first(&shapes.points[POINT..]);
        assert!(last.distance(utm + DVec3::new(0.25, 0.5, 0.75)) < 1e-4, "{last}");
    }

    #[test]
    fn a_single_place_far_away_is_no_bound() {
        let far = [[900.0, 0.0, 0.0]];
        let near: Vec<[f32; 3]> = (0..400).map(|i| [(i % 20) as f32, (i / 20) as f32, 0.0]).collect();
        let cloud = [near, far.to_vec()].concat();
        let cloud = samples::cloud(&cloud);
        let bounds = Shapes::cloud(&cloud, &CloudLook::default()).unwrap().bounds;
        assert_eq!(bounds, Some([DVec3::ZERO, DVec3::new(19.0, 19.0, 0.0)]));
        let mut path = Shapes::default();
        let places = (0..40).map(|i| if i == 39 { DVec3::X * 1e4 } else { DVec3::X * f64::from(i) });
        path.strip(places, Color32::RED, 1.0);
        let [min, max] = path.finish().bounds.unwrap();
        assert!(min.x <= 1.0 && max.x < 40.0, "{min} {max}");
        assert_eq!(spread([DVec3::ZERO, DVec3::X].into_iter()), Some([DVec3::ZERO, DVec3::X]));
        assert_eq!(spread([].into_iter()), None);
    }

    #[test]
    fn entities_become_lit_surfaces_and_lines_around_their_anchor() {
        let pose = |x: f64| {
            let position = Some(foxglove::Vector3 { x, y: 0.0, z: 0.0 });
            Some(foxglove::Pose { position, orientation: None })
        };
        let (size, color) = (Some(foxglove::Vector3 { x: 2.0, y: 2.0, z: 2.0 }), None);
        let end = |x: f64| foxglove::Point3 { x, y: 0.0, z: 0.0 };
        let points = vec![end(5e6), end(5e6 + 1.0), end(5e6 + 2.0)];
        let entity = foxglove::SceneEntity {
            cubes: vec![foxglove::CubePrimitive { pose: pose(5e6), size, color }],
            lines: vec![foxglove::LinePrimitive { points, ..Default::default() }],
            ..Default::default()
        };
        let entity = std::sync::Arc::new(Entity::new(entity, Stamp(0)));
        let placed = PlacedEntities(vec![(entity, Pose::IDENTITY)].into());
        let shapes = Shapes::entities(&placed);
        assert_eq!(shapes.lines.len(), 2 * LINE);
        assert_eq!(
            shapes.surfaces.len(),
            16 * 3 * CORNER,
            "four triangles at the bottom and the top, eight beside"
        );
        assert_eq!(shapes.bounds, Some([DVec3::splat(-1.0), DVec3::new(2.0, 1.0, 1.0)]));
        let mut shades: Vec<u8> = shapes.surfaces.chunks_exact(CORNER).map(|corner| corner[12]).collect();
        shades.sort_unstable();
        shades.dedup();
        assert!(shades.len() >= 4, "sides are told apart: {shades:?}");
    }

    #[test]
    fn a_line_is_interrupted_where_there_is_no_place() {
        let mut shapes = Shapes::default();
        let points = [DVec3::ZERO, DVec3::X, DVec3::NAN, DVec3::Y, DVec3::Y, DVec3::Z];
        shapes.strip(points.into_iter(), Color32::RED, 1.0);
        assert_eq!(shapes.lines.len(), 2 * LINE);
    }
}
