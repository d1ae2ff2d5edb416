//! A frame with two runs of a drive that differ since a parameter was changed.

use super::{NOW, driving, grid, topic, track, with_metadata};
use rcs_msg::Stamp;
use rcs_msg::foxglove::Grid;
use rcs_runtime::source::{Compared, Comparison, Frame, RunTag, Runs, Topic};
use rcs_runtime::{Difference, Moment, RunId, RunSummary};
use std::sync::Arc;

/// What [`compared`] compares.
pub(crate) const SIDES: [Compared; 2] = [Compared::Run(RunId(0)), Compared::Run(RunId(1))];

fn before(ms: u64) -> Stamp {
    Stamp(NOW.0 - ms * 1_000_000)
}

fn difference(ms: u64, buffer: &str, field: &str, values: [&str; 2]) -> Difference {
    Difference {
        time: before(ms),
        time_s: 12.5 - ms as f64 * 1e-3,
        buffer: buffer.into(),
        sequence: 7,
        field: field.into(),
        detail: format!("{} in the first, {} in the second", values[0], values[1]),
        values: values.map(str::to_owned),
    }
}

/// The map of the drive, with other costs where `differs` holds, by column and row.
fn map(differs: impl Fn(usize, usize) -> Option<u8>) -> Grid {
    let mut map = grid(40, 40);
    let mut data = map.data.to_vec();
    let (row_stride, cell_stride) = (map.row_stride as usize, map.cell_stride as usize);
    for (column, row) in (0..40).flat_map(|row| (0..40).map(move |column| (column, row))) {
        if let Some(cost) = differs(column, row) {
            data[row * row_stride + column * cell_stride] = cost;
        }
    }
    map.data = data.into();
    map
}

/// The second run, with the first beside it, and six buffers that differ.
pub(crate) fn compared() -> Frame {
    let base = driving();
    let run = |id: u32, map: Grid| {
        let map = with_metadata(topic("/wm1/map", 5.0, 0.2, map), "wm1", &[("rcs.role", "map")]);
        let topics = base.topics.iter().filter(|topic| &*topic.name != "/wm1/map").cloned();
        let topics = topics.chain([map]).map(|mut topic: Topic| {
            topic.run = RunTag::Run(RunId(id));
            topic
        });
        let moment = Moment { run: RunId(id), event: 100, write: 0 };
        let summary = |id: u32| RunSummary {
            id: RunId(id),
            branched_from: (id == 1).then_some((Moment::default(), before(3000))),
            end: NOW,
            events: 100,
            writes: 0,
        };
        let runs = Runs { all: [summary(0), summary(1)].into(), moment, is_at_end: true, filling: None };
        let tracks = [0, 1].map(|id: u32| {
            let turned = track("/localization/local", "local", 0.12 * f64::from(id));
            rcs_runtime::source::Track { run: RunTag::Run(RunId(id)), ..turned }
        });
        Frame { topics: topics.collect(), runs, tracks: tracks.into(), ..base.clone() }
    };
    let is_tree = |column: usize, row: usize| (22..27).contains(&column) && (8..15).contains(&row);
    let first = run(0, map(|column, row| is_tree(column, row).then_some(30)));
    let second = run(1, map(|column, row| ((4..9).contains(&column) && row > 25).then_some(5)));
    let differences = [
        difference(3000, "/wm1/params", "message", ["", "a message"]),
        difference(2800, "/wm1/map", ".data", ["bytes", "bytes"]),
        difference(2600, "/planner/plan", ".chosen.cost", ["12.251", "14.5"]),
        difference(2550, "/follower/arcs", ".chosen", ["3", "4"]),
        difference(2500, "/vehicle_interface/vehicle", ".steering_rad", ["0.12", "0.085"]),
        difference(2480, "/localization/local", ".pose.position.y", ["1.30012", "1.30047"]),
    ];
    let comparison = Comparison {
        sides: SIDES,
        differences: Arc::new(differences),
        until: Some(NOW),
        progress: None,
        recording_ends: [None; 2],
        left_out: [0, 0],
        gaps: Arc::new([]),
        problem: None,
    };
    Frame {
        beside: Arc::new([Arc::new(Frame { is_beside: true, ..first })]),
        comparisons: Arc::new([comparison]),
        ..second
    }
}
