//! Clipping of lines to the canvas in world coordinates, before shapes are made.
//!
//! Some scanners report the largest number for a missing return, and a pose in a wrong frame may be thousands of
//! kilometres away. The cost of drawing must depend only on what is visible; implausible positions are counted and left
//! out.

use crate::canvas::Viewport;
use egui::{Color32, Pos2, Rect, Shape, Stroke};

/// Half of the Earth's circumference, m: no two positions are farther apart, so larger coordinates are invalid.
pub(crate) const FARTHEST_M: f64 = 2e7;
/// Points farther than this from the centre of their layer are left out, too, unless many of its points are that far
/// apart.
const FAR_M: f64 = 1e5;
/// Margin beyond the canvas to which lines are clipped, screen points.
const BEYOND: f64 = 64.0;
/// Maximum length of a dashed line, screen points; a longer one is drawn without gaps.
const MOST_DASHED: f32 = 40_000.0;

/// Whether coordinates are plausible for a position.
pub(crate) fn is_place(coordinates: &[f64]) -> bool {
    coordinates.iter().all(|v| v.abs() <= FARTHEST_M)
}

/// Bounds of the plausible points of a layer, to which the window is fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Near {
    middle: [f64; 2],
    reach: [f64; 2],
}

impl Near {
    /// Number of points that are enough to derive it from.
    pub(crate) const SAMPLE: usize = 5_000;

    /// Derived from median and spread of the points; for many points, of a sample.
    pub(crate) fn of(points: impl ExactSizeIterator<Item = [f64; 2]>) -> Self {
        let every = (points.len() / Self::SAMPLE).max(1);
        let sample: Vec<[f64; 2]> = points.step_by(every).filter(|point| is_place(point)).collect();
        let along = |axis: usize| {
            let mut values: Vec<f64> = sample.iter().map(|point| point[axis]).collect();
            values.sort_by(f64::total_cmp);
            let at = |part: f64| values.get((values.len().saturating_sub(1) as f64 * part) as usize).copied();
            let (low, middle, high) = (at(0.1), at(0.5), at(0.9));
            let spread = high.unwrap_or(0.0) - low.unwrap_or(0.0);
            (middle.unwrap_or(0.0), (10.0 * spread).max(FAR_M))
        };
        let (x, y) = (along(0), along(1));
        Self { middle: [x.0, y.0], reach: [x.1, y.1] }
    }

    /// Whether a point lies within the bounds; invalid coordinates never do.
    pub(crate) fn has(&self, point: [f64; 2]) -> bool {
        is_place(&point) && (0..2).all(|axis| (point[axis] - self.middle[axis]).abs() <= self.reach[axis])
    }
}

/// The visible parts of a line, up to slightly beyond the canvas, thinned to the resolution of the screen.
pub(crate) fn line(
    points: impl Iterator<Item = [f64; 2]>,
    viewport: Viewport,
    canvas: Rect,
) -> Vec<Vec<Pos2>> {
    let (mut min, mut max) = viewport.bounds(canvas);
    let beyond = BEYOND / viewport.scale;
    for axis in 0..2 {
        min[axis] -= beyond;
        max[axis] += beyond;
    }
    let mut parts: Vec<Vec<Pos2>> = Vec::new();
    let mut part = Thin::default();
    let mut last: Option<[f64; 2]> = None;
    for point in points {
        if !point.iter().all(|v| v.is_finite()) {
            part.end(&mut parts);
            last = None;
            continue;
        }
        if let Some(from) = last.replace(point) {
            match segment(from, point, min, max) {
                Some((a, b)) => {
                    if a != from || part.is_empty() {
                        part.end(&mut parts);
                        part.push(viewport.to_screen(canvas, a));
                    }
                    part.push(viewport.to_screen(canvas, b));
                    if b != point {
                        part.end(&mut parts);
                    }
                }
                None => part.end(&mut parts),
            }
        }
    }
    part.end(&mut parts);
    parts
}

/// Screen points with a minimum distance of about a pixel.
#[derive(Default)]
struct Thin {
    kept: Vec<Pos2>,
    /// The last point that was skipped. It is kept at the end, because the end of a track is the current position.
    last: Option<Pos2>,
}

impl Thin {
    fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    fn push(&mut self, point: Pos2) {
        if self.kept.last().is_none_or(|kept| (point - *kept).length_sq() >= 1.0) {
            self.kept.push(point);
            self.last = None;
        } else {
            self.last = Some(point);
        }
    }

    fn end(&mut self, parts: &mut Vec<Vec<Pos2>>) {
        self.kept.extend(self.last.take());
        let part = std::mem::take(&mut self.kept);
        if part.len() > 1 {
            parts.push(part);
        }
    }
}

/// The part of a segment within a rectangle (Liang-Barsky clipping).
fn segment(a: [f64; 2], b: [f64; 2], min: [f64; 2], max: [f64; 2]) -> Option<([f64; 2], [f64; 2])> {
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for axis in 0..2 {
        // Halved, so that the difference of two finite numbers is finite.
        let along = b[axis] / 2.0 - a[axis] / 2.0;
        let (low, high) = (min[axis] / 2.0 - a[axis] / 2.0, max[axis] / 2.0 - a[axis] / 2.0);
        if along == 0.0 {
            if low > 0.0 || high < 0.0 {
                return None;
            }
            continue;
        }
        let (first, second) = (low / along, high / along);
        enter = enter.max(first.min(second));
        leave = leave.min(first.max(second));
    }
    if enter > leave {
        return None;
    }
    let at = |part: f64| {
        if part <= 0.0 {
            a
        } else if part >= 1.0 {
            b
        } else {
            std::array::from_fn(|axis| (a[axis] * (1.0 - part) + b[axis] * part).clamp(min[axis], max[axis]))
        }
    };
    Some((at(enter), at(leave)))
}

/// Dashed lines, with a maximum number of dashes; longer lines are drawn without gaps.
pub(crate) fn dashed(parts: &[Vec<Pos2>], stroke: Stroke, color: Color32) -> Vec<Shape> {
    let length = |part: &Vec<Pos2>| part.windows(2).map(|ends| (ends[1] - ends[0]).length()).sum::<f32>();
    let stroke = Stroke::new(stroke.width, color);
    if parts.iter().map(length).sum::<f32>() > MOST_DASHED {
        return parts.iter().map(|part| Shape::line(part.clone(), stroke)).collect();
    }
    parts.iter().flat_map(|part| Shape::dashed_line(part, stroke, 6.0, 4.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEWPORT: Viewport = Viewport { center: [0.0, 0.0], scale: 10.0, y_up: true, turned_rad: 0.0 };

    fn canvas() -> Rect {
        Rect::from_min_size(Pos2::ZERO, egui::Vec2::new(400.0, 300.0))
    }

    #[test]
    fn a_line_to_anywhere_is_drawn_within_the_canvas_and_a_little_beyond() {
        for far in [1e3, 1e9, 1e18, f64::from(f32::MAX), f64::MAX] {
            let points = [[0.0, 0.0], [1.0, 1.0], [far, far], [-far, far], [0.0, -1.0], [1.0, f64::NAN]];
            let parts = line(points.into_iter(), VIEWPORT, canvas());
            assert!(!parts.is_empty(), "{far}");
            for point in parts.iter().flatten() {
                assert!(canvas().expand(66.0).contains(*point), "{far}: {point:?}");
            }
            let shapes = dashed(&parts, Stroke::new(2.0, Color32::RED), Color32::RED);
            assert!(shapes.len() < 1000, "{far}: {}", shapes.len());
        }
    }

    #[test]
    fn what_is_outside_is_not_drawn_and_what_crosses_is() {
        let parts = |points: &[[f64; 2]]| line(points.iter().copied(), VIEWPORT, canvas());
        assert!(parts(&[[100.0, 100.0], [200.0, 100.0]]).is_empty());
        assert_eq!(parts(&[[-100.0, 0.0], [100.0, 0.0]]).len(), 1);
        let out_and_back = parts(&[[0.0, 0.0], [100.0, 0.0], [100.0, 5.0], [0.0, 5.0]]);
        assert_eq!(out_and_back.len(), 2);
        assert!(parts(&[[0.0, 0.0]]).is_empty());
    }

    #[test]
    fn a_million_points_become_no_more_than_the_screen_shows() {
        let points = (0..1_000_000).map(|i| [f64::from(i) * 1e-4 - 50.0, 0.0]);
        let parts = line(points, VIEWPORT, canvas());
        let kept: usize = parts.iter().map(Vec::len).sum();
        assert!(parts.len() == 1 && kept <= 530, "{} parts, {kept} points", parts.len());
    }

    #[test]
    fn what_is_fitted_leaves_out_places_that_cannot_be_and_keeps_a_long_drive() {
        let drive: Vec<[f64; 2]> = (0..1000).map(|i| [f64::from(i.max(900) - 900) * 1000.0, 0.0]).collect();
        let near = Near::of(drive.iter().copied());
        assert!(drive.iter().all(|point| near.has(*point)), "99 km, mostly at rest");
        for wrong in [[4.3e6, 0.0], [0.0, 1e30], [f64::NAN, 0.0], [f64::INFINITY, 0.0]] {
            assert!(!near.has(wrong), "{wrong:?}");
        }
        let utm: Vec<[f64; 2]> = (0..100).map(|i| [500_000.0 + f64::from(i), 5_300_000.0]).collect();
        let near = Near::of(utm.iter().copied());
        assert!(utm.iter().all(|point| near.has(*point)), "a drive in the coordinates of a zone");
    }
}
