//! Measures terrain learning and classification on one thread: `cargo run --release -p rcs-terrain --example
//! terrain_speed`. The image is 640×480; every pixel is labelled ground or obstacle and has a range.
#![allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "an example that measures time and says it"
)]

use glam::{DVec2, DVec3};
use rcs_geom::{PinholeCamera, Pose};
use rcs_terrain::appearance::{MatchWeights, RatioBins};
use rcs_terrain::classify::{Matcher, WindowGrid, classify_row};
use rcs_terrain::frame::{LabelledFrame, Rays, gather, join, strips};
use rcs_terrain::map::TerrainMap;
use rcs_terrain::models::{ModelRules, ModelSet};
use rcs_terrain::place::{View, Windows, place, region};
use rcs_terrain::texture::PaddedGrey;
use std::time::Instant;

const SIZE: [usize; 2] = [640, 480];

fn median(name: &str, mut work: impl FnMut()) {
    let mut times: Vec<f64> = (0..31)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("{name:<32} {:7.2} ms median, {:7.2} ms best", times[times.len() / 2], times[0]);
}

/// Twenty-five patches of different colours, which give many models.
fn image(seed: u32) -> Vec<u8> {
    let mut state = seed;
    let mut rgb = Vec::with_capacity(SIZE[0] * SIZE[1] * 3);
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let patch = (x / 128 + y / 96 * 5) as u32;
            let noise = state >> 27;
            rgb.extend(
                [40 + patch * 53 % 150, 40 + patch * 91 % 150, 40 + patch * 29 % 150]
                    .map(|v| (v + noise) as u8),
            );
        }
    }
    rgb
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [width, height] = SIZE;
    let camera = PinholeCamera::from_horizontal_fov([width as u32, height as u32], 1.2)?;
    let vehicle_from_camera =
        Pose::from_rpy(DVec3::new(0.0, 0.0, 1.0), 0.0, 0.5, 0.0) * Pose::body_from_optical();
    let rgb = image(1);
    let rays = Rays::new(&camera);
    // A plane that rises ahead fills the image with ranges; its upper half is labelled obstacle.
    let depth_m: Vec<f32> = (0..width * height)
        .map(|i| {
            let ray = camera.unproject(DVec2::new((i % width) as f64, (i / width) as f64));
            let down = ray.map_or(0.0, |ray| -vehicle_from_camera.rotate(ray).z);
            (1.0 / down.max(0.1)) as f32
        })
        .collect();
    let labels: Vec<u8> = (0..width * height).map(|i| if i < width * height / 2 { 2 } else { 1 }).collect();
    let weights = MatchWeights { histograms: [1.0; 5], contrast: 1.0 }.normalised();
    let rules = ModelRules {
        min_points: 100,
        min_purity: 0.95,
        merge_distance: 0.02,
        max_models: 64,
        near_m: 4.0,
        weights,
    };
    let ratios = RatioBins::new(1.0);
    let mut map = TerrainMap::new(ModelSet::default())?;
    median("learning from a frame", || {
        let grey = PaddedGrey::from_rgb(&rgb, width, height);
        let frame = LabelledFrame {
            rgb: &rgb,
            grey: &grey,
            labels: &labels,
            depth_m: &depth_m,
            rays: &rays,
            local_from_camera: vehicle_from_camera,
        };
        let window = map.window();
        let gathered: Vec<_> =
            (0..strips(height)).map(|strip| gather(&frame, strip, &window, 30.0, &ratios)).collect();
        map.learn(&join(&gathered, window.side), &rules);
    });
    let points: u64 = map.models.models.iter().map(|model| model.terrain.points()).sum::<u64>() / 31;
    println!(
        "  {} models, {:?} cells, {points} points of models a frame",
        map.models.models.len(),
        map.counts()
    );

    let local_from_vehicle = Pose::IDENTITY;
    let view = View { camera: &camera, vehicle_from_camera, local_from_vehicle, wheels_below_m: 0.0 };
    let grid = WindowGrid::new(SIZE, 16);
    let matcher = Matcher::new(&map.models, weights, 0.2, 0, 0.5);
    median("classifying a whole image", || {
        let wanted = region(&view, &grid, 1.0, None);
        let grey = PaddedGrey::from_rgb(&rgb, width, height);
        let classes: Vec<_> = (0..grid.rows())
            .map(|row| {
                let wanted = &wanted[row * grid.columns()..][..grid.columns()];
                classify_row(&rgb, &grey, &ratios, &grid, row, wanted, &matcher)
            })
            .collect();
        let classes = classes.concat();
        let windows = Windows { grid: &grid, classes: &classes, stereo_end: None };
        place(&view, &windows, 20.0);
    });
    Ok(())
}
