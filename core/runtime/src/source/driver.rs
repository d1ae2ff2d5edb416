//! Runs a source on a separate thread: paces, steps and writes it as requested by messages; views read its frames.
//!
//! Requests are processed in order, except emergency stops, which have priority: an emergency stop ends the current
//! work, is written before everything that waits, and discards what waits to go elsewhere: seeks, steps, undoing and
//! other runs. It is recognised by its message type. The gathering of fields that it interrupts begins again when no
//! stop has come for a second, and within a few seconds in any case ([`Deferred`]).

use super::control::Control;
use super::deferred::Deferred;
use super::frame::{Frame, Playback, Topic};
use super::held::HeldControls;
use super::pace::Pace;
use super::{Source, SourceError, Task};
use crate::node::panic_text;
use crate::record::RecordOptions;
use rcs_formula::FieldRef;
use rcs_msg::{AnyMessage, Stamp, rcs, schema_of};
use std::cell::Cell;
use std::collections::VecDeque;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time between frames while playing, unless the window can draw only fewer ([`Driver::show_every`]).
const FRAME: Duration = Duration::from_millis(16);
/// Time between frames in which nothing but the clock has changed.
const CLOCK: Duration = Duration::from_millis(200);
/// Greatest duration of work between two frames (except for a single step of the source that takes longer), so that the
/// window stays responsive.
const BUDGET: Duration = Duration::from_millis(24);
/// Playing continues this far into a gap of a recording, and then jumps to its end.
const IN_A_GAP_NS: u64 = 1_000_000_000;
/// Least time between frames that show the results of background work.
const SHOW_IDLE: Duration = Duration::from_millis(250);

/// A source on a separate thread. Dropping it ends the thread.
pub struct Driver {
    shared: Arc<Shared>,
    controls: Option<Sender<Control>>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    frame: Mutex<Arc<Frame>>,
    /// The work in progress.
    task: Mutex<Option<(Arc<Task>, Instant)>>,
    /// Emergency stops that have not been written yet, oldest first.
    urgent: Mutex<VecDeque<(String, AnyMessage)>>,
    /// Time between frames while playing, µs.
    every_us: AtomicU64,
    /// Memory that the window takes for what it shows, bytes.
    reserved_bytes: AtomicU64,
}

impl Shared {
    fn every(&self) -> Duration {
        Duration::from_micros(self.every_us.load(Ordering::Relaxed))
    }

    fn task(&self) -> MutexGuard<'_, Option<(Arc<Task>, Instant)>> {
        self.task.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn urgent(&self) -> MutexGuard<'_, VecDeque<(String, AnyMessage)>> {
        self.urgent.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn cancel_task(&self) {
        if let Some((task, _)) = &*self.task() {
            task.cancel();
        }
    }

    fn show(&self, frame: Frame) {
        *self.frame.lock().unwrap_or_else(PoisonError::into_inner) = Arc::new(frame);
    }

    /// The last frame, with the error that ended the source.
    fn show_end(&self, text: &str) {
        *self.task() = None;
        let last = Arc::clone(&self.frame.lock().unwrap_or_else(PoisonError::into_inner));
        let playback = Playback { playing: false, error: Some(text.to_owned()), ..last.playback.clone() };
        self.show(Frame { generation: last.generation + 1, playback, ..(*last).clone() });
    }
}

impl Driver {
    /// Starts the thread of a source. `wake` is called for every new frame.
    pub fn spawn(mut source: Box<dyn Source>, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            frame: Mutex::new(Arc::new(source.frame())),
            task: Mutex::new(None),
            urgent: Mutex::default(),
            every_us: AtomicU64::new(FRAME.as_micros() as u64),
            reserved_bytes: AtomicU64::new(0),
        });
        let (controls, receiver) = channel();
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("source".to_owned()).spawn(move || {
            let pacer = DriverLoop {
                source,
                shared: Arc::clone(&theirs),
                wake: &wake,
                playback: Playback::default(),
                pace: Pace::new(),
                hands: HeldControls::default(),
                controls: &receiver,
                pending: VecDeque::new(),
                gather_later: None,
                last_stop: None,
                idle: true,
                may_idle: false,
                is_behind: false,
                woken: (Instant::now(), 0),
            };
            // The frame must show that the source has stopped, and why.
            if let Err(panic) = catch_unwind(AssertUnwindSafe(|| pacer.run())) {
                let text = format!("the source has ended: its thread panicked: {}", panic_text(&*panic));
                tracing::error!("{text}");
                theirs.show_end(&text);
                wake();
            }
        })?;
        Ok(Self { shared, controls: Some(controls), thread: Some(thread) })
    }

    /// The newest frame. Never waits for the source.
    pub fn frame(&self) -> Arc<Frame> {
        Arc::clone(&self.shared.frame.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Progress of long work, 0 to 1; `None` if there is none that a user would notice.
    pub fn busy(&self) -> Option<f64> {
        let task = self.shared.task();
        task.as_ref()
            .filter(|(_, since)| since.elapsed() > Duration::from_millis(100))
            .map(|(task, _)| task.fraction())
    }

    /// Sets the time between frames while playing: no more frames are made than the window can draw.
    pub fn show_every(&self, every: Duration) {
        let us = every.max(FRAME).as_micros() as u64;
        self.shared.every_us.store(us, Ordering::Relaxed);
    }

    /// Sets the memory that the window takes for what it shows, bytes: the past of the source has the rest.
    pub fn reserve(&self, bytes: u64) {
        self.shared.reserved_bytes.store(bytes, Ordering::Relaxed);
    }

    /// Sends a request. [`Control::Cancel`] and an emergency stop act at once, all others in order.
    pub fn send(&self, control: Control) {
        let control = match control {
            Control::Cancel => return self.shared.cancel_task(),
            Control::Write { buffer, message } if is_emergency_stop(&message) => {
                self.shared.urgent().push_back((buffer, message));
                self.shared.cancel_task();
                // Wakes the thread wherever it waits.
                Control::Cancel
            }
            other => other,
        };
        // If the thread has panicked, its last frame says so.
        if let Some(controls) = &self.controls {
            let _ = controls.send(control);
        }
    }
}

/// Whether this message has priority over everything else.
fn is_emergency_stop(message: &AnyMessage) -> bool {
    message.is_a(schema_of::<rcs::EmergencyStop>())
}

/// Whether an emergency stop asks to stop (`true`) or releases (`false`); `None` if it does not decode.
fn asks_to_stop(message: &AnyMessage) -> Option<bool> {
    message.to::<rcs::EmergencyStop>().map(|stop| stop.active)
}

impl Drop for Driver {
    fn drop(&mut self) {
        self.send(Control::Cancel);
        self.controls = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct DriverLoop<'a, W> {
    source: Box<dyn Source>,
    shared: Arc<Shared>,
    wake: &'a W,
    playback: Playback,
    pace: Pace,
    hands: HeldControls,
    controls: &'a Receiver<Control>,
    /// The outstanding requests, oldest first.
    pending: VecDeque<Control>,
    /// Fields that an emergency stop kept from being gathered.
    gather_later: Option<Deferred>,
    /// The last emergency stop or release that was written: its buffer, and what it asks for ([`asks_to_stop`]).
    last_stop: Option<(String, Option<bool>)>,
    /// Whether background work is left.
    idle: bool,
    /// Whether there may be some, because something was asked for since the source was last given time for it.
    may_idle: bool,
    /// Whether the source has not reached the time of the clock.
    is_behind: bool,
    /// When the window was last woken, and the content that it was woken for.
    woken: (Instant, u64),
}

impl<W: Fn()> DriverLoop<'_, W> {
    fn run(mut self) {
        let mut shown = Instant::now();
        loop {
            let wait = if self.playback.playing && self.is_behind {
                Duration::ZERO
            } else if self.playback.playing {
                self.shared.every().saturating_sub(shown.elapsed())
            } else if self.idle || self.may_idle {
                Duration::ZERO
            } else {
                Duration::MAX
            };
            let wait = match &self.gather_later {
                Some(deferred) => wait.min(deferred.at().saturating_duration_since(Instant::now())),
                None => wait,
            };
            if self.pending.is_empty() {
                match self.controls.recv_timeout(wait) {
                    Ok(control) => self.pending.push_back(control),
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return,
                }
            }
            let mut changed = !self.pending.is_empty();
            loop {
                match self.controls.try_recv() {
                    Ok(control) => self.pending.push_back(control),
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => return,
                }
            }
            // A request is answered at once; otherwise frames come no faster than they can be drawn.
            let is_asked = changed;
            // It may leave something to do in the background: a past to compute again, runs to compare.
            self.may_idle |= is_asked;
            self.source.reserve(self.shared.reserved_bytes.load(Ordering::Relaxed));
            drop_overtaken_seeks(&mut self.pending);
            self.write_urgent();
            while let Some(control) = self.pending.pop_front() {
                self.obey(control);
                self.write_urgent();
            }
            changed |= self.gather_again();
            if self.playback.playing {
                self.play_on(Instant::now());
                let is_due = shown.elapsed() + Duration::from_millis(1) >= self.shared.every();
                changed = is_asked || is_due || !self.playback.playing;
            } else if self.idle || self.may_idle {
                let has_ended = self.work_in_background();
                changed |= has_ended || shown.elapsed() > SHOW_IDLE;
            }
            if changed {
                shown = Instant::now();
                self.show(is_asked);
                // While it plays, the time until the next frame is used, unless the source needs it to keep up.
                if self.playback.playing && !self.is_behind && (self.idle || self.may_idle) {
                    self.work_in_background();
                }
            }
        }
    }

    /// Gives the source time for one piece of background work. Whether that was the last one.
    fn work_in_background(&mut self) -> bool {
        self.may_idle = false;
        let was_idle = std::mem::replace(&mut self.idle, self.source.idle());
        was_idle && !self.idle
    }

    /// Publishes a frame, and wakes the window for it; for the clock alone, only a few times a second.
    fn show(&mut self, is_asked: bool) {
        let mut frame = self.source.frame();
        // A frame follows when the comparisons that are not complete in this one are.
        self.idle |= frame.comparisons.iter().any(|comparison| comparison.progress.is_some());
        frame.playback = self.playback.clone();
        frame.topics.iter().for_each(Topic::convert_ahead);
        let content = content(&frame);
        self.shared.show(frame);
        let (at, known) = self.woken;
        if is_asked || !self.playback.playing || content != known || at.elapsed() >= CLOCK {
            self.woken = (Instant::now(), content);
            (self.wake)();
        }
    }

    /// Writes the emergency stops that have been sent, then discards what waits to go elsewhere, where they would not
    /// hold.
    fn write_urgent(&mut self) {
        let urgent = std::mem::take(&mut *self.shared.urgent());
        if urgent.is_empty() {
            return;
        }
        for (buffer, message) in urgent {
            let asks = asks_to_stop(&message);
            if let Err(error) = self.source.write(&buffer, message) {
                self.playback.error = Some(error.to_string());
            }
            self.last_stop = Some((buffer, asks));
        }
        if let Some(deferred) = &mut self.gather_later {
            deferred.put_off(Instant::now());
        }
        self.pending.extend(self.controls.try_iter());
        self.pending.retain(|control| !control.goes_elsewhere());
    }

    fn obey(&mut self, control: Control) {
        let result = match control {
            Control::Play => {
                if !std::mem::replace(&mut self.playback.playing, true) {
                    self.playback.from = self.source.now();
                }
                self.restart();
                let info = self.source.info();
                if info.end.is_some_and(|end| self.source.now() >= end) {
                    self.go_to(info.start)
                } else {
                    Ok(())
                }
            }
            Control::Pause => {
                self.playback.playing = false;
                Ok(())
            }
            Control::Speed(speed) => {
                if speed > 0.0 {
                    self.playback.speed = speed;
                }
                self.restart();
                Ok(())
            }
            Control::Loop(looping) => {
                self.playback.looping = looping;
                Ok(())
            }
            Control::Seek(to) => self.go_to(to),
            Control::Step(step) => {
                self.playback.playing = false;
                if step.is_back() {
                    self.hands.end();
                }
                self.work(|source, task| source.step(&step, task).map(|_| ()))
            }
            Control::SwitchRun(run) => {
                let moved = self.source.switch_run(run);
                self.playback.from = self.source.now();
                self.restart();
                self.hands.end();
                moved
            }
            Control::Undo => {
                self.playback.playing = false;
                self.hands.end();
                match self.source.undo() {
                    Ok(false) => Err(SourceError::Unsupported(
                        "nothing was written before this moment that could be taken back".to_owned(),
                    )),
                    undone => undone.map(|_| ()),
                }
            }
            Control::Watch(runs) => {
                self.source.watch(&runs);
                return;
            }
            Control::Gather(fields) => {
                self.gather(fields, None);
                return;
            }
            Control::Compare(pairs) => {
                self.source.compare(&pairs);
                self.idle = true;
                return;
            }
            Control::Against(files) => {
                self.source.against(&files);
                self.idle = true;
                return;
            }
            Control::ShowOther(is_shown) => {
                self.source.show_other(is_shown);
                self.idle = true;
                return;
            }
            Control::Write { buffer, message } => self.source.write(&buffer, message),
            Control::Hold(held) => {
                self.hands.hold(held, Instant::now(), self.source.now());
                return;
            }
            Control::LetGo(held) => {
                if !self.hands.let_go(&held.buffer) {
                    return;
                }
                self.source.write(&held.buffer, (held.make)(self.source.now()))
            }
            Control::Record { path, build } => {
                let options = RecordOptions { lossless: true, build, ..RecordOptions::default() };
                self.source.record(&path, &options)
            }
            Control::StopRecording => {
                self.source.stop_recording();
                Ok(())
            }
            // Already handled in `Driver::send`.
            Control::Cancel => return,
        };
        self.playback.error = result.err().map(|error| error.to_string());
    }

    /// Gathers these fields, and no others; later if an emergency stop interrupts. `interrupted` is when one did first.
    fn gather(&mut self, fields: Vec<FieldRef>, interrupted: Option<Instant>) {
        let (shared, last) = (Arc::clone(&self.shared), &self.last_stop);
        let is_overdue = interrupted.is_some_and(|first| Deferred::is_overdue(first, Instant::now()));
        let is_repeated = |(buffer, message): &(String, AnyMessage)| {
            last.as_ref().is_some_and(|(same, asks)| same == buffer && *asks == asks_to_stop(message))
        };
        // What is overdue comes to an end, although a stop that the vehicle does not confirm is sent again and again.
        let interrupts = |stop: &(String, AnyMessage)| !(is_overdue && is_repeated(stop));
        // Asked for every message of the past: each stop is judged once. Only this thread takes them away.
        let judged = Cell::new(0);
        let is_interrupted = || {
            let urgent = shared.urgent();
            let before = judged.replace(urgent.len());
            urgent.iter().skip(before).any(interrupts)
        };
        let is_whole = self.source.gather(&fields, &is_interrupted);
        self.gather_later = (!is_whole).then(|| Deferred::new(fields, interrupted, Instant::now()));
        self.idle = true;
    }

    /// Gathers the fields that an emergency stop kept from being gathered, if it is time. Whether it did.
    fn gather_again(&mut self) -> bool {
        let due = self.gather_later.take_if(|deferred| deferred.at() <= Instant::now());
        let Some(Deferred { fields, first, .. }) = due else { return false };
        self.gather(fields, Some(first));
        self.write_urgent();
        true
    }

    /// Restarts the pace at the current position of the source.
    fn restart(&mut self) {
        self.pace.restart(self.playback.speed);
        (self.playback.lag_s, self.playback.achieved) = (0.0, None);
    }

    fn go_to(&mut self, to: Stamp) -> Result<(), SourceError> {
        self.restart();
        let from = self.source.now();
        let moved = self.work(|source, task| source.seek(to, task));
        self.playback.from = self.source.now();
        if self.source.now() < from {
            self.hands.end();
        }
        moved
    }

    /// Advances the source to the time of the clock, or as far as the budget allows.
    fn play_on(&mut self, start: Instant) {
        self.hands.suspend_overdue(start);
        let info = self.source.info();
        let end = info.end.unwrap_or(Stamp::MAX);
        let now = self.source.now();
        if let Some(gap) = info.gaps.iter().find(|gap| now >= gap.from.after_ns(IN_A_GAP_NS) && now < gap.to)
        {
            let from = self.playback.from;
            if let Err(error) = self.go_to(gap.to) {
                self.playback.error = Some(error.to_string());
                self.playback.playing = false;
            }
            self.playback.from = from;
            return;
        }
        let target = self.pace.target(start, self.source.now());
        if let Err(error) = self.run_to(target.min(end), start) {
            self.playback.error = Some(error.to_string());
            self.playback.playing = false;
        }
        self.pace.arrived(Instant::now(), self.source.now(), target.min(end));
        self.is_behind = self.source.now() < target.min(end);
        (self.playback.lag_s, self.playback.achieved) = (self.pace.lag_s(), self.pace.achieved());
        if self.source.now() < end {
            return;
        }
        if !self.playback.looping {
            self.playback.playing = false;
        } else if let Err(error) = self.go_to(info.start) {
            self.playback.error = Some(error.to_string());
            self.playback.playing = false;
        }
    }

    fn run_to(&mut self, target: Stamp, start: Instant) -> Result<(), SourceError> {
        loop {
            self.write_urgent();
            let now = self.source.now();
            for (buffer, message) in self.hands.take_due(now) {
                if let Err(error) = self.source.write(&buffer, message) {
                    self.hands.suspend(&buffer);
                    self.playback.error = Some(error.to_string());
                }
            }
            if now >= target || start.elapsed() >= BUDGET {
                return Ok(());
            }
            let piece = now.after_ns(self.pace.piece_ns());
            let to = target.min(piece).min(self.hands.next_due().unwrap_or(Stamp::MAX));
            let began = Instant::now();
            match self.work(|source, task| source.seek(to, task)) {
                // An emergency stop has interrupted: it is written at the current position of the source.
                Err(SourceError::Cancelled) if !self.shared.urgent().is_empty() => continue,
                done => done?,
            }
            if to == piece {
                self.pace.piece_took(began.elapsed(), BUDGET);
            }
            if self.source.now() <= now {
                // Nothing is left to do: the run has ended.
                return Ok(());
            }
        }
    }

    /// Does work that may take long, with progress that the window can show and cancel.
    fn work(
        &mut self,
        f: impl FnOnce(&mut dyn Source, &Task) -> Result<(), SourceError>,
    ) -> Result<(), SourceError> {
        let task = Arc::new(Task::default());
        *self.shared.task() = Some((Arc::clone(&task), Instant::now()));
        // A cancellation that was sent before the task existed.
        if !self.shared.urgent().is_empty() {
            task.cancel();
        }
        let result = f(&mut *self.source, &task);
        *self.shared.task() = None;
        result
    }
}

/// A number that differs where frames show different messages or states.
fn content(frame: &Frame) -> u64 {
    let mut hasher = DefaultHasher::new();
    for topic in frame.topics.iter() {
        let newest = topic.latest.as_ref().map(|sample| (sample.header.log_time, sample.header.sequence));
        (newest, topic.pending).hash(&mut hasher);
    }
    for comparison in frame.comparisons.iter() {
        (comparison.differences.len(), comparison.progress.is_some()).hash(&mut hasher);
    }
    let run = frame.runs.current().0;
    frame.recording.as_ref().map(|recording| (recording.bytes, &recording.ended)).hash(&mut hasher);
    (frame.topics.len(), run, &frame.playback.error, frame.playback.playing).hash(&mut hasher);
    hasher.finish()
}

/// Of several consecutive seeks only the last is executed, because users drag the timeline.
fn drop_overtaken_seeks(controls: &mut VecDeque<Control>) {
    let is_seek = |control: &Control| matches!(control, Control::Seek(_));
    let overtaken: Vec<bool> = (0..controls.len())
        .map(|i| is_seek(&controls[i]) && controls.get(i + 1).is_some_and(is_seek))
        .collect();
    let mut overtaken = overtaken.into_iter();
    controls.retain(|_| !overtaken.next().unwrap_or(false));
}
