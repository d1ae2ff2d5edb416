//! Simulated worlds: terrain, vegetation, things, and rays cast into them.
