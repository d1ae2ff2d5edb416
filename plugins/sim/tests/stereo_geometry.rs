//! Geometry of a stereo pair: the rendered images agree with the calibration.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;

use common::bench::WORLD;
use common::lagr;
use glam::{DVec2, DVec3};
use rcs_geom::{PinholeCamera, Pose};
use rcs_scene::{CameraRays, Class, ViewRows, World, render_rows};
use rcs_sim::spec::CameraSpec;

struct View {
    depth_m: Vec<f32>,
    class: Vec<u8>,
    rgb: Vec<u8>,
}

fn draw(world: &World, lens: &PinholeCamera, global_from_camera: &Pose) -> View {
    let pixels = (lens.width * lens.height) as usize;
    let mut view = View { depth_m: vec![f32::NAN; pixels], class: vec![0; pixels], rgb: vec![0; 3 * pixels] };
    let mut label = vec![0; pixels];
    let mut out = ViewRows {
        rgb: &mut view.rgb,
        depth_m: &mut view.depth_m,
        class: &mut view.class,
        label: &mut label,
    };
    render_rows(world, &CameraRays::new(lens), global_from_camera, 1.0, 0..lens.height as usize, &mut out);
    view
}

fn pair() -> (World, CameraSpec, [Pose; 2]) {
    let world = World::from_toml(WORLD).unwrap();
    let spec = lagr().camera("front_left").unwrap().clone();
    let at = DVec2::new(5.0, 13.0);
    let global_from_vehicle = Pose::from_rpy(at.extend(world.height_m(at)), 0.02, -0.03, -0.2);
    let poses = [0, 1].map(|side| global_from_vehicle * spec.vehicle_from_camera(side));
    (world, spec, poses)
}

/// Pixels of the left view and the points that they show: column, row, point in the left camera's frame.
fn points<'a>(lens: &'a PinholeCamera, view: &'a View) -> impl Iterator<Item = (DVec2, DVec3)> + 'a {
    view.depth_m.iter().enumerate().filter(|(_, depth)| depth.is_finite()).map(|(at, &depth)| {
        let pixel = DVec2::new((at % lens.width as usize) as f64, (at / lens.width as usize) as f64);
        (pixel, lens.unproject(pixel).unwrap() * f64::from(depth))
    })
}

#[test]
fn depth_from_true_disparity_is_true_depth_within_rounding() {
    let (world, spec, poses) = pair();
    let view = draw(&world, &spec.lens, &poses[0]);
    let right_from_left = poses[1].inverse() * poses[0];
    let PinholeCamera { fx, fy, cx, cy, .. } = spec.lens;
    let rectified = |p: DVec3| DVec2::new(fx * p.x / p.z + cx, fy * p.y / p.z + cy);
    let mut count = 0;
    for (_, p_left) in points(&spec.lens, &view) {
        let [left, right] = [rectified(p_left), rectified(right_from_left * p_left)];
        assert!((left.y - right.y).abs() < 1e-9, "rows of a rectified pair are the same");
        let depth_m = fx * spec.baseline_m / (left.x - right.x);
        assert!((depth_m / p_left.z - 1.0).abs() < 1e-9, "got {depth_m} m, expected {} m", p_left.z);
        count += 1;
    }
    assert!(count > 30_000, "{count} pixels have a depth");
}

#[test]
fn a_point_that_both_cameras_see_has_the_same_place_and_class_in_both() {
    let (world, spec, poses) = pair();
    let lens = &spec.lens;
    let [left, right] = poses.map(|pose| draw(&world, lens, &pose));
    let right_from_left = poses[1].inverse() * poses[0];
    let (mut seen, mut agree, mut hidden) = (0, 0, 0);
    for (pixel, p_left) in points(lens, &left) {
        let p_right = right_from_left * p_left;
        let Some(place) = lens.project(p_right).filter(|place| lens.contains(*place)) else { continue };
        let [u, v] = [place.x.round() as usize, place.y.round() as usize];
        let at = v * lens.width as usize + u;
        let depth_m = f64::from(right.depth_m[at]);
        if p_left.z > 15.0 {
            continue;
        }
        seen += 1;
        // Far ahead, half a pixel of level ground covers a long distance.
        let tolerance = 0.02 + 0.01 * p_left.z * p_left.z;
        if (depth_m - p_right.z).abs() < tolerance {
            let own = left.class[pixel.y as usize * lens.width as usize + pixel.x as usize];
            agree += usize::from(own == right.class[at]);
        } else if depth_m < p_right.z {
            hidden += 1;
        }
    }
    assert!(seen > 20_000, "{seen}");
    assert!(hidden < seen / 20, "{hidden} of {seen} are hidden from the other camera");
    assert!(agree + hidden > seen * 97 / 100, "{agree} of {seen} agree, {hidden} are hidden");
}

#[test]
fn cameras_look_where_the_vehicle_file_says() {
    let spec = lagr();
    for (name, side) in [("front_left", 1.0), ("front_right", -1.0)] {
        let camera = spec.camera(name).unwrap();
        let [left, right] = [0, 1].map(|side| camera.vehicle_from_camera(side));
        let view = left.rotate(DVec3::Z);
        let yaw_deg = libm::atan2(view.y, view.x).to_degrees();
        assert!((20.0..=25.0).contains(&(side * yaw_deg)), "{name} looks {yaw_deg}° to the left");
        assert!((libm::asin(-view.z).to_degrees() - 13.0).abs() < 1e-9, "it looks down by 13°");
        let baseline = left.inverse() * right.translation;
        assert!(baseline.abs_diff_eq(DVec3::new(0.12, 0.0, 0.0), 1e-12), "{baseline}");
        let half_view = libm::atan(0.5 * 320.0 / camera.lens.fx).to_degrees();
        assert!((half_view - 35.0).abs() < 1e-9);
    }
}

#[test]
fn the_ground_ahead_and_the_sky_are_in_the_image_and_it_has_texture_to_match() {
    let (world, spec, poses) = pair();
    let view = draw(&world, &spec.lens, &poses[0]);
    let share = |class: Class| {
        view.class.iter().map(|&code| f64::from(u8::from(code == class.code()))).sum::<f64>()
            / view.class.len() as f64
    };
    assert!(
        share(Class::Dirt) > 0.4 && share(Class::Sky) > 0.02,
        "{} {}",
        share(Class::Dirt),
        share(Class::Sky)
    );
    // Only pixels of the ground: their grey levels differ from their neighbours'.
    let grey = |at: usize| i32::from(view.rgb[3 * at + 1]);
    let ground: Vec<usize> =
        (0..view.class.len() - 1).filter(|&at| view.class[at] == Class::Dirt.code()).collect();
    let steps = ground.iter().map(|&at| f64::from((grey(at + 1) - grey(at)).abs())).sum::<f64>();
    assert!(steps / ground.len() as f64 > 3.0, "mean step {}", steps / ground.len() as f64);
}
