use super::*;
use rcs_geom::Distortion;

const SIZE: [usize; 2] = [320, 240];

fn pinhole() -> PinholeCamera {
    let [width, height] = SIZE.map(|side| side as u32);
    PinholeCamera::new([width, height], [228.0; 2], [159.5, 119.5], Distortion::None).unwrap()
}

/// 0.95 m above the ground, 13° down and 24° to the left.
fn mount() -> Pose {
    let [pitch, yaw] = [13.0_f64, 24.0].map(f64::to_radians);
    Pose::from_rpy(DVec3::new(0.1, 0.15, 0.95), 0.0, pitch, yaw) * Pose::body_from_optical()
}

fn camera() -> Mounted {
    Mounted::new(&pinhole(), mount()).unwrap()
}

/// Patches of a few centimetres, from a hash of their place.
fn patches(at: DVec2) -> f64 {
    let level = |x: f64, y: f64| {
        let mut hash =
            (x as i64 as u32).wrapping_mul(0x9E37_79B1) ^ (y as i64 as u32).wrapping_mul(0x85EB_CA77);
        hash = (hash ^ (hash >> 15)).wrapping_mul(0x2C1B_3C6D);
        f64::from((hash >> 8) & 255)
    };
    let at = at / 0.04;
    let (cell, part) = (at.floor(), at - at.floor());
    let row = |y: f64| level(cell.x, y) * (1.0 - part.x) + level(cell.x + 1.0, y) * part.x;
    row(cell.y) * (1.0 - part.y) + row(cell.y + 1.0) * part.y
}

/// Image and depth of flat ground with this look, from a vehicle in a pose; `light` is the exposure.
fn view(paint: impl Fn(DVec2) -> f64, ground_from_vehicle: &Pose, light: f64) -> (Grey, Vec<f32>) {
    let (camera, ground_from_camera) = (pinhole(), *ground_from_vehicle * mount());
    let (mut rgb, mut depth_m) = (Vec::new(), Vec::new());
    for row in 0..SIZE[1] {
        for column in 0..SIZE[0] {
            let ray = camera.unproject(DVec2::new(column as f64, row as f64)).unwrap();
            let direction = ground_from_camera.rotate(ray);
            let depth =
                if direction.z < 0.0 { -ground_from_camera.translation.z / direction.z } else { f64::NAN };
            let at = ground_from_camera.translation + direction * depth;
            let level = if depth.is_nan() { 200.0 } else { paint(at.truncate()) };
            rgb.extend([(light * level).clamp(0.0, 255.0) as u8; 3]);
            depth_m.push(depth as f32);
        }
    }
    (Grey::of(&rgb, SIZE[0], SIZE[1]), depth_m)
}

/// The motion that is found between two poses of the vehicle.
fn found(paint: impl Fn(DVec2) -> f64, from: &Pose, to: &Pose, light: f64) -> Option<Motion> {
    let (before, depth_m) = view(&paint, from, 1.0);
    let (after, _) = view(&paint, to, light);
    let points = points(&before, &depth_m, &camera(), 4.0);
    let turn = to.rotation_matrix().transpose() * from.rotation_matrix();
    motion(&points, &after, &camera(), turn, [-0.15, 0.3])
}

#[test]
fn the_way_is_found_within_a_hundredth_of_a_metre_ahead_and_back_turning_and_in_other_light() {
    let start = Pose::from_xy_yaw(3.2, -1.3, 0.7);
    for (forward_m, left_m, turn_rad, light) in [
        (0.0, 0.0, 0.0, 1.0),
        (0.137, 0.0, 0.0, 1.0),
        (0.26, 0.0, 0.0, 0.8),
        (0.2, 0.02, 0.15, 1.0),
        (-0.1, 0.0, 0.0, 1.2),
        (0.01, 0.0, -0.2, 0.9),
    ] {
        let to = start * Pose::from_xy_yaw(forward_m, left_m, turn_rad);
        let motion = found(patches, &start, &to, light).unwrap();
        assert!((motion.forward_m - forward_m).abs() < 0.01, "{forward_m} m: {motion:?}");
        assert!((motion.left_m - left_m).abs() < 0.01 + STEP_M / 2.0, "{left_m} m: {motion:?}");
        assert!(motion.likeness > 0.8, "{motion:?}");
    }
}

#[test]
fn ground_without_texture_or_with_a_pattern_that_repeats_itself_tells_nothing() {
    let start = Pose::IDENTITY;
    let to = Pose::from_xy_yaw(0.1, 0.0, 0.0);
    assert_eq!(found(|_| 90.0, &start, &to, 1.0), None, "no texture");
    let stripes = |at: DVec2| if (at.x / 0.06).rem_euclid(2.0) < 1.0 { 60.0 } else { 180.0 };
    assert_eq!(found(stripes, &start, &to, 1.0), None, "stripes 0.12 m apart");
    let beyond = Pose::from_xy_yaw(0.5, 0.0, 0.0);
    let motion = found(patches, &start, &beyond, 1.0);
    assert!(motion.is_none_or(|motion| motion.likeness < 0.8), "faster than what is tried: {motion:?}");
}

#[test]
fn without_depth_there_are_no_points() {
    let (grey, depth_m) = view(patches, &Pose::IDENTITY, 1.0);
    let none = vec![f32::NAN; depth_m.len()];
    assert!(points(&grey, &none, &camera(), 4.0).is_empty());
    let near = points(&grey, &depth_m, &camera(), 2.0);
    assert!(!near.is_empty() && near.iter().all(|point| f64::from(point.at[0]) < 2.3));
    let far = points(&grey, &depth_m, &camera(), 4.0);
    assert!(far.len() > near.len() && far.len() <= 2 * POINTS);
    let turn = DMat3::IDENTITY;
    assert_eq!(motion(&near[..LEAST_POINTS - 1], &grey, &camera(), turn, [-0.1, 0.1]), None);
}

#[test]
fn a_lens_that_distorts_is_none_of_a_rectified_image() {
    let lens = |k1: f64| Distortion::PlumbBob([k1, 0.0, 0.0, 0.0, 0.0]);
    let of = |k1: f64| PinholeCamera::new([320, 240], [228.0; 2], [159.5, 119.5], lens(k1)).unwrap();
    assert!(Mounted::new(&of(0.0), mount()).is_some() && Mounted::new(&of(-0.16), mount()).is_none());
}
