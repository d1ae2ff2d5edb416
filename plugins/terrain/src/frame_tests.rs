//! Assignment of pixels to cells, compared with a reference implementation.

use super::*;
use crate::scene::{Scene, vehicle_from_camera};
use proptest::prelude::*;
use rcs_sense::CELL_SIZE_M;
use std::collections::BTreeMap;

/// Reference for every pixel: its point in the local frame, its cell, its code.
fn reference_gather(
    scene: &Scene,
    window: &Window,
    max_range_m: f32,
    ratios: &RatioBins,
) -> (BTreeMap<u32, Terrain>, Vec<u8>) {
    let [width, height] = scene.size;
    let camera = crate::scene::camera([width as u32, height as u32]);
    let codes = PixelCodes::of_rows(&scene.rgb, &scene.grey, 0..height, ratios);
    let local_from_camera = scene.local_from_vehicle * vehicle_from_camera();
    let (mut cells, mut used) = (BTreeMap::<u32, Terrain>::new(), vec![0; width * height]);
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            let depth = scene.depth_m[i];
            let is_labelled = [GROUND, OBSTACLE].contains(&scene.labels[i]);
            if !is_labelled || !depth.is_finite() || depth <= 0.0 || depth > max_range_m {
                continue;
            }
            let ray = camera.unproject(DVec2::new(x as f64, y as f64)).unwrap();
            let point = local_from_camera * (ray * f64::from(depth));
            let cell = ((point.truncate() - window.corner_m) / CELL_SIZE_M).floor();
            if cell.min_element() < 0.0 || cell.max_element() >= window.side as f64 {
                continue;
            }
            let terrain = cells.entry((cell.y as usize * window.side + cell.x as usize) as u32).or_default();
            terrain.histograms.add(codes.codes[i], codes.contrasts[i]);
            let height_mm = (point.z * 1000.0) as i32;
            let obstacle_top_mm = (scene.labels[i] == OBSTACLE).then_some(height_mm);
            let heights = Heights { lowest_mm: Some(height_mm), obstacle_top_mm };
            terrain.merge(&Terrain { heights, ..Terrain::default() });
            match scene.labels[i] {
                GROUND => terrain.ground += 1,
                _ => terrain.obstacle += 1,
            }
            used[i] = scene.labels[i];
        }
    }
    (cells, used)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn points_are_sorted_into_the_cells_of_the_definition(
        x in -50.0..50.0_f64, y in -50.0..50.0_f64, yaw in -3.0..3.0_f64, roll in -0.2..0.2_f64, wall in 2.0..15.0_f64,
        max_range_m in 3.0..30.0_f32, seed: u64,
    ) {
        let pose = Pose::from_rpy(DVec3::new(x, y, 0.3), roll, 0.05, yaw);
        let mut scene = Scene::new([60, 70], pose, wall, 2.0, seed);
        // Some pixels without a range or with another label.
        for i in 0..scene.labels.len() {
            match crate::scene::noise(i, 1, seed) % 10 {
                0 => scene.depth_m[i] = f32::NAN,
                1 => scene.depth_m[i] = 0.0,
                2 => scene.labels[i] = (i % 6) as u8,
                _ => {}
            }
        }
        // A window that does not contain the whole view.
        let window = Window { corner_m: DVec2::new(x - 8.0, y - 8.0), cell_size_m: CELL_SIZE_M, side: 80 };
        let ratios = RatioBins::new(1.0);
        let strips: Vec<_> = (0..strips(70))
            .map(|strip| gather(&scene.frame(), strip, &window, max_range_m, &ratios))
            .collect();
        let (cells, used) = reference_gather(&scene, &window, max_range_m, &ratios);
        prop_assert_eq!(strips.iter().flat_map(|s| s.used.clone()).collect::<Vec<_>>(), used);
        let joined = join(&strips, window.side);
        // The order in which the terms of a height are summed may change its last bit, and so its millimetre.
        let near = |[a, b]: [Option<i32>; 2]| a.zip(b).map_or(a == b, |(a, b)| a.abs_diff(b) <= 1);
        for ((_, terrain), expected) in joined.iter().zip(cells.values()) {
            let (found, expected) = (terrain.heights, expected.heights);
            prop_assert!(near([found.lowest_mm, expected.lowest_mm]));
            prop_assert!(near([found.obstacle_top_mm, expected.obstacle_top_mm]));
        }
        let flat = |(place, terrain): (u32, Terrain)| (place, Terrain { heights: Heights::default(), ..terrain });
        let [joined, cells]: [Vec<_>; 2] =
            [joined.into_iter().map(flat).collect(), cells.into_iter().map(flat).collect()];
        prop_assert_eq!(joined, cells);
    }
}

#[test]
fn frames_without_labelled_points_say_nothing() {
    let mut scene = Scene::new([64, 48], Pose::IDENTITY, 5.0, 2.0, 1);
    scene.labels.fill(4);
    let window = Window { corner_m: DVec2::splat(-20.0), cell_size_m: CELL_SIZE_M, side: 201 };
    let gathered = gather(&scene.frame(), 1, &window, 10.0, &RatioBins::new(1.0));
    assert!(gathered.cells.is_empty());
    assert_eq!(gathered.used, [0; 64 * 16]);
}

#[test]
fn a_distant_depth_has_no_cell() {
    let mut scene = Scene::new([64, 48], Pose::IDENTITY, 5.0, 2.0, 1);
    scene.depth_m[64 * 47] = 1e12;
    let window = Window { corner_m: DVec2::splat(-20.0), cell_size_m: CELL_SIZE_M, side: 201 };
    let gathered = gather(&scene.frame(), 1, &window, 10.0, &RatioBins::new(1.0));
    assert_eq!(gathered.used[64 * 15], 0);
    let rays = scene.frame().rays;
    // The first pixel of the strip's last row, as if it had been used.
    let used: Vec<u8> = (0..64 * 48).map(|i| u8::from(i == 64 * 47)).collect();
    let strip = Gathered { cells: Vec::new(), used };
    let from_camera = scene.frame().local_from_camera;
    let found = spots(rays, &scene.depth_m, &from_camera, &window, &[strip], &[0]);
    assert!(found.iter().all(Option::is_none), "{found:?}");
}
