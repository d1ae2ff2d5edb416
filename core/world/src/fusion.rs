//! The fusion rule: one cost of what the sources say (A 4 and B 3.4, the equation of `Cost_cell`).

use serde::{Deserialize, Serialize};

use crate::{MAX_COST, OBSTACLE_COST, Source, UNKNOWN_COST};

/// How much each source counts: the papers' `W_s`, `W_l`, `W_c`, for every source but the bumper, which overrides.
/// Only their ratios matter. The seeds give no values; by default all count alike.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// `W_s`.
    pub stereo: f32,
    /// `W_c`: colour models.
    pub color: f32,
    /// `W_l`: terrain learned from range.
    pub terrain: f32,
    /// Part of `W_l`: the classifier over image windows.
    pub classifier: f32,
    /// Infrared range sensors.
    pub infrared: f32,
}

impl Default for Weights {
    fn default() -> Self {
        Weights { stereo: 1.0, color: 1.0, terrain: 1.0, classifier: 1.0, infrared: 1.0 }
    }
}

/// By [`Source::index`]: what a source weighs that is absent (nothing), and that is present.
pub(crate) type WeightTable = [[f64; 2]; Source::COUNT];

/// A weight that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("weight of {source_name} is {value}, expected a finite number from 0 up")]
pub struct WeightsError {
    source_name: &'static str,
    value: f32,
}

impl Weights {
    /// The weight of a source; the bumper has none.
    pub const fn get(&self, source: Source) -> f32 {
        match source {
            Source::Stereo => self.stereo,
            Source::Color => self.color,
            Source::Terrain => self.terrain,
            Source::Classifier => self.classifier,
            Source::Bumper => 0.0,
            Source::Infrared => self.infrared,
        }
    }

    /// The weights as [`fuse_by_table`] looks them up; 0 for the bumper and for weights that cannot be.
    pub(crate) fn table(&self) -> WeightTable {
        Source::ALL.map(|source| match f64::from(self.get(source)) {
            weight if weight > 0.0 && weight.is_finite() => [0.0, weight],
            _ => [0.0; 2],
        })
    }

    /// Refuses NaN, infinity and negative weights. [`fuse`] takes those as 0.
    pub fn check(&self) -> Result<(), WeightsError> {
        for source in Source::ALL {
            let value = self.get(source);
            if !(value.is_finite() && value >= 0.0) {
                return Err(WeightsError { source_name: source.name(), value });
            }
        }
        Ok(())
    }
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

/// Fuses a cell: arrays by [`Source::index`].
///
/// - A source is present where its confidence is above 0, its cost at most 250 and its weight above 0.
/// - Cost = Σ Wᵢ·Costᵢ / Σ Wᵢ over the sources present, rounded to nearest (half up): weights of absent sources
///   renormalise. None present is unknown, not zero.
/// - A bumper hit (confidence above 0, cost at least [`OBSTACLE_COST`]) overrides: its cost, its confidence. A bumper
///   that was not hit says nothing of what the other sources see.
/// - The label is that of the highest confidence; the first source wins a tie.
///
/// Confidence does not weigh the cost: the papers' equation has the weights alone.
#[inline]
pub fn fuse(costs: &[u8; Source::COUNT], confidences: &[u8; Source::COUNT], weights: &Weights) -> Fused {
    fuse_by_table(costs, confidences, &weights.table())
}

/// [`fuse`] with weights that have been looked up, for whole maps.
#[inline]
#[allow(clippy::trivially_copy_pass_by_ref, reason = "as fuse takes them")]
pub(crate) fn fuse_by_table(
    costs: &[u8; Source::COUNT],
    confidences: &[u8; Source::COUNT],
    weights: &WeightTable,
) -> Fused {
    let said = |source: Source| (source, costs[source.index()], confidences[source.index()]);
    fuse_said(Source::ALL.into_iter().map(said), weights)
}

/// The rule itself: of what the sources say, each its cost and confidence, in the order of [`Source::ALL`].
#[inline]
pub(crate) fn fuse_said(said: impl Iterator<Item = (Source, u8, u8)>, weights: &WeightTable) -> Fused {
    let (mut sum, mut total) = (0.0, 0.0);
    let (mut highest, mut surest) = (0, (Source::Stereo, UNKNOWN_COST));
    let mut hit = None;
    for (source, cost, confidence) in said {
        // Absent sources add zeros rather than being skipped: the processor cannot predict which are absent.
        let known = u8::from(confidence > 0) & u8::from(cost <= MAX_COST);
        let weight = weights[source.index()][usize::from(known)];
        sum += weight * f64::from(cost);
        total += weight;
        let counted = if weight > 0.0 { confidence } else { 0 };
        if counted > highest {
            (highest, surest) = (counted, (source, cost));
        }
        if source == Source::Bumper && known == 1 && cost >= OBSTACLE_COST {
            hit = Some((cost, confidence));
        }
    }
    if let Some((cost, confidence)) = hit {
        return Fused { cost, label: Label::Obstacle, source: Some(Source::Bumper), confidence };
    }
    if total == 0.0 {
        return Fused::UNKNOWN;
    }
    let (source, surest_cost) = surest;
    Fused {
        cost: (sum / total + 0.5) as u8,
        label: Label::of_cost(surest_cost),
        source: Some(source),
        confidence: highest,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The rule from its definition, step by step, over lists.
    fn reference_fuse(costs: [u8; 6], confs: [u8; 6], weights: &Weights) -> (Option<f64>, Option<Source>) {
        let bumper = Source::Bumper.index();
        if confs[bumper] != 0
            && costs[bumper] >= OBSTACLE_COST
            && costs[bumper] != 255
            && costs[bumper] <= 250
        {
            return (Some(f64::from(costs[bumper])), Some(Source::Bumper));
        }
        let present: Vec<Source> = Source::ALL
            .into_iter()
            .filter(|s| confs[s.index()] != 0 && costs[s.index()] <= 250 && weights.get(*s) > 0.0)
            .collect();
        let total: f64 = present.iter().map(|s| f64::from(weights.get(*s))).sum();
        let cost =
            present.iter().map(|s| f64::from(weights.get(*s)) / total * f64::from(costs[s.index()])).sum();
        let mut by_confidence = present.clone();
        by_confidence.sort_by_key(|s| std::cmp::Reverse(confs[s.index()])); // stable: the first wins a tie
        (by_confidence.first().map(|_| cost), by_confidence.first().copied())
    }

    fn weights() -> impl Strategy<Value = Weights> {
        prop::array::uniform5(prop_oneof![Just(0.0_f32), 0.0..2.0_f32, Just(1.0)]).prop_map(
            |[stereo, color, terrain, classifier, infrared]| Weights {
                stereo,
                color,
                terrain,
                classifier,
                infrared,
            },
        )
    }

    fn confidences() -> impl Strategy<Value = [u8; 6]> {
        prop::array::uniform6(prop_oneof![2 => Just(0_u8), 3 => any::<u8>()])
    }

    proptest! {
        #[test]
        fn fusion_equals_the_reference(costs: [u8; 6], confs in confidences(), weights in weights()) {
            let fused = fuse(&costs, &confs, &weights);
            let (cost, source) = reference_fuse(costs, confs, &weights);
            prop_assert_eq!(fused.source, source);
            if let Some(cost) = cost {
                prop_assert!((f64::from(fused.cost) - cost).abs() <= 0.5 + 1e-9, "{fused:?} {cost}");
            } else {
                prop_assert_eq!(fused, Fused::UNKNOWN);
            }
            if let Some(source) = source {
                prop_assert_eq!(fused.confidence, confs[source.index()]);
                prop_assert_eq!(fused.label, Label::of_cost(costs[source.index()]));
            }
        }

        #[test]
        fn only_the_ratios_of_weights_matter(costs: [u8; 6], confs in confidences(), weights in weights()) {
            let double = Weights {
                stereo: weights.stereo * 2.0, color: weights.color * 2.0, terrain: weights.terrain * 2.0,
                classifier: weights.classifier * 2.0, infrared: weights.infrared * 2.0,
            };
            prop_assert_eq!(fuse(&costs, &confs, &weights), fuse(&costs, &confs, &double));
        }

        #[test]
        fn one_source_alone_gives_its_own_cost(cost in 0..=MAX_COST, conf in 1..=255_u8, weight in 0.01..10.0_f32) {
            let (mut costs, mut confs) = ([UNKNOWN_COST; 6], [0; 6]);
            costs[Source::Terrain.index()] = cost;
            confs[Source::Terrain.index()] = conf;
            let fused = fuse(&costs, &confs, &Weights { terrain: weight, ..Weights::default() });
            prop_assert_eq!((fused.cost, fused.source, fused.confidence), (cost, Some(Source::Terrain), conf));
        }
    }

    #[test]
    fn nothing_seen_is_unknown_and_not_free() {
        assert_eq!(fuse(&[0; 6], &[0; 6], &Weights::default()), Fused::UNKNOWN);
        assert_eq!(fuse(&[UNKNOWN_COST; 6], &[255; 6], &Weights::default()), Fused::UNKNOWN);
        let none = Weights { stereo: 0.0, color: 0.0, terrain: 0.0, classifier: 0.0, infrared: 0.0 };
        assert_eq!(fuse(&[0; 6], &[9; 6], &none), Fused::UNKNOWN);
    }

    #[test]
    fn a_bumper_hit_overrides_and_a_bumper_that_is_free_does_not() {
        let (mut costs, mut confs) = ([10; 6], [200; 6]);
        (costs[Source::Bumper.index()], confs[Source::Bumper.index()]) = (250, 1);
        let fused = fuse(&costs, &confs, &Weights::default());
        assert_eq!((fused.cost, fused.source), (250, Some(Source::Bumper)));
        costs[Source::Bumper.index()] = 0;
        assert_eq!(fuse(&costs, &confs, &Weights::default()).cost, 10);
        confs = [0; 6];
        confs[Source::Bumper.index()] = 255;
        assert_eq!(fuse(&costs, &confs, &Weights::default()), Fused::UNKNOWN);
    }

    #[test]
    fn weights_that_cannot_be_are_refused_by_name_and_count_as_none() {
        let bad = Weights { color: f32::NAN, ..Weights::default() };
        assert_eq!(
            bad.check().unwrap_err().to_string(),
            "weight of color is NaN, expected a finite number from 0 up"
        );
        assert!(Weights { stereo: -1.0, ..Weights::default() }.check().is_err());
        assert!(Weights::default().check().is_ok());
        assert_eq!(fuse(&[80; 6], &[5; 6], &Weights { color: f32::INFINITY, ..bad }).cost, 80);
    }
}
