//! A source of costs that the program does not know: a stack lists it, and the world model fuses it.

use rcs_log::{Log, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::foxglove::Grid;
use rcs_msg::{Stamp, rcs, schema_of};
use rcs_runtime::{Plan, RunOptions, StackFile, Stepped};
use rcs_world::{GridView, Map, MapMessage, MapOptions, Source, VoteRule, Weights};
use std::collections::BTreeMap;
use std::sync::Arc;

const STACK: &str = r#"
format = 1
name = "radar"
description = "Fuses a radar with stereo"
input = [{ buffer = "/radar/cost", topic = "/radar/cost" }, { buffer = "/stereo/cost", topic = "/stereo/cost" }]

[[process]]
name = "wm1"
plugin = "world_model"
supervisor = "viewer"
inputs = { stereo = "/stereo/cost", costs = "/radar/cost" }

[process.params]
pose = { source = "POSE_FIXED" }
sources = [
    { name = "stereo" },
    { name = "radar", kind = "SOURCE_LEARNED", weight = 0.25, gain_up = 50, max_confidence = 90 },
]
"#;

/// A cost map with one cell in its middle.
fn cost_map(source: Source, cost: u8) -> Grid {
    let mut map = Map::new(0.2).unwrap();
    map.vote(map.grid().centre(), source, cost, 1, Stamp(1), VoteRule::default());
    let options = MapOptions { sources: map.sources(), heights: false, weights: Weights::default() };
    let mut grid = map.to_grid("local", Stamp(1), &options);
    // A sensor's cost map states no confidence.
    grid.fields.retain(|field| field.name.starts_with("cost"));
    grid
}

fn run(text: &str, radar: &Grid) -> Result<Stepped, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("costs.mcap");
    let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
    let channels = ["/radar/cost", "/stereo/cost"]
        .map(|topic| writer.add_channel(topic, schema_of::<Grid>(), &BTreeMap::new()).unwrap());
    for sequence in 1..=3 {
        let time = Stamp(u64::from(sequence) * 100_000_000);
        let header = WriteHeader { sequence, log_time: time, publish_time: time };
        for (channel, grid) in channels.into_iter().zip([radar, &cost_map(Source::STEREO, 40)]) {
            writer.write(channel, header, &prost_bytes(grid)).unwrap();
        }
    }
    writer.finish().unwrap();
    let file = StackFile::parse("radar", text).map_err(|error| error.to_string())?;
    let plan = Plan::new(file, rcs_plugins::all(), &[]).map_err(|error| error.to_string())?;
    let mut run =
        Stepped::new(Arc::new(plan), Some(&Log::open(&path).unwrap()), RunOptions::default()).unwrap();
    run.begin().unwrap();
    run.run_until(Stamp(1_000_000_000)).unwrap();
    Ok(run)
}

fn prost_bytes(grid: &Grid) -> bytes::Bytes {
    rcs_msg::AnyMessage::new(grid.clone()).bytes()
}

#[test]
fn a_stack_adds_a_source_without_a_change_of_the_world_model() {
    let radar = Source::new("radar").unwrap();
    let run = run(STACK, &cost_map(radar, 240)).unwrap();
    let latest = run.bus().get("/wm1/map").unwrap().latest().unwrap();
    let map = latest.message.source::<MapMessage>().unwrap();
    let centre = map.map().grid().centre();
    let said = map.map().evidence(radar, centre);
    // 0.92 of a full vote: 240 is 115 from the border of the classes, the highest cost 125.
    assert_eq!((said.cost, said.confidence), (240, 83), "its own rule of confidence");
    // Stereo has 42 after three votes: (42 · 40 + 0.25 · 83 · 240) / (42 + 0.25 · 83)
    assert_eq!(map.map().fused(centre, &map.options().weights).cost, 106);
    let view = GridView::of(&latest.message).unwrap();
    assert_eq!(view.field("cost.radar").unwrap().get(100, 100), Some(240.0));
    assert_eq!(view.field("cost").unwrap().get(100, 100), Some(106.0));
}

#[test]
fn costs_of_a_source_that_is_not_listed_are_a_fault_and_bad_lists_are_refused() {
    let sonar = Source::new("sonar").unwrap();
    let run_of_sonar = run(STACK, &cost_map(sonar, 240)).unwrap();
    let status = run_of_sonar.bus().get("/wm1/status").unwrap().latest().unwrap();
    let status: rcs::Status = status.message.to().unwrap();
    assert_eq!(status.faults, 3);
    assert!(
        status.last_fault.contains("expected a field cost.<source> of stereo, radar"),
        "{}",
        status.last_fault
    );
    let refused = |list: &str| {
        let radar = STACK.lines().find(|line| line.contains("\"radar\", kind")).unwrap();
        let text = STACK.replace(radar, list);
        run(&text, &cost_map(sonar, 240)).err().unwrap_or_default()
    };
    assert!(refused("{ name = \"stereo\" }").contains("stereo is listed twice"));
    assert!(refused("{ name = \"Radar 2\" }").contains("cannot name a source"));
    assert!(refused("{ name = \"radar\", weight = -1 }").contains("weight"));
}
