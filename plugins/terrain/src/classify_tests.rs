//! Classification compared with a reference implementation, and discrimination of two textures.

use crate::appearance::{BINS, HISTOGRAMS, MatchWeights, PixelCodes, RatioBins};
use crate::classify::*;
use crate::map::TerrainMap;
use crate::models::{Model, ModelRules, ModelSet};
use crate::scene::{Scene, grass, noise, planks, terrain};
use proptest::prelude::*;
use rcs_geom::Pose;

const WEIGHTS: MatchWeights = MatchWeights { histograms: [0.18; HISTOGRAMS], contrast: 0.1 };

/// Models of the two textures, learned from a scene as by the learner.
pub(crate) fn learned() -> ModelSet {
    let rules = ModelRules {
        min_points: 40,
        min_purity: 0.95,
        merge_distance: 0.15,
        max_models: 16,
        near_m: 4.0,
        weights: WEIGHTS.normalised(),
    };
    let mut map = TerrainMap::new(ModelSet::default()).unwrap();
    let scene = Scene::new([320, 240], Pose::IDENTITY, 4.0, 5.0, 1);
    let window = map.window();
    let ratios = RatioBins::new(1.0);
    let strips: Vec<_> = (0..crate::frame::strips(240))
        .map(|strip| crate::frame::gather(&scene.frame(), strip, &window, 8.0, &ratios))
        .collect();
    map.learn(&crate::frame::join(&strips, window.side), &rules);
    map.models
}

pub(crate) fn classes_of(scene: &Scene, set: &ModelSet, window_px: usize) -> (WindowGrid, Vec<Class>) {
    let grid = WindowGrid::new(scene.size, window_px);
    let matcher = Matcher::new(set, WEIGHTS.normalised(), 0.3, 0, 0.5);
    let wanted = vec![true; grid.columns()];
    let ratios = RatioBins::new(1.0);
    let rows = (0..grid.rows())
        .map(|row| classify_row(&scene.rgb, &scene.grey, &ratios, &grid, row, &wanted, &matcher));
    (grid, rows.collect::<Vec<_>>().concat())
}

/// Reference for one window, in whole pixels and double precision.
fn reference_class(
    scene: &Scene,
    grid: &WindowGrid,
    column: usize,
    row: usize,
    set: &ModelSet,
    max: f64,
) -> Class {
    let codes = PixelCodes::of_rows(&scene.rgb, &scene.grey, 0..scene.size[1], &RatioBins::new(1.0));
    let share = |counts: &[[u64; BINS]; HISTOGRAMS], contrast: u64| {
        let points = counts[0].iter().sum::<u64>() as f64;
        (counts.map(|h| h.map(|c| c as f64 / points)), contrast as f64 / points / 840.0 / 255.0)
    };
    let (mut counts, mut contrast) = ([[0; BINS]; HISTOGRAMS], 0);
    for y in grid.y(row)[0]..grid.y(row)[1] {
        for x in grid.x(column)[0]..grid.x(column)[1] {
            let i = y * scene.size[0] + x;
            for (h, histogram) in counts.iter_mut().enumerate() {
                histogram[usize::from(codes.codes[i]) / BINS.pow(h as u32) % BINS] += 1;
            }
            contrast += u64::from(codes.contrasts[i]);
        }
    }
    let (window, window_contrast) = share(&counts, contrast);
    let distance = |model: &Model| {
        let histograms = &model.terrain.histograms;
        let (bins, contrast) = share(&histograms.bins, histograms.contrast_sum);
        let mut sum =
            f64::from(WEIGHTS.contrast) * (contrast - window_contrast) * (contrast - window_contrast);
        for h in 0..HISTOGRAMS {
            for b in 0..BINS {
                sum += f64::from(WEIGHTS.histograms[h])
                    * (bins[h][b] - window[h][b])
                    * (bins[h][b] - window[h][b]);
            }
        }
        sum
    };
    let numbered = set.models.iter().enumerate();
    let (number, best) = numbered.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b))).unwrap();
    let fraction = best.obstacle_fraction().unwrap();
    let like = Match { cost: (fraction * 250.0).round() as u8, model: number as u8 + 1 };
    match distance(best) {
        far if far > max => Class::Unclassified,
        _ if fraction >= 0.5 => Class::NotTraversable(like),
        _ => Class::Traversable(like),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn windows_are_classified_as_the_definition_says(seed: u64, width in 30..70_u32, height in 30..60_u32, window_px in 7..20_usize) {
        let scene = Scene::new([width, height], Pose::IDENTITY, 4.0, 1.0, seed);
        let set = learned();
        let (grid, classes) = classes_of(&scene, &set, window_px);
        for row in 0..grid.rows() {
            for column in 0..grid.columns() {
                let got = classes[row * grid.columns() + column];
                prop_assert_eq!(got, reference_class(&scene, &grid, column, row, &set, 0.3), "window {}, {}", column, row);
            }
        }
        // Every pixel has the class of its window.
        let image = overlay(&classes, &grid);
        for y in 0..height as usize {
            for x in 0..width as usize {
                let class = classes[y / window_px * grid.columns() + x / window_px];
                prop_assert_eq!(image[y * width as usize + x], class.pixel());
            }
        }
    }

    #[test]
    fn stereo_ends_above_the_highest_window_that_it_covers(seed: u64, width in 20..60_usize, height in 20..60_usize) {
        let grid = WindowGrid::new([width, height], 8);
        let depth: Vec<f32> = (0..width * height)
            .map(|i| match noise(i, (i / width / 8 + i % width / 8) % 3, seed) % 4 { 0 => f32::NAN, 1 => 20.0, _ => 5.0 })
            .collect();
        for (column, end) in end_of_stereo(&depth, &grid, 8.0).into_iter().enumerate() {
            let covered = |row: usize| {
                let ([left, right], [top, bottom]) = (grid.x(column), grid.y(row));
                let pixels: Vec<f32> = (top..bottom).flat_map(|y| (left..right).map(move |x| y * width + x)).map(|i| depth[i]).collect();
                pixels.iter().filter(|d| **d <= 8.0).count() * 2 >= pixels.len()
            };
            let expected = (0..grid.rows()).find(|&row| covered(row)).unwrap_or(grid.rows());
            prop_assert_eq!(end, expected);
        }
    }
}

#[test]
fn two_textures_are_told_apart_and_the_sky_is_neither() {
    let scene = Scene::new([640, 480], Pose::IDENTITY, 5.0, 2.0, 99);
    let (grid, classes) = classes_of(&scene, &learned(), 16);
    let (mut right, mut wrong, mut open, mut sky) = (0, 0, 0, 0);
    for row in 0..grid.rows() {
        for column in 0..grid.columns() {
            let label = |x: usize, y: usize| scene.labels[y * 640 + x];
            let ([left, after], [top, below]) = (grid.x(column), grid.y(row));
            let corners = [
                label(left, top),
                label(after - 1, top),
                label(left, below - 1),
                label(after - 1, below - 1),
            ];
            let class = classes[row * grid.columns() + column];
            match (corners, class) {
                ([0, 0, 0, 0], class) => sky += usize::from(class != Class::Unclassified),
                ([1, 1, 1, 1], Class::Traversable(like)) => right += usize::from(like.cost < 10),
                ([2, 2, 2, 2], Class::NotTraversable(like)) => right += usize::from(like.cost > 240),
                ([a, b, c, d], class) if a == b && b == c && c == d => {
                    wrong += usize::from(class != Class::Unclassified);
                    open += usize::from(class == Class::Unclassified);
                }
                _ => {}
            }
        }
    }
    assert_eq!((wrong, sky), (0, 0), "{right} right");
    assert!(right > 500 && open * 50 < right, "{right} right, {open} open");
}

#[test]
fn windows_that_are_not_wanted_are_skipped_and_without_models_nothing_is_classified() {
    let scene = Scene::new([32, 32], Pose::IDENTITY, 4.0, 1.0, 3);
    let grid = WindowGrid::new([32, 32], 16);
    let ratios = RatioBins::new(1.0);
    let matcher = Matcher::new(&ModelSet::default(), WEIGHTS, 2.0, 0, 0.5);
    let row = |wanted: &[bool]| classify_row(&scene.rgb, &scene.grey, &ratios, &grid, 1, wanted, &matcher);
    assert_eq!(row(&[false, true]), [Class::Skipped, Class::Unclassified]);
    assert_eq!(row(&[false, false]), [Class::Skipped; 2]);
    let models = [terrain(0, 100, 0), terrain(0o77777, 20, 0)].map(|terrain| Model::new(terrain, 1));
    let set = ModelSet { models: models.to_vec(), named: 0 };
    assert_eq!(Matcher::new(&set, WEIGHTS, 2.0, 50, 0.5).models(), 1, "models of few points are not used");
    assert_ne!(grass(1, 1, 1), planks(1, 1, 1));
}
