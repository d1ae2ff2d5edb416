//! The complete window without a display.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::window::{
    PATIENCE, STACK, State, drop_file, frame, harness, open, sample, stack, type_number, type_text, wait_for,
};
use egui::{Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ocu_app::bundled;
use ocu_app::layout::{Layout, Node};
use ocu_app::open::Request;
use ocu_app::window::{Options, Window};
use ocu_views::{RunChoice, SavedState};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

fn time_s(harness: &Harness<'_, State>) -> Option<f64> {
    Some(harness.state().as_ref()?.frame()?.time_s())
}

/// Duration of the open recording, s, from its first message to its last.
fn length_s(harness: &Harness<'_, State>) -> Option<f64> {
    let frame = harness.state().as_ref()?.frame()?;
    Some(frame.info.end?.seconds_since(frame.info.start))
}

/// A time as shown by the window.
fn clock(seconds: f64) -> String {
    ocu_ui::format::clock((seconds * 1e9).round() as u64)
}

fn opened<'a>(dir: &Path) -> Harness<'a, State> {
    let mut harness = harness(Options { request: sample(dir), ..Options::default() });
    wait_for(&mut harness, "the recording opens", |harness| time_s(harness).is_some());
    harness
}

#[test]
fn an_empty_window_invites_to_open_something() {
    let mut harness = harness(Options::default());
    harness.run();
    assert!(harness.query_by_label("Nothing is open").is_some());
    harness.key_press_modifiers(Modifiers::COMMAND, Key::O);
    harness.run();
    assert!(harness.query_by_label("Path").is_some(), "the dialog has a field for a path");
    assert!(harness.query_by_label("ctrl . closes").is_some(), "where Escape would stop a vehicle");
}

#[test]
fn the_size_of_everything_is_changed_by_commands_that_are_found_by_their_names() {
    let mut harness = harness(Options::default());
    harness.run();
    for (name, zoom) in [("Larger", 1.1), ("Usual size", 1.0), ("Smaller", 0.9), ("Usual size", 1.0)] {
        harness.key_press_modifiers(Modifiers::COMMAND, Key::K);
        harness.run_steps(3);
        harness.get_by_label("Find a command").type_text(name);
        harness.run_steps(3);
        harness.get_by_label_contains(&format!("{name} (zoom")).click();
        harness.run_steps(3);
        assert!((harness.ctx.zoom_factor() - zoom).abs() < 1e-3, "{name}");
    }
    let zooms_besides = harness.ctx.options(|options| options.zoom_with_keyboard);
    assert!(!zooms_besides, "only the keys of the commands zoom");
}

#[test]
fn a_time_that_is_typed_is_gone_to() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    harness.key_press_modifiers(Modifiers::COMMAND, Key::K);
    harness.run_steps(3);
    harness.get_by_label("Find a command").type_text("00:01.5");
    harness.run_steps(3);
    harness.key_press(Key::Enter);
    wait_for(&mut harness, "the typed time", |harness| {
        time_s(harness).is_some_and(|now_s| (now_s - 1.5).abs() < 1e-6)
    });
}

#[test]
fn a_recording_that_cannot_be_opened_is_said_and_the_old_one_stays() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    let absent = dir.path().join("absent.mcap");
    drop_file(&mut harness, &absent);
    wait_for(&mut harness, "the notice", |harness| harness.query_by_label("Dismiss").is_some());
    assert!(harness.query_by_label_contains("absent.mcap").is_some());
    assert!(time_s(&harness).is_some(), "the old recording is still there");
    harness.get_by_label("Dismiss").click();
    harness.run();
    assert!(harness.query_by_label("Dismiss").is_none());
}

#[test]
fn a_dropped_recording_opens_and_shows_its_start() {
    let dir = tempfile::tempdir().unwrap();
    let request = sample(dir.path());
    let mut harness = harness(Options::default());
    harness.run();
    drop_file(&mut harness, &request.log.unwrap());
    wait_for(&mut harness, "the recording opens", |harness| time_s(harness).is_some());
    harness.run();
    // It opens at the first image, which the camera sends shortly after its first cycle.
    let start_s = time_s(&harness).unwrap();
    assert!(start_s < 0.2 && harness.query_all_by_label(&clock(start_s)).next().is_some(), "{start_s}");
    let length_s = length_s(&harness).unwrap();
    assert!((2.9..=3.0).contains(&length_s), "{length_s}");
    assert!(harness.query_by_label(&format!("/ {}", clock(length_s))).is_some());
}

#[test]
fn a_dropped_stack_runs_on_the_open_recording() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    let stack = dir.path().join("mine.toml");
    std::fs::write(&stack, include_str!("../../../assets/stacks/sample.toml")).unwrap();
    drop_file(&mut harness, &stack);
    wait_for(&mut harness, "the stack runs", |harness| harness.query_by_label("REPLAY").is_some());
}

#[test]
fn edits_that_were_not_sent_do_not_pass_to_another_source() {
    let dir = tempfile::tempdir().unwrap();
    let root = Node::View { kind: "tuning".into(), state: SavedState::Null, run: RunChoice::Shown, id: 0 };
    let layout = Some(Layout { root, ..Layout::empty() });
    let mut harness = open(Options { request: stack(dir.path()), layout, ..Options::default() });
    harness.run_steps(3);
    type_number(&mut harness, "max_speed_mps", "0.7");
    assert!(harness.query_by_label_contains("Send 1").is_some());
    let other = dir.path().join("other.toml");
    std::fs::write(&other, STACK.replace("\"hand\"", "\"other\"")).unwrap();
    drop_file(&mut harness, &other);
    wait_for(&mut harness, "the other stack", |harness| {
        frame(harness).is_some_and(|frame| frame.info.title.contains("other"))
    });
    harness.run_steps(3);
    assert!(harness.query_by_label_contains("Send").is_some(), "its parameters are shown");
    assert!(harness.query_by_label_contains("Send 1").is_none());
}

#[test]
fn a_dropped_layout_arranges_the_views_and_a_wrong_one_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    let mine = dir.path().join("mine.ron");
    std::fs::write(&mine, include_str!("../../../layouts/fields.ron")).unwrap();
    drop_file(&mut harness, &mine);
    harness.run_steps(3);
    assert!(harness.query_by_label("Map").is_none(), "only the fields are left");
    std::fs::write(&mine, "Layout(version: 1, name: \"mine\", root: Pile([]))").unwrap();
    drop_file(&mut harness, &mine);
    harness.run_steps(3);
    assert!(harness.query_by_label_contains("mine.ron:1").is_some());
}

#[test]
fn buttons_step_forward_and_back_and_the_time_follows() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    let start = time_s(&harness);
    harness.get_by_label("Step forward").click();
    wait_for(&mut harness, "a step forward", |harness| time_s(harness) > start);
    harness.run();
    let first = time_s(&harness).unwrap();
    assert!(first < 0.2 && harness.query_all_by_label(&clock(first)).next().is_some(), "{first}");
    harness.get_by_label("Step forward").click();
    wait_for(&mut harness, "another step forward", |harness| time_s(harness) > Some(first));
    harness.get_by_label("Step back").click();
    wait_for(&mut harness, "a step back", |harness| time_s(harness) == Some(first));
}

#[test]
fn keys_play_pause_step_and_jump() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    let start = time_s(&harness);
    harness.key_press(Key::ArrowRight);
    wait_for(&mut harness, "a step by key", |harness| time_s(harness) > start);
    harness.key_press(Key::ArrowLeft);
    wait_for(&mut harness, "a step back by key", |harness| time_s(harness) == start);
    harness.key_press(Key::End);
    wait_for(&mut harness, "a jump to the end", |harness| time_s(harness) == length_s(harness));
    harness.key_press(Key::Home);
    wait_for(&mut harness, "a jump to the start", |harness| time_s(harness) == Some(0.0));
    harness.key_press(Key::Period);
    wait_for(&mut harness, "a second forward", |harness| time_s(harness) == Some(1.0));
    harness.key_press(Key::Space);
    wait_for(&mut harness, "playing", |harness| time_s(harness) > Some(1.2));
    harness.key_press(Key::Space);
    wait_for(&mut harness, "the pause", |harness| {
        let frame = harness.state().as_ref().and_then(Window::frame);
        frame.is_some_and(|frame| !frame.playback.playing)
    });
}

#[test]
fn keys_do_not_play_while_a_path_is_typed() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    harness.key_press_modifiers(Modifiers::COMMAND, Key::O);
    harness.run();
    harness.get_by_label("Path").focus();
    harness.run();
    let start = time_s(&harness);
    harness.key_press(Key::End);
    harness.run();
    assert_eq!(time_s(&harness), start);
}

#[test]
fn a_unit_of_steps_is_searched_for_and_keys_do_nothing_else_meanwhile() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    harness.run_steps(3);
    let start = time_s(&harness);
    harness.get_by_label("What a step is").click();
    harness.run_steps(4);
    assert!(harness.get_by_label("Search steps").accesskit_node().is_focused());
    harness.get_by_label("Search steps").type_text("GPS");
    harness.run_steps(2);
    assert!(harness.query_by_label("any message").is_none(), "only what was found is listed");
    for key in [Key::ArrowRight, Key::Space] {
        harness.key_press(key);
        harness.run_steps(3);
    }
    let now = frame(&harness).unwrap();
    assert!(time_s(&harness) == start && !now.playback.playing);

    harness.key_press(Key::Enter);
    harness.run_steps(3);
    assert!(harness.query_by_label("Search steps").is_none(), "a choice closes the list");
    harness.key_press(Key::ArrowRight);
    wait_for(&mut harness, "a step to the next position", |harness| {
        let frame = frame(harness).unwrap();
        let newest = frame.topic("/vehicle/gps").and_then(|topic| topic.latest.as_ref());
        time_s(harness) > start && newest.is_some_and(|sample| sample.header.log_time == frame.now)
    });

    harness.get_by_label("What a step is").click();
    harness.run_steps(4);
    let field = harness.get_by_label("Search steps");
    assert_eq!(field.accesskit_node().value().unwrap_or_default(), "", "it was cleared");
}

#[test]
fn a_drag_along_the_bar_goes_there() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    harness.run();
    let bar = harness.get_by_label("Time").rect();
    harness.drag_at(bar.left_center() + egui::vec2(20.0, 0.0));
    harness.step();
    harness.hover_at(bar.center());
    harness.step();
    harness.drop_at(bar.center());
    wait_for(&mut harness, "the seek", |harness| {
        time_s(harness)
            .zip(length_s(harness))
            .is_some_and(|(time, length)| (time - 0.5 * length).abs() < 0.01)
    });
}

#[test]
fn a_drag_that_falls_into_one_slow_pass_goes_there_too() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    harness.run();
    let bar = harness.get_by_label("Time").rect();
    harness.hover_at(bar.left_center());
    harness.run();
    let button = |pos, pressed| egui::Event::PointerButton {
        pos,
        button: egui::PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    let (from, to) = (bar.left_center() + egui::vec2(50.0, 0.0), bar.center());
    let events = [
        egui::Event::PointerMoved(from),
        button(from, true),
        egui::Event::PointerMoved(to),
        button(to, false),
    ];
    harness.input_mut().events.extend(events);
    wait_for(&mut harness, "the seek", |harness| {
        time_s(harness)
            .zip(length_s(harness))
            .is_some_and(|(time, length)| (time - 0.5 * length).abs() < 0.01)
    });
}

#[test]
fn a_paused_window_asks_for_no_repaint() {
    // With and without threads that prepare pictures.
    for has_threads in [false, true] {
        let dir = tempfile::tempdir().unwrap();
        let mut harness = opened(dir.path());
        if has_threads {
            ocu_views::prepare::start(&harness.ctx).unwrap();
        }
        // Tracks are read while no other request is pending; after that the window is idle.
        let start = Instant::now();
        let mut quiet = 0;
        while quiet < 20 {
            assert!(start.elapsed() < PATIENCE, "the window never comes to rest");
            harness.step();
            let delay = harness.output().viewport_output[&egui::ViewportId::ROOT].repaint_delay;
            quiet = if delay > Duration::from_secs(1) { quiet + 1 } else { 0 };
        }
    }
}

#[test]
fn every_bundled_layout_draws_and_has_named_widgets() {
    let dir = tempfile::tempdir().unwrap();
    let request = sample(dir.path());
    for name in bundled::names("layout") {
        let layout = Layout::named(name).unwrap();
        let options = Options { request: request.clone(), layout: Some(layout), ..Options::default() };
        let mut harness = harness(options);
        wait_for(&mut harness, name, |harness| time_s(harness).is_some());
        // The harness fails for a widget without a name.
        harness.run_steps(3);
        let image = harness.render().unwrap_or_else(|error| panic!("{name}: {error}"));
        let first = *image.get_pixel(0, 0);
        assert!(image.pixels().any(|pixel| *pixel != first), "{name} is blank");
    }
}

#[test]
fn the_arrangement_survives_a_restart_and_a_damaged_one_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let request = sample(dir.path());
    let options =
        || Options { request: request.clone(), layout: None, data_dir: Some(dir.path().join("data")) };
    let mut first = harness(options());
    wait_for(&mut first, "the recording opens", |harness| time_s(harness).is_some());
    first.get_by_label("Buffers").click();
    first.run_steps(2);
    first.state_mut().as_mut().unwrap().keep_layout();
    let kept = dir.path().join("data/layouts/recording_with_2_cameras.ron");
    assert!(!Layout::load(&kept).unwrap().buffers, "the list of buffers was closed");

    std::fs::write(&kept, "Layout(version: 77)").unwrap();
    let mut second = harness(options());
    wait_for(&mut second, "the recording opens", |harness| time_s(harness).is_some());
    assert!(second.query_by_label_contains("version 77").is_some());
}

#[test]
fn a_kept_arrangement_shows_the_images_of_another_recording_and_stays_kept_as_it_is() {
    let dir = tempfile::tempdir().unwrap();
    let camera = |name: &str| {
        let state = serde_json::json!({ "topic": { "name": name } });
        (1.0_f32, Node::View { kind: "camera".to_owned(), state, run: RunChoice::Shown, id: 0 })
    };
    let root = Node::Row(["/front/right", "/front/left"].map(camera).into());
    let layout = Layout { name: "recording with 2 cameras".to_owned(), root, ..Layout::empty() };
    let kept = dir.path().join("data/layouts/recording_with_2_cameras.ron");
    layout.save(&kept).unwrap();
    let written = std::fs::read_to_string(&kept).unwrap();
    let data_dir = Some(dir.path().join("data"));
    let mut harness = harness(Options { request: sample(dir.path()), layout: None, data_dir });
    wait_for(&mut harness, "the recording opens", |harness| time_s(harness).is_some());
    harness.run_steps(2);
    let left_of = |name: &str| harness.get_by_label(name).rect().left();
    assert!(left_of("Image of /camera/right") < left_of("Image of /camera/left"));
    harness.state_mut().as_mut().unwrap().keep_layout();
    assert_eq!(std::fs::read_to_string(&kept).unwrap(), written);
}

#[test]
fn a_change_of_the_layout_that_was_undone_is_undone_at_the_next_start_too() {
    let dir = tempfile::tempdir().unwrap();
    let data_dir = Some(dir.path().join("data"));
    let mut harness = harness(Options { request: sample(dir.path()), layout: None, data_dir });
    wait_for(&mut harness, "the recording opens", |harness| time_s(harness).is_some());
    let kept = dir.path().join("data/layouts/recording_with_2_cameras.ron");
    let keeps_buffers = |harness: &mut Harness<'_, State>| {
        harness.run_steps(2);
        harness.state_mut().as_mut().unwrap().keep_layout();
        Layout::load(&kept).unwrap().buffers
    };
    harness.get_by_label("Buffers").click();
    assert!(!keeps_buffers(&mut harness), "the list of buffers was closed");
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    assert!(keeps_buffers(&mut harness));
}

#[test]
fn a_layout_is_kept_by_enter_and_deleted_in_the_menu_where_its_file_is_set_aside() {
    let dir = tempfile::tempdir().unwrap();
    let data_dir = Some(dir.path().join("data"));
    let mut harness = harness(Options { request: sample(dir.path()), layout: None, data_dir });
    wait_for(&mut harness, "the recording opens", |harness| time_s(harness).is_some());
    let open_menu = |harness: &mut Harness<'_, State>| {
        harness.get_by_label("Layout").click();
        harness.run_steps(3);
    };
    open_menu(&mut harness);
    harness.get_by_label("Name of the layout").focus();
    harness.run_steps(2);
    harness.get_by_label("Name of the layout").type_text("mine");
    harness.run_steps(2);
    harness.key_press(Key::Enter);
    harness.run_steps(3);
    harness.state_mut().as_mut().unwrap().keep_layout();
    let kept = dir.path().join("data/layouts/mine.ron");
    assert_eq!(Layout::load(&kept).unwrap().name, "mine");

    open_menu(&mut harness);
    assert!(harness.query_by_label("Delete the layout mine").is_none(), "it is open");
    harness.get_by_label("default").click();
    harness.run_steps(3);
    open_menu(&mut harness);
    harness.get_by_label("Delete the layout mine").click();
    harness.run_steps(3);
    assert!(!kept.exists() && kept.with_extension("ron.old").exists());
    assert!(harness.query_by_label_contains("the layout mine is deleted").is_some());
}

#[test]
fn the_menu_of_layouts_has_undo_and_redo_only_where_there_is_a_step_and_says_which_names_are_taken() {
    let dir = tempfile::tempdir().unwrap();
    let layout = Some(Layout::empty());
    let mut harness = open(Options { request: sample(dir.path()), layout, ..Options::default() });
    let can = |harness: &mut Harness<'_, State>| {
        harness.get_by_label("Layout").click();
        harness.run_steps(3);
        let can = ["Undo the last change of the layout", "Redo the change of the layout"].map(|name| {
            let mut entries = harness.query_all_by_label_contains(name);
            entries.any(|entry| !entry.accesskit_node().is_disabled())
        });
        harness.key_press_modifiers(Modifiers::COMMAND, Key::Period);
        harness.run_steps(3);
        can
    };
    assert_eq!(can(&mut harness), [false, false]);
    harness.get_by_label("Buffers").click();
    harness.run_steps(3);
    assert_eq!(can(&mut harness), [true, false]);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    harness.run_steps(3);
    assert_eq!(can(&mut harness), [false, true]);

    harness.get_by_label("Layout").click();
    harness.run_steps(3);
    type_text(&mut harness, "Name of the layout", "recording");
    let keep = harness.get_by_label("Keep as");
    assert!(keep.accesskit_node().is_disabled());
    let at = keep.rect().center();
    harness.hover_at(at);
    wait_for(&mut harness, "the reason", |harness| {
        harness.query_all_by_label_contains("recording is a layout that comes").next().is_some()
    });
}

#[test]
fn a_path_that_cannot_be_opened_comes_back_in_the_dialog_with_the_reason_until_it_changes() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("text.mcap"), "hello").unwrap();
    let mut harness = opened(dir.path());
    for (file, reason) in [
        ("absent.mcap", "cannot open the log"),
        ("text.mcap", "got a text that begins with"),
        ("absent.ron", "cannot read the layout"),
        ("absent.json", "no stack is open that could begin"),
    ] {
        let path = dir.path().join(file).display().to_string();
        harness.key_press_modifiers(Modifiers::COMMAND, Key::O);
        harness.run_steps(3);
        type_text(&mut harness, "Path", &path);
        harness.key_press(Key::Enter);
        let is_told =
            |harness: &Harness<'_, State>| harness.query_all_by_label_contains(reason).next().is_some();
        wait_for(&mut harness, reason, is_told);
        harness.run_steps(2);
        let field = harness.get_by_label("Path");
        assert_eq!(field.value().as_deref(), Some(path.as_str()));
        assert!(field.accesskit_node().is_focused(), "{file}");
        field.type_text("x");
        harness.run_steps(3);
        assert!(!is_told(&harness), "{file}: it was about another path");
        harness.key_press_modifiers(Modifiers::COMMAND, Key::Period);
        harness.run_steps(3);
        assert!(harness.query_by_label("Path").is_none());
    }
}

#[test]
fn the_search_for_buffers_ends_with_the_source_that_was_searched() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = opened(dir.path());
    harness.run_steps(2);
    type_text(&mut harness, "Search buffers", "gps");
    let searched = |harness: &Harness<'_, State>| harness.get_by_label("Search buffers").value();
    assert_eq!(searched(&harness).as_deref(), Some("gps"));
    let other = dir.path().join("other.mcap");
    std::fs::copy(dir.path().join("drive.mcap"), &other).unwrap();
    drop_file(&mut harness, &other);
    wait_for(&mut harness, "the other recording", |harness| {
        frame(harness).is_some_and(|frame| frame.info.title == "other.mcap")
    });
    harness.run_steps(2);
    assert_eq!(searched(&harness).unwrap_or_default(), "");
}

#[test]
fn a_damaged_layout_of_the_users_is_said_once() {
    let dir = tempfile::tempdir().unwrap();
    let data_dir = dir.path().join("data");
    let kept = data_dir.join("layouts/mine.ron");
    std::fs::create_dir_all(kept.parent().unwrap()).unwrap();
    std::fs::write(&kept, "Layout(version: 77)").unwrap();
    let options = Options { request: sample(dir.path()), layout: None, data_dir: Some(data_dir) };
    let mut harness = harness(options);
    wait_for(&mut harness, "the recording opens", |harness| time_s(harness).is_some());
    harness.get_by_label("Layout").click();
    harness.run_steps(3);
    harness.get_by_label("mine").click();
    harness.run_steps(3);
    assert_eq!(harness.query_all_by_label_contains("version 77").count(), 1);
    assert!(harness.query_by_label_contains("is called").is_none(), "nothing else is said");
}

/// The recording that a process of its own opens.
const LOG: &str = "OCU_TEST_LOG";
/// Bars for opening a hostile recording, and for the memory of the process.
const MOST_TIME: Duration = Duration::from_secs(2);
const MOST_BYTES: u64 = 300 << 20;

#[test]
#[ignore = "run for each recording by the next test"]
fn one_hostile_recording_opens_in_the_window_and_plays_or_says_why_not() {
    let Some(path) = std::env::var_os(LOG).map(std::path::PathBuf::from) else { return };
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let request = Request { log: Some(path), ..Request::default() };
    let mut harness = harness(Options { request, ..Options::default() });
    let began = Instant::now();
    wait_for(&mut harness, &name, |harness| time_s(harness).is_some());
    let took = began.elapsed();
    // The dev profile is slower than a release, and tests share the machine.
    let room = if cfg!(debug_assertions) { 10 } else { 1 };
    assert!(took < MOST_TIME * room, "{name}: {took:?}");
    for _ in 0..3 {
        harness.step();
    }
    harness.key_press(Key::Space);
    for _ in 0..20 {
        harness.step();
    }
    let frame = harness.state().as_ref().unwrap().frame().unwrap();
    assert_eq!(frame.playback.error, None, "{name}");
    let damaged = ["husky_onebit", "REPRO", "cdrtest", "del1000", "stat_max", "bomb", "proto_bad"];
    let is_damaged = damaged.iter().any(|damaged| name.starts_with(damaged));
    assert_eq!(!frame.info.problems.is_empty(), is_damaged, "{name}: {:?}", frame.info.problems);
    if is_damaged {
        assert!(harness.query_by_label_contains("problem").is_some(), "{name} has a badge");
    }
    eprintln!("{name}: shown after {took:.2?}");
    if let Some(peak) = rcs_testkit::peak_bytes() {
        eprintln!("{name}: {} MB at most", peak >> 20);
        assert!(peak < MOST_BYTES, "{name}: {peak} bytes");
    }
}

#[test]
fn every_hostile_recording_opens_in_the_window_within_time_and_memory() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let entries = std::fs::read_dir(data.join("hostile")).unwrap().map(|entry| entry.unwrap().path());
    let mut count = 0;
    for path in entries.filter(|path| path.extension().is_some_and(|ending| ending == "mcap")) {
        let test = "one_hostile_recording_opens_in_the_window_and_plays_or_says_why_not";
        let output = Command::new(std::env::current_exe().unwrap())
            .args(["--ignored", "--exact", "--nocapture", test])
            .env(LOG, &path)
            .output()
            .unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{}: {errors}", path.display());
        assert!(errors.contains("shown after"), "{} was not opened: {errors}", path.display());
        count += 1;
    }
    assert!(count >= 13, "{count} recordings");
}
