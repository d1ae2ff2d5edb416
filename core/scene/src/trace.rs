//! Casts one ray: the nearest hit among ground, vegetation, things, and the plain outside.

use rcs_geom::DVec3;

use crate::class::{COVER_M, Class, Label, SHORT_M, Surface};
use crate::field_ray::FieldRay;
use crate::heightfield::FieldHit;
use crate::shape::Vec3;
use crate::terrain::CELL_M;
use crate::world::{Inner, World};

/// The hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, m.
    pub range_m: f64,
    /// Position in the global frame, m.
    pub point: DVec3,
    /// Its class.
    pub class: Class,
    /// The thing that was hit.
    pub thing: Option<u32>,
}

/// A hit without its appearance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Met {
    Field(FieldHit),
    /// Index of the shape.
    Shape(u32),
    Plain,
}

impl Inner {
    /// Where a ray hits the plain outside of the lattice, before `nearest`.
    #[inline]
    pub(crate) fn plain(&self, o: Vec3, d: Vec3, nearest: f32) -> Option<f32> {
        if d[2] >= -1e-6 {
            return None;
        }
        let t = -o[2] / d[2];
        let within = |axis: usize| {
            let at = o[axis] + t * d[axis];
            at >= 0.0 && at <= self.field.lattice.cells[axis] as f32 * CELL_M as f32
        };
        (t > 0.0 && t < nearest && !(within(0) && within(1))).then_some(t)
    }

    /// Class and thing of a hit.
    #[inline]
    pub(crate) fn class(&self, met: Met, at: Vec3) -> (Class, Option<u32>) {
        match met {
            Met::Shape(shape) => {
                let shape = &self.shapes[shape as usize];
                (shape.class, Some(shape.thing))
            }
            Met::Field(hit) => (self.surface(&hit, at).class(), None),
            Met::Plain => (Surface::from_code(self.field.lattice.surface[0]).class(), None),
        }
    }

    #[inline]
    fn surface(&self, hit: &FieldHit, at: Vec3) -> Surface {
        let lattice = &self.field.lattice;
        let nearer = |axis: usize| {
            usize::from(hit.stem < 0.0 && at[axis] / CELL_M as f32 - hit.cell[axis] as f32 >= 0.5)
        };
        Surface::from_code(
            lattice.surface
                [(hit.cell[1] as usize + nearer(1)) * lattice.width + hit.cell[0] as usize + nearer(0)],
        )
    }

    /// The ground truth's obstacle label of a hit.
    #[inline]
    pub(crate) fn label(&self, met: Met, at: Vec3, passable: &[bool; 16]) -> Label {
        match met {
            Met::Plain => Label::Ground,
            Met::Shape(shape) => {
                let shape = &self.shapes[shape as usize];
                if shape.thing_height_m < SHORT_M as f32 {
                    Label::Short
                } else if at[2] - shape.ground_m >= COVER_M as f32 {
                    Label::Cover
                } else {
                    Label::Obstacle
                }
            }
            Met::Field(hit) if hit.stem >= 0.0 => {
                if passable[self.surface(&hit, at) as usize] {
                    Label::Ground
                } else {
                    Label::Obstacle
                }
            }
            Met::Field(hit) => {
                let [a, b, c, d] = self.field.cell_corners(hit.cell);
                let slope = [0.5 * (b - a + d - c), 0.5 * (c - a + d - b)];
                let steep2 = (CELL_M * CELL_M) as f32;
                if slope[0] * slope[0] + slope[1] * slope[1] > steep2 {
                    Label::Obstacle
                } else {
                    Label::Ground
                }
            }
        }
    }
}

impl World {
    /// The first thing, stem or ground that a ray hits: what a ladar or an infrared sensor measures. `direction` need
    /// not be normalised. The same ray always has the same result, because the positions of stems and leaves are
    /// hashes. `None` if nothing is within `max_range_m`, and for numbers that are not finite.
    pub fn cast(&self, origin: DVec3, direction: DVec3, max_range_m: f64) -> Option<Hit> {
        let length = direction.length();
        if !(origin.is_finite() && length.is_finite() && length > 1e-9 && max_range_m > 0.0) {
            return None;
        }
        let unit = direction / length;
        let d = [unit.x as f32, unit.y as f32, unit.z as f32];
        let o = self.local(origin);
        let inner = &*self.inner;
        let mut nearest = max_range_m.min(1e4) as f32;
        let mut met = None;
        if let Some((t, shape)) = inner.grid.cast(&inner.shapes, o, d, nearest) {
            (nearest, met) = (t, Some(Met::Shape(shape)));
        }
        if let Some(hit) = inner.field.cast(&FieldRay::new(o, d), 0.0, nearest)
            && hit.t < nearest
        {
            (nearest, met) = (hit.t, Some(Met::Field(hit)));
        }
        if let Some(t) = inner.plain(o, d, nearest) {
            (nearest, met) = (t, Some(Met::Plain));
        }
        let at = [0, 1, 2].map(|axis| o[axis] + nearest * d[axis]);
        let (class, thing) = inner.class(met?, at);
        let range_m = f64::from(nearest);
        Some(Hit { range_m, point: origin + unit * range_m, class, thing })
    }
}
