//! The state of one cell of the map, and how measurements update it (Albus 2006a, 4, Albus 2006b, 3.4; Oskard 1988).

use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

use crate::{MAX_COST, OBSTACLE_COST, UNKNOWN_COST};

/// The class of a cost.
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

/// How votes change the confidences of a source in a cell. The papers say "a predefined constant" without giving its
/// value; the bound of ground is ours, so that an obstacle wins soon over ground that was seen for long.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VoteRule {
    /// Added to the confidence of the vote's class by a vote of full worth; at least 1.
    pub rise: u8,
    /// Subtracted from the confidence in ground by a vote of full worth for an obstacle.
    pub fall: u8,
    /// Subtracted from the confidence in an obstacle by a vote of full worth for ground, and where the source sees the
    /// cell without the obstacle ([`crate::Map::missed`]). Less than `fall`, because ground
    /// is also seen through and beside an obstacle: a mesh, a post, a cell that the obstacle fills in part.
    pub obstacle_fall: u8,
    /// Greatest confidence in an obstacle that votes of full worth reach; at least 1.
    pub max: u8,
    /// Greatest confidence in ground that votes of full worth reach; at least 1.
    pub ground_max: u8,
}

impl Default for VoteRule {
    /// Ground is certain after four votes (0.8 s at stereo's 5 Hz), and loses to an obstacle at the second vote against
    /// it.
    fn default() -> Self {
        VoteRule { rise: 20, fall: 20, obstacle_fall: 6, max: 200, ground_max: 80 }
    }
}

impl VoteRule {
    /// The greatest confidence of a class.
    fn bound(self, class: Label) -> u8 {
        if class == Label::Obstacle { self.max.max(1) } else { self.ground_max.max(1) }
    }
}

/// One vote of a source for a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vote {
    /// 0 to 250; a vote of another cost is ignored.
    pub cost: u8,
    /// How much it counts, from its pixels and its range noise: 255 is a full vote, 0 none.
    pub worth: u8,
    /// How far experience backs it: see [`Evidence::backing`].
    pub backing: u8,
    /// The model that says so: see [`Evidence::model`].
    pub model: u8,
}

impl From<u8> for Vote {
    /// A vote of full worth.
    fn from(cost: u8) -> Vote {
        Vote { cost, worth: u8::MAX, backing: 0, model: 0 }
    }
}

impl Vote {
    /// Its part of a full vote, 0 to 255: its worth, less the nearer its cost is to the border of the classes. A vote for
    /// an obstacle keeps half of its worth there, because half of the cell is one.
    fn part(self) -> u32 {
        let least = if Label::of_cost(self.cost) == Label::Obstacle { OBSTACLE_COST.div_ceil(2) } else { 0 };
        let from_border = u32::from(self.cost.abs_diff(OBSTACLE_COST).max(least));
        (u32::from(self.worth) * from_border).div_ceil(u32::from(OBSTACLE_COST)).min(255)
    }
}

/// The part of a number, rounded up.
fn part_of(number: u8, part: u32) -> u8 {
    (u32::from(number) * part).div_ceil(255).min(255) as u8
}

/// The evidence of one source about a cell: a confidence for each class, and a cost of the class that has more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Evidence {
    /// 0 to 250, or 255 for unknown. Its class is the one of the greater confidence.
    pub cost: u8,
    /// Confidence of the class of the cost, 0 to 255; 0 is unknown.
    pub confidence: u8,
    /// Confidence of the other class; never more than `confidence`.
    pub against: u8,
    /// How far experience backs the cost, 0 to 255: driven over, bumped into, or known beforehand. Only of sources that
    /// learn.
    pub backing: u8,
    /// The model of the source by which the cell was judged last: its number from 1 in the source's message of models; 0
    /// where none was. Only of sources that learn.
    pub model: u8,
    /// Acquisition sequence of the message that last changed it.
    pub sequence: u32,
}

impl Evidence {
    /// No vote yet.
    pub const NONE: Evidence =
        Evidence { cost: UNKNOWN_COST, confidence: 0, against: 0, backing: 0, model: 0, sequence: 0 };

    /// Updates the evidence with a vote (Oskard 1988). [`Label::of_cost`] gives the class of a cost.
    ///
    /// The vote counts by its part p of a full vote: its worth, times the distance of its cost from the border of the
    /// classes. The confidence of its class rises by p·`rise`, up to p times the bound of the class, and that of the
    /// other class falls by p·`fall`, or p·`obstacle_fall`. A confidence above the bound, from better votes, stays.
    ///
    /// The cost belongs to the class with the greater confidence; obstacle on a tie. When the class changes, or nothing
    /// was known, the cost is that of the vote. A vote for the class of the cost moves it towards the vote's by the
    /// fraction p·`rise` / (confidence + p·`rise`), which approximates the mean over votes, and by at least 1; its
    /// backing likewise.
    #[must_use]
    pub fn voted(self, vote: impl Into<Vote>, sequence: u32, rule: VoteRule) -> Evidence {
        let vote: Vote = vote.into();
        let part = vote.part();
        if vote.cost > MAX_COST || part == 0 {
            return self;
        }
        let class = Label::of_cost(vote.cost);
        let bound = part_of(rule.bound(class), part);
        let fall = if class == Label::Obstacle { rule.fall } else { rule.obstacle_fall };
        let (rise, fall) = (part_of(rule.rise.max(1), part).min(bound), part_of(fall, part));
        let raised = |confidence: u8| confidence.saturating_add(rise).min(bound.max(confidence));
        if self.confidence == 0 || self.cost > MAX_COST {
            let Vote { cost, backing, model, .. } = vote;
            return Evidence { cost, confidence: rise, against: 0, backing, model, sequence };
        }
        if Label::of_cost(self.cost) != class {
            let [own, other] = [self.confidence.saturating_sub(fall), raised(self.against)];
            let wins = other > own || (other == own && class == Label::Obstacle);
            return if wins {
                let Vote { cost, backing, model, .. } = vote;
                Evidence { cost, confidence: other, against: own, backing, model, sequence }
            } else {
                Evidence { confidence: own, against: other, sequence, ..self }
            };
        }
        let (held, weight) = (i32::from(self.confidence), i32::from(rise));
        // Integer arithmetic, so that results do not depend on rounding modes. The class stays the same, because the
        // new cost lies between two costs of that class.
        let moved = |from: u8, to: u8| {
            let difference = i32::from(to) - i32::from(from);
            let step = difference * weight / (held + weight);
            (i32::from(from) + if step == 0 { difference.signum() } else { step }) as u8
        };
        Evidence {
            cost: moved(self.cost, vote.cost),
            confidence: raised(self.confidence),
            against: self.against.saturating_sub(fall),
            backing: moved(self.backing, vote.backing),
            model: vote.model,
            sequence,
        }
    }

    /// The evidence after both confidences have faded by an amount; unknown where nothing is left.
    #[must_use]
    pub fn faded(self, amount: u8) -> Evidence {
        match self.confidence.saturating_sub(amount) {
            0 => Evidence::NONE,
            confidence => Evidence { confidence, against: self.against.saturating_sub(amount), ..self },
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
            // Rounds as `f32::round`, without a call of the library: the sum is exact in f64. A number of steps has no
            // negative zero.
            let steps = f64::from(value * HEIGHTS_PER_M);
            let steps = (steps + 0.5_f64.copysign(steps)) as i32 as f32;
            if small { steps / HEIGHTS_PER_M } else { value }
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
    /// Least distance of the vehicle when a vote called the cell an obstacle: 1 to 254 decimetres, 255 for more, 0 for
    /// never. An obstacle that was only seen from far may be one by the noise of its ranges.
    pub obstacle_seen_from_dm: u8,
    /// Acquisition time of the last change; 0 for never.
    pub updated: Stamp,
}

impl Cell {
    /// Notes that a vote called the cell an obstacle, from a distance, m.
    pub(crate) fn obstacle_seen_from(&mut self, distance_m: f64) {
        let from_dm = (distance_m * 10.0).ceil().clamp(1.0, 255.0) as u8;
        let before = self.obstacle_seen_from_dm;
        self.obstacle_seen_from_dm = if before == 0 { from_dm } else { before.min(from_dm) };
    }

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

    const RULE: VoteRule = VoteRule { rise: 30, fall: 20, obstacle_fall: 20, max: 255, ground_max: 80 };

    fn voted(votes: &[u8]) -> Evidence {
        (1..)
            .zip(votes)
            .fold(Evidence::NONE, |evidence, (sequence, &cost)| evidence.voted(cost, sequence, RULE))
    }

    #[test]
    fn votes_for_a_class_raise_its_confidence_by_a_constant_up_to_the_bound_of_the_class() {
        let confidences = |cost: u8| (1..=10).map(|n| voted(&vec![cost; n]).confidence).collect::<Vec<u8>>();
        assert_eq!(confidences(250), [30, 60, 90, 120, 150, 180, 210, 240, 255, 255]);
        assert_eq!(confidences(0), [30, 60, 80, 80, 80, 80, 80, 80, 80, 80]);
        assert_eq!((voted(&[250; 10]).cost, voted(&[250; 10]).sequence), (250, 10));
        assert_eq!(Evidence { confidence: 200, ..voted(&[0]) }.voted(0, 6, RULE).confidence, 200);
    }

    #[test]
    fn ground_seen_for_long_loses_to_an_obstacle_within_three_frames() {
        let rule = VoteRule::default();
        let ground = (0..100).fold(Evidence::NONE, |evidence, n| evidence.voted(0, n, rule));
        let frames = (1..100).find(|&frames| {
            let seen = (0..frames).fold(ground, |evidence, n| evidence.voted(250, n, rule));
            Label::of_cost(seen.cost) == Label::Obstacle
        });
        assert!(frames.unwrap() <= 3, "{frames:?}");
    }

    #[test]
    fn votes_against_raise_the_other_class_until_it_wins() {
        let steps: Vec<[u8; 3]> = (0..=3)
            .map(|n| voted(&[vec![250; 3], vec![0; n]].concat()))
            .map(|evidence| [evidence.cost, evidence.confidence, evidence.against])
            .collect();
        assert_eq!(steps, [[250, 90, 0], [250, 70, 30], [0, 60, 50], [0, 80, 30]]);
        // On a tie the obstacle wins.
        let even = VoteRule { rise: 20, fall: 20, obstacle_fall: 20, max: 80, ground_max: 80 };
        let tie =
            [0, 250, 0, 250].iter().fold(Evidence::NONE, |evidence, &cost| evidence.voted(cost, 1, even));
        assert_eq!([tie.cost, tie.confidence], [250, 20]);
    }

    #[test]
    fn a_vote_counts_by_its_worth_and_by_its_distance_from_the_border_of_the_classes() {
        let check = |cost: u8, worth: u8, votes: u32, expected: u8| {
            let vote = Vote { worth, ..Vote::from(cost) };
            let evidence = (0..votes).fold(Evidence::NONE, |evidence, n| evidence.voted(vote, n, RULE));
            assert_eq!(evidence.confidence, expected, "{vote:?}");
        };
        check(250, 255, 1, 30);
        check(250, 51, 1, 6);
        check(250, 51, 100, 51);
        check(0, 51, 100, 16);
        // Ground counts by its distance from the border, an obstacle by half of a vote at least.
        check(100, 255, 1, 6);
        check(100, 255, 100, 16);
        check(125, 255, 1, 16);
        check(150, 255, 100, 129);
        check(250, 0, 100, 0);
    }

    #[test]
    fn the_backing_follows_the_votes_of_the_class() {
        let known = Vote { backing: 200, ..Vote::from(250) };
        let seen = Evidence::NONE.voted(known, 1, RULE);
        assert_eq!(seen.backing, 200);
        assert_eq!(seen.voted(250, 2, RULE).backing, 100);
        let sure = seen.voted(known, 2, RULE).voted(known, 3, RULE);
        assert_eq!(
            [sure.voted(0, 4, RULE).cost, sure.voted(0, 4, RULE).backing],
            [250, 200],
            "ground does not win yet"
        );
        assert_eq!(voted(&[0, 0]).voted(known, 3, RULE).voted(known, 4, RULE).backing, 200);
    }

    #[test]
    fn what_is_not_seen_again_fades_to_unknown() {
        let seen = voted(&[250, 250, 0]);
        assert_eq!([seen.confidence, seen.against], [40, 30]);
        assert_eq!([seen.faded(35).confidence, seen.faded(35).against], [5, 0]);
        assert_eq!(seen.faded(40), Evidence::NONE);
    }

    #[test]
    fn what_is_no_cost_is_no_vote() {
        assert_eq!(Evidence::NONE.voted(255, 1, RULE), Evidence::NONE);
        assert_eq!(voted(&[40]).voted(251, 9, RULE), voted(&[40]));
    }

    #[test]
    fn agreeing_costs_are_averaged_over_the_first_votes() {
        // 250, then towards 200 by 18 / (30 + 18): a vote of 200 is 0.6 of a full one.
        assert_eq!(voted(&[250, 200]).cost, 232);
        assert_eq!(voted(&[0, 0, 0]).cost, 0);
    }

    proptest! {
        #[test]
        fn any_votes_keep_the_bounds_and_a_steady_source_wins(
            votes in prop::collection::vec((any::<u8>(), any::<u8>()), 0..80), last in 0..=MAX_COST,
            rise in 0..=255_u8, fall in 1..=255_u8, obstacle_fall in 1..=255_u8, ground_max in 0..=255_u8,
        ) {
            let rule = VoteRule { rise, fall, obstacle_fall, max: 255, ground_max };
            let mut evidence = Evidence::NONE;
            for (i, (cost, worth)) in (0..).zip(votes) {
                evidence = evidence.voted(Vote { worth, ..Vote::from(cost) }, i, rule);
                prop_assert_eq!(evidence.confidence == 0, evidence.cost == UNKNOWN_COST);
                prop_assert!(evidence.cost <= MAX_COST || evidence.cost == UNKNOWN_COST);
                prop_assert!(evidence.against <= evidence.confidence);
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
