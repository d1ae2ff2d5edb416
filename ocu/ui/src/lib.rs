//! Theme and widgets of the window.
//!
//! This crate depends only on egui and its icons. It knows colours, numbers and times, but neither messages nor robots;
//! the views that show those are in `ocu-views`.
//!
//! # Where to begin
//!
//! - [`install`], [`tokens`]: all colours and distances of the window, for the dark and the light theme.
//! - [`palette`]: colours of labels, costs, heights and ranges.
//! - [`mod@format`]: numbers, times, ages and sizes as text of constant width.
//! - [`stale`]: how an outdated value is marked.
//! - [`bar`]: a bar that gives way where there is no room.
//! - [`short_name`]: names that are shortened so that they can be told apart.
//! - [`widgets`], [`legend`]: widgets shared by several views.
//! - [`typing`]: what Enter does in a text field, and when keys belong to one.
//!
//! # Example
//!
//! ```
//! use ocu_ui::format;
//! use ocu_ui::palette::{MapPalette, UNKNOWN_COST};
//!
//! assert_eq!(format::bytes(2_400), "2.4 kB");
//! let palette = MapPalette::Even;
//! assert_eq!(palette.cost(UNKNOWN_COST), palette.unknown());
//! ```

pub mod bar;
pub mod format;
pub mod legend;
pub mod palette;
pub mod short_name;
pub mod stale;
mod theme;
pub mod typing;
pub mod widgets;

/// Icons, by name.
pub use egui_material_icons::icons;
/// An icon of [`icons`].
pub type Icon = egui_material_icons::MaterialIcon;
pub use theme::{Tokens, UNIT, contrast, install, tokens, tokens_of};
