//! Rates of messages: measured over the last seconds before the newest message, so that a topic that has stopped is
//! recognised by its age within a few of its periods, however long it has been silent or the run has lasted. After a
//! jump in a log, the times of these messages are looked up.

use crate::history::{RunId, RunSummary};
use crate::stepped::Stepped;
use rcs_bus::Sample;
use rcs_log::{Log, LogError, LogInfo, TimesOf, TopicId};
use rcs_msg::Stamp;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A rate is measured over this time before the newest message; over two messages if they are farther apart.
const WINDOW_NS: u64 = 2_000_000_000;
/// Greatest number of messages that are used, which is enough for a mean at any rate.
const MOST: usize = 64;
/// What was sent in this time after the start of a log and never again holds for all of the log.
const OPENING_NS: u64 = 1_000_000_000;

/// Messages per second, from the times of the last ones, newest first; `None` for fewer than two.
fn rate_hz(newest_first: impl Iterator<Item = u64>) -> Option<f64> {
    let mut times = newest_first.take(MOST);
    let newest = times.next()?;
    let mut span = None;
    for (count, time) in (1_u32..).zip(times) {
        let age = newest.saturating_sub(time);
        if span.is_some() && age > WINDOW_NS {
            break;
        }
        span = Some((count, age));
    }
    let (count, age) = span?;
    (age > 0).then(|| f64::from(count) * 1e9 / age as f64)
}

/// Times of the messages of a buffer in one run, by sequence.
#[derive(Clone, Debug, Default)]
struct MessageTimes(Vec<Stamp>);

impl MessageTimes {
    /// Records that the message with this sequence (from 1) was written at `time`. Known times are kept, because a part
    /// of a run that is executed again is the same.
    fn take(&mut self, sequence: u64, time: Stamp) {
        if sequence as usize > self.0.len() {
            // Messages that were not seen were written at this time at the latest.
            self.0.resize(sequence as usize, time);
        }
    }

    /// The times for a run that branches from this one at `time`, and shares so many messages with it.
    fn fork(&self, time: Stamp, shared: u64) -> Self {
        let kept = self.0.partition_point(|&known| known <= time);
        Self(self.0[..kept.min(shared as usize)].to_vec())
    }

    /// The rate at the message with this sequence.
    fn rate_hz(&self, newest: u64) -> Option<f64> {
        let known = &self.0[..self.0.len().min(newest as usize)];
        rate_hz(known.iter().rev().map(|time| time.0))
    }
}

/// Times of the messages of each buffer, in every run of the stack.
pub(super) struct RunTimes {
    inner: Arc<Mutex<Inner>>,
}

struct Inner {
    /// By run, and by buffer in the order of the plan.
    runs: Vec<Vec<MessageTimes>>,
    current: usize,
}

impl RunTimes {
    /// Records the time of each message of each buffer.
    pub(super) fn tap(run: &Stepped) -> Self {
        let first = vec![MessageTimes::default(); run.buffers().len()];
        let inner = Arc::new(Mutex::new(Inner { runs: vec![first], current: 0 }));
        for (index, buffer) in run.buffers().iter().enumerate() {
            let inner = Arc::clone(&inner);
            buffer.tap_once(Box::new(move |sample: &Sample| {
                let inner = &mut *inner.lock().unwrap_or_else(PoisonError::into_inner);
                inner.runs[inner.current][index].take(sample.header.sequence, sample.header.log_time);
            }));
        }
        Self { inner }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The times of the messages of a buffer in a run.
    pub(super) fn of(&self, run: usize, buffer: usize) -> Vec<Stamp> {
        let inner = self.lock();
        let times = inner.runs.get(run).and_then(|buffers| buffers.get(buffer));
        times.map(|times| times.0.clone()).unwrap_or_default()
    }

    /// Sets the run of what is written from now on. A new run begins with what it shares with the one that it branched
    /// from: `shared` messages of each buffer.
    pub(super) fn follow(&self, runs: &[RunSummary], current: usize, shared: &[u64]) {
        let mut inner = self.lock();
        for run in &runs[inner.runs.len().min(runs.len())..] {
            let times = match run.branched_from {
                Some((from, time)) => {
                    let parent = inner.runs[from.run.0 as usize].iter().enumerate();
                    parent.map(|(buffer, times)| times.fork(time, shared[buffer])).collect()
                }
                None => vec![MessageTimes::default(); inner.runs[0].len()],
            };
            inner.runs.push(times);
        }
        inner.current = current;
    }

    /// The rate of a buffer in a run at its message with this sequence.
    pub(super) fn rate_hz(&self, run: RunId, buffer: usize, newest: u64) -> Option<f64> {
        self.lock().runs[run.0 as usize][buffer].rate_hz(newest)
    }
}

/// The rate of a topic of a log.
#[derive(Clone, Debug)]
pub(crate) struct LogRate {
    /// The channels of its messages and of their updates.
    channels: Vec<TopicId>,
    /// Number of messages in all of them.
    messages: u64,
    /// [`LogInfo::mean_hz`] and [`LogInfo::density_hz`].
    mean_hz: Option<f64>,
    density_hz: Option<f64>,
    /// The end of [`OPENING_NS`].
    opening_until: Stamp,
    /// Times of the last messages that were shown, oldest first: those from `known_since` on, at most [`MOST`].
    times: VecDeque<Stamp>,
    known_since: Stamp,
    /// The rate at the viewed time.
    hz: Option<f64>,
    /// A lower one, by which the age is judged; 0 where no further message is due.
    seldom_hz: Option<f64>,
    /// Time of the newest message for which it was measured; `None` if more messages may follow at that time.
    measured: Option<Stamp>,
}

impl LogRate {
    pub(crate) fn new(channels: Vec<TopicId>, messages: u64, info: &LogInfo) -> Self {
        let mean_hz = info.mean_hz(&channels);
        Self {
            mean_hz,
            density_hz: info.density_hz(&channels),
            opening_until: info.complete_from.unwrap_or_default().max(info.start).after_ns(OPENING_NS),
            channels,
            messages,
            times: VecDeque::new(),
            known_since: Stamp(0),
            hz: mean_hz,
            seldom_hz: None,
            measured: None,
        }
    }

    /// After a jump, the messages from `time` on follow.
    pub(crate) fn begin_at(&mut self, time: Stamp) {
        self.times.clear();
        self.known_since = time;
    }

    /// The next message that is shown.
    pub(crate) fn take(&mut self, time: Stamp) {
        if self.times.len() == MOST {
            self.times.pop_front();
        }
        self.times.push_back(time);
    }

    /// The rate at the viewed time; see [`measure`].
    pub(crate) fn hz(&self) -> Option<f64> {
        self.hz
    }

    /// The rate by which the age is judged, where it is not [`LogRate::hz`].
    pub(crate) fn seldom_hz(&self) -> Option<f64> {
        self.seldom_hz
    }

    /// The messages whose times give the rate where the newest one is at `newest`; `None` if the rate is known: a single
    /// message has none.
    fn wanted(&self, newest: Stamp) -> Option<TimesOf<'_>> {
        let is_known = self.messages < 2 || self.measured == Some(newest);
        let (since, before) = (newest.before_ns(WINDOW_NS), newest.after_ns(1));
        (!is_known).then_some(TimesOf { topics: &self.channels, since, before })
    }

    /// Adds the times from `since` on, newest first, of the messages before those that were shown.
    fn complete(&mut self, newest_first: Vec<Stamp>, since: Stamp, viewed: Stamp) {
        // Of the messages at the viewed time, those count that were shown.
        self.times.retain(|time| *time >= viewed);
        for time in newest_first {
            if self.times.len() < MOST {
                self.times.push_front(time);
            }
        }
        self.known_since = since;
    }

    /// Measures the rate from the times from `since` on.
    fn settle(&mut self, newest: Stamp, since: Stamp, viewed: Stamp) {
        let last = self.times.iter().rev().take_while(|time| **time >= since).map(|time| time.0);
        let is_all = last.clone().count() as u64 == self.messages;
        let hz = rate_hz(last);
        let is_mean = is_all || hz.is_none();
        self.hz = hz.or(self.mean_hz);
        self.seldom_hz = if is_all && newest <= self.opening_until {
            Some(0.0)
        } else {
            self.density_hz.filter(|density_hz| is_mean && hz.is_none_or(|hz| *density_hz < hz))
        };
        // More messages may follow at the viewed time.
        self.measured = (newest < viewed).then_some(newest);
    }
}

/// Measures the rate of each topic at the `viewed` time, when its message at the time in `newest` is the newest one. It
/// follows from the log alone, not from what was shown before. The mean over the log stands for it where the last seconds
/// before that message have no other one. There, and where they have all messages that there are, the age is judged by
/// the number of messages over the duration of the log, if that is lower. What was sent in the first second alone does
/// not become old.
///
/// What several topics need is read once.
pub(crate) fn measure(
    rates: &mut [LogRate],
    newest: &[Option<Stamp>],
    log: &Log,
    viewed: Stamp,
) -> Result<(), LogError> {
    let mut open: Vec<(&mut LogRate, Stamp)> = Vec::new();
    for (rate, newest) in rates.iter_mut().zip(newest) {
        match newest {
            Some(newest) if rate.wanted(*newest).is_some() => open.push((rate, *newest)),
            Some(_) => {}
            None => (rate.hz, rate.seldom_hz, rate.measured) = (rate.mean_hz, None, None),
        }
    }
    let wanted: Vec<TimesOf<'_>> = open.iter().filter_map(|(rate, newest)| rate.wanted(*newest)).collect();
    let since = log.times_known_since(&wanted);
    // The times of the others were shown one after another.
    let is_unknown = |index: &usize| open[*index].0.known_since > since[*index];
    let unknown: Vec<usize> = (0..open.len()).filter(is_unknown).collect();
    let missing = |&index: &usize| {
        let TimesOf { topics, before, .. } = wanted[index];
        TimesOf { topics, since: since[index], before: before.min(viewed) }
    };
    let missing: Vec<TimesOf<'_>> = unknown.iter().map(missing).collect();
    let found = log.times_before(&missing)?;
    for (index, times) in unknown.into_iter().zip(found) {
        open[index].0.complete(times, since[index], viewed);
    }
    for ((rate, newest), since) in open.into_iter().zip(since) {
        rate.settle(newest, since, viewed);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(times_ms: impl DoubleEndedIterator<Item = u64>) -> Option<f64> {
        rate_hz(times_ms.rev().map(|ms| ms * 1_000_000))
    }

    #[test]
    fn a_topic_with_one_message_has_no_rate() {
        assert_eq!(rate([].into_iter()), None);
        assert_eq!(rate([5].into_iter()), None);
        assert_eq!(rate([5, 5].into_iter()), None, "two at one moment are one");
    }

    #[test]
    fn of_a_log_no_times_are_looked_up_of_a_topic_with_a_single_message() {
        let [single, several] = [1, 2].map(|messages| LogRate {
            channels: vec![TopicId(1)],
            messages,
            mean_hz: None,
            density_hz: None,
            opening_until: Stamp(0),
            times: VecDeque::new(),
            known_since: Stamp(0),
            hz: None,
            seldom_hz: None,
            measured: None,
        });
        assert!(single.wanted(Stamp(5)).is_none());
        let wanted = several.wanted(Stamp(5)).map(|of| (of.topics, of.since, of.before));
        assert_eq!(wanted, Some((&[TopicId(1)][..], Stamp(0), Stamp(6))));
    }

    #[test]
    fn the_rate_is_that_of_the_last_seconds() {
        assert_eq!(rate((0..100).map(|i| i * 20)), Some(50.0));
        // Once per second for a while, then 20 times per second.
        let times = (0..10).map(|i| i * 1000).chain((0..100).map(|i| 10_000 + i * 50));
        assert_eq!(rate(times), Some(20.0));
    }

    #[test]
    fn messages_further_apart_than_the_window_still_have_a_rate() {
        assert_eq!(rate([0, 10_000, 20_000].into_iter()), Some(0.1));
    }

    #[test]
    fn going_back_shows_the_rate_of_then_and_another_run_has_its_own() {
        let mut times = MessageTimes::default();
        let branch = Stamp(1_000_000_000);
        (1..=10).for_each(|i| times.take(i, Stamp(i * 100_000_000)));
        let mut other = times.fork(branch, 10);
        (11..=40).for_each(|i| times.take(i, branch.after_ns((i - 10) * 10_000_000)));
        assert_eq!(times.rate_hz(10), Some(10.0));
        (11..=12).for_each(|i| other.take(i, branch.after_ns((i - 10) * 1_000_000_000)));
        assert_eq!(other.rate_hz(12), Some(1.0));
        (11..=12).for_each(|i| times.take(i, Stamp(9_000_000_000)));
        assert!(times.rate_hz(40).is_some_and(|hz| hz > 20.0), "done again, nothing changes");
        assert_eq!((times.rate_hz(1), times.rate_hz(0)), (None, None));
        assert_eq!(times.fork(branch, 3).0.len(), 3, "of one time, only what is shared");
    }
}
