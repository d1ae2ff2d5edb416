//! The simulated vehicle: its motion, its sensors, ground truth, and the referee of a course.
//!
//! # `sim_vehicle`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `wheels` | in, optional | `rcs.WheelCommand` | speeds of the driven wheels, m/s, and curvature, 1/m |
//! | `encoders` | out | `rcs.WheelEncoders` | distances and speeds of the driven wheels, m and m/s |
//! | `imu` | out | `rcs.Imu` | turn rates, accelerations and heading, vehicle axes |
//! | `motors` | out | `rcs.MotorCurrents` | currents of the drive motors, A |
//! | `bumper` | out | `rcs.Bumper` | switches of the bumper in front |
//! | `infrared` | out | `rcs.RangeReadings` | ranges of the infrared sensors, m |
//! | `gps` | out | `foxglove.LocationFix` | position fixes of the antenna with their variances |
//! | `ground_speed` | out | `rcs.GroundSpeed` | speed over ground by Doppler radar, m/s |
//! | `steering` | out | `rcs.Steering` | curvature of the steered wheels, 1/m |
//! | `static_transforms` | out | `foxglove.FrameTransforms` | mounts of the sensors on the vehicle, once a second |
//! | `goal` | out | `foxglove.PoseInFrame` | the goal of the course, frame global, once a second |
//! | `run` | out | `rcs.CourseRun` | progress of the course |
//! | `ground_truth_state` | out | `rcs.GroundTruthState` | true pose in the frame global, speed, slip, contacts |
//! | `ground_truth_pose` | out | `foxglove.Odometry` | true pose of the vehicle in the frame global |
//! | `ground_truth_map` | out | `foxglove.Grid` | ground height, height of its cover (m), class and blocked of the whole world |
//! | `ground_truth_objects` | out | `rcs.GroundTruthObjects` | all objects of the world, frame global |
//!
//! Period 10 ms, which is also the time step; the state that is sent is that of the cycle's time. Sensors are sent at
//! the rates of the vehicle file. A command takes effect in the cycle that reads it. No commands besides those of the
//! runtime.
//!
//! # `sim_cameras`, `sim_ladar`
//!
//! A stereo pair or a single camera, and a scanning ladar. Their port tables are in [`cameras_process`] and
//! [`ladar_process`].
//!
//! # Where to begin
//!
//! - [`spec`]: the vehicle file, which contains everything that distinguishes one vehicle from another.
//! - [`vehicle`], [`drive`], [`contact`]: the motion. [`terrain`] is the interface to a world, [`scene`] implements it.
//! - [`sensors`], [`exposure`], [`clouds`]: sensor models with their errors, and the light.
//! - [`commands`]: which commands are obeyed. [`referee`]: the progress of a course.
//!
//! # Limits
//!
//! This is a model for testing perception and control, not a rigid-body physics engine. The frame does not bounce
//! (heights of the wheels follow the ground as first-order systems), the bumper's impact turns the vehicle only through
//! the contact point, and objects do not move when they are hit.
//!
//! Frame `global` has its origin at the world's origin and the axes of the UTM grid there; heights are above the
//! ellipsoid.
//!
//! Commands that are not finite, exceed the speed of the wheels, are older than the previous one, or are older than
//! `command_timeout_s` are faults and are not obeyed, nor is a turn by wheel speeds alone of a vehicle with steering;
//! without a valid recent command the vehicle brakes.
//!
//! # Example
//!
//! ```
//! use rcs_sim::spec::VehicleSpec;
//!
//! let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/vehicles/lagr.toml");
//! let spec = VehicleSpec::from_toml(&std::fs::read_to_string(file)?)?;
//! assert!(spec.wheels.track_m > 0.0 && spec.steering.is_none(), "a differential drive");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod camera_condition;
pub mod cameras_process;
pub mod clouds;
pub mod commands;
pub mod contact;
pub mod drive;
pub mod exposure;
pub mod ladar_process;
pub mod referee;
pub mod scene;
pub mod sensors;
pub mod spec;
pub mod terrain;
mod truth;
pub mod vehicle;
mod vehicle_process;

pub use cameras_process::SimCameras;
pub use ladar_process::SimLadar;
pub use vehicle_process::SimVehicle;
