//! Terrain models: cells of similar appearance, and the experience of driving over them (Albus 2006a, 3.2, steps 4 and
//! 5).

use crate::appearance::{Histograms, MatchWeights, Signature};
use rcs_sense::{Sample, last_learned, learned_name};
use serde::{Deserialize, Serialize};

/// Contents of a cell or a model, which have the same structure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Terrain {
    /// Appearance, summed over all points.
    pub histograms: Histograms,
    /// Points labelled ground from range.
    pub ground: u64,
    /// Points labelled obstacle from range.
    pub obstacle: u64,
    /// Experience of ground: cells driven over, times the gain of driving.
    pub driven: u64,
    /// Experience of obstacles: cells hit by the bumper, times the gain of the bumper.
    pub bumped: u64,
    /// Cells driven over that range had labelled.
    pub driven_labelled: u64,
    /// Those of them that it had called obstacles.
    pub driven_obstacle: u64,
    /// Greatest height of those above the ground under the vehicle, mm.
    pub driven_height_mm: u32,
    /// Heights of the points of a cell; of a model they say nothing, and are not stored.
    pub heights: Heights,
}

/// One experience of a cell: what it adds to the fields of [`Terrain`] of the same names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lesson {
    /// Experience of ground, in cells.
    pub driven: u64,
    /// Experience of obstacles, in cells.
    pub bumped: u64,
    /// Cells driven over that range had labelled.
    pub driven_labelled: u64,
    /// Those of them that it had called obstacles.
    pub driven_obstacle: u64,
    /// Greatest height of those above the ground under the vehicle, mm.
    pub driven_height_mm: u32,
}

impl Lesson {
    /// Adds another one.
    pub fn merge(&mut self, other: &Lesson) {
        self.driven = self.driven.saturating_add(other.driven);
        self.bumped = self.bumped.saturating_add(other.bumped);
        self.driven_labelled = self.driven_labelled.saturating_add(other.driven_labelled);
        self.driven_obstacle = self.driven_obstacle.saturating_add(other.driven_obstacle);
        self.driven_height_mm = self.driven_height_mm.max(other.driven_height_mm);
    }
}

/// Heights of labelled points in the local frame, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Heights {
    /// Of the lowest point.
    pub lowest_mm: Option<i32>,
    /// Of the highest point of an obstacle.
    pub obstacle_top_mm: Option<i32>,
}

impl Heights {
    /// Adds all points of another.
    fn merge(&mut self, other: &Heights) {
        self.lowest_mm = self.lowest_mm.into_iter().chain(other.lowest_mm).min();
        self.obstacle_top_mm = self.obstacle_top_mm.max(other.obstacle_top_mm);
    }

    /// Height of the obstacle above its lowest point or the ground under the vehicle, whichever is lower, mm; 0 without one.
    pub fn obstacle_mm(&self, ground_mm: i32) -> u32 {
        let base_mm = self.lowest_mm.map_or(ground_mm, |lowest_mm| lowest_mm.min(ground_mm));
        self.obstacle_top_mm.map_or(0, |top_mm| top_mm.saturating_sub(base_mm).max(0) as u32)
    }
}

/// What was seen of a model from range counts as at most this many cells, however long it was looked at, so that
/// experience of a few metres outweighs it.
pub const SEEN_CELLS: u64 = 20;

/// Cells that range called obstacles and that were driven over, from which on experience backs their model fully: a metre
/// of the vehicle's way through growth.
pub const BACKED_CELLS: u64 = 10;

/// Of the cells of a model that were driven over, the share that range had called obstacles: up to the first value they may
/// be the edges of things beside the way, which is ground; from the second one on, the way led through what range takes for
/// an obstacle. Measured: 0 on `corridor_2` and `wrong_branches_2`, 0.4 to 0.84 in tall grass, 0.18 to 0.6 where the vehicle
/// has then gone around what stereo still calls obstacles.
const CONTRADICTED: [f64; 2] = [0.05, 0.2];

/// Least number of points with which a cell can be said to resemble a model.
pub const ALIKE_POINTS: u64 = 8;

/// A model is like another one up to this multiple of the distance of a match.
const LIKE: f32 = 2.0;

/// Mud in another light differs by more from what was driven over. It is like mud, too, where it is this many times as near
/// to it as to any firm ground that was driven over, up to [`MOST_LIKE`]. Measured on models of a drive among puddles that no
/// wheel had touched: all 17 of mud and one of 31 of firm ground.
const NEARER: f32 = 2.0;
const MOST_LIKE: f32 = 0.3;

/// Ground is slippery from this share of slip on in its experience; that of slip alone has 0.4. Firm ground has some where
/// a cell is partly mud.
const SLIPPERY_SHARE: f64 = 0.2;

impl Terrain {
    /// Number of points labelled from range.
    pub fn points(&self) -> u64 {
        self.ground + self.obstacle
    }

    /// Share of the more frequent label among the points labelled from range; 0 without points.
    pub fn purity(&self) -> f64 {
        self.ground.max(self.obstacle) as f64 / self.points().max(1) as f64
    }

    /// Experience of both kinds, in cells.
    pub fn experience(&self) -> u64 {
        self.driven.saturating_add(self.bumped)
    }

    /// Whether its experience outweighs what was seen of it: a few cells at the edge of mud, over which wheels came without
    /// slipping, say little about ground that looks like it.
    pub fn is_experienced(&self) -> bool {
        self.experience() >= SEEN_CELLS
    }

    /// Whether much of its experience is slip.
    fn is_slippery(&self) -> bool {
        self.bumped as f64 > SLIPPERY_SHARE * self.experience() as f64
    }

    /// Forgets its points; its experience and heights stay.
    pub fn forget_points(&mut self) {
        (self.histograms, self.ground, self.obstacle) = (Histograms::default(), 0, 0);
    }

    /// Its points and heights alone.
    #[must_use]
    pub fn without_experience(&self) -> Terrain {
        let Terrain { histograms, ground, obstacle, heights, .. } = *self;
        Terrain { histograms, ground, obstacle, heights, ..Terrain::default() }
    }

    /// Adds an experience.
    pub fn learn(&mut self, lesson: &Lesson) {
        let Lesson { driven, bumped, driven_labelled, driven_obstacle, driven_height_mm } = *lesson;
        self.driven = self.driven.saturating_add(driven);
        self.bumped = self.bumped.saturating_add(bumped);
        self.driven_labelled = self.driven_labelled.saturating_add(driven_labelled);
        self.driven_obstacle = self.driven_obstacle.saturating_add(driven_obstacle);
        self.driven_height_mm = self.driven_height_mm.max(driven_height_mm);
    }

    /// Whether range has labelled it, by enough points to say so.
    pub fn is_labelled(&self) -> bool {
        self.points() >= ALIKE_POINTS
    }

    /// Whether range calls it an obstacle, by enough points to say so.
    pub fn is_obstacle_by_range(&self) -> bool {
        self.is_labelled() && 2 * self.obstacle >= self.points()
    }

    /// How far driving has contradicted range, 0 to 1: by the share of what range had called obstacles among what was driven
    /// over, see [`CONTRADICTED`].
    fn contradicted(&self) -> f64 {
        let share = self.driven_obstacle as f64 / self.driven_labelled.max(1) as f64;
        let [none, all] = CONTRADICTED;
        if self.driven_labelled == 0 { 0.0 } else { ((share - none) / (all - none)).clamp(0.0, 1.0) }
    }

    /// `N_obstacle / (N_ground + N_obstacle)` (the paper calls this traversability), in cells: its points from range
    /// are `seen` cells with the share of obstacles among them, to which experience adds its cells. `None` where
    /// nothing is known.
    pub fn obstacle_fraction(&self, seen: u64) -> Option<f64> {
        let points = self.points();
        let seen = if points > 0 { seen as f64 } else { 0.0 };
        let obstacle = seen * self.obstacle as f64 / points.max(1) as f64 + self.bumped as f64;
        let all = seen + self.experience() as f64;
        (all > 0.0).then(|| obstacle / all)
    }

    /// Adds all points of another.
    pub fn merge(&mut self, other: &Terrain) {
        self.histograms.merge(&other.histograms);
        self.ground = self.ground.saturating_add(other.ground);
        self.obstacle = self.obstacle.saturating_add(other.obstacle);
        self.driven = self.driven.saturating_add(other.driven);
        self.bumped = self.bumped.saturating_add(other.bumped);
        self.driven_labelled = self.driven_labelled.saturating_add(other.driven_labelled);
        self.driven_obstacle = self.driven_obstacle.saturating_add(other.driven_obstacle);
        self.driven_height_mm = self.driven_height_mm.max(other.driven_height_mm);
        self.heights.merge(&other.heights);
    }
}

/// A model: terrain, and the number of cells merged into it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Model {
    /// Sums over all its cells.
    pub terrain: Terrain,
    /// Number of cells that became it or were merged into it.
    pub cells: u64,
    /// What one of its cells looked like, once one has been seen; it is for display alone.
    pub sample: Option<Sample>,
    /// What it is called, while models before it come and go; empty until its set names it.
    pub name: String,
}

impl Model {
    /// A model of cells with these sums, without a picture and a name.
    pub fn new(terrain: Terrain, cells: u64) -> Model {
        Model { terrain, cells, sample: None, name: String::new() }
    }

    /// The obstacle fraction of what looks like it, see [`Terrain::obstacle_fraction`]; what was seen counts as its
    /// cells, at most [`SEEN_CELLS`]. `None` where nothing is known.
    pub fn obstacle_fraction(&self) -> Option<f64> {
        self.terrain.obstacle_fraction(self.cells.clamp(1, SEEN_CELLS))
    }

    /// How far driving has contradicted range, 0 to 1: as far as much of what was driven over had been called an obstacle
    /// by range, from [`BACKED_CELLS`] of them on. Driving over ground beside a thicket of the same colour, which
    /// is one model with it, says nothing about the thicket.
    pub fn driven_backing(&self) -> f64 {
        share(self.terrain.driven_obstacle, BACKED_CELLS) * self.terrain.contradicted()
    }

    /// How far experience backs its obstacle fraction against what range says of a cell, 0 to 1: driving as
    /// [`Self::driven_backing`] says, and only where the cell is no higher than what was driven over; a bump as far as range
    /// called the model ground. A bump counts fully once it outweighs all that was seen, and only where the model is more of
    /// an obstacle than the cell: a stone on ground where wheels have spun is still a stone.
    pub fn backing(&self, cell: &Terrain, is_low: bool) -> f64 {
        let driven = if is_low { self.driven_backing() } else { 0.0 };
        if cell.obstacle_fraction(1) > self.obstacle_fraction() {
            return driven;
        }
        let obstacle = self.terrain.obstacle as f64 / self.terrain.points().max(1) as f64;
        let bumped = share(self.terrain.bumped, SEEN_CELLS) * (2.0 * (1.0 - obstacle)).min(1.0);
        driven.max(bumped)
    }
}

/// A number of cells as a share of another, at most 1.
fn share(cells: u64, all: u64) -> f64 {
    (cells as f64 / all as f64).min(1.0)
}

/// Rules for cells to become models.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelRules {
    /// Minimum number of points of a cell.
    pub min_points: u64,
    /// Minimum share of the more frequent label, 0 to 1.
    pub min_purity: f64,
    /// Maximum distance of a match.
    pub merge_distance: f32,
    /// Maximum number of models.
    pub max_models: usize,
    /// A cell is seen from near up to this distance from the vehicle, m.
    pub near_m: f64,
    /// Weights of a match, normalised.
    pub weights: MatchWeights,
}

impl ModelRules {
    /// Whether a cell can become a model.
    pub fn is_ready(&self, cell: &Terrain) -> bool {
        self.is_seen(cell) && cell.purity() >= self.min_purity
    }

    /// Whether a cell has enough points to be compared with models.
    pub fn is_seen(&self, cell: &Terrain) -> bool {
        cell.points() >= self.min_points
    }
}

/// A set of models in the order in which they were learned; the number of a model is its index.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelSet {
    /// The models.
    pub models: Vec<Model>,
    /// The greatest number in a name that was given so far.
    pub named: u64,
}

impl ModelSet {
    /// Appearances of all models, prepared for comparison with these weights.
    pub fn signatures(&self, weights: &MatchWeights) -> Vec<Signature> {
        self.models.iter().map(|model| weights.signature(&model.terrain.histograms)).collect()
    }

    /// Names the models that have no name, such as those of an older file.
    pub fn name_all(&mut self) {
        self.named = self.named.max(last_learned(self.models.iter().map(|model| model.name.as_str())));
        for model in self.models.iter_mut().filter(|model| model.name.is_empty()) {
            self.named = self.named.saturating_add(1);
            model.name = learned_name(self.named);
        }
    }

    /// A model of one appearance with the next name.
    fn learned(&mut self, terrain: &Terrain, cells: u64) -> Model {
        self.named = self.named.saturating_add(1);
        Model { name: learned_name(self.named), ..Model::new(*terrain, cells) }
    }

    /// Merges a cell with its best match, or makes it a model where none is near enough. `signatures` are those of
    /// [`ModelSet::signatures`] with the weights of the rules, and are updated. `None` if there is no match and no
    /// room.
    pub fn take(
        &mut self,
        cell: &Terrain,
        cells: u64,
        rules: &ModelRules,
        signatures: &mut Vec<Signature>,
    ) -> Option<usize> {
        self.take_part(&cell.histograms, (cell, cells), rules, signatures)
    }

    /// The same for a cell that looks like this, of which a model gains only these sums and this number of cells.
    pub fn take_part(
        &mut self,
        look: &Histograms,
        (gained, cells): (&Terrain, u64),
        rules: &ModelRules,
        signatures: &mut Vec<Signature>,
    ) -> Option<usize> {
        match rules.weights.signature(look).best(signatures) {
            Some((best, distance)) if distance <= rules.merge_distance => {
                let model = &mut self.models[best];
                model.terrain.merge(gained);
                model.cells += cells;
                signatures[best] = rules.weights.signature(&model.terrain.histograms);
                Some(best)
            }
            _ if self.models.len() < rules.max_models => {
                let model = self.learned(gained, cells.max(1));
                signatures.push(rules.weights.signature(&model.terrain.histograms));
                self.models.push(model);
                Some(self.models.len() - 1)
            }
            _ => None,
        }
    }

    /// The model that a cell resembles most, if it is near enough for its number of points: the histogram of n points
    /// differs from the distribution that they come from by up to 1/n (the expectation of the squared difference).
    pub fn alike(&self, cell: &Terrain, rules: &ModelRules, signatures: &[Signature]) -> Option<usize> {
        if cell.points() < ALIKE_POINTS {
            return None;
        }
        let (best, distance) = rules.weights.signature(&cell.histograms).best(signatures)?;
        (distance <= rules.merge_distance + 1.0 / cell.points() as f32).then_some(best)
    }

    /// For each model of ground that has hardly any experience, the number of the one that it is most like of those that were
    /// driven over, if it is like it and wheels have slipped there: ground far ahead is mostly of models over which nothing
    /// has driven.
    pub fn like_slippery(&self, rules: &ModelRules) -> Vec<Option<u32>> {
        let signatures = self.signatures(&rules.weights);
        let is_driven = |number: &usize| {
            let terrain = &self.models[*number].terrain;
            terrain.is_experienced() && terrain.driven > 0
        };
        let is_slippery = |number: &usize| self.models[*number].terrain.is_slippery();
        let driven = (0..self.models.len()).filter(is_driven);
        let (slippery, firm): (Vec<usize>, Vec<usize>) = driven.partition(is_slippery);
        let [of_slippery, of_firm] =
            [&slippery, &firm].map(|of| of.iter().map(|&number| signatures[number]).collect::<Vec<_>>());
        let like = |(model, signature): (&Model, &Signature)| {
            let is_unknown_ground =
                !model.terrain.is_experienced() && 2 * model.terrain.obstacle < model.terrain.points();
            let (nearest, distance) = signature.best(&of_slippery).filter(|_| is_unknown_ground)?;
            let from_firm = signature.best(&of_firm).map(|(_, distance)| distance);
            let is_nearest = from_firm.is_none_or(|firm| distance < firm);
            let is_like = distance <= LIKE * rules.merge_distance
                || distance <= MOST_LIKE && from_firm.is_some_and(|firm| NEARER * distance <= firm);
            (is_nearest && is_like).then(|| slippery[nearest] as u32)
        };
        self.models.iter().zip(&signatures).map(like).collect()
    }

    /// Makes room for one more model by merging the two most similar models. Returns the index of the merged model,
    /// then the freed index; `None` if no two models are of the same kind. Only two models with the same classification
    /// (ground or obstacle) by range and experience are merged, so that a full set does not lose its obstacles among
    /// many kinds of ground.
    ///
    /// The paper does not say what happens with many kinds of terrain; without this rule the first cells of a frame
    /// would occupy all places.
    fn make_room(&mut self, signatures: &mut [Signature], rules: &ModelRules) -> Option<[usize; 2]> {
        let is_obstacle = |model: &Model| model.obstacle_fraction().is_some_and(|f| f >= 0.5);
        let kinds: Vec<bool> = self.models.iter().map(is_obstacle).collect();
        let mut best: Option<([usize; 2], f32)> = None;
        for (b, signature) in signatures.iter().enumerate() {
            for (a, other) in signatures[..b].iter().enumerate() {
                let distance = signature.distance(other);
                if kinds[a] == kinds[b] && best.is_none_or(|(_, least)| distance < least) {
                    best = Some(([a, b], distance));
                }
            }
        }
        let ([a, b], _) = best?;
        let gone = self.models.get(b)?.clone();
        let model = self.models.get_mut(a)?;
        model.terrain.merge(&gone.terrain);
        model.cells += gone.cells;
        signatures[a] = rules.weights.signature(&model.terrain.histograms);
        Some([a, b])
    }

    /// Makes a cell a model although the maximum is reached: the two most similar models are merged, and the cell takes
    /// the freed index. Returns the index of the merged model, then that of the cell.
    pub fn squeeze_in(
        &mut self,
        cell: &Terrain,
        rules: &ModelRules,
        signatures: &mut [Signature],
    ) -> Option<[usize; 2]> {
        let [a, b] = self.make_room(signatures, rules)?;
        self.models[b] = self.learned(cell, 1);
        signatures[b] = rules.weights.signature(&cell.histograms);
        Some([a, b])
    }

    /// Merges all models of another set, each with its best match.
    pub fn take_all(&mut self, other: &ModelSet, rules: &ModelRules) {
        let mut signatures = self.signatures(&rules.weights);
        for model in &other.models {
            let taken = self.take(&model.terrain, model.cells, rules, &mut signatures);
            if let Some(own) = taken.and_then(|number| self.models.get_mut(number)) {
                own.sample = own.sample.take().or_else(|| model.sample.clone());
            }
        }
    }
}

#[cfg(test)]
#[path = "models_tests.rs"]
pub(crate) mod tests;
