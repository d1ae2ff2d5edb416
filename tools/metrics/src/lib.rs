//! Figures of agreement between a classification and the ground truth.
//!
//! Begin with [`Confusion`]: it counts pixels or cells by true and predicted class, and computes intersection over
//! union, recall, precision and F1 from the counts.
//!
//! This crate has no dependencies, so that tests of any layer can use it. It reads no files and runs no methods: that
//! is the task of `rcs-eval`.
//!
//! ```
//! use rcs_metrics::Confusion;
//!
//! const GROUND: usize = 0;
//! const OBSTACLE: usize = 1;
//! let mut confusion = Confusion::<2>::default();
//! confusion.add(GROUND, Some(GROUND));
//! confusion.add(GROUND, Some(OBSTACLE));
//! confusion.add(OBSTACLE, None);
//! assert_eq!(confusion.iou(GROUND), Some(0.5));
//! assert_eq!(confusion.recall(OBSTACLE), Some(0.0));
//! assert_eq!(confusion.unclassified(), 1);
//! ```

/// Pixels or cells of `N` classes, counted by true and predicted class.
///
/// An unclassified pixel counts against the recall of its true class, and is a prediction of no class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Confusion<const N: usize> {
    /// `[true class][predicted class]`.
    counts: [[u64; N]; N],
    /// `[true class]`.
    unclassified: [u64; N],
}

impl<const N: usize> Default for Confusion<N> {
    fn default() -> Self {
        Self { counts: [[0; N]; N], unclassified: [0; N] }
    }
}

impl<const N: usize> Confusion<N> {
    /// Counts one pixel or cell; `None` if the method left it unclassified.
    ///
    /// # Panics
    /// If a class is not below `N`.
    pub fn add(&mut self, truth: usize, predicted: Option<usize>) {
        match predicted {
            Some(predicted) => self.counts[truth][predicted] += 1,
            None => self.unclassified[truth] += 1,
        }
    }

    /// Total count.
    pub fn total(&self) -> u64 {
        self.counts.iter().flatten().chain(&self.unclassified).sum()
    }

    /// Count of unclassified pixels or cells.
    pub fn unclassified(&self) -> u64 {
        self.unclassified.iter().sum()
    }

    /// Share of unclassified ones, 0 to 1; `None` if the total is 0.
    pub fn unclassified_share(&self) -> Option<f64> {
        ratio(self.unclassified(), self.total())
    }

    /// Count of a true class.
    pub fn of_class(&self, class: usize) -> u64 {
        self.counts[class].iter().sum::<u64>() + self.unclassified[class]
    }

    /// Count of a predicted class.
    pub fn predicted(&self, class: usize) -> u64 {
        self.counts.iter().map(|row| row[class]).sum()
    }

    /// Count of correct predictions of a class.
    pub fn correct(&self, class: usize) -> u64 {
        self.counts[class][class]
    }

    /// Intersection over union of a class; `None` if nothing has the class and nothing is predicted to have it.
    pub fn iou(&self, class: usize) -> Option<f64> {
        let both = self.correct(class);
        ratio(both, self.of_class(class) + self.predicted(class) - both)
    }

    /// Share of a true class that is predicted correctly; `None` if nothing has the class.
    pub fn recall(&self, class: usize) -> Option<f64> {
        ratio(self.correct(class), self.of_class(class))
    }

    /// Share of the predictions of a class that are correct; `None` if there are none.
    pub fn precision(&self, class: usize) -> Option<f64> {
        ratio(self.correct(class), self.predicted(class))
    }

    /// Harmonic mean of precision and recall; `None` if nothing has the class and nothing is predicted to have it.
    pub fn f1(&self, class: usize) -> Option<f64> {
        ratio(2 * self.correct(class), self.of_class(class) + self.predicted(class))
    }
}

fn ratio(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn confusion(counts: [(usize, Option<usize>, u64); 6]) -> Confusion<2> {
        let mut confusion = Confusion::default();
        for (truth, predicted, count) in counts {
            (0..count).for_each(|_| confusion.add(truth, predicted));
        }
        confusion
    }

    #[test]
    fn what_is_unclassified_is_missed_by_its_class_and_claimed_by_no_other() {
        let (ground, obstacle) = (0, 1);
        let confusion = confusion([
            (ground, Some(ground), 6),
            (ground, Some(obstacle), 1),
            (ground, None, 1),
            (obstacle, Some(obstacle), 9),
            (obstacle, Some(ground), 2),
            (obstacle, None, 1),
        ]);
        assert_eq!((confusion.iou(ground), confusion.iou(obstacle)), (Some(0.6), Some(9.0 / 13.0)));
        assert_eq!((confusion.f1(ground), confusion.recall(obstacle)), (Some(12.0 / 16.0), Some(0.75)));
        assert_eq!((confusion.precision(ground), confusion.precision(obstacle)), (Some(0.75), Some(0.9)));
        assert_eq!((confusion.total(), confusion.unclassified_share()), (20, Some(0.1)));
    }

    #[test]
    fn a_class_that_is_not_there_has_no_figure() {
        let mut confusion = Confusion::<2>::default();
        assert_eq!((confusion.iou(0), confusion.unclassified_share()), (None, None));
        confusion.add(1, Some(1));
        assert_eq!((confusion.iou(0), confusion.recall(0), confusion.f1(0)), (None, None, None));
        assert_eq!((confusion.iou(1), confusion.precision(0)), (Some(1.0), None));
    }

    #[test]
    fn of_more_than_two_classes_each_stands_against_all_others() {
        let mut confusion = Confusion::<3>::default();
        for (truth, predicted) in [(0, 0), (0, 1), (1, 1), (2, 1), (2, 2), (2, 2)] {
            confusion.add(truth, Some(predicted));
        }
        assert_eq!(
            [0, 1, 2].map(|class| confusion.iou(class)),
            [Some(0.5), Some(1.0 / 3.0), Some(2.0 / 3.0)]
        );
    }
}
