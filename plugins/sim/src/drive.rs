//! Driven wheels, motors and ground traction: one short time step.
//!
//! Everything that resists motion (traction, rolling resistance, scrub of casters, brakes) is an impulse with a limit.
//! The impulses are solved together, so that the vehicle stands still on a slope while the limits suffice, and slides
//! or spins its wheels when they do not. This is the projected Gauss-Seidel method of rigid-body solvers; motor and
//! traction of a wheel are solved exactly as one block.
//!
//! Traction: slip grows in proportion to the force up to `slip_at_limit`, where the force reaches its maximum `traction
//! · load`. On soft ground `slip_at_limit` is larger than on firm ground, so that rolling resistance and plants cost
//! speed there. Slip therefore depends on surface, slope, plants and motor torque.

use crate::spec::VehicleSpec;
use serde::{Deserialize, Serialize};

/// Length of a step, s: 10 ms.
pub const STEP_S: f64 = 0.01;

/// Number of passes over the wheels; each solves motor and traction of a wheel exactly.
const PASSES: usize = 8;
/// Below this speed slip is not proportional to the wheel's speed, m/s.
const CREEP_MPS: f64 = 0.001;
/// If wheel and ground are both slower than this, slip is 0, m/s.
const NO_SLIP_MPS: f64 = 0.02;

/// Command to the wheels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Drive {
    /// Wheel speeds, left and right, m/s.
    Speeds([f64; 2]),
    /// No motor current.
    Coast,
    /// Brakes applied.
    Brake,
}

/// Motion of the vehicle along and about its axes, and of its wheels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Speed ahead, m/s.
    pub speed_mps: f64,
    /// Turn rate, rad/s, positive to the left.
    pub yaw_rate_radps: f64,
    /// Speeds of the driven wheels' rims, left and right, m/s.
    pub rim_mps: [f64; 2],
    /// Forces of the motors at the rims, N.
    pub motor_n: [f64; 2],
}

/// Forces on the vehicle during a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Maximum traction of the left and the right driven wheel, N.
    pub grip_n: [f64; 2],
    /// Slip at which the left and the right driven wheel reach it.
    pub slip_at_limit: [f64; 2],
    /// Gravity and spring forces along the vehicle's x axis, N.
    pub push_n: f64,
    /// Maximum resisting force against rolling in either direction: rolling resistance and plants, N.
    pub hold_n: f64,
    /// Maximum resisting moment against turning in either direction, N·m.
    pub hold_nm: f64,
}

/// The equations of one wheel in a step.
struct Wheel {
    /// Rim speed before the step, and the target speed of motor or brake, m/s.
    rim_mps: f64,
    wanted_mps: f64,
    /// Maximum impulses of motor or brake, and of traction, N·s.
    motor_limit: f64,
    grip_limit: f64,
    /// Equivalent mass at the rim, kg.
    rim_kg: f64,
    /// Change of the ground speed at the wheel per impulse, and slip per impulse, m/s per N·s.
    give: f64,
    slip: f64,
}

impl Wheel {
    /// Returns the new rim speed, the impulse of the motor and the impulse of traction. `ground_mps` is the speed over
    /// ground at this wheel without this wheel's traction.
    fn solve(&self, ground_mps: f64) -> [f64; 3] {
        let softness = self.give + self.slip;
        let grip = |rim: f64| ((rim - ground_mps) / softness).clamp(-self.grip_limit, self.grip_limit);
        let held = grip(self.wanted_mps);
        let motor = self.rim_kg * (self.wanted_mps - self.rim_mps) + held;
        if motor.abs() <= self.motor_limit {
            return [self.wanted_mps, motor, held];
        }
        let motor = motor.clamp(-self.motor_limit, self.motor_limit);
        // The motor is at its limit: the rim speed follows from both impulses.
        let rolling =
            (self.rim_kg * self.rim_mps + motor + ground_mps / softness) / (self.rim_kg + 1.0 / softness);
        let traction = (rolling - ground_mps) / softness;
        if traction.abs() <= self.grip_limit {
            return [rolling, motor, traction];
        }
        let traction = traction.clamp(-self.grip_limit, self.grip_limit);
        [self.rim_mps + (motor - traction) / self.rim_kg, motor, traction]
    }
}

/// The target rim speed of a drive after `dt_s`, m/s, and the maximum force to reach it, N.
fn motor_goal(spec: &VehicleSpec, drive: Drive, side: usize, rim_mps: f64, dt_s: f64) -> [f64; 2] {
    let motors = &spec.motors;
    match drive {
        Drive::Speeds(speeds) => {
            let limit = spec.wheels.max_wheel_speed_mps;
            let target = speeds[side].clamp(-limit, limit);
            let part = dt_s / (motors.response_s + dt_s);
            let force = (motors.max_current_a - motors.idle_current_a) * motors.newton_per_amp;
            [rim_mps + part * (target - rim_mps), force]
        }
        Drive::Coast => [0.0, motors.idle_current_a * motors.newton_per_amp],
        Drive::Brake => [0.0, motors.brake_n],
    }
}

/// Steps a vehicle with differential drive.
pub fn step_differential(spec: &VehicleSpec, motion: &mut Motion, load: &Load, drive: Drive, dt_s: f64) {
    let mass = spec.body.mass_kg;
    let inertia = spec.body.yaw_inertia_kgm2;
    let arm = 0.5 * spec.wheels.track_m;
    let arms = [-arm, arm];
    let wheels = [0, 1].map(|side: usize| {
        let rim_mps = motion.rim_mps[side];
        let [wanted_mps, force] = motor_goal(spec, drive, side, rim_mps, dt_s);
        let grip_limit = (load.grip_n[side] * dt_s).max(1e-9);
        Wheel {
            rim_mps,
            wanted_mps,
            motor_limit: force * dt_s,
            grip_limit,
            rim_kg: spec.wheels.rim_mass_kg,
            give: 1.0 / mass + arm * arm / inertia,
            slip: spec.wheels.slip_at_limit.max(load.slip_at_limit[side]) * rim_mps.abs().max(CREEP_MPS)
                / grip_limit,
        }
    });
    let mut speed = motion.speed_mps + load.push_n / mass * dt_s;
    let mut turn = motion.yaw_rate_radps;
    let (mut traction, mut held, mut held_turn) = ([0.0; 2], 0.0, 0.0);
    for _ in 0..PASSES {
        for (side, wheel) in wheels.iter().enumerate() {
            speed -= traction[side] / mass;
            turn -= traction[side] * arms[side] / inertia;
            let [rim, motor, impulse] = wheel.solve(speed + turn * arms[side]);
            traction[side] = impulse;
            speed += impulse / mass;
            turn += impulse * arms[side] / inertia;
            motion.rim_mps[side] = rim;
            motion.motor_n[side] = motor / dt_s;
        }
        hold(&mut speed, &mut held, mass, load.hold_n * dt_s);
        hold(&mut turn, &mut held_turn, inertia, load.hold_nm * dt_s);
    }
    motion.speed_mps = speed;
    motion.yaw_rate_radps = turn;
}

/// Steps a vehicle with steering: the driven wheels are coupled by a differential, and the turn rate follows from the
/// curvature.
pub fn step_steered(
    spec: &VehicleSpec,
    motion: &mut Motion,
    load: &Load,
    drive: Drive,
    curvature_per_m: f64,
    dt_s: f64,
) {
    // A change of speed also changes the turn rate, so the yaw inertia adds to the mass.
    let mass = spec.body.mass_kg + spec.body.yaw_inertia_kgm2 * curvature_per_m * curvature_per_m;
    let drive = match drive {
        Drive::Speeds([left, right]) => Drive::Speeds([0.5 * (left + right); 2]),
        other => other,
    };
    // The axle is one wheel, because the differential gives both wheels the same force.
    let rim_mps = 0.5 * (motion.rim_mps[0] + motion.rim_mps[1]);
    let [wanted_mps, force] = motor_goal(spec, drive, 0, rim_mps, dt_s);
    let grip_limit = (2.0 * load.grip_n[0].min(load.grip_n[1]) * dt_s).max(1e-9);
    let slip_at_limit = load.slip_at_limit[0].max(load.slip_at_limit[1]);
    let axle = Wheel {
        rim_mps,
        wanted_mps,
        motor_limit: 2.0 * force * dt_s,
        grip_limit,
        rim_kg: 2.0 * spec.wheels.rim_mass_kg,
        give: 1.0 / mass,
        slip: spec.wheels.slip_at_limit.max(slip_at_limit) * rim_mps.abs().max(CREEP_MPS) / grip_limit,
    };
    let mut speed = motion.speed_mps + load.push_n / mass * dt_s;
    let (mut traction, mut held, mut rim) = (0.0, 0.0, rim_mps);
    for _ in 0..PASSES {
        speed -= traction / mass;
        let [after, motor, impulse] = axle.solve(speed);
        (traction, rim) = (impulse, after);
        speed += impulse / mass;
        motion.motor_n = [0.5 * motor / dt_s; 2];
        hold(&mut speed, &mut held, mass, load.hold_n * dt_s);
    }
    let split = 0.5 * spec.wheels.track_m * curvature_per_m;
    motion.rim_mps = [rim * (1.0 - split), rim * (1.0 + split)];
    motion.speed_mps = speed;
    motion.yaw_rate_radps = speed * curvature_per_m;
}

/// Applies an impulse that brings a speed to 0, up to its limit. `held` is the impulse applied so far.
fn hold(speed: &mut f64, held: &mut f64, mass: f64, limit: f64) {
    let wanted = (*held - *speed * mass).clamp(-limit, limit);
    *speed += (wanted - *held) / mass;
    *held = wanted;
}

/// Slip of a wheel: 0 is full grip, 1 spinning on the spot or locked.
pub fn slip_of(rim_mps: f64, ground_mps: f64) -> f64 {
    let faster = rim_mps.abs().max(ground_mps.abs());
    if faster < NO_SLIP_MPS { 0.0 } else { ((rim_mps - ground_mps).abs() / faster).min(1.0) }
}
