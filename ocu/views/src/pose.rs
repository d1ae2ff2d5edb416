//! Poses from messages, and the arrows by which those of a set are drawn.

use rcs_geom::{DVec3, Pose};
use rcs_msg::foxglove::{self, PosesInFrame};

/// Length of the arrows of a set of poses, m: that of RViz before a person changes it.
pub(crate) const ARROW_M: f64 = 0.3;
/// Of a larger set, every second, third, … pose is drawn.
const MOST_DRAWN: usize = 2_000;

/// The rigid transform of a message's pose; the identity where it has none.
pub(crate) fn from_message(pose: Option<&foxglove::Pose>) -> Result<Pose, String> {
    let Some(pose) = pose else { return Ok(Pose::IDENTITY) };
    let position = pose.position.unwrap_or_default();
    let rotation = pose.orientation.unwrap_or(foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 });
    let rotation = match [rotation.x, rotation.y, rotation.z, rotation.w] {
        // A missing orientation is decoded as four zeros.
        [0.0, 0.0, 0.0, 0.0] => [0.0, 0.0, 0.0, 1.0],
        rotation => rotation,
    };
    Pose::from_parts([position.x, position.y, position.z], rotation).map_err(|error| error.to_string())
}

/// The poses of a set that are drawn, in the frame of the message. Impossible ones are left out.
pub(crate) fn drawn(set: &PosesInFrame) -> impl Iterator<Item = Pose> + '_ {
    let every = set.poses.len().div_ceil(MOST_DRAWN).max(1);
    set.poses.iter().step_by(every).filter_map(|pose| from_message(Some(pose)).ok())
}

/// The lines of an arrow from a pose along its x axis: the shaft, and both sides of the head.
pub(crate) fn arrow(pose: &Pose, length_m: f64) -> [[DVec3; 2]; 3] {
    let at = |ahead: f64, left: f64| *pose * (DVec3::new(ahead, left, 0.0) * length_m);
    let tip = at(1.0, 0.0);
    [[at(0.0, 0.0), tip], [at(0.7, 0.2), tip], [at(0.7, -0.2), tip]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_huge_set_some_poses_are_drawn_and_of_a_small_one_all_that_can_be() {
        let count = |poses: Vec<foxglove::Pose>| {
            let set = PosesInFrame { poses, ..PosesInFrame::default() };
            drawn(&set).count()
        };
        assert_eq!(count(vec![foxglove::Pose::default(); 2_000]), 2_000);
        assert_eq!(count(vec![foxglove::Pose::default(); 4_001]), 1_334);
        let position = Some(foxglove::Vector3 { x: f64::NAN, y: 0.0, z: 0.0 });
        let impossible = foxglove::Pose { position, orientation: None };
        assert_eq!(count(vec![impossible, foxglove::Pose::default()]), 1);
        assert_eq!(count(Vec::new()), 0);
    }

    #[test]
    fn an_arrow_begins_at_its_pose_and_points_along_its_x_axis() {
        let [shaft, left, right] = arrow(&Pose::from_xy_yaw(1.0, 2.0, std::f64::consts::FRAC_PI_2), 0.3);
        assert!(shaft[0].distance(DVec3::new(1.0, 2.0, 0.0)) < 1e-12);
        for line in [shaft, left, right] {
            assert!(line[1].distance(DVec3::new(1.0, 2.3, 0.0)) < 1e-12, "{line:?}");
        }
    }
}
