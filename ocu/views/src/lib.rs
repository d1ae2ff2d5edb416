//! The views of the window, one file each, and their one list.
