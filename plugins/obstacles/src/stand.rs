//! Where the sensor and the vehicle were when range data were taken.

use crate::columns::{Footing, Placement};
use crate::cost_map::CELL_SIZE_M;
use crate::ground_map::GROUND_CELL_M;
use crate::params::{frames, mount};
use rcs_geom::{CellIndex, Pose};
use rcs_msg::Stamp;
use rcs_msg::rcs::{ObstaclesParams, PoseSource};
use rcs_world::{Localizer, LocalizerError};

/// Where everything stood.
#[derive(Clone, Debug)]
pub(crate) struct Stand {
    pub(crate) local_from_sensor: Pose,
    pub(crate) footing: Footing,
    pub(crate) placement: Placement,
    /// The vehicle's cell of the cost map, and of the ground map.
    pub(crate) centre: CellIndex,
    pub(crate) ground_centre: CellIndex,
}

/// Why that is not known.
#[derive(Debug, thiserror::Error)]
pub(crate) enum StandError {
    #[error(transparent)]
    Pose(#[from] LocalizerError),
    #[error(
        "vehicle lies on its side: its up is {up_z:.2} of upright, expected at least {}",
        Footing::MIN_UPRIGHT
    )]
    OnItsSide { up_z: f64 },
}

impl Stand {
    /// At a time; `optical` tells the axes of the data, `origin` the place of their coordinates in their frame.
    pub(crate) fn find(
        localizer: &Localizer,
        frame_id: &str,
        optical: bool,
        origin: &Pose,
        time: Stamp,
        params: &ObstaclesParams,
    ) -> Result<Stand, StandError> {
        let local_from_vehicle = match params.pose_source() {
            PoseSource::PoseFixed => Pose::IDENTITY,
            PoseSource::PoseMessages => {
                localizer.local_from_vehicle(frames(params), time, params.pose_max_age_s)?
            }
        };
        let vehicle_from_frame = if params.mount_fixed {
            mount(params, optical)
        } else {
            localizer.lookup(&params.vehicle_frame, frame_id, time, params.pose_max_age_s)?
        };
        let local_from_sensor = local_from_vehicle * vehicle_from_frame * *origin;
        let up = local_from_vehicle.rotate(glam::DVec3::Z);
        if up.z < Footing::MIN_UPRIGHT {
            return Err(StandError::OnItsSide { up_z: up.z });
        }
        let sensor = local_from_sensor.translation;
        let below_origin = local_from_vehicle.translation - up * params.wheels_below_m - sensor;
        let cell = |size_m: f64| {
            let cell = (local_from_vehicle.translation / size_m).floor();
            CellIndex::new(cell.x as i64, cell.y as i64)
        };
        Ok(Stand {
            local_from_sensor,
            footing: Footing { below_origin, up, wheels_m: params.wheels_x_m },
            placement: Placement { sensor, cell_size_m: CELL_SIZE_M },
            centre: cell(CELL_SIZE_M),
            ground_centre: cell(GROUND_CELL_M),
        })
    }
}
