//! The learning map: purity, merging, experience, scrolling, and outputs.

use super::*;
use crate::appearance::{MatchWeights, RatioBins};
use crate::frame::{gather, join, strips};
use crate::scene::{Scene, terrain};

const RULES: ModelRules = ModelRules {
    min_points: 40,
    min_purity: 0.95,
    merge_distance: 0.15,
    max_models: 16,
    weights: MatchWeights { histograms: [0.18; 5], contrast: 0.1 },
};

fn empty() -> TerrainMap {
    TerrainMap::new(ModelSet::default()).unwrap()
}

/// Index, in the window of a map around the origin, of the cell `x` cells east and `y` cells north of the centre.
fn place(x: i64, y: i64) -> u32 {
    ((y + 100) * 201 + x + 100) as u32
}

fn learn_scene(map: &mut TerrainMap, scene: &Scene) -> Learned {
    let window = map.window();
    let ratios = RatioBins::new(1.0);
    let strips: Vec<_> =
        (0..strips(scene.size[1])).map(|s| gather(&scene.frame(), s, &window, 10.0, &ratios)).collect();
    map.learn(&join(&strips, SIDE), &RULES)
}

#[test]
fn grass_and_planks_become_models_of_their_own() {
    let mut map = empty();
    let learned = learn_scene(&mut map, &Scene::new([320, 240], Pose::IDENTITY, 5.0, 3.0, 1));
    assert!(learned.ground > 20_000 && learned.obstacle > 10_000, "{learned:?}");
    let fractions: Vec<_> =
        map.models.models.iter().map(|m| m.terrain.obstacle_fraction().unwrap()).collect();
    assert!(fractions.iter().any(|&f| f < 0.05) && fractions.iter().any(|&f| f > 0.95), "{fractions:?}");
    assert!(fractions.iter().all(|&f| !(0.05..=0.95).contains(&f)), "{fractions:?}");
    assert!(fractions.len() <= 6, "two textures made {} models", fractions.len());
}

#[test]
fn a_cell_joins_a_model_when_it_is_ready_and_leaves_it_when_it_is_no_longer_pure() {
    let mut map = empty();
    let at = place(3, 4);
    let index = CellIndex::new(3, 4);
    map.learn(&[(at, terrain(0, 39, 0))], &RULES);
    assert_eq!(map.get(index).unwrap().model, None, "too few points");
    map.learn(&[(at, terrain(0, 1, 0))], &RULES);
    assert_eq!(map.get(index).unwrap().model, Some(0));
    assert_eq!(map.models.models[0].terrain.ground, 40, "all its points, once");
    map.learn(&[(at, terrain(0, 10, 1))], &RULES);
    assert_eq!((map.models.models[0].terrain.ground, map.models.models[0].terrain.obstacle), (50, 1));
    map.learn(&[(at, terrain(0, 0, 10))], &RULES);
    assert_eq!(map.get(index).unwrap().model, None, "not pure");
    assert_eq!(map.models.models[0].terrain.obstacle, 1, "the model keeps what it has");
}

#[test]
fn what_is_learned_in_one_region_reaches_others_that_look_like_it() {
    let mut map = empty();
    map.learn(&[(place(0, 5), terrain(7, 0, 100)), (place(50, 5), terrain(7, 100, 0))], &RULES);
    let costs = [CellIndex::new(0, 5), CellIndex::new(50, 5)].map(|i| map.cost(map.get(i).unwrap()));
    assert_eq!(costs, [125, 125], "both cells have the model's cost");
    map.learn(&[(place(-5, 5), terrain(0o70007, 5, 15))], &RULES);
    let own = map.get(CellIndex::new(-5, 5)).unwrap();
    assert_eq!((own.model, map.cost(own)), (None, 188), "a cell without a model speaks for itself");
}

#[test]
fn only_cells_whose_cost_has_changed_are_sent() {
    let mut map = empty();
    map.learn(&[(place(0, 5), terrain(7, 100, 0)), (place(9, 9), terrain(0o7000, 3, 1))], &RULES);
    let known = |costs: &[u8]| -> Vec<(usize, u8)> {
        costs.iter().copied().enumerate().filter(|&(_, cost)| cost != UNKNOWN_COST).collect()
    };
    let (corner, costs) = map.changed().unwrap();
    assert_eq!(corner, CellIndex::new(-100, -100));
    assert_eq!(known(&costs), [(place(0, 5) as usize, 0), (place(9, 9) as usize, 63)]);
    assert_eq!(map.changed(), None, "nothing has changed");
    map.learn(&[(place(9, 9), terrain(0o7000, 0, 4))], &RULES);
    assert_eq!(known(&map.changed().unwrap().1), [(place(9, 9) as usize, 156)]);
    // A change of a model changes all its cells.
    map.learn(&[(place(-9, 9), terrain(7, 0, 300))], &RULES);
    let costs = map.changed().unwrap().1;
    assert_eq!(known(&costs), [(place(0, 5) as usize, 188), (place(-9, 9) as usize, 188)]);
}

#[test]
fn driving_over_what_looked_like_obstacles_makes_them_cheaper_everywhere() {
    let mut map = empty();
    let weeds: Vec<_> = (0..20).map(|x| (place(x, 0), terrain(7, 0, 100))).collect();
    map.learn(&weeds, &RULES);
    let far = CellIndex::new(19, 0);
    assert_eq!(map.cost(map.get(far).unwrap()), 250);
    let outline = Patch { x: [-0.35, 0.35], y: [-0.25, 0.25] };
    let mut last = 250;
    for step in 0..10 {
        let pose = Pose::from_translation(DVec3::new(0.1 + 0.2 * f64::from(step), 0.1, 0.0));
        map.drive(&pose, &outline, 3.0, &RULES);
        let cost = map.cost(map.get(far).unwrap());
        assert!(cost < last, "step {step}: {cost} after {last}");
        last = cost;
        // A vehicle that stays in place adds nothing more.
        let before = map.clone();
        map.drive(&pose, &outline, 3.0, &RULES);
        assert_eq!(map, before);
    }
    // Eleven of twenty cells were driven over: 2000 obstacle points against 3300 points of driving.
    assert_eq!(map.models.models[0].terrain.driven, 3 * 1100);
    assert_eq!(last, (250.0_f64 * 2000.0 / 5300.0).round() as u8);
    // Cells beside the row are driven over, too, and known to be free although they were never seen.
    let beside = map.get(CellIndex::new(0, 1)).unwrap();
    assert_eq!((beside.terrain.driven, map.cost(beside)), (3 * 40, 0));
}

#[test]
fn a_hit_of_the_bumper_makes_what_was_hit_and_all_that_looks_like_it_dearer() {
    let mut map = empty();
    map.learn(&[(place(3, 0), terrain(7, 100, 0)), (place(30, 30), terrain(7, 100, 0))], &RULES);
    let pose = Pose::from_xy_yaw(0.1, 0.1, 0.0);
    map.bump(&pose, &Patch { x: [0.5, 0.7], y: [-0.1, 0.1] }, 10.0, &RULES);
    assert_eq!(map.get(CellIndex::new(3, 0)).unwrap().terrain.bumped, 1000);
    assert_eq!(map.experienced(), [0, 1]);
    let elsewhere = map.get(CellIndex::new(30, 30)).unwrap();
    assert_eq!(elsewhere.terrain.bumped, 0);
    assert_eq!(map.cost(elsewhere), (250.0_f64 * 1000.0 / 1200.0).round() as u8);
}

#[test]
fn scrolling_keeps_cells_as_they_are_and_forgets_what_leaves() {
    let mut map = empty();
    learn_scene(&mut map, &Scene::new([320, 240], Pose::IDENTITY, 6.0, 3.0, 2));
    map.changed();
    let before: Vec<(CellIndex, Cell)> = map.iter().map(|(index, cell)| (index, cell.clone())).collect();
    assert!(before.len() > 500);
    map.recentre(DVec2::new(13.0, 17.0));
    let kept: Vec<(CellIndex, Cell)> = map.iter().map(|(index, cell)| (index, cell.clone())).collect();
    let expected: Vec<_> = before.into_iter().filter(|(index, _)| index.x >= -35 && index.y >= -15).collect();
    assert!(!expected.is_empty());
    assert_eq!(kept, expected);
    assert_eq!(map.changed(), None, "what was sent is remembered, too");
    map.recentre(DVec2::new(500.0, 0.0));
    assert_eq!(map.counts(), [0, 0]);
    map.recentre(DVec2::new(f64::NAN, 0.0));
    assert_eq!(map.window().corner_m, DVec2::new(2400.0, -100.0) * CELL_SIZE_M);
}

#[test]
fn a_patch_covers_the_cells_whose_middles_lie_on_it_whatever_its_heading() {
    let map = empty();
    let patch = Patch { x: [-0.8, 0.4], y: [-0.3, 0.3] };
    for (i, yaw) in [0.0, 0.4, 1.6, -2.5].into_iter().enumerate() {
        let pose = Pose::from_xy_yaw(1.234 * i as f64, -0.77, yaw);
        let covered = map.covered(&pose, &patch);
        let all = map.cells.bounds().iter().filter(|&index| {
            let p = pose.inverse() * map.cells.middle_of(index).extend(0.0);
            (-0.8..=0.4).contains(&p.x) && (-0.3..=0.3).contains(&p.y)
        });
        let mut expected: Vec<_> = all.collect();
        expected.sort_unstable();
        assert_eq!(covered, expected, "yaw {yaw}");
        assert!((14..=22).contains(&covered.len()));
    }
}

#[test]
fn a_full_set_makes_room_by_merging_what_is_most_alike_and_keeps_its_obstacles() {
    let rules = ModelRules { max_models: 4, merge_distance: 0.01, ..RULES };
    // Two shades of one ground, another ground, an obstacle, then a new kind.
    let shades = |more: u16| {
        let mut shade = terrain(0, 100, 0);
        (0..40).for_each(|_| shade.histograms.add(more, 840));
        shade.ground += 40;
        shade
    };
    let mut map = empty();
    let first = [(place(0, 0), shades(1)), (place(1, 0), shades(2)), (place(2, 0), terrain(0o33333, 100, 0))];
    map.learn(&first, &rules);
    map.learn(&[(place(3, 0), terrain(3, 0, 100))], &rules);
    assert_eq!(map.models.models.len(), 4);
    let learned = map.learn(&[(place(4, 0), terrain(0o44444, 100, 0))], &rules);
    assert_eq!(learned.left_out, 0);
    let model = |x: i64| map.get(CellIndex::new(x, 0)).unwrap().model.unwrap();
    assert_eq!(model(0), model(1), "the two shades are one model");
    let numbers: std::collections::BTreeSet<u32> = (0..5).map(model).collect();
    assert_eq!((numbers.len(), map.models.models.len()), (4, 4));
    let points = |number: u32| map.models.models[number as usize].terrain.points();
    assert_eq!([points(model(0)), points(model(4))], [280, 100]);
    assert_eq!(map.cost(map.get(CellIndex::new(3, 0)).unwrap()), 250, "the obstacle is still one");
    // Every point of every cell is in its model.
    let in_models: u64 = map.models.models.iter().map(|model| model.terrain.points()).sum();
    assert_eq!(in_models, map.iter().map(|(_, cell)| cell.terrain.points()).sum::<u64>());
}
