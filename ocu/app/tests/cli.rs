//! The command line of the built program.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{json, keys, ocu, recording, text};
use std::path::Path;

#[test]
fn info_says_what_a_recording_holds() {
    let (_dir, path) = recording();
    let (code, out, errors) = ocu(&["info", text(&path)]);
    assert_eq!((code, errors.as_str()), (0, ""));
    // Path and size depend on the machine and the compressor.
    let stable: Vec<&str> = out.lines().filter(|line| !line.starts_with("file ")).collect();
    insta::assert_snapshot!(stable.join("\n"));
}

#[test]
fn info_as_json_has_exactly_the_agreed_keys() {
    let (_dir, path) = recording();
    let (code, out, _) = ocu(&["info", text(&path), "--json"]);
    assert_eq!(code, 0);
    let report = json(&out);
    assert_eq!(
        keys(&report),
        [
            "duration_s",
            "end_ns",
            "gaps",
            "lost",
            "messages",
            "problems",
            "recovered",
            "segments",
            "start_ns",
            "topics",
            "verified"
        ]
    );
    assert_eq!(keys(&report["lost"]), ["bytes", "messages"]);
    assert_eq!(keys(&report["topics"][0]), ["decodable", "encoding", "hz", "messages", "name", "schema"]);
    assert!(report["start_ns"].as_u64().unwrap() < 100_000_000, "{out}");
    let duration_s = report["duration_s"].as_f64().unwrap();
    assert!((1.9..=2.0).contains(&duration_s), "{out}");
    assert_eq!(report["recovered"], false);
    let topics = report["topics"].as_array().unwrap();
    let total: u64 = topics.iter().map(|topic| topic["messages"].as_u64().unwrap()).sum();
    assert_eq!(report["messages"], total);
    assert!(topics.iter().all(|topic| topic["decodable"] == true), "{out}");
}

#[test]
fn info_of_a_cut_recording_says_that_it_was_recovered_and_is_damaged() {
    let (_dir, path) = recording();
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let (code, out, errors) = ocu(&["info", text(&path), "--json"]);
    assert!(code == 3 && errors.contains("the recording is damaged"), "{code} {errors}");
    assert_eq!(json(&out)["recovered"], true);
    let (_, out, _) = ocu(&["info", text(&path)]);
    assert!(out.contains("recovered"), "{out}");
}

#[test]
fn run_as_json_has_exactly_the_agreed_keys_and_one_hash_for_any_number_of_threads() {
    let (_dir, path) = recording();
    let run = |threads: &str| {
        let (code, out, errors) =
            ocu(&["run", "--stack", "sample", "--log", text(&path), "--threads", threads, "--json"]);
        assert_eq!(code, 0, "{errors}{out}");
        json(&out)
    };
    let (one, two) = (run("1"), run("2"));
    assert_eq!(keys(&one), ["buffers", "hash", "outcome", "processes", "time_s", "wall_s", "warnings"]);
    let process = ["cycles", "faults", "last_fault", "max_us", "mean_us", "name", "overruns", "state"];
    assert_eq!(keys(&one["processes"][0]), process);
    assert_eq!(keys(&one["buffers"][0]), ["bytes", "hash", "messages", "name", "schema"]);
    assert_eq!(one["outcome"], "end");
    assert!(!one["hash"].as_str().unwrap().is_empty());
    assert_eq!(one["hash"], two["hash"]);
}

#[test]
fn run_of_a_course_as_json_has_exactly_the_agreed_keys_for_each_run() {
    let (code, out, errors) =
        ocu(&["run", "--stack", "truth_driver", "--course", "meadow", "--until", "2", "--json"]);
    assert_eq!(code, 0, "{errors}{out}");
    let report = json(&out);
    assert_eq!(report["runs"].as_array().map(Vec::len), Some(1), "{out}");
    let run = &report["runs"][0];
    let expected = [
        "bumper_hits",
        "collisions",
        "distance_m",
        "hash",
        "outcome",
        "remaining_m",
        "seed",
        "slip_s",
        "time_s",
    ];
    assert_eq!(keys(run), expected);
    assert_eq!((&run["outcome"], &run["collisions"]), (&"unfinished".into(), &0.into()), "{run}");
    assert_eq!(run["bumper_hits"], 0);
    assert!((1.0..=2.1).contains(&run["time_s"].as_f64().unwrap()), "{run}");
}

#[test]
fn run_stops_where_it_is_told_and_records_what_it_did() {
    let (dir, path) = recording();
    let out_path = dir.path().join("run.mcap");
    let record = text(&out_path);
    let (code, out, errors) =
        ocu(&["run", "--stack", "sample", "--log", text(&path), "--until", "1", "--record", record]);
    assert_eq!(code, 0, "{errors}{out}");
    assert!(out.starts_with("outcome  end"), "{out}");
    let (code, out, _) = ocu(&["info", record, "--json"]);
    assert_eq!(code, 0);
    let report = json(&out);
    assert_eq!(report["recovered"], false);
    let names: Vec<&str> =
        report["topics"].as_array().unwrap().iter().filter_map(|topic| topic["name"].as_str()).collect();
    assert!(names.contains(&"/runtime/processes"), "{names:?}");
}

#[test]
fn wrong_usage_is_told_from_a_failed_run() {
    let (dir, path) = recording();
    let log = text(&path);
    let absent = dir.path().join("absent.mcap");
    let png = dir.path().join("a.png");
    let render = |layout: &str, at: &str| {
        ocu(&["render", log, "--layout", layout, "--at", at, "--size", "64x64", "-o", text(&png)]).0
    };
    assert_eq!(ocu(&["--nonsense"]).0, 2);
    assert_eq!(ocu(&["info"]).0, 2);
    assert_eq!(ocu(&["run", "--stack", "nonsense", "--log", log]).0, 2);
    assert_eq!(ocu(&["run", "--stack", "sample", "--log", log, "--param", "nobody.x=1"]).0, 2);
    assert_eq!(ocu(&["run", "--stack", "sample", "--log", log, "--param", "x"]).0, 2);
    assert_eq!(ocu(&["run", "--stack", "sample"]).0, 2);
    // What the window would open is refused before there is one.
    for args in
        [&["replay", log][..], &["--course", "nowhere"], &[log, "--stack", "nonsense"], &[text(&absent)]]
    {
        let (code, _, errors) = ocu(args);
        assert!(code == 2 && errors.starts_with("error: "), "{args:?}: {errors}");
    }
    let fitting = dir.path().join("fitting.png");
    let args = ["render", log, "--at", "1", "--size", "320x200", "-o", text(&fitting)];
    assert_eq!(ocu(&args).0, 0, "without a layout, the one that fits");
    assert_eq!(image::open(&fitting).unwrap().width(), 320);
    assert_eq!(render("nonsense", "1"), 2);
    assert_eq!(render("default", "99"), 2);
    assert_eq!(render("default", "NaN"), 2);
    assert!(!png.exists());
}

#[test]
fn errors_name_the_file_and_what_was_expected() {
    let (dir, path) = recording();
    let stack = dir.path().join("mine.toml");
    std::fs::write(&stack, "format = 1\nname = \"mine\"\n[[process]]\nname = \"a\"\nplugin = \"nonsense\"\nsupervisor = \"viewer\"\n")
        .unwrap();
    let (code, _, errors) = ocu(&["run", "--stack", text(&stack), "--log", text(&path)]);
    assert_eq!(code, 2);
    assert!(errors.contains("mine.toml:5") && errors.contains("nonsense"), "{errors}");
    let not_a_log = dir.path().join("text.mcap");
    std::fs::write(&not_a_log, "hello").unwrap();
    let (code, _, errors) = ocu(&["info", text(&not_a_log)]);
    assert_eq!(code, 2);
    assert!(errors.starts_with("error: ") && errors.contains("text.mcap"), "{errors}");
}

#[test]
fn a_file_that_is_named_and_is_empty_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let empty = dir.path().join("empty.json");
    std::fs::write(&empty, "\n").unwrap();
    for param in ["map_memory.memory", "waypoint_generator.route", "waypoint_generator.slips"] {
        let param = format!("{param}={}", text(&empty));
        let (code, _, errors) = ocu(&["run", "--stack", "lagr", "--until", "0.1", "--param", &param]);
        assert_eq!(code, 2, "{errors}");
        assert!(errors.contains("got an empty file: ") && errors.contains("empty.json"), "{errors}");
    }
}

#[test]
fn the_look_of_a_course_is_read_and_not_overwritten_by_a_stack_without_cameras() {
    let dir = tempfile::tempdir().unwrap();
    let (look, course) = (dir.path().join("look.toml"), dir.path().join("course.toml"));
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let asset = |name: &str| std::fs::read_to_string(assets.join(name)).unwrap();
    let content = asset("looks/dry_summer.toml");
    std::fs::write(&look, &content).unwrap();
    std::fs::write(&course, format!("look = \"look.toml\"\n{}", asset("courses/meadow.toml"))).unwrap();
    let save = format!("/vehicle/run={}", text(&look));
    let refused = |part: &str| {
        let run = ["run", "--stack", "truth_driver", "--course", text(&course), "--until", "0.1"];
        let (code, _, errors) = ocu(&[&run[..], &["--force", "--save", &save]].concat());
        assert!(code == 2 && errors.contains(part), "{code} {errors}");
    };
    refused("the file is a file that is read");
    assert_eq!(std::fs::read_to_string(&look).unwrap(), content);
    std::fs::remove_file(&look).unwrap();
    refused("cannot read the look");
}

#[test]
fn every_command_has_help_with_an_example() {
    let (code, out, _) = ocu(&["--help"]);
    assert_eq!(code, 0);
    assert!(out.contains("Examples:") && out.contains("Exit codes"), "{out}");
    for command in ["run", "diff", "info", "latency", "render", "sample", "eval", "plugins", "stack"] {
        let (code, out, _) = ocu(&[command, "--help"]);
        assert_eq!(code, 0);
        assert!(out.contains("Example"), "{out}");
    }
}

/// A stereo pair with a disparity of 6 pixels, and its ground truth in 1/256 pixel.
fn stereo_pair() -> (tempfile::TempDir, [String; 3]) {
    let dir = tempfile::tempdir().unwrap();
    let level = |x: u32, y: u32| {
        let mut h = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77);
        h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
        image::Luma([(h >> 24) as u8])
    };
    let paths = ["left.png", "right.png", "truth.png"].map(|name| text(&dir.path().join(name)).to_owned());
    image::GrayImage::from_fn(96, 48, level).save(&paths[0]).unwrap();
    image::GrayImage::from_fn(96, 48, |x, y| level(x + 6, y)).save(&paths[1]).unwrap();
    let truth = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(96, 48, image::Luma([6 * 256]));
    truth.save(&paths[2]).unwrap();
    (dir, paths)
}

#[test]
fn eval_stereo_measures_a_pair_against_its_truth() {
    let (dir, [left, right, truth]) = stereo_pair();
    for (method, threads) in [("bm", 3), ("sgm", 1)] {
        let args = ["eval", "stereo", "--left", &left, "--right", &right, "--truth", &truth, "--json"];
        let more = ["--disparities", "16", "--threads", "3", "--method", method];
        let (code, out, errors) = ocu(&[&args[..], &more].concat());
        assert_eq!(code, 0, "{errors}");
        let report = json(&out);
        let expected = "bad2_dense_pct bad2_valid_pct density_pct ms_median pixels rms_px threads";
        assert_eq!(keys(&report).join(" "), expected);
        assert!(report["bad2_valid_pct"] == 0.0 && report["pixels"].as_u64() > Some(1000), "{out}");
        assert!(report["density_pct"].as_f64().unwrap() > 90.0, "{out}");
        assert_eq!(report["threads"], threads, "{method}");
    }
    let (code, out, _) = ocu(&["eval", "stereo", "--left", &left, "--right", &right, "--json"]);
    assert_eq!((code, &json(&out)["bad2_valid_pct"]), (0, &serde_json::Value::Null));
    // Cameras of machine vision write PGM.
    let grey = image::open(&left).unwrap().to_luma8();
    let pgm = dir.path().join("left.pgm");
    std::fs::write(&pgm, [&b"P5\n96 48\n255\n"[..], grey.as_raw()].concat()).unwrap();
    let (code, _, errors) =
        ocu(&["eval", "stereo", "--left", text(&pgm), "--right", &right, "--truth", &truth]);
    assert_eq!(code, 0, "{errors}");
}

#[test]
fn eval_stereo_refuses_what_does_not_fit() {
    let (dir, [left, right, truth]) = stereo_pair();
    let small = text(&dir.path().join("small.png")).to_owned();
    image::GrayImage::new(64, 48).save(&small).unwrap();
    let calib = text(&dir.path().join("pair.toml")).to_owned();
    let camera = |r: &str, tx: f64| {
        format!(
            "width = 96\nheight = 48\nk = [80, 0, 47.5, 0, 80, 23.5, 0, 0, 1]\nr = {r}\n\
             p = [80, 0, 47.5, {tx:?}, 0, 80, 23.5, 0, 0, 0, 1, 0]\n"
        )
    };
    let straight = "[1, 0, 0, 0, 1, 0, 0, 0, 1]";
    let write = |r: &str| {
        let text = format!("[left]\n{}[right]\n{}", camera(straight, 0.0), camera(r, -16.0));
        std::fs::write(&calib, text).unwrap();
    };
    let check = |right: &str, more: &[&str], code: i32, expected: &str| {
        let (got, _, errors) = ocu(&[&["eval", "stereo", "--left", &left, "--right", right], more].concat());
        assert_eq!(got, code, "{errors}");
        assert!(errors.contains(expected), "got \"{errors}\", expected \"{expected}\"");
    };
    check(&small, &[], 2, "left image is 96x48 pixels, right image 64x48");
    check(&right, &["--disparities", "112"], 2, "112 disparities do not fit into an image of 96 columns");
    check(&right, &["--disparities", "20"], 2, "expected a multiple of 16");
    check(&right, &["--truth", &left], 2, "expected a grey PNG of 16 bits");
    check(&right, &["--truth", "disparity.tif"], 2, ".pfm, .png or .npz");
    let unknown = text(&dir.path().join("unknown.png")).to_owned();
    image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::new(96, 48).save(&unknown).unwrap();
    check(&right, &["--truth", &unknown], 1, "the truth has no pixel seen by both cameras");
    check(&dir.path().join("none.png").to_string_lossy(), &[], 2, "none.png");
    write("[1, 0.5, 0, 0, 1, 0, 0, 0, 1]");
    check(&right, &["--calib", &calib], 2, "right camera is not a rotation");
    write(straight);
    let args = ["eval", "stereo", "--left", &left, "--right", &right, "--calib", &calib, "--truth", &truth];
    let (code, out, errors) = ocu(&[&args[..], &["--disparities", "16"]].concat());
    assert_eq!(code, 0, "{errors}");
    assert!(out.contains(" pixels seen by both cameras:"), "{out}");
}

#[test]
fn eval_stereo_reaches_its_bars_on_motorcycle() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let path = |name: &str| text(&data.join("stereo").join(name)).to_owned();
    let (left, right) = (path("motorcycle_left.png"), path("motorcycle_right.png"));
    let truth = path("motorcycle_disp.npz");
    for (method, least_density_pct) in [("bm", 85.0), ("sgm", 95.0)] {
        let args = ["eval", "stereo", "--left", &left, "--right", &right, "--truth", &truth];
        let (code, out, errors) = ocu(&[&args[..], &["--method", method, "--json"]].concat());
        assert_eq!(code, 0, "{errors}");
        let report = json(&out);
        assert!(report["bad2_valid_pct"].as_f64().unwrap() <= 3.5, "{method}: {out}");
        assert!(report["density_pct"].as_f64().unwrap() >= least_density_pct, "{method}: {out}");
    }
}

#[test]
fn eval_plan_prints_an_object_of_exactly_the_agreed_keys_in_any_case() {
    let dir = tempfile::tempdir().unwrap();
    let [map, scen] = ["a.map", "a.map.scen"].map(|name| text(&dir.path().join(name)).to_owned());
    std::fs::write(&map, "type octile\nheight 3\nwidth 4\nmap\n..@.\n.T..\nG..S\n").unwrap();
    std::fs::write(&scen, "version 1\n0\ta.map\t4\t3\t0\t0\t3\t0\t6.41421356\n").unwrap();
    let options: [&[&str]; 2] = [&[], &["--json"]];
    for more in options {
        let (code, out, errors) = ocu(&[&["eval", "plan", "--map", &map, "--scen", &scen], more].concat());
        assert_eq!(code, 0, "{errors}");
        // The four that are agreed come first.
        let expected = ["solved", "cost_ratio_max", "ms_median", "ms_max"];
        let expected = [&expected[..], &["scenarios", "cost_ratio_min", "cost_error_max"]].concat();
        let printed = out.lines().filter_map(|line| line.trim().strip_prefix('"')?.split('"').next());
        assert_eq!(printed.collect::<Vec<_>>(), expected, "{out}");
        let report = json(&out);
        assert_eq!((&report["solved"], &report["scenarios"]), (&1.into(), &1.into()), "{out}");
        assert!((report["cost_ratio_max"].as_f64().unwrap() - 1.0).abs() < 1e-6, "{out}");
        assert!(report["ms_max"].as_f64() >= report["ms_median"].as_f64(), "{out}");
    }
    let (code, _, errors) = ocu(&["eval", "plan", "--map", &scen, "--scen", &map]);
    assert!(code == 2 && errors.contains("a.map.scen, line 1"), "{errors}");
}

#[test]
fn eval_plan_names_the_line_of_a_scenario_whose_start_or_goal_is_blocked() {
    let dir = tempfile::tempdir().unwrap();
    let [map, scen] = ["a.map", "a.map.scen"].map(|name| text(&dir.path().join(name)).to_owned());
    std::fs::write(&map, "type octile\nheight 3\nwidth 4\nmap\n..@.\n.T..\nG..S\n").unwrap();
    let lines = ["version 1", "0 m 4 3 0 0 1 0 1", "0 m 4 3 1 1 0 1 1", "0 m 4 3 0 0 2 0 2"];
    std::fs::write(&scen, lines.join("\n")).unwrap();
    let (code, out, errors) = ocu(&["eval", "plan", "--map", &map, "--scen", &scen]);
    assert_eq!((code, &json(&out)["solved"]), (0, &1.into()), "{out}{errors}");
    assert!(errors.contains("a.map.scen, line 3: start (1, 1) is blocked; "), "{errors}");
    assert!(errors.contains("2 of 3 scenarios"), "{errors}");
}

#[test]
fn eval_obstacles_judges_the_maps_of_a_recorded_simulation() {
    let dir = tempfile::tempdir().unwrap();
    let run = text(&dir.path().join("run.mcap")).to_owned();
    let (code, _, errors) =
        ocu(&["run", "--stack", "simulation", "--course", "meadow", "--until", "2", "--record", &run]);
    assert_eq!(code, 0, "{errors}");
    let (code, out, errors) = ocu(&["eval", "obstacles", &run, "--eye-height", "1.5", "--json"]);
    assert_eq!(code, 0, "{errors}");
    let report = json(&out);
    assert_eq!(keys(&report), ["arcs", "driven_m", "layers", "maps", "things", "vehicle"]);
    assert!(report["maps"].as_u64() >= Some(1) && report["vehicle"]["eye_height_m"] == 1.5, "{out}");
    let names: Vec<_> = report["layers"].as_array().unwrap().iter().map(|layer| &layer["name"]).collect();
    assert_eq!(names[..2], ["fused", "stereo"]);
    let (code, out, _) = ocu(&["eval", "obstacles", &run]);
    assert!(code == 0 && out.contains("0.66 m wide") && out.contains("free called blocked"), "{out}");
    let (code, _, errors) = ocu(&["eval", "obstacles", &run, "--map", "/nowhere"]);
    assert!(code == 2 && errors.contains("no topic /nowhere"), "{errors}");
    let (code, _, errors) = ocu(&["eval", "obstacles", &run, "--width", "0"]);
    assert!(code == 2 && errors.contains("expected more than 0"), "{errors}");
}

/// A brown path (label 7) in green grass (1) under a sky (2), and a strip of no label (255); image and label files.
fn labelled_path(dir: &Path, name: &str, seed: u32) -> [String; 2] {
    let class = |x: u32, y: u32| match y {
        0..60 => 2,
        60..64 => 255,
        _ if x.abs_diff(160) < y / 2 => 7,
        _ => 1,
    };
    let paint = |x: u32, y: u32| {
        let noise = (x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77) ^ seed)
            .wrapping_mul(0x2c1b_3c6d)
            >> 27;
        let base: [u32; 3] = match class(x, y) {
            7 => [110, 76, 50],
            1 => [80, 115, 45],
            _ => [165, 195, 230],
        };
        image::Rgb(base.map(|v| (v + noise) as u8))
    };
    let paths = ["png", "labels.png"].map(|ending| text(&dir.join(format!("{name}.{ending}"))).to_owned());
    image::RgbImage::from_fn(320, 240, paint).save(&paths[0]).unwrap();
    image::GrayImage::from_fn(320, 240, |x, y| image::Luma([class(x, y)])).save(&paths[1]).unwrap();
    paths
}

/// The keys of a report on classes.
const CLASS_KEYS: &str =
    "f1 ground_iou images images_without_counterpart ms_median obstacle_iou pixels unclassified_pct";

#[test]
fn eval_color_measures_images_against_their_labels() {
    let dir = tempfile::tempdir().unwrap();
    let [first, second] = [1, 2].map(|seed| labelled_path(dir.path(), &format!("path_{seed}"), seed));
    let images = ["eval", "color", "--image", &first[0], &second[0], "--labels", &first[1], &second[1]];
    let (code, out, errors) =
        ocu(&[&images[..], &["--ground-ids", "7", "--ignore-ids", "255", "--json"]].concat());
    assert_eq!(code, 0, "{errors}");
    let report = json(&out);
    assert_eq!(keys(&report).join(" "), CLASS_KEYS);
    for figure in ["ground_iou", "obstacle_iou", "f1"] {
        assert!(report[figure].as_f64().unwrap() > 0.95, "{out}");
    }
    assert!(report["unclassified_pct"].as_f64().unwrap() < 2.0, "{out}");
    // With ground and background exchanged, nothing is right.
    let (_, out, _) = ocu(&[&images[..], &["--ground-ids", "1,2", "--json"]].concat());
    assert!(json(&out)["ground_iou"].as_f64().unwrap() < 0.05, "{out}");
    let (_, out, _) = ocu(&[&images[..], &["--ground-ids", "1,2,7,255", "--json"]].concat());
    assert_eq!(json(&out)["obstacle_iou"], 0.0, "obstacles were called, and there are none");
    let (code, _, errors) = ocu(&[&images[..], &["--ground-ids", "7,9"]].concat());
    assert!(code == 0 && errors.contains("no label image has the ground id 9"), "{errors}");
    let (code, out, _) = ocu(&[&images[..], &["--ground-ids", "7", "--apriori", "orange_fence"]].concat());
    assert!(code == 0 && out.contains("intersection over union of ground"), "{out}");
}

#[test]
fn eval_color_refuses_what_does_not_fit() {
    let dir = tempfile::tempdir().unwrap();
    let [image, labels] = labelled_path(dir.path(), "path", 1);
    let small = text(&dir.path().join("small.png")).to_owned();
    image::GrayImage::new(64, 48).save(&small).unwrap();
    let black = text(&dir.path().join("black.png")).to_owned();
    image::GrayImage::new(320, 240).save(&black).unwrap();
    let check = |args: &[&str], code: i32, expected: &str| {
        let (got, _, errors) = ocu(&[&["eval", "color", "--ground-ids", "7", "--image"], args].concat());
        assert_eq!(got, code, "{errors}");
        assert!(errors.contains(expected), "got \"{errors}\", expected \"{expected}\"");
    };
    check(&[&image, &image, "--labels", &labels], 2, "2 images, but 1 label images");
    check(&[&image, "--labels", &small], 2, "labels are 64x48 pixels, their image 320x240");
    check(&[&image, "--labels", &image], 2, "labels are an image in colours");
    check(&[&image, "--labels", "none.png"], 2, "cannot read none.png");
    let (code, _, why) = ocu(&["eval", "color", "--image", &image, "--labels", &labels, "--ground-ids", "8"]);
    assert!(code == 2 && why.contains("ground ids 8; expected one of 1, 2, 7, 255"), "{why}");
    check(&[&black, "--labels", &labels], 1, "image is 100 % black");
    check(&[&image, "--labels", &labels, "--horizon", "120"], 2, "horizon is 120 %");
    check(
        &[&image, "--labels", &labels, "--apriori", "moss"],
        2,
        "expected mulch, orange_fence, white_lime or a file",
    );
    check(&[&image, "--labels", &labels, "--apriori", &labels], 2, "cannot read the models");
    check(&[&image, "--labels", &labels, "--ignore-ids", "1,7"], 2, "the id 7 is in --ground-ids and");
}

/// A recording with true labels and classes of two moments; the second classes are 3 ms late.
fn labelled_recording(path: &Path, size: [u32; 2]) {
    use rcs_log::{LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::{AnyMessage, Stamp, foxglove::RawImage, schema_of};
    let mut writer = LogWriter::create(path, WriterOptions::default()).unwrap();
    let palette = |name: &str| [("rcs.palette".to_owned(), name.to_owned())].into();
    let truth = writer.add_channel("/truth", schema_of::<RawImage>(), &palette("obstacle_labels")).unwrap();
    let judged = writer.add_channel("/classes", schema_of::<RawImage>(), &palette("classes")).unwrap();
    let mut sequence = 0;
    let mut write = |channel, ms: u64, [width, height]: [u32; 2], pixels: &[u8]| {
        let time = Stamp(ms * 1_000_000);
        let data = pixels.iter().copied().cycle().take((width * height) as usize).collect::<Vec<_>>();
        let image = RawImage {
            timestamp: Some(time.to_proto()),
            width,
            height,
            encoding: "mono8".to_owned(),
            step: width,
            data: data.into(),
            ..RawImage::default()
        };
        let header = WriteHeader { sequence, log_time: time, publish_time: time };
        sequence += 1;
        writer.write(channel, header, &AnyMessage::new(image).bytes()).unwrap();
    };
    // Ground, short, obstacle, cover: short is ground, cover is not counted.
    write(truth, 1000, [4, 2], &[1, 3, 2, 4]);
    write(judged, 1000, size, &[1, 1, 2, 2]);
    write(judged, 1203, size, &[2, 1, 0, 0]);
    write(truth, 1200, [4, 2], &[1, 1, 2, 2]);
    write(truth, 1400, [4, 2], &[1, 1, 1, 1]);
    writer.finish().unwrap();
}

#[test]
fn eval_classify_measures_label_images_of_one_time_against_each_other() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("labels.mcap");
    labelled_recording(&path, [4, 2]);
    let (code, out, errors) =
        ocu(&["eval", "classify", "--log", text(&path), "--truth-topic", "/truth", "--json"]);
    assert_eq!(code, 0, "{errors}");
    let report = json(&out);
    assert_eq!(keys(&report).join(" "), CLASS_KEYS);
    // Of eight pixels of ground six are right and two are called obstacles; of six obstacles two are right and four not
    // classified.
    assert_eq!(report["ground_iou"].as_f64(), Some(6.0 / 8.0), "{out}");
    assert_eq!(report["obstacle_iou"].as_f64(), Some(2.0 / 8.0), "{out}");
    assert_eq!(report["f1"].as_f64(), Some(12.0 / 14.0), "{out}");
    assert!((report["unclassified_pct"].as_f64().unwrap() - 100.0 * 4.0 / 14.0).abs() < 1e-9, "{out}");
    assert_eq!(report["ms_median"], serde_json::Value::Null);
    // Images too far apart in time are not compared.
    let narrow = ["--topic", "/classes", "--tolerance", "0.001", "--json"];
    let (_, out, _) =
        ocu(&[&["eval", "classify", "--log", text(&path), "--truth-topic", "/truth"], &narrow[..]].concat());
    assert_eq!(json(&out)["unclassified_pct"].as_f64(), Some(0.0), "{out}");
}

#[test]
fn eval_classify_refuses_what_does_not_fit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("labels.mcap");
    labelled_recording(&path, [2, 4]);
    let check = |args: &[&str], code: i32, expected: &str| {
        let (got, _, errors) = ocu(&[&["eval", "classify", "--log", text(&path)], args].concat());
        assert_eq!(got, code, "{errors}");
        assert!(errors.contains(expected), "got \"{errors}\", expected \"{expected}\"");
    };
    check(&["--truth-topic", "/truth"], 2, "label images are 2x4 pixels, the true ones 4x2");
    check(&["--truth-topic", "/nothing"], 2, "the recording has no topic /nothing");
    check(&["--truth-topic", "/truth", "--topic", "/truth"], 2, "expected two topics");
    check(&["--truth-topic", "/truth", "--topic", "/none"], 2, "the recording has no topic /none");
    let (drive, sample) = recording();
    let (code, _, errors) = ocu(&["eval", "classify", "--log", text(&sample), "--truth-topic", "/truth"]);
    assert!(code == 2 && errors.contains("expected --topic"), "{errors}");
    drop(drive);
    let stack = ["eval", "classify", "--stack", "range_camera", "--until", "1"];
    let (code, _, errors) = ocu(&[&stack[..], &["--truth-topic", "/x", "--topic", "/y"]].concat());
    assert!(code == 2 && errors.contains("expected --log"), "{errors}");
}

#[test]
fn a_sweep_has_a_row_for_each_combination_and_each_is_what_a_run_gives() {
    let dir = tempfile::tempdir().unwrap();
    let runs = dir.path().join("runs");
    let stack = ["--stack", "truth_driver", "--course", "corridor", "--until", "1", "--json"];
    let sweep = ["sweep", "--param", "truth_driver.vehicle_width_m=0.6,5", "--runs", "2", "--seed", "3"];
    let record = ["--record", text(&runs)];
    let (code, out, errors) = ocu(&[&sweep[..], &record, &stack].concat());
    assert_eq!(code, 0, "{errors}");
    let report = common::json(&out);
    let rows = report["runs"].as_array().unwrap();
    let seeds: Vec<u64> = rows.iter().map(|row| row["seed"].as_u64().unwrap()).collect();
    assert_eq!(seeds, [3, 4, 3, 4]);
    for row in rows {
        // No course has a way for a vehicle as wide.
        let is_wide = row["params"]["truth_driver.vehicle_width_m"] == "5";
        assert_eq!(row["errors"].as_array().unwrap().is_empty(), !is_wide, "{row}");
    }
    let run = ["run", "--param", "truth_driver.vehicle_width_m=0.6", "--seed", "4"];
    let (code, out, errors) = ocu(&[&run[..], &stack].concat());
    assert_eq!(code, 0, "{errors}");
    assert_eq!(common::json(&out)["hash"], rows[1]["hash"]);
    // The recording of a run repeats it.
    let recorded = rows[1]["recording"].as_str().unwrap();
    let (code, out, errors) = ocu(&["run", "--replay", recorded, "--until", "1", "--json"]);
    assert_eq!(code, 0, "{errors}");
    assert_eq!(common::json(&out)["hash"], rows[1]["hash"]);
    let (code, _, errors) = ocu(&[&sweep[..], &record, &stack].concat());
    assert_eq!((code, errors.contains("exists already")), (2, true), "{errors}");
    for (wrong, part) in [("absent.x=1", "absent"), ("truth_driver.vehicle_width_m=9", "9")] {
        let (code, _, errors) = ocu(&["sweep", "--stack", "truth_driver", "--param", wrong, "--until", "1"]);
        assert_eq!((code, errors.contains(part)), (2, true), "{errors}");
    }
    let (code, _, errors) = ocu(&[&sweep[..], &sweep[1..3], &stack].concat());
    assert_eq!((code, errors.contains("is given twice")), (2, true), "{errors}");
}

#[test]
fn each_topic_that_a_log_lacks_is_told_with_those_of_its_type() {
    let (dir, log) = recording();
    let [stack, runs] = ["mine.toml", "runs"].map(|name| dir.path().join(name));
    let inputs = [("/a", "foxglove.Odometry"), ("/b", "foxglove.Grid")].map(|(topic, schema)| {
        format!("[[input]]\nbuffer = {topic:?}\ntopic = {topic:?}\ntype = {schema:?}\n")
    });
    let process = "[[process]]\nname = \"obstacles\"\nplugin = \"obstacles\"\nsupervisor = \"viewer\"\n";
    std::fs::write(&stack, format!("format = 1\nname = \"mine\"\n{}{process}", inputs.concat())).unwrap();
    let named = text(&stack);
    let sweep = ["sweep", "--stack", named, "--record", text(&runs)];
    for command in [&["stack", "check", named][..], &["run", "--stack", named], &sweep] {
        let (code, out, errors) = ocu(&[command, &["--log", text(&log)]].concat());
        let told = out + &errors;
        assert_eq!(code, if command[0] == "stack" { 1 } else { 2 }, "{told}");
        assert!(told.contains("no topic /a of type foxglove.Odometry; expected /localization/local\n"));
        assert!(told.contains("no topic /b of type foxglove.Grid; none of its topics is of this type"));
    }
    assert!(!runs.exists());
}
