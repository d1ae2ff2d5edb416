//! A source on a thread of its own: paced, stepped and written to by messages, looked at through frames.

use super::frame::{Frame, Playback};
use super::{Source, SourceError, Step, Task};
use rcs_msg::{AnyMessage, Stamp};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What an operator asks of a source.
#[derive(Clone, Debug)]
pub enum Control {
    /// Let time run.
    Play,
    /// Stop time.
    Pause,
    /// Seconds of the source a second.
    Speed(f64),
    /// Start again at the end.
    Loop(bool),
    /// Go to a time.
    Seek(Stamp),
    /// Go one step.
    Step(Step),
    /// Write a message into a buffer.
    Write {
        /// Its name.
        buffer: String,
        /// The message.
        message: AnyMessage,
    },
    /// Stop long work.
    Cancel,
}

/// Time between frames while playing.
const FRAME: Duration = Duration::from_millis(16);
/// Slower than this, background work shows what it has found so far.
const SHOW_IDLE: Duration = Duration::from_millis(250);

/// A source on a thread of its own. Dropping it ends the thread.
pub struct Driver {
    shared: Arc<Shared>,
    controls: Option<Sender<Control>>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    frame: Mutex<Arc<Frame>>,
    /// The work that is going on.
    task: Mutex<Option<(Arc<Task>, Instant)>>,
}

impl Driver {
    /// Takes a source over. `wake` is called whenever there is a new frame.
    pub fn spawn(mut source: Box<dyn Source>, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let shared = Arc::new(Shared { frame: Mutex::new(Arc::new(source.frame())), task: Mutex::new(None) });
        let (controls, receiver) = channel();
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("source".to_owned()).spawn(move || {
            Pacer { source, shared: theirs, wake, playback: Playback::default(), anchor: None }
                .run(&receiver);
        })?;
        Ok(Self { shared, controls: Some(controls), thread: Some(thread) })
    }

    /// The newest frame. Never waits for the source.
    pub fn frame(&self) -> Arc<Frame> {
        Arc::clone(&self.shared.frame.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// How far long work is, 0 to 1; `None` where there is none that a person would notice.
    pub fn busy(&self) -> Option<f64> {
        let task = self.shared.task.lock().unwrap_or_else(PoisonError::into_inner);
        task.as_ref()
            .filter(|(_, since)| since.elapsed() > Duration::from_millis(100))
            .map(|(task, _)| task.fraction())
    }

    /// Asks something of the source. [`Control::Cancel`] acts at once, everything else in turn.
    pub fn send(&self, control: Control) {
        if matches!(control, Control::Cancel) {
            if let Some((task, _)) = &*self.shared.task.lock().unwrap_or_else(PoisonError::into_inner) {
                task.cancel();
            }
            return;
        }
        if let Some(controls) = &self.controls {
            // The thread ends only with the driver.
            let _ = controls.send(control);
        }
    }
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

struct Pacer<W> {
    source: Box<dyn Source>,
    shared: Arc<Shared>,
    wake: W,
    playback: Playback,
    /// Where playing began: a moment of the clock and of the source.
    anchor: Option<(Instant, Stamp)>,
}

impl<W: Fn()> Pacer<W> {
    fn run(mut self, controls: &Receiver<Control>) {
        let mut idle = true;
        let mut shown = Instant::now();
        loop {
            let wait = if self.playback.playing {
                FRAME
            } else if idle {
                Duration::ZERO
            } else {
                Duration::MAX
            };
            let first = match controls.recv_timeout(wait) {
                Ok(control) => Some(control),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => return,
            };
            let mut changed = first.is_some();
            let mut pending: Vec<Control> = first.into_iter().collect();
            loop {
                match controls.try_recv() {
                    Ok(control) => pending.push(control),
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => return,
                }
            }
            drop_overtaken_seeks(&mut pending);
            for control in pending {
                self.obey(control);
            }
            if self.playback.playing {
                self.play_on();
                changed = true;
            } else if idle {
                idle = self.source.idle();
                if !idle || shown.elapsed() > SHOW_IDLE {
                    changed = true;
                }
            }
            if changed {
                shown = Instant::now();
                self.show();
            }
        }
    }

    fn show(&mut self) {
        let mut frame = self.source.frame();
        frame.playback = self.playback.clone();
        *self.shared.frame.lock().unwrap_or_else(PoisonError::into_inner) = Arc::new(frame);
        (self.wake)();
    }

    fn obey(&mut self, control: Control) {
        let result = match control {
            Control::Play => {
                self.playback.playing = true;
                self.anchor = None;
                let info = self.source.info();
                if info.end.is_some_and(|end| self.source.now() >= end) {
                    self.work(|source, task| source.seek(info.start, task))
                } else {
                    Ok(())
                }
            }
            Control::Pause => {
                self.playback.playing = false;
                Ok(())
            }
            Control::Speed(speed) => {
                if speed.is_finite() && speed > 0.0 {
                    self.playback.speed = speed;
                }
                self.anchor = None;
                Ok(())
            }
            Control::Loop(looping) => {
                self.playback.looping = looping;
                Ok(())
            }
            Control::Seek(to) => {
                self.anchor = None;
                self.work(|source, task| source.seek(to, task))
            }
            Control::Step(step) => {
                self.playback.playing = false;
                self.work(|source, task| source.step(&step, task).map(|_| ()))
            }
            Control::Write { buffer, message } => self.source.write(&buffer, message),
            // It has acted already, in `Driver::send`.
            Control::Cancel => return,
        };
        self.playback.error = result.err().map(|error| error.to_string());
    }

    fn play_on(&mut self) {
        let now = self.source.now();
        let (clock, from) = *self.anchor.get_or_insert((Instant::now(), now));
        let ahead_ns = clock.elapsed().as_secs_f64() * self.playback.speed * 1e9;
        let target = from.after_ns(ahead_ns as u64);
        let info = self.source.info();
        let end = info.end.unwrap_or(Stamp::MAX);
        // Never try to do more in one piece than what keeps the window alive: fall behind instead, and say so.
        let piece = now.after_ns((100e6 * self.playback.speed.max(0.1)) as u64);
        let to = target.min(end).min(piece);
        if to > now
            && let Err(error) = self.work(|source, task| source.seek(to, task))
        {
            self.playback.error = Some(error.to_string());
            self.playback.playing = false;
        }
        self.playback.lag_s = target.min(end).seconds_since(self.source.now()).max(0.0);
        if self.source.now() >= end {
            if self.playback.looping {
                self.anchor = None;
                if let Err(error) = self.work(|source, task| source.seek(info.start, task)) {
                    self.playback.error = Some(error.to_string());
                    self.playback.playing = false;
                }
            } else {
                self.playback.playing = false;
            }
        }
    }

    /// Does work that may take long, and lets the window see how far it is and stop it.
    fn work(
        &mut self,
        f: impl FnOnce(&mut dyn Source, &Task) -> Result<(), SourceError>,
    ) -> Result<(), SourceError> {
        let task = Arc::new(Task::default());
        let slot =
            |shared: &Shared, value| *shared.task.lock().unwrap_or_else(PoisonError::into_inner) = value;
        slot(&self.shared, Some((Arc::clone(&task), Instant::now())));
        let result = f(&mut *self.source, &task);
        slot(&self.shared, None);
        result
    }
}

/// Of several seeks in a row only the last matters: a person drags the time.
fn drop_overtaken_seeks(controls: &mut Vec<Control>) {
    let is_seek = |control: &Control| matches!(control, Control::Seek(_));
    let overtaken: Vec<bool> = (0..controls.len())
        .map(|i| is_seek(&controls[i]) && controls.get(i + 1).is_some_and(is_seek))
        .collect();
    let mut overtaken = overtaken.into_iter();
    controls.retain(|_| !overtaken.next().unwrap_or(false));
}
