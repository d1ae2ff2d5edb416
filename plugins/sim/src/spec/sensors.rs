//! Sensors in a vehicle file, and how they are parsed.

use super::reader::{FileError, Section};
use glam::DVec3;
use rcs_geom::{CameraError, Distortion, PinholeCamera, Pose};

/// Mount of a sensor on the vehicle: metres, and radians with positive pitch looking down and positive yaw to the left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Position in the vehicle frame.
    pub position: DVec3,
    /// Downward angle.
    pub pitch_rad: f64,
    /// Angle to the left.
    pub yaw_rad: f64,
}

/// Wheel encoders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderSpec {
    /// Rate, 1/s.
    pub rate_hz: f64,
    /// Distance per tick, m.
    pub tick_m: f64,
    /// Maximum relative error of the assumed wheel radius, drawn once per run.
    pub scale_error: f64,
}

/// Gyros, accelerometers and compass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialSpec {
    /// Rate, 1/s.
    pub rate_hz: f64,
    /// Standard deviation of white noise per reading, rad/s.
    pub gyro_noise_radps: f64,
    /// Standard deviation of the initial bias, rad/s.
    pub gyro_bias_radps: f64,
    /// Random walk of the bias, rad/s per square root of a second.
    pub gyro_walk_radps: f64,
    /// Standard deviation of white noise per reading, m/s².
    pub accel_noise_mps2: f64,
    /// Standard deviation of the initial bias, m/s².
    pub accel_bias_mps2: f64,
    /// Saturation, m/s².
    pub accel_limit_mps2: f64,
    /// Standard deviation of the compass's white noise, rad.
    pub heading_noise_rad: f64,
    /// Standard deviation of the compass's constant error, rad.
    pub heading_bias_rad: f64,
}

/// Position receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpsSpec {
    /// Rate, 1/s.
    pub rate_hz: f64,
    /// Position of the antenna.
    pub antenna: DVec3,
    /// Standard deviation of white noise, m.
    pub noise_m: f64,
    /// Standard deviation of the slow error, m.
    pub drift_m: f64,
    /// Time constant of the slow error, s.
    pub drift_s: f64,
    /// Factor on all errors for the height.
    pub vertical_factor: f64,
    /// Standard deviation stated by the receiver, m.
    pub stated_m: f64,
    /// Share of fixes that are outliers.
    pub outliers: f64,
    /// Error of an outlier, m.
    pub outlier_m: f64,
    /// Dropouts per hour.
    pub dropouts_per_hour: f64,
    /// Minimum and maximum duration of a dropout, s.
    pub dropout_s: [f64; 2],
    /// Radius within which trees have an effect, m.
    pub tree_radius_m: f64,
    /// Factor of each such tree on outliers and noise, for up to four trees.
    pub tree_factor: f64,
}

/// Doppler radar for speed over ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DopplerSpec {
    /// Rate, 1/s.
    pub rate_hz: f64,
    /// Noise, m/s.
    pub noise_mps: f64,
}

/// An infrared range sensor, which measures along x of its frame.
#[derive(Clone, Debug, PartialEq)]
pub struct InfraredSpec {
    /// Name of its frame.
    pub name: String,
    /// Mount.
    pub mount: Mount,
    /// Full opening angle, rad.
    pub cone_rad: f64,
    /// Minimum and maximum range, m.
    pub range_m: [f64; 2],
    /// Noise, m.
    pub noise_m: f64,
}

/// Kind of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraKind {
    /// Two colour cameras side by side.
    Stereo,
    /// One colour camera.
    Color,
    /// One thermal camera.
    Infrared,
}

/// A camera or a stereo pair. The mount of a pair is midway between its cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraSpec {
    /// Name.
    pub name: String,
    /// Kind.
    pub kind: CameraKind,
    /// Mount.
    pub mount: Mount,
    /// Lens and size of the raw image.
    pub lens: PinholeCamera,
    /// Baseline of a pair; 0 for a single camera.
    pub baseline_m: f64,
    /// Rate, 1/s.
    pub rate_hz: f64,
    /// Relative standard deviation of the brightness per frame.
    pub exposure_noise: f64,
    /// Relative difference in brightness between the cameras of a pair.
    pub camera_difference: f64,
    /// Noise of a dark pixel in grey levels (0 to 255).
    pub dark_noise: f64,
    /// Noise of a white pixel in grey levels (0 to 255); in between it grows with the square root of the brightness.
    pub shot_noise: f64,
    /// Share of light lost at the image corners.
    pub vignette: f64,
    /// Angle by which each camera is turned from what its calibration says, about an axis drawn once per run, rad.
    pub calibration_error_rad: f64,
    /// Distance by which the right image of a pair is lower than its calibration says, pixels of the raw image.
    pub vertical_offset_px: f64,
    /// Maximum error of the time stamps of images, s.
    pub stamp_jitter_s: f64,
    /// Exposure control; without it the exposure is constant.
    pub exposure_control: Option<ExposureControl>,
}

/// Exposure control of a camera or pair: it brings the mean grey level of the left image to a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureControl {
    /// Mean grey level that it keeps, 0 to 255.
    pub target: f64,
    /// Time constant, s.
    pub response_s: f64,
    /// Maximum factor between its exposure and the normal one, in both directions.
    pub max_gain: f64,
}

/// Passing clouds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudsSpec {
    /// Share of time under clouds.
    pub cover: f64,
    /// Mean time from cloud to cloud, s.
    pub period_s: f64,
    /// Share of the sun's light that passes a cloud.
    pub least_sunlight: f64,
    /// Seed of the times.
    pub seed: u32,
}

/// A scanning ladar: horizontal lines of rays that sweep vertically.
#[derive(Clone, Debug, PartialEq)]
pub struct LadarSpec {
    /// Name of its frame.
    pub name: String,
    /// Mount.
    pub mount: Mount,
    /// Full horizontal angle, rad.
    pub fan_rad: f64,
    /// Rays per line.
    pub rays: u32,
    /// Elevation of the lowest and the highest line above the mount's x axis, rad.
    pub sweep_rad: [f64; 2],
    /// Lines per sweep.
    pub lines: u32,
    /// Sweeps per second, 1/s.
    pub rate_hz: f64,
    /// Maximum range, m.
    pub max_range_m: f64,
    /// Noise, m.
    pub noise_m: f64,
}

impl Mount {
    /// Pose of the sensor in the vehicle frame: x along the viewing direction, y left, z up.
    pub fn vehicle_from_sensor(&self) -> Pose {
        Pose::from_rpy(self.position, 0.0, self.pitch_rad, self.yaw_rad)
    }
}

impl CameraSpec {
    /// Pose of a camera's optical frame in the vehicle frame; side 0 is the left or the only camera, 1 the right one.
    pub fn vehicle_from_camera(&self, side: usize) -> Pose {
        let across = if side == 0 { 0.5 * self.baseline_m } else { -0.5 * self.baseline_m };
        self.mount.vehicle_from_sensor()
            * Pose::from_translation(DVec3::new(0.0, across, 0.0))
            * Pose::body_from_optical()
    }

    /// Name of a camera's frame.
    pub fn frame(&self, side: usize) -> String {
        match (self.kind, side) {
            (CameraKind::Stereo, 0) => format!("{}_left_camera", self.name),
            (CameraKind::Stereo, _) => format!("{}_right_camera", self.name),
            _ => format!("{}_camera", self.name),
        }
    }

    /// Number of cameras.
    pub fn cameras(&self) -> usize {
        if self.kind == CameraKind::Stereo { 2 } else { 1 }
    }
}

impl LadarSpec {
    /// Directions of a line's rays in the sensor's frame, from right to left.
    pub fn directions(&self, line: u32) -> impl Iterator<Item = DVec3> + use<> {
        let [low, high] = self.sweep_rad;
        let part = if self.lines > 1 { f64::from(line) / f64::from(self.lines - 1) } else { 0.5 };
        let elevation = low + part * (high - low);
        let (rays, fan) = (self.rays, self.fan_rad);
        (0..rays).map(move |ray| {
            let azimuth = fan * (f64::from(ray) / f64::from((rays - 1).max(1)) - 0.5);
            let (sin_e, cos_e) = libm::sincos(elevation);
            let (sin_a, cos_a) = libm::sincos(azimuth);
            DVec3::new(cos_e * cos_a, cos_e * sin_a, sin_e)
        })
    }
}

fn mount(t: &Section<'_>) -> Result<Mount, FileError> {
    Ok(Mount {
        position: position(t)?,
        pitch_rad: t.number_or("pitch_deg", -90.0..=90.0, 0.0)?.to_radians(),
        yaw_rad: t.number_or("yaw_deg", -180.0..=180.0, 0.0)?.to_radians(),
    })
}

fn position(t: &Section<'_>) -> Result<DVec3, FileError> {
    Ok(DVec3::new(
        t.number("x_m", -20.0..=20.0)?,
        t.number("y_m", -20.0..=20.0)?,
        t.number("z_m", -1.0..=20.0)?,
    ))
}

fn rate(t: &Section<'_>) -> Result<f64, FileError> {
    t.number("rate_hz", 0.1..=100.0)
}

pub(super) fn encoders(t: &Section<'_>) -> Result<EncoderSpec, FileError> {
    Ok(EncoderSpec {
        rate_hz: rate(t)?,
        tick_m: t.number("tick_m", 1e-6..=0.1)?,
        scale_error: t.number("scale_error", 0.0..=0.1)?,
    })
}

pub(super) fn inertial(t: &Section<'_>) -> Result<InertialSpec, FileError> {
    Ok(InertialSpec {
        rate_hz: rate(t)?,
        gyro_noise_radps: t.number("gyro_noise_degps", 0.0..=100.0)?.to_radians(),
        gyro_bias_radps: t.number("gyro_bias_degps", 0.0..=100.0)?.to_radians(),
        gyro_walk_radps: t.number("gyro_walk_degps", 0.0..=10.0)?.to_radians(),
        accel_noise_mps2: t.number("accel_noise_mps2", 0.0..=10.0)?,
        accel_bias_mps2: t.number("accel_bias_mps2", 0.0..=10.0)?,
        accel_limit_mps2: t.number("accel_limit_mps2", 10.0..=1000.0)?,
        heading_noise_rad: t.number("heading_noise_deg", 0.0..=90.0)?.to_radians(),
        heading_bias_rad: t.number("heading_bias_deg", 0.0..=90.0)?.to_radians(),
    })
}

pub(super) fn gps(t: &Section<'_>) -> Result<GpsSpec, FileError> {
    let dropout_s = t.numbers::<2>("dropout_s")?;
    if !(0.0..=3600.0).contains(&dropout_s[0]) || !(dropout_s[0]..=3600.0).contains(&dropout_s[1]) {
        return Err(t.error("dropout_s", "is not the shortest and the longest time in seconds"));
    }
    Ok(GpsSpec {
        rate_hz: rate(t)?,
        antenna: position(t)?,
        noise_m: t.number("noise_m", 0.0..=100.0)?,
        drift_m: t.number("drift_m", 0.0..=100.0)?,
        drift_s: t.number("drift_s", 0.1..=3600.0)?,
        vertical_factor: t.number("vertical_factor", 0.0..=10.0)?,
        stated_m: t.number("stated_m", 0.001..=100.0)?,
        outliers: t.number("outliers", 0.0..=1.0)?,
        outlier_m: t.number("outlier_m", 0.0..=10000.0)?,
        dropouts_per_hour: t.number("dropouts_per_hour", 0.0..=3600.0)?,
        dropout_s,
        tree_radius_m: t.number("tree_radius_m", 0.0..=50.0)?,
        tree_factor: t.number("tree_factor", 1.0..=10.0)?,
    })
}

pub(super) fn doppler(t: &Section<'_>) -> Result<DopplerSpec, FileError> {
    Ok(DopplerSpec { rate_hz: rate(t)?, noise_mps: t.number("noise_mps", 0.0..=10.0)? })
}

pub(super) fn infrared(t: &Section<'_>) -> Result<InfraredSpec, FileError> {
    let near = t.number("min_range_m", 0.0..=10.0)?;
    Ok(InfraredSpec {
        name: t.text("name")?,
        mount: mount(t)?,
        cone_rad: t.number("cone_deg", 0.0..=90.0)?.to_radians(),
        range_m: [near, t.number("max_range_m", near..=20.0)?],
        noise_m: t.number("noise_m", 0.0..=1.0)?,
    })
}

pub(super) fn camera(t: &Section<'_>) -> Result<CameraSpec, FileError> {
    let kinds =
        [("stereo", CameraKind::Stereo), ("color", CameraKind::Color), ("infrared", CameraKind::Infrared)];
    let kind = t.choice("kind", &kinds)?;
    let baseline_m = match kind {
        CameraKind::Stereo => t.number("baseline_m", 0.01..=5.0)?,
        CameraKind::Color | CameraKind::Infrared => 0.0,
    };
    Ok(CameraSpec {
        name: t.text("name")?,
        kind,
        mount: mount(t)?,
        lens: lens(t)?,
        baseline_m,
        rate_hz: rate(t)?,
        exposure_noise: t.number("exposure_noise", 0.0..=1.0)?,
        camera_difference: t.number_or("camera_difference", 0.0..=1.0, 0.0)?,
        dark_noise: t.number("dark_noise", 0.0..=50.0)?,
        shot_noise: t.number("shot_noise", 0.0..=50.0)?,
        vignette: t.number_or("vignette", 0.0..=1.0, 0.0)?,
        calibration_error_rad: t.number_or("calibration_error_deg", 0.0..=5.0, 0.0)?.to_radians(),
        vertical_offset_px: match kind {
            CameraKind::Stereo => t.number_or("vertical_offset_px", -20.0..=20.0, 0.0)?,
            CameraKind::Color | CameraKind::Infrared => 0.0,
        },
        stamp_jitter_s: 1e-3 * t.number_or("stamp_jitter_ms", 0.0..=20.0, 0.0)?,
        exposure_control: t.optional_table("exposure_control", exposure_control)?,
    })
}

fn exposure_control(t: &Section<'_>) -> Result<ExposureControl, FileError> {
    Ok(ExposureControl {
        target: t.number("target", 10.0..=245.0)?,
        response_s: t.number("response_s", 0.0..=60.0)?,
        max_gain: t.number("max_gain", 1.0..=16.0)?,
    })
}

pub(super) fn clouds(t: &Section<'_>) -> Result<CloudsSpec, FileError> {
    Ok(CloudsSpec {
        cover: t.number("cover", 0.0..=1.0)?,
        period_s: t.number("period_s", 1.0..=3600.0)?,
        least_sunlight: t.number("least_sunlight", 0.0..=1.0)?,
        seed: if t.has("seed") { t.count("seed", 0..=u32::MAX)? } else { 0 },
    })
}

fn lens(t: &Section<'_>) -> Result<PinholeCamera, FileError> {
    let size = [t.count("width_px", 16..=4096)?, t.count("height_px", 16..=4096)?];
    let view = t.number("horizontal_view_deg", 5.0..=150.0)?.to_radians();
    let distortion = t.numbers::<5>("distortion")?;
    let refuse = |error: CameraError| t.error("distortion", format_args!("cannot be used: {error}"));
    let straight = PinholeCamera::from_horizontal_fov(size, view).map_err(refuse)?;
    let distortion = Distortion::from_model("plumb_bob", &distortion).map_err(refuse)?;
    let lens = PinholeCamera::new(size, [straight.fx, straight.fy], [straight.cx, straight.cy], distortion)
        .map_err(refuse)?;
    // A lens whose projection folds over inside of the image has no ray for its corners.
    let [w, h] = size.map(f64::from);
    for corner in [[0.0, 0.0], [w - 1.0, 0.0], [0.0, h - 1.0], [w - 1.0, h - 1.0]] {
        if lens.unproject(glam::DVec2::from_array(corner)).is_none() {
            return Err(t.error("distortion", format_args!("has no ray for the pixel {corner:?}")));
        }
    }
    Ok(lens)
}

pub(super) fn ladar(t: &Section<'_>) -> Result<LadarSpec, FileError> {
    let low = t.number("sweep_low_deg", -90.0..=90.0)?;
    Ok(LadarSpec {
        name: t.text("name")?,
        mount: mount(t)?,
        fan_rad: t.number("fan_deg", 1.0..=360.0)?.to_radians(),
        rays: t.count("rays", 1..=4096)?,
        sweep_rad: [low.to_radians(), t.number("sweep_high_deg", low..=90.0)?.to_radians()],
        lines: t.count("lines", 1..=1024)?,
        rate_hz: rate(t)?,
        max_range_m: t.number("max_range_m", 0.5..=500.0)?,
        noise_m: t.number("noise_m", 0.0..=1.0)?,
    })
}
