//! Conversion of a point cloud to columns of points.
//!
//! The order of the cloud does not matter: its points are sorted into vertical half-planes around the sensor, and
//! within each by elevation. A tilted scanner, as on a robot on a slope, is therefore scanned along gravity like a
//! camera; the columns of the sensor itself would mix a trunk with the ground beside it.

use crate::columns::{Strip, Survey};
use crate::scan::{Label, ScanPoint};
use std::f32::consts::TAU;

/// Number of columns that are processed together.
const STRIP_COLUMNS: usize = 16;

/// The points of a cloud, sorted into columns.
#[derive(Clone, Debug)]
pub struct CloudColumns {
    /// Index of each point in the cloud, column by column, each from the lowest ray to the highest.
    order: Vec<u32>,
    /// The points in that order.
    points: Vec<ScanPoint>,
    /// Index of the first point of each column in both, and the number of points at the end.
    starts: Vec<usize>,
}

impl CloudColumns {
    /// Sorts points into columns of width `azimuth_step_rad`, which must be positive. Points are x, y, z relative to
    /// the sensor in axes of the local frame, m; `None` without range.
    pub fn new(points: &[Option<[f32; 3]>], azimuth_step_rad: f32) -> CloudColumns {
        let columns = (TAU / azimuth_step_rad).ceil().clamp(1.0, 1e5) as usize;
        let mut keyed: Vec<(u32, f32, u32)> = Vec::with_capacity(points.len());
        for (number, point) in points.iter().enumerate() {
            let Some([x, y, z]) = *point else { continue };
            let azimuth = libm::atan2f(y, x);
            let turn = if azimuth < 0.0 { azimuth + TAU } else { azimuth };
            let column = ((turn / TAU * columns as f32) as usize).min(columns - 1);
            let elevation = z / libm::sqrtf(x * x + y * y).max(1e-6);
            keyed.push((column as u32, elevation, number as u32));
        }
        keyed.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
        let mut result = CloudColumns { order: Vec::new(), points: Vec::new(), starts: Vec::new() };
        let mut last = None;
        for (column, _, number) in keyed {
            if last != Some(column) {
                result.starts.push(result.order.len());
                last = Some(column);
            }
            let [x, y, z] = points[number as usize].unwrap_or_default();
            result.order.push(number);
            result.points.push(ScanPoint::at(x, y, z));
        }
        result.starts.push(result.order.len());
        result
    }

    /// Number of strips.
    pub fn strips(&self) -> usize {
        (self.starts.len() - 1).div_ceil(STRIP_COLUMNS)
    }

    /// Labels one strip of columns.
    pub fn scan_strip(&self, strip: usize, survey: &Survey<'_>) -> Strip {
        let first = strip * STRIP_COLUMNS;
        let end = (first + STRIP_COLUMNS).min(self.starts.len() - 1);
        let mut result = Strip::with_capacity(self.starts[end] - self.starts[first]);
        for column in first..end {
            let points = &self.points[self.starts[column]..self.starts[column + 1]];
            result.add_column(points, &[], survey);
        }
        result
    }

    /// Labels from all strips, one for each of the cloud's `count` points.
    pub fn labels(&self, strips: &[Strip], count: usize) -> Vec<Label> {
        let mut labels = vec![Label::Invalid; count];
        for (&number, &label) in self.order.iter().zip(strips.iter().flat_map(|strip| &strip.labels)) {
            labels[number as usize] = label;
        }
        labels
    }
}
