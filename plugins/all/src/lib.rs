//! The one list of plugins: what a stack file can name.
//!
//! A new process costs its own crate, a line of this crate's `Cargo.toml`, and a line here.

use rcs_runtime::ProcessType;

/// Puts the messages of every plugin into the registry: a program does this before it opens anything, so that what is
/// known by name does not depend on what it has opened before.
pub fn register() {
    all().iter().for_each(ProcessType::register);
}

/// Every process type there is, in the order of the names.
pub fn all() -> &'static [ProcessType] {
    static ALL: &[ProcessType] = &[
        ProcessType::of::<rcs_terrain::Classifier>(),
        ProcessType::of::<rcs_color::ColorModelLearner>(),
        ProcessType::of::<rcs_obstacles::LabelOverlay>(),
        ProcessType::of::<rcs_localization::Localization>(),
        ProcessType::of::<rcs_obstacles::Obstacles>(),
        ProcessType::of::<rcs_proximity::Proximity>(),
        ProcessType::of::<rcs_sim::SimCameras>(),
        ProcessType::of::<rcs_sim::SimLadar>(),
        ProcessType::of::<rcs_sim::SimVehicle>(),
        ProcessType::of::<rcs_stereo::Stereo>(),
        ProcessType::of::<rcs_supervisor::Supervisor>(),
        ProcessType::of::<rcs_terrain::TerrainLearner>(),
        ProcessType::of::<rcs_truth_driver::TruthDriver>(),
        ProcessType::of::<rcs_vehicle_interface::VehicleInterface>(),
        ProcessType::of::<rcs_world_model::WorldModel>(),
    ];
    ALL
}
