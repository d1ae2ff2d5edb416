//! One frame of the window without a window, and its times.

use ocu_app::window::Window;
use std::time::{Duration, Instant};

/// Times of one frame: the interface, and the conversion of its shapes to triangles.
pub(crate) struct Times {
    pub(crate) interface: Duration,
    pub(crate) triangles: Duration,
    /// Time until it wants to be painted again.
    pub(crate) rest: Duration,
}

/// Paints one frame; what the pointer and the keys did is in `events`.
pub(crate) fn pass(context: &egui::Context, window: &mut Window, events: Vec<egui::Event>) -> Times {
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

/// Median, 95 % and greatest value.
pub(crate) fn summary(values: &mut [f64]) -> String {
    values.sort_by(f64::total_cmp);
    let at = |part: f64| values[((values.len() - 1) as f64 * part) as usize];
    format!("median {:.2} ms, 95 % {:.2} ms, most {:.2} ms", at(0.5), at(0.95), at(1.0))
}
