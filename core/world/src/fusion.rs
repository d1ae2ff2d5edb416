//! The fusion rule: computes one cost from the evidence of all sources (Albus 2006a, 4 and Albus 2006b, 3.4, the
//! equation of `Cost_cell`).

use serde::{Deserialize, Serialize};

use crate::cell::{Evidence, Label};
use crate::{MAX_COST, OBSTACLE_COST, Source, UNKNOWN_COST};

/// How the evidence of a source enters the fusion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SourceKind {
    /// Its cost enters the weighted mean.
    #[default]
    Range,
    /// A hit of it (a cost of at least [`OBSTACLE_COST`]) is taken as it is, whatever the other sources say: the
    /// bumper. Its lower costs are ignored.
    Override,
}

/// A source and its weight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Weighted {
    /// The source.
    pub source: Source,
    /// Only the ratios of weights matter; the weight of a source of kind [`SourceKind::Override`] is ignored.
    pub weight: f32,
    /// How its evidence is used.
    pub kind: SourceKind,
}

/// Weights of the sources: `W_s`, `W_l`, `W_c` of the papers, for any number of sources. The order decides ties. A
/// source that is not listed has weight 1 and comes after those that are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Weights(Vec<Weighted>);

impl Default for Weights {
    /// The bundled sources have equal weights, and the bumper overrides. The papers give no values.
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
    /// Of several entries for one source the first counts.
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

/// An invalid weight.
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

    /// Weight and kind of a source.
    pub fn get(&self, source: Source) -> Weighted {
        let listed = self.0.iter().find(|entry| entry.source == source);
        listed.copied().unwrap_or(Weighted { source, weight: 1.0, kind: SourceKind::Range })
    }

    /// The same weights with another weight for one source.
    #[must_use]
    pub fn with(mut self, source: Source, weight: f32) -> Weights {
        match self.0.iter_mut().find(|entry| entry.source == source) {
            Some(entry) => entry.weight = weight,
            None => self.0.push(Weighted { source, weight, kind: SourceKind::Range }),
        }
        self
    }

    /// Refuses NaN, infinity and negative weights. [`fuse`] treats them as 0.
    pub fn check(&self) -> Result<(), WeightsError> {
        match self.0.iter().find(|entry| !(entry.weight.is_finite() && entry.weight >= 0.0)) {
            Some(entry) => Err(WeightsError { source_name: entry.source, value: entry.weight }),
            None => Ok(()),
        }
    }

    /// These sources in the order of fusion, each with its index in `sources`.
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

/// A source prepared for fusion.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    /// Its index in the caller's list.
    place: usize,
    source: Source,
    /// Its weight where it is absent (0), and where it is present.
    weights: [f64; 2],
    overrides: bool,
}

/// The result of the fusion of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fused {
    /// 0 to 250, or 255 for unknown.
    pub cost: u8,
    /// The class according to the surest source. Near the class boundary it may differ from the class of the mean cost.
    pub label: Label,
    /// The surest source; `None` if the cell is unknown.
    pub source: Option<Source>,
    /// The confidence of the surest source.
    pub confidence: u8,
}

impl Fused {
    /// The result for a cell without evidence.
    pub const UNKNOWN: Fused =
        Fused { cost: UNKNOWN_COST, label: Label::Unknown, source: None, confidence: 0 };
}

/// Fuses a cell from the cost and confidence of each source.
///
/// - A source is present if its confidence is above 0, its cost at most 250 and its weight above 0.
/// - Cost = Σ Wᵢ·Costᵢ / Σ Wᵢ over the sources present, rounded to nearest (half up); so the weights are renormalised
///   over the sources present. If none is present, the result is unknown, not 0.
/// - A hit of an overriding source (confidence above 0, cost at least [`OBSTACLE_COST`]) gives its own cost and
///   confidence as the result; of several hits, the one with the highest cost. Without a hit, an overriding source has
///   no influence.
/// - The label is that of the source with the highest confidence; on a tie, the first source in the order of the
///   weights.
///
/// Confidence does not weight the cost: the papers' equation has the weights alone.
pub fn fuse(said: &[(Source, u8, u8)], weights: &Weights) -> Fused {
    let layers = weights.placed(said.iter().map(|&(source, ..)| source));
    Fuser::new(&layers).fuse(|place| {
        let (_, cost, confidence) = said[place];
        Evidence { cost, confidence, sequence: 0 }
    })
}

/// [`fuse`] with weights that have been looked up, for complete maps.
#[derive(Clone, Copy)]
pub(crate) struct Fuser<'a> {
    layers: &'a [Placed],
}

impl<'a> Fuser<'a> {
    pub(crate) fn new(layers: &'a [Placed]) -> Fuser<'a> {
        Fuser { layers }
    }

    /// The rule itself, given the evidence at each index.
    #[inline]
    pub(crate) fn fuse(&self, said: impl Fn(usize) -> Evidence) -> Fused {
        let (mut sum, mut total) = (0.0, 0.0);
        let (mut highest, mut surest) = (0, None);
        let mut hit: Option<Fused> = None;
        for layer in self.layers {
            let Evidence { cost, confidence, .. } = said(layer.place);
            // Absent sources add zeros instead of being skipped, because the processor cannot predict that branch.
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
