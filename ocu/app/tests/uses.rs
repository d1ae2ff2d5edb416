//! What a user does with the window beyond playing and driving: looking at buffers and events, bookmarks, branches.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::window::{
    closes, drop_file, frame, has_told, open, recording, running, stack, type_text, wait_for, wait_until,
    writes,
};
use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable;
use ocu_app::layout::Layout;
use ocu_app::window::Options;
use rcs_runtime::source::EventKind;

fn named(layout: &str) -> Layout {
    Layout::named(layout).unwrap()
}

#[test]
fn a_click_on_a_buffer_shows_its_fields_even_if_no_view_lists_any() {
    let dir = tempfile::tempdir().unwrap();
    for layout in [named("tracks"), Layout::empty()] {
        let mut harness = recording(dir.path(), layout);
        harness.run_steps(3);
        harness.get_by_label("/vehicle/imu").click();
        harness.run_steps(4);
        assert!(harness.query_all_by_label_contains("angular_velocity").next().is_some());
    }
}

/// Goes to the start and drives by hand from there, which begins a second run. So far back, the key is held before the past
/// has been played to its end, on a busy machine, too. A key that is pressed while time stands must be let go first.
fn drive_from_the_start(harness: &mut egui_kittest::Harness<'_, common::window::State>) {
    harness.key_press(Key::Home);
    wait_until(harness, "the start", |frame| frame.time_s() < 0.1);
    harness.key_press(Key::Space);
    wait_until(harness, "time to run", |frame| frame.playback.playing);
    harness.key_down(Key::W);
    wait_until(harness, "another run", |frame| frame.runs.all.len() == 2);
    harness.key_up(Key::W);
}

#[test]
fn a_branch_is_announced_and_leaving_it_is_asked() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.key_down(Key::W);
    wait_until(&mut harness, "a write", |frame| frame.runs.all.iter().any(|run| run.writes > 0));
    harness.key_up(Key::W);
    wait_until(&mut harness, "some time", |frame| frame.time_s() > 4.0);
    harness.key_press(Key::Space);
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    harness.run_steps(2);
    let moment = frame(&harness).unwrap();
    let events = moment.events().unwrap();
    assert!(events.counts()[EventKind::Operator as usize] >= 1, "{:?}", events.counts());
    // To the event before: the start of driving, or the last change of a mode.
    harness.key_press_modifiers(Modifiers::SHIFT, Key::N);
    let from = moment.now;
    wait_until(&mut harness, "an event before", |frame| frame.now < from);
    harness.run_steps(2);
    assert!(harness.query_by_label("PAST").is_some());
    drive_from_the_start(&mut harness);
    harness.run_steps(3);
    assert!(harness.query_by_label_contains(" begins at 00:00:0").is_some());

    harness.get_by_label("Start again from the beginning").click();
    harness.run_steps(3);
    harness.get_by_label("Stay").click();
    harness.run_steps(3);
    assert!(harness.query_by_label("Stay").is_none());
    assert_eq!(frame(&harness).unwrap().runs.all.len(), 2, "nothing was left");
    harness.get_by_label("Start again from the beginning").click();
    harness.run_steps(3);
    harness.get_by_label_contains("Leave it").click();
    wait_until(&mut harness, "a new run", |frame| frame.runs.all.len() == 1 && frame.playback.playing);
}

#[test]
fn the_word_past_leads_to_the_newest_time_of_the_run_that_is_shown() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    wait_until(&mut harness, "some time", |frame| frame.time_s() > 4.0);
    for count in [1, 2] {
        harness.key_press(Key::Space);
        wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
        harness.run_steps(2);
        let newest = frame(&harness).unwrap().now;
        assert!(harness.query_by_label("PAST").is_none());
        harness.key_press(Key::Home);
        wait_until(&mut harness, "the start", |frame| frame.time_s() < 0.1);
        harness.run_steps(2);
        harness.get_by_role_and_label(egui::accesskit::Role::Button, "PAST").click();
        wait_until(&mut harness, "the newest time", |frame| frame.runs.is_at_end);
        let moment = frame(&harness).unwrap();
        assert_eq!((moment.now, moment.runs.all.len()), (newest, count), "nothing more was computed");
        harness.run_steps(2);
        assert!(harness.query_by_label("PAST").is_none());
        if count == 2 {
            return;
        }
        // A shorter run that branches from this one.
        drive_from_the_start(&mut harness);
        wait_until(&mut harness, "some of it", |frame| frame.time_s() > 1.0);
    }
}

#[test]
fn a_window_closes_at_once_where_nothing_is_lost_and_asks_where_something_would_be() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    assert!(closes(&mut harness), "a run without writes");
    harness.key_down(Key::W);
    wait_until(&mut harness, "a write", |frame| writes(frame) > 0);
    harness.key_up(Key::W);
    harness.run_steps(3);
    assert!(!closes(&mut harness));
    harness.run_steps(3);
    assert!(is_told(&harness, "it cannot be shown again"));
    harness.get_by_label("Stay").click();
    harness.run_steps(3);
    assert!(harness.query_by_label("Stay").is_none());
    assert!(frame(&harness).unwrap().playback.playing, "the run goes on");

    assert!(!closes(&mut harness), "it asks each time");
    harness.run_steps(3);
    harness.get_by_label("Leave it, close the window").click();
    wait_for(&mut harness, "the close", |harness| has_told(harness, &egui::ViewportCommand::Close));
    assert!(closes(&mut harness), "the user has agreed");

    harness.get_by_label("Start again from the beginning").click();
    harness.run_steps(3);
    harness.get_by_label_contains("Leave it").click();
    let is_new = |frame: &rcs_runtime::source::Frame| writes(frame) == 0 && frame.time_s() > 0.2;
    wait_until(&mut harness, "a new run", |frame| frame.playback.playing && is_new(frame));
    harness.key_down(Key::W);
    wait_until(&mut harness, "a write", |frame| writes(frame) > 0);
    harness.key_up(Key::W);
    harness.run_steps(3);
    assert!(!closes(&mut harness), "what the user agreed to was another run");
}

#[test]
fn a_file_that_is_not_there_is_refused_before_the_user_is_asked_to_leave_the_run() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.key_down(Key::W);
    wait_until(&mut harness, "a write", |frame| writes(frame) > 0);
    harness.key_up(Key::W);
    harness.run_steps(3);
    for name in ["absent.mcap", "absent.toml"] {
        drop_file(&mut harness, &dir.path().join(name));
        harness.run_steps(3);
        assert!(harness.query_by_label("Stay").is_none(), "{name}");
        assert!(is_told(&harness, "there is no such file") && is_told(&harness, name), "{name}");
    }
}

#[test]
fn a_file_that_is_dropped_or_chosen_takes_the_place_of_a_run_only_where_the_user_agrees() {
    let dir = tempfile::tempdir().unwrap();
    let recording = common::window::sample(dir.path()).log.unwrap();
    let mut harness = running(dir.path());
    harness.key_down(Key::W);
    wait_until(&mut harness, "a write", |frame| writes(frame) > 0);
    harness.key_up(Key::W);
    harness.run_steps(3);

    drop_file(&mut harness, &recording);
    harness.run_steps(3);
    harness.get_by_label("Stay").click();
    harness.run_steps(3);
    assert!(harness.query_by_label("Stay").is_none());

    harness.key_press_modifiers(Modifiers::COMMAND, Key::O);
    harness.run_steps(3);
    harness.get_by_label("Path").type_text(recording.to_str().unwrap());
    harness.run_steps(2);
    harness.key_press(Key::Enter);
    wait_for(&mut harness, "the question", |harness| harness.query_by_label("Stay").is_some());
    assert!(frame(&harness).unwrap().info.end.is_none(), "the run is still shown");
    harness.get_by_label("Leave it, open drive.mcap").click();
    wait_until(&mut harness, "the recording", |frame| frame.info.title == "drive.mcap");
}

#[test]
fn the_word_past_on_a_recording_leads_to_what_was_computed_and_not_to_the_end_of_the_recording() {
    let dir = tempfile::tempdir().unwrap();
    let log = common::window::sample(dir.path()).log;
    let request = ocu_app::open::Request { log, stack: Some("sample".to_owned()), ..Default::default() };
    let mut harness = open(Options { request, layout: Some(Layout::empty()), ..Options::default() });
    harness.run_steps(3);
    harness.key_press(Key::Period);
    wait_until(&mut harness, "a second", |frame| frame.time_s() > 0.9 && frame.runs.is_at_end);
    harness.run_steps(2);
    let newest = frame(&harness).unwrap().now;
    harness.key_press(Key::Home);
    wait_until(&mut harness, "the start", |frame| frame.time_s() < 0.1);
    harness.run_steps(2);
    harness.get_by_role_and_label(egui::accesskit::Role::Button, "PAST").click();
    wait_until(&mut harness, "the newest time", |frame| frame.runs.is_at_end);
    let moment = frame(&harness).unwrap();
    assert_eq!(moment.now, newest);
    assert!(moment.info.end.is_some_and(|end| newest < end), "nothing more was computed");
}

#[test]
fn a_bookmark_is_set_by_key_and_kept_beside_the_recording() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = recording(dir.path(), named("recording"));
    harness.key_press(Key::End);
    wait_until(&mut harness, "the end", |frame| Some(frame.now) == frame.info.end);
    harness.key_press(Key::M);
    harness.run_steps(2);
    let text = std::fs::read_to_string(dir.path().join("drive.mcap.marks.json")).unwrap();
    let end = frame(&harness).unwrap().now.0;
    assert!(text.contains(&end.to_string()), "{text}");
    harness.get_by_label("Bookmarks").click();
    harness.run_steps(3);
    assert!(harness.query_by_label_contains("Remove the bookmark at").is_some());
}

#[test]
fn the_wheel_zooms_the_timeline_and_a_button_shows_the_whole_again() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = recording(dir.path(), named("recording"));
    harness.run_steps(3);
    assert!(harness.query_by_label("Show the whole time").is_none());
    let bar = harness.get_by_label("Time").rect();
    harness.hover_at(bar.center());
    harness.run_steps(2);
    harness.input_mut().events.push(egui::Event::MouseWheel {
        unit: egui::MouseWheelUnit::Point,
        delta: egui::vec2(0.0, 400.0),
        modifiers: Modifiers::NONE,
        phase: egui::TouchPhase::Move,
        source: egui::MouseWheelSource::Unknown,
    });
    harness.run_steps(12);
    harness.get_by_label("Bookmarks").click();
    harness.run_steps(3);
    harness.get_by_label("Keep the range that is shown").click();
    harness.run_steps(3);
    let text = std::fs::read_to_string(dir.path().join("drive.mcap.marks.json")).unwrap();
    assert!(text.contains("end_ns"), "{text}");
    assert!(harness.query_by_label_contains("Remove the bookmark at 00:00:0").is_some());
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Period);
    harness.run_steps(3);
    harness.get_by_label("Show the whole time").click();
    harness.run_steps(3);
    assert!(harness.query_by_label("Show the whole time").is_none());
}

/// Text of the notices that the window shows.
fn is_told(harness: &egui_kittest::Harness<'_, common::window::State>, part: &str) -> bool {
    harness.query_all_by_label_contains(part).next().is_some()
}

#[test]
fn a_run_is_recorded_from_the_window_and_the_file_opens_and_repeats() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    let file = dir.path().join("mine.mcap");
    harness.key_down(Key::W);
    wait_until(&mut harness, "a write before", |frame| frame.runs.all.iter().any(|run| run.writes > 0));
    harness.key_up(Key::W);
    let from = frame(&harness).unwrap().time_s();
    wait_until(&mut harness, "a while without driving", |frame| frame.time_s() > from + 0.3);
    harness.get_by_label("Record").click();
    harness.run_steps(4);
    type_text(&mut harness, "File", file.to_str().unwrap());
    harness.get_by_label("Start").click();
    let is_running = |frame: &rcs_runtime::source::Frame| {
        frame.recording.as_ref().is_some_and(|recording| recording.ended.is_none())
    };
    wait_until(&mut harness, "the recording", is_running);
    harness.run_steps(2);
    assert!(harness.query_by_label("End the recording").is_some());
    let from = frame(&harness).unwrap().time_s();
    harness.key_down(Key::W);
    wait_until(&mut harness, "a second of it", |frame| frame.time_s() > from + 1.0);
    harness.key_up(Key::W);
    wait_until(&mut harness, "half a second without driving", |frame| frame.time_s() > from + 1.5);
    harness.get_by_label("End the recording").click();
    wait_until(&mut harness, "its end", |frame| !is_running(frame));
    harness.run_steps(3);
    assert!(is_told(&harness, "Recorded 00:00:0"), "it says what was recorded");

    let log = rcs_log::Log::open(&file).unwrap();
    assert_eq!(log.info().problems, Vec::<String>::new());
    assert!(log.info().topics_named("/operator/teleop").next().is_some());
    let (code, out, error) = common::ocu(&["run", "--replay", common::text(&file), "--json"]);
    assert_eq!(code, 0, "{out} {error}");
    assert_eq!(common::json(&out)["replay"]["equal"], true, "{out}");
}

#[test]
fn what_a_run_remembers_is_saved_and_another_run_begins_with_it() {
    let dir = tempfile::tempdir().unwrap();
    let request = ocu_app::open::Request { stack: Some("lagr".to_owned()), ..Default::default() };
    let view = r#"View(kind: "conditions")"#;
    let text =
        format!("Layout(version: 1, name: \"conditions\", buffers: false, root: Row([(1.0, {view})]))");
    let layout = Some(Layout::parse("conditions.ron", &text).unwrap());
    let mut harness = open(Options { request, layout, ..Options::default() });
    let models = |frame: &rcs_runtime::source::Frame| {
        let params = frame.topic("/terrain/params")?.latest.as_ref()?.message.value().ok()?;
        params.field("models").cloned()
    };
    wait_until(&mut harness, "its stand", |frame| frame.time_s() > 0.5);
    harness.key_press(Key::Space);
    wait_until(&mut harness, "a map", |frame| frame.time_s() > 1.5);
    harness.key_press(Key::Space);
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    let of_stack = models(&frame(&harness).unwrap());
    let unsent = "/wm1/status.faults > 0";
    type_text(&mut harness, "New condition", unsent);

    let choose = |harness: &mut egui_kittest::Harness<'_, common::window::State>, seed: u64, name: &str| {
        harness.get_by_label_contains(&format!("seed {seed}")).click();
        harness.run_steps(3);
        harness.get_by_label(name).click();
        harness.run_steps(4);
    };
    choose(&mut harness, 0, "Save what this run remembers…");
    let file = dir.path().join("remembered.json");
    type_text(&mut harness, "File", file.to_str().unwrap());
    harness.get_by_role_and_label(egui::accesskit::Role::Button, "Save").click();
    wait_for(&mut harness, "the file", |_| file.exists());
    harness.run_steps(2);
    assert!(is_told(&harness, "Saved: "));

    choose(&mut harness, 0, "Next run, with what this one remembers");
    let begins = |frame: &rcs_runtime::source::Frame| models(frame).is_some_and(|now| Some(now) != of_stack);
    wait_until(&mut harness, "the next run", begins);
    assert!(is_told(&harness, "meadow, seed 1"));
    assert!(is_told(&harness, "is given what an earlier run remembers: "));
    let written = harness.get_by_label("New condition").value();
    assert_eq!(written.as_deref(), Some(unsent), "what was not sent stays");
    harness.get_by_label_contains("seed 1").click();
    harness.run_steps(3);
    let seed = harness.get_by_role(egui::accesskit::Role::SpinButton).value();
    assert_eq!(seed.as_deref(), Some("1"), "the seed of this run");

    let other = dir.path().join("other.json");
    std::fs::write(&other, r#"{"format": 2, "remembered": {}}"#).unwrap();
    drop_file(&mut harness, &other);
    wait_for(&mut harness, "the reason", |harness| is_told(harness, "format is 2, expected 1"));
    assert!(is_told(&harness, "meadow, seed 1"), "the run stays");

    let request = ocu_app::open::Request { stack: Some("lagr".to_owned()), ..Default::default() };
    let mut harness = open(Options { request, layout: Some(Layout::empty()), ..Options::default() });
    drop_file(&mut harness, &file);
    wait_until(&mut harness, "a run with the file", begins);
}

#[test]
fn no_recording_is_written_over_a_file_and_another_run_ends_it() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    let file = dir.path().join("taken.mcap");
    std::fs::write(&file, "precious").unwrap();
    let record_to = |harness: &mut egui_kittest::Harness<'_, common::window::State>, path: &str| {
        harness.get_by_label("Record").click();
        harness.run_steps(4);
        harness.get_by_label("File").focus();
        harness.run_steps(2);
        harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
        harness.run_steps(2);
        harness.get_by_label("File").type_text(path);
        harness.run_steps(2);
        harness.get_by_label("Start").click();
    };
    record_to(&mut harness, file.to_str().unwrap());
    wait_until(&mut harness, "the refusal", |frame| frame.playback.error.is_some());
    harness.run_steps(2);
    assert!(is_told(&harness, "taken.mcap"));
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "precious");

    record_to(&mut harness, dir.path().join("first.mcap").to_str().unwrap());
    let ended = |frame: &rcs_runtime::source::Frame| Some(frame.recording.as_ref()?.ended.is_some());
    wait_until(&mut harness, "the recording", |frame| ended(frame) == Some(false));
    let from = frame(&harness).unwrap().time_s();
    wait_until(&mut harness, "some time", |frame| frame.time_s() > from + 1.2);
    harness.key_press(Key::Home);
    wait_until(&mut harness, "the past", |frame| !frame.runs.is_at_end);
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "another run", |frame| frame.runs.all.len() == 2);
    assert_eq!(frame(&harness).and_then(|frame| ended(&frame)), Some(true));
    harness.run_steps(2);
    assert!(is_told(&harness, "another run is shown now"));
    let log = rcs_log::Log::open(dir.path().join("first.mcap")).unwrap();
    assert!(log.info().end.seconds_since(log.info().start) > 1.0);
    assert_eq!(log.info().problems, Vec::<String>::new());
}

#[test]
fn a_recording_that_is_still_being_written_is_followed_at_its_end() {
    use rcs_log::{LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::{AnyMessage, Stamp, foxglove::Vector3};
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("live.mcap");
    // Chunks are closed at once.
    let options = WriterOptions { chunk_bytes: 1, ..WriterOptions::default() };
    let mut writer = LogWriter::create(&path, options).unwrap();
    let message = AnyMessage::new(Vector3 { x: 1.0, ..Vector3::default() });
    let channel = writer.add_channel("/a", &message.schema(), &std::collections::BTreeMap::new()).unwrap();
    let mut write = |from_s: u64, to_s: u64| {
        for second in from_s..to_s {
            let time = Stamp(second * 1_000_000_000);
            let header = WriteHeader { sequence: second as u32, log_time: time, publish_time: time };
            writer.write(channel, header, &message.bytes()).unwrap();
        }
        writer.flush().unwrap();
    };
    write(1, 10);
    let request = ocu_app::open::Request { log: Some(path), ..Default::default() };
    let options = ocu_app::window::Options { request, ..Default::default() };
    let mut harness = common::window::open(options);
    let end = |frame: &rcs_runtime::source::Frame| frame.info.end.unwrap().0 / 1_000_000_000;
    let first = end(&frame(&harness).unwrap());
    // Who looks at an earlier moment stays there.
    write(10, 20);
    wait_until(&mut harness, "more of the file", |frame| end(frame) > first);
    assert_eq!(frame(&harness).unwrap().now.0, 1_000_000_000);
    assert!(harness.query_by_label("GROWING").is_some());
    harness.key_press(Key::End);
    wait_until(&mut harness, "the end", |frame| Some(frame.now) == frame.info.end);
    let second = end(&frame(&harness).unwrap());
    write(20, 40);
    wait_until(&mut harness, "the new end", |frame| end(frame) > second && Some(frame.now) == frame.info.end);
}

#[test]
fn the_next_file_of_a_recording_is_followed_although_the_last_one_was_finished() {
    use rcs_log::{LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::{AnyMessage, Stamp, foxglove::Vector3};
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, from_s: u64, to_s: u64| {
        let mut writer = LogWriter::create(dir.path().join(name), WriterOptions::default()).unwrap();
        let message = AnyMessage::new(Vector3 { x: 1.0, ..Vector3::default() });
        let channel =
            writer.add_channel("/a", &message.schema(), &std::collections::BTreeMap::new()).unwrap();
        for second in from_s..to_s {
            let time = Stamp(second * 1_000_000_000);
            let header = WriteHeader { sequence: second as u32, log_time: time, publish_time: time };
            writer.write(channel, header, &message.bytes()).unwrap();
        }
        writer.finish().unwrap();
    };
    write("live_0.mcap", 1, 10);
    let request = ocu_app::open::Request { log: Some(dir.path().to_owned()), ..Default::default() };
    let options = ocu_app::window::Options { request, ..Default::default() };
    let mut harness = common::window::open(options);
    let end = |frame: &rcs_runtime::source::Frame| frame.info.end.unwrap().0 / 1_000_000_000;
    assert_eq!(frame(&harness).unwrap().info.problems, Vec::<String>::new());
    for (name, from_s, to_s) in [("live_1.mcap", 10, 20), ("live_2.mcap", 20, 30)] {
        write(name, from_s, to_s);
        wait_until(&mut harness, name, |frame| end(frame) == to_s - 1);
    }
}

#[test]
fn the_open_dialog_completes_a_path_and_opens_what_is_clicked() {
    let dir = tempfile::tempdir().unwrap();
    let recording = common::window::sample(dir.path()).log.unwrap();
    let mut harness = common::window::harness(ocu_app::window::Options::default());
    harness.run_steps(3);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::O);
    harness.run_steps(3);
    harness.get_by_label("Path").type_text(&format!("{}/dri", dir.path().display()));
    let offered = recording.display().to_string();
    common::window::wait_for(&mut harness, "what is offered", |harness| {
        harness.query_by_label(&offered).is_some()
    });
    harness.key_press(Key::Tab);
    harness.run_steps(3);
    harness.key_press(Key::Enter);
    wait_until(&mut harness, "the recording", |frame| frame.info.title == "drive.mcap");
}

#[test]
fn a_sweep_runs_beside_the_open_stack_and_a_click_opens_a_run() {
    let dir = tempfile::tempdir().unwrap();
    let view = r#"View(kind: "sweep", state: { "runs": 3, "until_s": 0.5 })"#;
    let text = format!("Layout(version: 1, name: \"sweep\", buffers: false, root: Row([(1.0, {view})]))");
    let layout = Layout::parse("sweep.ron", &text).unwrap();
    let data_dir = Some(dir.path().join("data"));
    let mut harness = open(Options { request: stack(dir.path()), layout: Some(layout), data_dir });
    harness.run_steps(3);
    let run = format!("{}  Run", ocu_ui::icons::ICON_PLAY_ARROW.codepoint);
    harness.get_by_label(&run).click();
    wait_for(&mut harness, "three runs", |harness| {
        harness.query_by_label("Run with seed 2: ended").is_some() && harness.query_by_label(&run).is_some()
    });
    assert!(frame(&harness).unwrap().playback.playing, "the open stack goes on");
    harness.get_by_label("Run with seed 1: ended").click();
    wait_until(&mut harness, "the run", |frame| frame.info.end.is_some());
    harness.run_steps(3);
    assert!(harness.query_by_label("Run with seed 2: ended").is_some(), "the table stays");
    wait_until(&mut harness, "its time", |frame| frame.time_s() > 0.4);

    // It is a recording: no stack is open that could run once more.
    harness.key_press_modifiers(Modifiers::COMMAND, Key::K);
    harness.run_steps(3);
    harness.get_by_label("Find a command").type_text("Next run");
    harness.run_steps(3);
    harness.get_by_label("Next run, with what this one remembers").click();
    wait_for(&mut harness, "the reason", |harness| is_told(harness, "no stack is open that could begin"));
}
