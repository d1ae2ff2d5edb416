//! Interaction with views, without a display.

mod access;
mod behaviour;
mod compares;
mod conditions;
mod drives;
mod edits;
mod hostile;
mod log_lines;
mod missions;
mod namesakes;
mod overlays;
mod pictures;
mod plans;
mod presses;
mod projections;
mod read_outs;
mod saved;
mod scenes;
mod sweeps;
mod topic_lists;
mod tracks;
mod tunes;
mod weighs;

use crate::samples;
use crate::view::{Selection, View, ViewContext, Wish, show};
use crate::views::{all, view_type};
use egui::{Pos2, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use rcs_runtime::source::{Control, Frame};
use std::collections::BTreeSet;

/// A view, its inputs, and its outputs.
struct Shown {
    view: Box<dyn View>,
    frame: Frame,
    selection: Selection,
    controls: Vec<Control>,
    wishes: Vec<Wish>,
}

impl Shown {
    fn new(kind: &str, frame: Frame) -> Self {
        let view = (view_type(kind).expect(kind).make)();
        Self { view, frame, selection: Selection::default(), controls: Vec::new(), wishes: Vec::new() }
    }
}

fn harness(shown: Shown, size: Vec2, theme: Theme) -> Harness<'static, Shown> {
    Harness::builder()
        .with_size(size)
        .with_theme(theme)
        .with_max_steps(12)
        .with_render_cursor(false)
        .with_context_setup(ocu_ui::install)
        .build_ui_state(
            |ui, shown: &mut Shown| {
                let panel = ocu_ui::tokens(ui).panel();
                ui.painter().rect_filled(ui.max_rect(), 0.0, panel);
                let Shown { view, frame, selection, controls, wishes } = shown;
                let mut cx = ViewContext { frame, controls, selection, wishes };
                view.watch(ui.ctx(), &mut cx);
                show(view.as_mut(), ui, &mut cx);
                selection.hovered.turn();
                selection.preview.turn();
            },
            shown,
        )
}

/// Presses at a place, changes what is shown, and releases at the same place.
fn press_at(harness: &mut Harness<'_, Shown>, at: Pos2, change: impl FnOnce(&mut Shown)) {
    harness.drag_at(at);
    harness.step();
    change(harness.state_mut());
    harness.step();
    harness.drop_at(at);
    harness.step();
}

#[test]
fn every_view_draws_nothing_and_everything_at_any_size_in_both_themes() {
    for view_type in all() {
        for frame in [samples::empty(), samples::full(), samples::camera_in_space(), samples::compared()] {
            for size in [Vec2::new(180.0, 120.0), Vec2::new(900.0, 560.0)] {
                for theme in [Theme::Dark, Theme::Light] {
                    let mut harness = harness(Shown::new(view_type.kind, frame.clone()), size, theme);
                    harness.state_mut().selection.topic = Some(crate::TopicKey::shown("/wm1/map"));
                    harness.run();
                    assert!(!harness.state().view.title(&frame).is_empty(), "{}", view_type.kind);
                    assert!(
                        harness.state().controls.is_empty(),
                        "{} asks for something by itself",
                        view_type.kind
                    );
                }
            }
        }
    }
}

/// A view of each kind that accepts topics of the samples, with one of them.
const ACCEPTED: [(&str, &str); 7] = [
    ("camera", "/obstacles/labels"),
    ("fields", "/flat/chatter"),
    ("map", "/planner/path"),
    ("map", "/wm1/map"),
    ("plan", "/planner/plan"),
    ("plot", "/planner/status"),
    ("scene", "/lidar/points"),
];

#[test]
fn every_topic_can_be_dropped_where_it_is_accepted_and_is_named_there() {
    let mut accepted = BTreeSet::new();
    for frame in [samples::full(), samples::driving()] {
        for (view_type, topic) in
            all().iter().flat_map(|view_type| frame.topics.iter().map(move |t| (view_type, t)))
        {
            let mut shown = Shown::new(view_type.kind, frame.clone());
            if shown.view.accepts(topic) {
                shown.view.drop_topic(topic);
                let mut harness = harness(shown, Vec2::new(500.0, 400.0), Theme::Dark);
                harness.run();
                let view = &harness.state().view;
                let is_named = match view_type.kind {
                    "camera" | "fields" => view.title(&frame) == *topic.name,
                    // The formula begins with the topic; which field is meant is chosen next.
                    "plot" => harness.get_by_label("Formula").value().unwrap().contains(&*topic.name),
                    // Titles do not depend on the topic.
                    _ => view.save().to_string().contains(&*topic.name),
                };
                assert!(is_named, "{} does not name {}", view_type.kind, topic.name);
                accepted.insert((view_type.kind, topic.name.to_string()));
            }
        }
    }
    for (kind, topic) in ACCEPTED {
        assert!(accepted.contains(&(kind, topic.to_owned())), "{kind} refuses {topic}");
    }
    for (kind, topic) in [("camera", "/wm1/map"), ("plot", "/flat/chatter"), ("scene", "/camera/image")] {
        assert!(!accepted.contains(&(kind, topic.to_owned())), "{kind} accepts {topic}");
    }
    let kinds: BTreeSet<&str> = accepted.iter().map(|(kind, _)| *kind).collect();
    assert_eq!(kinds, BTreeSet::from(ACCEPTED.map(|(kind, _)| kind)));
}

#[test]
fn every_view_gives_back_what_it_saved_and_survives_what_it_did_not() {
    for view_type in all() {
        let mut view = (view_type.make)();
        let saved = view.save();
        view.load(&saved).unwrap();
        assert_eq!(view.save(), saved, "{}", view_type.kind);
        let empty_object = serde_json::json!({});
        if !saved.is_null() {
            view.load(&empty_object).unwrap_or_else(|error| panic!("{}: {error}", view_type.kind));
            assert_eq!(view.save(), saved, "{}: a field that is missing keeps its default", view_type.kind);
            view.load(&serde_json::json!("nonsense")).unwrap_err();
            assert_eq!(view.save(), saved, "{}: a value that does not fit changes nothing", view_type.kind);
        }
    }
}

#[test]
fn kinds_names_and_summaries_are_said_once() {
    let mut kinds: Vec<_> = all().iter().map(|view_type| view_type.kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    assert_eq!(kinds.len(), all().len());
    assert!(all().iter().all(|view_type| view_type.summary.ends_with('.') && view_type.summary.len() < 100));
}
