//! One frame of the window without a window, and its times.

use ocu_app::window::Window;
use std::time::{Duration, Instant};

/// Times of one frame: the interface, and the conversion of its shapes to triangles.
pub(crate) struct Times {
    pub(crate) interface: Duration,
    pub(crate) triangles: Duration,
    /// Time until it wants to be painted again.
    pub(crate) rest: Duration,
    /// Part of the time of the interface in which it was ready while the processors did other work, where the system
    /// tells it.
    pub(crate) waited: Option<Duration>,
    /// Pixels of the textures that were made or changed.
    pub(crate) pixels: usize,
}

/// The time that this thread was ready but did not run, since it began.
fn waited() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split_whitespace().nth(1)?.parse().ok().map(Duration::from_nanos)
}

/// Paints one frame; what the pointer and the keys did is in `events`.
pub(crate) fn pass(context: &egui::Context, window: &mut Window, events: Vec<egui::Event>) -> Times {
    let screen = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(1600.0, 900.0));
    let input = egui::RawInput { screen_rect: Some(screen), events, ..egui::RawInput::default() };
    let before = waited();
    let began = Instant::now();
    let mut output = context.run_ui(input, |ui| window.ui(ui));
    let interface = began.elapsed();
    let waited = before.zip(waited()).map(|(before, after)| after.saturating_sub(before).min(interface));
    let changed = output.textures_delta.set.values().flatten();
    let pixels = changed.map(|delta| delta.image.width() * delta.image.height()).sum();
    // Nobody draws: the textures are let go.
    output.textures_delta.set.drain().for_each(drop);
    output.textures_delta.free.drain().for_each(drop);
    let rest = output.viewport_output.get(&egui::ViewportId::ROOT).map(|viewport| viewport.repaint_delay);
    let began = Instant::now();
    let triangles = context.tessellate(output.shapes, output.pixels_per_point);
    drop(triangles);
    Times { interface, triangles: began.elapsed(), rest: rest.unwrap_or(Duration::MAX), waited, pixels }
}

/// Median, 95 % and greatest value.
pub(crate) fn summary(values: &mut [f64]) -> String {
    values.sort_by(f64::total_cmp);
    let at = |part: f64| values[((values.len() - 1) as f64 * part) as usize];
    format!("median {:.2} ms, 95 % {:.2} ms, most {:.2} ms", at(0.5), at(0.95), at(1.0))
}

/// What the slowest twentieth of the frames spent their time on, and the others.
pub(crate) fn peaks(frames: &[Times]) -> String {
    let mut order: Vec<&Times> = frames.iter().collect();
    order.sort_by_key(|times| times.interface);
    let (usual, peaks) = order.split_at(order.len() * 19 / 20);
    let told = |frames: &[&Times]| {
        let mean = |of: &dyn Fn(&Times) -> f64| {
            frames.iter().map(|times| of(times)).sum::<f64>() / frames.len().max(1) as f64
        };
        format!(
            "{:.2} ms, of which {:.2} ms waiting for a processor; {:.0} kilopixels of new textures",
            mean(&|times| times.interface.as_secs_f64() * 1e3),
            mean(&|times| times.waited.map_or(f64::NAN, |waited| waited.as_secs_f64() * 1e3)),
            mean(&|times| times.pixels as f64 * 1e-3),
        )
    };
    format!("slowest twentieth: {}\n  other frames:      {}", told(peaks), told(usual))
}
