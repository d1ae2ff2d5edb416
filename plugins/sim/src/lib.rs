//! The simulated vehicle: dynamics, sensors, truth.

pub mod contact;
pub mod drive;
pub mod sensors;
pub mod spec;
pub mod terrain;
pub mod vehicle;
