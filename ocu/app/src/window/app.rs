//! Runs [`Window`] in eframe, and selects the renderer.

use super::body::{Options, Window};
use crate::asked;
use crate::cli::{Renderer, WindowArgs};
use crate::kept_layouts;
use crate::layout::data_dir;
use crate::offscreen::{Adapters, adapters};
use crate::open::Request;
use anyhow::anyhow;
use rcs_runtime::remove_abandoned_pasts;
use std::io;
use std::path::PathBuf;
use std::thread::{self, JoinHandle};
use std::time::Instant;

/// Opens the window; returns when it is closed.
pub fn run(args: &WindowArgs) -> anyhow::Result<()> {
    let started = Instant::now();
    let args = asked::sorted(args)?;
    args.check()?;
    let data_dir = data_dir();
    let named = |spec| kept_layouts::named(spec, data_dir.as_deref());
    let layout = args.layout.as_deref().map(named).transpose()?;
    let request = Request::of(&args);
    asked::check(&request)?;
    if let Err(error) = remove_abandoned(args.past.options().folder) {
        tracing::warn!("no thread to remove the pasts of programs that were killed: {error}");
    }
    let options = Options { request, layout, data_dir };
    let adapters = adapters();
    // Software Vulkan draws a full window five times more slowly than software OpenGL.
    let fitting = if adapters == Adapters::Hardware { Renderer::Wgpu } else { Renderer::Glow };
    let renderer = args.renderer.unwrap_or(fitting);
    tracing::debug!("drawing with {renderer:?}; graphics adapters: {adapters:?}");
    let native = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("OCU")
            .with_app_id("ocu")
            .with_inner_size([1600.0, 900.0])
            .with_min_inner_size([640.0, 400.0])
            .with_drag_and_drop(true),
        renderer: match renderer {
            Renderer::Wgpu => eframe::Renderer::Wgpu,
            Renderer::Glow => eframe::Renderer::Glow,
        },
        // It costs a software driver time for each pixel, and plain areas gain nothing by it.
        dithering: adapters != Adapters::Software,
        ..eframe::NativeOptions::default()
    };
    eframe::run_native(
        "ocu",
        native,
        Box::new(move |creation| {
            ocu_ui::install(&creation.egui_ctx);
            ocu_views::prepare::start(&creation.egui_ctx)?;
            let mut window = Window::new(&creation.egui_ctx, options);
            if adapters == Adapters::Software {
                window.draws_in_software();
            }
            Ok(Box::new(App { window, started, is_shown: false }))
        }),
    )
    .map_err(|error| {
        anyhow!(
            "the window cannot be opened: {error}; it needs a display and the packages libxkbcommon-x11-0 libegl1 \
             libgl1 libx11-xcb1 libxcursor1 libxi6 (ocu render and ocu run need none)"
        )
    })
}

/// Removes the pasts that killed programs have left in a folder, on a thread of its own, because they can be gigabytes.
fn remove_abandoned(folder: PathBuf) -> io::Result<JoinHandle<()>> {
    let remove = move || {
        let removed = remove_abandoned_pasts(&folder);
        if removed > 0 {
            tracing::info!("removed the past of {removed} programs that were killed");
        }
    };
    thread::Builder::new().name("abandoned".to_owned()).spawn(remove)
}

struct App {
    window: Window,
    started: Instant,
    is_shown: bool,
}

impl eframe::App for App {
    fn logic(&mut self, ctx: &egui::Context, _frame: &mut eframe::Frame) {
        self.window.logic(ctx);
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        self.window.ui(ui);
        if !self.is_shown && self.window.frame().is_some() {
            self.is_shown = true;
            tracing::info!("first picture of the source after {:.3} s", self.started.elapsed().as_secs_f64());
        }
    }

    fn on_exit(&mut self, _gl: Option<&eframe::glow::Context>) {
        self.window.keep_layout();
    }

    fn clear_color(&self, visuals: &egui::Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_killed_program_has_left_of_its_past_is_removed_at_the_start() {
        let root = tempfile::tempdir().unwrap();
        let (past, lock) = (root.path().join("1-0"), root.path().join("1-0.lock"));
        std::fs::create_dir(&past).unwrap();
        std::fs::write(past.join("0.past"), b"dead").unwrap();
        std::fs::write(&lock, b"").unwrap();
        remove_abandoned(root.path().to_owned()).unwrap().join().unwrap();
        assert!(!past.exists() && !lock.exists());
    }
}
