//! The interface of the dynamics to a world, so that they can be tested on a plane.

use glam::{DVec2, DVec3};

/// The ground at a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Height above the world's origin, m.
    pub height_m: f64,
    /// Traction coefficient: maximum force along the ground per normal force.
    pub traction: f64,
    /// Rolling resistance: force per weight.
    pub rolling_resistance: f64,
    /// Slip at which the force of a wheel reaches the limit of traction, at least.
    pub slip_at_limit: f64,
    /// Resistance of plants: force per weight of the vehicle.
    pub plant_drag: f64,
}

/// Overlap of an object with a box.
#[derive(Clone, Debug, PartialEq)]
pub struct Touch {
    /// Number of the object.
    pub thing: u32,
    /// Position of the contact, frame `global`, m.
    pub point: DVec3,
    /// Horizontal unit normal, pointing out of the object.
    pub normal: DVec2,
    /// Depth of the overlap, m.
    pub depth_m: f64,
}

/// An upright box: a horizontal rectangle and a range of heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UprightBox {
    /// Centre, m.
    pub centre: DVec2,
    /// Half of the extents along `yaw_rad` and perpendicular to it, m.
    pub half: DVec2,
    /// Direction of its first side, rad counter-clockwise from east.
    pub yaw_rad: f64,
    /// Lowest and highest height, m.
    pub z_m: [f64; 2],
}

/// A world as seen by the dynamics and the simple sensors. Frame `global`, metres.
pub trait Terrain {
    /// The ground at a position.
    fn patch(&self, at: DVec2) -> Patch;
    /// The height of the ground only.
    fn height_m(&self, at: DVec2) -> f64 {
        self.patch(at).height_m
    }
    /// Overlaps of objects with a box.
    fn touching(&self, body: &UprightBox) -> Vec<Touch>;
    /// Distance to the first object or ground that a ray hits, m.
    fn range_m(&self, origin: DVec3, direction: DVec3, max_m: f64) -> Option<f64>;
    /// Number of trees within a radius.
    fn trees_near(&self, at: DVec2, radius_m: f64) -> usize;
    /// Whether a position lies within the world.
    fn contains(&self, at: DVec2) -> bool;
    /// Kind of an object: tree, boulder, person, ….
    fn kind(&self, thing: u32) -> &str;
}
