//! Conversion of a point cloud to columns of points.
//!
//! The order of the cloud does not matter: its points are sorted into vertical half-planes around the sensor, and
//! within each by elevation. A tilted scanner, as on a robot on a slope, is therefore scanned along gravity like a
//! camera; the columns of the sensor itself would mix a trunk with the ground beside it.
//!
//! A column of the cloud of a depth camera holds several columns of its image. The scan examines a limited number of
//! points above each one, so of such a dense column it gets the nearest point of each small step of elevation; the
//! others get the label of that point, and vote, too.

use crate::columns::{Strip, Survey};
use crate::scan::{LOOK_AHEAD, Label, ScanPoint};
use std::f32::consts::TAU;
use std::ops::Range;

/// Number of columns that are processed together.
const STRIP_COLUMNS: usize = 16;
/// Step of elevation (tangent) of a dense column of which one point is scanned: about a row of a depth image.
const ELEVATION_STEP: f32 = 0.002;

/// The points of a cloud, sorted into columns.
#[derive(Clone, Debug, Default)]
pub struct CloudColumns {
    /// Index of each point in the cloud, column by column: first the points that are scanned, from the lowest ray to the
    /// highest, then the others.
    order: Vec<u32>,
    /// The points in that order.
    points: Vec<ScanPoint>,
    columns: Vec<Column>,
}

/// A column, by indices into the points.
#[derive(Clone, Debug)]
struct Column {
    /// The points that are scanned.
    scanned: Range<usize>,
    /// For each of the points that follow them, the scanned point of its step of elevation.
    nearest: Vec<usize>,
}

/// A point of a cloud before it is sorted: its column, elevation (tangent) and index.
type Keyed = (u32, f32, u32);

impl CloudColumns {
    /// Sorts points into columns of width `azimuth_step_rad`, which must be positive. Points are x, y, z relative to
    /// the sensor in axes of the local frame, m; `None` without range.
    pub fn new(points: &[Option<[f32; 3]>], azimuth_step_rad: f32) -> CloudColumns {
        let columns = (TAU / azimuth_step_rad).ceil().clamp(1.0, 1e5) as usize;
        let mut keyed: Vec<Keyed> = Vec::with_capacity(points.len());
        for (number, point) in points.iter().enumerate() {
            let Some([x, y, z]) = *point else { continue };
            let azimuth = libm::atan2f(y, x);
            let turn = if azimuth < 0.0 { azimuth + TAU } else { azimuth };
            let column = ((turn / TAU * columns as f32) as usize).min(columns - 1);
            let elevation = z / libm::sqrtf(x * x + y * y).max(1e-6);
            keyed.push((column as u32, elevation, number as u32));
        }
        keyed.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
        let mut result = CloudColumns::default();
        for column in keyed.chunk_by(|a, b| a.0 == b.0) {
            result.add(column, points);
        }
        result
    }

    /// Adds a column, sorted by elevation, of the points of a cloud.
    fn add(&mut self, column: &[Keyed], points: &[Option<[f32; 3]>]) {
        let start = self.points.len();
        let is_dense = column.len() > LOOK_AHEAD;
        let mut lowest = f32::NEG_INFINITY;
        // Those that are not scanned, and the scanned ones of their steps.
        let (mut others, mut nearest) = (Vec::new(), Vec::new());
        for &(_, elevation, number) in column {
            let [x, y, z] = points[number as usize].unwrap_or_default();
            let mut point = (number, ScanPoint::at(x, y, z));
            if is_dense && elevation - lowest < ELEVATION_STEP {
                let last = self.points.len() - 1;
                if point.1.range < self.points[last].range {
                    std::mem::swap(&mut point.0, &mut self.order[last]);
                    std::mem::swap(&mut point.1, &mut self.points[last]);
                }
                others.push(point);
                nearest.push(last);
            } else {
                lowest = elevation;
                self.order.push(point.0);
                self.points.push(point.1);
            }
        }
        self.columns.push(Column { scanned: start..self.points.len(), nearest });
        self.order.extend(others.iter().map(|other| other.0));
        self.points.extend(others.iter().map(|other| other.1));
    }

    /// Number of strips.
    pub fn strips(&self) -> usize {
        self.columns.len().div_ceil(STRIP_COLUMNS)
    }

    /// Labels one strip of columns.
    pub fn scan_strip(&self, strip: usize, survey: &Survey<'_>) -> Strip {
        let first = strip * STRIP_COLUMNS;
        let columns = &self.columns[first..(first + STRIP_COLUMNS).min(self.columns.len())];
        let points: usize = columns.iter().map(|column| column.scanned.len() + column.nearest.len()).sum();
        let mut result = Strip::with_capacity(points);
        for Column { scanned, nearest } in columns {
            let first = result.labels.len();
            result.add_column(&self.points[scanned.clone()], &[], survey);
            let others = &self.points[scanned.end..scanned.end + nearest.len()];
            let label = |(point, &nearest): (&ScanPoint, &usize)| {
                let behind_m = point.rho - self.points[nearest].rho;
                match result.labels[first + nearest - scanned.start] {
                    // It is seen past the edge of the obstacle.
                    Label::Obstacle if behind_m > survey.scan.gap_m => Label::TooFar,
                    label => label,
                }
            };
            let labels: Vec<Label> = others.iter().zip(nearest).map(label).collect();
            result.add_labelled(others, &labels, &survey.placement);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::{GroundPlane, Placement};
    use crate::depth_image::{DepthImage, Rays, label_image, scan_strip};
    use crate::scan::ScanParams;
    use glam::{DVec2, DVec3, Vec3};
    use rcs_geom::{PinholeCamera, Pose};
    use rcs_sense::CELL_SIZE_M;

    const SENSOR: DVec3 = DVec3::new(0.0, 0.0, 1.2);

    fn survey() -> Survey<'static> {
        Survey {
            ground_plane: GroundPlane { below_origin: -SENSOR, up: DVec3::Z, wheels_m: 0.5 },
            placement: Placement { sensor: SENSOR, cell_size_m: CELL_SIZE_M },
            scan: ScanParams::default(),
            negative: None,
            known: None,
        }
    }

    fn labels_of(points: &[Option<[f32; 3]>]) -> Vec<Label> {
        let columns = CloudColumns::new(points, 0.5_f32.to_radians());
        let strips: Vec<Strip> =
            (0..columns.strips()).map(|strip| columns.scan_strip(strip, &survey())).collect();
        let counted: u64 = strips.iter().flat_map(|strip| strip.counts).sum();
        assert_eq!(counted, points.iter().flatten().count() as u64, "each point counts once");
        columns.labels(&strips, points.len())
    }

    #[test]
    fn a_ramp_is_ground_in_the_dense_cloud_of_a_depth_camera_as_in_its_image() {
        let camera = PinholeCamera::from_horizontal_fov([640, 480], 1.1).unwrap();
        let mount = Pose::from_rpy(SENSOR, 0.0, 10_f64.to_radians(), 0.0) * Pose::body_from_optical();
        let turn = mount.rotation_matrix();
        // Flat ground, and a ramp of 10° from 2 m on.
        let rise = libm::tan(10_f64.to_radians());
        let (mut depths, mut points) = (Vec::new(), Vec::new());
        for row in 0..camera.height {
            for column in 0..camera.width {
                let ray = turn * camera.unproject(DVec2::new(column.into(), row.into())).unwrap();
                let on_flat = -SENSOR.z / ray.z;
                let on_ramp = (SENSOR.z + 2.0 * rise) / (rise * ray.x - ray.z);
                let depth_m = if ray.z < 0.0 && on_flat * ray.x < 2.0 { on_flat } else { on_ramp };
                let is_seen = (0.0..100.0).contains(&depth_m);
                depths.extend_from_slice(&(if is_seen { depth_m as f32 } else { 0.0 }).to_le_bytes());
                points.push(is_seen.then(|| (ray * depth_m).as_vec3().to_array()));
            }
        }
        let image = DepthImage::new([640, 480], 640 * 4, "32FC1", 1.0, &depths).unwrap();
        let rays = Rays::new(&camera);
        let strips: Vec<Strip> =
            (0..rays.strips()).map(|strip| scan_strip(&image, &[], &rays, strip, turn, &survey())).collect();
        let of_image = label_image(&strips, &image);
        let mut near = 0;
        for ((point, of_image), of_cloud) in points.iter().zip(of_image).zip(labels_of(&points)) {
            if let Some(point) = point.map(Vec3::from_array).filter(|point| point.length() < 6.0) {
                assert_eq!((of_image, of_cloud), (Label::Ground as u8, Label::Ground), "at {point}");
                near += 1;
            }
        }
        assert!(near > 50_000, "{near} points");
    }

    #[test]
    fn what_is_seen_past_the_edge_of_an_obstacle_in_a_dense_column_is_too_far_to_tell() {
        // A post 3 m ahead in the middle of flat ground and of a wall 6 m ahead, all in one column.
        let mut points = Vec::new();
        for step in 0..930_u16 {
            let elevation = -0.6 + 0.0007 * f32::from(step);
            let ground_m = if elevation < 0.0 { 1.2 / -elevation } else { 100.0 };
            for (azimuth, thing_m) in [(0.001, 6.0), (0.003, 3.0), (0.005, 6.0_f32)] {
                let rho = ground_m.min(thing_m);
                points.push(Some([rho, rho * azimuth, rho * elevation]));
            }
        }
        let labels = labels_of(&points);
        let of = |thing_m: f32, low_m: f32| {
            let pairs = points.iter().flatten().zip(&labels);
            let there = pairs.filter(|(point, _)| point[0] == thing_m && point[2] > low_m);
            there.map(|(_, label)| *label).collect::<Vec<Label>>()
        };
        let (post, wall) = (of(3.0, -1.0), of(6.0, -0.8));
        assert!(post.len() > 100 && post.iter().all(|label| *label == Label::Obstacle), "{post:?}");
        assert!(wall.len() > 200 && wall.iter().all(|label| *label == Label::TooFar), "{wall:?}");
    }
}
