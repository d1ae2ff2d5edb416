//! Poses from messages.

use rcs_geom::Pose;
use rcs_msg::foxglove;

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
