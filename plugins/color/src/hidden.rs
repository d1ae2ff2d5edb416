//! What stands in front of the foot of a known obstacle.
//!
//! Pixels of a hedge or a bush may have the colours of a known obstacle. Its foot then seems to lie where the rays of these
//! pixels meet the ground, which is behind the hedge. Where the world model has an obstacle on the way to the foot that is
//! high enough to hide it, the pixels show that obstacle. So they do where one stands at the foot, or close to it, that is
//! clearly higher than the known obstacle. Only what was seen by its shape or touched counts: known obstacles must not hide
//! each other, and themselves, by where they were placed before.
//!
//! A slope of soil has the colour of a known obstacle in the shade, too, and reaches up to the horizon as one does. Where
//! the ground behind a foot rises so that its pixels show that ground, there is none.
//!
//! Near the camera, a known obstacle is seen by its shape, too, even a mesh whose holes show the ground behind it; soil is not.
//! So the near feet do not count where almost none of them has an obstacle by shape beside it.

use crate::gate::solid;
use glam::DVec3;
use rcs_geom::Pose;
use rcs_sense::is_obstacle;
use rcs_world::{Field, GridView};

/// A foot is placed with an error that increases with its distance, and so is what hides it: up to this distance, m, and
/// this share of the distance of the foot, an obstacle in front of it is taken for the known obstacle itself.
const SAME_M: f64 = 0.5;
const SAME_SHARE: f64 = 0.1;
/// What is higher than a known obstacle by this factor is none.
const HIGHER: f64 = 1.3;
/// Ground before it may look like the known obstacle, too, so that its foot seems to be nearer by this much more, m.
const BEFORE_M: f64 = 0.5;
/// Ground behind a foot is looked for where a ray through the middle of the known obstacle passes, from this distance behind
/// it, m, up to this share of the distance at which the ray meets level ground.
const BEHIND_M: f64 = 0.4;
const BEFORE_LEVEL: f64 = 0.75;
/// Up to this distance from the camera, m, at least this share of the feet of known obstacles has an obstacle by shape beside it.
/// Measured: three of ten and more at a fence of mesh, none on soil.
const SHAPED_TO_M: f64 = 7.0;
const LEAST_SHAPED: f64 = 0.1;
/// Number of cells to each side of a foot that are looked at, at most, for what towers over it or stands there. Where the
/// radius is larger, the foot is so far away that none of them is in a map of [`rcs_world::MAX_SIDE`] cells around the camera,
/// or the cells are too small for any use.
const MOST_BESIDE: f64 = 100.0;
/// Nothing nearer to the camera than this, m, is looked at.
const NEAREST_M: f64 = 0.5;

/// The obstacles of a map that hide what lies behind them.
pub struct Screens<'a> {
    solid: Vec<Field<'a>>,
    top: Field<'a>,
    ground: Option<Field<'a>>,
    grid_from_frame: Pose,
    cell_size_m: f64,
}

impl<'a> Screens<'a> {
    /// Those of a map with costs by shape and with the heights of obstacles; `None` of another map.
    pub fn of(map: &'a GridView<'a>) -> Option<Screens<'a>> {
        let solid = solid(map);
        let top = map.field("obstacle.max").ok().filter(|_| !solid.is_empty())?;
        let size = map.cell_size_m();
        let cell_size_m = size.x.min(size.y);
        let grid_from_frame = map.frame_from_grid().inverse();
        let ground = map.field("ground.mean").ok();
        (cell_size_m > 0.0).then_some(Screens { solid, top, ground, grid_from_frame, cell_size_m })
    }

    /// Whether one of them hides a place on the ground from the camera, and is not there itself. Positions in the frame of
    /// the map, m.
    pub fn hides(&self, camera: DVec3, foot: DVec3) -> bool {
        let distance_m = (foot - camera).truncate().length();
        let end_m = distance_m - tolerance_m(distance_m);
        let step_m = 0.5 * self.cell_size_m;
        let steps = ((end_m - NEAREST_M) / step_m).floor().clamp(-1.0, 1e4) as i64;
        (0..=steps).any(|step| {
            let along = (NEAREST_M + step as f64 * step_m) / distance_m;
            self.reaches(camera.lerp(foot, along))
        })
    }

    /// Whether one of them stands at a place on the ground, or close to it, that is clearly higher than a known obstacle of
    /// this height, m. Positions in the frame of the map, m.
    pub fn towers_over(&self, camera: DVec3, foot: DVec3, height_m: f64) -> bool {
        let radius_m = tolerance_m((foot - camera).truncate().length()) + BEFORE_M;
        let cells = (radius_m / self.cell_size_m).floor().clamp(0.0, MOST_BESIDE) as i64;
        square(cells).filter(|(x, y)| x * x + y * y <= cells * cells).any(|(x, y)| {
            let beside = DVec3::new(x as f64, y as f64, 0.0) * self.cell_size_m;
            self.reaches(foot + beside + DVec3::Z * HIGHER * height_m)
        })
    }

    /// Whether the camera, which stands `above_m` (m) above the plane of a foot whose normal is `up`, sees rising ground where
    /// the middle of a known obstacle of this height, m, would be.
    pub fn shows_ground(&self, camera: DVec3, foot: DVec3, up: DVec3, above_m: f64, height_m: f64) -> bool {
        let Some(ground) = &self.ground else { return false };
        let part = 0.5 * height_m / above_m;
        let middle = foot + up * (0.5 * height_m) - camera;
        let distance_m = (foot - camera).truncate().length();
        // On level ground, the ray goes on for as far as it is high above the plane, as a part of the camera's height.
        let level_m = if part < 1.0 { distance_m * part / (1.0 - part) } else { f64::INFINITY };
        let end_m = (BEFORE_LEVEL * level_m).min(distance_m);
        let steps = ((end_m - BEHIND_M) / self.cell_size_m).floor().clamp(-1.0, 1e4) as i64;
        (0..=steps).any(|step| {
            let behind_m = BEHIND_M + step as f64 * self.cell_size_m;
            let point = camera + middle * (1.0 + behind_m / distance_m);
            let ground_z = self.cell_of(point).and_then(|(column, row)| ground.get(column, row));
            ground_z.is_some_and(|z| z.is_finite() && z >= point.z)
        })
    }

    /// Whether a place, m in the frame of the map, is so near that a known obstacle there is seen by its shape, too.
    pub fn is_near(camera: DVec3, foot: DVec3) -> bool {
        (foot - camera).truncate().length() <= SHAPED_TO_M
    }

    /// Whether almost none of the near ones of these feet has an obstacle by shape beside it, where anything is known by shape.
    /// Positions in the frame of the map, m.
    pub fn nothing_stands(&self, camera: DVec3, feet: impl Iterator<Item = DVec3>) -> bool {
        let near = feet.filter(|&foot| Screens::is_near(camera, foot));
        let known: Vec<bool> = near.filter_map(|foot| self.stands(foot)).collect();
        let standing = known.iter().filter(|stands| **stands).count();
        (standing as f64) < LEAST_SHAPED * known.len() as f64
    }

    /// Whether an obstacle stands at a place on the ground or beside it; `None` where nothing is known by its shape.
    fn stands(&self, foot: DVec3) -> Option<bool> {
        let cells = (SAME_M / self.cell_size_m).ceil().clamp(0.0, MOST_BESIDE) as i64;
        let mut is_known = false;
        for (x, y) in square(cells) {
            let beside = foot + DVec3::new(x as f64, y as f64, 0.0) * self.cell_size_m;
            let Some((column, row)) = self.cell_of(beside) else { continue };
            if self.solid.iter().any(|field| is_obstacle(field, column, row)) {
                return Some(true);
            }
            let ground = self.ground.as_ref().and_then(|ground| ground.get(column, row));
            is_known |= ground.is_some_and(f64::is_finite);
        }
        is_known.then_some(false)
    }

    /// Whether the obstacle in the cell of a point is as high as the point.
    fn reaches(&self, point: DVec3) -> bool {
        self.cell_of(point).is_some_and(|(column, row)| {
            self.solid.iter().any(|field| is_obstacle(field, column, row))
                && self.top.get(column, row).is_some_and(|top| top.is_finite() && top >= point.z)
        })
    }

    /// Column and row of a point.
    fn cell_of(&self, point: DVec3) -> Option<(usize, usize)> {
        let at = self.grid_from_frame * point / self.cell_size_m;
        (at.x >= 0.0 && at.y >= 0.0).then_some((at.x as usize, at.y as usize))
    }
}

/// The cells of a square around a cell, up to so many to each side.
fn square(cells: i64) -> impl Iterator<Item = (i64, i64)> {
    (-cells..=cells).flat_map(move |x| (-cells..=cells).map(move |y| (x, y)))
}

/// Up to which distance from a foot at a distance an obstacle may be the known one itself, m.
fn tolerance_m(distance_m: f64) -> f64 {
    distance_m * SAME_SHARE + SAME_M
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use glam::DVec2;
    use rcs_geom::CellIndex;
    use rcs_msg::Stamp;
    use rcs_msg::foxglove::{Grid, Vector2};
    use rcs_world::{HeightStats, Map, MapOptions, Source, Sources, VoteRule, Weights};

    const CAMERA: DVec3 = DVec3::new(0.0, 0.0, 1.0);

    /// A map with a wall across x = 3 m, of this height (m), that this source has seen.
    pub(crate) fn wall(height_m: f32, source: Source) -> Grid {
        let mut map = Map::new(0.2).unwrap();
        map.recentre(DVec2::ZERO).unwrap();
        for step in -10..=10 {
            let index = map.grid().cell_at(DVec2::new(3.1, 0.2 * f64::from(step) + 0.1)).unwrap();
            let rule = VoteRule { rise: 60, ..VoteRule::default() };
            map.vote(index, source, 250, 1, Stamp(1), rule);
            let mut heights = HeightStats::default();
            (0..9).for_each(|_| heights.add(height_m));
            let cell = map.cell_mut(index).unwrap();
            cell.observe_heights(&HeightStats::default(), &heights, 0.2, Stamp(1), rule);
        }
        let sources: Sources = [Source::STEREO, source].into_iter().collect();
        map.to_grid("local", Stamp(1), &MapOptions { sources, heights: true, weights: Weights::default() })
    }

    fn is_hidden(grid: &Grid, foot: DVec3) -> bool {
        let view = GridView::new(grid).unwrap();
        Screens::of(&view).unwrap().hides(CAMERA, foot)
    }

    #[test]
    fn a_wall_hides_what_stands_behind_it_and_nothing_before_or_beside_it() {
        let grid = wall(1.5, Source::STEREO);
        for (x, y, expected) in [(5.0, 0.0, true), (9.0, 1.0, true), (2.5, 0.0, false), (5.0, 5.0, false)] {
            assert_eq!(is_hidden(&grid, DVec3::new(x, y, 0.0)), expected, "({x}, {y})");
        }
        assert!(!is_hidden(&grid, DVec3::new(3.4, 0.0, 0.0)), "it may be the wall");
        assert!(!is_hidden(&grid, DVec3::new(0.1, 0.0, 0.0)), "at the camera");
    }

    #[test]
    fn what_is_lower_than_the_ray_hides_nothing() {
        // At 3 m the ray to 5 m is 0.4 m high, and that to 9 m 0.67 m.
        let grid = wall(0.5, Source::STEREO);
        assert!(is_hidden(&grid, DVec3::new(5.0, 0.0, 0.0)));
        assert!(!is_hidden(&grid, DVec3::new(9.0, 0.0, 0.0)));
    }

    #[test]
    fn what_stands_close_to_a_foot_and_is_higher_than_the_known_obstacle_is_not_it() {
        let is_other = |height_m: f32, x: f64| {
            let grid = wall(height_m, Source::STEREO);
            let view = GridView::new(&grid).unwrap();
            Screens::of(&view).unwrap().towers_over(CAMERA, DVec3::new(x, 0.0, 0.0), 1.0)
        };
        // The wall is at 3.0 to 3.2 m.
        assert_eq!([2.0, 3.1, 4.2].map(|x| is_other(1.5, x)), [true; 3]);
        assert_eq!([1.4, 5.0].map(|x| is_other(1.5, x)), [false; 2]);
        assert!(!is_other(1.2, 3.1), "it may be the known obstacle itself");
    }

    #[test]
    fn nothing_towers_over_a_foot_on_the_horizon_and_the_search_ends() {
        let grid = wall(1.5, Source::STEREO);
        let view = GridView::new(&grid).unwrap();
        let screens = Screens::of(&view).unwrap();
        for x in [1e4, 1e7, 1e12, f64::INFINITY, f64::NAN] {
            assert!(!screens.towers_over(CAMERA, DVec3::new(x, 0.0, 0.0), 1.0), "{x}");
        }
    }

    /// A strip of ground to 10 m ahead and behind and 2 m to each side with these heights by the distance ahead, m, that
    /// stereo has seen.
    fn strip(height_m: impl Fn(f32) -> f32) -> Map {
        let mut map = Map::new(0.2).unwrap();
        map.recentre(DVec2::ZERO).unwrap();
        for (step, across) in (-50..50).flat_map(|step| (-10..10).map(move |across| (step, across))) {
            let x = 0.2 * f64::from(step) + 0.1;
            let index = map.grid().cell_at(DVec2::new(x, 0.2 * f64::from(across) + 0.1)).unwrap();
            map.vote(index, Source::STEREO, 0, 1, Stamp(1), VoteRule::default());
            let mut heights = HeightStats::default();
            heights.add(height_m(x as f32));
            let cell = map.cell_mut(index).unwrap();
            cell.observe_heights(&heights, &HeightStats::default(), 0.2, Stamp(1), VoteRule::default());
        }
        map
    }

    /// Level ground, with a wall of this height, m, across x = 4 m.
    pub(crate) fn ground(wall_m: Option<f32>) -> Grid {
        let mut map = strip(|_| 0.0);
        for step in -10..10 {
            let Some(height_m) = wall_m else { continue };
            let index = map.grid().cell_at(DVec2::new(4.1, 0.2 * f64::from(step) + 0.1)).unwrap();
            stand(&mut map, index, height_m);
        }
        seen_by_stereo(&mut map)
    }

    /// An obstacle of this height, m, that stereo has seen in a cell.
    fn stand(map: &mut Map, index: CellIndex, height_m: f32) {
        let rule = VoteRule { rise: 60, ..VoteRule::default() };
        for time in 2..6 {
            map.vote(index, Source::STEREO, 250, 1, Stamp(time), rule);
        }
        let mut heights = HeightStats::default();
        (0..9).for_each(|_| heights.add(height_m));
        let cell = map.cell_mut(index).unwrap();
        cell.observe_heights(&HeightStats::default(), &heights, 0.2, Stamp(6), rule);
    }

    fn seen_by_stereo(map: &mut Map) -> Grid {
        let sources: Sources = [Source::STEREO].into_iter().collect();
        map.to_grid("local", Stamp(1), &MapOptions { sources, heights: true, weights: Weights::default() })
    }

    #[test]
    fn a_slope_behind_a_foot_is_what_its_pixels_show() {
        // Ground that rises by this from 4 m on; a ray to 0.5 m above a foot at 4 m meets level ground at 8 m.
        let is_slope = |rise: f32| {
            let grid = seen_by_stereo(&mut strip(|x| rise * (x - 4.0).max(0.0)));
            let view = GridView::new(&grid).unwrap();
            let foot = DVec3::new(4.1, 0.1, 0.0);
            Screens::of(&view).unwrap().shows_ground(CAMERA, foot, DVec3::Z, 1.0, 1.0)
        };
        // At 7 m, three quarters of the way, the ray is 0.14 m high.
        assert_eq!([0.0, 0.03, 0.07, 0.2].map(is_slope), [false, false, true, true]);
    }

    #[test]
    fn of_what_is_near_something_has_been_seen_by_its_shape_or_it_does_not_stand_there() {
        let nothing_stands = |has_post: bool, feet: &[[f64; 2]]| {
            let mut map = strip(|_| 0.0);
            if has_post {
                let index = map.grid().cell_at(DVec2::new(4.3, 0.1)).unwrap();
                stand(&mut map, index, 0.5);
            }
            let grid = seen_by_stereo(&mut map);
            let view = GridView::new(&grid).unwrap();
            let feet = feet.iter().map(|&[x, y]| DVec3::new(x, y, 0.0));
            Screens::of(&view).unwrap().nothing_stands(CAMERA, feet)
        };
        let soil = [[4.1, 0.1], [4.5, 0.1], [6.1, 0.1]];
        assert!(nothing_stands(false, &soil));
        assert!(!nothing_stands(true, &soil), "one of three");
        assert!(nothing_stands(true, &[[6.1, 0.1]; 3]), "it stands elsewhere");
        let many: Vec<_> = std::iter::repeat_n([6.1, 0.1], 20).chain([[4.1, 0.1]]).collect();
        assert!(nothing_stands(true, &many), "one of twenty");
        assert!(!nothing_stands(false, &[[8.1, 0.1], [9.1, 0.1]]), "they are far");
        assert!(!nothing_stands(false, &[[4.1, 5.0], [4.1, -3.0]]), "nothing is known there");
        assert!(!nothing_stands(false, &[]));
    }

    #[test]
    fn in_a_map_of_tiny_cells_the_search_beside_a_foot_ends() {
        let size = Some(Vector2 { x: 1e-6, y: 1e-6 });
        let grid = Grid { cell_size: size, ..wall(1.5, Source::STEREO) };
        let view = GridView::new(&grid).unwrap();
        let screens = Screens::of(&view).unwrap();
        assert!(!screens.nothing_stands(CAMERA, std::iter::once(DVec3::X)), "nothing is known there");
    }

    #[test]
    fn what_colour_says_hides_nothing() {
        assert!(!is_hidden(&wall(1.5, Source::COLOR), DVec3::new(5.0, 0.0, 0.0)));
    }

    #[test]
    fn a_map_without_heights_or_shapes_has_no_screens() {
        let mut map = Map::new(0.2).unwrap();
        map.recentre(DVec2::ZERO).unwrap();
        for (sources, heights) in [(Source::STEREO, false), (Source::COLOR, true)] {
            let options =
                MapOptions { sources: [sources].into_iter().collect(), heights, weights: Weights::default() };
            let grid = map.to_grid("local", Stamp(1), &options);
            assert!(Screens::of(&GridView::new(&grid).unwrap()).is_none());
        }
    }
}
