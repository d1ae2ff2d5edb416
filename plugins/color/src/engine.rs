//! The complete colour-model algorithm for one image (Albus 2006a, 3.1.2): learn from the samples, classify the pixels,
//! fuse them over time.
//!
//! Cost per image: see `benches/color.rs`.

use crate::background;
use crate::fusion::{Counts, Fused, count};
use crate::histogram::{Histogram, Span, bin};
use crate::image::{Image, reduce};
use crate::models::{Learned, Models, Settings};
use crate::{mesh, posts};
use rand_core::RngCore;
use rcs_msg::Stamp;
use rcs_sense::{Rgb, SAMPLE_PX, Sample};
use serde::{Deserialize, Serialize};

/// After a longer gap, ns, the fused probabilities are discarded: the pixels no longer see the same ground.
const FUSION_GAP_NS: u64 = 1_000_000_000;

/// After this time, ns, the colours of known obstacles are blended anew with those of the ground, which changes slowly.
const BLEND_PERIOD_NS: u64 = 1_000_000_000;

/// State of one camera: its models, and the probabilities fused over the last images.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Engine {
    /// The models.
    pub models: Models,
    fused: Fused,
    last_image: Option<Stamp>,
    last_learned: Option<Stamp>,
    /// [`Models::blended_obstacles`] in any light, those that posts have, and when they were blended.
    blended: Vec<u8>,
    posts: Vec<u8>,
    blended_at: Option<Stamp>,
}

/// What may be learned from an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Permission {
    /// Ground and background.
    All,
    /// Background, and ground only while there is no ground model.
    FirstGround,
    /// Background only.
    Background,
    /// Nothing.
    Nothing,
}

/// Regions of the image to sample, and what may be learned from them.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// Pixels that are assumed to be ground.
    pub ground: &'a [Span],
    /// Optical frame of the camera.
    pub frame_id: &'a str,
    /// For each column of the reduced image, how many rows from the top the first background samples are taken from.
    pub first_background: &'a [u32],
    /// What may be learned.
    pub permission: Permission,
}

/// Result of one image.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Costs of the 128×96 image in row order, 255 for unclassified pixels; `None` while there is no ground model.
    pub costs: Option<Vec<u8>>,
    /// The model that has most of the colour of each pixel, see [`Models::numbers`]; empty while there is no ground model.
    pub models: Vec<u8>,
    /// Which of these pixels show a known obstacle; `None` without models of known obstacles.
    pub known: Option<Known>,
    /// Number of pixels by class; all 0 where `costs` is `None`.
    pub counts: Counts,
    /// Pixels in the ground sample.
    pub sample_pixels: u32,
    /// What was done with the ground sample; `None` if it was too small or if ground may not be learned.
    pub learned: Option<Learned>,
    /// Difference between the ground sample and the best match before learning; 1 without a model or a sample.
    pub difference: f32,
}

/// How likely the pixels of the 128×96 image show a known obstacle, 0 to 255, in row order.
#[derive(Clone, Debug, PartialEq)]
pub struct Known {
    /// By the obstacle's own colour.
    pub pure: Vec<u8>,
    /// By this colour or a blend of it and the ground.
    pub blended: Vec<u8>,
    /// By this colour or a blend that the posts of a fence have ([`crate::posts`]).
    pub posts: Vec<u8>,
    /// The number of its model, see [`Models::numbers`]; of several, the first.
    pub model: u8,
}

impl Engine {
    /// An engine that starts with these models.
    pub fn new(models: Models) -> Engine {
        Engine { models, ..Engine::default() }
    }

    /// Processes one image. The caller has checked that it is neither black nor saturated.
    pub fn see(
        &mut self,
        image: &Image<'_>,
        samples: &Samples<'_>,
        time: Stamp,
        settings: &Settings,
        rng: &mut impl RngCore,
    ) -> Seen {
        let reduced = reduce(image);
        // Also after a gap, the background is sampled where the last image called it so.
        let called = self.fused.background();
        if self.last_image.is_none_or(|last| time.0.abs_diff(last.0) > FUSION_GAP_NS) {
            self.fused = Fused::default();
        }
        self.last_image = Some(time);

        let sample_pixels = samples.ground.iter().map(Span::pixels).sum();
        let mut seen = Seen {
            costs: None,
            models: Vec::new(),
            known: None,
            counts: Counts::default(),
            sample_pixels,
            learned: None,
            difference: 1.0,
        };
        if sample_pixels >= settings.min_sample_px {
            let histogram = Histogram::of_spans(image, samples.ground).scaled(settings.samples as f32);
            seen.difference = self.models.best_match(&histogram).0;
            let allowed = match samples.permission {
                Permission::All => true,
                Permission::FirstGround => self.models.ground.is_empty(),
                Permission::Background | Permission::Nothing => false,
            };
            if allowed {
                // A long gap counts as at most one second, because no image was seen during it.
                let elapsed_ns =
                    self.last_learned.map_or(0, |last| time.0.saturating_sub(last.0).min(FUSION_GAP_NS));
                let sample = || picture(&image.rgb(samples.frame_id, time), samples.ground);
                seen.learned = Some(self.models.learn_ground(&histogram, sample, time, elapsed_ns, settings));
            }
        }
        // Time in which nothing could be learned does not count towards the learning period.
        self.last_learned = seen.learned.is_some().then_some(time);

        if samples.permission != Permission::Nothing {
            let drawn = background::sample(image, &called, samples.first_background, settings.samples, rng);
            if drawn.sum() > 0.0 {
                self.models.learn_background(&drawn.scaled(settings.samples as f32), time, settings);
            }
        }
        if !self.models.ground.is_empty() {
            let of = |table: &[u8]| reduced.iter().map(|&[red, green]| table[bin(red, green)]).collect();
            seen.models = of(&self.models.numbers());
            let costs = self.fused.take(&reduced, &self.models.probabilities(), settings.fusion_frames);
            if !self.models.obstacles.is_empty() {
                let is_old = |at: Stamp| time.0.abs_diff(at.0) >= BLEND_PERIOD_NS;
                if self.blended_at.is_none_or(is_old) || seen.learned == Some(Learned::Added) {
                    let blended =
                        |least_cover, lights: &[f32]| self.models.blended_obstacles(least_cover, lights);
                    self.blended = blended(settings.known_least_cover, &mesh::ANY_LIGHT);
                    self.posts = blended(posts::LEAST_COVER, &mesh::FULL_LIGHT);
                    self.blended_at = Some(time);
                }
                seen.known = Some(Known {
                    pure: of(&self.models.known_obstacles()),
                    blended: of(&self.blended),
                    posts: of(&self.posts),
                    model: self.models.first_obstacle(),
                });
            }
            seen.counts = count(&costs);
            seen.costs = Some(costs);
        }
        seen
    }
}

/// The middle of the ground sample.
fn picture(image: &Rgb<'_>, ground: &[Span]) -> Option<Sample> {
    let rows = [ground.first()?.row, ground.last()?.row].map(|row| row as usize);
    let middle = ground.get(ground.len() / 2)?;
    let column = u32::midpoint(middle.start, middle.end) as usize;
    let side = (rows[1] + 1 - rows[0]).min(middle.pixels() as usize);
    Sample::around(image, [column, middle.row as usize], side.clamp(SAMPLE_PX / 2, 2 * SAMPLE_PX))
}
