//! The vehicle on the ground: one step of its motion, its attitude and its contacts.
//!
//! Wheels follow the ground as circles (they roll over an edge, and a step that is too high stops them); the heights of
//! the wheels determine height, roll and pitch. Motion along the vehicle: [`crate::drive`]. Motion across it: below the
//! limit of traction the vehicle drifts sideways in proportion to its speed and the side force; above the limit it
//! slides.

use crate::contact::Contacts;
pub use crate::drive::STEP_S;
use crate::drive::{Drive, Load, Motion, slip_of, step_differential, step_steered};
use crate::spec::VehicleSpec;
use crate::terrain::Terrain;
use glam::{DVec2, DVec3};
use rcs_geom::{Pose, wrap_angle};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
/// Length of a step, ns.
pub const STEP_NS: u64 = 10_000_000;
/// Substeps of the drive per step.
const DRIVE_STEPS: usize = 2;
/// Gravity, m/s².
pub const GRAVITY_MPS2: f64 = 9.81;

/// State of the simulated vehicle. Frame `global`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Vehicle {
    /// Position of its origin.
    at: DVec2,
    yaw_rad: f64,
    /// Speeds and wheels.
    pub motion: Motion,
    /// Sideways speed, m/s, positive to the left.
    pub side_mps: f64,
    /// Slip of the driven wheels, left and right.
    pub slip: [f64; 2],
    /// Heights of the left driven wheel, the right driven wheel and the other axle, m.
    heights_m: [f64; 3],
    /// Distances rolled by the driven wheels, m.
    pub rolled_m: [f64; 2],
    /// Distance travelled by the vehicle, m.
    pub distance_m: f64,
    /// `global_from_vehicle`.
    pub pose: Pose,
    /// Velocity of its origin in the frame `global`, m/s.
    velocity: DVec3,
    /// Ideal readings of gyros and accelerometers: rad/s and m/s², vehicle axes.
    pub turn_radps: DVec3,
    /// See `turn_radps`.
    pub force_mps2: DVec3,
    /// Curvature given by the steered wheels, 1/m.
    pub curvature_per_m: f64,
    /// Commanded curvatures within the dead time of the steering, oldest first.
    delayed: VecDeque<f64>,
    /// Contacts with objects.
    pub contacts: Contacts,
    /// Whether the vehicle has tipped over.
    pub turned_over: bool,
}

/// The command during a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DriveCommand {
    /// Command to the wheels.
    pub drive: Drive,
    /// Curvature for vehicles with steering, 1/m, positive to the left.
    pub curvature_per_m: f64,
}

/// Heights and surfaces under the wheels.
struct GroundContact {
    heights_m: [f64; 3],
    traction: [f64; 2],
    slip_at_limit: [f64; 2],
    rolling: f64,
    plant_drag: f64,
    /// Whether a wheel is blocked by a step that it cannot climb.
    blocked: bool,
}

impl Vehicle {
    /// A vehicle that stands at a position.
    pub fn new(spec: &VehicleSpec, terrain: &impl Terrain, at: DVec2, yaw_rad: f64) -> Vehicle {
        let mut vehicle = Vehicle {
            at,
            yaw_rad: wrap_angle(yaw_rad),
            motion: Motion::default(),
            side_mps: 0.0,
            slip: [0.0; 2],
            heights_m: [0.0; 3],
            rolled_m: [0.0; 2],
            distance_m: 0.0,
            pose: Pose::IDENTITY,
            velocity: DVec3::ZERO,
            turn_radps: DVec3::ZERO,
            force_mps2: DVec3::Z * GRAVITY_MPS2,
            curvature_per_m: 0.0,
            delayed: VecDeque::new(),
            contacts: Contacts::default(),
            turned_over: false,
        };
        vehicle.heights_m = vehicle.ground_contact(spec, terrain).heights_m;
        vehicle.pose = vehicle.pose_on(spec);
        vehicle.force_mps2 = vehicle.pose.rotation.conjugate() * (DVec3::Z * GRAVITY_MPS2);
        vehicle
    }

    /// Advances by one step of [`STEP_S`]. `traction_scale` multiplies the traction of every surface.
    pub fn step(
        &mut self,
        spec: &VehicleSpec,
        terrain: &impl Terrain,
        command: DriveCommand,
        traction_scale: f64,
    ) {
        let (before, velocity_before) = (self.pose, self.velocity);
        let ground_contact = self.ground_contact(spec, terrain);
        self.settle(spec, &ground_contact);
        let [roll, pitch, _] = self.pose.rpy();
        self.turned_over |= roll.abs().max(pitch.abs()) > spec.body.tip_over_rad;
        let command =
            if self.turned_over { DriveCommand { drive: Drive::Coast, ..command } } else { command };
        self.steer(spec, command.curvature_per_m);
        let grip = self.slide(spec, &ground_contact, roll, pitch, traction_scale);
        self.roll_on(spec, &ground_contact, command.drive, roll, pitch, grip);
        if ground_contact.blocked {
            self.contacts.meet_step(self.motion.speed_mps);
            self.motion.speed_mps = 0.0;
        }
        self.advance(pitch);
        self.contacts.update(
            spec,
            terrain,
            &mut self.at,
            self.yaw_rad,
            self.pose.translation.z,
            &mut self.motion,
        );
        self.pose = self.pose_on(spec);
        self.feel(&before, velocity_before);
    }

    /// Horizontal position of the vehicle's origin.
    pub fn at(&self) -> DVec2 {
        self.at
    }

    /// Horizontal unit vectors ahead and to the left.
    fn axes(&self) -> [DVec2; 2] {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        [DVec2::new(cos, sin), DVec2::new(-sin, cos)]
    }

    fn ground_contact(&self, spec: &VehicleSpec, terrain: &impl Terrain) -> GroundContact {
        let wheels = &spec.wheels;
        let [ahead, left] = self.axes();
        let reach = 0.7 * wheels.radius_m;
        // At ±0.7 of its radius, the lower edge of a circle is this far above its lowest point.
        let rise = wheels.radius_m * (1.0 - (1.0_f64 - 0.49).sqrt());
        let direction = if self.motion.speed_mps < 0.0 { -1.0 } else { 1.0 };
        let mut blocked = false;
        let mut height = |at: DVec2, middle_m: f64| {
            let next = terrain.height_m(at + ahead * (direction * reach));
            let last = terrain.height_m(at - ahead * (direction * reach));
            blocked |= next - middle_m > wheels.climb_m;
            middle_m.max(next - rise).max(last - rise)
        };
        let sides = [0.5 * wheels.track_m, -0.5 * wheels.track_m].map(|y| self.at + left * y);
        let patches = sides.map(|at| terrain.patch(at));
        let driven = [height(sides[0], patches[0].height_m), height(sides[1], patches[1].height_m)];
        let axle = self.at + ahead * wheels.other_axle_x_m;
        let others = [0.5 * wheels.other_track_m, -0.5 * wheels.other_track_m]
            .map(|y| axle + left * y)
            .map(|at| height(at, terrain.height_m(at)));
        GroundContact {
            heights_m: [driven[0], driven[1], 0.5 * (others[0] + others[1])],
            traction: [patches[0].traction, patches[1].traction],
            slip_at_limit: [patches[0].slip_at_limit, patches[1].slip_at_limit],
            rolling: 0.5 * (patches[0].rolling_resistance + patches[1].rolling_resistance),
            plant_drag: 0.5 * (patches[0].plant_drag + patches[1].plant_drag),
            blocked: blocked && self.motion.speed_mps != 0.0,
        }
    }

    /// The wheels follow the ground with the compliance of tyres and frame.
    fn settle(&mut self, spec: &VehicleSpec, ground_contact: &GroundContact) {
        let part = STEP_S / (spec.body.settle_s + STEP_S);
        for (height, ground) in self.heights_m.iter_mut().zip(ground_contact.heights_m) {
            *height += part * (ground - *height);
        }
        self.pose = self.pose_on(spec);
    }

    /// The pose from position, direction and heights of the wheels.
    fn pose_on(&self, spec: &VehicleSpec) -> Pose {
        let [left, right, other] = self.heights_m;
        let middle = 0.5 * (left + right);
        let roll = libm::atan2(left - right, spec.wheels.track_m);
        let rise_ahead = (other - middle) / spec.wheels.other_axle_x_m;
        let pitch = -libm::atan(rise_ahead);
        Pose::from_rpy(self.at.extend(middle), roll, pitch, self.yaw_rad)
    }

    /// The steering follows its command after a dead time, as a first-order system (Wellington 2005, A.4).
    fn steer(&mut self, spec: &VehicleSpec, curvature_per_m: f64) {
        let Some(steering) = &spec.steering else { return };
        let limit = steering.max_curvature_per_m;
        self.delayed.push_back(curvature_per_m.clamp(-limit, limit));
        let delay_steps = libm::round(steering.delay_s / STEP_S) as usize;
        if self.delayed.len() > delay_steps
            && let Some(command) = self.delayed.pop_front()
        {
            let part = STEP_S / (steering.time_constant_s + STEP_S);
            self.curvature_per_m += part * (command - self.curvature_per_m);
        }
    }

    /// Computes sideways motion; returns the maximum forces that remain for driving, N.
    fn slide(
        &mut self,
        spec: &VehicleSpec,
        ground_contact: &GroundContact,
        roll: f64,
        pitch: f64,
        scale: f64,
    ) -> [f64; 2] {
        let traction = ground_contact.traction.map(|traction| traction * scale);
        let upright = libm::cos(roll) * libm::cos(pitch);
        let limit = 0.5 * (traction[0] + traction[1]) * GRAVITY_MPS2 * upright;
        let downhill = -GRAVITY_MPS2 * libm::sin(roll) * libm::cos(pitch);
        let side = downhill - self.motion.speed_mps * self.motion.yaw_rate_radps;
        let share = if limit > 0.0 { side / limit } else { side.signum() };
        if share.abs() > 1.0 {
            self.side_mps += (side - limit * side.signum()) * STEP_S;
        } else {
            let drift = spec.wheels.side_slip_at_limit * self.motion.speed_mps.abs() * share;
            let brake = limit * STEP_S;
            self.side_mps += (drift - self.side_mps).clamp(-brake, brake);
        }
        let left_over = (1.0 - share * share).max(0.09).sqrt();
        let weight = spec.body.mass_kg * GRAVITY_MPS2 * upright * spec.wheels.driven_load;
        // Roll moves weight to the lower wheel.
        let lean = spec.body.centre_height_m * libm::tan(roll) / spec.wheels.track_m;
        let grip = |part: f64, traction: f64| part.clamp(0.0, 1.0) * weight * traction * left_over;
        [grip(0.5 - lean, traction[0]), grip(0.5 + lean, traction[1])]
    }

    fn roll_on(
        &mut self,
        spec: &VehicleSpec,
        ground_contact: &GroundContact,
        drive: Drive,
        roll: f64,
        pitch: f64,
        grip_n: [f64; 2],
    ) {
        let weight = spec.body.mass_kg * GRAVITY_MPS2;
        let rolling = (ground_contact.rolling + spec.wheels.rolling_resistance)
            * weight
            * libm::cos(pitch)
            * libm::cos(roll);
        let plants = ground_contact.plant_drag * weight;
        let load = Load {
            grip_n,
            slip_at_limit: ground_contact.slip_at_limit,
            push_n: weight * libm::sin(pitch) - self.contacts.spring_n(),
            hold_n: rolling + plants,
            // Plants on both sides of the body resist a turn with a lever arm of a quarter of its width.
            hold_nm: spec.wheels.scrub_nm + 0.25 * plants * spec.body.width_m,
        };
        let drive = match drive {
            Drive::Speeds(speeds) if spec.bumper.stops_drive && self.contacts.pressed() != [false; 2] => {
                Drive::Speeds(speeds.map(|speed| speed.min(0.0)))
            }
            other => other,
        };
        let dt = STEP_S / DRIVE_STEPS as f64;
        for _ in 0..DRIVE_STEPS {
            if spec.steering.is_some() {
                let curvature = self.driven_curvature(ground_contact, grip_n);
                step_steered(spec, &mut self.motion, &load, drive, curvature, dt);
            } else {
                step_differential(spec, &mut self.motion, &load, drive, dt);
            }
            for side in 0..2 {
                self.rolled_m[side] += self.motion.rim_mps[side] * dt;
            }
        }
        let half = [-0.5 * spec.wheels.track_m, 0.5 * spec.wheels.track_m];
        for (side, arm_m) in half.into_iter().enumerate() {
            let ground = self.motion.speed_mps + self.motion.yaw_rate_radps * arm_m;
            self.slip[side] = slip_of(self.motion.rim_mps[side], ground);
        }
    }

    /// The front wheels can hold a turn up to the limit of traction; beyond it, the vehicle turns less (understeer).
    fn driven_curvature(&self, ground_contact: &GroundContact, grip_n: [f64; 2]) -> f64 {
        let limit = 0.5 * (ground_contact.traction[0] + ground_contact.traction[1]) * GRAVITY_MPS2;
        let held = limit / (self.motion.speed_mps * self.motion.speed_mps).max(1e-3);
        if grip_n == [0.0; 2] { 0.0 } else { self.curvature_per_m.clamp(-held, held) }
    }

    fn advance(&mut self, pitch: f64) {
        let level = self.motion.speed_mps * libm::cos(pitch);
        self.yaw_rad = wrap_angle(self.yaw_rad + 0.5 * self.motion.yaw_rate_radps * STEP_S);
        let [ahead, left] = self.axes();
        self.at += (ahead * level + left * self.side_mps) * STEP_S;
        self.yaw_rad = wrap_angle(self.yaw_rad + 0.5 * self.motion.yaw_rate_radps * STEP_S);
        self.distance_m += DVec2::new(level, self.side_mps).length() * STEP_S;
    }

    /// Readings of ideal inertial sensors at the vehicle's origin.
    fn feel(&mut self, before: &Pose, velocity_before: DVec3) {
        self.velocity = (self.pose.translation - before.translation) / STEP_S;
        let acceleration = (self.velocity - velocity_before) / STEP_S + DVec3::Z * GRAVITY_MPS2;
        let vehicle_from_global = self.pose.rotation.conjugate();
        self.force_mps2 = vehicle_from_global * acceleration;
        let turn = before.rotation.conjugate() * self.pose.rotation;
        // For the small rotation of one step, the vector part of the quaternion is half of the angle.
        self.turn_radps = turn.xyz() * (2.0 * turn.w.signum() / STEP_S);
    }
}
