//! Errors in calibrations and images.

/// Why calibration numbers do not describe a camera, or why an image does not belong to it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// Focal length 0: the convention for "not calibrated".
    #[error("camera is not calibrated: focal lengths are {fx} and {fy}")]
    Uncalibrated {
        /// Pixels.
        fx: f64,
        /// Pixels.
        fy: f64,
    },
    /// A number is NaN or infinite.
    #[error("{what} is not finite: got {value}")]
    NotFinite {
        /// The part of the calibration that holds it.
        what: &'static str,
        /// The value.
        value: f64,
    },
    /// A matrix has the wrong number of entries.
    #[error("{what} has {got} entries, expected {expected}")]
    MatrixSize {
        /// Which matrix.
        what: &'static str,
        /// Number of entries found.
        got: usize,
        /// Number of entries expected.
        expected: usize,
    },
    /// The distortion model does not accept that many parameters.
    #[error("distortion model \"{model}\" has {got} parameters, expected {expected}")]
    ParameterCount {
        /// Name of the model.
        model: String,
        /// Number of parameters found.
        got: usize,
        /// Number of parameters that the model takes.
        expected: usize,
    },
    /// The distortion model is not supported.
    #[error(
        "distortion model \"{model}\" is unknown, expected plumb_bob, rational_polynomial, equidistant, fisheye or kannala_brandt"
    )]
    UnknownModel {
        /// Name of the model.
        model: String,
    },
    /// Width or height is 0 or too large.
    #[error("image size {width}x{height} is not usable")]
    Size {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
    /// The length of a buffer does not match its image.
    #[error("image has {got} bytes, expected {expected} ({width}x{height}, {channels} channels)")]
    ImageSize {
        /// Number of bytes found.
        got: usize,
        /// Number of bytes expected.
        expected: usize,
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
        /// Bytes per pixel.
        channels: usize,
    },
}
