//! Tests of the arrangement of views.

use super::*;
use crate::bundled;
use crate::open::Request;
use crate::window::Window;
use egui::{Event, Key, Modifiers, PointerButton, Pos2, Rect, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use ocu_views::{ShowIn, TopicKey};
use rcs_bus::{Header, Sample, WriterId};
use rcs_msg::foxglove::PosesInFrame;
use rcs_msg::{AnyMessage, Stamp, schema_of};
use rcs_runtime::source::{Frame, RunTag, Topic};
use std::sync::Arc;

/// Kinds and states of the views below a tile, in order.
fn states(node: &Node) -> Vec<(&str, &SavedState)> {
    match node {
        Node::Row(parts) | Node::Column(parts) => parts.iter().flat_map(|(_, node)| states(node)).collect(),
        Node::Grid(nodes) | Node::Tabs { tiles: nodes, .. } => nodes.iter().flat_map(states).collect(),
        Node::View { kind, state, .. } => vec![(kind.as_str(), state)],
    }
}

/// Whether a view has kept all of a state. It keeps more where the state leaves out fields, and sorts some lists.
fn is_kept(state: &SavedState, kept: &SavedState) -> bool {
    match (state, kept) {
        (SavedState::Object(state), SavedState::Object(kept)) => {
            state.iter().all(|(name, value)| kept.get(name).is_some_and(|kept| is_kept(value, kept)))
        }
        (SavedState::Array(state), SavedState::Array(kept)) => {
            state.len() == kept.len()
                && state.iter().all(|value| kept.iter().any(|kept| is_kept(value, kept)))
        }
        _ => state == kept,
    }
}

#[test]
fn a_layout_survives_being_opened_and_kept() {
    let mut stored = 0;
    for name in bundled::names("layout") {
        let layout = Layout::bundled(name).unwrap().unwrap();
        let kept = Workspace::new(&layout).layout(layout.buffers);
        let again = Workspace::new(&kept).layout(kept.buffers);
        assert_eq!(kept, again, "{name}");
        let (views, kept) = (states(&layout.root), states(&kept.root));
        assert_eq!(views.len(), kept.len(), "{name}");
        for ((kind, state), (kept_kind, kept)) in views.into_iter().zip(kept) {
            assert_eq!(kind, kept_kind, "{name}");
            if !state.is_null() {
                assert!(is_kept(state, kept), "{name}, {kind}: of {state} there is {kept}");
                stored += 1;
            }
        }
    }
    assert!(stored > 5, "bundled layouts store the states of {stored} views");
}

#[test]
fn views_can_be_added_to_an_empty_workspace_and_beside_others() {
    let mut workspace = Workspace::new(&Layout::empty());
    assert!(workspace.is_empty());
    let view_type = &ocu_views::all()[0];
    workspace.add(view_type);
    assert!(!workspace.is_empty());
    workspace.add(view_type);
    let Node::Row(parts) = workspace.layout(true).root else { panic!("expected a row") };
    assert_eq!(parts.len(), 2);
}

fn view(kind: &str, id: u64) -> Node {
    Node::View { kind: kind.into(), state: SavedState::Null, run: RunChoice::Shown, id }
}

#[test]
fn a_view_opens_beside_the_one_that_was_used_and_takes_half_of_its_place() {
    let root = Node::Row(vec![(3.0, view("map", 0)), (1.0, view("camera", 0))]);
    let mut workspace = Workspace::new(&Layout { root, ..Layout::empty() });
    workspace.focused = Some(1);
    workspace.add(view_type("fields").unwrap());
    let Node::Row(parts) = workspace.layout(true).root else { panic!("expected a row") };
    let kinds: Vec<_> = parts
        .iter()
        .map(|(share, node)| match node {
            Node::View { kind, .. } => (kind.as_str(), share.round() as i32),
            _ => panic!("expected views"),
        })
        .collect();
    assert_eq!(kinds, [("map", 38), ("fields", 38), ("camera", 25)]);
}

#[test]
fn views_that_are_in_both_arrangements_are_the_same_and_keep_where_they_look() {
    let mut workspace = Workspace::new(&Layout {
        root: Node::Row(vec![(1.0, view("map", 0)), (1.0, view("camera", 0))]),
        ..Layout::empty()
    });
    let before = workspace.layout(true);
    let address = |workspace: &Workspace, id: u64| {
        let panes = workspace.tree.tiles.tiles().filter_map(|tile| match tile {
            Tile::Pane(pane) if pane.id == id => Some(std::ptr::from_ref(&*pane.view).addr()),
            _ => None,
        });
        panes.last()
    };
    let map = address(&workspace, 1);
    assert!(map.is_some());
    let only = Layout { root: view("map", 1), ..before.clone() };
    workspace.apply(&only);
    assert_eq!(address(&workspace, 1), map);
    workspace.apply(&before);
    assert_eq!(address(&workspace, 1), map, "undo has kept it");
    assert_eq!(workspace.layout(true), before);
}

#[test]
fn a_view_may_be_bound_to_a_run_which_layouts_store() {
    let bound = Node::View { kind: "map".into(), state: SavedState::Null, run: RunChoice::Run(3), id: 0 };
    let root = Node::Row(vec![(1.0, bound), (1.0, view("map", 0))]);
    let layout = Workspace::new(&Layout { root, ..Layout::empty() }).layout(true);
    let text = layout.to_text().unwrap();
    assert_eq!(text.matches("run:").count(), 1, "{text}");
    let workspace = Workspace::new(&Layout::parse("again", &text).unwrap());
    assert_eq!(workspace.runs(), [RunId(3)]);
}

#[test]
fn a_condition_stops_the_source_while_its_view_is_hidden() {
    use rcs_runtime::source::{Control, FieldPoint, FieldSeries, SourceInfo, SourceKind};
    let state = serde_json::json!({ "conditions": [{ "formula": "/a.x > 1", "stops": true }] });
    let condition = Node::View { kind: "conditions".into(), state, run: RunChoice::Shown, id: 0 };
    let root = Node::Tabs { active: 1, tiles: vec![condition, view("map", 0)] };
    let mut workspace = Workspace::new(&Layout { root, ..Layout::empty() });
    let info = SourceInfo { kind: SourceKind::Stack, ..SourceInfo::default() };
    let values = [(10, 0.0), (20, 2.0)];
    let field = FieldSeries {
        field: workspace.fields()[0].clone(),
        run: RunTag::FIRST,
        points: values.into_iter().map(|(time, value)| FieldPoint { stamp: Stamp(time), value }).collect(),
        names: Arc::default(),
        states: Arc::default(),
        reading: None,
        problem: None,
    };
    let mut frame = Frame::empty(Arc::new(info), Stamp(25));
    (frame.playback.playing, frame.playback.from) = (true, Stamp(5));
    frame.fields = Arc::new([field]);
    let (mut controls, mut selection, mut wishes) = (Vec::new(), ocu_views::Selection::default(), Vec::new());
    let mut cx = ViewContext {
        frame: &frame,
        controls: &mut controls,
        selection: &mut selection,
        wishes: &mut wishes,
    };
    workspace.watch(&egui::Context::default(), &mut cx);
    assert!(matches!(controls.as_slice(), [Control::Pause, Control::Seek(Stamp(20))]), "{controls:?}");
}

#[test]
fn a_command_is_prepared_in_the_view_that_sends_it_which_comes_to_the_front_or_opens() {
    let state = |workspace: &Workspace| {
        let layout = workspace.layout(true);
        let Node::Tabs { active, tiles } = layout.root else { panic!("expected tabs") };
        let Node::View { kind, state, .. } = &tiles[active] else { panic!("expected a view") };
        assert_eq!(kind, "details");
        state["commands"]["planner"].clone()
    };
    let root = Node::Tabs { active: 1, tiles: vec![view("details", 0), view("map", 0)] };
    let mut workspace = Workspace::new(&Layout { root, ..Layout::empty() });
    workspace.choose_command("planner", "GOTO");
    assert_eq!(state(&workspace), "GOTO");
    let mut workspace = Workspace::new(&Layout { root: view("map", 0), ..Layout::empty() });
    workspace.choose_command("planner", "GOTO");
    let text = workspace.layout(true).to_text().unwrap();
    assert!(text.contains("details") && text.contains("GOTO"), "{text}");
}

/// Two paths in frames that no transform connects.
fn paths() -> Frame {
    let now = Stamp(1_000_000_000);
    let topics = ["/one", "/two"].map(|name| {
        let header = Header { sequence: 1, log_time: now, acq_time: now, writer: WriterId::RUNTIME };
        let path = PosesInFrame { frame_id: format!("frame of {name}"), ..PosesInFrame::default() };
        Topic::new(name, RunTag::FIRST, Arc::clone(schema_of::<PosesInFrame>()))
            .with_latest(Sample { header, message: AnyMessage::new(path) })
    });
    Frame { topics: Arc::new(topics), ..Frame::empty(Arc::default(), now) }
}

#[test]
fn a_topic_is_shown_by_the_view_that_draws_it_or_can_and_a_new_map_has_a_frame_that_suits_it() {
    let frame = paths();
    let maps = |workspace: &Workspace| {
        let layout = workspace.layout(true);
        let views = states(&layout.root).into_iter().filter(|(kind, _)| *kind == "map");
        views.map(|(_, state)| state.clone()).collect::<Vec<SavedState>>()
    };
    let is_in_front = |workspace: &Workspace| {
        let seen = workspace.tree.active_tiles();
        seen.iter().any(|id| matches!(workspace.tree.tiles.get(*id), Some(Tile::Pane(pane)) if pane.id == 1))
    };
    let state = serde_json::json!({ "frame": "frame of /one", "layers": { "/one": { "shown": false } } });
    let map = Node::View { kind: "map".into(), state, run: RunChoice::Shown, id: 1 };
    let root = Node::Tabs { active: 1, tiles: vec![map, view("fields", 2)] };
    let mut workspace = Workspace::new(&Layout { root, ..Layout::empty() });
    assert!(!is_in_front(&workspace));
    for time in ["hidden", "drawn"] {
        workspace.show_topic(&frame, &TopicKey::shown("/one"), ShowIn::View);
        let maps = maps(&workspace);
        assert_eq!(maps.len(), 1, "{time}");
        assert_eq!(maps[0]["layers"]["/one"]["shown"], true, "{time}");
        assert!(is_in_front(&workspace), "{time}");
    }
    for time in ["another frame", "drawn"] {
        workspace.show_topic(&frame, &TopicKey::shown("/two"), ShowIn::View);
        let maps = maps(&workspace);
        assert_eq!(maps.len(), 2, "{time}");
        assert!(maps.iter().any(|map| map["frame"] == "frame of /two"), "{time}");
    }
    workspace.show_topic(&frame, &TopicKey::shown("/one"), ShowIn::NewView);
    assert_eq!(maps(&workspace).len(), 3, "a new view was asked for");
}

type Shown = Harness<'static, Option<Window>>;

fn workspace(shown: &Shown) -> &Workspace {
    shown.state().as_ref().and_then(|window| window.workspace.as_ref()).unwrap()
}

/// Containers, kinds and identities of a layout.
fn shape(node: &Node) -> String {
    let linear = |name: &str, parts: &[(f32, Node)]| {
        let parts: Vec<String> = parts.iter().map(|(_, node)| shape(node)).collect();
        format!("{name}({})", parts.join(" "))
    };
    let list = |nodes: &[Node]| nodes.iter().map(shape).collect::<Vec<_>>().join(" ");
    match node {
        Node::Row(parts) => linear("row", parts),
        Node::Column(parts) => linear("column", parts),
        Node::Grid(nodes) => format!("grid({})", list(nodes)),
        Node::Tabs { active, tiles } => format!("tabs {active} of ({})", list(tiles)),
        Node::View { kind, id, .. } => format!("{kind} {id}"),
    }
}

fn shape_of(shown: &Shown) -> String {
    shape(&workspace(shown).layout(true).root)
}

/// The place of a view with its tabs.
fn place(shown: &Shown, kind: &str) -> Rect {
    let tiles = &workspace(shown).tree.tiles;
    let mut panes = tiles.iter();
    let (pane, _) =
        panes.find(|(_, tile)| matches!(tile, Tile::Pane(pane) if pane.view_type.kind == kind)).unwrap();
    tiles.rect(tiles.parent_of(*pane).unwrap()).unwrap()
}

/// A point of the first tab.
fn tab(shown: &Shown, kind: &str) -> Pos2 {
    place(shown, kind).min + Vec2::new(16.0, 12.0)
}

fn drag(shown: &mut Shown, from: Pos2, to: Pos2) {
    shown.hover_at(from);
    shown.step();
    shown.drag_at(from);
    shown.step();
    for at in [from.lerp(to, 0.5), to] {
        shown.hover_at(at);
        shown.step();
    }
    shown.drop_at(to);
}

/// Chooses the only line of the palette that has this text.
fn choose(shown: &mut Shown, text: &str) {
    shown.key_press_modifiers(Modifiers::COMMAND, Key::K);
    shown.run_steps(3);
    shown.get_by_label("Find a command").type_text(text);
    shown.run_steps(3);
    shown.key_press(Key::Enter);
}

/// A change by its name.
type Change = (&'static str, fn(&mut Shown));

/// What changes an arrangement, each in one step.
const CHANGES: [Change; 7] = [
    ("add by the palette", |shown| choose(shown, "view: timing")),
    ("drag into the tabs", |shown| {
        // The middle of what is below the tabs.
        let to = place(shown, "fields").center() + Vec2::new(0.0, 12.0);
        drag(shown, tab(shown, "timing"), to);
    }),
    ("drag beside", |shown| {
        let map = place(shown, "map");
        drag(shown, tab(shown, "fields"), map.left_center() + Vec2::new(0.25 * map.width(), 0.0));
    }),
    ("double click on a buffer", |shown| {
        for _ in 0..2 {
            // The list of buffers is at the left of the views.
            let rows = shown.query_all_by_label("/two");
            rows.min_by(|a, b| a.rect().left().total_cmp(&b.rect().left())).unwrap().click();
        }
    }),
    ("close", |shown| {
        let pos = tab(shown, "timing");
        shown.hover_at(pos);
        for pressed in [true, false] {
            let (button, modifiers) = (PointerButton::Middle, Modifiers::NONE);
            shown.event(Event::PointerButton { pos, button, pressed, modifiers });
        }
    }),
    ("another layout", |shown| choose(shown, "layout: fields")),
    ("reset", |shown| choose(shown, "reset the layout")),
];

#[test]
fn every_change_of_the_arrangement_is_one_step_that_is_undone_and_redone() {
    let frame = Arc::new(paths());
    // Rounded to whole percents, these shares add up to 101.
    let parts = [(59.6, "map"), (19.7, "fields"), (20.7, "log")];
    let root = Node::Row(parts.map(|(share, kind)| (share, view(kind, 0))).into());
    let layout = Layout { root, ..Layout::empty() };
    let mut shown: Shown = Harness::builder().with_size([1600.0, 900.0]).with_step_dt(0.02).build_ui_state(
        move |ui, window: &mut Option<Window>| {
            if let Some(window) = window {
                window.ui(ui);
            } else {
                // Fonts are available from the next pass on.
                ocu_ui::install(ui.ctx());
                *window = Some(Window::still(ui.ctx(), &Request::default(), Arc::clone(&frame), &layout));
                ui.ctx().request_repaint();
            }
        },
        None,
    );
    // Longer than between the clicks of a double click, so that no change continues the one before.
    let settle = |shown: &mut Shown| {
        shown.remove_cursor();
        shown.run_steps(30);
    };
    settle(&mut shown);
    let mut shapes = vec![shape_of(&shown)];
    for (name, change) in CHANGES {
        let before = shape_of(&shown);
        change(&mut shown);
        settle(&mut shown);
        let after = shape_of(&shown);
        assert_ne!(after, before, "{name}");
        for (key, expected) in [(Key::Z, &before), (Key::Y, &after)] {
            shown.key_press_modifiers(Modifiers::COMMAND, key);
            settle(&mut shown);
            assert_eq!(shape_of(&shown), *expected, "{name}, {key:?}");
        }
        shapes.push(after);
    }
    let (back, forward) = (shapes.iter().rev().collect::<Vec<_>>(), shapes.iter().collect());
    for (key, steps) in [(Key::Z, back), (Key::Y, forward)] {
        for expected in steps.into_iter().skip(1) {
            shown.key_press_modifiers(Modifiers::COMMAND, key);
            settle(&mut shown);
            assert_eq!(shape_of(&shown), *expected, "{key:?}");
        }
    }
}
