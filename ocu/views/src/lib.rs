//! The views of the window, one file (or folder) each, and the one list of them.
//!
//! A view reads a [`Frame`](rcs_runtime::source::Frame) and paints it. It matches topics by type and role, never by
//! plugin, so a plugin's outputs appear without a line of code here. What a view wants done (play, seek, write a
//! buffer) it asks for through [`ViewContext::controls`]; it never waits.
//!
//! The window makes views from [`all`], shows each through [`show`], and keeps what [`View::save`] gives.

mod buffers;
mod camera;
mod canvas;
mod clip;
mod drive;
mod fields;
mod hierarchy;
mod image;
mod map;
pub mod operator;
mod pose;
#[cfg(test)]
mod samples;
#[cfg(test)]
mod tests;
mod texture;
mod toolbar;
mod view;
mod views;

pub use view::{HoverPoint, RunChoice, SavedState, Selection, TopicKey, View, ViewContext, ViewType, show};
pub use views::{all, view_type};
