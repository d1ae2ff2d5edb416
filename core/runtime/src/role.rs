//! Roles: the purpose of an output, or of an input that an operator writes. Views use them, and the plan checks them.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

/// The purpose of the messages of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// Shapes drawn on an image.
    Annotations,
    /// A camera calibration.
    Calibration,
    /// A point cloud.
    Cloud,
    /// A command to another process.
    Command,
    /// Costs of one source, per cell or per pixel.
    Cost,
    /// Range per pixel.
    Depth,
    /// Disparity per pixel.
    Disparity,
    /// A goal position.
    Goal,
    /// An image.
    Image,
    /// A class per pixel; the channel's `rcs.classes` names the classes.
    Labels,
    /// A map in which sources are fused.
    Map,
    /// Goals, and the bounds of driving.
    Mission,
    /// Learned models.
    Models,
    /// A planned path.
    Path,
    /// A pose.
    Pose,
    /// Shapes on an image that are expected there, not seen in it.
    Prediction,
    /// A measurement of a sensor.
    Sensor,
    /// Static transforms.
    StaticTransforms,
    /// Statistics of a process.
    Stats,
    /// Timed transforms.
    Transforms,
}

/// Key of the channel metadata that holds the role of a buffer.
pub(crate) const ROLE: &str = "rcs.role";

const NAMES: [(Role, &str); 20] = [
    (Role::Annotations, "annotations"),
    (Role::Calibration, "calibration"),
    (Role::Cloud, "cloud"),
    (Role::Command, "command"),
    (Role::Cost, "cost"),
    (Role::Depth, "depth"),
    (Role::Disparity, "disparity"),
    (Role::Goal, "goal"),
    (Role::Image, "image"),
    (Role::Labels, "labels"),
    (Role::Map, "map"),
    (Role::Mission, "mission"),
    (Role::Models, "models"),
    (Role::Path, "path"),
    (Role::Pose, "pose"),
    (Role::Prediction, "prediction"),
    (Role::Sensor, "sensor"),
    (Role::StaticTransforms, "static_transforms"),
    (Role::Stats, "stats"),
    (Role::Transforms, "transforms"),
];

impl Role {
    /// All roles, sorted by name.
    pub fn all() -> impl Iterator<Item = Role> {
        NAMES.into_iter().map(|(role, _)| role)
    }

    /// The name in the channel metadata `rcs.role`.
    pub fn name(self) -> &'static str {
        NAMES.into_iter().find(|(role, _)| *role == self).map_or("", |(_, name)| name)
    }

    /// Message types that suit this role; empty if any type does.
    pub fn types(self) -> &'static [&'static str] {
        match self {
            Role::Annotations | Role::Prediction => &["foxglove.ImageAnnotations"],
            Role::Calibration => &["foxglove.CameraCalibration"],
            Role::Cloud => &["foxglove.PointCloud"],
            Role::Cost => &["foxglove.Grid", "foxglove.RawImage"],
            Role::Depth | Role::Disparity | Role::Image | Role::Labels => {
                &["foxglove.RawImage", "foxglove.CompressedImage"]
            }
            Role::Goal => &["foxglove.PoseInFrame"],
            Role::Map => &["foxglove.Grid"],
            Role::Mission => &["rcs.Mission"],
            Role::Path => &["foxglove.PosesInFrame"],
            Role::StaticTransforms | Role::Transforms => &["foxglove.FrameTransforms"],
            Role::Command | Role::Models | Role::Pose | Role::Sensor | Role::Stats => &[],
        }
    }

    /// Whether messages of that type suit this role.
    pub fn fits(self, type_name: &str) -> bool {
        self.types().is_empty() || self.types().contains(&type_name)
    }
}

/// Whether the transforms of a topic or buffer with this name and channel metadata are static, by its role or by ROS's
/// convention.
pub(crate) fn has_static_transforms(name: &str, metadata: &BTreeMap<String, String>) -> bool {
    let is_static = |role: &String| role == Role::StaticTransforms.name();
    name.ends_with("/tf_static") || metadata.get(ROLE).is_some_and(is_static)
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The text is not the name of a role.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no role {0:?}")]
pub struct UnknownRole(String);

impl FromStr for Role {
    type Err = UnknownRole;

    fn from_str(name: &str) -> Result<Role, UnknownRole> {
        let found = NAMES.into_iter().find(|(_, known)| *known == name);
        found.map(|(role, _)| role).ok_or_else(|| UnknownRole(name.to_owned()))
    }
}

/// The purpose of an input that an operator can write, by which a window finds it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum InputRole {
    /// Speed and turn rate of teleoperation.
    Teleoperation,
    /// The emergency stop.
    EmergencyStop,
    /// Goals, and the bounds of driving.
    Mission,
    /// Places from which a process learns.
    Training,
}

impl InputRole {
    /// The name in [`rcs_msg::rcs::PortInfo`].
    pub const fn name(self) -> &'static str {
        match self {
            InputRole::Teleoperation => "teleoperation",
            InputRole::EmergencyStop => "emergency_stop",
            InputRole::Mission => "mission",
            InputRole::Training => "training",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_to_their_roles() {
        for role in Role::all() {
            assert_eq!(role.name().parse(), Ok(role));
        }
        assert_eq!("drive".parse::<Role>().unwrap_err().to_string(), "there is no role \"drive\"");
        assert!(Role::Map.fits("foxglove.Grid") && !Role::Map.fits("foxglove.RawImage"));
        assert!(Role::Stats.fits("rcs.StereoStats"));
    }
}
