//! Models as messages, and as the text of a file, which is such a message in JSON.

use crate::appearance::{BINS, HISTOGRAMS, Histograms, MatchWeights};
use crate::models::{Heights, Model, ModelSet, Terrain};
use crate::proto::{TerrainCamera, TerrainModel, TerrainModels, TerrainWeights};
use rcs_sense::{Sample, SampleError};

/// Why models of a message or a file are refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelsError {
    /// A histogram has a wrong number of bins.
    #[error("model {model} has {got} bins of {what}, expected {BINS}")]
    Bins {
        /// Number of the model, from 0.
        model: usize,
        /// Which histogram.
        what: &'static str,
        /// Number of bins given.
        got: usize,
    },
    /// The histograms of one model have different numbers of points.
    #[error("model {model} has {got} points in its histogram of {what}, expected {expected}")]
    Points {
        /// Number of the model, from 0.
        model: usize,
        /// Which histogram.
        what: &'static str,
        /// Number of points given.
        got: u128,
        /// Number of points of the first histogram, not 0.
        expected: u128,
    },
    /// A count exceeds the maximum.
    #[error("model {model} has {what} {got}, expected at most {MOST}")]
    TooMany {
        /// Number of the model, from 0.
        model: usize,
        /// Which number.
        what: &'static str,
        /// The number.
        got: u64,
    },
    /// Weights or span are not numbers in range.
    #[error("{what} is {got}, expected {expected}")]
    Number {
        /// Which number.
        what: &'static str,
        /// The number.
        got: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// The picture of a model is invalid.
    #[error("model {model}: {error}")]
    Sample {
        /// Number of the model, from 0.
        model: usize,
        /// What is wrong.
        error: SampleError,
    },
    /// The text of a file is invalid.
    #[error("models do not read: {0}")]
    Text(String),
}

/// Maximum count, so that sums of many fit in 64 bits.
const MOST: u64 = 1 << 48;

impl ModelSet {
    /// The set as a message without a time.
    pub fn to_message(
        &self,
        camera: TerrainCamera,
        span_octaves: f64,
        weights: &MatchWeights,
    ) -> TerrainModels {
        let [red_green, red_blue, green_blue, intensity, texture] = weights.histograms.map(f64::from);
        let contrast = f64::from(weights.contrast);
        TerrainModels {
            timestamp: None,
            camera: camera.into(),
            ratio_span_octaves: span_octaves,
            weights: Some(TerrainWeights { red_green, red_blue, green_blue, intensity, texture, contrast }),
            models: self.models.iter().map(model_message).collect(),
        }
    }

    /// The models of a message, whose sums must agree. A message without models is valid.
    pub fn from_message(message: &TerrainModels) -> Result<ModelSet, ModelsError> {
        let models = message.models.iter().enumerate().map(|(number, model)| model_of(number, model));
        Ok(ModelSet { models: models.collect::<Result<_, _>>()?, named: 0 })
    }
}

/// How the windows of an image are compared with the models of a message: the span of the bins (octaves), and the
/// weights.
pub fn matching_of(message: &TerrainModels) -> Result<(f64, MatchWeights), ModelsError> {
    let span = message.ratio_span_octaves;
    if !(span.is_finite() && span > 0.0) {
        let what = "span of the ratios' bins";
        return Err(ModelsError::Number { what, got: span, expected: "a number above 0" });
    }
    let w = message.weights.unwrap_or_default();
    let numbers = [w.red_green, w.red_blue, w.green_blue, w.intensity, w.texture, w.contrast];
    if let Some(&got) = numbers.iter().find(|w| !(0.0..=1e6).contains(*w)) {
        return Err(ModelsError::Number { what: "weight", got, expected: "0 to 1e6" });
    }
    let [histograms @ .., contrast] = numbers.map(|w| w as f32);
    Ok((span, MatchWeights { histograms, contrast }.normalised()))
}

/// The models of a file's text; `None` where it is empty.
pub fn models_of_text(text: &str) -> Result<Option<TerrainModels>, ModelsError> {
    if text.trim().is_empty() {
        return Ok(None);
    }
    let message: TerrainModels =
        rcs_msg::from_json(text).map_err(|error| ModelsError::Text(error.to_string()))?;
    matching_of(&message)?;
    ModelSet::from_message(&message)?;
    Ok(Some(message))
}

fn model_message(model: &Model) -> TerrainModel {
    let terrain = &model.terrain;
    let [red_green, red_blue, green_blue, intensity, texture] = terrain.histograms.bins.map(Vec::from);
    TerrainModel {
        red_green,
        red_blue,
        green_blue,
        intensity,
        texture,
        contrast_sum: terrain.histograms.contrast_sum,
        ground: terrain.ground,
        obstacle: terrain.obstacle,
        driven: terrain.driven,
        bumped: terrain.bumped,
        driven_labelled: terrain.driven_labelled,
        driven_obstacle: terrain.driven_obstacle,
        driven_height_m: f64::from(terrain.driven_height_mm) / 1000.0,
        cells: model.cells,
        contrast: terrain.histograms.contrast(),
        obstacle_fraction: model.obstacle_fraction().unwrap_or(0.0),
        sample: model.sample.as_ref().map(Sample::message),
        name: model.name.clone(),
    }
}

fn model_of(number: usize, model: &TerrainModel) -> Result<Model, ModelsError> {
    let named: [(&str, &[u64]); HISTOGRAMS] = [
        ("red_green", &model.red_green),
        ("red_blue", &model.red_blue),
        ("green_blue", &model.green_blue),
        ("intensity", &model.intensity),
        ("texture", &model.texture),
    ];
    let mut histograms = Histograms { contrast_sum: model.contrast_sum, ..Histograms::default() };
    let mut expected = 0;
    for ((what, bins), histogram) in named.into_iter().zip(&mut histograms.bins) {
        let got = bins.len();
        *histogram = bins.try_into().map_err(|_| ModelsError::Bins { model: number, what, got })?;
        let got = bins.iter().map(|&count| u128::from(count)).sum();
        expected = if expected == 0 { got } else { expected };
        if got != expected || got == 0 {
            return Err(ModelsError::Points { model: number, what, got, expected: expected.max(1) });
        }
    }
    let terrain = Terrain {
        histograms,
        ground: model.ground,
        obstacle: model.obstacle,
        driven: model.driven,
        bumped: model.bumped,
        driven_labelled: model.driven_labelled,
        driven_obstacle: model.driven_obstacle,
        driven_height_mm: (model.driven_height_m * 1000.0).round().clamp(0.0, 1e6) as u32,
        heights: Heights::default(),
    };
    let counts = [
        ("points", u64::try_from(expected).unwrap_or(u64::MAX)),
        ("ground", model.ground),
        ("obstacle", model.obstacle),
        ("driven", model.driven),
        ("bumped", model.bumped),
        ("cells", model.cells),
    ];
    if let Some((what, got)) = counts.into_iter().find(|(_, count)| *count > MOST) {
        return Err(ModelsError::TooMany { model: number, what, got });
    }
    let sample = model.sample.as_ref().map(Sample::of).transpose();
    let sample = sample.map_err(|error| ModelsError::Sample { model: number, error })?;
    Ok(Model { terrain, cells: model.cells, sample, name: model.name.clone() })
}

#[cfg(test)]
#[path = "model_file_tests.rs"]
mod tests;
