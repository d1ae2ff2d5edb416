//! Conditions under which ground is not learned (Albus 2006a, 3.1.2): the vehicle stands, it turns fast, or an obstacle
//! of the world model projects into the ground sample.
//!
//! Difference from the paper: only obstacles that were seen by their shape or touched count (stereo, infrared, bumper, and
//! any range sensor that a stack adds). If costs of the colour models counted too, ground of a new colour would remain an
//! obstacle in the sample, and a vehicle that drives on it could never learn it. What the fused cost calls free does not
//! count either: experience has shown that it gives way. For a map without such sources the fused cost alone is used.

use crate::histogram::Span;
use crate::region::{Rectangle, contains};
use glam::DVec3;
use rcs_geom::{PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_sense::{Standing, is_obstacle, plane_height};
use rcs_world::{Field, GridView, Source};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Motion of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// m/s.
    pub speed_mps: f64,
    /// Magnitude of the turn rate, rad/s.
    pub turn_rate_radps: f64,
}

/// Longest time between two images from whose poses motion is derived, s.
const LONGEST_S: f64 = 2.0;
/// Shortest time between them, ns. Where images come faster than poses, one image has the same pose as the image before,
/// and the next one a pose that leapt: from one image to the next, the vehicle seems to stand and to race in turn.
const SHORTEST_NS: u64 = 150_000_000;

/// Derives motion from the vehicle's poses at images.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Odometer {
    /// Times of the last images and the poses at them, oldest first: those nearer to the newest one than [`SHORTEST_NS`], and
    /// one before them.
    past: VecDeque<(Stamp, Pose)>,
}

impl Odometer {
    /// Takes the pose at an image. Returns the motion since the newest image that is at least 0.15 s older; `None` where there
    /// is none, and where it is more than 2 s older.
    pub fn take(&mut self, time: Stamp, local_from_vehicle: &Pose) -> Option<Motion> {
        // Later images are of a clock that has begun again, or came with a time from the future.
        self.past.retain(|&(past, _)| past < time);
        let is_older = |&(past, _): &(Stamp, Pose)| time.0.abs_diff(past.0) >= SHORTEST_NS;
        while self.past.get(1).is_some_and(is_older) {
            self.past.pop_front();
        }
        let before = self.past.front().copied().filter(is_older);
        self.past.push_back((time, *local_from_vehicle));
        let (then, local_from_then) = before?;
        let elapsed_s = time.seconds_since(then);
        if elapsed_s > LONGEST_S {
            return None;
        }
        let step = local_from_then.inverse() * *local_from_vehicle;
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

/// The costs of the sources that see obstacles by their shape or touch them: of all but those that judge by appearance
/// ([`GridView::is_learned`]), of slip, and of the map of an earlier run.
pub(crate) fn solid<'a>(map: &'a GridView<'_>) -> Vec<Field<'a>> {
    let is_solid =
        |source: &Source| !map.is_learned(*source) && ![Source::SLIP, Source::MEMORY].contains(source);
    let sources = map.sources();
    sources.iter().filter(is_solid).filter_map(|source| map.field(&format!("cost.{source}")).ok()).collect()
}

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
    let solid = solid(map);
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
    fn a_range_sensor_of_any_name_blocks_and_what_is_remembered_or_slippery_does_not() {
        let sonar = Source::new("sonar").unwrap();
        assert!(blocked([1.8, 0.0], 0.0, sonar, 250));
        assert!(!blocked([1.8, 0.0], 0.0, sonar, 40));
        assert!(!blocked([1.8, 0.0], 0.0, Source::MEMORY, 250));
        assert!(!blocked([1.8, 0.0], 0.0, Source::SLIP, 250));
    }

    #[test]
    fn motion_is_what_lies_between_two_images() {
        let mut odometer = Odometer::default();
        let at = |s: f64| Stamp((s * 1e9) as u64);
        assert_eq!(odometer.take(at(1.0), &Pose::IDENTITY), None);
        let motion = odometer.take(at(1.2), &Pose::from_xy_yaw(0.2, 0.0, -0.1)).unwrap();
        assert!((motion.speed_mps - 1.0).abs() < 1e-9 && (motion.turn_rate_radps - 0.5).abs() < 1e-9);
        assert_eq!(odometer.take(at(9.0), &Pose::IDENTITY), None, "too long ago");
        assert_eq!(odometer.take(at(9.1), &Pose::IDENTITY), None, "nothing shortly before");
        assert_eq!(odometer.take(at(0.5), &Pose::IDENTITY), None, "the clock has begun again");
    }

    #[test]
    fn a_vehicle_whose_poses_come_less_often_than_images_neither_stands_nor_races() {
        // 20 images a second at 1 m/s, of which every second one has the pose of the one before.
        let mut odometer = Odometer::default();
        let speeds: Vec<Option<f64>> = (0..20_u32)
            .map(|image| {
                let pose = Pose::from_xy_yaw(0.1 * f64::from(image / 2), 0.0, 0.0);
                let motion = odometer.take(Stamp(50_000_000 * u64::from(image)), &pose);
                motion.map(|motion| motion.speed_mps)
            })
            .collect();
        assert_eq!(speeds[..3], [None; 3]);
        let near_1 = 0.6..1.4;
        assert!(speeds[3..].iter().all(|speed| speed.is_some_and(|mps| near_1.contains(&mps))), "{speeds:?}");
    }
}
