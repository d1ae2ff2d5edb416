//! The process on hand-made messages: unusable ones are reported and skipped without output, and the next usable ones
//! are processed; runs repeat bit for bit with any number of threads and from a snapshot.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_msg::foxglove::{CameraCalibration, PointCloud, RawImage};
use rcs_msg::rcs::Command;
use rcs_msg::{AnyMessage, Payload, Stamp, schema_of};
use rcs_runtime::source::Task;
use rcs_runtime::{ExternalEvent, ProcessType, RunOptions, Session, Snapshot, Stepped};
use rcs_stereo::Stereo;
use rcs_testkit::bench::{self, Setup, newest};
use rcs_testkit::logs::hand_made;

const STACK: &str = r#"
format = 1
name = "hand_made"
input = [
    { buffer = "/left", topic = "/left" },
    { buffer = "/right", topic = "/right" },
    { buffer = "/left_calibration", topic = "/left_calibration" },
    { buffer = "/right_calibration", topic = "/right_calibration" },
]

[[process]]
name = "stereo"
plugin = "stereo"
supervisor = "viewer"
period_ms = 20.0
params = { disparities = 32, max_wait_ms = 150.0 }

[process.inputs]
left = "/left"
right = "/right"
left_calibration = "/left_calibration"
right_calibration = "/right_calibration"

[buffers."/left"]
queue = 4

[buffers."/right"]
queue = 4
"#;

const PROCESSES: &[ProcessType] = &[ProcessType::of::<Stereo>()];
const TOPICS: [&str; 4] = ["/left", "/right", "/left_calibration", "/right_calibration"];
const OUTPUTS: [&str; 6] = ["rectified", "calibration", "disparity", "depth", "points", "stats"];
const SIZE: [usize; 2] = [96, 64];
const F_PX: f64 = 80.0;
const BASELINE_M: f64 = 0.25;
/// Disparity of everything in the pair; its range is 80 px · 0.25 m / 10 px.
const SHIFT_PX: usize = 10;
const DEPTH_M: f32 = 2.0;

/// A message and its arrival time, ms.
struct Given {
    at_ms: u64,
    topic: &'static str,
    message: AnyMessage,
}

fn texture(x: usize, y: usize, seed: u32) -> u8 {
    let mut h = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ seed;
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    20 + ((h >> 24) as u8) / 2
}

fn raw_image([width, height]: [usize; 2], data: Vec<u8>) -> RawImage {
    RawImage {
        frame_id: "camera".to_owned(),
        width: width as u32,
        height: height as u32,
        encoding: "mono8".to_owned(),
        step: width as u32,
        data: data.into(),
        ..RawImage::default()
    }
}

/// One camera's image of a wall; each seed gives another wall.
fn camera(topic: &str, seed: u32) -> RawImage {
    let shift = if topic == "/right" { SHIFT_PX } else { 0 };
    let data = (0..SIZE[0] * SIZE[1]).map(|i| texture(i % SIZE[0] + shift, i / SIZE[0], seed)).collect();
    raw_image(SIZE, data)
}

fn calibration(topic: &str) -> CameraCalibration {
    let tx = if topic == "/right_calibration" { -F_PX * BASELINE_M } else { 0.0 };
    let (cx, cy) = ((SIZE[0] - 1) as f64 / 2.0, (SIZE[1] - 1) as f64 / 2.0);
    CameraCalibration {
        frame_id: "camera".to_owned(),
        width: SIZE[0] as u32,
        height: SIZE[1] as u32,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: vec![F_PX, 0.0, cx, 0.0, F_PX, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![F_PX, 0.0, cx, tx, 0.0, F_PX, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraCalibration::default()
    }
}

fn give<T: Payload>(at_ms: u64, topic: &'static str, value: T) -> Given {
    Given { at_ms, topic, message: AnyMessage::new(value) }
}

fn calibrated() -> Vec<Given> {
    ["/left_calibration", "/right_calibration"].map(|topic| give(0, topic, calibration(topic))).into()
}

/// Usable images of both cameras.
fn pair(at_ms: u64) -> [Given; 2] {
    let seed = at_ms as u32;
    [give(at_ms, "/left", camera("/left", seed)), give(at_ms, "/right", camera("/right", seed))]
}

fn run(given: &[Given], threads: usize, params: &[(&str, &str)]) -> Stepped {
    let topics = TOPICS.map(|topic| {
        let is_image = ["/left", "/right"].contains(&topic);
        (topic, if is_image { schema_of::<RawImage>() } else { schema_of::<CameraCalibration>() })
    });
    let timed =
        given.iter().map(|given| (Stamp((1_000 + given.at_ms) * 1_000_000), given.topic, &given.message));
    let options = RunOptions { threads, ..RunOptions::default() };
    let setup = Setup::new(STACK, PROCESSES).params(params).options(options);
    setup.stepped(Some(&hand_made(&topics, timed)))
}

fn run_until(run: &mut Stepped, ms: u64) {
    run.run_until(Stamp((1_000 + ms) * 1_000_000)).unwrap();
}

fn latest<T: Payload>(run: &Stepped, port: &str) -> Option<T> {
    newest(run, &format!("/stereo/{port}"))
}

fn faults(run: &Stepped) -> (u64, String) {
    bench::faults(run, "stereo")
}

/// Number of messages sent on each output.
fn sent(run: &Stepped) -> [u64; 6] {
    OUTPUTS.map(|port| bench::sent(run, &format!("/stereo/{port}")))
}

/// Gives unusable input and, a second later, a usable pair: expects one fault with this text, no output for it, and
/// that the pair is used.
fn check(bad: Vec<Given>, params: &[(&str, &str)], expected: &str) {
    check_count(bad, params, expected, 1);
}

fn check_count(bad: Vec<Given>, params: &[(&str, &str)], expected: &str, count: u64) {
    let mut given = calibrated();
    given.extend(pair(100));
    given.extend(bad);
    given.extend(
        ["/left_calibration", "/right_calibration"].map(|topic| give(900, topic, calibration(topic))),
    );
    given.extend(pair(1000));
    // The last message ends the log: give the process time to read the one before.
    given.push(give(1200, "/left_calibration", calibration("/left_calibration")));
    let mut run = run(&given, 1, params);
    run_until(&mut run, 150);
    assert_eq!((faults(&run).0, sent(&run)), (0, [1; 6]), "before: {}", faults(&run).1);
    run_until(&mut run, 850);
    let (found, last) = faults(&run);
    assert_eq!(found, count, "{last}");
    assert!(last.contains(expected), "got {last:?}, expected {expected:?}");
    assert_eq!(sent(&run), [1; 6], "nothing goes out for bad input");
    run_until(&mut run, 1150);
    assert_eq!((faults(&run).0, sent(&run)), (count, [2; 6]), "after: {}", faults(&run).1);
    let stats: rcs_stereo::proto::StereoStats = latest(&run, "stats").unwrap();
    assert_eq!((stats.timestamp.unwrap().seconds, stats.pairs), (2, 2));
}

#[test]
fn a_wall_is_seen_at_its_range_with_colour_and_pixel() {
    let mut given = calibrated();
    given.extend(pair(100));
    let mut run = run(&given, 1, &[]);
    run_until(&mut run, 200);
    assert_eq!(faults(&run), (0, String::new()));
    let depth: RawImage = latest(&run, "depth").unwrap();
    assert_eq!((depth.frame_id.as_str(), depth.encoding.as_str(), depth.step), ("camera", "32FC1", 384));
    let depth = rcs_msg::image::depth_m(&depth, 1.0).unwrap();
    let known: Vec<f32> = depth.iter().copied().filter(|d| !d.is_nan()).collect();
    let right = known.iter().filter(|&&d| (d - DEPTH_M).abs() < 0.02).count();
    assert!(right * 10 > known.len() * 9 && right > 3000, "{right} of {}", known.len());
    let disparity: RawImage = latest(&run, "disparity").unwrap();
    let disparity: Vec<f32> =
        disparity.data.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    for (depth, disparity) in depth.iter().zip(&disparity) {
        assert_eq!(depth.is_nan(), disparity.is_nan());
        assert!(depth.is_nan() || (depth * disparity - 20.0).abs() < 1e-3, "{depth} {disparity}");
    }
    let cloud: PointCloud = latest(&run, "points").unwrap();
    assert_eq!(cloud.data.len(), known.len() * 20);
    let rectified: RawImage = latest(&run, "rectified").unwrap();
    for (point, bytes) in rcs_msg::points(&cloud).unwrap().iter().zip(cloud.data.chunks_exact(20)) {
        let [u, v] = [16, 18].map(|at| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]])));
        let z = depth[v * SIZE[0] + u];
        assert!((point.position.z as f32 - z).abs() < 1e-6);
        assert!((point.position.x - (u as f64 - 47.5) / F_PX * f64::from(z)).abs() < 1e-5);
        assert_eq!(point.rgb.unwrap()[..], rectified.data[(v * SIZE[0] + u) * 3..][..3]);
    }
    let stats: rcs_stereo::proto::StereoStats = latest(&run, "stats").unwrap();
    assert_eq!((stats.pixels, stats.matched), (96 * 64, known.len() as u64));
    let calibration: CameraCalibration = latest(&run, "calibration").unwrap();
    assert_eq!((calibration.k[0], calibration.p[3], calibration.width), (F_PX, 0.0, 96));
}

#[test]
fn an_image_of_another_size_than_its_calibration_is_skipped() {
    let small = raw_image([48, 64], (0..48 * 64).map(|i| texture(i, 1, 1)).collect());
    let bad = vec![give(300, "/left", small), give(300, "/right", camera("/right", 3))];
    check(bad, &[], "left image has [48, 64] pixels, its calibration is for [96, 64]");
}

#[test]
fn black_and_saturated_images_are_skipped_and_their_other_camera_without_another_word() {
    for (level, expected) in [(0, "image is 100 % black"), (255, "100 % saturated")] {
        let blind = raw_image(SIZE, vec![level; SIZE[0] * SIZE[1]]);
        let bad = vec![give(300, "/left", camera("/left", 3)), give(300, "/right", blind)];
        check(bad, &[], expected);
    }
}

#[test]
fn an_image_that_does_not_decode_is_skipped() {
    let cut = RawImage { data: vec![1; 100].into(), ..camera("/left", 1) };
    check(vec![give(300, "/left", cut), give(300, "/right", camera("/right", 3))], &[], "left image of");
    let strange = RawImage { encoding: "h264".to_owned(), ..camera("/left", 1) };
    check(vec![give(300, "/left", strange), give(300, "/right", camera("/right", 3))], &[], "h264");
}

#[test]
fn depth_is_refused_as_the_image_of_a_camera() {
    let grey = camera("/left", 3);
    let data: Vec<u8> = grey.data.iter().flat_map(|&level| [0, level]).collect();
    let depth = RawImage { encoding: "16UC1".to_owned(), step: 2 * grey.step, data: data.into(), ..grey };
    let bad = vec![give(300, "/left", depth), give(300, "/right", camera("/right", 3))];
    check(bad, &[], "encoding \"16UC1\" is depth, expected that of a camera");
}

#[test]
fn a_frozen_camera_is_reported_for_every_image_and_nothing_stale_goes_out() {
    // The left camera repeats the image of 100 ms under new timestamps.
    let frozen = |at_ms| {
        [give(at_ms, "/left", camera("/left", 100)), give(at_ms, "/right", camera("/right", at_ms as u32))]
    };
    let bad = [300, 400, 500].into_iter().flat_map(frozen).collect();
    check_count(bad, &[], "the camera is frozen", 3);
}

#[test]
fn a_missing_camera_is_named() {
    check(vec![give(300, "/left", camera("/left", 3))], &[], "right image of");
    let bad = vec![give(300, "/right", camera("/right", 3))];
    check(bad, &[], "left image of");
}

#[test]
fn a_late_camera_is_given_up_and_what_comes_of_it_then_is_no_pair() {
    // Taken 20 ms after the left camera's: too far apart to be a pair.
    let bad = vec![give(300, "/left", camera("/left", 3)), give(320, "/right", camera("/right", 3))];
    check_count(bad, &[], "is late by more than 150 ms", 2);
}

#[test]
fn more_disparities_than_columns_are_reported() {
    let mut given = calibrated();
    given.extend(pair(100));
    let mut run = run(&given, 1, &[("stereo.disparities", "112")]);
    run_until(&mut run, 150);
    let (count, last) = faults(&run);
    assert_eq!((count, sent(&run)), (1, [0; 6]));
    assert!(last.contains("112 disparities do not fit into an image of 96 columns"), "{last}");
}

#[test]
fn calibrations_that_are_not_a_pairs_are_reported_with_each_pair() {
    let sheared = vec![1.0, 0.2, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let right = calibration("/right_calibration");
    let cases = [
        (CameraCalibration { r: sheared, ..right.clone() }, "is not a rotation"),
        (CameraCalibration { p: calibration("/left_calibration").p, ..right.clone() }, "baseline is"),
        (CameraCalibration { r: Vec::new(), ..right.clone() }, "rectification matrix has 0 entries"),
    ];
    for (bad, expected) in cases {
        let mut given = vec![give(200, "/right_calibration", bad)];
        given.extend(pair(300));
        check(given, &[], expected);
    }
    // A calibration that no camera can have is reported on arrival, and so is the pair that lacks a usable one.
    let mut given =
        vec![give(200, "/right_calibration", CameraCalibration { k: vec![f64::NAN; 9], ..right })];
    given.extend(pair(300));
    check_count(given, &[], "no usable calibration of the right camera", 2);
}

#[test]
fn without_calibrations_pairs_are_skipped() {
    let mut run = run(&pair(100), 1, &[]);
    run_until(&mut run, 150);
    assert_eq!(sent(&run), [0; 6]);
    assert!(faults(&run).1.contains("no usable calibration of the left camera"));
}

#[test]
fn after_init_the_calibrations_that_were_sent_once_are_still_known() {
    let mut given = calibrated();
    given.extend([100, 300, 500, 700, 900].into_iter().flat_map(pair));
    let mut session = Session::new(run(&given, 1, &[])).unwrap();
    let go = |session: &mut Session, at_ms: u64| {
        session.forward_until(Stamp((1_000 + at_ms) * 1_000_000), &Task::default()).unwrap();
    };
    let command = |session: &mut Session, serial: u64, name: &str| {
        let command = Command { serial, name: name.to_owned(), ..Command::default() };
        session.write(ExternalEvent::operator("/stereo/command", AnyMessage::new(command))).unwrap();
    };
    go(&mut session, 400);
    assert_eq!((faults(session.run()).0, sent(session.run())), (0, [2; 6]));
    command(&mut session, 2, "INIT");
    go(&mut session, 440);
    command(&mut session, 3, "RUN");
    go(&mut session, 850);
    assert_eq!((faults(session.run()).0, sent(session.run())), (0, [4; 6]), "{}", faults(session.run()).1);
}

#[test]
fn a_pair_in_which_nothing_has_a_range_is_sent_without_ranges_and_reported() {
    let grey = |at_ms: u64| raw_image(SIZE, vec![100 + (at_ms % 7) as u8; SIZE[0] * SIZE[1]]);
    let mut given = calibrated();
    given.extend([give(300, "/left", grey(1)), give(300, "/right", grey(2))]);
    let mut run = run(&given, 1, &[]);
    run_until(&mut run, 350);
    let (count, last) = faults(&run);
    assert!(count == 1 && last.contains("none of 6144 pixels has a range"), "{count}: {last}");
    assert_eq!(sent(&run), [1; 6], "whoever stands without recent ranges sees that the cameras send");
    let depth: RawImage = latest(&run, "depth").unwrap();
    let depth_m = depth.data.chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()));
    assert!(depth_m.into_iter().all(f32::is_nan));
    let stats: rcs_stereo::proto::StereoStats = latest(&run, "stats").unwrap();
    assert_eq!((stats.matched, stats.min_range_m, stats.max_range_m), (0, 0.0, 0.0));
}

#[test]
fn a_recording_in_which_the_clock_of_the_cameras_begins_again_is_matched_on() {
    let mut given = calibrated();
    for (at_ms, stamp_ms) in [(20_000, 21_000), (20_200, 1_000), (20_400, 1_200), (20_600, 1_400)] {
        given.extend(["/left", "/right"].map(|topic| {
            let timestamp = Some(Stamp(stamp_ms * 1_000_000).to_proto());
            give(at_ms, topic, RawImage { timestamp, ..camera(topic, at_ms as u32) })
        }));
    }
    given.push(give(21_000, "/left_calibration", calibration("/left_calibration")));
    let mut run = run(&given, 1, &[]);
    run_until(&mut run, 20_900);
    let stats: rcs_stereo::proto::StereoStats = latest(&run, "stats").unwrap();
    assert_eq!((stats.timestamp.unwrap().seconds, stats.pairs, stats.unpaired), (1, 3, 2));
    let (count, last) = faults(&run);
    let expected = "the clock of the right camera has begun again; 0 waiting images dropped";
    assert_eq!((count, last.as_str()), (4, expected), "of the new clock, the first images are refused");
}

#[test]
fn parameters_that_no_matcher_has_are_refused_before_anything_runs() {
    for (name, value, expected) in [
        ("stereo.disparities", "40", "multiple of 16"),
        ("stereo.block_px", "8", "odd number"),
        ("stereo.min_range_m", "99.5", "expected at most max_range_m"),
    ] {
        let params = [(name, value), ("stereo.max_range_m", "50")];
        let error = Setup::new(STACK, PROCESSES).params(&params).plan().unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

/// The last messages of all outputs of a run.
fn outcome(run: &Stepped) -> Vec<Vec<u8>> {
    OUTPUTS
        .map(|port| {
            run.bus().get(&format!("/stereo/{port}")).unwrap().latest().unwrap().message.bytes().to_vec()
        })
        .into()
}

#[test]
fn any_number_of_threads_and_a_run_from_a_snapshot_give_the_same_bytes() {
    for method in ["STEREO_BM", "STEREO_SGM"] {
        let mut given = calibrated();
        given.extend([100, 200, 300].into_iter().flat_map(pair));
        let params = [("stereo.method", method)];
        let mut alone = run(&given, 1, &params);
        // Snapshot between the two images of a pair; between two pairs the state is only calibrations and counts.
        run_until(&mut alone, 250);
        let saved = Snapshot::from_bytes(&alone.snapshot().to_bytes().unwrap()).unwrap();
        run_until(&mut alone, 400);
        let expected = outcome(&alone);
        let mut threaded = run(&given, 3, &params);
        run_until(&mut threaded, 400);
        assert_eq!(outcome(&threaded), expected, "{method}");
        let mut restored = run(&given, 1, &params);
        restored.restore(&saved).unwrap();
        run_until(&mut restored, 400);
        assert_eq!(outcome(&restored), expected, "{method}");
        assert_eq!(faults(&restored).0, 0);
    }
}

#[test]
fn an_image_that_waits_is_part_of_the_state() {
    let mut given = calibrated();
    // The right image was taken with the left one and arrives two cycles later, within the allowed difference.
    given.extend([give(100, "/left", camera("/left", 1)), give(145, "/right", camera("/right", 1))]);
    given.push(give(400, "/left_calibration", calibration("/left_calibration")));
    let params = [("stereo.max_time_difference_ms", "50")];
    let mut alone = run(&given, 1, &params);
    run_until(&mut alone, 130);
    assert_eq!(sent(&alone), [0; 6]);
    let saved = Snapshot::from_bytes(&alone.snapshot().to_bytes().unwrap()).unwrap();
    run_until(&mut alone, 300);
    let mut restored = run(&given, 1, &params);
    restored.restore(&saved).unwrap();
    run_until(&mut restored, 300);
    assert_eq!(outcome(&restored), outcome(&alone));
    let stats: rcs_stereo::proto::StereoStats = latest(&restored, "stats").unwrap();
    assert!((stats.right_after_left_ms - 45.0).abs() < 1e-9);
}
