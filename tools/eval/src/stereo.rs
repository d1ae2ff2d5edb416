//! Evaluates disparities of one pair of images against ground truth, and measures the time.

use crate::report::counted;
use crate::{EvalError, disparity_file};
use rcs_geom::PinholeCamera;
use rcs_stereo::{CameraInfo, Matcher, Method, NO_DISPARITY, Settings, StereoCamera, Strip, score};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::Path;
use std::time::Instant;

/// What is evaluated.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// Left image.
    pub left: &'a Path,
    /// Right image, of the same size.
    pub right: &'a Path,
    /// Calibration of both cameras, a TOML file; `None` if the images are rectified.
    pub calibration: Option<&'a Path>,
    /// Ground truth disparities of the rectified left image.
    pub truth: Option<&'a Path>,
    /// The matching method.
    pub method: Method,
    /// Number of disparities searched, pixels.
    pub disparities: usize,
    /// Number of threads.
    pub threads: usize,
}

/// The figures. Those that need ground truth are `None` (null in JSON) without it, and so are those over pixels of which
/// there are none.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Report {
    /// Pixels seen by both cameras, over which the other figures are.
    pub pixels: Option<usize>,
    /// Of the pixels with a disparity, the share with an error of more than 2 pixels, percent.
    pub bad2_valid_pct: Option<f64>,
    /// Of all pixels, the share with an error of more than 2 pixels or without a disparity, percent.
    pub bad2_dense_pct: Option<f64>,
    /// Pixels with a disparity, percent.
    pub density_pct: f64,
    /// Root mean square error over pixels with an error of at most 2 pixels, pixels.
    pub rms_px: Option<f64>,
    /// Median time to match the pair, ms.
    pub ms_median: f64,
    /// Number of threads used.
    pub threads: usize,
}

/// How often the pair is matched; the report contains the median of the times.
const RUNS: usize = 11;

/// Evaluates one pair.
pub fn measure(job: &Job<'_>) -> Result<Report, EvalError> {
    let (mut left, size) = grey(job.left)?;
    let (mut right, right_size) = grey(job.right)?;
    if size != right_size {
        return Err(EvalError::refused(format!(
            "left image is {}x{} pixels, right image {}x{}",
            size[0], size[1], right_size[0], right_size[1]
        )));
    }
    if let Some(path) = job.calibration {
        let camera = calibration(path, size)?;
        let refused = |error: &dyn fmt::Display| EvalError::refused(format!("{error}: {}", path.display()));
        left = camera.left().remap(&left, 1).map_err(|error| refused(&error))?;
        right = camera.right().remap(&right, 1).map_err(|error| refused(&error))?;
    }
    let truth = job.truth.map(|path| disparity_file::read(path, size)).transpose()?;

    let refused = |error: rcs_stereo::StereoError| EvalError::refused(error.to_string());
    let settings = Settings::new(job.method, job.disparities);
    let mut matcher = Matcher::new(size, settings).map_err(refused)?;
    let (mut disparity, mut times_ms, mut threads) = (Vec::new(), Vec::new(), 1);
    for _ in 0..RUNS {
        let start = Instant::now();
        matcher
            .compute_in_strips(&left, &right, &mut disparity, job.threads, |strips| {
                threads = strips.len();
                run_all(strips);
            })
            .map_err(refused)?;
        times_ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times_ms.sort_by(f64::total_cmp);

    let score = truth
        .map(|truth| score::score(&disparity, &truth, size[0], job.disparities))
        .transpose()
        .map_err(refused)?;
    if let (Some(score), Some(path)) = (score, job.truth)
        && score.pixels == 0
    {
        let from = job.disparities;
        return Err(EvalError::nothing(format!(
            "the truth has no pixel seen by both cameras, expected some from column {from} on: {}",
            path.display()
        )));
    }
    Ok(Report {
        pixels: score.map(|score| score.pixels),
        bad2_valid_pct: score.and_then(|score| score.bad2_valid_pct),
        bad2_dense_pct: score.map(|score| score.bad2_dense_pct),
        density_pct: score.map_or_else(|| density(&disparity, size[0], job.disparities), |s| s.density_pct),
        rms_px: score.and_then(|score| score.rms_px),
        ms_median: times_ms[times_ms.len() / 2],
        threads,
    })
}

impl fmt::Display for Report {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let (Some(pixels), Some(dense)) = (self.pixels, self.bad2_dense_pct) {
            writeln!(out, "over {} seen by both cameras:", counted(pixels as u64, "pixel"))?;
            if let Some(valid) = self.bad2_valid_pct {
                writeln!(out, "  {valid:6.2} % of those with a disparity are more than 2 px off")?;
            }
            writeln!(out, "  {dense:6.2} % of all are more than 2 px off or have none")?;
            writeln!(out, "  {:6.2} % have a disparity", self.density_pct)?;
            if let Some(rms) = self.rms_px {
                writeln!(out, "  {rms:6.3} px RMS of those at most 2 px off")?;
            }
        } else {
            writeln!(out, "  {:6.2} % of the pixels right of the range have a disparity", self.density_pct)?;
        }
        let threads = counted(self.threads as u64, "thread");
        writeln!(out, "  {:6.2} ms, median of {RUNS}, {threads}", self.ms_median)
    }
}

/// One strip on this thread, each of the others on a thread of its own.
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

/// Share of pixels with a disparity among those where one is possible, percent.
fn density(disparity: &[u16], width: usize, disparities: usize) -> f64 {
    let rows = disparity.chunks_exact(width);
    let possible = rows.len() * width.saturating_sub(disparities);
    let found = rows.flat_map(|row| row.iter().skip(disparities)).filter(|&&d| d != NO_DISPARITY).count();
    100.0 * found as f64 / possible.max(1) as f64
}

fn grey(path: &Path) -> Result<(Vec<u8>, [usize; 2]), EvalError> {
    let image = image::open(path).map_err(|error| EvalError::read(path, error))?.to_luma8();
    let size = [image.width() as usize, image.height() as usize];
    Ok((image.into_raw(), size))
}

/// A calibration file: two cameras with the numbers of calibration messages.
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

fn calibration(path: &Path, [width, height]: [usize; 2]) -> Result<StereoCamera, EvalError> {
    let refused = |what: String| EvalError::refused(format!("{what}: {}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| EvalError::read(path, error))?;
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
    let left = CameraInfo { raw: &left_raw, r: &left.r, p: &left.p };
    let right = CameraInfo { raw: &right_raw, r: &right.r, p: &right.p };
    StereoCamera::new(left, right).map_err(|error| refused(error.to_string()))
}
