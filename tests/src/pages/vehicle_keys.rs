//! The keys of vehicle files, as `docs/reference/worlds.md` states them.

use super::asked::{Key, Kind, Section};
use rcs_sim::spec::VehicleSpec;

pub(super) const VEHICLE: Kind = Kind {
    read: |text| {
        let vehicle = VehicleSpec::from_toml(text).map_err(|error| error.to_string())?;
        Ok(format!("{vehicle:?}"))
    },
    sample: r#"
        format = 1
        name = "robot"
        clouds = { cover = 0.5, period_s = 60, least_sunlight = 0.3 }
        [body]
        mass_kg = 90
        yaw_inertia_kgm2 = 9
        centre_height_m = 0.3
        front_m = 0.5
        rear_m = 0.5
        width_m = 0.6
        height_m = 0.8
        clearance_m = 0.1
        tip_over_deg = 40
        settle_s = 0.1
        [wheels]
        radius_m = 0.2
        track_m = 0.6
        other_axle_x_m = -0.6
        other_track_m = 0.5
        driven_load = 0.6
        max_speed_mps = 0.01
        max_wheel_speed_mps = 1.5
        rim_mass_kg = 5
        rolling_resistance = 0.01
        slip_at_limit = 0.1
        scrub_nm = 0
        climb_m = 0.1
        side_slip_at_limit = 0.1
        [motors]
        max_current_a = 20
        newton_per_amp = 20
        idle_current_a = 1
        response_s = 0.1
        brake_n = 300
        noise_a = 0.1
        [steering]
        max_curvature_per_m = 0.2
        delay_s = 0.2
        time_constant_s = 0.3
        noise_per_m = 0.001
        [bumper]
        width_m = 0.6
        bottom_m = 0
        top_m = 0.4
        travel_m = 0.5
        stiffness_npm = 5000
        switch_m = 0.01
        [encoders]
        rate_hz = 20
        tick_m = 0.001
        scale_error = 0.01
        [inertial]
        rate_hz = 100
        gyro_noise_degps = 0.1
        gyro_bias_degps = 0.1
        gyro_walk_degps = 0.01
        accel_noise_mps2 = 0.1
        accel_bias_mps2 = 0.1
        accel_limit_mps2 = 50
        heading_noise_deg = 1
        heading_bias_deg = 1
        [gps]
        rate_hz = 5
        x_m = 0
        y_m = 0
        z_m = 0.8
        noise_m = 0.1
        drift_m = 1
        drift_s = 60
        vertical_factor = 1.5
        stated_m = 1
        outliers = 0.01
        outlier_m = 5
        dropouts_per_hour = 1
        tree_radius_m = 3
        tree_factor = 2
        [doppler]
        rate_hz = 20
        noise_mps = 0.05
        [rates]
        infrared_hz = 10
        bumper_hz = 20
        motors_hz = 20
        ground_truth_hz = 20
        [[infrared]]
        name = "left"
        x_m = 0.5
        y_m = 0.2
        z_m = 0.3
        cone_deg = 5
        min_range_m = 0
        max_range_m = 1
        noise_m = 0.01
        [[camera]]
        name = "front"
        kind = "stereo"
        x_m = 0.4
        y_m = 0
        z_m = 0.8
        baseline_m = 0.12
        width_px = 320
        height_px = 240
        horizontal_view_deg = 70
        rate_hz = 10
        exposure_noise = 0.01
        dark_noise = 1
        shot_noise = 2
        exposure_control = { target = 110, response_s = 0.3, max_gain = 4 }
        [[ladar]]
        name = "scanner"
        x_m = 0.4
        y_m = 0
        z_m = 0.9
        fan_deg = 180
        rays = 181
        sweep_low_deg = -90
        sweep_high_deg = 0
        lines = 11
        rate_hz = 5
        max_range_m = 30
        noise_m = 0.02
    "#,
};

const PLACE: &[Key] = &[
    ("x_m", "", "Place in the vehicle frame, forward."),
    ("y_m", "", "The same to the left."),
    ("z_m", "", "The same upward."),
];

const ANGLES: &[Key] =
    &[("pitch_deg", "0", "Angle downward, degrees."), ("yaw_deg", "0", "Angle to the left, degrees.")];

const RATE: &[Key] = &[("rate_hz", "", "Rate.")];

pub(super) const VEHICLE_SECTIONS: [Section; 16] = [
    Section {
        heading: "",
        at: "",
        keys: &[&[
            ("format", "", "Version of the format."),
            ("name", "", "Name of the vehicle."),
            ("description", "", "One sentence."),
            ("body", "", "Mass and dimensions of the body."),
            ("wheels", "", "Wheels."),
            ("motors", "", "Motors, one for each driven wheel."),
            ("steering", "none: a differential drive", "Steering."),
            ("bumper", "", "Bumper in front."),
            ("encoders", "", "Encoders of the driven wheels."),
            ("inertial", "", "Gyros, accelerometers and compass."),
            ("gps", "", "Position receiver."),
            ("doppler", "none", "Speed over ground by radar."),
            ("rates", "", "Rates of the other outputs."),
            ("infrared", "[]", "Range sensors, each with a name of its own."),
            ("camera", "[]", "Cameras and stereo pairs, each with a name of its own."),
            ("ladar", "[]", "Scanning ladars, each with a name of its own."),
            ("clouds", "none", "Passing clouds, which change the light of all cameras."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[body]",
        at: "body",
        keys: &[&[
            ("mass_kg", "", "Total mass."),
            ("yaw_inertia_kgm2", "", "Moment of inertia about the vertical axis, kg m²."),
            ("centre_height_m", "", "Height of the centre of mass."),
            ("front_m", "", "Distance by which the body reaches ahead of the origin."),
            ("rear_m", "", "Distance by which it reaches behind the origin."),
            ("width_m", "", "Width."),
            ("height_m", "", "Height of the highest part."),
            ("clearance_m", "", "Clearance between the wheels: lower objects do not touch the body."),
            ("tip_over_deg", "", "Lean, to any side, from which on the vehicle tips over, degrees."),
            ("settle_s", "", "Time constant with which tyres and frame follow a change of height."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[wheels]",
        at: "wheels",
        keys: &[&[
            ("radius_m", "", "Radius of the driven wheels."),
            ("track_m", "", "Distance between the driven wheels."),
            (
                "other_axle_x_m",
                "",
                "Position of the other axle, at least 0.05 m from the driven one; negative behind it.",
            ),
            ("other_track_m", "", "Distance between the wheels of the other axle."),
            ("driven_load", "", "Share of the weight on the driven wheels."),
            ("max_speed_mps", "", "Greatest speed of the vehicle."),
            (
                "max_wheel_speed_mps",
                "",
                "Greatest speed of a wheel, as of the outer one in a turn; at least `max_speed_mps`.",
            ),
            ("rim_mass_kg", "", "Inertia of a driven wheel with its gears, as a mass at its rim."),
            (
                "rolling_resistance",
                "",
                "Resistance of the wheels besides that of the ground: force per weight.",
            ),
            ("slip_at_limit", "", "Slip at which traction reaches its limit."),
            ("scrub_nm", "", "Moment with which casters and tyres resist a turn, N m."),
            ("climb_m", "", "Height of a step above which it stops a wheel."),
            (
                "side_slip_at_limit",
                "",
                "Sideways speed per forward speed at which the side force reaches the limit of traction.",
            ),
        ]],
        besides: &[],
    },
    Section {
        heading: "[motors]",
        at: "motors",
        keys: &[&[
            ("max_current_a", "", "Greatest current of a motor."),
            ("newton_per_amp", "", "Force at the rim for each ampere, N/A."),
            ("idle_current_a", "", "Current of a motor without load."),
            ("response_s", "", "Time constant of the speed controller."),
            ("brake_n", "", "Greatest force of the brake of a wheel."),
            ("noise_a", "", "Standard deviation of the measured current."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[steering]",
        at: "steering",
        keys: &[&[
            ("max_curvature_per_m", "", "Greatest curvature, 1/m."),
            ("delay_s", "", "Dead time before the steering reacts."),
            ("time_constant_s", "", "Time constant of its response after that."),
            ("noise_per_m", "", "Standard deviation of the measured curvature, 1/m."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[bumper]",
        at: "bumper",
        keys: &[&[
            ("width_m", "", "Width."),
            ("bottom_m", "", "Height of the lowest part."),
            ("top_m", "", "Height of the highest part, at least `bottom_m`."),
            ("travel_m", "", "Distance by which it protrudes from the body, which is also its travel."),
            ("stiffness_npm", "", "Stiffness of its spring, N/m."),
            ("switch_m", "", "Compression at which it switches, at most `travel_m`."),
            ("stops_drive", "false", "Whether a pressed switch keeps the motors from driving forward."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[encoders]",
        at: "encoders",
        keys: &[
            RATE,
            &[
                ("tick_m", "", "Distance for each tick."),
                (
                    "scale_error",
                    "",
                    "Greatest relative error of the assumed wheel radius, drawn once per run.",
                ),
            ],
        ],
        besides: &[],
    },
    Section {
        heading: "[inertial]",
        at: "inertial",
        keys: &[
            RATE,
            &[
                ("gyro_noise_degps", "", "Standard deviation of a reading of the gyros, degrees/s."),
                ("gyro_bias_degps", "", "Standard deviation of their bias at the start, degrees/s."),
                ("gyro_walk_degps", "", "Random walk of the bias, degrees/s per square root of a second."),
                ("accel_noise_mps2", "", "Standard deviation of a reading of the accelerometers, m/s²."),
                ("accel_bias_mps2", "", "Standard deviation of their bias, m/s²."),
                ("accel_limit_mps2", "", "Greatest acceleration that they measure, m/s²."),
                ("heading_noise_deg", "", "Standard deviation of a reading of the compass, degrees."),
                ("heading_bias_deg", "", "Standard deviation of its constant error, degrees."),
            ],
        ],
        besides: &[],
    },
    Section {
        heading: "[gps]",
        at: "gps",
        keys: &[
            RATE,
            PLACE,
            &[
                ("noise_m", "", "Standard deviation of white noise."),
                ("drift_m", "", "Standard deviation of the slow error."),
                ("drift_s", "", "Time constant of the slow error."),
                ("vertical_factor", "", "Factor on all errors for the height."),
                ("stated_m", "", "Standard deviation that the receiver states."),
                ("outliers", "", "Share of fixes that are outliers."),
                ("outlier_m", "", "Error of an outlier."),
                ("dropouts_per_hour", "", "Number of dropouts per hour."),
                ("dropout_s", "[0, 0]", "Shortest and longest dropout, 0 to 3600 s."),
                ("tree_radius_m", "", "Radius within which trees have an effect."),
                ("tree_factor", "", "Factor of each of up to four such trees on outliers and noise."),
            ],
        ],
        besides: &[],
    },
    Section {
        heading: "[doppler]",
        at: "doppler",
        keys: &[RATE, &[("noise_mps", "", "Standard deviation of the speed.")]],
        besides: &[],
    },
    Section {
        heading: "[rates]",
        at: "rates",
        keys: &[&[
            ("infrared_hz", "", "Rate of the range sensors."),
            ("bumper_hz", "", "Rate of the switches of the bumper."),
            ("motors_hz", "", "Rate of motor currents and steering."),
            ("ground_truth_hz", "", "Rate of the ground truth."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[[infrared]]",
        at: "infrared",
        keys: &[
            &[("name", "", "Name of its frame.")],
            PLACE,
            ANGLES,
            &[
                ("cone_deg", "", "Full opening angle, degrees."),
                ("min_range_m", "", "Least range."),
                ("max_range_m", "", "Greatest range, at least `min_range_m`."),
                ("noise_m", "", "Standard deviation of the range."),
            ],
        ],
        besides: &[],
    },
    Section {
        heading: "[[camera]]",
        at: "camera",
        keys: &[
            &[("name", "", "Name."), ("kind", "", "`stereo` is a pair; `infrared` is a thermal camera.")],
            PLACE,
            ANGLES,
            RATE,
            &[
                ("baseline_m", "", "Distance between the cameras of a pair; not for other kinds."),
                ("width_px", "", "Width of the image."),
                ("height_px", "", "Height of the image."),
                ("horizontal_view_deg", "", "Horizontal angle of view, degrees."),
                (
                    "distortion",
                    "[0, 0, 0, 0, 0]",
                    "Coefficients k1, k2, p1, p2, k3 of the lens, which must have a ray for each corner.",
                ),
                ("exposure_noise", "", "Relative standard deviation of the brightness of a frame."),
                (
                    "camera_difference",
                    "0",
                    "Relative difference in brightness between the cameras of a pair.",
                ),
                ("dark_noise", "", "Standard deviation of a dark pixel, grey levels of 255."),
                ("shot_noise", "", "Standard deviation of a white pixel, grey levels of 255."),
                ("vignette", "0", "Share of light lost at the corners of the image."),
                (
                    "calibration_error_deg",
                    "0",
                    "Angle by which each camera is turned from what its calibration says, degrees.",
                ),
                (
                    "vertical_offset_px",
                    "0",
                    "Distance by which the right image is lower than its calibration says; of pairs only.",
                ),
                ("stamp_jitter_ms", "0", "Greatest error of the time stamps of images."),
                ("exposure_control", "none: constant exposure", "Exposure control."),
            ],
        ],
        besides: &[],
    },
    Section {
        heading: "[camera.exposure_control]",
        at: "camera.exposure_control",
        keys: &[&[
            ("target", "", "Mean grey level of the left image that it keeps, of 255."),
            ("response_s", "", "Time constant."),
            ("max_gain", "", "Greatest factor between its exposure and the normal one, up and down."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[[ladar]]",
        at: "ladar",
        keys: &[
            &[("name", "", "Name of its frame.")],
            PLACE,
            ANGLES,
            &[
                ("fan_deg", "", "Full horizontal angle, degrees."),
                ("rays", "", "Rays of a line."),
                ("sweep_low_deg", "", "Elevation of the lowest line, degrees."),
                ("sweep_high_deg", "", "Elevation of the highest line, degrees; at least `sweep_low_deg`."),
                ("lines", "", "Lines of a sweep."),
                ("rate_hz", "", "Sweeps per second."),
                ("max_range_m", "", "Greatest range."),
                ("noise_m", "", "Standard deviation of the range."),
            ],
        ],
        besides: &[],
    },
    Section {
        heading: "[clouds]",
        at: "clouds",
        keys: &[&[
            ("cover", "", "Share of time under clouds."),
            ("period_s", "", "Mean time from cloud to cloud."),
            ("least_sunlight", "", "Share of the light of the sun that passes a cloud."),
            ("seed", "0", "Seed of the times."),
        ]],
        besides: &[],
    },
];
