//! Evaluates label images of a recording or a running stack against ground truth labels of the same times.

use crate::EvalError;
use crate::report::{ClassReport, GROUND, OBSTACLE};
use rcs_bus::Buffer;
use rcs_log::{CursorOptions, Log, LogMessage, LogTopic};
use rcs_metrics::Confusion;
use rcs_msg::foxglove::RawImage;
use rcs_msg::image::raw_to_rgb8;
use rcs_msg::{AnyMessage, Stamp, canonical, canonical_name, schema_of};
use rcs_runtime::{Happened, Plan, RunOptions, Stepped};
use rcs_sense::ObstacleLabel;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// Greatest number of label images that wait for their counterpart.
const WAITING: usize = 64;

/// What is evaluated.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// Topic of the ground truth label images, in the recording or the stack.
    pub truth_topic: &'a str,
    /// Topic of the label images to evaluate; `None` for the one whose palette is `classes`.
    pub topic: Option<&'a str>,
    /// Greatest difference of acquisition times between two label images of a pair, s.
    pub tolerance_s: f64,
}

/// The stack that produces the label images.
#[derive(Clone, Debug)]
pub struct StackRun<'a> {
    /// The stack.
    pub plan: Arc<Plan>,
    /// The recording that it reads.
    pub log: Option<&'a Log>,
    /// Options of the run. It uses one thread, so that the times are those of one core.
    pub options: RunOptions,
    /// When to stop, seconds from its start; `None` for the end of the recording.
    pub until_s: Option<f64>,
}

/// Evaluates the label images of a recording.
pub fn recording(job: &Job<'_>, log: &Log) -> Result<ClassReport, EvalError> {
    let mut pairs = Pairs::new(job);
    let judged = judged_topic(job, log)?;
    read(log, &[(job.truth_topic, Side::Truth), (&judged, Side::Judged)], &mut pairs)?;
    pairs.report(Vec::new())
}

/// Evaluates the label images of a stack while it runs.
pub fn stack(job: &Job<'_>, run: StackRun<'_>) -> Result<ClassReport, EvalError> {
    let mut pairs = Pairs::new(job);
    let times_ms = run_stack(job, run, &mut pairs)?;
    pairs.report(times_ms)
}

/// Side of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Truth,
    Judged,
}

/// Label images by acquisition time, and the counts of the complete pairs.
#[derive(Debug)]
struct Pairs {
    tolerance_s: f64,
    tolerance_ns: u64,
    /// Whether the number of waiting label images is unlimited.
    keeps_all: bool,
    waiting: [BTreeMap<Stamp, Labels>; 2],
    seen: [u64; 2],
    matched: u64,
    confusion: Confusion<2>,
}

#[derive(Debug)]
struct Labels {
    size: [u32; 2],
    pixels: Vec<u8>,
}

impl Pairs {
    fn new(job: &Job<'_>) -> Pairs {
        Pairs {
            tolerance_s: job.tolerance_s,
            tolerance_ns: (job.tolerance_s * 1e9).round() as u64,
            keeps_all: false,
            waiting: [BTreeMap::new(), BTreeMap::new()],
            seen: [0; 2],
            matched: 0,
            confusion: Confusion::default(),
        }
    }

    fn report(&self, times_ms: Vec<f64>) -> Result<ClassReport, EvalError> {
        if self.matched == 0 {
            let [truth, judged] = self.seen;
            return Err(EvalError::nothing(format!(
                "no label image of the {judged} that were judged has a true one of its time among {truth}, \
                 within {} s",
                self.tolerance_s
            )));
        }
        if self.confusion.total() == 0 {
            return Err(EvalError::nothing("the true label images have neither ground nor obstacles"));
        }
        Ok(ClassReport::new(&self.confusion, times_ms))
    }

    /// Adds a label image; counts the pair if its counterpart is there.
    fn add(&mut self, side: Side, image: &RawImage, otherwise: Stamp) -> Result<(), EvalError> {
        let time = image.timestamp.as_ref().and_then(Stamp::from_proto).unwrap_or(otherwise);
        if image.encoding != "mono8" && image.encoding != "8UC1" {
            return Err(EvalError::refused(format!(
                "label image has encoding {:?}, expected mono8",
                image.encoding
            )));
        }
        let rgb = raw_to_rgb8(image).map_err(|error| EvalError::nothing(error.to_string()))?.data;
        let pixels: Vec<u8> = rgb.as_chunks::<3>().0.iter().map(|pixel| pixel[0]).collect();
        let labels = Labels { size: [image.width, image.height], pixels };
        self.seen[side as usize] += 1;
        let others = &mut self.waiting[1 - side as usize];
        let apart = |other: Stamp| other.0.abs_diff(time.0);
        let nearest = others.keys().copied().min_by_key(|&other| apart(other));
        match nearest
            .filter(|&other| apart(other) <= self.tolerance_ns)
            .and_then(|other| others.remove(&other))
        {
            Some(other) if side == Side::Truth => self.count(&labels, &other),
            Some(other) => self.count(&other, &labels),
            None => {
                let own = &mut self.waiting[side as usize];
                own.insert(time, labels);
                if own.len() > WAITING && !self.keeps_all {
                    own.pop_first();
                }
                Ok(())
            }
        }
    }

    fn count(&mut self, truth: &Labels, judged: &Labels) -> Result<(), EvalError> {
        if truth.size != judged.size {
            let ([a, b], [c, d]) = (judged.size, truth.size);
            return Err(EvalError::refused(format!(
                "label images are {a}x{b} pixels, the true ones {c}x{d}"
            )));
        }
        self.matched += 1;
        for (&truth, &judged) in truth.pixels.iter().zip(&judged.pixels) {
            if let Some(truth) = class(truth) {
                self.confusion.add(truth, class(judged));
            }
        }
        Ok(())
    }
}

/// The class of a label of the palettes `obstacle_labels` and `classes`: short obstacles count as ground; cover, too
/// far and invalid have no class.
fn class(label: u8) -> Option<usize> {
    match label {
        label if label == ObstacleLabel::Ground.code() || label == ObstacleLabel::ShortObstacle.code() => {
            Some(GROUND)
        }
        label if label == ObstacleLabel::Obstacle.code() => Some(OBSTACLE),
        _ => None,
    }
}

/// The requested topic, or the one whose palette is `classes`.
fn judged_topic(job: &Job<'_>, log: &Log) -> Result<String, EvalError> {
    let is_classes = |topic: &&LogTopic| topic.metadata.get("rcs.palette").is_some_and(|p| p == "classes");
    let names = log.info().topics.iter().filter(is_classes).map(|topic| topic.name.clone());
    chosen(job, names.collect(), "the recording")
}

fn chosen(job: &Job<'_>, mut names: Vec<String>, of: &str) -> Result<String, EvalError> {
    if let Some(topic) = job.topic {
        return Ok(topic.to_owned());
    }
    match names.len() {
        1 => Ok(names.remove(0)),
        0 => Err(EvalError::refused(format!(
            "{of} has no classes; expected --topic with the name of label images"
        ))),
        _ => Err(EvalError::refused(format!("expected --topic with one of {}", names.join(", ")))),
    }
}

/// Adds the label images of a recording's topics to the pairs.
fn read(log: &Log, wanted: &[(&str, Side)], pairs: &mut Pairs) -> Result<(), EvalError> {
    let mut sides = BTreeMap::new();
    for &(name, side) in wanted {
        let topics: Vec<&LogTopic> = log.info().topics_named(name).collect();
        if topics.is_empty() {
            return Err(EvalError::refused(format!("the recording has no topic {name}")));
        }
        for topic in topics {
            if canonical_name(&topic.schema) != Some(schema_of::<RawImage>().name()) {
                let schema = topic.schema.name();
                return Err(EvalError::refused(format!(
                    "topic {name} holds {schema}, expected images of labels"
                )));
            }
            sides.insert(topic.id, side);
        }
    }
    let options = CursorOptions { topics: Some(sides.keys().copied().collect()), ..CursorOptions::default() };
    for message in log.cursor(options) {
        let message = message?;
        if let Some(&side) = sides.get(&message.topic) {
            give(log, &message, side, pairs)?;
        }
    }
    Ok(())
}

fn give(log: &Log, message: &LogMessage, side: Side, pairs: &mut Pairs) -> Result<(), EvalError> {
    let topic =
        log.info().topic(message.topic).ok_or_else(|| EvalError::nothing("a message has no topic"))?;
    let image = canonical(&topic.schema, &message.data).transpose();
    let image = image.map_err(|error| EvalError::nothing(error.to_string()))?;
    let image: Option<RawImage> = image.and_then(|image: AnyMessage| image.to());
    let image =
        image.ok_or_else(|| EvalError::nothing(format!("a message of {} is no image", topic.name)))?;
    pairs.add(side, &image, message.log_time)
}

/// Runs a stack to its end and adds its label images, and the ground truth labels of the run or of the recording, to
/// the pairs. Returns the times of the cycles that wrote an evaluated image, ms.
fn run_stack(job: &Job<'_>, stack: StackRun<'_>, pairs: &mut Pairs) -> Result<Vec<f64>, EvalError> {
    let StackRun { plan, log, options, until_s } = stack;
    if log.is_none() && until_s.is_none() {
        return Err(EvalError::refused(
            "a stack without a recording runs on for ever: expected --log or --until",
        ));
    }
    let mut run = Stepped::new(plan, log, RunOptions { threads: 1, ..options }).map_err(EvalError::Start)?;
    let buffers = run.buffers().to_vec();
    let named = |name: &str| buffers.iter().find(|buffer| buffer.name() == name).cloned();
    let is_classes =
        |buffer: &&Arc<Buffer>| buffer.spec().metadata.get("rcs.palette").is_some_and(|p| p == "classes");
    let names = buffers.iter().filter(is_classes).map(|buffer| buffer.name().to_owned()).collect();
    let judged_name = chosen(job, names, "the stack")?;
    let judged = named(&judged_name)
        .ok_or_else(|| EvalError::refused(format!("the stack has no buffer {judged_name}")))?;
    let truth = named(job.truth_topic);
    if truth.is_none() {
        let log =
            log.ok_or_else(|| EvalError::refused(format!("the stack has no buffer {}", job.truth_topic)))?;
        // All ground truth images are read before the first evaluated one, which a process writes later.
        pairs.keeps_all = true;
        read(log, &[(job.truth_topic, Side::Truth)], pairs)?;
        pairs.keeps_all = false;
    }
    run.begin()?;
    let until = until_s.map(|seconds| run.start().after_ns((seconds * 1e9).round() as u64));
    let end = [run.horizon(), until].into_iter().flatten().min().unwrap_or(Stamp(0));
    let (mut seen, mut times_ms) = ([0; 2], Vec::new());
    // Times of cycles whose output is not visible yet.
    let mut computing_ms = BTreeMap::new();
    while run.next_time()?.is_some_and(|time| time <= end) {
        let clock = Instant::now();
        let happened = run.advance()?;
        let took_ms = clock.elapsed().as_secs_f64() * 1e3;
        if let Some(Happened::Started(process)) = happened {
            computing_ms.insert(process, took_ms);
        }
        for (side, buffer) in [(Side::Truth, truth.as_ref()), (Side::Judged, Some(&judged))] {
            let Some(buffer) = buffer else { continue };
            if buffer.newest() == seen[side as usize] {
                continue;
            }
            seen[side as usize] = buffer.newest();
            let Some(sample) = buffer.latest() else { continue };
            let image: Option<RawImage> = sample.message.to();
            let image = image.ok_or_else(|| {
                EvalError::nothing(format!("{} does not hold images of labels", buffer.name()))
            })?;
            pairs.add(side, &image, sample.header.acq_time)?;
            if side == Side::Judged
                && let Some(Happened::Cycle(process)) = happened
            {
                times_ms.push(took_ms + computing_ms.remove(&process).unwrap_or(0.0));
            }
        }
    }
    Ok(times_ms)
}
