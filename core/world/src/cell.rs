//! The state of one cell of the map, and how measurements update it (Albus 2006a, 4, Albus 2006b, 3.4; Oskard 1988).

use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

use crate::{MAX_COST, OBSTACLE_COST, UNKNOWN_COST};

/// The class of a cell, from its surest source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Label {
    /// No source has evidence.
    #[default]
    Unknown = 0,
    /// Cost below [`OBSTACLE_COST`].
    Ground = 1,
    /// Cost of at least [`OBSTACLE_COST`].
    Obstacle = 2,
}

impl Label {
    /// The class of a cost.
    pub const fn of_cost(cost: u8) -> Label {
        match cost {
            0..OBSTACLE_COST => Label::Ground,
            OBSTACLE_COST..=MAX_COST => Label::Obstacle,
            _ => Label::Unknown,
        }
    }
}

/// How much one vote changes a confidence. The papers say "a predefined constant" without giving its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VoteRule {
    /// Added by a vote for the current class of the cell, and the confidence of a cell after its first vote; at least
    /// 1.
    pub rise: u8,
    /// Subtracted by a vote for the other class.
    pub fall: u8,
    /// Greatest confidence that votes can reach; at least 1.
    pub max: u8,
}

impl Default for VoteRule {
    /// 13 votes to full confidence, which is 2.6 s at stereo's 5 Hz, and as many to lose it.
    fn default() -> Self {
        VoteRule { rise: 20, fall: 20, max: 255 }
    }
}

/// The evidence of one source about a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Evidence {
    /// 0 to 250, or 255 for unknown.
    pub cost: u8,
    /// 0 to 255; 0 is unknown.
    pub confidence: u8,
    /// Acquisition sequence of the message that last changed it.
    pub sequence: u32,
}

impl Evidence {
    /// No vote yet.
    pub const NONE: Evidence = Evidence { cost: UNKNOWN_COST, confidence: 0, sequence: 0 };

    /// Updates the evidence with a vote of a cost (a cost above 250 is ignored). [`Label::of_cost`] gives the class of
    /// a cost.
    ///
    /// - Unknown: takes the vote's cost, with confidence `rise`.
    /// - Same class: confidence rises by `rise`, up to `max`. The cost moves towards the vote's by the fraction `rise /
    ///   (confidence + rise)`, which approximates the mean over votes, and by at least 1.
    /// - Other class: confidence falls by `fall`; the cost stays. When the confidence reaches 0, the vote's class takes
    ///   over as if the cell had been unknown.
    #[must_use]
    pub fn voted(self, cost: u8, sequence: u32, rule: VoteRule) -> Evidence {
        if cost > MAX_COST {
            return self;
        }
        let (max, rise) = (rule.max.max(1), rule.rise.max(1).min(rule.max.max(1)));
        let fresh = Evidence { cost, confidence: rise, sequence };
        if self.confidence == 0 || self.cost > MAX_COST {
            return fresh;
        }
        if Label::of_cost(self.cost) != Label::of_cost(cost) {
            return match self.confidence.saturating_sub(rule.fall) {
                0 => fresh,
                confidence => Evidence { confidence, sequence, ..self },
            };
        }
        let (held, rise_weight) = (i32::from(self.confidence), i32::from(rise));
        let difference = i32::from(cost) - i32::from(self.cost);
        // Integer arithmetic, so that results do not depend on rounding modes. The class stays the same, because the
        // new cost lies between two costs of that class.
        let step = difference * rise_weight / (held + rise_weight);
        let step = if step == 0 { difference.signum() } else { step };
        Evidence {
            cost: (i32::from(self.cost) + step) as u8,
            // A confidence above `max`, from before the rule was changed, stays.
            confidence: self.confidence.saturating_add(rise).min(max.max(self.confidence)),
            sequence,
        }
    }
}

impl Default for Evidence {
    fn default() -> Self {
        Evidence::NONE
    }
}

/// Steps of a published height in a metre. A power of two, so that rounded heights are exact.
pub(crate) const HEIGHTS_PER_M: f32 = 1024.0;
/// Published heights of at least this, metres, are not rounded: their floats are not finer than the steps.
pub(crate) const ROUNDED_BELOW_M: f32 = 8192.0;
/// Low bits of a published variance that are 0.
pub(crate) const VARIANCE_SHIFT: u32 = 15;

/// Running statistics of heights, metres, by Welford's formula (Chan's for merging), which avoids large sums.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeightStats {
    /// Number of heights; if it is 0, the other fields are meaningless.
    pub count: u32,
    /// Mean, m.
    pub mean: f32,
    /// Mean squared difference from the mean, m².
    pub variance: f32,
    /// Least, m.
    pub min: f32,
    /// Greatest, m.
    pub max: f32,
}

impl HeightStats {
    /// Adds one height, metres. NaN and infinity are ignored.
    pub fn add(&mut self, height_m: f32) {
        if height_m.is_finite() {
            self.merge(&HeightStats {
                count: 1,
                mean: height_m,
                variance: 0.0,
                min: height_m,
                max: height_m,
            });
        }
    }

    /// Adds all heights of other statistics.
    pub fn merge(&mut self, other: &HeightStats) {
        if other.count == 0 {
            return;
        }
        if self.count == 0 {
            *self = *other;
            return;
        }
        let (n, m) = (f64::from(self.count), f64::from(other.count));
        let difference = f64::from(other.mean) - f64::from(self.mean);
        let mean = f64::from(self.mean) + difference * m / (n + m);
        let between = difference * difference * n * m / (n + m);
        let squares = f64::from(self.variance) * n + f64::from(other.variance) * m + between;
        *self = HeightStats {
            count: self.count.saturating_add(other.count),
            mean: mean as f32,
            variance: (squares / (n + m)) as f32,
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        };
    }

    /// The statistics as a message states them, so that recordings compress well: heights rounded to 1/1024 m (below
    /// [`ROUNDED_BELOW_M`]; larger ones are unchanged), the variance to eight binary digits after the first, downwards.
    /// A sensor's noise is larger. Rounding twice changes nothing.
    #[must_use]
    pub(crate) fn rounded(self) -> HeightStats {
        let height = |value: f32| {
            let small = value.abs() < ROUNDED_BELOW_M;
            // The sum makes a negative zero positive, since a number of steps has no negative zero.
            if small { (value * HEIGHTS_PER_M).round() / HEIGHTS_PER_M + 0.0 } else { value }
        };
        HeightStats {
            count: self.count,
            mean: height(self.mean),
            variance: f32::from_bits(self.variance.to_bits() >> VARIANCE_SHIFT << VARIANCE_SHIFT),
            min: height(self.min),
            max: height(self.max),
        }
    }

    /// Standard deviation, metres; 0 without heights.
    pub fn deviation(&self) -> f32 {
        libm::sqrtf(self.variance)
    }
}

/// The state of the ground in one cell of the map, which all sources share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Heights of ground points, metres in the map's frame.
    pub ground: HeightStats,
    /// Heights of obstacle points, metres in the map's frame.
    pub obstacle: HeightStats,
    /// Confidence of the heights, 0 to 255.
    pub elevation_confidence: u8,
    /// Acquisition time of the last change; 0 for never.
    pub updated: Stamp,
}

impl Cell {
    /// Adds the heights of one frame. They are one vote about the elevation: in favour if the mean of the frame's
    /// ground lies within 3 standard deviations (at least `tolerance_m`) of the cell's, else against. When the
    /// confidence reaches 0, the frame's heights replace the cell's.
    pub fn observe_heights(
        &mut self,
        ground: &HeightStats,
        obstacle: &HeightStats,
        tolerance_m: f32,
        time: Stamp,
        rule: VoteRule,
    ) {
        if ground.count == 0 && obstacle.count == 0 {
            return;
        }
        self.updated = self.updated.max(time);
        if ground.count > 0 && self.ground.count > 0 {
            let bound = (3.0 * self.ground.deviation()).max(tolerance_m);
            if (ground.mean - self.ground.mean).abs() > bound {
                self.elevation_confidence = self.elevation_confidence.saturating_sub(rule.fall);
                if self.elevation_confidence == 0 {
                    (self.ground, self.obstacle) = (*ground, *obstacle);
                    self.elevation_confidence = rule.rise;
                }
                return;
            }
        }
        self.ground.merge(ground);
        self.obstacle.merge(obstacle);
        self.elevation_confidence = self.elevation_confidence.saturating_add(rule.rise);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const RULE: VoteRule = VoteRule { rise: 30, fall: 20, max: 255 };

    fn voted(votes: &[u8]) -> Evidence {
        (1..)
            .zip(votes)
            .fold(Evidence::NONE, |evidence, (sequence, &cost)| evidence.voted(cost, sequence, RULE))
    }

    #[test]
    fn votes_for_a_class_raise_its_confidence_by_a_constant_up_to_the_bound() {
        let confidences: Vec<u8> = (1..=10).map(|n| voted(&vec![200; n]).confidence).collect();
        assert_eq!(confidences, [30, 60, 90, 120, 150, 180, 210, 240, 255, 255]);
        assert_eq!(voted(&[200; 10]).cost, 200);
        assert_eq!(voted(&[200; 10]).sequence, 10);
    }

    #[test]
    fn a_rule_may_bound_the_confidence_that_its_votes_lead_to() {
        let rule = VoteRule { max: 70, ..RULE };
        let evidence = (1..=5).fold(Evidence::NONE, |evidence, n| evidence.voted(200, n, rule));
        assert_eq!(evidence.confidence, 70);
        assert_eq!(Evidence { confidence: 200, ..evidence }.voted(200, 6, rule).confidence, 200);
    }

    #[test]
    fn votes_against_lower_it_by_a_constant_until_the_class_changes() {
        let steps: Vec<(u8, u8)> = (0..=4)
            .map(|n| voted(&[vec![200; 2], vec![0; n]].concat()))
            .map(|evidence| (evidence.cost, evidence.confidence))
            .collect();
        assert_eq!(steps, [(200, 60), (200, 40), (200, 20), (0, 30), (0, 60)]);
    }

    #[test]
    fn what_is_no_cost_is_no_vote() {
        assert_eq!(Evidence::NONE.voted(255, 1, RULE), Evidence::NONE);
        assert_eq!(voted(&[40]).voted(251, 9, RULE), voted(&[40]));
    }

    #[test]
    fn agreeing_costs_are_averaged_over_the_first_votes() {
        // 100, then (100·30 + 40·30)/60 = 70, then 70 + (100 − 70)/3 = 80.
        assert_eq!(voted(&[100, 40]).cost, 70);
        assert_eq!(voted(&[100, 40, 100]).cost, 80);
    }

    proptest! {
        #[test]
        fn any_votes_keep_the_bounds_and_a_steady_source_wins(
            votes in prop::collection::vec(any::<u8>(), 0..80), last in 0..=MAX_COST, rise in 0..=255_u8, fall in 1..=255_u8,
        ) {
            let rule = VoteRule { rise, fall, max: 255 };
            let mut evidence = Evidence::NONE;
            for (i, cost) in (0..).zip(votes) {
                evidence = evidence.voted(cost, i, rule);
                prop_assert_eq!(evidence.confidence == 0, evidence.cost == UNKNOWN_COST);
                prop_assert!(evidence.cost <= MAX_COST || evidence.cost == UNKNOWN_COST);
            }
            for i in 0..1000 {
                evidence = evidence.voted(last, i, rule);
            }
            prop_assert_eq!(evidence.cost, last);
        }

        #[test]
        fn running_heights_equal_those_of_the_list(heights in prop::collection::vec(-5.0..5.0_f32, 1..200), cut in 0..200_usize) {
            let cut = cut.min(heights.len());
            let mut stats = HeightStats::default();
            let mut rest = HeightStats::default();
            heights[..cut].iter().for_each(|&h| stats.add(h));
            heights[cut..].iter().for_each(|&h| rest.add(h));
            stats.merge(&rest);
            let n = heights.len() as f64;
            let mean = heights.iter().map(|&h| f64::from(h)).sum::<f64>() / n;
            let variance = heights.iter().map(|&h| (f64::from(h) - mean).powi(2)).sum::<f64>() / n;
            prop_assert_eq!(stats.count as usize, heights.len());
            prop_assert!((f64::from(stats.mean) - mean).abs() < 1e-5);
            prop_assert!((f64::from(stats.variance) - variance).abs() < 1e-4);
            prop_assert_eq!(stats.min, heights.iter().copied().fold(f32::MAX, f32::min));
            prop_assert_eq!(stats.max, heights.iter().copied().fold(f32::MIN, f32::max));
        }
    }

    #[test]
    fn heights_that_disagree_long_enough_replace_the_old_ones() {
        let stats = |height: f32| {
            let mut stats = HeightStats::default();
            (0..5).for_each(|_| stats.add(height));
            stats
        };
        let mut cell = Cell::default();
        let none = HeightStats::default();
        for _ in 0..2 {
            cell.observe_heights(&stats(0.0), &none, 0.1, Stamp(1), RULE);
        }
        assert_eq!((cell.elevation_confidence, cell.ground.count), (60, 10));
        for _ in 0..2 {
            cell.observe_heights(&stats(1.0), &none, 0.1, Stamp(2), RULE);
        }
        assert_eq!((cell.elevation_confidence, cell.ground.mean), (20, 0.0));
        cell.observe_heights(&stats(1.0), &stats(2.0), 0.1, Stamp(3), RULE);
        assert_eq!((cell.ground.mean, cell.obstacle.mean, cell.updated), (1.0, 2.0, Stamp(3)));
    }

    #[test]
    fn heights_that_are_not_finite_are_left_out() {
        let mut stats = HeightStats::default();
        stats.add(f32::NAN);
        stats.add(f32::INFINITY);
        assert_eq!(stats, HeightStats::default());
    }
}
