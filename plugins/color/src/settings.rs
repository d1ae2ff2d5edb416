//! Conversion of the process parameters.

use crate::engine::Engine;
use crate::file::parse;
use crate::models::{Models, Settings};
use crate::proto::ColorModelsParams;
use crate::region::Rectangle;
use rcs_sense::{Extrinsics, fingerprint_of_texts};

pub(crate) fn initial_models(params: &ColorModelsParams) -> Result<Models, String> {
    let mut models = Models::default();
    for (name, text) in
        [("models", &params.models), ("models_2", &params.models_2), ("models_3", &params.models_3)]
    {
        let read = parse(text).map_err(|error| format!("{name}: {error}"))?;
        models = models.with(&read, params.samples);
    }
    Ok(models)
}

/// The runtime has refused invalid files before; where it did not check (in tests), invalid files count as empty.
pub(crate) fn initial_engine(params: &ColorModelsParams) -> Engine {
    Engine::new(initial_models(params).unwrap_or_default())
}

pub(crate) fn files(params: &ColorModelsParams) -> u64 {
    fingerprint_of_texts(&[&params.models, &params.models_2, &params.models_3])
}

pub(crate) fn rectangle(params: &ColorModelsParams) -> Rectangle {
    Rectangle {
        ahead_m: params.sample_ahead_m,
        length_m: params.sample_length_m,
        width_m: params.sample_width_m,
        below_m: params.wheels_below_m,
    }
}

pub(crate) fn settings(params: &ColorModelsParams) -> Settings {
    Settings {
        samples: params.samples,
        max_models: params.max_models as usize,
        match_difference: params.match_difference as f32,
        learning_period_ns: (params.learning_period_s * 1e9) as u64,
        memory: params.model_memory,
        fusion_frames: params.fusion_frames,
        min_sample_px: params.min_sample_px,
        known_least_cover: params.known_least_cover,
    }
}

pub(crate) fn extrinsics(params: &ColorModelsParams) -> Extrinsics<'_> {
    Extrinsics::new(params.pose.as_ref(), params.mount.as_ref())
}
