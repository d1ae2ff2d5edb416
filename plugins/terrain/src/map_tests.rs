//! The learning map: purity, merging, experience, scrolling, and outputs.

use super::*;
use crate::appearance::{MatchWeights, RatioBins};
use crate::frame::{gather, join, spots, strips};
use crate::judgement::SURE;
use crate::scene::{Scene, terrain};
use crate::surroundings::Part;
use glam::DVec3;
use rcs_geom::Pose;

pub(crate) const RULES: ModelRules = ModelRules {
    min_points: 40,
    min_purity: 0.95,
    merge_distance: 0.15,
    max_models: 16,
    near_m: 4.0,
    weights: MatchWeights { histograms: [0.18; 5], contrast: 0.1 },
};

pub(crate) fn empty() -> TerrainMap {
    TerrainMap::new(ModelSet::default()).unwrap()
}

/// Index, in the window of a map around the origin, of the cell `x` cells east and `y` cells north of the centre.
pub(crate) fn place(x: i64, y: i64) -> u32 {
    ((y + 100) * 201 + x + 100) as u32
}

/// The judgement on a known cell, and its cost.
pub(crate) fn judgement(map: &TerrainMap, index: CellIndex) -> Judgement {
    map.judge(map.get(index).unwrap(), &RULES).unwrap()
}

fn cost(map: &TerrainMap, index: CellIndex) -> u8 {
    judgement(map, index).cost
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
    let fractions: Vec<_> = map.models.models.iter().map(|m| m.obstacle_fraction().unwrap()).collect();
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
    let cell = map.get(index).unwrap();
    assert_eq!((cell.model, cell.is_part), (Some(0), false), "not pure, but still like it");
    assert_eq!(map.models.models[0].terrain.obstacle, 1, "the model keeps what it has");
}

#[test]
fn a_cell_that_becomes_pure_again_gives_its_model_only_what_it_has_got_since() {
    let mut map = empty();
    let (at, index) = (place(3, 4), CellIndex::new(3, 4));
    map.learn(&[(at, terrain(7, 100, 0))], &RULES);
    let corners = [[0.65, 0.85], [0.75, 0.85], [0.75, 0.95]].map(|[x, y]| DVec2::new(x, y));
    assert_eq!(map.mark(&corners, Experience::Bumped, 30.0, &RULES), 1);
    assert_eq!(map.get(index).unwrap().terrain.bumped, 30);
    for _ in 0..2 {
        map.learn(&[(at, terrain(7, 0, 12))], &RULES);
        assert!(!map.get(index).unwrap().is_part, "not pure");
        map.learn(&[(at, terrain(7, 300, 0))], &RULES);
        let (cell, model) = (map.get(index).unwrap(), &map.models.models[0]);
        assert!(cell.is_part && map.models.models.len() == 1);
        assert_eq!(model.terrain.histograms, cell.terrain.histograms);
        let counts = |terrain: &Terrain| [terrain.ground, terrain.obstacle, terrain.bumped];
        assert_eq!((counts(&model.terrain), model.cells), (counts(&cell.terrain), 1));
    }
}

#[test]
fn what_is_learned_in_one_region_reaches_others_that_look_like_it() {
    let mut map = empty();
    map.learn(&[(place(0, 5), terrain(7, 0, 100)), (place(50, 5), terrain(7, 100, 0))], &RULES);
    let costs = [CellIndex::new(0, 5), CellIndex::new(50, 5)].map(|i| cost(&map, i));
    assert_eq!(costs, [125, 125], "both cells have the model's cost");
    map.learn(&[(place(-5, 5), terrain(0o70007, 5, 15))], &RULES);
    let own = map.get(CellIndex::new(-5, 5)).unwrap();
    assert_eq!(
        (own.model, cost(&map, CellIndex::new(-5, 5))),
        (None, 188),
        "a cell without a model speaks for itself"
    );
}

#[test]
fn judgements_hold_every_known_cell_with_its_confidence() {
    let mut map = empty();
    map.learn(&[(place(0, 5), terrain(7, 100, 0)), (place(9, 9), terrain(0o7000, 3, 1))], &RULES);
    let known = |map: &TerrainMap| -> Vec<(usize, u8, u8)> {
        let (corner, judgements) = map.judgements(&RULES);
        assert_eq!((corner, judgements.len()), (CellIndex::new(-100, -100), SIDE * SIDE));
        let known = judgements.iter().enumerate().filter_map(|(at, judgement)| Some((at, (*judgement)?)));
        known.map(|(at, judgement)| (at, judgement.cost, judgement.confidence)).collect()
    };
    // Four of the forty points that make a cell certain.
    let expected = [(place(0, 5) as usize, 0, SURE), (place(9, 9) as usize, 63, SURE / 10)];
    assert_eq!(known(&map), expected);
    // A change of a model changes all its cells.
    map.learn(&[(place(-9, 9), terrain(7, 0, 300))], &RULES);
    assert_eq!([cost(&map, CellIndex::new(0, 5)), cost(&map, CellIndex::new(-9, 9))], [188, 188]);
}

/// A vehicle 0.8 m high whose frame has its origin on the ground.
pub(crate) fn vehicle(local_from_vehicle: Pose) -> Vehicle {
    Vehicle { local_from_vehicle, wheels_below_m: 0.0, height_m: 0.8 }
}

/// Drives east from cell 0, one cell per step.
fn drive(map: &mut TerrainMap, steps: std::ops::Range<i32>) {
    drive_with(&vehicle(Pose::IDENTITY), map, steps);
}

/// The same with a vehicle like this one.
pub(crate) fn drive_with(like: &Vehicle, map: &mut TerrainMap, steps: std::ops::Range<i32>) {
    let outline = Patch { x: [-0.35, 0.35], y: [-0.25, 0.25] };
    for step in steps {
        let pose = Pose::from_translation(DVec3::new(0.1 + 0.2 * f64::from(step), 0.1, 0.0));
        let vehicle = Vehicle { local_from_vehicle: pose, ..*like };
        map.stand(&vehicle);
        map.drive(&vehicle, &outline, 5.0, &RULES);
        // A vehicle that stays in place adds nothing more.
        let before = map.clone();
        map.drive(&vehicle, &outline, 5.0, &RULES);
        assert_eq!(*map, before);
    }
}

#[test]
fn driving_over_what_looked_like_obstacles_makes_them_cheap_everywhere() {
    let mut map = empty();
    // However many points were seen of it, a model counts as at most 20 cells.
    let weeds: Vec<_> = (0..60).map(|x| (place(x, 0), terrain(7, 0, 1000))).collect();
    map.learn(&weeds, &RULES);
    let far = CellIndex::new(59, 0);
    assert_eq!(judgement(&map, far), Judgement { cost: 250, confidence: SURE, backing: 0, model: 1 });
    let mut last = 250;
    for step in 0..10 {
        drive(&mut map, step..step + 1);
        assert_eq!(judgement(&map, far).backing < 255, step < 8, "step {step}");
        assert!(cost(&map, far) < last, "step {step}");
        last = cost(&map, far);
    }
    // Eleven cells of the row were driven over, each worth five: 20 cells of obstacle against 55 of driving. Range had
    // called them obstacles, and ten such cells back the model fully.
    let Terrain { driven, driven_labelled, driven_obstacle, .. } = map.models.models[0].terrain;
    assert_eq!((driven, driven_labelled, driven_obstacle), (55, 11, 11));
    assert_eq!(judgement(&map, far), Judgement { cost: 67, confidence: SURE, backing: 255, model: 1 });
    // Cells beside the row are driven over, too, and known to be free although they were never seen.
    let beside = Judgement { cost: 0, confidence: SURE, backing: 255, model: 0 };
    assert_eq!(judgement(&map, CellIndex::new(0, 1)), beside);
}

#[test]
fn driving_along_a_thicket_of_the_colour_of_the_ground_says_nothing_about_it() {
    let mut map = empty();
    let ground: Vec<_> = (0..60).map(|x| (place(x, 0), terrain(7, 100, 0))).collect();
    let thicket: Vec<_> = (0..60).map(|x| (place(x, 4), terrain(7, 0, 1000))).collect();
    map.learn(&[ground, thicket].concat(), &RULES);
    assert_eq!(map.models.models.len(), 1, "they look alike");
    drive(&mut map, 0..50);
    let Judgement { cost, backing, .. } = judgement(&map, CellIndex::new(40, 4));
    assert!(cost < 60 && backing == 0, "{cost} {backing}: range outweighs it");
}

#[test]
fn experience_reaches_cells_that_are_not_pure() {
    let mut map = empty();
    let mixed: Vec<_> = (0..60).map(|x| (place(x, 0), terrain(7, 40, 60))).collect();
    map.learn(&mixed, &RULES);
    let far = CellIndex::new(59, 0);
    assert_eq!((map.get(far).unwrap().model, cost(&map, far)), (None, 150));
    // The first cell that is driven over becomes a model; the cells ahead resemble it when they are seen again.
    drive(&mut map, 0..40);
    map.learn(&[(place(59, 0), terrain(7, 4, 6))], &RULES);
    let cell = map.get(far).unwrap();
    assert_eq!((cell.model, cell.is_part), (Some(0), false));
    let judgement = judgement(&map, far);
    assert!(judgement.cost < 60 && judgement.backing == 255, "{judgement:?}");
    assert_eq!(map.models.models[0].terrain.points(), 100, "its points are those of the first cell alone");
}

#[test]
fn one_bump_keeps_what_was_hit_and_all_that_looks_like_it_above_200() {
    for (ground, obstacle) in [(0, 100), (100, 0)] {
        let mut map = empty();
        let cells: Vec<_> = (0..60).map(|x| (place(x, 0), terrain(7, ground, obstacle))).collect();
        map.learn(&cells, &RULES);
        let vehicle = vehicle(Pose::from_xy_yaw(0.1, 0.1, 0.0));
        // The bumper hits on both sides: three cells of the row lie within its reach.
        map.bump(&vehicle, &Patch { x: [0.3, 0.9], y: [-0.1, 0.1] }, 30.0, &RULES);
        assert_eq!(map.experienced(), [0, 3, 0]);
        let elsewhere = judgement(&map, CellIndex::new(50, 0));
        // Range says the same of what it called an obstacle; ground that was bumped into needs the backing.
        let backing = if ground > 0 { 255 } else { 0 };
        assert!(elsewhere.cost > 200 && elsewhere.backing == backing, "{elsewhere:?}");
        assert_eq!(map.get(CellIndex::new(50, 0)).unwrap().terrain.bumped, 0);
    }
}

#[test]
fn a_hit_between_the_middles_of_cells_is_one_of_the_cells_of_its_corners() {
    let mut map = empty();
    let at = |x: f64| vehicle(Pose::from_xy_yaw(x, 0.1, 0.0));
    // At 0.22 to 0.23 m of cells of 0.2 m.
    map.bump(&at(0.1), &Patch { x: [0.12, 0.13], y: [-0.15, 0.15] }, 30.0, &RULES);
    let bumped: Vec<CellIndex> =
        map.iter().filter(|(_, cell)| cell.terrain.bumped > 0).map(|(index, _)| index).collect();
    assert_eq!(bumped, [CellIndex::new(1, -1), CellIndex::new(1, 1)]);
    assert_eq!(map.experienced(), [0, 2, 0]);
    map.bump(&at(900.0), &Patch { x: [0.12, 0.13], y: [0.0, 0.1] }, 30.0, &RULES);
    assert_eq!(map.experienced(), [0, 2, 0], "outside of the map");
}

#[test]
fn with_a_near_range_of_0_not_even_the_cell_under_the_vehicle_is_near() {
    let mut map = empty();
    map.learn(&[(place(0, 0), terrain(7, 100, 0))], &ModelRules { near_m: 0.0, ..RULES });
    assert!(!map.get(CellIndex::new(0, 0)).unwrap().is_near);
    map.learn(&[(place(0, 0), terrain(7, 100, 0))], &RULES);
    assert!(map.get(CellIndex::new(0, 0)).unwrap().is_near);
    // Without it again, the cell takes points as before.
    map.learn(&[(place(0, 0), terrain(7, 50, 0))], &ModelRules { near_m: 0.0, ..RULES });
    let cell = map.get(CellIndex::new(0, 0)).unwrap();
    assert_eq!((cell.is_near, cell.terrain.ground), (false, 150));
}

#[test]
fn ground_on_which_the_wheels_have_spun_is_dear_wherever_it_looks_like_it_and_not_closed() {
    let mut map = empty();
    let row = |y: i64, texture: u16| (0..60).map(move |x| (place(x, y), terrain(texture, 100, 0)));
    map.learn(&row(0, 7).chain(row(4, 0o70007)).collect::<Vec<_>>(), &RULES);
    assert_eq!(map.models.models.len(), 2, "mud and grass");
    // Three metres into the mud the wheels spin.
    drive(&mut map, 0..15);
    let wheels = Patch { x: [-0.2, 0.2], y: [-0.3, 0.3] };
    map.spin(&vehicle(Pose::from_xy_yaw(3.0, 0.1, 0.0)), &wheels, 60.0, &RULES);
    let [mud, grass] = [0, 4].map(|y| judgement(&map, CellIndex::new(50, y)));
    assert!((35..=100).contains(&mud.cost) && mud.backing == 255, "{mud:?}");
    assert_eq!((grass.cost, grass.backing), (0, 0));
    let before = map.clone();
    map.spin(&vehicle(Pose::from_xy_yaw(3.0, 0.1, 0.0)), &wheels, 60.0, &RULES);
    assert_eq!(map.models, before.models, "the same cells teach it once");
    for step in 1..8 {
        map.spin(&vehicle(Pose::from_xy_yaw(3.0 + 0.4 * f64::from(step), 0.1, 0.0)), &wheels, 60.0, &RULES);
    }
    map.learn(&[(place(59, 2), terrain(7, 10, 30))], &RULES);
    let stone = map.get(CellIndex::new(59, 2)).unwrap();
    assert_eq!(
        (stone.model, judgement(&map, CellIndex::new(59, 2)).backing),
        (Some(0), 0),
        "a stone in the mud"
    );
    let mud = judgement(&map, CellIndex::new(50, 0));
    assert!((90..=100).contains(&mud.cost), "{mud:?}");
}

#[test]
fn a_gain_below_one_cell_teaches_one_and_slip_teaches_at_least_one_of_each_kind() {
    let (here, under) = (vehicle(Pose::from_xy_yaw(0.1, 0.1, 0.0)), Patch { x: [-0.2, 0.2], y: [-0.2, 0.2] });
    let taught = |teach: &dyn Fn(&mut TerrainMap)| {
        let mut map = empty();
        teach(&mut map);
        let terrain = &map.get(CellIndex::new(0, 0)).unwrap().terrain;
        [terrain.driven, terrain.bumped]
    };
    for (gain, expected) in
        [(0.0, [0, 0]), (0.1, [1, 1]), (1.0, [1, 1]), (2.0, [1, 1]), (3.0, [2, 1]), (60.0, [36, 24])]
    {
        assert_eq!(taught(&|map| map.spin(&here, &under, gain, &RULES)), expected, "{gain}");
    }
    for (gain, expected) in [(0.0, 0), (0.1, 1), (1.4, 1), (5.0, 5), (30.0, 30)] {
        assert_eq!(taught(&|map| map.drive(&here, &under, gain, &RULES)), [expected, 0], "{gain}");
        assert_eq!(taught(&|map| map.bump(&here, &under, gain, &RULES)), [0, expected], "{gain}");
    }
}

/// Centres the map on a cell of the x axis, and adds points to cells of that axis, whose textures have one bin each.
fn look_from(map: &mut TerrainMap, vehicle: i64, cells: &[(i64, u16, u64)]) {
    let middle = map.cells.middle_of(CellIndex::new(vehicle, 0));
    map.recentre(middle);
    let points: Vec<_> = cells
        .iter()
        .map(|&(x, texture, count)| (place(x - vehicle, 0), terrain(texture, count, 0)))
        .collect();
    map.learn(&points, &RULES);
}

#[test]
fn ground_looks_different_from_afar_and_experience_teaches_both_looks() {
    const AFAR: u16 = 7;
    const NEAR: u16 = 0o70007;
    let mut map = empty();
    let of = |map: &TerrainMap, x: i64| map.get(CellIndex::new(x, 0)).unwrap().clone();
    look_from(&mut map, 0, &[(30, AFAR, 100), (60, AFAR, 100)]);
    // The vehicle comes near to the first of them.
    look_from(&mut map, 20, &[(30, NEAR, 1000), (60, AFAR, 100)]);
    assert_eq!((of(&map, 30).model, of(&map, 30).far, of(&map, 60).model), (Some(1), Some(0), Some(0)));
    let points = |map: &TerrainMap| [0, 1].map(|number: usize| map.models.models[number].terrain.points());
    assert_eq!(points(&map), [300, 1000], "what is seen from near does not change the look from afar");
    let wheels = Patch { x: [-0.2, 0.2], y: [-0.3, 0.3] };
    map.spin(&vehicle(Pose::from_xy_yaw(6.1, 0.1, 0.0)), &wheels, 60.0, &RULES);
    let experienced = |number: usize| map.models.models[number].terrain.experience();
    assert!(experienced(0) > 0 && experienced(0) == experienced(1));
    // So the other one is known to be such ground 8 m ahead, and still is when little was seen of it from near.
    let ahead = judgement(&map, CellIndex::new(60, 0));
    assert!((35..=100).contains(&ahead.cost) && ahead.backing == 255, "{ahead:?}");
    look_from(&mut map, 45, &[(60, 0o7777, 10)]);
    assert_eq!((of(&map, 60).model, of(&map, 60).far), (None, Some(0)));
    let near = judgement(&map, CellIndex::new(60, 0));
    assert!((35..=100).contains(&near.cost) && near.backing == 255, "{near:?}");
    // What has been near is not judged from afar again.
    let before = of(&map, 30);
    look_from(&mut map, 60, &[(30, 0o7777, 1000)]);
    assert_eq!(of(&map, 30), before);
    // Without the model from afar, that from near stays, and has another number.
    assert!(map.delete(0));
    assert_eq!((of(&map, 30).model, of(&map, 30).far), (Some(0), None));
}

#[test]
fn ground_that_is_like_mud_is_judged_like_it_before_wheels_have_spun_on_its_model() {
    let mut map = empty();
    // A model of the grass, one of the mud, and one of the mud farther away, which has a tenth of other pixels.
    let grass = terrain(0o77777, 100, 0);
    let mud = terrain(7, 100, 0);
    let mut far_mud = terrain(7, 70, 0);
    far_mud.merge(&terrain(0o70007, 30, 0));
    let rules = ModelRules { merge_distance: 0.01, ..RULES };
    map.learn(&[(place(0, 10), grass), (place(5, 0), mud), (place(25, 0), far_mud)], &rules);
    let rules = ModelRules { merge_distance: 0.05, ..RULES };
    let cost = |map: &TerrainMap, cell: (i64, i64)| {
        map.judge(map.get(CellIndex::new(cell.0, cell.1)).unwrap(), &rules).unwrap().cost
    };
    assert_eq!([cost(&map, (5, 0)), cost(&map, (25, 0))], [0, 0]);
    let wheels = Patch { x: [-0.2, 0.2], y: [-0.3, 0.3] };
    map.spin(&vehicle(Pose::from_xy_yaw(1.1, 0.1, 0.0)), &wheels, 60.0, &rules);
    let mud = cost(&map, (5, 0));
    assert!((90..=100).contains(&mud), "{mud}");
    assert_eq!([cost(&map, (25, 0)), cost(&map, (0, 10))], [mud, 0]);
    assert_eq!(map.models.models[2].terrain.experience(), 0, "it has learned nothing itself");
}

#[test]
fn a_look_from_afar_without_experience_does_not_count_for_the_surroundings_of_a_cell() {
    const AFAR: u16 = 7;
    let mut map = empty();
    look_from(&mut map, 0, &[(30, AFAR, 100)]);
    // From near, too little is seen of it to compare it.
    look_from(&mut map, 20, &[(30, 0o70007, 1)]);
    let cell = map.get(CellIndex::new(30, 0)).unwrap();
    assert_eq!((cell.model, cell.far), (None, Some(0)));
    assert_eq!(part_in_surroundings(Some(cell), map.number_of(cell, &[])), Part::Takes);
    map.models.models[0].terrain.driven = 10;
    let cell = map.get(CellIndex::new(30, 0)).unwrap();
    assert_eq!(part_in_surroundings(Some(cell), map.number_of(cell, &[])), Part::Gives);
}

#[test]
fn scrolling_keeps_cells_as_they_are_and_forgets_what_leaves() {
    let mut map = empty();
    learn_scene(&mut map, &Scene::new([320, 240], Pose::IDENTITY, 6.0, 3.0, 2));
    let before: Vec<(CellIndex, Cell)> = map.iter().map(|(index, cell)| (index, cell.clone())).collect();
    assert!(before.len() > 500);
    map.recentre(DVec2::new(13.0, 17.0));
    let kept: Vec<(CellIndex, Cell)> = map.iter().map(|(index, cell)| (index, cell.clone())).collect();
    let expected: Vec<_> = before.into_iter().filter(|(index, _)| index.x >= -35 && index.y >= -15).collect();
    assert!(!expected.is_empty());
    assert_eq!(kept, expected);
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
    assert_eq!(cost(&map, CellIndex::new(3, 0)), 250, "the obstacle is still one");
    // Every point of every cell is in its model.
    let in_models: u64 = map.models.models.iter().map(|model| model.terrain.points()).sum();
    assert_eq!(in_models, map.iter().map(|(_, cell)| cell.terrain.points()).sum::<u64>());
}

#[test]
fn a_deleted_model_takes_its_cells_along_and_the_others_keep_theirs() {
    let mut map = empty();
    let kinds = [(place(0, 5), terrain(0, 100, 0)), (place(9, 5), terrain(0o77777, 0, 100))];
    map.learn(&kinds, &RULES);
    map.learn(&[(place(20, 5), terrain(0, 30, 0)), (place(30, 5), terrain(0o77777, 30, 0))], &RULES);
    assert!(!map.delete(2) && map.delete(0));
    let models = [0, 9, 20, 30].map(|x| map.get(CellIndex::new(x, 5)).map(|cell| cell.model));
    assert_eq!(models, [None, Some(Some(0)), Some(None), Some(Some(0))], "parts go; what is alike stays");
    assert_eq!(map.models.models[0].terrain.obstacle, 100);
    // What is seen from now on can be learned again.
    map.learn(&kinds[..1], &RULES);
    assert_eq!(map.get(CellIndex::new(0, 5)).unwrap().model, Some(1));
}

#[test]
fn a_model_without_a_picture_gets_one_of_its_cell_with_the_most_points() {
    let mut map = empty();
    let scene = Scene::new([160, 120], Pose::IDENTITY, 5.0, 3.0, 1);
    let (window, ratios) = (map.window(), RatioBins::new(1.0));
    let strips: Vec<_> =
        (0..strips(scene.size[1])).map(|s| gather(&scene.frame(), s, &window, 10.0, &ratios)).collect();
    let points = join(&strips, SIDE);
    assert_eq!(map.without_sample(&points), [], "there is no model");
    map.learn(&points, &RULES);
    let missing = map.without_sample(&points);
    assert_eq!(missing.len(), map.models.models.len());
    let cells: Vec<u32> = missing.iter().map(|(_, cell)| *cell).collect();
    let frame = scene.frame();
    let spots = spots(frame.rays, frame.depth_m, &frame.local_from_camera, &window, &strips, &cells);
    for ((number, cell), spot) in missing.iter().zip(spots) {
        let spot = spot.unwrap();
        let ([column, row], of) = (spot.middle, &points.iter().find(|(place, _)| place == cell).unwrap().1);
        let label = if of.obstacle > of.ground { crate::frame::OBSTACLE } else { crate::frame::GROUND };
        assert_eq!(scene.labels[row * scene.size[0] + column], label, "model {number}: {spot:?}");
        assert!(spot.side >= 2 && spot.side < 60, "{spot:?}");
    }
    let size = scene.size;
    let time = rcs_msg::Stamp(7);
    let image = rcs_sense::Rgb { data: &scene.rgb, step: 3 * size[0], size, frame_id: "camera", time };
    map.models.models[0].sample = rcs_sense::Sample::around(&image, [80, 100], 12);
    assert_eq!(map.without_sample(&points).len(), missing.len() - 1);
}

#[test]
fn a_large_outline_marks_all_its_cells_and_teaches_a_model_as_much_as_a_small_one() {
    let marked = |side: i64| {
        let mut map = empty();
        let points: Vec<_> = (0..60).map(|i| (place(i % 10, i / 10), terrain(0, 100, 0))).collect();
        map.learn(&points, &RULES);
        let reach = 0.2 * side as f64;
        let corners = [[0.0, 0.0], [reach, 0.0], [reach, reach], [0.0, reach]].map(|[x, y]| DVec2::new(x, y));
        assert_eq!(map.mark(&corners, Experience::Bumped, 30.0, &RULES), (side * side) as u64);
        assert_eq!(map.get(CellIndex::new(side - 1, side - 1)).unwrap().terrain.bumped, 30);
        assert_eq!(map.experienced(), [0, 0, (side * side) as u64]);
        map.models.models[0].terrain.bumped
    };
    assert_eq!([marked(1), marked(2), marked(6)], [30, 120, 120]);
    // Smaller than a cell, it means the cells of its corners.
    let mut map = empty();
    let corners = [[0.01, 0.01], [0.05, 0.01], [0.05, 0.05]].map(|[x, y]| DVec2::new(x, y));
    assert_eq!(map.mark(&corners, Experience::Driven, 30.0, &RULES), 1);
    assert_eq!(map.get(CellIndex::new(0, 0)).unwrap().terrain.driven, 30);
}

/// The corners of a square of 36 cells, 5 m east of the origin.
fn square() -> [DVec2; 4] {
    [[5.0, 0.0], [6.2, 0.0], [6.2, 1.2], [5.0, 1.2]].map(|[x, y]| DVec2::new(x, y))
}

/// Centres the map on a cell of the x axis, and adds points to all cells of the square.
fn look_at_square(map: &mut TerrainMap, vehicle: i64, texture: u16) {
    map.recentre(map.cells.middle_of(CellIndex::new(vehicle, 0)));
    let cells = (0..36).map(|i| place(25 + i % 6 - vehicle, i / 6));
    let points: Vec<_> = cells.map(|at| (at, terrain(texture, 100, 0))).collect();
    map.learn(&points, &RULES);
}

#[test]
fn a_large_outline_teaches_models_that_its_cells_join_later_no_more_than_those_that_they_have() {
    const AFAR: u16 = 7;
    const NEAR: u16 = 0o70007;
    let bumped = |map: &TerrainMap| -> Vec<u64> {
        map.models.models.iter().map(|model| model.terrain.bumped).collect()
    };
    let most = 30 * MARKED_CELLS as u64;
    // Marked when it was seen from afar, or not at all; and it looks different from near, or not.
    for (is_seen, near, expected) in [
        (true, NEAR, vec![most, most]),
        (true, AFAR, vec![most]),
        (false, NEAR, vec![most, most]),
        (false, AFAR, vec![most]),
    ] {
        let mut map = empty();
        if is_seen {
            look_at_square(&mut map, 0, AFAR);
        }
        assert_eq!(map.mark(&square(), Experience::Bumped, 30.0, &RULES), 36);
        look_at_square(&mut map, 0, AFAR);
        look_at_square(&mut map, 20, near);
        assert_eq!(bumped(&map), expected, "{is_seen} {near}");
        assert!(map.iter().all(|(_, cell)| cell.is_part && cell.terrain.bumped == 30));
    }
    // Seen from near alone.
    let mut map = empty();
    map.mark(&square(), Experience::Bumped, 30.0, &RULES);
    look_at_square(&mut map, 20, NEAR);
    assert_eq!(bumped(&map), [most]);
}

#[test]
fn what_was_driven_over_before_it_was_seen_reaches_its_model_once_and_whole() {
    let mut map = empty();
    let outline = Patch { x: [-0.35, 0.35], y: [-0.25, 0.25] };
    map.drive(&vehicle(Pose::from_xy_yaw(5.5, 0.5, 0.0)), &outline, 5.0, &RULES);
    let driven: u64 = map.iter().map(|(_, cell)| cell.terrain.driven).sum();
    assert!(driven >= 30, "{driven}");
    look_at_square(&mut map, 0, 7);
    look_at_square(&mut map, 20, 0o70007);
    let of_models: Vec<u64> = map.models.models.iter().map(|model| model.terrain.driven).collect();
    assert_eq!(of_models, [driven, driven], "its look from afar, and that from near");
}

#[test]
fn each_cell_of_an_outline_stays_an_obstacle_also_where_its_look_is_that_of_no_model_which_learned_it() {
    let mut map = empty();
    let cells = |rows: std::ops::Range<i64>| rows.flat_map(|y| (0..6).map(move |x| place(25 + x, y)));
    let seen = |map: &mut TerrainMap, rows: std::ops::Range<i64>, texture: u16| {
        let points: Vec<_> = cells(rows).map(|at| (at, terrain(texture, 100, 0))).collect();
        map.learn(&points, &RULES);
    };
    // Of the 36 cells, twelve are grass that was seen; the others are seen later, and look different.
    seen(&mut map, 0..2, 7);
    map.mark(&square(), Experience::Bumped, 30.0, &RULES);
    seen(&mut map, 2..6, 0o70007);
    for (index, cell) in map.iter() {
        assert!(cell.is_part && cell.terrain.bumped == 30);
        assert!(cost(&map, index) > 125, "{index:?}: {}", cost(&map, index));
    }
}
