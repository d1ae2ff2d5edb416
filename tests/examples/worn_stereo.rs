//! What stereo loses by cameras as they are: share of pixels with a range, and error of the range at 5 m and 10 m, for
//! each fault of the cameras alone and for all of them. Several runs, because faults are drawn once per run.
//!
//! `cargo run -p ocu-tests --example worn_stereo [-- COURSE]`

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "its output is what it is for")]
#![allow(unreachable_pub, reason = "shared with the tests")]

#[path = "../src/bundled.rs"]
mod bundled;

use bundled::Repository;
use rcs_geom::{DVec2, PinholeCamera};
use rcs_msg::foxglove::{CameraCalibration, RawImage};
use rcs_msg::{Payload, Stamp};
use rcs_runtime::{Asset, Assets, Plan, PlanOptions, RunOptions, StackFile, Stepped};
use std::sync::Arc;

const SEEDS: u64 = 6;
const SECONDS: u64 = 8;
/// Distances at which the error is measured, m, each with a tenth of it to both sides.
const BANDS_M: [f64; 2] = [5.0, 10.0];
/// Range to which pixels count, m.
const REACH_M: f64 = 12.0;

const CONTROL: &str = "exposure_control = { target = 105.0, response_s = 0.5, max_gain = 3.0 }";
/// Name, keys of a camera, and whether clouds pass.
const FAULTS: [(&str, &str, bool); 8] = [
    ("none", "", false),
    ("calibration 0.1°", "calibration_error_deg = 0.1", false),
    ("calibration 0.2°", "calibration_error_deg = 0.2", false),
    ("calibration 0.3°", "calibration_error_deg = 0.3", false),
    ("vertical offset 1 px", "vertical_offset_px = 1.0", false),
    ("clouds, constant exposure", "", true),
    ("clouds, exposure control", CONTROL, true),
    ("all (`lagr_worn`)", "all", true),
];

/// The bundled files, with a vehicle of this program.
struct Files(String);

impl Assets for Files {
    fn read(&self, kind: &str, name: &str, beside: &str) -> Result<Asset, String> {
        let asset = Repository.read(kind, name, beside)?;
        Ok(if kind == "vehicle" { Asset { text: self.0.clone(), ..asset } } else { asset })
    }
}

fn vehicle(keys: &str, clouds: bool) -> String {
    if keys == "all" {
        return Repository.read("vehicle", "lagr_worn", "").unwrap().text;
    }
    let lagr = Repository.read("vehicle", "lagr", "").unwrap().text;
    let lagr = lagr.replace("vignette = 0.12\n", &format!("vignette = 0.12\n{keys}\n"));
    let table = "[clouds]\ncover = 0.5\nperiod_s = 4.0\nleast_sunlight = 0.3\n\n[[infrared]]";
    if clouds { lagr.replacen("[[infrared]]", table, 1) } else { lagr }
}

/// What the runs with one fault have shown.
#[derive(Default)]
struct Loss {
    pixels: u64,
    ranged: u64,
    wrong: u64,
    /// By run and band: median of the relative error.
    medians: [Vec<f64>; BANDS_M.len()],
}

fn main() {
    let course = std::env::args().nth(1).unwrap_or_else(|| "meadow".to_owned());
    println!("course {course}, {SEEDS} runs of {SECONDS} s, pixels of ground and things within {REACH_M} m");
    println!(
        "| fault | pixels with a range | of these wrong by more than 1.5 px | error at 5 m: rms, worst run | at 10 m |"
    );
    println!("| --- | --- | --- | --- | --- |");
    for (name, keys, clouds) in FAULTS {
        let mut loss = Loss::default();
        for seed in 0..SEEDS {
            watch(&course, &vehicle(keys, clouds), seed, &mut loss);
        }
        let share = |part: u64, of: u64| 100.0 * part as f64 / of.max(1) as f64;
        let [near, far] = loss.medians.each_ref().map(|medians| {
            let rms = (medians.iter().map(|e| e * e).sum::<f64>() / medians.len().max(1) as f64).sqrt();
            let worst =
                medians.iter().fold(0.0_f64, |worst, e| if e.abs() > worst.abs() { *e } else { worst });
            format!("{:.1} %, {:+.1} %", 100.0 * rms, 100.0 * worst)
        });
        println!(
            "| {name} | {:.1} % | {:.1} % | {near} | {far} |",
            share(loss.ranged, loss.pixels),
            share(loss.wrong, loss.ranged)
        );
    }
}

fn watch(course: &str, vehicle: &str, seed: u64, loss: &mut Loss) {
    let files = Files(vehicle.to_owned());
    let mut stack = Repository.read("stack", "truth_driver", "").unwrap().text;
    stack.push_str("\n[[process]]\nname = \"perception\"\nplugin = \"supervisor\"\nsupervisor = \"robot\"\n");
    stack.push_str("as = \"auxiliary\"\n\n[[include]]\npart = \"stereo_pair\"\nwith = { side = \"left\" }\n");
    let file = StackFile::compose("worn_stereo", &stack, &files).unwrap_or_else(|error| panic!("{error}"));
    let options = PlanOptions { overrides: &[], course: Some(course), assets: &files };
    let plan = Plan::with(file, rcs_plugins::all(), &options).unwrap_or_else(|error| panic!("{error}"));
    let options = RunOptions { seed, ..RunOptions::default() };
    let mut run = Stepped::new(Arc::new(plan), None, options).unwrap();
    run.begin().unwrap();
    let mut errors: [Vec<f64>; BANDS_M.len()] = Default::default();
    for second in 1..=SECONDS {
        run.run_until(Stamp(second * 1_000_000_000)).unwrap();
        compare(&run, loss, &mut errors);
    }
    for (errors, medians) in errors.iter_mut().zip(&mut loss.medians) {
        errors.sort_by(f64::total_cmp);
        medians.extend(errors.get(errors.len() / 2));
    }
}

fn latest<T: Payload>(run: &Stepped, buffer: &str) -> Option<T> {
    run.bus().get(buffer).unwrap_or_else(|| panic!("no buffer {buffer}")).latest()?.message.to()
}

/// Compares the newest range image with the truth of the same image.
fn compare(run: &Stepped, loss: &mut Loss, errors: &mut [Vec<f64>; BANDS_M.len()]) {
    let depth: RawImage = latest(run, "/stereo_left/depth").unwrap();
    let truth: RawImage = latest(run, "/front_left/ground_truth_depth").unwrap();
    if depth.timestamp != truth.timestamp {
        return;
    }
    let camera = |buffer: &str| {
        let c: CameraCalibration = latest(run, buffer).unwrap();
        PinholeCamera::from_calibration([c.width, c.height], &c.k, &c.distortion_model, &c.d).unwrap()
    };
    let (rectified, raw) = (camera("/stereo_left/calibration"), camera("/front_left/left_calibration"));
    let [depth_m, true_m] = [&depth, &truth].map(|image| rcs_msg::image::depth_m(image, 1.0).unwrap());
    let width = rectified.width as usize;
    // Columns that the right camera does not see, and a margin.
    for at in (0..depth_m.len()).filter(|at| (52..width - 4).contains(&(at % width))) {
        let ray = rectified.unproject(DVec2::new((at % width) as f64, (at / width) as f64));
        let pixel =
            ray.and_then(|ray| raw.project(ray)).map(DVec2::round).filter(|&pixel| raw.contains(pixel));
        let Some(pixel) = pixel else { continue };
        let truth = f64::from(true_m[pixel.y as usize * raw.width as usize + pixel.x as usize]);
        if truth.is_nan() || truth > REACH_M {
            continue;
        }
        loss.pixels += 1;
        let got = f64::from(depth_m[at]);
        if !got.is_finite() || got <= 0.0 {
            continue;
        }
        loss.ranged += 1;
        let focal_baseline = rectified.fx * 0.12;
        loss.wrong += u64::from((focal_baseline / got - focal_baseline / truth).abs() > 1.5);
        for (band_m, errors) in BANDS_M.into_iter().zip(errors.iter_mut()) {
            if (truth / band_m - 1.0).abs() < 0.1 {
                errors.push(got / truth - 1.0);
            }
        }
    }
}
