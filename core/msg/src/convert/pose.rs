//! Poses, paths, polygons and transforms.

use super::cloud::identity;
use super::{Conversion, Source, Unusable};
use crate::any::AnyMessage;
use crate::foxglove::{FrameTransform, FrameTransforms, Odometry, Pose, PoseInFrame, PosesInFrame, Vector3};

pub(super) const POSE_STAMPED: Conversion = Conversion {
    from: "geometry_msgs/PoseStamped",
    signature: "iIsddddddd",
    to: "foxglove.PoseInFrame",
    convert: pose_stamped,
};

pub(super) const POSE_WITH_COVARIANCE_STAMPED: Conversion = Conversion {
    from: "geometry_msgs/PoseWithCovarianceStamped",
    signature: "iIsddddddd[36]d",
    to: "foxglove.Odometry",
    convert: pose_with_covariance_stamped,
};

pub(super) const POSE_ARRAY: Conversion = Conversion {
    from: "geometry_msgs/PoseArray",
    signature: "iIs[](ddddddd)",
    to: "foxglove.PosesInFrame",
    convert: pose_array,
};

pub(super) const PATH: Conversion = Conversion {
    from: "nav_msgs/Path",
    signature: "iIs[](iIsddddddd)",
    to: "foxglove.PosesInFrame",
    convert: path,
};

pub(super) const TF_MESSAGE: Conversion = Conversion {
    from: "tf2_msgs/TFMessage",
    signature: "[](iIssddddddd)",
    to: "foxglove.FrameTransforms",
    convert: tf_message,
};

/// What `tf2_msgs/TFMessage` was called before ROS 1 had `tf2`.
pub(super) const ROS1_TF_MESSAGE: Conversion = Conversion { from: "tf/tfMessage", ..TF_MESSAGE };

pub(super) const POLYGON_STAMPED: Conversion = Conversion {
    from: "geometry_msgs/PolygonStamped",
    signature: "iIs[](fff)",
    to: "foxglove.PosesInFrame",
    convert: polygon_stamped,
};

/// Bytes of the numbers of a stamped pose. A sequence cannot have more poses than the message has room for.
const STAMPED_POSE_SIZE: usize = 68;
/// Bytes of the numbers of a pose.
const POSE_SIZE: usize = 56;
/// Bytes of a corner of a polygon.
const CORNER_SIZE: usize = 12;

fn pose_stamped(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    Ok(AnyMessage::new(PoseInFrame {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        pose: Some(source.pose()?),
    }))
}

/// Foxglove has a covariance of the pose in its odometry only; the body frame and the velocities are not known.
fn pose_with_covariance_stamped(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    Ok(AnyMessage::new(Odometry {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        pose: Some(source.pose()?),
        pose_covariance: source.floats(36)?,
        ..Odometry::default()
    }))
}

fn pose_array(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    let count = source.cursor.length(POSE_SIZE)?;
    let poses = (0..count).map(|_| source.pose()).collect::<Result<Vec<_>, Unusable>>()?;
    Ok(AnyMessage::new(PosesInFrame { timestamp: header.timestamp, frame_id: header.frame_id, poses }))
}

/// In ROS 2 each pose has a header of its own. By convention it repeats the header of the path, which is the one kept.
/// Some planners name the frame in the poses only: then it is that of the first pose.
fn path(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let mut header = source.header()?;
    let count = source.cursor.length(STAMPED_POSE_SIZE)?;
    let mut poses = Vec::with_capacity(count);
    for index in 0..count {
        let own = source.header()?;
        if index == 0 && header.frame_id.is_empty() {
            header.frame_id = own.frame_id;
        }
        poses.push(source.pose()?);
    }
    Ok(AnyMessage::new(PosesInFrame { timestamp: header.timestamp, frame_id: header.frame_id, poses }))
}

fn tf_message(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let count = source.cursor.length(STAMPED_POSE_SIZE)?;
    let mut transforms = Vec::with_capacity(count);
    for _ in 0..count {
        let header = source.header()?;
        transforms.push(FrameTransform {
            timestamp: header.timestamp,
            parent_frame_id: header.frame_id,
            child_frame_id: source.cursor.string()?,
            translation: Some(source.vector()?),
            rotation: Some(source.quaternion()?),
        });
    }
    Ok(AnyMessage::new(FrameTransforms { transforms }))
}

/// The outline of the polygon: a path that returns to the first corner. Its poses have no orientation of their own.
fn polygon_stamped(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    let count = source.cursor.length(CORNER_SIZE)?;
    let mut poses = Vec::with_capacity(count.saturating_add(1));
    for _ in 0..count {
        let corner = [source.cursor.f32()?, source.cursor.f32()?, source.cursor.f32()?];
        let [x, y, z] = corner.map(f64::from);
        poses.push(Pose { position: Some(Vector3 { x, y, z }), ..identity() });
    }
    // Some writers repeat the first corner themselves, and two corners are a line.
    let first = poses.first().filter(|first| poses.len() > 2 && poses.last() != Some(*first)).copied();
    poses.extend(first);
    Ok(AnyMessage::new(PosesInFrame { timestamp: header.timestamp, frame_id: header.frame_id, poses }))
}
