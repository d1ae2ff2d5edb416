//! Recorded runs, repeated and compared with the built program.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::ocu;
use rcs_log::Log;
use std::path::{Path, PathBuf};

fn run(args: &[&str], code: i32) -> serde_json::Value {
    let (got, out, errors) = ocu(args);
    assert_eq!(got, code, "{errors}{out}");
    serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error}: {out}"))
}

/// Copies a recording and changes one byte of one message.
fn change_a_byte(from: &Path, to: &Path, topic: &str) -> u32 {
    let log = Log::open(from).unwrap();
    let mut changed = None;
    rcs_testkit::logs::copy_changed(&log, to, |name, sequence, data| {
        if changed.is_none() && name == topic && sequence >= 5 && data.len() > 8 {
            let last = data.len() - 3;
            data[last] ^= 1;
            changed = Some(sequence);
        }
    })
    .unwrap();
    changed.unwrap()
}

/// Teleoperation, a parameter change, an edit and an emergency stop.
const ACTS: &str = r#"[
  {"at_s": 0.2, "buffer": "/operator/teleop", "message": {"speed_mps": 0.6, "yaw_rate_radps": 0.2},
   "every_s": 0.05, "until_s": 1.2},
  {"at_s": 0.5, "buffer": "/wm1/params", "message": {"publish_hz": 8}},
  {"at_s": 0.7, "buffer": "/runtime/override",
   "message": {"buffer": "/vehicle_interface/wheels", "mode": "HOLD", "path": ".left_mps", "value_json": "0.1",
               "owner": "test", "expires_s": 0.3}},
  {"at_s": 1.3, "buffer": "/operator/emergency_stop", "message": {"active": true, "reason": "a test"}}
]"#;

#[test]
fn a_live_run_of_the_simulation_with_an_operator_replays_to_the_same_hash() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (acts, live, again, changed) =
        (path("acts.json"), path("live.mcap"), path("again.mcap"), path("changed.mcap"));
    std::fs::write(&acts, ACTS).unwrap();
    let recorded = run(
        &[
            "run",
            "--live",
            "--stack",
            "simulation",
            "--until",
            "1.6",
            "--acts",
            &acts,
            "--record",
            &live,
            "--json",
        ],
        0,
    );
    assert_eq!(recorded["outcome"], "end");
    for process in recorded["processes"].as_array().unwrap() {
        let late = ["start_late_p99_ms", "wake_late_p99_ms", "lock_wait_p99_ms"];
        assert!(late.iter().all(|key| process[key].as_f64().is_some_and(|ms| ms >= 0.0)), "{process}");
        assert!(["missed", "missed_by_lock"].iter().all(|key| process[key].is_u64()), "{process}");
    }
    let messages = |report: &serde_json::Value, name: &str| {
        let buffers = report["buffers"].as_array().unwrap();
        buffers.iter().find(|buffer| buffer["name"] == name).unwrap()["messages"].as_u64().unwrap()
    };
    assert_eq!(messages(&recorded, "/runtime/journal"), 24);
    assert_eq!(messages(&recorded, "/operator/teleop"), 21);
    let replayed = run(&["run", "--replay", &live, "--record", &again, "--json"], 0);
    assert_eq!(replayed["replay"], serde_json::json!({"equal": true, "first": null}));
    assert_eq!(replayed["hash"], recorded["hash"]);
    let agreed = run(&["diff", &live, &again, "--json"], 0);
    // A recording that was split is one.
    let parts = [path("split_0.mcap"), path("split_1.mcap")];
    let whole = Log::open(&live).unwrap();
    let middle = whole.info().start.after_ns(700_000_000);
    rcs_testkit::logs::split(&whole, middle, [Path::new(&parts[0]), Path::new(&parts[1])]).unwrap();
    assert_eq!(run(&["diff", &parts[0], &live, "--json"], 0)["equal"], true);
    assert_eq!(run(&["run", "--replay", &parts[0], "--json"], 0)["replay"]["equal"], true);
    assert_eq!(agreed, serde_json::json!({"equal": true, "first": null}));

    let sequence = change_a_byte(live.as_ref(), changed.as_ref(), "/localization/local");
    for args in [&["diff", &live, &changed, "--json"][..], &["run", "--replay", &changed, "--json"]] {
        let found = run(args, 1);
        let found = if args[0] == "run" { &found["replay"] } else { &found };
        assert_eq!(found["equal"], false);
        assert_eq!(found["first"]["buffer"], "/localization/local", "{found}");
        assert_eq!(found["first"]["sequence"], sequence, "{found}");
        let keys: Vec<_> = found["first"].as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(keys, ["buffer", "field", "sequence", "time_s", "values", "writer"]);
        assert_eq!(found["first"]["writer"], "localization");
        let values: Vec<&str> = found["first"]["values"]
            .as_array()
            .unwrap()
            .iter()
            .map(|value| value.as_str().unwrap())
            .collect();
        assert_ne!(values[0], values[1], "{found}");
        assert!(found["first"]["field"].as_str().unwrap().starts_with('.'), "{found}");
    }
}

#[test]
fn a_run_on_a_log_replays_on_a_copy_of_it_and_refuses_another() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (drive, copy, other, out) =
        (path("drive.mcap"), path("copy.mcap"), path("other.mcap"), path("run.mcap"));
    ocu_app::sample::write(drive.as_ref(), 2.0, false).unwrap();
    ocu_app::sample::write(other.as_ref(), 1.0, false).unwrap();
    std::fs::copy(&drive, &copy).unwrap();
    let args = ["run", "--stack", "sample", "--log", &drive, "--record", &out, "--json", "--seed", "3"];
    let recorded = run(&[&args[..], &["--record-what", "journal"]].concat(), 0);
    let replayed = run(&["run", "--replay", &out, "--log", &copy, "--json"], 0);
    assert_eq!((&replayed["hash"], &replayed["replay"]["equal"]), (&recorded["hash"], &true.into()));
    let check = |more: &[&str], expected: &[&str]| {
        let (code, _, errors) = ocu(&[&["run", "--replay", &out, "--json"], more].concat());
        assert_eq!(code, 2, "{errors}");
        assert!(expected.iter().all(|part| errors.contains(part)), "{errors}");
    };
    check(&["--log", &other], &["another log", "other.mcap"]);
    let beside = run(&["run", "--replay", &out, "--json"], 0);
    assert_eq!(beside["hash"], recorded["hash"], "the log in the folder of the recording");
    let elsewhere = tempfile::tempdir().unwrap();
    let alone = elsewhere.path().join("run.mcap").to_str().unwrap().to_owned();
    std::fs::copy(&out, &alone).unwrap();
    let (code, _, errors) = ocu(&["run", "--replay", &alone]);
    assert_eq!(code, 2, "{errors}");
    assert!(errors.contains("expected --log") && errors.contains("on a log with the identity"), "{errors}");
    check(&["--log", &copy, "--seed", "4"], &["seed 3", "got 4"]);
    check(&["--log", &copy, "--stack", "husky"], &["another stack", "husky", "sample"]);
    check(&["--log", &copy, "--course", "hill"], &["--stack"]);
    let process = replayed["processes"][0]["name"].as_str().unwrap();
    check(&["--log", &copy, "--param", &format!("{process}.nothing=1")], &["nothing"]);
    // A recording with only the journal opens as the run itself; the log is found in the same folder by its content.
    let request = ocu_app::open::Request { log: Some(out.clone().into()), ..Default::default() };
    let mut source = ocu_app::stacks::open(&request).unwrap();
    let end = source.info().end.unwrap();
    source.seek(end, &rcs_runtime::source::Task::default()).unwrap();
    let frame = source.frame();
    for buffer in recorded["buffers"].as_array().unwrap() {
        let topic = frame.topics.iter().find(|topic| *topic.name == *buffer["name"].as_str().unwrap());
        if buffer["name"] != "/runtime/timing" {
            assert_eq!(topic.unwrap().messages, buffer["messages"].as_u64().unwrap(), "{buffer}");
        }
    }
}

#[test]
fn the_journal_of_a_simulation_takes_kilobytes() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run.mcap");
    let out = out.to_str().unwrap();
    let args = [
        "run",
        "--stack",
        "simulation",
        "--until",
        "0.5",
        "--record",
        out,
        "--record-what",
        "journal",
        "--json",
    ];
    let recorded = run(&args, 0);
    let bytes = std::fs::metadata(out).unwrap().len();
    assert!(bytes < 200_000, "{bytes} bytes");
    let replayed = run(&["run", "--replay", out, "--json"], 0);
    assert_eq!((&replayed["hash"], &replayed["replay"]["equal"]), (&recorded["hash"], &true.into()));
}

#[test]
fn acts_that_do_not_fit_are_refused_by_number() {
    let folder = tempfile::tempdir().unwrap();
    let acts = folder.path().join("acts.json");
    let check = |text: &str, expected: &[&str]| {
        std::fs::write(&acts, text).unwrap();
        let args = ["run", "--stack", "simulation", "--until", "0.1", "--acts", acts.to_str().unwrap()];
        let (code, _, errors) = ocu(&args);
        assert_eq!(code, 2, "{errors}");
        assert!(expected.iter().all(|part| errors.contains(part)), "{errors}");
    };
    check("{}", &["the acts cannot be read", "acts.json"]);
    check(r#"[{"at_s": 0, "buffer": "/none", "message": {}}]"#, &["act 1", "no buffer /none"]);
    check(r#"[{"at_s": -1, "buffer": "/operator/teleop", "message": {}}]"#, &["act 1", "at_s is -1"]);
    check(r#"[{"at_s": 0, "buffer": "/operator/teleop", "message": {"speed": 1}}]"#, &["act 1", "speed"]);
    check(
        r#"[{"at_s": 0, "buffer": "/wm1/params", "message": {"publish_hz": 1e9}}]"#,
        &["act 1", "publish_hz"],
    );
    // Also with a file that its process refuses.
    check(
        r#"[{"at_s": 2, "buffer": "/vehicle/params", "message": {"course": "garbage"}}]"#,
        &["act 1: course: ", "an act takes the text of a file, not its path", "acts.json"],
    );
    for (times, expected) in [
        (r#""at_s": 1e300"#, "at_s is 1.0000e300; expected seconds"),
        (r#""at_s": 1, "until_s": 3"#, "until_s is given without every_s"),
        (r#""at_s": 2, "every_s": 0.1, "until_s": 1"#, "until_s is 1; expected at least at_s, which is 2"),
        (r#""at_s": 2, "every_s": 0"#, "every_s is 0; expected at least 0.001"),
    ] {
        let act = format!(r#"[{{{times}, "buffer": "/operator/teleop", "message": {{}}}}]"#);
        check(&act, &["act 1", expected]);
    }
}

#[test]
fn faults_and_acts_after_the_end_are_warnings_and_an_act_without_an_end_is_repeated() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (acts, runs) = (path("acts.json"), path("runs"));
    let text = r#"[{"at_s": 0.1, "buffer": "/operator/teleop", "message": {"speed_mps": 0.5}, "every_s": 0.1},
                   {"at_s": 50, "buffer": "/operator/teleop", "message": {"speed_mps": 0.5}}]"#;
    std::fs::write(&acts, text).unwrap();
    let stack = ["--stack", "truth_driver", "--course", "meadow", "--until", "0.4", "--json"];
    let fault = ["--fault", "truth_driver:frozen@100..200"];
    let is_told = |warnings: &serde_json::Value, beginning: &str| {
        let mut warnings = warnings.as_array().unwrap().iter().map(|warning| warning.as_str().unwrap());
        warnings.any(|warning| {
            warning.starts_with(beginning) && warning.contains("after the end of the run at 0.")
        })
    };
    let of_fault = "the fault truth_driver:frozen begins at 100 s, ";
    let done = run(&[&["run", "--acts", &acts][..], &stack, &fault].concat(), 0);
    assert!(is_told(&done["warnings"], of_fault), "{done}");
    assert!(
        is_told(&done["warnings"], "acts not done: 1, the first one on /operator/teleop at 50 s"),
        "{done}"
    );
    let teleop =
        done["buffers"].as_array().unwrap().iter().find(|buffer| buffer["name"] == "/operator/teleop");
    assert_eq!(teleop.unwrap()["messages"], 4);
    let swept = run(&[&["sweep", "--record", &runs][..], &stack, &fault].concat(), 0);
    assert!(is_told(&swept["runs"][0]["warnings"], of_fault), "{swept}");
}

#[test]
fn acts_change_the_newest_parameters_and_none_is_done_after_the_course_is_decided() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (acts, params) = (path("acts.json"), path("params.json"));
    let both = r#"[{"at_s": 0.1, "buffer": "/wm1/params", "message": {"publish_hz": 8}},
                   {"at_s": 0.2, "buffer": "/wm1/params", "message": {"fade_period_s": 7}}]"#;
    std::fs::write(&acts, both).unwrap();
    let save = format!("/wm1/params={params}");
    run(&["run", "--stack", "simulation", "--until", "0.3", "--acts", &acts, "--save", &save, "--json"], 0);
    let saved: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&params).unwrap()).unwrap();
    assert_eq!((&saved["publishHz"], &saved["fadePeriodS"]), (&8.0.into(), &7.0.into()), "{saved}");
    let late = r#"[{"at_s": 235, "buffer": "/operator/teleop", "message": {"speed_mps": 0.5}}]"#;
    std::fs::write(&acts, late).unwrap();
    let done = run(&["run", "--stack", "truth_driver", "--course", "meadow", "--acts", &acts, "--json"], 0);
    assert_eq!(done["runs"][0]["outcome"], "reached");
    let teleop =
        done["buffers"].as_array().unwrap().iter().find(|buffer| buffer["name"] == "/operator/teleop");
    assert_eq!(teleop.unwrap()["messages"], 0);
}

#[test]
fn a_damaged_recording_is_told_by_the_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (whole, part) = (path("whole.mcap"), path("part.mcap"));
    run(&["run", "--stack", "simulation", "--until", "3", "--record", &whole, "--json"], 0);
    let bytes = std::fs::read(&whole).unwrap();
    std::fs::write(&part, &bytes[..bytes.len() * 7 / 10]).unwrap();
    let replayed = run(&["run", "--replay", &part, "--json"], 3);
    assert_eq!(replayed["replay"]["equal"], true, "as far as it could be read");
    run(&["latency", &part, "--json"], 3);
    assert_eq!(run(&["diff", &part, &part, "--json"], 3)["equal"], true, "as far as it could be read");
    assert_eq!(run(&["diff", &whole, &whole, "--json"], 0)["equal"], true);
    run(&["latency", &whole, "--json"], 0);
    run(&["info", &part, "--json"], 3);
    let png = path("part.png");
    let size = ["--layout", "default", "--at", "0.5", "--size", "320x200"];
    let render = [&["render", part.as_str()], &size[..], &["-o", png.as_str()]].concat();
    for args in [&["graph", part.as_str()][..], &render[..]] {
        let (code, _, errors) = ocu(args);
        assert!(code == 3 && errors.contains("the recording is damaged"), "{args:?}: {code} {errors}");
    }
}

#[test]
fn a_run_with_faults_replays_to_the_same_hash_and_a_fault_that_does_not_fit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (faults, out) = (path("faults.toml"), path("faults.mcap"));
    let file = "[[fault]]\nbuffer = \"/wm1/map\"\nkind = \"late\"\ndelay_ms = 150\nfrom_s = 1.0\n";
    std::fs::write(&faults, file).unwrap();
    let stack = ["run", "--stack", "truth_driver", "--course", "meadow", "--until", "3", "--json"];
    let with = |more: &[&str], code| run(&[&stack[..], more].concat(), code);
    let plain = with(&[], 0);
    let text = "truth_driver:frozen@0.5..2";
    let hurt = with(&["--fault", text, "--record", &out], 0);
    assert_ne!(plain["hash"], hurt["hash"]);
    let replayed = run(&["run", "--replay", &out, "--json"], 0);
    assert_eq!((&replayed["hash"], &replayed["replay"]["equal"]), (&hurt["hash"], &true.into()));
    for (fault, part) in [
        ("nobody:stopped", "has no process or buffer nobody; the nearest names are"),
        ("truth_driver:broken", "expected one of stopped"),
        ("truth_driver:slowed=-5", "the delay is -5 ms"),
        (faults.as_str(), "no buffer /wm1/map"),
        ("truth_driver:stopped@3..2", "ends before it begins"),
    ] {
        let (code, _, errors) = ocu(&[&stack[..], &["--fault", fault]].concat());
        assert_eq!(code, 2, "{fault}: {errors}");
        assert!(errors.contains(part), "{fault}: {errors}");
    }
    let live = ["run", "--live", "--stack", "simulation", "--until", "1", "--fault", "/vehicle/imu:late=100"];
    let (code, _, errors) = ocu(&live);
    assert!(code == 2 && errors.contains("a live run cannot deliver messages late"), "{code} {errors}");
}

#[test]
fn a_vehicle_whose_perception_of_one_side_stops_stands() {
    let left_m = |until: &str, fault: &[&str]| {
        let stack =
            ["run", "--stack", "lagr", "--course", "meadow", "--seed", "3", "--json", "--until", until];
        // A process that is in ERROR at the end is told by the exit code.
        let code = i32::from(!fault.is_empty());
        run(&[&stack[..], fault].concat(), code)["runs"][0]["remaining_m"].as_f64().unwrap()
    };
    let sound_m = left_m("8", &[]);
    for process in ["stereo_left", "obstacles_right"] {
        let fault = format!("{process}:stopped@4");
        let [stood_m, later_m] = ["6", "8"].map(|until| left_m(until, &["--fault", &fault]));
        assert!((stood_m - later_m).abs() < 0.05, "{process}: {stood_m} m, then {later_m} m to the goal");
        assert!(later_m > sound_m + 1.0, "{process}: {later_m} m, without a fault {sound_m} m to the goal");
    }
}

#[test]
fn a_fault_that_is_refused_leaves_existing_recordings_as_they_are_and_prints_no_report() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [single, runs, of_sweep] = ["single.mcap", "runs", "runs/run-0001.mcap"].map(path);
    std::fs::create_dir(&runs).unwrap();
    for kept in [&single, &of_sweep] {
        std::fs::write(kept, "kept").unwrap();
    }
    let stack = ["--stack", "truth_driver", "--course", "meadow", "--until", "0.2", "--json", "--force"];
    for fault in [
        "truth_driver:slowed=-3",
        "truth_driver:dropped=1.5",
        "truth_driver:nan=.nope",
        "/truth_driver/drive:stopped",
    ] {
        for (command, record) in [("run", &single), ("sweep", &runs)] {
            let (code, out, errors) =
                ocu(&[&[command, "--record", record, "--fault", fault][..], &stack].concat());
            assert_eq!((code, out.as_str()), (2, ""), "{command} {fault}: {errors}");
        }
    }
    for kept in [&single, &of_sweep] {
        assert_eq!(std::fs::read_to_string(kept).unwrap(), "kept");
    }
}

#[test]
fn a_recording_of_the_journal_alone_is_refused_by_commands_that_read_what_was_computed() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [short, long, table] = ["short.mcap", "long.mcap", "table.csv"].map(path);
    for (until, out) in [("0.3", &short), ("0.6", &long)] {
        let stack = ["run", "--stack", "truth_driver", "--course", "meadow", "--until", until];
        run(&[&stack[..], &["--record", out, "--record-what", "journal", "--json"]].concat(), 0);
    }
    let expected = format!(
        "{short} holds the journal only; expected a full recording: ocu run --replay {short} --record full.mcap"
    );
    for args in [
        &["diff", &short, &long][..],
        &["latency", &short],
        &["export", &short, "--fields", "/truth_driver/drive.speed_mps", "-o", &table],
        &["eval", "obstacles", &short],
        &["tune", "--log", &short, "--stack", "lagr"],
    ] {
        let (code, out, errors) = ocu(args);
        assert_eq!((code, out.as_str()), (2, ""), "{args:?}: {errors}");
        assert!(errors.contains(&expected), "{args:?}: {errors}");
    }
}

#[test]
fn each_of_several_runs_is_recorded_and_repeated_with_what_the_one_before_has_learned() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let out = path("drive.mcap");
    let stack = ["run", "--stack", "lagr", "--course", "meadow", "--until", "2", "--runs", "2", "--json"];
    let save = format!("/wm1/stats={}", path("stats.json"));
    let record = ["--record", &out, "--record-what", "journal", "--save", &save];
    let recorded = run(&[&stack[..], &record].concat(), 0);
    assert!(std::fs::read_to_string(path("stats.json")).unwrap().contains("source"), "of the last run");
    for (number, name) in ["drive-1.mcap", "drive-2.mcap"].into_iter().enumerate() {
        let replayed = run(&["run", "--replay", &path(name), "--until", "2", "--json"], 0);
        assert_eq!(replayed["hash"], recorded["runs"][number]["hash"], "{name}");
    }
    assert_eq!(recorded["hash"], recorded["runs"][1]["hash"]);
    // An existing file of a later run is refused before anything runs.
    std::fs::remove_file(path("drive-1.mcap")).unwrap();
    let (code, _, errors) = ocu(&[&stack[..], &record].concat());
    assert!(code == 2 && errors.contains("drive-2.mcap"), "{errors}");
    assert!(!Path::new(&path("drive-1.mcap")).exists());
}

#[test]
fn a_part_of_a_recorded_run_is_repeated_if_it_has_the_beginning_and_else_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [whole, first, later, last] = ["whole.mcap", "first.mcap", "later.mcap", "last.mcap"].map(path);
    run(&["run", "--stack", "simulation", "--until", "1", "--record", &whole, "--json"], 0);
    let cut = |args: &[&str]| {
        let (code, _, errors) = ocu(&[&["cut"][..], args].concat());
        assert_eq!(code, 0, "{errors}");
    };
    cut(&["--to", "0.5", "-o", &first, &whole]);
    cut(&["--from", "0.5", "-o", &later, &whole]);
    cut(&["--to", "0.3", "-o", &last, &later]);
    assert_eq!(run(&["run", "--replay", &first, "--json"], 0)["replay"]["equal"], true);
    for part in [&later, &last] {
        let (code, _, errors) = ocu(&["run", "--replay", part]);
        assert_eq!(code, 2, "{errors}");
        assert!(errors.contains("a part of a run without its beginning"), "{errors}");
    }
}

/// Half a second of the course `hill`, recorded to a folder.
fn recording_of_hill(folder: &Path) -> PathBuf {
    let log = folder.join("hill.mcap");
    let run = ["run", "--stack", "simulation", "--course", "hill", "--until", "0.5", "--record"];
    let (code, _, error) = ocu(&[&run[..], &[log.to_str().unwrap()]].concat());
    assert_eq!(code, 0, "{error}");
    log
}

#[test]
fn every_run_on_a_recording_of_a_course_has_the_goal_of_that_course() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let log = recording_of_hill(folder.path());
    let (log, out) = (log.to_str().unwrap(), path("run.mcap"));
    let args = ["run", "--stack", "replay", "--log", log, "--runs", "2"];
    let (_, _, errors) = ocu(&[&args[..], &["--record", &out, "--record-what", "journal"]].concat());
    let goal = |name: &str| {
        let log = Log::open(path(name)).unwrap_or_else(|error| panic!("{error}: {errors}"));
        let recorded = rcs_runtime::RecordedRun::read(&log, rcs_plugins::all()).unwrap();
        let plan = recorded.plan(rcs_plugins::all()).unwrap();
        let mut processes = plan.processes.iter();
        let generator = processes.find(|process| &*process.name == "waypoint_generator").unwrap();
        generator.params.value().unwrap().field("goal").cloned()
    };
    assert!(goal("run-1.mcap").is_some());
    assert_eq!(goal("run-2.mcap"), goal("run-1.mcap"));
    // The first of them is repeated with its stack named, too.
    let first = path("run-1.mcap");
    let (_, report, errors) = ocu(&["run", "--replay", &first, "--stack", "replay", "--log", log, "--json"]);
    assert!(report.contains("\"equal\": true"), "{report}{errors}");
}

#[test]
fn a_stack_on_a_recorded_run_says_that_parameters_which_were_sent_in_that_run_are_not_in_force() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (acts, log) = (path("acts.json"), path("drive.mcap"));
    let sent = r#"[{"at_s": 0.1, "buffer": "/wm1/params", "message": {"publish_hz": 8}}]"#;
    std::fs::write(&acts, sent).unwrap();
    let simulation = ["run", "--stack", "simulation", "--until", "0.3", "--json"];
    run(&[&simulation[..], &["--acts", &acts, "--record", &log]].concat(), 0);
    let said = "sent to wm1 during the recorded run are not in force";
    let on_it = ["--stack", "replay", "--log", &log, "--until", "0.1"];
    for command in ["run", "sweep"] {
        let (_, _, errors) = ocu(&[&[command][..], &on_it].concat());
        assert!(errors.contains(said), "{command}: {errors}");
    }
    let (shown, stack) = (Some(log.clone().into()), Some("replay".to_owned()));
    let request = ocu_app::open::Request { log: shown, stack, ..Default::default() };
    let problems = ocu_app::stacks::open(&request).unwrap().info().problems.concat();
    assert!(problems.contains(said), "{problems}");
    let (code, _, errors) = ocu(&["run", "--replay", &log]);
    assert!(code == 0 && !errors.contains("not in force"), "{code} {errors}");
}

#[test]
fn a_stack_on_a_recorded_run_has_the_seed_of_that_run_unless_another_one_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (log, again) = (path("drive.mcap"), path("again.mcap"));
    let simulation = ["run", "--stack", "simulation", "--until", "0.3", "--json"];
    run(&[&simulation[..], &["--seed", "7", "--record", &log]].concat(), 0);
    let seed = |seed: Option<u64>| {
        let (log, stack) = (Some(log.clone().into()), Some("simulation".to_owned()));
        let request = ocu_app::open::Request { log, stack, seed, ..Default::default() };
        let frame = ocu_app::stacks::open(&request).unwrap().frame();
        let mut runs = frame.topics_of_type("rcs.RunInfo").filter(|topic| !topic.run.is_recorded());
        runs.next().unwrap().get::<rcs_msg::rcs::RunInfo>().unwrap().seed
    };
    assert_eq!((seed(None), seed(Some(0)), seed(Some(8))), (7, 0, 8));
    run(&[&simulation[..], &["--log", &log, "--record", &again]].concat(), 0);
    let again = Log::open(&again).unwrap();
    let again = rcs_runtime::RecordedRun::read(&again, rcs_plugins::all()).unwrap();
    assert_eq!(again.info().seed, 7);
}

#[test]
fn a_stack_that_reads_nothing_of_a_recording_says_so_unless_it_repeats_the_recorded_run() {
    let folder = tempfile::tempdir().unwrap();
    let log = recording_of_hill(folder.path());
    let says = |stack: &str| {
        let args = ["run", "--stack", stack, "--log", log.to_str().unwrap(), "--until", "0.1"];
        let (_, report, errors) = ocu(&[&args[..], &["--json"]].concat());
        let (log, stack) = (Some(log.clone()), Some(stack.to_owned()));
        let request = ocu_app::open::Request { log, stack, ..Default::default() };
        let problems = ocu_app::stacks::open(&request).unwrap().info().problems.concat();
        [errors, report, problems].map(|text| text.matches("reads nothing of the recording").count())
    };
    assert_eq!(says("truth_driver"), [1, 1, 1]);
    assert_eq!(says("simulation"), [0, 0, 0]);
    assert_eq!(says("replay"), [0, 0, 0]);
}

#[test]
fn a_stack_on_its_own_recording_says_that_the_run_began_with_other_parameters() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (plain, other) = (path("plain.mcap"), path("other.mcap"));
    let simulation = ["run", "--stack", "simulation", "--json"];
    let record = |log: &str, param: &[&str]| {
        run(&[&simulation[..], &["--until", "0.3", "--record", log], param].concat(), 0);
    };
    let param = ["--param", "wm1.publish_hz=8"];
    record(&plain, &[]);
    record(&other, &param);
    let warnings = |log: &str, param: &[&str]| {
        let done = run(&[&simulation[..], &["--until", "0.1", "--log", log], param].concat(), 0);
        let warnings = done["warnings"].as_array().unwrap().iter();
        let is_meant = |warning: &&serde_json::Value| warning.as_str().unwrap().contains("began with");
        warnings.filter(is_meant).cloned().collect::<Vec<_>>()
    };
    let said = "the recorded run began with other parameters of wm1: ocu run --replay repeats them";
    assert_eq!(warnings(&other, &[]), [said]);
    assert_eq!(warnings(&other, &param), [""; 0]);
    assert_eq!(warnings(&plain, &[]), [""; 0]);
    // What the command line gives is meant to differ.
    assert_eq!(warnings(&plain, &param), [""; 0]);
    let is_told_of_sweep = |log: &str, values: &str| {
        let sweep = ["sweep", "--stack", "simulation", "--until", "0.1", "--log", log, "--param", values];
        let (code, _, errors) = ocu(&sweep);
        assert_eq!(code, 0, "{errors}");
        errors.contains(said)
    };
    assert!(!is_told_of_sweep(&plain, "wm1.publish_hz=5,6"));
    assert!(!is_told_of_sweep(&other, "wm1.publish_hz=5,6"));
    assert!(is_told_of_sweep(&other, "wm1.fade_period_s=5,7"));
}

#[test]
fn a_stack_on_a_recording_of_a_course_has_the_goal_of_that_course() {
    let dir = tempfile::tempdir().unwrap();
    let log = recording_of_hill(dir.path());
    let goal = |course: Option<&str>| {
        let request = ocu_app::open::Request {
            log: Some(log.clone()),
            stack: Some("replay".to_owned()),
            course: course.map(str::to_owned),
            ..Default::default()
        };
        let frame = ocu_app::stacks::open(&request).unwrap().frame();
        let params = frame.topic("/waypoint_generator/params").unwrap().latest.clone().unwrap();
        params.message.value().unwrap().field("goal").cloned()
    };
    assert!(goal(None).is_some());
    assert_eq!(goal(None), goal(Some("hill")));
    assert_ne!(goal(None), goal(Some("meadow")));
}
