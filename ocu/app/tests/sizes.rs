//! The whole window at every size and scale: nothing overprints, nothing is cut, and it looks as in the pictures.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use egui::accesskit::Role;
use egui_kittest::kittest::{AccessKitNode, NodeT};
use egui_kittest::{Harness, SnapshotOptions, SnapshotResults};
use ocu_app::layout::Layout;
use ocu_app::open::Request;
use ocu_app::render::frame_at;
use ocu_app::window::Window;
use rcs_runtime::source::{Frame, Playback};
use std::sync::Arc;

/// Sizes in pixels, and pixels per point.
const SIZES: [(f32, f32); 3] = [(640.0, 480.0), (1000.0, 700.0), (1600.0, 900.0)];
const SCALES: [f32; 3] = [1.0, 1.5, 2.0];

/// A simulated vehicle two seconds after its start, which plays and has fallen behind: as much as bars can show.
fn moment() -> (Request, Arc<Frame>) {
    let request = Request { stack: Some("simulation".to_owned()), ..Request::default() };
    let mut frame = frame_at(&request, 2.0).unwrap();
    frame.playback = Playback { playing: true, achieved: Some(0.42), lag_s: 3.1, ..Playback::default() };
    (request, Arc::new(frame))
}

fn window(
    request: Request,
    frame: Arc<Frame>,
    size: egui::Vec2,
    scale: f32,
) -> Harness<'static, Option<Window>> {
    let layout = Layout::named("simulation").unwrap();
    let mut harness = Harness::builder()
        .with_size(size / scale)
        .with_pixels_per_point(scale)
        .with_render_cursor(false)
        .with_max_steps(24)
        .build_ui_state(
            move |ui, state: &mut Option<Window>| {
                if let Some(window) = state {
                    window.ui(ui);
                } else {
                    // Fonts are available from the next pass on.
                    ocu_ui::install(ui.ctx());
                    *state = Some(Window::still(ui.ctx(), &request, Arc::clone(&frame), &layout));
                    ui.ctx().request_repaint();
                }
            },
            None,
        );
    harness.run_steps(12);
    harness
}

/// What can be clicked or read in the bar at the top and in that of time, with its place.
fn in_bars(harness: &Harness<'_, Option<Window>>) -> Vec<(String, egui::Rect)> {
    let wanted = [Role::Button, Role::ComboBox, Role::Label, Role::ProgressIndicator];
    let root = harness.root();
    let nodes = root.children_recursive().filter(|node| wanted.contains(&node.accesskit_node().role()));
    // A panel of the window, or a pane in it.
    let pane = |node: AccessKitNode<'_>| {
        let mut above = node.parent();
        while let Some(node) = above.filter(|node| node.role() != Role::Pane) {
            above = node.parent();
        }
        above.map(|node| node.id())
    };
    let named = nodes.map(|node| {
        let access = node.accesskit_node();
        (access.label().or_else(|| access.value()).unwrap_or_default(), node.rect(), pane(access))
    });
    let all: Vec<_> = named.filter(|(_, rect, _)| rect.is_positive()).collect();
    let row = |wanted: &str| {
        let found = all.iter().find(|(name, ..)| name.starts_with(wanted));
        let (_, rect, pane) = found.unwrap_or_else(|| panic!("no {wanted}: {all:?}"));
        (rect.center().y, *pane)
    };
    let rows = [row("Emergency stop"), row("Pause")];
    // Items of a bar are centred in it and no higher than it.
    let is_in_a_bar = |rect: &egui::Rect, pane| {
        let is_in = |row: &(f32, _)| (rect.center().y - row.0).abs() < 3.0 && row.1 == pane;
        rect.height() < 28.0 && rows.iter().any(is_in)
    };
    let in_bars = all.into_iter().filter(|(_, rect, pane)| is_in_a_bar(rect, *pane));
    in_bars.map(|(name, rect, _)| (name, rect)).collect()
}

#[test]
fn nothing_overprints_or_is_cut_at_any_size_and_scale() {
    let (request, frame) = moment();
    let mut results = SnapshotResults::new();
    for (width, height) in SIZES {
        for scale in SCALES {
            let size = egui::vec2(width, height);
            let mut harness = window(request.clone(), Arc::clone(&frame), size, scale);
            let what = format!("{width}_at_{}", (scale * 100.0) as u32);
            let screen = egui::Rect::from_min_size(egui::Pos2::ZERO, size / scale);
            let items = in_bars(&harness);
            assert!(items.len() >= 6, "{what}: {items:?}");
            for (index, (name, rect)) in items.iter().enumerate() {
                assert!(screen.contains_rect(rect.shrink(0.5)), "{what}: {name} is cut: {rect:?}");
                for (other, place) in &items[..index] {
                    let common = rect.shrink(0.5).intersect(place.shrink(0.5));
                    assert!(!common.is_positive(), "{what}: {name} {rect:?} over {other} {place:?}");
                }
            }
            let options = SnapshotOptions::new().threshold(1.6).max_failed_pixels(200_usize);
            harness.snapshot_options(format!("window_{what}"), &options);
            results.extend(harness.take_snapshot_results());
        }
    }
}
