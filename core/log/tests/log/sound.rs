//! Sound logs of other programs.

use crate::common::{logs_under, plain, read_all};
use rcs_log::{CursorOptions, Log, Lost};
use rcs_msg::MessageEncoding;
use std::path::Path;

/// A sound log is the same whether it is opened by index or by a scan.
fn check_same_both_ways(path: &Path) -> Log {
    let name = path.display();
    let indexed = Log::open(path).unwrap();
    let scanned = Log::open_by_scan(path).unwrap();
    let (a, b) = (indexed.info(), scanned.info());
    assert!(b.recovered, "{name}");
    assert_eq!(a.lost, Lost::default(), "{name}: {:?}", a.problems);
    assert_eq!(b.lost, Lost::default(), "{name}: {:?}", b.problems);
    assert_eq!((a.messages, a.start, a.end), (b.messages, b.start, b.end), "{name}");
    let counts = |info: &rcs_log::LogInfo| -> Vec<(u16, String, u64)> {
        info.topics.iter().map(|topic| (topic.id.0, topic.name.clone(), topic.messages)).collect()
    };
    assert_eq!(counts(a), counts(b), "{name}");
    assert_eq!(indexed.metadata(), scanned.metadata(), "{name}");
    assert_eq!(indexed.attachments(), scanned.attachments(), "{name}");
    let messages = read_all(&indexed);
    assert_eq!(messages.len() as u64, a.messages, "{name}");
    assert!(messages.is_sorted_by_key(|message| message.place), "{name}");
    assert!(messages.is_sorted_by_key(|message| message.log_time), "{name}");
    assert_eq!(plain(messages), plain(read_all(&scanned)), "{name}");
    assert_eq!(indexed.lost(), Lost::default(), "{name}");
    indexed
}

#[test]
fn every_sound_log_is_the_same_by_index_and_by_scan() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    for folder in ["real-logs", "ros2-typed-mcap", "rosbag2-mcap"] {
        for path in logs_under(&data.join(folder)) {
            let log = check_same_both_ways(&path);
            assert!(!log.info().recovered, "{}: {:?}", path.display(), log.info().problems);
        }
    }
    for name in ["compressed.mcap", "uncompressed.mcap", "zstd_chunk_with_padding.mcap"] {
        check_same_both_ways(&data.join("mcap-crate-drive").join(name));
    }
}

#[test]
fn real_logs_hold_what_their_authors_say() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let check = |name: &str, messages: u64, duration_s: f64| {
        let log = Log::open(data.join(name)).unwrap();
        let info = log.info();
        assert_eq!(info.messages, messages, "{name}");
        assert!((info.duration_s() - duration_s).abs() < 1.0, "{name}: {}", info.duration_s());
        assert!(info.topics.iter().all(|topic| topic.decodable), "{name}");
        log
    };
    let husky = check("real-logs/husky_outdoor_ros2.mcap", 16_806, 395.0);
    check("real-logs/orfd_y0613_1242_ros2.mcap", 18, 0.9);
    check("real-logs/monoforce_tradr_ros2.mcap", 65, 89.0);
    let imu = husky.info().topics.iter().find(|topic| topic.schema.name() == "sensor_msgs/msg/Imu").unwrap();
    assert!((imu.hz - 30.0).abs() < 1.0, "{}", imu.hz);
    let drive = Log::open(data.join("mcap-crate-drive/compressed.mcap")).unwrap();
    assert_eq!(drive.info().segments, 413);
    assert_eq!(drive.info().messages, 826);
    let padded = Log::open(data.join("mcap-crate-drive/zstd_chunk_with_padding.mcap")).unwrap();
    assert_eq!(padded.info().messages, 12);
    assert_eq!(
        padded.info().topics[0].name,
        "undefined channel 0",
        "the log does not say what its messages are"
    );
    assert!(!padded.info().topics[0].decodable);
    let typed = Log::open(data.join("ros2-typed-mcap/test_bag_mcap.mcap")).unwrap();
    assert_eq!(typed.info().messages, 2 * typed.info().topics.len() as u64);
}

#[test]
fn a_bag_with_the_wrong_serialization_lists_its_topics_as_undecodable() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let path = data.join("rosbag2-mcap/rosbag2_tests/resources/mcap/wrong_rmw_test/wrong_rmw_test_0.mcap");
    let log = Log::open(path).unwrap();
    assert!(!log.info().topics.is_empty());
    for topic in &log.info().topics {
        let MessageEncoding::Other(encoding) = topic.schema.message_encoding() else { continue };
        assert!(!topic.decodable);
        assert!(topic.undecodable_because.as_ref().unwrap().contains(encoding.as_str()));
    }
    assert!(log.info().topics.iter().any(|topic| !topic.decodable));
}

#[test]
fn a_file_that_was_never_written_beyond_its_first_chunk_header_opens_empty() {
    let Some(data) = rcs_testkit::data_dir() else { return };
    let log = Log::open(data.join("mcap-crate-drive/chunk_not_closed.mcap")).unwrap();
    assert!(log.info().recovered);
    assert_eq!(log.info().messages, 0);
    assert!(
        log.info().problems.iter().any(|problem| problem.contains("never closed")),
        "{:?}",
        log.info().problems
    );
    assert_eq!(log.cursor(CursorOptions::default()).count(), 0);
}
