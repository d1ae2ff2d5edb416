//! What a matcher is asked to do.

use crate::STEPS_PER_PIXEL;

/// How disparities are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Block matching: fast; leaves out what it cannot tell.
    Block,
    /// Semi-global matching: denser; about four times the time.
    SemiGlobal,
}

/// Settings of a [`crate::Matcher`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// How disparities are found.
    pub method: Method,
    /// Disparities that are tried, 0 to one less than this, pixels: a multiple of 16, from 16 to 256.
    pub disparities: usize,
    /// Side of the square that block matching compares, pixels: odd, from 5 to 15. Semi-global matching has its own.
    pub block: usize,
    /// How many percent more any match that is not beside the best one must cost, 0 to 100.
    pub uniqueness_pct: u16,
    /// Most by which the disparities found from the left and from the right image may differ, pixels.
    pub left_right_max: u16,
    /// Connected patches of fewer pixels are left out.
    pub speckle_min_area: usize,
    /// Neighbours are connected up to this difference, 1/16 pixel, at most 1024.
    pub speckle_step: u16,
}

impl Settings {
    /// The settings that the figures in [`crate`] were measured with.
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

    /// Whether a matcher for images of this size can work so.
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

    /// Whether there are images that a matcher can work so on.
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

/// The longest side of an image that is believed, pixels.
const MAX_SIDE: usize = 1 << 15;

/// Why there is no disparity image.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StereoError {
    /// Width or height is 0 or absurd.
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
        /// Pixels there are.
        got: usize,
        /// Pixels there should be.
        expected: usize,
        /// Pixels.
        width: usize,
        /// Pixels.
        height: usize,
    },
    /// No such number of disparities.
    #[error("number of disparities is {got}, expected a multiple of 16 from 16 to 256")]
    Disparities {
        /// The number.
        got: usize,
    },
    /// No pixel of the left image has all of its disparities in the right one.
    #[error("{disparities} disparities do not fit into an image of {width} columns")]
    Range {
        /// Disparities to try.
        disparities: usize,
        /// Columns.
        width: usize,
    },
    /// No such square.
    #[error("side of the block is {got}, expected an odd number from 5 to 15")]
    Block {
        /// The side, pixels.
        got: usize,
    },
    /// Out of range.
    #[error("uniqueness is {got} %, expected at most 100")]
    Uniqueness {
        /// Percent.
        got: u16,
    },
    /// Out of range.
    #[error("step of the speckle filter is {got}, expected at most 1024 sixteenths of a pixel")]
    SpeckleStep {
        /// 1/16 pixel.
        got: u16,
    },
    /// The ground truth has another size than the disparity image.
    #[error("ground truth has {got} pixels, expected {expected}")]
    TruthSize {
        /// Pixels there are.
        got: usize,
        /// Pixels there should be.
        expected: usize,
    },
}
