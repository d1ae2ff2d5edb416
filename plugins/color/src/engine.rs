//! The whole colour-model algorithm on one image (Albus 2006a, 3.1.2): learn from its samples, classify it, fuse it.
//!
//! Cost on one image: see `benches/color.rs`.

use crate::background;
use crate::fusion::{Counts, Fused, count};
use crate::histogram::{Histogram, Span};
use crate::image::{Image, reduce};
use crate::models::{Learned, Models, Settings};
use rand_core::RngCore;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// After a longer pause pixels have nothing to do with those of the last image, ns.
const FUSION_GAP_NS: u64 = 1_000_000_000;

/// Models and what the last images said. The state of a camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Engine {
    /// The models.
    pub models: Models,
    fused: Fused,
    last_image: Option<Stamp>,
    last_learned: Option<Stamp>,
}

/// What may be learned from an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Permission {
    /// Ground and background.
    All,
    /// Background, and ground only where there is no model of it yet.
    FirstGround,
    /// Background alone.
    Background,
    /// Nothing.
    Nothing,
}

/// Where an image is sampled, and what may be learned.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// Pixels that are assumed to be ground.
    pub ground: &'a [Span],
    /// Rows from the top that the first background samples may come from, by columns of the reduced image.
    pub first_background: &'a [u32],
    /// What may be learned.
    pub permission: Permission,
}

/// What came of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Costs of the 128×96 image by rows, 255 for no vote; nothing while there is no ground model.
    pub costs: Option<Vec<u8>>,
    /// Pixels by what they are; all 0 without costs.
    pub counts: Counts,
    /// Pixels in the ground sample.
    pub sample_pixels: u32,
    /// What became of the ground sample; `None` where it was too small or nothing may be learned from it.
    pub learned: Option<Learned>,
    /// Difference of the ground sample from the best match before it was learned; 1 without model or sample.
    pub difference: f32,
}

impl Engine {
    /// An engine that begins with models.
    pub fn new(models: Models) -> Engine {
        Engine { models, ..Engine::default() }
    }

    /// One image, which has been checked: it is neither black nor saturated.
    pub fn see(
        &mut self,
        image: &Image<'_>,
        samples: &Samples<'_>,
        time: Stamp,
        settings: &Settings,
        rng: &mut impl RngCore,
    ) -> Seen {
        let reduced = reduce(image);
        if self.last_image.is_none_or(|last| time.0.abs_diff(last.0) > FUSION_GAP_NS) {
            self.fused = Fused::default();
        }
        self.last_image = Some(time);

        let sample_pixels = samples.ground.iter().map(Span::pixels).sum();
        let mut seen =
            Seen { costs: None, counts: Counts::default(), sample_pixels, learned: None, difference: 1.0 };
        if sample_pixels >= settings.min_sample_px {
            let histogram = Histogram::of_spans(image, samples.ground).scaled(settings.samples as f32);
            seen.difference = self.models.best_match(&histogram).0;
            let allowed = match samples.permission {
                Permission::All => true,
                Permission::FirstGround => self.models.ground.is_empty(),
                Permission::Background | Permission::Nothing => false,
            };
            if allowed {
                // A long pause is one image long: nothing was watched meanwhile.
                let elapsed_ns =
                    self.last_learned.map_or(0, |last| time.0.saturating_sub(last.0).min(FUSION_GAP_NS));
                seen.learned = Some(self.models.learn_ground(&histogram, time, elapsed_ns, settings));
            }
        }
        // Time that nothing could be learned in does not count for learning mode.
        self.last_learned = seen.learned.is_some().then_some(time);

        if samples.permission != Permission::Nothing {
            let called = self.fused.background();
            let drawn = background::sample(image, &called, samples.first_background, settings.samples, rng);
            if drawn.sum() > 0.0 {
                self.models.learn_background(&drawn.scaled(settings.samples as f32), time, settings);
            }
        }
        if !self.models.ground.is_empty() {
            let costs = self.fused.take(&reduced, &self.models.probabilities(), settings.fusion_frames);
            seen.counts = count(&costs);
            seen.costs = Some(costs);
        }
        seen
    }
}
