//! The world model WM1: fuses sensed costs into a scrolling map.
