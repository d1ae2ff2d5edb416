//! A matcher for pairs of one size, with its working memory.

use crate::checks::{Accept, SpeckleFilter};
use crate::prefilter::{Filtered, LogFilter};
use crate::{Method, Settings, StereoError, Width, block, sgm};

/// Matches rectified pairs of one size. It holds working memory and no state: a result depends on its pair alone. The
/// documentation of [the crate](crate) has an example.
#[derive(Clone, Debug)]
pub struct Matcher {
    width: usize,
    height: usize,
    settings: Settings,
    vectors: Width,
    left: Filtered,
    right: Filtered,
    strips: Vec<block::Scratch>,
    semi_global: sgm::Scratch,
    speckles: SpeckleFilter,
}

/// A part of the work on one pair. Parts are independent: run them in any order, on any threads.
#[derive(Debug)]
pub struct Strip<'a> {
    matcher: Shared<'a>,
    scratch: StripScratch<'a>,
    first_row: usize,
    out: &'a mut [u16],
}

#[derive(Clone, Copy, Debug)]
struct Shared<'a> {
    left: &'a Filtered,
    right: &'a Filtered,
    width: usize,
    settings: &'a Settings,
    vectors: Width,
}

#[derive(Debug)]
enum StripScratch<'a> {
    Block(&'a mut block::Scratch),
    SemiGlobal(&'a mut sgm::Scratch),
}

impl Matcher {
    /// A matcher for images of width × height pixels.
    pub fn new(size: [usize; 2], settings: Settings) -> Result<Matcher, StereoError> {
        settings.check(size)?;
        let [width, height] = size;
        Ok(Matcher {
            width,
            height,
            settings,
            vectors: Width::widest(),
            left: Filtered::default(),
            right: Filtered::default(),
            strips: Vec::new(),
            semi_global: sgm::Scratch::default(),
            speckles: SpeckleFilter::default(),
        })
    }

    /// Selects the vector width, for tests and measurements; all widths give the same result bit for bit.
    #[must_use]
    pub fn with_vectors(mut self, vectors: Width) -> Matcher {
        self.vectors = vectors;
        self
    }

    /// Disparities of the left image's pixels in 1/16 pixel, or [`crate::NO_DISPARITY`]: `disparity` is resized to the
    /// number of pixels. Images are grey, in row order without gaps.
    pub fn compute(
        &mut self,
        left: &[u8],
        right: &[u8],
        disparity: &mut Vec<u16>,
    ) -> Result<(), StereoError> {
        self.compute_in_strips(left, right, disparity, 1, |strips| strips.into_iter().for_each(Strip::run))
    }

    /// [`Matcher::compute`] in up to `count` parts, all of which `run_all` must run. The result is the same bit for bit
    /// for any number of parts. Semi-global matching is one part, because its rows depend on each other.
    pub fn compute_in_strips(
        &mut self,
        left: &[u8],
        right: &[u8],
        disparity: &mut Vec<u16>,
        count: usize,
        run_all: impl FnOnce(Vec<Strip<'_>>),
    ) -> Result<(), StereoError> {
        self.filter(left, right)?;
        disparity.clear();
        disparity.resize(self.width * self.height, crate::NO_DISPARITY);
        let matcher = Shared {
            left: &self.left,
            right: &self.right,
            width: self.width,
            settings: &self.settings,
            vectors: self.vectors,
        };
        run_all(match self.settings.method {
            Method::SemiGlobal => {
                let scratch = StripScratch::SemiGlobal(&mut self.semi_global);
                vec![Strip { matcher, scratch, first_row: 0, out: disparity }]
            }
            Method::Block => {
                let rows = self.height.div_ceil(count.clamp(1, self.height));
                self.strips.resize_with(self.height.div_ceil(rows), block::Scratch::default);
                let parts = disparity.chunks_mut(rows * self.width).zip(&mut self.strips).enumerate();
                let strip = |(k, (out, scratch))| Strip {
                    matcher,
                    scratch: StripScratch::Block(scratch),
                    first_row: k * rows,
                    out,
                };
                parts.map(strip).collect()
            }
        });
        let Settings { speckle_min_area, speckle_step, .. } = self.settings;
        self.speckles.apply(disparity, self.width, speckle_min_area, speckle_step);
        Ok(())
    }

    fn filter(&mut self, left: &[u8], right: &[u8]) -> Result<(), StereoError> {
        let (width, height) = (self.width, self.height);
        let expected = width * height;
        for (camera, image) in [("left", left), ("right", right)] {
            if image.len() != expected {
                return Err(StereoError::ImageSize { camera, got: image.len(), expected, width, height });
            }
        }
        let (pad, spare, cap, brightness) = match self.settings.method {
            Method::Block => (self.settings.block / 2, block::SPARE, block::cap(self.settings.block), false),
            Method::SemiGlobal => (sgm::RADIUS, 0, sgm::CAP, true),
        };
        for (image, out) in [(left, &mut self.left), (right, &mut self.right)] {
            self.vectors.run(LogFilter { image, width, height, pad, spare, cap, brightness, out });
        }
        Ok(())
    }
}

impl Strip<'_> {
    /// Runs this part.
    pub fn run(self) {
        let Strip { matcher: Shared { left, right, width, settings, vectors }, scratch, first_row, out } =
            self;
        let &Settings { disparities, block, uniqueness_pct, left_right_max, .. } = settings;
        let accept = Accept { uniqueness_pct, left_right_max };
        match scratch {
            StripScratch::Block(scratch) => {
                let radius = block / 2;
                vectors.run(block::Rows {
                    left,
                    right,
                    width,
                    disparities,
                    radius,
                    accept,
                    first_row,
                    scratch,
                    out,
                });
            }
            // Its inner loops are only 64 bytes long, for which vectors of half that width are faster.
            StripScratch::SemiGlobal(scratch) => vectors.min(Width::Avx2).run(sgm::Image {
                left,
                right,
                width,
                disparities,
                accept,
                scratch,
                out,
            }),
        }
    }
}
