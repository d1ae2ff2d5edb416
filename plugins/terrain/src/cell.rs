//! A cell of the learning map, what is known of it, and what the models that it joins gain from it: each point and each
//! experience once. Of what the operator outlines, a model learns a few cells only, so a cell may have experience of which its
//! model knows nothing: then it is judged by itself.

use crate::judgement::{Judgement, SURE};
use crate::models::{Lesson, Model, ModelRules, Terrain};
use crate::surroundings::Part;
use rcs_world::MAX_COST;
use serde::{Deserialize, Serialize};

/// A cell of the learning map.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cell {
    /// Sums of its points and its experience.
    pub terrain: Terrain,
    /// Number of the model that it belongs to, or that it resembles.
    pub model: Option<u32>,
    /// Whether its points are part of that model.
    pub is_part: bool,
    /// Whether it was seen from near; what was seen from afar no longer counts then.
    pub is_near: bool,
    /// Number of the model that it belonged to or resembled from afar.
    pub far: Option<u32>,
    /// The points that it has got since it left a model, which keeps the others; `None` if no model has its points, or the
    /// one that it is part of has all.
    pub since: Option<Box<Terrain>>,
    /// Experience from when it had no model: that which it joins learns it.
    pub untold: Lesson,
    /// Experience from before it came near: the model that it joins then learns it.
    pub untold_near: Lesson,
}

impl Cell {
    /// Forgets its points from afar, and keeps the model that they made it part of.
    pub fn come_near(&mut self) {
        self.is_near = true;
        self.far = self.model.take();
        (self.is_part, self.since) = (false, None);
        self.untold = std::mem::take(&mut self.untold_near);
        self.terrain.forget_points();
    }

    /// Adds points.
    pub fn add(&mut self, points: &Terrain) {
        self.terrain.merge(points);
        if let Some(since) = &mut self.since {
            since.merge(points);
        }
    }

    /// Has no model any more. `new`: the points of the cell that the model has not gained.
    pub fn leave(&mut self, new: &Terrain) {
        if self.is_part {
            self.since = Some(Box::new(*new));
        }
        (self.model, self.is_part) = (None, false);
    }

    /// What a model gains that the cell joins: the points that no model has, and the number of cells, which is 0 for one that
    /// has been counted before.
    pub fn gift(&self) -> (Terrain, u64) {
        match &self.since {
            Some(since) => (**since, 0),
            None => (self.terrain.without_experience(), 1),
        }
    }

    /// Joins a model, which has gained [`Self::gift`]. Returns what the model learns of its experience.
    pub fn join(&mut self, number: u32) -> Lesson {
        (self.model, self.is_part, self.since) = (Some(number), true, None);
        let untold = std::mem::take(&mut self.untold);
        // What it experienced from afar, that model has learned.
        if self.far == Some(number) { Lesson::default() } else { untold }
    }
}

/// Judges a cell: by its model, where it belongs to one or where experience backs one that it resembles; else by itself.
/// `is_low`: it is no higher than what was driven over.
pub(crate) fn judgement(
    cell: &Cell,
    numbered: Option<(u32, &Model)>,
    is_low: bool,
    rules: &ModelRules,
) -> Option<Judgement> {
    let has_experience = cell.terrain.experience() > 0;
    let judges = |model: &Model| model.terrain.experience() > 0 || (cell.is_part && !has_experience);
    let numbered = numbered.filter(|(_, model)| judges(model));
    let model = numbered.map(|(_, model)| model);
    let fraction = match model {
        Some(model) => model.obstacle_fraction()?,
        None => cell.terrain.obstacle_fraction(1)?,
    };
    let backing =
        if has_experience { 1.0 } else { model.map_or(0.0, |model| model.backing(&cell.terrain, is_low)) };
    let seen = cell.terrain.points() as f64 / rules.min_points.max(1) as f64;
    let part = if has_experience { 1.0 } else { seen.min(1.0) };
    Some(Judgement {
        cost: (f64::from(MAX_COST) * fraction).round() as u8,
        confidence: (f64::from(SURE) * part).ceil() as u8,
        backing: (255.0 * backing).round() as u8,
        model: numbered.map_or(0, |(number, _)| u8::try_from(number + 1).unwrap_or(0)),
    })
}

/// Whether the surroundings of a cell judge it, or it them; `number`: of the model by which the cell is judged.
pub(crate) fn part_in_surroundings(cell: Option<&Cell>, number: Option<u32>) -> Part {
    match cell {
        _ if number.is_some() => Part::Gives,
        Some(cell) if cell.terrain.experience() > 0 || cell.terrain.is_labelled() => Part::Keeps,
        _ => Part::Takes,
    }
}
