//! Four plots of a log: opening them, moving them along the time, and zooming.

use super::pass::{pass, summary};
use anyhow::Context as _;
use egui::{Event, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, TouchPhase};
use ocu_app::open::Request;
use ocu_app::window::Window;
use std::time::{Duration, Instant};

/// Frames in which the plots are moved.
const MOVED: usize = 300;
/// Points of the screen by which they move in a frame.
const STEP: f32 = 6.0;
/// Within the view, or the first of them.
const START: Pos2 = Pos2::new(300.0, 160.0);

/// The arguments are the log and the fields.
pub(crate) fn measure(arguments: &[String]) -> anyhow::Result<()> {
    let (log, fields) = arguments.split_first().context("expected a log and its fields")?;
    let graph = |field: &String| format!("{{\"curves\": [{{\"formula\": \"{field}\"}}]}}");
    let graphs: Vec<String> = fields.iter().map(graph).collect();
    let plot = |graphs: &str, span: &str| {
        format!("View(kind: \"plot\", state: {{\"span\": {span}, \"graphs\": [{graphs}]}})")
    };
    for (span, what) in [("\"all\"", "everything"), ("{\"fixed\": [300.0, 400.0]}", "a tenth")] {
        let one = plot(&graphs.join(", "), span);
        let each: Vec<String> = graphs.iter().map(|graph| plot(graph, span)).collect();
        let each = format!("Grid([{}])", each.join(", "));
        for (root, how) in [(one, "graphs of one view"), (each, "views")] {
            let context = egui::Context::default();
            let request = Request { log: Some(log.into()), ..Request::default() };
            let layout = format!("Layout(version: 1, name: \"measured\", buffers: false, root: {root})");
            let opened = Instant::now();
            let mut window = super::window(&context, request, &layout)?;
            while !is_read(&window, fields.len()) {
                anyhow::ensure!(opened.elapsed() < Duration::from_mins(1), "the fields are not read");
                pass(&context, &mut window, Vec::new());
                std::thread::sleep(Duration::from_millis(2));
            }
            let read = opened.elapsed().as_secs_f64();
            // The log's other contents are read at the same time: what follows is measured at rest.
            std::thread::sleep(Duration::from_secs(1));
            let (mut interface, mut triangles) = moved(&context, &mut window);
            println!(
                "{} {how}, {what}: read {read:.2} s after opening; moved: interface {}; triangles {}; zoomed: \
                 interface {}",
                fields.len(),
                summary(&mut interface),
                summary(&mut triangles),
                summary(&mut zoomed(&context, &mut window)),
            );
        }
    }
    Ok(())
}

/// Whether all fields have been read.
fn is_read(window: &Window, count: usize) -> bool {
    window.frame().is_some_and(|frame| {
        let complete =
            |field: &&rcs_runtime::source::FieldSeries| field.reading.is_none() && !field.points.is_empty();
        frame.fields.iter().filter(complete).count() == count
    })
}

/// Drags what is at the start to and fro; the times of the frames, ms.
pub(crate) fn moved(context: &egui::Context, window: &mut Window) -> (Vec<f64>, Vec<f64>) {
    let button = |pos, pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    let mut at = START;
    pass(context, window, vec![Event::PointerMoved(at)]);
    pass(context, window, vec![button(at, true)]);
    let (mut interface, mut triangles) = (Vec::new(), Vec::new());
    for index in 0..MOVED {
        at.x += if index / 50 % 2 == 0 { STEP } else { -STEP };
        let times = pass(context, window, vec![Event::PointerMoved(at)]);
        interface.push(times.interface.as_secs_f64() * 1e3);
        triangles.push(times.triangles.as_secs_f64() * 1e3);
        std::thread::sleep(Duration::from_millis(8));
    }
    pass(context, window, vec![button(at, false)]);
    (interface, triangles)
}

/// Zooms in and out; the times of the frames in which the zoom changed, ms.
pub(crate) fn zoomed(context: &egui::Context, window: &mut Window) -> Vec<f64> {
    let wheel = |y: f32| Event::MouseWheel {
        unit: MouseWheelUnit::Point,
        delta: egui::vec2(0.0, y),
        phase: TouchPhase::Move,
        source: MouseWheelSource::Unknown,
        modifiers: Modifiers::NONE,
    };
    pass(context, window, vec![Event::PointerMoved(START)]);
    let frames = (0..MOVED).map(|index| {
        let times = pass(context, window, vec![wheel(if index / 20 % 2 == 0 { 12.0 } else { -12.0 })]);
        std::thread::sleep(Duration::from_millis(8));
        times.interface.as_secs_f64() * 1e3
    });
    frames.collect()
}
