//! Runs [`Window`] in eframe, and selects the renderer.

use super::body::{Options, Window};
use super::notices::Matter;
use crate::asked;
use crate::cli::{Renderer, WindowArgs};
use crate::kept_layouts;
use crate::layout::data_dir;
use crate::offscreen::{Adapters, adapters};
use crate::open::Request;
use anyhow::anyhow;
use std::time::Instant;

/// Opens the window; returns when it is closed.
pub fn run(args: &WindowArgs) -> anyhow::Result<()> {
    let started = Instant::now();
    let args = asked::sorted(args)?;
    args.check()?;
    let data_dir = data_dir();
    let named = |spec| kept_layouts::as_arranged(spec, data_dir.as_deref());
    let (layout, problem) = args.layout.as_deref().map(named).transpose()?.unzip();
    let request = Request::of(&args);
    asked::check(&request)?;
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
            if let Some(problem) = problem.flatten() {
                window.notices.error(Matter::Layout, problem);
            }
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
