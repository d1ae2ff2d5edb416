//! The learning map: 201×201 cells of 0.2 m, north-up, that scroll with the vehicle, and the models of its cells (Albus
//! 2006a, 3.2).
//!
//! A cell that is ready gives all its points to a model. From then on each new point of the cell also goes to the
//! model, until the cell is no longer pure; then the model keeps its points, and a cell that becomes pure again gives those
//! that it has got since. A cell that is not pure, or has few points, can resemble a model: it gives it no points, but
//! shares its experience. Cells that scroll off the map are forgotten.
//! `lessons.rs` has what driving, bumper and operator teach the map.
//!
//! Ground looks different from near and from afar. A cell that comes nearer to the vehicle than `near_range_m` begins anew, with
//! a model of how it looks from near: its many points from there would otherwise replace what its model looked like from
//! afar. It keeps the number of the model that it belonged to from afar. Experience teaches both, and the cell is judged by
//! that one while the other has no experience. How it looks from afar later does not count any more. The paper has one look
//! for both.

mod lessons;

pub use lessons::{Experience, MARKED_CELLS, Patch, Vehicle};

use crate::cell::{Cell, judgement, part_in_surroundings};
use crate::frame::Window;
use crate::judgement::Judgement;
use crate::models::{Model, ModelRules, ModelSet, Terrain};
use crate::surroundings::{Role, spread};
use glam::DVec2;
use rcs_geom::{CellIndex, GridError, ScrollGrid};
use rcs_sense::CELL_SIZE_M;
use rcs_world::SIDE;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Maximum number of cells per frame for which models are merged to make room, which bounds the time of a frame with
/// many new kinds of terrain: finding the most similar pair of 64 models takes about 20 µs.
pub const SQUEEZED: usize = 64;

/// What looks like obstacles that were driven over may be higher than those by this much, mm, by the noise of range.
const HEIGHT_NOISE_MM: u32 = 100;

/// Result of learning from a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Learned {
    /// Ground points added to cells.
    pub ground: u64,
    /// Obstacle points added to cells.
    pub obstacle: u64,
    /// Cells that could not become models because the maximum is reached.
    pub left_out: u64,
}

/// The learning map and its models.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TerrainMap {
    cells: ScrollGrid<Option<Arc<Cell>>>,
    /// The models of the cells.
    pub models: ModelSet,
    /// Cells under the vehicle in the previous update.
    under: Vec<CellIndex>,
    /// Height of the ground under the vehicle, local frame, mm.
    ground_mm: i32,
    /// Number of cells driven over, number hit, and number that an operator marked.
    experienced: [u64; 3],
}

impl TerrainMap {
    /// An empty map around the origin, with initial models.
    pub fn new(models: ModelSet) -> Result<TerrainMap, GridError> {
        Ok(TerrainMap {
            cells: ScrollGrid::new(SIDE, CELL_SIZE_M, None)?,
            models,
            under: Vec::new(),
            ground_mm: 0,
            experienced: [0; 3],
        })
    }

    /// Forgets all cells, as if they had scrolled off the map; the models stay.
    pub fn forget_cells(&mut self) {
        self.cells.clear();
        self.under.clear();
    }

    /// Centres the map on a position of the local frame, m.
    pub fn recentre(&mut self, place: DVec2) {
        if let Some(centre) = self.cells.cell_at(place) {
            self.cells.recentre(centre);
        }
    }

    /// The middle of the map, local frame, m.
    pub fn middle(&self) -> DVec2 {
        self.cells.middle_of(self.cells.centre())
    }

    /// The window of cells to which points are assigned.
    pub fn window(&self) -> Window {
        Window { corner_m: self.cells.origin(), cell_size_m: CELL_SIZE_M, side: SIDE }
    }

    /// A cell; `None` outside of the map and where nothing is known.
    pub fn get(&self, cell: CellIndex) -> Option<&Cell> {
        self.cells.get(cell)?.as_deref()
    }

    /// All known cells, in row order from the south.
    pub fn iter(&self) -> impl Iterator<Item = (CellIndex, &Cell)> {
        self.cells.iter().filter_map(|(index, cell)| Some((index, cell.as_deref()?)))
    }

    /// Number of cells driven over, number hit by the bumper, and number that an operator marked, since the start.
    pub fn experienced(&self) -> [u64; 3] {
        self.experienced
    }

    /// Adds the points of a frame, by cell index, and lets ready cells become models (step 4). When the maximum number
    /// of models is reached, models are merged to make room for up to [`SQUEEZED`] cells per frame; further cells wait
    /// for a later frame.
    pub fn learn(&mut self, points: &[(u32, Terrain)], rules: &ModelRules) -> Learned {
        let mut learned = Learned::default();
        let mut signatures = self.models.signatures(&rules.weights);
        // The current number of each model that existed before the frame, and the models that cells have joined in this
        // frame.
        let mut numbers: Vec<u32> = (0..self.models.models.len() as u32).collect();
        let mut joined: Vec<(CellIndex, u32, bool)> = Vec::new();
        let mut squeezed = 0;
        let south_west = self.cells.bounds().south_west;
        for (place, new) in points {
            let place = *place as usize;
            let index = south_west.offset((place % SIDE) as i64, (place / SIDE) as i64);
            let Some(cell) = self.cells.get_mut(index) else { continue };
            let cell = Arc::make_mut(cell.get_or_insert_default());
            let [x, y] = [place % SIDE, place / SIDE].map(|at| at as f64 - (SIDE / 2) as f64);
            let is_near = rules.near_m > 0.0 && CELL_SIZE_M * libm::hypot(x, y) <= rules.near_m;
            if rules.near_m <= 0.0 {
                // The range may have been greater before.
                cell.is_near = false;
            }
            if is_near && !cell.is_near {
                cell.come_near();
            } else if !is_near && cell.is_near {
                continue;
            }
            cell.add(new);
            learned.ground += new.ground;
            learned.obstacle += new.obstacle;
            let number = cell.model.and_then(|before| numbers.get(before as usize)).map(|&now| now as usize);
            if !rules.is_ready(&cell.terrain) {
                let alike = self.models.alike(&cell.terrain, rules, &signatures);
                cell.leave(new);
                joined.extend(alike.map(|number| (index, number as u32, false)));
            } else if let Some(number) = number.filter(|_| cell.is_part)
                && let Some(model) = self.models.models.get_mut(number)
            {
                model.terrain.merge(new);
                signatures[number] = rules.weights.signature(&model.terrain.histograms);
            } else {
                let (gift, count) = cell.gift();
                let look = &cell.terrain.histograms;
                if let Some(number) = self.models.take_part(look, (&gift, count), rules, &mut signatures) {
                    joined.push((index, number as u32, true));
                } else if squeezed < SQUEEZED
                    && let Some([kept, freed]) = self.models.squeeze_in(&gift, rules, &mut signatures)
                {
                    squeezed += 1;
                    let renamed = joined.iter_mut().map(|(_, number, _)| number).chain(&mut numbers);
                    renamed
                        .filter(|number| **number == freed as u32)
                        .for_each(|number| *number = kept as u32);
                    joined.push((index, freed as u32, true));
                } else {
                    learned.left_out += 1;
                }
            }
        }
        if squeezed > 0 {
            self.rename(&numbers);
        }
        self.join(&joined);
        learned
    }

    /// Gives cells their models: index, number of the model, and whether the cell is part of it.
    fn join(&mut self, joined: &[(CellIndex, u32, bool)]) {
        for &(index, number, is_part) in joined {
            let Some(Some(cell)) = self.cells.get_mut(index) else { continue };
            let cell = Arc::make_mut(cell);
            if !is_part {
                cell.model = Some(number);
            } else if let Some(model) = self.models.models.get_mut(number as usize) {
                model.terrain.learn(&cell.join(number));
            }
        }
    }

    /// The models without a picture of which a frame shows a cell: number, and index of that of their cells with the most
    /// points in the frame.
    pub fn without_sample(&self, points: &[(u32, Terrain)]) -> Vec<(usize, u32)> {
        let mut best: Vec<Option<(u32, u64)>> = vec![None; self.models.models.len()];
        let missing = |number: &usize| self.models.models.get(*number).is_some_and(|m| m.sample.is_none());
        if !(0..best.len()).any(|number| missing(&number)) {
            return Vec::new();
        }
        let south_west = self.cells.bounds().south_west;
        for (place, new) in points {
            let (x, y) = (*place as usize % SIDE, *place as usize / SIDE);
            let cell = self.get(south_west.offset(x as i64, y as i64)).filter(|cell| cell.is_part);
            let number = cell.and_then(|cell| cell.model).map(|number| number as usize).filter(missing);
            if let Some(slot) = number.and_then(|number| best.get_mut(number))
                && slot.is_none_or(|(_, most)| new.points() > most)
            {
                *slot = Some((*place, new.points()));
            }
        }
        best.iter().enumerate().filter_map(|(number, found)| Some((number, found.as_ref()?.0))).collect()
    }

    /// Deletes a model, and forgets the cells that are part of it, so that only what is seen from now on can become such
    /// a model again. Whether there was one.
    pub fn delete(&mut self, number: usize) -> bool {
        if number >= self.models.models.len() {
            return false;
        }
        self.models.models.remove(number);
        let gone = number as u32;
        for index in self.cells.bounds().iter() {
            let Some(cell) = self.get(index) else { continue };
            let [model, far] = [cell.model, cell.far].map(|model| match model {
                Some(model) if model > gone => Some(model - 1),
                Some(model) if model == gone => None,
                model => model,
            });
            if [model, far] == [cell.model, cell.far] {
                continue;
            }
            let was_part = cell.is_part && cell.model == Some(gone);
            let Some(slot) = self.cells.get_mut(index) else { continue };
            match slot {
                Some(cell) if !was_part => {
                    let cell = Arc::make_mut(cell);
                    (cell.model, cell.far) = (model, far);
                }
                _ => *slot = None,
            }
        }
        true
    }

    /// Updates the model numbers of cells whose models were merged.
    fn rename(&mut self, numbers: &[u32]) {
        for index in self.cells.bounds().iter() {
            let Some(before) = self.get(index).map(|cell| [cell.model, cell.far]) else { continue };
            let after = before.map(|before| before.and_then(|number| numbers.get(number as usize).copied()));
            if before != after
                && let Some(Some(cell)) = self.cells.get_mut(index)
            {
                let cell = Arc::make_mut(cell);
                [cell.model, cell.far] = after;
            }
        }
    }

    /// The number of the model by which a cell is judged: the one that it belongs to or resembles from near, or if only that
    /// from afar has experience, that one; if both have hardly any, the one of slippery ground that they are like.
    fn number_of(&self, cell: &Cell, like: &[Option<u32>]) -> Option<u32> {
        let with = |least: fn(&Terrain) -> bool| {
            let has_it = |number: &u32| {
                self.models.models.get(*number as usize).is_some_and(|model| least(&model.terrain))
            };
            cell.model.filter(has_it).or(cell.far.filter(has_it))
        };
        let like = |number: Option<u32>| number.and_then(|number| *like.get(number as usize)?);
        let of_its_own = with(Terrain::is_experienced);
        let slippery = || like(cell.model).or_else(|| like(cell.far));
        of_its_own.or_else(slippery).or_else(|| with(|terrain| terrain.experience() > 0)).or(cell.model)
    }

    /// Up to this height, mm, driving tells of what looks like what was driven over: as high as any of that was.
    fn driven_height_mm(&self) -> u32 {
        let driven = self.models.models.iter().filter(|model| model.driven_backing() >= 0.5);
        let highest_mm = driven.map(|model| model.terrain.driven_height_mm).max();
        highest_mm.map_or(0, |height_mm| height_mm.saturating_add(HEIGHT_NOISE_MM))
    }

    fn is_low(&self, cell: &Cell, limit_mm: u32) -> bool {
        cell.terrain.heights.obstacle_mm(self.ground_mm) <= limit_mm
    }

    /// What is known of a cell (step 5): the obstacle fraction of its model, where it belongs to one or where experience
    /// backs one that it resembles; else its own. The fraction is scaled to 0 to 250. `None` where nothing is known.
    pub fn judge(&self, cell: &Cell, rules: &ModelRules) -> Option<Judgement> {
        let number = self.number_of(cell, &self.models.like_slippery(rules));
        let model = number.and_then(|number| Some((number, self.models.models.get(number as usize)?)));
        judgement(cell, model, self.is_low(cell, self.driven_height_mm()), rules)
    }

    /// The south-west corner cell, and what is known of each cell, in row order from there. Some take the judgement of their
    /// surroundings, see [`crate::surroundings`].
    pub fn judgements(&self, rules: &ModelRules) -> (CellIndex, Vec<Option<Judgement>>) {
        let mut judgements = Vec::with_capacity(SIDE * SIDE);
        let mut roles = Vec::with_capacity(SIDE * SIDE);
        let limit_mm = self.driven_height_mm();
        let driven = |model: &Model| (255.0 * model.driven_backing()).round() as u8;
        let driven: Vec<u8> = self.models.models.iter().map(driven).collect();
        let like = self.models.like_slippery(rules);
        self.cells.for_each_run(|_, _, cells| {
            for cell in cells {
                let cell = cell.as_deref();
                let is_low = cell.is_none_or(|cell| self.is_low(cell, limit_mm));
                let number = cell.and_then(|cell| self.number_of(cell, &like));
                let model =
                    number.and_then(|number| Some((number, self.models.models.get(number as usize)?)));
                let driven = number.and_then(|number| driven.get(number as usize)).copied().unwrap_or(0);
                judgements.push(cell.and_then(|cell| judgement(cell, model, is_low, rules)));
                roles.push(Role { part: part_in_surroundings(cell, number), driven, is_low });
            }
        });
        spread(&mut judgements, &roles, SIDE);
        (self.cells.bounds().south_west, judgements)
    }

    /// Number of cells with points or experience, and number of cells that are part of a model.
    pub fn counts(&self) -> [u64; 2] {
        let mut counts = [0; 2];
        self.cells.for_each_run(|_, _, cells| {
            for cell in cells.iter().flatten() {
                counts[0] += 1;
                counts[1] += u64::from(cell.is_part);
            }
        });
        counts
    }
}

#[cfg(test)]
#[path = "map_tests.rs"]
pub(crate) mod tests;
