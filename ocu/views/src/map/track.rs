//! Tracks in the plane of the map: transformed, or aligned with another track where no transform exists.

use rcs_geom::{DVec3, Enu, Geodetic, Pose};
use rcs_msg::Stamp;
use rcs_runtime::source::Track;

/// Frame of geodetic tracks.
pub(super) const WGS84: &str = "wgs84";
/// Length of the first part of a track that is used for alignment, m.
pub(super) const ALIGN_LENGTH_M: f64 = 40.0;

/// A track in the plane of the map.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Placed {
    /// Times in ascending order.
    pub(super) stamps: Vec<Stamp>,
    /// x and y, m, and yaw, rad (NaN where unknown), for each time.
    pub(super) points: Vec<[f64; 3]>,
}

/// A rotation and a translation in the plane that align one track with another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Alignment {
    /// Rotation, rad.
    pub(super) yaw_rad: f64,
    /// Translation after the rotation, m.
    pub(super) translation_m: [f64; 2],
    /// Root mean square distance of the aligned part, m.
    pub(super) rms_m: f64,
}

impl Alignment {
    fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        [cos * x - sin * y + self.translation_m[0], sin * x + cos * y + self.translation_m[1]]
    }
}

/// Local east-north-up frame at the first fix of a geodetic track.
pub(super) fn local_enu(track: &Track) -> Option<Enu> {
    let [longitude, latitude, altitude, _] =
        *track.points.iter().find(|p| p[..3].iter().all(|v| v.is_finite()))?;
    Geodetic::new(latitude, longitude, altitude).ok().map(Enu::new)
}

impl Placed {
    /// Transforms a track into the map's frame; a geodetic one through `enu` first.
    pub(super) fn new(track: &Track, enu: Option<&Enu>, map_from_track: &Pose) -> Self {
        let mut placed = Self::default();
        let yaw = map_from_track.yaw();
        for (stamp, &[a, b, c, heading]) in track.stamps.iter().zip(&track.points) {
            let point = match enu {
                Some(enu) => match Geodetic::new(b, a, c) {
                    Ok(place) => enu.enu_from_geodetic(&place),
                    Err(_) => continue,
                },
                None => DVec3::new(a, b, c),
            };
            let point = *map_from_track * point;
            if point.is_finite() {
                placed.stamps.push(*stamp);
                placed.points.push([point.x, point.y, heading + yaw]);
            }
        }
        placed
    }

    /// Interpolated position and yaw at a time; `None` before the first point, and the last point after the end.
    pub(super) fn at(&self, time: Stamp) -> Option<[f64; 3]> {
        let after = self.stamps.partition_point(|stamp| *stamp <= time);
        let before = after.checked_sub(1)?;
        let (from, to) = (self.points[before], *self.points.get(after).unwrap_or(&self.points[before]));
        let span = self.stamps.get(after).map_or(0.0, |stamp| stamp.seconds_since(self.stamps[before]));
        let part = if span > 0.0 { time.seconds_since(self.stamps[before]) / span } else { 0.0 };
        let between = |a: f64, b: f64| a + (b - a) * part;
        let yaw = if from[2].is_nan() { self.course(before) } else { from[2] };
        Some([between(from[0], to[0]), between(from[1], to[1]), yaw])
    }

    /// Direction of motion at a point: to the next point at half a metre distance, otherwise from the last one.
    fn course(&self, index: usize) -> f64 {
        let here = self.points[index];
        let far = |p: &&[f64; 3]| (p[0] - here[0]).hypot(p[1] - here[1]) > 0.5;
        let ahead = self.points[index..].iter().take(500).find(far);
        let behind = self.points[..index].iter().rev().take(500).find(far);
        match (ahead, behind) {
            (Some(p), _) => (p[1] - here[1]).atan2(p[0] - here[0]),
            (None, Some(p)) => (here[1] - p[1]).atan2(here[0] - p[0]),
            (None, None) => f64::NAN,
        }
    }

    /// The rotation and translation that align the first part of this track with `reference` by least squares. `None`
    /// if they have no time in common, or hardly move.
    pub(super) fn align(&self, reference: &Placed) -> Option<Alignment> {
        let first = *self.stamps.first()?.max(reference.stamps.first()?);
        let last = *self.stamps.last()?.min(reference.stamps.last()?);
        let mut pairs: Vec<([f64; 2], [f64; 2])> = Vec::new();
        let mut length_m = 0.0;
        for (stamp, point) in self.stamps.iter().zip(&self.points) {
            if *stamp < first || *stamp > last {
                continue;
            }
            let Some([x, y, _]) = reference.at(*stamp) else { continue };
            if let Some(([last_x, last_y], _)) = pairs.last() {
                length_m += f64::hypot(x - last_x, y - last_y);
            }
            pairs.push(([x, y], [point[0], point[1]]));
            if length_m > ALIGN_LENGTH_M {
                break;
            }
        }
        if pairs.len() < 3 || length_m < 1.0 {
            return None;
        }
        let n = pairs.len() as f64;
        let (mut to, mut from) = ([0.0; 2], [0.0; 2]);
        for (a, b) in &pairs {
            for axis in 0..2 {
                to[axis] += a[axis] / n;
                from[axis] += b[axis] / n;
            }
        }
        let (mut cross, mut dot) = (0.0_f64, 0.0_f64);
        for (a, b) in &pairs {
            let (a, b) = ([a[0] - to[0], a[1] - to[1]], [b[0] - from[0], b[1] - from[1]]);
            cross += b[0] * a[1] - b[1] * a[0];
            dot += b[0] * a[0] + b[1] * a[1];
        }
        let yaw_rad = cross.atan2(dot);
        let turned = Alignment { yaw_rad, translation_m: [0.0; 2], rms_m: 0.0 }.apply(from);
        let mut alignment =
            Alignment { yaw_rad, translation_m: [to[0] - turned[0], to[1] - turned[1]], rms_m: 0.0 };
        let squares = pairs.iter().map(|(a, b)| {
            let b = alignment.apply(*b);
            (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
        });
        alignment.rms_m = (squares.sum::<f64>() / n).sqrt();
        Some(alignment)
    }

    /// The track after an alignment.
    pub(super) fn aligned(mut self, alignment: &Alignment) -> Self {
        for point in &mut self.points {
            let [x, y] = alignment.apply([point[0], point[1]]);
            *point = [x, y, point[2] + alignment.yaw_rad];
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(count: usize, rotation_rad: f64, translation: [f64; 2]) -> Track {
        let (sin, cos) = rotation_rad.sin_cos();
        let point = |i: usize| {
            let t = i as f64 * 0.1;
            let (x, y) = (t, 5.0 * (t / 7.0).sin());
            [cos * x - sin * y + translation[0], sin * x + cos * y + translation[1], 0.0, f64::NAN]
        };
        Track {
            stamps: (0..count).map(|i| Stamp(i as u64 * 100_000_000)).collect(),
            points: (0..count).map(point).collect(),
            ..Track::default()
        }
    }

    #[test]
    fn an_alignment_undoes_a_turn_and_a_shift() {
        let reference = Placed::new(&curve(1000, 0.0, [0.0; 2]), None, &Pose::IDENTITY);
        let moved = Placed::new(&curve(1000, 1.1, [30.0, -4.0]), None, &Pose::IDENTITY);
        let alignment = moved.align(&reference).unwrap();
        assert!((alignment.yaw_rad + 1.1).abs() < 1e-9 && alignment.rms_m < 1e-9);
        let back = moved.aligned(&alignment);
        let worst = back
            .points
            .iter()
            .zip(&reference.points)
            .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
            .fold(0.0, f64::max);
        assert!(worst < 1e-6, "{worst}");
    }

    #[test]
    fn tracks_that_share_no_time_or_stand_still_are_not_aligned() {
        let reference = Placed::new(&curve(1000, 0.0, [0.0; 2]), None, &Pose::IDENTITY);
        let mut later = reference.clone();
        later.stamps.iter_mut().for_each(|stamp| *stamp = stamp.after_ns(1_000_000_000_000));
        assert_eq!(later.align(&reference), None);
        let standing = Placed { points: vec![[1.0, 1.0, 0.0]; 1000], ..reference.clone() };
        assert_eq!(reference.align(&standing), None);
        assert_eq!(Placed::default().align(&reference), None);
    }

    #[test]
    fn between_two_points_a_track_is_on_the_line_and_looks_where_it_goes() {
        let track = Placed {
            stamps: vec![Stamp(0), Stamp(10), Stamp(20)],
            points: vec![[0.0, 0.0, f64::NAN], [0.0, 2.0, f64::NAN], [0.0, 4.0, f64::NAN]],
        };
        let [x, y, yaw] = track.at(Stamp(5)).unwrap();
        assert!(x == 0.0 && y == 1.0 && (yaw - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(track.at(Stamp(99)).map(|p| p[1]), Some(4.0));
        assert_eq!(Placed::default().at(Stamp(5)), None);
    }

    #[test]
    fn a_degree_of_latitude_is_111_km_to_the_north() {
        let track = Track {
            frame_id: WGS84.into(),
            stamps: vec![Stamp(0), Stamp(1)],
            points: vec![[8.0, 48.0, 100.0, f64::NAN], [8.0, 48.001, 100.0, f64::NAN]],
            ..Track::default()
        };
        let enu = local_enu(&track).unwrap();
        let placed = Placed::new(&track, Some(&enu), &Pose::IDENTITY);
        assert!(placed.points[0][0].abs() < 1e-6 && (placed.points[1][1] - 111.2).abs() < 0.3);
    }
}
