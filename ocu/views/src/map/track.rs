//! Tracks in the plane of the map: their parts that are visible, implausible positions in them, and their alignment
//! with another track where no transform exists.
//!
//! Nothing here reads a whole track in every pass: tracks grow for hours, and the cost of a frame must not.

use crate::canvas::Viewport;
use crate::clip::{Near, is_place};
use egui::Rect;
use rcs_geom::{DMat3, DVec2, DVec3, Pose};
use rcs_msg::Stamp;
use rcs_runtime::source::{Part, Series, TrackBounds, TrackPoint};
use std::ops::{ControlFlow, Range};

/// Length of the first part of a track that is used for alignment, m.
pub(super) const ALIGN_LENGTH_M: f64 = 40.0;
/// Parts of a track that are smaller than this are one position for the alignment, m.
const AT_REST_M: f64 = 0.05;
/// Greatest root mean square distance of an aligned part, relative to its length: beyond it, the tracks have nothing in
/// common, or one of them jumps.
const MOST_OFF: f64 = 0.5;
/// Greatest number of parts that are drawn of a track, of its past and its future each.
const MOST_PARTS: usize = 2_000;
/// Number of parts from which the extent of a track is determined.
const FIT_PARTS: usize = 512;
/// A part that is smaller than this is drawn as one line, screen points.
const FINE: f64 = 1.5;

/// Transforms positions and boxes of a track into the plane of the map.
#[derive(Clone, Copy)]
pub(super) struct Plane {
    map_from_track: Pose,
    /// Absolute values of the rotation matrix.
    spread: DMat3,
}

impl Plane {
    pub(super) fn new(map_from_track: Pose) -> Self {
        let rotation = map_from_track.rotation_matrix();
        let spread = DMat3::from_cols(rotation.x_axis.abs(), rotation.y_axis.abs(), rotation.z_axis.abs());
        Self { map_from_track, spread }
    }

    /// A position on the map.
    pub(super) fn point(&self, position_m: [f64; 3]) -> [f64; 2] {
        let p = self.map_from_track * DVec3::from_array(position_m);
        [p.x, p.y]
    }

    /// The box around a box, on the map.
    fn bounds(&self, bounds: &TrackBounds) -> (DVec2, DVec2) {
        let (min, max) = (DVec3::from_array(bounds.min_m), DVec3::from_array(bounds.max_m));
        let middle = (self.map_from_track * (min + (max - min) / 2.0)).truncate();
        let half = (self.spread * ((max - min) / 2.0)).truncate();
        (middle - half, middle + half)
    }
}

/// The line of a part of a track, with as many points as the canvas needs.
pub(super) fn line(
    points: &Series<TrackPoint>,
    range: Range<usize>,
    plane: &Plane,
    viewport: Viewport,
    canvas: Rect,
) -> Vec<[f64; 2]> {
    let (low, high) = viewport.bounds(canvas);
    let is_fine = |part: &Part<TrackPoint>| {
        let (min, max) = plane.bounds(&part.summary);
        let is_outside = max.x < low[0] || min.x > high[0] || max.y < low[1] || min.y > high[1];
        is_outside || (max - min).max_element() * viewport.scale <= FINE
    };
    let mut line = Vec::new();
    for part in points.parts(range, MOST_PARTS, is_fine) {
        line.push(plane.point(part.first.position_m));
        if !part.is_record() {
            line.push(plane.point(part.last.position_m));
        }
    }
    line
}

/// Direction of motion at a record of a track: to the next position at half a metre distance, otherwise from the last
/// one; NaN if there is none.
pub(super) fn course(points: &Series<TrackPoint>, index: usize) -> f64 {
    let Some(here) = points.get(index) else { return f64::NAN };
    let (mut ahead, mut behind) = (None, None);
    let away = |point: &TrackPoint| {
        let [x, y] = [0, 1].map(|axis| point.position_m[axis] - here.position_m[axis]);
        (x.hypot(y) > 0.5).then_some([x, y])
    };
    points.each(index..index + 500, |point| ahead = ahead.or_else(|| away(point)));
    points.each(index.saturating_sub(500)..index, |point| behind = away(point).or(behind));
    match (ahead, behind) {
        (Some([x, y]), _) => y.atan2(x),
        (None, Some([x, y])) => (-y).atan2(-x),
        (None, None) => f64::NAN,
    }
}

/// Distance and time of the position of a track that is nearest to a point of the map, if any is within `reach_m`. The
/// summaries of its parts leave out what is far away.
pub(super) fn nearest(
    points: &Series<TrackPoint>,
    plane: &Plane,
    point: [f64; 2],
    reach_m: f64,
) -> Option<(f64, Stamp)> {
    let point = DVec2::from_array(point);
    let is_far = |part: &Part<TrackPoint>| {
        let (min, max) = plane.bounds(&part.summary);
        (point - point.clamp(min, max)).length() > reach_m
    };
    let distance = |record: &TrackPoint| (DVec2::from_array(plane.point(record.position_m)) - point).length();
    let parts = points.parts(0..points.len(), MOST_PARTS, is_far);
    let near = parts.iter().filter(|part| !is_far(part)).flat_map(|part| [&part.first, &part.last]);
    let found = near.map(|record| (distance(record), record.stamp));
    found.filter(|(distance, _)| *distance <= reach_m).min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Interpolated position of a track at a time; `None` before its first record, and the last one after its end.
fn at(points: &Series<TrackPoint>, time: Stamp) -> Option<[f64; 2]> {
    let after = points.count_until(time);
    let before = points.get(after.checked_sub(1)?)?;
    let next = points.get(after).unwrap_or(before);
    let span = next.stamp.seconds_since(before.stamp);
    let part = if span > 0.0 { time.seconds_since(before.stamp) / span } else { 0.0 };
    Some([0, 1].map(|axis| {
        let (from, to) = (before.position_m[axis], next.position_m[axis]);
        from + (to - from) * part
    }))
}

/// Which positions of a track are plausible, kept up to date as it grows.
#[derive(Clone, Debug, Default)]
pub(super) struct Judged {
    points: Series<TrackPoint>,
    /// Bounds of the plausible positions, in the track's frame.
    near: Option<Near>,
    /// Number of records from which `near` was derived.
    known: usize,
    /// Number of records that have been judged.
    seen: usize,
    /// Number of implausible ones.
    pub(super) far: usize,
}

impl Judged {
    /// Judges what has been appended. All records are judged again when a quarter was added, so that the cost of a
    /// record is the same however long the track is.
    pub(super) fn update(&mut self, points: &Series<TrackPoint>) {
        if !self.points.same(points) || points.len() < self.seen {
            *self = Self::default();
        }
        self.points = points.clone();
        if self.near.is_none() || points.len() > self.known + self.known / 4 + 64 {
            let sample = points.sample(Near::SAMPLE);
            let near = Near::of(sample.iter().map(|point| [point.position_m[0], point.position_m[1]]));
            (self.near, self.known, self.seen, self.far) = (Some(near), points.len(), 0, 0);
        }
        let Some(near) = self.near else { return };
        let inside = |bounds: &TrackBounds| {
            [bounds.min_m, bounds.max_m].iter().all(|corner| near.has([corner[0], corner[1]]))
        };
        points.walk(
            self.seen..points.len(),
            |part| inside(&part.summary),
            |part| {
                // Bounds leave out what is not a number.
                self.far += usize::from(part.is_record() && !inside(&part.summary));
                ControlFlow::Continue(())
            },
        );
        self.seen = points.len();
    }

    /// The extent of the plausible positions on the map.
    pub(super) fn extent(&self, plane: &Plane) -> Option<([f64; 2], [f64; 2])> {
        let near = self.near?;
        let mut extent: Option<(DVec2, DVec2)> = None;
        let mut add = |(min, max): (DVec2, DVec2)| {
            if is_place(&[min.x, min.y, max.x, max.y]) {
                let (low, high) = extent.unwrap_or((min, max));
                extent = Some((low.min(min), high.max(max)));
            }
        };
        for part in self.points.parts(0..self.points.len(), FIT_PARTS, |_| false) {
            let corners = [part.summary.min_m, part.summary.max_m];
            if corners.iter().all(|corner| near.has([corner[0], corner[1]])) {
                add(plane.bounds(&part.summary));
                continue;
            }
            for point in [part.first, part.last].map(|point| point.position_m) {
                if near.has([point[0], point[1]]) {
                    let p = DVec2::from_array(plane.point(point));
                    add((p, p));
                }
            }
        }
        extent.map(|(min, max)| (min.to_array(), max.to_array()))
    }
}

/// An extent on the map, m, with those of tracks that are only aligned. Outliers, as those of a satellite receiver, widen
/// it by its size at most, or by `least_m`.
pub(super) fn widened(
    (low, high): ([f64; 2], [f64; 2]),
    loose: &[([f64; 2], [f64; 2])],
    least_m: f64,
) -> ([f64; 2], [f64; 2]) {
    let most_m = (high[0] - low[0]).max(high[1] - low[1]).max(least_m);
    let (mut min, mut max) = (low, high);
    for (from, to) in loose {
        for axis in 0..2 {
            min[axis] = min[axis].min(from[axis].max(low[axis] - most_m));
            max[axis] = max[axis].max(to[axis].min(high[axis] + most_m));
        }
    }
    (min, max)
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
    /// Length of the aligned part on the track on which it is shorter, m: a jump makes the other one long.
    pub(super) length_m: f64,
}

impl Alignment {
    fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        [cos * x - sin * y + self.translation_m[0], sin * x + cos * y + self.translation_m[1]]
    }

    /// Whether the tracks fit well enough for one to be drawn beside the other.
    pub(super) fn is_plausible(&self) -> bool {
        self.rms_m <= MOST_OFF * self.length_m
    }

    /// As a pose of the aligned track in the frame of the other one.
    pub(super) fn pose(&self) -> Pose {
        Pose::from_xy_yaw(self.translation_m[0], self.translation_m[1], self.yaw_rad)
    }
}

/// The alignment of one track with another, computed again while the part that it uses grows.
#[derive(Clone, Debug, Default)]
pub(super) struct Aligned {
    tracks: Option<[Series<TrackPoint>; 2]>,
    /// Whether the part that is used will not change any more.
    is_final: bool,
    pub(super) alignment: Option<Alignment>,
}

impl Aligned {
    /// Aligns `track` with `reference`.
    pub(super) fn update(&mut self, track: &Series<TrackPoint>, reference: &Series<TrackPoint>) {
        let now = [track, reference];
        if let Some(known) = &self.tracks
            && known.iter().zip(now).all(|(known, now)| known.same(now) && known.len() <= now.len())
        {
            let grown = |(known, now): (&Series<_>, &Series<_>)| now.len() > known.len() + known.len() / 8;
            if self.is_final || !known.iter().zip(now).any(grown) {
                return;
            }
        }
        self.tracks = Some(now.map(Clone::clone));
        (self.alignment, self.is_final) = align(track, reference);
    }
}

/// The rotation and translation that align the first part of a track with `reference` by least squares, and whether
/// later records cannot change it. `None` if they have no time in common, or hardly move.
fn align(track: &Series<TrackPoint>, reference: &Series<TrackPoint>) -> (Option<Alignment>, bool) {
    let ends = |points: &Series<TrackPoint>| Some([points.get(0)?.stamp, points.last()?.stamp]);
    let (Some(own), Some(other)) = (ends(track), ends(reference)) else { return (None, false) };
    let (first, last) = (own[0].max(other[0]), own[1].min(other[1]));
    let mut pairs: Vec<([f64; 2], [f64; 2])> = Vec::new();
    let (mut length_m, mut own_length_m) = (0.0_f64, 0.0_f64);
    track.walk(
        track.count_until(first.before_ns(1))..track.count_until(last),
        |part| (0..2).all(|axis| part.summary.max_m[axis] - part.summary.min_m[axis] <= AT_REST_M),
        |part| {
            let Some([x, y]) = at(reference, part.first.stamp) else { return ControlFlow::Continue(()) };
            let [own_x, own_y, _] = part.first.position_m;
            if let Some(([last_x, last_y], [own_last_x, own_last_y])) = pairs.last() {
                length_m += f64::hypot(x - last_x, y - last_y);
                own_length_m += f64::hypot(own_x - own_last_x, own_y - own_last_y);
            }
            pairs.push(([x, y], [own_x, own_y]));
            if length_m > ALIGN_LENGTH_M { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        },
    );
    let is_final = length_m > ALIGN_LENGTH_M;
    if pairs.len() < 3 || length_m < 1.0 {
        return (None, is_final);
    }
    (Some(least_squares(&pairs, length_m.min(own_length_m))), is_final)
}

/// The rotation and translation that bring the second points nearest to the first ones, over a length.
fn least_squares(pairs: &[([f64; 2], [f64; 2])], length_m: f64) -> Alignment {
    let n = pairs.len() as f64;
    let (mut to, mut from) = ([0.0; 2], [0.0; 2]);
    for (a, b) in pairs {
        for axis in 0..2 {
            to[axis] += a[axis] / n;
            from[axis] += b[axis] / n;
        }
    }
    let (mut cross, mut dot) = (0.0_f64, 0.0_f64);
    for (a, b) in pairs {
        let (a, b) = ([a[0] - to[0], a[1] - to[1]], [b[0] - from[0], b[1] - from[1]]);
        cross += b[0] * a[1] - b[1] * a[0];
        dot += b[0] * a[0] + b[1] * a[1];
    }
    let yaw_rad = cross.atan2(dot);
    let mut alignment = Alignment { yaw_rad, translation_m: [0.0; 2], rms_m: 0.0, length_m };
    let turned = alignment.apply(from);
    alignment.translation_m = [to[0] - turned[0], to[1] - turned[1]];
    let squares = pairs.iter().map(|(a, b)| {
        let b = alignment.apply(*b);
        (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
    });
    alignment.rms_m = (squares.sum::<f64>() / n).sqrt();
    alignment
}

#[cfg(test)]
#[path = "track_tests.rs"]
mod tests;
