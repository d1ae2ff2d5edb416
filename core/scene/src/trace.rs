//! Casts one ray: the nearest hit among ground, vegetation, things, and the plain outside.

use rcs_geom::{DVec2, DVec3};

use crate::class::{COVER_M, Class, Label, SHORT_M, Surface};
use crate::heightfield::{FieldHit, FieldRay};
use crate::shape::{Shape, Vec3};
use crate::terrain::{CELL_M, Lattice};
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

/// Shapes by the squares of ground below them, for single rays and bodies.
pub(crate) struct ShapeGrid {
    size: [usize; 2],
    /// First entry of each square in `entries`, with the end appended.
    starts: Vec<u32>,
    entries: Vec<u32>,
    /// The thing of each shape.
    things: Vec<u32>,
}

/// Size of a square, m.
const SQUARE_M: f32 = 2.0;

impl ShapeGrid {
    pub(crate) fn new(shapes: &[Shape], lattice: &Lattice) -> ShapeGrid {
        let side = |cells: usize| ((cells as f32 * CELL_M as f32) / SQUARE_M).ceil().max(1.0) as usize;
        let size = lattice.cells.map(side);
        let mut squares: Vec<Vec<u32>> = vec![Vec::new(); size[0] * size[1]];
        for (number, shape) in shapes.iter().enumerate() {
            let reach = shape.half_extent();
            let index = |axis: usize, sign: f32| {
                let at = (shape.middle[axis] + sign * (reach[axis] + 0.01)) / SQUARE_M;
                (at.max(0.0) as usize).min(size[axis] - 1)
            };
            for row in index(1, -1.0)..=index(1, 1.0) {
                for column in index(0, -1.0)..=index(0, 1.0) {
                    squares[row * size[0] + column].push(number as u32);
                }
            }
        }
        let mut starts = vec![0];
        let mut entries = Vec::new();
        for square in squares {
            entries.extend(square);
            starts.push(entries.len() as u32);
        }
        ShapeGrid { size, starts, entries, things: shapes.iter().map(|shape| shape.thing).collect() }
    }

    fn square(&self, column: usize, row: usize) -> &[u32] {
        let at = row * self.size[0] + column;
        &self.entries[self.starts[at] as usize..self.starts[at + 1] as usize]
    }

    /// Indices of the things with a shape near a rectangle (metres from the first sample), ascending, each once.
    pub(crate) fn things_near(&self, low: DVec2, high: DVec2) -> Vec<u32> {
        let index = |value: f64, axis: usize| {
            ((value / f64::from(SQUARE_M)).max(0.0) as usize).min(self.size[axis] - 1)
        };
        let mut near = Vec::new();
        for row in index(low.y, 1)..=index(high.y, 1) {
            for column in index(low.x, 0)..=index(high.x, 0) {
                near.extend(self.square(column, row).iter().map(|&shape| self.things[shape as usize]));
            }
        }
        near.sort_unstable();
        near.dedup();
        near
    }

    /// The first shape that a ray hits before `nearest`.
    fn cast(&self, shapes: &[Shape], o: Vec3, d: Vec3, nearest: f32) -> Option<(f32, u32)> {
        let inverse = [d[0], d[1]].map(|d| if d.abs() < 1e-9 { 1e12 } else { 1.0 / d });
        let mut span = [0.0_f32, nearest];
        for axis in 0..2 {
            let ends = [0.0, self.size[axis] as f32 * SQUARE_M].map(|end| (end - o[axis]) * inverse[axis]);
            span = [span[0].max(ends[0].min(ends[1])), span[1].min(ends[0].max(ends[1]))];
        }
        if span[0] >= span[1] {
            return None;
        }
        let mut best: Option<(f32, u32)> = None;
        let mut square = [0, 1].map(|axis| {
            let at = (o[axis] + span[0] * d[axis]) / SQUARE_M;
            (at.max(0.0) as i32).min(self.size[axis] as i32 - 1)
        });
        loop {
            for &shape in self.square(square[0] as usize, square[1] as usize) {
                let limit = best.map_or(nearest, |best| best.0);
                if let Some(t) = shapes[shape as usize].meet(o, d, limit) {
                    best = Some((t, shape));
                }
            }
            let leaves = [0, 1].map(|axis| {
                let far = square[axis] + i32::from(inverse[axis] >= 0.0);
                (far as f32 * SQUARE_M - o[axis]) * inverse[axis]
            });
            let axis = usize::from(leaves[1] < leaves[0]);
            square[axis] += if inverse[axis] >= 0.0 { 1 } else { -1 };
            let over = best.is_some_and(|best| best.0 <= leaves[axis]) || leaves[axis] >= span[1];
            if over || square[axis] < 0 || square[axis] >= self.size[axis] as i32 {
                return best;
            }
        }
    }
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
