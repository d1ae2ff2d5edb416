//! Poses of sensor and vehicle when range data were acquired.

use crate::columns::{GroundPlane, Placement};
use crate::ground_map::GROUND_CELL_M;
use crate::params::extrinsics;
use crate::proto::ObstaclesParams;
use rcs_geom::{CellIndex, Pose};
use rcs_sense::{
    Axes, CELL_SIZE_M, Localizer, LocalizerError, MAX_ROLL_DEG, OnItsSide, Rolled, SensorTime,
    camera_roll_deg, upright, upright_columns,
};

/// Geometry of one frame.
#[derive(Clone, Debug)]
pub(crate) struct SensorPose {
    pub(crate) local_from_sensor: Pose,
    /// A camera that is mounted upside down: the first row of its images has the lowest rays.
    pub(crate) is_upside_down: bool,
    pub(crate) ground_plane: GroundPlane,
    pub(crate) placement: Placement,
    /// The vehicle's cell, in the cost map and in the ground map.
    pub(crate) centre: CellIndex,
    pub(crate) ground_centre: CellIndex,
}

/// Why the geometry is unknown.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SensorPoseError {
    #[error(transparent)]
    Pose(#[from] LocalizerError),
    #[error(transparent)]
    OnItsSide(#[from] OnItsSide),
    #[error(transparent)]
    Rolled(#[from] Rolled),
}

impl SensorPose {
    /// Finds the geometry at a time; `axes` are those of the data, `origin` the pose of their coordinates in their
    /// frame. Refuses a camera on its side, because the columns of its images are not upright.
    pub(crate) fn find(
        localizer: &Localizer,
        frame_id: &str,
        axes: Axes,
        origin: &Pose,
        time: SensorTime,
        params: &ObstaclesParams,
    ) -> Result<SensorPose, SensorPoseError> {
        let extrinsics = extrinsics(params);
        let local_from_vehicle = extrinsics.local_from_vehicle(localizer, time)?;
        let vehicle_from_frame = extrinsics.vehicle_from_sensor(localizer, frame_id, axes, time)?;
        let is_camera = axes == Axes::Optical;
        let is_upside_down = is_camera && camera_roll_deg(&vehicle_from_frame).abs() >= 180.0 - MAX_ROLL_DEG;
        if is_camera && !is_upside_down {
            upright_columns(&vehicle_from_frame)?;
        }
        let local_from_sensor = local_from_vehicle * vehicle_from_frame * *origin;
        let up = upright(&local_from_vehicle)?;
        let sensor = local_from_sensor.translation;
        let below_origin = local_from_vehicle.translation - up * params.wheels_below_m - sensor;
        let cell = |size_m: f64| {
            let cell = (local_from_vehicle.translation / size_m).floor();
            CellIndex::new(cell.x as i64, cell.y as i64)
        };
        Ok(SensorPose {
            local_from_sensor,
            is_upside_down,
            ground_plane: GroundPlane { below_origin, up, wheels_m: params.wheels_x_m },
            placement: Placement { sensor, cell_size_m: CELL_SIZE_M },
            centre: cell(CELL_SIZE_M),
            ground_centre: cell(GROUND_CELL_M),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::Stamp;
    use rcs_msg::rcs::{Mount, PoseSource, VehiclePose};

    #[test]
    fn images_of_a_camera_upside_down_are_used_and_those_of_one_on_its_side_are_not() {
        let find = |roll_deg: f64, axes: Axes| {
            let pose = VehiclePose { source: PoseSource::PoseFixed.into(), ..rcs_msg::params::default() };
            let mount = Mount { fixed: true, roll_deg, ..rcs_msg::params::default() };
            let params =
                ObstaclesParams { pose: Some(pose), mount: Some(mount), ..ObstaclesParams::default() };
            let (localizer, time) = (Localizer::default(), SensorTime::from(Stamp(7)));
            let found = SensorPose::find(&localizer, "sensor", axes, &Pose::IDENTITY, time, &params);
            found.map(|pose| pose.is_upside_down).map_err(|error| error.to_string())
        };
        for (roll_deg, expected) in [(0.0, false), (-40.0, false), (180.0, true), (-150.0, true)] {
            assert_eq!(find(roll_deg, Axes::Optical), Ok(expected), "{roll_deg}");
        }
        let refused = find(90.0, Axes::Optical).unwrap_err();
        assert_eq!(refused, "camera is rolled by 90°, expected at most 45° either way");
        assert_eq!(find(90.0, Axes::Body), Ok(false), "a cloud has no rows");
    }
}
