//! The learning map: up to which height growth is known to give way.

use crate::map::Vehicle;
use crate::map::tests::{RULES, drive_with, empty, judgement, place, vehicle};
use crate::models::{Heights, Terrain};
use crate::scene::terrain;
use rcs_geom::{CellIndex, Pose};

/// What range calls an obstacle, from its lowest to its highest point, local frame, mm.
fn growth([lowest_mm, top_mm]: [i32; 2]) -> Terrain {
    let heights = Heights { lowest_mm: Some(lowest_mm), obstacle_top_mm: Some(top_mm) };
    Terrain { heights, ..terrain(7, 0, 100) }
}

#[test]
fn driving_through_growth_says_nothing_about_what_is_higher() {
    // The frame of the vehicle has its origin on the ground, or 1.5 m above it.
    for (below_mm, wheels_below_m) in [(0, 0.0), (1500, 1.5)] {
        let mut map = empty();
        let growth = |above_ground_mm: [i32; 2]| growth(above_ground_mm.map(|mm| mm - below_mm));
        let row: Vec<_> = (0..40).map(|x| (place(x, 0), growth([100, 650]))).collect();
        let things = [(50, [100, 740]), (55, [100, 1100]), (60, [600, 1100])];
        let things = things.map(|(x, heights)| (place(x, 0), growth(heights)));
        map.learn(&[row.as_slice(), &things].concat(), &RULES);
        assert_eq!(map.models.models.len(), 1, "they look alike");
        drive_with(&Vehicle { wheels_below_m, ..vehicle(Pose::IDENTITY) }, &mut map, 0..30);
        assert_eq!(map.models.models[0].terrain.driven_height_mm, 650);
        let backings = [50, 55, 60].map(|x| judgement(&map, CellIndex::new(x, 0)).backing);
        let why = "as high as the growth, less the noise of range; a post; and one whose foot is hidden";
        assert_eq!(backings, [255, 0, 0], "{below_mm} mm: {why}");
    }
}

#[test]
fn driving_through_growth_tells_of_as_much_of_it_as_the_vehicle_is_high() {
    let backing = |height_m: f64| {
        let mut map = empty();
        let crop: Vec<_> = (0..60).map(|x| (place(x, 0), growth([0, 1200]))).collect();
        map.learn(&crop, &RULES);
        drive_with(&Vehicle { height_m, ..vehicle(Pose::IDENTITY) }, &mut map, 0..30);
        judgement(&map, CellIndex::new(50, 0)).backing
    };
    assert_eq!([0.8, 3.0].map(backing), [0, 255]);
}
