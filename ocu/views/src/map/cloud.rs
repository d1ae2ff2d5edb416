//! A point cloud seen from above, coloured by height, rendered as pixels of the canvas.

use crate::canvas::Viewport;
use crate::clip::is_place;
use egui::{Color32, ColorImage, Rect};
use ocu_ui::palette;
use rcs_geom::Pose;
use rcs_msg::foxglove::PointCloud;
use rcs_msg::points;

/// The points of a cloud in the map's frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Cloud {
    /// x, y and z, m.
    pub(super) points: Vec<[f32; 3]>,
    /// The 2nd and 98th percentile of the heights, m.
    pub(super) heights: [f32; 2],
    /// The 1st and 99th percentile along x and y, m.
    pub(super) bounds: Option<([f64; 2], [f64; 2])>,
    /// Number of implausible points, such as missing returns of a scanner.
    pub(super) far: usize,
}

impl Cloud {
    /// Reads a cloud; the error says why it cannot be read.
    pub(super) fn new(cloud: &PointCloud, map_from_frame: &Pose) -> Result<Self, String> {
        let map_from_cloud = *map_from_frame * crate::pose::from_message(cloud.pose.as_ref())?;
        let read = points(cloud).map_err(|error| error.to_string())?;
        let finite = read.iter().map(|point| map_from_cloud * point.position).filter(|p| p.is_finite());
        let mut far = 0;
        let mut points: Vec<[f32; 3]> = Vec::new();
        for p in finite {
            if is_place(&p.to_array()) {
                points.push([p.x as f32, p.y as f32, p.z as f32]);
            } else {
                far += 1;
            }
        }
        let [x, y, z] = std::array::from_fn(|axis| spread(&points, axis));
        let bounds = (!points.is_empty())
            .then(|| ([f64::from(x[0]), f64::from(y[0])], [f64::from(x[1]), f64::from(y[1])]));
        Ok(Self { points, heights: z, bounds, far })
    }

    /// Renders the visible points, the highest on top, with `per_point` pixels per screen point.
    pub(super) fn paint(&self, canvas: Rect, viewport: Viewport, per_point: f32) -> ColorImage {
        let size = (canvas.size() * per_point).ceil();
        let (width, height) = (size.x.max(1.0) as usize, size.y.max(1.0) as usize);
        let mut pixels = vec![Color32::TRANSPARENT; width * height];
        let mut top = vec![f32::NEG_INFINITY; width * height];
        let [low, high] = self.heights.map(f64::from);
        for &[x, y, z] in &self.points {
            let at = (viewport.to_screen(canvas, [f64::from(x), f64::from(y)]) - canvas.min) * per_point;
            // Each point covers two by two pixels, so that a single one is visible.
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                if !(at.x >= 0.0 && at.y >= 0.0 && at.x < width as f32 && at.y < height as f32) {
                    continue;
                }
                let (px, py) = (at.x as usize + dx, at.y as usize + dy);
                if px >= width || py >= height {
                    continue;
                }
                let index = py * width + px;
                if z > top[index] {
                    top[index] = z;
                    pixels[index] = palette::even((f64::from(z) - low) / (high - low).max(1e-3));
                }
            }
        }
        ColorImage::new([width, height], pixels)
    }
}

/// The 2nd and 98th percentile along an axis.
fn spread(points: &[[f32; 3]], axis: usize) -> [f32; 2] {
    let every = (points.len() / 20_000).max(1);
    let mut values: Vec<f32> = points.iter().step_by(every).map(|p| p[axis]).collect();
    values.sort_by(f32::total_cmp);
    let last = values.len().saturating_sub(1) as f32;
    [0.02, 0.98].map(|fraction| values.get((last * fraction) as usize).copied().unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use egui::{Pos2, Vec2};

    #[test]
    fn the_highest_point_of_a_pixel_is_on_top() {
        let cloud = Cloud::new(
            &samples::cloud(&[[0.0, 0.0, 5.0], [0.0, 0.0, 1.0], [f32::NAN, 0.0, 9.0]]),
            &Pose::IDENTITY,
        );
        let cloud = cloud.unwrap();
        assert_eq!((cloud.points.len(), cloud.far), (2, 0));
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(9.0));
        let viewport = Viewport { center: [0.0, 0.0], scale: 1.0, y_up: true, turned_rad: 0.0 };
        let image = cloud.paint(canvas, viewport, 1.0);
        assert_eq!(image.pixels[4 * 9 + 4], palette::even(1.0));
        assert_eq!(image.pixels.iter().filter(|pixel| **pixel != Color32::TRANSPARENT).count(), 4);
    }

    #[test]
    fn points_that_can_be_no_place_are_counted_and_neither_drawn_nor_fitted() {
        let far =
            samples::cloud(&[[1.0, 2.0, 3.0], [f32::MAX, 0.0, 0.0], [0.0, 1e18, 0.0], [0.0, 0.0, -1e30]]);
        let cloud = Cloud::new(&far, &Pose::IDENTITY).unwrap();
        assert_eq!((cloud.points.len(), cloud.far), (1, 3));
        assert_eq!(cloud.bounds, Some(([1.0, 2.0], [1.0, 2.0])));
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(9.0));
        for scale in [1e-9, 1.0, 1e9] {
            let viewport = Viewport { center: [1.0, 2.0], scale, y_up: true, turned_rad: 0.0 };
            let image = cloud.paint(canvas, viewport, 1.0);
            assert_eq!(image.pixels.iter().filter(|pixel| **pixel != Color32::TRANSPARENT).count(), 4);
        }
    }

    #[test]
    fn an_empty_cloud_paints_nothing() {
        let cloud = Cloud::new(&samples::cloud(&[]), &Pose::IDENTITY).unwrap();
        assert_eq!(cloud.bounds, None);
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(4.0));
        let viewport = Viewport { center: [0.0, 0.0], scale: 1.0, y_up: true, turned_rad: 0.0 };
        assert!(cloud.paint(canvas, viewport, 1.0).pixels.iter().all(|pixel| *pixel == Color32::TRANSPARENT));
    }
}
