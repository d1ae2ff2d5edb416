//! Poses of sensor and vehicle when range data were acquired.

use crate::columns::{GroundPlane, Placement};
use crate::ground_map::GROUND_CELL_M;
use crate::params::extrinsics;
use crate::proto::ObstaclesParams;
use rcs_geom::{CellIndex, Pose};
use rcs_sense::{Axes, CELL_SIZE_M, Localizer, LocalizerError, OnItsSide, SensorTime, upright};

/// Geometry of one frame.
#[derive(Clone, Debug)]
pub(crate) struct SensorPose {
    pub(crate) local_from_sensor: Pose,
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
}

impl SensorPose {
    /// Finds the geometry at a time; `axes` are those of the data, `origin` the pose of their coordinates in their
    /// frame.
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
            ground_plane: GroundPlane { below_origin, up, wheels_m: params.wheels_x_m },
            placement: Placement { sensor, cell_size_m: CELL_SIZE_M },
            centre: cell(CELL_SIZE_M),
            ground_centre: cell(GROUND_CELL_M),
        })
    }
}
