//! What the fuzz targets do, run on random inputs: that no input makes a reader panic is checked with every test run,
//! and the fuzzer looks further.

use proptest::prelude::*;

#[path = "../../fuzz/src/lib.rs"]
#[allow(unreachable_pub, reason = "the fuzz targets see the same file as a crate of its own")]
mod targets;

/// Inputs of bytes that are often zero, small or alike, as lengths and numbers of fields are.
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
}
