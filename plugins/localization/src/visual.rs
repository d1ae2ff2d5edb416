//! Motion of the vehicle between two images of a camera with depth: direct visual odometry.
//!
//! Points of the first image, placed by their depth, are moved as the vehicle would have moved, and looked up in the second
//! image. The motion for which both images agree best is the one that it made. Its rotation is known from the gyros, and it
//! moves along its heading, so a search over the way ahead is enough, and one to the sides after it. Images agree by their
//! correlation, which does not depend on exposure.
//!
//! On simulated drives over grass and mud with 320×240 pixels at 5 Hz, one step of up to 0.26 m is found with a standard
//! deviation of 2 to 4 mm, whether the wheels slip or not; with a calibration that is off by 0.2° and a pixel, 9 to 14 mm.

use glam::{DMat3, DVec2, DVec3, Vec3};
use rcs_geom::{PinholeCamera, Pose};
use serde::{Deserialize, Serialize};

/// Distance between the ways that are tried, m. At 2 m it moves a point by about a pixel.
const STEP_M: f64 = 0.012;
/// Number of steps to each side that are tried.
const SIDE_STEPS: i32 = 3;
/// Number of places of an image at which points are looked for.
const POINTS: usize = 2000;
/// With fewer points, or fewer that both images show, nothing is told.
const LEAST_POINTS: usize = 80;
/// What is nearer to the camera is not looked at, m.
const NEAREST_M: f32 = 0.1;
/// By how much the corners of a rectified image may lie beside where a pinhole camera has them, px.
const STRAIGHT_PX: f64 = 0.05;
/// Another way that is nearly as likely as the best one makes it ambiguous: ground with a pattern that repeats itself.
const AMBIGUOUS: f64 = 0.03;

/// A grey image, smoothed so that the grey levels between its pixels can be interpolated.
#[derive(Clone, Debug, PartialEq)]
pub struct Grey {
    width: usize,
    height: usize,
    levels: Vec<u8>,
}

/// A point of the ground, or of what stands on it, as an image showed it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Axes of the vehicle at the time of the image, m.
    at: [f32; 3],
    /// Grey level.
    level: u8,
}

/// How the vehicle has moved, in its axes at the time of the first image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Ahead, m.
    pub forward_m: f64,
    /// To the left, m.
    pub left_m: f64,
    /// Correlation of both images after this motion.
    pub likeness: f64,
}

/// A camera without distortion, on the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mounted {
    focal_px: [f32; 2],
    centre_px: [f32; 2],
    vehicle_from_camera: Pose,
}

impl Mounted {
    /// `None` for a camera whose lens distorts: its images are not rectified.
    pub fn new(camera: &PinholeCamera, vehicle_from_camera: Pose) -> Option<Mounted> {
        let [right, bottom] = [camera.width, camera.height].map(f64::from);
        let is_straight = |pixel: DVec2| {
            camera.undistort(pixel).is_some_and(|straight| straight.abs_diff_eq(pixel, STRAIGHT_PX))
        };
        let corners =
            [DVec2::ZERO, DVec2::new(right, 0.0), DVec2::new(0.0, bottom), DVec2::new(right, bottom)];
        corners.into_iter().all(is_straight).then(|| Mounted {
            focal_px: [camera.fx, camera.fy].map(|v| v as f32),
            centre_px: [camera.cx, camera.cy].map(|v| v as f32),
            vehicle_from_camera,
        })
    }

    /// The pixel that shows a point of the optical frame, m.
    fn project(&self, at: Vec3) -> Option<[f32; 2]> {
        let scale = 1.0 / at.z;
        let pixel = |axis: usize| self.focal_px[axis] * at[axis] * scale + self.centre_px[axis];
        (at.z > NEAREST_M).then(|| [0, 1].map(pixel))
    }

    /// The point at a depth, m, that a pixel shows, in the optical frame.
    fn point(&self, pixel: [usize; 2], depth_m: f32) -> Vec3 {
        let [x, y] = [0, 1].map(|axis| (pixel[axis] as f32 - self.centre_px[axis]) / self.focal_px[axis]);
        Vec3::new(x, y, 1.0) * depth_m
    }
}

impl Grey {
    /// From RGB bytes by rows, each level the mean of 3×3 pixels.
    pub fn of(rgb: &[u8], width: usize, height: usize) -> Grey {
        let levels: Vec<u8> = rgb.as_chunks::<3>().0.iter().map(|&pixel| rcs_sense::luma(pixel)).collect();
        let mut smooth = levels.clone();
        if width >= 3 && height >= 3 {
            for row in 1..height - 1 {
                let [above, here, below] = [row - 1, row, row + 1].map(|row| &levels[row * width..][..width]);
                let out = &mut smooth[row * width + 1..][..width - 2];
                for (column, out) in out.iter_mut().enumerate() {
                    let three = |row: &[u8]| {
                        u16::from(row[column]) + u16::from(row[column + 1]) + u16::from(row[column + 2])
                    };
                    *out = ((three(above) + three(here) + three(below) + 4) / 9) as u8;
                }
            }
        }
        Grey { width, height, levels: smooth }
    }

    /// Level at a position, pixels; `None` at the border and beyond.
    fn at(&self, [x, y]: [f32; 2]) -> Option<f32> {
        let inside = |v: f32, side: usize| v >= 1.0 && v < side as f32 - 2.0;
        if !(inside(x, self.width) && inside(y, self.height)) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        let (right, down) = (x - column as f32, y - row as f32);
        let along = |row: usize| {
            let pair = &self.levels[row * self.width + column..][..2];
            let [here, beside] = [pair[0], pair[1]].map(f32::from);
            here + (beside - here) * right
        };
        let above = along(row);
        Some(above + (along(row + 1) - above) * down)
    }
}

/// Points of an image, evenly spread over it, with the depth along the optical axis of each pixel, m, up to a range.
pub fn points(grey: &Grey, depth_m: &[f32], camera: &Mounted, max_range_m: f64) -> Vec<Point> {
    let spacing = ((grey.width * grey.height / POINTS) as f64).sqrt().max(1.0) as usize;
    let pixels = (1..grey.height.saturating_sub(1))
        .step_by(spacing)
        .flat_map(|row| (1..grey.width.saturating_sub(1)).step_by(spacing).map(move |column| (row, column)));
    let point = |(row, column): (usize, usize)| {
        let index = row * grey.width + column;
        let depth_m = depth_m[index];
        let is_near = depth_m > NEAREST_M && f64::from(depth_m) <= max_range_m;
        is_near.then(|| {
            let at = camera.vehicle_from_camera * camera.point([column, row], depth_m).as_dvec3();
            Point { at: at.as_vec3().to_array(), level: grey.levels[index] }
        })
    };
    pixels.filter_map(point).collect()
}

/// The motion after which an image agrees best with the points of the one before; `None` where there are too few points,
/// or no way ahead within `ahead_m` (least and greatest, m) is clearly the best one. `after_from_before` turns from the axes
/// of the vehicle at the first image to those at the second one.
pub fn motion(
    before: &[Point],
    after: &Grey,
    camera: &Mounted,
    after_from_before: DMat3,
    ahead_m: [f64; 2],
) -> Option<Motion> {
    let to_camera = camera.vehicle_from_camera.rotation_matrix().transpose();
    let turn = to_camera * after_from_before;
    let shift = to_camera * camera.vehicle_from_camera.translation;
    let placed: Vec<(Vec3, f32)> = before
        .iter()
        .map(|point| {
            let at = turn * DVec3::from_array(point.at.map(f64::from)) - shift;
            (at.as_vec3(), f32::from(point.level))
        })
        .collect();
    let likeness = |forward_m: f64, left_m: f64| {
        let moved = (turn * DVec3::new(forward_m, left_m, 0.0)).as_vec3();
        correlation(placed.iter().filter_map(|&(at, level)| {
            let seen = after.at(camera.project(at - moved)?)?;
            Some([level, seen])
        }))
    };
    let first = (ahead_m[0] / STEP_M).floor() as i32;
    let last = ((ahead_m[1] / STEP_M).ceil() as i32).max(first);
    let ways: Vec<f64> =
        (first..=last).map(|step| likeness(f64::from(step) * STEP_M, 0.0).unwrap_or(-1.0)).collect();
    let best = (0..ways.len()).max_by(|&a, &b| ways[a].total_cmp(&ways[b]).then(b.cmp(&a)))?;
    // At the end of the range the best way may lie beyond it.
    let is_peak =
        |at: usize| at > 0 && at + 1 < ways.len() && ways[at] >= ways[at - 1] && ways[at] >= ways[at + 1];
    let is_rival = |at: usize| at.abs_diff(best) > 2 && is_peak(at) && ways[at] > ways[best] - AMBIGUOUS;
    if !is_peak(best) || (0..ways.len()).any(is_rival) {
        return None;
    }
    let forward_m = f64::from(first + best as i32) * STEP_M;
    let sides = (-SIDE_STEPS..=SIDE_STEPS).filter_map(|step| {
        let left_m = f64::from(step) * STEP_M;
        Some((likeness(forward_m, left_m)?, left_m))
    });
    let (_, left_m) = sides.reduce(|best, other| if other.0 > best.0 { other } else { best })?;
    // The vertex of the parabola through the best way and those beside it.
    let [back, here, on] = [-1.0, 0.0, 1.0].map(|step| likeness(forward_m + step * STEP_M, left_m));
    let (back, here, on) = (back?, here?, on?);
    let bend = back - 2.0 * here + on;
    let beside = if bend < 0.0 { (0.5 * (back - on) / bend).clamp(-1.0, 1.0) } else { 0.0 };
    Some(Motion { forward_m: forward_m + beside * STEP_M, left_m, likeness: here })
}

/// Correlation of pairs of numbers; `None` of too few, or if all of one side are alike.
fn correlation(pairs: impl Iterator<Item = [f32; 2]>) -> Option<f64> {
    let (mut count, mut sums, mut squares, mut products) = (0_usize, [0.0; 2], [0.0; 2], 0.0);
    for [a, b] in pairs.map(|pair| pair.map(f64::from)) {
        count += 1;
        sums = [sums[0] + a, sums[1] + b];
        squares = [squares[0] + a * a, squares[1] + b * b];
        products += a * b;
    }
    if count < LEAST_POINTS {
        return None;
    }
    let n = count as f64;
    let spread = |at: usize| squares[at] - sums[at] * sums[at] / n;
    let scale = spread(0) * spread(1);
    (scale > 0.0).then(|| (products - sums[0] * sums[1] / n) / scale.sqrt())
}

#[cfg(test)]
#[path = "visual_tests.rs"]
mod tests;
