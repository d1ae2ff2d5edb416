//! Local and global position estimates.
