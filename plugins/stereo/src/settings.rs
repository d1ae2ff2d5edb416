//! Settings of a matcher.

use crate::STEPS_PER_PIXEL;

/// How disparities are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Block matching: fast; ambiguous pixels are left out.
    Block,
    /// Semi-global matching: denser, about four times the time.
    SemiGlobal,
}

/// Settings of a [`crate::Matcher`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// How disparities are found.
    pub method: Method,
    /// Number of disparities, from 0 to one less than this, pixels: a multiple of 16, from 16 to 256.
    pub disparities: usize,
    /// Side of the square that block matching compares, pixels: odd, from 5 to 15. Semi-global matching has a fixed
    /// one.
    pub block: usize,
    /// Minimum excess cost of every match that is not adjacent to the best one, percent, 0 to 100.
    pub uniqueness_pct: u16,
    /// Maximum difference between the disparities found from the left and from the right image, pixels.
    pub left_right_max: u16,
    /// Connected patches of fewer pixels are removed.
    pub speckle_min_area: usize,
    /// Neighbours are connected up to this difference, 1/16 pixel, at most 1024.
    pub speckle_step: u16,
}

impl Settings {
    /// The settings with which the figures in [`crate`] were measured.
    pub fn new(method: Method, disparities: usize) -> Settings {
        Settings {
            method,
            disparities,
            block: 9,
            uniqueness_pct: 10,
            left_right_max: 1,
            speckle_min_area: 100,
            speckle_step: STEPS_PER_PIXEL,
        }
    }

    /// Checks the settings for images of this size.
    pub(crate) fn check(&self, [width, height]: [usize; 2]) -> Result<(), StereoError> {
        if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
            return Err(StereoError::Size { width, height });
        }
        self.check_values()?;
        if self.disparities > width {
            return Err(StereoError::Range { disparities: self.disparities, width });
        }
        Ok(())
    }

    /// Checks the settings without regard to an image size.
    pub(crate) fn check_values(&self) -> Result<(), StereoError> {
        let &Settings { disparities, block, uniqueness_pct, speckle_step, .. } = self;
        if !(16..=256).contains(&disparities) || !disparities.is_multiple_of(16) {
            return Err(StereoError::Disparities { got: disparities });
        }
        if !(5..=15).contains(&block) || block.is_multiple_of(2) {
            return Err(StereoError::Block { got: block });
        }
        if uniqueness_pct > 100 {
            return Err(StereoError::Uniqueness { got: uniqueness_pct });
        }
        if speckle_step > 1024 {
            return Err(StereoError::SpeckleStep { got: speckle_step });
        }
        Ok(())
    }
}

/// Maximum side of an image, pixels.
const MAX_SIDE: usize = 1 << 15;

/// Why there is no disparity image.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StereoError {
    /// Width or height is 0 or exceeds the maximum.
    #[error("image size {width}x{height} is not usable")]
    Size {
        /// Pixels.
        width: usize,
        /// Pixels.
        height: usize,
    },
    /// An image does not have the matcher's size.
    #[error("{camera} image has {got} pixels, expected {expected} ({width}x{height})")]
    ImageSize {
        /// Left or right.
        camera: &'static str,
        /// Number of pixels given.
        got: usize,
        /// Number of pixels expected.
        expected: usize,
        /// Pixels.
        width: usize,
        /// Pixels.
        height: usize,
    },
    /// Invalid number of disparities.
    #[error("number of disparities is {got}, expected a multiple of 16 from 16 to 256")]
    Disparities {
        /// The given number.
        got: usize,
    },
    /// The image is too narrow: no pixel has all of its disparities within the right image.
    #[error("{disparities} disparities do not fit into an image of {width} columns")]
    Range {
        /// Number of disparities.
        disparities: usize,
        /// Columns.
        width: usize,
    },
    /// Invalid side of the square.
    #[error("side of the block is {got}, expected an odd number from 5 to 15")]
    Block {
        /// The given side, pixels.
        got: usize,
    },
    /// The uniqueness is out of range.
    #[error("uniqueness is {got} %, expected at most 100")]
    Uniqueness {
        /// Percent.
        got: u16,
    },
    /// The speckle step is out of range.
    #[error("step of the speckle filter is {got}, expected at most 1024 sixteenths of a pixel")]
    SpeckleStep {
        /// 1/16 pixel.
        got: u16,
    },
    /// The ground truth has another size than the disparity image.
    #[error("ground truth has {got} pixels, expected {expected}")]
    TruthSize {
        /// Number of pixels given.
        got: usize,
        /// Number of pixels expected.
        expected: usize,
    },
}
