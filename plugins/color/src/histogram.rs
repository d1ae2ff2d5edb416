//! Histograms over red and green (Albus 2006a, 3.1.2), of which colour models consist.
//!
//! 30×30 bins, bin = ⌊30·v/256⌋ per channel. Histograms are scaled to a common sum, the sample budget, before they are
//! compared, merged or divided, because raw counts of samples of different sizes are not comparable.

use crate::image::Image;
use serde::{Deserialize, Serialize};

/// Bins per channel.
pub const BINS: usize = 30;
/// Bins per histogram.
pub const CELLS: usize = BINS * BINS;

/// Index of the bin of a colour: red bin times [`BINS`] plus green bin.
pub const fn bin(red: u8, green: u8) -> usize {
    (red as usize * BINS / 256) * BINS + green as usize * BINS / 256
}

/// Counts indexed by [`bin`], finite and not negative.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Histogram(Vec<f32>);

impl Default for Histogram {
    fn default() -> Self {
        Histogram(vec![0.0; CELLS])
    }
}

impl Histogram {
    /// Histogram with these counts, indexed by [`bin`]; `None` if there are not [`CELLS`] of them, if one is negative
    /// or not finite, or if their sum is not positive and finite.
    pub fn from_counts(counts: &[f32]) -> Option<Histogram> {
        let usable = counts.len() == CELLS && counts.iter().all(|count| *count >= 0.0 && count.is_finite());
        let histogram = Histogram(counts.to_vec());
        let sum = histogram.sum();
        (usable && sum > 0.0 && sum.is_finite()).then_some(histogram)
    }

    /// Histogram of the pixels in spans of an image; the spans must lie within the image.
    pub fn of_spans(image: &Image<'_>, spans: &[Span]) -> Histogram {
        // Two tables used in turn: neighbours often fall into one bin, and its second increment would wait for the
        // first.
        let mut tables = [[0_u32; CELLS]; 2];
        for span in spans {
            let row = image.row(span.row as usize);
            let pixels = row[span.start as usize * 3..span.end as usize * 3].as_chunks::<3>().0;
            for (i, &[red, green, _]) in pixels.iter().enumerate() {
                tables[i % 2][bin(red, green)] += 1;
            }
        }
        Histogram(std::iter::zip(tables[0], tables[1]).map(|(a, b)| (a + b) as f32).collect())
    }

    /// Counts one pixel.
    pub fn add(&mut self, red: u8, green: u8) {
        self.0[bin(red, green)] += 1.0;
    }

    /// Counts indexed by [`bin`].
    pub fn counts(&self) -> &[f32] {
        &self.0
    }

    /// Sum of the counts.
    pub fn sum(&self) -> f32 {
        // The order of the additions is fixed, so the sum is deterministic even where counts are not whole numbers.
        self.0.iter().map(|&count| f64::from(count)).sum::<f64>() as f32
    }

    /// Scales to another sum; an empty histogram stays empty.
    #[must_use]
    pub fn scaled(mut self, sum: f32) -> Histogram {
        let own = self.sum();
        if own > 0.0 {
            let factor = sum / own;
            self.0.iter_mut().for_each(|count| *count *= factor);
        }
        self
    }

    /// Share of one histogram that the other does not have: 0 for equal distributions, 1 for disjoint ones. Both must
    /// have the same sum. This is 1 minus the histogram intersection (Swain 1991), and half the sum of absolute
    /// differences.
    pub fn difference(&self, other: &Histogram) -> f32 {
        let sum = self.sum().max(f32::MIN_POSITIVE);
        let common: f32 = std::iter::zip(&self.0, &other.0).map(|(a, b)| a.min(*b)).sum();
        (1.0 - common / sum).clamp(0.0, 1.0)
    }

    /// Running average with a new histogram of the same sum, whose weight is 1 / (`uses` + 1): the temporal fusion of
    /// Albus 2006a, 3.1.2 with c = 1 and w = `uses`.
    pub fn merge(&mut self, new: &Histogram, uses: u32) {
        let weight = uses as f32;
        for (own, new) in std::iter::zip(&mut self.0, &new.0) {
            *own = (weight * *own + new) / (weight + 1.0);
        }
    }
}

/// Pixels of one row, columns `start` (included) to `end` (excluded).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Row of the image.
    pub row: u32,
    /// First column.
    pub start: u32,
    /// Column after the last one.
    pub end: u32,
}

impl Span {
    /// Number of pixels.
    pub fn pixels(&self) -> u32 {
        self.end.saturating_sub(self.start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Reference implementation of the binning rule, pixel by pixel.
    fn reference_histogram(image: &Image<'_>, spans: &[Span]) -> Vec<f32> {
        let mut counts = vec![0.0; 900];
        for span in spans {
            for column in span.start..span.end {
                let [r, g, _] = image.pixel(column as usize, span.row as usize);
                let of = |v: u8| (30.0 * f64::from(v) / 256.0).floor() as usize;
                counts[of(r) * 30 + of(g)] += 1.0;
            }
        }
        counts
    }

    proptest! {
        #[test]
        fn counts_equal_those_of_the_rule(
            data in prop::collection::vec(any::<u8>(), 13 * 7 * 3),
            edges in prop::collection::vec((0..=13_u32, 0..=13_u32), 7),
        ) {
            let image = Image::new([13, 7], 39, &data).unwrap();
            let spans: Vec<Span> = (0..).zip(&edges)
                .map(|(row, &(a, b))| Span { row, start: a.min(b), end: a.max(b) })
                .collect();
            let histogram = Histogram::of_spans(&image, &spans);
            prop_assert_eq!(histogram.counts(), reference_histogram(&image, &spans));
            prop_assert_eq!(histogram.sum(), spans.iter().map(Span::pixels).sum::<u32>() as f32);
        }

        #[test]
        fn a_difference_is_half_the_sum_of_absolute_differences_of_shares(
            a in prop::collection::vec(0..50_u8, CELLS), b in prop::collection::vec(0..50_u8, CELLS),
        ) {
            let of = |counts: &[u8]| {
                Histogram::from_counts(&counts.iter().map(|&c| f32::from(c)).collect::<Vec<_>>()).unwrap().scaled(1000.0)
            };
            let (a, b) = (of(&a), of(&b));
            let expected: f32 =
                std::iter::zip(a.counts(), b.counts()).map(|(a, b)| (a - b).abs()).sum::<f32>() / 2000.0;
            prop_assert!((a.difference(&b) - expected).abs() < 1e-4);
            prop_assert!((a.difference(&b) - b.difference(&a)).abs() < 1e-4);
            prop_assert!(a.difference(&a) < 1e-5);
        }
    }

    #[test]
    fn bins_are_thirtieths_of_256() {
        assert_eq!(bin(0, 0), 0);
        assert_eq!(bin(255, 255), 899);
        // 30·8/256 is below 1, 30·9/256 above it.
        assert_eq!((bin(8, 0), bin(9, 0), bin(0, 8), bin(0, 9)), (0, 30, 0, 1));
        let mut used: Vec<usize> = (0..=255).map(|v| bin(0, v)).collect();
        used.dedup();
        assert_eq!(used, (0..30).collect::<Vec<_>>());
    }

    #[test]
    fn colours_without_a_common_bin_differ_by_one() {
        let of = |red, green| {
            let mut histogram = Histogram::default();
            histogram.add(red, green);
            histogram.scaled(100.0)
        };
        assert_eq!(of(10, 200).difference(&of(200, 10)), 1.0);
        assert_eq!(of(10, 200).difference(&of(11, 201)), 0.0);
    }

    #[test]
    fn merging_averages_over_all_that_came() {
        let of = |red| {
            let mut histogram = Histogram::default();
            histogram.add(red, 0);
            histogram.scaled(90.0)
        };
        let mut model = of(0);
        model.merge(&of(0), 1);
        model.merge(&of(255), 2);
        assert_eq!((model.counts()[bin(0, 0)], model.counts()[bin(255, 0)]), (60.0, 30.0));
    }

    #[test]
    fn counts_that_cannot_be_are_refused() {
        assert!(Histogram::from_counts(&[1.0; 899]).is_none());
        assert!(Histogram::from_counts(&[0.0; 900]).is_none());
        let with = |value: f32| {
            let mut counts = [1.0; 900];
            counts[7] = value;
            Histogram::from_counts(&counts)
        };
        assert!(with(-1.0).is_none() && with(f32::NAN).is_none() && with(f32::INFINITY).is_none());
        assert!(with(f32::MAX).is_some_and(|histogram| histogram.sum().is_finite()));
    }
}
