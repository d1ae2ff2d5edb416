//! Children that the operator takes and gives back: what they are told again, and what of the operator's stays.

use super::Bench;
use rcs_msg::rcs::ProcessState::{Done, Error, Exec};

#[test]
fn what_the_operator_halted_stays_halted_until_it_is_given_back() {
    let mut bench = Bench::new();
    bench.say("wheels", "HALT");
    bench.forward(800);
    bench.expect("wheels", Done, "stands");
    bench.expect("robot", Exec, "runs; wheels obeys operator");
    bench.say("robot", "RUN");
    bench.forward(2000);
    bench.expect("wheels", Done, "stands");
    assert_eq!(bench.status("wheels").owner, "", "the operator's authority has lapsed");
    bench.say("wheels", "TAKE");
    bench.forward(100);
    bench.say("wheels", "RELEASE");
    bench.forward(200);
    bench.expect("wheels", Exec, "drives");
    assert_eq!(bench.status("wheels").commander, "robot");
}

#[test]
fn a_vehicle_interface_that_the_operator_has_taken_is_stopped_when_it_is_given_back() {
    let why = "perception is in ERROR: camera is in ERROR: blind";
    let cannot = format!("cannot stop the vehicle, because the operator has taken wheels: {why}");
    let has = format!("has stopped the vehicle: {why}");
    for command in ["TAKE", "RUN"] {
        let mut bench = Bench::new();
        bench.say("wheels", command);
        bench.forward(100);
        bench.fate("camera", "blind");
        bench.forward(200);
        bench.expect("wheels", Exec, "drives");
        bench.expect("robot", Error, &cannot);
        bench.say("wheels", "RELEASE");
        bench.forward(200);
        bench.expect("wheels", Exec, "brakes");
        bench.expect("robot", Error, &has);
        bench.forward(600);
        bench.expect("wheels", Done, "stands");

        // What the operator has moved since is stopped again.
        bench.say("wheels", "RUN");
        bench.forward(100);
        bench.expect("wheels", Exec, "drives");
        bench.expect("robot", Error, &cannot);
        bench.say("wheels", "RELEASE");
        bench.forward(800);
        bench.expect("wheels", Done, "stands");
        bench.expect("robot", Error, &has);
    }
}

#[test]
fn a_vehicle_interface_that_the_operator_has_taken_is_stopped_when_the_authority_has_lapsed() {
    let why = "perception is in ERROR: camera is in ERROR: blind";
    for command in ["TAKE", "RUN"] {
        let mut bench = Bench::new();
        bench.say("wheels", command);
        bench.forward(100);
        bench.fate("camera", "blind");
        bench.forward(800);
        bench.expect("wheels", Exec, "drives");
        let cannot = format!("cannot stop the vehicle, because the operator has taken wheels: {why}");
        bench.expect("robot", Error, &cannot);
        bench.forward(2200);
        bench.expect("wheels", Done, "stands");
        assert_eq!(bench.status("wheels").commander, "robot");
        bench.expect("robot", Error, &format!("has stopped the vehicle: {why}"));

        // The operator who keeps it drives on.
        bench.hold("wheels", 500);
        bench.say("wheels", "RUN");
        bench.hold("wheels", 3500);
        bench.expect("wheels", Exec, "drives");
    }
    // The same for HALT.
    let mut bench = Bench::new();
    bench.say("wheels", "TAKE");
    bench.forward(100);
    bench.say("robot", "HALT");
    bench.forward(500);
    bench.expect("wheels", Exec, "drives");
    bench.forward(2500);
    bench.expect("wheels", Done, "stands");
}

#[test]
fn an_order_that_is_refused_while_the_operator_has_a_child_is_sent_when_it_is_given_back() {
    let mut bench = Bench::new();
    bench.say("robot", "HALT");
    bench.forward(1000);
    bench.expect("robot", Done, "all children are halted");
    bench.say("wheels", "TAKE");
    bench.forward(100);
    bench.say("robot", "RUN");
    bench.forward(200);
    bench.expect("robot", Exec, "runs; the operator has taken wheels");
    bench.expect("wheels", Done, "stands");
    bench.say("wheels", "RELEASE");
    bench.forward(200);
    bench.expect("robot", Exec, "all children run");
    bench.expect("wheels", Exec, "drives");
}

#[test]
fn halt_names_a_child_that_obeys_the_operator_and_halts_it_when_it_is_given_back() {
    let mut bench = Bench::new();
    bench.say("lamp", "RUN");
    bench.say("robot", "HALT");
    bench.hold("lamp", 1500);
    bench.expect("lamp", Exec, "works");
    bench.expect("robot", Done, "all other children are halted; lamp obeys operator");
    bench.say("lamp", "RELEASE");
    bench.forward(200);
    bench.expect("lamp", Done, "halted");
    bench.expect("robot", Done, "all children are halted");
}

#[test]
fn halt_stands_a_vehicle_interface_that_the_operator_gives_back_after_the_timeout() {
    let mut bench = Bench::new();
    bench.say("wheels", "RUN");
    bench.say("robot", "HALT");
    bench.hold("wheels", 1000);
    bench.expect("wheels", Exec, "drives");
    bench.expect("robot", Exec, "waits for the vehicle to stand; wheels obeys operator");
    bench.expect("camera", Exec, "works");
    bench.hold("wheels", 2500);
    bench.expect("wheels", Exec, "drives");
    bench.expect("robot", Done, "all other children are halted; wheels obeys operator");
    bench.say("wheels", "RELEASE");
    bench.forward(200);
    bench.expect("wheels", Exec, "brakes");
    bench.expect("robot", Exec, "waits for wheels");
    bench.forward(600);
    bench.expect("wheels", Done, "stands");
    bench.expect("robot", Done, "all children are halted");
}

#[test]
fn the_timeout_of_halt_begins_again_when_a_vehicle_interface_is_given_back() {
    let mut bench = Bench::new();
    bench.say("robot", "HALT");
    bench.hold("wheels", 2500);
    bench.expect("wheels", Exec, "drives");
    bench.expect("robot", Exec, "waits for the vehicle to stand; the operator has taken wheels");
    bench.forward(200);
    bench.say("wheels", "RELEASE");
    bench.forward(450);
    bench.expect("wheels", Exec, "brakes");
    bench.expect("robot", Exec, "waits for the vehicle to stand");
    bench.expect("camera", Exec, "works");
    bench.forward(1000);
    bench.expect("wheels", Done, "stands");
    bench.expect("robot", Done, "all children are halted");
}

#[test]
fn a_command_of_its_own_by_which_a_child_runs_outlasts_release() {
    let mut bench = Bench::new();
    bench.say("wheels", "CREEP");
    bench.forward(100);
    bench.expect("wheels", Exec, "creeps");
    bench.say("wheels", "RELEASE");
    bench.forward(400);
    bench.expect("wheels", Exec, "creeps");
    assert_eq!(bench.status("wheels").owner, "robot");
    bench.expect("robot", Exec, "runs; wheels obeys operator");

    // The supervisor stops it all the same, and its RUN ends the command.
    bench.fate("camera", "blind");
    bench.forward(800);
    bench.expect("wheels", Done, "stands");
    bench.fate("camera", "");
    bench.forward(200);
    bench.say("robot", "RUN");
    bench.forward(200);
    bench.expect("wheels", Exec, "drives");
    bench.expect("robot", Exec, "all children run");

    // A child that refused such a command, because it was halted, is told to run.
    bench.say("map", "HALT");
    bench.forward(600);
    bench.say("map", "CLEAR");
    bench.forward(600);
    bench.expect("map", Error, "CLEAR needs a process that runs; expected RUN before it");
    bench.say("map", "RELEASE");
    bench.forward(1200);
    bench.expect("map", Exec, "saved 0, cleared 0");
    bench.expect("robot", Exec, "all children run");
}

#[test]
fn a_child_is_not_said_to_obey_the_operator_after_a_one_shot_and_release() {
    let mut bench = Bench::new();
    bench.say("map", "CLEAR");
    bench.forward(600);
    bench.expect("map", Exec, "saved 0, cleared 1");
    bench.expect("robot", Exec, "runs; map obeys operator");
    bench.say("map", "RELEASE");
    bench.forward(600);
    bench.expect("map", Exec, "saved 0, cleared 1");
    bench.expect("robot", Exec, "all children run");

    // What the operator has told it before the one-shot stays in force.
    bench.say("map", "KEEP");
    bench.say("map", "CLEAR");
    bench.forward(600);
    bench.say("map", "RELEASE");
    bench.forward(600);
    assert_eq!(bench.status("map").command, "KEEP");
    bench.expect("map", Exec, "saved 0, cleared 2");
    bench.expect("robot", Exec, "runs; map obeys operator");
    bench.say("robot", "RUN");
    bench.forward(600);
    bench.expect("robot", Exec, "all children run");

    // One that does not do what it is told is named also after a one-shot.
    bench.say("map", "CLEAR");
    bench.forward(600);
    bench.say("robot", "INIT");
    bench.forward(1500);
    assert_eq!(bench.status("map").owner, "", "the operator's authority has lapsed");
    bench.expect("robot", Done, "all other children are initialized; map obeys operator");
}
