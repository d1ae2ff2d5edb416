//! How well ground is told from obstacles, pixel by pixel: the figures of `ocu eval color` and `ocu eval classify`.

use serde::Serialize;
use std::io::Write;

/// What a method says of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Said {
    Ground,
    Obstacle,
    /// It does not know.
    Unclassified,
}

/// Pixels by what they are and what was said of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Confusion {
    /// `[is obstacle, is ground][said obstacle, said ground, unclassified]`.
    counts: [[u64; 3]; 2],
}

/// The figures, as `--json` prints them; null where there is nothing of the class, and where nothing was timed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Report {
    ground_iou: Option<f64>,
    obstacle_iou: Option<f64>,
    f1: Option<f64>,
    unclassified_pct: f64,
    ms_median: Option<f64>,
}

impl Confusion {
    /// Counts a pixel.
    pub(super) fn add(&mut self, is_ground: bool, said: Said) {
        let said = match said {
            Said::Obstacle => 0,
            Said::Ground => 1,
            Said::Unclassified => 2,
        };
        self.counts[usize::from(is_ground)][said] += 1;
    }

    /// How many pixels were counted.
    pub(super) fn total(&self) -> u64 {
        self.counts.iter().flatten().sum()
    }

    /// The figures; `times_ms` are in any order.
    pub(super) fn report(&self, mut times_ms: Vec<f64>) -> Report {
        times_ms.sort_by(f64::total_cmp);
        let class = |is: usize| {
            let (both, [other, this]) = (self.counts[is][is], [self.counts[1 - is], self.counts[is]]);
            (both, this.iter().sum::<u64>() - both, other[is])
        };
        let ratio = |part: u64, whole: u64| (whole > 0).then(|| part as f64 / whole as f64);
        let iou = |is: usize| {
            let (both, missed, wrong) = class(is);
            ratio(both, both + missed + wrong)
        };
        let (both, missed, wrong) = class(1);
        let unclassified = self.counts[0][2] + self.counts[1][2];
        Report {
            ground_iou: iou(1),
            obstacle_iou: iou(0),
            f1: ratio(2 * both, 2 * both + missed + wrong),
            unclassified_pct: 100.0 * ratio(unclassified, self.total()).unwrap_or(0.0),
            ms_median: times_ms.get(times_ms.len() / 2).copied(),
        }
    }
}

impl Report {
    /// Prints the figures.
    pub(super) fn print(&self, json: bool, out: &mut dyn Write) -> anyhow::Result<()> {
        if json {
            serde_json::to_writer_pretty(&mut *out, self)?;
            writeln!(out)?;
            return Ok(());
        }
        let figure = |value: Option<f64>| value.map_or("     -".to_owned(), |value| format!("{value:6.3}"));
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
    fn what_is_unclassified_is_missed_by_both_classes() {
        let mut confusion = Confusion::default();
        for (is_ground, said, count) in [
            (true, Said::Ground, 6),
            (true, Said::Obstacle, 1),
            (true, Said::Unclassified, 1),
            (false, Said::Obstacle, 9),
            (false, Said::Ground, 2),
            (false, Said::Unclassified, 1),
        ] {
            (0..count).for_each(|_| confusion.add(is_ground, said));
        }
        let report = confusion.report(vec![3.0, 1.0, 2.0]);
        assert_eq!((report.ground_iou, report.obstacle_iou), (Some(0.6), Some(9.0 / 13.0)));
        assert_eq!(
            (report.f1, report.unclassified_pct, report.ms_median),
            (Some(12.0 / 16.0), 10.0, Some(2.0))
        );
    }

    #[test]
    fn a_class_that_is_not_there_has_no_figure() {
        let mut confusion = Confusion::default();
        confusion.add(false, Said::Obstacle);
        let report = confusion.report(Vec::new());
        assert_eq!((report.ground_iou, report.obstacle_iou, report.f1), (None, Some(1.0), None));
    }
}
