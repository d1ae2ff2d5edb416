//! Checks of matching images, shared by both processes.

use rcs_geom::CameraError;
use rcs_msg::Stamp;
use rcs_msg::foxglove::RawImage;
use rcs_msg::image::{ImageError, depth_m, raw_to_rgb8};
use rcs_sense::{ImageFault, LocalizerError, OnItsSide, Rolled, check_size};

/// Why an image, or data that belong to it, was skipped.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Unusable {
    /// No calibration has arrived.
    #[error("image without a calibration")]
    NoCalibration,
    /// The calibration is invalid.
    #[error("calibration: {0}")]
    Calibration(#[from] CameraError),
    /// Depth or labels cannot be decoded.
    #[error("{what}: {error}")]
    Image {
        /// Which image.
        what: &'static str,
        /// The reason.
        error: ImageError,
    },
    /// Labels are not one byte per pixel.
    #[error("labels have encoding {got:?}, expected mono8")]
    LabelEncoding {
        /// The encoding given.
        got: String,
    },
    /// The image has a wrong size, is black, saturated or frozen.
    #[error(transparent)]
    Fault(#[from] ImageFault),
    /// The pose of the vehicle or the camera is unknown.
    #[error(transparent)]
    Pose(#[from] LocalizerError),
    /// The vehicle lies on its side.
    #[error(transparent)]
    OnItsSide(#[from] OnItsSide),
    /// The camera is mounted on its side or upside down.
    #[error(transparent)]
    Rolled(#[from] Rolled),
    /// No kept image is close enough in time.
    #[error("no {what} of the time of the {of}: nearest is {} s away{}", shown(*.apart_s), advice(*.missed))]
    Apart {
        /// What is missing.
        what: &'static str,
        /// For what it is needed.
        of: &'static str,
        /// Time difference to the nearest one, s; `None` without any.
        apart_s: Option<f64>,
        /// Number of images that the buffer dropped before they were read.
        missed: u64,
    },
    /// A message is not newer than the previous one.
    #[error("{what} of {} s is not newer than the one before, of {} s", .got.seconds_since(Stamp(0)), .newest.seconds_since(Stamp(0)))]
    Late {
        /// Which image.
        what: &'static str,
        /// Its time.
        got: Stamp,
        /// Time of the newest one before.
        newest: Stamp,
    },
}

fn shown(apart_s: Option<f64>) -> String {
    apart_s.map_or_else(|| "infinite".to_owned(), |apart| format!("{apart:.3}"))
}

fn advice(missed: u64) -> String {
    if missed == 0 {
        return String::new();
    }
    format!("; {missed} dropped unread: its buffer needs a longer `queue`")
}

/// Depths of an image that belongs to one of `size`, m, NaN where unknown.
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
