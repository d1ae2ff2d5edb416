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
use crate::field_ray::{BLOCK_TILES, CELL, FieldRay, Place, meet, span};
use crate::number::Number;
use crate::stem::{Stem, Stems};
use crate::surface::Material;
use crate::terrain::{BLOCK, CELL_M, Lattice, TILE};

/// Rounding errors of f32 at the size of a world are far smaller than this, m.
const SLACK_M: f32 = 1e-3;

/// Cells of a tile.
const CELLS: usize = TILE * TILE;
/// Stands for the stems of a tile that has none; never read.
static BARE: [Stem; CELLS] = [Stem::NONE; CELLS];

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
    pub(crate) stems: Stems,
    pub(crate) tiles_across: usize,
    /// Bounding plane: constant, slope per cell along x and y, and 1 if there are stems.
    pub(crate) tiles: Vec<[f32; 4]>,
    pub(crate) blocks_across: usize,
    pub(crate) blocks: Vec<[f32; 4]>,
    /// Bounding planes of the soil alone; computed for tiles with stems.
    soil: Vec<[f32; 4]>,
    /// Maxima over tiles and their eight neighbours, then over squares of twice the size, and so on.
    pyramid: Vec<Maxima>,
}

struct Maxima {
    across: usize,
    up: usize,
    highest: Vec<f32>,
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
        let mut grown_stems = Stems::default();
        for (index, tile) in tiles.iter().enumerate() {
            let corner = [index % tiles_across * TILE, index / tiles_across * TILE];
            let kind = |[i, j]: [usize; 2]| stems[usize::from(lattice.surface[j * lattice.width + i] & 15)];
            grown_stems.push(corner, (tile[3] > 0.0).then_some(kind), seed);
        }
        HeightField { lattice, stems: grown_stems, tiles_across, tiles, blocks_across, blocks, soil, pyramid }
    }

    /// The first hit between two distances, m.
    pub(crate) fn cast(&self, ray: &FieldRay, from_m: f32, to_m: f32) -> Option<FieldHit> {
        let over = span(self.lattice.cells.map(|cells| cells as f32), [ray.o[0], ray.o[1]], ray.inverse);
        let (t, end) = (from_m.larger(over[0]), to_m.smaller(over[1]));
        if t >= end {
            return None;
        }
        let most = [self.blocks_across as i32 - 1, (self.blocks.len() / self.blocks_across) as i32 - 1];
        let start = ray.at(t);
        let block = [0, 1].map(|axis| ((start[axis] * (1.0 / BLOCK as f32)) as i32).clamp(0, most[axis]));
        self.cast_blocks(ray, Place { square: block, t }, None, end)
    }

    /// Traverses blocks, the first from `tile` if there is one.
    pub(crate) fn cast_blocks(
        &self,
        ray: &FieldRay,
        start: Place,
        mut tile: Option<Place>,
        end: f32,
    ) -> Option<FieldHit> {
        let Place { square: mut block, mut t } = start;
        let most = [self.blocks_across as i32 - 1, (self.blocks.len() / self.blocks_across) as i32 - 1];
        loop {
            let leaves = [ray.leaves(0, block[0], BLOCK as f32), ray.leaves(1, block[1], BLOCK as f32)];
            let axis = usize::from(leaves[1] < leaves[0]);
            let until = leaves[0].smaller(leaves[1]).smaller(end);
            let plane = &self.blocks[block[1] as usize * self.blocks_across + block[0] as usize];
            let first = tile
                .take()
                .or_else(|| ray.goes_under(plane, t, until).map(|enters| Place::tile_at(ray, block, enters)));
            if let Some(first) = first
                && let Some(hit) = self.cast_tiles(ray, block, first, until)
            {
                return Some(hit);
            }
            t = t.larger(until);
            block[axis] += ray.step[axis];
            if t >= end || block[axis] < 0 || block[axis] > most[axis] {
                return None;
            }
        }
    }

    /// Traverses the tiles of one block.
    #[inline]
    fn cast_tiles(&self, ray: &FieldRay, block: [i32; 2], start: Place, until: f32) -> Option<FieldHit> {
        let low = block.map(|index| index * BLOCK_TILES);
        let Place { square: mut tile, mut t } = start;
        loop {
            let leaves = [ray.leaves(0, tile[0], TILE as f32), ray.leaves(1, tile[1], TILE as f32)];
            let axis = usize::from(leaves[1] < leaves[0]);
            let exit = leaves[0].smaller(leaves[1]).smaller(until);
            let index = tile[1] as usize * self.tiles_across + tile[0] as usize;
            let plane = &self.tiles[index];
            if let Some(enters) = ray.goes_under(plane, t, exit) {
                let hit = if plane[3] > 0.0 {
                    self.cast_cells::<true>(ray, index, tile, enters, exit)
                } else {
                    self.cast_cells::<false>(ray, index, tile, enters, exit)
                };
                if hit.is_some() {
                    return hit;
                }
            }
            t = t.larger(exit);
            tile[axis] += ray.step[axis];
            if t >= until || tile[axis] < low[axis] || tile[axis] >= low[axis] + BLOCK_TILES {
                return None;
            }
        }
    }

    /// Traverses the cells of one tile. Among stems the ground is tested only from where the ray crosses the plane of
    /// the soil.
    #[inline]
    fn cast_cells<const STEMS: bool>(
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
        let stems = if STEMS { self.stems.of_tile(index) } else { &BARE };
        let soil_from =
            if STEMS { ray.goes_under(&self.soil[index], from, until).unwrap_or(f32::MAX) } else { from };
        if soil_from <= from && ray.above_cell(cell, &self.corners(cell), t) <= 0.0 {
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
            let exit = leaves[0].smaller(leaves[1]).larger(t);
            let mut ground = f32::MAX;
            if !STEMS || exit >= soil_from {
                let corners = self.corners(cell);
                let above = ray.above_cell(cell, &corners, exit);
                if above <= 0.0 {
                    let above_at = |t| ray.above_cell(cell, &corners, t);
                    ground = meet(above_at, [t, above_at(t)], [exit, above]);
                }
            }
            if STEMS {
                // The remainder spares the check of the bounds.
                let stem = &stems[((cell[1] - low[1]) * SIDE + cell[0] - low[0]) as usize % CELLS];
                if let Some((at, part)) = stem.hit(ray, || self.corners(cell)[0])
                    && at < ground
                    && at >= from
                {
                    return hit(at, cell, part);
                }
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
