//! From which poses a thing in the way was in view, and which layers blocked the way to it from there.
//!
//! A vehicle keeps away from most things, so the distance at which it knew of those that it came close to says little.
//! Here each pose counts from which an arc truly hits a thing 2 m to 5 m ahead. The thing is sighted from a pose if it
//! is within the angle of view of the cameras, nothing hides it, and both were so over the last 0.5 m. Of several arcs
//! that hit it, the one on which it is nearest counts.

use super::Settings;
use super::report::{BANDS_M, ThingSightings};
use super::truth::Truth;
use rcs_geom::{DVec2, Pose};
use rcs_world::GridView;
use std::collections::BTreeMap;

/// How far the vehicle must have driven with a thing in view before the map must know of it, m. Three images of 5 Hz
/// take as much at 0.8 m/s. Being out of view for longer than that begins anew.
const NOTICED_M: f64 = 0.5;
/// Distance between the points of a line of sight that are compared with what stands there, m.
const SIGHT_STEP_M: f64 = 0.1;
/// Of what is higher than this above the ground, the part below counts, m: the vehicle runs into that.
const TALL_M: f64 = 1.0;
/// What stands this close to a cell does not hide it, m: one cell.
const BESIDE_M: f64 = 0.2;

/// A thing in view, and the arc that hits it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sighting {
    /// Number of the arc.
    pub(crate) arc: usize,
    /// Number of the thing.
    pub(crate) thing: u32,
    /// Distance along the arc from the front of the vehicle, m.
    pub(crate) distance_m: f64,
}

/// The cameras of the vehicle, taken as one above the middle of its front that looks ahead.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eye {
    /// Pose of its foot in the frame of the true map, without the tilt of the vehicle.
    map_from_foot: Pose,
    height_m: f64,
    view_rad: f64,
}

impl Eye {
    /// The eye of a vehicle at this pose of the true map's frame.
    pub(crate) fn new(frame_from_vehicle: &Pose, settings: &Settings) -> Eye {
        let at = frame_from_vehicle.translation;
        let level = Pose::from_xy_yaw(at.x, at.y, frame_from_vehicle.yaw());
        Eye {
            map_from_foot: level * Pose::from_xy_yaw(settings.front_m, 0.0, 0.0),
            height_m: settings.eye_height_m,
            view_rad: settings.view_rad,
        }
    }

    /// Whether a cell of the true map is within the angle of view, and the straight line to half the height of what
    /// stands there, at most 1 m high, passes above what stands in between. Cells of the same thing do not hide it.
    pub(crate) fn sees(&self, truth: &Truth, view: &GridView<'_>, cell: usize) -> bool {
        let (columns, size) = (view.columns(), view.cell_size_m());
        let middle = (DVec2::new((cell % columns) as f64, (cell / columns) as f64) + 0.5) * size;
        let foot_from_grid = self.map_from_foot.inverse() * view.frame_from_grid();
        let ahead = foot_from_grid * middle.extend(0.0);
        if libm::atan2(ahead.y, ahead.x).abs() > self.view_rad / 2.0 {
            return false;
        }
        let cell_at = |place: DVec2| {
            let slot = (place / size).floor();
            let is_inside =
                slot.min_element() >= 0.0 && slot.x < columns as f64 && slot.y < view.rows() as f64;
            if is_inside { Some(slot.y as usize * columns + slot.x as usize) } else { None }
        };
        let eye = foot_from_grid.inverse().translation.truncate();
        let Some(below) = cell_at(eye) else { return false };
        let eye_m = truth.ground_m[below] + self.height_m;
        let ground_m = truth.ground_m[cell];
        let target_m = f64::midpoint(ground_m, truth.top_m[cell].min(ground_m + TALL_M));
        let away_m = (middle - eye).length();
        let steps = ((away_m - BESIDE_M).max(0.0) / SIGHT_STEP_M) as usize;
        (1..=steps).all(|step| {
            let share = step as f64 * SIGHT_STEP_M / away_m;
            let line_m = eye_m + (target_m - eye_m) * share;
            let passes = |at: usize| truth.thing[at] == truth.thing[cell] || truth.top_m[at] < line_m;
            cell_at(eye.lerp(middle, share)).is_none_or(passes)
        })
    }
}

/// All sightings of a drive.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sightings {
    /// Distances driven since each thing has been in view, and when it was last in view, m.
    in_view_m: BTreeMap<u32, [f64; 2]>,
    /// Distance of each sighting of a thing, m, and whether a layer blocked the way to it.
    blocks: BTreeMap<(u32, String), Vec<(f64, bool)>>,
}

impl Sightings {
    /// Takes the things in view at a pose, and returns those sighted from it: at most one sighting of each thing.
    pub(crate) fn take(&mut self, driven_m: f64, in_view: impl Iterator<Item = Sighting>) -> Vec<Sighting> {
        let mut nearest: BTreeMap<u32, Sighting> = BTreeMap::new();
        for sighting in in_view {
            let known = nearest.entry(sighting.thing).or_insert(sighting);
            if sighting.distance_m < known.distance_m {
                *known = sighting;
            }
        }
        nearest.retain(|&thing, sighting| {
            let [since_m, last_m] = self.in_view_m.entry(thing).or_insert([driven_m; 2]);
            if driven_m - *last_m > NOTICED_M {
                *since_m = driven_m;
            }
            *last_m = driven_m;
            let is_in_band = |&[from_m, to_m]: &[f64; 2]| (from_m..to_m).contains(&sighting.distance_m);
            driven_m - *since_m >= NOTICED_M && BANDS_M.iter().any(is_in_band)
        });
        nearest.into_values().collect()
    }

    /// Notes whether a layer blocks the way to a thing that is sighted.
    pub(crate) fn note(&mut self, layer: &str, sighting: &Sighting, blocks: bool) {
        let poses = self.blocks.entry((sighting.thing, layer.to_owned())).or_default();
        poses.push((sighting.distance_m, blocks));
    }

    /// What each layer called the way to a thing, by names of the layers.
    pub(crate) fn of(&self, thing: u32) -> Vec<ThingSightings> {
        let of_thing =
            self.blocks.range((thing, String::new())..).take_while(|((other, _), _)| *other == thing);
        of_thing.map(|((_, layer), poses)| ThingSightings::new(layer, poses)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::obstacles::tests::{cell, true_map};
    use rcs_world::SIDE;

    #[test]
    fn a_thing_is_in_view_within_the_angle_of_the_cameras_where_nothing_hides_it() {
        let check = |thing: [f64; 2], other: [f64; 2], other_top_m: f64, expected: bool| {
            let [thing, other] = [thing, other].map(|[x, y]| cell(x, y));
            let place = |[column, row]: [usize; 2]| row * SIDE + column;
            let mut truth = Truth::new(true_map(&[other], &[thing])).unwrap();
            truth.top_m[place(other)] = other_top_m;
            let eye = Eye::new(&Pose::IDENTITY, &Settings::default());
            let view = GridView::new(&truth.grid).unwrap();
            assert_eq!(eye.sees(&truth, &view, place(thing)), expected, "{thing:?} {other:?} {other_top_m}");
        };
        let (ahead, between, aside) = ([4.1, 0.1], [2.1, 0.1], [4.1, -3.9]);
        check(ahead, aside, 1.0, true);
        check(ahead, between, 1.0, false);
        // The line from 0.95 m to the middle of a thing of 1 m is at 0.73 m there.
        check(ahead, between, 0.7, true);
        check(ahead, between, 0.8, false);
        // 47 and 54 degrees to the left of the front, of 50.
        check([3.1, 3.1], aside, 1.0, true);
        check([2.5, 3.1], aside, 1.0, false);
        check([-3.9, 0.1], aside, 1.0, false);
    }

    #[test]
    fn a_thing_is_sighted_once_a_pose_after_half_a_metre_in_view_and_a_break_begins_anew() {
        let mut sightings = Sightings::default();
        let on = |arc, distance_m| Sighting { arc, thing: 7, distance_m };
        let mut take = |driven_m, seen: &[Sighting]| sightings.take(driven_m, seen.iter().copied());
        let driven_m = [0.0, 0.25, 0.5, 0.75, 2.0, 2.25, 2.5];
        let sighted = driven_m.map(|driven_m| take(driven_m, &[on(0, 3.5)]).len());
        assert_eq!(sighted, [0, 0, 1, 1, 0, 0, 1]);
        assert_eq!(take(2.75, &[on(1, 3.0), on(2, 2.5), on(3, 2.75)]), [on(2, 2.5)]);
        assert_eq!([1.9, 2.0, 5.0].map(|distance_m| take(3.0, &[on(0, distance_m)]).len()), [0, 1, 0]);
    }
}
