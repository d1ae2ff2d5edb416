//! Parameters that are shown, typed and left, in the views of tuning and of details.

use super::{Shown, harness};
use crate::samples;
use crate::view::{Preview, PreviewStage, Previews, Wish};
use crate::views::view_type;
use egui::accesskit::Role;
use egui::{Event, Key, Shape, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use rcs_msg::prost::Message as _;
use rcs_msg::rcs::{Command, CommandInfo, InitialParams, RunInfo, SpeedLimit};
use rcs_msg::{AnyMessage, schema_of};
use rcs_runtime::source::{Control, RunTag, SourceInfo, SourceKind, Topic};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A number with more decimals than are shown.
const FINE: f64 = 0.003_906_25;

/// A view of a process whose only parameter has this value, and whose only command has the same parameter.
fn view(kind: &str, saved: &serde_json::Value, max_speed_mps: f64) -> Shown {
    let mut frame = samples::driving();
    let limit = samples::topic("/vehicle_interface/params", 0.0, 0.1, SpeedLimit { max_speed_mps });
    let others = frame.topics.iter().filter(|topic| topic.name != limit.name).cloned();
    frame.topics = others.chain([limit.clone()]).collect();
    let mut processes = frame.processes.to_vec();
    let parameters_schema = schema_of::<SpeedLimit>().name().to_owned();
    processes[0].commands =
        vec![CommandInfo { name: "LIMIT".into(), parameters_schema, ..CommandInfo::default() }];
    frame.processes = processes.into();
    let mut shown = Shown::new(kind, frame);
    shown.view.load(saved).unwrap();
    shown
}

/// This view in a large tile.
fn shown(kind: &str, saved: &serde_json::Value, max_speed_mps: f64) -> Harness<'static, Shown> {
    let mut harness = harness(view(kind, saved, max_speed_mps), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness
}

fn press(harness: &mut Harness<'_, Shown>, key: Key) {
    harness.key_press(key);
    harness.run();
}

/// A topic takes the place of the one with its name.
fn put(harness: &mut Harness<'_, Shown>, topic: &Topic) {
    let frame = &mut harness.state_mut().frame;
    let others = frame.topics.iter().filter(|other| other.name != topic.name).cloned();
    frame.topics = others.chain([topic.clone()]).collect();
    harness.run();
}

/// Another message of the parameter is in force.
fn take(harness: &mut Harness<'_, Shown>, max_speed_mps: f64) {
    put(harness, &samples::topic("/vehicle_interface/params", 0.0, 0.1, SpeedLimit { max_speed_mps }));
}

/// The process of the parameter has made a map.
fn make_map(harness: &mut Harness<'_, Shown>, age_s: f64) {
    let mut map = samples::topic("/map", 5.0, age_s, samples::grid(4, 4));
    map.writer = "vehicle_interface".into();
    map.metadata = Arc::new(BTreeMap::from([("rcs.role".to_owned(), "map".to_owned())]));
    put(harness, &map);
}

fn speed(params: &AnyMessage) -> f64 {
    params.to::<SpeedLimit>().unwrap().max_speed_mps
}

/// The parameters that were sent.
fn sent(harness: &Harness<'_, Shown>) -> Vec<f64> {
    let speed = |control: &Control| match control {
        Control::Write { message, .. } => message.to::<SpeedLimit>().unwrap().max_speed_mps,
        other => panic!("{other:?}"),
    };
    harness.state().controls.iter().map(speed).collect()
}

/// Types another number of the parameter.
fn type_speed(harness: &mut Harness<'_, Shown>, text: &str) {
    go_to_number(harness);
    harness.event(Event::Text(text.to_owned()));
    harness.run();
    press(harness, Key::Tab);
}

/// Types a speed of 2 m/s, and sends it.
fn send_two(harness: &mut Harness<'_, Shown>) {
    type_speed(harness, "2");
    harness.get_by_label_contains("Send 1").click();
    harness.run();
}

/// Goes to the number beside the slider of the parameter.
fn go_to_number(harness: &mut Harness<'_, Shown>) {
    harness.get_by_role_and_label(Role::Slider, "max_speed_mps").focus();
    harness.run();
    press(harness, Key::Tab);
}

#[test]
fn a_parameter_with_many_decimals_is_not_changed_by_showing_it_or_by_leaving_it() {
    let mut harness = shown("tuning", &serde_json::json!({ "at_once": true }), FINE);
    assert_eq!(harness.state().selection.preview.get(), None);
    go_to_number(&mut harness);
    press(&mut harness, Key::Tab);
    assert_eq!(harness.state().selection.preview.get(), None);
    assert!(harness.state().controls.is_empty());
}

#[test]
fn a_number_is_typed_with_all_its_decimals() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    go_to_number(&mut harness);
    harness.event(Event::Text(FINE.to_string()));
    harness.run();
    press(&mut harness, Key::Tab);
    let preview = harness.state().selection.preview.get().cloned().unwrap();
    assert_eq!(preview.params.to::<SpeedLimit>().unwrap().max_speed_mps, FINE);
}

#[test]
fn a_number_that_is_refused_says_what_was_expected_and_leaves_the_value() {
    for text in ["nan", "11", "fast"] {
        let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
        type_speed(&mut harness, text);
        let reason = format!("got {text:?}, expected a number from 0 to 10 m/s");
        assert!(harness.query_by_label(&reason).is_some(), "{text}");
        assert_eq!(harness.state().selection.preview.get(), None, "{text}");
        // A decimal comma is a decimal point, and the reason goes with what was refused.
        type_speed(&mut harness, "1,5");
        assert!(harness.query_by_label_contains("expected a number").is_none());
        let preview = harness.state().selection.preview.get().cloned().unwrap();
        assert_eq!(speed(&preview.params), 1.5);
    }
}

#[test]
fn a_number_that_becomes_too_great_while_it_is_typed_leaves_the_value_from_before() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    go_to_number(&mut harness);
    for digit in ["2", "5"] {
        harness.event(Event::Text(digit.to_owned()));
        harness.run();
    }
    press(&mut harness, Key::Tab);
    assert!(harness.query_by_label_contains("got \"25\"").is_some());
    assert_eq!(harness.state().selection.preview.get(), None);
}

#[test]
fn the_arrow_beside_a_parameter_goes_back_to_what_the_stack_gave() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    assert!(harness.query_by_label("Default of max_speed_mps: 0.5").is_some());
    let params = AnyMessage::new(SpeedLimit { max_speed_mps: 0.8 }).bytes();
    let given = InitialParams { process: "vehicle_interface".into(), params, ..InitialParams::default() };
    let run = RunInfo { params: vec![given], ..RunInfo::default() };
    put(&mut harness, &samples::topic("/runtime/run", 0.0, 12.0, run));
    harness.get_by_label("Value of the stack for max_speed_mps: 0.8").click();
    harness.run();
    let preview = harness.state().selection.preview.get().cloned().unwrap();
    assert_eq!(speed(&preview.params), 0.8);
}

#[test]
fn a_process_that_fuses_nothing_awaits_no_map_with_what_was_sent() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    make_map(&mut harness, 0.2);
    send_two(&mut harness);
    take(&mut harness, 2.0);
    assert_eq!(harness.state().selection.preview.get(), None);
}

/// Presses A or B.
fn press_kept(harness: &mut Harness<'_, Shown>, name: &str) {
    harness.get_by_label(&format!("Parameters {name}")).click();
    harness.run();
}

#[test]
fn the_kept_set_in_force_takes_the_place_of_a_change_that_was_not_sent() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    press_kept(&mut harness, "A");
    type_speed(&mut harness, "2");
    press_kept(&mut harness, "B");
    press_kept(&mut harness, "A");
    assert_eq!(harness.state().selection.preview.get(), None);
    assert!(sent(&harness).is_empty());
    press_kept(&mut harness, "B");
    assert_eq!(sent(&harness), [2.0]);
    // While B is on its way, A is not in force for long.
    press_kept(&mut harness, "A");
    assert_eq!(sent(&harness), [2.0, 1.0]);
}

#[test]
fn kept_sets_are_switched_between_where_nothing_can_be_sent() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    let frame = &mut harness.state_mut().frame;
    frame.info = Arc::new(SourceInfo { kind: SourceKind::Log, ..(*frame.info).clone() });
    harness.run();
    for (text, name) in [("2", "A"), ("3", "B")] {
        type_speed(&mut harness, text);
        press_kept(&mut harness, name);
    }
    for (name, expected) in [("A", 2.0), ("B", 3.0)] {
        press_kept(&mut harness, name);
        let preview = harness.state().selection.preview.get().cloned().unwrap();
        assert_eq!(speed(&preview.params), expected, "{name}");
    }
    assert!(harness.state().controls.is_empty());
}

#[test]
fn parameters_of_a_recording_can_be_saved_where_it_says_which_stack_ran() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    let frame = &mut harness.state_mut().frame;
    frame.info = Arc::new(SourceInfo { kind: SourceKind::Log, ..(*frame.info).clone() });
    harness.run();
    assert!(harness.get_by_label_contains("Save…").accesskit_node().is_disabled());
    let run = RunInfo { stack_text: "format = 1".to_owned(), ..RunInfo::default() };
    put(&mut harness, &samples::topic("/runtime/run", 0.0, 12.0, run));
    harness.get_by_label_contains("Save…").click();
    harness.run();
    assert!(matches!(harness.state().wishes.as_slice(), [Wish::SaveParams { .. }]));
}

#[test]
fn a_change_that_is_on_its_way_is_not_sent_again_until_it_counts_as_lost() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    send_two(&mut harness);
    harness.get_by_label_contains("Sending…").click();
    harness.run();
    assert_eq!(sent(&harness), [2.0]);
    // Passes are a quarter of a second apart.
    harness.run_steps(24);
    harness.get_by_label_contains("Send 1").click();
    harness.run();
    assert_eq!(sent(&harness), [2.0, 2.0]);
}

#[test]
fn what_was_refused_is_not_told_any_more_when_other_parameters_are_in_force() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    send_two(&mut harness);
    take(&mut harness, 3.0);
    type_speed(&mut harness, "11");
    for (in_force, is_told) in [(3.0, true), (4.0, false)] {
        take(&mut harness, in_force);
        let told = harness.query_by_label_contains("got \"11\"").is_some();
        assert_eq!(told, is_told, "{in_force}");
    }
}

#[test]
fn a_slider_that_is_dragged_in_the_past_follows_the_pointer_and_stays_where_it_is() {
    let dragged = |is_at_end: bool| {
        let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
        harness.state_mut().frame.runs.is_at_end = is_at_end;
        harness.run();
        let place = |harness: &Harness<'_, Shown>| {
            harness.get_by_role_and_label(Role::Slider, "max_speed_mps").rect()
        };
        let before = place(&harness);
        let at = |part: f32| egui::Pos2::new(before.left() + part * before.width(), before.center().y);
        harness.hover_at(at(0.2));
        harness.run();
        harness.drag_at(at(0.2));
        harness.run();
        for part in [0.3, 0.4] {
            harness.hover_at(at(part));
            harness.run();
        }
        assert_eq!(place(&harness), before, "{is_at_end}");
        let preview = harness.state().selection.preview.get().cloned().unwrap();
        preview.params.to::<SpeedLimit>().unwrap().max_speed_mps
    };
    assert_eq!(dragged(false), dragged(true));
}

#[test]
fn undo_takes_back_what_was_sent_and_keeps_what_was_not() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    send_two(&mut harness);
    take(&mut harness, 2.0);
    type_speed(&mut harness, "1.5");
    harness.get_by_label_contains("Undo").click();
    harness.run();
    assert_eq!(sent(&harness), [2.0, 1.0]);
    take(&mut harness, 1.0);
    let preview = harness.state().selection.preview.get().cloned().unwrap();
    assert_eq!(preview.params.to::<SpeedLimit>().unwrap().max_speed_mps, 1.5);
}

#[test]
fn what_was_not_sent_undo_and_kept_sets_are_there_again_after_another_layout() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    send_two(&mut harness);
    take(&mut harness, 2.0);
    harness.get_by_label("Parameters A").click();
    harness.run();
    type_speed(&mut harness, "1.5");
    // Another layout has other views, and so has the one before that comes back.
    for (kind, preview) in [("timing", None), ("tuning", Some(1.5))] {
        harness.state_mut().view = (view_type(kind).unwrap().make)();
        harness.run();
        let now = harness.state().selection.preview.get().cloned();
        let speed = now.map(|now| now.params.to::<SpeedLimit>().unwrap().max_speed_mps);
        assert_eq!(speed, preview, "{kind}");
    }
    assert!(harness.query_by_label("Forget A and B").is_some());
    harness.get_by_label_contains("Undo").click();
    harness.run();
    assert_eq!(sent(&harness), [2.0, 1.0]);
}

#[test]
fn undo_takes_back_no_parameters_that_others_have_sent_since() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    send_two(&mut harness);
    take(&mut harness, 3.0);
    let undo = harness.get_by_label_contains("Undo");
    assert!(undo.accesskit_node().is_disabled());
    let at = undo.rect().center();
    undo.click();
    harness.run();
    assert_eq!(sent(&harness), [2.0]);
    harness.hover_at(at);
    // Passes are a quarter of a second apart.
    harness.run_steps(8);
    assert!(harness.query_by_label_contains("nothing to undo").is_some());
}

#[test]
fn undo_that_cannot_send_is_disabled_and_says_why() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    send_two(&mut harness);
    take(&mut harness, 2.0);
    let is_disabled =
        |harness: &Harness<'_, Shown>| harness.get_by_label_contains("Undo").accesskit_node().is_disabled();
    assert!(!is_disabled(&harness));
    let frame = &mut harness.state_mut().frame;
    frame.info = Arc::new(SourceInfo { kind: SourceKind::Log, ..(*frame.info).clone() });
    harness.run();
    assert!(is_disabled(&harness));
    // The note below says so, too.
    let told = |harness: &Harness<'_, Shown>| {
        harness.query_all_by_label("A recording cannot be written to; run a stack on it.").count()
    };
    let before = told(&harness);
    let at = harness.get_by_label_contains("Undo").rect().center();
    harness.hover_at(at);
    // Passes are a quarter of a second apart.
    harness.run_steps(8);
    assert!(told(&harness) > before);
}

#[test]
fn the_keyboard_reaches_the_arrow_of_a_parameter_after_its_control() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    go_to_number(&mut harness);
    press(&mut harness, Key::Tab);
    let arrow = harness.get_by_label("Default of max_speed_mps: 0.5");
    assert!(arrow.accesskit_node().is_focused());
}

#[test]
fn what_was_sent_can_be_undone_when_it_is_in_force_again_after_another_value() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    send_two(&mut harness);
    take(&mut harness, 2.0);
    for (in_force, expected) in [(1.0, vec![2.0]), (2.0, vec![2.0, 1.0])] {
        take(&mut harness, in_force);
        harness.get_by_label_contains("Undo").click();
        harness.run();
        assert_eq!(sent(&harness), expected, "{in_force}");
    }
}

#[test]
fn a_command_that_goes_out_on_each_change_does_not_go_out_without_one() {
    let mut harness = shown("details", &serde_json::json!({ "on_each_change": true }), 1.0);
    go_to_number(&mut harness);
    press(&mut harness, Key::Tab);
    assert_eq!(harness.state().controls.len(), 0, "nothing was changed");
    for _ in 0..2 {
        go_to_number(&mut harness);
        harness.event(Event::Text("2.5".to_owned()));
        harness.run();
        press(&mut harness, Key::Tab);
        assert_eq!(harness.state().controls.len(), 1, "the same number is sent once");
    }
}

#[test]
fn parameters_of_a_command_are_there_again_after_another_layout_and_do_not_go_out_again_by_themselves() {
    let saved = serde_json::json!({ "on_each_change": true });
    let mut harness = shown("details", &saved, 1.0);
    type_speed(&mut harness, "2.5");
    for kind in ["timing", "details"] {
        let mut view = (view_type(kind).unwrap().make)();
        view.load(&saved).unwrap();
        harness.state_mut().view = view;
        harness.run();
    }
    type_speed(&mut harness, "2.5");
    assert_eq!(harness.state().controls.len(), 1, "nothing was changed");
    harness.get_by_label_contains("Send LIMIT").click();
    harness.run();
    let speed = |control: &Control| match control {
        Control::Write { message, .. } => {
            let command = message.to::<Command>().unwrap();
            SpeedLimit::decode(command.parameters).unwrap().max_speed_mps
        }
        other => panic!("{other:?}"),
    };
    let sent: Vec<f64> = harness.state().controls.iter().map(speed).collect();
    assert_eq!(sent, [2.5, 2.5]);
}

#[test]
fn a_command_with_parameters_in_the_menu_of_a_box_is_to_be_prepared_and_is_not_sent() {
    let mut harness = shown("hierarchy", &serde_json::json!({}), 1.0);
    harness.get_by_label_contains("Process vehicle_interface").click_secondary();
    harness.run();
    harness.get_by_label("LIMIT…").click();
    harness.run();
    assert!(harness.state().controls.is_empty());
    let wishes = &harness.state().wishes;
    let [Wish::Command { process, command }] = wishes.as_slice() else { panic!("{wishes:?}") };
    assert_eq!((&**process, command.as_str()), ("vehicle_interface", "LIMIT"));
}

#[test]
fn a_narrow_tile_shows_the_number_of_a_command_that_is_to_be_sent_and_of_the_one_that_was_sent() {
    let size = Vec2::new(320.0, 400.0);
    let mut harness = harness(view("details", &serde_json::json!({}), 1.0), size, Theme::Dark);
    let limit = AnyMessage::new(SpeedLimit { max_speed_mps: 1.25 });
    let command = Command {
        name: "LIMIT".into(),
        parameters_schema: limit.schema().name().to_owned(),
        parameters: limit.bytes(),
        ..Command::default()
    };
    let sent = samples::topic("/vehicle_interface/command", 0.0, 0.1, command);
    let mut processes = harness.state().frame.processes.to_vec();
    processes[0].command_buffer = sent.name.to_string();
    harness.state_mut().frame.processes = processes.into();
    put(&mut harness, &sent);
    // Of each text: where it ends, and from where on it is cut.
    let texts = harness.output().shapes.iter().filter_map(|painted| {
        let Shape::Text(text) = &painted.shape else { return None };
        let end = if text.galley.elided { f32::INFINITY } else { text.pos.x + text.galley.size().x };
        Some((text.galley.text().to_owned(), end, painted.clip_rect.right()))
    });
    let texts: Vec<(String, f32, f32)> = texts.collect();
    for part in ["0.5", " m/s", "1.25"] {
        let is_whole = |(text, end, cut): &(String, f32, f32)| text.starts_with(part) && end <= cut;
        assert!(texts.iter().any(is_whole), "{part}: {texts:?}");
    }
}

#[test]
fn all_lines_of_buttons_begin_at_one_place_in_a_narrow_tile() {
    let shown = view("tuning", &serde_json::json!({}), 1.0);
    let mut harness = harness(shown, Vec2::new(215.0, 400.0), Theme::Dark);
    harness.run();
    let lefts = ["  Send", "  Undo", "  Save…"].map(|name| harness.get_by_label_contains(name).rect().left());
    assert_eq!(lefts, [lefts[0]; 3]);
}

#[test]
fn a_and_b_are_beside_each_other_in_a_tile_of_any_width() {
    for width in (150_u16..400).step_by(10) {
        let shown = view("tuning", &serde_json::json!({}), 1.0);
        let mut harness = harness(shown, Vec2::new(width.into(), 400.0), Theme::Dark);
        harness.run();
        let [a, b] = ["A", "B"].map(|name| harness.get_by_label(&format!("Parameters {name}")).rect());
        assert!(a.top() == b.top() && a.right() < b.left(), "{width}: {a:?} {b:?}");
    }
}

fn preview(process: &str, stage: PreviewStage) -> Preview {
    let params = AnyMessage::new(SpeedLimit { max_speed_mps: 1.0 });
    Preview { process: process.into(), run: RunTag::FIRST, before: params.clone(), params, stage }
}

#[test]
fn a_preview_of_what_is_on_its_way_ends_when_its_view_is_hidden() {
    let own = Arc::new(());
    let mut previews = Previews::default();
    for _ in 0..2 {
        previews.set(&own, preview("wm1", PreviewStage::OnItsWay));
        previews.turn();
        assert!(previews.get().is_some());
    }
    assert!(previews.turn() && previews.get().is_none(), "nobody notices whether it was lost");
}

#[test]
fn a_preview_stays_while_its_view_exists_until_that_view_ends_it() {
    let preview = |process: &str| preview(process, PreviewStage::Edited);
    let (a, b) = (Arc::new(()), Arc::new(()));
    let mut previews = Previews::default();
    previews.set(&a, preview("wm1"));
    assert!(previews.turn() && !previews.turn(), "it stays while its view is hidden");
    previews.end(&b, None);
    previews.end(&a, Some("planner"));
    assert!(!previews.turn(), "a view without a draft ends nothing of another one");
    previews.end(&a, Some("wm1"));
    assert!(previews.turn() && previews.get().is_none());
    previews.set(&a, preview("wm1"));
    previews.turn();
    drop(a);
    assert!(previews.turn() && previews.get().is_none(), "its view was closed");
}

#[test]
fn nothing_moves_where_parameters_are_kept_and_the_button_that_forgets_them_is_in_their_line() {
    let mut harness = shown("tuning", &serde_json::json!({}), 1.0);
    let places = |harness: &Harness<'_, Shown>| {
        let kept = ["Parameters A", "Parameters B"].map(|name| harness.get_by_label(name).rect());
        (kept, harness.get_by_label_contains("Save…").rect())
    };
    let before = places(&harness);
    harness.get_by_label("Parameters A").click();
    harness.run();
    assert_eq!(places(&harness), before);
    let (of_forget, [of_a, _]) = (harness.get_by_label("Forget A and B").rect(), before.0);
    let lower_by = of_forget.center().y - of_a.center().y;
    assert!(lower_by.abs() < 1.0, "{lower_by}");
}
