//! Costs from bumper, infrared sensors, motor current and slip.
