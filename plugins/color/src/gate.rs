//! Conditions under which ground is not learned (Albus 2006a, 3.1.2): the vehicle stands, it turns fast, or an obstacle
//! of the world model projects into the ground sample.
//!
//! Difference from the paper: only obstacles that were seen by their shape or touched (stereo, infrared, bumper) count.
//! If costs of the colour models counted too, ground of a new colour would remain an obstacle in the sample, and a
//! vehicle that drives on it could never learn it. What the fused cost calls free does not count either: experience has
//! shown that it gives way. For a map without these sources the fused cost alone is used.

use crate::histogram::Span;
use crate::region::{Rectangle, contains};
use glam::DVec3;
use rcs_geom::{PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_sense::{Standing, is_obstacle, plane_height};
use rcs_world::{Field, GridView};
use serde::{Deserialize, Serialize};

/// Motion of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// m/s.
    pub speed_mps: f64,
    /// Magnitude of the turn rate, rad/s.
    pub turn_rate_radps: f64,
}

/// Longest time between two poses from which speed is derived, s.
const LONGEST_S: f64 = 2.0;
/// Shortest time between two poses from which speed is derived, s: below it, noise dominates.
const SHORTEST_S: f64 = 0.01;

/// Derives motion from the vehicle's poses at consecutive images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Odometer(Option<(Stamp, Pose)>);

impl Odometer {
    /// Takes the pose at an image; `None` where there is no pose shortly before it.
    pub fn take(&mut self, time: Stamp, local_from_vehicle: &Pose) -> Option<Motion> {
        let last = self.0.replace((time, *local_from_vehicle));
        let (last_time, last_pose) = last?;
        let elapsed_s = time.seconds_since(last_time);
        if !(SHORTEST_S..=LONGEST_S).contains(&elapsed_s) {
            return None;
        }
        let step = last_pose.inverse() * *local_from_vehicle;
        Some(Motion {
            speed_mps: step.translation.length() / elapsed_s,
            turn_rate_radps: step.yaw().abs() / elapsed_s,
        })
    }
}

/// Number of points along an obstacle's height that are projected.
const PARTS: usize = 5;
/// Obstacles farther from the rectangle's edges than this cannot project into it, m.
const BEYOND_M: f64 = 2.0;
/// Sources that see obstacles by their shape or touch them.
pub(crate) const SOLID: [&str; 3] = ["cost.stereo", "cost.infrared", "cost.bumper"];

/// How the camera sees the ground sample.
#[derive(Clone, Copy, Debug)]
pub struct SampleView<'a> {
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// Extrinsics of the camera.
    pub vehicle_from_camera: &'a Pose,
    /// Pose of the vehicle in the map's frame.
    pub local_from_vehicle: &'a Pose,
    /// The sampled rectangle on the ground.
    pub rectangle: &'a Rectangle,
    /// Pixels of the rectangle.
    pub spans: &'a [Span],
}

/// Whether an obstacle of the map projects into the ground sample. An obstacle reaches from the ground height of its
/// cell (the vehicle's plane where the map has none) to its maximum height.
pub fn obstacle_in_sample(map: &GridView<'_>, view: &SampleView<'_>) -> bool {
    let solid: Vec<Field<'_>> = SOLID.iter().filter_map(|name| map.field(name).ok()).collect();
    let fields = if solid.is_empty() { map.field("cost").into_iter().collect() } else { solid };
    let fused = map.field("cost").ok();
    let blocks = |column: usize, row: usize| {
        let is = |field: &Field<'_>| is_obstacle(field, column, row);
        fields.iter().any(is) && fused.as_ref().is_none_or(is)
    };
    let standing = Standing::of(map);
    let vehicle_from_local = view.local_from_vehicle.inverse();
    let camera_from_vehicle = view.vehicle_from_camera.inverse();
    let near = |p: DVec3| {
        let r = view.rectangle;
        p.y.abs() <= 0.5 * r.width_m + BEYOND_M
            && (-BEYOND_M..=r.ahead_m + r.length_m + BEYOND_M).contains(&p.x)
    };
    let plane = plane_height(view.local_from_vehicle, view.rectangle.below_m);
    let reach_m = view.rectangle.ahead_m + view.rectangle.length_m + view.rectangle.width_m + 2.0 * BEYOND_M;
    let [columns, rows] = standing.around(view.local_from_vehicle.translation, reach_m);
    for row in rows {
        for column in columns.clone() {
            let place = standing.middle(column, row);
            // The height of the plane suffices to discard distant cells before any field is read.
            let Some(plane_z) = plane(place) else { continue };
            if !near(vehicle_from_local * place.extend(plane_z)) || !blocks(column, row) {
                continue;
            }
            let [foot, head] = standing.ends_m(column, row, plane_z);
            let inside = (0..PARTS).any(|part| {
                let z = foot + (head - foot) * part as f64 / (PARTS - 1) as f64;
                let point = camera_from_vehicle * (vehicle_from_local * place.extend(z));
                view.camera.project(point).is_some_and(|pixel| contains(view.spans, pixel))
            });
            if inside {
                return true;
            }
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::region::spans;
    use glam::DVec2;
    use rcs_geom::Distortion;
    use rcs_msg::foxglove::Grid;
    use rcs_world::{HeightStats, Map, MapOptions, Source, Sources, VoteRule, Weights};

    const RULE: VoteRule = VoteRule { rise: 60, fall: 20, obstacle_fall: 20, max: 255, ground_max: 255 };

    /// A map with one obstacle cell of this height, from this source.
    fn map_with(place: DVec2, height_m: f32, source: Source, cost: u8) -> Grid {
        let mut map = Map::new(0.2).unwrap();
        map.recentre(place).unwrap();
        let index = map.grid().cell_at(place).unwrap();
        map.vote(index, source, cost, 1, Stamp(1), RULE);
        let cell = map.cell_mut(index).unwrap();
        let mut heights = HeightStats::default();
        (0..9).for_each(|_| heights.add(height_m));
        if height_m > 0.0 {
            cell.observe_heights(&HeightStats::default(), &heights, 0.2, Stamp(1), RULE);
        }
        let sources: Sources = [Source::STEREO, source].into_iter().collect();
        map.to_grid("local", Stamp(1), &MapOptions { sources, heights: true, weights: Weights::default() })
    }

    /// Whether an obstacle at a position of the vehicle frame blocks the sample, for a vehicle at an arbitrary pose.
    fn blocked([x, y]: [f64; 2], height_m: f32, source: Source, cost: u8) -> bool {
        let camera =
            PinholeCamera::new([320, 240], [200.0, 200.0], [160.0, 120.0], Distortion::None).unwrap();
        let mount = Pose::from_rpy(DVec3::new(0.0, 0.0, 1.0), 0.0, 30_f64.to_radians(), 0.0)
            * Pose::body_from_optical();
        let rectangle = Rectangle { ahead_m: 0.6, length_m: 2.0, width_m: 1.0, below_m: 0.0 };
        let spans = spans(&rectangle.outline(&camera, &mount), [320, 240]);
        let local_from_vehicle = Pose::from_xy_yaw(12.0, -7.0, 0.7);
        let place = local_from_vehicle * DVec3::new(x, y, 0.0);
        let grid = map_with(place.truncate(), height_m, source, cost);
        let map = GridView::new(&grid).unwrap();
        let view = SampleView {
            camera: &camera,
            vehicle_from_camera: &mount,
            local_from_vehicle: &local_from_vehicle,
            rectangle: &rectangle,
            spans: &spans,
        };
        obstacle_in_sample(&map, &view)
    }

    #[test]
    fn an_obstacle_in_the_rectangle_is_in_the_sample_and_one_beside_or_beyond_is_not() {
        assert!(blocked([1.8, 0.0], 0.0, Source::STEREO, 250));
        assert!(blocked([2.3, 0.3], 0.5, Source::BUMPER, 250));
        for place in [[1.8, 1.1], [1.8, -1.1], [3.4, 0.0], [-1.5, 0.0]] {
            assert!(!blocked(place, 0.0, Source::STEREO, 250), "{place:?}");
        }
    }

    #[test]
    fn a_tall_obstacle_beside_the_line_of_sight_is_in_the_sample_by_its_top_alone() {
        // Nearer than the rectangle, and its base is outside of it: a tall obstacle still hides the sample.
        assert!(!blocked([0.42, 0.0], 0.0, Source::STEREO, 250));
        assert!(blocked([0.42, 0.0], 0.7, Source::STEREO, 250));
    }

    #[test]
    fn free_cells_and_what_the_colour_models_say_themselves_block_nothing() {
        assert!(!blocked([1.8, 0.0], 0.0, Source::STEREO, 40));
        assert!(!blocked([1.8, 0.0], 0.0, Source::COLOR, 250));
        assert!(!blocked([1.8, 0.0], 0.0, Source::TERRAIN, 250));
    }

    #[test]
    fn motion_is_what_lies_between_two_images() {
        let mut odometer = Odometer::default();
        let at = |s: f64| Stamp((s * 1e9) as u64);
        assert_eq!(odometer.take(at(1.0), &Pose::IDENTITY), None);
        let motion = odometer.take(at(1.2), &Pose::from_xy_yaw(0.2, 0.0, -0.1)).unwrap();
        assert!((motion.speed_mps - 1.0).abs() < 1e-9 && (motion.turn_rate_radps - 0.5).abs() < 1e-9);
        assert_eq!(odometer.take(at(1.2), &Pose::IDENTITY), None, "no time between");
        assert_eq!(odometer.take(at(9.0), &Pose::IDENTITY), None, "too long ago");
    }
}
