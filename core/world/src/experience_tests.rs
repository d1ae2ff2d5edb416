//! Drives on small maps.

use super::*;
use crate::{Map, MapMessage, MapOptions, VoteRule, fuse};
use proptest::prelude::*;
use rcs_geom::DVec2;

fn weights() -> Weights {
    let kinds = [
        (Source::STEREO, 1.0, SourceKind::Range),
        (Source::COLOR, 0.5, SourceKind::Learned),
        (Source::BUMPER, 1.0, SourceKind::Override),
    ];
    kinds.into_iter().map(|(source, weight, kind)| Weighted { source, weight, kind }).collect()
}

/// Votes of one source at positions.
fn vote(map: &mut Map, source: Source, cost: u8, times: u32, at: &[DVec2]) {
    for &at in at {
        for sequence in 0..times {
            let cell = map.grid().cell_at(at).unwrap();
            map.vote(cell, source, cost, sequence, Stamp(1), VoteRule::default());
        }
    }
}

fn row(y_m: f64) -> Vec<DVec2> {
    (0..30).map(|x| DVec2::new(0.1 + 0.2 * f64::from(x), y_m)).collect()
}

/// A drive: colour calls a free row and a row of obstacles the wrong way round, stereo says little of either at first.
/// Then the free row is driven over, and stereo becomes sure of the other one.
fn drive() -> Experience {
    drive_with_maps().0
}

/// The same, with the map before these things are known and the last map, at the same place.
fn drive_with_maps() -> (Experience, [Map; 2]) {
    let (free, blocked) = (row(0.1), row(2.1));
    let mut experience = Experience::new(&weights());
    let mut map = Map::with_side(61, 0.2).unwrap();
    map.recentre(DVec2::new(3.0, 0.0));
    vote(&mut map, Source::STEREO, 0, 1, &free);
    vote(&mut map, Source::STEREO, 250, 1, &blocked);
    vote(&mut map, Source::COLOR, 200, 12, &free);
    vote(&mut map, Source::COLOR, 20, 12, &blocked);
    take(&mut experience, &map, 1);
    take(&mut experience, &map, 2);
    // The vehicle has moved on, and so has the map.
    map.recentre(DVec2::new(4.0, 0.4));
    let unsure = map.clone();
    vote(&mut map, Source::STEREO, 250, 12, &blocked);
    vote(&mut map, Source::BUMPER, 0, 1, &free);
    take(&mut experience, &map, 3);
    take(&mut experience, &map, 4);
    (experience, [unsure, map])
}

fn take(experience: &mut Experience, map: &Map, time_s: u64) {
    let options = MapOptions {
        sources: [Source::STEREO, Source::COLOR, Source::BUMPER].into_iter().collect(),
        heights: false,
        weights: weights(),
    };
    let time = Stamp(time_s * 1_000_000_000);
    let message = MapMessage::new(map.clone(), "local", time, options);
    experience.take(&GridView::of_map(&message), time).unwrap();
}

#[test]
fn what_was_said_before_is_a_sample_once_it_is_known_what_the_cell_is() {
    let experience = drive();
    let judged = experience.samples().judge(&weights());
    // Two earlier maps each, of 30 cells each; what is known already gives no more samples.
    assert_eq!(judged.count, [60, 0, 60]);
    assert_eq!(judged.unknown, [0; 3]);
    assert!(judged.wrong[0] > 0, "{judged:?}");
}

#[test]
fn a_cell_that_was_uncertain_for_some_time_is_not_learned_again() {
    let (mut experience, [unsure, sure]) = drive_with_maps();
    take(&mut experience, &unsure, 5);
    take(&mut experience, &sure, 6);
    assert_eq!(experience.samples().judge(&weights()).count, [60, 0, 60]);
}

#[test]
fn a_fit_lowers_the_weight_of_the_source_that_was_wrong() {
    let experience = drive();
    let fit = fit(experience.samples(), &weights(), &FitRules::default()).unwrap();
    assert_eq!(fit.weights.get(Source::COLOR).weight, 0.0);
    assert_eq!(fit.weights.get(Source::STEREO).weight, 1.0, "the reference");
    assert_eq!(fit.after.wrong, [0; 3]);
    assert!(fit.after.loss < 0.5 * fit.before.loss, "{fit:?}");
    let bounded = FitRules { greatest_factor: 2.0, ..FitRules::default() };
    let bounded = super::fit(experience.samples(), &weights(), &bounded).unwrap();
    assert_eq!(bounded.weights.get(Source::COLOR).weight, 0.3, "the least within the factor");
    assert_eq!(bounded.changes.len(), 1);
}

#[test]
fn a_source_that_was_turned_off_stays_off_unless_its_weight_may_change_by_any_factor() {
    let samples = drive().samples().clone();
    // Stereo, which was right, is off; colour alone decides, and was wrong.
    let other: Source = "radar".parse().unwrap();
    let kinds = [
        (other, 1.0, SourceKind::Range),
        (Source::STEREO, 0.0, SourceKind::Range),
        (Source::COLOR, 0.5, SourceKind::Learned),
        (Source::BUMPER, 1.0, SourceKind::Override),
    ];
    let weights: Weights =
        kinds.into_iter().map(|(source, weight, kind)| Weighted { source, weight, kind }).collect();
    for (greatest_factor, is_off) in [(4.0, true), (f32::INFINITY, false)] {
        let rules = FitRules { greatest_factor, ..FitRules::default() };
        let fit = fit(&samples, &weights, &rules).unwrap();
        assert_eq!(fit.weights.get(Source::STEREO).weight == 0.0, is_off, "{fit:?}");
    }
}

#[test]
fn from_free_ground_alone_nothing_is_learned() {
    let mut samples = drive().samples().clone();
    let driven: Vec<bool> = samples.outcomes.iter().map(|(_, o)| *o == Outcome::Driven).collect();
    let sources = samples.sources.len();
    let said = samples.said.chunks(sources).zip(&driven).filter(|(_, driven)| **driven);
    samples.said = said.flat_map(|(said, _)| said.to_vec()).collect();
    samples.outcomes.retain(|(_, outcome)| *outcome == Outcome::Driven);
    let error = fit(&samples, &weights(), &FitRules::default()).unwrap_err();
    assert!(error.contains("free ground alone"), "{error}");
}

#[test]
fn a_split_keeps_every_sample_and_an_earlier_map_or_one_of_other_cells_begins_anew() {
    let samples = drive().samples().clone();
    let [a, b] = samples.split(0.5);
    assert_eq!(a.len() + b.len(), samples.len());
    let mut kept = samples.clone();
    kept.keep_newest(7);
    assert_eq!((kept.len(), kept.said.len()), (7, 7 * 3));
    // The second is later, and has other cells.
    for (time, cell_size_m) in [(Stamp(0), 0.2), (Stamp(5_000_000_000), 0.4)] {
        let mut experience = drive();
        let map = Map::with_side(61, cell_size_m).unwrap();
        let options = MapOptions {
            sources: [Source::STEREO].into_iter().collect(),
            heights: false,
            weights: weights(),
        };
        let message = MapMessage::new(map, "local", time, options);
        experience.take(&GridView::of_map(&message), time).unwrap();
        assert_eq!((experience.earlier.len(), experience.samples()), (1, &samples));
        experience.keep_newest(7);
        assert_eq!(experience.samples(), &kept);
    }
}

#[test]
fn a_map_that_is_farther_away_than_cells_can_be_counted_gives_no_samples() {
    let mut map = Map::with_side(61, 0.2).unwrap();
    vote(&mut map, Source::BUMPER, 0, 1, &[DVec2::ZERO]);
    vote(&mut map, Source::COLOR, 200, 12, &row(0.1));
    let options = MapOptions {
        sources: [Source::STEREO, Source::COLOR, Source::BUMPER].into_iter().collect(),
        heights: false,
        weights: weights(),
    };
    let mut grid = map.to_grid("local", Stamp(1), &options);
    let mut experience = Experience::new(&weights());
    // The south-west corner, m. Each map lies apart from the one before.
    let corners = [[-6.0, -6.0], [1e19, 1e19], [-1e19, -1e19], [-6.0, -1e18], [-6.0, -6.0], [1e18, -1e19]];
    for (second, [x, y]) in (1..).zip(corners) {
        grid.pose.as_mut().unwrap().position = Some(rcs_msg::foxglove::Vector3 { x, y, z: 0.0 });
        let time = Stamp(second * 1_000_000_000);
        experience.take(&GridView::new(&grid).unwrap(), time).unwrap();
    }
    assert!(experience.samples().is_empty());
}

proptest! {
    #[test]
    fn judgements_are_those_of_the_fusion_rule(
        cells in prop::collection::vec((any::<[(u8, u8); 3]>(), 0..3_usize), 0..60),
    ) {
        let sources = vec![Source::STEREO, Source::COLOR, Source::BUMPER];
        let mut samples = Samples { sources: sources.clone(), ..Samples::default() };
        let (mut wrong, mut unknown) = ([0; 3], [0; 3]);
        for (said, outcome) in cells {
            let said = said.map(|(cost, confidence)| Evidence { cost, confidence, ..Evidence::NONE });
            samples.said.extend(said);
            samples.outcomes.push((Stamp(0), Outcome::ALL[outcome]));
            let pairs: Vec<_> = sources.iter().copied().zip(said).collect();
            let cost = fuse(&pairs, &weights()).cost;
            if cost == UNKNOWN_COST {
                unknown[outcome] += 1;
            } else if (cost >= OBSTACLE_COST) == (outcome == 0) {
                wrong[outcome] += 1;
            }
        }
        let judged = samples.judge(&weights());
        prop_assert_eq!((judged.wrong, judged.unknown), (wrong, unknown));
    }
}
