//! A plane shown on a canvas: drag to pan, scroll to zoom at the pointer, double click to fit.

use egui::{Pos2, Rect, Response, Ui, Vec2};
use serde::{Deserialize, Serialize};

/// The visible part of a plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Viewport {
    /// Point of the plane at the centre of the canvas.
    pub(crate) center: [f64; 2],
    /// Screen points per unit of the plane.
    pub(crate) scale: f64,
    /// Whether the plane's y axis points up (a map) or down (an image).
    pub(crate) y_up: bool,
    /// Angle by which the plane is turned about the centre, from its x axis to its y axis, rad. It follows from what is
    /// shown, and is not saved.
    #[serde(skip)]
    pub(crate) turned_rad: f64,
}

impl Viewport {
    /// Fits a rectangle of the plane into a canvas, with a margin in points.
    pub(crate) fn fit(min: [f64; 2], max: [f64; 2], canvas: Rect, margin: f32, y_up: bool) -> Self {
        let size = [(max[0] - min[0]).max(1e-6), (max[1] - min[1]).max(1e-6)];
        let room = (canvas.size() - Vec2::splat(2.0 * margin)).max(Vec2::splat(1.0));
        let scale = (f64::from(room.x) / size[0]).min(f64::from(room.y) / size[1]);
        Self {
            center: [f64::midpoint(min[0], max[0]), f64::midpoint(min[1], max[1])],
            scale,
            y_up,
            turned_rad: 0.0,
        }
    }

    /// Whether it can be drawn: a stored one may have been changed by hand.
    pub(crate) fn is_valid(&self) -> bool {
        self.scale.is_finite() && self.scale > 0.0 && self.center.iter().all(|v| v.is_finite())
    }

    /// Whether both show a common part of the plane.
    pub(crate) fn meets(self, other: Self, canvas: Rect) -> bool {
        let ((a_min, a_max), (b_min, b_max)) = (self.bounds(canvas), other.bounds(canvas));
        (0..2).all(|axis| a_min[axis] < b_max[axis] && b_min[axis] < a_max[axis])
    }

    fn down(self) -> f64 {
        if self.y_up { -1.0 } else { 1.0 }
    }

    /// Screen position of a point of the plane.
    pub(crate) fn to_screen(self, canvas: Rect, point: [f64; 2]) -> Pos2 {
        let [x, y] = turn([point[0] - self.center[0], point[1] - self.center[1]], self.turned_rad);
        canvas.center() + Vec2::new(on_screen(x * self.scale), on_screen(y * self.scale * self.down()))
    }

    /// Point of the plane at a screen position.
    pub(crate) fn to_plane(self, canvas: Rect, at: Pos2) -> [f64; 2] {
        let [x, y] = self.offset_in_plane(at - canvas.center());
        [self.center[0] + x, self.center[1] + y]
    }

    fn offset_in_plane(self, offset: Vec2) -> [f64; 2] {
        let upright = [f64::from(offset.x) / self.scale, f64::from(offset.y) / (self.scale * self.down())];
        turn(upright, -self.turned_rad)
    }

    /// Direction on the screen of a direction in the plane, given by its angle from the x axis, rad.
    pub(crate) fn direction(self, angle_rad: f64) -> Vec2 {
        let (sin, cos) = (angle_rad + self.turned_rad).sin_cos();
        Vec2::new(cos as f32, (sin * self.down()) as f32)
    }

    /// Minimum and maximum coordinates of the visible part; of a turned plane, of the rectangle around it.
    pub(crate) fn bounds(self, canvas: Rect) -> ([f64; 2], [f64; 2]) {
        let corners = [canvas.min, canvas.right_top(), canvas.max, canvas.left_bottom()];
        let corners = corners.map(|corner| self.to_plane(canvas, corner));
        let along = |axis: usize, pick: fn(f64, f64) -> f64| {
            corners.iter().map(|corner| corner[axis]).fold(corners[0][axis], pick)
        };
        ([along(0, f64::min), along(1, f64::min)], [along(0, f64::max), along(1, f64::max)])
    }

    /// Zooms by `factor` about a screen position, which keeps its place; `range` limits the scale.
    pub(crate) fn zoom_about(&mut self, canvas: Rect, at: Pos2, factor: f64, range: [f64; 2]) {
        let fixed = self.to_plane(canvas, at);
        self.scale = (self.scale * factor).clamp(range[0], range[1]);
        let moved = self.to_plane(canvas, at);
        for axis in 0..2 {
            self.center[axis] += fixed[axis] - moved[axis];
        }
    }

    /// Pans and zooms by the pointer; returns whether anything changed.
    pub(crate) fn interact(&mut self, ui: &Ui, response: &Response, range: [f64; 2], pan: bool) -> bool {
        let before = *self;
        if pan && response.dragged() {
            let [x, y] = self.offset_in_plane(response.drag_delta());
            self.center = [self.center[0] - x, self.center[1] - y];
        }
        if let Some(at) = response.hover_pos() {
            let (scroll, pinch) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
            let factor = f64::from(pinch) * (f64::from(scroll) / 240.0).exp();
            if (factor - 1.0).abs() > 1e-6 {
                self.zoom_about(response.rect, at, factor, range);
            }
        }
        *self != before
    }
}

fn turn([x, y]: [f64; 2], angle_rad: f64) -> [f64; 2] {
    let (sin, cos) = angle_rad.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}

/// Converts a screen coordinate and clamps it, so that sums of coordinates of huge shapes stay finite.
#[expect(clippy::manual_clamp, reason = "`clamp` returns NaN for NaN; this returns a finite number")]
fn on_screen(v: f64) -> f32 {
    const FAR: f64 = 1e6;
    v.max(-FAR).min(FAR) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn canvas() -> Rect {
        Rect::from_min_size(Pos2::new(10.0, 20.0), Vec2::new(300.0, 200.0))
    }

    #[test]
    fn screen_and_plane_are_inverse() {
        for (y_up, turned_rad) in [(false, 0.0), (true, 0.0), (true, 2.0)] {
            let viewport = Viewport { center: [3.0, -7.0], scale: 12.5, y_up, turned_rad };
            let at = Pos2::new(111.0, 77.0);
            let back = viewport.to_screen(canvas(), viewport.to_plane(canvas(), at));
            assert!((back - at).length() < 1e-3);
        }
    }

    #[test]
    fn zooming_keeps_the_point_under_the_pointer() {
        let mut viewport = Viewport { center: [3.0, -7.0], scale: 12.5, y_up: true, turned_rad: 0.7 };
        let at = Pos2::new(250.0, 60.0);
        let before = viewport.to_plane(canvas(), at);
        viewport.zoom_about(canvas(), at, 3.0, [1.0, 1000.0]);
        let after = viewport.to_plane(canvas(), at);
        assert!((before[0] - after[0]).abs() < 1e-9 && (before[1] - after[1]).abs() < 1e-9);
        assert_eq!(viewport.scale, 37.5);
    }

    #[test]
    fn a_turned_plane_keeps_distances_and_directions_and_its_bounds_hold_the_canvas() {
        let turned_rad = std::f64::consts::FRAC_PI_2 - 0.4;
        let viewport = Viewport { center: [3.0, -7.0], scale: 10.0, y_up: true, turned_rad };
        // What points to 0.4 rad in the plane points up on the screen.
        let ahead = [3.0 + 0.4_f64.cos(), -7.0 + 0.4_f64.sin()];
        let up = viewport.to_screen(canvas(), ahead) - canvas().center();
        assert!((up - Vec2::new(0.0, -10.0)).length() < 1e-4, "{up:?}");
        assert!((viewport.direction(0.4) - Vec2::UP).length() < 1e-6);
        let (min, max) = viewport.bounds(canvas());
        for corner in [canvas().min, canvas().right_top(), canvas().max, canvas().left_bottom()] {
            let [x, y] = viewport.to_plane(canvas(), corner);
            assert!(min[0] <= x && x <= max[0] && min[1] <= y && y <= max[1]);
        }
    }

    #[test]
    fn fitted_content_is_inside_the_canvas() {
        let viewport = Viewport::fit([-5.0, 0.0], [5.0, 100.0], canvas(), 8.0, true);
        for point in [[-5.0, 0.0], [5.0, 100.0]] {
            assert!(canvas().contains(viewport.to_screen(canvas(), point)));
        }
        assert!(Viewport::fit([1.0, 1.0], [1.0, 1.0], canvas(), 8.0, true).scale.is_finite());
    }
}
