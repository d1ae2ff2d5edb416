//! Times the whole colour model on a 640×480 picture on one thread, as the process runs it, and prints the median.
//!
//! `cargo run --release -p rcs-color --example color_speed`

#![allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "a program that measures time and prints it"
)]

use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};
use rcs_color::cost_map::{CostMap, Place};
use rcs_color::engine::{Engine, Permission, Samples};
use rcs_color::models::Settings;
use rcs_color::picture::{Picture, fingerprint};
use rcs_color::region::{Rectangle, first_background, rays, spans};
use rcs_geom::{DVec3, Distortion, PinholeCamera, Pose};
use rcs_msg::Stamp;
use std::error::Error;
use std::time::Instant;

const SIZE: [usize; 2] = [640, 480];
const RUNS: usize = 201;

/// Grass with a path, and sky; noise in every pixel.
fn scene(seed: u64) -> Vec<u8> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut data = Vec::with_capacity(SIZE[0] * SIZE[1] * 3);
    for row in 0..SIZE[1] {
        for column in 0..SIZE[0] {
            let base: [u32; 3] = match (row, column.abs_diff(320)) {
                (0..160, _) => [160, 190, 225],
                (row, aside) if aside < (row - 160) / 2 => [105, 70, 45],
                _ => [75, 110, 40],
            };
            let noise = rng.next_u32();
            data.extend([0, 8, 16].map(|shift| (base[shift / 8] + (noise >> shift) % 30) as u8));
        }
    }
    data
}

fn main() -> Result<(), Box<dyn Error>> {
    let camera = PinholeCamera::new(
        [640, 480],
        [400.0; 2],
        [320.0, 240.0],
        Distortion::from_model("plumb_bob", &[-0.2, 0.03, 0.0, 0.0, 0.0])?,
    )?;
    let mount =
        Pose::from_rpy(DVec3::new(0.0, 0.0, 1.0), 0.0, 20_f64.to_radians(), 0.0) * Pose::body_from_optical();
    let rectangle = Rectangle { ahead_m: 0.6, length_m: 2.0, width_m: 1.0, below_m: 0.0 };
    let rays = rays(&camera);
    let images: Vec<Vec<u8>> = (0..8).map(scene).collect();
    let (mut engine, settings) = (Engine::default(), Settings::default());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut times_ms, mut prints, mut cells) = (Vec::new(), 0, 0);
    for run in 0..RUNS {
        let data = &images[run % images.len()];
        let local_from_vehicle = Pose::from_xy_yaw(0.2 * run as f64, 0.0, 0.0);
        let start = Instant::now();
        prints ^= fingerprint(data);
        // The process copies the picture out of its message.
        let rgb = data.clone();
        let spans = spans(&rectangle.outline(&camera, &mount), SIZE);
        let limits = first_background(&rays, &mount, SIZE[1], 50);
        let samples = Samples { ground: &spans, first_background: &limits, permission: Permission::All };
        let picture = Picture::new(SIZE, 3 * SIZE[0], &rgb)?;
        let seen = engine.see(&picture, &samples, Stamp(run as u64 * 200_000_000), &settings, &mut rng)?;
        let costs = seen.costs.ok_or("no ground in the picture")?;
        let place = Place {
            camera: &camera,
            rays: &rays,
            vehicle_from_camera: &mount,
            local_from_vehicle: &local_from_vehicle,
            below_m: 0.0,
        };
        for (size_m, range_m) in [(0.2, 12.0), (0.6, 20.0)] {
            let map = CostMap::new(&costs, &place, size_m, range_m);
            cells += map.known()[0];
            drop(map.into_grid("local", Stamp(0)));
        }
        times_ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times_ms.sort_by(f64::total_cmp);
    let at = |part: usize| times_ms[times_ms.len() * part / 100];
    println!(
        "640x480, one thread: {:.2} ms median, {:.2} ms least, {:.2} ms at 95 %, of {RUNS}",
        at(50),
        at(0),
        at(95)
    );
    println!("({prints:x}, {} cells an image)", cells / RUNS as u32);
    Ok(())
}
