//! Scans of a laser: ranges at evenly spaced bearings become the points of a cloud, in the frame of the scan.

use super::cloud::identity;
use super::{Conversion, Source, Unusable};
use crate::any::AnyMessage;
use crate::foxglove::packed_element_field::NumericType;
use crate::foxglove::{LaserScan, PackedElementField, PointCloud, Pose};
use prost_types::Timestamp;

pub(super) const LASER_SCAN: Conversion = Conversion {
    from: "sensor_msgs/LaserScan",
    signature: "iIsfffffff[]f[]f",
    to: CLOUD,
    convert: laser_scan,
};

/// Foxglove's message of a scan.
pub(super) const FOXGLOVE: &str = "foxglove.LaserScan";
/// What scans become.
pub(super) const CLOUD: &str = "foxglove.PointCloud";

/// A scan with more rays is refused: no scanner has as many, and their points would take 64 MiB of memory.
const MAX_RAYS: usize = 1 << 22;

/// The rays of a scan. Bearings are about z, counter-clockwise from x.
struct Rays<'a> {
    first_rad: f64,
    /// From one ray to the next; negative if the scanner turns clockwise.
    step_rad: f64,
    nearest_m: f64,
    farthest_m: f64,
    ranges_m: &'a [f64],
    /// One for each ray, or none.
    intensities: &'a [f64],
}

/// The duration of the scan is not used: the points are those of a scanner that stood at the time of the message.
fn laser_scan(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    let (first_rad, _last_rad, step_rad) = (source.cursor.f32()?, source.cursor.f32()?, source.cursor.f32()?);
    let (_ray_s, _scan_s) = (source.cursor.f32()?, source.cursor.f32()?);
    let (nearest_m, farthest_m) = (source.cursor.f32()?, source.cursor.f32()?);
    let ranges_m = numbers(source)?;
    let intensities = numbers(source)?;
    let rays = Rays {
        first_rad: first_rad.into(),
        step_rad: step_rad.into(),
        nearest_m: nearest_m.into(),
        farthest_m: farthest_m.into(),
        ranges_m: &ranges_m,
        intensities: &intensities,
    };
    rays.cloud(header.timestamp, header.frame_id, identity())
}

/// A sequence of 32-bit numbers.
fn numbers(source: &mut Source<'_>) -> Result<Vec<f64>, Unusable> {
    let count = source.cursor.length(4)?;
    check(count)?;
    (0..count).map(|_| Ok(f64::from(source.cursor.f32()?))).collect()
}

fn check(rays: usize) -> Result<(), Unusable> {
    if rays > MAX_RAYS {
        let what = "rays of the scan, at most";
        return Err(Unusable::Content { what, got: rays as u64, expected: MAX_RAYS as u64 });
    }
    Ok(())
}

/// Foxglove states the bearings of the first and the last ray, and no limits of the range.
pub(super) fn of_foxglove(scan: &LaserScan) -> Result<AnyMessage, Unusable> {
    let steps = scan.ranges.len().saturating_sub(1).max(1);
    let rays = Rays {
        first_rad: scan.start_angle,
        step_rad: (scan.end_angle - scan.start_angle) / steps as f64,
        nearest_m: 0.0,
        farthest_m: f64::INFINITY,
        ranges_m: &scan.ranges,
        intensities: &scan.intensities,
    };
    rays.cloud(scan.timestamp, scan.frame_id.clone(), scan.pose.unwrap_or_else(identity))
}

impl Rays<'_> {
    /// The points of the rays with a return: `x`, `y`, `z` (0) and, if the scan has them, `intensity`.
    fn cloud(
        &self,
        timestamp: Option<Timestamp>,
        frame_id: String,
        pose: Pose,
    ) -> Result<AnyMessage, Unusable> {
        let count = self.ranges_m.len();
        check(count)?;
        let has_intensity = count > 0 && self.intensities.len() == count;
        let names: &[&str] = if has_intensity { &["x", "y", "z", "intensity"] } else { &["x", "y", "z"] };
        let mut data = Vec::with_capacity(count * names.len() * 4);
        for (index, &range_m) in self.ranges_m.iter().enumerate() {
            if !self.is_return(range_m) {
                continue;
            }
            let (sin, cos) = libm::sincos(self.first_rad + index as f64 * self.step_rad);
            let (x, y) = ((range_m * cos) as f32, (range_m * sin) as f32);
            if !x.is_finite() || !y.is_finite() {
                continue;
            }
            data.extend([x, y, 0.0].into_iter().flat_map(f32::to_le_bytes));
            if has_intensity {
                data.extend((self.intensities[index] as f32).to_le_bytes());
            }
        }
        let field = |(index, name): (usize, &&str)| PackedElementField {
            name: (*name).to_owned(),
            offset: 4 * index as u32,
            r#type: NumericType::Float32.into(),
        };
        Ok(AnyMessage::new(PointCloud {
            timestamp,
            frame_id,
            pose: Some(pose),
            point_stride: 4 * names.len() as u32,
            fields: names.iter().enumerate().map(field).collect(),
            data: data.into(),
        }))
    }

    /// Whether a ray hit something. Drivers state no return as NaN, infinity, 0, or a range outside of the limits.
    /// Limits that leave no range between them are not set.
    fn is_return(&self, range_m: f64) -> bool {
        let has_limits = self.farthest_m > self.nearest_m;
        let is_within = !has_limits || (self.nearest_m..=self.farthest_m).contains(&range_m);
        range_m > 0.0 && range_m.is_finite() && is_within
    }
}
