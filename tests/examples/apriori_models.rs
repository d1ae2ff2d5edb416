//! Writes the a priori models into a folder, from what the simulated vehicle sees and does on the first looks of the
//! courses: the colours of mulch, white lime and orange fence (Albus 2006a, 3.1.2), and growth that gives way (Albus
//! 2006b, 3.6).
//!
//! `cargo run -p ocu-tests --example apriori_models -- assets/models [colours] [growth]`
//!
//! - Colours: the pixels of the reduced image of which enough shows the surface, by the simulator's class image. Of a
//!   histogram only the bins stay that the surface has more often than everything else in the same pictures.
//! - Growth: the terrain models that a drive through tall growth has learned, with what was experienced of them. Models
//!   without experience are left out, because they say nothing that range does not.
//!
//! The second looks of the courses have other seasons and light, and none of their pictures are used, so that they show
//! what transfers.

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a tool that cannot go on stops")]
#![allow(unreachable_pub, dead_code, reason = "shared with the tests")]

#[path = "../src/bundled.rs"]
mod bundled;

use rcs_color::file::to_message;
use rcs_color::histogram::{BINS, Histogram};
use rcs_color::image::{HEIGHT, Image, WIDTH, reduce};
use rcs_color::models::{Model, Models};
use rcs_msg::foxglove::RawImage;
use rcs_msg::{AnyMessage, Payload, Stamp, to_json};
use rcs_runtime::{RunOptions, Stepped};
use rcs_scene::Class;
use rcs_terrain::appearance::MatchWeights;
use rcs_terrain::model_file::matching_of;
use rcs_terrain::models::{ModelRules, ModelSet};
use rcs_terrain::proto::{TerrainCamera, TerrainModels};
use std::path::{Path, PathBuf};

/// Colours of a surface, and where they are seen.
struct Surface {
    file: &'static str,
    name: &'static str,
    class: Class,
    course: &'static str,
    /// Share of a reduced pixel that must show it: a fence of mesh never fills one.
    least_share: f64,
    is_obstacle: bool,
}

const SURFACES: [Surface; 3] = [
    Surface {
        file: "mulch",
        name: "mulch",
        class: Class::Mulch,
        course: "mulch_path",
        least_share: 0.9,
        is_obstacle: false,
    },
    Surface {
        file: "white_lime",
        name: "white lime",
        class: Class::WhiteLime,
        course: "mulch_path",
        least_share: 0.9,
        is_obstacle: false,
    },
    Surface {
        file: "orange_fence",
        name: "orange fence",
        class: Class::Fence,
        course: "dead_end",
        least_share: 0.4,
        is_obstacle: true,
    },
];

/// Courses with growth that gives way, and the length of the drives, s.
const GROWTH: [(&str, f64); 2] = [("tall_grass", 60.0), ("transition", 60.0)];
/// Models whose experience backs less than this share of what they say are left out.
const LEAST_BACKING: f64 = 0.5;
/// Length of the drives whose pictures are used, and time between two pictures, s.
const DRIVE_S: f64 = 45.0;
const STEP_S: f64 = 0.5;

fn begin(course: &str, params: &[(&str, &str)]) -> Stepped {
    let mut run =
        Stepped::new(bundled::plan("learning", course, params), None, RunOptions::default()).unwrap();
    run.begin().unwrap();
    run
}

fn latest<T: Payload>(run: &Stepped, buffer: &str) -> Option<T> {
    run.bus().get(buffer)?.latest()?.message.to()
}

/// Share of a class in each pixel of the reduced image.
fn shares(classes: &RawImage, class: Class) -> Vec<f64> {
    let (width, height) = (classes.width as usize, classes.height as usize);
    let (mut of_class, mut all) = (vec![0.0; WIDTH * HEIGHT], vec![0.0; WIDTH * HEIGHT]);
    for (row, pixels) in classes.data.chunks_exact(classes.step as usize).enumerate() {
        for (column, &code) in pixels[..width].iter().enumerate() {
            let at = row * HEIGHT / height * WIDTH + column * WIDTH / width;
            all[at] += 1.0;
            of_class[at] += f64::from(u8::from(code == class.code()));
        }
    }
    of_class.iter().zip(all).map(|(part, all)| part / f64::max(all, 1.0)).collect()
}

/// The colours that a surface has more often than all that surrounds it.
fn colours(surface: &Surface) -> Histogram {
    let mut run = begin(surface.course, &[]);
    let (mut own, mut rest) = (Histogram::default(), Histogram::default());
    let mut time_s = 1.0;
    while time_s <= DRIVE_S {
        run.run_until(Stamp((time_s * 1e9) as u64)).unwrap();
        for side in ["left", "right"] {
            let image: Option<RawImage> = latest(&run, &format!("/front_{side}/left"));
            let classes: Option<RawImage> = latest(&run, &format!("/front_{side}/ground_truth_class"));
            let Some((image, classes)) = image.zip(classes) else { continue };
            let size = [image.width as usize, image.height as usize];
            let pixels = Image::new(size, image.step as usize, &image.data).unwrap();
            for ([red, green], share) in reduce(&pixels).into_iter().zip(shares(&classes, surface.class)) {
                if share >= surface.least_share {
                    own.add(red, green);
                } else if share == 0.0 {
                    rest.add(red, green);
                }
            }
        }
        time_s += STEP_S;
    }
    println!("{}: {} pixels of {}", surface.name, own.sum(), surface.course);
    let (own, rest) = (own.scaled(4000.0), rest.scaled(4000.0));
    let kept = own.counts().iter().zip(rest.counts()).map(|(&own, &rest)| if own > rest { own } else { 0.0 });
    // Two decimals keep the file readable.
    let counts: Vec<f32> =
        Histogram::from_counts(&kept.collect::<Vec<_>>()).unwrap().scaled(4000.0).counts().to_vec();
    let rounded: Vec<f32> = counts.iter().map(|count| (count * 100.0).round() / 100.0).collect();
    Histogram::from_counts(&rounded).unwrap()
}

fn write_colours(folder: &Path) {
    for surface in &SURFACES {
        let model = Model {
            name: surface.name.to_owned(),
            histogram: colours(surface),
            uses: 1,
            updated: Stamp(0),
            sample: None,
        };
        let mut models = Models::default();
        if surface.is_obstacle {
            models.obstacles.push(model);
        } else {
            models.ground.push(model);
        }
        let mut message = to_message(&models, Stamp(0));
        message.timestamp = None;
        let text = in_rows(&to_json(&AnyMessage::new(message)).unwrap());
        std::fs::write(folder.join(format!("{}.json", surface.file)), text).unwrap();
    }
}

/// Numbers with one row of the histogram per line.
fn in_rows(json: &str) -> String {
    let is_number = |line: &str| line.trim().trim_end_matches(',').parse::<f32>().is_ok();
    let (mut text, mut numbers) = (String::new(), 0);
    for line in json.trim_end().lines() {
        if is_number(line) && numbers % BINS > 0 {
            text.truncate(text.trim_end().len());
            text.push(' ');
            text.push_str(line.trim());
        } else {
            text.push_str(line);
        }
        numbers = if is_number(line) { numbers + 1 } else { 0 };
        text.push('\n');
    }
    text
}

/// Drives through growth that gives way, and keeps the models that this has backed.
fn write_growth(folder: &Path) {
    let mut kept = ModelSet::default();
    let (mut span_octaves, mut weights) = (0.0, MatchWeights { histograms: [1.0; 5], contrast: 1.0 });
    for (course, seconds) in GROWTH {
        // Straight through it, instead of around it.
        let mut run = begin(course, &[("truth_driver.vegetation_weight", "0.1")]);
        run.run_until(Stamp((seconds * 1e9) as u64)).unwrap();
        let message: TerrainModels = latest(&run, "/terrain/models").unwrap();
        (span_octaves, weights) = matching_of(&message).unwrap();
        let mut set = ModelSet::from_message(&message).unwrap();
        let all = set.models.len();
        set.models.retain(|model| model.driven_backing() >= LEAST_BACKING);
        println!("{course}: {} of {all} models are backed by experience", set.models.len());
        let rules = ModelRules {
            min_points: 1,
            min_purity: 0.5,
            merge_distance: 0.03,
            max_models: 64,
            near_m: 4.0,
            weights: weights.normalised(),
        };
        kept.take_all(&set, &rules);
    }
    let message = kept.to_message(TerrainCamera::Both, span_octaves, &weights);
    let value: serde_json::Value =
        serde_json::from_str(&to_json(&AnyMessage::new(message)).unwrap()).unwrap();
    let rows = |value: &serde_json::Value| match value {
        serde_json::Value::Array(models) => {
            let rows: Vec<String> = models.iter().map(|model| format!("    {model}")).collect();
            format!("[\n{}\n  ]", rows.join(",\n"))
        }
        other => other.to_string(),
    };
    let fields: Vec<String> = value
        .as_object()
        .unwrap()
        .iter()
        .map(|(name, value)| format!("  \"{name}\": {}", rows(value)))
        .collect();
    std::fs::write(folder.join("tall_growth.json"), format!("{{\n{}\n}}\n", fields.join(",\n"))).unwrap();
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().expect("a folder to write into"));
    let which: Vec<String> = arguments.collect();
    let wanted = |name: &str| which.is_empty() || which.iter().any(|given| given == name);
    if wanted("colours") {
        write_colours(&folder);
    }
    if wanted("growth") {
        write_growth(&folder);
    }
}
