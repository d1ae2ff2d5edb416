//! A point cloud seen from above, rendered as pixels of the canvas.

use crate::canvas::Viewport;
use crate::clip::is_place;
use crate::cloud_colors::{CloudColors, range};
use egui::{Color32, ColorImage, Rect};
use rcs_geom::Pose;
use rcs_msg::foxglove::PointCloud;
use rcs_msg::{Point, points};

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
    /// Reads a cloud; the error says why it cannot be read.
    pub(super) fn new(cloud: &PointCloud, map_from_frame: &Pose) -> Result<Self, String> {
        let map_from_cloud = *map_from_frame * crate::pose::from_message(cloud.pose.as_ref())?;
        let read = points(cloud).map_err(|error| error.to_string())?;
        let placed = read.iter().map(|point| Point { position: map_from_cloud * point.position, ..point });
        let (all, far): (Vec<Point>, Vec<Point>) = placed
            .filter(|point| point.position.is_finite())
            .partition(|point| is_place(&point.position.to_array()));
        let [x, y] = [0, 1].map(|axis| range(&all, |point| Some(point.position[axis])));
        let bounds = x.zip(y).map(|(x, y)| ([x[0], y[0]], [x[1], y[1]]));
        let origin = bounds.map_or([0.0; 2], |(low, _)| low);
        let colors = CloudColors::of(&all);
        let points = all.iter().map(|point| {
            let [x, y, z] = point.position.to_array();
            ([(x - origin[0]) as f32, (y - origin[1]) as f32, z as f32], colors.at(point))
        });
        Ok(Self { points: points.collect(), origin, colors, bounds, far: far.len() })
    }

    /// Renders the visible points, the highest on top, with `per_point` pixels per screen point.
    pub(super) fn paint(&self, canvas: Rect, viewport: Viewport, per_point: f32) -> ColorImage {
        let size = (canvas.size() * per_point).ceil();
        let (width, height) = (size.x.max(1.0) as usize, size.y.max(1.0) as usize);
        let mut pixels = vec![Color32::TRANSPARENT; width * height];
        let mut top = vec![f32::NEG_INFINITY; width * height];
        let [east, north] = self.origin;
        for &([x, y, z], color) in &self.points {
            let place = [east + f64::from(x), north + f64::from(y)];
            let at = (viewport.to_screen(canvas, place) - canvas.min) * per_point;
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
    fn a_cloud_far_from_the_origin_keeps_its_shape() {
        let utm = DVec3::new(308_200.0, 4_333_600.0, 0.0);
        let square = samples::cloud(&[[0.0, 0.0, 0.0], [0.0, 0.3, 1.0], [0.3, 0.0, 2.0], [0.3, 0.3, 3.0]]);
        let canvas = Rect::from_min_size(Pos2::ZERO, Vec2::splat(40.0));
        let painted = |at: DVec3| {
            let center = [at.x + 0.15, at.y + 0.15];
            let viewport = Viewport { center, scale: 50.0, y_up: true, turned_rad: 0.0 };
            Cloud::new(&square, &Pose::from_translation(at)).unwrap().paint(canvas, viewport, 1.0).pixels
        };
        assert_eq!(painted(utm), painted(DVec3::ZERO));
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
