//! Appearance of terrain: histograms of colour ratios, intensity and texture, and a contrast (Albus 2006a, 3.2).
//!
//! Ratios are binned by their logarithm, so that R/G and G/R are treated alike: bin = ⌊4 (1 + log₂(a/b)/span)⌋, clamped
//! to 0..7, with both colours at least 1. There are eight bins as in the paper; the paper does not give their limits,
//! so the span (octaves) is a parameter. Intensity: value >> 5. Texture: code >> 5, the top three bits of the pattern.

use crate::texture::{CONTRAST_UNIT, PaddedGrey, Patterns};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Bins per histogram.
pub const BINS: usize = 8;
/// Number of histograms: R/G, R/B, G/B, intensity, texture.
pub const HISTOGRAMS: usize = 5;

/// Table of the bins of all ratios of two colours.
#[derive(Clone, Debug, PartialEq)]
pub struct RatioBins {
    span_octaves: f64,
    /// Indexed by `a << 8 | b`.
    bins: Vec<u8>,
}

impl RatioBins {
    /// Bins from `-span_octaves` to `span_octaves`. A span that is not a positive number is replaced by 1.
    pub fn new(span_octaves: f64) -> RatioBins {
        let span = if span_octaves.is_finite() && span_octaves > 0.0 { span_octaves } else { 1.0 };
        let logs: [f64; 256] = std::array::from_fn(|v| libm::log2(v.max(1) as f64));
        let bin = |a: f64, b: f64| (4.0 * (1.0 + (a - b) / span)).floor().clamp(0.0, 7.0) as u8;
        let bins = logs.iter().flat_map(|&a| logs.iter().map(move |&b| bin(a, b))).collect();
        RatioBins { span_octaves: span, bins }
    }

    /// Span of the bins, octaves.
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
    /// Bins of the five histograms, three bits each starting with the lowest, in row order.
    pub codes: Vec<u16>,
    /// Contrasts of the patterns, in 1/840 grey level.
    pub contrasts: Vec<u32>,
}

impl PixelCodes {
    /// Codes of the pixels of some rows. `rgb` is the whole image, three bytes per pixel in row order, and `grey` its
    /// grey version.
    ///
    /// # Panics
    /// If the image does not contain these rows.
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

/// Number of points by bin for R/G, R/B, G/B, intensity and texture, and the sum of their contrasts. Counts are whole
/// numbers, so the order of additions does not matter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Histograms {
    /// Number of points by histogram and bin.
    pub bins: [[u64; BINS]; HISTOGRAMS],
    /// Sum of the contrasts in 1/840 grey level.
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

    /// Adds all points of another one.
    pub fn merge(&mut self, other: &Histograms) {
        let bins = self.bins.as_flattened_mut().iter_mut().zip(other.bins.as_flattened());
        bins.for_each(|(mine, theirs)| *mine = mine.saturating_add(*theirs));
        self.contrast_sum = self.contrast_sum.saturating_add(other.contrast_sum);
    }

    /// Number of points.
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

/// Weight of each part in a match.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MatchWeights {
    /// Weights of R/G, R/B, G/B, intensity, texture.
    pub histograms: [f32; HISTOGRAMS],
    /// Weight of the contrast.
    pub contrast: f32,
}

impl MatchWeights {
    /// Scales the weights to a sum of 1, so that a distance is 0 for equal appearances and 2 for histograms without a
    /// common bin. Weights without a positive sum are replaced by equal ones.
    #[must_use]
    pub fn normalised(self) -> MatchWeights {
        let sum = self.histograms.iter().sum::<f32>() + self.contrast;
        if !(sum.is_finite() && sum > 0.0) {
            return MatchWeights { histograms: [1.0 / 6.0; HISTOGRAMS], contrast: 1.0 / 6.0 };
        }
        MatchWeights { histograms: self.histograms.map(|w| w / sum), contrast: self.contrast / sum }
    }

    /// Prepares an appearance for comparison with these (normalised) weights: each histogram is divided by its number
    /// of points, and histograms and contrast are multiplied by the square roots of their weights.
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

/// An appearance prepared for comparison with certain weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signature {
    /// The histograms, and the contrast as the first number of an additional part.
    parts: [[f32; BINS]; HISTOGRAMS + 1],
}

impl Signature {
    /// Weighted sum of the squared differences of two appearances (Albus 2006a, 3.2, step 4), 0 for equal ones to 2.
    #[inline]
    pub fn distance(&self, other: &Signature) -> f32 {
        // One sum per bin, so that a histogram is one vector.
        let mut lanes = [0.0_f32; BINS];
        for (a, b) in self.parts.iter().zip(&other.parts) {
            for lane in 0..BINS {
                let difference = a[lane] - b[lane];
                lanes[lane] += difference * difference;
            }
        }
        // Added in pairs, in a fixed order: a chain of eight additions would dominate the running time.
        let [a, b, c, d, e, f, g, h] = lanes;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }

    /// Index and distance of the nearest of several appearances; the first of equally near ones.
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
