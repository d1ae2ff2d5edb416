//! The background sample (Albus 2006a, 3.1.2). The first samples are random pixels above the horizon and up to 50 px
//! below it. Later samples are random pixels that were classified as background in the previous image.

use crate::histogram::Histogram;
use crate::image::{HEIGHT, Image, PIXELS, WIDTH, edges};
use rand_core::RngCore;

/// Fewest background pixels of the reduced image that are sampled. With fewer, the sample is taken above the horizon
/// again, so that a handful of misclassified pixels cannot become the background model.
const FEWEST: usize = PIXELS / 100;
/// Maximum number of draws per sample, for a region above the horizon that is not a rectangle.
const DRAWS: u32 = 8;

/// A nearly uniform random number below `limit`; the bias is below `limit` / 2³².
fn below(rng: &mut impl RngCore, limit: usize) -> usize {
    ((u64::from(rng.next_u32()) * limit as u64) >> 32) as usize
}

/// Draws up to `samples` pixels. `called` lists the pixels of the reduced image that were classified as background.
/// `limits` gives, for each column of the reduced image, the number of rows from the top that are sampled when `called`
/// is too short. The histogram is empty where there is nothing to sample.
pub fn sample(
    image: &Image<'_>,
    called: &[u32],
    limits: &[u32],
    samples: u32,
    rng: &mut impl RngCore,
) -> Histogram {
    if called.len() >= FEWEST {
        sample_called(image, called, samples, rng)
    } else {
        sample_above(image, limits, samples, rng)
    }
}

fn sample_called(image: &Image<'_>, called: &[u32], samples: u32, rng: &mut impl RngCore) -> Histogram {
    let [width, height] = image.size();
    let (columns, rows) = (edges(width, WIDTH), edges(height, HEIGHT));
    let mut histogram = Histogram::default();
    for _ in 0..samples {
        let pixel = called[below(rng, called.len())] as usize;
        let ([left, right], [top, bottom]) = (columns[pixel % WIDTH], rows[pixel / WIDTH]);
        let column = left + below(rng, right - left);
        let row = top + below(rng, bottom - top);
        let [red, green, _] = image.pixel(column, row);
        histogram.add(red, green);
    }
    histogram
}

fn sample_above(image: &Image<'_>, limits: &[u32], samples: u32, rng: &mut impl RngCore) -> Histogram {
    let [width, height] = image.size();
    let lowest = limits.iter().max().map_or(0, |&limit| height.min(limit as usize));
    let mut histogram = Histogram::default();
    if lowest == 0 {
        return histogram;
    }
    let mut left = samples;
    for _ in 0..samples.saturating_mul(DRAWS) {
        let (column, row) = (below(rng, width), below(rng, lowest));
        if row < limits[column * WIDTH / width] as usize {
            let [red, green, _] = image.pixel(column, row);
            histogram.add(red, green);
            left -= 1;
        }
        if left == 0 {
            break;
        }
    }
    histogram
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::SeedableRng;

    /// An image whose red encodes the row and whose green encodes the column, in steps of 16.
    fn image_data() -> Vec<u8> {
        (0..240_usize)
            .flat_map(|row| {
                (0..320_usize)
                    .flat_map(move |column| [(row * 255 / 239) as u8, (column * 255 / 319) as u8, 0])
            })
            .collect()
    }

    fn drawn(called: &[u32], limits: &[u32]) -> Vec<(usize, usize)> {
        let data = image_data();
        let image = Image::new([320, 240], 960, &data).unwrap();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let histogram = sample(&image, called, limits, 4000, &mut rng);
        let bins = histogram.counts().iter().enumerate().filter(|(_, count)| **count > 0.0);
        bins.map(|(index, _)| (index / 30, index % 30)).collect()
    }

    #[test]
    fn the_first_samples_come_from_above_the_limit_of_each_column() {
        // The left half down to row 120, the right half down to row 40.
        let limits: Vec<u32> = (0..128).map(|column| if column < 64 { 120 } else { 40 }).collect();
        let bins = drawn(&[], &limits);
        assert!(bins.iter().all(|&(row, column)| row <= if column < 15 { 15 } else { 5 }), "{bins:?}");
        assert!(bins.len() > 250, "all of the region is sampled: {} bins", bins.len());
    }

    #[test]
    fn later_samples_come_from_what_was_called_background() {
        // A block of the reduced image: rows 60 to 79, columns 10 to 29.
        let called: Vec<u32> =
            (60..80).flat_map(|row| (10..30).map(move |column| row * 128 + column)).collect();
        let bins = drawn(&called, &[240; 128]);
        // Rows 150 to 200 of 240, columns 25 to 75 of 320.
        assert!(
            bins.iter().all(|&(row, column)| (18..=25).contains(&row) && (2..=7).contains(&column)),
            "{bins:?}"
        );
        assert!(bins.len() > 30);
    }

    #[test]
    fn a_handful_of_background_pixels_is_not_enough_to_sample() {
        let bins = drawn(&[12_000; 5], &[40; 128]);
        assert!(bins.iter().all(|&(row, _)| row <= 5), "{bins:?}");
    }

    #[test]
    fn without_a_horizon_in_view_there_is_no_sample() {
        assert!(drawn(&[], &[0; 128]).is_empty());
    }
}
