//! How a driver keeps a source at the pace of the clock, and how held controls work.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use rcs_msg::{AnyMessage, Stamp, foxglove, rcs};
use rcs_runtime::RunId;
use rcs_runtime::source::{
    Compared, Comparison, Control, Driver, Frame, HeldControl, Source, SourceError, SourceInfo, SourceKind,
    Step, Task,
};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_mins(1);

/// What was written: buffer, time of the source, x.
type Written = Arc<Mutex<Vec<(String, Stamp, f64)>>>;

/// A source without an end that needs `cost` seconds of the clock for one of its own seconds.
struct Busy {
    now: Stamp,
    cost: f64,
    info: Arc<SourceInfo>,
    written: Written,
    /// Pieces of background work that are left to be done once it plays.
    left: Arc<Mutex<u32>>,
}

impl Busy {
    fn new(cost: f64) -> (Self, Written) {
        let written = Written::default();
        let info = SourceInfo { kind: SourceKind::Stack, title: "busy".to_owned(), ..SourceInfo::default() };
        let source = Self {
            now: Stamp(0),
            cost,
            info: Arc::new(info),
            written: Arc::clone(&written),
            left: Arc::default(),
        };
        (source, written)
    }
}

impl Source for Busy {
    fn info(&self) -> Arc<SourceInfo> {
        Arc::clone(&self.info)
    }

    fn now(&self) -> Stamp {
        self.now
    }

    fn frame(&mut self) -> Frame {
        let mut frame = Frame::empty(self.info(), self.now);
        frame.generation = self.written.lock().unwrap().len() as u64;
        frame
    }

    fn seek(&mut self, to: Stamp, _task: &Task) -> Result<(), SourceError> {
        std::thread::sleep(Duration::from_secs_f64(to.seconds_since(self.now).max(0.0) * self.cost));
        self.now = to;
        Ok(())
    }

    fn step(&mut self, _step: &Step, _task: &Task) -> Result<bool, SourceError> {
        Ok(false)
    }

    fn write(&mut self, buffer: &str, message: AnyMessage) -> Result<(), SourceError> {
        let x = message.get::<foxglove::Vector3>().map_or(f64::NAN, |vector| vector.x);
        self.written.lock().unwrap().push((buffer.to_owned(), self.now, x));
        Ok(())
    }

    fn idle(&mut self) -> bool {
        let mut left = self.left.lock().unwrap();
        if *left > 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
        if self.now > Stamp(0) {
            *left = left.saturating_sub(1);
        }
        *left > 0
    }
}

fn drive(cost: f64) -> (Driver, Written) {
    let (source, written) = Busy::new(cost);
    (Driver::spawn(Box::new(source), || {}).unwrap(), written)
}

#[track_caller]
fn wait(driver: &Driver, what: &str, is: impl Fn(&Frame) -> bool) -> Arc<Frame> {
    let start = Instant::now();
    loop {
        let frame = driver.frame();
        if is(&frame) {
            return frame;
        }
        assert!(start.elapsed() < PATIENCE, "waited in vain for {what}: {:?}", frame.playback);
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_source_that_cannot_keep_up_falls_behind_says_so_and_stays_responsive() {
    let (driver, _) = drive(4.0);
    driver.send(Control::Play);
    let slow = wait(&driver, "a lag of a second", |frame| frame.playback.lag_s > 1.0);
    let achieved = slow.playback.achieved.unwrap();
    assert!(achieved < 0.5, "a quarter of real time at most, got {achieved}");
    // The outstanding work has not grown with the delay: a pause takes effect at once.
    let asked = Instant::now();
    driver.send(Control::Pause);
    let paused = wait(&driver, "the pause", |frame| !frame.playback.playing);
    assert!(asked.elapsed() < Duration::from_secs(5), "{:?}", asked.elapsed());
    // A new start counts the delay from zero; the pause keeps it from growing until it is seen.
    driver.send(Control::Play);
    driver.send(Control::Pause);
    wait(&driver, "a new start", |frame| frame.playback.lag_s < paused.playback.lag_s);
}

#[test]
fn a_frame_says_from_where_it_has_played_without_a_jump() {
    let (driver, _) = drive(0.0);
    let at = |s: u64| Stamp(s * 1_000_000_000);
    driver.send(Control::Seek(at(5)));
    driver.send(Control::Play);
    wait(&driver, "time", |frame| frame.now > at(5));
    // Asked again while it plays, it goes on.
    driver.send(Control::Play);
    driver.send(Control::Speed(2.0));
    let frame = wait(&driver, "the speed", |frame| frame.playback.speed == 2.0);
    assert!(frame.playback.playing && frame.playback.from == at(5), "{:?}", frame.playback);
    driver.send(Control::Seek(at(900)));
    let frame = wait(&driver, "the seek", |frame| frame.now >= at(900));
    assert_eq!(frame.playback.from, at(900));
    driver.send(Control::Pause);
    let paused = wait(&driver, "the pause", |frame| !frame.playback.playing);
    driver.send(Control::Play);
    let frame = wait(&driver, "a new start", |frame| frame.playback.playing);
    assert_eq!(frame.playback.from, paused.now);
}

#[test]
fn as_fast_as_it_goes_leaves_the_clock_behind() {
    let (driver, _) = drive(0.01);
    driver.send(Control::Speed(f64::INFINITY));
    driver.send(Control::Play);
    let fast = wait(&driver, "speed", |frame| frame.playback.achieved.is_some_and(|speed| speed > 5.0));
    assert_eq!(fast.playback.lag_s, 0.0);
}

#[test]
fn background_work_goes_on_while_it_plays() {
    let (source, _) = Busy::new(0.01);
    let left = Arc::clone(&source.left);
    *left.lock().unwrap() = 20;
    let driver = Driver::spawn(Box::new(source), || {}).unwrap();
    driver.send(Control::Play);
    let frame = wait(&driver, "the work", |_| *left.lock().unwrap() == 0);
    assert!(frame.playback.playing, "{:?}", frame.playback);
}

/// A source that ends after 200 ms, and compares what it has done only when it has time for background work.
struct Comparer {
    busy: Busy,
    until: Stamp,
}

impl Source for Comparer {
    fn info(&self) -> Arc<SourceInfo> {
        Arc::new(SourceInfo { end: Some(Stamp(200_000_000)), ..(*self.busy.info).clone() })
    }

    fn now(&self) -> Stamp {
        self.busy.now
    }

    fn frame(&mut self) -> Frame {
        let comparison = Comparison {
            sides: [Compared::Run(RunId(0)), Compared::Other],
            differences: Arc::new([]),
            until: Some(self.until),
            progress: (self.until < self.busy.now).then_some(0.99),
            recording_ends: [None; 2],
            left_out: [0, 0],
            gaps: Arc::new([]),
            problem: None,
        };
        Frame { comparisons: Arc::new([comparison]), ..self.busy.frame() }
    }

    fn seek(&mut self, to: Stamp, task: &Task) -> Result<(), SourceError> {
        self.busy.seek(to, task)
    }

    fn step(&mut self, step: &Step, task: &Task) -> Result<bool, SourceError> {
        self.busy.step(step, task)
    }

    fn write(&mut self, buffer: &str, message: AnyMessage) -> Result<(), SourceError> {
        self.busy.write(buffer, message)
    }

    fn idle(&mut self) -> bool {
        self.until = self.busy.now;
        false
    }
}

#[test]
fn a_comparison_that_ends_after_playing_has_ended_is_shown_as_complete() {
    let (busy, _) = Busy::new(0.0);
    let driver = Driver::spawn(Box::new(Comparer { busy, until: Stamp(0) }), || {}).unwrap();
    driver.send(Control::Play);
    let end = Stamp(200_000_000);
    let frame = wait(&driver, "the end of the comparison", |frame| {
        frame.now == end && frame.comparisons.iter().all(|comparison| comparison.progress.is_none())
    });
    assert_eq!(frame.comparisons[0].until, Some(end));
    assert!(!frame.playback.playing, "{:?}", frame.playback);
}

/// Holds /hand at `x`, with fifty milliseconds of the source between messages.
fn hand(x: f64) -> HeldControl {
    HeldControl {
        buffer: "/hand".to_owned(),
        every_ns: 50_000_000,
        make: Arc::new(move |_| AnyMessage::new(foxglove::Vector3 { x, ..Default::default() })),
    }
}

#[test]
fn what_is_held_is_written_in_the_sources_time_until_let_go() {
    let (driver, written) = drive(0.01);
    let held = hand(1.0);
    driver.send(Control::Speed(4.0));
    driver.send(Control::Hold(held.clone()));
    driver.send(Control::Play);
    let start = Instant::now();
    while written.lock().unwrap().len() < 40 {
        assert!(start.elapsed() < PATIENCE);
        driver.send(Control::Hold(held.clone()));
        std::thread::sleep(Duration::from_millis(20));
    }
    driver.send(Control::LetGo(hand(0.0)));
    wait(&driver, "more time", |frame| frame.now > written.lock().unwrap()[39].1.after_ns(1_000_000_000));
    let written = written.lock().unwrap().clone();
    let (last, before) = written.split_last().unwrap();
    assert_eq!(last.2, 0.0, "the last message is that of letting go");
    assert!(before.iter().all(|(buffer, _, x)| buffer == "/hand" && *x == 1.0));
    // A stall of this thread may let the control lapse, but nothing comes sooner, however fast the source runs.
    let mut steps_ns = before.windows(2).map(|pair| pair[1].1.0 - pair[0].1.0);
    assert!(steps_ns.clone().all(|step_ns| step_ns >= 50_000_000), "{before:?}");
    assert!(steps_ns.any(|step_ns| step_ns == 50_000_000), "{before:?}");
}

#[test]
fn a_hand_that_nobody_speaks_for_lets_go() {
    let (driver, written) = drive(0.01);
    driver.send(Control::Hold(hand(1.0)));
    driver.send(Control::Play);
    let lapsed = Stamp(0).after_ns((HeldControl::LEASE.as_nanos() * 3) as u64);
    wait(&driver, "time to pass", |frame| frame.now > lapsed);
    let count = written.lock().unwrap().len();
    assert!(count > 0);
    wait(&driver, "more time to pass", |frame| frame.now > lapsed.after_ns(500_000_000));
    assert_eq!(written.lock().unwrap().len(), count, "nothing is written any more");
}

#[test]
fn going_back_ends_what_is_held_until_it_is_let_go_and_writes_nothing_there() {
    let (driver, written) = drive(0.01);
    let at = |ms: u64| Stamp(ms * 1_000_000);
    let held = hand(1.0);
    driver.send(Control::Hold(held.clone()));
    driver.send(Control::Play);
    wait(&driver, "time to pass", |frame| frame.now > at(200));
    driver.send(Control::Hold(held.clone()));
    driver.send(Control::Seek(at(100)));
    // The window has not seen the earlier time yet.
    driver.send(Control::Hold(held));
    wait(&driver, "the past", |frame| frame.playback.from == at(100) && frame.now > at(300));
    driver.send(Control::LetGo(hand(0.0)));
    driver.send(Control::Pause);
    wait(&driver, "the pause", |frame| !frame.playback.playing);
    let so_far = written.lock().unwrap().clone();
    assert!(so_far.iter().all(|(.., x)| *x == 1.0), "no last message: {so_far:?}");
    assert!(so_far.windows(2).all(|pair| pair[0].1 <= pair[1].1), "nothing in the past: {so_far:?}");
    driver.send(Control::Hold(hand(2.0)));
    driver.send(Control::Play);
    wait(&driver, "what is held anew", |_| written.lock().unwrap().iter().any(|(.., x)| *x == 2.0));
}

#[test]
fn nothing_is_written_while_time_stands() {
    let (driver, written) = drive(0.01);
    for _ in 0..10 {
        driver.send(Control::Hold(hand(1.0)));
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(written.lock().unwrap().is_empty());
}

/// A source whose seeks last until they are cancelled, and whose steps panic.
struct Slow {
    busy: Busy,
    seeks: Arc<Mutex<u32>>,
    /// While a test holds it, too, the past is read until that is interrupted.
    long_past: Arc<()>,
}

impl Source for Slow {
    fn info(&self) -> Arc<SourceInfo> {
        self.busy.info()
    }

    fn now(&self) -> Stamp {
        self.busy.now
    }

    fn frame(&mut self) -> Frame {
        self.busy.frame()
    }

    fn seek(&mut self, _to: Stamp, task: &Task) -> Result<(), SourceError> {
        *self.seeks.lock().unwrap() += 1;
        loop {
            task.check()?;
            std::thread::yield_now();
        }
    }

    fn step(&mut self, _step: &Step, _task: &Task) -> Result<bool, SourceError> {
        std::panic::panic_any("a step too far")
    }

    fn gather(&mut self, _fields: &[rcs_formula::FieldRef], is_interrupted: &dyn Fn() -> bool) -> bool {
        *self.seeks.lock().unwrap() += 1;
        while Arc::strong_count(&self.long_past) > 1 {
            if is_interrupted() {
                return false;
            }
            std::thread::yield_now();
        }
        true
    }

    fn write(&mut self, buffer: &str, message: AnyMessage) -> Result<(), SourceError> {
        self.busy.write(buffer, message)
    }

    fn undo(&mut self) -> Result<bool, SourceError> {
        self.busy.write("undone", AnyMessage::new(foxglove::Vector3::default())).map(|()| true)
    }

    fn switch_run(&mut self, run: RunId) -> Result<(), SourceError> {
        self.busy.write(&run.to_string(), AnyMessage::new(foxglove::Vector3::default()))
    }
}

fn slow() -> (Driver, Written, Arc<Mutex<u32>>, Arc<()>) {
    let (busy, written) = Busy::new(0.0);
    let (seeks, long_past) = (Arc::default(), Arc::default());
    let source = Slow { busy, seeks: Arc::clone(&seeks), long_past: Arc::clone(&long_past) };
    (Driver::spawn(Box::new(source), || {}).unwrap(), written, seeks, long_past)
}

fn write(buffer: &str, message: AnyMessage) -> Control {
    Control::Write { buffer: buffer.to_owned(), message }
}

fn stop() -> AnyMessage {
    AnyMessage::new(rcs::EmergencyStop { active: true, ..Default::default() })
}

#[test]
fn an_emergency_stop_ends_a_seek_and_goes_before_everything_that_waits() {
    let (driver, written, seeks, _) = slow();
    driver.send(Control::Seek(Stamp(1)));
    let start = Instant::now();
    while *seeks.lock().unwrap() == 0 {
        assert!(start.elapsed() < PATIENCE, "the seek never began");
    }
    // None of these is executed during the seek.
    driver.send(write("/other", AnyMessage::new(foxglove::Vector3::default())));
    driver.send(Control::Seek(Stamp(2)));
    driver.send(Control::Speed(2.0));
    driver.send(write("/stop", stop()));
    wait(&driver, "the rest", |frame| frame.playback.speed == 2.0);
    let written: Vec<_> = written.lock().unwrap().iter().map(|(buffer, ..)| buffer.clone()).collect();
    assert_eq!(written, ["/stop", "/other"]);
    assert_eq!(*seeks.lock().unwrap(), 1, "the seek that waited is gone");
}

#[test]
fn an_undo_and_another_run_that_wait_behind_an_emergency_stop_do_not_take_it_back() {
    let (driver, written, seeks, _) = slow();
    driver.send(Control::Seek(Stamp(1)));
    let start = Instant::now();
    while *seeks.lock().unwrap() == 0 {
        assert!(start.elapsed() < PATIENCE, "the seek never began");
    }
    driver.send(Control::Undo);
    driver.send(Control::SwitchRun(RunId(0)));
    driver.send(Control::Speed(2.0));
    driver.send(write("/stop", stop()));
    wait(&driver, "the rest", |frame| frame.playback.speed == 2.0);
    let written: Vec<_> = written.lock().unwrap().iter().map(|(buffer, ..)| buffer.clone()).collect();
    assert_eq!(written, ["/stop"]);
}

#[test]
fn an_emergency_stop_comes_before_the_past_of_a_curve_however_often_it_is_sent_again() {
    let (driver, written, reads, long_past) = slow();
    driver.send(Control::Gather(Vec::new()));
    let start = Instant::now();
    while *reads.lock().unwrap() == 0 {
        assert!(start.elapsed() < PATIENCE, "the past is never read");
    }
    driver.send(Control::Speed(2.0));
    while driver.frame().generation == 0 || driver.frame().playback.speed != 2.0 {
        assert!(start.elapsed() < PATIENCE, "no frame has the stop and what waited behind it");
        driver.send(write("/stop", stop()));
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(written.lock().unwrap().iter().all(|(buffer, ..)| buffer == "/stop"));
    drop(long_past);
    wait(&driver, "the past to be read again", |_| *reads.lock().unwrap() > 1);
}

#[test]
fn an_emergency_stop_while_time_runs_is_written_and_time_runs_on() {
    let (driver, written) = drive(0.5);
    driver.send(Control::Play);
    wait(&driver, "time", |frame| frame.now > Stamp(20_000_000));
    driver.send(write("/stop", stop()));
    let stopped_at = wait(&driver, "the stop", |_| !written.lock().unwrap().is_empty()).now;
    let frame = wait(&driver, "time to run on", |frame| frame.now > stopped_at.after_ns(50_000_000));
    assert!(frame.playback.playing && frame.playback.error.is_none(), "{:?}", frame.playback);
}

#[test]
fn a_panic_of_the_source_shows_in_the_frame_and_nothing_plays_any_more() {
    let (driver, ..) = slow();
    let before = driver.frame().generation;
    driver.send(Control::Step(Step::Time { ns: 1 }));
    let frame = wait(&driver, "the end", |frame| frame.playback.error.is_some());
    let error = frame.playback.error.as_deref().unwrap();
    assert_eq!(error, "the source has ended: its thread panicked: a step too far");
    assert!(!frame.playback.playing && frame.generation > before && driver.busy().is_none());
    // Further requests have no effect, and the error stays.
    driver.send(Control::Play);
    driver.send(write("/stop", stop()));
    assert_eq!(driver.frame().playback.error.as_deref(), Some(error));
}
