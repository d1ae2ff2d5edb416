//! Damaged and implausible recordings, and impatient callers, with the built program.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Maximum time of a command on any of these files.
const MOST_TIME: Duration = Duration::from_secs(2);
const MOST_BYTES: u64 = 300 << 20;
/// Maximum time for drawing the window with a software driver; a graphics card needs less.
const MOST_TIME_DRAWING: Duration = Duration::from_secs(10);
/// Memory that a software driver needs for itself.
const DRIVER_BYTES: u64 = 250 << 20;

/// Result of a command.
struct Done {
    code: i32,
    out: String,
    errors: String,
    took: Duration,
    /// Peak memory, bytes.
    peak: u64,
}

/// Runs `ocu`, which must exit by itself and not by a panic or a signal.
fn ocu(args: &[&str]) -> Done {
    let began = Instant::now();
    let mut child = Command::new(env!("CARGO_BIN_EXE_ocu"))
        .args(args)
        .env_remove("DISPLAY")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let read = |mut pipe: Box<dyn std::io::Read + Send>| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            pipe.read_to_end(&mut bytes).unwrap();
            bytes
        })
    };
    let out = read(Box::new(child.stdout.take().unwrap()));
    let errors = read(Box::new(child.stderr.take().unwrap()));
    let status_file = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        let text = std::fs::read_to_string(&status_file).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or_default();
        peak = peak.max(line.split_whitespace().next().and_then(|kb| kb.parse().ok()).unwrap_or(0) * 1024);
        if began.elapsed() > Duration::from_mins(2) {
            child.kill().unwrap();
            panic!("does not come back: {args:?}");
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let took = began.elapsed();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (out, errors) = (text(out.join().unwrap()), text(errors.join().unwrap()));
    let code = status.code().unwrap_or(-1);
    assert!((0..=3).contains(&code), "{args:?}: {status}: {errors}");
    assert!(!errors.contains("panicked"), "{args:?}: {errors}");
    Done { code, out, errors, took, peak }
}

impl Done {
    #[track_caller]
    fn within(self, time: Duration, bytes: u64) -> Self {
        // The dev profile is slower than a release, and tests share the machine.
        let room = if cfg!(debug_assertions) { 10 } else { 1 };
        assert!(self.took < time * room, "{:?}", self.took);
        assert!(self.peak < bytes, "{} MB", self.peak >> 20);
        self
    }

    #[track_caller]
    fn json(&self) -> Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error}: {}{}", self.out, self.errors))
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn hostile(data: &Path, name: &str) -> PathBuf {
    data.join("hostile").join(name)
}

/// The hostile recordings in a folder, sorted by name.
fn recordings(data: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(data.join("hostile")).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<PathBuf> =
        entries.filter(|path| path.extension().is_some_and(|it| it == "mcap")).collect();
    paths.sort();
    assert!(paths.len() >= 13, "{paths:?}");
    paths
}

#[test]
fn info_says_the_right_thing_of_every_hostile_recording() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    for path in recordings(&data) {
        let name = path.file_name().unwrap().to_str().unwrap();
        let report = ocu(&["info", text(&path), "--json"]).within(MOST_TIME, MOST_BYTES).json();
        let messages = report["messages"].as_u64().unwrap();
        let lost = report["lost"]["messages"].as_u64().unwrap();
        let problems = report["problems"].as_array().unwrap();
        let told = |words: &str| problems.iter().any(|problem| problem.as_str().unwrap().contains(words));
        let is = |what: bool| assert!(what, "{name}: {report:#}");
        match name {
            "husky_onebit_624587.mcap" => {
                is(messages + lost == 16_806
                    && (1..100).contains(&lost)
                    && told("log times that are not within"));
                is(report["duration_s"].as_f64().unwrap() < 396.0);
            }
            "tradr_t0.mcap" => {
                is(messages == 65 && problems.is_empty());
                is(report["gaps"].as_array().unwrap().len() == 1);
            }
            "stat_max.mcap" => is(messages == 16_806 && told("statistics")),
            "REPRO_allones.mcap" => is(messages + lost == 826 && messages >= 824 && told("length")),
            "cdrtest-cut-s3-130-chunk-usize.mcap" => is(messages == 7 && told("contents")),
            "del1000_tradr_chunk1.mcap" => {
                is(messages >= 60 && messages + lost == 65 && !problems.is_empty());
            }
            "proto_editions2023.mcap" => is(report["topics"][0]["decodable"] == true),
            "proto_bad_syntax.mcap" => is(report["topics"][0]["decodable"] == false),
            "bomb_zstd.mcap" => is(!problems.is_empty()),
            "cloud_far_point.mcap" | "path_far_pose.mcap" | "path_utm_in_local.mcap" => is(messages >= 1),
            "escape_topic.mcap" => is(messages == 1),
            other => panic!("{other}: say here what is right"),
        }
    }
}

#[test]
fn names_of_others_do_not_reach_the_terminal_as_control_characters() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    for path in recordings(&data) {
        for command in ["info", "check"] {
            let done = ocu(&[command, text(&path)]);
            for stream in [&done.out, &done.errors] {
                assert!(
                    !stream.chars().any(|c| c.is_control() && c != '\n'),
                    "{command} {}: {stream:?}",
                    path.display()
                );
            }
        }
    }
    let done = ocu(&["info", text(&hostile(&data, "escape_topic.mcap"))]);
    assert!(done.out.contains("\\u{1b}"), "{}", done.out);
}

#[test]
fn check_finds_the_sound_sound_and_the_damaged_damaged() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let sound = ocu(&["check", text(&data.join("real-logs/husky_outdoor_ros2.mcap")), "--json"]);
    assert_eq!(sound.code, 0, "{}", sound.out);
    assert_eq!((&sound.json()["sound"], &sound.json()["messages"]), (&true.into(), &16_806.into()));
    for path in recordings(&data) {
        let name = path.file_name().unwrap().to_str().unwrap();
        let done = ocu(&["check", text(&path), "--json"]).within(MOST_TIME, MOST_BYTES);
        let is_sound = match name {
            // A schema that cannot be read, implausible contents and odd names are no damage to the recording.
            "proto_bad_syntax.mcap"
            | "proto_editions2023.mcap"
            | "cloud_far_point.mcap"
            | "path_far_pose.mcap"
            | "path_utm_in_local.mcap"
            | "tradr_t0.mcap"
            | "escape_topic.mcap" => true,
            "husky_onebit_624587.mcap"
            | "stat_max.mcap"
            | "REPRO_allones.mcap"
            | "cdrtest-cut-s3-130-chunk-usize.mcap"
            | "del1000_tradr_chunk1.mcap"
            | "bomb_zstd.mcap" => false,
            other => panic!("{other}: say here what is right"),
        };
        let code = if is_sound { 0 } else { 3 };
        assert_eq!((done.code, &done.json()["sound"]), (code, &is_sound.into()), "{name}: {}", done.out);
    }
}

#[test]
fn a_run_on_every_hostile_recording_comes_back_and_says_what_it_could_not_read() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let stack = |name: &str| {
        if name.starts_with("husky") || name == "stat_max.mcap" { "husky" } else { "forest_robot" }
    };
    for path in recordings(&data) {
        let name = path.file_name().unwrap().to_str().unwrap();
        let run = ["run", "--stack", stack(name), "--log", text(&path), "--json"];
        let done = ocu(&run).within(MOST_TIME, MOST_BYTES);
        let expected = match name {
            "tradr_t0.mcap" => 0,
            "husky_onebit_624587.mcap" | "stat_max.mcap" | "del1000_tradr_chunk1.mcap" => 3,
            // They have none of the topics that the stack reads, which is refused.
            "REPRO_allones.mcap"
            | "cdrtest-cut-s3-130-chunk-usize.mcap"
            | "bomb_zstd.mcap"
            | "proto_bad_syntax.mcap"
            | "proto_editions2023.mcap"
            | "cloud_far_point.mcap"
            | "path_far_pose.mcap"
            | "path_utm_in_local.mcap"
            | "escape_topic.mcap" => 2,
            other => panic!("{other}: say here what is right"),
        };
        assert_eq!(done.code, expected, "{name}: {}{}", done.out, done.errors);
        match done.code {
            2 => assert!(done.errors.contains("the log has no topic"), "{name}: {}", done.errors),
            3 => assert!(!done.json()["log"]["problems"].as_array().unwrap().is_empty(), "{name}"),
            _ => {}
        }
    }
}

#[test]
fn every_hostile_recording_is_drawn() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let dir = tempfile::tempdir().unwrap();
    for path in recordings(&data) {
        for layout in ["tracks", "default"] {
            let name = path.file_stem().unwrap().to_str().unwrap();
            let png = dir.path().join(format!("{name}.{layout}.png"));
            let args = ["--layout", layout, "--at", "0", "--size", "800x450", "-o", text(&png)];
            let args: Vec<&str> = ["render", text(&path)].into_iter().chain(args).collect();
            let done = ocu(&args).within(MOST_TIME_DRAWING, MOST_BYTES + DRIVER_BYTES);
            assert!([0, 3].contains(&done.code), "{name}: {}", done.errors);
            assert!(png.is_file(), "{name}");
        }
    }
}

#[test]
fn a_run_never_writes_onto_what_it_reads_nor_over_another_file_without_being_told() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("drive.mcap");
    ocu_app::sample::write(&log, 1.0, false).unwrap();
    let before = std::fs::read(&log).unwrap();
    let link = dir.path().join("link.mcap");
    std::os::unix::fs::symlink(&log, &link).unwrap();
    let stack = dir.path().join("own.toml");
    let own = "format = 1\nname = \"own\"\n[[input]]\nbuffer = \"/gps\"\ntopic = \"/vehicle/gps\"\n\
               type = \"foxglove.LocationFix\"\n";
    std::fs::write(&stack, own).unwrap();
    let spelled = format!("{}/./drive.mcap", dir.path().display());
    let save = |path: &Path| format!("/gps={}", path.display());
    let run = |more: &[&str]| {
        let args: Vec<&str> =
            ["run", "--stack", text(&stack), "--log", text(&log)].iter().chain(more).copied().collect();
        ocu(&args)
    };
    for force in [&[][..], &["--force"]] {
        for record in [text(&log), &spelled, text(&link), text(&stack)] {
            let done = run(&[&["--record", record], force].concat());
            assert_eq!(done.code, 2, "{record}: {}", done.errors);
            let done = run(&[&["--save", &save(Path::new(record))], force].concat());
            assert_eq!(done.code, 2, "{record}: {}", done.errors);
        }
    }
    assert_eq!(std::fs::read(&log).unwrap(), before);
    assert_eq!(std::fs::read_to_string(&stack).unwrap(), own);

    let out = dir.path().join("out.mcap");
    assert_eq!(run(&["--record", text(&out)]).code, 0);
    let first = std::fs::read(&out).unwrap();
    let done = run(&["--record", text(&out)]);
    assert!(done.code == 2 && done.errors.contains("--force"), "{}", done.errors);
    assert_eq!(std::fs::read(&out).unwrap(), first);
    assert_eq!(run(&["--record", text(&out), "--force"]).code, 0);
    let left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().collect();
    assert_eq!(left.len(), 4, "{left:?}");

    assert_eq!(ocu(&["sample", text(&out), "--duration", "0.1"]).code, 2);
    assert_eq!(ocu(&["sample", text(&out), "--duration", "0.1", "--force"]).code, 0);
    let render =
        ["render", text(&log), "--layout", "default", "--at", "0", "--size", "64x64", "--force", "-o"];
    assert_eq!(ocu(&[&render[..], &[text(&log)]].concat()).code, 2);
    assert_eq!(std::fs::read(&log).unwrap(), before);
}

#[test]
fn no_command_writes_onto_a_part_of_the_recording_that_it_reads() {
    let dir = tempfile::tempdir().unwrap();
    let [first, second] = ["drive_0.mcap", "drive_1.mcap"].map(|name| dir.path().join(name));
    ocu_app::sample::write(&first, 0.5, false).unwrap();
    let before = std::fs::read(&first).unwrap();
    std::fs::write(&second, &before).unwrap();
    let (log, part) = (text(&first), text(&second));
    let render = ["render", "--at", "0", "--size", "64x64"];
    for args in [
        &["cut", log][..],
        &["export", log, "--fields", "/vehicle/imu"],
        &["tune", "--log", log, "--stack", "lagr"],
        &[&render[..], &[log]].concat()[..],
        &[&render[..], &["--stack", "truth_driver", "--against", log]].concat()[..],
    ] {
        let done = ocu(&[args, &["--force", "-o", part]].concat());
        assert!(done.code == 2 && done.errors.contains("the file is the recording"), "{}", done.errors);
        assert_eq!(std::fs::read(&second).unwrap(), before);
    }
}

#[test]
fn pipes_devices_and_texts_that_are_none_are_refused_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let pipe = dir.path().join("pipe.toml");
    let made = Command::new("mkfifo").arg(&pipe).status();
    let bad = dir.path().join("bad.toml");
    std::fs::write(&bad, b"format = 1\nname = \"\xff\"\n").unwrap();
    let done = ocu(&["run", "--stack", text(&bad), "--until", "1"]);
    assert!(done.code == 2 && done.errors.contains("line 2"), "{}", done.errors);
    assert_eq!(ocu(&["run", "--stack", "/dev/zero", "--until", "1"]).code, 2);
    assert_eq!(ocu(&["run", "--stack", "simulation", "--until", "1", "--record", "/dev/null"]).code, 2);
    if made.is_ok_and(|status| status.success()) {
        assert_eq!(ocu(&["run", "--stack", text(&pipe), "--until", "1"]).code, 2);
        assert_eq!(ocu(&["info", text(&pipe)]).code, 2);
        assert_eq!(ocu(&["run", "--stack", "simulation", "--until", "1", "--record", text(&pipe)]).code, 2);
    }
}

#[test]
fn a_stack_that_reads_a_recording_says_so_where_none_is_given() {
    let done = ocu(&["run", "--stack", "husky", "--until", "3"]);
    assert!(done.code == 2 && done.errors.contains("--log"), "{}", done.errors);
}

#[test]
fn the_same_input_twice_is_refused() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let log = data.join("real-logs/husky_outdoor_ros2.mcap");
    let done = ocu(&["run", "--stack", text(&hostile(&data, "duplicate_input.toml")), "--log", text(&log)]);
    assert!(done.code == 2 && done.errors.contains("/fix"), "{}", done.errors);
}

#[test]
fn the_hash_does_not_know_what_a_person_called_the_files() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let dir = tempfile::tempdir().unwrap();
    let log = data.join("hostile/tradr_t0.mcap");
    let link = dir.path().join("other name.mcap");
    std::os::unix::fs::symlink(&log, &link).unwrap();
    let own = "format = 1\nname = \"own\"\n[[input]]\nbuffer = \"/gps\"\ntopic = \"/vehicle/gps\"\n\
               type = \"foxglove.LocationFix\"\n";
    let drive = dir.path().join("drive.mcap");
    ocu_app::sample::write(&drive, 1.0, false).unwrap();
    let copy = dir.path().join("x/../renamed.mcap");
    std::fs::create_dir(dir.path().join("x")).unwrap();
    std::fs::copy(&drive, &copy).unwrap();
    let stacks = ["a.toml", "b.toml"].map(|name| dir.path().join(name));
    for stack in &stacks {
        std::fs::write(stack, own).unwrap();
    }
    let hash = |stack: &str, log: &Path| {
        let done = ocu(&["run", "--stack", stack, "--log", text(log), "--json"]);
        assert_eq!(done.code, 0, "{}", done.errors);
        done.json()["hash"].as_str().unwrap().to_owned()
    };
    assert_eq!(hash("forest_robot", &log), hash("forest_robot", &link));
    let first = hash(text(&stacks[0]), &drive);
    assert_eq!(first, hash(text(&stacks[0]), &copy));
    assert_eq!(first, hash(text(&stacks[1]), &drive), "another name of the stack's file");
}

#[test]
fn a_closed_standard_output_hides_no_error() {
    let Ok(full) = std::fs::OpenOptions::new().write(true).open("/dev/full") else { return };
    let mut plugins = Command::new(env!("CARGO_BIN_EXE_ocu"));
    let output = plugins.arg("plugins").stdout(full).stderr(Stdio::piped()).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1), "{errors}");
    assert!(errors.contains("cannot write to standard output: "), "{errors}");
    let dir = tempfile::tempdir().unwrap();
    let save = format!("/nothing={}", dir.path().join("x.json").display());
    let mut child = Command::new(env!("CARGO_BIN_EXE_ocu"))
        .args(["run", "--stack", "simulation", "--until", "0.2", "--json"])
        .args(["--save", &save])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    // A reader that closes the output early is not an error.
    let mut child = Command::new(env!("CARGO_BIN_EXE_ocu"))
        .args(["run", "--stack", "simulation", "--until", "0.2", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Runs `ocu` with an upper limit of the size of files, where a write fails as on a full disk.
fn ocu_on_a_small_disk(kilobytes: u32, args: &[&str]) -> Option<Done> {
    // Without the signal, a write beyond the limit is an error. The shell hands both over to the program.
    let script = "trap '' XFSZ; ulimit -f \"$1\" || exit 99; shift; exec \"$@\"";
    let blocks = (u64::from(kilobytes) * 1024 / 512).to_string();
    let began = Instant::now();
    let output = Command::new("sh")
        .args(["-c", script, "sh", &blocks, env!("CARGO_BIN_EXE_ocu")])
        .args(args)
        .env_remove("DISPLAY")
        .output();
    let output = match output {
        Ok(output) if output.status.code() != Some(99) => output,
        _ => {
            eprintln!("skipped: the size of files cannot be limited here");
            return None;
        }
    };
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (code, took) = (output.status.code().unwrap_or(-1), began.elapsed());
    Some(Done { code, out: text(output.stdout), errors: text(output.stderr), took, peak: 0 })
}

#[test]
fn a_full_disk_ends_the_run_at_once_and_leaves_a_readable_recording() {
    let dir = tempfile::tempdir().unwrap();
    let record = dir.path().join("full.mcap");
    let run = ["run", "--stack", "simulation", "--json", "--record", text(&record)];
    // The stack records about 14 MB in a second: 4 MB are full long before the end.
    let Some(done) = ocu_on_a_small_disk(4096, &[&run[..], &["--until", "10"]].concat()) else { return };
    assert_eq!(done.code, 1, "{}{}", done.out, done.errors);
    assert!(done.errors.contains("full.mcap") && done.errors.contains("byte"), "{}", done.errors);
    let report = done.json();
    assert_eq!(report["outcome"], "error");
    let ran_s = report["time_s"].as_f64().unwrap();
    assert!(ran_s < 3.0, "it goes on until {ran_s} s");
    let size = record.metadata().unwrap().len();
    assert!((3_000_000..=4096 * 1024).contains(&size), "{size} bytes");
    let info = ocu(&["info", text(&record), "--json"]).json();
    assert!(info["messages"].as_u64().unwrap() > 100, "{info}");
    assert_eq!(info["recovered"], true);

    // With --keep-going the run is complete, and the failure is reported nevertheless.
    std::fs::remove_file(&record).unwrap();
    let keep = [&run[..], &["--until", "2", "--keep-going"]].concat();
    let done = ocu_on_a_small_disk(4096, &keep).unwrap();
    assert_eq!(done.code, 1, "{}{}", done.out, done.errors);
    assert!((done.json()["time_s"].as_f64().unwrap() - 2.0).abs() < 0.1, "{}", done.out);
    assert!(done.errors.contains("full.mcap"), "{}", done.errors);
}

#[test]
fn a_live_run_on_a_full_disk_prints_its_report_and_saves_messages_nevertheless() {
    let dir = tempfile::tempdir().unwrap();
    let (record, saved) = (dir.path().join("full.mcap"), dir.path().join("vehicle.json"));
    let save = format!("/vehicle_interface/vehicle={}", saved.display());
    let run = ["run", "--live", "--stack", "simulation", "--json", "--record", text(&record)];
    let more = ["--save", &save, "--until", "2", "--keep-going"];
    let Some(done) = ocu_on_a_small_disk(1024, &[&run[..], &more].concat()) else { return };
    assert_eq!(done.code, 1, "{}{}", done.out, done.errors);
    assert!(done.errors.contains("full.mcap"), "{}", done.errors);
    let report = done.json();
    assert_eq!(report["outcome"], "error");
    assert!(report["time_s"].as_f64().unwrap() > 1.9, "{report}");
    assert!(saved.is_file());
}

#[test]
fn a_full_disk_is_reported_by_every_command_that_writes() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("drive.mcap");
    ocu_app::sample::write(&log, 1.0, false).unwrap();
    let out = |name: &str| dir.path().join(name);
    let (sample, png, json) = (out("sample.mcap"), out("a.png"), out("a.json"));
    let save = format!("/wm1/map={}", json.display());
    let commands: [&[&str]; 3] = [
        &["sample", text(&sample), "--duration", "1"],
        &["render", text(&log), "--layout", "default", "--at", "0.5", "--size", "800x450", "-o", text(&png)],
        &["run", "--stack", "sample", "--log", text(&log), "--save", &save],
    ];
    for command in commands {
        let Some(done) = ocu_on_a_small_disk(8, command) else { return };
        assert_eq!(done.code, 1, "{command:?}: {}{}", done.out, done.errors);
        assert!(done.errors.contains(text(dir.path())), "{command:?} names its file: {}", done.errors);
    }
    assert!(!png.exists() && !json.exists(), "a part of a file was left");
}
