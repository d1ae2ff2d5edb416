//! Conversion of a point cloud to columns of points.
//!
//! The order of the cloud does not matter: its points are sorted into vertical half-planes around the sensor, and
//! within each by elevation. A tilted scanner, as on a robot on a slope, is therefore scanned along gravity like a
//! camera; the columns of the sensor itself would mix a trunk with the ground beside it.
//!
//! A column of the cloud of a depth camera holds several columns of its image. The scan examines a limited number of
//! points above each one, so of such a dense column it gets the nearest point of each small step of elevation that is not
//! of the vehicle itself; the others get the label of that point, and vote, too, unless they lie behind its surface.

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
    /// the sensor in axes of the local frame, m; `None` without range. Those nearer than `min_range_m` are of the vehicle
    /// itself.
    pub fn new(points: &[Option<[f32; 3]>], azimuth_step_rad: f32, min_range_m: f32) -> CloudColumns {
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
            result.add(column, points, min_range_m);
        }
        result
    }

    /// Adds a column, sorted by elevation, of the points of a cloud.
    fn add(&mut self, column: &[Keyed], points: &[Option<[f32; 3]>], min_range_m: f32) {
        // A point of the vehicle itself counts as farther than all others.
        let distance = |point: &ScanPoint| (point.range < min_range_m, point.range);
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
                if distance(&point.1) < distance(&self.points[last]) {
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
                let of_nearest = result.labels[first + nearest - scanned.start];
                match of_nearest {
                    _ if point.range < survey.scan.min_range_m => Label::Invalid,
                    _ if point.range > survey.scan.max_range_m => Label::TooFar,
                    Label::Ground | Label::ShortObstacle | Label::Obstacle
                        if is_behind(point, &self.points[nearest], survey) =>
                    {
                        Label::TooFar
                    }
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

/// Whether a point is seen past the edge of the surface of the nearest point of its step of elevation: it lies behind that
/// by more than a gap, and by more than one step spans on flat ground.
fn is_behind(point: &ScanPoint, nearest: &ScanPoint, survey: &Survey<'_>) -> bool {
    let behind_m = point.rho - nearest.rho;
    // Elevations on ground `h` below the sensor are -h / rho, so a step spans step · rho · rho / h.
    let height_m = -survey.ground_plane.below_origin.z as f32;
    behind_m > survey.scan.gap_m && behind_m * height_m > ELEVATION_STEP * point.rho * nearest.rho
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
        let columns = CloudColumns::new(points, 0.5_f32.to_radians(), survey().scan.min_range_m);
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

    /// A dense column of a cloud, row by row: `rho_m` says how far away each column of the image sees something at an
    /// elevation (tangent).
    fn dense_column(rho_m: impl Fn(f32) -> [f32; 4]) -> Vec<Option<[f32; 3]>> {
        let row = |step: u16| {
            let elevation = -0.6 + 0.0007 * f32::from(step);
            let seen = std::iter::zip([0.001, 0.003, 0.005, 0.004], rho_m(elevation));
            seen.map(move |(azimuth, rho): (f32, f32)| Some([rho, rho * azimuth, rho * elevation]))
        };
        (0..930).flat_map(row).collect()
    }

    /// Distance of flat ground at an elevation, m.
    fn ground_m(elevation: f32) -> f32 {
        if elevation < 0.0 { 1.2 / -elevation } else { 100.0 }
    }

    /// Labels of the points of which this holds.
    fn labels_where(points: &[Option<[f32; 3]>], is_meant: impl Fn([f32; 3]) -> bool) -> Vec<Label> {
        let pairs = std::iter::zip(points, labels_of(points));
        pairs.filter(|(point, _)| point.is_some_and(&is_meant)).map(|(_, label)| label).collect()
    }

    #[test]
    fn what_is_seen_past_the_edge_of_an_obstacle_in_a_dense_column_is_too_far_to_tell() {
        // A post 3 m ahead in the middle of flat ground and of a wall 6 m ahead, and a part of the vehicle 0.2 m ahead, all
        // in one column.
        let points = dense_column(|elevation| {
            [6.0, 3.0, 6.0, 0.2].map(|thing_m: f32| thing_m.min(ground_m(elevation)))
        });
        let of = |thing_m: f32, low_m: f32| labels_where(&points, |[x, _, z]| x == thing_m && z > low_m);
        let (post, wall, own) = (of(3.0, -1.0), of(6.0, -0.8), of(0.2, -1.0));
        assert!(post.len() > 100 && post.iter().all(|label| *label == Label::Obstacle), "{post:?}");
        assert!(wall.len() > 200 && wall.iter().all(|label| *label == Label::TooFar), "{wall:?}");
        assert!(own.len() == 930 && own.iter().all(|label| *label == Label::Invalid), "{own:?}");
    }

    #[test]
    fn what_is_seen_past_the_crest_of_a_bank_in_a_dense_column_is_too_far_to_tell() {
        // A ramp from 2 m to 5 m ahead in the middle of flat ground and of a wall 6 m ahead, all in one column.
        let points = dense_column(|elevation| {
            let beside_m = ground_m(elevation).min(6.0);
            let on_ramp_m = 1.6 / (0.2 - elevation);
            let is_ramp = elevation < 0.2 && (2.0..5.0).contains(&on_ramp_m);
            let middle_m = if is_ramp { on_ramp_m } else { beside_m };
            [beside_m, middle_m, beside_m, beside_m]
        });
        let ramp = labels_where(&points, |[x, _, z]| (2.2..4.9).contains(&x) && z > -1.19);
        let wall = labels_where(&points, |[x, _, z]| x == 6.0 && z < -0.75);
        assert!(ramp.len() > 300 && ramp.iter().all(|label| *label == Label::Ground), "{ramp:?}");
        assert!(wall.len() > 200 && wall.iter().all(|label| *label == Label::TooFar), "{wall:?}");
    }

    #[test]
    fn far_ground_in_a_dense_column_is_ground_though_one_step_spans_more_than_a_gap() {
        let points = dense_column(|elevation| [ground_m(elevation).min(29.0); 4]);
        let far = labels_where(&points, |[x, _, _]| (20.0..28.0).contains(&x));
        assert!(far.len() > 40 && far.iter().all(|label| *label == Label::Ground), "{far:?}");
    }
}
