//! Label images from labelled points, projected into a camera.

use crate::scan::Label;
use glam::DVec3;
use rcs_geom::PinholeCamera;

/// Paints each point (m, optical frame) as a square of `2·radius_px + 1` pixels into a label image of the camera's
/// size, one byte per pixel in row order. The nearest point wins; of two equally near ones, the first. Pixels without a
/// point are [`Label::Invalid`].
pub fn paint(
    camera: &PinholeCamera,
    points: impl IntoIterator<Item = (DVec3, u8)>,
    radius_px: u32,
    max_range_m: f64,
) -> Vec<u8> {
    let (width, height) = (i64::from(camera.width), i64::from(camera.height));
    let mut image = vec![Label::Invalid as u8; (width * height) as usize];
    let mut depths = vec![f32::INFINITY; image.len()];
    let radius = i64::from(radius_px);
    for (point, label) in points {
        if point.length() > max_range_m {
            continue;
        }
        let Some(pixel) = camera.project(point).filter(|&pixel| camera.contains(pixel)) else { continue };
        let (u, v) = (pixel.x.round() as i64, pixel.y.round() as i64);
        let depth = point.z as f32;
        for row in (v - radius).max(0)..=(v + radius).min(height - 1) {
            for column in (u - radius).max(0)..=(u + radius).min(width - 1) {
                let at = (row * width + column) as usize;
                if depth < depths[at] {
                    depths[at] = depth;
                    image[at] = label;
                }
            }
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> PinholeCamera {
        PinholeCamera::from_horizontal_fov([64, 48], 1.2).unwrap()
    }

    fn count(image: &[u8], label: u8) -> usize {
        image.iter().map(|&pixel| usize::from(pixel == label)).sum()
    }

    #[test]
    fn the_nearest_point_wins_and_what_is_behind_the_camera_is_not_seen() {
        let far = (DVec3::new(0.0, 0.0, 5.0), Label::Ground as u8);
        let near = (DVec3::new(0.0, 0.0, 2.0), Label::Obstacle as u8);
        let behind = (DVec3::new(0.0, 0.0, -1.0), Label::Cover as u8);
        let image = paint(&camera(), [far, near, behind], 1, 100.0);
        assert_eq!(count(&image, Label::Obstacle as u8), 9);
        assert!(!image.contains(&(Label::Ground as u8)));
        assert!(!image.contains(&(Label::Cover as u8)));
    }

    #[test]
    fn points_at_the_border_are_cut_and_far_ones_left_out() {
        let camera = camera();
        let corner = camera.unproject(glam::DVec2::ZERO).unwrap() * 3.0;
        let image = paint(&camera, [(corner, 1), (DVec3::new(0.0, 0.0, 60.0), 2)], 2, 50.0);
        assert_eq!(count(&image, 1), 9);
        assert!(!image.contains(&2));
    }
}
