//! `ocu eval stereo`: disparities of one pair against the truth, and the time that they take.

use crate::cli::{EvalStereoArgs, StereoMethod};
use crate::eval::truth;
use crate::usage;
use anyhow::Context as _;
use rcs_geom::PinholeCamera;
use rcs_stereo::{Eye, Matcher, Method, NO_DISPARITY, Settings, StereoCamera, Strip, score};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// `ocu eval stereo --json`. Figures that need a truth are null without one.
#[derive(Debug, Serialize)]
struct Report {
    bad2_valid_pct: Option<f64>,
    bad2_dense_pct: Option<f64>,
    density_pct: f64,
    rms_px: Option<f64>,
    ms_median: f64,
    threads: usize,
}

/// Times that the pair is matched; the median of their times is reported.
const RUNS: usize = 11;

/// Prints the figures of one pair.
pub(super) fn stereo(args: &EvalStereoArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let (mut left, size) = grey(&args.left)?;
    let (mut right, right_size) = grey(&args.right)?;
    if size != right_size {
        return Err(usage(format!(
            "left image is {}x{} pixels, right image {}x{}",
            size[0], size[1], right_size[0], right_size[1]
        )));
    }
    if let Some(path) = &args.calib {
        let camera = calibration(path, size)?;
        left = camera.left().remap(&left, 1)?;
        right = camera.right().remap(&right, 1)?;
    }
    let truth = args.truth.as_deref().map(|path| truth::read(path, size)).transpose()?;

    let method = match args.method {
        StereoMethod::Bm => Method::Block,
        StereoMethod::Sgm => Method::SemiGlobal,
    };
    let settings = Settings::new(method, args.disparities);
    let mut matcher = Matcher::new(size, settings).map_err(|error| usage(error.to_string()))?;
    let (mut disparity, mut times_ms, mut threads) = (Vec::new(), Vec::new(), 1);
    for _ in 0..RUNS {
        let start = Instant::now();
        matcher.compute_in_strips(&left, &right, &mut disparity, usize::from(args.threads), |strips| {
            threads = strips.len();
            run_all(strips);
        })?;
        times_ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times_ms.sort_by(f64::total_cmp);

    let score = truth.map(|truth| score::score(&disparity, &truth, size[0], args.disparities)).transpose()?;
    let report = Report {
        bad2_valid_pct: score.map(|score| score.bad2_valid_pct),
        bad2_dense_pct: score.map(|score| score.bad2_dense_pct),
        density_pct: score.map_or_else(|| density(&disparity, size[0], args.disparities), |s| s.density_pct),
        rms_px: score.map(|score| score.rms_px),
        ms_median: times_ms[times_ms.len() / 2],
        threads,
    };
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &report).context("cannot write the report")?;
        writeln!(out)?;
        return Ok(());
    }
    human(&report, out)
}

fn human(report: &Report, out: &mut dyn Write) -> anyhow::Result<()> {
    if let (Some(valid), Some(dense), Some(rms)) =
        (report.bad2_valid_pct, report.bad2_dense_pct, report.rms_px)
    {
        writeln!(out, "over pixels seen by both eyes:")?;
        writeln!(out, "  {valid:6.2} % of those with a disparity are more than 2 px off")?;
        writeln!(out, "  {dense:6.2} % of all are more than 2 px off or have none")?;
        writeln!(out, "  {:6.2} % have a disparity", report.density_pct)?;
        writeln!(out, "  {rms:6.3} px RMS of those at most 2 px off")?;
    } else {
        writeln!(out, "  {:6.2} % of the pixels right of the range have a disparity", report.density_pct)?;
    }
    writeln!(out, "  {:6.2} ms, median of {RUNS}, {} threads", report.ms_median, report.threads)?;
    Ok(())
}

/// One strip on this thread, the others on threads of their own.
fn run_all(strips: Vec<Strip<'_>>) {
    let mut strips = strips.into_iter();
    let first = strips.next();
    std::thread::scope(|scope| {
        for strip in strips {
            scope.spawn(|| strip.run());
        }
        if let Some(strip) = first {
            strip.run();
        }
    });
}

/// Share of pixels with a disparity among those that can have one, percent.
fn density(disparity: &[u16], width: usize, disparities: usize) -> f64 {
    let rows = disparity.chunks_exact(width);
    let possible = rows.len() * width.saturating_sub(disparities);
    let found = rows.flat_map(|row| row.iter().skip(disparities)).filter(|&&d| d != NO_DISPARITY).count();
    100.0 * found as f64 / possible.max(1) as f64
}

fn grey(path: &Path) -> anyhow::Result<(Vec<u8>, [usize; 2])> {
    let image = image::open(path).with_context(|| format!("cannot read {}", path.display()))?.to_luma8();
    let size = [image.width() as usize, image.height() as usize];
    Ok((image.into_raw(), size))
}

/// The calibration file: two cameras as in calibration messages.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Calibration {
    left: Camera,
    right: Camera,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Camera {
    width: u32,
    height: u32,
    k: Vec<f64>,
    #[serde(default)]
    model: String,
    #[serde(default)]
    d: Vec<f64>,
    r: Vec<f64>,
    p: Vec<f64>,
}

fn calibration(path: &Path, [width, height]: [usize; 2]) -> anyhow::Result<StereoCamera> {
    let refused = |what: String| usage(format!("{what}: {}", path.display()));
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let Calibration { left, right } =
        toml::from_str(&text).map_err(|error| refused(error.to_string().trim_end().to_owned()))?;
    let raw = |camera: &Camera| {
        if [camera.width as usize, camera.height as usize] != [width, height] {
            let (w, h) = (camera.width, camera.height);
            return Err(refused(format!(
                "calibration is for {w}x{h} pixels, the images have {width}x{height}"
            )));
        }
        PinholeCamera::from_calibration([camera.width, camera.height], &camera.k, &camera.model, &camera.d)
            .map_err(|error| refused(error.to_string()))
    };
    let (left_raw, right_raw) = (raw(&left)?, raw(&right)?);
    let left = Eye { raw: &left_raw, r: &left.r, p: &left.p };
    let right = Eye { raw: &right_raw, r: &right.r, p: &right.p };
    StereoCamera::new(left, right).map_err(|error| refused(error.to_string()))
}
