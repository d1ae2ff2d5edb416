//! `ocu render`: draws a layout at a given time as an image, or over a range of time as an animation, without a window or
//! a display.

use crate::cli::{RenderArgs, Size};
use crate::kept_layouts;
use crate::layout::{Layout, data_dir};
use crate::layout_fit::{comparing, fitting};
use crate::offscreen::Painter;
use crate::open::Request;
use crate::output::{self, Files};
use crate::window::Window;
use crate::{Ended, parts, stacks, usage};
use anyhow::Context as _;
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, ImageFormat, RgbaImage};
use rcs_log::Log;
use rcs_runtime::RunId;
use rcs_runtime::source::{Compared, Frame, Source, Task};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Maximum number of passes: most views settle in a few.
const MOST_PASSES: usize = 40;
/// Minimum number of passes: sizes are known from the second one on.
const LEAST_PASSES: usize = 3;
/// Maximum number of pictures of an animation.
const MOST_PICTURES: usize = 1000;
/// Maximum time that a picture of an animation is shown, s: a GIF has 16 bits for it, in hundredths of a second.
const MOST_SHOWN_S: f64 = 655.35;
/// Of 1 to 30: how fast, and how coarsely, the colours of an animation are chosen.
const GIF_SPEED: i32 = 10;

/// Renders the image or the animation, and writes it.
pub fn render(args: &RenderArgs) -> anyhow::Result<Ended> {
    check_animation(args)?;
    if args.course.is_some() && args.stack.is_none() {
        tracing::warn!("a recording uses nothing of --course; expected --stack with it, or no course");
    }
    let mut files = Files::new(args.force);
    let texts = [&args.stack, &args.course].into_iter().flatten().map(Path::new);
    let layout = args.layout.as_deref();
    for path in args.log.iter().chain(&args.against) {
        files.reads_log("the recording that is read", path);
    }
    for path in texts.chain(layout.map(Path::new)) {
        files.reads("a file that is read", path);
    }
    files.writes("--output", &args.output)?;
    if args.to.is_none() && !parts::has_ending(&args.output, "png") {
        let path = args.output.display();
        return Err(usage(format!("--output is {path}; expected a .png file, or a .gif file with --to")));
    }
    let mut layout = layout.map(|spec| kept_layouts::named(spec, data_dir().as_deref())).transpose()?;
    if args.against.is_some() && !layout.get_or_insert_with(comparing).has_view("compare") {
        return Err(usage("--against is for the view Compare; expected a layout with it, or none"));
    }
    let request = Request {
        log: args.log.clone(),
        stack: args.stack.clone(),
        course: args.course.clone(),
        seed: args.seed,
        ..Request::default()
    };
    let fields = layout.as_ref().map(Layout::fields).unwrap_or_default();
    let log = stacks::log_of(&request)?;
    let mut source = open_with(&request, log.as_ref(), &fields, args.against.as_deref())?;
    let times = times(args, length_s(&*source))?;
    let theme = if args.light { egui::Theme::Light } else { egui::Theme::Dark };
    let mut picture = |at_s: f64| {
        let frame = Arc::new(seek(&mut *source, at_s)?);
        // Without a layout, the one that the window would open.
        let layout = layout.get_or_insert_with(|| fitting(&frame));
        picture(&request, &frame, layout, args.size, theme)
    };
    let mut file = std::io::Cursor::new(Vec::new());
    match times.as_slice() {
        [at_s] if args.to.is_none() => {
            picture(*at_s)?.write_to(&mut file, ImageFormat::Png).context("cannot compress the picture")?;
        }
        _ => {
            let mut animation = GifEncoder::new_with_speed(&mut file, GIF_SPEED);
            animation.set_repeat(Repeat::Infinite)?;
            let delay = Delay::from_saturating_duration(Duration::from_secs_f64(args.every / args.speed));
            for at_s in times {
                let picture = image::Frame::from_parts(picture(at_s)?, 0, 0, delay);
                animation.encode_frame(picture).context("cannot compress the animation")?;
            }
        }
    }
    output::write(&args.output, file.get_ref(), args.force)?;
    Ok(Ended::after(log.as_ref()))
}

/// Refuses wrong options of an animation, before anything is opened.
fn check_animation(args: &RenderArgs) -> anyhow::Result<()> {
    let Some(to_s) = args.to else { return Ok(()) };
    if !parts::has_ending(&args.output, "gif") {
        return Err(usage(format!("--output is {}; expected a .gif file with --to", args.output.display())));
    }
    if to_s < args.at {
        return Err(usage(format!("--to is {to_s} s; expected at least --at, {} s", args.at)));
    }
    if args.every <= 0.0 || args.speed <= 0.0 {
        return Err(usage("--every and --speed: expected more than 0".to_owned()));
    }
    let shown_s = args.every / args.speed;
    if shown_s > MOST_SHOWN_S {
        return Err(usage(format!(
            "--every {} s with --speed {} shows each picture for {shown_s} s; expected at most {MOST_SHOWN_S} s",
            args.every, args.speed
        )));
    }
    Ok(())
}

/// The times to draw, in seconds from the start of a source of this length: one, or those of an animation, which ends with
/// the source at the latest.
fn times(args: &RenderArgs, length_s: Option<f64>) -> anyhow::Result<Vec<f64>> {
    let length_s = length_s.unwrap_or(f64::INFINITY);
    if args.at > length_s {
        return Err(usage(format!("--at is {} s; expected at most {length_s:.3} s, where it ends", args.at)));
    }
    let Some(to_s) = args.to else { return Ok(vec![args.at]) };
    // It may be larger than any integer.
    let count = ((to_s.min(length_s) - args.at) / args.every + 1e-9).floor() + 1.0;
    if count > MOST_PICTURES as f64 {
        return Err(usage(format!(
            "--every {} s gives {count} pictures; expected at most {MOST_PICTURES}",
            args.every
        )));
    }
    Ok((0..count as usize).map(|picture| args.at + picture as f64 * args.every).collect())
}

/// Time from the start of a source to its end; `None` if nothing ends it.
fn length_s(source: &dyn Source) -> Option<f64> {
    let info = source.info();
    info.end.map(|end| end.seconds_since(info.start))
}

/// The state of a source `at_s` seconds after its start, including its complete tracks.
pub fn frame_at(request: &Request, at_s: f64) -> anyhow::Result<Frame> {
    seek(&mut *open_with(request, stacks::log_of(request)?.as_ref(), &[], None)?, at_s)
}

/// A source that gathers the values of these fields over time, and is compared with another recording.
fn open_with(
    request: &Request,
    log: Option<&Log>,
    fields: &[rcs_formula::FieldRef],
    against: Option<&Path>,
) -> anyhow::Result<Box<dyn Source>> {
    let mut source = stacks::open_on(request, log)?;
    source.gather(fields, &|| false);
    if let Some(against) = against {
        let this = if request.stack.is_some() { Compared::Run(RunId(0)) } else { Compared::Recorded };
        source.against(&parts::of(against)?);
        source.compare(&[[this, Compared::Other]]);
    }
    Ok(source)
}

/// The state of a source at a time, in seconds from its start, or at its end if that is earlier, once everything that it
/// gathers is there.
fn seek(source: &mut dyn Source, at_s: f64) -> anyhow::Result<Frame> {
    let info = source.info();
    let at = info.start.after_ns((at_s * 1e9).round() as u64);
    let at = info.end.map_or(at, |end| at.min(end));
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
    let mut was_repeated = false;
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
        // After frames that were laid out more than once, egui draws a warning over the next one.
        let settled = !was_repeated && delay.is_none_or(|delay| delay > Duration::ZERO);
        was_repeated = output.platform_output.num_completed_passes > 1;
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
