//! The world model WM1: fuses sensed costs into a scrolling map (Albus 2006a, 4, Albus 2006b, 3.4).
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `stereo` | in, optional | `foxglove.Grid` | costs from range images: field cost.stereo, local frame |
//! | `color` | in, optional | `foxglove.Grid` | costs of the colour models: field cost.color, local frame |
//! | `terrain` | in, optional | `foxglove.Grid` | costs of terrain learned from range: field cost.terrain, local frame |
//! | `classifier` | in, optional | `foxglove.Grid` | costs of the image classifier: field cost.classifier, local frame |
//! | `bumper` | in, optional | `foxglove.Grid` | cells that the bumper hit: field cost.bumper, local frame |
//! | `infrared` | in, optional | `foxglove.Grid` | costs of the infrared sensors: field cost.infrared, local frame |
//! | `costs` | in, optional | `foxglove.Grid` | costs of any sources: a field cost.<source> for each that the parameters list, local frame |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `map` | out | `foxglove.Grid` | 201x201 cells of 0.2 m around the vehicle, local frame |
//! | `vehicle` | out | `foxglove.PoseInFrame` | pose of the vehicle in the local frame, with each map |
//! | `stats` | out | `rcs.WorldModelStats` | known and obstacle cells of the map |
//!
//! Period 50 ms: votes are taken at the sensors' rates; the map goes out 5 times a second. Command `CLEAR` forgets the
//! map. State: the map (41 kB of shared tiles a snapshot where nothing changed), the last seconds of poses.
//!
//! Method: every cell of a cost map with a cost is one vote of its source for the ground under its middle. A vote for
//! the class that the cell has raises that source's confidence by a constant, one against it lowers it (Oskard); the
//! sources stay apart, and what goes out is fused by [`rcs_world::fuse`] with the weights of the parameters. The map
//! scrolls so that the vehicle is in cell (100, 100). Rules and fields of the message: [`rcs_world`].
//!
//! The map goes out as [`rcs_world::MapMessage`], which shares its tiles with the process; it becomes a `foxglove.Grid`
//! for those who do not know it, and is recorded as key frames and changed tiles.
//!
//! A cost map that cannot be used (another frame, no `cost.<source>`, sizes that do not fit) is a fault and changes
//! nothing.

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod algo;
mod process;

pub use process::{CELL_SIZE_M, WorldModel, WorldModelCommand};
