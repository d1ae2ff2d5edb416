//! The fusion rule: one cost of what the sources say (Albus 2006a, 4 and Albus 2006b, 3.4, the equation of
//! `Cost_cell`).

use serde::{Deserialize, Serialize};

use crate::{Evidence, MAX_COST, OBSTACLE_COST, Source, UNKNOWN_COST};

/// How what a source says counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SourceKind {
    /// Its cost is averaged with that of the others by its weight.
    #[default]
    Range,
    /// A hit of it (a cost from [`OBSTACLE_COST`] on) stands for itself, whatever the others see: the bumper. What it
    /// says otherwise does not count.
    Override,
}

/// A source and how much it counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Weighted {
    /// Who.
    pub source: Source,
    /// Only the ratios of weights matter; that of a source that overrides is not looked at.
    pub weight: f32,
    /// How.
    pub kind: SourceKind,
}

/// How much each source counts: the papers' `W_s`, `W_l`, `W_c`, for as many sources as a stack has. The order settles
/// ties. A source that is not listed counts 1, behind those that are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Weights(Vec<Weighted>);

impl Default for Weights {
    /// The bundled sources count alike, the bumper overrides. The seeds give no values.
    fn default() -> Self {
        Source::BUNDLED
            .into_iter()
            .map(|source| {
                let kind = if source == Source::BUMPER { SourceKind::Override } else { SourceKind::Range };
                Weighted { source, weight: 1.0, kind }
            })
            .collect()
    }
}

impl FromIterator<Weighted> for Weights {
    /// The first of two entries of one source counts.
    fn from_iter<I: IntoIterator<Item = Weighted>>(entries: I) -> Weights {
        let mut list: Vec<Weighted> = Vec::new();
        for entry in entries {
            if !list.iter().any(|known| known.source == entry.source) {
                list.push(entry);
            }
        }
        Weights(list)
    }
}

/// A weight that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("weight of {source_name} is {value}, expected a finite number from 0 up")]
pub struct WeightsError {
    source_name: Source,
    value: f32,
}

impl Weights {
    /// The entries, in their order.
    pub fn iter(&self) -> impl Iterator<Item = Weighted> + Clone + use<'_> {
        self.0.iter().copied()
    }

    /// How a source counts.
    pub fn get(&self, source: Source) -> Weighted {
        let listed = self.0.iter().find(|entry| entry.source == source);
        listed.copied().unwrap_or(Weighted { source, weight: 1.0, kind: SourceKind::Range })
    }

    /// The same with another weight of a source.
    #[must_use]
    pub fn with(mut self, source: Source, weight: f32) -> Weights {
        match self.0.iter_mut().find(|entry| entry.source == source) {
            Some(entry) => entry.weight = weight,
            None => self.0.push(Weighted { source, weight, kind: SourceKind::Range }),
        }
        self
    }

    /// Refuses NaN, infinity and negative weights. [`fuse`] takes those as 0.
    pub fn check(&self) -> Result<(), WeightsError> {
        match self.0.iter().find(|entry| !(entry.weight.is_finite() && entry.weight >= 0.0)) {
            Some(entry) => Err(WeightsError { source_name: entry.source, value: entry.weight }),
            None => Ok(()),
        }
    }

    /// These sources in the order in which they are fused, each with its place in `sources`.
    pub(crate) fn placed(&self, sources: impl IntoIterator<Item = Source>) -> Vec<Placed> {
        let rank = |source| self.0.iter().position(|entry| entry.source == source).unwrap_or(usize::MAX);
        let mut placed: Vec<Placed> = sources
            .into_iter()
            .enumerate()
            .map(|(place, source)| {
                let Weighted { weight, kind, .. } = self.get(source);
                let overrides = kind == SourceKind::Override;
                let weight = f64::from(weight);
                let weight = if weight > 0.0 && weight.is_finite() && !overrides { weight } else { 0.0 };
                Placed { place, source, weights: [0.0, weight], overrides }
            })
            .collect();
        placed.sort_by_key(|entry| rank(entry.source));
        placed
    }
}

/// A source on its way into a fusion.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    /// Its place in the caller's list.
    place: usize,
    source: Source,
    /// What it weighs where it is absent (nothing), and where it is present.
    weights: [f64; 2],
    overrides: bool,
}

/// What a cell is, by its surest source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Label {
    /// Nobody has seen it.
    #[default]
    Unknown = 0,
    /// Cost below [`OBSTACLE_COST`].
    Ground = 1,
    /// Cost from [`OBSTACLE_COST`] on.
    Obstacle = 2,
}

impl Label {
    /// The class that a cost stands for.
    pub const fn of_cost(cost: u8) -> Label {
        match cost {
            0..OBSTACLE_COST => Label::Ground,
            OBSTACLE_COST..=MAX_COST => Label::Obstacle,
            _ => Label::Unknown,
        }
    }
}

/// What the sources say of a cell together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fused {
    /// 0 to 250, or 255 for unknown.
    pub cost: u8,
    /// The class that the surest source gives. Near the class border it may differ from that of the mean cost.
    pub label: Label,
    /// The surest source; `None` where the cell is unknown.
    pub source: Option<Source>,
    /// The surest source's confidence.
    pub confidence: u8,
}

impl Fused {
    /// Nobody has seen the cell.
    pub const UNKNOWN: Fused =
        Fused { cost: UNKNOWN_COST, label: Label::Unknown, source: None, confidence: 0 };
}

/// Fuses a cell: each source with its cost and confidence.
///
/// - A source is present where its confidence is above 0, its cost at most 250 and its weight above 0.
/// - Cost = Σ Wᵢ·Costᵢ / Σ Wᵢ over the sources present, rounded to nearest (half up): weights of absent sources
///   renormalise. None present is unknown, not zero.
/// - A hit of a source that overrides (confidence above 0, cost at least [`OBSTACLE_COST`]) stands for itself: its
///   cost, its confidence; of several, the highest cost. One that was not hit says nothing of what the other sources
///   see.
/// - The label is that of the highest confidence; the first source in the order of the weights wins a tie.
///
/// Confidence does not weigh the cost: the papers' equation has the weights alone.
pub fn fuse(said: &[(Source, u8, u8)], weights: &Weights) -> Fused {
    let layers = weights.placed(said.iter().map(|&(source, ..)| source));
    Fuser::new(&layers).fuse(|place| {
        let (_, cost, confidence) = said[place];
        Evidence { cost, confidence, sequence: 0 }
    })
}

/// [`fuse`] with sources that have been looked up, for whole maps.
#[derive(Clone, Copy)]
pub(crate) struct Fuser<'a> {
    layers: &'a [Placed],
}

impl<'a> Fuser<'a> {
    pub(crate) fn new(layers: &'a [Placed]) -> Fuser<'a> {
        Fuser { layers }
    }

    /// The rule itself, of what the source at each place says.
    #[inline]
    pub(crate) fn fuse(&self, said: impl Fn(usize) -> Evidence) -> Fused {
        let (mut sum, mut total) = (0.0, 0.0);
        let (mut highest, mut surest) = (0, None);
        let mut hit: Option<Fused> = None;
        for layer in self.layers {
            let Evidence { cost, confidence, .. } = said(layer.place);
            // Absent sources add zeros rather than being skipped: the processor cannot predict which are absent.
            let known = u8::from(confidence > 0) & u8::from(cost <= MAX_COST);
            let weight = layer.weights[usize::from(known)];
            sum += weight * f64::from(cost);
            total += weight;
            let counted = if weight > 0.0 { confidence } else { 0 };
            if counted > highest {
                (highest, surest) = (counted, Some((layer.source, cost)));
            }
            if layer.overrides
                && known == 1
                && cost >= OBSTACLE_COST
                && hit.is_none_or(|other| cost > other.cost)
            {
                let source = Some(layer.source);
                hit = Some(Fused { cost, label: Label::Obstacle, source, confidence });
            }
        }
        if let Some(hit) = hit {
            return hit;
        }
        let Some((source, surest_cost)) = surest.filter(|_| total != 0.0) else { return Fused::UNKNOWN };
        Fused {
            cost: (sum / total + 0.5) as u8,
            label: Label::of_cost(surest_cost),
            source: Some(source),
            confidence: highest,
        }
    }
}

#[cfg(test)]
#[path = "fusion_tests.rs"]
mod tests;
