//! Follows a recording that is still being written: reads it again when a file of it has grown or was added.
//!
//! Only files that were changed lately are watched, by a thread of its own, so that a file that does not grow costs no
//! frame. It reads the less often the longer that takes. What it has read is shown where the old state was: at the
//! viewed time, or at the new end if the old one was viewed.

use crate::open::Request;
use rcs_msg::Stamp;
use rcs_runtime::source::{Frame, Source, SourceKind, Task};
use std::fs::Metadata;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant, SystemTime};

/// Time between two looks at the file.
const LOOK: Duration = Duration::from_secs(1);
/// A file that was not changed for this long is finished.
const FINISHED: Duration = Duration::from_mins(1);
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

/// What the thread and the window tell each other.
#[derive(Default)]
struct Shared {
    /// The viewed time, ns.
    viewed: AtomicU64,
    grows: AtomicBool,
}

impl Follow {
    /// Watches the recording of a request, if it is shown as it is, has not been finished, and was changed lately.
    pub(super) fn of(request: &Request, frame: &Frame, ctx: &egui::Context) -> Option<Self> {
        let recording = request.recording().filter(|_| request.stack.is_none() && is_unfinished(frame))?;
        let metadata = metadata_of(&recording);
        let length = metadata.iter().any(was_changed_lately).then(|| length_bytes(&metadata))?;
        let shared = Arc::new(Shared { viewed: AtomicU64::new(frame.now.0), ..Shared::default() });
        let ((found, sources), (end, ended)) = (channel(), channel());
        let watch = Watch { recording, length, shared: Arc::clone(&shared), ctx: ctx.clone() };
        let thread = std::thread::Builder::new().name("follow".to_owned());
        thread.spawn(move || watch.run(&found, &ended)).ok()?;
        Some(Self { shared, sources, _end: end })
    }

    /// Whether the file is growing.
    pub(super) fn is_growing(&self) -> bool {
        self.shared.grows.load(Ordering::Relaxed)
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
    shared: Arc<Shared>,
    ctx: egui::Context,
}

impl Watch {
    fn run(mut self, found: &Sender<Box<dyn Source>>, ended: &Receiver<()>) {
        let mut grew = Instant::now();
        let mut pause = LOOK;
        while ended.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
            pause = LOOK;
            if grew.elapsed() > GROWS && self.shared.grows.swap(false, Ordering::Relaxed) {
                self.ctx.request_repaint();
            }
            if grew.elapsed() > FINISHED {
                return;
            }
            let length = length_bytes(&metadata_of(&self.recording));
            if length <= self.length {
                continue;
            }
            grew = Instant::now();
            self.shared.grows.store(true, Ordering::Relaxed);
            match read(&self.recording, Stamp(self.shared.viewed.load(Ordering::Relaxed))) {
                Ok(source) => {
                    self.length = length;
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
pub(super) fn is_unfinished(frame: &Frame) -> bool {
    frame.info.kind == SourceKind::Log && !frame.info.problems.is_empty()
}

fn was_changed_lately(metadata: &Metadata) -> bool {
    let age = metadata.modified().ok().and_then(|time| SystemTime::now().duration_since(time).ok());
    metadata.is_file() && age.is_none_or(|age| age < FINISHED)
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
