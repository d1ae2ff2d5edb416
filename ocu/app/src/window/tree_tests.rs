//! Tests of the arrangement of views.

use super::*;
use crate::bundled;

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
    use rcs_msg::Stamp;
    use rcs_runtime::source::{Control, FieldPoint, FieldSeries, RunTag, SourceInfo, SourceKind};
    use std::sync::Arc;
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
