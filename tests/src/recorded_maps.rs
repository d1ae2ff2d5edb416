//! Maps recorded as key frames and deltas, as every kind of reader gets them.

use ocu_app::Ended;
use ocu_app::cli::{CutArgs, DiffArgs, ExportArgs};
use proptest::prelude::*;
use rcs_geom::DVec2;
use rcs_log::{CursorOptions, Log, LogWriter, Recorder, RecorderOptions, WriteHeader, WriterOptions};
use rcs_msg::foxglove::Grid;
use rcs_msg::{DELTA_OF, DeltaCodec, Stamp, Stored, schema_of};
use rcs_runtime::source::{LogSource, Source, Step, Task};
use rcs_runtime::{Plan, RunOptions, StackFile, Stepped};
use rcs_world::{MAP_CODEC, Map, MapMessage, MapOptions, VoteRule, Weights};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const TOPIC: &str = "/wm1/map";
const START: u64 = 1_700_000_000_000_000_000;
const PERIOD_NS: u64 = 200_000_000;
/// 25 s of maps: three key frames.
const COUNT: u32 = 125;

fn time_of(sequence: u32) -> Stamp {
    Stamp(START + u64::from(sequence) * PERIOD_NS)
}

/// A drive along a line with votes around the vehicle; sequence numbers begin with 1.
fn drive() -> Vec<MapMessage> {
    let mut map = Map::new(0.2).unwrap();
    let mut maps = Vec::new();
    for sequence in 1..=COUNT {
        let at = DVec2::new(f64::from(sequence) * 0.17, f64::from(sequence) * -0.06);
        map.recentre(at).unwrap();
        for i in 0..40_u32 {
            let offset = DVec2::new(f64::from(i * 7 % 23) * 0.2, f64::from(i * 5 % 17) * 0.2);
            let cell = map.grid().cell_at(at + offset).unwrap();
            let cost = ((i * 31 + sequence * 3) % 251) as u8;
            map.vote(cell, rcs_world::Source::STEREO, cost, sequence, time_of(sequence), VoteRule::default());
        }
        let sources = [rcs_world::Source::STEREO].into_iter().collect();
        let options = MapOptions { sources, heights: true, weights: Weights::default() };
        maps.push(MapMessage::new(map.clone(), "local", time_of(sequence), options));
    }
    maps
}

/// Records maps as a run does, or each as a complete message.
fn record(path: &Path, maps: &[MapMessage], codec: Option<&'static dyn DeltaCodec>) {
    let writer = LogWriter::create(path, WriterOptions::default()).unwrap();
    let recorder = Recorder::start(writer, RecorderOptions::default()).unwrap();
    let handle = recorder.handle();
    let channel = handle.add_channel_with(TOPIC, schema_of::<Grid>(), BTreeMap::new(), codec).unwrap();
    for (sequence, map) in (1..).zip(maps) {
        assert!(handle.write_message(channel, header(sequence), map.clone().into_message()));
    }
    recorder.finish().unwrap();
}

fn header(sequence: u32) -> WriteHeader {
    WriteHeader { sequence, log_time: time_of(sequence), publish_time: time_of(sequence) }
}

struct Recorded {
    maps: Vec<MapMessage>,
    path: PathBuf,
    _folder: tempfile::TempDir,
}

fn recorded() -> Recorded {
    let (maps, folder) = (drive(), tempfile::tempdir().unwrap());
    let path = folder.path().join("maps.mcap");
    record(&path, &maps, Some(&MAP_CODEC));
    Recorded { maps, path, _folder: folder }
}

fn open(path: &Path) -> Log {
    Log::open(path).unwrap().with_codecs(rcs_runtime::codecs(rcs_plugins::all()))
}

/// The sequence of the map that a source shows at its current time; its bytes have been compared.
fn shown(source: &mut LogSource, maps: &[MapMessage]) -> Option<u32> {
    let frame = source.frame();
    let sample = frame.topic(TOPIC)?.latest.clone()?;
    let sequence = sample.header.sequence as u32;
    let expected = &maps[sequence as usize - 1];
    assert!(sample.message.bytes() == expected.clone().into_message().bytes(), "map {sequence}");
    if let Some(map) = sample.message.source::<MapMessage>() {
        assert!(map == expected, "map {sequence}, read typed");
    }
    assert_eq!(sample.header.log_time, time_of(sequence));
    Some(sequence)
}

/// The newest map up to this one whose key frame and all deltas since are in a log, from the stored messages. The base
/// of each delta is the map before it.
fn newest_left(path: &Path, to: u32) -> Option<u32> {
    let log = Log::open(path).unwrap();
    let mut newest: Option<u32> = None;
    for message in log.cursor(CursorOptions { end: time_of(to), ..CursorOptions::default() }) {
        let message = message.unwrap();
        let is_whole = log.info().topic(message.topic).unwrap().name == TOPIC;
        if is_whole || newest.is_some_and(|base| base + 1 == message.sequence) {
            newest = Some(message.sequence);
        }
    }
    newest
}

#[test]
fn a_log_shows_every_map_as_it_was_wherever_one_goes_in_it() {
    let Recorded { maps, path, _folder } = recorded();
    let mut source = LogSource::new(&open(&path)).unwrap();
    let names: Vec<String> = source.frame().topics.iter().map(|topic| topic.name.to_string()).collect();
    assert_eq!(names, [TOPIC], "deltas are no topic of their own");
    assert_eq!(source.frame().topic(TOPIC).unwrap().messages, u64::from(COUNT));
    // Forward by small steps, and jumps in both directions.
    let way = [1, 2, 3, 4, 20, 21, 90, 91, 10, 125, 50, 49, 51, 52, 100, 1];
    for sequence in way {
        source.seek(time_of(sequence), &Task::default()).unwrap();
        assert_eq!(shown(&mut source, &maps), Some(sequence));
    }
    source.seek(time_of(30), &Task::default()).unwrap();
    for (back, expected) in [(false, 31), (false, 32), (true, 31), (true, 30), (true, 29)] {
        let step = Step::Message { topic: Some(TOPIC.to_owned()), back };
        assert!(source.step(&step, &Task::default()).unwrap());
        assert_eq!(shown(&mut source, &maps), Some(expected));
    }
}

#[test]
fn key_frames_are_plain_grids_for_readers_who_know_no_deltas() {
    let Recorded { maps, path, _folder } = recorded();
    let log = Log::open(&path).unwrap();
    let topic = |name: &str| log.info().topics_named(name).next().unwrap().clone();
    let (keys, deltas) = (topic(TOPIC), topic("/wm1/map/delta"));
    assert_eq!((keys.schema.name(), keys.messages), ("foxglove.Grid", 3));
    assert_eq!((deltas.schema.name(), deltas.messages), ("rcs.MapDelta", u64::from(COUNT) - 3));
    assert_eq!(deltas.metadata.get(DELTA_OF).map(String::as_str), Some(TOPIC));
    let mut source = LogSource::new(&log).unwrap();
    source.seek(time_of(70), &Task::default()).unwrap();
    assert_eq!(shown(&mut source, &maps), Some(51));
}

#[test]
fn deltas_without_their_key_frame_are_skipped_and_told_and_never_a_wrong_map() {
    let (maps, folder) = (drive(), tempfile::tempdir().unwrap());
    let path = folder.path().join("gaps.mcap");
    let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
    let keys = writer.add_channel(TOPIC, schema_of::<Grid>(), &BTreeMap::new()).unwrap();
    let metadata = BTreeMap::from([(DELTA_OF.to_owned(), TOPIC.to_owned())]);
    let deltas = writer.add_channel("/wm1/map/delta", &MAP_CODEC.delta_schema(), &metadata).unwrap();
    let mut encoder = MAP_CODEC.encoder();
    // The second key frame, map 51, and the delta to map 20 are missing.
    for (sequence, map) in (1..).zip(&maps) {
        let message = map.clone().into_message();
        match encoder.encode(sequence, time_of(sequence), &message) {
            _ if [20, 51].contains(&sequence) => {}
            Stored::Whole => writer.write(keys, header(sequence), &message.bytes()).unwrap(),
            Stored::Delta(delta) => writer.write(deltas, header(sequence), &delta).unwrap(),
        }
    }
    writer.finish().unwrap();
    let mut source = LogSource::new(&open(&path)).unwrap();
    assert!(source.info().problems.is_empty());
    for (to, expected) in
        [(19, 19), (21, 19), (50, 19), (60, 19), (100, 19), (101, 101), (102, 102), (10, 10)]
    {
        source.seek(time_of(to), &Task::default()).unwrap();
        assert_eq!(shown(&mut source, &maps), Some(expected), "at map {to}");
    }
    source.frame();
    let problems = source.info().problems.join("\n");
    assert!(problems.contains("/wm1/map: map delta 21 follows map 20"), "{problems}");
    assert!(problems.contains("skipped up to the next key frame"), "{problems}");
}

#[test]
fn a_part_that_is_cut_from_a_recording_shows_the_same_maps() {
    let Recorded { maps, path, _folder } = recorded();
    // From map 30 on, whose base is a delta, and a part of that part.
    let (part, smaller) = (path.with_file_name("part.mcap"), path.with_file_name("smaller.mcap"));
    for (log, output, from) in [(&path, &part, 5.8), (&part, &smaller, 1.0)] {
        let args = CutArgs { log: log.clone(), from, to: None, output: output.clone(), force: false };
        assert_eq!(ocu_app::cut::cut(&args, &mut Vec::new()).unwrap(), Ended::Well);
    }
    for (path, first) in [(&part, 30), (&smaller, 35)] {
        let mut source = LogSource::new(&open(path)).unwrap();
        for sequence in [first, first + 1, 50, 51, 60, COUNT, 40] {
            source.seek(time_of(sequence), &Task::default()).unwrap();
            assert_eq!(shown(&mut source, &maps), Some(sequence));
        }
        source.frame();
        assert_eq!(source.info().problems.join("\n"), "");
    }
}

#[test]
fn a_field_is_exported_from_every_map_of_a_range_between_key_frames() {
    let Recorded { path, _folder, .. } = recorded();
    // Maps 30 to 40; the key frames are maps 1, 51 and 101.
    let args = ExportArgs {
        fields: vec![format!("{TOPIC}.pose.position.x")],
        from: 5.8,
        to: Some(7.8),
        output: path.with_file_name("x.csv"),
        force: false,
        log: path,
    };
    let mut out = Vec::new();
    let ended = ocu_app::export::export(&args, &mut out).unwrap();
    let text = String::from_utf8(out).unwrap();
    assert_eq!((ended, text.trim_end()), (Ended::Well, "/wm1/map.pose.position.x: 11 values"));
}

#[test]
fn recordings_agree_whether_their_maps_were_recorded_whole_or_as_deltas() {
    let Recorded { maps, path, _folder } = recorded();
    let whole = path.with_file_name("whole.mcap");
    record(&whole, &maps, None);
    let args = DiffArgs { first: path, second: whole, all: false, json: false };
    assert_eq!(ocu_app::diff::diff(&args, &mut Vec::new()).unwrap(), Ended::Well);
}

const STACK: &str = r#"
format = 1
name = "fed"
description = "A world model that takes a recorded map for the costs of stereo"
input = [{ buffer = "/log/map", topic = "/wm1/map" }]

[[process]]
name = "wm2"
plugin = "world_model"
supervisor = "viewer"
inputs = { stereo = "/log/map" }
params = { pose = { source = "POSE_FIXED" } }
"#;

fn fed(path: &Path) -> Stepped {
    let file = StackFile::parse("fed", STACK).unwrap_or_else(|error| panic!("{error}"));
    let plan = Plan::new(file, rcs_plugins::all(), &[]).unwrap_or_else(|error| panic!("{error}"));
    let mut run = Stepped::new(Arc::new(plan), Some(&open(path)), RunOptions::default()).unwrap();
    run.begin().unwrap();
    run
}

#[test]
fn a_stack_on_a_log_reads_the_same_maps_whether_they_were_recorded_whole_or_as_deltas() {
    let Recorded { maps, path, _folder } = recorded();
    let whole = path.with_file_name("whole.mcap");
    record(&whole, &maps, None);
    let [mut whole, mut deltas] = [fed(&whole), fed(&path)];
    for until in [30, 80, 124] {
        for run in [&mut whole, &mut deltas] {
            run.run_until(time_of(until)).unwrap();
        }
        let newest = |run: &Stepped, buffer: &str| run.bus().get(buffer).unwrap().latest().unwrap();
        for buffer in ["/log/map", "/wm2/map", "/wm2/stats"] {
            let (a, b) = (newest(&whole, buffer), newest(&deltas, buffer));
            assert_eq!(a.header, b.header, "{buffer}");
            assert!(a.message.bytes() == b.message.bytes(), "{buffer}");
        }
    }
    // After going back in the log, the rest is the same.
    let snapshot = deltas.snapshot();
    deltas.run_until(time_of(125)).unwrap();
    let end = deltas.bus().get("/wm2/map").unwrap().latest().unwrap().message.bytes();
    deltas.restore(&snapshot).unwrap();
    deltas.run_until(time_of(125)).unwrap();
    assert!(deltas.bus().get("/wm2/map").unwrap().latest().unwrap().message.bytes() == end);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]
    #[test]
    fn a_log_that_is_cut_anywhere_shows_the_maps_that_are_left(cut in 0.05..1.0_f64, to in 1..=COUNT) {
        let Recorded { maps, path, _folder } = recorded();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..(bytes.len() as f64 * cut) as usize]).unwrap();
        let newest = LogSource::new(&open(&path)).ok().and_then(|mut source| {
            source.seek(time_of(to), &Task::default()).unwrap();
            shown(&mut source, &maps)
        });
        prop_assert_eq!(newest, newest_left(&path, to));
    }
}
