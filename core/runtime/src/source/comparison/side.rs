//! One side of a comparison: the messages of a recording or of a run, time by time.

use crate::compare::{Entry, is_compared};
use crate::history::Piece;
use crate::stack::Plan;
use rcs_bus::Sample;
use rcs_log::{Cursor, CursorOptions, Log, Reassembly, TopicId};
use rcs_msg::{DeltaCodec, Stamp};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::iter::Peekable;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

/// Messages of a log that are read at once.
const PIECE: usize = 512;
/// Time between two looks at whether a run goes on.
const LOOK: Duration = Duration::from_millis(100);

/// Where the messages of a side come from.
pub(super) enum Input {
    Log(Log),
    Files(Vec<PathBuf>, Vec<&'static dyn DeltaCodec>),
    Run {
        /// What the run wrote before its first event, by index of the buffer; it is in no piece.
        opening: Vec<(usize, Sample)>,
        pieces: Receiver<Piece>,
        waiting: Arc<AtomicUsize>,
        plan: Arc<Plan>,
        /// The log that the run reads.
        log: Option<Log>,
    },
}

/// A side that is being read.
pub(super) struct Reading {
    from: Origin,
    /// The messages that were read and not compared yet, by time.
    pub(super) queue: VecDeque<(String, Entry)>,
    /// Everything before this time was read.
    pub(super) until: Stamp,
}

enum Origin {
    Log(Box<LogReading>),
    Run { pieces: Receiver<Piece>, waiting: Arc<AtomicUsize>, plan: Arc<Plan>, log: Option<Log> },
}

struct LogReading {
    log: Log,
    cursor: Peekable<Cursor>,
    reassembly: Reassembly,
}

/// What reading on gave.
pub(super) enum Step {
    /// More messages.
    Read,
    /// The messages of this part were not kept.
    Lost(Stamp, Stamp),
    /// Nothing yet.
    Nothing,
    /// No more messages will come.
    Ended,
    /// Nobody wants the comparison any more.
    Dropped,
}

impl Input {
    /// Opens the side; an error says why it cannot be read.
    pub(super) fn open(self) -> Result<Reading, String> {
        let mut queue = VecDeque::new();
        let from = match self {
            Self::Log(log) => of_log(log),
            Self::Files(files, codecs) => {
                of_log(Log::open_parts(&files).map_err(|error| error.to_string())?.with_codecs(codecs))
            }
            Self::Run { opening, pieces, waiting, plan, log } => {
                let name = |buffer: usize| plan.buffers[buffer].spec.name.clone();
                queue.extend(opening.into_iter().map(|(buffer, sample)| (name(buffer), entry_of(sample))));
                Origin::Run { pieces, waiting, plan, log }
            }
        };
        Ok(Reading { from, queue, until: Stamp(0) })
    }
}

fn entry_of(sample: Sample) -> Entry {
    Entry {
        sequence: sample.header.sequence as u32,
        log_time: sample.header.log_time,
        acq_time: sample.header.acq_time,
        message: sample.message,
    }
}

fn of_log(log: Log) -> Origin {
    let (cursor, reassembly) = (log.cursor(CursorOptions::default()).peekable(), Reassembly::new(&log));
    Origin::Log(Box::new(LogReading { log, cursor, reassembly }))
}

impl Reading {
    /// Names of the buffers that can be compared.
    pub(super) fn names(&self) -> BTreeSet<String> {
        match &self.from {
            Origin::Log(from) => {
                let LogReading { log, reassembly, .. } = &**from;
                let topics = log.info().topics.iter();
                let whole = topics.filter(|topic| reassembly.keys_of(topic.id).is_none());
                whole.map(|topic| topic.name.clone()).filter(|name| is_compared(name)).collect()
            }
            Origin::Run { plan, .. } => {
                let is_fed = |index: usize| plan.inputs.iter().any(|input| input.buffer == index);
                let buffers = plan.buffers.iter().enumerate().filter(|(index, _)| !is_fed(*index));
                buffers.map(|(_, buffer)| buffer.spec.name.clone()).filter(|name| is_compared(name)).collect()
            }
        }
    }

    /// The recording that is read; `None` for a run.
    pub(super) fn log(&self) -> Option<&Log> {
        let Origin::Log(from) = &self.from else { return None };
        Some(&from.log)
    }

    /// Whether it is a recording, which may lack messages.
    pub(super) fn is_recording(&self) -> bool {
        self.log().is_some()
    }

    /// The time of the last message of a recording; `None` for a run, which may go on.
    pub(super) fn end(&self) -> Option<Stamp> {
        Some(self.log()?.info().end)
    }

    /// Reads only these buffers.
    pub(super) fn choose(&mut self, wanted: &BTreeSet<String>) {
        let Origin::Log(from) = &mut self.from else { return };
        let LogReading { log, cursor, reassembly } = &mut **from;
        let topics = log.info().topics.iter();
        let chosen: Vec<TopicId> = topics
            .filter(|topic| {
                let keys = reassembly.keys_of(topic.id).and_then(|keys| log.info().topic(keys));
                wanted.contains(&keys.unwrap_or(topic).name)
            })
            .map(|topic| topic.id)
            .collect();
        let options = CursorOptions { topics: Some(chosen), ..CursorOptions::default() };
        *cursor = log.cursor(options).peekable();
    }

    /// Reads the next messages. `problems` is told what could not be read.
    pub(super) fn read_on(&mut self, wanted: &BTreeSet<String>, problem: &mut Option<String>) -> Step {
        match &mut self.from {
            Origin::Log(from) => {
                let LogReading { log, cursor, reassembly } = &mut **from;
                let mut last = Stamp(0);
                for count in 0.. {
                    match cursor.peek() {
                        None => {
                            self.until = Stamp::MAX;
                            return Step::Ended;
                        }
                        Some(Ok(next)) if count >= PIECE && next.log_time > last => {
                            self.until = next.log_time;
                            return Step::Read;
                        }
                        Some(_) => {}
                    }
                    match cursor.next() {
                        Some(Ok(message)) => {
                            last = message.log_time;
                            self.queue.extend(Entry::of(&message, log, reassembly));
                        }
                        // The cursor continues after what cannot be read.
                        Some(Err(error)) => *problem = Some(error.to_string()),
                        None => {}
                    }
                }
                Step::Read
            }
            Origin::Run { pieces, plan, log, .. } => {
                let piece = match pieces.recv_timeout(LOOK) {
                    Ok(piece) => piece,
                    Err(RecvTimeoutError::Timeout) => return Step::Nothing,
                    Err(RecvTimeoutError::Disconnected) => return Step::Dropped,
                };
                let (from, until) = (piece.from, piece.until);
                self.until = until;
                let names: BTreeMap<usize, &str> =
                    plan.buffers.iter().map(|b| b.spec.name.as_str()).enumerate().collect();
                let is_wanted = |buffer: usize| names.get(&buffer).is_some_and(|name| wanted.contains(*name));
                let unpacked = piece.unpack(plan, log.as_ref(), is_wanted);
                match unpacked {
                    Ok(Some(samples)) => {
                        for (buffer, sample) in samples {
                            let Some(name) = names.get(&buffer) else { continue };
                            self.queue.push_back(((*name).to_owned(), entry_of(sample)));
                        }
                        Step::Read
                    }
                    Ok(None) => Step::Lost(from, until),
                    Err(error) => {
                        *problem = Some(error.to_string());
                        Step::Lost(from, until)
                    }
                }
            }
        }
    }

    /// What was read last has been compared.
    pub(super) fn taken(&self) {
        if let Origin::Run { waiting, .. } = &self.from {
            waiting.fetch_sub(1, Ordering::AcqRel);
        }
    }
}
