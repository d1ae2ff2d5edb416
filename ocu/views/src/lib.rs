//! The views of the window: one file or folder each, and one list of them.
//!
//! A view reads a [`Frame`](rcs_runtime::source::Frame), the state of a source at one time, and paints it. It selects
//! topics by type and role, never by plugin, so outputs of a new plugin appear without a change here. Actions (play,
//! seek, write a buffer) are requested through [`ViewContext::controls`]; a view never blocks, and never reads files or
//! logs itself.
//!
//! The window creates views from [`all`], paints each with [`show`], and stores what [`View::save`] returns.
//!
//! # Where to begin
//!
//! [`View`] is the trait to implement, [`ViewContext`] what a view receives; `src/timing.rs` is a view without
//! state. A new view is one file and one entry in `src/views.rs`.
//!
//! # Example
//!
//! ```
//! let map = ocu_views::view_type("map").unwrap();
//! let mut view = (map.make)();
//! let saved = view.save(); // what a layout stores
//! view.load(&saved).unwrap();
//! ```

mod badge;
mod buffers;
mod cached;
mod camera;
mod canvas;
mod clip;
mod cloud_colors;
mod cloud_look;
mod command;
mod compare;
mod conditions;
mod details;
mod drive;
pub mod edit;
mod fields;
mod frames;
mod hierarchy;
mod image;
mod keys;
mod ladder;
mod links;
mod map;
mod models;
pub mod offscreen;
pub mod operator;
mod origin;
mod plan;
mod plot;
mod pose;
pub mod prepare;
mod primitives;
pub mod process_state;
#[cfg(test)]
mod samples;
mod scene;
mod series;
mod sweep;
#[cfg(test)]
mod tests;
mod text_log;
mod timing;
mod toolbar;
mod tuning;
mod view;
mod views;

pub use camera::cameras;
pub use sweep::{SweepRequest, SweepRow, SweepState};
pub use view::{
    Drafts, Draws, FieldKey, Hover, HoverPoint, Hovers, Preview, PreviewStage, Previews, RunChoice,
    SavedState, Selection, ShowIn, TopicKey, View, ViewContext, ViewType, Wish, show,
};
pub use views::{all, view_type};
