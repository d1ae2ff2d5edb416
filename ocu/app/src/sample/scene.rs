//! The world of the generated recording and its camera: flat ground with a dirt track, trees, bushes, boulders, bales.
//!
//! One ray for each pixel gives colour and depth. Everything is simple on purpose: enough that a column scan finds
//! ground and obstacles, and small enough to be written in a few seconds.

use super::drive::{Noise, State};
use glam::DVec3;
use libm::{asin, atan2, cos, floor, hypot, sin};

/// Pixels and focal length of the camera; square pixels, no distortion.
pub(super) const WIDTH: usize = 320;
pub(super) const HEIGHT: usize = 240;
pub(super) const FOCAL_PX: f64 = 230.0;
pub(super) const CENTRE_PX: [f64; 2] = [159.5, 119.5];
/// Where the camera sits on the vehicle, and how far it looks down.
pub(super) const MOUNT_M: DVec3 = DVec3::new(0.35, 0.0, 1.1);
pub(super) const MOUNT_PITCH_RAD: f64 = 0.16;
/// Farther points have no depth.
const MAX_RANGE_M: f64 = 40.0;
/// Direction towards the sun.
const SUN: DVec3 = DVec3::new(0.45, -0.4, 0.8);

#[derive(Clone, Copy, Debug)]
enum Shape {
    Sphere { centre_m: DVec3, radius_m: f64 },
    Cylinder { foot_m: DVec3, radius_m: f64, height_m: f64 },
}

#[derive(Clone, Copy, Debug)]
struct Thing {
    shape: Shape,
    colour: DVec3,
}

/// The world: things that stand on the plane z = 0, and the line that the track follows.
#[derive(Debug)]
pub(super) struct Scene {
    things: Vec<Thing>,
    /// The track's centre line: x ascending, y.
    track: Vec<[f64; 2]>,
}

/// One picture: colour as rgb8, depth along the optical axis in millimetres (0: none).
pub(super) struct Picture {
    pub(super) rgb: Vec<u8>,
    pub(super) depth_mm: Vec<u16>,
}

impl Scene {
    /// Things beside the way that the vehicle will drive.
    pub(super) fn beside(states: &[State], seed: u64) -> Self {
        let mut noise = Noise::new(seed);
        let mut track: Vec<[f64; 2]> =
            states.iter().step_by(20).map(|state| [state.position_m.x, state.position_m.y]).collect();
        track.dedup_by(|b, a| b[0] - a[0] < 1e-3);
        if let [.., a, b] = track[..] {
            // The track goes on where the drive ends.
            let slope = (b[1] - a[1]) / (b[0] - a[0]);
            track.push([b[0] + 60.0, b[1] + 60.0 * slope]);
        }
        let mut scene = Self { things: Vec::new(), track };
        for index in 0..26 {
            let x = 4.0 + 1.8 * f64::from(index) + noise.between(-0.6, 0.6);
            let side = if index % 2 == 0 { 1.0 } else { -1.0 };
            let y = scene.track_y(x) + side * noise.between(1.9, 5.5);
            scene.add(index % 5, DVec3::new(x, y, 0.0), &mut noise);
        }
        for _ in 0..40 {
            let x = noise.between(8.0, 60.0);
            let side = if noise.uniform() < 0.5 { 1.0 } else { -1.0 };
            let y = scene.track_y(x) + side * noise.between(8.0, 22.0);
            scene.add(0, DVec3::new(x, y, 0.0), &mut noise);
        }
        scene
    }

    fn add(&mut self, kind: i32, foot_m: DVec3, noise: &mut Noise) {
        let up = |height_m: f64| foot_m + DVec3::Z * height_m;
        let shade = noise.between(0.85, 1.1);
        let mut push = |shape, colour: DVec3| self.things.push(Thing { shape, colour: colour * shade });
        match kind {
            0 | 3 => {
                let (height_m, radius_m) = (noise.between(2.2, 3.0), noise.between(0.12, 0.22));
                push(Shape::Cylinder { foot_m, radius_m, height_m }, DVec3::new(0.36, 0.25, 0.17));
                let crown_m = noise.between(1.0, 1.5);
                push(
                    Shape::Sphere { centre_m: up(height_m + 0.6 * crown_m), radius_m: crown_m },
                    DVec3::new(0.16, 0.36, 0.13),
                );
            }
            1 => push(
                Shape::Sphere { centre_m: up(0.35), radius_m: noise.between(0.5, 0.8) },
                DVec3::new(0.22, 0.42, 0.16),
            ),
            2 => push(
                Shape::Sphere { centre_m: up(0.12), radius_m: noise.between(0.3, 0.5) },
                DVec3::new(0.52, 0.5, 0.47),
            ),
            _ => push(Shape::Cylinder { foot_m, radius_m: 0.7, height_m: 1.2 }, DVec3::new(0.72, 0.6, 0.3)),
        }
    }

    /// Height of the track's centre line at x, in the plane.
    fn track_y(&self, x: f64) -> f64 {
        let after = self.track.partition_point(|point| point[0] <= x);
        match (after.checked_sub(1).and_then(|before| self.track.get(before)), self.track.get(after)) {
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (x - a[0]) / (b[0] - a[0]),
            (Some(a), None) => a[1],
            (None, b) => b.map_or(0.0, |point| point[1]),
        }
    }

    /// What the camera sees from there.
    pub(super) fn picture(&self, state: &State) -> Picture {
        let (yaw, pitch) = (state.yaw_rad, state.pitch_rad + MOUNT_PITCH_RAD);
        let forward = DVec3::new(cos(yaw) * cos(pitch), sin(yaw) * cos(pitch), -sin(pitch));
        let right = DVec3::new(sin(yaw), -cos(yaw), 0.0);
        let down = forward.cross(right);
        let ahead = DVec3::new(cos(yaw), sin(yaw), 0.0);
        let eye = state.position_m + ahead * MOUNT_M.x + DVec3::Z * MOUNT_M.z;

        let columns = self.things_by_column(eye, forward, right);
        let mut picture = Picture { rgb: vec![0; WIDTH * HEIGHT * 3], depth_mm: vec![0; WIDTH * HEIGHT] };
        for v in 0..HEIGHT {
            for (u, things) in columns.iter().enumerate() {
                let x = (u as f64 - CENTRE_PX[0]) / FOCAL_PX;
                let y = (v as f64 - CENTRE_PX[1]) / FOCAL_PX;
                // Not of unit length: the distance along it is the depth along the optical axis.
                let ray = forward + right * x + down * y;
                let (depth_m, colour) = self.look(eye, ray, things);
                let pixel = v * WIDTH + u;
                if depth_m < MAX_RANGE_M {
                    picture.depth_mm[pixel] = (depth_m * 1000.0).round() as u16;
                }
                for channel in 0..3 {
                    picture.rgb[pixel * 3 + channel] = (colour[channel].clamp(0.0, 1.0) * 255.0) as u8;
                }
            }
        }
        picture
    }

    /// For each column of the image, the things that may show in it.
    fn things_by_column(&self, eye: DVec3, forward: DVec3, right: DVec3) -> Vec<Vec<&Thing>> {
        let angles: Vec<f64> = (0..WIDTH).map(|u| atan2(u as f64 - CENTRE_PX[0], FOCAL_PX)).collect();
        let mut columns = vec![Vec::new(); WIDTH];
        for thing in &self.things {
            let (centre_m, radius_m) = thing.bounds();
            let (x, z) = ((centre_m - eye).dot(right), (centre_m - eye).dot(forward));
            let distance = hypot(x, z);
            if z < -radius_m || distance > MAX_RANGE_M + 25.0 {
                continue;
            }
            let half = if distance <= radius_m { std::f64::consts::PI } else { asin(radius_m / distance) };
            let middle = atan2(x, z);
            for (column, angle) in columns.iter_mut().zip(&angles) {
                if (angle - middle).abs() <= half {
                    column.push(thing);
                }
            }
        }
        columns
    }

    /// Depth and colour along a ray.
    fn look(&self, eye: DVec3, ray: DVec3, things: &[&Thing]) -> (f64, DVec3) {
        let mut best = (f64::INFINITY, DVec3::ZERO);
        for thing in things {
            if let Some((depth, normal)) = thing.shape.hit(eye, ray)
                && depth < best.0
            {
                let light = 0.45 + 0.55 * normal.dot(SUN).max(0.0);
                let point = eye + ray * depth;
                let grain =
                    0.85 + 0.3 * value_noise(point.x * 7.0 + point.z * 5.0, point.y * 7.0 - point.z * 3.0);
                best = (depth, thing.colour * light * grain);
            }
        }
        if ray.z < 0.0 {
            let depth = -eye.z / ray.z;
            if depth < best.0 {
                best = (depth, self.ground(eye + ray * depth, depth));
            }
        }
        if best.0.is_finite() {
            // Haze, so that distance can be told.
            let haze = (best.0 / 90.0).min(0.7);
            return (best.0, best.1.lerp(DVec3::new(0.72, 0.78, 0.84), haze));
        }
        let height = (ray.z / ray.length()).clamp(0.0, 1.0);
        (
            f64::INFINITY,
            DVec3::new(0.74, 0.8, 0.86).lerp(DVec3::new(0.4, 0.58, 0.82), (height * 2.0).min(1.0)),
        )
    }

    fn ground(&self, point: DVec3, depth: f64) -> DVec3 {
        let off_track = (point.y - self.track_y(point.x)).abs();
        let edge = ((off_track - 0.75) / 0.3).clamp(0.0, 1.0);
        let colour = DVec3::new(0.55, 0.45, 0.33).lerp(DVec3::new(0.32, 0.46, 0.2), edge);
        let fine = value_noise(point.x * 9.0, point.y * 9.0) - 0.5;
        let coarse = value_noise(point.x * 1.3, point.y * 1.3) - 0.5;
        // Detail below a pixel would only flicker.
        let detail = (4.0 / depth).min(1.0);
        colour * (1.0 + 0.5 * fine * detail + 0.25 * coarse)
    }
}

impl Thing {
    fn bounds(&self) -> (DVec3, f64) {
        match self.shape {
            Shape::Sphere { centre_m, radius_m } => (centre_m, radius_m),
            Shape::Cylinder { foot_m, radius_m, height_m } => {
                (foot_m + DVec3::Z * (height_m / 2.0), hypot(radius_m, height_m / 2.0))
            }
        }
    }
}

impl Shape {
    /// Distance along the ray to the first point of the surface in front of the eye, and the normal there.
    fn hit(&self, eye: DVec3, ray: DVec3) -> Option<(f64, DVec3)> {
        match *self {
            Self::Sphere { centre_m, radius_m } => {
                let to = eye - centre_m;
                let t = nearest_root(ray.dot(ray), to.dot(ray), to.dot(to) - radius_m * radius_m)?;
                Some((t, (to + ray * t) / radius_m))
            }
            Self::Cylinder { foot_m, radius_m, height_m } => {
                let to = eye - foot_m;
                let flat = |v: DVec3| DVec3::new(v.x, v.y, 0.0);
                let (a, b) = (flat(ray), flat(to));
                let t = nearest_root(a.dot(a), b.dot(a), b.dot(b) - radius_m * radius_m)?;
                let height = to.z + ray.z * t;
                (0.0..=height_m).contains(&height).then(|| (t, flat(to + ray * t) / radius_m))
            }
        }
    }
}

/// Smaller positive root of a t² + 2 b t + c.
fn nearest_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 || a == 0.0 {
        return None;
    }
    let t = (-b - discriminant.sqrt()) / a;
    (t > 1e-6).then_some(t)
}

/// Smooth noise in 0 to 1 with one value for each unit square's corner.
fn value_noise(x: f64, y: f64) -> f64 {
    let (x0, y0) = (floor(x), floor(y));
    let corner = |dx: f64, dy: f64| {
        let key = ((x0 + dx) as i64 as u64).wrapping_mul(0x9e37_79b9)
            ^ ((y0 + dy) as i64 as u64).wrapping_mul(0x85eb_ca6b);
        Noise::new(key).uniform()
    };
    let (fx, fy) = (x - x0, y - y0);
    let bottom = corner(0.0, 0.0) * (1.0 - fx) + corner(1.0, 0.0) * fx;
    let top = corner(0.0, 1.0) * (1.0 - fx) + corner(1.0, 1.0) * fx;
    bottom * (1.0 - fy) + top * fy
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::drive::states;

    #[test]
    fn depth_of_open_ground_is_that_of_the_plane() {
        let states = states(1.0);
        let empty = Scene { things: Vec::new(), track: Vec::new() };
        let picture = empty.picture(&states[0]);
        let v = 200;
        let below = libm::atan((v as f64 - CENTRE_PX[1]) / FOCAL_PX) + MOUNT_PITCH_RAD;
        let along = MOUNT_M.z / libm::sin(below) * libm::cos(below - MOUNT_PITCH_RAD);
        assert!((f64::from(picture.depth_mm[v * WIDTH + 10]) - along * 1000.0).abs() <= 1.0);
        assert_eq!(picture.depth_mm[0], 0, "the sky has no depth");
    }

    #[test]
    fn things_stand_in_front_of_the_ground_behind_them() {
        let states = states(20.0);
        let scene = Scene::beside(&states, 1);
        let with = scene.picture(&states[300]);
        let without = Scene { things: Vec::new(), track: scene.track.clone() }.picture(&states[300]);
        let nearer = with
            .depth_mm
            .iter()
            .zip(&without.depth_mm)
            .filter(|&(&a, &b)| a != 0 && (b == 0 || a < b))
            .count();
        assert!(nearer > 2000, "{nearer} pixels of things");
    }
}
