//! From colours to costs of the 128×96 image: classification, temporal fusion, cost (Albus 2006a, 3.1.2).
//!
//! For each pixel `P_t = (w·P_{t−1} + c·P) / (w + c)`, then `w += c` while `w < w_max`; w₀ = 0, c = 1. A pixel whose
//! colour occurs in no model (0/0) is unclassified in this image: its `P_t` and w do not change, and its cost is
//! unknown.

use crate::histogram::bin;
use crate::image::PIXELS;
use rcs_world::{MAX_COST, OBSTACLE_COST, UNKNOWN_COST};
use serde::{Deserialize, Serialize};

/// Probability of ground of each pixel of the reduced image, fused over time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fused {
    /// `P_t`; [`NEVER`] until the pixel has been classified once.
    probability: Vec<f32>,
    /// w.
    weight: Vec<u16>,
}

/// Marks pixels that have never been classified.
const NEVER: f32 = -1.0;

/// Number of pixels by class.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Cost below [`OBSTACLE_COST`]: more likely ground.
    pub ground: u32,
    /// Cost of at least [`OBSTACLE_COST`].
    pub background: u32,
    /// Unclassified.
    pub unclassified: u32,
}

impl Default for Fused {
    fn default() -> Self {
        Fused { probability: vec![NEVER; PIXELS], weight: vec![0; PIXELS] }
    }
}

impl Fused {
    /// Fuses an image, given its reduced pixels and `P_ground` by bin (NaN for 0/0). With `w_max` 0 every image is
    /// classified by itself. Returns the cost of each pixel: 250·(1 − `P_t`), rounded, 255 where it is unclassified.
    pub fn take(&mut self, reduced: &[[u8; 2]], probabilities: &[f32], w_max: u32) -> Vec<u8> {
        let w_max = w_max.min(u32::from(u16::MAX)) as u16;
        let pixels = reduced.iter().zip(&mut self.probability).zip(&mut self.weight);
        pixels
            .map(|((&[red, green], fused), weight)| {
                let new = probabilities[bin(red, green)];
                if new.is_nan() {
                    return UNKNOWN_COST;
                }
                let w = f32::from(*weight);
                *fused = (w * *fused + new) / (w + 1.0);
                *weight = weight.saturating_add(1).min(w_max);
                cost(*fused)
            })
            .collect()
    }

    /// Indices of the pixels of the reduced image that are background by the fused probability.
    pub fn background(&self) -> Vec<u32> {
        let is_background = |&(_, p): &(u32, &f32)| *p != NEVER && cost(*p) >= OBSTACLE_COST;
        (0..).zip(&self.probability).filter(is_background).map(|(index, _)| index).collect()
    }
}

/// 250·(1 − P), rounded.
pub fn cost(probability: f32) -> u8 {
    (f32::from(MAX_COST) * (1.0 - probability) + 0.5).clamp(0.0, f32::from(MAX_COST)) as u8
}

/// Counts the pixels of each class.
pub fn count(costs: &[u8]) -> Counts {
    let mut counts = Counts::default();
    for &cost in costs {
        match cost {
            UNKNOWN_COST => counts.unclassified += 1,
            OBSTACLE_COST.. => counts.background += 1,
            _ => counts.ground += 1,
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::histogram::{CELLS, Histogram};
    use crate::models::{Model, Models};
    use proptest::prelude::*;
    use rcs_msg::Stamp;

    fn model(counts: &[u8]) -> Model {
        let counts: Vec<f32> = counts.iter().map(|&c| f32::from(c)).collect();
        let histogram = Histogram::from_counts(&counts).unwrap();
        Model { name: String::new(), histogram, uses: 1, updated: Stamp(1), sample: None }
    }

    /// Reference implementation, pixel by pixel and model by model: the largest `P_ground`, `None` for 0/0, then fused.
    fn reference_cost(models: &Models, [red, green]: [u8; 2], fused: &mut (f64, u32), w_max: u32) -> u8 {
        let at = usize::from(red) * 30 / 256 * 30 + usize::from(green) * 30 / 256;
        let n_background: f64 = models
            .background
            .iter()
            .chain(&models.obstacles)
            .map(|m| f64::from(m.histogram.counts()[at]))
            .sum();
        let mut best = f64::NAN;
        for model in &models.ground {
            let n_ground = f64::from(model.histogram.counts()[at]);
            best = best.max(n_ground / (n_ground + n_background));
        }
        if best.is_nan() {
            return 255;
        }
        let (p, w) = (fused.0, f64::from(fused.1));
        fused.0 = (w * p + best) / (w + 1.0);
        if fused.1 < w_max {
            fused.1 += 1;
        }
        (250.0 * (1.0 - fused.0)).round() as u8
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn costs_equal_those_of_the_rule(
            grounds in prop::collection::vec(prop::collection::vec(prop_oneof![Just(0_u8), any::<u8>()], CELLS), 1..4),
            backgrounds in prop::collection::vec(prop::collection::vec(prop_oneof![Just(0_u8), any::<u8>()], CELLS), 2),
            seed: u64, w_max in 0..4_u32,
        ) {
            let models = Models {
                ground: grounds.iter().map(|c| model(c)).collect(),
                background: Some(model(&backgrounds[0])),
                obstacles: vec![model(&backgrounds[1])],
                ..Models::default()
            };
            let table = models.probabilities();
            let (mut fused, mut reference) = (Fused::default(), vec![(0.0, 0); PIXELS]);
            let mut state = seed;
            for _ in 0..4 {
                let image: Vec<[u8; 2]> = (0..PIXELS).map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    [(state >> 56) as u8, (state >> 48) as u8]
                }).collect();
                let costs = fused.take(&image, &table, w_max);
                for ((cost, &pixel), fused) in costs.iter().zip(&image).zip(&mut reference) {
                    let expected = reference_cost(&models, pixel, fused, w_max);
                    // Single and double precision may round a half in different directions.
                    prop_assert!(cost.abs_diff(expected) <= 1 && (*cost == 255) == (expected == 255), "{cost} {expected}");
                }
            }
        }
    }

    #[test]
    fn a_colour_that_nobody_has_seen_gives_no_vote_and_what_was_said_before_stays() {
        let mut table = vec![f32::NAN; CELLS];
        table[bin(0, 0)] = 0.2;
        let mut fused = Fused::default();
        let known = vec![[0, 0]; PIXELS];
        let unknown = vec![[255, 255]; PIXELS];
        assert!(fused.take(&unknown, &table, 3).iter().all(|&cost| cost == UNKNOWN_COST));
        assert!(fused.background().is_empty());
        assert!(fused.take(&known, &table, 3).iter().all(|&cost| cost == 200));
        assert_eq!(count(&fused.take(&unknown, &table, 3)).unclassified, PIXELS as u32);
        assert_eq!(fused.background().len(), PIXELS);
    }

    #[test]
    fn probabilities_are_averaged_over_w_max_images() {
        let table = |p: f32| vec![p; CELLS];
        let image = vec![[9, 9]; PIXELS];
        let mut fused = Fused::default();
        // w = 0, 1, 2, 2: 0; 1/2; (2·1/2 + 1)/3 = 2/3; (2·2/3 + 1)/3 = 7/9.
        let costs: Vec<u8> =
            [0.0, 1.0, 1.0, 1.0].into_iter().map(|p| fused.take(&image, &table(p), 2)[0]).collect();
        assert_eq!(costs, [250, 125, 83, 56]);
    }

    #[test]
    fn half_ground_half_background_is_an_obstacle_as_the_world_model_has_it() {
        let counts = count(&[cost(0.5), cost(0.51), cost(0.0), cost(1.0), 255]);
        assert_eq!(counts, Counts { ground: 2, background: 2, unclassified: 1 });
    }
}
