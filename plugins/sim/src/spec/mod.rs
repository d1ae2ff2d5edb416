//! The vehicle file: what the simulated vehicle is made of.
//!
//! A file is refused with line, key, what was found and what was expected; unknown keys are refused. Lengths are
//! metres, places are in the vehicle frame: origin on the ground in the middle between the driven wheels, x forward, y
//! left, z up.

mod parse;
mod reader;
mod sensors;

pub use reader::FileError;
pub use sensors::{
    CameraKind, CameraSpec, DopplerSpec, EncoderSpec, GpsSpec, InertialSpec, InfraredSpec, LadarSpec, Mount,
};

/// Everything that a vehicle file says.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleSpec {
    /// Its name.
    pub name: String,
    /// Mass and shape.
    pub body: BodySpec,
    /// What carries it.
    pub wheels: WheelSpec,
    /// What drives it.
    pub motors: MotorSpec,
    /// Present where the vehicle steers like a car; absent where it turns by its wheels' speeds.
    pub steering: Option<SteeringSpec>,
    /// The switches in front.
    pub bumper: BumperSpec,
    /// Wheel encoders.
    pub encoders: EncoderSpec,
    /// Gyros, accelerometers, compass.
    pub inertial: InertialSpec,
    /// Position receiver.
    pub gps: GpsSpec,
    /// Speed over ground by radar.
    pub doppler: Option<DopplerSpec>,
    /// How often the rest is sent, 1/s.
    pub rates: Rates,
    /// Range sensors.
    pub infrared: Vec<InfraredSpec>,
    /// Cameras and stereo pairs.
    pub cameras: Vec<CameraSpec>,
    /// Scanning ladars.
    pub ladars: Vec<LadarSpec>,
}

/// Mass and shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodySpec {
    /// With everything, kg.
    pub mass_kg: f64,
    /// About the vertical axis, kg·m².
    pub yaw_inertia_kgm2: f64,
    /// Height of the centre of mass.
    pub centre_height_m: f64,
    /// The body reaches from `-rear_m` to `front_m` along x.
    pub front_m: f64,
    /// See `front_m`.
    pub rear_m: f64,
    /// Across.
    pub width_m: f64,
    /// Highest part.
    pub height_m: f64,
    /// Lowest part of the body between the wheels: what is lower does not touch it.
    pub clearance_m: f64,
    /// It turns over when it leans more than this, rad.
    pub tip_over_rad: f64,
    /// Time in which tyres and frame settle on a new height, s.
    pub settle_s: f64,
}

/// What carries it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelSpec {
    /// Of the driven wheels.
    pub radius_m: f64,
    /// Between the driven wheels.
    pub track_m: f64,
    /// From the driven axle to the other one, along x: negative where the other one is behind.
    pub other_axle_x_m: f64,
    /// Between the wheels of the other axle.
    pub other_track_m: f64,
    /// Part of the weight on the driven wheels.
    pub driven_load: f64,
    /// Highest speed of the vehicle.
    pub max_speed_mps: f64,
    /// Highest speed of a wheel: the outer one in a turn.
    pub max_wheel_speed_mps: f64,
    /// Inertia of a driven wheel with its gears, as a mass at its rim, kg.
    pub rim_mass_kg: f64,
    /// Rolling resistance of the wheels themselves, beside the ground's: force by weight.
    pub rolling_resistance: f64,
    /// Slip with which the traction reaches its limit; below, slip is in proportion to the force.
    pub slip_at_limit: f64,
    /// Moment by which casters and tyres resist a turn, N·m.
    pub scrub_nm: f64,
    /// A step that is higher stops a wheel.
    pub climb_m: f64,
    /// Sideways slip (speed by speed ahead) when the side force reaches the limit of traction.
    pub side_slip_at_limit: f64,
}

/// What drives it: one motor for each driven wheel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorSpec {
    /// Highest current of a motor, A.
    pub max_current_a: f64,
    /// Force at the rim for each ampere, N/A.
    pub newton_per_amp: f64,
    /// Current of a motor that turns without load, A.
    pub idle_current_a: f64,
    /// Time in which the speed controller closes in on its command, s.
    pub response_s: f64,
    /// Force of the brake of a wheel, N.
    pub brake_n: f64,
    /// Noise of a current's measurement, A.
    pub noise_a: f64,
}

/// How the vehicle steers (Wellington 2005, A.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteeringSpec {
    /// Sharpest turn, 1/m.
    pub max_curvature_per_m: f64,
    /// Time before any motion occurs, s.
    pub delay_s: f64,
    /// Then it follows as a first-order system with this time constant, s.
    pub time_constant_s: f64,
    /// Noise of the measurement, 1/m.
    pub noise_per_m: f64,
}

/// The switches in front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BumperSpec {
    /// Across.
    pub width_m: f64,
    /// Lowest part.
    pub bottom_m: f64,
    /// Highest part.
    pub top_m: f64,
    /// How far it stands out of the body and gives way.
    pub travel_m: f64,
    /// Spring, N/m.
    pub stiffness_npm: f64,
    /// Pressed so far it switches.
    pub switch_m: f64,
    /// Whether a pressed switch keeps the motors from driving forward.
    pub stops_drive: bool,
}

/// How often the vehicle's simple sensors are sent, 1/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Range sensors.
    pub infrared_hz: f64,
    /// Switches of the bumper.
    pub bumper_hz: f64,
    /// Motor currents and steering.
    pub motors_hz: f64,
    /// True state.
    pub ground_truth_hz: f64,
}

impl VehicleSpec {
    /// Reads a vehicle file.
    pub fn from_toml(text: &str) -> Result<VehicleSpec, FileError> {
        reader::read_file(text, parse::vehicle)
    }

    /// The camera of a name.
    pub fn camera(&self, name: &str) -> Option<&CameraSpec> {
        self.cameras.iter().find(|camera| camera.name == name)
    }

    /// The ladar of a name; the first where the name is empty.
    pub fn ladar(&self, name: &str) -> Option<&LadarSpec> {
        self.ladars.iter().find(|ladar| name.is_empty() || ladar.name == name)
    }
}
