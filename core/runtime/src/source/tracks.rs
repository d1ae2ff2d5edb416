//! Tracks: positions from messages with poses, and the transforms of a log.

use super::frame::Track;
use rcs_geom::{DVec3, Pose, TransformTree};
use rcs_msg::{AnyMessage, Stamp, foxglove};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Types of messages with a pose.
const POSE_TYPES: [&str; 3] = ["foxglove.Odometry", "foxglove.PoseInFrame", "foxglove.LocationFix"];
const TRANSFORM_TYPES: [&str; 2] = ["foxglove.FrameTransforms", "foxglove.FrameTransform"];

pub(crate) fn is_pose_type(name: &str) -> bool {
    POSE_TYPES.contains(&name)
}

pub(crate) fn is_transform_type(name: &str) -> bool {
    TRANSFORM_TYPES.contains(&name)
}

/// Tracks and transforms that grow message by message.
#[derive(Default)]
pub(crate) struct Tracks {
    /// Shared with the frames, and copied on write.
    by_topic: BTreeMap<Arc<str>, Arc<Track>>,
    tree: TransformTree,
    /// Transforms implied by odometry, used if no message gives them.
    implied: TransformTree,
    has_transforms: bool,
}

impl Tracks {
    /// Adds a canonical message with this log time on `topic`.
    pub(crate) fn take(&mut self, topic: &Arc<str>, log_time: Stamp, message: &AnyMessage, is_static: bool) {
        if let Some(odometry) = message.get::<foxglove::Odometry>() {
            if let Some(pose) = odometry.pose.as_ref().and_then(to_pose) {
                self.push(topic, &odometry.frame_id, log_time, pose.translation, pose.yaw());
                let time = odometry.timestamp.as_ref().and_then(Stamp::from_proto).unwrap_or(log_time);
                if !odometry.frame_id.is_empty() && !odometry.body_frame_id.is_empty() {
                    // A loop or a number that is not finite: the track still shows it.
                    let _ = self.implied.insert(&odometry.frame_id, &odometry.body_frame_id, time.0, pose);
                }
            }
        } else if let Some(stamped) = message.get::<foxglove::PoseInFrame>() {
            if let Some(pose) = stamped.pose.as_ref().and_then(to_pose) {
                self.push(topic, &stamped.frame_id, log_time, pose.translation, pose.yaw());
            }
        } else if let Some(fix) = message.get::<foxglove::LocationFix>() {
            let position = DVec3::new(fix.longitude, fix.latitude, fix.altitude);
            if fix.longitude.is_finite() && fix.latitude.is_finite() {
                self.push(topic, "wgs84", log_time, position, f64::NAN);
            }
        } else if let Some(list) = message.get::<foxglove::FrameTransforms>() {
            for transform in &list.transforms {
                self.transform(transform, log_time, is_static);
            }
        } else if let Some(transform) = message.get::<foxglove::FrameTransform>() {
            self.transform(transform, log_time, is_static);
        }
    }

    fn push(&mut self, topic: &Arc<str>, frame_id: &str, time: Stamp, position: DVec3, yaw: f64) {
        let track = self.by_topic.entry(Arc::clone(topic)).or_insert_with(|| {
            Arc::new(Track { topic: Arc::clone(topic), frame_id: frame_id.to_owned(), ..Track::default() })
        });
        // After going back, a run that goes forward again adds nothing new.
        if track.stamps.last().is_none_or(|&last| time > last) {
            let track = Arc::make_mut(track);
            track.stamps.push(time);
            track.points.push([position.x, position.y, position.z, yaw]);
        }
    }

    fn transform(&mut self, transform: &foxglove::FrameTransform, log_time: Stamp, is_static: bool) {
        let (Some(translation), Some(rotation)) = (&transform.translation, &transform.rotation) else {
            return;
        };
        let Some(pose) = pose_of(translation, rotation) else { return };
        let (parent, child) = (&transform.parent_frame_id, &transform.child_frame_id);
        let time = transform.timestamp.as_ref().and_then(Stamp::from_proto).unwrap_or(log_time);
        let taken = if is_static {
            self.tree.set_static(parent, child, pose)
        } else {
            self.tree.insert(parent, child, time.0, pose)
        };
        self.has_transforms |= taken.is_ok();
    }

    /// The tracks for a run that branches from this one at `time`.
    pub(crate) fn fork(&self, time: Stamp) -> Self {
        let cut = |(topic, track): (&Arc<str>, &Arc<Track>)| {
            let keep = track.stamps.partition_point(|&stamp| stamp <= time);
            let track = Track {
                topic: Arc::clone(&track.topic),
                frame_id: track.frame_id.clone(),
                stamps: track.stamps[..keep].to_vec(),
                points: track.points[..keep].to_vec(),
            };
            (Arc::clone(topic), Arc::new(track))
        };
        Self { by_topic: self.by_topic.iter().map(cut).collect(), ..Self::default() }
    }

    /// Number of positions.
    pub(crate) fn len(&self) -> usize {
        self.by_topic.values().map(|track| track.stamps.len()).sum()
    }

    /// All tracks, shared.
    pub(crate) fn share(&self) -> BTreeMap<Arc<str>, Arc<Track>> {
        self.by_topic.clone()
    }

    /// All transforms, shared; those implied by odometry only if no message gives any.
    pub(crate) fn tree(&self) -> TransformTree {
        if self.has_transforms { self.tree.clone() } else { self.implied.clone() }
    }
}

pub(crate) fn to_pose(pose: &foxglove::Pose) -> Option<Pose> {
    pose_of(pose.position.as_ref()?, pose.orientation.as_ref()?)
}

/// A rigid transform; `None` if a number is not finite or the rotation is not valid.
pub(crate) fn pose_of(translation: &foxglove::Vector3, rotation: &foxglove::Quaternion) -> Option<Pose> {
    let translation = [translation.x, translation.y, translation.z];
    Pose::from_parts(translation, [rotation.x, rotation.y, rotation.z, rotation.w]).ok()
}
