//! The colour models and how they are learned (Albus 2006a, 3.1.2): several of ground, one of background, known
//! obstacles.
//!
//! - A new ground histogram that is close to a model updates the best match. Otherwise, while there are fewer than the
//!   maximum number of models, learning mode starts: for a period it keeps the histogram that differs most from all
//!   models. The period restarts whenever a more different histogram is seen; when it ends, that histogram becomes a
//!   model.
//! - The very first ground histogram becomes a model at once ("the initial ground model").
//! - Background histograms are averaged into the one background model.
//!
//! What the paper leaves open and how it is done here: the difference of two histograms is [`Histogram::difference`]; a
//! model is a running average over the last `memory` histograms; the learning period counts only time between images
//! from which ground may be learned, so a turn suspends it. A priori ground models are updated like learned ones,
//! because changes of light affect them, too. Known obstacles are not updated, and their counts are added to the
//! background's.

use crate::histogram::{CELLS, Histogram};
use crate::mesh;
use rcs_msg::Stamp;
use rcs_sense::{Sample, last_learned, learned_name};
use serde::{Deserialize, Serialize};

/// Blends of a known obstacle that are rarer than this part of them do not count.
const LEAST_PART: f32 = 0.0005;

/// Parameters of learning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Sum of the counts of every model: the sample budget.
    pub samples: u32,
    /// Maximum number of ground models.
    pub max_models: usize,
    /// A histogram that differs by less from a model updates it, 0 to 1.
    pub match_difference: f32,
    /// Time from the most different histogram until it becomes a model, ns.
    pub learning_period_ns: u64,
    /// Maximum number of histograms in the average of a model.
    pub memory: u32,
    /// Maximum number of images in the average of a pixel's probability, `w_max`; 0 classifies every image by itself.
    pub fusion_frames: u32,
    /// Minimum number of pixels of a ground sample.
    pub min_sample_px: u32,
    /// Least share of a pixel that a known obstacle covers where it shows: 1 for those that nothing is seen through.
    pub known_least_cover: f64,
}

impl Default for Settings {
    /// The default values of the process parameters.
    fn default() -> Self {
        Settings {
            samples: 4000,
            max_models: 5,
            match_difference: 0.5,
            learning_period_ns: 1_000_000_000,
            memory: 25,
            fusion_frames: 3,
            min_sample_px: 300,
            known_least_cover: 0.25,
        }
    }
}

/// A colour model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Name of the model.
    pub name: String,
    /// Distribution of colours; its sum is the sample budget.
    pub histogram: Histogram,
    /// Number of histograms that were averaged into it.
    pub uses: u32,
    /// Acquisition time of the last of them.
    pub updated: Stamp,
    /// What it was made from, for display alone.
    pub sample: Option<Sample>,
}

impl Model {
    fn update(&mut self, new: &Histogram, time: Stamp, memory: u32) {
        self.histogram.merge(new, self.uses.min(memory.saturating_sub(1)));
        self.uses = self.uses.saturating_add(1);
        self.updated = time;
    }
}

/// What was done with a ground histogram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Learned {
    /// It updated the ground model of this index.
    Updated(usize),
    /// Learning mode is watching for the most different histogram.
    Watches {
        /// Time left in learning mode, ns.
        left_ns: u64,
    },
    /// A new ground model was made.
    Added,
    /// It differs from all models, and the maximum number of models is reached.
    Full,
}

/// State of learning mode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Watch {
    /// The most different histogram so far, and its difference.
    candidate: Histogram,
    sample: Option<Sample>,
    difference: f32,
    left_ns: u64,
}

/// All models of one camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Models {
    /// Traversable ground.
    pub ground: Vec<Model>,
    /// Everything that is not ground; `None` until some of it has been seen.
    pub background: Option<Model>,
    /// Known obstacles.
    pub obstacles: Vec<Model>,
    pub(crate) watch: Option<Watch>,
    /// Ground models made so far, from which new models are numbered.
    pub(crate) made: u32,
}

impl Models {
    /// Adds initial models, scaled to the sample budget.
    #[must_use]
    pub fn with(mut self, others: &Models, samples: u32) -> Models {
        let scaled = |model: &Model| Model {
            histogram: model.histogram.clone().scaled(samples as f32),
            ..model.clone()
        };
        self.ground.extend(others.ground.iter().map(scaled));
        self.obstacles.extend(others.obstacles.iter().map(scaled));
        self.background = self.background.or_else(|| others.background.as_ref().map(scaled));
        // Saved models that were learned keep their names, so new names are numbered after them.
        let last = last_learned(self.ground.iter().map(|model| model.name.as_str())) as u32;
        self.made = self.made.max(last).max(self.ground.len() as u32);
        self
    }

    /// Scales all models to another sample budget: they are compared with histograms of that budget.
    pub fn rescale(&mut self, samples: u32) {
        let models = self.ground.iter_mut().chain(&mut self.background).chain(&mut self.obstacles);
        let candidate = self.watch.iter_mut().map(|watch| &mut watch.candidate);
        for histogram in models.map(|model| &mut model.histogram).chain(candidate) {
            *histogram = std::mem::take(histogram).scaled(samples as f32);
        }
    }

    /// The smallest difference between a histogram and a ground model, and the index of that model; 1 and `None`
    /// without models.
    pub fn best_match(&self, histogram: &Histogram) -> (f32, Option<usize>) {
        self.ground.iter().enumerate().fold((1.0, None), |best, (index, model)| {
            let difference = model.histogram.difference(histogram);
            if best.1.is_none() || difference < best.0 { (difference, Some(index)) } else { best }
        })
    }

    /// Time left in learning mode, ns; `None` when it is off.
    pub fn learning_left_ns(&self) -> Option<u64> {
        self.watch.as_ref().map(|watch| watch.left_ns)
    }

    /// Takes a ground histogram scaled to the sample budget, `elapsed_ns` after the previous one. `sample` makes the
    /// picture of its pixels, if it may become a model.
    pub fn learn_ground(
        &mut self,
        histogram: &Histogram,
        sample: impl FnOnce() -> Option<Sample>,
        time: Stamp,
        elapsed_ns: u64,
        settings: &Settings,
    ) -> Learned {
        let (difference, best) = self.best_match(histogram);
        let Some(best) = best else {
            self.add(histogram.clone(), sample(), time);
            return Learned::Added;
        };
        let matches = difference < settings.match_difference;
        let room = self.ground.len() < settings.max_models;
        if matches {
            self.ground[best].update(histogram, time, settings.memory);
        }
        if !room {
            self.watch = None;
            return if matches { Learned::Updated(best) } else { Learned::Full };
        }
        if let Some(watch) = &mut self.watch {
            watch.left_ns = watch.left_ns.saturating_sub(elapsed_ns);
        }
        if !matches && self.watch.as_ref().is_none_or(|watch| difference > watch.difference) {
            let left_ns = settings.learning_period_ns;
            let (candidate, sample) = (histogram.clone(), sample());
            self.watch = Some(Watch { candidate, sample, difference, left_ns });
        }
        match self.watch.take_if(|watch| watch.left_ns == 0) {
            Some(watch) => {
                self.add(watch.candidate, watch.sample, time);
                Learned::Added
            }
            None if matches => Learned::Updated(best),
            None => Learned::Watches { left_ns: self.learning_left_ns().unwrap_or(0) },
        }
    }

    /// Takes a background histogram scaled to the sample budget.
    pub fn learn_background(&mut self, histogram: &Histogram, time: Stamp, settings: &Settings) {
        if let Some(model) = &mut self.background {
            model.update(histogram, time, settings.memory);
        } else {
            let (name, histogram) = ("background".to_owned(), histogram.clone());
            self.background = Some(Model { name, histogram, uses: 1, updated: time, sample: None });
        }
    }

    fn add(&mut self, histogram: Histogram, sample: Option<Sample>, time: Stamp) {
        self.made = self.made.saturating_add(1);
        let name = learned_name(u64::from(self.made));
        self.ground.push(Model { name, histogram, uses: 1, updated: time, sample });
        self.watch = None;
    }

    /// Deletes a model by its number in messages: ground models come first, then the background, then known obstacles.
    /// Whether there was one.
    pub fn delete(&mut self, number: usize) -> bool {
        if number < self.ground.len() {
            self.ground.remove(number);
            return true;
        }
        let background = self.background.iter().len();
        let rest = number - self.ground.len();
        if rest < background {
            self.background = None;
            return true;
        }
        let is_known = rest - background < self.obstacles.len();
        if is_known {
            self.obstacles.remove(rest - background);
        }
        is_known
    }

    /// The names of all models in the order of messages.
    pub fn names(&self) -> Vec<&str> {
        let all = self.ground.iter().chain(&self.background).chain(&self.obstacles);
        all.map(|model| model.name.as_str()).collect()
    }

    /// How likely a colour is a known obstacle, for each bin: `N_o / (N_g + N_b)`, 0 to 255, with the largest `N_g`, and
    /// `N_b` including `N_o`. Empty without known obstacles.
    pub fn known_obstacles(&self) -> Vec<u8> {
        if self.obstacles.is_empty() {
            return Vec::new();
        }
        let most = |bin: usize| {
            self.ground.iter().map(|model| model.histogram.counts()[bin]).fold(0.0_f32, f32::max)
        };
        let of = |models: &[Model], bin: usize| models.iter().map(|m| m.histogram.counts()[bin]).sum::<f32>();
        let known = |bin: usize| {
            let obstacle = of(&self.obstacles, bin);
            let all = most(bin) + of(self.background.as_slice(), bin) + obstacle;
            if obstacle > 0.0 { (255.0 * obstacle / all) as u8 } else { 0 }
        };
        (0..CELLS).map(known).collect()
    }

    /// How likely a colour is a blend of a known obstacle and the ground behind it, for each bin: `N / (N + N_g)`, 0 to
    /// 255, with the counts N of the blends ([`mesh::blended`]) and the largest `N_g`. The background does not count,
    /// because the background of a fence is often the fence itself. Empty without known obstacles.
    pub fn blended_obstacles(&self, least_cover: f64, lights: &[f32]) -> Vec<u8> {
        let Some((first, others)) = self.obstacles.split_first() else { return Vec::new() };
        let mut obstacle = first.histogram.clone();
        (1..).zip(others).for_each(|(uses, model)| obstacle.merge(&model.histogram, uses));
        let (mut blend, mut ground) = (vec![0.0_f32; CELLS], vec![0.0_f32; CELLS]);
        let raise = |most: &mut [f32], counts: &[f32]| {
            std::iter::zip(most, counts).for_each(|(most, &count)| *most = most.max(count));
        };
        for model in &self.ground {
            raise(&mut blend, &mesh::blended(&obstacle, &model.histogram, least_cover, lights));
            raise(&mut ground, model.histogram.counts());
        }
        let least = LEAST_PART * obstacle.sum();
        let likelihood = |(blend, ground): (f32, f32)| {
            if blend > least { (255.0 * blend / (blend + ground) + 0.5) as u8 } else { 0 }
        };
        std::iter::zip(blend, ground).map(likelihood).collect()
    }

    /// The model that has most of a colour, for each bin: its number from 1 in the message of models; 0 where none has it.
    /// Of equal ones the first.
    pub fn numbers(&self) -> Vec<u8> {
        let mut most = vec![0.0_f32; CELLS];
        let mut numbers = vec![0; CELLS];
        let models = self.ground.iter().chain(&self.background).chain(&self.obstacles);
        for (number, model) in models.enumerate() {
            let number = u8::try_from(number + 1).unwrap_or(0);
            for ((most, slot), &count) in most.iter_mut().zip(&mut numbers).zip(model.histogram.counts()) {
                if count > *most {
                    (*most, *slot) = (count, number);
                }
            }
        }
        numbers
    }

    /// Number of the first known obstacle in the message of models, from 1.
    pub fn first_obstacle(&self) -> u8 {
        let before = self.ground.len() + usize::from(self.background.is_some());
        u8::try_from(before + 1).unwrap_or(0)
    }

    /// `P_ground = N_g / (N_g + N_b)` of each bin, the maximum over the ground models; NaN for 0/0 (unclassified).
    /// `N_b` is the sum of the counts of the background and of known obstacles.
    pub fn probabilities(&self) -> Vec<f32> {
        let mut background = vec![0.0_f32; CELLS];
        for model in self.background.iter().chain(&self.obstacles) {
            std::iter::zip(&mut background, model.histogram.counts()).for_each(|(sum, count)| *sum += count);
        }
        // `N_b` is common to all models, so the largest `N_g` gives the largest quotient.
        let mut ground = vec![0.0_f32; CELLS];
        for model in &self.ground {
            std::iter::zip(&mut ground, model.histogram.counts())
                .for_each(|(most, &count)| *most = most.max(count));
        }
        std::iter::zip(ground, background).map(|(g, b)| g / (g + b)).collect()
    }
}
