//! Measures the interface: the time that a frame of the window takes on its thread, without the driver of the graphics.
//!
//! Built by `cargo build --workspace --example interface`; with the arguments
//!
//! - `STACK COURSE SECONDS [AFTER]`: the whole window at 1600×900 with four cameras with overlays, two maps and the log,
//!   on a stack that runs; then the same, paused. With `AFTER`, once more after so many seconds of the run, through which
//!   it is stepped.
//! - `large`: a map, an image and a cloud as large as they come, opened, moved, zoomed and played.
//! - `plots LOG FIELD FIELD FIELD FIELD`: opening four plots of a log, and moving them along the time. The example
//!   `recordings` of `rcs-log` writes such logs.
//! - `hierarchy SECONDS`: the view Hierarchy with 40 processes at 50 Hz, and an empty view for comparison.

#![allow(clippy::print_stdout, reason = "it prints what it measures")]

mod hierarchy;
mod large;
mod pass;
mod plots;

use ocu_app::layout::Layout;
use ocu_app::open::Request;
use ocu_app::window::{Options, Window};
use ocu_views::TopicKey;
use pass::{pass, peaks, summary};
use std::time::{Duration, Instant};

const LAYOUT: &str = r#"Layout(version: 1, name: "measured", buffers: true, root: Row([
    (1.0, Grid([CAMERAS])),
    (1.0, Column([
        (2.0, Row([(1.0, View(kind: "map")), (1.0, View(kind: "map"))])),
        (1.0, View(kind: "log")),
    ])),
]))"#;
/// Time between frames, as with 30 a second.
const EVERY: Duration = Duration::from_millis(33);
/// The longest time until a run begins.
const PATIENCE: Duration = Duration::from_secs(20);

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.first().map(String::as_str) {
        Some("large") => large::measure(),
        Some("plots") => plots::measure(&arguments[1..]),
        Some("hierarchy") => hierarchy::measure(&arguments[1..]),
        _ => whole(arguments.into_iter()),
    }
}

/// The window with this request and layout.
fn window(context: &egui::Context, request: Request, layout: &str) -> anyhow::Result<Window> {
    ocu_ui::install(context);
    ocu_views::prepare::start(context)?;
    let layout = Some(Layout::parse("measured", layout)?);
    Ok(Window::new(context, Options { request, layout, data_dir: None }))
}

fn whole(mut args: impl Iterator<Item = String>) -> anyhow::Result<()> {
    let stack = args.next().unwrap_or_else(|| "lagr_stereo_only".to_owned());
    let course = args.next();
    let seconds: f64 = args.next().map(|text| text.parse()).transpose()?.unwrap_or(20.0);
    let after_s: Option<f64> = args.next().map(|text| text.parse()).transpose()?;
    let context = egui::Context::default();
    let request = Request { stack: Some(stack), course, ..Request::default() };
    // Four cameras; those that there are, if they are fewer.
    let cameras = ocu_views::cameras(&ocu_app::render::frame_at(&request, 0.5)?);
    let view = |camera: &TopicKey| {
        format!(r#"View(kind: "camera", state: {{"topic": {{"name": "{}"}}}})"#, camera.name)
    };
    let views: Vec<String> = cameras.iter().cycle().take(4).map(view).collect();
    println!("cameras: {}", cameras.iter().map(|camera| camera.name.as_str()).collect::<Vec<_>>().join(", "));
    let mut window = window(&context, request, &LAYOUT.replace("CAMERAS", &views.join(", ")))?;
    // Until the first picture.
    let opened = Instant::now();
    while window.frame().is_none() {
        pass(&context, &mut window, Vec::new());
        std::thread::sleep(Duration::from_millis(5));
    }
    println!("first picture after {:.0} ms", opened.elapsed().as_secs_f64() * 1e3);
    // A robot that stands before its course is sent to the goal.
    let began = Instant::now();
    while window.frame().is_some_and(|frame| !frame.playback.playing) && began.elapsed() < PATIENCE {
        pass(&context, &mut window, press(egui::Key::Space));
        std::thread::sleep(Duration::from_millis(500));
    }
    measure("running", &context, &mut window, seconds);
    pass(&context, &mut window, press(egui::Key::Space));
    measure("paused", &context, &mut window, 3.0);
    if let Some(after_s) = after_s {
        step_to(&context, &mut window, after_s);
        pass(&context, &mut window, press(egui::Key::Space));
        measure("running", &context, &mut window, seconds);
    }
    Ok(())
}

fn press(key: egui::Key) -> Vec<egui::Event> {
    let (physical_key, repeat, modifiers) = (None, false, egui::Modifiers::NONE);
    [true, false].map(|pressed| egui::Event::Key { key, physical_key, pressed, repeat, modifiers }).to_vec()
}

/// Steps through a run by seconds, as fast as it goes.
fn step_to(context: &egui::Context, window: &mut Window, to_s: f64) {
    let time_s = |window: &Window| window.frame().map_or(f64::MAX, |frame| frame.time_s());
    let began = Instant::now();
    while time_s(window) < to_s {
        let from_s = time_s(window);
        pass(context, window, press(egui::Key::Period));
        while time_s(window) < from_s + 0.5 {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    println!("stepped to {to_s:.0} s of the run in {:.0} s", began.elapsed().as_secs_f64());
}

fn measure(what: &str, context: &egui::Context, window: &mut Window, seconds: f64) {
    let (mut interface, mut computing, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    let mut frames = Vec::new();
    let began = Instant::now();
    while began.elapsed().as_secs_f64() < seconds {
        let start = Instant::now();
        let times = pass(context, window, Vec::new());
        interface.push(times.interface.as_secs_f64() * 1e3);
        computing.push(times.interface.saturating_sub(times.waited.unwrap_or_default()).as_secs_f64() * 1e3);
        triangles.push(times.triangles.as_secs_f64() * 1e3);
        frames.push(times);
        std::thread::sleep(EVERY.saturating_sub(start.elapsed()));
    }
    let at = window.frame().map_or(0.0, |frame| frame.time_s());
    let lag = window.frame().map_or(0.0, |frame| frame.playback.lag_s);
    let quiet = frames.iter().rev().take_while(|times| times.rest > Duration::from_secs(1)).count();
    println!(
        "{what}: {} frames up to {at:.1} s of the run, {lag:.1} s behind; interface {}, without waiting for \
         a processor {}; triangles {}; the last {quiet} frames asked for no other one",
        interface.len(),
        summary(&mut interface),
        summary(&mut computing),
        summary(&mut triangles),
    );
    println!("  {}", peaks(&frames));
}
