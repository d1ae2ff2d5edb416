//! The vehicle file, which describes the simulated vehicle.
//!
//! `docs/reference/worlds.md` has every key. An invalid file is refused with line, key, the value found and what was
//! expected; unknown keys are refused. Lengths are in metres, positions in the vehicle frame: origin on the ground midway
//! between the driven wheels, x forward, y left, z up.

mod parse;
mod reader;
mod sensors;

pub use reader::FileError;
pub use sensors::{
    CameraKind, CameraSpec, CloudsSpec, DopplerSpec, EncoderSpec, ExposureControl, GpsSpec, InertialSpec,
    InfraredSpec, LadarSpec, Mount,
};

/// The contents of a vehicle file.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleSpec {
    /// Name of the vehicle.
    pub name: String,
    /// Mass and dimensions of the body.
    pub body: BodySpec,
    /// Wheels.
    pub wheels: WheelSpec,
    /// Motors.
    pub motors: MotorSpec,
    /// Steering; `None` for a differential drive.
    pub steering: Option<SteeringSpec>,
    /// Bumper.
    pub bumper: BumperSpec,
    /// Wheel encoders.
    pub encoders: EncoderSpec,
    /// Gyros, accelerometers, compass.
    pub inertial: InertialSpec,
    /// Position receiver.
    pub gps: GpsSpec,
    /// Speed over ground by radar.
    pub doppler: Option<DopplerSpec>,
    /// Rates of the other outputs, 1/s.
    pub rates: Rates,
    /// Range sensors.
    pub infrared: Vec<InfraredSpec>,
    /// Cameras and stereo pairs.
    pub cameras: Vec<CameraSpec>,
    /// Scanning ladars.
    pub ladars: Vec<LadarSpec>,
    /// Passing clouds, which the cameras see. They are in this file because it says all that disturbs the images.
    pub clouds: Option<CloudsSpec>,
}

/// Mass and dimensions of the body; lengths in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodySpec {
    /// Total mass, kg.
    pub mass_kg: f64,
    /// Moment of inertia about the vertical axis, kg·m².
    pub yaw_inertia_kgm2: f64,
    /// Height of the centre of mass.
    pub centre_height_m: f64,
    /// The body reaches from `-rear_m` to `front_m` along x.
    pub front_m: f64,
    /// See `front_m`.
    pub rear_m: f64,
    /// Width.
    pub width_m: f64,
    /// Height of the highest part.
    pub height_m: f64,
    /// Ground clearance between the wheels: lower objects do not touch the body.
    pub clearance_m: f64,
    /// Lean angle from which on the vehicle tips over, rad.
    pub tip_over_rad: f64,
    /// Time constant with which tyres and frame follow a change of height, s.
    pub settle_s: f64,
}

/// Wheels; lengths in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelSpec {
    /// Radius of the driven wheels.
    pub radius_m: f64,
    /// Distance between the driven wheels.
    pub track_m: f64,
    /// Position of the other axle relative to the driven one, along x: negative where it is behind.
    pub other_axle_x_m: f64,
    /// Distance between the wheels of the other axle.
    pub other_track_m: f64,
    /// Share of the weight on the driven wheels.
    pub driven_load: f64,
    /// Maximum speed of the vehicle.
    pub max_speed_mps: f64,
    /// Maximum speed of a wheel, such as the outer one in a turn.
    pub max_wheel_speed_mps: f64,
    /// Inertia of a driven wheel with its gears, as an equivalent mass at its rim, kg.
    pub rim_mass_kg: f64,
    /// Rolling resistance of the wheels, in addition to that of the ground: force per weight.
    pub rolling_resistance: f64,
    /// Slip at which traction reaches its limit; below it, slip is proportional to force.
    pub slip_at_limit: f64,
    /// Moment with which casters and tyres resist a turn, N·m.
    pub scrub_nm: f64,
    /// A higher step stops a wheel.
    pub climb_m: f64,
    /// Sideways slip (sideways speed per forward speed) at which the side force reaches the limit of traction.
    pub side_slip_at_limit: f64,
}

/// Motors, one per driven wheel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorSpec {
    /// Maximum current of a motor, A.
    pub max_current_a: f64,
    /// Force at the rim per ampere, N/A.
    pub newton_per_amp: f64,
    /// Current of a motor without load, A.
    pub idle_current_a: f64,
    /// Time constant of the speed controller, s.
    pub response_s: f64,
    /// Maximum force of a wheel's brake, N.
    pub brake_n: f64,
    /// Noise of the current measurement, A.
    pub noise_a: f64,
}

/// Steering (Wellington 2005, A.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteeringSpec {
    /// Maximum curvature, 1/m.
    pub max_curvature_per_m: f64,
    /// Dead time before the steering reacts, s.
    pub delay_s: f64,
    /// Time constant of the first-order response after that, s.
    pub time_constant_s: f64,
    /// Noise of the measured curvature, 1/m.
    pub noise_per_m: f64,
}

/// Bumper; lengths in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BumperSpec {
    /// Width.
    pub width_m: f64,
    /// Height of the lowest part.
    pub bottom_m: f64,
    /// Height of the highest part.
    pub top_m: f64,
    /// Distance by which it protrudes from the body, which is also its travel.
    pub travel_m: f64,
    /// Stiffness of the spring, N/m.
    pub stiffness_npm: f64,
    /// Compression at which it switches.
    pub switch_m: f64,
    /// Whether a pressed switch prevents the motors from driving forward.
    pub stops_drive: bool,
}

/// Rates at which the simple sensors are sent, 1/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Range sensors.
    pub infrared_hz: f64,
    /// Switches of the bumper.
    pub bumper_hz: f64,
    /// Motor currents and steering.
    pub motors_hz: f64,
    /// Ground truth.
    pub ground_truth_hz: f64,
}

impl VehicleSpec {
    /// Parses a vehicle file.
    pub fn from_toml(text: &str) -> Result<VehicleSpec, FileError> {
        reader::read_file(text, parse::vehicle)
    }

    /// The camera with a name.
    pub fn camera(&self, name: &str) -> Option<&CameraSpec> {
        self.cameras.iter().find(|camera| camera.name == name)
    }

    /// The ladar with a name; the first one where the name is empty.
    pub fn ladar(&self, name: &str) -> Option<&LadarSpec> {
        self.ladars.iter().find(|ladar| name.is_empty() || ladar.name == name)
    }
}
