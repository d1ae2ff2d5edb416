//! The complete colour model on one image, as its process runs it: learning, classification, both cost maps; without
//! and with a known obstacle.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use rcs_color::cost_map::{CameraPlacement, CostMap, Ground, Standing};
use rcs_color::engine::{Engine, Permission, Samples};
use rcs_color::file::parse;
use rcs_color::image::Image;
use rcs_color::models::{Models, Settings};
use rcs_color::region::{Rectangle, first_background, rays, spans};
use rcs_color::upright::Shape;
use rcs_geom::{Distortion, PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_sense::fingerprint;

const SIZE: [usize; 2] = [640, 480];
/// Images arrive five times per second.
const PERIOD_NS: u64 = 200_000_000;

/// A path in grass under a sky, with noise in every pixel.
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
            data.extend([0, 1, 2].map(|i| (base[i] + (noise >> (8 * i)) % 30) as u8));
        }
    }
    data
}

fn color_models(criterion: &mut Criterion) {
    let lens = Distortion::from_model("plumb_bob", &[-0.2, 0.03, 0.0, 0.0, 0.0]).expect("a lens");
    let camera = PinholeCamera::new([640, 480], [400.0; 2], [320.0, 240.0], lens).expect("a sound camera");
    let mount =
        Pose::from_rpy(DVec3::new(0.0, 0.0, 1.0), 0.0, 20_f64.to_radians(), 0.0) * Pose::body_from_optical();
    let rectangle = Rectangle { ahead_m: 0.6, length_m: 2.0, width_m: 1.0, below_m: 0.0 };
    let rays = rays(&camera);
    let images: Vec<Vec<u8>> = (0..8).map(scene).collect();
    let settings = Settings::default();
    let fence = parse(include_str!("../assets/models/orange_fence.json")).expect("sound models");
    let shape = Shape { height_m: 0.95, least_share: 0.6, span_m: 2.5 };

    let mut group = criterion.benchmark_group("color/whole_model");
    group.throughput(Throughput::Elements((SIZE[0] * SIZE[1]) as u64));
    for (name, models) in [("640x480", Models::default()), ("640x480_known_fence", fence)] {
        let mut engine = Engine::new(Models::default().with(&models, settings.samples));
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut at = 0_u64;
        group.bench_function(name, |bench| {
            bench.iter(|| {
                at += 1;
                let data = &images[at as usize % images.len()];
                let print = fingerprint(data);
                // The process copies the image out of its message.
                let rgb = data.clone();
                let spans = spans(&rectangle.outline(&camera, &mount), SIZE);
                let limits = first_background(&rays, &mount, SIZE[1], 50);
                let samples = Samples {
                    ground: &spans,
                    frame_id: "",
                    first_background: &limits,
                    permission: Permission::All,
                };
                let image = Image::new(SIZE, 3 * SIZE[0], &rgb).expect("a sound image");
                let time = Stamp(at * PERIOD_NS);
                let seen = engine.see(&image, &samples, time, &settings, &mut rng);
                let place = CameraPlacement {
                    camera: &camera,
                    rays: &rays,
                    vehicle_from_camera: &mount,
                    local_from_vehicle: &Pose::from_xy_yaw(0.2 * at as f64, 0.0, 0.0),
                    below_m: 0.0,
                    tilt_noise_rad: 0.005,
                };
                let costs = seen.costs.expect("there is ground in the image");
                let known = seen.known.as_ref().map(|known| Standing { known, shape, screens: None });
                let ground = Ground::new(&costs, &seen.models, known.as_ref(), place);
                (print, CostMap::new(&ground, 0.2, 12.0).to_grid("local", time))
            })
        });
    }
    group.finish();
}

criterion_group!(benches, color_models);
criterion_main!(benches);
