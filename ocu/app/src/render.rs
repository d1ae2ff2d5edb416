//! `ocu render`: draws a layout at a given time as an image, without a window or a display.

use crate::cli::{RenderArgs, Size};
use crate::layout::Layout;
use crate::layout_fit::fitting;
use crate::offscreen::Painter;
use crate::open::Request;
use crate::output::{self, Files};
use crate::window::Window;
use crate::{parts, usage};
use anyhow::Context as _;
use image::RgbaImage;
use rcs_runtime::RunId;
use rcs_runtime::source::{Compared, Frame, Task};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Maximum number of passes: most views settle in a few.
const MOST_PASSES: usize = 40;
/// Minimum number of passes: sizes are known from the second one on.
const LEAST_PASSES: usize = 3;

/// Renders the image and writes it.
pub fn render(args: &RenderArgs) -> anyhow::Result<()> {
    let mut files = Files::new(args.force);
    let texts = [&args.stack, &args.course].into_iter().flatten().map(std::path::Path::new);
    let layout = args.layout.as_deref();
    for path in args
        .log
        .iter()
        .chain(&args.against)
        .map(PathBuf::as_path)
        .chain(texts)
        .chain(layout.map(std::path::Path::new))
    {
        files.reads("a file that is read", path);
    }
    files.writes("--output", &args.output)?;
    let layout = layout.map(Layout::named).transpose()?;
    let request = Request {
        log: args.log.clone(),
        stack: args.stack.clone(),
        course: args.course.clone(),
        seed: args.seed,
        ..Request::default()
    };
    let fields = layout.as_ref().map(Layout::fields).unwrap_or_default();
    let frame = Arc::new(frame_with(&request, args.at, &fields, args.against.as_deref())?);
    // Without a layout, the one that the window would open.
    let layout = layout.unwrap_or_else(|| fitting(&frame));
    let theme = if args.light { egui::Theme::Light } else { egui::Theme::Dark };
    let picture = picture(&request, &frame, &layout, args.size, theme)?;
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).context("cannot compress the picture")?;
    output::write(&args.output, png.get_ref(), args.force)
}

/// The state of a source `at_s` seconds after its start, including its complete tracks.
pub fn frame_at(request: &Request, at_s: f64) -> anyhow::Result<Frame> {
    frame_with(request, at_s, &[], None)
}

/// Like [`frame_at`], with the values of these fields over time, and compared with another recording.
fn frame_with(
    request: &Request,
    at_s: f64,
    fields: &[rcs_formula::FieldRef],
    against: Option<&Path>,
) -> anyhow::Result<Frame> {
    let mut source = crate::stacks::open(request)?;
    let info = source.info();
    let at = info.start.after_ns((at_s * 1e9).round() as u64);
    if let Some(end) = info.end
        && at > end
    {
        let length_s = end.seconds_since(info.start);
        return Err(usage(format!(
            "--at is {at_s} s; expected at most {length_s:.3} s, where the recording ends"
        )));
    }
    source.gather(fields);
    if let Some(against) = against {
        let this = if request.stack.is_some() { Compared::Run(RunId(0)) } else { Compared::Recorded };
        source.against(&parts::of(against)?);
        source.compare(&[[this, Compared::Other]]);
    }
    source.seek(at, &Task::default())?;
    while source.idle() {}
    Ok(source.frame())
}

/// The whole window at one time, as on a screen.
pub fn picture(
    request: &Request,
    frame: &Arc<Frame>,
    layout: &Layout,
    size: Size,
    theme: egui::Theme,
) -> anyhow::Result<RgbaImage> {
    let mut painter = Painter::new()?;
    let context = egui::Context::default();
    ocu_ui::install(&context);
    context.set_theme(theme);
    let mut window = Window::still(&context, request, Arc::clone(frame), layout);
    let screen =
        egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(size.width as f32, size.height as f32));
    for pass in 1.. {
        let input = egui::RawInput {
            screen_rect: Some(screen),
            max_texture_side: Some(painter.max_texture_side()),
            // A simulated clock: the image must not depend on the speed of the machine.
            time: Some(pass as f64 * 0.1),
            ..egui::RawInput::default()
        };
        let mut output = context.run_ui(input, |ui| window.ui(ui));
        painter.take_textures(&mut output.textures_delta);
        let delay =
            output.viewport_output.get(&egui::ViewportId::ROOT).map(|viewport| viewport.repaint_delay);
        let settled = delay.is_none_or(|delay| delay > Duration::ZERO);
        let last = pass >= MOST_PASSES || (pass >= LEAST_PASSES && settled);
        let painted = last.then(|| {
            let primitives = context.tessellate(std::mem::take(&mut output.shapes), output.pixels_per_point);
            painter.paint(&primitives, [size.width, size.height], output.pixels_per_point)
        });
        painter.free_textures(&mut output.textures_delta);
        if let Some(pixels) = painted {
            return RgbaImage::from_raw(size.width, size.height, pixels?)
                .context("the picture has another size");
        }
    }
    anyhow::bail!("no pass was drawn")
}
