//! A driver that knows the ground truth: what the courses of the simulation can be driven in.
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `ground_truth_pose` | in | `foxglove.Odometry` | true pose of the vehicle, frame global |
//! | `ground_truth_map` | in | `foxglove.Grid` | fields height and vegetation (m) and class of the whole world, frame global |
//! | `goal` | in | `foxglove.PoseInFrame` | where to go, frame global |
//! | `drive` | out | `rcs.DriveCommand` | speed, m/s, and turn rate, rad/s |
//! | `path` | out | `foxglove.PosesInFrame` | cells of the path from where it was planned to the goal, frame global |
//! | `stats` | out | `rcs.TruthDriverStats` | plans, and how the path is followed |
//!
//! Period 50 ms; `drive` every cycle while there is a path, `path` and `stats` twice a second. Cost: microseconds, and
//! a search (tenths of a second on a world of 150 m) when the map or the goal changes, or the vehicle has strayed.
//! State: pose, goal, path.
//!
//! No seed has it: it stands in for a whole control stack that is not under test. Cells with things (not crowns), steep
//! faces and steps are blocked; the distance to them, slope, slippery surfaces and tall vegetation make cells dearer:
//! [`terrain`]. A* with eight neighbours finds the cheapest path: [`search`]. A point of it some way ahead is steered
//! for, more slowly before bends and in narrow places: [`pursuit`].
//!
//! It commands a turn rate rather than a heading: headings of [`rcs_msg::rcs::DriveCommand`] are in the local frame of
//! a position estimate, which knows nothing of the ground truth.

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
