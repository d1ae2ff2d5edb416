//! Vehicle-wide arcs, and which cells of a grid they cover.

use rcs_geom::{DVec2, DVec3, Pose};
use rcs_world::GridView;

/// A path of constant curvature that leaves the origin of the vehicle frame along its x axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arc {
    /// Curvature, 1/m; positive to the left.
    pub(crate) curvature_per_m: f64,
}

impl Arc {
    /// Arcs with evenly spaced curvatures from the sharpest right turn to the sharpest left turn.
    pub(crate) fn fan(count: usize, sharpest_per_m: f64) -> Vec<Arc> {
        let middle = (count.max(1) - 1) as f64 / 2.0;
        let part = |number: usize| if middle > 0.0 { (number as f64 - middle) / middle } else { 0.0 };
        (0..count.max(1)).map(|number| Arc { curvature_per_m: part(number) * sharpest_per_m }).collect()
    }

    /// Distance along the arc to the point of it that is nearest to a position of the vehicle frame, and the distance
    /// from there, m.
    pub(crate) fn locate(self, place: DVec2) -> [f64; 2] {
        let k = self.curvature_per_m;
        if k.abs() < 1e-9 {
            return [place.x, place.y.abs()];
        }
        let radius = 1.0 / k.abs();
        let centre = DVec2::new(0.0, radius);
        let from_centre = DVec2::new(place.x, place.y * k.signum()) - centre;
        let angle = libm::atan2(from_centre.x, -from_centre.y);
        [radius * angle, (from_centre.length() - radius).abs()]
    }
}

/// A cell near an arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Covered {
    /// Index of the cell, by rows.
    pub(crate) cell: usize,
    /// Distance of its middle along the arc, m.
    pub(crate) along_m: f64,
    /// Whether its middle lies under the vehicle's width; otherwise it lies at most the tolerance beside it.
    pub(crate) inside: bool,
}

/// What is swept: the width of the vehicle, the part of each arc, and the tolerance around both.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::struct_field_names, reason = "the postfix is the unit")]
pub(crate) struct Sweep {
    pub(crate) half_width_m: f64,
    /// From the front of the vehicle to the end of the longest arc.
    pub(crate) along_m: [f64; 2],
    pub(crate) tolerance_m: f64,
}

/// The cells of a grid that each arc covers, for a vehicle at this pose of the grid's frame. The vehicle's tilt is
/// ignored.
pub(crate) fn covered(
    view: &GridView<'_>,
    frame_from_vehicle: &Pose,
    arcs: &[Arc],
    sweep: &Sweep,
) -> Vec<Vec<Covered>> {
    let level = Pose::from_xy_yaw(
        frame_from_vehicle.translation.x,
        frame_from_vehicle.translation.y,
        frame_from_vehicle.yaw(),
    );
    let vehicle_from_grid = level.inverse() * view.frame_from_grid();
    let vehicle = vehicle_from_grid.inverse().translation.truncate();
    let size = view.cell_size_m();
    let reach = sweep.along_m[1] + sweep.half_width_m + 2.0 * sweep.tolerance_m;
    let range = |at: f64, size: f64, cells: usize| {
        let end = |v: f64| (v / size).clamp(0.0, cells as f64) as usize;
        end(at - reach)..end(at + reach + size)
    };
    let mut covered = vec![Vec::new(); arcs.len()];
    for row in range(vehicle.y, size.y, view.rows()) {
        for column in range(vehicle.x, size.x, view.columns()) {
            let middle = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * size;
            let place = (vehicle_from_grid * DVec3::new(middle.x, middle.y, 0.0)).truncate();
            if place.length() > reach {
                continue;
            }
            for (arc, cells) in arcs.iter().zip(&mut covered) {
                let [along_m, beside_m] = arc.locate(place);
                if beside_m <= sweep.half_width_m + sweep.tolerance_m
                    && along_m >= sweep.along_m[0]
                    && along_m <= sweep.along_m[1] + sweep.tolerance_m
                {
                    let cell = row * view.columns() + column;
                    cells.push(Covered { cell, along_m, inside: beside_m <= sweep.half_width_m });
                }
            }
        }
    }
    covered
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn a_fan_reaches_from_the_sharpest_right_turn_to_the_sharpest_left_turn() {
        let curvatures: Vec<f64> = Arc::fan(5, 0.4).iter().map(|arc| arc.curvature_per_m).collect();
        assert_eq!(curvatures, [-0.4, -0.2, 0.0, 0.2, 0.4]);
        assert_eq!(Arc::fan(1, 0.4), [Arc { curvature_per_m: 0.0 }]);
    }

    #[test]
    fn positions_are_located_along_and_beside_the_arc() {
        let check = |curvature_per_m: f64, place: [f64; 2], expected: [f64; 2]| {
            let got = Arc { curvature_per_m }.locate(DVec2::from_array(place));
            let near = got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9);
            assert!(near, "{curvature_per_m} {place:?}: {got:?}");
        };
        check(0.0, [3.0, -0.4], [3.0, 0.4]);
        // A quarter of a circle of 2 m to the left ends at (2, 2); to the right at (2, -2).
        check(0.5, [2.0, 2.0], [2.0 * FRAC_PI_2, 0.0]);
        check(-0.5, [2.0, -2.0], [2.0 * FRAC_PI_2, 0.0]);
        check(-0.5, [2.3, -2.0], [2.0 * FRAC_PI_2, 0.3]);
        check(0.5, [0.0, -0.25], [0.0, 0.25]);
    }
}
