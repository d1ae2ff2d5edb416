//! The simulated vehicle: dynamics, sensors, truth.
