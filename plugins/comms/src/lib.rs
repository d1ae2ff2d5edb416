//! The comms interface between the controller and the vehicle.
