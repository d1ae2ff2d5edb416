//! Small maps.

use super::*;
use crate::search::{Path, Search};
use crate::zones::Polygon;

fn rules() -> Rules {
    Rules {
        table: vec![(30, 10), (124, 60)],
        unknown: 20,
        unknown_near: 20,
        slipped: 4.0,
        half_width_m: 0.35,
        least_room_m: 0.4,
        far_room_m: 0.4,
        near_m: 4.0,
        wish_room_m: 1.0,
        clearance: 40.0,
        heading: 0.5,
        heading_range_m: 2.0,
        route_range_m: 2.0,
        relief_cost: 200,
        ..Rules::plain()
    }
}

/// 41×41 cells of 0.2 m of this fused cost, around (0, 0).
fn sensed(fused: u8) -> Sensed {
    Sensed {
        columns: 41,
        cell_size_m: 0.2,
        corner: DVec2::splat(-4.1),
        fused: vec![fused; 41 * 41],
        bumped: Vec::new(),
        remembered: Vec::new(),
        seen_from_dm: Vec::new(),
    }
}

fn at(x_m: f64, y_m: f64) -> Place {
    sensed(0).place(DVec2::new(x_m, y_m)).unwrap()
}

fn with_obstacle(x_m: f64, y_m: f64) -> Sensed {
    let mut sensed = sensed(0);
    let index = sensed.index(at(x_m, y_m));
    sensed.fused[index] = 250;
    sensed
}

const FAR: f64 = 100.0;

fn costs(sensed: &Sensed, vehicle: &Pose, rules: &Rules) -> (Terrain, CostGrid) {
    let mut terrain = Terrain::default();
    let costs = terrain.costs(sensed, vehicle, &Past::default(), rules).unwrap();
    (terrain, costs)
}

#[test]
fn costs_are_looked_up_in_the_table_and_unknown_cells_have_an_entry() {
    let away = Pose::from_xy_yaw(FAR, FAR, 0.0);
    for (fused, expected) in
        [(0, 10), (30, 10), (31, 60), (124, 60), (125, BLOCKED), (250, BLOCKED), (255, 20)]
    {
        let (_, costs) = costs(&sensed(fused), &away, &rules());
        assert_eq!(costs.get(at(1.0, 2.0)), Some(expected), "{fused}");
    }
}

#[test]
fn near_an_obstacle_the_vehicle_does_not_fit_and_then_pays_for_clearance() {
    let sensed = with_obstacle(0.0, 0.0);
    let away = Pose::from_xy_yaw(FAR, FAR, 0.0);
    let (terrain, costs) = costs(&sensed, &away, &rules());
    let cost = |x_m| costs.get(at(x_m, 0.0)).unwrap();
    assert_eq!([cost(0.0), cost(0.2), cost(0.4)], [BLOCKED; 3], "the obstacle reaches 0.1 m");
    assert_eq!(cost(0.6), 10 + 23, "0.1 m more than the least room: (1 - 1/6)³ of 40");
    assert!(cost(0.8) < cost(0.6) && cost(1.2) == 10);
    assert_eq!(terrain.terms(&sensed, at(0.0, 0.0), &away, &rules()), Err(Obstruction::Obstacle));
    assert_eq!(terrain.terms(&sensed, at(0.4, 0.0), &away, &rules()), Err(Obstruction::TooNarrow));
}

#[test]
fn on_the_edge_of_a_path_a_vehicle_pays_for_the_dear_ground_under_its_side() {
    let mut sensed = sensed(100);
    for row in 16..=24 {
        sensed.fused[row * 41..(row + 1) * 41].fill(0);
    }
    let away = Pose::from_xy_yaw(FAR, FAR, 0.0);
    let (_, costs) = costs(&sensed, &away, &rules());
    let across: Vec<u8> = (20..=26).map(|row| costs.get(Place::new(20, row)).unwrap()).collect();
    assert_eq!(across, [10, 10, 10, 20, 30, 40, 50], "a fifth of a vehicle 0.7 m wide for each cell");
}

#[test]
fn what_lies_ahead_of_the_vehicle_is_cheaper_than_what_lies_behind() {
    let sensed = sensed(100);
    let vehicle = Pose::from_xy_yaw(0.0, 0.0, std::f64::consts::FRAC_PI_2);
    let (_, costs) = costs(&sensed, &vehicle, &rules());
    let cost = |x_m, y_m| costs.get(at(x_m, y_m)).unwrap();
    assert_eq!(cost(0.0, 1.0), 60 - 15, "half of the range: a quarter of the cost");
    assert_eq!(cost(0.0, -1.0), 60 + 15);
    assert_eq!([cost(1.0, 0.0), cost(0.0, 2.0), cost(0.0, 3.0)], [60; 3]);
}

#[test]
fn near_the_vehicle_unknown_is_clear_and_obstacles_can_be_left_but_not_what_the_bumper_hit() {
    let relieving = Rules { relief_range_m: 1.0, route: 0.0, route_range_m: 2.0, heading: 0.0, ..rules() };
    let vehicle = Pose::from_xy_yaw(0.1, 0.1, 0.0);
    let (_, costs_unknown) = costs(&sensed(255), &vehicle, &relieving);
    assert_eq!(costs_unknown.get(at(0.5, 0.0)), Some(10));
    assert_eq!(costs_unknown.get(at(2.0, 0.0)), Some(20));
    let mut sensed = with_obstacle(0.5, 0.0);
    let (_, before) = costs(&sensed, &vehicle, &relieving);
    assert_eq!((before.get(at(0.5, 0.0)), before.get(at(0.15, 0.0))), (Some(200), Some(200)));
    sensed.bumped = vec![false; sensed.fused.len()];
    let index = sensed.index(at(0.5, 0.0));
    sensed.bumped[index] = true;
    let (terrain, after) = costs(&sensed, &vehicle, &relieving);
    assert_eq!((after.get(at(0.5, 0.0)), after.get(at(0.15, 0.0))), (Some(BLOCKED), Some(200)));
    assert_eq!(terrain.terms(&sensed, at(0.5, 0.0), &vehicle, &relieving), Err(Obstruction::Obstacle));
}

#[test]
fn the_terms_of_every_cell_add_up_to_its_cost() {
    let mut sensed = with_obstacle(-1.0, 1.0);
    sensed.fused.iter_mut().step_by(7).for_each(|fused| *fused = 255);
    let rules = Rules { relief_range_m: 0.8, route: 0.0, route_range_m: 2.0, ..rules() };
    let vehicle = Pose::from_xy_yaw(-0.4, 0.6, 2.0);
    let (terrain, costs) = costs(&sensed, &vehicle, &rules);
    for index in 0..sensed.fused.len() {
        let place = Place::new((index % 41) as i32, (index / 41) as i32);
        let cost = terrain.terms(&sensed, place, &vehicle, &rules).map(|terms| limited(terms.total()));
        assert_eq!(costs.get(place), Some(cost.unwrap_or(BLOCKED)), "{place:?}");
    }
}

#[test]
fn the_nearest_free_cell_is_found_within_the_distance() {
    let sensed = with_obstacle(0.0, 0.0);
    let (_, costs) = costs(&sensed, &Pose::from_xy_yaw(FAR, FAR, 0.0), &rules());
    let near =
        |x_m, within_m| Terrain::nearest_free(&sensed, &costs, DVec2::new(x_m, 0.05), within_m, |_| true);
    assert_eq!(near(0.0, 0.3), None);
    assert_eq!(near(0.1, 0.8), Some(at(0.4, 0.4)));
    assert_eq!(near(2.0, 0.0), Some(at(2.0, 0.0)));
    assert_eq!(near(f64::NAN, 1.0), None);
}

#[test]
fn far_from_the_vehicle_a_narrower_gap_is_enough_and_as_dear_as_the_narrowest() {
    let sensed = with_obstacle(0.0, 0.0);
    let rules = Rules { far_room_m: 0.2, near_m: 2.0, clearance: 40.0, ..rules() };
    for (vehicle_m, expected) in [(1.0, Some(BLOCKED)), (3.0, Some(50))] {
        let vehicle = Pose::from_xy_yaw(vehicle_m, vehicle_m, 0.0);
        let (terrain, costs) = costs(&sensed, &vehicle, &Rules { heading_range_m: 0.0, ..rules.clone() });
        assert_eq!(costs.get(at(0.4, 0.0)), expected, "seen from {vehicle_m} m");
        assert!(terrain.room_m(&sensed, DVec2::new(0.4, 0.0), &rules) < 0.4);
        assert_eq!(costs.get(at(0.0, 0.0)), Some(BLOCKED), "the obstacle itself");
    }
}

#[test]
fn a_way_that_was_driven_before_is_cheaper_than_beside_it() {
    let rules = Rules { route: 0.5, route_range_m: 1.0, heading_range_m: 0.0, ..rules() };
    let away = Pose::from_xy_yaw(FAR, FAR, 0.0);
    let mut terrain = Terrain::default();
    let route: Vec<DVec2> = (0..20).map(|step| DVec2::new(f64::from(step) * 0.2 - 2.0, 0.0)).collect();
    let costs =
        terrain.costs(&sensed(31), &away, &Past { route: &route, ..Past::default() }, &rules).unwrap();
    assert_eq!(costs.get(at(0.0, 0.0)), Some(30), "half of 60");
    assert_eq!(costs.get(at(0.0, 2.0)), Some(60));
    let terms = terrain.terms(&sensed(31), at(0.0, 0.0), &away, &rules).unwrap();
    assert!((terms.memory + 30.0).abs() < 0.1, "{terms:?}");
}

#[test]
fn a_narrow_way_that_was_driven_before_is_cheaper_than_unknown_ground_beside_it() {
    let rules = Rules { route: 0.5, route_range_m: 1.0, heading_range_m: 0.0, ..rules() };
    let away = Pose::from_xy_yaw(FAR, FAR, 0.0);
    // A corridor along x between walls 1.4 m apart; beyond them, nothing is known.
    let mut sensed = sensed(0);
    for index in 0..sensed.fused.len() {
        let across_m = (((index / 41) as f64 - 20.0) * 0.2).abs();
        sensed.fused[index] = if across_m > 1.1 { 255 } else { u8::from(across_m > 0.7) * 250 };
    }
    let route = [DVec2::ZERO];
    let cost = |route: &[DVec2]| {
        let past = Past { route, ..Past::default() };
        Terrain::default().costs(&sensed, &away, &past, &rules).unwrap().get(at(0.0, 0.0)).unwrap()
    };
    assert_eq!((cost(&[]), cost(&route)), (15, 8), "half of 10 for the ground and 5 for the walls");
    let past = Past { route: &route, ..Past::default() };
    let mut terrain = Terrain::default();
    terrain.costs(&sensed, &away, &past, &rules).unwrap();
    let terms = terrain.terms(&sensed, at(0.0, 0.0), &away, &rules).unwrap();
    assert!((terms.memory + 7.5).abs() < 0.5, "{terms:?}");
}

#[test]
fn a_gap_that_was_too_narrow_from_near_stays_closed_when_the_vehicle_is_far_away() {
    let sensed = with_obstacle(0.0, 0.0);
    let rules = Rules { far_room_m: 0.2, near_m: 2.0, heading_range_m: 0.0, ..rules() };
    let far = Pose::from_xy_yaw(3.0, 3.0, 0.0);
    for (track, expected) in [(&[][..], Some(50)), (&[DVec2::ONE][..], Some(BLOCKED))] {
        let past = Past { track, ..Past::default() };
        let costs = Terrain::default().costs(&sensed, &far, &past, &rules).unwrap();
        assert_eq!(costs.get(at(0.4, 0.0)), expected, "{track:?}");
    }
}

#[test]
fn a_gap_of_two_coarse_cells_is_wide_enough_and_one_of_one_cell_is_not() {
    // Cells of 0.6 m, and a wall along x with a gap.
    let rules = Rules {
        half_width_m: 0.33,
        least_room_m: 0.33,
        far_room_m: 0.2,
        near_m: 4.0,
        heading_range_m: 0.0,
        ..rules()
    };
    let near = Pose::from_xy_yaw(0.0, 1.0, 0.0);
    for (cells, expected) in [(1, BLOCKED), (2, 50), (3, 50)] {
        let mut sensed = Sensed {
            columns: 21,
            cell_size_m: 0.6,
            corner: DVec2::splat(-6.3),
            fused: vec![0; 441],
            ..sensed(0)
        };
        for column in (0..21).filter(|column| !(10..10 + cells).contains(column)) {
            sensed.fused[10 * 21 + column] = 250;
        }
        // Another wall before and behind it: a corridor, so that no block lies across its end.
        for column in [9, 10 + cells] {
            sensed.fused[9 * 21 + column] = 250;
            sensed.fused[11 * 21 + column] = 250;
        }
        let (terrain, costs) = costs(&sensed, &near, &rules);
        let gap = Place::new(10, 10);
        assert_eq!(costs.get(gap), Some(expected), "{cells} cells");
        let terms = terrain.terms(&sensed, gap, &near, &rules);
        assert_eq!(terms.is_ok(), expected != BLOCKED, "{terms:?}");
    }
}

#[test]
fn the_path_that_was_planned_before_is_cheaper_than_beside_it() {
    let rules = Rules { previous: 0.2, previous_range_m: 1.0, heading_range_m: 0.0, ..rules() };
    let away = Pose::from_xy_yaw(FAR, FAR, 0.0);
    let past = Past { previous: &[DVec2::ZERO], ..Past::default() };
    let mut terrain = Terrain::default();
    let costs = terrain.costs(&sensed(31), &away, &past, &rules).unwrap();
    assert_eq!((costs.get(at(0.0, 0.0)), costs.get(at(2.0, 0.0))), (Some(48), Some(60)));
    let terms = terrain.terms(&sensed(31), at(0.0, 0.0), &away, &rules).unwrap();
    assert!((terms.previous + 12.0).abs() < 0.1 && terms.memory == 0.0, "{terms:?}");
}

#[test]
fn an_obstacle_that_was_seen_from_far_alone_costs_but_does_not_block() {
    let mut sensed = with_obstacle(3.0, 0.0);
    let rules = Rules { sure_m: 2.0, unsure: 70, ..rules() };
    let vehicle = Pose::from_xy_yaw(0.0, 0.0, 0.0);
    let blocks = |sensed: &Sensed, expected: u8, why: &str| {
        let (_, costs) = costs(sensed, &vehicle, &rules);
        assert_eq!(costs.get(at(3.0, 0.0)), Some(expected), "{why}");
    };
    blocks(&sensed, BLOCKED, "the map does not say from where it was seen");
    sensed.seen_from_dm = vec![21; sensed.fused.len()];
    let (terrain, around) = costs(&sensed, &vehicle, &rules);
    assert_eq!(around.get(at(3.0, 0.0)), Some(70));
    assert_eq!(around.get(at(2.8, 0.0)), Some(10), "it takes no room");
    assert_eq!(terrain.terms(&sensed, at(3.0, 0.0), &vehicle, &rules).unwrap().terrain, 70.0);
    sensed.seen_from_dm.fill(20);
    blocks(&sensed, BLOCKED, "it was seen from near");
    sensed.seen_from_dm.fill(0);
    blocks(&sensed, 70, "no vote called it an obstacle");
    let is_obstacle: Vec<bool> = sensed.fused.iter().map(|&fused| fused == 250).collect();
    sensed.remembered = is_obstacle.clone();
    blocks(&sensed, BLOCKED, "an earlier run was nearer");
    (sensed.bumped, sensed.remembered) = (is_obstacle, Vec::new());
    blocks(&sensed, BLOCKED, "the bumper hit it");
}

#[test]
fn a_barred_place_has_the_greatest_cost_but_can_be_driven_if_it_is_the_only_way() {
    let sensed = with_obstacle(1.0, 0.0);
    let costs =
        costs_with_barred(&sensed, &[Barred { at: (0.0, 0.0), radius_m: 0.5, slipped: false, stood: None }]);
    let cost = |x_m| costs.get(at(x_m, 0.0)).unwrap();
    assert_eq!([cost(0.0), cost(-0.8)], [MAX_COST; 2], "within its radius and the least room");
    assert_eq!(cost(-1.2), 10);
    assert_eq!(cost(1.0), BLOCKED);
    assert_eq!(cost(0.8), BLOCKED, "an obstacle in a barred place is still one");
}

#[test]
fn a_firm_path_through_a_place_where_the_wheels_slipped_is_cheaper_than_the_mud_beside_it() {
    let mut sensed = sensed(0);
    for row in 0..sensed.fused.len() / sensed.columns {
        for column in 0..sensed.columns {
            let place = Place::new(column as i32, row as i32);
            let index = sensed.index(place);
            sensed.fused[index] = if sensed.centre(place).y > 0.0 { 120 } else { 0 };
        }
    }
    let slipped = Barred { at: (0.0, 0.0), radius_m: 2.0, slipped: true, stood: None };
    let costs = costs_with_barred(&sensed, &[slipped]);
    let cost = |y_m| costs.get(at(0.0, y_m)).unwrap();
    assert_eq!(cost(-1.0), 40, "firm: four times as dear");
    assert_eq!(cost(1.0), 240, "mud");
    assert_eq!(cost(-4.0), 10, "outside of the place");
    let index = sensed.index(at(1.0, -1.0));
    sensed.fused[index] = 250;
    let beside = costs_with_barred(&sensed, &[slipped]).get(at(0.4, -1.0)).unwrap();
    let outside = costs_with_barred(&sensed, &[]).get(at(0.4, -1.0)).unwrap();
    assert!(
        beside.abs_diff(4 * outside) <= 2,
        "close to an obstacle it is as much dearer: {beside} {outside}"
    );
    assert!(outside > 10);
    let costs = costs_with_barred(&sensed, &[slipped, Barred { slipped: false, ..slipped }]);
    assert_eq!(costs.get(at(0.0, -1.0)).unwrap(), MAX_COST, "the vehicle does not get there");
}

fn costs_with_barred(sensed: &Sensed, barred: &[Barred]) -> CostGrid {
    let past = Past { barred, ..Past::default() };
    Terrain::default().costs(sensed, &Pose::from_xy_yaw(FAR, FAR, 0.0), &past, &rules()).unwrap()
}

/// A rectangle from its lowest to its highest corner, m.
fn rectangle([low, high]: [(f64, f64); 2]) -> Polygon {
    let corners = [low, (high.0, low.1), high, (low.0, high.1)];
    Polygon::new(corners.map(DVec2::from)).unwrap()
}

/// The costs where these rectangles must not be entered, from their lowest to their highest corners, m.
fn costs_with_zones(vehicle: &Pose, zones: &[[(f64, f64); 2]]) -> CostGrid {
    let zones = Zones { keep_out: zones.iter().copied().map(rectangle).collect(), ..Zones::default() };
    let past = Past { zones: Some(&zones), ..Past::default() };
    Terrain::default().costs(&sensed(0), vehicle, &past, &rules()).unwrap()
}

#[test]
fn a_vehicle_inside_of_a_zone_can_leave_it_where_the_nearest_border_leads_into_another_zone() {
    // To the east, 0.2 m away, another zone begins; to the west, 1.7 m away, there is none.
    let zones = [[(-0.9, -3.0), (1.0, 3.0)], [(0.9, -3.5), (3.7, 3.5)]];
    let costs = costs_with_zones(&Pose::from_xy_yaw(0.8, 0.0, 0.0), &zones);
    for x_m in [0.8, 0.0, -0.6, -1.0, -1.6] {
        assert_ne!(costs.get(at(x_m, 0.0)), Some(BLOCKED), "{x_m} m");
    }
    assert_eq!(costs.get(at(3.4, 0.0)), Some(BLOCKED), "farther than the way out");
    let outside = costs_with_zones(&Pose::from_xy_yaw(-2.0, 0.0, 0.0), &zones);
    assert_eq!(outside.get(at(-0.6, 0.0)), Some(BLOCKED));
}

#[test]
fn a_zone_that_is_thinner_than_a_cell_is_not_entered() {
    // Between the middles of two rows of cells.
    let costs = costs_with_zones(&Pose::from_xy_yaw(0.0, -3.0, 0.0), &[[(-9.0, 1.02), (9.0, 1.08)]]);
    for x_m in [-4.0, -1.0, 0.0, 2.2, 4.0] {
        assert_eq!(costs.get(at(x_m, 1.0)), Some(BLOCKED), "{x_m} m");
    }
    assert_ne!(costs.get(at(0.0, 2.0)), Some(BLOCKED));
}

/// Whether a way leads from a vehicle to a place past zones, m, with relief up to a distance from the vehicle, m.
fn leads(from: DVec2, to: DVec2, zones: &Zones, relief_range_m: f64) -> bool {
    let rules = Rules { relief_range_m, ..rules() };
    let past = Past { zones: Some(zones), ..Past::default() };
    let vehicle = Pose::from_xy_yaw(from.x, from.y, 0.0);
    let costs = Terrain::default().costs(&sensed(0), &vehicle, &past, &rules).unwrap();
    let (start, end) = (at(from.x, from.y), at(to.x, to.y));
    Search::default().path(&costs, start, end, 20, &mut Path::default()).is_ok()
}

#[test]
fn a_vehicle_close_to_a_thin_zone_can_leave_it_on_its_side_and_does_not_cross_it() {
    let zones = Zones { keep_out: vec![rectangle([(-9.0, 1.02), (9.0, 1.08)])], ..Zones::default() };
    let (south, north) = (DVec2::new(2.0, -2.0), DVec2::new(2.0, 3.0));
    for relief_range_m in [0.0, 0.8, 1.2] {
        let both =
            |y_m: f64| [south, north].map(|to| leads(DVec2::new(0.0, y_m), to, &zones, relief_range_m));
        // From 0.9 to 1.1 m, the vehicle stands in a cell that the borders cross.
        for y_m in [0.3, 0.5, 0.7, 0.85, 0.95, 1.01] {
            assert_eq!(both(y_m), [true, false], "{y_m} m, relief up to {relief_range_m} m");
        }
        for y_m in [1.09, 1.15, 1.25, 1.5, 1.9] {
            assert_eq!(both(y_m), [false, true], "{y_m} m, relief up to {relief_range_m} m");
        }
        assert_eq!(both(1.05), [true, true], "inside of the zone, relief up to {relief_range_m} m");
    }
}

#[test]
fn a_vehicle_on_a_cell_that_a_slanting_border_crosses_does_not_cross_it() {
    // Along y = x + 0.07 m, 0.05 m high.
    let corners = [(-9.0, -8.93), (9.0, 9.07), (9.0, 9.12), (-9.0, -8.88)];
    let zones = Zones { keep_out: vec![Polygon::new(corners.map(DVec2::from)).unwrap()], ..Zones::default() };
    let aside = DVec2::new(-1.0, 1.0).normalize();
    for (along, across) in (0..8).flat_map(|along| (-6..=6).map(move |across| (along, across))) {
        let x_m = f64::from(along) * 0.083 - 0.31;
        let from = DVec2::new(x_m, x_m + 0.095 + f64::from(across) * 0.066);
        if !zones.forbid(from) {
            let beside = aside * 2.5 * f64::from(across).signum();
            assert!(leads(from, from + beside, &zones, 0.8), "{from}: on its side");
            assert!(!leads(from, from - beside, &zones, 0.8), "{from}: beyond the zone");
        }
    }
}

#[test]
fn a_vehicle_beside_the_end_of_a_thin_zone_drives_around_it() {
    let zones = Zones { keep_out: vec![rectangle([(-9.0, 1.02), (0.0, 1.08)])], ..Zones::default() };
    assert!(leads(DVec2::new(-0.5, 0.9), DVec2::new(-0.6, 2.6), &zones, 0.8));
}

#[test]
fn a_vehicle_in_the_corner_of_its_area_can_leave_the_corner() {
    // The middles of the cells beside its own lie outside of the area, but that of one diagonally across.
    let zones = Zones { area: Some(rectangle([(0.05, 0.05), (3.5, 3.5)])), ..Zones::default() };
    for relief_range_m in [0.0, 0.8] {
        assert!(leads(DVec2::new(0.08, 0.08), DVec2::new(2.0, 2.0), &zones, relief_range_m));
    }
}

#[test]
fn relief_does_not_open_a_zone() {
    let zones = Zones { keep_out: vec![rectangle([(0.7, -1.0), (2.0, 1.0)])], ..Zones::default() };
    let rules = Rules { relief_range_m: 1.2, ..rules() };
    let past = Past { zones: Some(&zones), ..Past::default() };
    let vehicle = Pose::IDENTITY;
    let mut terrain = Terrain::default();
    let costs = terrain.costs(&sensed(0), &vehicle, &past, &rules).unwrap();
    assert_eq!(costs.get(at(0.8, 0.0)), Some(BLOCKED));
    assert_eq!(terrain.terms(&sensed(0), at(0.8, 0.0), &vehicle, &rules), Err(Obstruction::Obstacle));
}
