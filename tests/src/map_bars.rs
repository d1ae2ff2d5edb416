//! The map of the stack `learning` on every course, as a planner feels it: how often it calls arcs of 3 m blocked that
//! are free, and free that are blocked, and whether it is worse than stereo alone.

use crate::bundled;
use crate::judged::simulated;
use rcs_eval::obstacles::{FUSED, Report};

/// Courses with growth that range sensors see and a vehicle pushes through. The bar for free arcs does not hold there
/// before it has been learned (docs/perception.md has the figures).
const GROWTH: [&str; 7] =
    ["soft_ground_2", "tall_grass", "tall_grass_2", "thickets", "thickets_2", "transition", "transition_2"];

/// The courses with or without growth, in their first or second look.
fn courses(growth: bool, second: bool) -> Vec<String> {
    let is_wanted = |name: &String| GROWTH.contains(&&**name) == growth && name.ends_with("_2") == second;
    let courses: Vec<String> = bundled::courses().into_iter().filter(is_wanted).collect();
    assert!(courses.len() >= 3, "{courses:?}");
    courses
}

/// Drives with a seed that nothing was tuned on.
fn drive(course: &str, seconds: f64) -> Report {
    simulated("learning", course, 3, seconds, &[])
}

/// Refuses a map that is worse than stereo alone in both shares, or of which a source is not judged.
fn check_against_sources(course: &str, report: &Report) {
    for length_m in [3.0, 5.0] {
        for source in ["stereo", "terrain", "color", "classifier", "bumper", "infrared"] {
            assert!(
                report.shares(source, length_m).is_some(),
                "{course}: {source} at {length_m} m: {report}"
            );
        }
        let of = |layer: &str| report.shares(layer, length_m).unwrap();
        let (fused, stereo) = (of(FUSED), of("stereo"));
        let free = fused.free_called_blocked_pct > stereo.free_called_blocked_pct;
        let blocked = fused.blocked_called_free_pct > stereo.blocked_called_free_pct;
        assert!(!(free && blocked), "{course} at {length_m} m: {report}");
    }
}

/// Where nothing gives way, the bars hold.
fn check_firm(second: bool) {
    for course in courses(false, second) {
        let report = drive(&course, 12.0);
        let fused = report.shares(FUSED, 3.0).unwrap();
        assert!(report.arcs[0].free > 100, "{course}: {report}");
        assert!(fused.free_called_blocked_pct.unwrap() <= 5.0, "{course}: {report}");
        assert!(fused.blocked_called_free_pct.is_none_or(|pct| pct <= 2.0), "{course}: {report}");
        assert_eq!(report.layers[0].late_things, 0, "{course}: {report}");
        check_against_sources(&course, &report);
    }
}

fn check_growth(second: bool) {
    for course in courses(true, second) {
        let report = drive(&course, 20.0);
        let fused = report.shares(FUSED, 3.0).unwrap();
        assert!(fused.blocked_called_free_pct.is_none_or(|pct| pct <= 2.0), "{course}: {report}");
        assert_eq!(report.layers[0].late_things, 0, "{course}: {report}");
        check_against_sources(&course, &report);
    }
}

#[test]
fn on_firm_ground_the_map_calls_arcs_what_they_are_and_blocks_the_way_to_each_thing_in_time() {
    check_firm(false);
}

#[test]
fn on_firm_ground_in_another_look_the_map_calls_arcs_what_they_are() {
    check_firm(true);
}

#[test]
fn in_tall_growth_the_map_misses_nothing_and_is_not_worse_than_stereo_alone() {
    check_growth(false);
}

#[test]
fn in_tall_growth_in_another_look_the_map_misses_nothing() {
    check_growth(true);
}

/// Boulders of 15 to 30 cm cover few rows of an image. The bar of 2 % does not hold for them (docs/perception.md).
#[test]
fn low_boulders_block_the_way_to_them_in_time() {
    let report = drive("low_boulders", 20.0);
    let fused = report.shares(FUSED, 3.0).unwrap();
    assert!(report.arcs[0].blocked > 20, "{report}");
    assert!(fused.free_called_blocked_pct.unwrap() <= 5.0, "{report}");
    assert!(fused.blocked_called_free_pct.unwrap() <= 5.0, "{report}");
    assert_eq!(report.layers[0].late_things, 0, "{report}");
    check_against_sources("low_boulders", &report);
}
