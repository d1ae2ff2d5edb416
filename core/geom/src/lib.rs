//! Frames, poses, camera models, geodesy and the scrolling grid.
