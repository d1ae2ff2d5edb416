//! The matchers against their slow references, on synthetic scenes and on invalid input.

use crate::reference::reference;
use crate::{Matcher, Method, NO_DISPARITY, STEPS_PER_PIXEL, Settings, StereoError, Strip, Width};
use proptest::prelude::*;

const METHODS: [Method; 2] = [Method::Block, Method::SemiGlobal];

fn compute(size: [usize; 2], settings: Settings, left: &[u8], right: &[u8]) -> Vec<u16> {
    let mut disparity = Vec::new();
    Matcher::new(size, settings).unwrap().compute(left, right, &mut disparity).unwrap();
    disparity
}

/// Grey levels by a hash of the position.
fn texture(x: usize, y: usize) -> u8 {
    let mut h = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    (h >> 24) as u8
}

/// A far plane with a square in front of it: side of the square, both disparities, and the pair.
fn scene(
    width: usize,
    height: usize,
    far: usize,
    near: usize,
) -> (Vec<u8>, Vec<u8>, impl Fn(usize, usize) -> bool) {
    let square = move |x: usize, y: usize| {
        x.abs_diff(width * 5 / 8) < width / 6 && y.abs_diff(height / 2) < height / 4
    };
    let pixels = || (0..width * height).map(move |i| (i % width, i / width));
    let left = pixels().map(|(x, y)| if square(x, y) { texture(x + 1000, y) } else { texture(x, y) });
    let right = pixels()
        .map(|(x, y)| if square(x + near, y) { texture(x + near + 1000, y) } else { texture(x + far, y) });
    (left.collect(), right.collect(), square)
}

fn settings() -> impl Strategy<Value = Settings> {
    let block = prop::sample::select(vec![5_usize, 7, 9, 11, 13, 15]);
    let range = prop::sample::select(vec![16_usize, 32, 48, 64]);
    (any::<bool>(), range, block, 0..=30_u16, 0..=2_u16, 0..30_usize, 0..=32_u16).prop_map(
        |(
            semi_global,
            disparities,
            block,
            uniqueness_pct,
            left_right_max,
            speckle_min_area,
            speckle_step,
        )| {
            let method = METHODS[usize::from(semi_global)];
            let left_right_max = if left_right_max == 2 { 64 } else { left_right_max };
            Settings {
                method,
                disparities,
                block,
                uniqueness_pct,
                left_right_max,
                speckle_min_area,
                speckle_step,
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, rng_seed: proptest::test_runner::RngSeed::Fixed(7), ..ProptestConfig::default() })]

    #[test]
    fn every_width_of_vectors_and_any_number_of_strips_give_the_reference(
        settings in settings(),
        beyond in 0..90_usize,
        height in 1..12_usize,
        shift in 0..20_usize,
        noise in prop::collection::vec(any::<u8>(), 16),
        contrast in 0..=4_u32,
        count in 1..5_usize,
    ) {
        // Starting with the narrowest image for this number of disparities.
        let width = settings.disparities + beyond;
        let pixels = || (0..width * height).map(|i| (i % width, i / width));
        let left: Vec<u8> = pixels().map(|(x, y)| texture(x, y) >> contrast).collect();
        let right: Vec<u8> = pixels()
            .map(|(x, y)| (texture(x + shift, y) >> contrast) ^ (noise[(x * 3 + y * 5) % 16] >> 5))
            .collect();
        let expected = reference(&left, &right, [width, height], &settings);
        for vectors in Width::available() {
            let mut matcher = Matcher::new([width, height], settings).unwrap().with_vectors(vectors);
            let mut disparity = Vec::new();
            // Computed twice, so that data of the first pair would show in the second.
            matcher.compute(&right, &left, &mut disparity).unwrap();
            let backwards = |strips: Vec<Strip<'_>>| strips.into_iter().rev().for_each(Strip::run);
            matcher.compute_in_strips(&left, &right, &mut disparity, count, backwards).unwrap();
            prop_assert_eq!(&disparity, &expected, "{:?}", vectors);
        }
    }
}

#[test]
fn the_widest_vectors_are_among_those_that_are_tested() {
    assert_eq!(Width::available().last(), Some(&Width::widest()));
}

#[test]
fn a_square_before_a_plane_is_found_with_both_disparities() {
    let (width, height) = (160, 96);
    let (left, right, square) = scene(width, height, 4, 13);
    for method in METHODS {
        let disparity = compute([width, height], Settings::new(method, 32), &left, &right);
        let at = |x: usize, y: usize| f64::from(disparity[y * width + x]) / f64::from(STEPS_PER_PIXEL);
        let (mut found, mut wrong) = (0, 0);
        for y in 0..height {
            for x in 32..width {
                let truth = if square(x, y) { 13.0 } else { 4.0 };
                if disparity[y * width + x] != NO_DISPARITY {
                    found += 1;
                    wrong += usize::from((at(x, y) - truth).abs() > 1.0);
                }
            }
        }
        let pixels = (width - 32) * height;
        assert!(found * 100 > pixels * 85, "{method:?} found {found} of {pixels}");
        assert!(wrong * 100 < found * 4, "{method:?}: {wrong} of {found} are wrong");
        assert!((at(100, 48) - 13.0).abs() < 0.3 && (at(40, 10) - 4.0).abs() < 0.3, "{method:?}");
    }
}

#[test]
fn a_shift_by_half_a_pixel_is_seen_as_one() {
    // Twice as wide and then averaged, so that an odd shift becomes half a pixel.
    let (width, height) = (120, 60);
    let smooth = |x: usize, y: usize| {
        let sum: u32 = (0..4).map(|k| u32::from(texture((x + k) / 3, y / 2))).sum();
        (sum / 4) as u8
    };
    let pixels = || (0..width * height).map(|i| (i % width, i / width));
    let left: Vec<u8> = pixels().map(|(x, y)| smooth(2 * x, y)).collect();
    let right: Vec<u8> = pixels().map(|(x, y)| smooth(2 * x + 13, y)).collect();
    for method in METHODS {
        let disparity = compute([width, height], Settings::new(method, 16), &left, &right);
        let mut found: Vec<u16> = disparity.into_iter().filter(|&d| d != NO_DISPARITY).collect();
        found.sort_unstable();
        let median = f64::from(found[found.len() / 2]) / f64::from(STEPS_PER_PIXEL);
        assert!((median - 6.5).abs() < 0.2, "{method:?}: {median}");
    }
}

#[test]
fn images_without_texture_have_no_disparity() {
    for method in METHODS {
        for (left, right) in [(0, 0), (255, 255), (0, 255), (128, 127)] {
            let pair = [left, right].map(|level| vec![level; 80 * 40]);
            let disparity = compute([80, 40], Settings::new(method, 32), &pair[0], &pair[1]);
            assert!(disparity.iter().all(|&d| d == NO_DISPARITY), "{method:?} {left} {right}");
        }
    }
}

#[test]
fn what_lies_left_of_the_range_has_no_disparity() {
    let (left, right, _) = scene(100, 40, 3, 9);
    for method in METHODS {
        let disparity = compute([100, 40], Settings::new(method, 48), &left, &right);
        assert!(disparity.chunks_exact(100).all(|row| row[..47].iter().all(|&d| d == NO_DISPARITY)));
        assert!(disparity.iter().any(|&d| d != NO_DISPARITY));
    }
}

#[test]
fn settings_and_images_that_do_not_fit_are_refused() {
    let good = Settings::new(Method::Block, 64);
    let check = |size, settings, expected: &str| {
        let error = Matcher::new(size, settings).unwrap_err().to_string();
        assert!(error.contains(expected), "got \"{error}\", expected \"{expected}\"");
    };
    check([63, 48], good, "64 disparities do not fit into an image of 63 columns");
    check([0, 48], good, "image size 0x48");
    check([640, 1 << 20], good, "image size 640x1048576");
    for disparities in [0, 8, 63, 272] {
        check([640, 480], Settings { disparities, ..good }, "expected a multiple of 16 from 16 to 256");
    }
    for block in [0, 3, 8, 17] {
        check([640, 480], Settings { block, ..good }, "expected an odd number from 5 to 15");
    }
    check([640, 480], Settings { uniqueness_pct: 101, ..good }, "expected at most 100");
    check([640, 480], Settings { speckle_step: 2000, ..good }, "expected at most 1024");

    let mut matcher = Matcher::new([640, 480], good).unwrap();
    let (full, half) = (vec![0; 640 * 480], vec![0; 640 * 240]);
    let mut disparity = vec![7];
    let error = matcher.compute(&full, &half, &mut disparity).unwrap_err();
    assert!(matches!(error, StereoError::ImageSize { camera: "right", got: 153_600, expected: 307_200, .. }));
    assert_eq!(disparity, [7], "nothing is sent on for a pair that is refused");
}

#[test]
fn more_strips_than_rows_are_no_more_than_rows() {
    let (left, right, _) = scene(64, 5, 2, 6);
    let settings = Settings::new(Method::Block, 16);
    let mut matcher = Matcher::new([64, 5], settings).unwrap();
    let (mut disparity, mut strips) = (Vec::new(), 0);
    for count in [0, 100] {
        matcher
            .compute_in_strips(&left, &right, &mut disparity, count, |all| {
                strips = all.len();
                all.into_iter().for_each(Strip::run);
            })
            .unwrap();
        assert_eq!(disparity, compute([64, 5], settings, &left, &right));
    }
    assert_eq!(strips, 5);
}
