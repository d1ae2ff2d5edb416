//! Golden traces of perception, fusion and localization on bundled courses: some numbers of each process, once per
//! second.
//!
//! A change of these numbers is reviewed as a diff of `tests/golden/*.csv`. `just golden` rewrites the files.

use crate::bundled::plan;
use rcs_msg::{FieldScanner, Stamp};
use rcs_runtime::{RunOptions, Stepped};
use rcs_testkit::golden::Trace;

/// The root of the repository, which contains `tests/golden`.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
const STACK: &str = "learning";
/// Courses, and the duration of the drive, s.
const COURSES: [(&str, u64); 2] = [("mulch_path", 15), ("meadow", 15)];

/// Trace columns of a part: `(column, buffer, field)`.
type Columns = &'static [(&'static str, &'static str, &'static str)];

/// One file per part and course.
const PARTS: [(&str, Columns); 6] = [
    (
        "stereo",
        &[
            ("left_pairs", "/stereo_left/stats", ".pairs"),
            ("left_density_pct", "/stereo_left/stats", ".density_pct"),
            ("left_min_range_m", "/stereo_left/stats", ".min_range_m"),
            ("left_max_range_m", "/stereo_left/stats", ".max_range_m"),
            ("right_pairs", "/stereo_right/stats", ".pairs"),
            ("right_density_pct", "/stereo_right/stats", ".density_pct"),
            ("right_min_range_m", "/stereo_right/stats", ".min_range_m"),
            ("right_max_range_m", "/stereo_right/stats", ".max_range_m"),
        ],
    ),
    (
        "obstacles",
        &[
            ("left_ground", "/obstacles_left/stats", ".ground"),
            ("left_obstacle", "/obstacles_left/stats", ".obstacle"),
            ("left_short", "/obstacles_left/stats", ".short_obstacle"),
            ("left_cells", "/obstacles_left/stats", ".cells"),
            ("left_obstacle_cells", "/obstacles_left/stats", ".obstacle_cells"),
            ("right_ground", "/obstacles_right/stats", ".ground"),
            ("right_obstacle", "/obstacles_right/stats", ".obstacle"),
            ("right_short", "/obstacles_right/stats", ".short_obstacle"),
            ("right_cells", "/obstacles_right/stats", ".cells"),
            ("right_obstacle_cells", "/obstacles_right/stats", ".obstacle_cells"),
        ],
    ),
    (
        "color",
        &[
            ("left_models", "/color_left/stats", ".ground_models"),
            ("left_ground_px", "/color_left/stats", ".ground"),
            ("left_background_px", "/color_left/stats", ".background"),
            ("left_unclassified_px", "/color_left/stats", ".unclassified"),
            ("left_obstacle_cells", "/color_left/stats", ".obstacle_cells"),
            ("right_models", "/color_right/stats", ".ground_models"),
            ("right_ground_px", "/color_right/stats", ".ground"),
            ("right_background_px", "/color_right/stats", ".background"),
            ("right_unclassified_px", "/color_right/stats", ".unclassified"),
            ("right_obstacle_cells", "/color_right/stats", ".obstacle_cells"),
        ],
    ),
    (
        "terrain",
        &[
            ("ground_points", "/terrain/stats", ".ground"),
            ("obstacle_points", "/terrain/stats", ".obstacle"),
            ("cells_with_model", "/terrain/stats", ".cells_with_model"),
            ("models", "/terrain/stats", ".models"),
            ("driven", "/terrain/stats", ".driven"),
            ("left_traversable", "/classifier_left/stats", ".traversable"),
            ("left_not_traversable", "/classifier_left/stats", ".not_traversable"),
            ("left_unclassified", "/classifier_left/stats", ".unclassified"),
            ("right_traversable", "/classifier_right/stats", ".traversable"),
            ("right_not_traversable", "/classifier_right/stats", ".not_traversable"),
            ("right_unclassified", "/classifier_right/stats", ".unclassified"),
        ],
    ),
    (
        "world_model",
        &[
            ("known", "/wm1/stats", ".known"),
            ("obstacle", "/wm1/stats", ".obstacle"),
            ("votes", "/wm1/stats", ".votes"),
            ("scrolled", "/wm1/stats", ".scrolled"),
        ],
    ),
    (
        "localization",
        &[
            ("local_x_m", "/localization/local", ".pose.position.x"),
            ("local_y_m", "/localization/local", ".pose.position.y"),
            ("local_z_m", "/localization/local", ".pose.position.z"),
            ("local_qz", "/localization/local", ".pose.orientation.z"),
            ("local_var_x_m2", "/localization/local", ".pose_covariance[0]"),
            ("global_x_m", "/localization/global", ".pose.position.x"),
            ("global_y_m", "/localization/global", ".pose.position.y"),
            ("global_qz", "/localization/global", ".pose.orientation.z"),
            ("global_var_x_m2", "/localization/global", ".pose_covariance[0]"),
            ("truth_x_m", "/vehicle/ground_truth_pose", ".pose.position.x"),
            ("truth_y_m", "/vehicle/ground_truth_pose", ".pose.position.y"),
        ],
    ),
];

/// A field of a buffer's newest message; NaN before the first.
fn newest(run: &Stepped, buffer: &str, field: &str) -> f64 {
    let buffer = run.bus().get(buffer).unwrap_or_else(|| panic!("there is no buffer {buffer}"));
    let path = field.parse().unwrap_or_else(|error| panic!("{field}: {error}"));
    let scanner = FieldScanner::new(&buffer.spec().schema, &path)
        .unwrap_or_else(|error| panic!("{}{field}: {error}", buffer.name()));
    let Some(sample) = buffer.latest() else { return f64::NAN };
    // A number that is 0 is absent on the wire.
    scanner.scan(&sample.message.bytes()).unwrap_or_else(|error| panic!("{field}: {error}")).unwrap_or(0.0)
}

fn check(course: &str, seconds: u64) {
    let mut run = Stepped::new(plan(STACK, course, &[]), None, RunOptions::default()).unwrap();
    run.begin().unwrap();
    let mut traces = PARTS.map(|(_, columns)| {
        let names: Vec<&str> = ["time_s"].into_iter().chain(columns.iter().map(|column| column.0)).collect();
        Trace::with_digits(&names, 3)
    });
    for second in 1..=seconds {
        run.run_until(Stamp(second * 1_000_000_000)).unwrap();
        for ((_, columns), trace) in PARTS.iter().zip(&mut traces) {
            let values = columns.iter().map(|(_, buffer, field)| newest(&run, buffer, field));
            trace.row(&[second as f64].into_iter().chain(values).collect::<Vec<_>>());
        }
    }
    let failed: Vec<String> = PARTS
        .iter()
        .zip(&traces)
        .filter_map(|((part, _), trace)| trace.differs(ROOT, &format!("{course}_{part}.csv")))
        .collect();
    assert!(
        failed.is_empty(),
        "`just golden` writes the traces anew; first differences:\n{}",
        failed.join("\n")
    );
}

#[test]
fn perception_fusion_and_localization_on_the_mulch_path_are_as_committed() {
    let (course, seconds) = COURSES[0];
    check(course, seconds);
}

#[test]
fn perception_fusion_and_localization_on_the_meadow_are_as_committed() {
    let (course, seconds) = COURSES[1];
    check(course, seconds);
}
