//! The map that a run saves for the next one: what it has sensed from near, and beyond that what it remembers.
//!
//! What is sensed is kept in the local frame, in which things stay where they were sensed. The estimate of the global
//! frame moves by metres and turns by degrees within a run, so the map is put there as a whole, when it is saved: what is
//! remembered is then placed as it is registered, and only where nothing is sensed. A wall that is both remembered and
//! sensed would else be saved twice, a metre apart.

use crate::memory::{MemoryError, Rectangle};
use rcs_geom::{DVec2, Pose};
use rcs_world::UNKNOWN_COST;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What a run has sensed from near: the map of the world model forgets what it has left behind.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// Local frame; shared between snapshots.
    map: Option<Arc<Rectangle>>,
}

impl Kept {
    /// Takes what is sensed now (local frame) within a distance of a track, m. The newest counts. Where the track is too
    /// long to keep all that is near it, nothing is taken.
    pub fn take(&mut self, sensed: &Rectangle, track: &[DVec2], within_m: f64) -> Result<(), MemoryError> {
        if track.is_empty() {
            return Ok(());
        }
        let mut grown = Rectangle::around(track, within_m, sensed.cell_size_m)?;
        if let Some(kept) = &self.map {
            for index in 0..grown.costs.len() {
                grown.costs[index] = kept.most(grown.centre(index), grown.cell_size_m);
            }
        }
        for &at in track.iter().filter(|&&at| sensed.holds(at)) {
            grown.around_each(at, within_m, |centre, cost| {
                let seen = sensed.at(centre);
                *cost = if seen == UNKNOWN_COST { *cost } else { seen };
            });
        }
        self.map = Some(Arc::new(grown));
        Ok(())
    }

    /// The map to save in the global frame, together with a remembered map and the pose of its frame in the local one;
    /// `None` before anything is taken.
    pub fn saved(
        &self,
        remembered: Option<(&Rectangle, Pose)>,
        global_from_local: &Pose,
    ) -> Result<Option<Rectangle>, MemoryError> {
        let Some(kept) = &self.map else { return Ok(None) };
        let moved = |frame: &Pose, at: DVec2| (*frame * at.extend(0.0)).truncate();
        let mut corners: Vec<DVec2> = kept.corners().map(|at| moved(global_from_local, at)).into();
        if let Some((map, local_from_map)) = &remembered {
            let global_from_map = *global_from_local * *local_from_map;
            corners.extend(map.corners().map(|at| moved(&global_from_map, at)));
        }
        let mut saved = Rectangle::around(&corners, 0.0, kept.cell_size_m)?;
        let local_from_global = global_from_local.inverse();
        let remembered = remembered.map(|(map, local_from_map)| (map, local_from_map.inverse()));
        for index in 0..saved.costs.len() {
            let local = moved(&local_from_global, saved.centre(index));
            let sensed = kept.at(local);
            let size_m = saved.cell_size_m;
            let old =
                || remembered.map_or(UNKNOWN_COST, |(map, frame)| map.most(moved(&frame, local), size_m));
            saved.costs[index] = if sensed == UNKNOWN_COST { old() } else { sensed };
        }
        saved.trim();
        Ok(Some(saved))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::is_obstacle;

    /// A wall 0.8 m thick along x, 20 m long, whose south side is at this place, with ground on both sides.
    fn wall(south_m: f64) -> Rectangle {
        let mut map = Rectangle::around(&[DVec2::ZERO], 10.0, 0.4).unwrap();
        for index in 0..map.costs.len() {
            let across_m = map.centre(index).y - south_m;
            map.costs[index] = if (0.0..0.8).contains(&across_m) { 250 } else { 0 };
        }
        map
    }

    /// The thickness of walls at an x, m.
    fn thickness_m(map: &Rectangle, x_m: f64) -> f64 {
        let places = (-200..200).map(|step| DVec2::new(x_m, f64::from(step) / 10.0));
        0.1 * places.filter(|&at| is_obstacle(map.at(at))).count() as f64
    }

    #[test]
    fn a_wall_that_is_remembered_beside_its_place_is_saved_once_where_it_is_sensed() {
        let mut kept = Kept::default();
        let track: Vec<DVec2> = (-3..3).map(|x| DVec2::new(f64::from(x), -3.0)).collect();
        kept.take(&wall(0.0), &track, 5.0).unwrap();
        let old = wall(0.0);
        let place = |y_m: f64| Some(Pose::from_translation(DVec2::new(0.0, y_m).extend(0.0)));
        for moved in [None, place(0.0), place(-1.6), place(1.2)] {
            let saved = kept.saved(moved.map(|moved| (&old, moved)), &Pose::IDENTITY).unwrap().unwrap();
            assert!((thickness_m(&saved, 0.0) - 0.8).abs() < 0.15, "{moved:?}");
            // Nothing was sensed there.
            let expected_m = if moved.is_some() { 0.8 } else { 0.0 };
            assert!((thickness_m(&saved, 9.0) - expected_m).abs() < 0.15, "{moved:?}");
        }
    }

    #[test]
    fn a_thin_wall_that_is_kept_or_remembered_stays_where_the_cells_become_larger() {
        let mut thin = Rectangle::around(&[DVec2::ZERO], 4.0, 0.1).unwrap();
        for index in 0..thin.costs.len() {
            let is_wall = (0.1..0.2).contains(&thin.centre(index).y);
            thin.costs[index] = if is_wall { 250 } else { 0 };
        }
        let unknown = Rectangle::around(&[DVec2::ZERO], 4.0, 0.4).unwrap();
        let (mut kept, mut nothing) = (Kept::default(), Kept::default());
        kept.take(&thin, &[DVec2::ZERO], 3.0).unwrap();
        for kept in [&mut kept, &mut nothing] {
            kept.take(&unknown, &[DVec2::ZERO], 3.0).unwrap();
        }
        for (kept, old) in [(kept, None), (nothing, Some((&thin, Pose::IDENTITY)))] {
            let saved = kept.saved(old, &Pose::IDENTITY).unwrap().unwrap();
            assert_eq!(saved.cell_size_m, 0.4);
            let at = |x: i32, y_m: f64| saved.at(DVec2::new(0.1 * f64::from(x) + 0.05, y_m));
            assert!((-20..20).all(|x| at(x, 0.15) == 250 && at(x, 0.6) == 0 && at(x, -0.2) == 0));
        }
    }

    #[test]
    fn the_map_is_rigid_whatever_the_estimate_of_the_position_does_in_between() {
        let mut kept = Kept::default();
        let sensed = wall(0.0);
        for x in -6..6 {
            let track: Vec<DVec2> = (-6..=x).map(|x| DVec2::new(f64::from(x), -1.0)).collect();
            kept.take(&sensed, &track, 2.0).unwrap();
        }
        let turned = Pose::from_xy_yaw(30.0, -7.0, 0.1);
        let saved = kept.saved(None, &turned).unwrap().unwrap();
        for x in -5..5 {
            let in_wall = turned * DVec2::new(f64::from(x), 0.4).extend(0.0);
            assert!(is_obstacle(saved.at(in_wall.truncate())), "{x}");
        }
        assert_eq!(Kept::default().saved(None, &turned), Ok(None));
    }

    #[test]
    fn a_map_that_is_too_large_is_an_error_and_what_was_kept_stays() {
        let check = |error: MemoryError| {
            let is_large =
                matches!(error, MemoryError::Large { columns, rows } if columns > 2500 && rows > 2500);
            assert!(is_large, "{error}");
            assert!(error.to_string().ends_with(" cells, expected at most 4000000 in all"), "{error}");
        };
        let mut kept = Kept::default();
        let near = DVec2::new(0.0, -3.0);
        kept.take(&wall(0.0), &[near], 5.0).unwrap();
        let before = kept.clone();
        check(kept.take(&wall(0.0), &[near, DVec2::splat(1000.0)], 5.0).unwrap_err());
        assert_eq!(kept, before);
        // A map of another place.
        let (old, place) = (wall(0.0), Pose::from_xy_yaw(1000.0, 1000.0, 0.0));
        check(kept.saved(Some((&old, place)), &Pose::IDENTITY).unwrap_err());
        assert!(kept.saved(None, &Pose::IDENTITY).unwrap().is_some());
        // Without a track there is nothing to take.
        kept.take(&wall(0.0), &[], 5.0).unwrap();
        assert_eq!(kept, before);
    }
}
