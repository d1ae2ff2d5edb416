//! The robot of a recording without positions: where its own coordinate frame is by the transforms. Frames are known by the
//! names that ROS gives to that of a robot (REP 105); others could be those of a sensor or of a thing that it carries.

use crate::clip::is_place;
use rcs_runtime::source::Frame;

/// Last parts of the names of a robot's frame, the usual one first.
const NAMES: [&str; 2] = ["base_link", "base_footprint"];
/// Age from which the newest transform is outdated, s.
const OLD_S: f64 = 1.2;

/// Where the robot is on the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Robot {
    /// x, y in m and heading in rad.
    pub(super) place: [f64; 3],
    /// Whether its own transform reaches about to the viewed time.
    pub(super) is_current: bool,
}

impl Robot {
    /// The robot whose frame moves in that of the map; `None` if there is none, or if there are several.
    pub(super) fn of(frame: &Frame, map: &str) -> Option<Self> {
        let name = own_frame(frame)?;
        let (tree, now) = (&frame.transforms, frame.transform_time(frame.now));
        // As everything on the map: before the first sample by the first, and after the last by the last.
        let pose = tree.lookup_nearest(map, name, now.0).ok()?;
        let [x, y] = [pose.translation.x, pose.translation.y];
        let is_current = match tree.newest_until(tree.parent(name)?, name, now.0) {
            Ok(Some(newest_ns)) => now.0.saturating_sub(newest_ns) as f64 * 1e-9 <= OLD_S,
            Ok(None) => true,
            Err(_) => false,
        };
        is_place(&[x, y]).then_some(Self { place: [x, y, pose.yaw()], is_current })
    }
}

/// The coordinate frame of the robot; its name may begin with that of the robot, as in `robot1/base_link`. One without a
/// parent moves nowhere.
pub(super) fn own_frame(frame: &Frame) -> Option<&str> {
    let frames = frame.transforms.frames();
    let named = |wanted: &str| {
        let is_own =
            |name: &&str| name.rsplit('/').next() == Some(wanted) && frame.transforms.parent(name).is_some();
        let own: Vec<&str> = frames.iter().copied().filter(is_own).collect();
        if let [one] = own.as_slice() { Some(*one) } else { None }
    };
    NAMES.into_iter().find_map(named)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use rcs_geom::{DVec3, Pose, TransformTree};
    use std::sync::Arc;

    /// A frame of a recording with transforms alone; each moves by 1 m to the east in the last second.
    fn with(links: &[(&str, &str)]) -> Frame {
        let frame = samples::empty();
        let now = frame.transform_time(frame.now).0;
        let mut tree = TransformTree::new();
        for (parent, child) in links {
            for (time_ns, x) in [(now - 1_000_000_000, 2.0), (now, 3.0)] {
                tree.insert(parent, child, time_ns, Pose::from_xy_yaw(x, 1.0, 0.5)).unwrap();
            }
        }
        tree.set_static("base_link", "lidar", Pose::from_translation(DVec3::Z)).unwrap();
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
    fn of_several_robots_none_is_chosen_and_a_name_may_have_a_prefix() {
        let own = |links: &[(&str, &str)]| own_frame(&with(links)).map(str::to_owned);
        assert_eq!(own(&[("map", "a/base_link")]).as_deref(), Some("a/base_link"));
        assert_eq!(own(&[("map", "a/base_link"), ("map", "b/base_link")]), None);
        assert_eq!(own(&[("map", "base_footprint")]).as_deref(), Some("base_footprint"));
        assert_eq!(own(&[]), None, "a frame without a parent");
    }
}
