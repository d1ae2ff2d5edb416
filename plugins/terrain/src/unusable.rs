//! What both processes check of the images that belong together.

use rcs_geom::CameraError;
use rcs_msg::Stamp;
use rcs_msg::foxglove::RawImage;
use rcs_msg::image::{ImageError, depth_m, raw_to_rgb8};
use rcs_sense::{ImageFault, LocalizerError, check_size};

/// Why an image, or what belongs to it, was skipped.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Unusable {
    /// No calibration has come.
    #[error("image without a calibration")]
    NoCalibration,
    /// The calibration is none.
    #[error("calibration: {0}")]
    Calibration(#[from] CameraError),
    /// Depth or labels do not read.
    #[error("{what}: {error}")]
    Image {
        /// Which of the images.
        what: &'static str,
        /// Why.
        error: ImageError,
    },
    /// Labels are one byte a pixel.
    #[error("labels have encoding {got:?}, expected mono8")]
    LabelEncoding {
        /// What they say.
        got: String,
    },
    /// Of another size, black, saturated, frozen.
    #[error(transparent)]
    Fault(#[from] ImageFault),
    /// The pose of vehicle or camera is not known.
    #[error(transparent)]
    Pose(#[from] LocalizerError),
    /// What came is for another time than all images that are kept.
    #[error("no {what} of the time of the {of}: nearest is {} s away", shown(*.apart_s))]
    Apart {
        /// What is missing.
        what: &'static str,
        /// What it was wanted for.
        of: &'static str,
        /// Distance to the nearest; `None` where there is none at all.
        apart_s: Option<f64>,
    },
    /// A message is not newer than the one before.
    #[error("{what} of {} s is not newer than the one before, of {} s", .got.seconds_since(Stamp(0)), .newest.seconds_since(Stamp(0)))]
    Late {
        /// Which of the images.
        what: &'static str,
        /// Its time.
        got: Stamp,
        /// The newest before.
        newest: Stamp,
    },
}

fn shown(apart_s: Option<f64>) -> String {
    apart_s.map_or_else(|| "infinite".to_owned(), |apart| format!("{apart:.3}"))
}

/// Depths of an image that belongs to one of `size`, m, NaN where there is none.
pub(crate) fn depths(image: &RawImage, size: [u32; 2], scale_m: f64) -> Result<Vec<f32>, Unusable> {
    check_size("depth", image, "its image", size)?;
    depth_m(image, scale_m as f32).map_err(|error| Unusable::Image { what: "depth", error })
}

/// Labels of an image that belongs to one of `size`.
pub(crate) fn labels(image: &RawImage, size: [u32; 2]) -> Result<Vec<u8>, Unusable> {
    check_size("label image", image, "its image", size)?;
    if !matches!(image.encoding.as_str(), "mono8" | "8UC1") {
        return Err(Unusable::LabelEncoding { got: image.encoding.clone() });
    }
    let rgb = raw_to_rgb8(image).map_err(|error| Unusable::Image { what: "label image", error })?.data;
    Ok(rgb.as_chunks::<3>().0.iter().map(|pixel| pixel[0]).collect())
}
