//! Shapes by the square of ground below them.

use crate::shape::{Shape, Vec3};
use crate::terrain::{CELL_M, Lattice};
use rcs_geom::DVec2;

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
    pub(crate) fn cast(&self, shapes: &[Shape], o: Vec3, d: Vec3, nearest: f32) -> Option<(f32, u32)> {
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
