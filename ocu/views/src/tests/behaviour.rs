//! Effects of clicks, keys and drags.

use super::{Shown, harness};
use crate::operator::Hand;
use crate::samples;
use crate::view::{Hover, HoverPoint, Hovers, TopicKey};
use egui::accesskit::{Role, Toggled};
use egui::{Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use rcs_msg::{foxglove, rcs};
use rcs_runtime::source::{Control, SourceInfo, SourceKind, Step};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

fn shown(kind: &str) -> Harness<'static, Shown> {
    let mut harness = harness(Shown::new(kind, samples::full()), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness
}

fn key(name: &str) -> TopicKey {
    TopicKey::shown(name)
}

#[test]
fn a_search_leaves_only_the_buffers_that_match() {
    let mut harness = shown("buffers");
    assert!(harness.query_by_label("/camera/image").is_some());
    harness.get_by_label("Search buffers").click();
    harness.run();
    harness.get_by_label("Search buffers").type_text("grid");
    harness.run();
    assert!(harness.query_by_label("/wm1/map").is_some(), "a type counts, too");
    assert!(harness.query_by_label("/camera/image").is_none());
    harness.get_by_label("Clear the search").click();
    harness.run();
    assert!(harness.query_by_label("/camera/image").is_some());
}

#[test]
fn a_click_on_a_buffer_selects_it_and_a_group_folds() {
    let mut harness = shown("buffers");
    harness.get_by_label("/wm1/map").click();
    harness.run();
    assert_eq!(harness.state().selection.topic, Some(key("/wm1/map")));
    harness.get_by_label("Group by the process that writes them").click();
    harness.run();
    harness.get_by_label("Group wm1").click();
    harness.run();
    assert!(harness.query_by_label("/wm1/map").is_none());
    assert!(harness.query_by_label("/obstacles/labels").is_some());
}

#[test]
fn a_buffer_can_be_dragged() {
    let mut harness = shown("buffers");
    let at = harness.get_by_label("/lidar/points").rect().center();
    harness.hover_at(at);
    harness.run_steps(2);
    harness.drag_at(at);
    harness.run_steps(2);
    harness.hover_at(at + Vec2::new(0.0, 60.0));
    harness.run_steps(2);
    let payload = egui::DragAndDrop::payload::<TopicKey>(&harness.ctx);
    assert_eq!(payload.as_deref(), Some(&key("/lidar/points")));
}

#[test]
fn a_topic_that_is_dropped_on_the_fields_is_kept_there() {
    let mut harness = shown("fields");
    let topic =
        harness.state().frame.topic("/gps").or(harness.state().frame.topic("/lidar/points")).unwrap().clone();
    egui::DragAndDrop::set_payload(&harness.ctx, TopicKey::of(&topic));
    harness.drag_at(egui::Pos2::new(400.0, 300.0));
    harness.run_steps(2);
    harness.drop_at(egui::Pos2::new(400.0, 300.0));
    harness.run();
    assert_eq!(harness.state().view.title(&harness.state().frame), "/lidar/points");
}

#[test]
fn fields_follow_the_selection_open_and_search() {
    let mut harness = shown("fields");
    assert!(
        harness.query_by_label("No buffer is chosen").is_none(),
        "something is shown until one is chosen"
    );
    harness.state_mut().selection.topic = Some(key("/planner/path"));
    harness.run();
    harness.get_by_label("poses 12 elements").click();
    harness.run();
    harness.get_by_label("[3]").click();
    harness.run();
    harness.get_by_label_contains("position x 1.5").click();
    harness.run();
    assert!(harness.query_by_label("x 1.5").is_some());
    harness.get_by_label("Search fields").click();
    harness.run();
    harness.get_by_label("Search fields").type_text("poses[11].position.x");
    harness.run();
    assert!(harness.query_by_label(".poses[11].position.x 5.5").is_some());
}

#[test]
fn a_message_without_a_reader_says_why_and_shows_its_bytes() {
    let mut harness = shown("fields");
    harness.state_mut().selection.topic =
        Some(TopicKey { name: "/flat/chatter".into(), run: crate::RunChoice::Recorded });
    harness.run();
    assert!(
        harness
            .query_by_label_contains("Cannot be read: message encoding \"flatbuffer\" has no reader")
            .is_some()
    );
    assert!(harness.query_by_label_contains("000010  10 11 12").is_some());
}

#[test]
fn lines_of_bytes_do_not_wrap_in_a_narrow_view() {
    let mut harness = harness(Shown::new("fields", samples::full()), Vec2::new(220.0, 400.0), Theme::Dark);
    harness.state_mut().selection.topic =
        Some(TopicKey { name: "/flat/chatter".into(), run: crate::RunChoice::Recorded });
    harness.run();
    let line = harness.get_by_label_contains("000010  10 11 12").rect();
    assert!(line.height() < 20.0, "{line:?}");
}

#[test]
fn a_pinned_topic_stays_when_another_is_selected() {
    let mut harness = shown("fields");
    harness.state_mut().selection.topic = Some(key("/wm1/map"));
    harness.run();
    harness.get_by_label("Keep this buffer").click();
    harness.run();
    harness.state_mut().selection.topic = Some(key("/planner/path"));
    harness.run();
    assert!(harness.query_by_label_contains("poses").is_none());
    harness.get_by_label("Follow the selection again").click();
    harness.run();
    assert!(harness.query_by_label_contains("poses").is_some());
}

#[test]
fn a_click_on_a_box_selects_the_process_and_every_state_is_a_word() {
    let mut harness = shown("hierarchy");
    for name in [
        "Process planner: ERROR",
        "Process wm1: NO STATUS 5.0 s",
        "Process obstacles: EXEC",
        "Process idle: NOT RUNNING",
        "Process lost: NOT CONNECTED",
    ] {
        assert!(harness.query_by_label(name).is_some(), "{name}");
    }
    harness.get_by_label("Process obstacles: EXEC").click();
    harness.run();
    assert_eq!(harness.state().selection.process.as_deref(), Some("obstacles"));
}

#[test]
fn an_array_is_shown_as_a_histogram_and_as_a_picture() {
    let mut harness = shown("fields");
    harness.state_mut().selection.topic = Some(key("/wm1/map"));
    harness.run();
    harness.get_by_label_contains("data ").click_secondary();
    harness.run();
    harness.get_by_label("As a histogram").click();
    harness.run();
    assert!(harness.query_by_label("Histogram of the array").is_some());
    harness.get_by_label("As a picture").click();
    harness.run();
    assert!(harness.query_by_label("Picture of the array").is_some());
    assert_eq!(harness.state().view.save()["array"]["path"], ".data");
    harness.get_by_label("Close the array").click();
    harness.run();
    assert!(harness.query_by_label("Picture of the array").is_none());
}

#[test]
fn the_menu_of_a_box_begins_a_fault_and_ends_it() {
    use rcs::r#override::Mode;
    let mut frame = samples::full();
    let mut info = (*frame.info).clone();
    info.kind = SourceKind::Stack;
    frame.info = Arc::new(info);
    let running = rcs::OverrideInForce {
        id: 7,
        process: "obstacles".into(),
        fault: "frozen".into(),
        ..Default::default()
    };
    let list = rcs::OverrideList { active: vec![running], ..Default::default() };
    let requests = samples::topic("/runtime/override", 0.0, 1.0, rcs::Override::default());
    let list = samples::topic("/runtime/overrides", 0.0, 1.0, list);
    frame.topics = frame.topics.iter().cloned().chain([requests, list]).collect();
    let mut harness = harness(Shown::new("hierarchy", frame), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    let mut choose = |labels: [&str; 2]| {
        harness.get_by_label("Process obstacles: EXEC").click_secondary();
        harness.run();
        for label in labels.into_iter().filter(|label| !label.is_empty()) {
            harness.get_by_label_contains(label).click();
            harness.run();
        }
        let control = harness.state_mut().controls.pop();
        let Some(Control::Write { buffer, message }) = control else { panic!("{control:?}") };
        assert_eq!(buffer, "/runtime/override");
        message.to::<rcs::Override>().unwrap()
    };
    let begins = choose(["Fault on demand", "Stopped"]);
    assert_eq!((begins.mode(), begins.process.as_str()), (Mode::Hold, "obstacles"));
    assert_eq!(begins.fault.unwrap().kind(), rcs::fault::Kind::Stopped);
    let ends = choose(["End: frozen", ""]);
    assert_eq!((ends.mode(), ends.id), (Mode::Release, 7));
}

#[test]
fn a_layer_of_a_map_can_be_switched_off_and_the_layout_keeps_that() {
    let mut harness = shown("map");
    let node = harness.get_by_label("Show /wm1/map");
    assert_eq!(node.accesskit_node().toggled(), Some(Toggled::True));
    node.click();
    harness.run();
    assert_eq!(harness.get_by_label("Show /wm1/map").accesskit_node().toggled(), Some(Toggled::False));
    assert_eq!(harness.state().view.save()["layers"]["/wm1/map"]["shown"], false);
}

/// A map with a vehicle at a place, m, and with a heading, rad.
pub(super) fn map_of_a_vehicle_at([x, y]: [f64; 2], yaw_rad: f64) -> Harness<'static, Shown> {
    let mut frame = samples::driving();
    let position = Some(foxglove::Vector3 { x, y, z: 0.0 });
    let (z, w) = (yaw_rad / 2.0).sin_cos();
    let orientation = Some(foxglove::Quaternion { x: 0.0, y: 0.0, z, w });
    let pose = Some(foxglove::Pose { position, orientation });
    let place = foxglove::PoseInFrame { frame_id: "local".into(), pose, ..Default::default() };
    let place = samples::topic("/localization/local", 50.0, 0.01, place);
    let others = frame.topics.iter().filter(|topic| topic.name != place.name).cloned();
    frame.topics = others.chain([place.clone()]).collect();
    let mut harness = harness(Shown::new("map", frame), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness
}

/// The place on the map that lies beside the middle of its canvas, m.
fn pointed(harness: &mut Harness<'_, Shown>, beside: Vec2) -> [f64; 2] {
    let canvas = harness.get_by_label("Map").rect();
    harness.hover_at(canvas.center() + beside);
    harness.run();
    let point = harness.state().selection.hovered.get().point.clone().unwrap();
    [point.position_m[0], point.position_m[1]]
}

/// Drags the map from its middle.
fn drag_map(harness: &mut Harness<'_, Shown>, by: Vec2) {
    let at = harness.get_by_label("Map").rect().center();
    harness.drag_at(at);
    harness.run_steps(2);
    harness.hover_at(at + by);
    harness.run_steps(2);
    harness.drop_at(at + by);
    harness.run();
}

#[test]
fn a_map_turns_so_that_the_vehicle_heads_up_and_back() {
    let heading_rad: f64 = 2.5;
    let mut harness = map_of_a_vehicle_at([3.0, 2.0], heading_rad);
    // Direction on the map of what lies above the middle of the canvas, rad.
    let up = |harness: &mut Harness<'_, Shown>| {
        let (middle, above) = (pointed(harness, Vec2::ZERO), pointed(harness, Vec2::new(0.0, -100.0)));
        (above[1] - middle[1]).atan2(above[0] - middle[0])
    };
    assert!((up(&mut harness) - FRAC_PI_2).abs() < 1e-3);
    harness.get_by_label("Turn the map: the vehicle heads up").click();
    harness.run();
    assert!((up(&mut harness) - heading_rad).abs() < 1e-3);
    harness.get_by_label("Follow the vehicle").click();
    harness.run();
    let [x, y] = pointed(&mut harness, Vec2::ZERO);
    assert!((x - 3.0).abs() < 0.1 && (y - 2.0).abs() < 0.1, "{x} {y}");
    assert_eq!(harness.state().view.save()["vehicle_up"], true);

    // Who drags a turned map moves it with the pointer.
    drag_map(&mut harness, Vec2::new(80.0, 30.0));
    let moved = pointed(&mut harness, Vec2::new(80.0, 30.0));
    assert!((moved[0] - x).abs() < 0.1 && (moved[1] - y).abs() < 0.1, "{moved:?}");
    harness.get_by_label("Turn the map: the vehicle heads up").click();
    harness.run();
    assert!((up(&mut harness) - FRAC_PI_2).abs() < 1e-3, "north is up again");
}

#[test]
fn a_map_follows_the_vehicle_until_it_is_dragged_and_zooms_to_a_layer() {
    let mut harness = map_of_a_vehicle_at([3.0, 2.0], 0.0);
    let middle = |harness: &mut Harness<'_, Shown>| pointed(harness, Vec2::ZERO);
    let before = middle(&mut harness);
    harness.get_by_label("Follow the vehicle").click();
    harness.run();
    let followed = middle(&mut harness);
    assert!((followed[0] - 3.0).abs() < 0.1 && (followed[1] - 2.0).abs() < 0.1, "{followed:?}");
    assert_ne!(before, followed);
    assert!(harness.state().view.save()["viewport"].is_null(), "a vehicle that drives changes no layout");

    drag_map(&mut harness, Vec2::new(80.0, 0.0));
    assert_eq!(harness.state().view.save()["follows"], false, "who drags looks elsewhere");

    harness.get_by_label("Zoom to /wm1/map").click();
    harness.run();
    let [x, y] = middle(&mut harness);
    assert!(x.abs() < 1.0 && y.abs() < 1.0, "the middle of the map: {x} {y}");
}

#[test]
fn what_nothing_connects_to_the_map_says_so() {
    let mut harness = shown("map");
    let notes = harness.query_all_by_label_contains("aligned at its start").count();
    assert_eq!(notes, 2, "odometry and GPS are laid on the pose's track");
    harness.get_by_label("Align loose tracks at their start").click();
    harness.run();
    assert_eq!(harness.query_all_by_label_contains("not drawn: frame").count(), 2);
}

#[test]
fn a_cell_under_the_pointer_tells_its_numbers_and_the_frame_that_made_them() {
    let mut harness = shown("map");
    let canvas = harness.get_by_label("Map").rect();
    harness.hover_at(canvas.center() + Vec2::new(9.0, 3.0));
    harness.run();
    assert!(harness.query_by_label("      7").is_some(), "the message that made the cell");
    assert!(harness.query_by_label_contains("/wm1/map  cell").is_some());
    let hover = harness.state().selection.hovered.get();
    assert!(hover.point.is_some() && hover.cell.is_some());
}

#[test]
fn a_click_keeps_a_cell_and_a_source_leads_to_the_message_that_made_it() {
    let mut frame = samples::full();
    // A process that makes the map of what another topic says.
    let map = frame.topic("/wm1/map").unwrap().clone();
    let mut said = map.clone();
    said.name = "/obstacles/cost".into();
    frame.topics = frame.topics.iter().cloned().chain([said]).collect();
    let port = rcs::PortInfo { buffer: "/obstacles/cost".into(), ..Default::default() };
    let writer = rcs::ProcessInfo { name: map.writer.to_string(), inputs: vec![port], ..Default::default() };
    frame.processes = Arc::new([writer]);
    let mut shown = Shown::new("map", frame);
    shown.view.load(&serde_json::json!({ "layers": { "/obstacles/cost": { "shown": false } } })).unwrap();
    let mut harness = harness(shown, Vec2::new(900.0, 700.0), Theme::Dark);
    harness.run();
    // Beside the tracks, a click on which goes to a time.
    let place = harness.get_by_label("Map").rect().center() + Vec2::new(20.0, 40.0);
    let click = |harness: &mut Harness<'_, Shown>, at| {
        harness.hover_at(at);
        harness.run();
        harness.drag_at(at);
        harness.drop_at(at);
        harness.run();
    };
    click(&mut harness, place);
    harness.hover_at(place - Vec2::new(100.0, 100.0));
    harness.run();
    assert!(harness.query_by_label_contains("/wm1/map  cell").is_some(), "it stays");
    harness.get_by_label_contains("message 7 of stereo").click();
    harness.run();
    let back_to = Step::BackTo { topic: "/obstacles/cost".to_owned(), sequence: 7 };
    let controls = &harness.state().controls;
    assert!(matches!(&controls[..], [Control::Step(step)] if *step == back_to), "{controls:?}");
    assert_eq!(harness.state().selection.topic, Some(key("/obstacles/cost")));
    // Its layer is shown until the view is back.
    let now = harness.state().frame.now;
    for (viewed, shows) in [(now, true), (now.before_ns(1_000_000_000), true), (now, false)] {
        harness.state_mut().frame.now = viewed;
        harness.run();
        let layer = harness.get_by_label("Show /obstacles/cost").accesskit_node().toggled();
        assert_eq!(layer, Some(Toggled::from(shows)), "{viewed}");
    }
    harness.get_by_label("Close the cell").click();
    harness.run();
    assert!(harness.query_by_label_contains("of stereo, which made this cell").is_none());
}

#[test]
fn a_small_map_counts_the_numbers_of_a_cell_that_find_no_room() {
    let says = |size: Vec2| {
        let mut harness = harness(Shown::new("map", samples::full()), size, Theme::Dark);
        harness.run();
        let canvas = harness.get_by_label("Map").rect();
        harness.hover_at(canvas.center() + Vec2::new(9.0, 3.0));
        harness.run();
        assert!(harness.query_by_label_contains("/wm1/map  cell").is_some());
        harness.query_by_label_contains("more in a larger map").is_some()
    };
    assert!(says(Vec2::new(400.0, 200.0)));
    assert!(!says(Vec2::new(1200.0, 1100.0)));
}

#[test]
fn a_measured_line_is_kept_until_measuring_ends() {
    let mut harness = shown("map");
    harness.get_by_label("Measure a distance").click();
    harness.run();
    let at = harness.get_by_label("Map").rect().center();
    harness.drag_at(at);
    harness.run_steps(2);
    harness.hover_at(at + Vec2::new(60.0, 0.0));
    harness.run_steps(2);
    harness.drop_at(at + Vec2::new(60.0, 0.0));
    harness.run();
    let before = harness.get_by_label("Measure a distance").accesskit_node().toggled();
    assert_eq!(before, Some(Toggled::True));
}

#[test]
fn a_camera_names_the_pixel_under_the_pointer_in_every_layer() {
    let mut harness = shown("camera");
    let canvas = harness.get_by_label("Image of /camera/image").rect();
    harness.hover_at(canvas.center() + Vec2::new(10.0, 120.0));
    harness.run();
    assert!(harness.query_by_label_contains("px").is_some());
    assert!(harness.query_by_label_contains("rgb ").is_some());
    assert!(harness.query_all_by_label("ground").count() >= 2, "in the legend and under the pointer");
}

#[test]
fn an_overlay_can_be_switched_off() {
    let mut harness = shown("camera");
    harness.get_by_role_and_label(Role::CheckBox, "/obstacles/labels").click();
    harness.run();
    assert_eq!(harness.state().view.save()["overlays"]["/obstacles/labels"]["shown"], false);
    assert!(harness.query_by_label("ground").is_none(), "nor is its legend there");
}

#[test]
fn an_image_that_cannot_be_decoded_says_why() {
    let mut shown = Shown::new("camera", samples::full());
    let topic = shown.frame.topic("/camera/broken").unwrap().clone();
    shown.view.drop_topic(&topic);
    let mut harness = harness(shown, Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    assert!(harness.query_by_label("This image cannot be shown").is_some());
    assert!(harness.query_by_label_contains("does not decode").is_some());
}

fn driving(kind: &str) -> Harness<'static, Shown> {
    let mut harness = harness(Shown::new(kind, samples::driving()), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness
}

#[test]
fn the_truth_is_off_until_a_person_switches_it_on() {
    let mut map = driving("map");
    let toggled =
        |harness: &Harness<'_, Shown>, name: &str| harness.get_by_label(name).accesskit_node().toggled();
    assert_eq!(toggled(&map, "Show /wm1/map"), Some(Toggled::True));
    assert_eq!(toggled(&map, "Show /vehicle/ground_truth_map"), Some(Toggled::False));
    assert!(map.query_by_label("Truth of the simulation").is_some());
    map.get_by_label("Show /vehicle/ground_truth_map").click();
    map.run();
    assert_eq!(toggled(&map, "Show /vehicle/ground_truth_map"), Some(Toggled::True));
    assert_eq!(map.state().view.save()["layers"]["/vehicle/ground_truth_map"]["shown"], true);

    let mut camera = driving("camera");
    let truth = |harness: &Harness<'_, Shown>| {
        harness
            .get_by_role_and_label(Role::CheckBox, "/camera/ground_truth_labels")
            .accesskit_node()
            .toggled()
    };
    assert!(camera.query_by_label("class 2").is_none());
    camera.get_by_label_contains("Overlays: /obstacles/labels, /color/shapes").click();
    camera.run();
    assert_eq!(truth(&camera), Some(Toggled::False));
    assert!(camera.query_by_label("Truth of the simulation").is_some());
    camera.get_by_role_and_label(Role::CheckBox, "/camera/ground_truth_labels").click();
    camera.run();
    assert_eq!(truth(&camera), Some(Toggled::True), "the menu stays open");
    assert_eq!(camera.state().view.save()["overlays"]["/camera/ground_truth_labels"]["shown"], true);
}

#[test]
fn a_goal_is_no_track() {
    let map = driving("map");
    assert_eq!(map.query_all_by_label("Show /vehicle/goal").count(), 1);
}

#[test]
fn a_button_drives_while_it_is_pressed_and_only_while_time_runs() {
    let mut harness = driving("drive");
    let at = harness.get_by_label("Turn left").rect().center();
    harness.hover_at(at);
    harness.run();
    harness.drag_at(at);
    harness.run();
    assert_eq!(harness.state().selection.hand, Hand { left: 1.0, ..Hand::default() });
    harness.state_mut().selection.hand = Hand::default();
    harness.drop_at(at);
    harness.step();
    harness.state_mut().selection.hand = Hand::default();
    harness.run();
    assert_eq!(harness.state().selection.hand, Hand::default());

    harness.state_mut().frame.playback.playing = false;
    harness.drag_at(at);
    harness.run();
    assert_eq!(harness.state().selection.hand, Hand::default());
    assert!(harness.query_by_label_contains("Time stands").is_some());
}

/// The written messages of a buffer.
fn written(harness: &Harness<'_, Shown>, buffer: &str) -> Vec<f64> {
    let controls = harness.state().controls.iter();
    let messages = controls.filter_map(|control| match control {
        Control::Write { buffer: to, message } if to == buffer => message.to::<rcs::SpeedLimit>(),
        _ => None,
    });
    messages.map(|limit| limit.max_speed_mps).collect()
}

#[test]
fn a_changed_parameter_is_previewed_sent_as_one_message_and_taken_back() {
    let params = "/vehicle_interface/params";
    let mut harness = driving("tuning");
    assert!(harness.get_by_label_contains("Send").accesskit_node().is_disabled(), "nothing is changed");
    harness.get_by_label("Default of max_speed_mps: 0.5").click();
    harness.run();
    let preview = harness.state().selection.preview.get().cloned().unwrap();
    assert_eq!(&*preview.process, "vehicle_interface");
    assert_eq!(preview.params.to::<rcs::SpeedLimit>().unwrap().max_speed_mps, 0.5);
    assert!(written(&harness, params).is_empty(), "a preview sends nothing");
    harness.get_by_label_contains("Send 1").click();
    harness.run();
    assert_eq!(written(&harness, params), [0.5]);

    // The source confirms: nothing is left to send, and the change can be taken back.
    let limit = samples::topic(params, 0.0, 0.1, rcs::SpeedLimit { max_speed_mps: 0.5 });
    let topics = harness.state().frame.topics.iter().map(|topic| match &*topic.name {
        name if name == params => limit.clone(),
        _ => topic.clone(),
    });
    harness.state_mut().frame.topics = topics.collect();
    harness.run();
    assert_eq!(harness.state().selection.preview.get(), None);
    assert!(harness.get_by_label_contains("Send").accesskit_node().is_disabled());
    harness.get_by_label_contains("Undo").click();
    harness.run();
    assert_eq!(written(&harness, params), [0.5, 1.0]);
}

#[test]
fn two_sets_of_parameters_are_kept_and_switched_between() {
    let params = "/vehicle_interface/params";
    let mut harness = driving("tuning");
    harness.get_by_label("Parameters A").click();
    harness.run();
    harness.get_by_label("Default of max_speed_mps: 0.5").click();
    harness.run();
    harness.get_by_label("Parameters B").click();
    harness.run();
    assert!(written(&harness, params).is_empty(), "keeping sends nothing");
    harness.get_by_label("Parameters B").click();
    harness.run();
    assert_eq!(written(&harness, params), [0.5]);
}

#[test]
fn parameters_of_a_recording_are_shown_and_previewed_and_cannot_be_sent() {
    let mut harness = driving("tuning");
    let info = SourceInfo { kind: SourceKind::Log, ..(*harness.state().frame.info).clone() };
    harness.state_mut().frame.info = Arc::new(info);
    // The note says that nothing can be sent, and moves the rows.
    harness.run();
    harness.get_by_label("Default of max_speed_mps: 0.5").click();
    harness.run();
    assert!(harness.state().selection.preview.get().is_some());
    assert!(harness.get_by_label_contains("Send 1").accesskit_node().is_disabled());
    assert!(harness.query_by_label_contains("run a stack on it").is_some());
}

#[test]
fn a_pointer_that_rests_on_a_map_asks_for_no_repaint() {
    let point = HoverPoint { frame_id: "local".to_owned(), position_m: [1.0, 2.0, f64::NAN] };
    let mut hovers = Hovers::default();
    let mut turned = |point: &HoverPoint| {
        hovers.set(Hover { point: Some(point.clone()), ..Hover::default() });
        hovers.turn()
    };
    assert!(turned(&point) && !turned(&point));
    assert!(turned(&HoverPoint { position_m: [1.0, 2.5, f64::NAN], ..point }));
}
