//! Renders the image of a camera.
//!
//! Pixels are processed in bundles of 8×8. For each bundle the shapes that its cone can hit and the distance over which
//! it is clear of the ground are determined once; each ray then tests those shapes. From that distance on, the rays of
//! four neighbouring pixels traverse the ground together. Both steps only skip what no ray of the bundle can hit, and
//! bundles have fixed positions in the image. So the way in which an image is cut into strips does not change the
//! result.

use std::ops::Range;

use glam::Vec4;
use rcs_geom::Pose;

use crate::camera::{BUNDLE, CameraRays, Cone, GROUP};
use crate::class::{Class, Label, Surface};
use crate::looks::{Looks, Seen};
use crate::packet::{LANES, Packet};
use crate::shape::{Form, MESH_COVER, Shape, Vec3, along, between};
use crate::trace::Met;
use crate::world::{Inner, World};

/// Beyond this distance only the sky is visible, m.
pub const CAMERA_RANGE_M: f64 = 300.0;
const RANGE: f32 = CAMERA_RANGE_M as f32;
/// Beyond this pixel width the strands of a fence blend with the background, m.
const BLEND_M: f32 = 0.012;

/// Buffers for some rows of a view, by rows, the first row of the strip first.
pub struct ViewRows<'a> {
    /// Red, green, blue: three bytes per pixel.
    pub rgb: &'a mut [u8],
    /// Depth along the optical axis, m; NaN where there is none.
    pub depth_m: &'a mut [f32],
    /// Codes of [`Class`].
    pub class: &'a mut [u8],
    /// Codes of [`Label`].
    pub label: &'a mut [u8],
}

/// Renders some rows of a camera's image. `sunlight` is the share of the sun's light that the clouds let through, 1
/// under a clear sky. Rows and pixels beyond the size of `out` are left out.
pub fn render_rows(
    world: &World,
    rays: &CameraRays,
    global_from_camera: &Pose,
    sunlight: f32,
    rows: Range<usize>,
    out: &mut ViewRows<'_>,
) {
    let rows = rows.start..rows.end.min(rays.height());
    let held = [out.rgb.len() / 3, out.depth_m.len(), out.class.len(), out.label.len()];
    let held_rows = held.into_iter().min().unwrap_or(0) / rays.width().max(1);
    let rows = rows.start..rows.end.min(rows.start + held_rows);
    if rows.is_empty() || !global_from_camera.is_finite() {
        return;
    }
    let view = View::new(world, rays, global_from_camera, sunlight);
    let mut near = Vec::new();
    let mut nearer = Vec::new();
    for bundle_row in rows.start / BUNDLE..=(rows.end - 1) / BUNDLE {
        for column in 0..rays.bundles_across() {
            if column % GROUP == 0 {
                view.shapes_near(rays.group(column, bundle_row), &view.reach, &mut near);
            }
            view.shapes_near(rays.bundle(column, bundle_row), &near, &mut nearer);
            view.bundle(column, bundle_row, &rows, &nearer, out);
        }
    }
}

/// Bounding sphere of a shape relative to the camera.
#[derive(Clone, Copy)]
struct Ball {
    shape: u32,
    /// Centre relative to the camera, in the global frame, m.
    middle: Vec3,
    reach_m: f32,
    /// No ray hits it closer than this, m.
    nearest_m: f32,
}

struct View<'v> {
    inner: &'v Inner,
    rays: &'v CameraRays,
    origin: Vec3,
    /// Rows of the rotation matrix from the optical frame to the global one.
    turn: [Vec3; 3],
    reach: Vec<Ball>,
    passable: [bool; 16],
    sunlight: f32,
}

/// The hit of a ray.
#[derive(Clone, Copy)]
struct Found {
    t: f32,
    met: Option<Met>,
}

/// What a ray hits first.
#[derive(Clone, Copy)]
struct Front {
    solid: Found,
    /// The fence is blended over what is behind it: distance and index of the nearest shape of a fence.
    veil: Option<(f32, u32)>,
    /// The nearest strand of a fence, where the ray may end.
    strand: Found,
}

impl Front {
    const NOTHING: Front =
        Front { solid: Found { t: RANGE, met: None }, veil: None, strand: Found { t: RANGE, met: None } };
}

impl<'v> View<'v> {
    fn new(world: &'v World, rays: &'v CameraRays, pose: &Pose, sunlight: f32) -> View<'v> {
        let inner = &*world.inner;
        let origin = world.local(pose.translation);
        let columns = pose.rotation_matrix().to_cols_array_2d();
        let turn = [0, 1, 2].map(|row| [0, 1, 2].map(|column| columns[column][row] as f32));
        let ball = |(number, shape): (usize, &Shape)| {
            let middle = [0, 1, 2].map(|axis| shape.middle[axis] - origin[axis]);
            let reach_m = shape.reach_m();
            let nearest_m = dot(&middle, middle).sqrt() - reach_m;
            Ball { shape: number as u32, middle, reach_m, nearest_m }
        };
        let mut passable = [true; 16];
        for surface in Surface::ALL {
            passable[surface as usize] = world.material(surface).passable;
        }
        let mut reach: Vec<Ball> = inner.shapes.iter().enumerate().map(ball).collect();
        // Near ones first, because what they hide need not be tested.
        reach.sort_by(|a, b| a.nearest_m.total_cmp(&b.nearest_m));
        View { inner, rays, origin, turn, reach, passable, sunlight: sunlight.clamp(0.0, 1.0) }
    }

    #[inline]
    fn turned(&self, v: Vec3) -> Vec3 {
        let [x, y, z] = &self.turn;
        [dot(x, v), dot(y, v), dot(z, v)]
    }

    /// The spheres that a cone may hit.
    fn shapes_near(&self, cone: &Cone, among: &[Ball], near: &mut Vec<Ball>) {
        near.clear();
        let axis = self.turned(cone.axis);
        for ball in among {
            let m = ball.middle;
            let along = m[0] * axis[0] + m[1] * axis[1] + m[2] * axis[2];
            let distance2 = m[0] * m[0] + m[1] * m[1] + m[2] * m[2];
            // A ray stays within spread · distance of the axis at the same distance, and hits the sphere at most at the
            // distance of its centre plus its radius.
            let reach = ball.reach_m + cone.spread * (distance2.sqrt() + ball.reach_m);
            let aside2 = distance2 - along * along;
            let before = along > 0.0 || distance2 <= reach * reach;
            if before && aside2 <= reach * reach * 1.0001 + 1e-4 {
                near.push(*ball);
            }
        }
    }

    fn bundle(
        &self,
        column: usize,
        bundle_row: usize,
        rows: &Range<usize>,
        near: &[Ball],
        out: &mut ViewRows<'_>,
    ) {
        let cone = self.rays.bundle(column, bundle_row);
        let clear = self.inner.field.clear_until(self.origin, self.turned(cone.axis), cone.spread);
        let first = (bundle_row * BUNDLE).max(rows.start);
        let columns = self.rays.columns_of(column);
        for row in first..((bundle_row + 1) * BUNDLE).min(rows.end) {
            let at = (row - rows.start) * self.rays.width() + columns.start;
            for (number, rays) in self.rays.row(row, &columns).chunks(LANES).enumerate() {
                self.packet(rays, near, clear, at + number * LANES, out);
            }
        }
    }

    /// Neighbouring pixels of a row, at most those of a packet; the first is that at `at` of the buffers.
    fn packet(&self, rays: &[Vec3], near: &[Ball], clear: f32, at: usize, out: &mut ViewRows<'_>) {
        let mut d = [[0.0; 3]; LANES];
        let mut found = [Front::NOTHING; LANES];
        let mut nearest = [0.0; LANES];
        for (lane, ray) in rays.iter().enumerate() {
            d[lane] = self.turned(*ray);
            if ray[2] > 0.0 {
                self.shapes(d[lane], near, &mut found[lane]);
                nearest[lane] = found[lane].solid.t;
            }
        }
        if nearest.iter().any(|nearest| clear < *nearest) {
            let directions = [0, 1, 2].map(|axis| Vec4::from_array(d.map(|d| d[axis])));
            let hits = self.inner.field.cast_packet(&Packet::new(self.origin, directions), clear, nearest);
            for (front, hit) in found.iter_mut().zip(hits) {
                if let Some(hit) = hit
                    && hit.t < front.solid.t
                {
                    front.solid = Found { t: hit.t, met: Some(Met::Field(hit)) };
                }
            }
        }
        for (lane, (ray, front)) in rays.iter().zip(&mut found).enumerate() {
            self.pixel(*ray, d[lane], front, at + lane, out);
        }
    }

    /// The shapes that a ray hits first.
    #[inline]
    fn shapes(&self, d: Vec3, near: &[Ball], front: &mut Front) {
        for ball in near {
            if ball.nearest_m >= front.solid.t {
                break;
            }
            let shape = &self.inner.shapes[ball.shape as usize];
            if shape.form == Form::Mesh {
                self.fence(shape, ball.shape, d, &mut front.veil, &mut front.strand);
            } else if let Some(t) = shape.meet(self.origin, d, front.solid.t) {
                front.solid = Found { t, met: Some(Met::Shape(ball.shape)) };
            }
        }
    }

    #[inline]
    fn pixel(&self, ray: Vec3, d: Vec3, front: &mut Front, at: usize, out: &mut ViewRows<'_>) {
        if ray[2] <= 0.0 {
            return put(out, at, [0.0; 3], f32::NAN, Class::Sky, Label::Invalid);
        }
        let Front { solid, veil, strand } = front;
        // The plain is behind any ground that a ray hits.
        if !matches!(solid.met, Some(Met::Field(_)))
            && let Some(t) = self.inner.plain(self.origin, d, solid.t)
        {
            *solid = Found { t, met: Some(Met::Plain) };
        }
        let mut colour = self.colour(solid, d);
        let mut seen = &*solid;
        if strand.t < solid.t {
            seen = strand;
        }
        if let Some((t, shape)) = *veil
            && t < solid.t
        {
            let blended = t * self.rays.pixel_rad > BLEND_M;
            let cover = if blended { MESH_COVER } else { f32::from(u8::from(strand.t < solid.t)) };
            let orange = self.colour(&Found { t, met: Some(Met::Shape(shape)) }, d);
            colour = between(&colour, &orange, cover, 1.0);
        }
        let Some(met) = seen.met else {
            return put(out, at, colour, f32::NAN, Class::Sky, Label::Invalid);
        };
        let point = self.point(seen.t, d);
        let (class, _) = self.inner.class(met, point);
        put(out, at, colour, seen.t * ray[2], class, self.inner.label(met, point, &self.passable));
    }

    #[inline]
    fn fence(&self, shape: &Shape, number: u32, d: Vec3, veil: &mut Option<(f32, u32)>, strand: &mut Found) {
        if let Some((t, _)) = shape.crossing(self.origin, d)
            && veil.is_none_or(|(nearest, _)| t < nearest)
        {
            *veil = Some((t, number));
        }
        if let Some(t) = shape.meet(self.origin, d, strand.t) {
            *strand = Found { t, met: Some(Met::Shape(number)) };
        }
    }

    #[inline]
    fn point(&self, t: f32, d: Vec3) -> Vec3 {
        along(self.origin, d, t)
    }

    #[inline]
    fn colour(&self, found: &Found, d: Vec3) -> Vec3 {
        let looks = &self.inner.looks;
        let Some(met) = found.met else { return looks.sky(d) };
        let seen = Seen {
            at: self.point(found.t, d),
            direction: d,
            footprint_m: found.t * self.rays.pixel_rad,
            sunlight: self.sunlight,
        };
        let colour = match met {
            Met::Field(hit) => looks.field(&self.inner.field, &hit, &seen),
            Met::Shape(shape) => looks.shape(&self.inner.shapes[shape as usize], &seen),
            Met::Plain => looks.plain(&seen),
        };
        Looks::hazed(colour, found.t)
    }
}

#[inline]
fn put(out: &mut ViewRows<'_>, at: usize, colour: Vec3, depth_m: f32, class: Class, label: Label) {
    out.rgb[3 * at..3 * at + 3].copy_from_slice(&[colour[0] as u8, colour[1] as u8, colour[2] as u8]);
    out.depth_m[at] = depth_m;
    out.class[at] = class.code();
    out.label[at] = label.code();
}

#[inline]
fn dot(row: &Vec3, v: Vec3) -> f32 {
    row[0] * v[0] + row[1] * v[1] + row[2] * v[2]
}
