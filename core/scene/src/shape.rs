//! Convex shapes of which things consist, and their intersection with rays.
//!
//! Each shape is intersected as an interval along the ray, in the axes of the shape (rotated about z only). Foliage is
//! a volume of small cubes; a hash of a cube's position decides whether it contains a leaf, so that both cameras of a
//! pair see the same leaves. The fence is a panel with holes.

use crate::class::Class;
use crate::coat::Coat;
use crate::noise::{hash3, unit};
use crate::number::Number;

/// Coordinates are metres relative to the lattice's first sample.
pub(crate) type Vec3 = [f32; 3];

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Form {
    Ellipsoid,
    /// An axis along z.
    Column,
    /// An axis along its own x axis.
    Roll,
    Box,
    /// A panel with holes in its own x-z plane.
    Mesh,
}

/// One shape of a thing.
#[derive(Clone, Debug)]
pub(crate) struct Shape {
    pub(crate) form: Form,
    pub(crate) thing: u32,
    pub(crate) class: Class,
    pub(crate) middle: Vec3,
    /// Half sizes along its own axes, m.
    pub(crate) half: Vec3,
    /// Cosine and sine of its yaw.
    pub(crate) turn: [f32; 2],
    /// Size of the cubes of leaves, m; 0 for solid shapes.
    pub(crate) leaf_m: f32,
    pub(crate) coat: Coat,
    /// Height of the ground below the thing, m.
    pub(crate) ground_m: f32,
    /// Height of the complete thing, m.
    pub(crate) thing_height_m: f32,
}

/// Fraction of the cubes in foliage that contain a leaf.
const LEAVES: f32 = 0.6;
/// Greatest number of steps through foliage; a ray without a hit by then passes.
const LEAF_STEPS: usize = 8;
/// Size of the fence's meshes, m.
pub(crate) const MESH_M: f32 = 0.05;
/// Width of its strands as a fraction of that.
const STRAND: f32 = 0.14;
/// Fraction of the fence's area that is plastic.
pub(crate) const MESH_COVER: f32 = 1.0 - (1.0 - STRAND) * (1.0 - STRAND);
/// Width of the solid bands at its upper and lower edge, m.
const BAND_M: f32 = 0.03;

impl Shape {
    /// Radius of the bounding sphere, m.
    pub(crate) fn reach_m(&self) -> f32 {
        let [x, y, z] = self.half;
        match self.form {
            Form::Ellipsoid => x.max(y).max(z),
            Form::Column => (x * x + z * z).sqrt(),
            Form::Roll => (x * x + y * y).sqrt(),
            Form::Box | Form::Mesh => (x * x + y * y + z * z).sqrt(),
        }
    }

    /// Half size of the bounding box along x and y of the world, m.
    pub(crate) fn half_extent(&self) -> [f32; 2] {
        let [x, y, _] = self.half;
        let [c, s] = self.turn.map(f32::abs);
        [c * x + s * y, s * x + c * y]
    }

    #[inline]
    fn turned(&self, v: Vec3) -> Vec3 {
        let [c, s] = self.turn;
        [c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]]
    }

    /// The distance at which a ray hits the shape, if less than `nearest`, m.
    #[inline]
    pub(crate) fn meet(&self, origin: Vec3, direction: Vec3, nearest: f32) -> Option<f32> {
        let from = [origin[0] - self.middle[0], origin[1] - self.middle[1], origin[2] - self.middle[2]];
        let (o, d) = (self.turned(from), self.turned(direction));
        let [enter, leave] = match self.form {
            Form::Ellipsoid => ball(scaled(o, self.half), scaled(d, self.half))?,
            Form::Column => {
                let [x, y, z] = self.half;
                both(disc([o[0] / x, o[1] / y], [d[0] / x, d[1] / y])?, slab(o[2], d[2], z))?
            }
            Form::Roll => {
                let [x, y, z] = self.half;
                both(disc([o[1] / y, o[2] / z], [d[1] / y, d[2] / z])?, slab(o[0], d[0], x))?
            }
            Form::Box => {
                let [x, y, z] = self.half;
                both(both(slab(o[0], d[0], x), slab(o[1], d[1], y))?, slab(o[2], d[2], z))?
            }
            Form::Mesh => return self.strand(o, d, nearest),
        };
        if leave <= 0.0 || enter >= nearest {
            return None;
        }
        if self.leaf_m > 0.0 {
            return self.leaf(origin, direction, enter.larger(0.0), leave.smaller(nearest));
        }
        (enter > 0.0).then_some(enter)
    }

    /// The first leaf in an interval.
    #[inline]
    fn leaf(&self, origin: Vec3, direction: Vec3, enter: f32, leave: f32) -> Option<f32> {
        let step = 1.3 * self.leaf_m;
        let mut t = enter + 0.01;
        for _ in 0..LEAF_STEPS {
            if t >= leave {
                return None;
            }
            if unit(self.leaf_hash(along(origin, direction, t))) < LEAVES {
                return Some(t);
            }
            t += step;
        }
        None
    }

    /// Hash of the cube of leaves at a position.
    #[inline]
    pub(crate) fn leaf_hash(&self, at: Vec3) -> u32 {
        // Coordinates are positive except for rays from outside of the world, where one irregular row of cubes does no
        // harm.
        let scale = 1.0 / self.leaf_m;
        hash3((at[0] * scale) as i32, (at[1] * scale) as i32, ((at[2] + 64.0) * scale) as i32, 0x1EAF)
    }

    /// Where the ray crosses the panel, m.
    #[inline]
    pub(crate) fn crossing(&self, origin: Vec3, direction: Vec3) -> Option<(f32, [f32; 2])> {
        let from = [origin[0] - self.middle[0], origin[1] - self.middle[1], origin[2] - self.middle[2]];
        self.panel(self.turned(from), self.turned(direction))
    }

    #[inline]
    fn panel(&self, o: Vec3, d: Vec3) -> Option<(f32, [f32; 2])> {
        let t = -o[1] / d[1];
        let at = [o[0] + t * d[0], o[2] + t * d[2]];
        (t > 0.0 && t < 1e4 && at[0].abs() <= self.half[0] && at[1].abs() <= self.half[2]).then_some((t, at))
    }

    #[inline]
    fn strand(&self, o: Vec3, d: Vec3, nearest: f32) -> Option<f32> {
        let (t, at) = self.panel(o, d)?;
        if t >= nearest {
            return None;
        }
        let in_mesh = |v: f32| {
            let cells = (v + 64.0) * (1.0 / MESH_M);
            cells - (cells as i32) as f32
        };
        let band = self.half[2] - at[1].abs() < BAND_M;
        (band || in_mesh(at[0]) < STRAND || in_mesh(at[1]) < STRAND).then_some(t)
    }

    /// The outward unit normal at a point of the surface, in the world.
    #[inline]
    pub(crate) fn normal(&self, at: Vec3, direction: Vec3) -> Vec3 {
        let from = [at[0] - self.middle[0], at[1] - self.middle[1], at[2] - self.middle[2]];
        let p = scaled(self.turned(from), self.half);
        let n = match self.form {
            Form::Ellipsoid => scaled(p, self.half),
            Form::Column if p[2] > 0.9999 => [0.0, 0.0, 1.0],
            Form::Column => [p[0], p[1], 0.0],
            Form::Roll if p[0].abs() > 0.9999 => [p[0], 0.0, 0.0],
            Form::Roll => [0.0, p[1], p[2]],
            Form::Box => {
                let [x, y, z] = p.map(f32::abs);
                if x >= y && x >= z {
                    [p[0], 0.0, 0.0]
                } else if y >= z {
                    [0.0, p[1], 0.0]
                } else {
                    [0.0, 0.0, p[2]]
                }
            }
            Form::Mesh => [0.0, -self.turned(direction)[1], 0.0],
        };
        let [c, s] = self.turn;
        unit_length([c * n[0] - s * n[1], s * n[0] + c * n[1], n[2]])
    }
}

/// The point at a distance along a ray.
#[inline]
pub(crate) fn along(origin: Vec3, direction: Vec3, t: f32) -> Vec3 {
    [origin[0] + t * direction[0], origin[1] + t * direction[1], origin[2] + t * direction[2]]
}

/// Interpolates between two colours, multiplied by a factor.
#[inline]
pub(crate) fn between(a: &Vec3, b: &Vec3, part: f32, factor: f32) -> Vec3 {
    [
        (a[0] + (b[0] - a[0]) * part) * factor,
        (a[1] + (b[1] - a[1]) * part) * factor,
        (a[2] + (b[2] - a[2]) * part) * factor,
    ]
}

#[inline]
pub(crate) fn unit_length(v: Vec3) -> Vec3 {
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt().max(1e-12);
    [v[0] / length, v[1] / length, v[2] / length]
}

#[inline]
fn scaled(v: Vec3, half: Vec3) -> Vec3 {
    [v[0] / half[0], v[1] / half[1], v[2] / half[2]]
}

/// The interval in which a ray is within distance 1 of the origin. It is computed from the closest point, which keeps
/// precision for rays with a distant origin.
#[inline]
fn ball(o: Vec3, d: Vec3) -> Option<[f32; 2]> {
    let inverse = 1.0 / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    let t = -(o[0] * d[0] + o[1] * d[1] + o[2] * d[2]) * inverse;
    let p = [o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]];
    let within = 1.0 - (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    if within <= 0.0 {
        return None;
    }
    let half = (within * inverse).sqrt();
    Some([t - half, t + half])
}

/// The same in a plane; a ray without motion in the plane is inside always or never.
#[inline]
fn disc(o: [f32; 2], d: [f32; 2]) -> Option<[f32; 2]> {
    let inverse = 1.0 / (d[0] * d[0] + d[1] * d[1]).max(1e-12);
    let t = -(o[0] * d[0] + o[1] * d[1]) * inverse;
    let p = [o[0] + t * d[0], o[1] + t * d[1]];
    let within = 1.0 - (p[0] * p[0] + p[1] * p[1]);
    if within <= 0.0 {
        return None;
    }
    let half = (within * inverse).sqrt();
    Some([t - half, t + half])
}

/// The interval in which |o + t·d| ≤ half.
#[inline]
fn slab(o: f32, d: f32, half: f32) -> [f32; 2] {
    let inverse = 1.0 / if d.abs() < 1e-9 { 1e-9 } else { d };
    let ends = [(-half - o) * inverse, (half - o) * inverse];
    [ends[0].smaller(ends[1]), ends[0].larger(ends[1])]
}

#[inline]
fn both(a: [f32; 2], b: [f32; 2]) -> Option<[f32; 2]> {
    let [enter, leave] = [a[0].larger(b[0]), a[1].smaller(b[1])];
    (enter < leave).then_some([enter, leave])
}
