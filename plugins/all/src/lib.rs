//! The list of all plugins that a stack file can name.
//!
//! This crate contains no algorithm: it depends on every plugin crate and lists its process types. To add a plugin of
//! this repository, add its crate, one dependency in this crate's `Cargo.toml` and one line in [`all`]. A program with
//! plugins of its own has a list of its own: see `examples/plugin`.
//!
//! ```
//! let names: Vec<_> = rcs_plugins::all().iter().map(|process| process.def().plugin).collect();
//! assert!(names.contains(&"world_model"));
//! ```

use rcs_runtime::ProcessType;

/// Registers the message types of every plugin. A program calls this before it opens any log, so that the known types
/// do not depend on which files were opened.
pub fn register() {
    all().iter().for_each(ProcessType::register);
}

/// All process types, sorted by name.
pub fn all() -> &'static [ProcessType] {
    static ALL: &[ProcessType] = &[
        ProcessType::of::<rcs_terrain::Classifier>(),
        ProcessType::of::<rcs_color::ColorModelLearner>(),
        ProcessType::of::<rcs_obstacles::LabelOverlay>(),
        ProcessType::of::<rcs_localization::Localization>(),
        ProcessType::of::<rcs_world_model::MapMemoryKeeper>(),
        ProcessType::of::<rcs_obstacles::Obstacles>(),
        ProcessType::of::<rcs_planner::AStarPlanner>(),
        ProcessType::of::<rcs_world_model::Prediction>(),
        ProcessType::of::<rcs_proximity::Proximity>(),
        ProcessType::of::<rcs_sim::SimCameras>(),
        ProcessType::of::<rcs_sim::SimLadar>(),
        ProcessType::of::<rcs_sim::SimVehicle>(),
        ProcessType::of::<rcs_stereo::Stereo>(),
        ProcessType::of::<rcs_supervisor::Supervisor>(),
        ProcessType::of::<rcs_terrain::TerrainLearner>(),
        ProcessType::of::<rcs_truth_driver::TruthDriver>(),
        ProcessType::of::<rcs_vehicle_interface::VehicleInterface>(),
        ProcessType::of::<rcs_localization::VisualMotion>(),
        ProcessType::of::<rcs_planner::WaypointFollower>(),
        ProcessType::of::<rcs_planner::WaypointGenerator>(),
        ProcessType::of::<rcs_world_model::WeightLearner>(),
        ProcessType::of::<rcs_world_model::WorldModel>(),
    ];
    ALL
}
