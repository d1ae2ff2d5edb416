//! Contacts of the vehicle with objects: the bumper in front is a spring with switches, the rest of the body is rigid.

use crate::drive::{Motion, STEP_S};
use crate::spec::VehicleSpec;
use crate::terrain::{Terrain, Touch, UprightBox};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// A contact above this speed is a collision, m/s.
pub const COLLISION_MPS: f64 = 0.3;
/// A contact that reappears within this time is the same contact, s.
const SAME_CONTACT_S: f64 = 0.5;
/// Object number of the ground in contacts, for a step that a wheel cannot climb.
pub const GROUND: u32 = u32::MAX;
/// Half of the width of the middle part of the bumper, which presses both switches, m.
const MIDDLE_M: f64 = 0.08;

/// One point at which the vehicle touches an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// Number of the object, or [`GROUND`].
    pub thing: u32,
    /// Position, frame `global`, m.
    pub point: DVec3,
    /// Speed towards the object when the contact began, m/s.
    pub speed_mps: f64,
    /// Whether the bumper touches it.
    pub on_bumper: bool,
    /// Whether it is a collision: above [`COLLISION_MPS`], not on the bumper, or with a person.
    pub collision: bool,
    /// Steps since the contact began.
    pub steps: u32,
    /// Whether it became a collision in this step.
    pub collided: bool,
    /// Time since the last touch, s.
    lost_s: f64,
}

impl Contact {
    /// Whether the vehicle touches the object in this step.
    pub fn is_present(&self) -> bool {
        self.lost_s == 0.0
    }
}

/// All contacts of the vehicle, and the state of its bumper.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Contacts {
    list: Vec<Contact>,
    pressed: [bool; 2],
    /// Force of the bumper's spring, N.
    spring_n: f64,
    /// Speed at which a wheel met a ground step in this step, m/s.
    met_step_mps: Option<f64>,
}

impl Contacts {
    /// Contacts that exist now or ended a moment ago.
    pub fn list(&self) -> &[Contact] {
        &self.list
    }

    /// State of the left and the right switch.
    pub fn pressed(&self) -> [bool; 2] {
        self.pressed
    }

    /// Force of the bumper's spring against forward motion, N.
    pub fn spring_n(&self) -> f64 {
        self.spring_n
    }

    /// Records that a wheel is blocked by a ground step.
    pub(crate) fn meet_step(&mut self, speed_mps: f64) {
        self.met_step_mps = Some(speed_mps.abs());
    }

    /// Finds contacts at the new position, moves the vehicle out of the objects, and removes the blocked motion.
    pub(crate) fn update(
        &mut self,
        spec: &VehicleSpec,
        terrain: &impl Terrain,
        at: &mut DVec2,
        yaw_rad: f64,
        ground_m: f64,
        motion: &mut Motion,
    ) {
        self.pressed = [false; 2];
        self.spring_n = 0.0;
        for contact in &mut self.list {
            contact.steps = contact.steps.saturating_add(1);
            contact.collided = false;
            contact.lost_s += STEP_S;
        }
        self.list.retain(|contact| contact.lost_s < SAME_CONTACT_S);
        if let Some(speed) = self.met_step_mps.take() {
            self.note(terrain, GROUND, at.extend(ground_m), speed, false);
        }
        let (sin, cos) = libm::sincos(yaw_rad);
        let ahead = DVec2::new(cos, sin);
        let [whole, bumper, body] = boxes(spec, *at, ahead, yaw_rad, ground_m);
        if terrain.touching(&whole).is_empty() {
            return;
        }
        let on_bumper: Vec<Touch> =
            terrain.touching(&bumper).into_iter().filter(|touch| touch.normal.dot(ahead) < -0.5).collect();
        for touch in &on_bumper {
            let speed = approach(touch, *at, ahead, motion);
            self.note(terrain, touch.thing, touch.point, speed, true);
            self.press(spec, touch, *at, ahead);
        }
        for touch in terrain.touching(&body) {
            let speed = approach(&touch, *at, ahead, motion);
            let behind_bumper = on_bumper.iter().any(|other| other.thing == touch.thing);
            self.note(terrain, touch.thing, touch.point, speed, behind_bumper);
            stop(spec, &touch, *at, ahead, motion);
            *at += touch.normal * touch.depth_m;
        }
    }

    fn press(&mut self, spec: &VehicleSpec, touch: &Touch, at: DVec2, ahead: DVec2) {
        let depth = touch.depth_m.min(spec.bumper.travel_m);
        self.spring_n = self.spring_n.max(spec.bumper.stiffness_npm * depth);
        if depth >= spec.bumper.switch_m {
            let left_of_middle = ahead.perp_dot(touch.point.truncate() - at);
            self.pressed[0] |= left_of_middle > -MIDDLE_M;
            self.pressed[1] |= left_of_middle < MIDDLE_M;
        }
    }

    fn note(&mut self, terrain: &impl Terrain, thing: u32, point: DVec3, speed_mps: f64, on_bumper: bool) {
        let index = self.list.iter().position(|contact| contact.thing == thing).unwrap_or_else(|| {
            self.list.push(Contact {
                thing,
                point,
                speed_mps,
                on_bumper,
                collision: false,
                steps: 0,
                collided: false,
                lost_s: 0.0,
            });
            self.list.len() - 1
        });
        let contact = &mut self.list[index];
        let is_collision = contact.speed_mps > COLLISION_MPS || !on_bumper || terrain.kind(thing) == "person";
        contact.collided |= is_collision && !contact.collision;
        contact.collision |= is_collision;
        contact.on_bumper = on_bumper;
        contact.point = point;
        contact.lost_s = 0.0;
    }
}

/// An object that the body of a vehicle overlaps at this position.
pub(crate) fn object_at(spec: &VehicleSpec, terrain: &impl Terrain, at: DVec2, yaw_rad: f64) -> Option<u32> {
    let (sin, cos) = libm::sincos(yaw_rad);
    let [.., body] = boxes(spec, at, DVec2::new(cos, sin), yaw_rad, terrain.height_m(at));
    terrain.touching(&body).first().map(|touch| touch.thing)
}

/// Bounding boxes of the whole vehicle, of the bumper, and of the body behind it.
fn boxes(spec: &VehicleSpec, at: DVec2, ahead: DVec2, yaw_rad: f64, ground_m: f64) -> [UprightBox; 3] {
    let (body, bumper) = (&spec.body, &spec.bumper);
    let part = |from_m: f64, to_m: f64, width_m: f64, low_m: f64, high_m: f64| UprightBox {
        centre: at + ahead * (0.5 * (from_m + to_m)),
        half: DVec2::new(0.5 * (to_m - from_m), 0.5 * width_m),
        yaw_rad,
        z_m: [ground_m + low_m, ground_m + high_m],
    };
    let front = body.front_m + bumper.travel_m;
    [
        part(
            -body.rear_m,
            front,
            body.width_m.max(bumper.width_m),
            body.clearance_m.min(bumper.bottom_m),
            body.height_m.max(bumper.top_m),
        ),
        // As deep as the vehicle, so that it is always pushed back out of a thin object such as a fence.
        part(-body.rear_m, front, bumper.width_m, bumper.bottom_m, bumper.top_m),
        part(-body.rear_m, body.front_m, body.width_m, body.clearance_m, body.height_m),
    ]
}

/// Speed of the touched point of the vehicle towards the object, m/s.
fn approach(touch: &Touch, at: DVec2, ahead: DVec2, motion: &Motion) -> f64 {
    let arm = touch.point.truncate() - at;
    let velocity = ahead * motion.speed_mps + arm.perp() * motion.yaw_rate_radps;
    (-velocity.dot(touch.normal)).max(0.0)
}

/// Removes the speed towards the object from the motion, by an impulse along the normal; the wheels do not give way
/// sideways.
fn stop(spec: &VehicleSpec, touch: &Touch, at: DVec2, ahead: DVec2, motion: &mut Motion) {
    let speed = approach(touch, at, ahead, motion);
    let along = touch.normal.dot(ahead);
    let moment = (touch.point.truncate() - at).perp_dot(touch.normal);
    let give = along * along / spec.body.mass_kg + moment * moment / spec.body.yaw_inertia_kgm2;
    if speed > 0.0 && give > 0.0 {
        let impulse = speed / give;
        motion.speed_mps += impulse * along / spec.body.mass_kg;
        motion.yaw_rate_radps += impulse * moment / spec.body.yaw_inertia_kgm2;
    }
}
