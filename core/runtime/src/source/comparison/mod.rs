//! Comparisons of two runs, of a run and a recording, or of two recordings: the first difference of each buffer.
//!
//! A thread per comparison reads both sides time by time, and follows runs that go on. The source's thread hands it what
//! the past has kept, by reference. A buffer is compared up to its first difference, so that what follows costs little:
//! the table of these differences shows how a difference spreads.
//!
//! The buffers that differ by their nature are left out: measured times, and the identity of the run. So are those that
//! a log feeds, and those that only one side has. A run and a recording are compared from what the run writes before its
//! first event up to the end of the recording, and without the descriptions of their processes, because a run may repeat
//! a part of the recorded stack. Two recordings are compared up to the end of the shorter one, if they have
//! a common time. A recording that begins later than the other side, or is complete only from later on, is compared
//! from there on.

mod other;
mod side;
mod worker;

use super::SourceError;
use super::compared::{Compared, Comparison};
use super::frame::Frame;
use super::log_view::LogView;
use crate::compare::Difference;
use crate::history::{Piece, RunReader, Session};
use crate::stack::Plan;
use other::OtherView;
use rcs_log::Log;
use rcs_msg::{DeltaCodec, Stamp};
use side::Input;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use worker::Work;

/// The largest number of pieces of a run that wait to be compared: they keep what they refer to in memory.
const MOST_WAITING: usize = 4;
/// Time between two looks at what the other threads have compared.
const WAIT: Duration = Duration::from_millis(4);

/// What a comparing thread tells.
#[derive(Default)]
struct Told {
    differences: Arc<[Difference]>,
    until: Option<Stamp>,
    recording_ends: [Option<Stamp>; 2],
    left_out: [usize; 2],
    gaps: Arc<[(Stamp, Stamp)]>,
    problem: Option<Arc<str>>,
    /// The other recording, once it is open.
    other: Option<Log>,
    /// Index of the side that it waits for: it has compared everything up to where that side is known.
    waits_for: Option<usize>,
    ended: bool,
}

type SharedTold = Arc<Mutex<Told>>;

fn lock(told: &Mutex<Told>) -> MutexGuard<'_, Told> {
    told.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a source can compare.
pub(super) struct Subject<'a> {
    /// The runs of a stack.
    pub(super) session: Option<&'a Session>,
    /// The open recording.
    pub(super) log: Option<&'a Log>,
    /// Time of the start.
    pub(super) start: Stamp,
}

impl<'a> Subject<'a> {
    /// A stack, on a recording if it reads one.
    pub(super) fn of(session: &'a Session, recorded: Option<&'a LogView>, start: Stamp) -> Subject<'a> {
        Subject { session: Some(session), log: recorded.map(LogView::log), start }
    }
}

/// The comparisons of a source.
#[derive(Default)]
pub(super) struct Comparing {
    pairs: Vec<Pair>,
    /// The files of the other recording; empty if none was chosen.
    against: Vec<PathBuf>,
    other: OtherView,
    /// Whether nobody shows the moment in the other recording.
    is_other_hidden: bool,
}

struct Pair {
    sides: [Compared; 2],
    /// Those sides that are runs.
    feeds: [Option<FeedOfRun>; 2],
    told: SharedTold,
}

/// Hands the messages of a run to the comparing thread, which ends when it is dropped.
struct FeedOfRun {
    reader: RunReader,
    pieces: Sender<Piece>,
    waiting: Arc<AtomicUsize>,
    /// Whether everything up to now was handed over.
    is_done: bool,
}

impl FeedOfRun {
    fn feed(&mut self, session: &Session) {
        self.is_done = false;
        while self.waiting.load(Ordering::Acquire) < MOST_WAITING {
            let Some(piece) = session.read_on(&mut self.reader) else {
                self.is_done = true;
                return;
            };
            self.waiting.fetch_add(1, Ordering::AcqRel);
            if self.pieces.send(piece).is_err() {
                // The thread has ended, and has said why.
                self.is_done = true;
                return;
            }
        }
    }
}

impl Pair {
    fn is_busy(&self) -> bool {
        let told = lock(&self.told);
        let has_all = |feed: &FeedOfRun| feed.is_done && feed.waiting.load(Ordering::Acquire) == 0;
        let waits = told.waits_for.is_some_and(|side| self.feeds[side].as_ref().is_none_or(has_all));
        !told.ended && !waits
    }

    fn read(&self, start: Stamp, end: Stamp) -> Comparison {
        let is_busy = self.is_busy();
        let told = lock(&self.told);
        let done_s = told.until.map_or(0.0, |until| until.min(end).seconds_since(start));
        let fraction = (done_s / end.seconds_since(start).max(1e-9)).clamp(0.0, 1.0);
        Comparison {
            sides: self.sides,
            differences: Arc::clone(&told.differences),
            until: told.until.map(|until| until.min(end)),
            progress: is_busy.then_some(fraction),
            recording_ends: told.recording_ends,
            left_out: told.left_out,
            gaps: Arc::clone(&told.gaps),
            problem: told.problem.clone(),
        }
    }
}

impl Comparing {
    /// Compares these pairs, and no others.
    pub(super) fn compare(&mut self, pairs: &[[Compared; 2]], subject: &Subject<'_>) {
        self.pairs.retain(|pair| pairs.contains(&pair.sides));
        for &sides in pairs {
            if !self.pairs.iter().any(|pair| pair.sides == sides) {
                let pair = self.begin(sides, subject);
                self.pairs.push(pair);
            }
        }
    }

    /// Sets the files of the other recording. Comparisons with the one before begin anew.
    pub(super) fn against(&mut self, files: &[PathBuf], subject: &Subject<'_>) {
        files.clone_into(&mut self.against);
        self.other.set(None);
        let wanted: Vec<[Compared; 2]> = self.pairs.iter().map(|pair| pair.sides).collect();
        self.pairs.retain(|pair| !pair.sides.contains(&Compared::Other));
        self.compare(&wanted, subject);
    }

    /// Sets whether the moment in the other recording is shown.
    pub(super) fn show_other(&mut self, is_shown: bool) {
        self.is_other_hidden = !is_shown;
        self.find_other();
    }

    /// The moment of `frame` in the other recording; `None` while it is not compared, not shown, or not open yet.
    pub(super) fn other_frame(&mut self, frame: &Frame) -> Option<Arc<Frame>> {
        self.find_other();
        self.other.frame(frame)
    }

    /// Reads the other recording once a comparing thread has opened it, and no longer than it is compared and shown.
    fn find_other(&mut self) {
        let known = if self.is_other_hidden {
            None
        } else {
            self.pairs.iter().find_map(|pair| lock(&pair.told).other.clone())
        };
        self.other.set(known);
    }

    /// Name of the other recording.
    pub(super) fn other(&self) -> Option<Arc<str>> {
        let path = self.against.first()?;
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        Some(match self.against.len() {
            1 => name.into(),
            files => format!("{name} ({files} files)").into(),
        })
    }

    fn begin(&self, sides: [Compared; 2], subject: &Subject<'_>) -> Pair {
        let told = SharedTold::default();
        let mut pair = Pair { sides, feeds: [None, None], told: Arc::clone(&told) };
        let inputs = match self.inputs(sides, subject, &mut pair.feeds) {
            Ok(inputs) => inputs,
            Err(error) => {
                *lock(&told) =
                    Told { problem: Some(error.to_string().into()), ended: true, ..Told::default() };
                return pair;
            }
        };
        let plan = subject.session.map(|session| Arc::clone(session.run().plan()));
        let work = Work { inputs, plan, start: subject.start };
        if let Err(error) = work.spawn(Arc::clone(&told)) {
            let problem = format!("no thread to compare: {error}");
            *lock(&told) = Told { problem: Some(problem.into()), ended: true, ..Told::default() };
        }
        pair
    }

    fn inputs(
        &self,
        sides: [Compared; 2],
        subject: &Subject<'_>,
        feeds: &mut [Option<FeedOfRun>; 2],
    ) -> Result<[Input; 2], SourceError> {
        let missing = |text: &str| SourceError::Unsupported(text.to_owned());
        let run_of = |side: Compared| match side {
            Compared::Run(run) => Some(run),
            Compared::Recorded | Compared::Other => None,
        };
        let mut input = |index: usize| -> Result<Input, SourceError> {
            let (side, beside) = (sides[index], sides[1 - index]);
            match side {
                Compared::Recorded => {
                    let log = subject.log.ok_or_else(|| missing("no recording is open"))?;
                    Ok(Input::Log(log.clone()))
                }
                Compared::Other => {
                    if self.against.is_empty() {
                        return Err(missing("no other recording was chosen"));
                    }
                    Ok(Input::Files(self.against.clone(), codecs(subject)))
                }
                Compared::Run(run) => {
                    let known = subject.session.filter(|session| (run.0 as usize) < session.runs().len());
                    let session = known.ok_or_else(|| missing(&format!("there is no {run}")))?;
                    let (pieces, receiver) = channel();
                    let waiting = Arc::new(AtomicUsize::new(0));
                    let other = run_of(beside);
                    // All runs of a stack begin alike, but not like a recording.
                    let opening = if other.is_none() { session.opening() } else { Vec::new() };
                    let reader = session.reader(run, other);
                    feeds[index] =
                        Some(FeedOfRun { reader, pieces, waiting: Arc::clone(&waiting), is_done: false });
                    let (plan, log) = (Arc::clone(session.run().plan()), subject.log.cloned());
                    Ok(Input::Run { opening, pieces: receiver, waiting, plan, log })
                }
            }
        };
        Ok([input(0)?, input(1)?])
    }

    /// Hands over what runs have written since; `true` while there is something to compare.
    pub(super) fn feed(&mut self, session: Option<&Session>) -> bool {
        for pair in &mut self.pairs {
            if let Some(session) = session {
                pair.feeds.iter_mut().flatten().for_each(|feed| feed.feed(session));
            }
        }
        self.pairs.iter().any(Pair::is_busy)
    }

    /// The same as background work, with the reading of the other recording: waits a little while other threads compare.
    pub(super) fn idle(&mut self, session: Option<&Session>) -> bool {
        let is_busy = self.feed(session);
        self.find_other();
        let reads = self.other.idle();
        if is_busy && !reads {
            std::thread::sleep(WAIT);
        }
        is_busy || reads
    }

    /// The comparisons as far as they have come; `end` is the last time that is known of the source.
    pub(super) fn read(&self, start: Stamp, end: Stamp) -> Arc<[Comparison]> {
        self.pairs.iter().map(|pair| pair.read(start, end)).collect()
    }
}

/// The codecs that another recording of the same kind needs.
fn codecs(subject: &Subject<'_>) -> Vec<&'static dyn DeltaCodec> {
    let of_log = subject.log.map(Log::codecs).unwrap_or_default();
    let of_plan = |plan: &Plan| plan.buffers.iter().filter_map(|buffer| buffer.codec).collect::<Vec<_>>();
    let of_plan = subject.session.map(|session| of_plan(session.run().plan())).unwrap_or_default();
    of_log.iter().copied().chain(of_plan).collect()
}
