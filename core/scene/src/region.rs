//! Regions of the ground: polygons, paths with a width, circles.

use rcs_geom::DVec2;

use crate::read::{SceneError, Table};

/// A part of the ground, m.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Region {
    Polygon(Vec<DVec2>),
    Path { points: Vec<DVec2>, half_width_m: f64 },
    Circle { centre: DVec2, radius_m: f64 },
}

impl Region {
    /// A table must have exactly one of `polygon`, `path` with `width_m`, or `circle = [x, y, radius]`.
    pub(crate) fn read(table: &mut Table<'_>) -> Result<Region, SceneError> {
        let polygon = table.points("polygon", 3)?;
        let path = table.points("path", 2)?;
        let circle = table.numbers::<3>("circle", crate::read::COORDINATE_M)?;
        match (polygon, path, circle) {
            (Some(points), None, None) => Ok(Region::Polygon(points)),
            (None, Some(points), None) => {
                let half_width_m = 0.5 * table.need_number("width_m", 0.05..=200.0)?;
                Ok(Region::Path { points, half_width_m })
            }
            (None, None, Some([x, y, radius_m])) if radius_m > 0.0 => {
                Ok(Region::Circle { centre: DVec2::new(x, y), radius_m })
            }
            (None, None, Some([_, _, radius_m])) => Err(table.error(
                "circle",
                format!("got radius {radius_m}, expected [x, y, radius] with a radius above 0"),
            )),
            _ => Err(table.error("polygon", "expected exactly one of polygon, path, circle")),
        }
    }

    /// Distance from the border, m; negative inside.
    pub(crate) fn distance_m(&self, at: DVec2) -> f64 {
        match self {
            Region::Polygon(points) => {
                let distance = closest_on_path(points, at)
                    .distance_m
                    .min(closest_on_path(&[points[points.len() - 1], points[0]], at).distance_m);
                if inside(points, at) { -distance } else { distance }
            }
            Region::Path { points, half_width_m } => closest_on_path(points, at).distance_m - half_width_m,
            Region::Circle { centre, radius_m } => at.distance(*centre) - radius_m,
        }
    }

    /// The bounding box, m: lower left and upper right corner.
    pub(crate) fn extent(&self) -> [DVec2; 2] {
        let (points, margin) = match self {
            Region::Polygon(points) => (points.as_slice(), 0.0),
            Region::Path { points, half_width_m } => (points.as_slice(), *half_width_m),
            Region::Circle { centre, radius_m } => (std::slice::from_ref(centre), *radius_m),
        };
        let low = points.iter().copied().fold(DVec2::splat(f64::INFINITY), DVec2::min);
        let high = points.iter().copied().fold(DVec2::splat(f64::NEG_INFINITY), DVec2::max);
        [low - margin, high + margin]
    }
}

/// The point of a path that is closest to a position.
pub(crate) struct Closest {
    pub(crate) distance_m: f64,
    /// Signed distance, positive to the left of the path's direction, m.
    pub(crate) side_m: f64,
}

/// The closest point of a path of at least two points (repeated points are allowed).
pub(crate) fn closest_on_path(points: &[DVec2], at: DVec2) -> Closest {
    let mut best = Closest { distance_m: f64::INFINITY, side_m: f64::INFINITY };
    for leg in points.windows(2) {
        let along = leg[1] - leg[0];
        let length2 = along.length_squared();
        let fraction = if length2 > 0.0 { ((at - leg[0]).dot(along) / length2).clamp(0.0, 1.0) } else { 0.0 };
        let distance_m = at.distance(leg[0] + along * fraction);
        if distance_m < best.distance_m {
            let left = along.perp_dot(at - leg[0]);
            best = Closest { distance_m, side_m: if left < 0.0 { -distance_m } else { distance_m } };
        }
    }
    best
}

/// Whether a position lies in a polygon, by counting crossings.
fn inside(points: &[DVec2], at: DVec2) -> bool {
    let mut inside = false;
    let mut last = points[points.len() - 1];
    for &point in points {
        if (point.y > at.y) != (last.y > at.y) {
            let crossing = point.x + (at.y - point.y) * (last.x - point.x) / (last.y - point.y);
            inside ^= at.x < crossing;
        }
        last = point;
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_negative_inside_and_grow_outside() {
        let square =
            Region::Polygon([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]].map(DVec2::from_array).to_vec());
        assert_eq!(square.distance_m(DVec2::new(2.0, 1.0)), -1.0);
        assert_eq!(square.distance_m(DVec2::new(-3.0, 2.0)), 3.0);
        assert_eq!(square.distance_m(DVec2::new(-3.0, 8.0)), 5.0);
        let path = Region::Path { points: vec![DVec2::ZERO, DVec2::new(10.0, 0.0)], half_width_m: 1.0 };
        assert_eq!(path.distance_m(DVec2::new(5.0, 3.0)), 2.0);
        assert_eq!(path.extent(), [DVec2::new(-1.0, -1.0), DVec2::new(11.0, 1.0)]);
        assert!(closest_on_path(&[DVec2::ZERO, DVec2::X], DVec2::new(0.5, -0.2)).side_m < 0.0);
    }
}
