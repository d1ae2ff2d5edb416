//! Conversion of cost maps to votes (Albus 2006a, 4, Albus 2006b, 3.4).

use crate::resample::{Resampled, is_finer, resampled};
use rcs_geom::{CellIndex, CellRect, DVec2};
use rcs_msg::{Stamp, foxglove::Grid};
use rcs_world::{GridView, GridViewError, Label, Map, OBSTACLE_COST, Source, SourceKind, VoteRule};

/// Least share of a larger cell of the map that a touch must know to free it, and to free one in which something was hit.
const DRIVEN_SHARE: f64 = 0.5;
const HIT_SHARE: f64 = 0.75;

/// Properties common to all votes of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoteOrigin {
    /// The voting source.
    pub source: Source,
    /// How its evidence is used.
    pub kind: SourceKind,
    /// Sequence number of the message, stored as provenance.
    pub sequence: u32,
    /// Acquisition time of the message.
    pub time: Stamp,
    /// Weight of a vote.
    pub rule: VoteRule,
    /// Costs with less backing do not vote.
    pub least_backing: u8,
    /// Ground heights that differ by less agree, m.
    pub height_tolerance_m: f32,
}

/// Result of a message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// Number of cells that received a vote or a statement.
    pub votes: u64,
    /// Cells of the message outside of the map.
    pub outside: u64,
}

/// Takes a cost map of a source. The grid's frame is the map's; its field `cost.<source>` (u8, 0–250, 255 unknown) is
/// needed. Cells of other sizes or turned ones are resampled, see [`resampled`].
///
/// - Each cell of the map that has a cost in the message receives one vote, of the worth `worth.<source>` (u8, 255 for a
///   full vote), the backing `backing.<source>` and the model `model.<source>` if the message has these fields.
/// - A message with the field `conf.<source>` states the evidence instead (a learned map): it replaces everything that
///   was known of the source where the message has cells, known or not, with the confidence `conf.<source>`, the
///   backing `backing.<source>` and the model `model.<source>`.
///
/// Cells with less than the least backing are left out. In those of a message that votes, an obstacle that the source
/// saw before loses confidence ([`Map::missed`]): else one frame that takes ground for a known obstacle would stay.
///
/// Where the cells of a touch ([`SourceKind::Override`]) are smaller than the map's, one that is below the cost of an
/// obstacle says nothing unless the touch knows half of the map's cell, and three quarters of one in which something was
/// hit: what was driven over in part may be blocked in the other.
///
/// Heights are taken where the message has them (`ground.mean` and the others of [`Map::to_grid`]).
pub fn take(map: &mut Map, grid: &Grid, origin: &VoteOrigin) -> Result<Taken, GridViewError> {
    let Resampled { mut cells, is_state, outside } = resampled(grid, origin.source, map.grid())?;
    let view = GridView::new(grid)?;
    if origin.kind == SourceKind::Override && is_finer(&view, map.grid()) {
        let cell_size_m = map.grid().cell_size_m();
        let share_of_one = view.cell_size_m().element_product() / (cell_size_m * cell_size_m);
        cells.retain(|sensed| {
            let was_hit = Label::of_cost(map.evidence(origin.source, sensed.cell).cost) == Label::Obstacle;
            let least = if was_hit { HIT_SHARE } else { DRIVEN_SHARE };
            sensed.vote.cost >= OBSTACLE_COST || f64::from(sensed.count) * share_of_one > least - 1e-6
        });
    }
    cells.retain(|sensed| {
        let is_backed = sensed.vote.backing >= origin.least_backing;
        if !is_backed && !is_state {
            map.missed(sensed.cell, origin.source, origin.rule);
        }
        is_backed
    });
    if is_state {
        let stated: Vec<_> =
            cells.iter().map(|sensed| (sensed.cell, sensed.stated(origin.sequence))).collect();
        map.state(origin.source, window_of(&view, map), &stated, origin.time);
    }
    for sensed in &cells {
        if !is_state {
            map.vote(sensed.cell, origin.source, sensed.vote, origin.sequence, origin.time, origin.rule);
        }
        let [ground, obstacle] = &sensed.heights;
        if (ground.count > 0 || obstacle.count > 0)
            && let Some(cell) = map.cell_mut(sensed.cell)
        {
            cell.observe_heights(ground, obstacle, origin.height_tolerance_m, origin.time, origin.rule);
        }
    }
    Ok(Taken { votes: cells.len() as u64, outside })
}

/// The cells of the map that a message covers; of one that is turned, those of the rectangle around it. Those at its border
/// of which it covers only a part belong to it, unless its cells are smaller than the map's: what it says of the part is not
/// what it said of the whole.
fn window_of(view: &GridView<'_>, map: &Map) -> CellRect {
    let size = DVec2::new(view.columns() as f64, view.rows() as f64) * view.cell_size_m();
    let corners = [DVec2::ZERO, DVec2::new(size.x, 0.0), DVec2::new(0.0, size.y), size];
    let corners = corners.map(|at| (view.frame_from_grid() * at.extend(0.0)).truncate());
    // Borders of cells belong to neither side.
    let (inside, cut) = if is_finer(view, map.grid()) { (-1e-6, 1) } else { (1e-6, 0) };
    let low = map.grid().cell_at(corners.into_iter().fold(DVec2::INFINITY, DVec2::min) + inside);
    let high = map.grid().cell_at(corners.into_iter().fold(DVec2::NEG_INFINITY, DVec2::max) - inside);
    let (Some(low), Some(high)) = (low, high) else {
        return CellRect { south_west: CellIndex::new(0, 0), columns: 0, rows: 0 };
    };
    let (south_west, north_east) = (low.offset(cut, cut), high.offset(-cut, -cut));
    let count = |from: i64, to: i64| usize::try_from(to - from + 1).unwrap_or(0);
    let [columns, rows] = [count(south_west.x, north_east.x), count(south_west.y, north_east.y)];
    CellRect { south_west, columns, rows }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_world::{Evidence, MapOptions, Sources, UNKNOWN_COST, Vote, Weights};

    const RULE: VoteRule = VoteRule { rise: 30, fall: 20, obstacle_fall: 20, max: 255, ground_max: 80 };

    fn origin(source: Source, sequence: u32) -> VoteOrigin {
        VoteOrigin {
            source,
            kind: SourceKind::Range,
            sequence,
            time: Stamp(u64::from(sequence)),
            rule: RULE,
            least_backing: 0,
            height_tolerance_m: 0.2,
        }
    }

    /// A cost map around `centre` with the given costs at the given positions; all other cells are unknown.
    fn grid(centre: DVec2, source: Source, costs: &[(DVec2, u8)]) -> Grid {
        let mut grid = statement(centre, source, costs);
        grid.fields.retain(|field| field.name.starts_with("cost"));
        grid
    }

    /// The same with the confidence of one vote.
    fn statement(centre: DVec2, source: Source, costs: &[(DVec2, u8)]) -> Grid {
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
    fn a_cell_names_the_model_that_judged_it_last() {
        let (place, source) = (DVec2::new(3.1, -2.3), Source::TERRAIN);
        let mut map = Map::new(0.2).unwrap();
        let cell = map.grid().cell_at(place).unwrap();
        let said = |model: u8| {
            let mut stated = Map::new(0.2).unwrap();
            stated.vote(cell, source, Vote { model, ..Vote::from(30) }, 1, Stamp(1), RULE);
            let sources: Sources = [source].into_iter().collect();
            let options = MapOptions { sources, heights: false, weights: Weights::default() };
            stated.to_grid("local", Stamp(1), &options)
        };
        for (sequence, model, updated) in [(1, 7, 1), (2, 7, 1), (3, 9, 1)] {
            take(&mut map, &said(model), &origin(source, sequence)).unwrap();
            assert_eq!(map.evidence(source, cell).model, model);
            assert_eq!(map.grid().get(cell).unwrap().updated, Stamp(updated), "nothing else has changed");
        }
        // The same as votes, which say nothing of confidence.
        let mut votes = said(4);
        votes.fields.retain(|field| !field.name.starts_with("conf"));
        take(&mut map, &votes, &origin(source, 4)).unwrap();
        assert_eq!(map.evidence(source, cell).model, 4);
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
    fn costs_with_too_little_backing_do_not_vote() {
        let [a, b] = [DVec2::new(1.1, 0.1), DVec2::new(2.1, 0.1)];
        let mut message = grid(DVec2::ZERO, Source::COLOR, &[(a, 250), (b, 250)]);
        let mut map = Map::new(0.2).unwrap();
        let origin = VoteOrigin { least_backing: 128, ..origin(Source::COLOR, 1) };
        assert_eq!(take(&mut map, &message, &origin).unwrap().votes, 0, "without backing");
        // The cell of `a` is backed by 200, all others by 100.
        let offset = message.cell_stride as usize;
        let at = map.grid().cell_at(a).unwrap();
        let south_west = map.grid().bounds().south_west;
        let backed = ((at.y - south_west.y) * i64::from(message.column_count) + at.x - south_west.x) as usize;
        let cells = message.data.chunks(offset).enumerate();
        let data: Vec<u8> =
            cells.flat_map(|(i, cell)| [cell, &[if i == backed { 200 } else { 100 }]].concat()).collect();
        message.data = data.into();
        message.fields.push(rcs_msg::foxglove::PackedElementField {
            name: "backing.color".to_owned(),
            offset: offset as u32,
            r#type: rcs_world::NumericType::Uint8.into(),
        });
        message.cell_stride += 1;
        message.row_stride += message.column_count;
        assert_eq!(take(&mut map, &message, &origin).unwrap().votes, 1);
        let said = |place| map.evidence(Source::COLOR, map.grid().cell_at(place).unwrap());
        assert_eq!((said(a).cost, said(b)), (250, Evidence::NONE));
        // What is seen there again without the backing takes the confidence away, and is no ground.
        let (seen, unbacked) = (said(a), grid(DVec2::ZERO, Source::COLOR, &[(a, 40), (b, 40)]));
        assert_eq!(take(&mut map, &unbacked, &origin).unwrap().votes, 0);
        let evidence = map.evidence(Source::COLOR, at);
        assert_eq!(evidence, seen.faded(RULE.obstacle_fall));
        assert!(evidence.confidence > 0 && evidence.cost == 250);
        take(&mut map, &unbacked, &origin).unwrap();
        assert_eq!(map.evidence(Source::COLOR, at), Evidence::NONE);
        assert!(map.layer(Source::COLOR).unwrap().iter().all(|(_, held)| *held == Evidence::NONE));
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

    #[test]
    fn a_state_replaces_what_was_known_of_its_source_alone() {
        let [a, b] = [DVec2::new(1.1, 0.1), DVec2::new(2.1, 0.1)];
        let mut map = Map::new(0.2).unwrap();
        let said = |map: &Map, source, place| map.evidence(source, map.grid().cell_at(place).unwrap());
        take(&mut map, &grid(DVec2::ZERO, Source::STEREO, &[(a, 250)]), &origin(Source::STEREO, 1)).unwrap();
        for (sequence, costs) in [(1, [(a, 250), (b, 250)]), (2, [(b, 10), (b, 10)])] {
            let message = statement(DVec2::ZERO, Source::TERRAIN, &costs);
            take(&mut map, &message, &origin(Source::TERRAIN, sequence)).unwrap();
        }
        assert_eq!(said(&map, Source::TERRAIN, a), Evidence::NONE);
        assert_eq!((said(&map, Source::TERRAIN, b).cost, said(&map, Source::TERRAIN, b).sequence), (10, 2));
        assert_eq!(said(&map, Source::STEREO, a).cost, 250);
        // The same statement again changes nothing, not even the sequence.
        let before = map.clone();
        let again = statement(DVec2::ZERO, Source::TERRAIN, &[(b, 10), (b, 10)]);
        take(&mut map, &again, &origin(Source::TERRAIN, 3)).unwrap();
        assert_eq!(map, before);
    }

    #[test]
    fn a_state_leaves_what_lies_outside_of_its_window_as_it_was_said() {
        let [behind, ahead] = [DVec2::new(-15.1, 0.1), DVec2::new(15.1, 0.1)];
        let mut map = Map::with_side(401, 0.2).unwrap();
        let said = |map: &Map, place| map.evidence(Source::TERRAIN, map.grid().cell_at(place).unwrap()).cost;
        let at = |x: f64| DVec2::new(x, 0.0);
        for (sequence, centre, costs) in
            [(1, at(0.0), [(behind, 90), (ahead, 90)]), (2, at(10.0), [(ahead, 40); 2])]
        {
            let message = statement(centre, Source::TERRAIN, &costs);
            take(&mut map, &message, &origin(Source::TERRAIN, sequence)).unwrap();
        }
        assert_eq!((said(&map, behind), said(&map, ahead)), (90, 40));
        take(&mut map, &statement(at(0.0), Source::TERRAIN, &[]), &origin(Source::TERRAIN, 3)).unwrap();
        assert_eq!((said(&map, behind), said(&map, ahead)), (UNKNOWN_COST, UNKNOWN_COST));
    }

    #[test]
    fn a_state_leaves_a_larger_cell_that_has_left_its_window_in_part_as_it_was_said() {
        let [outer, inner, next] = [-19.9, -19.7, -19.5].map(|x| DVec2::new(x, 0.1));
        let mut map = Map::new(0.4).unwrap();
        let said = |map: &Map, place| map.evidence(Source::TERRAIN, map.grid().cell_at(place).unwrap()).cost;
        let all = statement(DVec2::ZERO, Source::TERRAIN, &[(outer, 250), (inner, 10), (next, 10)]);
        take(&mut map, &all, &origin(Source::TERRAIN, 1)).unwrap();
        assert_eq!((said(&map, inner), said(&map, next)), (250, 10));
        // The vehicle moves on by one cell of the message, which begins at -19.8 m now.
        let rest = statement(DVec2::new(0.3, 0.1), Source::TERRAIN, &[(inner, 10), (next, 40)]);
        take(&mut map, &rest, &origin(Source::TERRAIN, 2)).unwrap();
        assert_eq!((said(&map, inner), said(&map, next)), (250, 40));
    }

    #[test]
    fn a_touch_frees_a_larger_cell_where_it_has_driven_over_half_of_it_and_more_where_something_was_hit() {
        let at = |x: f64, y: f64| DVec2::new(x, y);
        let all = [at(0.1, 0.1), at(0.3, 0.1), at(0.1, 0.3), at(0.3, 0.3)].map(|place| (place, 0));
        let touch = |map: &mut Map, kind: SourceKind, costs: &[(DVec2, u8)]| {
            let message = grid(DVec2::ZERO, Source::BUMPER, costs);
            take(map, &message, &VoteOrigin { kind, ..origin(Source::BUMPER, 1) }).unwrap();
            map.evidence(Source::BUMPER, map.grid().cell_at(at(0.1, 0.1)).unwrap()).cost
        };
        let empty = |cell_size_m: f64| Map::new(cell_size_m).unwrap();
        let touched = |cell_size_m, kind, count| touch(&mut empty(cell_size_m), kind, &all[..count]);
        let driven: Vec<u8> = (1..=4).map(|count| touched(0.4, SourceKind::Override, count)).collect();
        assert_eq!(driven, [UNKNOWN_COST, 0, 0, 0]);
        assert_eq!(touched(0.4, SourceKind::Range, 1), 0, "a sensor that sees a part of it");
        assert_eq!(touched(0.2, SourceKind::Override, 1), 0, "each cell by itself");
        // Half of it under the vehicle does not free what was hit in the other half; driving over more does.
        let mut map = empty(0.4);
        assert_eq!(touch(&mut map, SourceKind::Override, &[(at(0.1, 0.3), 250), all[0], all[1]]), 250);
        for _ in 0..9 {
            assert_eq!(touch(&mut map, SourceKind::Override, &all[..2]), 250);
        }
        for _ in 0..9 {
            touch(&mut map, SourceKind::Override, &all[..3]);
        }
        assert_eq!(touch(&mut map, SourceKind::Override, &all[..3]), 0);
    }

    #[test]
    fn what_is_driven_over_is_one_way_on_larger_cells_whatever_its_direction() {
        for heading_deg in [0.0_f64, 5.0, 20.0, 45.0, 80.0] {
            let mut map = Map::new(0.4).unwrap();
            let along = DVec2::from_angle(heading_deg.to_radians());
            // A body of 0.6 m by 1 m, each 0.1 m of 10 m.
            for step in 0..100 {
                let middle = along * (f64::from(step) * 0.1) + DVec2::new(0.07, 0.13);
                let places =
                    (-5..=5).flat_map(|x| (-5..=5).map(move |y| DVec2::new(x.into(), y.into()) * 0.2));
                let first = map.grid().middle_of(map.grid().cell_at(middle).unwrap());
                let middles = places.map(|offset| first + DVec2::splat(0.1) + offset);
                let is_under = |place: &DVec2| {
                    let from = *place - middle;
                    from.dot(along).abs() <= 0.5 && from.perp_dot(along).abs() <= 0.3
                };
                let driven: Vec<(DVec2, u8)> = middles.filter(is_under).map(|place| (place, 0)).collect();
                let message = grid(DVec2::ZERO, Source::BUMPER, &driven);
                let origin = VoteOrigin { kind: SourceKind::Override, ..origin(Source::BUMPER, step + 1) };
                take(&mut map, &message, &origin).unwrap();
            }
            // From its beginning, steps over the sides of cells lead to its end.
            let is_free = |cell: CellIndex| map.evidence(Source::BUMPER, cell).cost == 0;
            let cell_at =
                |along_m: f64| map.grid().cell_at(along * along_m + DVec2::new(0.07, 0.13)).unwrap();
            let mut reached = vec![cell_at(0.5)];
            let mut next = 0;
            while let Some(&cell) = reached.get(next) {
                next += 1;
                let beside = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(x, y)| cell.offset(x, y));
                let new: Vec<_> =
                    beside.into_iter().filter(|c| is_free(*c) && !reached.contains(c)).collect();
                reached.extend(new);
            }
            assert!(reached.contains(&cell_at(9.0)), "{heading_deg} degrees: {} cells", reached.len());
        }
    }
}
