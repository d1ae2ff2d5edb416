//! Behavior generation above the vehicle interface: planner, waypoint generator and waypoint follower (Albus 2006a, 5,
//! Albus 2006b, 3.5).
//!
//! # `planner`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `map` | in | `foxglove.Grid` | the world model's map: field cost, local frame |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `path` | out | `foxglove.PosesInFrame` | cells of the path from the vehicle to the goal or to the map's edge, local frame; none to stop |
//! | `plan` | out | `rcs.Plan` | the path with the terms of its cost, and the cheapest path elsewhere with its |
//!
//! Period 50 ms; it plans when a new map or goal has come. Command `PLAN_TO` sets the goal, in the local frame. Cost: 2
//! searches of at most a millisecond, and the costs of the map. State: the goal, the poses of the last seconds.
//!
//! It plans for a point with the room of a vehicle on one map. It does not steer: that is the task of the follower,
//! which knows the vehicle's motion. It does not remember: what it has not on the map it takes for unknown.
//!
//! # Why here and not there
//!
//! Each step of `plan` has the terms of its cost ([`terrain`]), and so has the cheapest path that stays away from the
//! middle of the one chosen; `reason` says what that one would cost more, term by term.
//!
//! # When there is no path
//!
//! The status is `ERROR` with the reason, and the path sent has no poses, so that the vehicle stops: no pose or one that
//! is too old, a map that is too old, cannot be used or knows nothing around the vehicle, a goal inside of an obstacle, no way, or none but through zones. It plans again as soon as
//! the reason is gone. If the goal's cell is blocked, it plans to the nearest free one within `approach_m`, and says so;
//! arrived there, it is in `ERROR` if the goal is still blocked and farther away than `goal_radius_m`.
//! A point of a longer path counts as reached within 0.3 m at most. A goal outside of the map is planned to over the edge that suits, with all cells outside taken for unknown.
//!
//! # `waypoint_generator`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `path` | in | `foxglove.PosesInFrame` | the planner's path, local frame |
//! | `far_path` | in, optional | `foxglove.PosesInFrame` | path of the planner of a larger map, local frame; used only with `global` |
//! | `transforms` | in | `foxglove.FrameTransforms` | the local frame in the global frame |
//! | `global` | in, optional | `foxglove.Odometry` | pose of the vehicle in the global frame: its covariance, its track, and its place on `far_path` |
//! | `way_slip` | in, optional | `rcs.WaySlip` | slip over the last metres: the route for the next run leaves out where the wheels slipped |
//! | `map` | in, optional | `foxglove.Grid` | a world model's map, local frame, by which the route is cut |
//! | `registration` | in, optional | `foxglove.FrameTransforms` | the global frame of the remembered route in the local frame |
//! | `modes` | in, optional | `rcs.ModeEvent` | changes of mode of the follower, for places that are barred |
//! | `plan` | in, optional | `rcs.Plan` | the planner's plan: whether there is a way to where the far path leads |
//! | `vehicle` | in, optional | `rcs.VehicleStatus` | state of the vehicle; while it is held or driven by hand, the search for the goal waits |
//! | `mission` | in, optional | `rcs.Mission` | goals, area and zones of the operator |
//! | `waypoints` | out | `foxglove.PosesInFrame` | waypoints along the path, local frame; none to stand |
//! | `goal` | out | `foxglove.PoseInFrame` | the goal in the local frame |
//! | `route` | out | `rcs.Route` | path memory: the way to the goal without loops and excursions, UTM; near the goal |
//! | `slips` | out | `rcs.SlipMemory` | slip memory: places where the wheels slipped, UTM |
//! | `driven` | out | `rcs.Mission` | the goals, the area and the zones that are obeyed, global frame |
//!
//! Period 50 ms. It supervises a planner, a follower and, optionally, a planner on a larger map: passes `INIT`, `RUN` and
//! `HALT` on to them, and has the planners plan to the goal ([`goal`]) wherever that moves in the local frame. With a far
//! planner, the near one plans to the point of its path that lies `lookahead_m` along it, as the levels of A 5 do, so
//! that what has left the near map is not forgotten; where its path there is a detour, to a point half as far. Command `GO_TO` gives another goal, and the operator's `mission` gives
//! several ([`mission`]), which are driven to one after the other; both outlive `INIT`. Commands `SAVE` and `CLEAR` are for
//! what is remembered from run to run; they change nothing of what is driven to. The planners go around [`zones`] and stay inside of the
//! area; a goal that lies elsewhere is not driven to. The route of a run ([`route`], cut by the `map` as [`shortcut`] says)
//! is a parameter of the next one, and the planner makes the cells along it cheaper. One to another goal stays until this goal
//! is reached, and after `CLEAR` one without points is sent. With `found_within_m`, it looks
//! for the goal of the file after it has arrived there by its own estimate ([`goal_search`]). There are no waypoints,
//! and it is in `ERROR`, without a goal, with one in another UTM zone, while the position is not known
//! well enough, and when the local frame has jumped in the global one. If the fixes then put the vehicle back on its own track,
//! its wheels have turned on the spot: it goes on, and the place ahead is [`barred`], as where a mode bars one. Where wheels
//! slipped is a parameter of the next run ([`slips`]). State: the frames, what the planner was told, the track, and the barred places.
//!
//! # `waypoint_follower`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `waypoints` | in | `foxglove.PosesInFrame` | waypoints of the path, local frame; none to stand |
//! | `map` | in | `foxglove.Grid` | the world model's map: field cost, local frame |
//! | `sensed` | in, optional | `foxglove.Grid` | costs from the sensors that must not stop: it stands without recent ones |
//! | `left_images` | in, optional | `foxglove.RawImage` | images, ranges or labels of the left side: it stands without recent ones |
//! | `right_images` | in, optional | `foxglove.RawImage` | the same of the right side |
//! | `goal` | in, optional | `foxglove.PoseInFrame` | the goal, local frame: for modes that drive straight to it |
//! | `plan` | in, optional | `rcs.Plan` | the plan: for modes that begin when there is no way |
//! | `far_plan` | in, optional | `rcs.Plan` | the plan on a larger map, for such modes, too |
//! | `bumper` | in, optional | `rcs.Bumper` | switches of the bumper, for modes |
//! | `slip` | in, optional | `rcs.SlipReport` | slip of the wheels and load of the motors, for modes |
//! | `way_slip` | in, optional | `rcs.WaySlip` | slip over the last metres, for modes |
//! | `vehicle` | in, optional | `rcs.VehicleStatus` | state of the vehicle; held or driven by hand, it is not stuck |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `drive` | out | `rcs.DriveCommand` | speed, m/s, and turn rate, rad/s |
//! | `arc` | out | `foxglove.PosesInFrame` | the arc that is driven, local frame |
//! | `arcs` | out | `rcs.ArcChoice` | the arcs that were considered, with the terms of their scores |
//! | `modes` | out | `rcs.ModeEvent` | each change of mode, with its reason |
//!
//! Period 50 ms; `drive` every cycle. It drives to the first major turning point of the waypoints ([`waypoints`]) on the
//! best of a list of arcs ([`arcs`]), no faster than the limits that `vehicle` states. It stands, and says so, without a
//! recent path, map or pose, and where no arc is free. The papers' custom behaviors are a table in a file ([`modes`]); without a file there are none. State: the
//! waypoints, the goal, the poses of the last seconds, the last arc, the active mode.
//!
//! # Where to begin
//!
//! [`costs`]: the grid of costs; [`search`]: A* with eight neighbours; [`terrain`]: what a cell costs; [`plan`]: the plan
//! with its terms; [`arcs`]: the choice of an arc. [`AStarPlanner`], [`WaypointGenerator`] and [`WaypointFollower`]
//! connect them to ports and parameters.
//!
//! ```
//! use rcs_planner::costs::{BLOCKED, CostGrid};
//! use rcs_planner::search::{Path, Place, Search};
//!
//! // Three by two cells; the upper middle one is blocked.
//! let costs = CostGrid::new(3, 2, vec![1, BLOCKED, 1, 1, 1, 1])?;
//! let (mut search, mut path) = (Search::default(), Path::default());
//! search.path(&costs, Place::new(0, 0), Place::new(2, 0), 1, &mut path)?;
//! assert_eq!((path.cells.len(), path.cost), (5, 4.0), "no diagonal step past a blocked corner");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod arcs;
pub mod barred;
mod borders;
mod children;
pub mod clearance;
pub mod costs;
mod follower_costs;
mod follower_process;
mod generator_process;
pub mod goal;
pub mod goal_search;
pub mod grip;
mod ground;
mod held;
mod map_reader;
pub mod mission;
pub mod modes;
mod motion;
mod place;
pub mod plan;
mod process;
mod queue;
pub mod route;
pub mod search;
pub mod sensed;
mod settings;
pub mod shortcut;
mod signals;
pub mod slips;
pub mod terrain;
pub mod waypoints;
pub mod zones;

pub use follower_process::WaypointFollower;
pub use generator_process::{WaypointGenerator, WaypointGeneratorCommand};
pub use process::{AStarPlanner, PlannerCommand};
