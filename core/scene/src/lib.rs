//! Simulated worlds: terrain, vegetation and things, rays cast into them, images rendered from them, and courses.
//!
//! A [`World`] is read from a TOML file and never changes. It answers what the ground is like ([`World::ground`]), what
//! a vehicle touches ([`World::touching`]), what a ray hits ([`World::cast`]), and what a camera sees
//! ([`render_rows`]). It also has the ground truth: [`Class`] and [`Label`] per pixel, [`World::truth_cell`] and
//! [`World::blocked`] per position.
//!
//! The crate simulates no vehicle and no sensor, and has no clock: those are processes in the plugin `sim`. Begin with
//! [`World::from_toml`]:
//!
//! ```
//! use rcs_geom::{DVec2, DVec3};
//! use rcs_scene::{Class, World};
//! let world = World::from_toml(
//!     r#"
//!     name = "example"
//!     bounds_m = [[0, 0], [40, 30]]
//!     base = "short_grass"
//!     origin = { zone = 18, easting_m = 308000, northing_m = 4333000 }
//!     [[thing]]
//!     kind = "boulder"
//!     at = [20, 15]
//!     radius_m = 0.5
//!     height_m = 0.8
//!     "#,
//! )?;
//! let hit = world.cast(DVec3::new(10.0, 15.0, 0.4), DVec3::X, 30.0).expect("the boulder");
//! assert_eq!(hit.class, Class::Boulder);
//! assert!(world.blocked(DVec2::new(20.0, 15.0), 0.1) && !world.blocked(DVec2::new(10.0, 15.0), 0.1));
//! # Ok::<(), rcs_scene::SceneError>(())
//! ```
//!
//! # World files
//!
//! Lengths are in metres, angles in degrees counter-clockwise from east; z is up. Unknown keys are refused.
//! `docs/reference/worlds.md` has every key. The names of surfaces and kinds are those of [`Surface`] and [`ThingKind`].
//!
//! Colours, light and sky of a world can be replaced by those of a file of its own, a [`Look`].
//!
//! # Determinism
//!
//! Everything follows from the text: noise and seeded lists are hashes of seed and position, the content of vegetation
//! is a hash of the position, and a pixel depends on its camera, its pose and the world alone.

mod build;
mod camera;
mod class;
mod coat;
mod course;
mod drive;
mod field_ray;
mod ground_truth;
mod heightfield;
mod light;
mod look;
mod looks;
mod noise;
mod number;
mod packet;
mod read;
mod region;
mod render;
mod shape;
mod shape_grid;
mod spec;
mod stem;
mod surface;
mod terrain;
mod texture;
mod thing;
mod touch;
mod trace;
#[cfg(test)]
mod trace_tests;
mod world;

pub use camera::CameraRays;
pub use class::{COVER_M, Class, Label, SHORT_M, Surface, ThingKind};
pub use course::{Course, UtmPosition, WrongZone};
pub use drive::TRUTH_CELL_M;
pub use ground_truth::TruthCell;
pub use look::Look;
pub use read::SceneError;
pub use render::{CAMERA_RANGE_M, ViewRows, render_rows};
pub use thing::{Outline, Thing};
pub use touch::{Footprint, THICKET, Touch};
pub use trace::Hit;
pub use world::{Ground, World};
