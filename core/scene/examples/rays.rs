//! Measures how long a world takes to load, and a ray to cast.
//!
//! ```text
//! rays WORLD.toml…
//! ```

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use rcs_geom::{DVec2, DVec3, Distortion, PinholeCamera, Pose};
use rcs_scene::{CameraRays, ViewRows, World, render_rows};

/// Rows drawn at a time.
const STRIP: usize = 8;

/// Least time of several runs, seconds: the one that other work on the machine disturbed least.
fn least(runs: u32, mut work: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    };
    (0..runs).map(time).fold(f64::INFINITY, f64::min)
}

#[expect(clippy::print_stdout, reason = "an example tells what it measured")]
fn main() -> Result<(), Box<dyn Error>> {
    for path in std::env::args().skip(1) {
        let text = std::fs::read_to_string(&path)?;
        let world = World::from_toml(&text)?;
        let load = least(3, || drop(black_box(World::from_toml(&text))));
        let (width, height) = (320, 240);
        let f = 0.5 * f64::from(width) / libm::tan(35_f64.to_radians());
        let lens = Distortion::from_model("plumb_bob", &[-0.2, 0.05, 0.0, 0.0, 0.0])?;
        let camera = PinholeCamera::new([width, height], [f, f], [159.5, 119.5], lens)?;
        let rays = CameraRays::new(&camera);
        let pixels = (width * height) as usize;
        let (mut rgb, mut depth_m) = (vec![0; 3 * pixels], vec![0.0; pixels]);
        let (mut class, mut label) = (vec![0; pixels], vec![0; pixels]);
        let mut per_ray = Vec::new();
        for at in [[10.0, 45.0], [40.0, 47.0], [65.0, 45.0], [90.0, 40.0]].map(DVec2::from_array) {
            for yaw in [-20_f64, 20.0] {
                let camera = at.extend(world.height_m(at) + 0.9);
                let body = Pose::from_rpy(camera, 0.0, 10_f64.to_radians(), yaw.to_radians());
                let pose = body * Pose::body_from_optical();
                // Strip by strip, so that other work on the machine disturbs few strips of every run.
                let time: f64 = (0..height as usize / STRIP)
                    .map(|strip| {
                        let rows = strip * STRIP..(strip + 1) * STRIP;
                        least(20, || {
                            let (rgb, depth_m) = (&mut rgb[..], &mut depth_m[..]);
                            let mut out = ViewRows { rgb, depth_m, class: &mut class, label: &mut label };
                            render_rows(&world, &rays, &pose, 1.0, rows.clone(), &mut out);
                        })
                    })
                    .sum();
                per_ray.push(time / pixels as f64 * 1e9);
            }
        }
        let mean = per_ray.iter().sum::<f64>() / per_ray.len() as f64;
        let worst = per_ray.iter().copied().fold(0.0, f64::max);
        let camera = DVec3::new(20.0, 45.0, world.height_m(DVec2::new(20.0, 45.0)) + 1.2);
        let scan = |down: f64| {
            for beam in 0..360 {
                let angle = f64::from(beam).to_radians();
                black_box(world.cast(camera, DVec3::new(libm::cos(angle), libm::sin(angle), down), 60.0));
            }
        };
        let ladar = (0..20).map(|scans| least(10, || scan(-0.01 * f64::from(scans)))).sum::<f64>() / 7200.0;
        let name = world.name();
        println!(
            "{name}: load {:.0} ms, {} things, camera ray {mean:.0} ns mean, {worst:.0} ns in the worst view, ladar ray {:.0} ns",
            load * 1e3,
            world.things().len(),
            ladar * 1e9
        );
    }
    Ok(())
}
