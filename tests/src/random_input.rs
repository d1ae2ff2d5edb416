//! Runs the fuzz targets on random inputs, so that every test run checks that readers do not panic; the fuzzer searches
//! further.

use proptest::prelude::*;
use std::collections::BTreeSet;

#[path = "../../fuzz/src/lib.rs"]
#[allow(unreachable_pub, reason = "the fuzz targets see the same file as a crate of its own")]
mod targets;

#[path = "../../fuzz/src/app.rs"]
#[allow(unreachable_pub, reason = "the fuzz target sees the same file as a module of its own")]
mod app;

/// Inputs with many bytes that are zero, small or equal, like lengths and field numbers.
fn input() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![any::<u8>(), 0..8_u8, Just(255)];
    prop::collection::vec(byte, 0..200)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_damaged_log_opens_or_is_refused_and_reads_in_order(input in input()) {
        targets::log_reader(&input);
    }

    #[test]
    fn a_scanned_field_is_the_field_of_the_tree(input in input()) {
        targets::field_scanner(&input);
    }

    #[test]
    fn a_ros_message_decodes_or_is_refused(input in input()) {
        targets::cdr(&input);
    }

    #[test]
    fn a_stack_file_is_planned_or_refused_with_its_line(input in input()) {
        targets::stack_file(&input);
    }

    #[test]
    fn a_schema_of_others_is_understood_or_refused(input in input()) {
        targets::foreign::schema(&input);
    }

    #[test]
    fn a_payload_converts_or_is_refused(input in input()) {
        targets::foreign::payload(&input);
    }

    #[test]
    fn a_world_a_course_or_a_vehicle_is_read_or_refused_with_its_line(input in input()) {
        targets::foreign::scene_file(&input);
    }

    #[test]
    fn a_recorded_run_is_read_or_refused_with_words(input in input()) {
        targets::recorded::journal(&input);
    }

    #[test]
    fn a_layout_or_a_list_of_actions_is_read_or_refused_with_words(input in input()) {
        app::app_file(&input);
    }
}

/// The seeds of a target: inputs on which earlier versions failed, and one for each of its base inputs.
#[test]
fn the_seeds_of_every_fuzz_target_pass_it() {
    type Target = (&'static str, fn(&[u8]));
    const TARGETS: [Target; 9] = [
        ("log_reader", targets::log_reader),
        ("field_scanner", targets::field_scanner),
        ("cdr", targets::cdr),
        ("stack_file", targets::stack_file),
        ("schema", targets::foreign::schema),
        ("payload", targets::foreign::payload),
        ("scene_file", targets::foreign::scene_file),
        ("journal", targets::recorded::journal),
        ("app_file", app::app_file),
    ];
    let fuzz = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz");
    let files = std::fs::read_dir(fuzz.join("fuzz_targets")).expect("there are fuzz targets");
    let stem = |file: std::io::Result<std::fs::DirEntry>| {
        let path = file.expect("it can be read").path();
        path.file_stem().expect("a file has a name").to_string_lossy().into_owned()
    };
    let files: BTreeSet<String> = files.map(stem).collect();
    let names: BTreeSet<String> = TARGETS.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(files, names, "a new fuzz target belongs into this list and gets a test on random inputs");
    for (name, target) in TARGETS {
        let seeds = std::fs::read_dir(fuzz.join("seeds").join(name)).expect(name);
        let seeds = seeds.map(|entry| entry.expect(name).path());
        let mut count = 0;
        for seed in seeds {
            target(&std::fs::read(&seed).expect("a seed"));
            count += 1;
        }
        assert!(count > 0, "{name}");
    }
}
