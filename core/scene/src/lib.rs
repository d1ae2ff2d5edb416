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
//!
//! | table | keys |
//! | --- | --- |
//! | top | `name`, `seed`, `bounds_m = [[x, y], [x, y]]`, `base` (a surface) |
//! | `[origin]` | `zone`, `north`, `easting_m`, `northing_m`: UTM coordinates of the origin (0, 0) |
//! | `[sun]` | `azimuth_deg`, `elevation_deg` |
//! | `[surface.NAME]` | `traction`, `rolling_resistance`, `slip_at_limit`, `height_m`, `density_per_m`, `drag`, `passable`, `colour`, `second_colour` |
//! | `[[undulation]]` | `wavelength_m`, `amplitude_m` |
//! | `[[hill]]` | `centre`, `radius_m`, `second_radius_m`, `yaw_deg`, `height_m` (negative for a hollow) |
//! | `[[slope]]` | `from`, `to`, `rise_m` |
//! | `[[ditch]]` | `path`, `width_m`, `depth_m`, `bank_m` |
//! | `[[ledge]]` | `path`, `height_m` (of the left side), `run_m`, `fade_m` |
//! | `[[paint]]` | `surface`, a region, `edge_m` (irregularity of its border) |
//! | `[[thing]]` | `kind`, `at`, `yaw_deg`, sizes |
//! | `[[line]]` | `kind` (fence, hedge), `path`, sizes |
//! | `[[scatter]]` | `kind`, `count`, `spacing_m`, a region, sizes as a number or `[least, largest]` |
//! | `[[clear]]` | a region that seeded lists leave empty |
//!
//! A region is one of `polygon = [[x, y], …]`, `path = [[x, y], …]` with `width_m`, `circle = [x, y, radius]`.
//! Sizes are those of `radius_m`, `height_m`, `crown_radius_m`, `length_m` and `width_m` that the kind has.
//! The names of surfaces and kinds are those of [`Surface`] and [`ThingKind`].
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
mod ground_truth;
mod heightfield;
mod light;
mod look;
mod looks;
mod noise;
mod read;
mod region;
mod render;
mod shape;
mod shape_grid;
mod spec;
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
