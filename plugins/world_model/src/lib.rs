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
//! | `slip` | in, optional | `foxglove.Grid` | cells on which the wheels slipped: field cost.slip, local frame |
//! | `costs` | in, optional | `foxglove.Grid` | costs of any sources: a field cost.<source> for each that the parameters list, local frame |
//! | `weights` | in, optional | `rcs.FusionWeights` | weights that a process has learned; one counts until that of the parameters is changed |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `map` | out | `foxglove.Grid` | cells around the vehicle, local frame |
//! | `vehicle` | out | `foxglove.PoseInFrame` | pose of the vehicle in the local frame, with each map |
//! | `stats` | out | `rcs.WorldModelStats` | known and obstacle cells of the map, and the age of each source |
//!
//! Period 50 ms: votes are counted as cost maps arrive; the map is sent 5 times a second. Command `CLEAR` forgets the
//! map. State: the map (41 kB of shared tiles per snapshot where nothing changed), the poses of the last seconds.
//!
//! It fuses costs. It does not interpret sensor data, which is the task of the sources, and it does not plan.
//!
//! Method: each cost map gives each cell of the map at most one vote for its source; cells of other sizes are
//! resampled. A vote raises the confidence of that source in the class of the vote and lowers that in the other class,
//! by constants and within bounds (Oskard 1988); ground's bound is low, so that an obstacle wins over ground that was
//! seen for long. A source that keeps a map of its own (learned terrain) states its evidence instead, and replaces what
//! was known of it where its map is now. What is not seen again fades. The evidence of each source is kept separately, and the published cost
//! is computed from it by [`rcs_world::fuse`] with the weights of the parameters. The map scrolls so that the vehicle
//! stays in cell (100, 100). Voting rules and message fields: [`rcs_world`].
//!
//! The map is sent as [`rcs_world::MapMessage`], which shares its tiles with the process. Readers that do not know that
//! type receive a `foxglove.Grid`, and recordings contain key frames and changed tiles.
//!
//! An unusable cost map (wrong frame, no field `cost.<source>`, inconsistent sizes) is a fault and changes nothing.
//! Where the vehicle's pose in the local frame leaps, the frame has begun again: the map is cleared, which is a fault.
//!
//! # `prediction`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `image` | in | `foxglove.RawImage` | image of the camera: only its time and frame are read |
//! | `calibration` | in | `foxglove.CameraCalibration` | calibration of the image |
//! | `map` | in, optional | `foxglove.Grid` | world model: its obstacles are predicted, local frame |
//! | `path` | in, optional | `foxglove.PosesInFrame` | planned path, local frame |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `predicted` | out | `foxglove.ImageAnnotations` | obstacles from foot to top, and the path, pixels of the image |
//!
//! Period 50 ms; with each image it sends what the camera is expected to see of the map and of the path ([`prediction`]).
//! It has no commands. State: the poses of the last seconds, and the camera. The colour models decide by the same
//! projection ([`rcs_sense::Standing`]) whether an obstacle of the map lies in their ground sample; they take it at the time
//! of their own image, which a message of the image before would not be.
//!
//! # `weight_learner`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `map` | in | `foxglove.Grid` | the world model's map, with the evidence of each source |
//! | `params` | in | `rcs.WorldModelParams` | the world model's parameters, which give the weights to begin with |
//! | `weights` | out | `rcs.FusionWeights` | weights of the sources, and why they are these |
//!
//! Period 1 s. Command `RESET` goes back to the weights of the parameters. State: the maps of the last eight seconds, and
//! the newest judgements (shared between snapshots). It adjusts the weights of a world model while the vehicle drives,
//! by how each source agreed with what was driven over, hit, or seen from near ([`rcs_world::fit`]). In the bundled
//! stacks it does not adjust them (`adjusts`) but says what would be better, because the same place would be judged
//! differently from one minute to the next. In a stack it is wired to a world model so:
//!
//! ```toml
//! [change.wm1]
//! inputs = { weights = "/weights/weights" }
//!
//! [[process]]
//! name = "weights"
//! plugin = "weight_learner"
//! supervisor = "robot"
//! as = "auxiliary"
//! inputs = { map = "/wm1/map", params = "/wm1/params" }
//! ```
//!
//! # `map_memory`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `map` | in | `foxglove.Grid` | the map to remember, with the evidence of each source, local frame |
//! | `odometry` | in | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `transforms` | in | `foxglove.FrameTransforms` | the local frame in the global frame |
//! | `plan` | in, optional | `rcs.Plan` | the plan on that map: one without a way to the goal drops the remembered map |
//! | `cost` | out | `foxglove.Grid` | the remembered map where it fits: fields cost.memory, conf.memory and backing.memory, local frame |
//! | `memory` | out | `rcs.MapMemory` | the map to save, global frame |
//! | `registration` | out | `foxglove.FrameTransforms` | the frame of the remembered map in the local frame; none while it does not fit |
//!
//! What the run has seen outlives `INIT`. While the local frame has jumped by more than `jump_m` in the global one, the
//! map is not saved: until it is back, or the vehicle has driven on for 30 s. A remembered map that leaves no way to a
//! goal is not used until there is another goal, and is saved all the same.
//!
//! Period 0.5 s. Commands `SAVE` and `CLEAR`. State: the track, and how the remembered map fits. The map of a run is the
//! parameter `memory` of the next one; `ocu run --save` writes it, and `ocu run --runs` hands it over. It is registered
//! against what is sensed before it is believed, stays where it is in the local frame while the estimate of the position
//! changes, and follows what is sensed as the local frame drifts ([`memory`]); one that does not fit, or is of another UTM
//! zone, is not used, and the status says why. Until that is decided, it is saved as it was. Where the local frame begins
//! again, what this run has saved is remembered in the same way, and nothing is saved until it is registered.
//! `registration` also places the route of the earlier run. What is remembered is one source of the world model, whose
//! weight is such that anything sensed outvotes it.
//!
//! # Where to begin
//!
//! [`resample`] and [`algo`] convert cost maps to votes; [`WorldModel`] connects it to ports and parameters. A new source of costs is a
//! name in the parameters and a field `cost.<name>` in a cost map on the input `costs`.
//!
//! # Example
//!
//! ```
//! use rcs_runtime::Process;
//! use rcs_world_model::WorldModel;
//! use rcs_world_model::proto::{WorldModelParams, WorldModelSource};
//!
//! let source = |name: &str| WorldModelSource { name: name.to_owned(), ..Default::default() };
//! let with = |sources| WorldModelParams { sources, ..Default::default() };
//! assert!(WorldModel::check(&with(vec![source("stereo"), source("sonar")])).is_ok());
//! assert!(WorldModel::check(&with(vec![source("stereo"), source("stereo")])).is_err(), "listed twice");
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod algo;
pub mod memory;
mod memory_process;
pub mod prediction;
mod prediction_process;
mod process;
pub mod register;
pub mod resample;
pub mod saved;
mod sources;
mod weight_learner;

pub use memory_process::{MapMemoryCommand, MapMemoryKeeper};
pub use prediction_process::Prediction;
pub use process::{WorldModel, WorldModelCommand};
pub use weight_learner::{WeightLearner, WeightLearnerCommand};
