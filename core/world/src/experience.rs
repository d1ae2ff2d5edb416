//! Weights of the fusion from experience (Albus 2006b, 3.4).
//!
//! While a vehicle drives, it learns what cells are that its sources judged before: it drives over them, it bumps into
//! what is in them, or it sees them again from near. [`Experience`] collects what each source had said of such cells
//! in the seconds before. [`fit`] looks for weights with which the fusion rule ([`crate::fuse`]) would have been right
//! more often. The papers plan to adjust weights by how well the sources did, and do not say how; the method is ours.
//!
//! What the vehicle drives over is what its map called free, so driving alone would favour every source that calls
//! ground free. Therefore nothing is fitted without obstacles: those that were hit, or that a range sensor was sure of
//! when it had come near.

use crate::fusion::Fuser;
use crate::{Evidence, GridView, GridViewError, MAX_COST, NumericType, OBSTACLE_COST, Source, UNKNOWN_COST};
use crate::{SourceKind, Weighted, Weights};
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::Arc;

/// Time between two maps that are looked at, s.
const STEP_S: f64 = 1.0;
/// Number of earlier maps in which a cell is looked up when it becomes known what it is.
const EARLIER: usize = 8;
/// Confidence from which on a range sensor is sure of an obstacle. Votes from far do not lead there.
pub(crate) const SURE: u8 = 150;
/// Fewer samples of an outcome do not count.
const LEAST_SAMPLES: usize = 20;

/// What a cell turned out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Outcome {
    /// The vehicle drove over it.
    Driven,
    /// The vehicle bumped into what is in it.
    Hit,
    /// A range sensor was sure of an obstacle in it.
    Seen,
}

impl Outcome {
    /// All of them.
    pub const ALL: [Outcome; 3] = [Outcome::Driven, Outcome::Hit, Outcome::Seen];
}

/// What the sources had said of cells, and what these turned out to be.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Samples {
    sources: Vec<Source>,
    /// By samples, the evidence of each source.
    said: Vec<Evidence>,
    outcomes: Vec<(Stamp, Outcome)>,
}

/// How a fusion with some weights judges samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// Number of samples by outcome: driven over, hit, seen.
    pub count: [u64; 3],
    /// Of these, the number that the fusion calls an obstacle though it was driven over, or free though it was hit or
    /// seen. Unknown cells are not counted here.
    pub wrong: [u64; 3],
    /// Of these, the number of unknown cells.
    pub unknown: [u64; 3],
    /// Mean over the outcomes of the mean squared error of the cost, as a share of the highest one; an unknown cell
    /// counts as one between free and obstacle.
    pub loss: f64,
}

impl Samples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.outcomes.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.outcomes.is_empty()
    }

    /// The samples of every other stretch of time of this length, s, and the rest: to fit weights on the ones and check
    /// them on the others.
    pub fn split(&self, stretch_s: f64) -> [Samples; 2] {
        let mut parts = [0, 1].map(|_| Samples { sources: self.sources.clone(), ..Samples::default() });
        let first = self.outcomes.first().map_or(Stamp(0), |&(time, _)| time);
        let said = self.said.chunks(self.sources.len().max(1));
        for (said, &(time, outcome)) in said.zip(&self.outcomes) {
            let stretch = (time.seconds_since(first) / stretch_s.max(1e-3)) as u64;
            let part = &mut parts[(stretch % 2) as usize];
            part.said.extend_from_slice(said);
            part.outcomes.push((time, outcome));
        }
        parts
    }

    /// Whether they suffice to judge weights; the error says what is lacking.
    pub fn suffice(&self) -> Result<(), String> {
        let [driven, hit, seen] = Outcome::ALL.map(|outcome| self.count(outcome));
        if driven < LEAST_SAMPLES {
            return Err(format!(
                "{driven} judgements of cells that were driven over, expected {LEAST_SAMPLES}"
            ));
        }
        if hit.max(seen) < LEAST_SAMPLES {
            return Err(format!(
                "{hit} judgements of cells that were bumped into and {seen} of obstacles seen from near, expected \
                 {LEAST_SAMPLES} of either: from free ground alone nothing is learned"
            ));
        }
        Ok(())
    }

    /// Forgets the oldest samples beyond a number.
    fn keep_newest(&mut self, count: usize) {
        let surplus = self.len().saturating_sub(count);
        self.outcomes.drain(..surplus);
        self.said.drain(..surplus * self.sources.len());
    }

    /// How the fusion with these weights judges the samples.
    pub fn judge(&self, weights: &Weights) -> Judged {
        let layers = weights.placed(self.sources.iter().copied());
        let fuser = Fuser::new(&layers);
        let mut judged = Judged::default();
        let mut errors = [0.0_f64; 3];
        let all = self.said.chunks(self.sources.len().max(1)).zip(&self.outcomes);
        for (said, &(_, outcome)) in all {
            let cost = fuser.fuse(|place| said[place]).cost;
            let at = outcome as usize;
            let is_free = outcome == Outcome::Driven;
            judged.count[at] += 1;
            let error = if cost == UNKNOWN_COST {
                judged.unknown[at] += 1;
                0.5
            } else {
                judged.wrong[at] += u64::from((cost >= OBSTACLE_COST) == is_free);
                let share = f64::from(cost) / f64::from(MAX_COST);
                if is_free { share } else { 1.0 - share }
            };
            errors[at] += error * error;
        }
        let means = errors.iter().zip(judged.count).filter(|&(_, count)| count >= LEAST_SAMPLES as u64);
        let (sum, outcomes) = means
            .fold((0.0, 0), |(sum, outcomes), (error, count)| (sum + error / count as f64, outcomes + 1));
        judged.loss = if outcomes == 0 { 0.0 } else { sum / f64::from(outcomes) };
        judged
    }

    fn count(&self, outcome: Outcome) -> usize {
        self.outcomes.iter().filter(|(_, other)| *other == outcome).count()
    }
}

/// What the cells of a map were said to be at a time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Earlier {
    time: Stamp,
    cell_size_m: f64,
    /// South-west cell, counted from the origin of the frame.
    corner: [i64; 2],
    columns: usize,
    /// By cells, the evidence of each source.
    said: Vec<Evidence>,
}

impl Earlier {
    fn of(
        view: &GridView<'_>,
        kinds: &[(Source, SourceKind)],
        time: Stamp,
    ) -> Result<Earlier, GridViewError> {
        let cells = view.columns() * view.rows();
        let mut said = vec![Evidence::NONE; cells * kinds.len()];
        let mut bytes = Vec::new();
        let present = view.sources();
        for (place, &(source, _)) in kinds.iter().enumerate().filter(|(_, (s, _))| present.contains(*s)) {
            let mut column = |name: &str, put: fn(&mut Evidence, u8)| -> Result<(), GridViewError> {
                view.field_of(&format!("{name}.{source}"), NumericType::Uint8)?.bytes_into(&mut bytes);
                let own = said.iter_mut().skip(place).step_by(kinds.len());
                own.zip(&bytes).for_each(|(evidence, &byte)| put(evidence, byte));
                Ok(())
            };
            column("cost", |evidence, byte| evidence.cost = byte)?;
            column("conf", |evidence, byte| evidence.confidence = byte)?;
            // Not all sources learn.
            let _ = column("backing", |evidence, byte| evidence.backing = byte);
        }
        let corner = view.frame_from_grid().translation.truncate() / view.cell_size_m();
        let corner = [corner.x.round() as i64, corner.y.round() as i64];
        Ok(Earlier { time, cell_size_m: view.cell_size_m().x, corner, columns: view.columns(), said })
    }

    /// What was said of a cell, counted from the origin of the frame; `None` outside of the map.
    fn at(&self, cell: [i64; 2], sources: usize) -> Option<&[Evidence]> {
        // The corner may be so far away that its cell is the first or the last one that can be counted.
        let from_corner = |axis: usize| {
            let cells = cell[axis].checked_sub(self.corner[axis])?;
            usize::try_from(cells).ok()
        };
        let column = from_corner(0).filter(|&column| column < self.columns)?;
        let row = from_corner(1).filter(|&row| row < self.said.len())?;
        let index = (row * self.columns + column) * sources;
        self.said.get(index..index + sources)
    }

    /// The cells that can be counted from the origin of the frame, and what was said of them.
    fn cells(&self, sources: usize) -> impl Iterator<Item = ([i64; 2], &[Evidence])> {
        self.said.chunks(sources.max(1)).enumerate().filter_map(|(at, said)| {
            let x = self.corner[0].checked_add((at % self.columns) as i64)?;
            let y = self.corner[1].checked_add((at / self.columns) as i64)?;
            Some(([x, y], said))
        })
    }
}

/// Collects samples from the maps of a drive, in the order of time. The maps are of one frame; where it begins again, call
/// [`Experience::forget_maps`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Experience {
    kinds: Vec<(Source, SourceKind)>,
    // Shared, so that a copy costs little.
    earlier: VecDeque<Arc<Earlier>>,
    samples: Arc<Samples>,
}

impl Experience {
    /// Nothing yet, of these sources.
    pub fn new(weights: &Weights) -> Experience {
        let kinds: Vec<_> = weights.iter().map(|entry| (entry.source, entry.kind)).collect();
        let sources = kinds.iter().map(|&(source, _)| source).collect();
        Experience {
            kinds,
            earlier: VecDeque::new(),
            samples: Arc::new(Samples { sources, ..Samples::default() }),
        }
    }

    /// The samples.
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Forgets the oldest samples beyond a number.
    pub fn keep_newest(&mut self, count: usize) {
        if self.samples.len() > count {
            Arc::make_mut(&mut self.samples).keep_newest(count);
        }
    }

    /// Forgets the maps, as where their frame has begun again: their cells are not those of the next map. The samples stay.
    pub fn forget_maps(&mut self) {
        self.earlier.clear();
    }

    /// Looks at a map; one that follows the one before by less than a second is passed over. The map must have the
    /// fields `cost.<source>` and `conf.<source>`. A map of an earlier time, as of another run, begins anew, and so does
    /// one of another cell size.
    pub fn take(&mut self, view: &GridView<'_>, time: Stamp) -> Result<(), GridViewError> {
        let last = self.earlier.back().map(|earlier| earlier.time);
        let cell_size_m = view.cell_size_m().x;
        if self.earlier.back().is_some_and(|last| time < last.time || cell_size_m != last.cell_size_m) {
            self.earlier.clear();
        } else if last.is_some_and(|last| time.seconds_since(last) < STEP_S - 1e-6) {
            return Ok(());
        }
        let now = Earlier::of(view, &self.kinds, time)?;
        let mut new = Vec::new();
        if let Some(before) = self.earlier.back() {
            let sources = self.kinds.len();
            for (cell, said) in now.cells(sources) {
                let Some(outcome) = self.outcome(said) else { continue };
                // What was known before is not learned again, also where it was uncertain in between.
                let was_known = |earlier: &Arc<Earlier>| {
                    earlier.at(cell, sources).is_some_and(|said| self.outcome(said).is_some())
                };
                if before.at(cell, sources).is_none() || self.earlier.iter().rev().any(was_known) {
                    continue;
                }
                let judged = self.earlier.iter().filter_map(|earlier| earlier.at(cell, sources));
                new.extend(judged.filter(|said| self.is_judgement(said)).map(|said| (said, outcome)));
            }
        }
        if !new.is_empty() {
            let samples = Arc::make_mut(&mut self.samples);
            for (said, outcome) in new {
                samples.said.extend_from_slice(said);
                samples.outcomes.push((time, outcome));
            }
        }
        self.earlier.push_back(Arc::new(now));
        if self.earlier.len() > EARLIER {
            self.earlier.pop_front();
        }
        Ok(())
    }

    /// What a cell is known to be.
    fn outcome(&self, said: &[Evidence]) -> Option<Outcome> {
        let mut seen = None;
        for (evidence, &(_, kind)) in said.iter().zip(&self.kinds) {
            let is_obstacle = (OBSTACLE_COST..=MAX_COST).contains(&evidence.cost);
            match kind {
                SourceKind::Override if evidence.confidence > 0 && evidence.cost <= MAX_COST => {
                    return Some(if is_obstacle { Outcome::Hit } else { Outcome::Driven });
                }
                SourceKind::Range if is_obstacle && evidence.confidence >= SURE => {
                    seen = Some(Outcome::Seen);
                }
                _ => {}
            }
        }
        seen
    }

    /// Whether sources had judged a cell of which nothing was known for certain.
    fn is_judgement(&self, said: &[Evidence]) -> bool {
        self.outcome(said).is_none() && said.iter().any(|evidence| evidence.confidence > 0)
    }
}

/// Limits of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct FitRules {
    /// Weights that are tried.
    pub tried: Vec<f32>,
    /// Greatest factor by which a weight changes, up or down; infinity for none. A weight of 0 changes only where
    /// the factor is infinite: otherwise a source that was turned off stays off.
    pub greatest_factor: f32,
    /// A weight is changed if the loss decreases by this share at least.
    pub least_gain: f64,
}

impl Default for FitRules {
    fn default() -> Self {
        FitRules {
            tried: vec![0.0, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0],
            greatest_factor: f32::INFINITY,
            least_gain: 0.01,
        }
    }
}

/// A weight that was changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeightChange {
    /// The source.
    pub source: Source,
    /// Its weight before and after.
    pub weight: [f32; 2],
    /// The loss before and after this change, those before it applied.
    pub loss: [f64; 2],
}

/// Weights that judge the samples better.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The weights.
    pub weights: Weights,
    /// How the weights before judge the samples.
    pub before: Judged,
    /// How the new weights do.
    pub after: Judged,
    /// The changes in the order in which they were made; a source may be in it several times.
    pub changes: Vec<WeightChange>,
}

/// Looks for weights that judge the samples better, one weight after the other until none gains. The weight of the
/// first range sensor stays, because only ratios of weights matter, and so do those of overriding sources, which do not
/// count. The error says what is missing if there is too little experience.
pub fn fit(samples: &Samples, weights: &Weights, rules: &FitRules) -> Result<Fit, String> {
    samples.suffice()?;
    let is_range = |entry: &Weighted| entry.kind == SourceKind::Range;
    let reference = weights.iter().find(is_range).map(|entry| entry.source);
    let changed = |entry: &Weighted| entry.kind != SourceKind::Override && Some(entry.source) != reference;
    let sources: Vec<Weighted> = weights.iter().filter(changed).collect();
    let before = samples.judge(weights);
    let (mut best, mut loss, mut changes) = (weights.clone(), before.loss, Vec::new());
    // Each change decreases the loss by a share, so that this ends; the number of passes bounds the time.
    for _ in 0..PASSES {
        let changes_before = changes.len();
        for &Weighted { source, weight: first, .. } in &sources {
            let now = best.get(source).weight;
            let within = |&&weight: &&f32| {
                (first == 0.0 && rules.greatest_factor.is_infinite())
                    || (weight <= first * rules.greatest_factor && weight >= first / rules.greatest_factor)
            };
            let tried = rules.tried.iter().filter(within).map(|&weight| {
                let weights = best.clone().with(source, weight);
                (samples.judge(&weights).loss, weight, weights)
            });
            let Some((found, weight, weights)) = tried.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            if found < loss * (1.0 - rules.least_gain) {
                changes.push(WeightChange { source, weight: [now, weight], loss: [loss, found] });
                (best, loss) = (weights, found);
            }
        }
        if changes.len() == changes_before {
            break;
        }
    }
    let after = samples.judge(&best);
    Ok(Fit { weights: best, before, after, changes })
}

/// Greatest number of passes over all sources.
const PASSES: usize = 6;

#[cfg(test)]
#[path = "experience_tests.rs"]
mod tests;
