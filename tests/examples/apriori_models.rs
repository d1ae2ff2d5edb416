//! Writes the a priori models of Albus 2006a, 3.1.2 into a folder: a mulch path, a path of white lime, an orange fence.
//!
//! `cargo run -p ocu-tests --example apriori_models -- assets/models`
//!
//! The models are synthetic and contain no images. A surface is a range of ratios of green to red in any light; red
//! covers a range, with most of its weight in the middle. Models learned on site are better. These are for the first
//! metres, and for obstacles that the vehicle must not drive on to learn them.

use rcs_color::file::to_message;
use rcs_color::histogram::{BINS, Histogram};
use rcs_color::models::{Model, Models};
use rcs_msg::{AnyMessage, Stamp, to_json};
use std::error::Error;
use std::path::PathBuf;

/// Colours of a surface.
struct Surface {
    file: &'static str,
    name: &'static str,
    /// Range of red.
    red: [f64; 2],
    /// Range of green divided by red.
    green_to_red: [f64; 2],
    is_obstacle: bool,
}

const SURFACES: [Surface; 3] = [
    Surface {
        file: "mulch",
        name: "mulch",
        red: [45.0, 185.0],
        green_to_red: [0.62, 0.82],
        is_obstacle: false,
    },
    Surface {
        file: "white_lime",
        name: "white lime",
        red: [135.0, 255.0],
        green_to_red: [0.93, 1.01],
        is_obstacle: false,
    },
    Surface {
        file: "orange_fence",
        name: "orange fence",
        red: [130.0, 255.0],
        green_to_red: [0.3, 0.55],
        is_obstacle: true,
    },
];

/// Number of steps over each range.
const STEPS: u32 = 200;

fn histogram(surface: &Surface) -> Histogram {
    let mut histogram = Histogram::default();
    // The mean of two uniform steps has a triangular distribution, so that the middle of each range has the most
    // weight.
    let at = |[from, to]: [f64; 2], part: f64| from + (to - from) * part;
    let triangle = |a: u32, b: u32| f64::from(a + b) / f64::from(2 * (STEPS - 1));
    for (i, j) in (0..STEPS).flat_map(|i| (0..STEPS).map(move |j| (i, j))) {
        let red = at(surface.red, triangle(i, j));
        let green =
            red * at(surface.green_to_red, triangle((7 * i + 3 * j) % STEPS, (5 * i + 11 * j) % STEPS));
        histogram.add(red as u8, green.min(255.0) as u8);
    }
    histogram.scaled(4000.0)
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

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("expected a folder to write into")?);
    for surface in &SURFACES {
        // Two decimals keep the file readable.
        let counts: Vec<f32> =
            histogram(surface).counts().iter().map(|count| (count * 100.0).round() / 100.0).collect();
        let histogram = Histogram::from_counts(&counts).ok_or("a surface without colours")?;
        let model = Model { name: surface.name.to_owned(), histogram, uses: 1, updated: Stamp(0) };
        let mut models = Models::default();
        if surface.is_obstacle {
            models.obstacles.push(model);
        } else {
            models.ground.push(model);
        }
        let mut message = to_message(&models, Stamp(0));
        message.timestamp = None;
        let text = in_rows(&to_json(&AnyMessage::new(message))?);
        std::fs::write(folder.join(format!("{}.json", surface.file)), text)?;
    }
    Ok(())
}
