//! Evaluates label images of a recording or a running stack against ground truth labels of the same times.

use crate::EvalError;
use crate::report::{ClassReport, GROUND, OBSTACLE};
use rcs_bus::Buffer;
use rcs_log::{CursorOptions, Log, LogMessage, LogTopic, MessagePosition, TopicId};
use rcs_metrics::Confusion;
use rcs_msg::foxglove::RawImage;
use rcs_msg::image::raw_to_rgb8;
use rcs_msg::{AnyMessage, Stamp, canonical, canonical_name, schema_of};
use rcs_runtime::{Happened, Plan, RunOptions, Stepped, acquisition_time};
use rcs_sense::ObstacleLabel;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// Greatest number of label images of one side of a running stack that wait for their counterpart.
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
    recorded_pairs(job, log)?.report(Vec::new())
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

impl Labels {
    fn of(image: &RawImage) -> Result<Labels, EvalError> {
        if image.encoding != "mono8" && image.encoding != "8UC1" {
            return Err(EvalError::refused(format!(
                "label image has encoding {:?}, expected mono8",
                image.encoding
            )));
        }
        let rgb = raw_to_rgb8(image).map_err(|error| EvalError::nothing(error.to_string()))?.data;
        let pixels: Vec<u8> = rgb.as_chunks::<3>().0.iter().map(|pixel| pixel[0]).collect();
        Ok(Labels { size: [image.width, image.height], pixels })
    }
}

impl Pairs {
    fn new(job: &Job<'_>) -> Pairs {
        Pairs {
            tolerance_s: job.tolerance_s,
            tolerance_ns: (job.tolerance_s * 1e9).round() as u64,
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
        let without_counterpart = self.seen[Side::Judged as usize] - self.matched;
        Ok(ClassReport::new(&self.confusion, self.matched, without_counterpart, times_ms))
    }

    /// Adds a label image and its time of acquisition; counts the pair if its counterpart is there.
    fn add(&mut self, side: Side, image: &RawImage, time: Stamp) -> Result<(), EvalError> {
        let labels = Labels::of(image)?;
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
                if own.len() > WAITING {
                    own.pop_first();
                }
                Ok(())
            }
        }
    }

    /// Adds a judged label image and its time of acquisition; counts the pair with the nearest true one that no other has
    /// taken.
    fn add_to(
        &mut self,
        truth: &mut RecordedTruth<'_>,
        image: &RawImage,
        time: Stamp,
    ) -> Result<(), EvalError> {
        let judged = Labels::of(image)?;
        self.seen[Side::Judged as usize] += 1;
        match truth.take_nearest(time, self.tolerance_ns)? {
            Some(image) => self.count(&Labels::of(&image)?, &judged),
            None => Ok(()),
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
    chosen(job, &names.collect::<Vec<_>>(), "the recording")
}

fn chosen(job: &Job<'_>, names: &[String], of: &str) -> Result<String, EvalError> {
    let topic = match (job.topic, names) {
        (Some(topic), _) => topic.to_owned(),
        (None, [topic]) => topic.clone(),
        (None, []) => {
            return Err(EvalError::refused(format!(
                "{of} has no classes; expected --topic with the name of label images"
            )));
        }
        (None, _) => {
            return Err(EvalError::refused(format!("expected --topic with one of {}", names.join(", "))));
        }
    };
    if topic == job.truth_topic {
        return Err(EvalError::refused(format!(
            "got {topic} as the true and as the judged label images, expected two topics"
        )));
    }
    Ok(topic)
}

/// The topics of a recording with this name, which hold label images.
fn image_topics(log: &Log, name: &str) -> Result<Vec<TopicId>, EvalError> {
    let topics: Vec<&LogTopic> = log.info().topics_named(name).collect();
    if topics.is_empty() {
        return Err(EvalError::refused(format!("the recording has no topic {name}")));
    }
    for topic in &topics {
        if canonical_name(&topic.schema) != Some(schema_of::<RawImage>().name()) {
            let schema = topic.schema.name();
            return Err(EvalError::refused(format!(
                "topic {name} holds {schema}, expected images of labels"
            )));
        }
    }
    Ok(topics.into_iter().map(|topic| topic.id).collect())
}

/// The pairs of a recording.
fn recorded_pairs(job: &Job<'_>, log: &Log) -> Result<Pairs, EvalError> {
    let topics = image_topics(log, &judged_topic(job, log)?)?;
    let mut truth = RecordedTruth::new(log, job.truth_topic)?;
    let mut pairs = Pairs::new(job);
    pairs.seen[Side::Truth as usize] = truth.place_before.len() as u64;
    for message in log.cursor(CursorOptions { topics: Some(topics), ..CursorOptions::default() }) {
        let (time, image) = timed_image(log, &message?)?;
        pairs.add_to(&mut truth, &image, time)?;
    }
    Ok(pairs)
}

/// The true label images of a recording. They may have been appended to it in any order, so their times are read first;
/// an image is read again when a judged one needs it.
struct RecordedTruth<'a> {
    log: &'a Log,
    topics: Vec<TopicId>,
    /// Of each image by its time of acquisition, the place of the one before it in the log.
    place_before: BTreeMap<Stamp, MessagePosition>,
}

impl RecordedTruth<'_> {
    fn new<'a>(log: &'a Log, name: &str) -> Result<RecordedTruth<'a>, EvalError> {
        let topics = image_topics(log, name)?;
        let mut place_before = BTreeMap::new();
        let mut place = MessagePosition::before(Stamp(0));
        for message in log.cursor(CursorOptions { topics: Some(topics.clone()), ..CursorOptions::default() })
        {
            let message = message?;
            place_before.insert(timed_image(log, &message)?.0, place);
            place = message.place;
        }
        Ok(RecordedTruth { log, topics, place_before })
    }

    /// Takes the image that is nearest to a time, if it is within the tolerance.
    fn take_nearest(&mut self, time: Stamp, tolerance_ns: u64) -> Result<Option<RawImage>, EvalError> {
        let apart = |other: &Stamp| other.0.abs_diff(time.0);
        let before = self.place_before.range(..=time).next_back();
        let around = before.into_iter().chain(self.place_before.range(time..).next());
        let nearest = around.map(|(&other, _)| other).min_by_key(apart);
        let Some(place) = nearest
            .filter(|other| apart(other) <= tolerance_ns)
            .and_then(|other| self.place_before.remove(&other))
        else {
            return Ok(None);
        };
        let message = self.log.next_message(place, Some(&self.topics))?;
        Ok(message.map(|message| timed_image(self.log, &message)).transpose()?.map(|(_, image)| image))
    }
}

/// The label image of a message, and when it was acquired.
fn timed_image(log: &Log, message: &LogMessage) -> Result<(Stamp, RawImage), EvalError> {
    let topic =
        log.info().topic(message.topic).ok_or_else(|| EvalError::nothing("a message has no topic"))?;
    let converted = canonical(&topic.schema, &message.data).transpose();
    let converted: Option<AnyMessage> = converted.map_err(|error| EvalError::nothing(error.to_string()))?;
    let no_image = || EvalError::nothing(format!("a message of {} is no image", topic.name));
    let converted = converted.ok_or_else(no_image)?;
    let image: RawImage = converted.to().ok_or_else(no_image)?;
    Ok((acquisition_time(&converted, message.publish_time, message.log_time), image))
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
    let names: Vec<String> =
        buffers.iter().filter(is_classes).map(|buffer| buffer.name().to_owned()).collect();
    let judged_name = chosen(job, &names, "the stack")?;
    let judged = named(&judged_name)
        .ok_or_else(|| EvalError::refused(format!("the stack has no buffer {judged_name}")))?;
    let truth = named(job.truth_topic);
    let mut recorded_truth = match (&truth, log) {
        (Some(_), _) => None,
        (None, Some(log)) => Some(RecordedTruth::new(log, job.truth_topic)?),
        (None, None) => {
            return Err(EvalError::refused(format!("the stack has no buffer {}", job.truth_topic)));
        }
    };
    if let Some(truth) = &recorded_truth {
        pairs.seen[Side::Truth as usize] = truth.place_before.len() as u64;
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
            let time = sample.header.acq_time;
            match &mut recorded_truth {
                Some(truth) => pairs.add_to(truth, &image, time)?,
                None => pairs.add(side, &image, time)?,
            }
            if side == Side::Judged
                && let Some(Happened::Cycle(process)) = happened
            {
                times_ms.push(took_ms + computing_ms.remove(&process).unwrap_or(0.0));
            }
        }
    }
    Ok(times_ms)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_log::{LogWriter, WriteHeader, WriterOptions};

    const JOB: Job<'static> = Job { truth_topic: "/truth", topic: Some("/classes"), tolerance_s: 0.005 };

    /// A label image of two pixels: its side, its stamp and its log time in milliseconds, and its labels.
    type Image = (Side, u64, u64, [u8; 2]);

    /// A recording of these images, in this order.
    fn log_of(images: &[Image]) -> Log {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("labels.mcap");
        let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
        let channels = ["/truth", "/classes"]
            .map(|topic| writer.add_channel(topic, schema_of::<RawImage>(), &BTreeMap::new()).unwrap());
        for &(side, stamp_ms, log_ms, labels) in images {
            let image = RawImage {
                timestamp: Some(Stamp(stamp_ms * 1_000_000).to_proto()),
                width: 2,
                height: 1,
                encoding: "mono8".to_owned(),
                step: 2,
                data: labels.to_vec().into(),
                ..RawImage::default()
            };
            let time = Stamp(log_ms * 1_000_000);
            let header = WriteHeader { sequence: 0, log_time: time, publish_time: time };
            writer.write(channels[side as usize], header, &AnyMessage::new(image).bytes()).unwrap();
        }
        writer.finish().unwrap();
        Log::from_bytes(std::fs::read(&path).unwrap().into()).unwrap()
    }

    /// The report on a recording of these images, in this order.
    fn report(images: &[Image]) -> ClassReport {
        recording(&JOB, &log_of(images)).unwrap()
    }

    /// Compared images, those without a counterpart, and the intersection over union of ground.
    fn figures(report: &ClassReport) -> (u64, u64, Option<f64>) {
        (report.images, report.images_without_counterpart, report.ground_iou)
    }

    #[test]
    fn label_images_whose_stamp_is_not_set_are_matched_by_their_log_times() {
        let images = [
            (Side::Truth, 0, 1000, [1, 2]),
            (Side::Truth, 0, 2000, [2, 1]),
            (Side::Judged, 0, 1002, [1, 2]),
            (Side::Judged, 0, 2002, [2, 1]),
        ];
        assert_eq!(figures(&report(&images)), (2, 0, Some(1.0)));
    }

    #[test]
    fn ground_truth_that_was_appended_to_the_drive_is_matched_to_all_of_it() {
        let judged = (1..=100).map(|i| (Side::Judged, 100 * i, 100 * i, [1, 2]));
        let truth = (1..=100).map(|i| (Side::Truth, 100 * i, 20_000 + i, [1, 2]));
        let images: Vec<Image> = judged.chain(truth).collect();
        assert_eq!(figures(&report(&images)), (100, 0, Some(1.0)));
    }

    #[test]
    fn true_label_images_are_found_in_any_order_and_a_stamp_far_ahead_spoils_only_its_own_image() {
        let hour_ms = 3_600_000;
        let judged = (1..=100).map(|i| (Side::Judged, 100 * i, 100 * i, [1, 2]));
        let ahead = [(Side::Judged, hour_ms, 50, [1, 2]), (Side::Truth, 2 * hour_ms, 20_000, [1, 2])];
        let truth = (1..=100).map(|i| (Side::Truth, 100 * (101 - i), 20_000 + i, [1, 2]));
        let images: Vec<Image> = judged.chain(ahead).chain(truth).collect();
        assert_eq!(figures(&report(&images)), (100, 1, Some(1.0)));
    }

    #[test]
    fn of_several_true_images_within_the_tolerance_the_nearest_counts() {
        let images = [
            (Side::Truth, 1000, 1000, [2, 1]),
            (Side::Truth, 1004, 1004, [1, 2]),
            (Side::Judged, 1003, 1003, [1, 2]),
        ];
        assert_eq!(figures(&report(&images)), (1, 0, Some(1.0)));
    }

    #[test]
    fn a_report_says_how_many_images_it_rests_on() {
        let judged = (1..=13).map(|i| (Side::Judged, 100 * i, 100 * i, [1, 2]));
        let images: Vec<Image> = judged.chain([(Side::Truth, 500, 500, [1, 2])]).collect();
        let report = report(&images);
        assert_eq!((figures(&report), report.pixels), ((1, 12, Some(1.0)), 2));
    }
}
