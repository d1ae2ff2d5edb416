//! Theme and widgets. Nothing here knows of messages or robots: only of colours, numbers and time.
//!
//! - [`install`], [`tokens`]: every colour and distance of the window, for the dark and the light theme.
//! - [`palette`]: from a label, a cost, a height or a range to a colour.
//! - [`mod@format`]: numbers, times, ages and sizes as text of constant width.
//! - [`stale`]: the look of a value that is old.
//! - [`widgets`], [`legend`]: what several views need.

pub mod format;
pub mod legend;
pub mod palette;
pub mod stale;
mod theme;
pub mod widgets;

/// Icons, by name.
pub use egui_material_icons::icons;
/// One icon of [`icons`].
pub type Icon = egui_material_icons::MaterialIcon;
pub use theme::{Tokens, UNIT, install, tokens, tokens_of};
