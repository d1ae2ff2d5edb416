//! The commands that tell what is there and what went wrong: plugins, stacks, faults and latency.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::{json, keys, ocu, recording, text};
use rcs_log::{LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{AnyMessage, Stamp, foxglove, rcs, schema_of};
use std::path::{Path, PathBuf};

fn strings(list: &serde_json::Value) -> Vec<&str> {
    list.as_array().unwrap().iter().filter_map(serde_json::Value::as_str).collect()
}

/// Ten depth images of 4x2 pixels, and a stack that gives them to `obstacles` without a calibration.
fn depth_without_calibration() -> (tempfile::TempDir, PathBuf, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let (log, stack) = (dir.path().join("depth.mcap"), dir.path().join("mine.toml"));
    let mut writer = LogWriter::create(&log, WriterOptions::default()).unwrap();
    let depth = writer
        .add_channel("/depth", schema_of::<foxglove::RawImage>(), &std::collections::BTreeMap::default())
        .unwrap();
    for number in 1..=10_u32 {
        let time = Stamp(u64::from(number) * 200_000_000);
        let image = foxglove::RawImage {
            timestamp: Some(time.to_proto()),
            frame_id: "camera".to_owned(),
            width: 4,
            height: 2,
            encoding: "16UC1".to_owned(),
            step: 8,
            data: vec![number as u8; 16].into(),
        };
        let header = WriteHeader { sequence: number, log_time: time, publish_time: time };
        writer.write(depth, header, &AnyMessage::new(image).bytes()).unwrap();
    }
    writer.finish().unwrap();
    let text = "format = 1\nname = \"mine\"\n\n[[input]]\nbuffer = \"/depth\"\ntopic = \"/depth\"\n\n[[process]]\n\
                name = \"obstacles\"\nplugin = \"obstacles\"\nsupervisor = \"viewer\"\ninputs = { depth = \"/depth\" }\n";
    std::fs::write(&stack, text).unwrap();
    (dir, log, stack)
}

#[test]
fn a_buffer_to_which_nothing_was_written_is_told_and_hinders_neither_other_files_nor_more_runs() {
    let dir = tempfile::tempdir().unwrap();
    let [nothing, imu] = ["teleop.json", "imu.json"].map(|name| dir.path().join(name));
    let saves = [format!("/operator/teleop={}", text(&nothing)), format!("/vehicle/imu={}", text(&imu))];
    let run =
        ["run", "--stack", "simulation", "--course", "meadow", "--until", "0.5", "--runs", "2", "--json"];
    let (code, out, errors) = ocu(&[&run[..], &["--save", &saves[0], "--save", &saves[1]]].concat());
    assert_eq!(code, 1, "{errors}");
    assert!(errors.contains("nothing was ever written to /operator/teleop"), "{errors}");
    assert_eq!(json(&out)["runs"].as_array().unwrap().len(), 2, "{out}");
    assert!(imu.exists() && !nothing.exists());
}

#[test]
fn a_buffer_that_the_stack_does_not_have_is_refused_before_anything_runs() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("run.mcap");
    let saved = format!("/nosuch={}", text(&file));
    let recorded = ["--record", text(&file), "--record-what", "/vehicle/imu,/nosuch"];
    for (args, purpose) in [(&["--save", &saved][..], "save"), (&recorded[..], "record")] {
        let run = ["run", "--stack", "truth_driver", "--until", "0.1"];
        let (code, _, errors) = ocu(&[&run[..], args].concat());
        let said = format!("there is no buffer /nosuch to {purpose} in the stack truth_driver");
        assert!(code == 2 && errors.contains(&said) && !file.exists(), "{code} {errors}");
    }
}

#[test]
fn a_report_of_several_runs_says_what_is_of_the_last_one_and_the_help_says_what_each_is_handed() {
    let told = |more: &[&str]| {
        let run = ["run", "--stack", "simulation", "--course", "meadow", "--until", "0.3"];
        let (code, out, errors) = ocu(&[&run[..], more].concat());
        assert_eq!(code, 0, "{errors}");
        out
    };
    let several = told(&["--runs", "2"]);
    let labelled = several.lines().filter(|line| line.ends_with(" of the last run"));
    assert_eq!(labelled.count(), 4, "time, hash, processes and buffers: {several}");
    assert!(!told(&[]).contains("of the last run"));
    let (_, help, _) = ocu(&["run", "--help"]);
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(help.contains("a stack that remembers is handed what the run before has learned"), "{help}");
}

#[test]
fn what_an_earlier_run_remembers_is_refused_where_it_would_not_count_and_is_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("remembered.json");
    let route = r#"{"format": 1, "zone": 18, "points": [{"easting_m": 308210.0, "northing_m": 4333645.0},
                    {"easting_m": 308310.0, "northing_m": 4333645.0}]}"#;
    let content =
        serde_json::json!({ "format": 1, "remembered": { "waypoint_generator.route": route } }).to_string();
    std::fs::write(&file, &content).unwrap();
    let refused = |args: &[&str], part: &str| {
        let (code, _, errors) = ocu(&[args, &["--remembered", text(&file)]].concat());
        assert!(code == 2 && errors.contains(part), "{code} {errors}");
    };
    let run = ["run", "--stack", "lagr", "--course", "hill", "--until", "0.1"];
    let param = ["--param", "waypoint_generator.route=other.json"];
    refused(&[&run[..], &param].concat(), "--param and --remembered both have waypoint_generator.route");
    refused(&["a.mcap"], "expected --stack");
    let save = format!("/vehicle/imu={}", text(&file));
    refused(&[&run[..], &["--force", "--save", &save]].concat(), "the file is a file that is read");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), content);
}

#[test]
fn a_process_that_can_use_none_of_its_messages_is_told_and_can_be_made_an_error() {
    let (_dir, log, stack) = depth_without_calibration();
    let run = ["run", "--stack", text(&stack), "--log", text(&log)];
    let (code, out, errors) = ocu(&run);
    assert_eq!(code, 0, "{errors}");
    let warning = "warning: obstacles could use no message of its input depth: 10 faults; the last one: ";
    assert!(out.contains(warning), "{out}");
    let header = out.lines().find(|line| line.starts_with("process")).unwrap();
    assert!(header.ends_with("faults  last fault"), "{out}");

    let (code, out, errors) = ocu(&[&run[..], &["--fail-on-fault", "--json"]].concat());
    assert_eq!(code, 1, "{errors}");
    let report = json(&out);
    assert_eq!(report["outcome"], "error");
    assert_eq!(report["processes"][0]["faults"], 10);
    assert!(report["processes"][0]["last_fault"].as_str().unwrap().contains("calibration"), "{out}");
    assert_eq!(strings(&report["warnings"]).len(), 1, "{out}");
}

#[test]
fn the_report_says_why_a_process_is_in_error() {
    // No course has a way that is as wide.
    let run = ["run", "--stack", "truth_driver", "--course", "corridor", "--until", "1", "--param"];
    let run = [&run[..], &["truth_driver.vehicle_width_m=5"]].concat();
    let (code, out, errors) = ocu(&run);
    assert_eq!(code, 1, "{out}{errors}");
    assert!(out.contains("error: truth_driver is in ERROR: no way leads to the goal with "), "{out}");

    let (code, out, errors) = ocu(&[&run[..], &["--json"]].concat());
    assert_eq!(code, 1, "{out}{errors}");
    let report = json(&out);
    assert_eq!(report["outcome"], "error");
    let processes = report["processes"].as_array().unwrap();
    for process in processes {
        let error = process["error"].as_str().unwrap_or_default();
        assert_eq!(process["state"] == "ERROR", !error.is_empty(), "{process}");
    }
    let driver = processes.iter().find(|process| process["name"] == "truth_driver").unwrap();
    assert!(driver["error"].as_str().unwrap().starts_with("no way leads to the goal"), "{driver}");
}

#[test]
fn a_process_that_writes_nothing_is_told() {
    let (dir, log, _) = depth_without_calibration();
    let stack = dir.path().join("silent.toml");
    let text_of = "format = 1\nname = \"silent\"\n[[input]]\nbuffer = \"/depth\"\ntopic = \"/depth\"\ntype = \"foxglove.RawImage\"\n[[process]]\n\
                   name = \"obstacles\"\nplugin = \"obstacles\"\nsupervisor = \"viewer\"\n";
    std::fs::write(&stack, text_of).unwrap();
    let (code, out, _) = ocu(&["run", "--stack", text(&stack), "--log", text(&log), "--json"]);
    assert_eq!(code, 0, "{out}");
    let warnings = json(&out)["warnings"].clone();
    assert!(strings(&warnings)[0].starts_with("obstacles wrote nothing in "), "{out}");
}

#[test]
fn a_stack_that_works_is_no_error_with_fail_on_fault() {
    let (_dir, path) = recording();
    let (code, out, errors) =
        ocu(&["run", "--stack", "sample", "--log", text(&path), "--fail-on-fault", "--json"]);
    assert_eq!(code, 0, "{errors}{out}");
    assert_eq!(strings(&json(&out)["warnings"]), [""; 0]);
}

/// A recording of the stack `sample`.
fn recorded_run(dir: &Path, log: &Path) -> PathBuf {
    let run = dir.join("run.mcap");
    let (code, _, errors) = ocu(&["run", "--stack", "sample", "--log", text(log), "--record", text(&run)]);
    assert_eq!(code, 0, "{errors}");
    run
}

#[test]
fn latency_tells_the_age_of_messages_and_each_hop_on_their_way() {
    let (dir, log) = recording();
    let run = recorded_run(dir.path(), &log);
    let (code, out, errors) = ocu(&["latency", text(&run), "--json"]);
    assert_eq!(code, 0, "{errors}");
    let report = json(&out);
    let buffers = report["buffers"].as_array().unwrap();
    let buffer = |name: &str| buffers.iter().find(|buffer| buffer["buffer"] == name).unwrap();
    let expected = ["buffer", "hops", "max_ms", "messages", "p50_ms", "p95_ms", "writer"];
    assert_eq!(keys(buffer("/obstacles/cost")), expected);
    assert_eq!(buffer("/obstacles/cost")["writer"], "obstacles");
    let hop = |to: &str, from: &str| {
        let hops = buffer(to)["hops"].as_array().unwrap();
        hops.iter().find(|hop| hop["from"] == from).unwrap_or_else(|| panic!("{hops:?}")).clone()
    };
    let ms = |value: &serde_json::Value| value["p50_ms"].as_f64().unwrap();
    let (stereo, obstacles) = (hop("/stereo/depth", "/camera/left"), hop("/obstacles/cost", "/stereo/depth"));
    assert_eq!(keys(&stereo), ["from", "max_ms", "messages", "p50_ms", "p95_ms"]);
    // Each takes its declared latency and what its phase adds; the ages add up.
    assert!(ms(&stereo) > 0.0 && ms(&obstacles) > 0.0, "{out}");
    let age = ms(buffer("/obstacles/cost"));
    assert!((age - ms(&stereo) - ms(&obstacles)).abs() <= 50.0, "{out}");
    // A map that is recorded as key frames and deltas is one buffer; commands and statuses are none of its business.
    assert!(buffers.iter().all(|buffer| !buffer["buffer"].as_str().unwrap().contains("/delta")), "{out}");
    assert!(buffers.iter().all(|buffer| !buffer["buffer"].as_str().unwrap().ends_with("/status")), "{out}");

    let (code, out, _) = ocu(&["latency", text(&run)]);
    assert!(code == 0 && out.contains("  from /stereo/depth"), "{out}");
    // Any other log has ages, and no hops.
    let (code, out, _) = ocu(&["latency", text(&log), "--json"]);
    assert_eq!(code, 0);
    let buffers = json(&out)["buffers"].clone();
    assert!(buffers.as_array().unwrap().iter().any(|buffer| buffer["buffer"] == "/camera/left"), "{out}");
}

#[test]
fn latency_tells_the_writers_of_a_shared_buffer_apart() {
    let dir = tempfile::tempdir().unwrap();
    let run = dir.path().join("run.mcap");
    let (code, _, errors) = ocu(&["run", "--stack", "simulation", "--until", "3", "--record", text(&run)]);
    assert_eq!(code, 0, "{errors}");
    let (code, out, errors) = ocu(&["latency", text(&run), "--json"]);
    assert_eq!(code, 0, "{errors}");
    let report = json(&out);
    let cost = report["buffers"].as_array().unwrap().iter().filter(|b| b["buffer"] == "/obstacles/cost");
    let writers: Vec<_> = cost.map(|buffer| buffer["writer"].as_str().unwrap()).collect();
    assert_eq!(writers, ["obstacles_left", "obstacles_right"], "{out}");
    assert!(!out.contains(" or "), "{out}");
}

#[test]
fn plugins_are_listed_and_one_is_told_in_full() {
    let (code, out, _) = ocu(&["plugins"]);
    assert_eq!(code, 0);
    assert!(out.lines().any(|line| line.starts_with("obstacles ")), "{out}");
    let (code, out, _) = ocu(&["plugins", "obstacles"]);
    assert_eq!(code, 0);
    assert!(out.contains("max_range_m") && out.contains("1 to 200"), "{out}");
    assert!(out.contains("foxglove.CameraCalibration") && out.contains("INIT"), "{out}");
    let labels = out.lines().find(|line| line.starts_with("labels ")).unwrap();
    assert!(labels.contains(" labels ") && out.contains(" and latency "), "{out}");
    let (code, out, _) = ocu(&["plugins", "obstacles", "--json"]);
    assert_eq!(code, 0);
    let report = json(&out);
    let expected = [
        "children",
        "commands",
        "inputs",
        "latency_ms",
        "name",
        "outputs",
        "params",
        "params_schema",
        "period_ms",
        "summary",
    ];
    assert_eq!(keys(&report), expected);
    assert_eq!(keys(&report["inputs"][0]), ["help", "metadata", "name", "required", "role", "schema"]);
    let param = report["params"].as_array().unwrap().iter().find(|p| p["name"] == "max_range_m").unwrap();
    assert_eq!((&param["unit"], param["min"].as_f64()), (&"m".into(), Some(1.0)), "{param}");
    let all = json(&ocu(&["plugins", "--json"]).1);
    assert!(all.as_array().unwrap().len() >= 15);
    let (code, _, errors) = ocu(&["plugins", "obstacle"]);
    assert!(code == 2 && errors.contains("expected classifier, "), "{errors}");
}

#[test]
fn a_bundled_stack_is_shown_with_the_line_that_each_line_came_from() {
    let (code, out, _) = ocu(&["stack", "show", "simulation"]);
    assert_eq!(code, 0);
    assert!(
        out.contains("# assets/stacks/simulation.toml:") && out.contains("# assets/stacks/parts/"),
        "{out}"
    );
    // Without them it is a stack file that runs by itself.
    let (code, plain, _) = ocu(&["stack", "show", "sample", "--plain"]);
    assert_eq!(code, 0);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("plain.toml");
    std::fs::write(&path, plain).unwrap();
    let (code, out, _) = ocu(&["stack", "check", text(&path), "--json"]);
    assert_eq!(code, 0, "{out}");
}

#[test]
fn the_warnings_of_bundled_stacks_are_logs_that_are_not_given_and_costs_that_are_only_shown() {
    for (name, _) in ocu_app::stacks::bundled() {
        let (code, out, errors) = ocu(&["stack", "check", name, "--json"]);
        assert_eq!(code, 0, "{name}: {errors}");
        let report = json(&out);
        let is_meant = |text: &&str| {
            // The commands of a replay move nothing.
            let is_shown = text.contains("/cost") || *name == "replay" && text.contains("/wheels");
            text.contains("--log") || is_shown && text.contains("is read by no process")
        };
        let others: Vec<_> =
            strings(&report["warnings"]).into_iter().filter(|text| !is_meant(text)).collect();
        assert_eq!(others, [""; 0], "{name}");
    }
}

#[test]
fn a_check_tells_what_is_probably_not_meant() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("mine.toml");
    let check = |text_of: &str| {
        std::fs::write(&path, text_of).unwrap();
        let (code, out, _) = ocu(&["stack", "check", text(&path), "--json"]);
        (code, json(&out))
    };
    let stack = |mount: &str, frame: &str, cost: &str| {
        format!(
            "format = 1\nname = \"mine\"\n[[process]]\nname = \"obstacles\"\nplugin = \"obstacles\"\n\
             supervisor = \"viewer\"\n[process.params]\nmount = {{ {mount} }}\npose = {{ source = \"POSE_FIXED\", local_frame = \"{frame}\" }}\n\
             [[process]]\nname = \"wm1\"\nplugin = \"world_model\"\nsupervisor = \"viewer\"\n{cost}\
             params = {{ pose = {{ source = \"POSE_FIXED\" }} }}\n"
        )
    };
    let wired = "inputs = { stereo = \"/obstacles/cost\" }\n";
    let (code, report) = check(&stack("fixed = true, height_m = 1.5", "local", wired));
    assert_eq!((code, strings(&report["warnings"])), (0, vec![]));
    for (text_of, warning) in [
        (stack("height_m = 1.5", "local", wired), "obstacles: mount.height_m is set, but mount.fixed is not"),
        (
            stack("", "odom", wired),
            "local_frame is \"local\" in wm1 and \"odom\" in obstacles, which it reads",
        ),
        (
            stack("", "local", ""),
            "/obstacles/cost of obstacles is read by no process; the input stereo of wm1 is not wired",
        ),
    ] {
        let (code, report) = check(&text_of);
        let warnings = strings(&report["warnings"]);
        assert_eq!(code, 0);
        assert!(warnings.len() == 1 && warnings[0].contains(warning), "{warnings:?}");
        let is_unread = strings(&report["unread"]).contains(&"/obstacles/cost");
        assert_eq!(is_unread, warning.contains("read by no process"), "{report}");
    }
    let (code, report) = check(&stack("height_m = 99", "local", wired));
    assert_eq!(code, 1);
    assert!(strings(&report["errors"])[0].contains("mine.toml:8"), "{report}");
}

#[test]
fn a_run_tells_once_and_in_its_json_what_is_probably_a_mistake_in_the_stack() {
    let (_dir, log, stack) = depth_without_calibration();
    let plain = std::fs::read_to_string(&stack).unwrap();
    std::fs::write(&stack, plain + "params = { mount = { height_m = 1.5 } }\n").unwrap();
    let (code, out, errors) = ocu(&["run", "--stack", text(&stack), "--log", text(&log), "--json"]);
    assert_eq!(code, 0, "{errors}");
    assert_eq!(errors.matches("obstacles: mount.height_m is set").count(), 1, "{errors}");
    let report = json(&out);
    let is_told = |text: &&str| text.starts_with("obstacles: mount.height_m is set");
    assert_eq!(strings(&report["warnings"]).into_iter().filter(is_told).count(), 1, "{out}");
    // It is no fault of a process, and with --runs each warning of a run has its seed.
    let runs = ["run", "--stack", text(&stack), "--log", text(&log), "--runs", "2"];
    let (code, out, errors) = ocu(&runs);
    assert!(code == 0 && !out.contains("mount.height_m"), "{errors}{out}");
    for seed in ["warning: seed 0: obstacles could use", "warning: seed 1: obstacles could use"] {
        assert!(out.contains(seed), "{out}");
    }
}

#[test]
fn a_check_tells_that_the_file_of_a_course_replaces_that_of_the_stack() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("mine.toml");
    let warnings = |vehicle: &str, param: &[&str]| {
        let text_of = format!(
            "format = 1\nname = \"mine\"\ncourse = \"meadow\"\n[[include]]\npart = \"simulated_robot\"\n\
             [change.vehicle]\nparams = {{ vehicle = \"{vehicle}\" }}\n"
        );
        std::fs::write(&path, text_of).unwrap();
        let (code, out, errors) = ocu(&[&["stack", "check", text(&path), "--json"][..], param].concat());
        assert_eq!(code, 0, "{out}{errors}");
        let report = json(&out);
        let of_files =
            strings(&report["warnings"]).into_iter().filter(|text| text.contains("vehicle.vehicle"));
        of_files.map(str::to_owned).collect::<Vec<_>>()
    };
    let told = warnings("lagr_worn", &[]);
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].contains("mine.toml:7: the file of vehicle.vehicle does not count"), "{told:?}");
    assert!(told[0].contains("/lagr.toml; expected it in the course"), "{told:?}");
    assert_eq!(warnings("lagr", &[]), [""; 0], "the same file");
    assert_eq!(warnings("lagr_worn", &["--param", "vehicle.vehicle=lagr_worn"]), [""; 0], "it counts more");
}

#[test]
fn a_check_reads_all_parts_of_a_split_recording() {
    let (dir, log, stack) = depth_without_calibration();
    let folder = dir.path().join("split");
    std::fs::create_dir(&folder).unwrap();
    let first = folder.join("drive_0.mcap");
    let mut writer = LogWriter::create(&first, WriterOptions::default()).unwrap();
    let metadata = std::collections::BTreeMap::default();
    let other = writer.add_channel("/other", schema_of::<foxglove::RawImage>(), &metadata).unwrap();
    let header = WriteHeader { sequence: 1, log_time: Stamp(1), publish_time: Stamp(1) };
    writer.write(other, header, &[]).unwrap();
    writer.finish().unwrap();
    // The topic that the stack reads begins in the second file.
    std::fs::rename(&log, folder.join("drive_1.mcap")).unwrap();
    for named in [&folder, &first] {
        let (code, out, errors) = ocu(&["stack", "check", text(&stack), "--log", text(named)]);
        assert_eq!(code, 0, "{out}{errors}");
    }
}

#[test]
fn a_file_that_cannot_be_opened_is_wrong_usage_of_every_command() {
    let dir = tempfile::tempdir().unwrap();
    let [absent, out, table] = ["absent.mcap", "out.png", "out.csv"].map(|name| dir.path().join(name));
    for command in [
        "ABSENT",
        "info ABSENT",
        "check ABSENT",
        "latency ABSENT",
        "graph ABSENT",
        "diff ABSENT ABSENT",
        "cut ABSENT -o OUT",
        "export ABSENT --fields /a.x -o TABLE",
        "render ABSENT --at 0 --size 64x64 -o OUT",
        "run --stack sample --log ABSENT",
        "run --replay ABSENT",
        "sweep --stack sample --log ABSENT",
        "tune --stack lagr --log ABSENT",
        "stack show ABSENT",
        "stack check ABSENT",
        "stack check sample --log ABSENT",
        "eval classify --log ABSENT --truth-topic /a",
        "eval color --image ABSENT --labels ABSENT --ground-ids 1",
        "eval obstacles ABSENT",
        "eval plan --map ABSENT --scen ABSENT",
        "eval stereo --left ABSENT --right ABSENT",
    ] {
        let word = |word| match word {
            "ABSENT" => text(&absent),
            "OUT" => text(&out),
            "TABLE" => text(&table),
            word => word,
        };
        let (code, _, errors) = ocu(&command.split(' ').map(word).collect::<Vec<_>>());
        assert!(code == 2 && errors.contains("absent.mcap"), "{command}: {code} {errors}");
    }
    assert!(!out.exists() && !table.exists());
}

#[test]
fn commands_that_read_a_recording_list_their_exit_codes() {
    for command in [&["stack", "check"][..], &["sweep"], &["run"], &["diff"]] {
        let (_, help, _) = ocu(&[command, &["--help"]].concat());
        let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
        let codes = help.split_once("Exit codes: ").unwrap().1;
        assert!(["0 ", "1 ", "2 ", "3 "].iter().all(|code| codes.contains(*code)), "{command:?}: {codes}");
    }
}

/// A drive of 60 s along a free row, beside a row of obstacles that stereo is sure of once they are near. Terrain calls
/// both rows the wrong way round. The obstacles are only there in some seconds. The course is no bundled one.
fn maps_of_a_drive(path: &Path, has_obstacles: impl Fn(u32) -> bool) {
    use rcs_geom::DVec2;
    use rcs_world::{GridView, Map, MapOptions, Source, VoteRule, Weights, fuse_grid};
    let mut writer = LogWriter::create(path, WriterOptions::default()).unwrap();
    let schema = schema_of::<foxglove::Grid>();
    let channel = writer.add_channel("/wm1/map", schema, &std::collections::BTreeMap::default()).unwrap();
    let run = schema_of::<rcs::CourseRun>();
    let course = writer.add_channel("/vehicle/run", run, &std::collections::BTreeMap::default()).unwrap();
    let run = AnyMessage::new(rcs::CourseRun { course: "hauler".to_owned(), ..Default::default() });
    let header = WriteHeader { sequence: 1, log_time: Stamp(1), publish_time: Stamp(1) };
    writer.write(course, header, &run.bytes()).unwrap();
    let mut map = Map::new(0.2).unwrap();
    let options = MapOptions {
        sources: [Source::STEREO, Source::TERRAIN, Source::BUMPER].into_iter().collect(),
        heights: false,
        weights: Weights::default(),
    };
    for second in 0..60_u32 {
        let vehicle_m = 0.8 * f64::from(second);
        map.recentre(DVec2::new(vehicle_m, 0.0));
        let mut vote = |ahead_m: f64, y_m: f64, source, cost, times| {
            let cell = map.grid().cell_at(DVec2::new(vehicle_m + ahead_m, y_m)).unwrap();
            for _ in 0..times {
                map.vote(cell, source, cost, second, Stamp(1), VoteRule::default());
            }
        };
        for ahead_m in (0..30).map(|step| 0.1 + 0.2 * f64::from(step)) {
            let near = if ahead_m < 1.5 { 8 } else { 1 };
            vote(ahead_m, 0.1, Source::STEREO, 0, 1);
            vote(ahead_m, 2.1, Source::STEREO, 250, if has_obstacles(second) { near } else { 0 });
            vote(ahead_m, 0.1, Source::TERRAIN, 250, 3);
            vote(ahead_m, 2.1, Source::TERRAIN, 0, 3);
        }
        for behind_m in (0..5).map(|step| -0.1 - 0.2 * f64::from(step)) {
            vote(behind_m, 0.1, Source::BUMPER, 0, 1);
        }
        let time = Stamp(u64::from(second + 1) * 1_000_000_000);
        let message = map.to_grid("local", time, &options);
        assert!(fuse_grid(&GridView::new(&message).unwrap(), &Weights::default(), &mut Vec::new()).is_ok());
        let header = WriteHeader { sequence: second, log_time: time, publish_time: time };
        writer.write(channel, header, &AnyMessage::new(message).bytes()).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn weights_are_learned_from_a_drive_and_written_into_a_stack() {
    let dir = tempfile::tempdir().unwrap();
    let (log, stack) = (dir.path().join("drive.mcap"), dir.path().join("tuned.toml"));
    maps_of_a_drive(&log, |_| true);
    let tune = ["tune", "--log", text(&log), "--stack", "lagr"];
    let (code, out, errors) = ocu(&[&tune[..], &["-o", text(&stack), "--json"]].concat());
    assert!(code == 0 && !errors.contains("hauler"), "no stack runs, so none drives to a goal: {errors}");
    let report = json(&out);
    assert_eq!((&report["process"], &report["kept"]), (&"wm1".into(), &true.into()), "{out}");
    let weight = |source: &str| {
        let weights = report["weights"].as_array().unwrap();
        let found = weights.iter().find(|weight| weight["source"] == source).unwrap();
        ["before", "after"].map(|key| found[key].as_f64().unwrap())
    };
    assert_eq!(weight("stereo"), [1.0; 2], "the reference");
    let terrain = report["weights"].as_array().unwrap().iter().find(|weight| weight["source"] == "terrain");
    let without = terrain.unwrap()["loss_without"].as_f64().unwrap();
    assert!(without < report["loss"].as_f64().unwrap(), "terrain is always wrong: {out}");
    let [before, after] = weight("terrain");
    assert!(after < 0.5 * before, "{out}");
    let loss = |half: &str, which: &str| report[half][which]["loss"].as_f64().unwrap();
    assert!(loss("checked", "after") < 0.5 * loss("checked", "before"), "{out}");
    // The stack that was written has the weight, and runs.
    let written = std::fs::read_to_string(&stack).unwrap();
    assert!(written.contains("wm1"), "{written}");
    let (code, out, errors) = ocu(&[&tune[..4], &[text(&stack), "--json"]].concat());
    assert_eq!(code, 0, "{errors}");
    let again = json(&out);
    let terrain = again["weights"].as_array().unwrap().iter().find(|weight| weight["source"] == "terrain");
    assert!((terrain.unwrap()["before"].as_f64().unwrap() - after).abs() < 1e-6, "{out}");

    let (code, _, errors) = ocu(&[&tune[..], &["--run"]].concat());
    assert!(code == 2 && errors.contains("the course \"hauler\", which is neither"), "{code} {errors}");
    let (code, _, errors) = ocu(&[&tune[..], &["--process", "planner"]].concat());
    assert!(code == 2 && errors.contains("wm1"), "{code} {errors}");
    let (code, _, errors) = ocu(&[&tune[..], &["-o", "lagr"]].concat());
    assert!(code == 2 && errors.contains("a bundled stack has this name"), "{code} {errors}");
    // A recording without maps, and a stack that reads none of it.
    let (_dir, sample) = recording();
    let (code, _, errors) = ocu(&["tune", "--log", text(&sample), "--stack", "lagr"]);
    assert!(code == 2 && errors.contains("/wm1/map"), "{code} {errors}");
}

#[test]
fn weights_that_the_other_half_of_a_drive_cannot_check_are_not_kept() {
    let dir = tempfile::tempdir().unwrap();
    let mut told = [0, 1].map(|half| {
        let log = dir.path().join(format!("{half}.mcap"));
        // Near the end of a stretch of ten seconds, so that what was said of them before is in it, too.
        maps_of_a_drive(&log, |second| second / 10 == half && second % 10 >= 8);
        let stack = dir.path().join("tuned.toml");
        std::fs::write(&stack, "an earlier one").unwrap();
        let done = ocu(&["tune", "--log", text(&log), "--stack", "lagr", "--force", "-o", text(&stack)]);
        assert_eq!(std::fs::read_to_string(&stack).unwrap(), "an earlier one");
        done
    });
    // The other one has the obstacles in the half on which weights are fitted.
    told.sort_by_key(|(_, _, errors)| errors.contains("too little experience"));
    let (code, _, errors) = &told[1];
    assert!(*code == 1 && errors.contains("too little experience"), "{code} {errors}");
    let (code, out, errors) = &told[0];
    let why = "not kept: the half that they were not fitted to has ";
    assert!(out.contains(why), "{out}");
    assert!(*code == 1 && errors.contains(&format!("no file was written ({why}")), "{code} {errors}");
    assert!(errors.contains("tuned.toml"), "{errors}");
}

#[test]
fn a_drive_on_which_no_source_can_tell_obstacles_or_ground_is_not_said_to_be_too_short() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("drive.mcap");
    maps_of_a_drive(&log, |_| false);
    // Stereo and the infrared sensors.
    let [stereo, infrared] = [0, 6].map(|source| format!("wm1.sources[{source}].max_confidence=100"));
    let tune = ["tune", "--log", text(&log), "--stack", "lagr", "--param", stereo.as_str()];
    let (code, _, errors) = ocu(&tune);
    assert!(code == 1 && errors.contains("expected 20") && !errors.contains("max_confidence"), "{errors}");
    let (code, _, errors) = ocu(&[&tune[..], &["--param", infrared.as_str()]].concat());
    let why = "no range sensor can be sure of an obstacle: the greatest max_confidence is 100, expected";
    assert!(code == 1 && errors.contains(why), "{code} {errors}");
    let [bumper, slip] = [5, 7].map(|source| format!("wm1.sources[{source}].kind=SOURCE_RANGE"));
    let params = ["--param", bumper.as_str(), "--param", slip.as_str()];
    let (code, _, errors) = ocu(&[&tune[..5], &params].concat());
    let why = "expected 20; no source of kind SOURCE_OVERRIDE tells what was driven over";
    assert!(code == 1 && errors.contains(why), "{code} {errors}");
}
