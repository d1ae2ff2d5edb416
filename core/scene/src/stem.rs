//! The stems of vegetation: at most one in a cell of the lattice, at a place that its hash decides.

use crate::field_ray::FieldRay;
use crate::noise::{hash2, unit};
use crate::surface::STEM_PRESENCE;
use crate::terrain::TILE;

/// Stems closer than this to the origin of a ray are ignored, because the body that carries the sensor has pushed them
/// aside, m.
pub(crate) const STEM_CLEAR_M: f32 = 0.35;

/// A stem, or none: a vertical cylinder within a cell.
#[derive(Clone, Copy)]
pub(crate) struct Stem {
    /// Position of its axis, cells.
    pub(crate) at: [f32; 2],
    /// Square of its radius, cells; 0 if there is no stem.
    pub(crate) radius2: f32,
    pub(crate) height_m: f32,
}

/// The stems of the tiles that have some: computed once, because a ray through growth tests one per cell.
#[derive(Default)]
pub(crate) struct Stems {
    tiles: Vec<[Stem; TILE * TILE]>,
    /// Of each tile of the lattice, its place in `tiles`; that of the next one if it has no stems.
    places: Vec<u32>,
}

impl Stem {
    pub(crate) const NONE: Stem = Stem { at: [0.0; 2], radius2: 0.0, height_m: 0.0 };

    /// The stem of a cell of a surface whose stems have a radius (cells; 0 if it has none) and a greatest height (m).
    fn in_cell(cell: [usize; 2], [radius, height_m]: [f32; 2], seed: u32) -> Stem {
        let hash = hash2(cell[0] as i32, cell[1] as i32, seed);
        if radius == 0.0 || unit(hash) >= STEM_PRESENCE as f32 {
            return Stem::NONE;
        }
        let part = |shift: u32| ((hash >> shift) & 255) as f32 * (1.0 / 256.0);
        let room = 1.0 - 2.0 * radius;
        let at = [cell[0] as f32 + (radius + room * part(0)), cell[1] as f32 + (radius + room * part(8))];
        // Stems of one surface differ in height; the shortest has 6/10 of the greatest height.
        Stem { at, radius2: radius * radius, height_m: height_m * (0.6 + 0.4 * part(16)) }
    }

    /// Distance at which a ray hits the stem, and how high: as a fraction of the stem's height, which stands on ground
    /// of height `foot_m`.
    #[inline]
    pub(crate) fn hit(&self, ray: &FieldRay, foot_m: impl Fn() -> f32) -> Option<(f32, f32)> {
        let to = [self.at[0] - ray.o[0], self.at[1] - ray.o[1]];
        // All terms are multiplied by the ray's horizontal length, so that only a hit needs a division.
        let aside = to[0] * ray.d[1] - to[1] * ray.d[0];
        let within = self.radius2 * ray.run2 - aside * aside;
        if within <= 0.0 {
            return None;
        }
        let t = (to[0] * ray.d[0] + to[1] * ray.d[1] - within.sqrt()) / ray.run2;
        let part = (ray.o[2] + t * ray.d[2] - foot_m()) / self.height_m;
        (t > STEM_CLEAR_M && part < 1.0).then_some((t, part.max(0.0)))
    }
}

impl Stems {
    /// Adds the next tile, whose first cell is `corner`: `kind` gives radius and greatest height of the stems of a
    /// cell's surface. `None` for a tile without stems.
    pub(crate) fn push(
        &mut self,
        corner: [usize; 2],
        kind: Option<impl Fn([usize; 2]) -> [f32; 2]>,
        seed: u32,
    ) {
        self.places.push(self.tiles.len() as u32);
        self.tiles.extend(kind.map(|kind| {
            std::array::from_fn(|index| {
                let cell = [corner[0] + index % TILE, corner[1] + index / TILE];
                Stem::in_cell(cell, kind(cell), seed)
            })
        }));
    }

    /// The stems of a tile that has some, by rows of cells.
    #[inline]
    pub(crate) fn of_tile(&self, tile: usize) -> &[Stem; TILE * TILE] {
        &self.tiles[self.places[tile] as usize]
    }
}
