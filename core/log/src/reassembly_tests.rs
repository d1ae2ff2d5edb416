use super::*;
use crate::writer::{LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{MessageEncoding, Schema, Stamp};

/// Number of updates, one per nanosecond after the grid.
const COUNT: u64 = 40;
/// Number of cells of a grid, in one row.
const CELLS: usize = 8;

/// CDR of a message with an empty header, these numbers, and cells at its end.
fn message(numbers: &[u32], cells: &[u8]) -> Vec<u8> {
    let header: [u32; 4] = [0, 0, 1, 0];
    let mut bytes = vec![0, 1, 0, 0];
    for number in header.iter().chain(numbers) {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend((cells.len() as u32).to_le_bytes());
    bytes.extend(cells);
    bytes
}

fn grid(value: u8) -> Vec<u8> {
    // Time of loading, size of a cell, sides, padding, and a pose of seven zeros.
    let mut numbers = vec![0, 0, 0, CELLS as u32, 1, 0];
    numbers.extend([0; 14]);
    message(&numbers, &[value; CELLS])
}

/// An update of one cell.
fn update(x: u32, value: u8) -> Vec<u8> {
    message(&[x, 0, 1, 1], &[value])
}

/// A log of small chunks with these messages: times, ns, topics, publishers, and data.
fn log_of(messages: Vec<(u64, &str, &str, Vec<u8>)>) -> Log {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("grids.mcap");
    let options = WriterOptions { chunk_bytes: 2000, ..WriterOptions::default() };
    let mut writer = LogWriter::create(&path, options).unwrap();
    for (time, topic, publisher, data) in messages {
        let name = match topic {
            "/costmap" => "nav_msgs/msg/OccupancyGrid",
            "/costmap_updates" => "map_msgs/msg/OccupancyGridUpdate",
            _ => "example/msg/Other",
        };
        let schema = Schema::new(name, MessageEncoding::Cdr, "ros2idl", bytes::Bytes::new());
        let metadata = BTreeMap::from([("publisher".to_owned(), publisher.to_owned())]);
        let channel = writer.add_channel(topic, &schema, &metadata).unwrap();
        let header = WriteHeader { sequence: 0, log_time: Stamp(time), publish_time: Stamp(time) };
        writer.write(channel, header, &data).unwrap();
    }
    writer.finish().unwrap();
    Log::from_bytes(std::fs::read(&path).unwrap().into()).unwrap()
}

/// A grid at 1 ns and its updates, each of which changes one cell, with 1500 bytes of another topic beside each.
fn drive() -> Log {
    let mut messages = vec![(1, "/costmap", "a", grid(0))];
    for number in 1..=COUNT {
        let update = update(number as u32 % CELLS as u32, number as u8);
        messages.push((1 + number, "/costmap_updates", "a", update));
        messages.push((1 + number, "/others", "a", vec![0; 1500]));
    }
    log_of(messages)
}

fn reassembly(log: &Log, reach_bytes: u64) -> Reassembly {
    let mut reassembly = Reassembly::new(log);
    reassembly.streams[0].reach.as_mut().unwrap().most_bytes = reach_bytes;
    reassembly
}

fn cells(whole: &Reassembled) -> Vec<u8> {
    let bytes = whole.message.bytes();
    bytes[bytes.len() - CELLS..].to_vec()
}

/// The cells at each time, read from the start.
fn states(log: &Log, reach_bytes: u64) -> BTreeMap<u64, Vec<u8>> {
    let (mut reassembly, mut states) = (reassembly(log, reach_bytes), BTreeMap::new());
    for stored in log.cursor(CursorOptions::default()) {
        let stored = stored.unwrap();
        if let Some(whole) = reassembly.take(&stored) {
            states.insert(stored.log_time.0, cells(&whole));
        }
    }
    states
}

/// The messages after a seek.
fn seek(reassembly: &mut Reassembly, time: u64) -> Vec<Reassembled> {
    reassembly.seek(MessagePosition::after(Stamp(time))).unwrap()
}

#[test]
fn a_seek_gives_what_reading_on_gives_and_begins_at_the_nearest_grid_that_an_earlier_one_kept() {
    let log = drive();
    let states = states(&log, u64::MAX);
    assert_eq!(states.len() as u64, 1 + COUNT);
    assert_eq!(states[&(1 + COUNT)], [40_u8, 33, 34, 35, 36, 37, 38, 39]);
    // A part of this way has few updates.
    let mut reassembly = reassembly(&log, 90_000);
    for time in [41, 3, 25, 24, 10, 40, 39, 1, 26, 41] {
        let newest = seek(&mut reassembly, time);
        assert_eq!((newest.len(), newest[0].stored.log_time), (1, Stamp(time)));
        assert_eq!(cells(&newest[0]), states[&time], "at {time}");
    }
    assert!(reassembly.streams[0].kept.len() > 5);
    assert!(seek(&mut reassembly, 0).is_empty());
    assert_eq!(log.problems(), [""; 0]);
}

#[test]
fn updates_too_far_behind_their_grid_are_left_out_and_told_once_on_every_way() {
    let log = drive();
    let (all, near) = (states(&log, u64::MAX), states(&log, 30_000));
    let last = *near.keys().last().unwrap();
    assert!((5..35).contains(&last), "{last}");
    assert!(near.iter().all(|(time, cells)| all[time] == *cells));
    for first in [41, last, last + 1, 30, 2, 40, last - 1] {
        let mut reassembly = reassembly(&log, 30_000);
        for time in [first, 41, first] {
            let newest = seek(&mut reassembly, time);
            assert_eq!(cells(&newest[0]), near[&time.min(last)], "at {time}");
        }
    }
    let problems = log.problems();
    assert_eq!(problems.len(), 1, "{problems:?}");
    let told = "/costmap_updates: update at 0.000 s: updates since the whole grid lie in 1 MiB of the recording, \
                expected at most 1 MiB; left out, like those up to the next whole grid";
    assert_eq!(problems[0], told);
}

#[test]
fn an_update_belongs_to_the_last_grid_of_its_topic_whichever_channel_has_it() {
    // A node that is started again.
    let log = log_of(vec![
        (1, "/costmap", "a", grid(1)),
        (2, "/costmap_updates", "a", update(0, 10)),
        (3, "/costmap", "b", grid(2)),
        (4, "/costmap_updates", "b", update(1, 20)),
        (5, "/costmap_updates", "a", update(2, 30)),
    ]);
    let states = states(&log, u64::MAX);
    assert_eq!(states[&2], [10_u8, 1, 1, 1, 1, 1, 1, 1]);
    assert_eq!(states[&5], [2_u8, 20, 30, 2, 2, 2, 2, 2]);
    let mut reassembly = reassembly(&log, u64::MAX);
    for time in [5, 4, 2, 3, 1] {
        let newest = seek(&mut reassembly, time);
        assert_eq!(cells(&newest[0]), states[&time], "at {time}");
        let name = |id| log.info().topic(id).unwrap().metadata["publisher"].as_str();
        assert_eq!(name(newest[0].topic), if time < 3 { "a" } else { "b" });
    }
    let ids = |name: &str| log.info().topics_named(name).map(|topic| topic.id).collect::<Vec<_>>();
    let (grids, updates) = (ids("/costmap"), ids("/costmap_updates"));
    assert_eq!((reassembly.deltas_of(grids[0]), reassembly.deltas_of(grids[1])), (&updates[..], &[][..]));
    assert_eq!((reassembly.keys_of(updates[1]), reassembly.keys_of(grids[0])), (Some(grids[0]), None));
}

#[test]
fn what_lies_between_two_positions_is_the_sum_of_the_segments_with_messages_there() {
    let log = drive();
    let updates: Vec<TopicId> = log.info().topics_named("/costmap_updates").map(|topic| topic.id).collect();
    let contents = log.contents_of(&updates);
    let at = |time: u64| MessagePosition::before(Stamp(time));
    let reference = |from: u64, to: u64| {
        let held = |channels: &[u16]| updates.iter().any(|id| channels.contains(&id.0));
        let segments = log.0.segments.iter().filter(|segment| {
            let is_held = segment.channels.as_ref().is_none_or(|channels| held(channels));
            is_held && segment.first <= to && segment.last >= from
        });
        segments.map(|segment| segment.contents).sum::<u64>()
    };
    for from in (0..=COUNT + 2).step_by(3) {
        for to in (from..=COUNT + 2).step_by(5) {
            assert_eq!(contents.between(at(from), at(to)), reference(from, to), "{from} to {to}");
        }
    }
    assert!(reference(0, COUNT + 2) > reference(0, 1));
}
