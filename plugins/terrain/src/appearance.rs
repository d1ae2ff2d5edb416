//! What a piece of terrain looks like: histograms of colour ratios, intensity and texture, and a contrast (Albus 2006a,
//! 3.2).
//!
//! Ratios are binned by their logarithm, so that R/G and G/R are treated alike: bin = ⌊4 (1 + log₂(a/b)/span)⌋, kept in
//! 0..7, with both colours at least 1. Eight bins, as the paper has; the span (octaves) is a parameter, since the paper
//! gives no bins. Intensity: value >> 5. Texture: code >> 5, the top three bits of the pattern.

use crate::texture::{CONTRAST_UNIT, PaddedGrey, Patterns};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Bins of each histogram.
pub const BINS: usize = 8;
/// Histograms: R/G, R/B, G/B, intensity, texture.
pub const HISTOGRAMS: usize = 5;

/// The bin of every ratio of two colours.
#[derive(Clone, Debug, PartialEq)]
pub struct RatioBins {
    span_octaves: f64,
    /// Indexed by `a << 8 | b`.
    bins: Vec<u8>,
}

impl RatioBins {
    /// Bins that reach from `-span_octaves` to `span_octaves`. A span that is not a positive number counts as 1.
    pub fn new(span_octaves: f64) -> RatioBins {
        let span = if span_octaves.is_finite() && span_octaves > 0.0 { span_octaves } else { 1.0 };
        let logs: [f64; 256] = std::array::from_fn(|v| libm::log2(v.max(1) as f64));
        let bin = |a: f64, b: f64| (4.0 * (1.0 + (a - b) / span)).floor().clamp(0.0, 7.0) as u8;
        let bins = logs.iter().flat_map(|&a| logs.iter().map(move |&b| bin(a, b))).collect();
        RatioBins { span_octaves: span, bins }
    }

    /// Octaves.
    pub fn span_octaves(&self) -> f64 {
        self.span_octaves
    }

    /// Bin of a / b.
    fn bin(&self, a: u8, b: u8) -> u16 {
        u16::from(self.bins[usize::from(a) << 8 | usize::from(b)])
    }
}

/// The bins of every pixel of some rows of an image, and its contrast.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PixelCodes {
    /// Bins of the five histograms, three bits each from the lowest, by rows.
    pub codes: Vec<u16>,
    /// Contrast of the pattern, in 1/840 grey level.
    pub contrasts: Vec<u32>,
}

impl PixelCodes {
    /// Codes of the pixels of some rows. `rgb` is the whole image, three bytes a pixel by rows, and `grey` is made of
    /// it.
    ///
    /// # Panics
    /// Where the image does not have these rows.
    pub fn of_rows(rgb: &[u8], grey: &PaddedGrey, rows: Range<usize>, ratios: &RatioBins) -> PixelCodes {
        let width = grey.width();
        let mut all =
            PixelCodes { codes: vec![0; width * rows.len()], contrasts: vec![0; width * rows.len()] };
        if width == 0 {
            return all;
        }
        let mut patterns = Patterns::default();
        let outputs = all.codes.chunks_exact_mut(width).zip(all.contrasts.chunks_exact_mut(width));
        for (row, (codes, contrasts)) in rows.zip(outputs) {
            grey.patterns(row, &mut patterns);
            contrasts.copy_from_slice(&patterns.contrasts);
            let pixels = rgb[row * width * 3..(row + 1) * width * 3].as_chunks::<3>().0;
            let pixels = pixels.iter().zip(grey.row(row)).zip(&patterns.codes);
            for (code, ((&[r, g, b], &intensity), &pattern)) in codes.iter_mut().zip(pixels) {
                *code = ratios.bin(r, g)
                    | ratios.bin(r, b) << 3
                    | ratios.bin(g, b) << 6
                    | u16::from(intensity >> 5) << 9
                    | u16::from(pattern >> 5) << 12;
            }
        }
        all
    }
}

/// Points by bin: R/G, R/B, G/B, intensity, texture, and the sum of their contrasts. Whole numbers, so that adding in
/// any order gives the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Histograms {
    /// Points by histogram and bin.
    pub bins: [[u64; BINS]; HISTOGRAMS],
    /// In 1/840 grey level.
    pub contrast_sum: u64,
}

impl Histograms {
    /// Adds a pixel by its code and contrast.
    #[inline]
    pub fn add(&mut self, code: u16, contrast: u32) {
        for (i, histogram) in self.bins.iter_mut().enumerate() {
            histogram[usize::from(code >> (3 * i) & 7)] += 1;
        }
        self.contrast_sum += u64::from(contrast);
    }

    /// Adds all points of others.
    pub fn merge(&mut self, other: &Histograms) {
        let bins = self.bins.as_flattened_mut().iter_mut().zip(other.bins.as_flattened());
        bins.for_each(|(mine, theirs)| *mine = mine.saturating_add(*theirs));
        self.contrast_sum = self.contrast_sum.saturating_add(other.contrast_sum);
    }

    /// Points.
    pub fn points(&self) -> u64 {
        self.bins[0].iter().sum()
    }

    /// Mean contrast, 0 to 1; 0 without points.
    pub fn contrast(&self) -> f64 {
        let points = self.points();
        if points == 0 {
            return 0.0;
        }
        self.contrast_sum as f64 / (f64::from(CONTRAST_UNIT) * 255.0 * points as f64)
    }
}

/// How much each part counts in a match.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MatchWeights {
    /// Of R/G, R/B, G/B, intensity, texture.
    pub histograms: [f32; HISTOGRAMS],
    /// Of the contrast.
    pub contrast: f32,
}

impl MatchWeights {
    /// The same ratios with a sum of 1, so that a distance is 0 for equals and 2 for histograms without a common bin.
    /// Weights without a positive sum count as equal.
    #[must_use]
    pub fn normalised(self) -> MatchWeights {
        let sum = self.histograms.iter().sum::<f32>() + self.contrast;
        if !(sum.is_finite() && sum > 0.0) {
            return MatchWeights { histograms: [1.0 / 6.0; HISTOGRAMS], contrast: 1.0 / 6.0 };
        }
        MatchWeights { histograms: self.histograms.map(|w| w / sum), contrast: self.contrast / sum }
    }

    /// An appearance as it is compared under these weights, which are normalised: each histogram divided by its points,
    /// and the contrast, times the root of its weight.
    pub fn signature(&self, histograms: &Histograms) -> Signature {
        let scale = 1.0 / histograms.points().max(1) as f64;
        let mut parts = [[0.0; BINS]; HISTOGRAMS + 1];
        for ((part, bins), &weight) in parts.iter_mut().zip(&histograms.bins).zip(&self.histograms) {
            let factor = f64::from(weight).sqrt() * scale;
            *part = bins.map(|count| (count as f64 * factor) as f32);
        }
        parts[HISTOGRAMS][0] = (histograms.contrast() * f64::from(self.contrast).sqrt()) as f32;
        Signature { parts }
    }
}

/// An appearance under the weights of a match.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signature {
    /// Histograms, and the contrast as the first number of a part of its own.
    parts: [[f32; BINS]; HISTOGRAMS + 1],
}

impl Signature {
    /// Weighted sum of the squared differences of two appearances (Albus 2006a, 3.2, step 4): 0 for equals, 2 at most.
    #[inline]
    pub fn distance(&self, other: &Signature) -> f32 {
        // Bins side by side: one vector for each histogram.
        let mut lanes = [0.0_f32; BINS];
        for (a, b) in self.parts.iter().zip(&other.parts) {
            for lane in 0..BINS {
                let difference = a[lane] - b[lane];
                lanes[lane] += difference * difference;
            }
        }
        // Pairs, in a fixed order: a chain of eight additions would be most of the time.
        let [a, b, c, d, e, f, g, h] = lanes;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }

    /// The nearest of several appearances and its distance; of equally near ones the first.
    pub fn best(&self, models: &[Signature]) -> Option<(usize, f32)> {
        let mut best: Option<(usize, f32)> = None;
        for (index, model) in models.iter().enumerate() {
            let distance = self.distance(model);
            if best.is_none_or(|(_, least)| distance < least) {
                best = Some((index, distance));
            }
        }
        best
    }
}

#[cfg(test)]
#[path = "appearance_tests.rs"]
mod tests;
