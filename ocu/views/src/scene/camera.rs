//! The camera of the scene: it looks at a point from a distance, and turns around it. World axes: z up.

use egui::{Pos2, Rect, Vec2};
use glam::DMat4;
use rcs_geom::DVec3;
use serde::{Deserialize, Serialize};

/// Angle of view from the lower edge to the upper one, rad.
const VIEW_RAD: f64 = 0.8;
/// Highest and lowest elevation, rad: straight down would leave no direction for up.
const STEEPEST: f64 = 1.55;
const LOWEST: f64 = -0.6;

/// The corners of a box.
pub(super) fn corners(min: DVec3, max: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|corner| {
        let pick = |axis: usize| if (corner >> axis) & 1 == 0 { min[axis] } else { max[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    })
}

/// Where the scene is looked at from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Camera {
    /// The point that it looks at, m.
    pub(super) center: [f64; 3],
    /// Distance from that point, m.
    pub(super) distance_m: f64,
    /// Direction from the centre to the camera: counter-clockwise from the x axis, and above the plane.
    pub(super) azimuth_rad: f64,
    pub(super) elevation_rad: f64,
}

impl Camera {
    /// Looks at a box from behind and above, and sees all of it in a canvas with this ratio of width to height.
    pub(super) fn fit(min: DVec3, max: DVec3, aspect: f64) -> Self {
        let center = min.midpoint(max);
        let camera =
            Self { center: center.to_array(), distance_m: 0.0, azimuth_rad: -2.2, elevation_rad: 0.7 };
        let outward = camera.outward();
        let right = DVec3::Z.cross(outward).normalize();
        let up = outward.cross(right);
        // Half the height of the canvas at a distance of 1.
        let half = (0.5 * VIEW_RAD).tan();
        let needed_m = corners(min, max).map(|corner| {
            let p = corner - center;
            p.dot(outward) + (p.dot(up).abs() / half).max(p.dot(right).abs() / (half * aspect))
        });
        Self { distance_m: 1.05 * needed_m.into_iter().fold(1.5, f64::max), ..camera }
    }

    /// Whether all numbers can be used.
    pub(super) fn is_valid(&self) -> bool {
        let angles = [self.azimuth_rad, self.elevation_rad];
        self.center.iter().chain(&angles).all(|v| v.is_finite()) && (1e-3..1e7).contains(&self.distance_m)
    }

    /// Direction from the centre to the camera.
    fn outward(&self) -> DVec3 {
        let (azimuth, elevation) = (self.azimuth_rad.sin_cos(), self.elevation_rad.sin_cos());
        DVec3::new(elevation.1 * azimuth.1, elevation.1 * azimuth.0, elevation.0)
    }

    /// Position of the camera.
    pub(super) fn eye(&self) -> DVec3 {
        DVec3::from_array(self.center) + self.outward() * self.distance_m
    }

    /// From world to clip coordinates, for a canvas with this ratio of width to height.
    pub(super) fn clip_from_world(&self, aspect: f64) -> DMat4 {
        let view = DMat4::look_at_rh(self.eye(), DVec3::from_array(self.center), DVec3::Z);
        let near = (0.01 * self.distance_m).max(0.01);
        DMat4::perspective_rh(VIEW_RAD, aspect, near, 60.0 * self.distance_m + 1000.0) * view
    }

    /// Turns by a movement of the pointer, points.
    pub(super) fn turn(&mut self, by: Vec2) {
        self.azimuth_rad = (self.azimuth_rad - f64::from(by.x) * 0.008) % std::f64::consts::TAU;
        self.elevation_rad = (self.elevation_rad + f64::from(by.y) * 0.008).clamp(LOWEST, STEEPEST);
    }

    /// Moves the centre so that it follows the pointer.
    pub(super) fn pan(&mut self, by: Vec2, height: f32) {
        let per_point = 2.0 * self.distance_m * (VIEW_RAD / 2.0).tan() / f64::from(height.max(1.0));
        let (sin, cos) = self.azimuth_rad.sin_cos();
        let (right, ahead) = (DVec3::new(-sin, cos, 0.0), DVec3::new(-cos, -sin, 0.0));
        let moved = right * -f64::from(by.x) + ahead * f64::from(by.y);
        self.center = (DVec3::from_array(self.center) + moved * per_point).to_array();
    }

    /// Goes nearer for a factor above 1.
    pub(super) fn zoom(&mut self, factor: f64) {
        self.distance_m = (self.distance_m / factor).clamp(0.2, 1e6);
    }
}

/// The place of a world point on the canvas; `None` behind the camera.
pub(super) fn project(clip_from_world: &DMat4, canvas: Rect, p: DVec3) -> Option<Pos2> {
    let clip = *clip_from_world * p.extend(1.0);
    if clip.w <= 1e-6 {
        return None;
    }
    let [x, y] = [clip.x / clip.w, clip.y / clip.w];
    let half = canvas.size() / 2.0;
    Some(canvas.center() + Vec2::new(x as f32 * half.x, -y as f32 * half.y))
}

/// The world point at a place of the canvas with this depth, 0 to 1; `None` where nothing was drawn.
pub(super) fn unproject(clip_from_world: &DMat4, canvas: Rect, at: Pos2, depth: f32) -> Option<DVec3> {
    if !(0.0..1.0).contains(&depth) {
        return None;
    }
    let part = (at - canvas.min) / canvas.size();
    let clip =
        glam::DVec4::new(f64::from(part.x) * 2.0 - 1.0, 1.0 - f64::from(part.y) * 2.0, f64::from(depth), 1.0);
    let p = clip_from_world.inverse() * clip;
    let p = p.truncate() / p.w;
    p.is_finite().then_some(p)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_projected_comes_back_from_its_depth() {
        let camera = Camera::fit(DVec3::new(-5.0, -5.0, 0.0), DVec3::new(5.0, 5.0, 2.0), 4.0 / 3.0);
        let canvas = Rect::from_min_size(Pos2::new(10.0, 20.0), Vec2::new(400.0, 300.0));
        let matrix = camera.clip_from_world(4.0 / 3.0);
        let center = project(&matrix, canvas, DVec3::from_array(camera.center)).unwrap();
        assert!(center.distance(canvas.center()) < 1e-3);
        for p in [DVec3::new(1.0, 2.0, 0.5), DVec3::new(-3.0, 0.0, 2.0)] {
            let at = project(&matrix, canvas, p).unwrap();
            let clip = matrix * p.extend(1.0);
            let back = unproject(&matrix, canvas, at, (clip.z / clip.w) as f32).unwrap();
            assert!(back.distance(p) < 1e-2, "{back} {p}");
        }
        assert_eq!(unproject(&matrix, canvas, canvas.center(), 1.0), None, "nothing is there");
        let behind = camera.eye() + (camera.eye() - DVec3::from_array(camera.center));
        assert_eq!(project(&matrix, canvas, behind), None);
    }

    #[test]
    fn all_of_a_box_is_seen_in_wide_and_narrow_canvases_and_fills_them() {
        let boxes = [[60.0, 60.0, 0.0], [200.0, 4.0, 10.0], [3.0, 90.0, 1.0], [5.0, 5.0, 40.0]];
        for (max, aspect) in boxes.into_iter().flat_map(|max| [0.4, 1.0, 2.5].map(|aspect| (max, aspect))) {
            let (min, max) = (DVec3::ZERO, DVec3::from_array(max));
            let matrix = Camera::fit(min, max, aspect).clip_from_world(aspect);
            let reach = corners(min, max).map(|corner| {
                let clip = matrix.project_point3(corner);
                clip.x.abs().max(clip.y.abs())
            });
            let farthest = reach.into_iter().fold(0.0, f64::max);
            assert!((0.85..1.0).contains(&farthest), "{max} in {aspect}: {farthest}");
        }
    }

    #[test]
    fn the_scene_follows_the_pointer_and_never_turns_over() {
        let mut camera = Camera::fit(DVec3::ZERO, DVec3::new(10.0, 10.0, 0.0), 1.0);
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::new(300.0, 300.0));
        let p = DVec3::from_array(camera.center);
        camera.pan(Vec2::new(30.0, 0.0), 300.0);
        let at = project(&camera.clip_from_world(1.0), canvas, p).unwrap();
        assert!((at - canvas.center() - Vec2::new(30.0, 0.0)).length() < 1.5, "{at:?}");
        camera.turn(Vec2::new(0.0, 1e4));
        assert!(camera.elevation_rad <= STEEPEST && camera.is_valid());
    }
}
