//! Contacts of a vehicle: its rectangle against the solid outlines of things, and against vegetation that does not give
//! way.

use std::ops::RangeInclusive;

use rcs_geom::{DVec2, DVec3};

use crate::thing::{Outline, Thing};
use crate::world::World;

/// An oriented rectangle on the ground: the outline of a vehicle seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Its centre, m.
    pub centre: DVec2,
    /// Angle of its length, counter-clockwise from east, rad.
    pub yaw_rad: f64,
    /// m.
    pub half_length_m: f64,
    /// m.
    pub half_width_m: f64,
}

/// A contact: a rectangle overlaps a thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Index of the thing, or [`THICKET`].
    pub thing: u32,
    /// The deepest point, at the middle of the common range of heights, m.
    pub point: DVec3,
    /// Direction that separates the two: horizontal unit vector from the thing toward the rectangle.
    pub normal: DVec2,
    /// Penetration depth along that direction, m.
    pub depth_m: f64,
}

/// Number of vegetation that does not give way, in contacts.
pub const THICKET: u32 = u32::MAX - 1;
/// Distance between the points of an outline at which vegetation is looked for, m: the size of a sample of the ground.
const OUTLINE_STEP_M: f64 = 0.1;
/// Radius around such a point within which the way out is looked for, m.
const WAY_OUT_M: f64 = 0.2;
/// Steps of that search, m, and directions.
const WAY_OUT_STEP_M: f64 = 0.01;
const WAYS: usize = 16;

/// An oriented rectangle with its axes.
struct Rectangle {
    middle: DVec2,
    axis: DVec2,
    half: DVec2,
}

impl Rectangle {
    fn new(middle: DVec2, yaw_rad: f64, half: DVec2) -> Rectangle {
        Rectangle { middle, axis: DVec2::new(libm::cos(yaw_rad), libm::sin(yaw_rad)), half }
    }

    fn to_own(&self, offset: DVec2) -> DVec2 {
        DVec2::new(self.axis.dot(offset), self.axis.perp_dot(offset))
    }

    fn to_world(&self, own: DVec2) -> DVec2 {
        self.axis * own.x + self.axis.perp() * own.y
    }

    /// Points of its outline in its own axes, at most [`OUTLINE_STEP_M`] apart.
    fn outline(&self) -> impl Iterator<Item = DVec2> + use<> {
        let half = self.half;
        let side = move |length: f64, place: fn(f64, f64, DVec2) -> DVec2| {
            let parts = (2.0 * length / OUTLINE_STEP_M).ceil().max(1.0) as u32;
            (0..=parts).flat_map(move |part| {
                let along = length * (2.0 * f64::from(part) / f64::from(parts) - 1.0);
                [-1.0, 1.0].map(|sign| place(along, sign, half))
            })
        };
        side(half.x, |along, sign, half| DVec2::new(along, sign * half.y))
            .chain(side(half.y, |along, sign, half| DVec2::new(sign * half.x, along)))
    }

    /// Half extent along a unit direction, m.
    fn reach(&self, direction: DVec2) -> f64 {
        self.to_own(direction).abs().dot(self.half)
    }

    /// Its farthest point along a direction; the middle of an edge that is perpendicular to the direction.
    fn farthest(&self, direction: DVec2) -> DVec2 {
        let own = self.to_own(direction);
        let corner = |v: f64, half: f64| if v.abs() < 1e-6 { 0.0 } else { half * v.signum() };
        self.middle + self.to_world(DVec2::new(corner(own.x, self.half.x), corner(own.y, self.half.y)))
    }

    /// Normal toward this rectangle, depth and point.
    fn meets_circle(&self, centre: DVec2, radius: f64) -> Option<(DVec2, f64, DVec2)> {
        let own = self.to_own(centre - self.middle);
        let nearest = own.clamp(-self.half, self.half);
        let apart = own - nearest;
        let distance = apart.length();
        if distance >= radius {
            return None;
        }
        if distance > 0.0 {
            let normal = self.to_world(-apart / distance);
            return Some((normal, radius - distance, self.middle + self.to_world(nearest)));
        }
        // The centre of the circle is inside: separate through the nearest side.
        let room = self.half - own.abs();
        let outward =
            if room.x < room.y { DVec2::new(own.x.signum(), 0.0) } else { DVec2::new(0.0, own.y.signum()) };
        Some((self.to_world(-outward), radius + room.min_element(), centre))
    }

    /// The same for another rectangle, by the axis of least overlap.
    fn meets_rectangle(&self, other: &Rectangle) -> Option<(DVec2, f64, DVec2)> {
        let between = self.middle - other.middle;
        let mut least: Option<(DVec2, f64)> = None;
        for axis in [self.axis, self.axis.perp(), other.axis, other.axis.perp()] {
            let apart = axis.dot(between);
            let overlap = self.reach(axis) + other.reach(axis) - apart.abs();
            if overlap <= 0.0 {
                return None;
            }
            if least.is_none_or(|(_, depth)| overlap < depth - 1e-12) {
                least = Some((if apart < 0.0 { -axis } else { axis }, overlap));
            }
        }
        let (normal, depth) = least?;
        // The deepest corner is one of this rectangle if it lies inside of the other, else one of the other.
        let mine = self.farthest(-normal);
        let inside = other.to_own(mine - other.middle).abs().cmple(other.half + 1e-9).all();
        let theirs = other.farthest(normal);
        let place = if inside { mine } else { theirs };
        Some((normal, depth, place))
    }
}

impl World {
    /// The solid things that overlap a vehicle's outline, in the order of their indices, then the deepest place in
    /// vegetation that does not give way. `heights_m` are the heights of
    /// the vehicle's lowest and highest part: things that are completely above or below are left out. Crowns and the
    /// outer foliage of bushes are not solid.
    pub fn touching(&self, footprint: &Footprint, heights_m: RangeInclusive<f64>) -> Vec<Touch> {
        let finite = footprint.centre.is_finite() && footprint.yaw_rad.is_finite();
        if !finite {
            return Vec::new();
        }
        let half = DVec2::new(footprint.half_length_m, footprint.half_width_m);
        let body = Rectangle::new(footprint.centre, footprint.yaw_rad, half);
        let extent = DVec2::new(body.reach(DVec2::X), body.reach(DVec2::Y));
        let low = self.bounds_m()[0];
        let near = self.inner.grid.things_near(body.middle - extent - low, body.middle + extent - low);
        let touch = |number: u32| touch(self.things().get(number as usize)?, &body, &heights_m);
        let mut touches: Vec<Touch> = near.into_iter().filter_map(touch).collect();
        if self.inner.has_thickets {
            touches.extend(self.thicket(&body, &heights_m));
        }
        touches
    }

    /// Where a rectangle is deepest in vegetation that does not give way; the middle of places that are equally deep.
    fn thicket(&self, body: &Rectangle, heights_m: &RangeInclusive<f64>) -> Option<Touch> {
        let mut touches: Vec<Touch> = Vec::new();
        for own in body.outline() {
            let place = body.middle + body.to_world(own);
            let ground = self.ground(place);
            let top = ground.height_m + ground.vegetation_height_m;
            if ground.passable || top < *heights_m.start() || ground.height_m > *heights_m.end() {
                continue;
            }
            let Some((normal, depth_m)) = self.way_out(place) else { continue };
            let z = 0.5 * (ground.height_m.max(*heights_m.start()) + top.min(*heights_m.end()));
            touches.push(Touch { thing: THICKET, point: place.extend(z), normal, depth_m });
        }
        let deepest = *touches.iter().max_by(|a, b| a.depth_m.total_cmp(&b.depth_m))?;
        let equal = touches.iter().filter(|touch| {
            touch.depth_m > deepest.depth_m - WAY_OUT_STEP_M && touch.normal.dot(deepest.normal) > 0.9
        });
        let (sum, count) =
            equal.fold((DVec3::ZERO, 0.0), |(sum, count), touch| (sum + touch.point, count + 1.0));
        Some(Touch { point: sum / count, ..deepest })
    }

    /// Direction and length of the way out of vegetation: away from the middle of what surrounds the place.
    fn way_out(&self, place: DVec2) -> Option<(DVec2, f64)> {
        let mut normal = DVec2::ZERO;
        for way in 0..WAYS {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * way as f64 / WAYS as f64);
            let way = DVec2::new(cos, sin);
            if self.ground(place + way * WAY_OUT_M).passable {
                normal += way;
            }
        }
        let normal = normal.try_normalize()?;
        let steps = (2.0 * WAY_OUT_M / WAY_OUT_STEP_M) as usize;
        let mut depths_m = (1..=steps).map(|step| step as f64 * WAY_OUT_STEP_M);
        let depth_m = depths_m.find(|&depth_m| self.ground(place + normal * depth_m).passable)?;
        Some((normal, depth_m))
    }
}

fn touch(thing: &Thing, body: &Rectangle, heights_m: &RangeInclusive<f64>) -> Option<Touch> {
    let [bottom, top] = [thing.position.z, thing.position.z + thing.solid_height_m];
    if bottom > *heights_m.end() || top < *heights_m.start() {
        return None;
    }
    let middle = thing.position.truncate();
    let (normal, depth_m, place) = match thing.solid {
        Outline::Circle { radius_m } => body.meets_circle(middle, radius_m)?,
        Outline::Rectangle { half_length_m, half_width_m } => body.meets_rectangle(&Rectangle::new(
            middle,
            thing.yaw_rad,
            DVec2::new(half_length_m, half_width_m),
        ))?,
    };
    let z = 0.5 * (bottom.max(*heights_m.start()) + top.min(*heights_m.end()));
    Some(Touch { thing: thing.number, point: place.extend(z), normal, depth_m })
}
