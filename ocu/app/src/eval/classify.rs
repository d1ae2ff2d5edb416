//! `ocu eval classify`: label images of a recording, or of a stack that runs on it, against true ones.

use crate::cli::EvalClassifyArgs;
use crate::eval::segments::{Confusion, Said};
use crate::{stacks, usage};
use anyhow::Context as _;
use rcs_bus::Buffer;
use rcs_log::{CursorOptions, Log, LogMessage, LogTopic};
use rcs_msg::foxglove::RawImage;
use rcs_msg::image::raw_to_rgb8;
use rcs_msg::{AnyMessage, Stamp, canonical, canonical_name, schema_of};
use rcs_runtime::{Happened, RunOptions, Stepped};
use rcs_sense::ObstacleLabel;
use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Arc;
use std::time::Instant;

/// Label images that wait for the one of their time.
const WAITING: usize = 64;

/// Prints the figures of all pairs of label images together.
pub(super) fn classify(args: &EvalClassifyArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let log = args.log.as_ref().map(Log::open).transpose()?;
    let mut pairs = Pairs { tolerance_ns: (args.tolerance * 1e9).round() as u64, ..Pairs::default() };
    let mut times_ms = Vec::new();
    match (&args.stack, &log) {
        (Some(stack), log) => run(stack, log.as_ref(), args, &mut pairs, &mut times_ms)?,
        (None, Some(log)) => {
            let judged = judged_topic(args, log)?;
            read(log, &[(&args.truth_topic, Side::Truth), (&judged, Side::Judged)], &mut pairs)?;
        }
        (None, None) => return Err(usage("expected a recording or a stack, got neither")),
    }
    anyhow::ensure!(
        pairs.matched > 0,
        "no label image of the {} that were judged has a true one of its time among {}, within {} s",
        pairs.seen[Side::Judged as usize],
        pairs.seen[Side::Truth as usize],
        args.tolerance
    );
    anyhow::ensure!(pairs.confusion.total() > 0, "the true label images have neither ground nor obstacles");
    pairs.confusion.report(times_ms).print(args.json, out)
}

/// Which of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Truth,
    Judged,
}

/// Label images by acquisition time, and what the pairs of them have in common.
#[derive(Debug, Default)]
struct Pairs {
    tolerance_ns: u64,
    /// Whether label images wait however many there are.
    keeps_all: bool,
    waiting: [BTreeMap<Stamp, Labels>; 2],
    seen: [u64; 2],
    matched: u64,
    confusion: Confusion,
}

#[derive(Debug)]
struct Labels {
    size: [u32; 2],
    pixels: Vec<u8>,
}

impl Pairs {
    /// Takes a label image; counts it if the other one of its time is there.
    fn add(&mut self, side: Side, image: &RawImage, otherwise: Stamp) -> anyhow::Result<()> {
        let time = image.timestamp.as_ref().and_then(Stamp::from_proto).unwrap_or(otherwise);
        if image.encoding != "mono8" && image.encoding != "8UC1" {
            return Err(usage(format!("label image has encoding {:?}, expected mono8", image.encoding)));
        }
        let rgb = raw_to_rgb8(image)?.data;
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

    fn count(&mut self, truth: &Labels, judged: &Labels) -> anyhow::Result<()> {
        if truth.size != judged.size {
            let ([a, b], [c, d]) = (judged.size, truth.size);
            return Err(usage(format!("label images are {a}x{b} pixels, the true ones {c}x{d}")));
        }
        self.matched += 1;
        for (&truth, &judged) in truth.pixels.iter().zip(&judged.pixels) {
            let is_ground = match class(truth) {
                Said::Ground => true,
                Said::Obstacle => false,
                Said::Unclassified => continue,
            };
            self.confusion.add(is_ground, class(judged));
        }
        Ok(())
    }
}

/// The class of a label of the palettes `obstacle_labels` and `classes`: short obstacles are driven over, and what is
/// cover, too far or invalid is of no class.
fn class(label: u8) -> Said {
    match label {
        label if label == ObstacleLabel::Ground.code() || label == ObstacleLabel::ShortObstacle.code() => {
            Said::Ground
        }
        label if label == ObstacleLabel::Obstacle.code() => Said::Obstacle,
        _ => Said::Unclassified,
    }
}

/// The topic that is asked for, or the one whose labels are of the palette `classes`.
fn judged_topic(args: &EvalClassifyArgs, log: &Log) -> anyhow::Result<String> {
    let is_classes = |topic: &&LogTopic| topic.metadata.get("rcs.palette").is_some_and(|p| p == "classes");
    let names = log.info().topics.iter().filter(is_classes).map(|topic| topic.name.clone());
    chosen(args, names.collect(), "the recording")
}

fn chosen(args: &EvalClassifyArgs, mut names: Vec<String>, of: &str) -> anyhow::Result<String> {
    if let Some(topic) = &args.topic {
        return Ok(topic.clone());
    }
    match names.len() {
        1 => Ok(names.remove(0)),
        0 => Err(usage(format!("{of} has no classes; expected --topic with the name of label images"))),
        _ => Err(usage(format!("expected --topic with one of {}", names.join(", ")))),
    }
}

/// Gives label images of a recording's topics to the pairs.
fn read(log: &Log, wanted: &[(&str, Side)], pairs: &mut Pairs) -> anyhow::Result<()> {
    let mut sides = BTreeMap::new();
    for &(name, side) in wanted {
        let topics: Vec<&LogTopic> = log.info().topics_named(name).collect();
        if topics.is_empty() {
            return Err(usage(format!("the recording has no topic {name}")));
        }
        for topic in topics {
            if canonical_name(&topic.schema) != Some(schema_of::<RawImage>().name()) {
                let schema = topic.schema.name();
                return Err(usage(format!("topic {name} holds {schema}, expected images of labels")));
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

fn give(log: &Log, message: &LogMessage, side: Side, pairs: &mut Pairs) -> anyhow::Result<()> {
    let topic = log.info().topic(message.topic).context("a message has no topic")?;
    let image = canonical(&topic.schema, &message.data).transpose()?;
    let image: Option<RawImage> = image.and_then(|image: AnyMessage| image.to());
    let image = image.with_context(|| format!("a message of {} is no image", topic.name))?;
    pairs.add(side, &image, message.log_time)
}

/// Runs a stack to its end and gives its label images, and the true ones of the run or of the recording, to the pairs.
fn run(
    stack: &str,
    log: Option<&Log>,
    args: &EvalClassifyArgs,
    pairs: &mut Pairs,
    times_ms: &mut Vec<f64>,
) -> anyhow::Result<()> {
    let overrides: Vec<(String, String)> = args
        .params
        .iter()
        .map(|param| (format!("{}.{}", param.process, param.field), param.value.clone()))
        .collect();
    let plan = stacks::plan(stack, args.course.as_deref(), &overrides)?;
    if log.is_none() && args.until.is_none() {
        return Err(usage("a stack without a recording runs on for ever: expected --log or --until"));
    }
    // One thread: the time of an image is that of one core.
    let options = RunOptions { threads: 1, seed: args.seed, ..stacks::options() };
    let mut run = Stepped::new(plan, log, options).context("the stack cannot run")?;
    let buffers = run.buffers().to_vec();
    let named = |name: &str| buffers.iter().find(|buffer| buffer.name() == name).cloned();
    let is_classes =
        |buffer: &&Arc<Buffer>| buffer.spec().metadata.get("rcs.palette").is_some_and(|p| p == "classes");
    let names = buffers.iter().filter(is_classes).map(|buffer| buffer.name().to_owned()).collect();
    let judged_name = chosen(args, names, "the stack")?;
    let judged =
        named(&judged_name).ok_or_else(|| usage(format!("the stack has no buffer {judged_name}")))?;
    let truth = named(&args.truth_topic);
    if truth.is_none() {
        let log = log.ok_or_else(|| usage(format!("the stack has no buffer {}", args.truth_topic)))?;
        // All true images are there before the first judged one: what is judged comes late, not early.
        pairs.keeps_all = true;
        read(log, &[(&args.truth_topic, Side::Truth)], pairs)?;
        pairs.keeps_all = false;
    }
    run.begin()?;
    let until = args.until.map(|seconds| run.start().after_ns((seconds * 1e9).round() as u64));
    let end = [run.horizon(), until].into_iter().flatten().min().unwrap_or(Stamp(0));
    let mut seen = [0; 2];
    // Of cycles whose output is not visible yet.
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
            let image = image.with_context(|| format!("{} does not hold images of labels", buffer.name()))?;
            pairs.add(side, &image, sample.header.acq_time)?;
            if side == Side::Judged
                && let Some(Happened::Cycle(process)) = happened
            {
                times_ms.push(took_ms + computing_ms.remove(&process).unwrap_or(0.0));
            }
        }
    }
    Ok(())
}
