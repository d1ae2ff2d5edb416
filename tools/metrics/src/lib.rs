//! How well a classification agrees with the ground truth.
//!
//! - [`Confusion`] counts pixels or cells by their true and their predicted class. Intersection over union, recall,
//!   precision and F1 follow from the counts.
//!
//! This crate has no dependencies, so that the tests of any layer may use it. Reading files and running methods on them
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
/// One that was not classified is missed by its class and claimed by no other.
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
    /// Counts one pixel or cell; `None` is one that the method did not classify.
    ///
    /// # Panics
    /// Where a class is not below `N`.
    pub fn add(&mut self, truth: usize, predicted: Option<usize>) {
        match predicted {
            Some(predicted) => self.counts[truth][predicted] += 1,
            None => self.unclassified[truth] += 1,
        }
    }

    /// How many were counted.
    pub fn total(&self) -> u64 {
        self.counts.iter().flatten().chain(&self.unclassified).sum()
    }

    /// How many were not classified.
    pub fn unclassified(&self) -> u64 {
        self.unclassified.iter().sum()
    }

    /// Share of those that were not classified, 0 to 1; `None` where nothing was counted.
    pub fn unclassified_share(&self) -> Option<f64> {
        ratio(self.unclassified(), self.total())
    }

    /// How many are of a class.
    pub fn of_class(&self, class: usize) -> u64 {
        self.counts[class].iter().sum::<u64>() + self.unclassified[class]
    }

    /// How many were predicted to be of a class.
    pub fn predicted(&self, class: usize) -> u64 {
        self.counts.iter().map(|row| row[class]).sum()
    }

    /// How many of a class were predicted to be so.
    pub fn correct(&self, class: usize) -> u64 {
        self.counts[class][class]
    }

    /// Intersection over union of a class; `None` where nothing is of the class or predicted to be.
    pub fn iou(&self, class: usize) -> Option<f64> {
        let both = self.correct(class);
        ratio(both, self.of_class(class) + self.predicted(class) - both)
    }

    /// Share of a class that was predicted to be so; `None` where nothing is of the class.
    pub fn recall(&self, class: usize) -> Option<f64> {
        ratio(self.correct(class), self.of_class(class))
    }

    /// Share of what was predicted to be of a class that is so; `None` where nothing was predicted.
    pub fn precision(&self, class: usize) -> Option<f64> {
        ratio(self.correct(class), self.predicted(class))
    }

    /// Harmonic mean of precision and recall; `None` where nothing is of the class or predicted to be.
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
