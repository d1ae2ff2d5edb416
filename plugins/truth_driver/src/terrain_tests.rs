//! Synthetic maps.

use super::*;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{PackedElementField, Vector2};

const RULES: Rules = Rules {
    room_m: 0.6,
    wish_room_m: 1.8,
    room_weight: 2.0,
    max_slope: 0.4,
    max_step_m: 0.15,
    slope_weight: 4.0,
    slip_weight: 4.0,
    vegetation_weight: 1.0,
};

/// A map of 60×40 cells of 0.2 m; a cell is (height, vegetation, class).
fn map(cell: impl Fn(usize, usize) -> (f32, f32, u8)) -> Grid {
    let mut data = Vec::new();
    for row in 0..40 {
        for column in 0..60 {
            let (height, vegetation, class) = cell(column, row);
            data.extend_from_slice(&height.to_le_bytes());
            data.extend_from_slice(&vegetation.to_le_bytes());
            data.push(class);
        }
    }
    let field = |name: &str, offset: u32, kind: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    Grid {
        frame_id: "global".to_owned(),
        column_count: 60,
        cell_size: Some(Vector2 { x: 0.2, y: 0.2 }),
        row_stride: 60 * 9,
        cell_stride: 9,
        fields: vec![
            field("height", 0, NumericType::Float32),
            field("vegetation", 4, NumericType::Float32),
            field("class", 8, NumericType::Uint8),
        ],
        data: data.into(),
        ..Grid::default()
    }
}

const START: DVec2 = DVec2::new(1.5, 4.0);
const GOAL: DVec2 = DVec2::new(10.5, 4.0);

fn way(cell: impl Fn(usize, usize) -> (f32, f32, u8)) -> Result<Way, NoWay> {
    Terrain::new(&map(cell), &RULES).unwrap().way(START, GOAL, &RULES)
}

#[test]
fn over_flat_grass_the_way_is_straight() {
    let way = way(|_, _| (0.0, 0.0, 1)).unwrap();
    assert!((crate::pursuit::length(&way.points, 0) - 9.0).abs() < 0.3, "{}", way.cost_m);
    assert!(way.points.iter().all(|&(point, _)| (point.y - 4.0).abs() < 0.7));
}

#[test]
fn the_way_keeps_its_room_from_things_and_passes_under_crowns() {
    let wall =
        |class| move |column: usize, row: usize| (0.0, 0.0, if column == 30 && row < 26 { class } else { 1 });
    let around = way(wall(23)).unwrap();
    assert!(around.points.iter().all(|&(_, room)| room >= 0.6));
    assert!(around.points.iter().any(|&(point, _)| point.y > 5.8), "it goes around the end of the fence");
    let under = way(wall(17)).unwrap();
    assert!(under.points.iter().all(|&(point, _)| point.y < 5.0));
}

#[test]
fn ditches_steep_faces_and_gaps_that_are_too_narrow_are_no_way() {
    let blocked =
        |result: Result<Way, NoWay>| assert!(matches!(result, Err(NoWay::Blocked { .. })), "{result:?}");
    blocked(way(|column, _| (if column == 30 || column == 31 { -0.3 } else { 0.0 }, 0.0, 1)));
    blocked(way(|column, _| ((column.clamp(20, 40) - 20) as f32 * 0.1, 0.0, 1)));
    blocked(way(|column, row| (0.0, 0.0, if column == 30 && !(18..22).contains(&row) { 19 } else { 1 })));
    // A gap of 1.6 m has enough clearance.
    let gap = way(|column, row| (0.0, 0.0, if column == 30 && !(16..24).contains(&row) { 19 } else { 1 }));
    assert!(gap.unwrap().points.iter().all(|&(_, room)| room >= 0.6));
}

#[test]
fn mud_slopes_and_tall_vegetation_are_gone_around_where_that_is_cheaper() {
    let detours = |patch: (f32, f32, u8)| {
        let cell = |column: usize, row: usize| {
            let inside = (25..35).contains(&column) && (12..26).contains(&row);
            if inside { patch } else { (0.0, 0.0, 1) }
        };
        way(cell).unwrap().points.iter().any(|&(point, _)| !(2.4..5.2).contains(&point.y))
    };
    assert!(detours((0.0, 0.0, 7)), "mud");
    assert!(detours((0.0, 2.0, 3)), "weeds of 2 m");
    assert!(!detours((0.0, 0.1, 1)), "short grass");
}

#[test]
fn what_the_map_says_is_blocked_is_no_way() {
    let mut grid = map(|_, _| (0.0, 0.0, 1));
    // The class field of a map that is 0 except in one column also serves as the field `blocked`.
    grid.data = map(|column, _| (0.0, 0.0, u8::from(column == 30))).data;
    assert!(Terrain::new(&grid, &RULES).unwrap().way(START, GOAL, &RULES).is_ok());
    grid.fields.push(PackedElementField { name: "blocked".to_owned(), ..grid.fields[2].clone() });
    let result = Terrain::new(&grid, &RULES).unwrap().way(START, GOAL, &RULES);
    assert!(matches!(result, Err(NoWay::Blocked { .. })), "{result:?}");
}

#[test]
fn a_vehicle_that_stands_too_close_to_a_thing_may_leave() {
    let way =
        Terrain::new(&map(|column, row| (0.0, 0.0, if column == 5 && row == 20 { 16 } else { 1 })), &RULES)
            .unwrap()
            .way(START, GOAL, &RULES)
            .unwrap();
    assert!(way.points[0].1 < 0.6 && way.points[20].1 >= 0.6);
}

#[test]
fn places_off_the_map_and_maps_that_are_none_are_refused() {
    let flat = map(|_, _| (0.0, 0.0, 1));
    let terrain = Terrain::new(&flat, &RULES).unwrap();
    let error = terrain.way(START, DVec2::new(99.0, 4.0), &RULES).unwrap_err();
    assert_eq!(error.to_string(), "goal is at (99.0, 4.0) m, expected a place on the map");
    assert!(terrain.way(DVec2::new(f64::NAN, 0.0), GOAL, &RULES).is_err());
    let lacks = Grid { fields: flat.fields[1..].to_vec(), ..flat.clone() };
    assert!(Terrain::new(&lacks, &RULES).unwrap_err().contains("\"height\""));
    let nan = map(|column, _| (if column == 7 { f32::NAN } else { 0.0 }, 0.0, 1));
    assert!(Terrain::new(&nan, &RULES).unwrap_err().contains("cell 7"));
}
