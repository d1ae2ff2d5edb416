//! The window: top bar, buffers, views in tiles, timeline.
//!
//! [`Window`] contains everything except the system's window frame, so that tests and `ocu render` draw the same
//! contents.

mod actions;
mod alarm_sound;
mod app;
mod body;
mod bookmarks;
mod commands;
mod complete;
mod density;
mod dialog;
mod document;
mod file_dialogs;
mod focus;
mod follow;
mod frames;
mod held;
mod joystick;
mod keymap;
mod known_alarms;
mod lanes;
mod layout_store;
mod leaving;
mod load_param;
mod memory;
mod notices;
mod open;
mod operate;
mod palette;
mod panels;
mod recording;
mod save_file;
mod save_params;
mod scale;
mod shortcut;
mod source;
mod state_lane;
mod stop_button;
mod sweeping;
mod timeline;
mod top_bar;
mod top_menus;
mod top_state;
mod top_tags;
mod transport;
mod tree;
mod typed_time;

pub use app::run;
pub use body::{Options, Window};
