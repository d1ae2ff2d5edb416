//! Casts rays at the ground and at the vegetation on it.
//!
//! The ground is bilinear between the samples of the [`Lattice`]. Two levels bound it from above: each tile of 8×8
//! cells and each block of 8×8 tiles has a **plane** that is above all of its samples and stems. A plane fits sloped
//! ground far better than a maximum does, so that a ray that grazes a hillside skips nearly all tiles. A ray traverses
//! blocks, then the tiles of blocks whose plane it crosses, and then cells, from the point where it crosses the plane
//! of a tile. The hit in a cell depends on the ray and the cell alone, not on where the traversal began.
//!
//! For bundles of rays there is a pyramid of maxima: [`HeightField::clear_until`] returns a distance up to which no ray
//! of a cone can hit the ground.

use crate::class::Surface;
use crate::noise::{hash2, unit};
use crate::surface::{Material, STEM_PRESENCE};
use crate::terrain::{BLOCK, CELL_M, Lattice, TILE};

const CELL: f32 = CELL_M as f32;
/// Rounding errors of f32 at the size of a world are far smaller than this, m.
const SLACK_M: f32 = 1e-3;

/// Stems closer than this to the origin of a ray are ignored, because the body that carries the sensor has pushed them
/// aside, m.
pub(crate) const STEM_CLEAR_M: f32 = 0.35;

/// A ray in units of the lattice: cells horizontally, metres vertically and along the ray.
#[derive(Clone, Copy)]
pub(crate) struct FieldRay {
    o: [f32; 3],
    d: [f32; 3],
    /// 1 / d of the first two axes; huge where d is 0.
    inverse: [f32; 2],
    step: [i32; 2],
    /// 1 if the ray leaves a cell through its far side.
    far: [i32; 2],
    /// Square of the length of the first two components of d.
    run2: f32,
}

/// Intersection of a ray with the ground or a stem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FieldHit {
    /// Distance along the ray, m.
    pub(crate) t: f32,
    /// Cell of the lattice.
    pub(crate) cell: [u32; 2],
    /// Height on a stem as a fraction of the stem's height; negative for the ground.
    pub(crate) stem: f32,
}

/// The ground with its acceleration structures.
pub(crate) struct HeightField {
    pub(crate) lattice: Lattice,
    /// By surface code: radius of stems in cells, 0 if there are none, and their greatest height, m.
    stems: [[f32; 2]; 16],
    tiles_across: usize,
    /// Bounding plane: constant, slope per cell along x and y, and 1 if there are stems.
    tiles: Vec<[f32; 4]>,
    blocks_across: usize,
    blocks: Vec<[f32; 4]>,
    /// Bounding planes of the soil alone; computed for tiles with stems.
    soil: Vec<[f32; 4]>,
    /// Maxima over tiles and their eight neighbours, then over squares of twice the size, and so on.
    pyramid: Vec<Maxima>,
    seed: u32,
}

struct Maxima {
    across: usize,
    up: usize,
    highest: Vec<f32>,
}

/// A stem of a cell.
pub(crate) struct Stem {
    /// Position of its axis relative to the cell's corner, cells.
    pub(crate) at: [f32; 2],
    pub(crate) radius: f32,
    pub(crate) height_m: f32,
}

impl FieldRay {
    /// From an origin in metres relative to the first sample, and a unit direction.
    pub(crate) fn new(origin_m: [f32; 3], direction: [f32; 3]) -> FieldRay {
        let o = [origin_m[0] * (1.0 / CELL), origin_m[1] * (1.0 / CELL), origin_m[2]];
        let d = [direction[0] * (1.0 / CELL), direction[1] * (1.0 / CELL), direction[2]];
        let still = [d[0].abs() < 1e-6, d[1].abs() < 1e-6];
        let inverse = |d: f32, still: bool| if still { 1e12 } else { 1.0 / d };
        let far = [i32::from(still[0] || d[0] >= 0.0), i32::from(still[1] || d[1] >= 0.0)];
        FieldRay {
            o,
            d,
            inverse: [inverse(d[0], still[0]), inverse(d[1], still[1])],
            step: [2 * far[0] - 1, 2 * far[1] - 1],
            far,
            run2: (d[0] * d[0] + d[1] * d[1]).max(1e-12),
        }
    }

    #[inline]
    fn at(&self, t: f32) -> [f32; 2] {
        [self.o[0] + t * self.d[0], self.o[1] + t * self.d[1]]
    }

    /// Distance at which the ray leaves square `index` of `side` cells along one axis.
    #[inline]
    fn leaves(&self, axis: usize, index: i32, side: f32) -> f32 {
        ((index + self.far[axis]) as f32 * side - self.o[axis]) * self.inverse[axis]
    }

    /// Height above a plane at t = 0, and its derivative with respect to t.
    #[inline]
    fn above(&self, plane: &[f32; 4]) -> [f32; 2] {
        [
            self.o[2] - plane[0] - plane[1] * self.o[0] - plane[2] * self.o[1],
            self.d[2] - plane[1] * self.d[0] - plane[2] * self.d[1],
        ]
    }
}

impl HeightField {
    pub(crate) fn new(lattice: Lattice, materials: &[Material], seed: u32) -> HeightField {
        let mut stems = [[0.0; 2]; 16];
        for (surface, material) in Surface::ALL.into_iter().zip(materials) {
            if material.has_stems() {
                let radius = (material.stem_radius_m(CELL_M) / CELL_M) as f32;
                stems[surface as usize] = [radius, material.height_m as f32];
            }
        }
        let [tiles_across, tiles_up] = lattice.cells.map(|cells| cells / TILE);
        let [blocks_across, blocks_up] = lattice.cells.map(|cells| cells / BLOCK);
        let grown = Grown { lattice: &lattice, stems: &stems };
        let bare = Grown { lattice: &lattice, stems: &[[0.0; 2]; 16] };
        let planes = |across: usize, up: usize, side: usize| -> Vec<[f32; 4]> {
            let squares = (0..up).flat_map(|row| (0..across).map(move |column| [column * side, row * side]));
            squares.map(|corner| grown.plane_over(corner, side)).collect()
        };
        let tiles = planes(tiles_across, tiles_up, TILE);
        let blocks = planes(blocks_across, blocks_up, BLOCK);
        let soil_below = |(index, tile): (usize, &[f32; 4])| {
            let corner = [index % tiles_across * TILE, index / tiles_across * TILE];
            if tile[3] > 0.0 { bare.plane_over(corner, TILE) } else { [0.0; 4] }
        };
        let soil = tiles.iter().enumerate().map(soil_below).collect();
        let corners =
            (0..tiles_up).flat_map(|row| (0..tiles_across).map(move |column| [column * TILE, row * TILE]));
        let highest = corners.map(|corner| grown.highest(corner, TILE)).collect();
        let pyramid = pyramid(Maxima { across: tiles_across, up: tiles_up, highest });
        HeightField { lattice, stems, tiles_across, tiles, blocks_across, blocks, soil, pyramid, seed }
    }

    /// The part of the ray above the lattice, m.
    fn over(&self, ray: &FieldRay) -> [f32; 2] {
        let mut span = [0.0_f32, f32::MAX];
        for axis in 0..2 {
            let ends =
                [0.0, self.lattice.cells[axis] as f32].map(|end| (end - ray.o[axis]) * ray.inverse[axis]);
            span = [larger(span[0], smaller(ends[0], ends[1])), smaller(span[1], larger(ends[0], ends[1]))];
        }
        span
    }

    /// The first hit between two distances, m.
    pub(crate) fn cast(&self, ray: &FieldRay, from_m: f32, to_m: f32) -> Option<FieldHit> {
        let over = self.over(ray);
        let (mut t, end) = (larger(from_m, over[0]), smaller(to_m, over[1]));
        if t >= end {
            return None;
        }
        let most = [self.blocks_across as i32 - 1, (self.blocks.len() / self.blocks_across) as i32 - 1];
        let start = ray.at(t);
        let mut block = [0, 1].map(|axis| ((start[axis] * (1.0 / BLOCK as f32)) as i32).clamp(0, most[axis]));
        loop {
            let leaves = [ray.leaves(0, block[0], BLOCK as f32), ray.leaves(1, block[1], BLOCK as f32)];
            let axis = usize::from(leaves[1] < leaves[0]);
            let until = smaller(smaller(leaves[0], leaves[1]), end);
            let plane = &self.blocks[block[1] as usize * self.blocks_across + block[0] as usize];
            if let Some(enters) = goes_under(ray, plane, t, until)
                && let Some(hit) = self.tiles(ray, block, enters, until)
            {
                return Some(hit);
            }
            t = larger(t, until);
            block[axis] += ray.step[axis];
            if t >= end || block[axis] < 0 || block[axis] > most[axis] {
                return None;
            }
        }
    }

    /// Traverses the tiles of one block.
    #[inline]
    fn tiles(&self, ray: &FieldRay, block: [i32; 2], from: f32, until: f32) -> Option<FieldHit> {
        const SIDE: i32 = (BLOCK / TILE) as i32;
        let low = [block[0] * SIDE, block[1] * SIDE];
        let start = ray.at(from);
        let mut tile = [0, 1]
            .map(|axis| ((start[axis] * (1.0 / TILE as f32)) as i32).clamp(low[axis], low[axis] + SIDE - 1));
        let mut t = from;
        loop {
            let leaves = [ray.leaves(0, tile[0], TILE as f32), ray.leaves(1, tile[1], TILE as f32)];
            let axis = usize::from(leaves[1] < leaves[0]);
            let exit = smaller(smaller(leaves[0], leaves[1]), until);
            let index = tile[1] as usize * self.tiles_across + tile[0] as usize;
            let plane = &self.tiles[index];
            if let Some(enters) = goes_under(ray, plane, t, exit) {
                let hit = if plane[3] > 0.0 {
                    self.cells::<true>(ray, index, tile, enters, exit)
                } else {
                    self.cells::<false>(ray, index, tile, enters, exit)
                };
                if hit.is_some() {
                    return hit;
                }
            }
            t = larger(t, exit);
            tile[axis] += ray.step[axis];
            if t >= until || tile[axis] < low[axis] || tile[axis] >= low[axis] + SIDE {
                return None;
            }
        }
    }

    /// Traverses the cells of one tile. Among stems the ground is tested only from where the ray crosses the plane of
    /// the soil.
    #[inline]
    fn cells<const STEMS: bool>(
        &self,
        ray: &FieldRay,
        index: usize,
        tile: [i32; 2],
        from: f32,
        until: f32,
    ) -> Option<FieldHit> {
        const SIDE: i32 = TILE as i32;
        let low = [tile[0] * SIDE, tile[1] * SIDE];
        let start = ray.at(from);
        let mut cell = [
            (start[0] as i32).clamp(low[0], low[0] + SIDE - 1),
            (start[1] as i32).clamp(low[1], low[1] + SIDE - 1),
        ];
        let mut t = from;
        let hit = |t: f32, cell: [i32; 2], stem: f32| {
            Some(FieldHit { t, cell: [cell[0] as u32, cell[1] as u32], stem })
        };
        let soil_from =
            if STEMS { goes_under(ray, &self.soil[index], from, until).unwrap_or(f32::MAX) } else { from };
        if soil_from <= from && above_cell(ray, cell, &self.corners(cell), t) <= 0.0 {
            return hit(t, cell, -1.0);
        }
        // The dependency from one step to the next determines the cost of the traversal. So the cell is also counted in
        // f32, and the side by which a ray leaves is selected without a branch, because the branch is not predictable.
        let mut place = [cell[0] as f32, cell[1] as f32];
        let to_far = [ray.far[0] as f32 - ray.o[0], ray.far[1] as f32 - ray.o[1]];
        let step = [ray.step[0] as f32, ray.step[1] as f32];
        loop {
            let leaves = [(place[0] + to_far[0]) * ray.inverse[0], (place[1] + to_far[1]) * ray.inverse[1]];
            let sideways = leaves[0] <= leaves[1];
            let exit = larger(smaller(leaves[0], leaves[1]), t);
            let mut ground = f32::MAX;
            if !STEMS || exit >= soil_from {
                let corners = self.corners(cell);
                let above = above_cell(ray, cell, &corners, exit);
                if above <= 0.0 {
                    ground = meet(ray, cell, &corners, [t, exit], above);
                }
            }
            if STEMS
                && let Some((at, part)) = self.stem_hit(ray, cell)
                && at < ground
                && at >= from
            {
                return hit(at, cell, part);
            }
            if ground < f32::MAX {
                return hit(ground, cell, -1.0);
            }
            t = exit;
            place[0] += if sideways { step[0] } else { 0.0 };
            place[1] += if sideways { 0.0 } else { step[1] };
            cell[0] += if sideways { ray.step[0] } else { 0 };
            cell[1] += if sideways { 0 } else { ray.step[1] };
            let outside =
                (cell[0] - low[0]) as u32 >= SIDE as u32 || (cell[1] - low[1]) as u32 >= SIDE as u32;
            if t >= until || outside {
                return None;
            }
        }
    }

    /// Heights of the corners of a cell, m: the lower two, then the upper two.
    pub(crate) fn cell_corners(&self, cell: [u32; 2]) -> [f32; 4] {
        self.corners([cell[0] as i32, cell[1] as i32])
    }

    #[inline]
    fn corners(&self, cell: [i32; 2]) -> [f32; 4] {
        let at = cell[1] as usize * self.lattice.width + cell[0] as usize;
        let low = &self.lattice.z[at..at + 2];
        let high = &self.lattice.z[at + self.lattice.width..at + self.lattice.width + 2];
        [low[0], low[1], high[0], high[1]]
    }

    /// The stem of a cell, if it has one: a vertical cylinder within the cell.
    pub(crate) fn stem(&self, cell: [usize; 2]) -> Option<Stem> {
        let surface = self.lattice.surface[cell[1] * self.lattice.width + cell[0]];
        let [radius, height_m] = self.stems[usize::from(surface & 15)];
        let hash = hash2(cell[0] as i32, cell[1] as i32, self.seed);
        if radius == 0.0 || unit(hash) >= STEM_PRESENCE as f32 {
            return None;
        }
        let part = |shift: u32| ((hash >> shift) & 255) as f32 * (1.0 / 256.0);
        let room = 1.0 - 2.0 * radius;
        // Stems of one surface differ in height; the shortest has 6/10 of the greatest height.
        let height_m = height_m * (0.6 + 0.4 * part(16));
        Some(Stem { at: [radius + room * part(0), radius + room * part(8)], radius, height_m })
    }

    #[inline]
    fn stem_hit(&self, ray: &FieldRay, cell: [i32; 2]) -> Option<(f32, f32)> {
        let index = [cell[0] as usize, cell[1] as usize];
        let stem = self.stem(index)?;
        let to = [cell[0] as f32 + stem.at[0] - ray.o[0], cell[1] as f32 + stem.at[1] - ray.o[1]];
        // All terms are multiplied by the ray's horizontal length, so that only a hit needs a division.
        let aside = to[0] * ray.d[1] - to[1] * ray.d[0];
        let within = stem.radius * stem.radius * ray.run2 - aside * aside;
        if within <= 0.0 {
            return None;
        }
        let t = (to[0] * ray.d[0] + to[1] * ray.d[1] - within.sqrt()) / ray.run2;
        let foot = self.lattice.z[index[1] * self.lattice.width + index[0]];
        let part = (ray.o[2] + t * ray.d[2] - foot) / stem.height_m;
        (t > STEM_CLEAR_M && part < 1.0).then_some((t, part.max(0.0)))
    }

    /// A distance up to which no ray of a cone reaches the ground or a stem, m. The cone begins at `origin_m` around
    /// `axis` (a unit vector); `spread` bounds the distance between two of its rays at the same distance from the
    /// origin, as a fraction of that distance. `f32::MAX` if the cone leaves the world above the ground.
    pub(crate) fn clear_until(&self, origin_m: [f32; 3], axis: [f32; 3], spread: f32) -> f32 {
        let tile_m = CELL * TILE as f32;
        let (mut t, mut level) = (0.0_f32, 2.min(self.pyramid.len() - 1));
        loop {
            let side_m = tile_m * (1 << level) as f32;
            let maxima = &self.pyramid[level];
            // Points of the cone up to t + step stay within one square of the position of the axis at t.
            let step = (side_m - spread * t) / (1.0 + spread);
            let at = [origin_m[0] + t * axis[0], origin_m[1] + t * axis[1]].map(|v| (v / side_m).floor());
            let outside =
                at[0] < -1.0 || at[1] < -1.0 || at[0] > maxima.across as f32 || at[1] > maxima.up as f32;
            let highest = if outside { 0.0 } else { maxima.around([at[0] as i32, at[1] as i32]) };
            let lowest = origin_m[2] + (t * (axis[2] - spread)).min((t + step) * (axis[2] - spread));
            if step < 0.2 * side_m {
                // The cone is about as wide as the squares: smaller squares would not advance it.
                return t;
            }
            if lowest > highest + SLACK_M {
                t += step;
                level = (level + 1).min(self.pyramid.len() - 1);
                if t > 400.0 {
                    return f32::MAX;
                }
            } else if level > 0 {
                level -= 1;
            } else {
                return t;
            }
        }
    }
}

/// Height of the ray above the ground of a cell, m.
#[inline]
fn above_cell(ray: &FieldRay, cell: [i32; 2], corners: &[f32; 4], t: f32) -> f32 {
    let at = ray.at(t);
    let fu = (at[0] - cell[0] as f32).clamp(0.0, 1.0);
    let fv = (at[1] - cell[1] as f32).clamp(0.0, 1.0);
    let low = corners[0] + fu * (corners[1] - corners[0]);
    let high = corners[2] + fu * (corners[3] - corners[2]);
    ray.o[2] + t * ray.d[2] - (low + fv * (high - low))
}

/// Where a ray that is above the ground at the first distance crosses it before the second; `above_b` is its height
/// there, 0 or less.
#[inline]
fn meet(ray: &FieldRay, cell: [i32; 2], corners: &[f32; 4], [a, b]: [f32; 2], above_b: f32) -> f32 {
    let above_a = above_cell(ray, cell, corners, a);
    let first = crossing([a, above_a], [b, above_b]);
    let above = above_cell(ray, cell, corners, first);
    // Within a cell the ground below a ray is a parabola, and nearly always close to a line: then the first step
    // suffices.
    if above.abs() < 5e-5 {
        first
    } else if above > 0.0 {
        crossing([first, above], [b, above_b])
    } else {
        crossing([a, above_a], [first, above])
    }
}

/// `f32::min` without NaN handling, which compiles to one instruction; none of these numbers is NaN.
#[inline]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// `f32::max` without NaN handling.
#[inline]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Where a ray that may be above a plane at `t` crosses it before `until`.
#[inline]
fn goes_under(ray: &FieldRay, plane: &[f32; 4], t: f32, until: f32) -> Option<f32> {
    let [above, rate] = ray.above(plane);
    let (first, last) = (above + rate * t, above + rate * until);
    if first > 0.0 && last > 0.0 {
        None
    } else if first > 0.0 {
        Some(crossing([t, first], [until, last]))
    } else {
        Some(t)
    }
}

/// Zero crossing of a line between two heights, of which the first is above 0 and the second is not.
#[inline]
fn crossing([a, above_a]: [f32; 2], [b, above_b]: [f32; 2]) -> f32 {
    smaller(larger(a + (b - a) * (above_a / larger(above_a - above_b, 1e-12)), a), b)
}

/// The ground with its vegetation.
struct Grown<'l> {
    lattice: &'l Lattice,
    stems: &'l [[f32; 2]; 16],
}

impl Grown<'_> {
    /// Calls with column, row and top height of each sample of a square of cells; the stem of a cell stands on its
    /// first sample.
    fn each(&self, corner: [usize; 2], side: usize, mut call: impl FnMut(usize, usize, f32, bool)) {
        for row in 0..=side {
            let start = (corner[1] + row) * self.lattice.width + corner[0];
            let heights = &self.lattice.z[start..=start + side];
            let surfaces = &self.lattice.surface[start..=start + side];
            for (column, (z, surface)) in heights.iter().zip(surfaces).enumerate() {
                let [radius, height] = self.stems[usize::from(surface & 15)];
                call(column, row, z + height, radius > 0.0);
            }
        }
    }

    fn highest(&self, corner: [usize; 2], side: usize) -> f32 {
        let mut highest = f32::MIN;
        self.each(corner, side, |_, _, top, _| highest = highest.max(top));
        highest
    }

    /// The plane through the middle of the square with its mean slope, raised above all samples.
    fn plane_over(&self, corner: [usize; 2], side: usize) -> [f32; 4] {
        let middle = side as f32 * 0.5;
        let (mut sum, mut along, mut across, mut weight, mut grows) = (0.0, 0.0, 0.0, 0.0, false);
        self.each(corner, side, |column, row, top, stems| {
            let (u, v) = (column as f32 - middle, row as f32 - middle);
            sum += top;
            along += u * top;
            across += v * top;
            weight += u * u;
            grows |= stems;
        });
        let count = ((side + 1) * (side + 1)) as f32;
        let (mean, slope_u, slope_v) = (sum / count, along / weight, across / weight);
        let mut raise = f32::MIN;
        self.each(corner, side, |column, row, top, _| {
            let (u, v) = (column as f32 - middle, row as f32 - middle);
            raise = raise.max(top - mean - slope_u * u - slope_v * v);
        });
        let at = [corner[0] as f32 + middle, corner[1] as f32 + middle];
        // A stem has the height of its first sample but may stand anywhere in the cell, so the plane is raised by its
        // slope.
        let lean = if grows { slope_u.abs() + slope_v.abs() } else { 0.0 };
        let constant = mean + raise + lean + SLACK_M - slope_u * at[0] - slope_v * at[1];
        [constant, slope_u, slope_v, if grows { 1.0 } else { 0.0 }]
    }
}

impl Maxima {
    /// The maximum of a square and its neighbours; the plain outside counts as 0.
    fn around(&self, [i, j]: [i32; 2]) -> f32 {
        if i < 0 || j < 0 || i >= self.across as i32 || j >= self.up as i32 {
            let near = [i.clamp(0, self.across as i32 - 1), j.clamp(0, self.up as i32 - 1)];
            return self.around(near).max(0.0);
        }
        self.highest[j as usize * self.across + i as usize]
    }

    fn over_neighbours(&self) -> Maxima {
        let at = |i: i32, j: i32| {
            if i < 0 || j < 0 || i >= self.across as i32 || j >= self.up as i32 {
                0.0
            } else {
                self.highest[j as usize * self.across + i as usize]
            }
        };
        let squares = (0..self.up as i32).flat_map(|j| (0..self.across as i32).map(move |i| [i, j]));
        let highest = squares
            .map(|[i, j]| {
                let near = (-1..=1).flat_map(|dj| (-1..=1).map(move |di| [i + di, j + dj]));
                near.map(|[i, j]| at(i, j)).fold(f32::MIN, f32::max)
            })
            .collect();
        Maxima { across: self.across, up: self.up, highest }
    }

    fn halved(&self) -> Maxima {
        let [across, up] = [self.across.div_ceil(2), self.up.div_ceil(2)];
        let squares = (0..up).flat_map(|j| (0..across).map(move |i| [i, j]));
        let highest = squares
            .map(|[i, j]| {
                let four = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[di, dj]| [2 * i + di, 2 * j + dj]);
                let inside = four.into_iter().filter(|[i, j]| *i < self.across && *j < self.up);
                inside.map(|[i, j]| self.highest[j * self.across + i]).fold(f32::MIN, f32::max)
            })
            .collect();
        Maxima { across, up, highest }
    }
}

fn pyramid(tiles: Maxima) -> Vec<Maxima> {
    let mut levels = vec![tiles];
    while levels.last().is_some_and(|level| level.across > 1 || level.up > 1) {
        levels.extend(levels.last().map(Maxima::halved));
    }
    levels.iter().map(Maxima::over_neighbours).collect()
}
