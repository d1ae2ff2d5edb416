//! What driving, bumper and operator teach the learning map (Albus 2006a, 3.2, step 5): cells gain experience, and
//! so do the models that they belong to.
//!
//! The paper does not give the weight of experience. Here both what is seen and what is experienced are counted in
//! cells, so that their ratio depends neither on the resolution of the camera nor on how long something was looked at:
//! a cell that is driven over gains `driven_gain` cells of ground, and so does the model that it belongs to or
//! resembles; one that resembles none becomes a model, pure or not. What was seen of a model counts as at most
//! [`SEEN_CELLS`](crate::models::SEEN_CELLS) cells. A cell gains when it comes under the vehicle, not while it stays
//! there. Hits of the bumper add cells of obstacle in the same way, and so do outlines that an operator draws. Wheels that
//! begin to spin add cells of both kinds: such ground is dear, and not closed.

use super::{Cell, TerrainMap};
use crate::models::{Lesson, ModelRules};
use glam::{DVec2, DVec3};
use rcs_geom::{CellIndex, Pose};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Of the cells that an operator marks at once, a model gains from at most so many, whether they belong to it then or join
/// it later: as from a hit of the bumper, so that one large outline does not outweigh everything that was driven over.
pub const MARKED_CELLS: usize = 4;

/// Share of obstacle in the experience of ground on which the wheels spin: it costs at most 100 of 250, so that a planner
/// goes around it where there is another way.
const SPUN_SHARE: f64 = 0.4;

/// Whole cells of a gain; at least one of a positive gain.
fn cells_of(gain: f64) -> u64 {
    if gain > 0.0 { gain.round().max(1.0) as u64 } else { 0 }
}

/// Cells of ground and of obstacle that ground on which the wheels spin gains; at least one of each of a positive gain,
/// because ground alone would make it free, and obstacle alone would close it.
fn spun_cells(gain: f64) -> [u64; 2] {
    let cells = if gain > 0.0 { cells_of(gain).max(2) } else { 0 };
    let bumped = (SPUN_SHARE * cells as f64).round() as u64;
    [cells - bumped, bumped]
}

/// The vehicle at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vehicle {
    /// Its pose in the local frame.
    pub local_from_vehicle: Pose,
    /// Distance of the ground under the wheels below the origin of its frame, m.
    pub wheels_below_m: f64,
    /// Its height above that ground, m.
    pub height_m: f64,
}

impl Vehicle {
    /// Height of the ground under it, local frame, mm.
    fn ground_mm(&self) -> i32 {
        let up = self.local_from_vehicle.rotate(DVec3::Z);
        ((self.local_from_vehicle.translation.z - up.z * self.wheels_below_m) * 1000.0) as i32
    }
}

/// How far experience reaches.
#[derive(Clone, Copy)]
struct Reach {
    /// Number of cells at once from which a model gains.
    cells: usize,
    /// Greatest height of an obstacle of which driving over it tells, mm: what is higher hung over the way.
    height_mm: u32,
    /// Height of the ground under the vehicle, local frame, mm.
    ground_mm: i32,
}

impl Reach {
    /// Of the vehicle.
    fn own(vehicle: &Vehicle) -> Reach {
        let height_mm = (vehicle.height_m * 1000.0).round() as u32;
        Reach { cells: usize::MAX, height_mm, ground_mm: vehicle.ground_mm() }
    }

    /// Of an operator, while the ground under the vehicle is at this height.
    fn told(ground_mm: i32) -> Reach {
        Reach { cells: MARKED_CELLS, height_mm: u32::MAX, ground_mm }
    }
}

/// A rectangle on the ground under or in front of the vehicle, vehicle frame, m: x forward, y left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// From rear to front.
    pub x: [f64; 2],
    /// From right to left.
    pub y: [f64; 2],
}

/// Experience of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Experience {
    /// The vehicle drove over it, or an operator says that it can.
    Driven,
    /// The bumper hit something in it, or an operator says that it would.
    Bumped,
}

/// Corners of a patch in the local frame, m.
fn corners(local_from_vehicle: &Pose, patch: &Patch) -> [DVec2; 4] {
    [0, 1, 2, 3].map(|i| {
        let corner = DVec3::new(patch.x[i & 1], patch.y[i >> 1], 0.0);
        (*local_from_vehicle * corner).truncate()
    })
}

/// Whether a position lies inside of an outline, by counting crossings.
fn contains(outline: &[DVec2], at: DVec2) -> bool {
    let edges = outline.iter().zip(outline.iter().cycle().skip(1));
    let crossed = edges.filter(|(a, b)| {
        (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
    });
    crossed.count() % 2 == 1
}

impl TerrainMap {
    /// Takes the height of the ground under the vehicle, above which the heights of obstacles are measured.
    pub fn stand(&mut self, vehicle: &Vehicle) {
        self.ground_mm = vehicle.ground_mm();
    }

    /// Adds ground to cells that have come under the vehicle since the last call (learning by experience).
    pub fn drive(&mut self, vehicle: &Vehicle, outline: &Patch, gain: f64, rules: &ModelRules) {
        let under = self.covered(&vehicle.local_from_vehicle, outline);
        let fresh: Vec<CellIndex> =
            under.iter().copied().filter(|cell| self.under.binary_search(cell).is_err()).collect();
        self.experience(&fresh, Experience::Driven, [cells_of(gain), 1], Reach::own(vehicle), rules);
        self.experienced[0] += fresh.len() as u64;
        self.under = under;
    }

    /// Adds obstacles to the cells of a patch that the bumper hit: those whose centres lie in it, or those of its corners where
    /// it has no centre.
    pub fn bump(&mut self, vehicle: &Vehicle, patch: &Patch, gain: f64, rules: &ModelRules) {
        let mut hit = self.covered(&vehicle.local_from_vehicle, patch);
        if hit.is_empty() {
            let corners = corners(&vehicle.local_from_vehicle, patch).into_iter();
            let cells = corners.filter_map(|corner| self.cells.cell_at(corner));
            hit = cells.filter(|cell| self.cells.contains(*cell)).collect();
            hit.sort_unstable();
            hit.dedup();
        }
        self.experience(&hit, Experience::Bumped, [cells_of(gain); 2], Reach::own(vehicle), rules);
        self.experienced[1] += hit.len() as u64;
    }

    /// Adds ground and obstacles to the cells of a patch on which the wheels have begun to spin; to each cell once, however
    /// long the vehicle tries to leave it.
    pub fn spin(&mut self, vehicle: &Vehicle, patch: &Patch, gain: f64, rules: &ModelRules) {
        let mut spun = self.covered(&vehicle.local_from_vehicle, patch);
        spun.retain(|cell| self.get(*cell).is_none_or(|cell| cell.terrain.bumped == 0));
        let reach = Reach::own(vehicle);
        let [driven, bumped] = spun_cells(gain);
        self.experience(&spun, Experience::Bumped, [bumped; 2], reach, rules);
        self.experience(&spun, Experience::Driven, [driven, 0], reach, rules);
        self.experienced[0] += spun.len() as u64;
    }

    /// Adds experience to the cells of an outline that an operator has drawn, local frame, m: those whose centres lie
    /// inside, or those of its corners where it is smaller than a cell. A model gains from at most [`MARKED_CELLS`] of
    /// them. Returns their number.
    pub fn mark(&mut self, outline: &[DVec2], what: Experience, gain: f64, rules: &ModelRules) -> u64 {
        let corners: Vec<CellIndex> = outline
            .iter()
            .filter_map(|corner| self.cells.cell_at(*corner).filter(|cell| self.cells.contains(*cell)))
            .collect();
        let bounds = self.cells.bounds();
        let mut inside: Vec<CellIndex> =
            bounds.iter().filter(|cell| contains(outline, self.cells.middle_of(*cell))).collect();
        if inside.is_empty() {
            inside = corners;
        }
        inside.sort_unstable();
        inside.dedup();
        self.experience(&inside, what, [cells_of(gain); 2], Reach::told(self.ground_mm), rules);
        self.experienced[2] += inside.len() as u64;
        inside.len() as u64
    }

    /// Adds experience to cells, and to each of their models: the first number of cells, and the second one to what was
    /// driven over although range called it an obstacle.
    fn experience(
        &mut self,
        cells: &[CellIndex],
        what: Experience,
        [gained, overrules]: [u64; 2],
        reach: Reach,
        rules: &ModelRules,
    ) {
        let mut signatures = self.models.signatures(&rules.weights);
        let mut counted: BTreeMap<u32, usize> = BTreeMap::new();
        // Lessons that a model which the cell joins later shall learn; in the second list, one from near.
        let mut untold: [Vec<(CellIndex, Lesson)>; 2] = [Vec::new(), Vec::new()];
        let mut near = 0;
        let (driven, bumped) = if what == Experience::Driven { (gained, 0) } else { (0, gained) };
        for &index in cells {
            let Some(slot) = self.cells.get_mut(index) else { continue };
            let cell = Arc::make_mut(slot.get_or_insert_default());
            if cell.model.is_none() {
                cell.model = self.models.alike(&cell.terrain, rules, &signatures).map(|number| number as u32);
            }
            if cell.model.is_none() && rules.is_seen(&cell.terrain) {
                // Nothing is like it yet: what is experienced here shall reach what looks like it.
                let (gift, count) = cell.gift();
                let look = &cell.terrain.histograms;
                if let Some(number) = self.models.take_part(look, (&gift, count), rules, &mut signatures) {
                    let lesson = cell.join(number as u32);
                    self.models.models[number].terrain.learn(&lesson);
                }
            }
            let mut counts = |number: &u32| {
                let count = counted.entry(*number).or_default();
                *count += 1;
                *count <= reach.cells
            };
            let counted_if =
                |is_counted| if what == Experience::Driven && is_counted { overrules } else { 0 };
            let driven_labelled = counted_if(cell.terrain.is_labelled());
            let driven_obstacle = counted_if(cell.terrain.is_obstacle_by_range());
            let height_mm =
                if driven_obstacle > 0 { cell.terrain.heights.obstacle_mm(reach.ground_mm) } else { 0 };
            let driven_height_mm = height_mm.min(reach.height_mm);
            let lesson = Lesson { driven, bumped, driven_labelled, driven_obstacle, driven_height_mm };
            cell.terrain.learn(&lesson);
            near += usize::from(cell.is_near);
            if cell.model.is_none() {
                untold[0].push((index, lesson));
            }
            if !cell.is_near {
                untold[1].push((index, lesson));
            }
            let far = cell.far.filter(|far| cell.model != Some(*far));
            for number in [cell.model, far].into_iter().flatten().filter(|number| counts(number)) {
                if let Some(model) = self.models.models.get_mut(number as usize) {
                    model.terrain.learn(&lesson);
                }
            }
        }
        let most = counted.values().copied().max().unwrap_or(0);
        self.keep(&untold[0], reach.cells.saturating_sub(most), |cell| &mut cell.untold);
        self.keep(&untold[1], reach.cells.saturating_sub(near), |cell| &mut cell.untold_near);
    }

    /// Keeps lessons for models that their cells join later: those of so many cells at most, spread over all of them.
    fn keep(&mut self, lessons: &[(CellIndex, Lesson)], most: usize, place: fn(&mut Cell) -> &mut Lesson) {
        if most == 0 {
            return;
        }
        let every = lessons.len().div_ceil(most).max(1);
        for (index, lesson) in lessons.iter().step_by(every) {
            if let Some(Some(cell)) = self.cells.get_mut(*index) {
                place(Arc::make_mut(cell)).merge(lesson);
            }
        }
    }

    /// Cells whose centres lie in a patch, sorted.
    pub(super) fn covered(&self, local_from_vehicle: &Pose, patch: &Patch) -> Vec<CellIndex> {
        let corners = corners(local_from_vehicle, patch);
        let low = corners.into_iter().fold(DVec2::INFINITY, DVec2::min);
        let high = corners.into_iter().fold(DVec2::NEG_INFINITY, DVec2::max);
        let (Some(low), Some(high)) = (self.cells.cell_at(low), self.cells.cell_at(high)) else {
            return Vec::new();
        };
        let vehicle_from_local = local_from_vehicle.inverse();
        let height = local_from_vehicle.translation.z;
        let mut covered = Vec::new();
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                let index = CellIndex::new(x, y);
                let place = vehicle_from_local * self.cells.middle_of(index).extend(height);
                let on = |v: f64, [from, to]: [f64; 2]| v >= from && v <= to;
                if on(place.x, patch.x) && on(place.y, patch.y) && self.cells.contains(index) {
                    covered.push(index);
                }
            }
        }
        covered
    }
}
