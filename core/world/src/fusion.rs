//! The fusion rule: computes one cost from the evidence of all sources (Albus 2006a, 4 and Albus 2006b, 3.4, the
//! equation of `Cost_cell`).

use serde::{Deserialize, Serialize};

use crate::cell::{Evidence, Label};
use crate::{MAX_COST, OBSTACLE_COST, Source, UNKNOWN_COST};

/// How the evidence of a source enters the fusion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SourceKind {
    /// A sensor of shape or distance: of several, the one with the highest cost counts.
    #[default]
    Range,
    /// A touch: its obstacles are taken as they are, whatever the other sources say, and where there is none, what it
    /// has driven over is free.
    Override,
    /// A judgement by appearance: it enters the mean with the range sensors, and lowers their cost only as far as
    /// experience backs it ([`Evidence::backing`]).
    Learned,
}

/// A source and its weight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Weighted {
    /// The source.
    pub source: Source,
    /// Its confidences count by it: `W` of the papers. At 0 the source is off; for one of kind
    /// [`SourceKind::Override`] every weight above 0 counts as 1.
    pub weight: f32,
    /// How its evidence is used.
    pub kind: SourceKind,
}

impl Weighted {
    /// Whether the source is on. NaN, infinity and negative weights turn it off.
    fn counts(&self) -> bool {
        self.weight > 0.0 && self.weight.is_finite()
    }
}

/// Weights of the sources: `W_s`, `W_l`, `W_c` of the papers, for any number of sources. The order decides ties. A
/// source that is not listed is a range sensor of weight 1 and comes after those that are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Weights {
    entries: Vec<Weighted>,
    /// Cells with less evidence (the sum of weight times confidence) are unknown.
    pub least_evidence: f32,
}

/// Evidence below which a cell is unknown, by default: a fifth of a full vote of a sensor with weight 1, which is what
/// stereo's first sight of a thing at 5 m is worth.
const LEAST_EVIDENCE: f32 = 4.0;

impl Default for Weights {
    /// The bundled sources have equal weights, the bumper overrides, and what is judged by colour or texture is
    /// learned. The papers give no values.
    fn default() -> Self {
        let kind = |source| match source {
            Source::BUMPER => SourceKind::Override,
            Source::COLOR | Source::TERRAIN | Source::CLASSIFIER => SourceKind::Learned,
            _ => SourceKind::Range,
        };
        Source::BUNDLED
            .into_iter()
            .map(|source| Weighted { source, weight: 1.0, kind: kind(source) })
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
        Weights { entries: list, least_evidence: LEAST_EVIDENCE }
    }
}

impl Weights {
    /// The entries, in their order.
    pub fn iter(&self) -> impl Iterator<Item = Weighted> + Clone + use<'_> {
        self.entries.iter().copied()
    }

    /// Weight and kind of a source.
    pub fn get(&self, source: Source) -> Weighted {
        let listed = self.entries.iter().find(|entry| entry.source == source);
        listed.copied().unwrap_or(Weighted { source, weight: 1.0, kind: SourceKind::Range })
    }

    /// The same weights with another weight for one source.
    #[must_use]
    pub fn with(mut self, source: Source, weight: f32) -> Weights {
        match self.entries.iter_mut().find(|entry| entry.source == source) {
            Some(entry) => entry.weight = weight,
            None => self.entries.push(Weighted { source, weight, kind: SourceKind::Range }),
        }
        self
    }

    /// Whether all sources that sense from a distance are off, so that nothing is known of what is ahead.
    pub fn is_blind(&self) -> bool {
        let mut distant = self.entries.iter().filter(|entry| entry.kind != SourceKind::Override).peekable();
        distant.peek().is_some() && distant.all(|entry| !entry.counts())
    }

    /// These sources in the order of fusion, each with its index in `sources`.
    pub(crate) fn placed(&self, sources: impl IntoIterator<Item = Source>) -> Layers {
        let rank =
            |source| self.entries.iter().position(|entry| entry.source == source).unwrap_or(usize::MAX);
        let mut placed: Vec<Placed> = sources
            .into_iter()
            .enumerate()
            .map(|(place, source)| {
                let weighted = self.get(source);
                let weight = match weighted.kind {
                    _ if !weighted.counts() => 0.0,
                    SourceKind::Override => 1.0,
                    SourceKind::Range | SourceKind::Learned => weighted.weight,
                };
                Placed { place, source, weight, kind: weighted.kind }
            })
            .collect();
        let order = |kind| match kind {
            SourceKind::Override => 0,
            SourceKind::Range => 1,
            SourceKind::Learned => 2,
        };
        placed.sort_by_key(|entry| (order(entry.kind), rank(entry.source)));
        let least =
            if self.least_evidence.is_finite() { self.least_evidence.max(f32::MIN_POSITIVE) } else { 0.0 };
        let is_off = |entry: &Placed| entry.kind == SourceKind::Override || entry.weight <= 0.0;
        let blind = self.is_blind() && placed.iter().all(is_off);
        Layers { placed, least, blind }
    }
}

/// Sources prepared for fusion, by kind: touch, range, learned.
#[derive(Clone, Debug)]
pub(crate) struct Layers {
    placed: Vec<Placed>,
    least: f32,
    /// See [`Weights::is_blind`].
    blind: bool,
}

/// A source prepared for fusion.
#[derive(Clone, Copy, Debug)]
struct Placed {
    /// Its index in the caller's list.
    place: usize,
    source: Source,
    weight: f32,
    kind: SourceKind,
}

/// The result of the fusion of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fused {
    /// 0 to 250, or 255 for unknown.
    pub cost: u8,
    /// The class of the cost.
    pub label: Label,
    /// The source with the most evidence for the class; `None` if the cell is unknown.
    pub source: Option<Source>,
    /// The confidence of that source.
    pub confidence: u8,
}

impl Fused {
    /// The result for a cell without evidence.
    pub const UNKNOWN: Fused =
        Fused { cost: UNKNOWN_COST, label: Label::Unknown, source: None, confidence: 0 };

    fn of(cost: u8, source: Source, confidence: u8) -> Fused {
        Fused { cost, label: Label::of_cost(cost), source: Some(source), confidence }
    }
}

/// Fuses a cell from the evidence of each source (Albus 2006a, 4; Albus 2006b, 3.4).
///
/// A source is present if its confidence cᵢ is above 0, its cost at most 250 and its weight Wᵢ above 0. The first of
/// these rules that applies gives the result:
///
/// 1. The obstacles of overriding sources: the one with the highest cost is the result.
/// 2. What an overriding source has driven over: its cost is the result. Where all other sources are off
///    ([`Weights::is_blind`]) such a cell is unknown: a vehicle must not drive by its own track alone.
/// 3. Cost = Σ Wᵢ·cᵢ·Costᵢ / Σ Wᵢ·cᵢ, rounded to nearest, over these sources:
///    - the range sensor with the highest cost (of equal ones the surer), with the evidence W·c of all range sensors
///      together: they do not average each other away. It counts by the part 1 − b, where b is the greatest backing of
///      a learned source;
///    - learned sources. One with a lower cost than the range sensor's counts by its own backing alone; any other one by
///      its own backing or by 1 − b, whichever is more: what experience backs outranks what it does not.
///
/// Below the least evidence (Σ Wᵢ·cᵢ, before that of a source is reduced by the backing of another) the cell is unknown,
/// which is not 0.
///
/// The label is the class of the cost. The papers' equation has the weights alone; their text says that the confidences
/// "are used as a cost factor", which is the factor cᵢ here.
pub fn fuse(said: &[(Source, Evidence)], weights: &Weights) -> Fused {
    let layers = weights.placed(said.iter().map(|&(source, _)| source));
    Fuser::new(&layers).fuse(|place| said[place].1)
}

/// [`fuse`] with weights that have been looked up, for complete maps.
#[derive(Clone, Copy)]
pub(crate) struct Fuser<'a> {
    touches: &'a [Placed],
    ranges: &'a [Placed],
    learned: &'a [Placed],
    least: f32,
    blind: bool,
}

/// A source that counts in a cell.
#[derive(Clone, Copy)]
struct Counted {
    source: Source,
    cost: u8,
    confidence: u8,
    evidence: f32,
}

impl<'a> Fuser<'a> {
    pub(crate) fn new(layers: &'a Layers) -> Fuser<'a> {
        let placed = &layers.placed;
        let first =
            |kind| placed.partition_point(|entry| entry.kind == SourceKind::Override || entry.kind == kind);
        let (ranges, learned) = (first(SourceKind::Override), first(SourceKind::Range));
        Fuser {
            touches: &placed[..ranges],
            ranges: &placed[ranges..learned],
            learned: &placed[learned..],
            least: layers.least,
            blind: layers.blind,
        }
    }

    /// The rule itself, given the evidence at each index.
    #[inline]
    pub(crate) fn fuse(&self, said: impl Fn(usize) -> Evidence) -> Fused {
        if let Some(touch) = self.touch(&said) {
            return touch;
        }
        let (mut range, mut seen): (Option<Counted>, f32) = (None, 0.0);
        for layer in self.ranges {
            let Some(next) = layer.counted(said(layer.place)) else { continue };
            seen += next.evidence;
            if range.is_none_or(|best| (next.cost, next.evidence) > (best.cost, best.evidence)) {
                range = Some(next);
            }
        }
        let range_cost = range.map_or(0, |range| range.cost);
        let backing = |evidence: &Evidence| f32::from(evidence.backing) / 255.0;
        let mut backed = 0.0_f32;
        for layer in self.learned {
            let evidence = said(layer.place);
            if layer.counted(evidence).is_some() {
                backed = backed.max(backing(&evidence));
            }
        }
        // Of each class the source with the most evidence; sums over the learned sources, and their evidence before what
        // another one's experience takes from it.
        let mut most: [Option<Counted>; 2] = [None; 2];
        let (mut sum, mut total, mut all) = (0.0, 0.0, seen);
        for layer in self.learned {
            let evidence = said(layer.place);
            let Some(mut next) = layer.counted(evidence) else { continue };
            let own = backing(&evidence);
            if next.cost < range_cost {
                next.evidence *= own;
                all += next.evidence;
            } else {
                all += next.evidence;
                next.evidence *= own.max(1.0 - backed);
            }
            sum += next.evidence * f32::from(next.cost);
            total += next.evidence;
            note(&mut most, next);
        }
        if all < self.least {
            return Fused::UNKNOWN;
        }
        if let Some(mut range) = range {
            range.evidence = seen * (1.0 - backed);
            sum += range.evidence * f32::from(range.cost);
            total += range.evidence;
            note(&mut most, range);
        }
        // Weights of 1e37 make the sum infinite; what is no number would be the cost 0.
        if total <= 0.0 || !sum.is_finite() {
            return Fused::UNKNOWN;
        }
        let cost = (sum / total + 0.5) as u8;
        let [free, obstacle] = most;
        let first = if cost >= OBSTACLE_COST { obstacle.or(free) } else { free.or(obstacle) };
        first.map_or(Fused::UNKNOWN, |first| Fused::of(cost, first.source, first.confidence))
    }

    /// What was touched: the obstacle with the highest cost, else what was driven over.
    fn touch(&self, said: &impl Fn(usize) -> Evidence) -> Option<Fused> {
        let mut touched: Option<Counted> = None;
        for layer in self.touches {
            let Some(next) = layer.counted(said(layer.place)) else { continue };
            if touched.is_none_or(|best| next.cost > best.cost) {
                touched = Some(next);
            }
        }
        let touched = touched.filter(|touch| !self.blind || touch.cost >= OBSTACLE_COST);
        touched.map(|touch| Fused::of(touch.cost, touch.source, touch.confidence))
    }
}

impl Placed {
    #[inline]
    fn counted(&self, evidence: Evidence) -> Option<Counted> {
        let Evidence { cost, confidence, .. } = evidence;
        let is_present = confidence > 0 && cost <= MAX_COST && self.weight > 0.0;
        let counted =
            Counted { source: self.source, cost, confidence, evidence: self.weight * f32::from(confidence) };
        is_present.then_some(counted)
    }
}

#[inline]
fn note(most: &mut [Option<Counted>; 2], next: Counted) {
    let class = &mut most[usize::from(next.cost >= OBSTACLE_COST)];
    if next.evidence > 0.0 && class.is_none_or(|best| next.evidence > best.evidence) {
        *class = Some(next);
    }
}

#[cfg(test)]
#[path = "fusion_tests.rs"]
mod tests;
