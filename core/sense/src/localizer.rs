//! The pose of the vehicle, from whatever a stack wires: odometry, a pose stream, transforms.

use crate::sensor_time::SensorTime;
use rcs_geom::{Pose, PoseError, TransformError, TransformTree};
use rcs_msg::{Stamp, foxglove};
use serde::{Deserialize, Serialize};

/// Names of frames, from the parameters of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameNames<'a> {
    /// Frame of the map: gravity along −z.
    pub local: &'a str,
    /// Frame of the vehicle: x forward, y left, z up.
    pub vehicle: &'a str,
    /// Frame whose pose the pose stream gives; empty for the vehicle frame.
    pub pose: &'a str,
}

/// Why a pose is unknown or was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LocalizerError {
    /// A message has no pose, or an incomplete one.
    #[error("message of frame {frame:?} has no pose")]
    Missing {
        /// Frame of the message.
        frame: String,
    },
    /// The numbers are not a pose.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// It is farther from the origin of its frame than any vehicle gets.
    #[error("pose of {frame:?} is {far_m:e} m from the origin, expected at most {FARTHEST_M:e} m")]
    Far {
        /// Frame of the message.
        frame: String,
        /// Distance, m.
        far_m: f64,
    },
    /// The frames are not connected.
    #[error(transparent)]
    Transform(#[from] TransformError),
    /// The newest pose is too old.
    #[error("pose of {frame:?} is {age_s:.3} s old, expected at most {max_age_s} s")]
    Stale {
        /// Frame whose pose was requested.
        frame: String,
        /// Age at the requested time, s.
        age_s: f64,
        /// Greatest accepted age, s.
        max_age_s: f64,
    },
    /// The mount of the parameters is for body axes, and the name of the frame says that its axes are optical.
    #[error(
        "frame {frame:?} is optical (z along the view), expected one with x forward, y left and z up for the fixed mount; let transforms place it instead"
    )]
    OpticalFrame {
        /// Frame of the data.
        frame: String,
    },
}

/// The tree has a separate frame for the pose stream, because the stream's own frame may be a child of the vehicle.
const STREAM: &str = "(pose stream)";
/// Poses older than this are forgotten.
const HISTORY_NS: u64 = 10_000_000_000;
/// A pose is at most this far from the origin of its frame, m: more than the circumference of the earth.
const FARTHEST_M: f64 = 5e7;

/// Keeps the poses of the vehicle over the last seconds, and looks them up by time.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Localizer {
    tree: TransformTree,
}

impl Default for Localizer {
    fn default() -> Self {
        Self { tree: TransformTree::with_history_ns(HISTORY_NS) }
    }
}

impl Localizer {
    /// Adds odometry that arrives at `now`: the pose of its body frame (the vehicle frame if it names none) in its frame.
    /// A pose that is not from the future replaces those that are.
    pub fn add_odometry(
        &mut self,
        odometry: &foxglove::Odometry,
        time: Stamp,
        names: FrameNames<'_>,
        now: Stamp,
    ) -> Result<(), LocalizerError> {
        let body = if odometry.body_frame_id.is_empty() { names.vehicle } else { &odometry.body_frame_id };
        let pose = pose_of(odometry.pose.as_ref(), &odometry.frame_id)?;
        Ok(self.tree.insert_as_of(&odometry.frame_id, body, time.0, pose, now.0)?)
    }

    /// Adds a pose of the stream that arrives at `now`: that of [`FrameNames::pose`] in the frame of the message. A pose
    /// that is not from the future replaces those that are.
    pub fn add_pose(
        &mut self,
        message: &foxglove::PoseInFrame,
        time: Stamp,
        now: Stamp,
    ) -> Result<(), LocalizerError> {
        let pose = pose_of(message.pose.as_ref(), &message.frame_id)?;
        Ok(self.tree.insert_as_of(&message.frame_id, STREAM, time.0, pose, now.0)?)
    }

    /// Adds transforms at their times, which arrive at `now`; those without a time (none, or 0) at `time`, that of the
    /// message. Those that are not from the future replace those that are. Those that are refused do not keep out the others;
    /// the first error is returned.
    pub fn add_transforms(
        &mut self,
        message: &foxglove::FrameTransforms,
        time: Stamp,
        now: Stamp,
    ) -> Result<(), LocalizerError> {
        self.add_each(message, Some((time, now)))
    }

    /// Adds transforms that hold at all times. Those that are refused do not keep out the others; the first error is
    /// returned.
    pub fn add_static_transforms(
        &mut self,
        message: &foxglove::FrameTransforms,
    ) -> Result<(), LocalizerError> {
        self.add_each(message, None)
    }

    /// Adds each transform of a message at its time, or as a static one without the time and the arrival of the message.
    fn add_each(
        &mut self,
        message: &foxglove::FrameTransforms,
        came: Option<(Stamp, Stamp)>,
    ) -> Result<(), LocalizerError> {
        let mut result = Ok(());
        for transform in &message.transforms {
            let (parent, child) = (&transform.parent_frame_id, &transform.child_frame_id);
            let pose = parts(transform.translation.as_ref(), transform.rotation.as_ref(), child);
            let added = pose.and_then(|pose| {
                let added = match came {
                    None => self.tree.set_static(parent, child, pose),
                    Some((time, now)) => {
                        let time = stated_time(transform).unwrap_or(time);
                        self.tree.insert_as_of(parent, child, time.0, pose, now.0)
                    }
                };
                added.map_err(LocalizerError::from)
            });
            result = result.and(added);
        }
        result
    }

    /// Whether nothing has been added.
    pub(crate) fn is_empty(&self) -> bool {
        self.tree.is_empty()
    }

    /// The frame whose poses in the local one tell that of the vehicle, by its name in the tree.
    pub(crate) fn source<'a>(&self, names: FrameNames<'a>) -> &'a str {
        if self.tree.contains(STREAM) { STREAM } else { names.vehicle }
    }

    /// Time of the newest pose of a frame in another one that is not later than a time; `None` where there is none, and
    /// where the pose holds at all times.
    pub(crate) fn newest_until(&self, target: &str, source: &str, time: Stamp) -> Option<Stamp> {
        self.tree.newest_until(target, source, time.0).ok().flatten().map(Stamp)
    }

    /// The time of a sensor by the clock of the vehicle's poses.
    pub(crate) fn time_of_pose(&self, names: FrameNames<'_>, time: SensorTime) -> Stamp {
        let newest = self.tree.newest(names.local, self.source(names)).ok().flatten();
        time.by_clock_of(newest.map(Stamp))
    }

    /// Pose of the vehicle in the local frame at a time. If that is later than the newest pose, the newest one is used,
    /// provided that it is not older than `max_age_s`.
    pub fn local_from_vehicle(
        &self,
        names: FrameNames<'_>,
        time: impl Into<SensorTime>,
        max_age_s: f64,
    ) -> Result<Pose, LocalizerError> {
        let time: SensorTime = time.into();
        if !self.tree.contains(STREAM) {
            return self.lookup(names.local, names.vehicle, time, max_age_s);
        }
        let local_from_stream = self.lookup(names.local, STREAM, time, max_age_s)?;
        if names.pose.is_empty() || names.pose == names.vehicle {
            return Ok(local_from_stream);
        }
        Ok(local_from_stream * self.lookup(names.pose, names.vehicle, time, max_age_s)?)
    }

    /// `target_from_source` at a time, from transforms alone. If that is later than the newest transform, the newest
    /// one is used, provided that it is not older than `max_age_s`.
    pub fn lookup(
        &self,
        target: &str,
        source: &str,
        time: impl Into<SensorTime>,
        max_age_s: f64,
    ) -> Result<Pose, LocalizerError> {
        if target == source {
            return Ok(Pose::IDENTITY);
        }
        let newest = self.tree.newest(target, source)?.map(Stamp);
        let time: SensorTime = time.into();
        let time = time.by_clock_of(newest);
        let Some(newest) = newest.filter(|&newest| newest < time) else {
            return Ok(self.tree.lookup(target, source, time.0)?);
        };
        let age_s = time.seconds_since(newest);
        if age_s > max_age_s {
            return Err(LocalizerError::Stale { frame: source.to_owned(), age_s, max_age_s });
        }
        Ok(self.tree.lookup(target, source, newest.0)?)
    }
}

/// Time that a transform states; 0 counts as none.
fn stated_time(transform: &foxglove::FrameTransform) -> Option<Stamp> {
    transform.timestamp.as_ref().and_then(Stamp::from_proto).filter(|time| time.0 != 0)
}

/// The pose of a message, checked.
pub fn pose_of(pose: Option<&foxglove::Pose>, frame: &str) -> Result<Pose, LocalizerError> {
    let (position, orientation) =
        pose.map_or((None, None), |p| (p.position.as_ref(), p.orientation.as_ref()));
    parts(position, orientation, frame)
}

/// Converts a pose to a message.
pub fn pose_message(pose: &Pose) -> foxglove::Pose {
    let (p, q) = (pose.translation, pose.rotation);
    foxglove::Pose {
        position: Some(foxglove::Vector3 { x: p.x, y: p.y, z: p.z }),
        orientation: Some(foxglove::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }),
    }
}

fn parts(
    translation: Option<&foxglove::Vector3>,
    rotation: Option<&foxglove::Quaternion>,
    frame: &str,
) -> Result<Pose, LocalizerError> {
    let (Some(t), Some(q)) = (translation, rotation) else {
        return Err(LocalizerError::Missing { frame: frame.to_owned() });
    };
    let pose = Pose::from_parts([t.x, t.y, t.z], [q.x, q.y, q.z, q.w])?;
    let far_m = pose.translation.length();
    if far_m > FARTHEST_M {
        return Err(LocalizerError::Far { frame: frame.to_owned(), far_m });
    }
    Ok(pose)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_geom::DVec3;

    const NAMES: FrameNames<'static> = FrameNames { local: "map", vehicle: "base", pose: "lidar" };

    fn pose_at(x: f64, frame: &str) -> foxglove::PoseInFrame {
        let pose = pose_message(&Pose::from_translation(DVec3::new(x, 0.0, 0.5)));
        foxglove::PoseInFrame { frame_id: frame.to_owned(), pose: Some(pose), ..Default::default() }
    }

    fn mount() -> foxglove::FrameTransforms {
        let translation = Some(foxglove::Vector3 { x: 0.2, y: 0.0, z: 0.5 });
        let rotation = Some(foxglove::Quaternion { w: 1.0, ..Default::default() });
        let transform = foxglove::FrameTransform {
            parent_frame_id: "base".to_owned(),
            child_frame_id: "lidar".to_owned(),
            translation,
            rotation,
            ..Default::default()
        };
        foxglove::FrameTransforms { transforms: vec![transform] }
    }

    #[test]
    fn a_pose_farther_away_than_any_vehicle_gets_is_refused() {
        let mut localizer = Localizer::default();
        // UTM coordinates are not.
        localizer.add_pose(&pose_at(1e7, "map"), Stamp(1), Stamp(1)).unwrap();
        let refused = localizer.add_pose(&pose_at(-1e9, "map"), Stamp(2), Stamp(2)).unwrap_err();
        assert_eq!(refused.to_string(), "pose of \"map\" is 1e9 m from the origin, expected at most 5e7 m");
        assert!(localizer.add_pose(&pose_at(f64::MAX, "map"), Stamp(3), Stamp(3)).is_err());
    }

    #[test]
    fn a_stream_of_the_sensors_poses_tells_where_the_vehicle_is() {
        let mut localizer = Localizer::default();
        localizer.add_static_transforms(&mount()).unwrap();
        localizer.add_pose(&pose_at(1.0, "map"), Stamp(1_000), Stamp(1_000)).unwrap();
        localizer.add_pose(&pose_at(2.0, "map"), Stamp(2_000), Stamp(2_000)).unwrap();
        let pose = localizer.local_from_vehicle(NAMES, Stamp(1_500), 0.0).unwrap();
        assert!(pose.translation.abs_diff_eq(DVec3::new(1.3, 0.0, 0.0), 1e-12), "{pose:?}");
    }

    #[test]
    fn an_old_pose_is_not_taken_for_the_present_one() {
        let mut localizer = Localizer::default();
        localizer.add_static_transforms(&mount()).unwrap();
        localizer.add_pose(&pose_at(1.0, "map"), Stamp(0), Stamp(0)).unwrap();
        assert!(localizer.local_from_vehicle(NAMES, Stamp(400_000_000), 0.5).is_ok());
        let late = localizer.local_from_vehicle(NAMES, Stamp(600_000_000), 0.5);
        assert!(matches!(late, Err(LocalizerError::Stale { .. })), "{late:?}");
    }

    #[test]
    fn odometry_without_a_body_frame_is_the_vehicles() {
        let mut localizer = Localizer::default();
        let pose = Some(pose_message(&Pose::from_xy_yaw(3.0, 4.0, 1.0)));
        let odometry = foxglove::Odometry { frame_id: "map".to_owned(), pose, ..Default::default() };
        localizer.add_odometry(&odometry, Stamp(5), NAMES, Stamp(5)).unwrap();
        let pose = localizer.local_from_vehicle(NAMES, Stamp(5), 0.0).unwrap();
        assert!((pose.yaw() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_pose_from_the_future_is_forgotten_and_the_present_ones_are_kept_and_grow_old() {
        let ms = |ms: u64| Stamp(ms * 1_000_000);
        let mut localizer = Localizer::default();
        for (x_m, time_ms, now_ms) in [(9.0, 3_600_000, 990), (1.0, 1_000, 1_010), (2.0, 1_100, 1_110)] {
            let pose = Some(pose_message(&Pose::from_xy_yaw(x_m, 0.0, 0.0)));
            let odometry = foxglove::Odometry { frame_id: "map".to_owned(), pose, ..Default::default() };
            localizer.add_odometry(&odometry, ms(time_ms), NAMES, ms(now_ms)).unwrap();
        }
        let pose = localizer.local_from_vehicle(NAMES, ms(1_050), 0.5).unwrap();
        assert!((pose.translation.x - 1.5).abs() < 1e-9, "{pose:?}");
        let late = localizer.local_from_vehicle(NAMES, ms(50_000), 0.5);
        assert!(matches!(late, Err(LocalizerError::Stale { .. })), "{late:?}");
    }

    #[test]
    fn a_sensor_whose_clock_is_ahead_was_where_the_vehicle_was_by_the_clock_of_the_poses() {
        let ms = |ms: u64| Stamp(ms * 1_000_000);
        let x_m = |poses_ahead_ms: u64, acquired_ms: u64| {
            let mut localizer = Localizer::default();
            for (x_m, at_ms) in [(1.0, 1_000), (2.0, 1_100)] {
                localizer.add_pose(&pose_at(x_m, "map"), ms(at_ms + poses_ahead_ms), ms(at_ms)).unwrap();
            }
            let names = FrameNames { pose: "", ..NAMES };
            let time = SensorTime { acquired: ms(acquired_ms), arrived: ms(1_050) };
            localizer.local_from_vehicle(names, time, 0.5).unwrap().translation.x
        };
        for (poses_ahead_ms, acquired_ms) in [(0, 1_050), (0, 29_050), (28_000, 29_050)] {
            let x_m = x_m(poses_ahead_ms, acquired_ms);
            assert!((x_m - 1.5).abs() < 1e-9, "{poses_ahead_ms} {acquired_ms}: {x_m}");
        }
    }

    #[test]
    fn a_bad_transform_does_not_keep_out_the_others_of_its_message() {
        let mut message = mount();
        let imu = foxglove::FrameTransform {
            child_frame_id: "imu".to_owned(),
            rotation: Some(foxglove::Quaternion::default()),
            ..message.transforms[0].clone()
        };
        message.transforms.insert(0, imu);
        let of_length_0 = |result: Result<(), LocalizerError>| {
            assert!(
                matches!(result, Err(LocalizerError::Pose(PoseError::NotARotation { .. }))),
                "{result:?}"
            );
        };
        let (mut fixed, mut timed) = (Localizer::default(), Localizer::default());
        of_length_0(fixed.add_static_transforms(&message));
        of_length_0(timed.add_transforms(&message, Stamp(0), Stamp(7)));
        assert!(fixed.lookup("base", "lidar", Stamp(9), 0.0).is_ok());
        assert!(timed.lookup("base", "lidar", Stamp(0), 0.0).is_ok());
    }

    #[test]
    fn a_transform_without_a_time_counts_at_that_of_its_message() {
        let ms = |ms: u64| Stamp(ms * 1_000_000);
        for timestamp in [None, Some(Stamp(0).to_proto())] {
            let mut message = mount();
            message.transforms[0].timestamp = timestamp;
            let mut localizer = Localizer::default();
            localizer.add_transforms(&message, ms(5_000), ms(5_010)).unwrap();
            assert!(localizer.lookup("base", "lidar", ms(5_100), 0.5).is_ok());
            message.transforms[0].timestamp = Some(ms(5_200).to_proto());
            localizer.add_transforms(&message, ms(5_300), ms(5_310)).unwrap();
            let newest = localizer.lookup("base", "lidar", ms(5_300), 0.05);
            assert!(matches!(newest, Err(LocalizerError::Stale { .. })), "its own time counts: {newest:?}");
        }
    }

    #[test]
    fn poses_that_are_none_are_refused_and_leave_nothing_behind() {
        let mut localizer = Localizer::default();
        let missing = foxglove::PoseInFrame { frame_id: "map".to_owned(), ..Default::default() };
        assert!(matches!(
            localizer.add_pose(&missing, Stamp(0), Stamp(0)),
            Err(LocalizerError::Missing { .. })
        ));
        assert!(matches!(
            localizer.add_pose(&pose_at(f64::NAN, "map"), Stamp(0), Stamp(0)),
            Err(LocalizerError::Pose(PoseError::NotFinite { .. }))
        ));
        assert!(matches!(
            localizer.local_from_vehicle(NAMES, Stamp(0), 1.0),
            Err(LocalizerError::Transform(TransformError::UnknownFrame { .. }))
        ));
    }
}
