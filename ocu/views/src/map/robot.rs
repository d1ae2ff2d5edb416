//! The robot by the transforms: where its own coordinate frame is. Frames are known by the names that ROS gives to that of a
//! robot (REP 105); others could be those of a sensor or of a thing that it carries.

use crate::clip::is_place;
use ocu_ui::stale::LEAST_S;
use rcs_runtime::source::Frame;

/// Last parts of the names of a robot's frame, the usual one first.
const NAMES: [&str; 2] = ["base_link", "base_footprint"];
/// Distance up to which a track belongs to the robot, m.
const SAME_M: f64 = 2.0;
/// Steps of the middle of the surroundings, and how far they reach from it, m.
const SURROUNDINGS_M: f64 = 10.0;
/// Distance along an axis up to which the middle of the surroundings stays: more than half a step, m.
const STAYS_M: f64 = 0.7 * SURROUNDINGS_M;

/// Where the robot is on the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Robot {
    /// x, y in m and heading in rad.
    pub(super) place: [f64; 3],
    /// Whether the transform by which it moves reaches about to the viewed time.
    pub(super) is_current: bool,
}

impl Robot {
    /// The robot whose frame moves in that of the map; `None` if there is none, if there are several, or if all transforms
    /// above its frame are static.
    pub(super) fn of(frame: &Frame, map: &str) -> Option<Self> {
        let name = own_frame(frame)?;
        let (tree, now) = (&frame.transforms, frame.transform_time(frame.now));
        // As everything on the map: before the first sample by the first, and after the last by the last.
        let pose = tree.lookup_nearest(map, name, now.0).ok()?;
        let [x, y] = [pose.translation.x, pose.translation.y];
        // It moves by the first transform above its frame that is not static.
        let mut child = name;
        let is_current = loop {
            let parent = tree.parent(child)?;
            match tree.newest_until(parent, child, now.0) {
                Ok(None) => child = parent,
                Ok(Some(newest_ns)) => break now.0.saturating_sub(newest_ns) as f64 * 1e-9 <= LEAST_S,
                Err(_) => break false,
            }
        };
        is_place(&[x, y]).then_some(Self { place: [x, y, pose.yaw()], is_current })
    }

    /// The robot where it gets a mark of its own, and the place of the vehicle, which the map follows and by which it is
    /// turned. `tracks` are the places of what the visible tracks belong to, x, y in m and heading in rad, with the ages of
    /// their messages, s. One near the robot is the robot, and has a mark. Others are of other things, or were clicked once,
    /// such as a goal: where the robot is not current, the first one with a new message is the vehicle, and where there is
    /// no robot, the first one.
    pub(super) fn beside(
        frame: &Frame,
        map: &str,
        tracks: &[([f64; 3], f64)],
    ) -> (Option<Self>, Option<[f64; 3]>) {
        let place = |(place, _): &([f64; 3], f64)| *place;
        let Some(robot) = Self::of(frame, map) else { return (None, tracks.first().map(place)) };
        let is_new = |(_, age_s): &&([f64; 3], f64)| !robot.is_current && *age_s <= LEAST_S;
        let vehicle = tracks.iter().find(is_new).map_or(robot.place, place);
        let is_it = |[x, y, _]: [f64; 3]| (x - robot.place[0]).hypot(y - robot.place[1]) <= SAME_M;
        ((!tracks.iter().map(place).any(is_it)).then_some(robot), Some(vehicle))
    }
}

/// Lower and upper corner of the surroundings of the robot, or of the origin of the map if there is no robot, m. Their
/// middle is rounded, and `kept`, the middle of the pass before, stays until the robot is far from it, so that a map that
/// shows them stands still while the robot moves, and where it stands between two middles.
pub(super) fn surroundings(frame: &Frame, map: &str, kept: &mut Option<[f64; 2]>) -> ([f64; 2], [f64; 2]) {
    let [x, y, _] = Robot::of(frame, map).map_or([0.0; 3], |robot| robot.place);
    let stays = |middle: &[f64; 2]| (x - middle[0]).abs().max((y - middle[1]).abs()) <= STAYS_M;
    let rounded = || [x, y].map(|v| (v / SURROUNDINGS_M).round() * SURROUNDINGS_M);
    let middle = kept.filter(stays).unwrap_or_else(rounded);
    *kept = Some(middle);
    (middle.map(|v| v - SURROUNDINGS_M), middle.map(|v| v + SURROUNDINGS_M))
}

/// The coordinate frame of the robot; its name may begin with that of the robot, as in `robot1/base_link`. One without a
/// parent moves nowhere. `None` if there is none, or if there are several of the usual name.
pub(super) fn own_frame(frame: &Frame) -> Option<&str> {
    let frames = frame.transforms.frames();
    for wanted in NAMES {
        let is_own =
            |name: &&str| name.rsplit('/').next() == Some(wanted) && frame.transforms.parent(name).is_some();
        let own: Vec<&str> = frames.iter().copied().filter(is_own).collect();
        match own.as_slice() {
            [] => {}
            [one] => return Some(*one),
            _ => return None,
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use rcs_geom::{DVec3, Pose, TransformTree};
    use std::sync::Arc;

    /// A frame of a recording with transforms alone; each moves by 1 m to the east in the last second.
    fn with(links: &[(&str, &str)]) -> Frame {
        with_static(links, &[])
    }

    /// As [`with`], with other transforms that are static.
    fn with_static(links: &[(&str, &str)], fixed: &[(&str, &str)]) -> Frame {
        let frame = samples::empty();
        let now = frame.transform_time(frame.now).0;
        let mut tree = TransformTree::new();
        for (parent, child) in links {
            for (time_ns, x) in [(now - 1_000_000_000, 2.0), (now, 3.0)] {
                tree.insert(parent, child, time_ns, Pose::from_xy_yaw(x, 1.0, 0.5)).unwrap();
            }
        }
        for (parent, child) in fixed.iter().chain(&[("base_link", "lidar")]) {
            tree.set_static(parent, child, Pose::from_translation(DVec3::Z)).unwrap();
        }
        Frame { transforms: Arc::new(tree), ..frame }
    }

    #[test]
    fn a_recording_with_transforms_alone_has_its_robot_where_its_frame_is() {
        let frame = with(&[("map", "base_link")]);
        let robot = Robot::of(&frame, "map").unwrap();
        let [x, y, yaw] = robot.place;
        assert!((x - 3.0).abs() < 1e-9 && (y - 1.0).abs() < 1e-9 && (yaw - 0.5).abs() < 1e-9, "{robot:?}");
        assert!(robot.is_current);
        let later = Frame { now: frame.now.after_ns(5_000_000_000), ..frame.clone() };
        assert_eq!(Robot::of(&later, "map").map(|robot| robot.is_current), Some(false));
        // Neither a frame that is not connected, nor what nobody knows to be a robot.
        assert_eq!(Robot::of(&frame, "moon"), None);
        assert_eq!(Robot::of(&with(&[("map", "trailer")]), "map"), None);
    }

    #[test]
    fn a_robot_is_as_old_as_the_transform_by_which_it_moves() {
        let above = [("base_footprint", "base_link")];
        let frame = with_static(&[("odom", "base_footprint")], &above);
        assert_eq!(Robot::of(&frame, "odom").map(|robot| robot.is_current), Some(true));
        let later = Frame { now: frame.now.after_ns(5_000_000_000), ..frame };
        assert_eq!(Robot::of(&later, "odom").map(|robot| robot.is_current), Some(false));
        let fixed = with_static(&[], &[("odom", "base_footprint"), above[0]]);
        assert_eq!(Robot::of(&fixed, "odom"), None, "it moves nowhere");
    }

    #[test]
    fn a_place_that_was_clicked_neither_hides_the_robot_nor_is_followed() {
        let frame = with(&[("map", "base_link")]);
        let robot = Robot::of(&frame, "map").unwrap();
        let [goal, own, odometry] =
            [([30.0, 1.0, 0.0], 60.0), ([3.5, 1.0, 0.5], 0.05), ([8.0, 1.0, 0.5], 0.05)];
        assert_eq!(Robot::beside(&frame, "map", &[goal]), (Some(robot), Some(robot.place)));
        assert_eq!(Robot::beside(&frame, "map", &[goal, own]), (None, Some(robot.place)));
        // Where the transforms have ended, a track that goes on is the vehicle, and where there are none, the first one.
        let later = Frame { now: frame.now.after_ns(5_000_000_000), ..frame };
        let old = Robot::of(&later, "map").unwrap();
        assert_eq!(Robot::beside(&later, "map", &[goal]), (Some(old), Some(old.place)));
        assert_eq!(Robot::beside(&later, "map", &[goal, odometry]), (Some(old), Some(odometry.0)));
        assert_eq!(Robot::beside(&with(&[]), "map", &[goal, own]), (None, Some(goal.0)));
        assert_eq!(Robot::beside(&with(&[]), "map", &[]), (None, None));
    }

    #[test]
    fn a_map_with_a_robot_alone_stands_still_while_it_moves() {
        let frame = with(&[("map", "base_link")]);
        let before = Frame { now: frame.now.before_ns(1_000_000_000), ..frame.clone() };
        let [before_x, x] = [&before, &frame].map(|frame| Robot::of(frame, "map").unwrap().place[0]);
        assert!(x - before_x > 0.9, "{before_x} {x}");
        let around = |frame: &Frame, map: &str| surroundings(frame, map, &mut None);
        assert_eq!(around(&before, "map"), around(&frame, "map"));
        assert_eq!(around(&frame, "moon"), ([-10.0; 2], [10.0; 2]));
    }

    #[test]
    fn a_map_with_a_robot_alone_stands_still_where_it_stands_between_two_middles() {
        let frame = samples::empty();
        let now = frame.transform_time(frame.now).0;
        let mut kept = None;
        let middles_m = [4.99, 5.01, 4.99, 7.1, 5.01, 4.99].map(|x_m| {
            let mut tree = TransformTree::new();
            tree.insert("map", "base_link", now, Pose::from_xy_yaw(x_m, 0.0, 0.0)).unwrap();
            let frame = Frame { transforms: Arc::new(tree), ..frame.clone() };
            surroundings(&frame, "map", &mut kept).0[0] + SURROUNDINGS_M
        });
        assert_eq!(middles_m, [0.0, 0.0, 0.0, 10.0, 10.0, 10.0]);
    }

    #[test]
    fn of_several_robots_none_is_chosen_and_a_name_may_have_a_prefix() {
        let own = |links: &[(&str, &str)]| own_frame(&with(links)).map(str::to_owned);
        assert_eq!(own(&[("map", "a/base_link")]).as_deref(), Some("a/base_link"));
        assert_eq!(own(&[("map", "a/base_link"), ("map", "b/base_link")]), None);
        let with_footprint = [("map", "a/base_link"), ("map", "b/base_link"), ("map", "a/base_footprint")];
        assert_eq!(own(&with_footprint), None, "one of them has two frames");
        assert_eq!(own(&[("map", "base_footprint")]).as_deref(), Some("base_footprint"));
        assert_eq!(own(&[]), None, "a frame without a parent");
    }
}
