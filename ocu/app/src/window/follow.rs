//! Follows a recording that is still being written: reads it again when its file has grown.
//!
//! Only files that were changed lately are watched. They are read on a thread of its own, the less often the longer that
//! takes, and shown where the old state was: at the viewed time, or at the new end if the old one was viewed.

use crate::open::Request;
use rcs_msg::Stamp;
use rcs_runtime::source::{Frame, Source, SourceKind, Task};
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant, SystemTime};

/// Time between two looks at the file.
const LOOK: Duration = Duration::from_secs(1);
/// A file that was not changed for this long is finished.
const FINISHED: Duration = Duration::from_mins(1);
/// A file that grew within this time is called growing.
const GROWS: Duration = Duration::from_secs(10);
/// The file is read for at most this share of the time: one part in five.
const PAUSES: u32 = 4;

/// A file that is watched.
pub(super) struct Follow {
    path: PathBuf,
    /// Size of what is shown, bytes.
    length: u64,
    /// When the file grew last; when it was opened, if it has not grown since.
    grew: Instant,
    has_grown: bool,
    looked: Instant,
    /// No reading begins before.
    rest_until: Instant,
    reading: Option<Reading>,
}

/// A file that is being read again.
struct Reading {
    since: Instant,
    length: u64,
    source: Receiver<anyhow::Result<Box<dyn Source>>>,
}

impl Follow {
    /// Watches the recording of a request, if it is shown as it is, has not been finished, and was changed lately.
    pub(super) fn of(request: &Request, frame: &Frame) -> Option<Self> {
        let path = request.log.clone().filter(|_| request.stack.is_none() && is_unfinished(frame))?;
        let metadata = path.metadata().ok()?;
        let now = Instant::now();
        was_changed_lately(&metadata).then(|| Self {
            path,
            length: metadata.len(),
            grew: now,
            has_grown: false,
            looked: now,
            rest_until: now,
            reading: None,
        })
    }

    /// Whether the file is growing.
    pub(super) fn is_growing(&self) -> bool {
        self.has_grown && self.grew.elapsed() < GROWS
    }

    /// Looks at the file now and then; returns what it holds now, positioned at `viewed`, once it has been read again.
    pub(super) fn poll(&mut self, ctx: &egui::Context, viewed: Stamp) -> Option<Box<dyn Source>> {
        let now = Instant::now();
        if let Some(reading) = &self.reading {
            let result = match reading.source.try_recv() {
                Err(TryRecvError::Empty) => return None,
                Err(TryRecvError::Disconnected) => None,
                Ok(result) => Some(result),
            };
            let (took, length) = (reading.since.elapsed(), reading.length);
            self.reading = None;
            self.rest_until = now + took * PAUSES;
            match result {
                Some(Ok(source)) => {
                    self.length = length;
                    return Some(source);
                }
                // A record that is just being written may not be readable; the next look is later.
                Some(Err(error)) => tracing::debug!("{error:#}: {}", self.path.display()),
                None => {}
            }
        }
        if self.grew.elapsed() > FINISHED {
            return None;
        }
        ctx.request_repaint_after(LOOK);
        if now.saturating_duration_since(self.looked) < LOOK || now < self.rest_until {
            return None;
        }
        self.looked = now;
        let length = self.path.metadata().map_or(self.length, |metadata| metadata.len());
        if length > self.length {
            (self.grew, self.has_grown) = (now, true);
            self.read(ctx, length, viewed);
        }
        None
    }

    fn read(&mut self, ctx: &egui::Context, length: u64, viewed: Stamp) {
        let (sender, source) = channel();
        let (path, ctx) = (self.path.clone(), ctx.clone());
        let thread = std::thread::Builder::new().name("follow".to_owned()).spawn(move || {
            // Fails if the recording is no longer shown.
            let _ = sender.send(read(&path, viewed));
            ctx.request_repaint();
        });
        if thread.is_ok() {
            self.reading = Some(Reading { since: Instant::now(), length, source });
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

/// The recording as it is now, with its tracks and events, at a time.
fn read(path: &Path, viewed: Stamp) -> anyhow::Result<Box<dyn Source>> {
    let request = Request { log: Some(path.to_owned()), ..Request::default() };
    let mut source = crate::stacks::open(&request)?;
    while source.idle() {}
    source.seek(viewed, &Task::default())?;
    Ok(source)
}
