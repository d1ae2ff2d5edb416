//! The world-model cell, its message layout and the fusion rule.
