//! What the dynamics ask of a world, so that they can be tested on a plane.

use glam::{DVec2, DVec3};

/// The ground at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Above the world's origin, m.
    pub height_m: f64,
    /// Highest force along the ground by the force onto it.
    pub traction: f64,
    /// Force against rolling by weight.
    pub rolling_resistance: f64,
    /// Force with which plants hold a vehicle back, by its weight.
    pub plant_drag: f64,
}

/// A thing that reaches into a box.
#[derive(Clone, Debug, PartialEq)]
pub struct Touch {
    /// Its number.
    pub thing: u32,
    /// Where, in the frame `global`, m.
    pub point: DVec3,
    /// Out of the thing, level, of length 1.
    pub normal: DVec2,
    /// How far it reaches in, m.
    pub depth_m: f64,
}

/// A box that stands upright: level rectangle, and from which height to which.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UprightBox {
    /// Its middle, m.
    pub centre: DVec2,
    /// Half its extent along `yaw_rad` and across, m.
    pub half: DVec2,
    /// Direction of its first side, counter-clockwise from east.
    pub yaw_rad: f64,
    /// Lowest and highest height, m.
    pub z_m: [f64; 2],
}

/// A world as the vehicle's dynamics and simple sensors know it. Frame `global`, metres.
pub trait Terrain {
    /// The ground below a place.
    fn patch(&self, at: DVec2) -> Patch;
    /// Its height alone.
    fn height_m(&self, at: DVec2) -> f64 {
        self.patch(at).height_m
    }
    /// What reaches into a box.
    fn touching(&self, body: &UprightBox) -> Vec<Touch>;
    /// Distance to what a ray meets first, m.
    fn range_m(&self, origin: DVec3, direction: DVec3, max_m: f64) -> Option<f64>;
    /// How many trees stand within a distance.
    fn trees_near(&self, at: DVec2, radius_m: f64) -> usize;
    /// Whether a place belongs to the world.
    fn contains(&self, at: DVec2) -> bool;
    /// Kind of a thing: tree, boulder, person, ….
    fn kind(&self, thing: u32) -> &str;
}
