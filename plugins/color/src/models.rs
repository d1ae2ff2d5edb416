//! The colour models and how they are learned (Albus 2006a, 3.1.2): several of ground, one of background, known
//! obstacles.
//!
//! - A new ground histogram that is close to a model updates the best match. Otherwise, below the greatest number of
//!   models, learning mode begins: a period in which the histogram that differs most from all models is looked for. It
//!   begins anew whenever a more different one is seen; when it ends, that one becomes a model.
//! - The very first ground histogram becomes a model at once: "the initial ground model".
//! - Background histograms are averaged into the one background model.
//!
//! Where we decide what the paper leaves open: the difference of two histograms is [`Histogram::difference`]; models
//! are running averages over the last `memory` histograms; the period runs in the time between images of which
//! something may be learned, so that a turn suspends it. A priori ground models are updated like any other, as the
//! light changes them, too; known obstacles are not, and count with the background.

use crate::histogram::{CELLS, Histogram};
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// What is fixed about learning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Sum of every model: the sample budget.
    pub samples: u32,
    /// Most ground models.
    pub max_models: usize,
    /// A histogram that differs by less from a model updates it, 0 to 1.
    pub match_difference: f32,
    /// Time after the most different histogram until it becomes a model, ns.
    pub learning_period_ns: u64,
    /// Most histograms in the average of a model.
    pub memory: u32,
    /// Most images in the average of a pixel's probability, `w_max`; 0 judges each image by itself.
    pub fusion_frames: u32,
    /// Fewest pixels of a ground sample.
    pub min_sample_px: u32,
}

impl Default for Settings {
    /// The defaults of the parameters.
    fn default() -> Self {
        Settings {
            samples: 4000,
            max_models: 5,
            match_difference: 0.5,
            learning_period_ns: 1_000_000_000,
            memory: 25,
            fusion_frames: 3,
            min_sample_px: 300,
        }
    }
}

/// A model of colours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// What it is called.
    pub name: String,
    /// Its shares, with the sample budget as their sum.
    pub histogram: Histogram,
    /// Histograms that were merged into it.
    pub uses: u32,
    /// When the last of them was seen.
    pub updated: Stamp,
}

impl Model {
    fn update(&mut self, new: &Histogram, time: Stamp, memory: u32) {
        self.histogram.merge(new, self.uses.min(memory.saturating_sub(1)));
        self.uses = self.uses.saturating_add(1);
        self.updated = time;
    }
}

/// What became of a ground histogram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Learned {
    /// It updated the ground model of this index.
    Updated(usize),
    /// It is watched in learning mode, which lasts this long still.
    Watches {
        /// Nanoseconds.
        left_ns: u64,
    },
    /// A new ground model was made.
    Added,
    /// It differs from all models, and there are as many as there may be.
    Full,
}

/// Learning mode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Watch {
    /// The most different histogram yet, and by how much.
    candidate: Histogram,
    difference: f32,
    left_ns: u64,
}

/// All models of one camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Models {
    /// Traversable ground.
    pub ground: Vec<Model>,
    /// Everything else, once anything of it was seen.
    pub background: Option<Model>,
    /// Known obstacles.
    pub obstacles: Vec<Model>,
    pub(crate) watch: Option<Watch>,
    /// Ground models made so far: their names go on where they ended.
    pub(crate) made: u32,
}

impl Models {
    /// Adds models to begin with, scaled to the sample budget.
    #[must_use]
    pub fn with(mut self, others: &Models, samples: u32) -> Models {
        let scaled = |model: &Model| Model {
            histogram: model.histogram.clone().scaled(samples as f32),
            ..model.clone()
        };
        self.ground.extend(others.ground.iter().map(scaled));
        self.obstacles.extend(others.obstacles.iter().map(scaled));
        self.background = self.background.or_else(|| others.background.as_ref().map(scaled));
        // Learned models that were saved keep their names, so new ones count on.
        self.made = self.made.max(self.ground.len() as u32);
        self
    }

    /// The least difference of a histogram from a ground model, and that model; 1 and none without models.
    pub fn best_match(&self, histogram: &Histogram) -> (f32, Option<usize>) {
        self.ground.iter().enumerate().fold((1.0, None), |best, (index, model)| {
            let difference = model.histogram.difference(histogram);
            if best.1.is_none() || difference < best.0 { (difference, Some(index)) } else { best }
        })
    }

    /// Whether learning mode is on, and for how long still, ns.
    pub fn learning_left_ns(&self) -> Option<u64> {
        self.watch.as_ref().map(|watch| watch.left_ns)
    }

    /// Takes a ground histogram that is scaled to the budget, `elapsed_ns` after the last one that was taken.
    pub fn learn_ground(
        &mut self,
        histogram: &Histogram,
        time: Stamp,
        elapsed_ns: u64,
        settings: &Settings,
    ) -> Learned {
        let (difference, best) = self.best_match(histogram);
        let Some(best) = best else {
            self.add(histogram.clone(), time);
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
            self.watch = Some(Watch { candidate: histogram.clone(), difference, left_ns });
        }
        match self.watch.take_if(|watch| watch.left_ns == 0) {
            Some(watch) => {
                self.add(watch.candidate, time);
                Learned::Added
            }
            None if matches => Learned::Updated(best),
            None => Learned::Watches { left_ns: self.learning_left_ns().unwrap_or(0) },
        }
    }

    /// Takes a background histogram that is scaled to the budget.
    pub fn learn_background(&mut self, histogram: &Histogram, time: Stamp, settings: &Settings) {
        if let Some(model) = &mut self.background {
            model.update(histogram, time, settings.memory);
        } else {
            let (name, histogram) = ("background".to_owned(), histogram.clone());
            self.background = Some(Model { name, histogram, uses: 1, updated: time });
        }
    }

    fn add(&mut self, histogram: Histogram, time: Stamp) {
        self.made += 1;
        let name = format!("learned {}", self.made);
        self.ground.push(Model { name, histogram, uses: 1, updated: time });
        self.watch = None;
    }

    /// `P_ground = N_g / (N_g + N_b)` of each bin, the largest over the ground models; NaN for 0/0, which is no answer.
    /// `N_b` is the background's count with those of known obstacles.
    pub fn probabilities(&self) -> Vec<f32> {
        let mut background = vec![0.0_f32; CELLS];
        for model in self.background.iter().chain(&self.obstacles) {
            std::iter::zip(&mut background, model.histogram.counts()).for_each(|(sum, count)| *sum += count);
        }
        // With one N_b for all, the largest N_g gives the largest quotient.
        let mut ground = vec![0.0_f32; CELLS];
        for model in &self.ground {
            std::iter::zip(&mut ground, model.histogram.counts())
                .for_each(|(most, &count)| *most = most.max(count));
        }
        std::iter::zip(ground, background).map(|(g, b)| g / (g + b)).collect()
    }
}
