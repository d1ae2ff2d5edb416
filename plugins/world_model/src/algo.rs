//! Conversion of cost maps to votes (Albus 2006a, 4, Albus 2006b, 3.4).

use rcs_geom::{DVec2, DVec3};
use rcs_msg::{Stamp, foxglove::Grid};
use rcs_world::{Field, GridView, GridViewError, HeightStats, MAX_COST, Map, NumericType, Source, VoteRule};

/// Properties common to all votes of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoteOrigin {
    /// The voting source.
    pub source: Source,
    /// Sequence number of the message, stored as provenance.
    pub sequence: u32,
    /// Acquisition time of the message.
    pub time: Stamp,
    /// Weight of a vote.
    pub rule: VoteRule,
    /// Ground heights that differ by less agree, m.
    pub height_tolerance_m: f32,
}

/// Result of a message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// Number of votes.
    pub votes: u64,
    /// Votes for cells outside of the map.
    pub outside: u64,
}

/// Lets every cell of a cost map with a cost vote for the map's cell in which its middle lies. The grid's frame is the
/// map's. Its field `cost.<source>` (u8, 0–250, 255 unknown) is asked for; heights are taken where it has them
/// (`ground.mean` and the others of [`Map::to_grid`]).
pub fn take(map: &mut Map, grid: &Grid, origin: &VoteOrigin) -> Result<Taken, GridViewError> {
    let view = GridView::new(grid)?;
    let costs = view.field_of(&format!("cost.{}", origin.source), NumericType::Uint8)?;
    let ground = Heights::find(&view, "ground");
    let obstacle = Heights::find(&view, "obstacle");
    let map_from_grid = view.frame_from_grid();
    let size = view.cell_size_m();
    let mut taken = Taken::default();
    for row in 0..view.rows() {
        for column in 0..view.columns() {
            let Some(cost) = costs.get(column, row).map(|cost| cost as u8).filter(|&cost| cost <= MAX_COST)
            else {
                continue;
            };
            let middle = DVec2::new(column as f64 + 0.5, row as f64 + 0.5) * size;
            let place = (map_from_grid * DVec3::new(middle.x, middle.y, 0.0)).truncate();
            let Some(index) = map.grid().cell_at(place).filter(|&index| map.grid().contains(index)) else {
                taken.outside += 1;
                continue;
            };
            map.vote(index, origin.source, cost, origin.sequence, origin.time, origin.rule);
            let heights =
                |of: &Option<Heights<'_>>| of.as_ref().map(|h| h.get(column, row)).unwrap_or_default();
            let tolerance = origin.height_tolerance_m;
            if let Some(cell) = map.cell_mut(index) {
                let (ground, obstacle) = (heights(&ground), heights(&obstacle));
                cell.observe_heights(&ground, &obstacle, tolerance, origin.time, origin.rule);
            }
            taken.votes += 1;
        }
    }
    Ok(taken)
}

/// Fields with the heights of one class.
struct Heights<'a> {
    count: Field<'a>,
    mean: Field<'a>,
    variance: Field<'a>,
    min: Field<'a>,
    max: Field<'a>,
}

impl<'a> Heights<'a> {
    /// `None` if the grid lacks one of them.
    fn find(view: &'a GridView<'a>, class: &str) -> Option<Heights<'a>> {
        let field = |number: &str| view.field(&format!("{class}.{number}")).ok();
        Some(Heights {
            count: field("count")?,
            mean: field("mean")?,
            variance: field("variance")?,
            min: field("min")?,
            max: field("max")?,
        })
    }

    /// Heights of a cell; the default if a number is not finite.
    fn get(&self, column: usize, row: usize) -> HeightStats {
        let number = |field: &Field<'_>| field.get(column, row).unwrap_or(f64::NAN);
        let (count, mean, variance) = (number(&self.count), number(&self.mean), number(&self.variance));
        let (min, max) = (number(&self.min), number(&self.max));
        let finite = [count, mean, variance, min, max].iter().all(|value| value.is_finite());
        if !finite || count < 1.0 || variance < 0.0 {
            return HeightStats::default();
        }
        HeightStats {
            count: count as u32,
            mean: mean as f32,
            variance: variance as f32,
            min: min as f32,
            max: max as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_world::{MapOptions, Sources, Weights};

    const RULE: VoteRule = VoteRule { rise: 30, fall: 20, max: 255 };

    fn origin(source: Source, sequence: u32) -> VoteOrigin {
        VoteOrigin { source, sequence, time: Stamp(u64::from(sequence)), rule: RULE, height_tolerance_m: 0.2 }
    }

    /// A cost map around `centre` with the given costs at the given positions; all other cells are unknown.
    fn grid(centre: DVec2, source: Source, costs: &[(DVec2, u8)]) -> Grid {
        let mut map = Map::new(0.2).unwrap();
        map.recentre(centre).unwrap();
        for &(place, cost) in costs {
            let index = map.grid().cell_at(place).unwrap();
            map.vote(index, source, cost, 1, Stamp(1), RULE);
        }
        let sources: Sources = [source].into_iter().collect();
        map.to_grid("local", Stamp(1), &MapOptions { sources, heights: false, weights: Weights::default() })
    }

    #[test]
    fn votes_land_on_the_same_ground_wherever_either_map_is_centred() {
        let place = DVec2::new(3.1, -2.3);
        let mut map = Map::new(0.2).unwrap();
        map.recentre(DVec2::new(5.0, 5.0)).unwrap();
        for (i, centre) in [DVec2::ZERO, DVec2::new(7.7, -9.1)].into_iter().enumerate() {
            let message = grid(centre, Source::STEREO, &[(place, 250)]);
            let taken = take(&mut map, &message, &origin(Source::STEREO, i as u32 + 1)).unwrap();
            assert_eq!(taken, Taken { votes: 1, outside: 0 });
        }
        let evidence = map.evidence(Source::STEREO, map.grid().cell_at(place).unwrap());
        assert_eq!((evidence.cost, evidence.confidence, evidence.sequence), (250, 60, 2));
        let known = map.grid().iter().filter(|(_, cell)| cell.updated != Stamp(0)).count();
        assert_eq!(known, 1);
    }

    #[test]
    fn unknown_cells_do_not_vote_and_votes_outside_of_the_map_are_counted() {
        let mut map = Map::new(0.2).unwrap();
        map.recentre(DVec2::new(30.0, 0.0)).unwrap();
        let message =
            grid(DVec2::ZERO, Source::STEREO, &[(DVec2::new(0.1, 0.1), 0), (DVec2::new(15.0, 0.1), 200)]);
        let taken = take(&mut map, &message, &origin(Source::STEREO, 1)).unwrap();
        assert_eq!(taken, Taken { votes: 1, outside: 1 });
    }

    #[test]
    fn a_grid_without_the_sources_cost_is_refused_and_changes_nothing() {
        let mut map = Map::new(0.2).unwrap();
        let before = map.clone();
        let message = grid(DVec2::ZERO, Source::COLOR, &[(DVec2::ZERO, 250)]);
        assert!(take(&mut map, &message, &origin(Source::STEREO, 1)).is_err());
        assert_eq!(map, before);
    }
}
