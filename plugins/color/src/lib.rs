//! Colour models of ground and background.
