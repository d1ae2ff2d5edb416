//! Evaluates the colour models of ground and background on labelled images.

use crate::EvalError;
use crate::report::{ClassReport, GROUND, OBSTACLE};
use image::DynamicImage;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rcs_color::engine::{Engine, Permission, Samples};
use rcs_color::histogram::Span;
use rcs_color::image::{HEIGHT, Image, WIDTH};
use rcs_color::models::{Models, Settings};
use rcs_color::region::spans;
use rcs_geom::DVec2;
use rcs_metrics::Confusion;
use rcs_msg::Stamp;
use rcs_runtime::Assets;
use rcs_sense::check_exposure;
use rcs_world::{OBSTACLE_COST, UNKNOWN_COST};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// How often each image is processed; all times enter the median.
const RUNS: usize = 5;
/// Assumed time between images, ns.
const PERIOD_NS: u64 = 200_000_000;
/// Most ids that an error names.
const MOST_IDS: usize = 20;
/// Distance of the first background samples below the horizon.
const BELOW_HORIZON_PX: u32 = 50;

/// What is evaluated.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    /// Images, in the order in which they were taken.
    pub images: &'a [PathBuf],
    /// A label image for each image, of the same size.
    pub labels: &'a [PathBuf],
    /// Ids of ground; every other id is an obstacle.
    pub ground_ids: &'a [u16],
    /// Ids that are not counted.
    pub ignored_ids: &'a [u16],
    /// Names of the a priori models.
    pub apriori: &'a [String],
    /// Source of the model files.
    pub assets: &'a dyn Assets,
    /// Height of the horizon, percent of the image from the top.
    pub horizon_pct: f64,
}

/// Evaluates all images together.
pub fn measure(job: &Job<'_>) -> Result<ClassReport, EvalError> {
    if job.images.len() != job.labels.len() {
        let (images, labels) = (job.images.len(), job.labels.len());
        return Err(EvalError::refused(format!("{images} images, but {labels} label images")));
    }
    if !(0.0..=100.0).contains(&job.horizon_pct) {
        return Err(EvalError::refused(format!("horizon is {} %, expected 0 to 100", job.horizon_pct)));
    }
    if let Some(id) = job.ground_ids.iter().find(|id| job.ignored_ids.contains(id)) {
        return Err(EvalError::refused(format!(
            "the id {id} is in --ground-ids and in --ignore-ids; expected it in one of them"
        )));
    }
    // Each image is independent: no fusion, and a new ground model takes effect at once.
    let settings =
        Settings { fusion_frames: 0, learning_period_ns: 0, min_sample_px: 1, ..Settings::default() };
    let mut engine = Engine::new(apriori(job, settings.samples)?);
    check_ground_ids(job)?;
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let (mut confusion, mut times_ms) = (Confusion::default(), Vec::new());
    let mut found = BTreeSet::<u16>::new();
    let rules = rcs_msg::params::default();
    for (index, (path, labels)) in (0..).zip(job.images.iter().zip(job.labels)) {
        let image = image::open(path).map_err(|error| EvalError::read(path, error))?.to_rgb8();
        let size = [image.width() as usize, image.height() as usize];
        let ids = ids(labels, size)?;
        found.extend(ids.iter().copied());
        check_exposure(image.as_raw(), &rules).map_err(|error| EvalError::unusable(path, error))?;
        let image = Image::new(size, 3 * size[0], image.as_raw())
            .map_err(|error| EvalError::unusable(path, error))?;
        let ground = trapezoid(size);
        let horizon_px = (job.horizon_pct * 0.01 * size[1] as f64) as u32;
        let limits = [horizon_px.saturating_add(BELOW_HORIZON_PX).min(size[1] as u32); WIDTH];
        let samples =
            Samples { ground: &ground, frame_id: "", first_background: &limits, permission: Permission::All };
        let time = Stamp(index * PERIOD_NS);
        let before = (engine.clone(), rng.clone());
        let mut costs = None;
        for _ in 0..RUNS {
            (engine, rng) = before.clone();
            let start = Instant::now();
            let seen = engine.see(&image, &samples, time, &settings, &mut rng);
            times_ms.push(start.elapsed().as_secs_f64() * 1e3);
            costs = seen.costs;
        }
        let costs =
            costs.ok_or_else(|| EvalError::nothing(format!("no ground sample in {}", path.display())))?;
        count(&costs, &ids, size, job, &mut confusion);
    }
    for absent in job.ground_ids.iter().filter(|id| !found.contains(*id)) {
        tracing::warn!("no label image has the ground id {absent}");
    }
    Ok(ClassReport::new(&confusion, job.images.len() as u64, 0, times_ms))
}

/// Refuses label images of which none has a ground id. Reads them up to the first one that has.
fn check_ground_ids(job: &Job<'_>) -> Result<(), EvalError> {
    let mut found = BTreeSet::<u16>::new();
    for (path, labels) in job.images.iter().zip(job.labels) {
        let (width, height) = image::image_dimensions(path).map_err(|error| EvalError::read(path, error))?;
        found.extend(ids(labels, [width as usize, height as usize])?);
        if job.ground_ids.iter().any(|id| found.contains(id)) {
            return Ok(());
        }
    }
    let more = if found.len() > MOST_IDS { ", …" } else { "" };
    let (got, expected) = (listed(job.ground_ids), listed(found.iter().take(MOST_IDS)));
    Err(EvalError::refused(format!(
        "no label image has one of the ground ids {got}; expected one of {expected}{more}"
    )))
}

fn listed<'a>(ids: impl IntoIterator<Item = &'a u16>) -> String {
    ids.into_iter().map(u16::to_string).collect::<Vec<_>>().join(", ")
}

fn count(
    costs: &[u8],
    ids: &[u16],
    [width, height]: [usize; 2],
    job: &Job<'_>,
    confusion: &mut Confusion<2>,
) {
    for (pixel, id) in ids.iter().enumerate() {
        if job.ignored_ids.contains(id) {
            continue;
        }
        let (column, row) = (pixel % width * WIDTH / width, pixel / width * HEIGHT / height);
        let predicted = match costs[row * WIDTH + column] {
            UNKNOWN_COST => None,
            OBSTACLE_COST.. => Some(OBSTACLE),
            _ => Some(GROUND),
        };
        confusion.add(if job.ground_ids.contains(id) { GROUND } else { OBSTACLE }, predicted);
    }
}

/// The bottom centre of an image: the ground ahead of a vehicle whose camera looks forward.
fn trapezoid(size: [usize; 2]) -> Vec<Span> {
    let corner = |x: f64, y: f64| DVec2::new(x * size[0] as f64, y * size[1] as f64) - 0.5;
    spans(&[corner(0.4, 0.68), corner(0.6, 0.68), corner(0.7, 0.96), corner(0.3, 0.96)], size)
}

/// The a priori models.
fn apriori(job: &Job<'_>, samples: u32) -> Result<Models, EvalError> {
    let mut models = Models::default();
    for name in job.apriori {
        let asset = job.assets.read("models", name, "").map_err(EvalError::Refused)?;
        let read = rcs_color::file::parse(&asset.text)
            .map_err(|error| EvalError::refused(format!("{}: {error}", asset.file)))?;
        models = models.with(&read, samples);
    }
    Ok(models)
}

/// Ids of a label image, by rows.
fn ids(path: &Path, size: [usize; 2]) -> Result<Vec<u16>, EvalError> {
    let image = image::open(path).map_err(|error| EvalError::read(path, error))?;
    let got = [image.width() as usize, image.height() as usize];
    if got != size {
        return Err(EvalError::refused(format!(
            "labels are {}x{} pixels, their image {}x{}: {}",
            got[0],
            got[1],
            size[0],
            size[1],
            path.display()
        )));
    }
    match image {
        DynamicImage::ImageLuma8(grey) => Ok(grey.into_raw().into_iter().map(u16::from).collect()),
        DynamicImage::ImageLuma16(grey) => Ok(grey.into_raw()),
        other => {
            let rgb = other.to_rgb8();
            // Some programs write grey images with three equal channels.
            if rgb.pixels().all(|pixel| pixel.0[0] == pixel.0[1] && pixel.0[1] == pixel.0[2]) {
                return Ok(rgb.pixels().map(|pixel| u16::from(pixel.0[0])).collect());
            }
            Err(EvalError::refused(format!(
                "labels are an image in colours, expected a grey PNG of ids: {}",
                path.display()
            )))
        }
    }
}
