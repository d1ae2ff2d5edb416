//! Synthetic drives: the sensor readings of a vehicle that rolls, spins, stalls and turns.

use super::*;

const RULES: Rules = Rules {
    track_m: 0.6,
    memory_s: 1.5,
    spin_slip: 0.3,
    min_speed_mps: 0.3,
    stall_current_a: 15.0,
    stall_speed_mps: 0.05,
    settle_s: 0.3,
};

/// State of the vehicle and its wheels at one time of a drive.
#[derive(Clone, Copy, Default)]
struct Moment {
    /// Speed of the vehicle.
    speed_mps: f64,
    yaw_rate_radps: f64,
    /// Speeds of the wheels.
    wheels_mps: [f64; 2],
    motors_a: [f64; 2],
    pitch_rad: f64,
}

/// Drives for a time with 100 inertial readings and 20 evaluations a second; accelerations are derived from the speeds.
fn drive(traction: &mut Traction, from_s: f64, to_s: f64, offset_mps2: f64, at: impl Fn(f64) -> Moment) {
    for step in (from_s * 100.0) as u64..(to_s * 100.0) as u64 {
        let (time_s, before_s) = (step as f64 * 0.01, step as f64 * 0.01 - 0.01);
        let now = at(time_s);
        let acceleration = (now.speed_mps - at(before_s.max(from_s)).speed_mps) / 0.01;
        traction.wheels_mps = now.wheels_mps;
        traction.motors_a = now.motors_a;
        let time = Stamp(step * 10_000_000);
        let reading = Inertial {
            time,
            arrived: time,
            acceleration_mps2: acceleration - GRAVITY_MPS2 * libm::sin(now.pitch_rad) + offset_mps2,
            yaw_rate_radps: now.yaw_rate_radps,
            pitch_rad: now.pitch_rad,
        };
        traction.take_inertial(&reading, &RULES);
        if step % 5 == 0 {
            traction.look(time, 0.2, &RULES);
        }
    }
}

fn rolling(speed_mps: f64) -> Moment {
    Moment { speed_mps, wheels_mps: [speed_mps; 2], ..Moment::default() }
}

#[test]
fn wheels_that_roll_grip_also_uphill_and_with_an_offset_of_the_accelerometer() {
    let mut traction = Traction::default();
    drive(&mut traction, 0.0, 2.0, 0.05, |_| rolling(0.0));
    assert_eq!(traction.state, State::Unknown, "a vehicle that stands tells nothing");
    let uphill = |t: f64| Moment { pitch_rad: -0.2, ..rolling((t - 2.0).clamp(0.0, 1.2)) };
    drive(&mut traction, 2.0, 12.0, 0.05, uphill);
    assert_eq!(traction.state, State::Grips);
    assert!(traction.slip < 0.05, "{}", traction.slip);
    assert_eq!(traction.spin.count, 0);
}

#[test]
fn wheels_that_spin_on_the_spot_are_told_after_the_time_to_settle_and_counted_once() {
    let mut traction = Traction::default();
    drive(&mut traction, 0.0, 1.0, 0.0, |_| rolling(0.0));
    let spinning = |t: f64| Moment { wheels_mps: [(t - 1.0).min(1.0); 2], ..Moment::default() };
    drive(&mut traction, 1.0, 1.5, 0.0, spinning);
    assert_eq!(traction.state, State::Grips, "0.2 s above the least speed are too short to be sure");
    drive(&mut traction, 1.5, 3.0, 0.0, spinning);
    assert_eq!(traction.state, State::Spins);
    assert!(traction.slip > 0.6, "{}", traction.slip);
    assert_eq!(traction.spin.count, 1);
    assert!((traction.spin.time_s - 1.65).abs() < 0.11, "{}", traction.spin.time_s);
    drive(&mut traction, 3.0, 8.0, 0.0, |_| rolling(0.0));
    assert_eq!((traction.state, traction.spin.count), (State::Unknown, 1));
}

#[test]
fn wheels_that_are_braked_to_0_for_a_moment_do_not_make_a_vehicle_that_rolls_stand() {
    let mut traction = Traction::default();
    drive(&mut traction, 0.0, 1.0, 0.0, |_| rolling(0.0));
    drive(&mut traction, 1.0, 4.0, 0.0, |t| rolling((t - 1.0).min(0.8)));
    let braked = |t: f64| Moment { wheels_mps: [if t < 4.1 { 0.0 } else { 0.8 }; 2], ..rolling(0.8) };
    drive(&mut traction, 4.0, 4.2, 0.0, braked);
    assert!(traction.inertial_mps > 0.6, "{}", traction.inertial_mps);
    // Wheels that turn around do, also by way of 0.
    drive(&mut traction, 4.2, 4.3, 0.0, |_| rolling(0.0));
    drive(&mut traction, 4.3, 4.4, 0.0, |_| Moment { wheels_mps: [-0.3; 2], ..rolling(0.0) });
    assert!((traction.inertial_mps + 0.3).abs() < 0.02, "{}", traction.inertial_mps);
}

#[test]
fn an_offset_that_was_not_there_at_rest_is_learned_on_the_way_and_wheels_that_spin_are_told_for_seconds() {
    let mut traction = Traction::default();
    drive(&mut traction, 0.0, 1.0, 0.0, |_| rolling(0.0));
    drive(&mut traction, 1.0, 30.0, 0.15, |t| rolling((t - 1.0).min(1.0)));
    assert!((traction.inertial_mps - 1.0).abs() < 0.02, "{}", traction.inertial_mps);
    let stuck = |t: f64| Moment { speed_mps: (1.0 - (t - 30.0) * 2.0).max(0.0), ..rolling(1.0) };
    drive(&mut traction, 30.0, 36.0, 0.15, stuck);
    assert_eq!((traction.state, traction.spin.count), (State::Spins, 1));
    assert!(traction.spin.time_s > 5.0, "{}", traction.spin.time_s);
}

#[test]
fn wheels_that_turn_around_after_they_have_spun_are_not_said_to_spin_backward() {
    let mut traction = Traction::default();
    drive(&mut traction, 0.0, 1.0, 0.0, |_| rolling(0.0));
    let spinning = |t: f64| Moment { wheels_mps: [(t - 1.0).min(1.0); 2], ..Moment::default() };
    drive(&mut traction, 1.0, 3.0, 0.0, spinning);
    // Since it began to spin, the pitch is wrong by 1.3 degrees.
    let offset_mps2 = GRAVITY_MPS2 * libm::sin(0.023);
    drive(&mut traction, 3.0, 4.0, offset_mps2, spinning);
    assert!(traction.inertial_mps > 0.4, "{}", traction.inertial_mps);
    let back = |t: f64| {
        let wheel_mps = (1.0 - 2.0 * (t - 4.0)).max(-0.6);
        Moment { speed_mps: wheel_mps.min(0.0), wheels_mps: [wheel_mps; 2], ..Moment::default() }
    };
    drive(&mut traction, 4.0, 5.2, offset_mps2, back);
    assert_eq!(traction.state, State::Grips);
    assert!(traction.slip < 0.3, "{}", traction.slip);
}

#[test]
fn a_vehicle_that_loses_its_grip_at_speed_is_noticed() {
    let mut traction = Traction::default();
    drive(&mut traction, 0.0, 4.0, 0.02, |t| rolling((t - 1.0).clamp(0.0, 1.0)));
    // On mud the vehicle slows to 0.3 m/s within a second while the wheels keep turning.
    let mud = |t: f64| Moment { speed_mps: (1.0 - (t - 4.0) * 0.7).max(0.3), ..rolling(1.0) };
    drive(&mut traction, 4.0, 6.0, 0.02, mud);
    assert_eq!(traction.state, State::Spins);
    assert!(traction.slip > 0.3 && traction.slip < 0.8, "{}", traction.slip);
}

#[test]
fn a_turn_that_the_gyro_agrees_with_is_no_slip_and_one_that_it_does_not_is() {
    let turn = |yaw_rate_radps: f64| {
        let mut traction = Traction::default();
        drive(&mut traction, 0.0, 3.0, 0.0, |_| Moment {
            yaw_rate_radps,
            wheels_mps: [-0.36, 0.36],
            ..Moment::default()
        });
        traction
    };
    let grips = turn(1.2);
    assert_eq!(grips.state, State::Grips);
    assert!(grips.slip < 1e-9 && (grips.wheel_yaw_rate_radps(&RULES) - 1.2).abs() < 1e-12);
    let spins = turn(0.3);
    assert_eq!(spins.state, State::Spins);
    assert!((spins.slip - 0.75).abs() < 1e-9);
}

#[test]
fn a_motor_that_draws_current_while_its_wheel_stands_is_stalled() {
    let mut traction = Traction::default();
    let against_a_wall = Moment { motors_a: [4.0, 20.0], ..Moment::default() };
    drive(&mut traction, 0.0, 0.25, 0.0, |_| against_a_wall);
    assert_eq!((traction.state, traction.stall.count), (State::Unknown, 0));
    drive(&mut traction, 0.25, 1.0, 0.0, |_| against_a_wall);
    assert_eq!((traction.state, traction.stall.count), (State::Stalled, 1));
    let climbs = Moment { motors_a: [20.0, 20.0], ..rolling(0.5) };
    drive(&mut traction, 1.0, 2.0, 0.0, |_| climbs);
    assert_eq!(traction.stall.count, 1, "a current with turning wheels is work");
}

#[test]
fn without_inertial_readings_there_is_no_slip() {
    let mut traction = Traction { wheels_mps: [1.0, 1.0], ..Traction::default() };
    traction.look(Stamp(0), 0.2, &RULES);
    assert_eq!((traction.state, traction.slip), (State::Unknown, 0.0));
    drive(&mut traction, 0.0, 1.0, 0.0, |_| rolling(1.0));
    assert_eq!(traction.state, State::Grips);
    traction.look(Stamp(1_500_000_000), 0.2, &RULES);
    assert_eq!(traction.state, State::Unknown);
}

#[test]
fn readings_after_a_gap_or_out_of_order_are_not_integrated() {
    let mut traction = Traction { wheels_mps: [1.0, 1.0], ..Traction::default() };
    let reading = |ms: u64| Inertial {
        time: Stamp(ms * 1_000_000),
        arrived: Stamp(2_000_000_000),
        acceleration_mps2: 50.0,
        yaw_rate_radps: 0.0,
        pitch_rad: 0.0,
    };
    traction.take_inertial(&reading(1_000), &RULES);
    traction.take_inertial(&reading(2_000), &RULES);
    assert_eq!(traction.inertial_mps, 1.0, "the wheels' speed after a gap");
    traction.take_inertial(&reading(1_990), &RULES);
    assert_eq!(traction.inertial_mps, 1.0);
}

#[test]
fn the_second_reading_of_a_clock_that_has_begun_again_is_one_after_a_gap_and_the_next_is_integrated() {
    let mut traction = Traction { wheels_mps: [1.0, 1.0], ..Traction::default() };
    let take = |traction: &mut Traction, ms: u64| {
        let reading = Inertial {
            time: Stamp(ms * 1_000_000),
            arrived: Stamp(900_000_000_000),
            acceleration_mps2: 50.0,
            yaw_rate_radps: 0.0,
            pitch_rad: 0.0,
        };
        traction.take_inertial(&reading, &RULES)
    };
    let begins_again = [500_000, 500_010, 1_000, 1_010].map(|ms| take(&mut traction, ms));
    assert_eq!(begins_again, [false, false, false, true]);
    assert_eq!(traction.inertial_mps, 1.0, "the wheels' speed after a gap");
    assert!(!take(&mut traction, 1_020) && traction.inertial_mps > 1.0);
}

#[test]
fn an_inertial_sensor_too_slow_to_be_integrated_does_not_say_that_the_wheels_grip() {
    let mut traction = Traction { wheels_mps: [1.0, 1.0], ..Traction::default() };
    let take = |traction: &mut Traction, ms: u64| {
        let time = Stamp(ms * 1_000_000);
        let reading =
            Inertial { time, arrived: time, acceleration_mps2: 0.0, yaw_rate_radps: 0.0, pitch_rad: 0.0 };
        traction.take_inertial(&reading, &RULES);
        traction.look(time, 0.2, &RULES);
        traction.state
    };
    for step in 0..20 {
        assert_eq!(take(&mut traction, 125 * step), State::Unknown);
    }
    assert_eq!(take(&mut traction, 125 * 19 + 50), State::Grips, "a step that is integrated");
}

#[test]
fn a_reading_from_the_future_does_not_end_the_detection_and_a_clock_that_is_ahead_does_not_hide_silence() {
    let mut traction = Traction { wheels_mps: [1.0, 1.0], ..Traction::default() };
    let take = |traction: &mut Traction, ms: u64, ahead_ms: u64| {
        let (now, time) = (Stamp(ms * 1_000_000), Stamp((ms + ahead_ms) * 1_000_000));
        let reading =
            Inertial { time, arrived: now, acceleration_mps2: 0.0, yaw_rate_radps: 0.0, pitch_rad: 0.0 };
        traction.take_inertial(&reading, &RULES);
        traction.look(now, 0.2, &RULES);
        traction.state
    };
    for step in 0..20 {
        take(&mut traction, 1_000 + 10 * step, 0);
    }
    take(&mut traction, 1_200, 3_600_000);
    take(&mut traction, 1_210, 0);
    assert_eq!(take(&mut traction, 1_220, 0), State::Grips);
    // From now on its clock is 18 s ahead.
    for step in 0..20 {
        take(&mut traction, 1_230 + 10 * step, 18_000);
    }
    assert_eq!(traction.state, State::Grips);
    traction.look(Stamp(1_700_000_000), 0.2, &RULES);
    assert_eq!(traction.state, State::Unknown, "silent since 1.42 s");
}
