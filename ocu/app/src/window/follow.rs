//! Follows a recording that is still being written: reads it again when a file of it has grown or was added.
//!
//! A recording is watched that has no end; one of several files, also for a while after the last one was finished, because
//! the next one may come then. A thread of its own watches, so that a file that does not grow costs no frame. It looks the
//! less often the longer nothing came, and reads the less often the longer that takes. What it has read is shown where
//! the old state was: at the viewed time, or at the new end if the old one was viewed.

use crate::open::Request;
use rcs_msg::Stamp;
use rcs_runtime::source::{Frame, Source, SourceInfo, SourceKind, Task};
use std::fs::Metadata;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant, SystemTime};

/// Time between two looks at a file that was changed lately.
const LOOK: Duration = Duration::from_secs(1);
/// Time between two looks at one that was not, and has no end: who writes it may have paused.
const LOOK_SELDOM: Duration = Duration::from_secs(5);
/// A file that was not changed for this long was not changed lately.
const LATELY: Duration = Duration::from_mins(1);
/// A file that grew within this time is called growing.
const GROWS: Duration = Duration::from_secs(10);
/// The file is read for at most this share of the time: one part in five.
const PAUSES: u32 = 4;

/// A file that is watched, until this is dropped.
pub(super) struct Follow {
    shared: Arc<Shared>,
    sources: Receiver<Box<dyn Source>>,
    /// The thread ends when this is dropped.
    _end: Sender<()>,
}

/// Whether a recording grows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Growth {
    /// It has not grown since it was opened.
    #[default]
    None,
    /// It grows.
    Grows,
    /// It has grown, and does not now, and has no end.
    Paused,
}

/// What the thread and the window tell each other.
#[derive(Default)]
struct Shared {
    /// The viewed time, ns.
    viewed: AtomicU64,
    /// A [`Growth`].
    growth: AtomicU8,
}

impl Shared {
    /// Sets the growth; whether it was another.
    fn set(&self, growth: Growth) -> bool {
        self.growth.swap(growth as u8, Ordering::Relaxed) != growth as u8
    }
}

impl Follow {
    /// Watches the recording of a request, if it is shown as it is, and has not been finished, or is one of several files
    /// that were changed lately.
    pub(super) fn of(request: &Request, frame: &Frame, ctx: &egui::Context) -> Option<Self> {
        let is_log = request.stack.is_none() && frame.info.kind == SourceKind::Log;
        let recording = request.recording().filter(|_| is_log)?;
        let metadata = metadata_of(&recording);
        let is_finished = !is_unfinished(&frame.info);
        // A file after the last one may be begun soon.
        let has_parts = || recording.log.as_deref().is_some_and(crate::parts::may_be_continued);
        let may_grow = !is_finished || (has_parts() && metadata.iter().any(was_changed_lately));
        let length = may_grow.then(|| length_bytes(&metadata))?;
        let shared = Arc::new(Shared { viewed: AtomicU64::new(frame.now.0), ..Shared::default() });
        let ((found, sources), (end, ended)) = (channel(), channel());
        let watch = Watch { recording, length, is_finished, shared: Arc::clone(&shared), ctx: ctx.clone() };
        let thread = std::thread::Builder::new().name("follow".to_owned());
        thread.spawn(move || watch.run(&found, &ended)).ok()?;
        Some(Self { shared, sources, _end: end })
    }

    /// Whether the file grows.
    pub(super) fn growth(&self) -> Growth {
        let growths = [Growth::None, Growth::Grows, Growth::Paused];
        growths.into_iter().nth(self.shared.growth.load(Ordering::Relaxed).into()).unwrap_or_default()
    }

    /// What the file holds now, near `viewed`, if it has been read again.
    pub(super) fn poll(&self, viewed: Stamp) -> Option<Box<dyn Source>> {
        self.shared.viewed.store(viewed.0, Ordering::Relaxed);
        self.sources.try_iter().last()
    }
}

/// The work of the thread.
struct Watch {
    /// The request for it.
    recording: Request,
    /// Size of what is shown, bytes.
    length: u64,
    /// Whether that has an end.
    is_finished: bool,
    shared: Arc<Shared>,
    ctx: egui::Context,
}

impl Watch {
    fn run(mut self, found: &Sender<Box<dyn Source>>, ended: &Receiver<()>) {
        let mut grew = Instant::now();
        let mut pause = LOOK;
        while ended.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
            let still = grew.elapsed();
            if still > LATELY && self.is_finished {
                return;
            }
            pause = if still > LATELY { LOOK_SELDOM } else { LOOK };
            let has_grown = self.shared.growth.load(Ordering::Relaxed) != Growth::None as u8;
            let growth = if self.is_finished { Growth::None } else { Growth::Paused };
            if still > GROWS && has_grown && self.shared.set(growth) {
                self.ctx.request_repaint();
            }
            let length = length_bytes(&metadata_of(&self.recording));
            if length <= self.length {
                continue;
            }
            grew = Instant::now();
            self.shared.set(Growth::Grows);
            match read(&self.recording, Stamp(self.shared.viewed.load(Ordering::Relaxed))) {
                Ok(source) => {
                    self.length = length;
                    self.is_finished = !is_unfinished(&source.info());
                    // Fails if the recording is no longer shown.
                    let _ = found.send(source);
                }
                // A record that is just being written may not be readable; the next look is later.
                Err(error) => tracing::debug!("{error:#}: {}", self.recording.title()),
            }
            self.ctx.request_repaint();
            pause = LOOK.max(grew.elapsed() * PAUSES);
        }
    }
}

/// Whether a recording may still be written: one without an end has a problem, because it had to be searched.
fn is_unfinished(info: &SourceInfo) -> bool {
    info.kind == SourceKind::Log && !info.problems.is_empty()
}

fn was_changed_lately(metadata: &Metadata) -> bool {
    let age = metadata.modified().ok().and_then(|time| SystemTime::now().duration_since(time).ok());
    metadata.is_file() && age.is_none_or(|age| age < LATELY)
}

/// What the system says about the files of a recording: those that were named, or all of one that was split. Empty
/// where none is found.
fn metadata_of(recording: &Request) -> Vec<Metadata> {
    let files = match &recording.log {
        Some(path) if recording.parts.is_empty() => crate::parts::of(path).unwrap_or_default(),
        _ => recording.files().cloned().collect(),
    };
    files.iter().filter_map(|path| path.metadata().ok()).collect()
}

fn length_bytes(files: &[Metadata]) -> u64 {
    files.iter().map(Metadata::len).sum()
}

/// The recording as it is now, with its tracks and events, at a time.
fn read(recording: &Request, viewed: Stamp) -> anyhow::Result<Box<dyn Source>> {
    let mut source = crate::stacks::open(recording)?;
    while source.idle() {}
    source.seek(viewed, &Task::default())?;
    Ok(source)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    #[test]
    fn the_length_of_a_recording_is_that_of_all_its_files_however_they_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: usize| {
            let path = folder.path().join(name);
            std::fs::write(&path, vec![0_u8; bytes]).unwrap();
            path
        };
        let (first, second) = (file("drive_0.mcap", 10), file("drive_1.mcap", 200));
        let lengths = || {
            let named: [(PathBuf, Vec<PathBuf>); 4] = [
                (second.clone(), Vec::new()),
                (second.clone(), vec![first.clone()]),
                (first.clone(), Vec::new()),
                (folder.path().to_owned(), Vec::new()),
            ];
            named.map(|(log, parts)| {
                length_bytes(&metadata_of(&Request { log: Some(log), parts, ..Request::default() }))
            })
        };
        assert_eq!(lengths(), [200, 210, 210, 210]);
        file("drive_2.mcap", 3_000);
        assert_eq!(lengths(), [200, 210, 3_210, 3_210]);
    }
}
