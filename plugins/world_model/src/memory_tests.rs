//! Maps with an L of obstacles on ground.

use super::*;
use crate::algo::{VoteOrigin, take};
use rcs_world::{Evidence, Map, MapOptions, SourceKind, VoteRule, Weighted, Weights, fuse};

const ORIGIN: (u8, f64, f64) = (18, 308_000.0, 4_333_000.0);

fn origin() -> Utm {
    Utm::new(ORIGIN.0, true, ORIGIN.1, ORIGIN.2).unwrap()
}

/// 50×50 cells of 0.4 m around (0, 0), with walls whose corner is at a place, and ground elsewhere.
pub(crate) fn map(wall: DVec2) -> Rectangle {
    let mut map = Rectangle::around(&[DVec2::ZERO], 10.0, 0.4).unwrap();
    for index in 0..map.costs.len() {
        let from_wall = map.centre(index) - wall;
        let on = |along: f64, across: f64| (0.0..5.0).contains(&along) && (0.0..0.8).contains(&across);
        let is_wall = on(from_wall.x, from_wall.y) || on(from_wall.y, from_wall.x);
        map.costs[index] = if is_wall { 250 } else { 0 };
    }
    map
}

#[test]
fn the_file_of_a_map_is_the_map() {
    let map = map(DVec2::new(2.0, 1.0));
    let text = rcs_msg::to_json(&rcs_msg::AnyMessage::new(map.to_memory(&origin()))).unwrap();
    let read = Rectangle::of_memory(&parse(&text).unwrap().unwrap(), &origin()).unwrap();
    assert_eq!((read.columns, &read.costs), (map.columns, &map.costs));
    assert!(read.corner.distance(map.corner) < 1e-6);
    assert_eq!(parse(" "), Ok(None));
}

#[test]
fn the_highest_cost_in_a_square_is_that_of_a_thin_obstacle_in_it() {
    let mut map = Rectangle::around(&[DVec2::ZERO], 2.0, 0.1).unwrap();
    for index in 0..map.costs.len() {
        let centre = map.centre(index);
        map.costs[index] = match () {
            () if centre.x < 0.0 => UNKNOWN_COST,
            () if (0.1..0.2).contains(&centre.y) => 250,
            () => 40,
        };
    }
    let most = |x: f64, y: f64, size_m: f64| map.most(DVec2::new(x, y), size_m);
    assert_eq!((most(0.75, 0.25, 0.4), most(0.75, 0.25, 0.1)), (250, 40));
    assert_eq!((most(0.8, 0.4, 0.4), most(0.8, 0.3, 0.4)), (40, 250), "the first ends beside the wall");
    assert_eq!((most(-0.05, 0.65, 0.4), most(-0.6, 0.65, 0.4)), (40, 255), "known in part, and unknown");
    assert_eq!((most(9.0, 0.15, 0.4), most(0.75, -9.0, 0.4), most(0.0, 0.0, 1e6)), (255, 255, 250));
}

#[test]
fn a_file_that_is_no_map_or_of_another_version_or_place_is_refused() {
    let good = map(DVec2::ZERO).to_memory(&origin());
    let error = |change: fn(&mut MapMemory)| {
        let mut map = good.clone();
        change(&mut map);
        parse(&rcs_msg::to_json(&rcs_msg::AnyMessage::new(map)).unwrap()).unwrap_err().to_string()
    };
    assert_eq!(error(|map| map.format = 2), "format is 2, expected 1");
    assert!(
        error(|map| map.columns = 7).starts_with("2500 cells in rows of 7, of 0.4 m, expected full rows")
    );
    assert!(error(|map| map.cell_size_m = 0.0).contains("of 0 m"));
    assert!(error(|map| map.costs.clear()).starts_with("0 cells"));
    let cost = |map: &mut MapMemory| map.costs = [vec![255, 250, 251], vec![0; 2497]].concat().into();
    assert_eq!(error(cost), "cell 2 has the cost 251, expected 0 to 250, or 255 for unknown");
    let bounds = " m, expected 0 to 1000000 m and -100000 to 10100000 m";
    for (error, easting) in [
        (error(|map| map.easting_m = f64::NAN), "NaN"),
        (error(|map| map.easting_m = 1e10), "10000000000"),
        (error(|map| map.easting_m = -1.0), "-1"),
    ] {
        let expected =
            format!("the corner is at easting {easting} m and northing {}{bounds}", good.northing_m);
        assert_eq!(error, expected);
    }
    for northing_m in [-1e10, 1e10, f64::INFINITY] {
        let mut map = good.clone();
        map.northing_m = northing_m;
        let text = rcs_msg::to_json(&rcs_msg::AnyMessage::new(map)).unwrap();
        let error = parse(&text).unwrap_err();
        assert_eq!(error, MemoryError::Place { easting_m: good.easting_m, northing_m });
    }
    assert!(parse("{\"format\": 1, \"columns\": -1}").is_err());
    let elsewhere = Utm::new(17, true, ORIGIN.1, ORIGIN.2).unwrap();
    assert_eq!(
        Rectangle::of_memory(&good, &elsewhere).unwrap_err().to_string(),
        "the map is in UTM zone 18, expected zone 17 of the global frame's origin"
    );
}

#[test]
fn remembered_ground_outweighs_what_was_sensed_a_few_times_and_not_what_is_sensed_well() {
    let frame = GridFrame::around(DVec2::ZERO, 1, 0.4);
    let grid = statement(&frame, &[0], 80, Source::MEMORY, "local", Stamp(1));
    let said = |name: &str| {
        let field = grid.fields.iter().find(|field| field.name == name).unwrap();
        grid.data[field.offset as usize]
    };
    let (cost, confidence, backing) = (said("cost.memory"), said("conf.memory"), said("backing.memory"));
    let memory = Evidence { cost, confidence, backing, ..Evidence::NONE };
    let weights: Weights = [
        Weighted { source: Source::STEREO, weight: 1.0, kind: SourceKind::Range },
        // As in the bundled stacks.
        Weighted { source: Source::MEMORY, weight: 0.2, kind: SourceKind::Learned },
    ]
    .into_iter()
    .collect();
    let fused = |times: u8| {
        let stereo = Evidence { cost: 250, confidence: times, ..Evidence::NONE };
        fuse(&[(Source::STEREO, stereo), (Source::MEMORY, memory)], &weights).cost
    };
    assert!(fused(8) < OBSTACLE_COST && fused(60) > 190, "{} {}", fused(8), fused(60));
    // What is remembered as being in the way needs no backing: it never lowers a cost.
    let wall = statement(&frame, &[250], 80, Source::MEMORY, "local", Stamp(1));
    assert_eq!(wall.data.as_ref(), [250, 80, 0]);
}

#[test]
fn the_cells_around_a_place_are_those_of_a_plain_loop() {
    for place in [DVec2::new(0.3, -0.2), DVec2::new(9.8, 9.9), DVec2::new(-30.0, 0.0), DVec2::new(0.0, 11.0)]
    {
        let mut map = map(DVec2::ZERO);
        let near = |map: &Rectangle, index: usize| map.centre(index).distance(place) <= 2.0;
        let expected: Vec<usize> = (0..map.costs.len()).filter(|&index| near(&map, index)).collect();
        map.costs.fill(0);
        map.around_each(place, 2.0, |_, cost| *cost += 1);
        let visited: Vec<usize> = (0..map.costs.len()).filter(|&index| map.costs[index] == 1).collect();
        assert_eq!(visited, expected, "{place}");
        assert_eq!(map.holds(place), place.abs().max_element() < 10.0, "{place}");
    }
}

#[test]
fn what_is_only_remembered_is_not_sensed_and_what_is_sensed_counts() {
    let rule = VoteRule { rise: 60, fall: 20, obstacle_fall: 20, max: 255, ground_max: 80 };
    let mut world = Map::new(0.4).unwrap();
    world.recentre(DVec2::ZERO).unwrap();
    let place = |column: u32| DVec2::new(0.2 + 0.4 * f64::from(column), 0.2);
    // By columns: what stereo senses, if anything, and what is remembered.
    let columns =
        [(Some(0), 250), (None, 250), (Some(250), 250), (Some(250), 255), (Some(0), 255), (None, 0)];
    let frame = GridFrame::around(DVec2::ZERO, 21, 0.4);
    let mut remembered = vec![UNKNOWN_COST; frame.side * frame.side];
    for (column, &(sensed, old)) in (0..).zip(&columns) {
        if let Some(cost) = sensed {
            let cell = world.grid().cell_at(place(column)).unwrap();
            world.vote(cell, Source::STEREO, cost, 1, Stamp(1), rule);
        }
        let slot = (0..remembered.len())
            .find(|slot| frame.middle(slot % frame.side, slot / frame.side).abs_diff_eq(place(column), 0.01));
        remembered[slot.unwrap()] = old;
    }
    let stated = statement(&frame, &remembered, 80, Source::MEMORY, "local", Stamp(1));
    let origin = VoteOrigin {
        source: Source::MEMORY,
        kind: SourceKind::Learned,
        sequence: 1,
        time: Stamp(1),
        rule,
        least_backing: 0,
        height_tolerance_m: 0.2,
    };
    take(&mut world, &stated, &origin).unwrap();
    let weights: Weights = [
        Weighted { source: Source::STEREO, weight: 1.0, kind: SourceKind::Range },
        Weighted { source: Source::MEMORY, weight: 0.2, kind: SourceKind::Learned },
    ]
    .into_iter()
    .collect();
    let sources = [Source::STEREO, Source::MEMORY].into_iter().collect();
    let message = world.to_grid("local", Stamp(1), &MapOptions { sources, heights: true, weights });
    let view = GridView::new(&message).unwrap();
    let fused = Rectangle::of_grid(&view).unwrap();
    assert!(is_obstacle(fused.at(place(1))), "on the map it counts");
    let sensed = Rectangle::sensed_from_near(&view, 8.0).unwrap();
    let costs: Vec<u8> = (0..6).map(|column| sensed.at(place(column))).collect();
    assert_eq!(costs, [0, 255, 250, 250, 0, 255]);
    assert_eq!(by_shape(&view).get(Source::MEMORY).weight, 0.0, "it is not compared with itself");
    let nothing_near = Rectangle::sensed_from_near(&view, 0.2).unwrap();
    assert_eq!(nothing_near.at(place(3)), 255, "an obstacle that was seen from farther away");
}

#[test]
fn a_range_sensor_of_any_name_is_compared_and_what_judges_by_appearance_is_not() {
    let rule = VoteRule { rise: 60, fall: 20, obstacle_fall: 20, max: 255, ground_max: 80 };
    let [radar, texture] = ["radar", "texture"].map(|name| Source::new(name).unwrap());
    let voted = [
        (DVec2::new(0.2, 0.2), radar),
        (DVec2::new(1.0, 0.2), Source::COLOR),
        (DVec2::new(1.8, 0.2), texture),
    ];
    let mut world = Map::new(0.4).unwrap();
    world.recentre(DVec2::ZERO).unwrap();
    for (place, source) in voted {
        let cell = world.grid().cell_at(place).unwrap();
        world.vote(cell, source, 250, 1, Stamp(1), rule);
    }
    let sources = voted.map(|(_, source)| source).into_iter().collect();
    // The message says by which model a learned source judged.
    let learned = Weighted { source: texture, weight: 1.0, kind: SourceKind::Learned };
    let options = MapOptions { sources, heights: true, weights: std::iter::once(learned).collect() };
    let message = world.to_grid("local", Stamp(1), &options);
    let view = GridView::new(&message).unwrap();
    let mut costs = Vec::new();
    fuse_grid(&view, &by_shape(&view), &mut costs).unwrap();
    let compared = Rectangle::with(&view, costs);
    assert_eq!(voted.map(|(place, _)| compared.at(place)), [250, UNKNOWN_COST, UNKNOWN_COST]);
}

#[test]
fn the_distance_from_which_obstacles_are_sure_is_one_that_a_map_tells() {
    use crate::proto::MapMemoryParams;
    let check =
        |near_m: f64| rcs_msg::params::check_typed(&MapMemoryParams { near_m, ..rcs_msg::params::default() });
    assert!(check(25.4).is_ok() && check(25.5).is_err());
}
