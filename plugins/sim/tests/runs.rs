//! Whole runs: refused input, outputs, and bit-identical repetition.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;

use common::bench::{Bench, COURSE, Files, STACK, VehicleBench, WORLD, plan};
use rcs_msg::foxglove::{CameraCalibration, FrameTransforms, Grid, LocationFix, PoseInFrame, RawImage};
use rcs_msg::rcs::{self, CourseOutcome};
use rcs_runtime::source::Task;
use rcs_runtime::{RunOptions, Snapshot, Stepped};
use rcs_sim::spec::VehicleSpec;
use rcs_world::GridView;

fn quiet() -> [(&'static str, &'static str); 1] {
    [("front_left.ground_truth", "false")]
}

#[test]
fn it_drives_by_commands_and_brakes_when_they_stop_coming() {
    let mut bench = Bench::start(STACK, &Files::default(), &quiet());
    bench.drive(0.8, 0.8, 2000);
    assert!((bench.state().speed_mps - 0.8).abs() < 0.05, "{}", bench.state().speed_mps);
    bench.advance(150);
    assert!(bench.state().speed_mps > 0.7, "the last command is 200 ms old");
    bench.advance(600);
    assert!(bench.state().speed_mps.abs() < 1e-3, "{}", bench.state().speed_mps);
    assert_eq!(bench.faults("vehicle").0, 0, "silence is no bad input");
}

#[test]
fn a_start_in_an_object_is_a_fault() {
    let world = WORLD.replace("at = [12, 15.2]", "at = [5, 10]");
    let bench = Bench::start(STACK, &Files { world, ..Files::default() }, &quiet());
    let told = "start: the vehicle stands in an object of kind tree, expected a free place".to_owned();
    assert_eq!(bench.faults("vehicle"), (1, told));
}

/// Drives, sends one invalid command, and returns its fault.
fn refused(send: impl FnOnce(&mut Bench)) -> (Bench, String) {
    let mut bench = Bench::start(STACK, &Files::default(), &quiet());
    bench.drive(0.8, 0.8, 1500);
    send(&mut bench);
    bench.advance(10);
    let (faults, last) = bench.faults("vehicle");
    assert_eq!(faults, 1, "{last}");
    (bench, last)
}

#[test]
fn a_command_that_is_not_a_number_is_refused_and_counted_and_the_vehicle_brakes() {
    for [left, right] in [[f64::NAN, 0.5], [0.5, f64::INFINITY]] {
        let (mut bench, why) = refused(|bench| bench.command(left, right));
        assert!(why.contains("expected finite"), "{why}");
        bench.advance(100);
        assert!(bench.state().speed_mps < 0.6, "it brakes at once: {}", bench.state().speed_mps);
        bench.advance(1000);
        assert!(bench.state().speed_mps.abs() < 1e-3);
    }
}

#[test]
fn ten_metres_a_second_are_refused_and_counted_and_the_vehicle_brakes() {
    let (mut bench, why) = refused(|bench| bench.command(10.0, 10.0));
    assert!(why.contains("wheel at 10 m/s, expected at most 1.8 m/s"), "{why}");
    bench.advance(1000);
    assert!(bench.state().speed_mps.abs() < 1e-3);
    bench.drive(0.5, 0.5, 1000);
    assert!((bench.state().speed_mps - 0.5).abs() < 0.05, "a sound command is obeyed again");
}

#[test]
fn commands_from_the_past_are_refused_and_counted_and_change_nothing() {
    let (bench, why) = refused(|bench| bench.command_of(bench.now_ms as f64 - 300.0, -1.0, -1.0));
    assert!(why.contains("old, expected at most 0.2 s"), "{why}");
    assert!(bench.state().speed_mps > 0.7);
    let (bench, why) = refused(|bench| bench.command_of(bench.now_ms as f64 - 100.0, -1.0, -1.0));
    assert!(why.contains("older than the one before"), "{why}");
    assert!(bench.state().speed_mps > 0.7);
    let (_, why) = refused(|bench| bench.command_of(bench.now_ms as f64 + 500.0, 1.0, 1.0));
    assert!(why.contains("ahead"), "{why}");
}

#[test]
fn a_run_of_a_course_is_counted_until_the_goal_is_reached() {
    let mut bench = Bench::start(STACK, &Files::default(), &quiet());
    let goal: PoseInFrame = bench.latest("/vehicle/goal");
    let place = goal.pose.unwrap().position.unwrap();
    assert!((place.x - 15.0).abs() < 1e-9 && (place.y - 10.0).abs() < 1e-9 && goal.frame_id == "global");
    bench.drive(1.0, 1.0, 5000);
    let run: rcs::CourseRun = bench.latest("/vehicle/run");
    assert_eq!((run.outcome(), run.course.as_str()), (CourseOutcome::CourseRunning, "yard"));
    assert!((run.distance_m + run.remaining_m - 10.0).abs() < 0.2, "{run:?}");
    bench.drive(1.0, 1.0, 6000);
    let run: rcs::CourseRun = bench.latest("/vehicle/run");
    assert_eq!(run.outcome(), CourseOutcome::CourseReached, "{run:?}");
    assert_eq!((run.collisions, run.bumper_hits), (0, 0));
    assert!((9.0..10.5).contains(&run.time_s), "{run:?}");
}

#[test]
fn every_sensor_is_sent_at_its_rate() {
    let mut bench = Bench::start(STACK, &Files::default(), &[("vehicle.gps_dropouts", "false")]);
    bench.advance(2000);
    let count = |buffer: &str| bench.sent(buffer);
    for (buffer, expected) in [
        ("encoders", 101),
        ("imu", 201),
        ("motors", 41),
        ("bumper", 41),
        ("infrared", 21),
        ("gps", 9),
        ("static_transforms", 3),
        ("goal", 3),
        ("run", 11),
        ("ground_truth_state", 201),
        ("ground_truth_pose", 201),
        ("ground_truth_map", 1),
        ("ground_truth_objects", 1),
        ("ground_speed", 0),
        ("steering", 0),
    ] {
        assert_eq!(count(&format!("/vehicle/{buffer}")), expected, "{buffer}");
    }
    // The eleventh image is being rendered: the camera sends it 40 ms later.
    for buffer in [
        "left",
        "right",
        "left_calibration",
        "right_calibration",
        "ground_truth_depth",
        "ground_truth_labels",
    ] {
        assert_eq!(count(&format!("/front_left/{buffer}")), 10, "{buffer}");
    }
    let transforms: FrameTransforms = bench.latest("/vehicle/static_transforms");
    let names: Vec<&str> = transforms.transforms.iter().map(|t| t.child_frame_id.as_str()).collect();
    assert_eq!(
        names,
        [
            "imu",
            "gps",
            "infrared_left",
            "infrared_right",
            "front_left_left_camera",
            "front_left_right_camera",
            "front_right_left_camera",
            "front_right_right_camera"
        ]
    );
}

#[test]
fn the_encoders_tell_the_speed_since_their_last_reading_also_where_readings_are_not_evenly_spaced() {
    let mut files = Files::default();
    files.vehicle = files.vehicle.replacen("[encoders]\nrate_hz = 50.0", "[encoders]\nrate_hz = 30.0", 1);
    assert_ne!(files.vehicle, common::LAGR);
    let slow = STACK.replacen("supervisor =", "period_ms = 20.0\nsupervisor =", 1);
    let exact = [("front_left.ground_truth", "false"), ("vehicle.sensor_noise", "false")];
    // A reading every 3 or 4 steps of 10 ms, and every 1 or 2 periods of 20 ms.
    for stack in [STACK, slow.as_str()] {
        let mut bench = Bench::start(stack, &files, &exact);
        bench.drive(1.0, 1.0, 2000);
        for _ in 0..20 {
            bench.command(1.0, 1.0);
            bench.advance(20);
            let reading: rcs::WheelEncoders = bench.latest("/vehicle/encoders");
            for speed_mps in [reading.left_mps, reading.right_mps] {
                // A tick of 0.5 mm in 20 ms.
                assert!((speed_mps - 1.0).abs() < 0.026, "{speed_mps}");
            }
        }
    }
}

#[test]
fn the_status_says_why_a_camera_takes_fewer_images_than_asked_for() {
    let status_of = |files: &Files, rate_hz: &str| {
        let params = [("front_left.ground_truth", "false"), ("front_left.rate_hz", rate_hz)];
        let mut bench = Bench::start(STACK, files, &params);
        bench.advance(200);
        bench.latest::<rcs::Status>("/front_left/status").state_text
    };
    let mut files = Files::default();
    assert_eq!(status_of(&files, "20"), "takes images");
    assert_eq!(status_of(&files, "30"), "takes images: 20 of 30 per s, the period is 50 ms");
    files.vehicle = files.vehicle.replacen("ground_truth_hz = 100.0", "ground_truth_hz = 5.0", 1);
    let few = status_of(&files, "10");
    assert!(few.ends_with(": 5 of 10 per s, ground_truth_hz is 5"), "{few}");
}

#[test]
fn the_true_map_is_the_world() {
    let bench = Bench::start(STACK, &Files::default(), &quiet());
    let grid: Grid = bench.latest("/vehicle/ground_truth_map");
    let view = GridView::new(&grid).unwrap();
    assert_eq!((view.columns(), view.rows()), (200, 150));
    let world = rcs_scene::World::from_toml(WORLD).unwrap();
    let (height, class) = (view.field("height").unwrap(), view.field("class").unwrap());
    let cover = view.field("vegetation").unwrap();
    for (column, row) in [(0, 0), (60, 76), (110, 115), (199, 149)] {
        let truth = world.truth_cell(column, row).unwrap();
        assert!((height.get(column, row).unwrap() - truth.ground_height_m).abs() < 1e-6);
        assert!((cover.get(column, row).unwrap() - truth.cover_height_m).abs() < 1e-6);
        assert_eq!(class.get(column, row), Some(f64::from(truth.class.code())));
    }
    let things: rcs::GroundTruthObjects = bench.latest("/vehicle/ground_truth_objects");
    let kinds: Vec<&str> = things.things.iter().map(|thing| thing.kind.as_str()).collect();
    assert_eq!(kinds, ["tree", "boulder", "person"]);
}

#[test]
fn positions_are_on_the_earth_where_the_world_lies() {
    let exact = [
        ("vehicle.gps_noise", "false"),
        ("vehicle.gps_outliers", "false"),
        ("vehicle.gps_dropouts", "false"),
    ];
    let bench = Bench::start(STACK, &Files::default(), &exact);
    let fix: LocationFix = bench.latest("/vehicle/gps");
    let place = rcs_geom::Geodetic::new(fix.latitude, fix.longitude, fix.altitude).unwrap();
    let utm = rcs_geom::Utm::from_geodetic(&place).unwrap();
    // The antenna is above the start, which is slightly inclined.
    assert!((utm.easting_m - 500_005.0).abs() < 0.2 && (utm.northing_m - 5_400_010.0).abs() < 0.2, "{utm:?}");
    assert_eq!(fix.position_covariance[0], 1.5 * 1.5);
    let off = Bench::start(STACK, &Files::default(), &[("vehicle.gps_off", "true")]);
    assert!(off.session.run().bus().get("/vehicle/gps").unwrap().latest().is_none());
}

#[test]
fn pictures_have_the_size_of_the_vehicle_file_or_of_the_parameters() {
    let mut bench = Bench::start(STACK, &Files::default(), &[]);
    bench.advance(50);
    let image: RawImage = bench.latest("/front_left/left");
    assert_eq!((image.width, image.height, image.step, image.encoding.as_str()), (320, 240, 960, "rgb8"));
    assert_eq!(image.frame_id, "front_left_left_camera");
    let calibration: CameraCalibration = bench.latest("/front_left/right_calibration");
    assert!((calibration.p[3] / calibration.p[0] + 0.12).abs() < 1e-12, "baseline 0.12 m");

    let mut bench = Bench::start(
        STACK,
        &Files::default(),
        &[("front_left.width_px", "640"), ("front_left.distortion", "false")],
    );
    bench.advance(50);
    let image: RawImage = bench.latest("/front_left/left");
    let large: CameraCalibration = bench.latest("/front_left/left_calibration");
    assert_eq!((image.width, image.height), (640, 480));
    assert!((large.k[0] / calibration.k[0] - 2.0).abs() < 1e-12);
    assert_eq!(large.d, [0.0; 5]);
}

/// Hash of all messages of a run that drives by itself.
fn driven(threads: usize, snapshot_ms: Option<u64>) -> Option<String> {
    let mut bench = Bench::with_threads(STACK, &Files::default(), &[], threads);
    let steps = [(0.5, 0.9, 500), (1.2, 1.2, 400), (-0.4, 0.4, 200), (1.3, 1.3, 300)];
    for (left, right, ms) in steps {
        bench.drive(left, right, ms);
    }
    if let Some(ms) = snapshot_ms {
        // Back and forward again: the session restores a snapshot and repeats the operator's writes.
        bench.session.go_to_time(rcs_msg::Stamp(ms * 1_000_000), &Task::default()).unwrap();
        let end = rcs_msg::Stamp(bench.now_ms * 1_000_000 + 5_000_000);
        bench.session.forward_until(end, &Task::default()).unwrap();
    }
    bench.session.run().summary().hash.map(|hash| format!("{hash:?}"))
}

#[test]
fn two_runs_two_threads_and_a_run_from_a_snapshot_give_the_same_bits() {
    let once = driven(1, None);
    assert!(once.is_some());
    assert_eq!(driven(1, None), once, "again");
    assert_eq!(driven(2, None), once, "two threads");
    assert_eq!(driven(1, Some(800)), once, "from a snapshot");
}

#[test]
fn a_run_goes_on_from_a_snapshot_on_disk_with_the_same_bits() {
    let run = || {
        let options = RunOptions { hash: true, ..RunOptions::default() };
        let mut run = Stepped::new(plan(STACK, &Files::default(), &[]).unwrap(), None, options).unwrap();
        run.begin().unwrap();
        run
    };
    let at = |ms: u64| rcs_msg::Stamp(ms * 1_000_000 + 5_000_000);
    let mut whole = run();
    whole.run_until(at(900)).unwrap();
    let mut first = run();
    first.run_until(at(470)).unwrap();
    let bytes = first.snapshot().to_bytes().unwrap();
    let mut second = run();
    second.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
    second.run_until(at(900)).unwrap();
    assert_eq!(second.summary().hash, whole.summary().hash);
}

#[test]
fn a_sensor_with_the_frame_of_another_one_is_refused_with_its_line() {
    let refused = |text: &str, from: &str, to: &str| {
        let changed = text.replacen(from, to, 1);
        let line = 1 + changed.lines().position(|line| line == to).unwrap();
        let error = VehicleSpec::from_toml(&changed).unwrap_err();
        assert_eq!(error.line, line, "{error}");
        error.reason
    };
    let taken = |sensor: &str, frame: &str| {
        format!("{sensor} has the frame {frame:?}, which is taken, expected another name")
    };
    let (first, second) = ("name = \"ladar_roof\"", "name = \"ladar_bumper\"");
    assert_eq!(refused(common::TRACTOR, first, "name = \"gps\""), taken("ladar", "gps"));
    assert_eq!(
        refused(common::TRACTOR, second, "name = \"stereo_left_camera\""),
        taken("ladar", "stereo_left_camera")
    );
    let ladar = common::TRACTOR.split_once("[[ladar]]\n").unwrap().1.split_once("[[ladar]]").unwrap().0;
    let both = format!("{}\n[[ladar]]\n{ladar}", common::LAGR);
    assert!(VehicleSpec::from_toml(&both).is_ok());
    let renamed = both.replacen("name = \"infrared_right\"", "name = \"front\"", 1);
    assert_eq!(refused(&renamed, first, "name = \"front\" # ladar"), taken("ladar", "front"));
}

/// Expects that files with one change are refused with this text.
fn check(change: impl FnOnce(&mut Files), expected: &str) {
    let mut files = Files::default();
    change(&mut files);
    let error = plan(STACK, &files, &[]).expect_err("it was not refused");
    assert!(error.contains(expected), "got {error:?}, expected {expected:?}");
}

#[test]
fn bad_files_are_refused_with_their_line_and_reason() {
    let line_of = |text: &str, part: &str| 1 + text.lines().position(|line| line.contains(part)).unwrap();
    let vehicle = common::LAGR;
    let at = |part: &str| format!("vehicles/lagr.toml:{}", line_of(vehicle, part));
    let swap = |from: &'static str, to: &'static str| {
        move |files: &mut Files| {
            assert!(files.vehicle.contains(from));
            files.vehicle = files.vehicle.replacen(from, to, 1);
        }
    };
    check(swap("mass_kg = 90.0", "mass_kg = -1.0"), &at("mass_kg"));
    check(
        swap("mass_kg = 90.0", "mass_kg = -1.0"),
        "body.mass_kg is -1.0, expected a number from 1 to 50000",
    );
    check(swap("mass_kg = 90.0", "mass_kg = nan"), "body.mass_kg is nan");
    check(swap("track_m = 0.58", "trakc_m = 0.58"), "wheels.track_m is missing");
    check(swap("noise_a = 0.15", "noise_a = 0.15\ncolour = 1"), "motors.colour is unknown");
    check(
        swap("name = \"front_right\"", "name = \"front_left\""),
        "camera has the name \"front_left\" twice",
    );
    check(swap("kind = \"stereo\"", "kind = \"fish\""), "camera.kind is \"fish\", expected one of stereo");
    check(swap("distortion = [-0.16, ", "distortion = [-9.0, "), "has no ray for the pixel");
    check(swap("[gps]", "[gps"), "vehicles/lagr.toml:");
    check(
        |files| files.vehicle.clear(),
        "vehicles/lagr.toml:1: got no text, expected that of a vehicle file",
    );
    check(
        |files| files.world = WORLD.replace("dirt", "dust"),
        &format!("worlds/yard.toml:{}", line_of(WORLD, "base")),
    );
    check(
        |files| files.course = COURSE.replace("goal_radius_m = 1.0", "goal_radius_m = -1.0"),
        "courses/yard.toml:8",
    );
    let goal_line = line_of(COURSE, "goal = {");
    check(
        |files| files.course = COURSE.replace("easting = 500015.0", "easting = 500500.0"),
        &format!("courses/yard.toml:{goal_line}: goal is at [500, 10] m, expected a place in the world"),
    );
    check(
        |files| files.course = COURSE.replace("goal = {", "goal = { zone = 17,"),
        &format!("courses/yard.toml:{goal_line}: goal is in zone 17, expected the world's zone 32"),
    );
    // A course without a vehicle, and a world that is taken for a course.
    let vehicle_line = COURSE.lines().find(|line| line.starts_with("vehicle")).unwrap();
    check(
        |files| files.course = COURSE.replace(vehicle_line, ""),
        "courses/yard.toml: key \"vehicle\" is missing, expected the name of a vehicle",
    );
    check(
        |files| files.course = format!("format = 1{WORLD}"),
        "is missing, expected the name of a world or the path of its file",
    );
    let error = plan(STACK, &Files::default(), &[("front_left.pair", "middle")]).unwrap_err();
    assert!(error.contains("expected a camera of the vehicle: front_left, front_right"), "{error}");
}
