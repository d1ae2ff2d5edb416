//! Conversion between models, their message, and its JSON file.

use crate::histogram::{BINS, CELLS, Histogram};
use crate::models::{Model, Models};
use crate::proto::{ColorModel, ColorModelKind, ColorModels};
use rcs_msg::Stamp;
use rcs_sense::{Sample, SampleError};

/// Why a file is not a valid file of colour models.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The text is not JSON of `rcs.ColorModels`.
    #[error(transparent)]
    Json(#[from] rcs_msg::JsonError),
    /// A histogram has other bins, or another number of counts.
    #[error(
        "model {name:?} has {got} counts of {red_bins}x{green_bins} bins, expected {CELLS} of {BINS}x{BINS}"
    )]
    Bins {
        /// Name of the model.
        name: String,
        /// Number of counts in the file.
        got: usize,
        /// Number of red bins in the file.
        red_bins: u32,
        /// Number of green bins in the file.
        green_bins: u32,
    },
    /// The counts of a histogram are none.
    #[error("model {name:?}: {what}")]
    Counts {
        /// Name of the model.
        name: String,
        /// What was found and expected.
        what: String,
    },
    /// The kind of a model is unknown.
    #[error("model {name:?} is of kind {kind}, expected 0 to 2")]
    Kind {
        /// Name of the model.
        name: String,
        /// Kind in the file.
        kind: i32,
    },
    /// The picture of a model is invalid.
    #[error("model {name:?}: {error}")]
    Sample {
        /// Name of the model.
        name: String,
        /// What is wrong.
        error: SampleError,
    },
    /// There is more than one background model.
    #[error("more than one background model: {name:?}")]
    Backgrounds {
        /// Name of the second one.
        name: String,
    },
}

/// Parses the models of a JSON text; an empty text gives no models. Counts are not scaled: the caller does that.
pub fn parse(text: &str) -> Result<Models, FileError> {
    if text.trim().is_empty() {
        return Ok(Models::default());
    }
    from_message(&rcs_msg::from_json::<ColorModels>(text)?)
}

/// Converts a message to models.
pub fn from_message(message: &ColorModels) -> Result<Models, FileError> {
    let mut models = Models::default();
    for model in &message.models {
        let ColorModel { name, kind, uses, .. } = model;
        let histogram = histogram_of(model)?;
        let updated = model.updated.as_ref().and_then(Stamp::from_proto).unwrap_or_default();
        let sample = model.sample.as_ref().map(Sample::of).transpose();
        let sample = sample.map_err(|error| FileError::Sample { name: name.clone(), error })?;
        let read = Model { name: name.clone(), histogram, uses: (*uses).max(1), updated, sample };
        match ColorModelKind::try_from(*kind) {
            Ok(ColorModelKind::ColorModelGround) => models.ground.push(read),
            Ok(ColorModelKind::ColorModelObstacle) => models.obstacles.push(read),
            Ok(ColorModelKind::ColorModelBackground) if models.background.is_none() => {
                models.background = Some(read);
            }
            Ok(ColorModelKind::ColorModelBackground) => {
                return Err(FileError::Backgrounds { name: name.clone() });
            }
            Err(_) => return Err(FileError::Kind { name: name.clone(), kind: *kind }),
        }
    }
    Ok(models)
}

/// The histogram of a model.
fn histogram_of(model: &ColorModel) -> Result<Histogram, FileError> {
    let ColorModel { name, red_bins, green_bins, counts, .. } = model;
    let (name, got, red_bins, green_bins) = (name.clone(), counts.len(), *red_bins, *green_bins);
    if got != CELLS || [red_bins, green_bins] != [BINS as u32; 2] {
        return Err(FileError::Bins { name, got, red_bins, green_bins });
    }
    Histogram::from_counts(counts).ok_or_else(|| FileError::Counts { name, what: wrong_of(counts) })
}

/// What is wrong with the counts of a histogram.
fn wrong_of(counts: &[f32]) -> String {
    let is_wrong = |count: f32| !(count.is_finite() && count >= 0.0);
    if let Some((index, count)) = counts.iter().enumerate().find(|(_, count)| is_wrong(**count)) {
        return format!("count {index} is {count}, expected a finite number from 0 up");
    }
    let sum: f64 = counts.iter().map(|&count| f64::from(count)).sum();
    if sum > 0.0 {
        return format!("the counts add up to {sum:.1e}, expected at most {:.1e}", f32::MAX);
    }
    "all counts are 0, expected some above 0".to_owned()
}

/// Converts models to a message: ground, then background, then obstacles.
pub fn to_message(models: &Models, time: Stamp) -> ColorModels {
    let message = |model: &Model, kind: ColorModelKind| ColorModel {
        name: model.name.clone(),
        kind: kind.into(),
        red_bins: BINS as u32,
        green_bins: BINS as u32,
        counts: model.histogram.counts().to_vec(),
        uses: model.uses,
        updated: (model.updated != Stamp(0)).then(|| model.updated.to_proto()),
        sample: model.sample.as_ref().map(Sample::message),
    };
    let ground = models.ground.iter().map(|model| message(model, ColorModelKind::ColorModelGround));
    let background =
        models.background.iter().map(|model| message(model, ColorModelKind::ColorModelBackground));
    let obstacles = models.obstacles.iter().map(|model| message(model, ColorModelKind::ColorModelObstacle));
    ColorModels {
        timestamp: Some(time.to_proto()),
        models: ground.chain(background).chain(obstacles).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::AnyMessage;
    use rcs_sense::Rgb;

    fn models() -> Models {
        let data = [7; 27];
        let picture = Rgb { data: &data, step: 9, size: [3, 3], frame_id: "camera", time: Stamp(3) };
        let model = |name: &str, red: u8| {
            let mut histogram = Histogram::default();
            histogram.add(red, 40);
            histogram.add(red, 90);
            Model {
                name: name.to_owned(),
                histogram: histogram.scaled(4000.0),
                uses: 3,
                updated: Stamp(5_000_000_007),
                sample: Sample::around(&picture, [1, 1], 2),
            }
        };
        Models {
            ground: vec![model("mulch", 100), model("learned 1", 50)],
            background: Some(model("background", 200)),
            obstacles: vec![model("fence", 250)],
            ..Models::default()
        }
    }

    #[test]
    fn what_is_saved_is_what_is_loaded() {
        let message = to_message(&models(), Stamp(9));
        let text = rcs_msg::to_json(&AnyMessage::new(message)).unwrap();
        assert_eq!(parse(&text).unwrap(), models());
        assert_eq!(parse(" \n").unwrap(), Models::default());
    }

    #[test]
    fn files_that_are_no_models_are_refused_with_what_is_wrong() {
        let check = |change: fn(&mut ColorModels), expected: &str| {
            let mut message = to_message(&models(), Stamp(9));
            change(&mut message);
            let error = from_message(&message).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        };
        let expected = "expected a finite number from 0 up";
        check(|m| m.models[0].counts[3] = -1.0, &format!("model \"mulch\": count 3 is -1, {expected}"));
        check(
            |m| m.models[1].counts[3] = f32::NAN,
            &format!("model \"learned 1\": count 3 is NaN, {expected}"),
        );
        check(|m| m.models[0].counts.fill(1e38), "the counts add up to 9.0e40, expected at most 3.4e38");
        check(|m| m.models[0].counts.fill(0.0), "all counts are 0, expected some above 0");
        check(|m| m.models[1].counts.truncate(899), "has 899 counts of 30x30 bins, expected 900 of 30x30");
        check(|m| m.models[0].red_bins = 16, "of 16x30 bins");
        check(|m| m.models[0].kind = 7, "is of kind 7, expected 0 to 2");
        check(|m| m.models[0].sample.as_mut().unwrap().width = 3, "model \"mulch\": sample is");
        check(|m| m.models[0].kind = 1, "more than one background model: \"background\"");
        assert!(matches!(parse("{\"models\": 3}"), Err(FileError::Json(_))));
    }

    #[test]
    fn the_files_that_come_with_the_program_are_models() {
        let of = |text: &str| {
            let models = parse(text).unwrap();
            let one = models.ground.iter().chain(&models.obstacles).next().unwrap();
            (one.name.clone(), models.ground.len(), models.obstacles.len(), one.histogram.clone())
        };
        let mulch = of(include_str!("../../../assets/models/mulch.json"));
        let lime = of(include_str!("../../../assets/models/white_lime.json"));
        let fence = of(include_str!("../../../assets/models/orange_fence.json"));
        assert_eq!((mulch.0.as_str(), mulch.1, mulch.2), ("mulch", 1, 0));
        assert_eq!((lime.0.as_str(), lime.1, lime.2), ("white lime", 1, 0));
        assert_eq!((fence.0.as_str(), fence.1, fence.2), ("orange fence", 0, 1));
        for (a, b) in [(&mulch.3, &lime.3), (&mulch.3, &fence.3), (&lime.3, &fence.3)] {
            assert!(a.difference(&b.clone().scaled(a.sum())) > 0.99, "their colours have nothing in common");
        }
    }
}
