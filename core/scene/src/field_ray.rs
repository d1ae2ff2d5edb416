//! A ray over the lattice of the ground, and where it crosses borders, planes and the ground of a cell.
//!
//! The functions of [`Number`]s serve one ray and packets of rays.

use crate::number::Number;
use crate::terrain::{BLOCK, CELL_M, TILE};

pub(crate) const CELL: f32 = CELL_M as f32;
/// Tiles per side of a block.
pub(crate) const BLOCK_TILES: i32 = (BLOCK / TILE) as i32;

/// A ray in units of the lattice: cells horizontally, metres vertically and along the ray.
#[derive(Clone, Copy)]
pub(crate) struct FieldRay {
    pub(crate) o: [f32; 3],
    pub(crate) d: [f32; 3],
    /// 1 / d of the first two axes; huge where d is 0.
    pub(crate) inverse: [f32; 2],
    pub(crate) step: [i32; 2],
    /// 1 if the ray leaves a cell through its far side.
    pub(crate) far: [i32; 2],
    /// Square of the length of the first two components of d.
    pub(crate) run2: f32,
}

/// Where the traversal of a ray is: in a square from distance `t` on.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    pub(crate) square: [i32; 2],
    pub(crate) t: f32,
}

impl FieldRay {
    /// From an origin in metres relative to the first sample, and a unit direction.
    pub(crate) fn new(origin_m: [f32; 3], direction: [f32; 3]) -> FieldRay {
        let d = in_cells(direction);
        let still = [d[0].abs() < 1e-6, d[1].abs() < 1e-6];
        let inverse = |axis: usize| if still[axis] { 1e12 } else { 1.0 / d[axis] };
        let far = |axis: usize| still[axis] || d[axis] >= 0.0;
        FieldRay::of(in_cells(origin_m), d, [inverse(0), inverse(1)], [far(0), far(1)])
    }

    /// From its parts in units of the lattice; `far` says whether it leaves squares through their far side.
    pub(crate) fn of(o: [f32; 3], d: [f32; 3], inverse: [f32; 2], far: [bool; 2]) -> FieldRay {
        let far = far.map(i32::from);
        let step = far.map(|far| 2 * far - 1);
        FieldRay { o, d, inverse, step, far, run2: (d[0] * d[0] + d[1] * d[1]).max(1e-12) }
    }

    #[inline]
    pub(crate) fn at(&self, t: f32) -> [f32; 2] {
        [self.o[0] + t * self.d[0], self.o[1] + t * self.d[1]]
    }

    /// Distance at which the ray leaves square `index` of `side` cells along one axis.
    #[inline]
    pub(crate) fn leaves(&self, axis: usize, index: i32, side: f32) -> f32 {
        border_distance((index + self.far[axis]) as f32, side, self.o[axis], self.inverse[axis])
    }

    /// Where the ray, which may be above a plane at `t`, crosses it before `until`.
    #[inline]
    pub(crate) fn goes_under(&self, plane: &[f32; 4], t: f32, until: f32) -> Option<f32> {
        let [above, rate] = above_plane(self.o, self.d, [plane[0], plane[1], plane[2]]);
        let (first, last) = (above + rate * t, above + rate * until);
        if first > 0.0 && last > 0.0 {
            None
        } else if first > 0.0 {
            Some(crossing([t, first], [until, last]))
        } else {
            Some(t)
        }
    }

    /// Height above the ground of a cell, m.
    #[inline]
    pub(crate) fn above_cell(&self, cell: [i32; 2], corners: &[f32; 4], t: f32) -> f32 {
        above_corners(self.at(t), self.o[2] + t * self.d[2], cell.map(|index| index as f32), corners)
    }
}

impl Place {
    /// The tile of a block in which a ray is at a distance.
    #[inline]
    pub(crate) fn tile_at(ray: &FieldRay, block: [i32; 2], t: f32) -> Place {
        let at = ray.at(t);
        let square = [0, 1].map(|axis| {
            let low = block[axis] * BLOCK_TILES;
            ((at[axis] * (1.0 / TILE as f32)) as i32).clamp(low, low + BLOCK_TILES - 1)
        });
        Place { square, t }
    }
}

/// Metres in units of the lattice.
#[inline]
pub(crate) fn in_cells<N: Number>(m: [N; 3]) -> [N; 3] {
    [m[0] * N::of(1.0 / CELL), m[1] * N::of(1.0 / CELL), m[2]]
}

/// The part of a ray above a lattice of `size` cells.
#[inline]
pub(crate) fn span<N: Number>(size: [f32; 2], o: [N; 2], inverse: [N; 2]) -> [N; 2] {
    let mut span = [N::of(0.0), N::of(f32::MAX)];
    for axis in 0..2 {
        let ends = [0.0, size[axis]].map(|end| (N::of(end) - o[axis]) * inverse[axis]);
        span = [span[0].larger(ends[0].smaller(ends[1])), span[1].smaller(ends[0].larger(ends[1]))];
    }
    span
}

/// Distance at which a ray crosses the border with this index between squares of `side` cells, along one axis.
#[inline]
pub(crate) fn border_distance<N: Number>(border: N, side: f32, o: N, inverse: N) -> N {
    (border * N::of(side) - o) * inverse
}

/// Height of a ray above a plane at t = 0, and its derivative with respect to t. The plane is a constant and its slopes
/// along x and y.
#[inline]
pub(crate) fn above_plane<N: Number>(o: [N; 3], d: [N; 3], plane: [N; 3]) -> [N; 2] {
    [o[2] - plane[0] - plane[1] * o[0] - plane[2] * o[1], d[2] - plane[1] * d[0] - plane[2] * d[1]]
}

/// Height of a point above the ground of a cell, m, by the heights of its corners: the lower two, then the upper two.
#[inline]
pub(crate) fn above_corners<N: Number>(at: [N; 2], z: N, cell: [N; 2], corners: &[N; 4]) -> N {
    let part = |axis: usize| (at[axis] - cell[axis]).larger(N::of(0.0)).smaller(N::of(1.0));
    let low = corners[0] + part(0) * (corners[1] - corners[0]);
    let high = corners[2] + part(0) * (corners[3] - corners[2]);
    z - (low + part(1) * (high - low))
}

/// Where a ray crosses the ground of a cell between two distances, each with its height there: at the first it is above
/// the ground, at the second it is not. `above` gives its height at a distance.
#[inline]
pub(crate) fn meet<N: Number>(above: impl Fn(N) -> N, a: [N; 2], b: [N; 2]) -> N {
    let first = crossing(a, b);
    let height = above(first);
    let middle = [first, height];
    let second = height.if_above(0.0, crossing(middle, b), crossing(a, middle));
    // Within a cell the ground below a ray is a parabola, and nearly always close to a line: then the first step
    // suffices.
    height.abs().if_above(5e-5, second, first)
}

/// Zero crossing of a line between two heights, of which the first is above 0 and the second is not.
#[inline]
pub(crate) fn crossing<N: Number>([a, above_a]: [N; 2], [b, above_b]: [N; 2]) -> N {
    (a + (b - a) * (above_a / (above_a - above_b).larger(N::of(1e-12)))).larger(a).smaller(b)
}
