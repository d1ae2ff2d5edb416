use super::*;
use crate::fields::MOST_BYTES;
use crate::samples;
use crate::view::{Hovers, Selection, TopicKey};
use egui::Theme;
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use rcs_formula::Points;
use rcs_msg::foxglove::RawImage;
use rcs_runtime::source::{FieldSeries, RunTag, Series, series_of};
use std::sync::Arc;

/// A frame with a field of quantities, one with gaps, and one of states, over twelve seconds.
pub(crate) fn frame() -> Frame {
    let mut frame = samples::full();
    let start = frame.info.start;
    let series = |field: &str, hz: f64, value: &dyn Fn(f64) -> f64| {
        let count = (12.0 * hz) as u64;
        let stamps: Vec<_> = (0..count).map(|i| start.after_ns((i as f64 / hz * 1e9) as u64)).collect();
        let values: Vec<f64> = (0..count).map(|i| value(i as f64 / hz)).collect();
        let formula: rcs_formula::Formula = field.parse().unwrap();
        FieldSeries {
            field: formula.fields()[0].clone(),
            run: RunTag::FIRST,
            points: series_of(&Points::new(stamps, values)),
            names: Arc::default(),
            states: Arc::default(),
            reading: None,
            problem: None,
        }
    };
    let wave =
        series("/vehicle/state.speed_mps", 500.0, &|t| 1.2 + 0.6 * (t * 1.1).sin() + 0.1 * (t * 97.0).sin());
    let turn = series("/vehicle/state.yaw_rate_rps", 20.0, &|t| {
        if (5.0..6.5).contains(&t) { f64::NAN } else { 0.3 * (t * 0.9).cos() }
    });
    let names = [(0, "DONE".into()), (1, "EXEC".into()), (3, "ERROR".into())];
    let states = series("/planner/status.state", 5.0, &|t| {
        if t < 1.0 {
            0.0
        } else if t < 8.0 {
            1.0
        } else {
            3.0
        }
    });
    let states = FieldSeries { names: Arc::new(names.into()), ..states };
    frame.fields = Arc::new([wave, turn, states]);
    frame
}

struct Shown {
    view: Plot,
    frame: Frame,
    controls: Vec<Control>,
    wishes: Vec<Wish>,
}

fn harness(view: Plot, size: egui::Vec2) -> Harness<'static, Shown> {
    let shown = Shown { view, frame: frame(), controls: Vec::new(), wishes: Vec::new() };
    let mut selection = Selection { hovered: Hovers::default(), ..Selection::default() };
    Harness::builder()
        .with_size(size)
        .with_theme(Theme::Dark)
        .with_max_steps(12)
        .with_render_cursor(false)
        .with_context_setup(ocu_ui::install)
        .build_ui_state(
            move |ui, shown: &mut Shown| {
                ui.painter().rect_filled(ui.max_rect(), 0.0, ocu_ui::tokens(ui).panel());
                let Shown { view, frame, controls, wishes } = shown;
                let mut cx = ViewContext { frame, controls, selection: &mut selection, wishes };
                crate::view::show(view, ui, &mut cx);
                selection.hovered.turn();
            },
            shown,
        )
}

fn plot(graphs: &[&[&str]]) -> Plot {
    let graph = |formulas: &&[&str]| Graph {
        curves: formulas.iter().map(|formula| Curve::new(*formula)).collect(),
        ..Graph::default()
    };
    let saved = Saved { graphs: graphs.iter().map(graph).collect(), ..Saved::default() };
    Plot { saved, ..Plot::default() }
}

fn several() -> Plot {
    let mut view = plot(&[
        &["/vehicle/state.speed_mps", "smooth(/vehicle/state.speed_mps, 0.5)", "/planner/status.state"],
        &["/vehicle/state.yaw_rate_rps", "integral(/vehicle/state.yaw_rate_rps)"],
    ]);
    view.saved.graphs[1].curves[1].right = true;
    view.saved.statistics = true;
    view
}

#[test]
fn a_spectrum_has_a_graph_over_frequency() {
    let mut view = plot(&[&["/vehicle/state.speed_mps"], &["spectrum(/vehicle/state.speed_mps)"]]);
    view.saved.graphs[1].across = Some((0.0, 20.0));
    let mut harness = harness(view, egui::Vec2::new(640.0, 360.0));
    harness.run();
    let shelf = &mut harness.state_mut().view.shelf;
    let context = egui::Context::default();
    let shown = shelf.shown(&context, &frame(), "spectrum(/vehicle/state.speed_mps)", RunChoice::Shown);
    assert_eq!(shown.over, rcs_formula::Over::Frequency);
    let greatest = (40..shown.points.len()).filter_map(|index| shown.points.get(index));
    let peak = greatest.max_by(|a, b| a.value.total_cmp(&b.value)).unwrap();
    // The wave of 97 rad/s.
    assert!((peak.stamp.0 as f64 * 1e-9 - 97.0 / std::f64::consts::TAU).abs() < 0.1, "{peak:?}");
    assert!((peak.value - 0.1).abs() < 0.02, "{peak:?}");
    harness.snapshot("plot_spectrum");
}

#[test]
fn a_spectrum_beside_a_field_is_refused_and_says_why() {
    let view = plot(&[&["/vehicle/state.speed_mps", "spectrum(/vehicle/state.speed_mps)"]]);
    let mut harness = harness(view, egui::Vec2::new(640.0, 300.0));
    harness.run();
    let formula: rcs_formula::Formula =
        "spectrum(/vehicle/state.speed_mps) - /vehicle/state.speed_mps".parse().unwrap();
    let points = Points::from_seconds(&[(0.0, 1.0), (1.0, 2.0), (2.0, 1.0), (3.0, 2.0)]);
    let error = formula.eval(&[points]).unwrap_err().to_string();
    assert!(error.contains("over frequency"), "{error}");
}

#[test]
fn curves_states_and_statistics_are_drawn() {
    let mut harness = harness(several(), egui::Vec2::new(720.0, 480.0));
    harness.run();
    let options = egui_kittest::SnapshotOptions::new().threshold(1.6).max_failed_pixels(24_usize);
    harness.snapshot_options("plot_dark", &options);
    let all: Vec<String> = harness.state().view.fields().iter().map(ToString::to_string).collect();
    assert_eq!(all, ["/planner/status.state", "/vehicle/state.speed_mps", "/vehicle/state.yaw_rate_rps"]);
    // The statistics of the whole range: the integral has the time between points, the deviation its root.
    harness.get_by_label_contains("/vehicle/state.yaw_rate_rps: points 240");
    harness.get_by_label_contains("deviation 0.21644");
}

#[test]
fn against_another_and_arrays_are_drawn() {
    let mut view = plot(&[&["/vehicle/state.yaw_rate_rps"], &["/wm1/map.fields", "/camera/image.data"]]);
    view.saved.graphs[0].against = Some("/vehicle/state.speed_mps".to_owned());
    let mut harness = harness(view, egui::Vec2::new(720.0, 480.0));
    harness.run();
    let options = egui_kittest::SnapshotOptions::new().threshold(1.6).max_failed_pixels(24_usize);
    harness.snapshot_options("plot_against", &options);
}

/// What a graph draws in a frame.
fn drawn(context: &egui::Context, frame: &Frame, graph: &Graph) -> Drawn {
    let (mut shelf, mut drawn) = (Shelf::default(), Vec::new());
    let draw = |ui: &mut Ui| drawn.push(Drawn::new(ui, frame, &mut shelf, graph, &mut 0));
    context.run_ui(egui::RawInput::default(), draw).textures_delta.clear();
    drawn.pop().unwrap()
}

#[test]
fn a_field_over_time_beside_an_array_is_refused_and_an_array_against_a_field() {
    let (context, frame) = (egui::Context::default(), frame());
    let formulas = ["/vehicle/state.speed_mps", "/camera/image.data", "/nothing/here.x"];
    let mut graph = plot(&[&formulas]).saved.graphs.remove(0);
    let first = drawn(&context, &frame, &graph);
    assert_eq!(first.kind, GraphKind::Index);
    let [speed, array, absent] = [0, 1, 2].map(|index| &first.curves[index].shown);
    assert!(speed.points.is_empty());
    assert!(speed.problem.as_ref().unwrap().contains("over time"), "{:?}", speed.problem);
    assert_eq!((array.points.len(), &array.problem), (96 * 64 * 3, &None));
    assert_eq!(absent.problem.as_deref(), Some("there is no buffer /nothing/here"));
    // The same message is read once.
    assert!(drawn(&context, &frame, &graph).curves[1].shown.points.same(&array.points));
    graph.against = Some("/vehicle/state.yaw_rate_rps".to_owned());
    let against = drawn(&context, &frame, &graph);
    assert_eq!((against.kind, &against.curves[0].shown.problem), (GraphKind::Against, &None));
    let problem = against.curves[1].shown.problem.as_ref().unwrap();
    assert!(problem.contains("over its index"), "{problem}");
}

#[test]
fn an_array_of_a_message_that_is_too_large_says_so_and_displaces_no_curve_over_time() {
    let mut frame = frame();
    // Zeros that nothing reads take no memory.
    let image = RawImage { data: vec![0_u8; MOST_BYTES + 1].into(), ..RawImage::default() };
    let large = samples::topic("/large/image", 5.0, 0.1, image);
    frame.topics = frame.topics.iter().cloned().chain([large]).collect();
    let refused = FieldSeries {
        field: FieldRef { topic: "/large/image".to_owned(), path: ".data".parse().unwrap() },
        points: Series::default(),
        problem: Some("got bytes, expected a number: .data".into()),
        ..frame.fields[0].clone()
    };
    frame.fields = frame.fields.iter().cloned().chain([refused]).collect();
    let graph = plot(&[&["/vehicle/state.speed_mps", "/large/image.data"]]).saved.graphs.remove(0);
    let drawn = drawn(&egui::Context::default(), &frame, &graph);
    let [speed, array] = [0, 1].map(|index| &drawn.curves[index].shown);
    assert_eq!((drawn.kind, speed.points.is_empty(), &speed.problem), (GraphKind::Time, false, &None));
    let problem = array.problem.as_ref().unwrap();
    assert!(problem.contains("larger than 64 MiB"), "{problem}");
}

#[test]
fn marks_find_room_beside_the_graph_and_those_that_are_shortened_are_said_whole() {
    let context = egui::Context::default();
    let plot = Rect::from_min_size(Pos2::new(100.0, 100.0), egui::Vec2::new(300.0, 200.0));
    let (mut width, mut whole) = (0.0, Vec::new());
    let draw = |ui: &mut Ui| {
        let text = "0".repeat(axis::MOST_CHARACTERS);
        let font = egui::FontId::monospace(paint::MARK);
        width = ui.painter().layout_no_wrap(text, font, Color32::WHITE).size().x;
        let says = |from: f64, to: f64, at_right: bool| {
            let axis = axis::Axis::vertical(from, to, plot.y_range());
            paint::vertical_axis(ui.painter(), plot, &axis, at_right, tokens(ui))
        };
        whole = [false, true].map(|at_right| says(1.7e9, 1.7e9 + 60.0, at_right)).to_vec();
        whole.push(says(0.0, 1.0, false));
    };
    context.run_ui(egui::RawInput::default(), draw).textures_delta.clear();
    // Beside the lines of the marks, which are 4 points long.
    assert!(width <= GUTTER - 5.0, "{width}");
    let said = Some("1700000060\n1700000040\n1700000020\n1700000000".to_owned());
    assert_eq!(whole, [said.clone(), said, None]);
}

#[test]
fn a_click_goes_to_its_time_and_scrolling_zooms_about_the_pointer() {
    let mut harness = harness(plot(&[&["/vehicle/state.speed_mps"]]), egui::Vec2::new(600.0, 300.0));
    harness.run();
    let place = harness.state().view.places[0];
    let middle = place.center();
    let click = |harness: &mut Harness<'static, Shown>, pressed| {
        harness.event(egui::Event::PointerButton {
            pos: middle,
            button: egui::PointerButton::Primary,
            pressed,
            modifiers: egui::Modifiers::NONE,
        });
        harness.step();
    };
    harness.event(egui::Event::PointerMoved(middle));
    harness.step();
    click(&mut harness, true);
    click(&mut harness, false);
    let start = harness.state().frame.info.start;
    let sought = harness.state().controls.iter().find_map(|control| match control {
        Control::Seek(to) => Some(to.seconds_since(start)),
        _ => None,
    });
    // All of 12.5 s and a margin are visible.
    assert!((sought.unwrap() - 6.3).abs() < 0.1, "{sought:?}");
    harness.event(egui::Event::MouseWheel {
        unit: egui::MouseWheelUnit::Point,
        delta: egui::Vec2::new(0.0, 120.0),
        phase: egui::TouchPhase::Move,
        source: egui::MouseWheelSource::Unknown,
        modifiers: egui::Modifiers::NONE,
    });
    harness.run();
    let Span::Fixed(from, to) = harness.state().view.saved.span else { panic!("not zoomed") };
    assert!(to - from < 11.0 && (f64::midpoint(from, to) - 6.3).abs() < 0.2, "{from} {to}");
    harness.get_by_label("Fit to graph").click();
    harness.run();
    assert_eq!(harness.state().view.saved.span, Span::All);
}

#[test]
fn the_visible_values_are_saved_as_text() {
    let mut harness = harness(several(), egui::Vec2::new(720.0, 480.0));
    harness.state_mut().view.saved.span = Span::Fixed(0.9, 1.25);
    // The cursors are elsewhere.
    harness.state_mut().view.cursors = Some((4.0, 6.0));
    harness.run();
    harness.get_by_label("Save the values as text (CSV)").click();
    harness.run();
    let wishes = &harness.state().wishes;
    let Some(Wish::SaveFile { content, .. }) = wishes.first() else { panic!("{wishes:?}") };
    let text = String::from_utf8(content.to_vec()).unwrap();
    let mut lines = text.lines();
    assert!(lines.next().unwrap().starts_with("time_s,time_ns,/vehicle/state.speed_mps,\"smooth("));
    assert_eq!(text.lines().filter(|line| line.contains("EXEC")).count(), 2);
    assert_eq!(text.lines().count(), 1 + 176);
}

#[test]
fn a_dropped_field_is_a_curve_of_the_graph_below_it_or_a_graph_of_its_own() {
    let mut view = plot(&[&["/a.x"]]);
    view.places = vec![Rect::from_min_max(Pos2::ZERO, Pos2::new(100.0, 100.0))];
    let field = FieldKey { topic: TopicKey::shown("/b"), path: "y[2]".parse().unwrap() };
    view.drop_field(&field, Pos2::new(50.0, 20.0));
    view.drop_field(&field, Pos2::new(50.0, 90.0));
    let formulas: Vec<Vec<&str>> =
        view.saved.graphs.iter().map(|g| g.curves.iter().map(|c| c.formula.as_str()).collect()).collect();
    assert_eq!(formulas, [vec!["/a.x", "/b.y[2]"], vec!["/b.y[2]"]]);
    // What a layout stores has all of it.
    let mut again = Plot::default();
    again.load(&view.save()).unwrap();
    assert_eq!(again.saved, view.saved);
}

#[test]
fn a_formula_that_is_wrong_or_a_field_that_is_absent_says_so() {
    let mut harness = harness(
        plot(&[&["smooth(", "/nothing/here.x", "/planner/status.cycle"]]),
        egui::Vec2::new(600.0, 300.0),
    );
    harness.run();
    for name in ["smooth(", "/nothing/here.x", "/planner/status.cycle"] {
        harness.get_by_label(&format!("Curve {name}"));
    }
}

#[test]
fn a_curve_of_a_run_that_is_not_there_says_so_and_shows_no_other() {
    let field = "/vehicle/state.speed_mps";
    let shown = |frame: &Frame, run: RunChoice| {
        let shown = Shelf::default().shown(&egui::Context::default(), frame, field, run);
        (shown.points.is_empty(), shown.problem.as_deref().map(str::to_owned))
    };
    let says = |text: &str| (true, Some(text.to_owned()));
    // A stack with one run and without a recording.
    let mut frame = frame();
    frame.topics = frame.topics.iter().filter(|topic| !topic.run.is_recorded()).cloned().collect();
    let only = rcs_runtime::RunSummary {
        id: rcs_runtime::RunId(0),
        branched_from: None,
        end: frame.now,
        events: 0,
        writes: 0,
    };
    frame.runs.all = Arc::new([only]);
    assert_eq!(shown(&frame, RunChoice::Run(0)), (false, None));
    assert_eq!(shown(&frame, RunChoice::Run(1)), says("there is no run 1"));
    assert_eq!(shown(&frame, RunChoice::Recorded), says("there is no recorded topic /vehicle/state"));
    // A recording.
    let recorded = frame.fields.iter().map(|one| FieldSeries { run: RunTag::Recorded, ..one.clone() });
    frame.fields = recorded.collect();
    frame.runs = rcs_runtime::source::Runs::default();
    for run in [RunChoice::Shown, RunChoice::Recorded] {
        assert_eq!(shown(&frame, run), (false, None), "{run:?}");
    }
    assert_eq!(shown(&frame, RunChoice::Run(0)), says("there is no run 0"));
}

#[test]
fn tab_completes_a_formula_and_what_is_typed_next_follows() {
    let mut harness = harness(plot(&[]), egui::Vec2::new(600.0, 300.0));
    harness.run();
    harness.get_by_label("Add a curve").click();
    harness.run();
    let line = |harness: &Harness<'_, Shown>| harness.get_by_label("Formula").value().unwrap_or_default();
    harness.get_by_label("Formula").type_text("1 + ");
    harness.run();
    harness.key_press(egui::Key::Enter);
    harness.run();
    assert!(harness.get_by_label("Formula").is_focused(), "it is no formula yet");
    harness.get_by_label("Formula").type_text("smo");
    harness.run();
    harness.key_press(egui::Key::Tab);
    harness.run();
    assert_eq!(line(&harness), "1 + smooth(");
    harness.get_by_label("Formula").type_text("/planner/status.cyc");
    harness.run();
    harness.key_press(egui::Key::Tab);
    harness.run();
    harness.get_by_label("Formula").type_text(", 2)");
    harness.run();
    assert_eq!(line(&harness), "1 + smooth(/planner/status.cycle, 2)");
    harness.key_press(egui::Key::Enter);
    harness.run();
    assert_eq!(harness.state().view.fields().len(), 1);
}

#[test]
fn a_formula_that_is_being_written_is_kept_in_the_layout_and_takes_no_focus_when_it_comes_back() {
    let mut harness = harness(plot(&[&["/planner/status.cycle"]]), egui::Vec2::new(600.0, 300.0));
    harness.run();
    harness.get_by_label("Add a curve").click();
    harness.run();
    harness.get_by_label("Formula").type_text("smooth(/pla");
    harness.run();
    let mut kept = harness.state().view.save();
    let mut again = Plot::default();
    again.load(&kept).unwrap();
    assert_eq!(again.save(), kept);
    let mut harness = self::harness(again, egui::Vec2::new(600.0, 300.0));
    harness.run();
    let line = harness.get_by_label("Formula");
    assert_eq!(line.value().as_deref(), Some("smooth(/pla"));
    assert!(!line.accesskit_node().is_focused());
    // Older layouts have none.
    kept.as_object_mut().unwrap().remove("entry");
    let mut older = Plot::default();
    older.load(&kept).unwrap();
    assert_eq!((older.saved.graphs.len(), older.saved.entry), (1, None));
}

#[test]
fn a_problem_for_which_the_legend_has_no_room_is_shown_in_full_under_the_pointer() {
    let mut harness = harness(plot(&[&["/nothing/here.speed_mps"]]), egui::Vec2::new(260.0, 220.0));
    harness.run();
    let whole = ": there is no buffer /nothing/here";
    assert_eq!(harness.query_all_by_label_contains(whole).count(), 0);
    let place = harness.get_by_label("Curve /nothing/here.speed_mps").rect();
    harness.hover_at(place.center());
    harness.run_steps(8);
    assert_ne!(harness.query_all_by_label_contains(whole).count(), 0);
}

#[test]
fn under_the_pointer_the_legend_has_the_value_of_a_curve_and_why_not_all_values_are_there() {
    let mut harness = harness(plot(&[&["/vehicle/state.speed_mps"]]), egui::Vec2::new(600.0, 300.0));
    let frame = &mut harness.state_mut().frame;
    let lost = |one: &FieldSeries| FieldSeries { problem: Some("2 messages are lost".into()), ..one.clone() };
    frame.fields = frame.fields.iter().map(lost).collect();
    harness.run();
    let whole = "; 2 messages are lost";
    assert_eq!(harness.query_all_by_label_contains(whole).count(), 0);
    let place = harness.get_by_label("Curve /vehicle/state.speed_mps").rect();
    harness.hover_at(place.center());
    harness.run_steps(8);
    assert_ne!(harness.query_all_by_label_contains(whole).count(), 0);
}

#[test]
fn the_legend_of_many_curves_takes_half_of_the_graph_and_a_button_lists_them_all() {
    let formulas: Vec<String> =
        (0..10).map(|offset| format!("/vehicle/state.speed_mps + {offset}")).collect();
    let formulas: Vec<&str> = formulas.iter().map(String::as_str).collect();
    let mut harness = harness(plot(&[&formulas]), egui::Vec2::new(600.0, 220.0));
    harness.run();
    let graph = harness.state().view.places[0];
    let rows = harness.query_all_by_label_contains("Curve /").count();
    let label = format!("{} more", 10 - rows);
    let more = harness.get_by_label(&label);
    assert!(rows > 0 && more.rect().bottom() <= graph.center().y, "{rows} {} {graph}", more.rect());
    more.click();
    harness.run_steps(8);
    harness.get_by_label_contains("/vehicle/state.speed_mps + 8: ");
    // Others may lie below the end of the list that is visible in so low a window.
    harness.get_by_label("Remove /vehicle/state.speed_mps + 0").click();
    harness.run_steps(8);
    let left: Vec<&str> = harness.state().view.saved.formulas().collect();
    assert_eq!(left, formulas[1..]);
}

#[test]
fn the_line_changes_the_curve_for_which_it_was_opened_although_one_before_it_is_removed() {
    let mut view = plot(&[&["/vehicle/state.speed_mps", "/planner/status.state", "/planner/status.cycle"]]);
    view.saved.entry = Some(Entry::new("/planner/status.state".to_owned(), Some((0, 1))));
    let mut harness = harness(view, egui::Vec2::new(600.0, 300.0));
    harness.run();
    harness.get_by_label("Formula").type_text(" * 2");
    harness.run();
    harness.state_mut().view.saved.graphs[0].curves.remove(0);
    harness.run();
    harness.get_by_label("Change").click();
    harness.run();
    let formulas: Vec<&str> = harness.state().view.saved.formulas().collect();
    assert_eq!(formulas, ["/planner/status.state * 2", "/planner/status.cycle"]);
}
