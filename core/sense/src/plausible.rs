//! Bounds of what a sensor of a ground vehicle can read. Beyond them, also where it is no number, a reading is none: one that
//! is used would spoil an estimate for good.

/// Fastest turn, rad/s: the range of a common gyro (2000°/s).
pub const FASTEST_RADPS: f64 = 35.0;
/// Hardest push, m/s²: the range of a sensor for shocks.
pub const HARDEST_MPS2: f64 = 500.0;
/// Fastest wheel, m/s.
pub const FASTEST_WHEEL_MPS: f64 = 100.0;
