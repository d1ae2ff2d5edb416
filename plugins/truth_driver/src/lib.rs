//! A driver that uses ground truth to drive the courses of the simulation.
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `ground_truth_pose` | in | `foxglove.Odometry` | true pose of the vehicle, frame global |
//! | `ground_truth_map` | in | `foxglove.Grid` | fields height and vegetation (m) and class of the whole world, frame global |
//! | `goal` | in | `foxglove.PoseInFrame` | the goal, frame global |
//! | `drive` | out | `rcs.DriveCommand` | speed, m/s, and turn rate, rad/s |
//! | `path` | out | `foxglove.PosesInFrame` | cells of the path from where it was planned to the goal, frame global |
//! | `stats` | out | `rcs.TruthDriverStats` | planning and path following |
//!
//! Period 50 ms; `drive` every cycle while there is a path, `path` and `stats` twice a second. Cost: microseconds, and
//! a search (tenths of a second on a world of 150 m) when the map or the goal changes, or when the vehicle has left its
//! path. State: pose, goal, path.
//!
//! It comes from none of the papers. It replaces the rest of the control stack in tests of one part, such as
//! perception. It is not a planner for a real vehicle: it reads ground truth, so a run with it is marked as such.
//!
//! It commands a turn rate rather than a heading, because headings of [`rcs_msg::rcs::DriveCommand`] are in the local
//! frame of the localization, whose relation to ground truth is unknown.
//!
//! # Where to begin
//!
//! - [`terrain`]: cells with obstacles (except tree crowns), steep faces and steps are blocked; cells near them,
//!   slopes, slippery surfaces and tall vegetation have a higher cost.
//! - [`search`]: A* with eight neighbours finds the cheapest path.
//! - [`pursuit`]: steers for a point some way ahead on the path; slows down before bends and in narrow places.
//!
//! # Example
//!
//! ```
//! use rcs_truth_driver::search::{Field, shortest};
//!
//! // Three by two cells of 1 m; the upper middle one is blocked.
//! let cost = [1.0, f32::INFINITY, 1.0, 1.0, 1.0, 1.0];
//! let field = Field { columns: 3, cell_size_m: 1.0, cost: &cost };
//! let path = shortest(&field, 0, 2).unwrap();
//! assert_eq!(path.cells, [0, 3, 4, 5, 2], "no diagonal step past a blocked corner");
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod distance;
mod process;
pub mod pursuit;
pub mod search;
pub mod terrain;

pub use process::TruthDriver;
