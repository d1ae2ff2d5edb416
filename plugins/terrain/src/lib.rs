//! Terrain models learned from range, and images classified by them.
