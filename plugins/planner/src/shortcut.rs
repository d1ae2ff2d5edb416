//! Cuts a way that was driven by the map: what leads into a dead end and out again is replaced by the free ground between
//! (Albus 2006a, 5: the path is saved without "loops and excursions").
//!
//! The way in and the way out may lie several metres apart, so that the vehicle never came back to the same place. The
//! cut is the cheapest path over the cells of the map, where the cells that were driven over cost less than other free
//! ones. They are those of the track, and not of the way that is left of it: each cut would be free to lie half a metre
//! beside the one before, and with some of them the way crept into a fence.

use crate::clearance::Clearance;
use crate::costs::{BLOCKED, CostGrid};
use crate::place::Place;
use crate::proto::BarredPlace;
use crate::search::{Path, Search};
use crate::sensed::{Sensed, around};
use rcs_geom::DVec2;
use rcs_world::{OBSTACLE_COST, UNKNOWN_COST};
use serde::{Deserialize, Serialize};

/// Cost of a cell of the track, and of another free cell: a cut must be shorter than two thirds of what it replaces, because
/// what was driven over is safe.
const DRIVEN: u8 = 10;
const FREE: u8 = 15;
/// Ground that costs more than this, such as mud, is no way for a cut, unless it was driven over.
const MOST_FREE: u8 = 50;
/// Distance from the track at which a cell belongs to it, m.
const BESIDE_M: f64 = 0.5;
/// Least distance of a cut from what is in the way, m: holes of a fence that are narrower than twice this are no way.
const ROOM_M: f64 = 1.0;

/// Longest step of a track that was driven, m; a longer one is a wrong position.
pub(crate) const LONGEST_STEP_M: f64 = 20.0;

/// Length that is driven between two cuts, m.
const STEP_M: f64 = 10.0;

/// Once the wheels have slipped, the greatest distance between where a point was when it was driven and where it is by the
/// newest estimate of the position, m: what differs by more was driven before, so the local frame is not one frame for both.
const MOST_CORRECTED_M: f64 = 3.0;

/// Greatest number of points of a way: 40 km of cells of 0.2 m, and more where it is not cut. Then every second one is
/// dropped, and the first one stays. Where points lie farther apart than what counts as the same place, loops may stay.
const MOST_POINTS: usize = 200_000;
/// Greatest number of points of the track by which a way is cut: 10 km. Then its older half is dropped: a way that comes
/// back to where it was so long ago is cut by the map alone.
const MOST_DRIVEN: usize = 20_000;

/// A point of a way: in the local frame, in which the map lies, and in the global frame at the time that it was driven, m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WayPoint {
    /// Local frame.
    pub local: DVec2,
    /// Global frame.
    pub global: DVec2,
}

/// The way of a run, cut by the map while it is driven.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Way {
    points: Vec<WayPoint>,
    /// Index of the first point that may be cut.
    open: usize,
    /// The track from that point on.
    driven: Vec<WayPoint>,
    /// Length driven since the last cut, m.
    since_cut_m: f64,
    /// Whether the local frame in which it began has begun again since.
    has_left_frame: bool,
}

impl Way {
    /// Adds a position. What is kept is bounded, so that a vehicle can drive for days.
    pub fn add(&mut self, point: WayPoint) {
        self.since_cut_m += self.points.last().map_or(0.0, |last| last.global.distance(point.global));
        self.points.push(point);
        self.driven.push(point);
        if self.points.len() > MOST_POINTS {
            self.points = self.points.iter().step_by(2).copied().collect();
            self.open = self.open.div_ceil(2);
        }
        if self.driven.len() > MOST_DRIVEN {
            self.driven.drain(..MOST_DRIVEN / 2);
        }
    }

    /// Goes back to the point that is nearest to a position in the global frame, m: the wheels turned, and the vehicle
    /// did not move. What was driven before lies elsewhere in the local frame now, and is no longer cut.
    pub fn back_to(&mut self, global: DVec2) {
        let away_m = |at: &usize| self.points[*at].global.distance(global);
        let nearest = (0..self.points.len()).min_by(|a, b| away_m(a).total_cmp(&away_m(b)));
        self.points.truncate(nearest.map_or(0, |at| at + 1));
        self.close();
    }

    /// Whether nothing was added since what was driven before is no longer cut.
    pub fn is_closed(&self) -> bool {
        self.driven.is_empty() && !self.points.is_empty()
    }

    /// What was driven so far is no longer cut.
    fn close(&mut self) {
        self.open = self.points.len();
        self.driven.clear();
    }

    /// The local frame has begun again, or may have: where the way was before is known in the global frame alone, and is
    /// no longer cut.
    pub fn leave_frame(&mut self) {
        self.close();
        self.has_left_frame |= !self.points.is_empty();
    }

    /// Where it begins, if that is known in the local frame.
    pub fn start(&self) -> Option<WayPoint> {
        self.points.first().copied().filter(|_| !self.has_left_frame)
    }

    /// Whether the vehicle has driven far enough since the last cut.
    pub fn is_due(&self) -> bool {
        self.since_cut_m >= STEP_M
    }

    /// Cuts the way by a map in the local frame, with the newest estimate of the global frame. What lies outside of the map
    /// stays.
    pub fn cut(&mut self, sensed: &Sensed, barred: &[BarredPlace], to_global: impl Fn(DVec2) -> DVec2) {
        self.since_cut_m = 0.0;
        let is_outside = |point: &WayPoint| cell(sensed, point.local).is_none();
        let outside = self.points[self.open.min(self.points.len())..].iter().rposition(is_outside);
        let from = self.open + outside.map_or(0, |outside| outside + 1);
        let inside = self.points.get(from..).unwrap_or_default();
        let kept = cut(inside, &self.driven, sensed, barred, to_global);
        if let Some(kept) = kept {
            self.points.truncate(from);
            self.points.extend(kept);
        }
    }

    /// Its points in the global frame, m, by the newest estimate of that frame, as the map that is saved with it.
    /// `has_slipped`: whether the wheels have slipped, so that what was driven before may lie elsewhere in the local frame.
    pub fn in_global(&self, has_slipped: bool, to_global: impl Fn(DVec2) -> DVec2) -> Vec<DVec2> {
        let newest = |point: &WayPoint| {
            let now = to_global(point.local);
            let is_kept = has_slipped && now.distance(point.global) > MOST_CORRECTED_M;
            if is_kept { point.global } else { now }
        };
        let (before, open) = self.points.split_at(self.open.min(self.points.len()));
        before.iter().map(|point| point.global).chain(open.iter().map(newest)).collect()
    }
}

/// The cell of the map at a position, m.
fn cell(sensed: &Sensed, at: DVec2) -> Option<Place> {
    let rows = sensed.fused.len() / sensed.columns.max(1);
    let is_inside = |at: i32, count: usize| (0..count as i32).contains(&at);
    sensed.place(at).filter(|at| is_inside(at.column, sensed.columns) && is_inside(at.row, rows))
}

/// The cheapest path from the first to the last point of a way inside of the map; `None` for a way that is too short.
fn cut(
    way: &[WayPoint],
    driven: &[WayPoint],
    sensed: &Sensed,
    barred: &[BarredPlace],
    to_global: impl Fn(DVec2) -> DVec2,
) -> Option<Vec<WayPoint>> {
    let [first, .., last] = way else { return None };
    let (start, goal) = cell(sensed, first.local).zip(cell(sensed, last.local))?;
    let costs = costs(driven, sensed, barred)?;
    let mut path = Path::default();
    Search::default().path(&costs, start, goal, FREE, &mut path).ok()?;
    let nearest = |centre: DVec2| {
        let away_m = |point: &&WayPoint| point.local.distance(centre);
        driven.iter().min_by(|a, b| away_m(a).total_cmp(&away_m(b))).unwrap_or(first)
    };
    let between = path.cells.iter().skip(1).take(path.cells.len().saturating_sub(2)).map(|&place| {
        let centre = sensed.centre(place);
        let beside = nearest(centre);
        WayPoint { local: centre, global: beside.global + to_global(centre) - to_global(beside.local) }
    });
    Some([*first].into_iter().chain(between).chain([*last]).collect())
}

/// The costs of the cells for a cut: [`DRIVEN`], [`FREE`], or blocked; unknown and dear cells are blocked.
fn costs(driven: &[WayPoint], sensed: &Sensed, barred: &[BarredPlace]) -> Option<CostGrid> {
    let is_free = |fused: u8| fused <= MOST_FREE;
    let in_the_way: Vec<bool> =
        sensed.fused.iter().map(|&fused| fused >= OBSTACLE_COST && fused != UNKNOWN_COST).collect();
    let room = (ROOM_M / sensed.cell_size_m).ceil() as usize;
    let mut clearance = Clearance::default();
    let squared = clearance.squared(sensed.columns, &in_the_way, room);
    let enough = room * room;
    let cells = sensed.fused.iter().zip(squared);
    let cells = cells.map(
        |(&fused, &squared)| {
            if is_free(fused) && usize::from(squared) >= enough { FREE } else { BLOCKED }
        },
    );
    let mut cells: Vec<u8> = cells.collect();
    for place in barred {
        let at = DVec2::new(place.x_m, place.y_m);
        around(sensed, at, place.radius_m, |place, _| cells[sensed.index(place)] = BLOCKED);
    }
    let is_driven = |pair: &&[WayPoint]| pair[0].local.distance(pair[1].local) <= LONGEST_STEP_M;
    for pair in driven.windows(2).filter(is_driven) {
        let steps =
            (pair[0].local.distance(pair[1].local) / (0.5 * sensed.cell_size_m)).ceil().max(1.0) as u32;
        for step in 0..=steps {
            let at = pair[0].local.lerp(pair[1].local, f64::from(step) / f64::from(steps));
            around(sensed, at, BESIDE_M, |place, _| cells[sensed.index(place)] = DRIVEN);
        }
    }
    let rows = cells.len() / sensed.columns.max(1);
    CostGrid::new(sensed.columns, rows, cells).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::route::length_m;

    /// 151×151 free cells of 0.4 m; a trap that is open to the west, from x = 0 to 12 m between y = -4 and 4 m, and unknown
    /// cells east of x = 24 m.
    fn trap() -> Sensed {
        let columns = 151;
        let corner = DVec2::splat(-30.2);
        let mut sensed = Sensed {
            columns,
            cell_size_m: 0.4,
            corner,
            fused: vec![20; columns * columns],
            ..Sensed::default()
        };
        for at in 0..sensed.fused.len() {
            let centre = sensed.centre(Place::new((at % columns) as i32, (at / columns) as i32));
            let side = (centre.y.abs() - 4.0).abs() < 0.3 && (0.0..12.0).contains(&centre.x);
            let end = (centre.x - 12.0).abs() < 0.3 && centre.y.abs() < 4.2;
            if side || end {
                sensed.fused[at] = 250;
            } else if centre.x > 24.0 {
                sensed.fused[at] = UNKNOWN_COST;
            }
        }
        sensed
    }

    /// Along corners in the local frame, which lies 100 m north of the global one.
    fn along(corners: &[(f64, f64)]) -> Way {
        let mut way = Way::default();
        for pair in corners.windows(2) {
            let (from, to) = (DVec2::from(pair[0]), DVec2::from(pair[1]));
            let count = (from.distance(to) / 0.5).ceil() as u32;
            for at in 0..count {
                let local = from.lerp(to, f64::from(at) / f64::from(count));
                way.add(WayPoint { local, global: to_global(local) });
            }
        }
        way
    }

    fn to_global(local: DVec2) -> DVec2 {
        local + DVec2::new(0.0, 100.0)
    }

    const INTO_THE_TRAP: [(f64, f64); 6] =
        [(-20.0, 0.0), (10.0, 2.5), (10.0, -2.5), (-2.0, -2.5), (-2.0, -7.0), (20.0, -7.0)];

    #[test]
    fn a_way_into_a_dead_end_and_out_again_is_cut_before_it_although_both_lie_apart() {
        let mut way = along(&INTO_THE_TRAP);
        assert!(way.is_due());
        let driven = way.in_global(false, to_global);
        way.cut(&trap(), &[], to_global);
        let kept = way.in_global(false, to_global);
        assert!(!way.is_due());
        assert_eq!((kept.first(), kept.last()), (driven.first(), driven.last()));
        // The shortest way is 42 m long; that along the cells is up to 8 % longer.
        assert!((41.0..48.0).contains(&length_m(&kept)), "{} of {}", length_m(&kept), length_m(&driven));
        let in_the_trap = |at: &&DVec2| at.x > 0.5 && (at.y - 100.0).abs() < 4.0;
        assert_eq!(kept.iter().find(in_the_trap), None);
        // A second cut by the same map changes nothing.
        way.cut(&trap(), &[], to_global);
        assert_eq!(way.in_global(false, to_global), kept);
    }

    #[test]
    fn a_way_around_a_wall_keeps_its_distance_however_often_it_is_cut() {
        // Along the trap, 2 m beside it, in a bend towards it: each cut could lie nearer to the wall than the one before.
        let mut way = along(&[(-10.0, -9.0), (2.0, -6.0), (10.0, -6.0), (22.0, -9.0)]);
        let driven = way.in_global(false, to_global);
        (0..12).for_each(|_| way.cut(&trap(), &[], to_global));
        let off_m = |at: &DVec2| driven.iter().map(|point| point.distance(*at)).fold(f64::MAX, f64::min);
        let kept = way.in_global(false, to_global);
        let farthest_m = kept.iter().map(off_m).fold(0.0, f64::max);
        assert!(farthest_m < BESIDE_M + 0.4, "{farthest_m} m beside the track: {kept:?}");
    }

    #[test]
    fn what_is_unknown_barred_or_outside_of_the_map_is_no_cut() {
        let length = |way: &Way| length_m(&way.in_global(false, to_global));
        // The cut across unknown ground would save 20 m.
        let mut way = along(&[(20.0, -10.0), (20.0, 10.0), (28.0, 10.0), (28.0, -10.0)]);
        let before_m = length(&way);
        way.cut(&trap(), &[], to_global);
        assert!(length(&way) > before_m - 4.0, "{} of {before_m}", length(&way));
        // A place barred before the trap: the way into it is the only one that is known to be free.
        let mut way = along(&INTO_THE_TRAP);
        let barred = [BarredPlace { x_m: -12.0, y_m: -15.0, radius_m: 14.0, slipped: false }];
        way.cut(&trap(), &barred, to_global);
        assert!(way.in_global(false, to_global).iter().any(|at| at.x > -3.0 && at.x < 0.0));
        let mut way = along(&[(100.0, 0.0), (120.0, 0.0), (120.0, 5.0), (100.0, 5.0)]);
        let before = way.clone();
        way.cut(&trap(), &[], to_global);
        assert_eq!(way.in_global(false, to_global), before.in_global(false, to_global));
    }

    #[test]
    fn a_way_around_mud_is_not_cut_through_it_and_ground_that_costs_a_little_is() {
        let around = [(-18.0, 14.0), (-18.0, 5.0), (-2.0, 5.0), (-2.0, 14.0)];
        for (cost, is_cut) in [(40, true), (90, false)] {
            let mut ground = trap();
            for at in 0..ground.fused.len() {
                let place = Place::new((at % ground.columns) as i32, (at / ground.columns) as i32);
                let centre = ground.centre(place);
                if (-14.0..-6.0).contains(&centre.x) && centre.y > 6.0 {
                    ground.fused[at] = cost;
                }
            }
            let mut way = along(&around);
            way.cut(&ground, &[], to_global);
            let kept = way.in_global(false, to_global);
            let is_through = kept.iter().any(|at| (-13.0..-7.0).contains(&at.x) && at.y > 107.0);
            assert_eq!(is_through, is_cut, "ground that costs {cost}: {kept:?}");
        }
    }

    #[test]
    fn after_wheels_have_turned_what_was_driven_before_is_no_longer_cut() {
        let mut way = along(&INTO_THE_TRAP[..3]);
        way.back_to(to_global(DVec2::new(10.0, 2.5)));
        let before = way.in_global(false, to_global);
        assert!(before.last().is_some_and(|last| last.distance(DVec2::new(10.0, 102.5)) < 0.6));
        for &WayPoint { local, global } in &along(&INTO_THE_TRAP[2..]).points {
            way.add(WayPoint { local, global });
        }
        way.cut(&trap(), &[], to_global);
        assert_eq!(way.in_global(false, to_global)[..before.len()], before);
    }

    #[test]
    fn the_way_lies_where_the_newest_estimate_says_unless_the_wheels_have_slipped_since() {
        let way = along(&[(0.0, 0.0), (10.0, 0.0)]);
        let corrected = |local: DVec2| to_global(local) + DVec2::new(1.5, -2.0);
        let far = |local: DVec2| to_global(local) + DVec2::new(6.0, 0.0);
        assert_eq!(way.in_global(true, corrected)[0], corrected(DVec2::ZERO));
        assert_eq!(way.in_global(true, far)[0], to_global(DVec2::ZERO));
        // The first estimate was wrong by 6 m.
        assert_eq!(way.in_global(false, far)[0], far(DVec2::ZERO));
        let mut way = way;
        way.back_to(to_global(DVec2::ZERO));
        assert_eq!(way.in_global(true, corrected), [to_global(DVec2::ZERO)]);
    }

    #[test]
    fn what_was_driven_before_the_local_frame_began_again_stays_in_the_global_frame_and_is_not_cut() {
        let mut way = along(&INTO_THE_TRAP[..3]);
        let before = way.in_global(false, to_global);
        way.leave_frame();
        assert_eq!(way.start(), None);
        way.add(WayPoint { local: DVec2::ZERO, global: DVec2::new(90.0, 90.0) });
        way.cut(&trap(), &[], |local| local + DVec2::splat(90.0));
        let now = way.in_global(false, |local| local + DVec2::splat(90.0));
        assert_eq!((&now[..before.len()], now.len()), (before.as_slice(), before.len() + 1));
    }

    #[test]
    fn a_way_that_goes_on_for_days_keeps_its_ends_and_a_bounded_number_of_points() {
        let at = |step: usize| {
            let local = DVec2::new(0.5 * step as f64, 0.0);
            WayPoint { local, global: to_global(local) }
        };
        let (middle, last) = (MOST_POINTS / 2, MOST_POINTS - 1);
        let mut way = Way::default();
        (0..=middle).for_each(|step| way.add(at(step)));
        way.back_to(at(middle).global);
        (middle + 1..=last).for_each(|step| way.add(at(step)));
        assert_eq!(way.points.len(), MOST_POINTS);
        way.add(at(last + 1));
        assert_eq!(way.points.len(), MOST_POINTS / 2 + 1);
        // Points that are no longer cut stay in the global frame as it was then.
        let corrected = |local: DVec2| to_global(local) + DVec2::new(0.0, 1.5);
        let kept = way.in_global(false, corrected);
        assert_eq!(kept.iter().filter(|point| point.y == 100.0).count(), middle / 2 + 1);
        assert_eq!((kept[0], kept[kept.len() - 1]), (at(0).global, corrected(at(last + 1).local)));
        (last + 2..3 * MOST_POINTS).for_each(|step| way.add(at(step)));
        assert!(way.points.len() <= MOST_POINTS && way.driven.len() <= MOST_DRIVEN);
        let newest = at(3 * MOST_POINTS - 1);
        assert_eq!((way.points.last(), way.driven.last()), (Some(&newest), Some(&newest)));
        assert_eq!(way.start(), Some(at(0)));
    }
}
