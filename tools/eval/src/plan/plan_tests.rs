//! Small files with errors, and the public maps.

use super::*;
use std::fs;

const MAP: &str = "type octile\nheight 3\nwidth 4\nmap\n..@.\n.T..\nG..S\n";
const SCENARIOS: &str = "version 1\n0\ta b.map\t4\t3\t0\t0\t3\t0\t6.41421356\n0\tm\t4\t3\t0\t0\t0\t0\t0\n\n";

fn evaluated(map: &str, scenarios: &str) -> Result<Report, String> {
    let folder = tempfile::tempdir().unwrap();
    let [map_file, scenario_file] = ["a.map", "a.scen"].map(|name| folder.path().join(name));
    fs::write(&map_file, map).unwrap();
    fs::write(&scenario_file, scenarios).unwrap();
    let job = Job { map: &map_file, scenarios: &scenario_file };
    measure(&job).map_err(|error| error.to_string().replace(&*folder.path().to_string_lossy(), ""))
}

#[test]
fn a_small_map_is_solved_without_cutting_corners() {
    let report = evaluated(MAP, SCENARIOS).unwrap();
    assert_eq!((report.scenarios, report.solved), (2, 2));
    let ratio = report.cost_ratio_max.unwrap();
    assert!((ratio - 1.0).abs() < 1e-6, "{report:?}");
    assert_eq!(evaluated(&MAP.replace('\n', "\r\n"), &SCENARIOS.replace('\n', "\r\n")).unwrap().solved, 2);
    for scenarios in [format!("\n \n{SCENARIOS}"), "0 m 4 3 0 0 0 0 0\n0 m 4 3 0 0 1 0 1\n".to_owned()] {
        assert_eq!(evaluated(MAP, &scenarios).unwrap().solved, 2, "{scenarios}");
    }
    let text = serde_json::to_string(&report).unwrap();
    assert!(text.starts_with("{\"solved\":2,\"cost_ratio_max\":1"), "{text}");
}

#[test]
fn a_scenario_that_no_path_solves_is_not_solved() {
    let report = evaluated(MAP, "version 1\n0\tm\t4\t3\t0\t0\t2\t0\t2\n0\tm\t4\t3\t2\t0\t0\t0\t2\n").unwrap();
    assert_eq!((report.solved, report.cost_ratio_max), (0, None));
    let json = serde_json::to_value(report).unwrap();
    assert!(json["cost_ratio_max"].is_null() && json["ms_median"].is_number(), "{json}");
}

#[test]
fn a_search_that_ends_before_it_knows_is_refused_with_its_line() {
    let solved = |result| is_solved(result, Path::new("/a.scen"), 7).map_err(|error| error.to_string());
    assert_eq!((solved(Ok(())), solved(Err(NoPath::NotConnected))), (Ok(true), Ok(false)));
    let error = solved(Err(NoPath::TooDear)).unwrap_err();
    assert!(error.starts_with("/a.scen, line 7: no path of up to about 10"), "{error}");
}

#[test]
fn bad_files_are_refused_with_their_line() {
    let map = |from: &str, to: &str| evaluated(&MAP.replacen(from, to, 1), SCENARIOS).unwrap_err();
    let scen = |from: &str, to: &str| evaluated(MAP, &SCENARIOS.replacen(from, to, 1)).unwrap_err();
    for (error, expected) in [
        (map("octile", "hex"), "/a.map, line 1: got \"type hex\", expected \"type octile\""),
        (map("height 3", "height -3"), "/a.map, line 2: height is \"-3\", expected a whole number from 1 to"),
        (map("width 4", "width 999999999999"), "/a.map, line 3: width is"),
        (map("width 4\n", ""), "/a.map, line 1: the head of the file has no width"),
        (map("map\n", "width 4\nmap\n"), "/a.map, line 4: width is given again, expected it once"),
        (map("width 4", "height 3"), "/a.map, line 3: height is given again, expected it once"),
        (map(".T..", ".T."), "/a.map, line 6: row 1 has 3 cells, expected 4"),
        (map(".T..", ".x.."), "/a.map, line 6: cell 1 of row 1 is 'x', expected free"),
        (map("G..S\n", ""), "/a.map, line 6: the file ends here, expected 3 rows of cells, got 2"),
        (map("G..S\n", "G..S\nG..S\n"), "/a.map, line 8: got \"G..S\" after the 3 rows"),
        (map("map\n", ""), "/a.map, line 4: got \"..@.\", expected"),
        (scen("version 1", "version 2"), "/a.scen, line 1: got \"version 2\", expected \"version 1\""),
        (scen("\t4\t3\t", "\t8\t6\t"), "/a.scen, line 2: the scenario is for a map of 8x6 cells"),
        (scen("\t3\t0\t6", "\t3\t3\t6"), "/a.scen, line 2: goal is (3, 3), expected columns 0 to 3"),
        (
            scen("6.41421356", "0"),
            "/a.scen, line 2: optimal length is \"0\", expected a finite number from 3.0",
        ),
        (scen("6.41421356", "inf"), "/a.scen, line 2: optimal length is \"inf\", expected a finite"),
        (scen("6.41421356", "x"), "/a.scen, line 2: optimal length is \"x\", expected a number"),
        (scen("a b.map\t4", ""), "/a.scen, line 2: has 7 columns, expected 9: bucket, map, map width"),
        (scen("6.41421356", "6.41421356\t7"), "/a.scen, line 2: has 10 columns, expected 9"),
        (
            scen("\t3\t0\t0\t", "\t3\t0.5\t0\t"),
            "/a.scen, line 2: start x is \"0.5\", expected a whole number up to",
        ),
        (
            scen("version 1", "\nversion 1\n\nversion 1"),
            "/a.scen, line 4: got \"version 1\", expected the version once, on the first line",
        ),
        (scen("\n\n", "\nversion 1\n"), "/a.scen, line 4: got \"version 1\", expected the version once"),
        (
            evaluated(MAP, "version 1\n").unwrap_err(),
            "/a.scen, line 1: the file ends here, expected a scenario",
        ),
        (evaluated(MAP, "").unwrap_err(), "/a.scen, line 1: the file ends here, expected a scenario"),
    ] {
        assert!(error.starts_with(expected), "{error}\n{expected}");
    }
    let absent = Job { map: Path::new("/absent.map"), scenarios: Path::new("/absent.scen") };
    assert_eq!(measure(&absent).unwrap_err().to_string(), "cannot read /absent.map");
}

#[test]
fn the_public_maps_are_solved_with_the_optimal_lengths() {
    let Some(folder) = rcs_testkit::data_dir() else { return };
    for map in
        ["cities/Berlin_0_256", "dao/arena", "dao/den312d", "random/random512-10-0", "rooms/16room_003"]
    {
        let file = |suffix: &str| folder.join(format!("movingai/{map}.{suffix}"));
        let report = measure(&Job { map: &file("map"), scenarios: &file("map.scen") }).unwrap();
        assert_eq!(report.solved, report.scenarios, "{map}");
        assert!(report.cost_error_max.is_some_and(|error| error < 5e-3), "{map}: {report:?}");
    }
}
