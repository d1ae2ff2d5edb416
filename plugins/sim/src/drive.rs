//! Driven wheels, motors and the ground they grip: one short step in time.
//!
//! Everything that can hold the vehicle (traction, rolling resistance, scrub of casters, brakes) is an impulse with a
//! limit, and the impulses are found together, so that a vehicle stands still on a slope for as long as what holds it
//! suffices, and slides or spins its wheels when it does not. This is the projected Gauss–Seidel method of rigid-body
//! solvers, with motor and traction of a wheel solved exactly as one block.
//!
//! Traction: slip grows in proportion to the force up to `slip_at_limit`, where the force reaches `traction · load`;
//! more it cannot be. So slip follows from surface, slope, plants and what the motors want.

use crate::spec::VehicleSpec;
use serde::{Deserialize, Serialize};

/// Passes over the wheels; motor and traction of a wheel are exact in each.
const PASSES: usize = 8;
/// Speed below which slip is not in proportion to the wheel's speed any more, m/s.
const CREEP_MPS: f64 = 0.001;
/// Below this speed of wheel and ground there is no slip to speak of, m/s.
const NO_SLIP_MPS: f64 = 0.02;

/// What the wheels are told.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Drive {
    /// Wheel speeds, left and right, m/s.
    Speeds([f64; 2]),
    /// The motors have no current.
    Coast,
    /// The brakes are on.
    Brake,
}

/// Motion along and about the vehicle's axes, and the wheels'.
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

/// What acts on the vehicle during a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Highest force of a driven wheel along the ground, left and right, N.
    pub grip_n: [f64; 2],
    /// Gravity and springs along the vehicle's x axis, N.
    pub push_n: f64,
    /// Force that holds back whatever way the vehicle rolls: rolling resistance and plants, N.
    pub hold_n: f64,
    /// Moment that holds back whatever way it turns, N·m.
    pub hold_nm: f64,
}

/// A wheel's share of a step.
struct Wheel {
    /// Rim speed before, and the speed that the motor or the brake wants now, m/s.
    rim_mps: f64,
    wanted_mps: f64,
    /// Highest impulse of motor or brake, and of traction, N·s.
    motor_limit: f64,
    grip_limit: f64,
    /// Mass at the rim, kg.
    rim_kg: f64,
    /// Speed that the ground under the wheel gains by an impulse, and slip by an impulse, m/s by N·s.
    give: f64,
    slip: f64,
}

impl Wheel {
    /// Rim speed after, impulse of the motor, impulse of traction; `ground_mps` is the vehicle's speed over the ground
    /// at this wheel without this wheel's traction.
    fn solve(&self, ground_mps: f64) -> [f64; 3] {
        let softness = self.give + self.slip;
        let grip = |rim: f64| ((rim - ground_mps) / softness).clamp(-self.grip_limit, self.grip_limit);
        let held = grip(self.wanted_mps);
        let motor = self.rim_kg * (self.wanted_mps - self.rim_mps) + held;
        if motor.abs() <= self.motor_limit {
            return [self.wanted_mps, motor, held];
        }
        let motor = motor.clamp(-self.motor_limit, self.motor_limit);
        // The motor is at its limit: the rim's speed follows from both impulses.
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

/// The rim speed that a drive wants after `dt_s`, and the highest force to get there, N.
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

/// Steps a vehicle whose wheels turn it.
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
            slip: spec.wheels.slip_at_limit * rim_mps.abs().max(CREEP_MPS) / grip_limit,
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

/// Steps a vehicle that steers: both driven wheels by a differential, the turn by the curvature that is driven.
pub fn step_steered(
    spec: &VehicleSpec,
    motion: &mut Motion,
    load: &Load,
    drive: Drive,
    curvature_per_m: f64,
    dt_s: f64,
) {
    // To turn faster, the yaw inertia must be sped up with the mass.
    let mass = spec.body.mass_kg + spec.body.yaw_inertia_kgm2 * curvature_per_m * curvature_per_m;
    let drive = match drive {
        Drive::Speeds([left, right]) => Drive::Speeds([0.5 * (left + right); 2]),
        other => other,
    };
    // The axle as one wheel: a differential gives both the same force.
    let rim_mps = 0.5 * (motion.rim_mps[0] + motion.rim_mps[1]);
    let [wanted_mps, force] = motor_goal(spec, drive, 0, rim_mps, dt_s);
    let grip_limit = (2.0 * load.grip_n[0].min(load.grip_n[1]) * dt_s).max(1e-9);
    let axle = Wheel {
        rim_mps,
        wanted_mps,
        motor_limit: 2.0 * force * dt_s,
        grip_limit,
        rim_kg: 2.0 * spec.wheels.rim_mass_kg,
        give: 1.0 / mass,
        slip: spec.wheels.slip_at_limit * rim_mps.abs().max(CREEP_MPS) / grip_limit,
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

/// An impulse that brings a speed to 0 as far as its limit allows. `held` is what it has given so far.
fn hold(speed: &mut f64, held: &mut f64, mass: f64, limit: f64) {
    let wanted = (*held - *speed * mass).clamp(-limit, limit);
    *speed += (wanted - *held) / mass;
    *held = wanted;
}

/// Slip of a wheel: 0 grips, 1 spins on the spot or is locked.
pub fn slip_of(rim_mps: f64, ground_mps: f64) -> f64 {
    let faster = rim_mps.abs().max(ground_mps.abs());
    if faster < NO_SLIP_MPS { 0.0 } else { ((rim_mps - ground_mps).abs() / faster).min(1.0) }
}
