//! Looking back at what a run has kept: within its memory, complete, and the same whichever way a moment is reached.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{PAIR, TIGHT_BYTES, content, plan, seconds, tight};
use rcs_formula::FieldRef;
use rcs_msg::{AnyMessage, Stamp, foxglove};
use rcs_runtime::source::{LogSource, RunTag, Source, StackSource, Step, Task, finish_idle};
use rcs_runtime::{
    Cycle, NoCommands, Out, PastOptions, Plan, PortBuilder, Process, ProcessDef, ProcessType, RecordOptions,
    Role, RunId, RunOptions, StackFile,
};
use rcs_testkit::proto::CounterParams;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The time at which the surveyor sends its transform.
const TOLD: Stamp = Stamp(50_000_000_000);
const IMAGE: &str = "/surveyor/image";
const PARAMS: &str = "/surveyor/params";
/// The wheels, whose places are sent one by one: that of the first at 1 s, that of the second at 2 s.
const WHEELS: [&str; 2] = ["left", "right"];
/// The parameter that the surveyor refuses while it is strict.
const ODD_HZ: f64 = 13.0;
static IS_STRICT: AtomicBool = AtomicBool::new(false);

/// Sends an image of noise ten times a second, and each transform once.
#[derive(Clone, Serialize, Deserialize)]
struct Surveyor {
    has_told: bool,
    /// Number of wheels whose places were sent.
    wheels: usize,
}

fn transform(parent: &str, child: &str, now: Stamp) -> foxglove::FrameTransforms {
    let transform = foxglove::FrameTransform {
        timestamp: Some(now.to_proto()),
        parent_frame_id: parent.into(),
        child_frame_id: child.into(),
        translation: Some(foxglove::Vector3 { x: 1.0, y: 2.0, z: 3.0 }),
        rotation: Some(foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
    };
    foxglove::FrameTransforms { transforms: vec![transform] }
}

impl Process for Surveyor {
    type Params = CounterParams;
    type Ports = (Out<foxglove::FrameTransforms>, Out<foxglove::FrameTransforms>, Out<foxglove::RawImage>);
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "surveyor",
        summary: "Surveys.",
        period_ms: 100.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        let transforms = b.output("transforms", "Where the mast is.").build();
        let fixed = b.output("fixed", "Where the wheels are.").role(Role::StaticTransforms).build();
        (transforms, fixed, b.output("image", "Noise.").build())
    }

    fn check(params: &Self::Params) -> Result<(), String> {
        let is_refused = params.publish_hz == ODD_HZ && IS_STRICT.load(Ordering::Relaxed);
        if is_refused { Err("publish_hz: it is odd".to_owned()) } else { Ok(()) }
    }

    fn new(_params: &Self::Params) -> Self {
        Self { has_told: false, wheels: 0 }
    }

    fn cycle(
        &mut self,
        (transforms, fixed, image): &Self::Ports,
        _params: &Self::Params,
        cx: &mut Cycle<'_>,
    ) {
        use rand_core::RngCore as _;
        cx.exec("surveying");
        if !self.has_told && cx.now() >= TOLD {
            self.has_told = true;
            cx.write(transforms, cx.now(), transform("map", "mast", cx.now()));
        }
        if let Some(wheel) = WHEELS.get(self.wheels)
            && cx.now() >= seconds(self.wheels as f64 + 1.0)
        {
            self.wheels += 1;
            cx.write(fixed, cx.now(), transform("rover", wheel, cx.now()));
        }
        let mut data = vec![0; 60 * 60];
        cx.rng().fill_bytes(&mut data);
        let message =
            foxglove::RawImage { width: 60, height: 60, data: data.into(), ..foxglove::RawImage::default() };
        cx.write(image, cx.now(), message);
    }
}

const SURVEY: &str = "
format = 1
name = \"survey\"
[[process]]
name = \"surveyor\"
plugin = \"surveyor\"
supervisor = \"viewer\"
";

fn survey(past: PastOptions) -> StackSource {
    let file = StackFile::parse("survey.toml", SURVEY).unwrap();
    let plan = Arc::new(Plan::new(file, &[ProcessType::of::<Surveyor>()], &[]).unwrap());
    let options = RunOptions { seed: 3, past, ..RunOptions::default() };
    StackSource::new(plan, None, options).unwrap()
}

fn params(publish_hz: f64) -> AnyMessage {
    AnyMessage::new(CounterParams { publish_hz, ..rcs_msg::params::default() })
}

fn field(topic: &str, path: &str) -> FieldRef {
    FieldRef { topic: topic.to_owned(), path: path.parse().unwrap() }
}

/// Overwrites everything that is on disk.
fn damage(folder: &Path) {
    for entry in std::fs::read_dir(folder).unwrap().flatten().filter(|entry| entry.path().is_dir()) {
        for file in std::fs::read_dir(entry.path()).unwrap().flatten() {
            let length = file.metadata().unwrap().len() as usize;
            std::fs::write(file.path(), vec![0xa5; length]).unwrap();
        }
    }
}

#[test]
fn looking_through_the_whole_past_and_plotting_it_keep_the_limit_of_memory() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = survey(tight(folder.path(), 1 << 30));
    let task = Task::default();
    source.seek(seconds(120.0), &task).unwrap();
    for second in 0..120 {
        source.seek(seconds(f64::from(second)), &task).unwrap();
        source.frame();
        let usage = source.session().past_use();
        assert!(usage.memory_bytes <= TIGHT_BYTES, "{usage:?} at {second} s");
    }
    let height = field(IMAGE, "height");
    source.gather(std::slice::from_ref(&height), &|| false);
    let usage = source.session().past_use();
    assert!(usage.memory_bytes <= TIGHT_BYTES, "{usage:?}");
    let points = source.frame().field(&height, RunTag::FIRST).unwrap().points.len();
    assert!(points > 1100, "{points} points");
}

#[test]
fn a_jump_forward_in_the_past_finds_the_transforms_that_a_jump_back_finds() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = survey(tight(folder.path(), 1 << 30));
    source.seek(seconds(120.0), &Task::default()).unwrap();
    let mut told_at = |to_s: f64| {
        source.seek(seconds(to_s), &Task::default()).unwrap();
        finish_idle(&mut source);
        source.frame().transforms.newest("map", "mast").ok().flatten()
    };
    assert_eq!(told_at(100.0), Some(TOLD.0));
    assert_eq!(told_at(10.0), None);
    assert_eq!(told_at(100.0), Some(TOLD.0));
}

#[test]
fn a_jump_forward_keeps_the_fixed_transforms_that_were_known_before_it() {
    for disk_bytes in [1 << 30, 0] {
        let folder = tempfile::tempdir().unwrap();
        let mut source = survey(tight(folder.path(), disk_bytes));
        source.seek(seconds(120.0), &Task::default()).unwrap();
        // What is not on disk is computed again.
        for to_s in [0.5, 0.9, 1.3, 1.7, 2.1, 2.5, 2.9, 100.0] {
            source.seek(seconds(to_s), &Task::default()).unwrap();
            source.frame();
            finish_idle(&mut source);
        }
        let transforms = source.frame().transforms;
        for wheel in WHEELS {
            let found = transforms.lookup("rover", wheel, seconds(100.0).0);
            assert!(found.is_ok(), "{wheel}, with {disk_bytes} bytes of disk: {found:?}");
        }
    }
}

#[test]
fn a_recording_from_the_middle_of_a_run_has_the_fixed_transform_of_every_frame() {
    for disk_bytes in [None, Some(1 << 30)] {
        let folder = tempfile::tempdir().unwrap();
        let past = disk_bytes.map_or_else(PastOptions::default, |bytes| tight(folder.path(), bytes));
        let mut source = survey(past);
        let path = folder.path().join("survey.mcap");
        source.seek(seconds(30.0), &Task::default()).unwrap();
        source.record(&path, &RecordOptions { lossless: true, ..RecordOptions::default() }).unwrap();
        source.seek(seconds(31.0), &Task::default()).unwrap();
        source.stop_recording();
        let mut recorded = LogSource::open(&path).unwrap();
        finish_idle(&mut recorded);
        let transforms = recorded.frame().transforms;
        for wheel in WHEELS {
            let found = transforms.lookup("rover", wheel, seconds(30.0).0);
            assert!(found.is_ok(), "{wheel}, with {disk_bytes:?} bytes of disk: {found:?}");
        }
    }
}

#[test]
fn fields_of_several_runs_are_read_from_disk_together_and_are_those_of_a_run_that_is_followed() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = survey(tight(folder.path(), 1 << 30));
    let mut followed = survey(PastOptions::default());
    let fields = [
        field(IMAGE, "height"),
        field(IMAGE, "width"),
        field("/surveyor/status", "cycle"),
        field(PARAMS, "publish_hz"),
    ];
    followed.gather(&fields, &|| false);
    let task = Task::default();
    for source in [&mut source, &mut followed] {
        source.seek(seconds(60.0), &task).unwrap();
        source.seek(seconds(30.5), &task).unwrap();
        source.write(PARAMS, params(7.0)).unwrap();
        source.seek(seconds(60.0), &task).unwrap();
    }
    // Interrupted in the middle, nothing is gathered.
    let asked = std::cell::Cell::new(0);
    let after_a_hundred = || asked.replace(asked.get() + 1) == 100;
    assert!(!source.gather(&fields, &after_a_hundred));
    assert!(fields.iter().all(|field| source.frame().field(field, RunTag::Run(RunId(0))).is_none()));
    let before = source.session().past_use().reads;
    assert!(source.gather(&fields, &|| false));
    let usage = source.session().past_use();
    let reads = usage.reads - before;
    assert!(reads > 50 && reads <= usage.stretches as u64, "{reads} reads: {usage:?}");
    let (gathered, followed) = (source.frame(), followed.frame());
    for (field, run) in fields.iter().flat_map(|field| [(field, 0), (field, 1)]) {
        let run = RunTag::Run(RunId(run));
        let [found, expected] = [&gathered, &followed].map(|frame| frame.field(field, run).unwrap());
        assert_eq!(found.problem, None, "{field:?} of {run:?}");
        assert!(!found.points.is_empty(), "{field:?} of {run:?}");
        assert_eq!(found.points.sample(10_000), expected.points.sample(10_000), "{field:?} of {run:?}");
    }
}

#[test]
fn all_states_of_an_enum_are_known_before_a_run_has_had_them() {
    let mut source = survey(PastOptions::default());
    let state = field("/surveyor/status", "state");
    source.gather(std::slice::from_ref(&state), &|| false);
    let frame = source.frame();
    let states = &frame.field(&state, RunTag::FIRST).unwrap().states;
    assert_eq!(states[..], ["UNINITIALIZED", "EXEC", "DONE", "ERROR"]);
}

#[test]
fn what_a_run_writes_before_its_first_event_is_plotted_and_can_be_gone_back_to() {
    let mut source = survey(PastOptions::default());
    let task = Task::default();
    let rate = field(PARAMS, "publish_hz");
    // The times of the parameters in a run, gathered anew.
    let times = |source: &mut StackSource, run: u32| {
        source.gather(&[], &|| false);
        source.gather(std::slice::from_ref(&rate), &|| false);
        let frame = source.frame();
        let series = frame.field(&rate, RunTag::Run(RunId(run))).unwrap();
        assert_eq!(series.problem, None);
        series.points.sample(100).iter().map(|point| point.stamp).collect::<Vec<_>>()
    };
    let back_to_first = Step::BackTo { topic: PARAMS.to_owned(), sequence: 1 };
    source.seek(seconds(1.0), &task).unwrap();
    assert_eq!(times(&mut source, 0), [seconds(0.0)]);
    source.seek(seconds(2.0), &task).unwrap();
    source.write(PARAMS, params(7.0)).unwrap();
    assert_eq!(times(&mut source, 0), [seconds(0.0), seconds(2.0)]);
    assert!(source.step(&back_to_first, &task).unwrap());
    assert_eq!(source.now(), seconds(0.0));
    assert!(!source.step(&back_to_first, &task).unwrap(), "it is there");
    // A run that branches within the first second has it once, too.
    source.seek(seconds(0.5), &task).unwrap();
    source.write(PARAMS, params(9.0)).unwrap();
    assert_eq!(times(&mut source, 1), [seconds(0.0), seconds(0.5)]);
    assert_eq!(times(&mut source, 0), [seconds(0.0), seconds(2.0)]);
    assert!(source.step(&back_to_first, &task).unwrap());
    assert_eq!(source.now(), seconds(0.0));
    // Of several messages of a buffer, each is known.
    let mut source = StackSource::new(plan(PAIR).unwrap(), None, RunOptions::default()).unwrap();
    let name = field("/runtime/processes", "name");
    source.gather(std::slice::from_ref(&name), &|| false);
    let frame = source.frame();
    let series = frame.field(&name, RunTag::FIRST).unwrap();
    assert_eq!((series.points.len(), &series.problem), (2, &None));
}

#[test]
fn going_back_to_a_message_reads_nothing_of_what_was_written_since() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = survey(tight(folder.path(), 1 << 30));
    let task = Task::default();
    source.seek(seconds(60.0), &task).unwrap();
    damage(folder.path());
    let back_to = Step::BackTo { topic: IMAGE.to_owned(), sequence: 16 };
    assert!(source.step(&back_to, &task).unwrap());
    assert_eq!(source.now(), seconds(1.5));
    // The messages and the snapshot of the second that is shown could not be read; no other was tried.
    let problems = source.frame().info.problems.clone();
    assert!(problems.len() <= 2, "{problems:?}");
    finish_idle(&mut source);
    let frame = source.frame();
    assert_eq!(frame.topic(IMAGE).unwrap().latest.as_ref().unwrap().header.sequence, 16);
}

#[test]
fn a_second_that_is_shown_from_a_part_is_completed_before_the_one_before_is_prepared() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = survey(tight(folder.path(), 0));
    let task = Task::default();
    source.seek(seconds(60.0), &task).unwrap();
    source.seek(seconds(7.3), &task).unwrap();
    assert!(source.frame().topics.iter().any(|topic| topic.pending), "it was dropped");
    // To refuse a command in the past, the run is executed up to there.
    assert!(source.write("/nothing", params(7.0)).is_err());
    assert!(source.step(&Step::Message { topic: Some(IMAGE.to_owned()), back: true }, &task).unwrap());
    assert_eq!(source.now(), seconds(7.2));
    finish_idle(&mut source);
    let mut reference = survey(PastOptions::default());
    reference.seek(seconds(7.2), &task).unwrap();
    assert_eq!(content(&source.frame()), content(&reference.frame()));
}

#[test]
fn what_cannot_be_computed_again_is_tried_again_only_when_something_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = survey(tight(folder.path(), 0));
    let mut reference = survey(PastOptions::default());
    let task = Task::default();
    for source in [&mut source, &mut reference] {
        source.seek(seconds(5.0), &task).unwrap();
        source.write(PARAMS, params(ODD_HZ)).unwrap();
        source.seek(seconds(60.0), &task).unwrap();
    }
    IS_STRICT.store(true, Ordering::Relaxed);
    source.seek(seconds(5.5), &task).unwrap();
    finish_idle(&mut source);
    assert!(!source.idle(), "it is not tried again");
    let frame = source.frame();
    assert!(frame.topics.iter().any(|topic| topic.pending) && !frame.info.problems.is_empty());
    IS_STRICT.store(false, Ordering::Relaxed);
    for source in [&mut source, &mut reference] {
        source.seek(seconds(5.6), &task).unwrap();
        finish_idle(source);
    }
    assert_eq!(content(&source.frame()), content(&reference.frame()));
}
