//! What stands in front of the foot of a known obstacle.
//!
//! Pixels of a hedge or a bush may have the colours of a known obstacle. Its foot then seems to lie where the rays of these
//! pixels meet the ground, which is behind the hedge. Where the world model has an obstacle on the way to the foot that is
//! high enough to hide it, the pixels show that obstacle. Only what was seen by its shape or touched counts (stereo,
//! infrared, bumper): known obstacles must not hide each other, and themselves, by where they were placed before.

use crate::gate::{SOLID, is_obstacle_of};
use glam::DVec3;
use rcs_geom::Pose;
use rcs_world::{Field, GridView};

/// A foot is placed with an error that increases with its distance, and so is what hides it: up to this distance, m, and
/// this share of the distance of the foot, an obstacle in front of it is taken for the known obstacle itself.
const SAME_M: f64 = 0.5;
const SAME_SHARE: f64 = 0.1;
/// Nothing nearer to the camera than this, m, is looked at.
const NEAREST_M: f64 = 0.5;

/// The obstacles of a map that hide what lies behind them.
pub struct Screens<'a> {
    solid: Vec<Field<'a>>,
    top: Field<'a>,
    grid_from_frame: Pose,
    cell_size_m: f64,
}

impl<'a> Screens<'a> {
    /// Those of a map with costs by shape and with the heights of obstacles; `None` of another map.
    pub fn of(map: &'a GridView<'a>) -> Option<Screens<'a>> {
        let solid: Vec<Field<'_>> = SOLID.iter().filter_map(|name| map.field(name).ok()).collect();
        let top = map.field("obstacle.max").ok().filter(|_| !solid.is_empty())?;
        let size = map.cell_size_m();
        let cell_size_m = size.x.min(size.y);
        let grid_from_frame = map.frame_from_grid().inverse();
        (cell_size_m > 0.0).then_some(Screens { solid, top, grid_from_frame, cell_size_m })
    }

    /// Whether one of them hides a place on the ground from the camera, and is not there itself. Positions in the frame of
    /// the map, m.
    pub fn hides(&self, camera: DVec3, foot: DVec3) -> bool {
        let distance_m = (foot - camera).truncate().length();
        let end_m = distance_m * (1.0 - SAME_SHARE) - SAME_M;
        let step_m = 0.5 * self.cell_size_m;
        let steps = ((end_m - NEAREST_M) / step_m).floor().clamp(-1.0, 1e4) as i64;
        (0..=steps).any(|step| {
            let along = (NEAREST_M + step as f64 * step_m) / distance_m;
            self.reaches(camera.lerp(foot, along))
        })
    }

    /// Whether the obstacle in the cell of a point of a ray is as high as the point.
    fn reaches(&self, point: DVec3) -> bool {
        let at = self.grid_from_frame * point / self.cell_size_m;
        let (column, row) = (at.x as usize, at.y as usize);
        let is_inside = at.x >= 0.0 && at.y >= 0.0;
        is_inside
            && self.solid.iter().any(|field| is_obstacle_of(field, column, row))
            && self.top.get(column, row).is_some_and(|top| top.is_finite() && top >= point.z)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use glam::DVec2;
    use rcs_msg::Stamp;
    use rcs_msg::foxglove::Grid;
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
