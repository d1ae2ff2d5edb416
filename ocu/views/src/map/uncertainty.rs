//! The uncertainty of a position on the map, as the ellipse of two standard deviations.

use super::layers::Layer;
use crate::canvas::Viewport;
use egui::{Color32, Painter, Pos2, Rect, Shape, Stroke};
use rcs_geom::Pose;
use rcs_msg::foxglove::location_fix::PositionCovarianceType;
use rcs_msg::foxglove::{LocationFix, Odometry};

/// Number of standard deviations that are shown.
pub(super) const SIGMAS: f64 = 2.0;
/// Points of the ellipse.
const POINTS: u32 = 48;
/// A smaller ellipse is hidden by the vehicle, points.
const LEAST: f32 = 6.0;

/// The covariance of x and y, m²: variances of x and y, and their covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Covariance {
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Covariance {
    /// That of the newest message of a layer; `None` if it states none, or an impossible one.
    pub(super) fn of(layer: &Layer<'_>) -> Option<Self> {
        let message = layer.topic?.canonical()?;
        let (matrix, side) = if let Some(odometry) = message.get::<Odometry>() {
            (&odometry.pose_covariance, 6)
        } else {
            let fix = message.get::<LocationFix>()?;
            let is_known = fix.position_covariance_type() != PositionCovarianceType::Unknown;
            (is_known.then_some(&fix.position_covariance)?, 3)
        };
        let at = |row: usize, column: usize| matrix.get(row * side + column).copied();
        let covariance = Self { xx: at(0, 0)?, xy: at(0, 1)?, yy: at(1, 1)? };
        covariance.is_possible().then_some(covariance)
    }

    fn is_possible(&self) -> bool {
        let Self { xx, xy, yy } = *self;
        xx.is_finite() && yy.is_finite() && xx > 0.0 && yy > 0.0 && xy * xy <= xx * yy
    }

    /// The greatest standard deviation in any direction, m.
    pub(super) fn most_m(&self) -> f64 {
        let (mean, half) = (f64::midpoint(self.xx, self.yy), (self.xx - self.yy) / 2.0);
        (mean + half.hypot(self.xy)).sqrt()
    }

    /// Points of the ellipse around the origin, m.
    fn ellipse(&self) -> impl Iterator<Item = [f64; 2]> {
        // The circle, transformed by the Cholesky factor.
        let a = self.xx.sqrt();
        let b = self.xy / a;
        let c = (self.yy - b * b).max(0.0).sqrt();
        (0..POINTS).map(move |point| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(point) / f64::from(POINTS)).sin_cos();
            [SIGMAS * a * cos, SIGMAS * (b * cos + c * sin)]
        })
    }
}

/// Paints the ellipse around a position on the map.
pub(super) fn paint(
    painter: &Painter,
    covariance: &Covariance,
    [x, y]: [f64; 2],
    map_from_track: &Pose,
    viewport: Viewport,
    canvas: Rect,
    color: Color32,
) {
    let (sin, cos) = map_from_track.yaw().sin_cos();
    let turned = covariance.ellipse().map(|[dx, dy]| [x + cos * dx - sin * dy, y + sin * dx + cos * dy]);
    let points: Vec<Pos2> = turned.map(|point| viewport.to_screen(canvas, point)).collect();
    let bounds = Rect::from_points(&points);
    // An ellipse that covers everything, or nothing, says nothing.
    let is_shown = bounds.is_finite() && bounds.size().max_elem() >= LEAST && !bounds.contains_rect(canvas);
    if is_shown {
        let fill = color.gamma_multiply(0.12);
        painter.add(Shape::convex_polygon(points, fill, Stroke::new(1.0, color.gamma_multiply(0.8))));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_of_the_ellipse_is_two_standard_deviations_away() {
        let covariance = Covariance { xx: 0.5, xy: 0.2, yy: 0.3 };
        assert!(covariance.is_possible());
        let determinant = 0.5 * 0.3 - 0.2 * 0.2;
        let mut longest: f64 = 0.0;
        for [x, y] in covariance.ellipse() {
            // Mahalanobis distance, with the inverse of the matrix.
            let distance = ((0.3 * x * x - 0.4 * x * y + 0.5 * y * y) / determinant).sqrt();
            assert!((distance - SIGMAS).abs() < 1e-9, "{distance}");
            longest = longest.max(x.hypot(y));
        }
        assert!((longest / SIGMAS - covariance.most_m()).abs() < 2e-3);
        let impossible = [[0.0, 0.0, 1.0], [1.0, 1.1, 1.0], [f64::NAN, 0.0, 1.0], [-1.0, 0.0, 1.0]];
        for [xx, xy, yy] in impossible {
            assert!(!Covariance { xx, xy, yy }.is_possible());
        }
    }
}
