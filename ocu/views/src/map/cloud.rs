//! A point cloud seen from above, rendered as pixels of the canvas.

use crate::canvas::Viewport;
use crate::cloud_colors::{CloudColors, Colored, range};
use egui::{Color32, ColorImage, Rect};
use rcs_geom::Pose;
use rcs_msg::foxglove::PointCloud;

/// The points of a cloud in the map's frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cloud {
    /// x and y relative to `origin`, and z, m; colours.
    pub(super) points: Vec<([f32; 3], Color32)>,
    /// x and y near the points, m: 32-bit numbers have steps of half a metre at the northing of a UTM zone.
    origin: [f64; 2],
    /// By what they are coloured.
    pub(super) colors: CloudColors,
    /// The 2nd and 98th percentile along x and y, m.
    pub(super) bounds: Option<([f64; 2], [f64; 2])>,
    /// Number of implausible points, such as missing returns of a scanner.
    pub(super) far: usize,
}

impl Cloud {
    /// Reads a cloud and colours it by what was chosen; the error says why it cannot be read.
    pub(super) fn new(cloud: &PointCloud, map_from_frame: &Pose, by: Option<&str>) -> Result<Self, String> {
        let Colored { points, colors, far } = Colored::new(cloud, map_from_frame, by)?;
        let [x, y] = [0, 1].map(|axis| range(&points, |(place, _)| Some(place[axis])));
        let bounds = x.zip(y).map(|(x, y)| ([x[0], y[0]], [x[1], y[1]]));
        let origin = bounds.map_or([0.0; 2], |(low, _)| low);
        let points = points.iter().map(|(place, color)| {
            let [x, y, z] = place.to_array();
            ([(x - origin[0]) as f32, (y - origin[1]) as f32, z as f32], *color)
        });
        Ok(Self { points: points.collect(), origin, colors, bounds, far })
    }

    /// Renders the visible points, the highest on top, as squares of this side in screen points, of which each has
    /// `per_point` pixels.
    pub(super) fn paint(&self, canvas: Rect, viewport: Viewport, per_point: f32, side: f32) -> ColorImage {
        let size = (canvas.size() * per_point).ceil();
        let (width, height) = (size.x.max(1.0) as usize, size.y.max(1.0) as usize);
        let mut pixels = vec![Color32::TRANSPARENT; width * height];
        let mut top = vec![f32::NEG_INFINITY; width * height];
        let side = (side * per_point).round().max(1.0) as usize;
        let [east, north] = self.origin;
        for &([x, y, z], color) in &self.points {
            let place = [east + f64::from(x), north + f64::from(y)];
            let at = (viewport.to_screen(canvas, place) - canvas.min) * per_point;
            if !(at.x >= 0.0 && at.y >= 0.0 && at.x < width as f32 && at.y < height as f32) {
                continue;
            }
            let first = [at.x, at.y].map(|v| (v as usize).saturating_sub((side - 1) / 2));
            let rows = first[1]..(first[1] + side).min(height);
            let columns = first[0]..(first[0] + side).min(width);
            for (px, py) in rows.flat_map(|py| columns.clone().map(move |px| (px, py))) {
                let index = py * width + px;
                if z > top[index] {
                    top[index] = z;
                    pixels[index] = color;
                }
            }
        }
        ColorImage::new([width, height], pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use egui::{Pos2, Vec2};
    use ocu_ui::palette;
    use rcs_geom::DVec3;

    #[test]
    fn the_highest_point_of_a_pixel_is_on_top() {
        let cloud = Cloud::new(
            &samples::cloud(&[[0.0, 0.0, 5.0], [0.0, 0.0, 1.0], [f32::NAN, 0.0, 9.0]]),
            &Pose::IDENTITY,
            None,
        );
        let cloud = cloud.unwrap();
        assert_eq!((cloud.points.len(), cloud.far), (2, 0));
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(9.0));
        let viewport = Viewport { center: [0.0, 0.0], scale: 1.0, y_up: true, turned_rad: 0.0 };
        let image = cloud.paint(canvas, viewport, 1.0, 2.0);
        assert_eq!(image.pixels[4 * 9 + 4], palette::even(1.0));
        assert_eq!(image.pixels.iter().filter(|pixel| **pixel != Color32::TRANSPARENT).count(), 4);
    }

    #[test]
    fn points_that_can_be_no_place_are_counted_and_neither_drawn_nor_fitted() {
        let far =
            samples::cloud(&[[1.0, 2.0, 3.0], [f32::MAX, 0.0, 0.0], [0.0, 1e18, 0.0], [0.0, 0.0, -1e30]]);
        let cloud = Cloud::new(&far, &Pose::IDENTITY, None).unwrap();
        assert_eq!((cloud.points.len(), cloud.far), (1, 3));
        assert_eq!(cloud.bounds, Some(([1.0, 2.0], [1.0, 2.0])));
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(9.0));
        for scale in [1e-9, 1.0, 1e9] {
            let viewport = Viewport { center: [1.0, 2.0], scale, y_up: true, turned_rad: 0.0 };
            let image = cloud.paint(canvas, viewport, 1.0, 2.0);
            assert_eq!(image.pixels.iter().filter(|pixel| **pixel != Color32::TRANSPARENT).count(), 4);
        }
    }

    #[test]
    fn a_cloud_far_from_the_origin_keeps_its_shape() {
        let utm = DVec3::new(308_200.0, 4_333_600.0, 0.0);
        let square = samples::cloud(&[[0.0, 0.0, 0.0], [0.0, 0.3, 1.0], [0.3, 0.0, 2.0], [0.3, 0.3, 3.0]]);
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(40.0));
        let painted = |at: DVec3| {
            let center = [at.x + 0.15, at.y + 0.15];
            let viewport = Viewport { center, scale: 50.0, y_up: true, turned_rad: 0.0 };
            Cloud::new(&square, &Pose::from_translation(at), None)
                .unwrap()
                .paint(canvas, viewport, 1.0, 2.0)
                .pixels
        };
        assert_eq!(painted(utm), painted(DVec3::ZERO));
    }

    #[test]
    fn a_point_is_as_large_as_was_chosen() {
        let cloud = Cloud::new(&samples::cloud(&[[0.0, 0.0, 1.0]]), &Pose::IDENTITY, None).unwrap();
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(20.0));
        let viewport = Viewport { center: [0.0, 0.0], scale: 1.0, y_up: true, turned_rad: 0.0 };
        let painted = [1.0, 3.0, 8.0].map(|side| {
            let image = cloud.paint(canvas, viewport, 1.0, side);
            image.pixels.iter().filter(|pixel| **pixel != Color32::TRANSPARENT).count()
        });
        assert_eq!(painted, [1, 9, 64]);
    }

    #[test]
    fn an_empty_cloud_paints_nothing() {
        let cloud = Cloud::new(&samples::cloud(&[]), &Pose::IDENTITY, None).unwrap();
        assert_eq!(cloud.bounds, None);
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(4.0));
        let viewport = Viewport { center: [0.0, 0.0], scale: 1.0, y_up: true, turned_rad: 0.0 };
        assert!(
            cloud.paint(canvas, viewport, 1.0, 2.0).pixels.iter().all(|pixel| *pixel == Color32::TRANSPARENT)
        );
    }
}
