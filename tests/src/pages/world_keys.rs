//! The keys of course, world and look files, as `docs/reference/worlds.md` states them.

use super::asked::{Key, Kind, Section};
use rcs_geom::{DVec2, Utm};
use rcs_planner::zones::Zones;
use rcs_scene::{Course, Look, World};

/// Courses are read by the simulation, and `area` and `keep_out` by the planning.
pub(super) const COURSE: Kind = Kind {
    read: |text| {
        let origin = Utm::new(18, true, 309_000.0, 4_335_000.0).map_err(|error| error.to_string())?;
        let zones = Zones::from_toml(text, "", &origin, 1.0)?;
        let course = Course::from_toml(text).map_err(|error| error.to_string())?;
        Ok(format!("{course:?} {zones:?}"))
    },
    sample: r#"
        format = 1
        name = "meadow"
        world = "meadow"
        time_limit_s = 240
        start = { easting = 309030, northing = 4335020, heading_deg = 90 }
        goal = { easting = 309030, northing = 4335120 }
    "#,
};

/// Of a world, the ground along a line through everything in the sample and the things are compared; `worlds.rs` finds the
/// defaults of numbers that change neither in the source.
pub(super) const WORLD: Kind = Kind {
    read: |text| {
        let world = World::from_toml(text).map_err(|error| error.to_string())?;
        let ground: Vec<_> = (0..30).map(|m| world.ground(DVec2::splat(f64::from(m)))).collect();
        Ok(format!("{:?} {:?} {ground:?} {:?}", world.origin(), world.bounds_m(), world.things()))
    },
    sample: r#"
        name = "meadow"
        bounds_m = [[0, 0], [40, 30]]
        origin = { zone = 18, easting_m = 308000, northing_m = 4333000 }
        sun = {}
        surface = { mud = {} }
        undulation = [{ wavelength_m = 10, amplitude_m = 0.1 }]
        hill = [{ centre = [9, 9], radius_m = 5, height_m = 1 }]
        slope = [{ from = [1, 1], to = [9, 9], rise_m = 1 }]
        ditch = [{ path = [[1, 1], [9, 9]], width_m = 1, depth_m = 0.3 }]
        ledge = [{ path = [[1, 1], [9, 9]], height_m = 0.3 }]
        paint = [{ surface = "mud", path = [[1, 1], [9, 9]], width_m = 1 }]
        thing = [{ kind = "tree", at = [5, 5] }]
        line = [{ kind = "fence", path = [[1, 1], [9, 9]] }]
        scatter = [{ kind = "tree", count = 3, path = [[1, 1], [9, 9]], width_m = 2 }]
        clear = [{ path = [[1, 1], [9, 9]], width_m = 2 }]
    "#,
};

pub(super) const LOOK: Kind = Kind {
    read: |text| {
        let look = Look::from_toml(text).map_err(|error| error.to_string())?;
        Ok(format!("{look:?}"))
    },
    sample: r#"
        format = 1
        name = "dry_summer"
        sun = {}
        light = {}
        sky = {}
        surface = { mud = {} }
        coat = { bush = {} }
    "#,
};

pub(super) const COURSE_SECTIONS: [Section; 3] = [
    Section {
        heading: "",
        at: "",
        keys: &[&[
            ("format", "", "Version of the format."),
            ("name", "", "Name in reports."),
            ("description", "\"\"", "One sentence."),
            ("world", "", "The world: name or path of its file."),
            ("vehicle", "that of the stack, if it names one", "The vehicle: name or path of its file."),
            (
                "look",
                "that of the world",
                "Colours and light of the world: name or path of the file of a look.",
            ),
            ("start", "", "Where the vehicle begins."),
            ("goal", "", "Where it drives to."),
            ("goal_radius_m", "1.5", "Distance from the goal at which it counts as reached."),
            ("time_limit_s", "", "Simulated time after which the run fails."),
            (
                "area",
                "the bounds of the world, less `area_margin_m` of the planning",
                "Corners of the polygon that the vehicle does not leave, UTM, m: 3 to 1000.",
            ),
            (
                "keep_out",
                "[]",
                "Zones that the vehicle does not enter: a list of polygons, each with corners as in `area`.",
            ),
        ]],
        besides: &[],
    },
    Section {
        heading: "[start]",
        at: "start",
        keys: &[POSITION, &[("heading_deg", "", "Heading, degrees counter-clockwise from east.")]],
        besides: &[],
    },
    Section { heading: "[goal]", at: "goal", keys: &[POSITION], besides: &[] },
];

const POSITION: &[Key] = &[
    ("zone", "that of the world", "UTM zone, which must be that of the world."),
    ("easting", "", "UTM easting, m."),
    ("northing", "", "UTM northing, m."),
];

const COLOURS: &[Key] = &[
    ("colour", "that of the surface", "First of the two colours of its specks: red, green, blue."),
    ("second_colour", "that of the surface", "Second of them."),
];

const REGION: &[Key] = &[
    ("polygon", "one of the three", "Corners of a polygon."),
    ("path", "one of the three", "Points of the middle line of a strip."),
    ("width_m", "required with `path`", "Width of the strip."),
    ("circle", "one of the three", "`[x, y, radius]`, m; the radius is above 0."),
];

/// Sizes that some kinds of things have; the page has them by kind.
pub(super) const SIZES: [&str; 5] = ["radius_m", "height_m", "crown_radius_m", "length_m", "width_m"];

pub(super) const WORLD_SECTIONS: [Section; 14] = [
    Section {
        heading: "",
        at: "",
        keys: &[&[
            ("name", "", "Name of the world."),
            ("seed", "0", "Seed of noise, of scattered things, and of textures without a look."),
            (
                "bounds_m",
                "",
                "Two corners, the lower left one first; sides of 10 to 200 m. Around it is a plain.",
            ),
            ("base", "\"short_grass\"", "Surface where nothing is painted."),
            ("origin", "", "UTM coordinates of the place (0, 0)."),
            ("sun", "", "Direction of the sun."),
            ("surface", "", "Properties of surfaces, by name."),
            ("undulation", "", "Smooth noise of the ground."),
            ("hill", "", "Hills and hollows."),
            ("slope", "", "Ground that rises from one place to another."),
            ("ditch", "", "Ditches."),
            ("ledge", "", "Steps of the ground."),
            ("paint", "", "Surfaces of regions; the last one that holds a place counts."),
            ("thing", "", "Single things."),
            ("line", "", "Fences and hedges."),
            ("scatter", "", "Things at places that follow from the seed."),
            ("clear", "", "Regions in which nothing is scattered."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[origin]",
        at: "origin",
        keys: &[&[
            ("zone", "", "UTM zone."),
            ("north", "true", "Whether it is on the northern hemisphere."),
            ("easting_m", "", "UTM easting."),
            ("northing_m", "", "UTM northing; the latitude is to be -80 to 84 degrees."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[sun]",
        at: "sun",
        keys: &[&[
            ("azimuth_deg", "120", "Direction to the sun, degrees counter-clockwise from east."),
            ("elevation_deg", "50", "Its angle above the horizon, degrees."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[surface.NAME]",
        at: "surface.mud",
        keys: &[
            &[
                ("traction", "that of the surface", "Greatest horizontal force as a fraction of the load."),
                ("rolling_resistance", "that of the surface", "Resistance as a fraction of the load."),
                (
                    "slip_at_limit",
                    "that of the surface",
                    "Slip at which a wheel reaches the limit of traction; a larger one of the vehicle counts.",
                ),
                ("height_m", "that of the surface", "Height of the vegetation."),
                (
                    "density_per_m",
                    "that of the surface",
                    "Probability per metre that a horizontal ray hits a stem; above 0 only with a height.",
                ),
                (
                    "drag",
                    "that of the surface",
                    "Force needed to push through, as a fraction of the vehicle's weight.",
                ),
                (
                    "passable",
                    "that of the surface",
                    "Whether a vehicle can drive into the vegetation, or stops at its edge.",
                ),
            ],
            COLOURS,
        ],
        besides: &[],
    },
    Section {
        heading: "[[undulation]]",
        at: "undulation",
        keys: &[&[
            ("wavelength_m", "", "Distance from one rise to the next."),
            ("amplitude_m", "", "Height of the rises."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[[hill]]",
        at: "hill",
        keys: &[&[
            ("centre", "", "Its middle, m."),
            ("radius_m", "", "Radius along its own x axis."),
            ("second_radius_m", "`radius_m`", "Radius across that axis."),
            ("yaw_deg", "0", "Direction of that axis, degrees counter-clockwise from east."),
            ("height_m", "", "Height in the middle; negative for a hollow."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[[slope]]",
        at: "slope",
        keys: &[&[
            ("from", "", "Where it begins, m; the ground is level before it."),
            ("to", "", "Where it ends, at least 1 m from there; the ground is level beyond it."),
            ("rise_m", "", "Height of the end above the beginning."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[[ditch]]",
        at: "ditch",
        keys: &[&[
            ("path", "", "Its middle line."),
            ("width_m", "", "Width at the top."),
            ("depth_m", "", "Depth."),
            ("bank_m", "0.1", "Width of each bank, within the width of the ditch."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[[ledge]]",
        at: "ledge",
        keys: &[&[
            ("path", "", "Its edge; the ground is higher on its left side."),
            ("height_m", "", "Height of the step."),
            ("run_m", "0.2", "Distance over which the ground rises."),
            ("fade_m", "10", "Distance over which it returns to its height."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[[paint]]",
        at: "paint",
        keys: &[
            &[
                ("surface", "", "The surface."),
                ("edge_m", "0.15", "Irregularity of the border of its region."),
            ],
            REGION,
        ],
        besides: &[],
    },
    Section {
        heading: "[[thing]]",
        at: "thing",
        keys: &[&[
            ("kind", "", "Kind of thing; fences and hedges are lines only."),
            ("at", "", "Its place, m, within the bounds of the world."),
            ("yaw_deg", "0", "Direction of its x axis, degrees counter-clockwise from east."),
        ]],
        besides: &SIZES,
    },
    Section {
        heading: "[[line]]",
        at: "line",
        keys: &[&[
            ("kind", "", "Kind of line."),
            ("path", "", "The places along which it stands, within the bounds of the world."),
        ]],
        besides: &SIZES,
    },
    Section {
        heading: "[[scatter]]",
        at: "scatter",
        keys: &[
            &[
                ("kind", "", "Kind of thing; fences and hedges are lines only."),
                ("count", "", "Number of things."),
                ("spacing_m", "1", "Least distance from the outlines of other things."),
            ],
            REGION,
        ],
        besides: &SIZES,
    },
    Section { heading: "[[clear]]", at: "clear", keys: &[REGION], besides: &[] },
];

pub(super) const LOOK_SECTIONS: [Section; 6] = [
    Section {
        heading: "",
        at: "",
        keys: &[&[
            ("format", "", "Version of the format."),
            ("name", "", "Name of the look."),
            ("description", "\"\"", "One sentence."),
            (
                "texture_seed",
                "the seed of the world",
                "Seed of the textures: other specks of the same colours.",
            ),
            ("sun", "", "Direction of the sun."),
            ("light", "", "Colour of the light, and shade."),
            ("sky", "", "Colours of the sky."),
            ("surface", "", "Colours of surfaces, by name."),
            ("coat", "", "Colours of the materials of things, by name."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[sun]",
        at: "sun",
        keys: &[&[
            (
                "azimuth_deg",
                "that of the world",
                "Direction to the sun, degrees counter-clockwise from east.",
            ),
            ("elevation_deg", "that of the world", "Its angle above the horizon, degrees."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[light]",
        at: "light",
        keys: &[&[
            (
                "colour",
                "no change",
                "Factors of red, green and blue for all colours but those of sky and horizon.",
            ),
            ("shade", "that of the world", "Light in the shade as a fraction of that in the sun."),
        ]],
        besides: &[],
    },
    Section {
        heading: "[sky]",
        at: "sky",
        keys: &[&[
            ("zenith", "that of the world", "Red, green and blue straight above."),
            ("horizon", "that of the world", "The same at the horizon."),
            ("trees", "that of the world", "The same of the wood on the horizon."),
        ]],
        besides: &[],
    },
    Section { heading: "[surface.NAME]", at: "surface.mud", keys: &[LOOK_COLOURS], besides: &[] },
    Section { heading: "[coat.NAME]", at: "coat.bush", keys: &[LOOK_COLOURS], besides: &[] },
];

const LOOK_COLOURS: &[Key] = &[
    ("colour", "that of the world", "First of the two colours of its specks: red, green, blue."),
    ("second_colour", "that of the world", "Second of them."),
];
