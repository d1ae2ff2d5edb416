//! Grids of ROS that were recorded whole once and then by updates, as a window shows them and as a part of the recording
//! has them.

use ocu_app::Ended;
use ocu_app::cli::CutArgs;
use rcs_log::{Log, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::foxglove::Grid;
use rcs_msg::{MessageEncoding, Schema, Stamp};
use rcs_runtime::source::{LogSource, Source, Step, Task, UPDATES as UPDATES_KEY};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const GRIDS: &str = "/costmap";
const UPDATES: &str = "/costmap_updates";
const OTHERS: &str = "/others";
const START: u64 = 1_700_000_000_000_000_000;

/// Definitions, as a recorder of ROS 2 writes them.
const GRID: &str = "std_msgs/Header header\nMapMetaData info\nint8[] data\n===\n\
    MSG: nav_msgs/MapMetaData\nbuiltin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\n\
    uint32 height\ngeometry_msgs/Pose origin\n===\n\
    MSG: geometry_msgs/Pose\nPoint position\nQuaternion orientation\n===\n\
    MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n===\n\
    MSG: geometry_msgs/Quaternion\nfloat64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n";
const UPDATE: &str = "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data\n";
const HEADER: &str = "===\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n===\n\
    MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

/// Writes CDR, little-endian.
struct Cdr(Vec<u8>);

impl Cdr {
    /// A message with a header without a time, as costmaps have.
    fn new(frame_id: &str) -> Self {
        let cdr = Self(vec![0, 1, 0, 0]).words(&[0, 0, frame_id.len() as u32 + 1]);
        let mut bytes = cdr.0;
        bytes.extend(frame_id.as_bytes());
        bytes.push(0);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        Self(bytes)
    }

    fn words(mut self, words: &[u32]) -> Self {
        self.0.extend(words.iter().flat_map(|word| word.to_le_bytes()));
        self
    }

    /// The last field.
    fn cells(self, cells: &[u8]) -> Vec<u8> {
        let mut bytes = self.words(&[cells.len() as u32]).0;
        bytes.extend(cells);
        bytes
    }
}

/// A grid of four by two cells of 0.5 m, all of them with this value.
fn grid(value: u8) -> Vec<u8> {
    // After the sides an empty word, and the pose: seven doubles, the last of which is 1.
    let cdr = Cdr::new("map").words(&[0, 0, 0.5f32.to_bits(), 4, 2, 0]).words(&[0; 13]);
    cdr.words(&[0x3ff0_0000]).cells(&[value; 8])
}

/// New cells for a rectangle: the first cell, and the number of cells along x and y.
fn update(frame_id: &str, rectangle: [i32; 4], cells: &[u8]) -> Vec<u8> {
    Cdr::new(frame_id).words(&rectangle.map(|number| number as u32)).cells(cells)
}

/// A time after the start of the recording.
fn seconds(time_s: f64) -> Stamp {
    Stamp(START).after_ns((time_s * 1e9) as u64)
}

struct Recorded {
    path: PathBuf,
    _folder: tempfile::TempDir,
}

/// A recording of ROS 2 from 0 to 9 s with these messages; each has its time, s, and its topic.
fn record(messages: &[(f64, &str, Vec<u8>)]) -> Recorded {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
    let mut channels = BTreeMap::new();
    for (topic, name, definition) in [
        (OTHERS, "example/msg/Other", "int32 data\n"),
        (UPDATES, "map_msgs/msg/OccupancyGridUpdate", UPDATE),
        (GRIDS, "nav_msgs/msg/OccupancyGrid", GRID),
    ] {
        let definition = format!("{definition}{HEADER}").into_bytes();
        let schema = Schema::new(name, MessageEncoding::Cdr, "ros2msg", definition.into());
        channels.insert(topic, writer.add_channel(topic, &schema, &BTreeMap::new()).unwrap());
    }
    let mut write = |time_s: f64, topic: &str, data: &[u8]| {
        let time = seconds(time_s);
        let header = WriteHeader { sequence: 0, log_time: time, publish_time: time };
        writer.write(channels[topic], header, data).unwrap();
    };
    write(0.0, OTHERS, &[]);
    for (time_s, topic, data) in messages {
        write(*time_s, topic, data);
    }
    write(9.0, OTHERS, &[]);
    writer.finish().unwrap();
    Recorded { path, _folder: folder }
}

fn source(path: &Path) -> LogSource {
    LogSource::new(&Log::open(path).unwrap()).unwrap()
}

/// The costs of the grid that views draw at a time.
fn shown(source: &mut LogSource, time_s: f64) -> Option<Vec<u8>> {
    source.seek(seconds(time_s), &Task::default()).unwrap();
    drawn(source)
}

fn drawn(source: &mut LogSource) -> Option<Vec<u8>> {
    let frame = source.frame();
    let topic = frame.topic(GRIDS)?;
    topic.get::<Grid>().map(|grid| grid.data.to_vec())
}

/// The problems of the recording that have been found so far.
fn problems(source: &mut LogSource) -> Vec<String> {
    source.frame();
    source.info().problems.clone()
}

/// A grid at 1 s, three updates of it, and another grid at 6 s.
fn drive() -> Recorded {
    record(&[
        (1.0, GRIDS, grid(0)),
        (2.0, UPDATES, update("map", [0, 0, 2, 1], &[100, 50])),
        (3.0, UPDATES, update("map", [1, 0, 2, 2], &[0, 0xff, 20, 40])),
        (4.0, UPDATES, update("/map", [3, 1, 1, 1], &[80])),
        (6.0, GRIDS, grid(100)),
    ])
}

/// The costs that a viewer who reads the recording up to this time sees.
fn expected(time_s: f64) -> Option<Vec<u8>> {
    let after = [
        (6.0, [250; 8]),
        (4.0, [250, 0, 255, 0, 0, 50, 100, 200]),
        (3.0, [250, 0, 255, 0, 0, 50, 100, 0]),
        (2.0, [250, 125, 0, 0, 0, 0, 0, 0]),
        (1.0, [0; 8]),
    ];
    let newest = after.into_iter().find(|(message_s, _)| *message_s <= time_s);
    newest.map(|(_, costs)| costs.to_vec())
}

#[test]
fn a_grid_is_shown_with_all_updates_up_to_the_time_wherever_one_comes_from() {
    let recorded = drive();
    let mut source = source(&recorded.path);
    let names: Vec<String> = source.frame().topics.iter().map(|topic| topic.name.to_string()).collect();
    assert_eq!(names, [OTHERS, GRIDS], "updates are no topic of their own");
    let frame = source.frame();
    let grids = frame.topic(GRIDS).unwrap();
    assert_eq!((grids.messages, grids.metadata[UPDATES_KEY].as_str()), (5, "3 on /costmap_updates"));
    // On by small steps, and jumps in both directions.
    let way = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.5, 3.5, 0.5, 5.0, 2.0, 1.5, 4.0, 3.0, 0.0, 9.0, 2.5];
    for time_s in way {
        assert_eq!(shown(&mut source, time_s), expected(time_s), "at {time_s} s");
    }
    for (back, time_s) in [(false, 3.0), (false, 4.0), (true, 3.0), (true, 2.0), (true, 1.0), (false, 2.0)] {
        let step = Step::Message { topic: Some(GRIDS.to_owned()), back };
        assert!(source.step(&step, &Task::default()).unwrap());
        assert_eq!(source.now(), seconds(time_s));
        assert_eq!(drawn(&mut source), expected(time_s), "at {time_s} s");
    }
    // The time of an update is not stated, so that it is the time of its recording.
    source.seek(seconds(5.0), &Task::default()).unwrap();
    assert_eq!(source.frame().topic(GRIDS).unwrap().acq_time(), Some(seconds(4.0)));
    assert_eq!(problems(&mut source), [""; 0]);
}

#[test]
fn a_part_of_a_recording_begins_with_the_grid_as_it_was_there() {
    let recorded = drive();
    let part = recorded.path.with_file_name("part.mcap");
    let args =
        CutArgs { log: recorded.path.clone(), from: 3.5, to: None, output: part.clone(), force: false };
    assert_eq!(ocu_app::cut::cut(&args, &mut Vec::new()).unwrap(), Ended::Well);
    let mut source = source(&part);
    for time_s in [3.5, 4.0, 6.0, 3.5] {
        assert_eq!(shown(&mut source, time_s), expected(time_s), "at {time_s} s");
    }
    assert_eq!(problems(&mut source), [""; 0]);
}

#[test]
fn an_update_that_does_not_fit_is_left_out_and_told_once_and_those_after_it_apply() {
    let of_grid = "expected cells of a grid of 4 × 2";
    for (bad, why) in [
        (update("map", [3, 0, 2, 1], &[1, 1]), format!("it has 2 × 1 cells from (3, 0) on, {of_grid}")),
        (update("map", [-1, 0, 1, 1], &[1]), format!("it has 1 × 1 cells from (-1, 0) on, {of_grid}")),
        (update("map", [0, 0, 2, 2], &[1; 3]), "cells of the update: got 3, expected 4".to_owned()),
        (
            update("odom", [0, 0, 1, 1], &[1]),
            "it is in the frame \"odom\", expected \"map\" as of the grid".to_owned(),
        ),
        (vec![0, 1, 0, 0, 7], "got 1 bytes, expected 4 more at byte 4".to_owned()),
    ] {
        let good = update("map", [3, 1, 1, 1], &[100]);
        let recorded = record(&[(1.0, GRIDS, grid(0)), (2.0, UPDATES, bad), (3.0, UPDATES, good)]);
        let mut source = source(&recorded.path);
        for time_s in [2.5, 3.5, 8.0, 2.0, 1.5, 3.0] {
            let cost = if time_s < 3.0 { 0 } else { 250 };
            assert_eq!(shown(&mut source, time_s), Some(vec![0, 0, 0, 0, 0, 0, 0, cost]), "at {time_s} s");
        }
        let told = format!("{UPDATES}: update at {}: {why}; left out", seconds(2.0));
        assert_eq!(problems(&mut source), [told]);
    }
}

#[test]
fn updates_before_any_whole_grid_are_left_out_and_told_once() {
    let early = |time_s: f64| (time_s, UPDATES, update("map", [0, 0, 1, 1], &[100]));
    let recorded = record(&[early(0.5), early(1.0), early(5.0), (6.0, GRIDS, grid(0))]);
    let mut source = source(&recorded.path);
    for time_s in [0.2, 0.7, 5.5, 0.9, 6.0, 4.0, 7.0] {
        let cells = (time_s >= 6.0).then(|| vec![0; 8]);
        assert_eq!(shown(&mut source, time_s), cells, "at {time_s} s");
    }
    let told = format!("{UPDATES}: update at {}: no whole grid is before it; left out", seconds(0.5));
    assert_eq!(problems(&mut source), [told]);
}
