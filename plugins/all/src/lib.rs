//! The one list of plugins: what a stack file can name.
//!
//! A new process costs its own crate, a line of this crate's `Cargo.toml`, and a line here.

use rcs_runtime::ProcessType;

/// Every process type there is, in the order of the names.
pub fn all() -> &'static [ProcessType] {
    static ALL: &[ProcessType] = &[
        ProcessType::of::<rcs_terrain::Classifier>(),
        ProcessType::of::<rcs_color::ColorModelling>(),
        ProcessType::of::<rcs_comms::Comms>(),
        ProcessType::of::<rcs_obstacles::LabelOverlay>(),
        ProcessType::of::<rcs_obstacles::Obstacles>(),
        ProcessType::of::<rcs_navigation::Position>(),
        ProcessType::of::<rcs_proximity::Proximity>(),
        ProcessType::of::<rcs_sim::SimCameras>(),
        ProcessType::of::<rcs_sim::SimLadar>(),
        ProcessType::of::<rcs_sim::SimVehicle>(),
        ProcessType::of::<rcs_stereo::Stereo>(),
        ProcessType::of::<rcs_terrain::TerrainLearner>(),
        ProcessType::of::<rcs_truth_driver::TruthDriver>(),
        ProcessType::of::<rcs_world_model::WorldModel>(),
    ];
    ALL
}
