//! Formulas over values in time: arithmetic over field paths, the functions of the diagnostics tool by name, and
//! statistics of a range.
//!
//! A [`Formula`] is parsed from a text such as `smooth(/vehicle/state.speed_mps, 0.5) - 1`. It names the fields that it
//! reads ([`Formula::fields`]); the caller finds their [`Points`], and [`Formula::eval`] gives the result. Plots,
//! exports and data breakpoints share this one language; `docs/manual.md` lists its functions.
//!
//! This crate computes and knows neither logs nor sources: `rcs-runtime` gathers the points of a field.
//!
//! ```
//! use rcs_formula::{Formula, Points};
//! let formula: Formula = "derivative(/pose.x) > 1".parse()?;
//! let x = Points::from_seconds(&[(0.0, 0.0), (1.0, 2.0), (2.0, 2.5)]);
//! let fast = formula.eval(&[x])?;
//! assert_eq!(*fast.values, [1.0, 1.0, 0.0]);
//! # Ok::<(), rcs_formula::FormulaError>(())
//! ```

mod error;
mod eval;
mod formula;
mod functions;
mod moments;
mod points;
mod spectrum;
mod table;
mod text;
mod window;

pub use error::FormulaError;
pub use formula::Formula;
pub use functions::{Function, functions};
pub use moments::Moments;
pub use points::{Names, Over, Points, States};
pub use table::{csv, rows};
pub use text::FieldRef;
