//! Measures the interface: the time that a frame of the window takes on its thread, without the driver of the graphics.
//!
//! `cargo run --workspace --example interface -- STACK COURSE SECONDS`: the whole window at 1600×900 with four cameras
//! with overlays, two maps and the log, on a stack that runs; then the same, paused.

#![allow(clippy::print_stdout, reason = "it prints what it measures")]

use ocu_app::layout::Layout;
use ocu_app::open::Request;
use ocu_app::window::{Options, Window};
use std::time::{Duration, Instant};

const LAYOUT: &str = r#"Layout(version: 1, name: "measured", buffers: true, root: Row([
    (1.0, Grid([View(kind: "camera"), View(kind: "camera"), View(kind: "camera"), View(kind: "camera")])),
    (1.0, Column([
        (2.0, Row([(1.0, View(kind: "map")), (1.0, View(kind: "map"))])),
        (1.0, View(kind: "log")),
    ])),
]))"#;
/// Time between frames, as with 30 a second.
const EVERY: Duration = Duration::from_millis(33);

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let stack = args.next().unwrap_or_else(|| "lagr_stereo_only".to_owned());
    let course = args.next();
    let seconds: f64 = args.next().map(|text| text.parse()).transpose()?.unwrap_or(20.0);
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("measured.ron");
    std::fs::write(&file, LAYOUT)?;
    let request = Request { stack: Some(stack), course, ..Request::default() };
    let context = egui::Context::default();
    ocu_ui::install(&context);
    let options = Options { request, layout: Some(Layout::load(&file)?), data_dir: None };
    let mut window = Window::new(&context, options);
    // Until the first picture.
    let opened = Instant::now();
    while window.frame().is_none() {
        pass(&context, &mut window, Vec::new());
        std::thread::sleep(Duration::from_millis(5));
    }
    println!("first picture after {:.0} ms", opened.elapsed().as_secs_f64() * 1e3);
    measure("running", &context, &mut window, seconds);
    let space = |pressed| egui::Event::Key {
        key: egui::Key::Space,
        physical_key: None,
        pressed,
        repeat: false,
        modifiers: egui::Modifiers::NONE,
    };
    pass(&context, &mut window, vec![space(true), space(false)]);
    measure("paused", &context, &mut window, 3.0);
    Ok(())
}

/// Times of one frame: the interface, and the conversion of its shapes to triangles.
struct Times {
    interface: Duration,
    triangles: Duration,
    /// Time until it wants to be painted again.
    rest: Duration,
}

fn pass(context: &egui::Context, window: &mut Window, events: Vec<egui::Event>) -> Times {
    let screen = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(1600.0, 900.0));
    let input = egui::RawInput { screen_rect: Some(screen), events, ..egui::RawInput::default() };
    let began = Instant::now();
    let mut output = context.run_ui(input, |ui| window.ui(ui));
    let interface = began.elapsed();
    // Nobody draws: the textures are let go.
    output.textures_delta.set.drain().for_each(drop);
    output.textures_delta.free.drain().for_each(drop);
    let rest = output.viewport_output.get(&egui::ViewportId::ROOT).map(|viewport| viewport.repaint_delay);
    let began = Instant::now();
    let triangles = context.tessellate(output.shapes, output.pixels_per_point);
    drop(triangles);
    Times { interface, triangles: began.elapsed(), rest: rest.unwrap_or(Duration::MAX) }
}

fn measure(what: &str, context: &egui::Context, window: &mut Window, seconds: f64) {
    let (mut interface, mut triangles, mut rests) = (Vec::new(), Vec::new(), Vec::new());
    let began = Instant::now();
    while began.elapsed().as_secs_f64() < seconds {
        let start = Instant::now();
        let times = pass(context, window, Vec::new());
        interface.push(times.interface.as_secs_f64() * 1e3);
        triangles.push(times.triangles.as_secs_f64() * 1e3);
        rests.push(times.rest);
        std::thread::sleep(EVERY.saturating_sub(start.elapsed()));
    }
    let at = window.frame().map_or(0.0, |frame| frame.time_s());
    let lag = window.frame().map_or(0.0, |frame| frame.playback.lag_s);
    let quiet = rests.iter().rev().take_while(|rest| **rest > Duration::from_secs(1)).count();
    println!(
        "{what}: {} frames up to {at:.1} s of the run, {lag:.1} s behind; interface {}; triangles {}; the last {quiet} \
         frames asked for no other one",
        interface.len(),
        summary(&mut interface),
        summary(&mut triangles),
    );
}

/// Median, 95 % and greatest value.
fn summary(values: &mut [f64]) -> String {
    values.sort_by(f64::total_cmp);
    let at = |part: f64| values[((values.len() - 1) as f64 * part) as usize];
    format!("median {:.2} ms, 95 % {:.2} ms, most {:.2} ms", at(0.5), at(0.95), at(1.0))
}
