//! The world as the dynamics see it, and the caches of everything derived from parameter files.

use crate::contact;
use crate::proto::SimVehicleParams;
use crate::referee::Goal;
use crate::spec::VehicleSpec;
use crate::terrain::{Patch, Terrain, Touch, UprightBox};
use glam::{DVec2, DVec3};
use rcs_geom::{GeodesyError, Geodetic, Utm};
use rcs_scene::{Course, Footprint, Look, Surface, THICKET, ThingKind, UtmPosition, World, WrongZone};
use std::sync::Arc;

/// A simulated world, with the queries of the dynamics.
#[derive(Clone, Debug)]
pub struct Scenery {
    /// The world.
    pub world: Arc<World>,
    /// Positions of trees.
    trees: Vec<DVec2>,
}

impl Scenery {
    /// Reads a world file.
    pub fn from_toml(text: &str) -> Result<Scenery, String> {
        let world = read_world(text, "")?;
        let is_tree = |thing: &&rcs_scene::Thing| thing.kind == ThingKind::Tree;
        let trees = world.things().iter().filter(is_tree).map(|tree| tree.position.truncate()).collect();
        Ok(Scenery { world, trees })
    }

    /// The geodetic position of a point of the frame `global`, whose axes are those of the UTM grid.
    pub fn geodetic(&self, p_global: DVec3) -> Result<Geodetic, GeodesyError> {
        let Utm { zone, north, easting_m, northing_m } = self.world.origin();
        let place = Utm::new(zone, north, easting_m + p_global.x, northing_m + p_global.y)?.to_geodetic();
        Ok(Geodetic { altitude_m: p_global.z, ..place })
    }
}

impl Terrain for Scenery {
    fn patch(&self, at: DVec2) -> Patch {
        let ground = self.world.ground(at);
        Patch {
            height_m: ground.height_m,
            traction: ground.traction,
            rolling_resistance: ground.rolling_resistance,
            slip_at_limit: ground.slip_at_limit,
            plant_drag: ground.vegetation_drag,
        }
    }

    fn height_m(&self, at: DVec2) -> f64 {
        self.world.height_m(at)
    }

    fn touching(&self, body: &UprightBox) -> Vec<Touch> {
        let footprint = Footprint {
            centre: body.centre,
            yaw_rad: body.yaw_rad,
            half_length_m: body.half.x,
            half_width_m: body.half.y,
        };
        let touches = self.world.touching(&footprint, body.z_m[0]..=body.z_m[1]);
        touches
            .into_iter()
            .map(|touch| Touch {
                thing: touch.thing,
                point: touch.point,
                normal: touch.normal,
                depth_m: touch.depth_m,
            })
            .collect()
    }

    fn range_m(&self, origin: DVec3, direction: DVec3, max_m: f64) -> Option<f64> {
        Some(self.world.cast(origin, direction, max_m)?.range_m)
    }

    fn trees_near(&self, at: DVec2, radius_m: f64) -> usize {
        self.trees.iter().filter(|tree| tree.distance_squared(at) < radius_m * radius_m).count()
    }

    fn contains(&self, at: DVec2) -> bool {
        let [low, high] = self.world.bounds_m();
        at.cmpge(low).all() && at.cmple(high).all()
    }

    fn kind(&self, thing: u32) -> &str {
        match self.world.things().get(thing as usize) {
            Some(thing) => thing.kind.name(),
            None if thing == THICKET => Surface::Thicket.name(),
            None => "ground",
        }
    }
}

/// Texts of the files from which something was built, to detect that they have changed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Texts(Vec<String>);

impl Texts {
    pub(crate) fn of(texts: &[&str]) -> Texts {
        Texts(texts.iter().map(|text| (*text).to_owned()).collect())
    }

    pub(crate) fn are(&self, texts: &[&str]) -> bool {
        self.0.iter().map(String::as_str).eq(texts.iter().copied())
    }

    /// Fingerprint of texts that are too long to be kept: FNV-1a over each text and its length.
    pub(crate) fn fingerprint(texts: &[&str]) -> u64 {
        let mix = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        texts.iter().fold(0xcbf2_9ce4_8422_2325, |hash, text| {
            let length = (text.len() as u64).to_le_bytes();
            length.into_iter().chain(text.bytes()).fold(hash, mix)
        })
    }
}

/// Reads a vehicle file.
pub(crate) fn read_vehicle(text: &str) -> Result<VehicleSpec, String> {
    if text.is_empty() {
        return Err("vehicle: got no text, expected that of a vehicle file".to_owned());
    }
    VehicleSpec::from_toml(text).map_err(|error| format!("vehicle: {error}"))
}

/// Parses a file of a course; none if it is empty.
fn read_course(text: &str) -> Result<Option<Course>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    Course::from_toml(text).map(Some).map_err(|error| format!("course: {error} (in the file of a course)"))
}

/// Parses a world file and computes the world, with the colours of a look unless that is empty. The processes of a
/// simulation have one world in common.
pub(crate) fn read_world(text: &str, look: &str) -> Result<Arc<World>, String> {
    rcs_runtime::shared(&["world", text, look], || {
        check_world(text)?;
        let look = read_look(look)?;
        World::with_look(text, look.as_ref()).map_err(|error| format!("world: {error}"))
    })
}

/// Parses a file of a look; none if it is empty.
pub(crate) fn read_look(text: &str) -> Result<Option<Look>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    Look::from_toml(text).map(Some).map_err(|error| format!("look: {error}"))
}

/// Parses a world file without computing the world: its origin and its corners.
pub(crate) fn check_world(text: &str) -> Result<(Utm, [DVec2; 2]), String> {
    if text.is_empty() {
        return Err("world: got no text, expected that of a world file".to_owned());
    }
    World::check(text).map_err(|error| format!("world: {error}"))
}

/// Start and goal of a run.
#[derive(Clone, Debug)]
pub(crate) struct Route {
    /// Name of the course; empty without one.
    pub(crate) course: String,
    pub(crate) start: DVec2,
    pub(crate) start_yaw_rad: f64,
    pub(crate) goal: Option<Goal>,
}

impl Route {
    /// The route of a course, or without one of the parameters, in a world with this origin and these corners.
    fn new(
        params: &SimVehicleParams,
        course: Option<Course>,
        origin: &Utm,
        [low, high]: [DVec2; 2],
    ) -> Result<Route, String> {
        let mut route = Route {
            course: String::new(),
            start: DVec2::new(params.start_east_m, params.start_north_m),
            start_yaw_rad: params.start_heading_deg.to_radians(),
            goal: None,
        };
        let has_course = course.is_some();
        // Where an error in the start or the goal belongs.
        let of = |what: &str| {
            if has_course {
                format!("course: line {}, ", Course::line_of(&params.course, what))
            } else {
                String::new()
            }
        };
        if let Some(course) = course {
            let place = |what: &str, place: &UtmPosition| {
                place.in_world(origin).map_err(|WrongZone { got, expected }| {
                    format!("{}{what} is in zone {got}, expected the world's zone {expected}", of(what))
                })
            };
            route.start = place("start", &course.start)?;
            route.start_yaw_rad = course.start_heading_rad;
            route.goal = Some(Goal {
                at: place("goal", &course.goal)?,
                radius_m: course.goal_radius_m,
                time_limit_s: course.time_limit_s,
            });
            route.course = course.name;
        }
        for (what, at) in [("start", Some(route.start)), ("goal", route.goal.map(|goal| goal.at))] {
            if let Some(at) = at.filter(|at| !(at.cmpge(low).all() && at.cmple(high).all())) {
                return Err(format!(
                    "{}{what} is at {at} m, expected a place in the world, from {low} to {high}",
                    of(what)
                ));
            }
        }
        Ok(route)
    }
}

/// Everything that `sim_vehicle` derives from its parameters.
#[derive(Clone, Debug)]
pub(crate) struct Stage {
    texts: Texts,
    pub(crate) spec: VehicleSpec,
    pub(crate) scenery: Scenery,
    pub(crate) route: Route,
}

impl Stage {
    /// Returns what is wrong with the texts, without computing a world.
    pub(crate) fn check(params: &SimVehicleParams) -> Result<(), String> {
        // The course comes first: where it is wrong, it may not name the other files.
        let course = read_course(&params.course)?;
        read_vehicle(&params.vehicle)?;
        let (origin, bounds) = check_world(&params.world)?;
        Route::new(params, course, &origin, bounds).map(|_| ())
    }

    /// Parses the texts and computes the world.
    pub(crate) fn new(params: &SimVehicleParams) -> Result<Stage, String> {
        let course = read_course(&params.course)?;
        let spec = read_vehicle(&params.vehicle)?;
        let scenery = Scenery::from_toml(&params.world)?;
        let route = Route::new(params, course, &scenery.world.origin(), scenery.world.bounds_m())?;
        let texts = Texts::of(&[&params.world, &params.vehicle, &params.course]);
        Ok(Stage { texts, spec, scenery, route })
    }

    /// Kind of an object that the vehicle overlaps at the start.
    pub(crate) fn object_at_start(&self) -> Option<&str> {
        let Route { start, start_yaw_rad, .. } = self.route;
        let thing = contact::object_at(&self.spec, &self.scenery, start, start_yaw_rad)?;
        Some(self.scenery.kind(thing))
    }

    /// Whether it was built from these texts.
    pub(crate) fn is_of(&self, params: &SimVehicleParams) -> bool {
        self.texts.are(&[&params.world, &params.vehicle, &params.course])
    }

    /// Fingerprint of these texts.
    pub(crate) fn fingerprint(params: &SimVehicleParams) -> u64 {
        Texts::fingerprint(&[&params.world, &params.vehicle, &params.course])
    }
}
