//! Merging and purity.

use super::*;
use crate::appearance::HISTOGRAMS;

pub(crate) const RULES: ModelRules = ModelRules {
    min_points: 50,
    min_purity: 0.95,
    merge_distance: 0.1,
    max_models: 3,
    near_m: 4.0,
    weights: MatchWeights { histograms: [0.2; HISTOGRAMS], contrast: 0.0 },
};

/// A cell of one colour bin with `ground` and `obstacle` points.
pub(crate) fn cell(code: u16, ground: u64, obstacle: u64) -> Terrain {
    let mut terrain = Terrain { ground, obstacle, ..Terrain::default() };
    (0..ground + obstacle).for_each(|_| terrain.histograms.add(code, 840));
    terrain
}

#[test]
fn a_cell_is_ready_with_enough_points_of_which_95_percent_share_a_label() {
    for (ground, obstacle, ready) in [
        (49, 0, false),
        (50, 0, true),
        (0, 50, true),
        (95, 5, true),
        (5, 95, true),
        (94, 6, false),
        (50, 50, false),
    ] {
        assert_eq!(RULES.is_ready(&cell(0, ground, obstacle)), ready, "{ground} ground, {obstacle} obstacle");
    }
}

#[test]
fn cells_that_look_alike_merge_and_others_become_models_until_there_is_no_room() {
    let mut set = ModelSet::default();
    let mut signatures = set.signatures(&RULES.weights);
    let mut take = |set: &mut ModelSet, cell: &Terrain| {
        let taken = set.take(cell, 1, &RULES, &mut signatures);
        assert_eq!(signatures, set.signatures(&RULES.weights), "signatures are kept up to date");
        taken
    };
    assert_eq!(take(&mut set, &cell(0, 100, 0)), Some(0));
    assert_eq!(take(&mut set, &cell(0, 0, 300)), Some(0), "a match does not ask for the label");
    assert_eq!(take(&mut set, &cell(0o11111, 60, 0)), Some(1));
    assert_eq!(take(&mut set, &cell(0o22222, 60, 0)), Some(2));
    assert_eq!(take(&mut set, &cell(0o33333, 60, 0)), None, "no room");
    assert_eq!(take(&mut set, &cell(0o22222, 60, 0)), Some(2));
    assert_eq!(set.models.len(), 3);
    assert_eq!(set.models[0].cells, 2);
    assert_eq!(set.models[0].obstacle_fraction(), Some(0.75));
    assert_eq!(set.models[0].terrain.histograms.points(), 400);
}

#[test]
fn ground_over_which_nothing_has_driven_is_slippery_where_it_is_most_like_ground_that_is() {
    // Shares of two colour bins; the squared distance of two mixtures is 2 × (difference of the shares)² here.
    let mixed = |share: u64, is_ground: bool, driven: u64, bumped: u64| {
        let mut terrain = cell(0, share, 0);
        terrain.merge(&cell(0o11111, 100 - share, 0));
        if !is_ground {
            (terrain.ground, terrain.obstacle) = (0, 100);
        }
        Model::new(Terrain { driven, bumped, ..terrain }, 1)
    };
    let models = vec![
        mixed(100, true, SEEN_CELLS, 0),
        mixed(0, true, 36, 24),
        // Like the second one; an obstacle there; between both; like the first one.
        mixed(30, true, 0, 0),
        mixed(30, false, 0, 0),
        mixed(50, true, 0, 0),
        mixed(80, true, 0, 0),
    ];
    let mut set = ModelSet { models, named: 0 };
    assert_eq!(set.like_slippery(&RULES), [None, None, Some(1), None, None, None]);
    set.models.push(mixed(25, true, SEEN_CELLS - 1, 0));
    let slippery = [None, None, Some(1), None, None, None, Some(1)];
    assert_eq!(set.like_slippery(&RULES), slippery, "a few cells that were driven over say little");
    set.models[6].terrain.driven = SEEN_CELLS;
    assert_eq!(set.like_slippery(&RULES), [None; 7], "it is more like firm ground now");
    assert_eq!(ModelSet::default().like_slippery(&RULES), []);
}

#[test]
fn mud_in_another_light_is_like_mud_where_firm_ground_is_much_less_like_it() {
    // The squared distance is 2 × (difference of the shares)² again; twice that of a match is 0.2.
    let mixed = |share: u64, driven: u64, bumped: u64| {
        let mut terrain = cell(0, share, 0);
        terrain.merge(&cell(0o11111, 100 - share, 0));
        Model::new(Terrain { driven, bumped, ..terrain }, 1)
    };
    let [mud, firm] = [mixed(0, 36, 24), mixed(100, 60, 0)];
    let like = |others: &[Model]| {
        let mut models = others.to_vec();
        models.extend([37, 41].map(|share| mixed(share, 0, 0)));
        ModelSet { models, named: 0 }.like_slippery(&RULES)[others.len()..].to_vec()
    };
    assert_eq!(like(&[mud.clone(), firm.clone()]), [Some(0), None], "0.27 and 0.34 from mud");
    assert_eq!(like(&[mud.clone(), mixed(80, 60, 0)]), [None, None], "0.37 from firm ground");
    assert_eq!(like(std::slice::from_ref(&mud)), [None, None], "no firm ground is known");
    // Grass of which some cells were partly mud is firm.
    assert_eq!(like(&[mixed(37, 400, 48), firm]), [None, None]);
}

#[test]
fn what_nobody_has_seen_has_no_obstacle_fraction_and_experience_counts_in_cells() {
    let nothing = Terrain::default();
    let mut model = Model::new(Terrain::default(), 1000);
    assert_eq!((model.obstacle_fraction(), model.backing(&nothing, true)), (None, 0.0));
    model.terrain.obstacle = 1_000_000;
    assert_eq!(model.obstacle_fraction(), Some(1.0));
    model.terrain.driven = 3 * SEEN_CELLS;
    assert_eq!(
        (model.obstacle_fraction(), model.backing(&nothing, true)),
        (Some(0.25), 0.0),
        "none of it was an obstacle by range"
    );
    (model.terrain.driven_labelled, model.terrain.driven_obstacle) = (BACKED_CELLS, BACKED_CELLS);
    assert_eq!((model.backing(&nothing, true), model.backing(&nothing, false)), (1.0, 0.0));
    model.terrain.bumped = 4 * SEEN_CELLS;
    assert_eq!(model.obstacle_fraction(), Some(0.625));
    let few = Terrain { driven: 5, driven_labelled: 5, driven_obstacle: BACKED_CELLS / 2, ..cell(0, 0, 100) };
    let few = Model::new(few, 5);
    assert_eq!((few.obstacle_fraction(), few.backing(&nothing, true)), (Some(0.5), 0.5));
    // A bump contradicts as far as range called it ground.
    let bumped = |ground, obstacle| {
        Model::new(Terrain { bumped: 1000, ..cell(0, ground, obstacle) }, 5).backing(&nothing, false)
    };
    assert_eq!([bumped(0, 100), bumped(100, 0), bumped(25, 75)], [0.0, 1.0, 0.5]);
}

#[test]
fn driving_backs_a_model_as_far_as_much_of_the_way_had_been_called_an_obstacle() {
    let backing = |driven_labelled, driven_obstacle, [ground, obstacle]: [u64; 2]| {
        let driven = Terrain { driven: 1000, driven_labelled, driven_obstacle, ..cell(0, ground, obstacle) };
        Model::new(driven, 5).driven_backing()
    };
    // The way along a thicket of the colour of the ground: some of its cells are the edge of the thicket.
    assert_eq!(backing(2000, 60, [50, 50]), 0.0);
    // The way through growth, however much of it range calls ground from far away.
    for points in [[0, 100], [100, 0], [97, 3]] {
        assert_eq!(backing(100, 60, points), 1.0, "{points:?}");
    }
    // What the vehicle has gone around since is not held against it.
    assert!((backing(400, 60, [97, 3]) - 2.0 / 3.0).abs() < 1e-9);
    // A file of an older version does not say how much had been labelled.
    assert_eq!(backing(0, 60, [0, 100]), 0.0);
}

#[test]
fn a_name_stays_and_is_given_once() {
    let named = |name: &str, code| Model { name: name.to_owned(), ..Model::new(cell(code, 60, 0), 2) };
    let mut set = ModelSet { models: vec![named("learned 4", 0), named("", 0o44444)], named: 0 };
    set.name_all();
    let learn = |set: &mut ModelSet| {
        let mut signatures = set.signatures(&RULES.weights);
        set.take(&cell(0o22222, 60, 0), 1, &RULES, &mut signatures)
    };
    assert_eq!(learn(&mut set), Some(2));
    let names = |set: &ModelSet| set.models.iter().map(|model| model.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&set), ["learned 4", "learned 5", "learned 6"]);
    set.models.remove(2);
    assert_eq!(learn(&mut set), Some(2));
    assert_eq!(names(&set), ["learned 4", "learned 5", "learned 7"], "another model has another name");
}

#[test]
fn sets_of_two_cameras_are_combined_by_their_matches() {
    let one = |code: u16| ModelSet { models: vec![Model::new(cell(code, 60, 0), 2)], named: 0 };
    let mut left = one(0);
    left.take_all(&one(0), &RULES);
    left.take_all(&one(0o44444), &RULES);
    let cells: Vec<_> = left.models.iter().map(|model| (model.cells, model.terrain.ground)).collect();
    assert_eq!(cells, [(4, 120), (2, 60)]);
}
