//! The window: top bar, buffers, views in tiles, timeline.
//!
//! [`Window`] contains everything except the system's window frame, so that tests and `ocu render` draw the same
//! contents.

mod app;
mod body;
mod commands;
mod document;
mod focus;
mod joystick;
mod keymap;
mod layout_store;
mod notices;
mod open;
mod operate;
mod palette;
mod save_params;
mod scale;
mod shortcut;
mod stop_button;
mod timeline;
mod top_bar;
mod tree;

pub use app::run;
pub use body::{Options, Window};
