//! The column scan: a depth image of a road with posts, labelled and converted to votes for cells.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DMat3, DVec3};
use rcs_geom::{Distortion, PinholeCamera};
use rcs_obstacles::columns::{GroundPlane, Placement, Survey};
use rcs_obstacles::depth_image::{DepthImage, Rays, label_image, scan_strip};
use rcs_obstacles::scan::ScanParams;

/// Height of the camera above the road, m.
const HEIGHT_M: f64 = 1.5;
const SCALE_M: f64 = 0.001;

/// Depth in units of [`SCALE_M`]: a level road up to 30 m, and posts two metres high at eight metres.
fn depth_image(width: usize, height: usize, focal_px: f64) -> Vec<u8> {
    let pixel = |at: usize| {
        let (row, column) = (at / width, at % width);
        let below_horizon = (row as f64 - height as f64 / 2.0) / focal_px;
        let road_m = if below_horizon > 0.0 { HEIGHT_M / below_horizon } else { f64::INFINITY };
        let is_post = column % 160 < 12 && below_horizon > -0.06;
        let depth_m = if is_post { road_m.min(8.0) } else { road_m };
        if depth_m <= 30.0 { (depth_m / SCALE_M) as u16 } else { 0 }
    };
    (0..width * height).flat_map(|at| pixel(at).to_le_bytes()).collect()
}

fn column_scan(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("obstacles/column_scan");
    for (width, height) in [(640, 480), (1280, 720)] {
        let focal_px = width as f64 * 0.8;
        let centre_px = [width as f64 / 2.0, height as f64 / 2.0];
        let size = [width as u32, height as u32];
        let camera = PinholeCamera::new(size, [focal_px; 2], centre_px, Distortion::None);
        let rays = Rays::new(&camera.expect("a sound camera"));
        let data = depth_image(width, height, focal_px);
        let image = DepthImage::new([width, height], width * 2, "16UC1", SCALE_M as f32, &data);
        let image = image.expect("a sound image");
        // Optical axes (right, down, forward) in the local frame (forward, left, up).
        let local_from_optical = DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X);
        let ground_plane =
            GroundPlane { below_origin: DVec3::new(0.0, 0.0, -HEIGHT_M), up: DVec3::Z, wheels_m: 0.4 };
        let placement = Placement { sensor: DVec3::new(0.0, 0.0, HEIGHT_M), cell_size_m: 0.2 };
        let survey =
            Survey { ground_plane, placement, scan: ScanParams::default(), negative: None, known: None };

        group.throughput(Throughput::Elements((width * height) as u64));
        group.bench_function(format!("{width}x{height}"), |bench| {
            bench.iter(|| {
                let strip = |at| scan_strip(&image, &[], &rays, at, local_from_optical, &survey);
                let strips: Vec<_> = (0..rays.strips()).map(strip).collect();
                label_image(&strips, &image)
            });
        });
    }
    group.finish();
}

criterion_group!(benches, column_scan);
criterion_main!(benches);
