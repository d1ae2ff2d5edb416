//! Casts the rays of four neighbouring pixels at the ground together.
//!
//! Most rays of a camera hit the ground in the first cell after they cross the plane of a tile. This case is computed
//! for all rays of a packet at once, without branches. A ray that does not hit the ground there goes on alone, from the
//! tile that it has reached. Each number results from the same operations as in [`HeightField::cast`], so the hits are
//! the same to the last bit.

use glam::{BVec4A, Mat4, Vec4};

use crate::field_ray::{
    BLOCK_TILES, FieldRay, Place, above_corners, above_plane, border_distance, crossing, in_cells, meet, span,
};
use crate::heightfield::{FieldHit, HeightField};
use crate::number::Number;
use crate::shape::Vec3;
use crate::terrain::{BLOCK, TILE};

/// Rays in a packet.
pub(crate) const LANES: usize = 4;
/// Squares of one size that a packet traverses at most.
const STEPS: usize = 4;

/// Rays from one origin, in units of the lattice as those of [`FieldRay`].
pub(crate) struct Packet {
    o: [f32; 3],
    d: [Vec4; 3],
    inverse: [Vec4; 2],
    /// 1 where a ray leaves a square through its far side, else 0.
    far: [Vec4; 2],
}

/// The traversal of squares of one size.
struct Walk {
    side: f32,
    /// Least and greatest index.
    bounds: [[Vec4; 2]; 2],
    /// Indices of the squares in which the rays are, from the distance `from` on.
    square: [Vec4; 2],
    from: Vec4,
    /// Where a ray leaves its square, or ends.
    until: Vec4,
    end: Vec4,
    /// Where a ray crosses the plane of its square.
    enters: Vec4,
    /// Whether a ray has stayed above all planes so far.
    above: BVec4A,
    /// Whether there are stems below the plane of a ray's square.
    grows: BVec4A,
    /// Whether a ray has ended, or has left the squares.
    out: BVec4A,
}

impl Packet {
    /// From an origin in metres relative to the first sample, and the components of unit directions.
    pub(crate) fn new(origin_m: Vec3, directions: [Vec4; 3]) -> Packet {
        let d = in_cells(directions);
        let [(inverse_x, far_x), (inverse_y, far_y)] = [d[0], d[1]].map(|d| {
            let still = d.abs().cmplt(Vec4::splat(1e-6));
            let inverse = Vec4::select(still, Vec4::splat(1e12), Vec4::ONE / d);
            (inverse, Vec4::select(still | d.cmpge(Vec4::ZERO), Vec4::ONE, Vec4::ZERO))
        });
        Packet { o: in_cells(origin_m), d, inverse: [inverse_x, inverse_y], far: [far_x, far_y] }
    }

    /// One of the rays.
    fn ray(&self, lane: usize) -> FieldRay {
        let inverse = self.inverse.map(|inverse| inverse[lane]);
        FieldRay::of(self.o, self.d.map(|d| d[lane]), inverse, self.far.map(|far| far[lane] > 0.0))
    }

    #[inline]
    fn o(&self) -> [Vec4; 3] {
        self.o.map(Vec4::splat)
    }

    #[inline]
    fn at(&self, t: Vec4) -> [Vec4; 2] {
        let [x, y, _] = self.o();
        [x + t * self.d[0], y + t * self.d[1]]
    }

    /// Begins a traversal where the rays are at `from`.
    #[inline]
    fn walk(&self, side: usize, bounds: [[Vec4; 2]; 2], from: Vec4, end: Vec4) -> Walk {
        let side = side as f32;
        let at = self.at(from);
        let [low, high] = bounds;
        let square =
            [0, 1].map(|axis| (at[axis] * (1.0 / side)).larger(low[axis]).smaller(high[axis]).trunc());
        let none = BVec4A::FALSE;
        Walk {
            side,
            bounds,
            square,
            from,
            until: end,
            end,
            enters: from,
            above: none,
            grows: none,
            out: none,
        }
    }
}

impl Walk {
    /// Lets each ray go on until it crosses the plane of a square, through [`STEPS`] squares at most. A ray that is
    /// `above` then is in the next square.
    #[inline]
    fn go_under(&mut self, rays: &Packet, planes: impl Fn([usize; 2]) -> [f32; 4]) {
        for _ in 0..STEPS {
            let [constant, slope_x, slope_y, grows] = self.of_squares(&planes);
            self.grows = grows.cmpgt(Vec4::ZERO);
            let exits = [0, 1].map(|axis| {
                border_distance(
                    self.square[axis] + rays.far[axis],
                    self.side,
                    rays.o()[axis],
                    rays.inverse[axis],
                )
            });
            self.until = exits[0].smaller(exits[1]).smaller(self.end);
            let [height, rate] = above_plane(rays.o(), rays.d, [constant, slope_x, slope_y]);
            let (first, last) = (height + rate * self.from, height + rate * self.until);
            let below = crossing([self.from, first], [self.until, last]);
            self.enters = first.if_above(0.0, below, self.from);
            self.above = first.cmpgt(Vec4::ZERO) & last.cmpgt(Vec4::ZERO) & !self.out;
            if !self.above.any() {
                return;
            }
            self.advance(rays, exits);
        }
    }

    /// Lets the rays that stay above the planes of their squares go to the next ones.
    #[inline]
    fn advance(&mut self, rays: &Packet, exits: [Vec4; 2]) {
        let along_y = exits[1].cmplt(exits[0]);
        let [low, high] = self.bounds;
        let step = rays.far.map(|far| far + far - Vec4::ONE);
        let next = [
            self.square[0] + Vec4::select(along_y, Vec4::ZERO, step[0]),
            self.square[1] + Vec4::select(along_y, step[1], Vec4::ZERO),
        ];
        let outside = |axis: usize| next[axis].cmplt(low[axis]) | next[axis].cmpgt(high[axis]);
        let from = self.from.larger(self.until);
        self.from = Vec4::select(self.above, from, self.from);
        self.out |= self.above & (from.cmpge(self.end) | outside(0) | outside(1));
        let moves = self.above & !self.out;
        self.square = [0, 1].map(|axis| Vec4::select(moves, next[axis], self.square[axis]));
    }

    /// Four numbers of each square, by number.
    #[inline]
    fn of_squares(&self, numbers: impl Fn([usize; 2]) -> [f32; 4]) -> [Vec4; 4] {
        let [i, j] = self.square.map(indices);
        let row = |lane: usize| Vec4::from_array(numbers([i[lane], j[lane]]));
        let columns = Mat4::from_cols(row(0), row(1), row(2), row(3)).transpose();
        [columns.x_axis, columns.y_axis, columns.z_axis, columns.w_axis]
    }

    fn place(&self, lane: usize) -> Place {
        Place { square: self.square.map(|square| square[lane] as i32), t: self.from[lane] }
    }
}

impl HeightField {
    /// The first hit of each ray of a packet between a common distance and one of its own, m.
    pub(crate) fn cast_packet(
        &self,
        rays: &Packet,
        from_m: f32,
        to_m: [f32; LANES],
    ) -> [Option<FieldHit>; LANES] {
        let mut hits = [None; LANES];
        let size = self.lattice.cells.map(|cells| cells as f32);
        let [o_x, o_y, _] = rays.o();
        let over = span(size, [o_x, o_y], rays.inverse);
        let (from, end) = (Vec4::splat(from_m).larger(over[0]), Vec4::from_array(to_m).smaller(over[1]));
        let out = from.cmpge(end);
        if out.all() {
            return hits;
        }
        let most = [self.blocks_across - 1, self.blocks.len() / self.blocks_across - 1];
        let bounds = [[Vec4::ZERO; 2], most.map(|most| Vec4::splat(most as f32))];
        let mut blocks = rays.walk(BLOCK, bounds, from, end);
        blocks.out = out;
        blocks.go_under(rays, |[i, j]| self.blocks[j * self.blocks_across + i]);

        let low = blocks.square.map(|square| square * BLOCK_TILES as f32);
        let high = low.map(|low| low + (BLOCK_TILES - 1) as f32);
        let mut tiles = rays.walk(TILE, [low, high], blocks.enters, blocks.until);
        tiles.out = blocks.out | blocks.above;
        tiles.go_under(rays, |[i, j]| self.tiles[j * self.tiles_across + i]);

        // Among stems the ground is rarely the first hit.
        let alone = tiles.out | tiles.above | tiles.grows;
        let mut ground = None;
        if !alone.all() {
            let low = tiles.square.map(|square| square * TILE as f32);
            let high = low.map(|low| low + (TILE - 1) as f32);
            let cells = rays.walk(1, [low, high], tiles.enters, tiles.until);
            ground = Some((self.first_cells(rays, &cells), cells.square.map(indices)));
        }
        for (lane, hit) in hits.iter_mut().enumerate() {
            if blocks.out.test(lane) {
                continue;
            }
            if let Some((met, [i, j])) = &ground
                && !alone.test(lane)
                && met[lane] < f32::MAX
            {
                let cell = [i[lane] as u32, j[lane] as u32];
                *hit = Some(FieldHit { t: met[lane], cell, stem: -1.0 });
                continue;
            }
            let tile = (!blocks.above.test(lane)).then(|| tiles.place(lane));
            *hit = self.cast_blocks(&rays.ray(lane), blocks.place(lane), tile, end[lane]);
        }
        hits
    }

    /// Where the rays hit the ground of the cells in which they begin; `f32::MAX` where they leave them above it.
    #[inline]
    fn first_cells(&self, rays: &Packet, cells: &Walk) -> Vec4 {
        let corners = cells.of_squares(|[i, j]| self.cell_corners([i as u32, j as u32]));
        let from = cells.from;
        let [x, y, z] = rays.o();
        let o = [x, y];
        let exits = [0, 1].map(|axis| (cells.square[axis] + (rays.far[axis] - o[axis])) * rays.inverse[axis]);
        let exit = exits[0].smaller(exits[1]).larger(from);
        let above = |t: Vec4| above_corners(rays.at(t), z + t * rays.d[2], cells.square, &corners);
        let (first, last) = (above(from), above(exit));
        let crosses = meet(above, [from, first], [exit, last]);
        first.if_above(0.0, last.if_above(0.0, Vec4::splat(f32::MAX), crosses), from)
    }
}

/// Whole numbers of at least 0 and far below 2^23 as indices.
#[inline]
fn indices(whole: Vec4) -> [usize; LANES] {
    // With 2^23 added, the lowest bits of a f32 are the number.
    let [a, b, c, d] = (whole + 8_388_608.0).to_array();
    let index = |number: f32| (number.to_bits() & 0x7F_FFFF) as usize;
    [index(a), index(b), index(c), index(d)]
}
