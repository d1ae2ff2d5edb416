//! Histograms compared with their definition.

use super::*;
use crate::texture::intensity;
use proptest::prelude::*;

/// Bins of a pixel by definition, without texture.
fn reference_bins([r, g, b]: [u8; 3], span: f64) -> [usize; 4] {
    let ratio = |a: u8, b: u8| {
        let log = libm::log2(f64::from(a.max(1)) / f64::from(b.max(1)));
        (((log / span + 1.0) * 4.0).floor() as i64).clamp(0, 7) as usize
    };
    [ratio(r, g), ratio(r, b), ratio(g, b), usize::from(intensity([r, g, b])) / 32]
}

fn square(v: f64) -> f64 {
    v * v
}

/// Reference: the sum over all parts in double precision.
fn reference_distance(w: &MatchWeights, a: &Histograms, b: &Histograms) -> f64 {
    let mut sum = f64::from(w.contrast) * square(a.contrast() - b.contrast());
    let share = |of: &Histograms, h: usize, bin: usize| of.bins[h][bin] as f64 / of.points() as f64;
    for h in 0..HISTOGRAMS {
        for bin in 0..BINS {
            sum += f64::from(w.histograms[h]) * square(share(a, h, bin) - share(b, h, bin));
        }
    }
    sum
}

const WEIGHTS: MatchWeights = MatchWeights { histograms: [1.0, 2.0, 1.0, 0.5, 1.5], contrast: 3.0 };

proptest! {
    #[test]
    fn pixels_fall_into_the_bins_of_the_definition(pixels in prop::collection::vec(any::<[u8; 3]>(), 12..60), span in 0.3..3.0_f64) {
        let width = 6;
        let height = pixels.len() / width;
        let rgb: Vec<u8> = pixels[..width * height].as_flattened().to_vec();
        let ratios = RatioBins::new(span);
        let grey = PaddedGrey::from_rgb(&rgb, width, height);
        let all = PixelCodes::of_rows(&rgb, &grey, 0..height, &ratios);
        let mut sum = Histograms::default();
        let mut expected = [[0_u64; BINS]; HISTOGRAMS];
        let mut contrast = 0_u64;
        for row in 0..height {
            let mut patterns = Patterns::default();
            grey.patterns(row, &mut patterns);
            for x in 0..width {
                let i = row * width + x;
                for (histogram, bin) in reference_bins(pixels[i], span).into_iter().enumerate() {
                    expected[histogram][bin] += 1;
                }
                expected[4][usize::from(patterns.codes[x] >> 5)] += 1;
                contrast += u64::from(patterns.contrasts[x]);
                sum.add(all.codes[i], all.contrasts[i]);
            }
        }
        prop_assert_eq!(sum.bins, expected);
        prop_assert_eq!(sum.contrast_sum, contrast);
        prop_assert_eq!(sum.points(), (width * height) as u64);
    }

    #[test]
    fn rows_alone_give_what_the_whole_image_gives(pixels in prop::collection::vec(any::<[u8; 3]>(), 40), cut in 0..8_usize) {
        let rgb = pixels.as_flattened();
        let (ratios, grey) = (RatioBins::new(1.0), PaddedGrey::from_rgb(rgb, 5, 8));
        let whole = PixelCodes::of_rows(rgb, &grey, 0..8, &ratios);
        let (above, below) = (PixelCodes::of_rows(rgb, &grey, 0..cut, &ratios), PixelCodes::of_rows(rgb, &grey, cut..8, &ratios));
        prop_assert_eq!([above.codes, below.codes].concat(), whole.codes);
        prop_assert_eq!([above.contrasts, below.contrasts].concat(), whole.contrasts);
    }

    #[test]
    fn the_distance_is_the_weighted_sum_of_squared_differences(
        a in prop::collection::vec(any::<(u16, u8)>(), 1..50),
        b in prop::collection::vec(any::<(u16, u8)>(), 1..50),
    ) {
        let appearance = |points: &[(u16, u8)]| {
            let mut sum = Histograms::default();
            for &(code, contrast) in points {
                sum.add(code & 0x7fff, u32::from(contrast) * 840);
            }
            sum
        };
        let (a, b) = (appearance(&a), appearance(&b));
        let weights = WEIGHTS.normalised();
        let expected = reference_distance(&weights, &a, &b);
        let (a, b) = (weights.signature(&a), weights.signature(&b));
        prop_assert!((f64::from(a.distance(&b)) - expected).abs() < 1e-6);
        prop_assert_eq!(a.distance(&b), b.distance(&a));
        prop_assert_eq!(a.distance(&a), 0.0);
        prop_assert!(a.distance(&b) <= 2.0 + 1e-6);
        let best = a.best(&[b, a, a]);
        prop_assert_eq!(best, Some(if a == b { (0, 0.0) } else { (1, 0.0) }));
    }

    #[test]
    fn a_ratio_and_its_inverse_lie_in_opposite_bins(a: u8, b: u8) {
        let ratios = RatioBins::new(1.0);
        let (there, back) = (ratios.bin(a, b), ratios.bin(b, a));
        // A ratio on the border of two bins belongs to the upper one in both directions.
        prop_assert!(there + back == 7 || there + back == 8, "{there} and {back}");
    }
}

#[test]
fn black_pixels_have_bins() {
    let ratios = RatioBins::new(1.0);
    assert_eq!(ratios.bin(0, 0), ratios.bin(200, 200));
    assert_eq!((ratios.bin(255, 0), ratios.bin(0, 255)), (7, 0));
    assert_eq!(RatioBins::new(f64::NAN), RatioBins::new(1.0));
}

#[test]
fn histograms_that_share_no_bin_are_two_apart_and_weights_of_nothing_are_equal() {
    let (mut a, mut b) = (Histograms::default(), Histograms::default());
    a.add(0, 0);
    b.add(0o77777, 0);
    let weights = MatchWeights { histograms: [1.0; HISTOGRAMS], contrast: 0.0 }.normalised();
    assert!((weights.signature(&a).distance(&weights.signature(&b)) - 2.0).abs() < 1e-6);
    let none = MatchWeights { histograms: [0.0; HISTOGRAMS], contrast: 0.0 }.normalised();
    assert!(none.signature(&a).distance(&none.signature(&b)) > 1.0);
    assert_eq!(weights.signature(&a).best(&[]), None);
}
