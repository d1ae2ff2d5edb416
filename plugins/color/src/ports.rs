//! Ports of the process `color_models`.

use crate::proto::{ColorModels, ColorStats};
use rcs_msg::foxglove::{CameraCalibration, Grid, ImageAnnotations, RawImage};
use rcs_runtime::{In, Out};
use rcs_sense::PosePorts;

/// Ports of [`crate::ColorModelLearner`].
#[derive(Debug)]
pub struct Ports {
    pub(crate) image: In<RawImage>,
    pub(crate) calibration: In<CameraCalibration>,
    pub(crate) poses: PosePorts,
    pub(crate) map: In<Grid>,
    pub(crate) probability: Out<RawImage>,
    pub(crate) sample: Out<ImageAnnotations>,
    pub(crate) cost: Out<Grid>,
    pub(crate) models: Out<ColorModels>,
    pub(crate) stats: Out<ColorStats>,
}
