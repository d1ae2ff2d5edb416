//! The window: top bar, buffers, views in tiles, timeline.
//!
//! [`Window`] is everything but the frame around it, so that tests and `ocu render` show the very same.

mod app;
mod body;
mod joystick;
mod keys;
mod layout_store;
mod notices;
mod open;
mod operate;
mod scale;
mod timeline;
mod top_bar;
mod tree;

pub use app::run;
pub use body::{Options, Window};
