//! The complete algorithm on a generated scene: a brown path through green grass below a sky.

use crate::engine::{Engine, Permission, Samples, Seen};
use crate::fusion::count;
use crate::histogram::{Histogram, Span, bin};
use crate::image::{HEIGHT, Image, PIXELS, WIDTH};
use crate::models::{Learned, Model, Models, Settings};
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};
use rcs_metrics::Confusion;
use rcs_msg::Stamp;

const SIZE: [usize; 2] = [320, 240];
const HORIZON: usize = 80;
const MULCH: [u8; 3] = [120, 84, 58];
const GRASS: [u8; 3] = [88, 122, 50];
const SKY: [u8; 3] = [170, 200, 235];
const LIME: [u8; 3] = [200, 196, 180];
const FENCE: [u8; 3] = [235, 110, 30];

/// Half of the path's width in a row, pixels; the path narrows towards the horizon.
fn half_width(row: usize) -> f64 {
    0.6 * (row as f64 - HORIZON as f64)
}

fn is_path(column: usize, row: usize) -> bool {
    row > HORIZON && (column as f64 - 160.0).abs() < half_width(row)
}

fn is_fence(column: usize, row: usize) -> bool {
    (110..=140).contains(&row) && (145..175).contains(&column)
}

/// Surface texture and noise: brightness varies by a third, each channel by slightly more.
fn paint(path: [u8; 3], fence: bool, seed: u64) -> Vec<u8> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |spread: f64| (f64::from(rng.next_u32()) / f64::from(u32::MAX) - 0.5) * 2.0 * spread;
    let mut data = Vec::with_capacity(SIZE[0] * SIZE[1] * 3);
    for row in 0..SIZE[1] {
        for column in 0..SIZE[0] {
            let base = match () {
                () if fence && is_fence(column, row) => FENCE,
                () if is_path(column, row) => path,
                () if row > HORIZON => GRASS,
                () => SKY,
            };
            let light = 1.0 + noise(0.3);
            data.extend(base.map(|v| (f64::from(v) * light + noise(6.0)).clamp(0.0, 255.0) as u8));
        }
    }
    data
}

/// The trapezoid of the ground sample, at the bottom of the path.
fn ground() -> Vec<Span> {
    (150..230).map(|row| Span { row, start: 130, end: 190 }).collect()
}

fn see(engine: &mut Engine, data: &[u8], time_s: f64, permission: Permission, seed: u64) -> Seen {
    let image = Image::new(SIZE, 3 * SIZE[0], data).unwrap();
    let limits = [HORIZON as u32 + 50; WIDTH];
    let (ground, frame_id) = (ground(), "camera");
    let samples = Samples { ground: &ground, frame_id, first_background: &limits, permission };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    engine.see(&image, &samples, Stamp((time_s * 1e9) as u64), &Settings::default(), &mut rng)
}

/// Intersection over union of ground below the horizon.
fn iou(costs: &[u8]) -> f64 {
    let mut confusion = Confusion::<2>::default();
    for (i, &cost) in costs.iter().enumerate() {
        let (column, row) = ((i % WIDTH) * SIZE[0] / WIDTH + 1, (i / WIDTH) * SIZE[1] / HEIGHT + 1);
        confusion.add(usize::from(is_path(column, row)), Some(usize::from(cost < 125)));
    }
    confusion.iou(1).unwrap()
}

#[test]
fn a_mulch_path_is_told_from_grass_and_sky() {
    let mut engine = Engine::default();
    let mut last = None;
    for i in 0..10 {
        last = Some(see(&mut engine, &paint(MULCH, false, i), 0.2 * i as f64, Permission::All, i));
    }
    let seen = last.unwrap();
    let iou = iou(&seen.costs.unwrap());
    assert!(iou > 0.95, "intersection over union {iou}");
    assert_eq!(engine.models.ground.len(), 1);
    assert_eq!(seen.learned, Some(Learned::Updated(0)));
    assert!(seen.counts.unclassified < 50, "{:?}", seen.counts);
}

#[test]
fn path_in_the_first_background_samples_does_not_stay_background() {
    // Down to 50 pixels below the horizon the first background sample also contains path; classification must be right
    // from the first image on.
    let mut engine = Engine::default();
    let seen = see(&mut engine, &paint(MULCH, false, 1), 0.0, Permission::All, 1);
    let iou = iou(&seen.costs.unwrap());
    assert!(iou > 0.9, "intersection over union {iou}");
}

#[test]
fn after_a_gap_the_background_is_sampled_where_the_last_image_called_it_so() {
    let mut engine = Engine::default();
    see(&mut engine, &paint(MULCH, false, 1), 0.0, Permission::All, 1);
    // What was grass beside the path, below the first samples, has another colour now.
    let mut data = paint(MULCH, false, 2);
    for pixel in (150..SIZE[1]).flat_map(|row| (0..40).map(move |column| row * SIZE[0] + column)) {
        data[3 * pixel..3 * pixel + 3].copy_from_slice(&FENCE);
    }
    see(&mut engine, &data, 1.2, Permission::All, 2);
    let background = engine.models.background.unwrap();
    assert!(background.histogram.counts()[bin(FENCE[0], FENCE[1])] > 0.0);
}

#[test]
fn ground_of_another_colour_becomes_a_second_model_and_the_first_is_remembered() {
    let mut engine = Engine::default();
    let mut time_s = 0.0;
    let mut drive = |engine: &mut Engine, path: [u8; 3], images: u64| {
        let mut last = None;
        for i in 0..images {
            time_s += 0.2;
            last = Some(see(engine, &paint(path, false, i), time_s, Permission::All, i));
        }
        last.unwrap()
    };
    drive(&mut engine, MULCH, 10);
    let seen = drive(&mut engine, LIME, 15);
    assert_eq!(engine.models.ground.len(), 2);
    let lime = iou(&seen.costs.unwrap());
    assert!(lime > 0.9, "lime {lime}");
    let seen = drive(&mut engine, MULCH, 4);
    let mulch = iou(&seen.costs.unwrap());
    assert!(mulch > 0.9 && engine.models.ground.len() == 2, "mulch again {mulch}");
}

#[test]
fn an_orange_fence_is_an_obstacle_by_an_a_priori_model_and_unclassified_without() {
    let fence_cost = |models: Models| {
        let mut engine = Engine::new(models);
        // The fence comes into view where the path was.
        see(&mut engine, &paint(MULCH, false, 1), 0.0, Permission::All, 1);
        let seen = see(&mut engine, &paint(MULCH, true, 2), 0.2, Permission::FirstGround, 2);
        let costs = seen.costs.unwrap();
        let mut of_fence: Vec<u8> = (0..PIXELS)
            .filter(|i| is_fence((i % WIDTH) * 5 / 2 + 1, (i / WIDTH) * 5 / 2 + 1))
            .map(|i| costs[i])
            .collect();
        of_fence.sort_unstable();
        of_fence
    };
    let mut orange = Histogram::default();
    for (red, green) in (150..=255_u8).flat_map(|red| (60..160_u8).map(move |green| (red, green))) {
        if f64::from(green) < 0.6 * f64::from(red) && f64::from(green) > 0.35 * f64::from(red) {
            orange.add(red, green);
        }
    }
    let model = Model {
        name: "orange fence".to_owned(),
        histogram: orange.scaled(4000.0),
        uses: 1,
        updated: Stamp(0),
        sample: None,
    };
    let without = fence_cost(Models::default());
    assert!(count(&without).unclassified as usize * 100 > without.len() * 90, "{without:?}");
    let with = fence_cost(Models { obstacles: vec![model], ..Models::default() });
    // Obstacles count at once, although one of the two fused images shows path there.
    assert!(with.iter().all(|&cost| (125..=250).contains(&cost)), "{with:?}");
}

#[test]
fn nothing_is_learned_that_is_not_allowed() {
    let learned = |permission: Permission| {
        let mut engine = Engine::default();
        see(&mut engine, &paint(MULCH, false, 1), 0.0, Permission::All, 1);
        let before = engine.models.clone();
        let seen = see(&mut engine, &paint(MULCH, false, 2), 0.2, permission, 2);
        assert!(seen.costs.is_some(), "it classifies in any case");
        (engine.models.ground != before.ground, engine.models.background != before.background)
    };
    assert_eq!(learned(Permission::All), (true, true));
    assert_eq!(learned(Permission::FirstGround), (false, true));
    assert_eq!(learned(Permission::Background), (false, true));
    assert_eq!(learned(Permission::Nothing), (false, false));
    let mut engine = Engine::default();
    let seen = see(&mut engine, &paint(MULCH, false, 1), 0.0, Permission::Background, 1);
    assert!(seen.costs.is_none(), "without a ground model there is nothing to say");
    let seen = see(&mut engine, &paint(MULCH, false, 2), 0.2, Permission::FirstGround, 2);
    assert_eq!(seen.learned, Some(Learned::Added));
}

#[test]
fn the_same_images_and_seeds_give_the_same_bits() {
    let run = || {
        let mut engine = Engine::default();
        let seen: Vec<Seen> = (0..5)
            .map(|i| see(&mut engine, &paint(MULCH, false, i), 0.2 * i as f64, Permission::All, i))
            .collect();
        (engine, seen)
    };
    assert_eq!(run(), run());
}
