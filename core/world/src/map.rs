//! The map around the vehicle.

use rcs_geom::{CellIndex, CellRect, DVec2, Exposed, GridError, ScrollGrid};
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

use crate::fusion::{Fuser, Layers};
use crate::{Cell, Evidence, Fused, Label, MAX_COST, Source, Sources, Vote, VoteRule, Weights};

/// Cells per side of WM1, and of WM2 in the papers, so that the vehicle is in cell (100, 100).
pub const SIDE: usize = 201;
/// Greatest number of cells per side.
pub const MAX_SIDE: usize = 401;
/// Cell size of WM1, and of the cost maps that it reads, m.
pub const CELL_SIZE_M: f64 = 0.2;

/// A world-model map: a square of cells, north-up, the vehicle in the middle cell. WM1 has 201×201 cells of 0.2 m (about
/// 40 m across); WM2 of the papers has as many of 0.6 m (about 120 m).
///
/// One grid holds the state of the ground; each source has a grid of evidence of its own, which is created by its first
/// vote. Clones share the tiles that neither has written since.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Map {
    grid: ScrollGrid<Cell>,
    /// In the order of first votes; all of the shape and window of `grid`.
    layers: Vec<(Source, ScrollGrid<Evidence>)>,
}

/// Whether both hold the same state: a source without evidence equals one that is absent.
impl PartialEq for Map {
    fn eq(&self, other: &Map) -> bool {
        let silent = |layer: &ScrollGrid<Evidence>| layer.iter().all(|(_, said)| *said == Evidence::NONE);
        let mut sources = self.sources();
        other.sources().iter().for_each(|source| sources.insert(source));
        self.grid == other.grid
            && sources.iter().all(|source| match (self.layer(source), other.layer(source)) {
                (Some(a), Some(b)) => a == b,
                (Some(layer), None) | (None, Some(layer)) => silent(layer),
                (None, None) => true,
            })
    }
}

impl Map {
    /// An unknown map of 201×201 cells around the frame's origin.
    pub fn new(cell_size_m: f64) -> Result<Map, GridError> {
        Map::with_side(SIDE, cell_size_m)
    }

    /// An unknown map around the frame's origin. An even number of cells per side puts the vehicle north-east of the
    /// middle.
    pub fn with_side(side: usize, cell_size_m: f64) -> Result<Map, GridError> {
        Ok(Map { grid: ScrollGrid::new(side, cell_size_m, Cell::default())?, layers: Vec::new() })
    }

    /// Cells per side.
    pub fn side(&self) -> usize {
        self.grid.side()
    }

    /// The state of the ground.
    pub fn grid(&self) -> &ScrollGrid<Cell> {
        &self.grid
    }

    /// The state of the ground in a cell, to write; `None` outside of the map.
    pub fn cell_mut(&mut self, index: CellIndex) -> Option<&mut Cell> {
        self.grid.get_mut(index)
    }

    /// The evidence of a source; `None` if it has not voted yet.
    pub fn layer(&self, source: Source) -> Option<&ScrollGrid<Evidence>> {
        self.layers.iter().find(|(name, _)| *name == source).map(|(_, layer)| layer)
    }

    /// The place of a source in the order of first votes; `None` if it has not voted yet.
    pub(crate) fn layer_number(&self, source: Source) -> Option<usize> {
        self.layers.iter().position(|(name, _)| *name == source)
    }

    /// The evidence of a source about a cell.
    pub fn evidence(&self, source: Source, index: CellIndex) -> Evidence {
        self.layer(source).and_then(|layer| layer.get(index)).copied().unwrap_or_default()
    }

    /// Forgets the evidence of the other sources. What they said of heights stays, because it is not kept by source.
    pub fn keep_sources(&mut self, is_kept: impl Fn(Source) -> bool) {
        self.layers.retain(|(source, _)| is_kept(*source));
    }

    /// Sources that have voted, in the order of their first votes.
    pub fn sources(&self) -> Sources {
        self.layers.iter().map(|&(source, _)| source).collect()
    }

    /// The evidence of a source, to write; creates its grid if necessary.
    pub(crate) fn layer_mut(&mut self, source: Source) -> &mut ScrollGrid<Evidence> {
        let place = self.layers.iter().position(|(name, _)| *name == source);
        let place = place.unwrap_or_else(|| {
            self.layers.push((source, self.grid.like(Evidence::NONE)));
            self.layers.len() - 1
        });
        &mut self.layers[place].1
    }

    /// The state of the ground, to write complete tiles.
    pub(crate) fn grid_mut(&mut self) -> &mut ScrollGrid<Cell> {
        &mut self.grid
    }

    /// Scrolls so that the vehicle (metres in the map's frame) is in the middle cell; newly exposed cells are unknown.
    /// For a position that is not finite nothing moves, and the result is `None`.
    pub fn recentre(&mut self, p_vehicle: DVec2) -> Option<Exposed> {
        let centre = self.grid.cell_at(p_vehicle)?;
        Some(self.recentre_on(centre))
    }

    /// Scrolls so that this is the middle cell.
    pub(crate) fn recentre_on(&mut self, centre: CellIndex) -> Exposed {
        for (_, layer) in &mut self.layers {
            layer.recentre(centre);
        }
        self.grid.recentre(centre)
    }

    /// Moves the window without filling the newly exposed cells: for a copy whose tiles are then written like the
    /// original's.
    pub(crate) fn set_centre(&mut self, centre: CellIndex) {
        self.grid.set_centre(centre);
        self.layers.iter_mut().for_each(|(_, layer)| layer.set_centre(centre));
    }

    /// Approximate memory in bytes: what it shares with other maps in equal parts.
    pub fn share_of_memory(&self) -> usize {
        let layers = self.layers.iter().map(|(_, layer)| layer.share_of_memory());
        self.grid.share_of_memory() + layers.sum::<usize>()
    }

    /// Applies a vote of a source for a cell, see [`Evidence::voted`]; false if the cell lies outside of the map. A
    /// cost above 250 is ignored. The vehicle is in the middle cell.
    pub fn vote(
        &mut self,
        index: CellIndex,
        source: Source,
        vote: impl Into<Vote>,
        sequence: u32,
        time: Stamp,
        rule: VoteRule,
    ) -> bool {
        let vote: Vote = vote.into();
        if !self.grid.contains(index) || vote.cost > MAX_COST {
            return self.grid.contains(index);
        }
        if let Some(evidence) = self.layer_mut(source).get_mut(index) {
            *evidence = evidence.voted(vote, sequence, rule);
        }
        self.touch(index, time);
        if Label::of_cost(vote.cost) == Label::Obstacle && vote.worth > 0 {
            let centre = self.grid.centre();
            let cells = DVec2::new((index.x - centre.x) as f64, (index.y - centre.y) as f64);
            let distance_m = cells.length() * self.grid.cell_size_m();
            self.grid.get_mut(index).into_iter().for_each(|cell| cell.obstacle_seen_from(distance_m));
        }
        true
    }

    /// A source saw a cell, but not the obstacle that it had seen there before: the confidence in the obstacle falls as by
    /// a vote for ground, and there is no evidence of ground.
    pub fn missed(&mut self, index: CellIndex, source: Source, rule: VoteRule) {
        let is_obstacle = |held: &Evidence| Label::of_cost(held.cost) == Label::Obstacle;
        let Some(held) = self.layer(source).and_then(|layer| layer.get(index)).copied().filter(is_obstacle)
        else {
            return;
        };
        if let Some(evidence) = self.layer_mut(source).get_mut(index) {
            *evidence = held.faded(rule.obstacle_fall);
        }
    }

    /// Replaces the evidence of a source within a window by its own statement: that of the listed cells, and none in the
    /// other cells of the window. What it said outside of it stays: a source whose map moves with the vehicle says no more
    /// of what it has left. Cells outside of the map are left out. Cells whose evidence stays the same but for its sequence
    /// are not written. One that only another model states is not touched: nothing else of it has changed.
    pub fn state(&mut self, source: Source, window: CellRect, cells: &[(CellIndex, Evidence)], time: Stamp) {
        let bounds = self.grid.bounds();
        let slot = |index: CellIndex| {
            let [column, row] = [index.x - bounds.south_west.x, index.y - bounds.south_west.y];
            (row * bounds.columns as i64 + column) as usize
        };
        let mut stated = vec![Evidence::NONE; bounds.columns * bounds.rows];
        for (index, evidence) in cells.iter().filter(|(index, _)| bounds.contains(*index)) {
            let is_known = evidence.confidence > 0 && evidence.cost <= MAX_COST;
            stated[slot(*index)] = if is_known { *evidence } else { Evidence::NONE };
        }
        let layer = self.layer_mut(source);
        let mut changed = Vec::new();
        layer.for_each_run(|at, first, held| {
            for (column, (held, now)) in held.iter().zip(&stated[at..]).enumerate() {
                let index = first.offset(column as i64, 0);
                if (Evidence { sequence: held.sequence, ..*now }) != *held && window.contains(index) {
                    let same_but_model =
                        Evidence { sequence: held.sequence, model: held.model, ..*now } == *held;
                    changed.push((index, *now, same_but_model));
                }
            }
        });
        for &(index, now, _) in &changed {
            if let Some(evidence) = layer.get_mut(index) {
                *evidence = now;
            }
        }
        for (index, ..) in changed.into_iter().filter(|(.., same_but_model)| !same_but_model) {
            self.touch(index, time);
        }
    }

    /// Lets all evidence of a source fade by an amount, see [`Evidence::faded`].
    pub fn fade(&mut self, source: Source, amount: u8) {
        let Some((_, layer)) = self.layers.iter_mut().find(|(name, _)| *name == source) else { return };
        for tile in 0..layer.tile_count() {
            if amount > 0 && layer.tile(tile).iter().any(|evidence| evidence.confidence > 0) {
                layer.tile_mut(tile).iter_mut().for_each(|evidence| *evidence = evidence.faded(amount));
            }
        }
    }

    /// The clock of a source has begun again: cells of which it says something count as last changed at this time at the
    /// latest.
    pub fn limit_updated(&mut self, source: Source, time: Stamp) {
        let Some(layer) = self.layer(source) else { return };
        let is_later = |index: &CellIndex| self.grid.get(*index).is_some_and(|cell| cell.updated > time);
        let said = layer.iter().filter(|(_, evidence)| **evidence != Evidence::NONE);
        let later: Vec<CellIndex> = said.map(|(index, _)| index).filter(is_later).collect();
        for index in later {
            if let Some(cell) = self.grid.get_mut(index) {
                cell.updated = time;
            }
        }
    }

    fn touch(&mut self, index: CellIndex, time: Stamp) {
        if let Some(cell) = self.grid.get_mut(index) {
            cell.updated = cell.updated.max(time);
        }
    }

    /// The fused result of a cell; unknown outside of the map.
    pub fn fused(&self, index: CellIndex, weights: &Weights) -> Fused {
        if !self.grid.contains(index) {
            return Fused::UNKNOWN;
        }
        let layers = self.placed(weights);
        Fuser::new(&layers).fuse(|layer| self.layers[layer].1.get(index).copied().unwrap_or_default())
    }

    /// Calls `visit` with the fused result of each cell, by rows from the south, west to east.
    pub fn for_each_fused(&self, weights: &Weights, mut visit: impl FnMut(CellIndex, Fused)) {
        self.for_each_cell(weights, |index, _, _, fused| visit(index, fused));
    }

    /// The same, with the state of the ground, and what each source says, in the order of their first votes.
    pub(crate) fn for_each_cell(
        &self,
        weights: &Weights,
        mut visit: impl FnMut(CellIndex, &Cell, &[Evidence], Fused),
    ) {
        let layers = self.placed(weights);
        let fuser = Fuser::new(&layers);
        let mut runs: Vec<&[Evidence]> = Vec::with_capacity(self.layers.len());
        let mut said = vec![Evidence::NONE; self.layers.len()];
        self.grid.for_each_run(|_, index, cells| {
            runs.clear();
            runs.extend(self.layers.iter().map(|(_, layer)| layer.run_from(index, cells.len())));
            for (at, cell) in cells.iter().enumerate() {
                let mut is_known = false;
                for (said, run) in said.iter_mut().zip(&runs) {
                    *said = run.get(at).copied().unwrap_or_default();
                    is_known |= said.confidence > 0;
                }
                // Most cells are unknown.
                let fused = if is_known { fuser.fuse(|layer| said[layer]) } else { Fused::UNKNOWN };
                visit(index.offset(at as i64, 0), cell, &said, fused);
            }
        });
    }

    /// The same for the cells of one tile, in the order in which they are stored.
    pub(crate) fn for_each_in_tile(
        &self,
        tile: usize,
        weights: &Weights,
        mut visit: impl FnMut(&Cell, &[Evidence], Fused),
    ) {
        let layers = self.placed(weights);
        let fuser = Fuser::new(&layers);
        let tiles: Vec<&[Evidence]> = self.layers.iter().map(|(_, layer)| layer.tile(tile)).collect();
        let mut said = vec![Evidence::NONE; tiles.len()];
        for (at, cell) in self.grid.tile(tile).iter().enumerate() {
            if self.grid.cell_in(tile, at).is_none() {
                continue;
            }
            let mut is_known = false;
            for (said, layer) in said.iter_mut().zip(&tiles) {
                *said = layer.get(at).copied().unwrap_or_default();
                is_known |= said.confidence > 0;
            }
            let fused = if is_known { fuser.fuse(|layer| said[layer]) } else { Fused::UNKNOWN };
            visit(cell, &said, fused);
        }
    }

    fn placed(&self, weights: &Weights) -> Layers {
        weights.placed(self.layers.iter().map(|&(source, _)| source))
    }

    /// Makes all cells unknown; the window does not move.
    pub fn clear(&mut self) {
        self.grid.clear();
        self.layers.clear();
    }
}
