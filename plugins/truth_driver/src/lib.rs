//! A driver that follows the shortest path on the true map.
