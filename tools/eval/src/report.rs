//! Figures of a ground and obstacle classification, pixel by pixel: those of `ocu eval color` and `ocu eval classify`.

use rcs_metrics::Confusion;
use serde::Serialize;
use std::fmt;

/// Class of a drivable pixel.
pub(crate) const GROUND: usize = 0;
/// Class of an obstacle pixel.
pub(crate) const OBSTACLE: usize = 1;

/// A number of things, in words: `1 image`, `3 images`.
pub(crate) fn counted(count: u64, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// The figures; `None` (null in JSON) if there is no pixel of the class, or no time was measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ClassReport {
    /// Images that were compared with a label image.
    pub images: u64,
    /// Images that were not compared, because no true label image is of their time.
    pub images_without_counterpart: u64,
    /// Pixels that were counted.
    pub pixels: u64,
    /// Intersection over union of ground, 0 to 1.
    pub ground_iou: Option<f64>,
    /// Intersection over union of obstacles, 0 to 1.
    pub obstacle_iou: Option<f64>,
    /// Harmonic mean of precision and recall of ground, 0 to 1.
    pub f1: Option<f64>,
    /// Pixels that the method left unclassified, percent.
    pub unclassified_pct: f64,
    /// Median time per image, ms.
    pub ms_median: Option<f64>,
}

impl ClassReport {
    /// Computes the figures from counts of ground and obstacles in `images` images; `times_ms` are in any order.
    pub(crate) fn new(
        confusion: &Confusion<2>,
        images: u64,
        images_without_counterpart: u64,
        mut times_ms: Vec<f64>,
    ) -> ClassReport {
        times_ms.sort_by(f64::total_cmp);
        ClassReport {
            images,
            images_without_counterpart,
            pixels: confusion.total(),
            ground_iou: confusion.iou(GROUND),
            obstacle_iou: confusion.iou(OBSTACLE),
            f1: confusion.f1(GROUND),
            unclassified_pct: 100.0 * confusion.unclassified_share().unwrap_or(0.0),
            ms_median: times_ms.get(times_ms.len() / 2).copied(),
        }
    }
}

impl fmt::Display for ClassReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let figure = |value: Option<f64>| value.map_or("     -".to_owned(), |value| format!("{value:6.3}"));
        let lacking = match self.images_without_counterpart {
            0 => String::new(),
            count => format!(", {} without a true one", counted(count, "image")),
        };
        let (pixels, images) = (counted(self.pixels, "pixel"), counted(self.images, "image"));
        writeln!(out, "over {pixels} of {images}{lacking}:")?;
        writeln!(out, "  {} intersection over union of ground", figure(self.ground_iou))?;
        writeln!(out, "  {} intersection over union of obstacles", figure(self.obstacle_iou))?;
        writeln!(out, "  {} F1 of ground", figure(self.f1))?;
        writeln!(out, "  {:6.2} % unclassified", self.unclassified_pct)?;
        if let Some(ms) = self.ms_median {
            writeln!(out, "  {ms:6.2} ms an image, median")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_shows_what_it_is_of_what_is_missing_as_a_dash_and_the_median_of_the_times() {
        let mut confusion = Confusion::default();
        confusion.add(OBSTACLE, Some(OBSTACLE));
        confusion.add(OBSTACLE, None);
        let report = ClassReport::new(&confusion, 1, 12, vec![3.0, 1.0, 2.0]);
        assert_eq!((report.obstacle_iou, report.ms_median), (Some(0.5), Some(2.0)));
        let text = report.to_string();
        let beginning = "over 2 pixels of 1 image, 12 images without a true one:\n       \
                         - intersection over union of ground\n   0.500 intersection";
        assert!(text.starts_with(beginning), "{text}");
        assert!(text.ends_with("   50.00 % unclassified\n    2.00 ms an image, median\n"), "{text}");
    }
}
