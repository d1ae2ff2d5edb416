//! Alarms that can be heard: two tones for a new error of the run, again while nobody has acknowledged it.
//!
//! The tones go to a player of the system (`pw-cat`, `paplay`, `aplay`). Where there is none, or no sound device, the
//! window stays silent, and the list of alarms says so.

use super::known_alarms::KnownAlarms;
use rcs_msg::Stamp;
use rcs_runtime::source::{Frame, SourceKind};
use std::io::Write;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time between two sounds for the same alarms.
const AGAIN: Duration = Duration::from_secs(5);
/// Least time between two sounds.
const LEAST: Duration = Duration::from_secs(1);
const RATE_HZ: u32 = 22_050;
/// Players that read 16-bit samples from their input, with their arguments.
const PLAYERS: [(&str, &[&str]); 3] = [
    ("pw-cat", &["--playback", "--raw", "--format", "s16", "--rate", "22050", "--channels", "1", "-"]),
    ("paplay", &["--raw", "--format=s16le", "--rate=22050", "--channels=1"]),
    ("aplay", &["-q", "-t", "raw", "-f", "S16_LE", "-r", "22050", "-c", "1", "-"]),
];

/// The sound of alarms.
#[derive(Debug)]
pub(super) struct AlarmSound {
    /// Whether the user has switched it off.
    is_off: bool,
    /// The alarms that are silenced.
    silenced: KnownAlarms,
    /// Time of the newest alarm that was heard, and when that was.
    heard: Option<(Stamp, Instant)>,
    /// Whether no player could be started.
    is_mute: Arc<AtomicBool>,
    /// Plays the tones, and says whether no player could be started; tests replace it.
    play: fn(Arc<AtomicBool>),
}

impl Default for AlarmSound {
    fn default() -> Self {
        Self { is_off: false, silenced: KnownAlarms::default(), heard: None, is_mute: Arc::default(), play }
    }
}

impl AlarmSound {
    /// Resets the state for another source; whether it is off stays.
    pub(super) fn forget(&mut self) {
        (self.silenced, self.heard) = (KnownAlarms::default(), None);
    }

    /// Whether it is switched on.
    pub(super) fn is_on(&self) -> bool {
        !self.is_off
    }

    /// Switches it on or off.
    pub(super) fn switch(&mut self) {
        self.is_off = !self.is_off;
    }

    /// Silences the alarms of the viewed run up to now; later ones, and those that only other runs have, are heard.
    pub(super) fn silence(&mut self, frame: &Frame) {
        self.silenced.know(&frame.runs, newest(frame).unwrap_or_default());
    }

    /// Whether this computer has nothing to play a sound with.
    pub(super) fn is_mute(&self) -> bool {
        self.is_mute.load(Ordering::Relaxed)
    }

    /// Plays the sound if an alarm is due; `known_until` is the time up to which alarms are acknowledged.
    pub(super) fn sound(&mut self, ctx: &egui::Context, frame: &Frame, known_until: Stamp) {
        // A recording, and the past of a run, alarm nobody.
        let is_live = frame.info.kind != SourceKind::Log && frame.playback.playing && frame.runs.is_at_end;
        let Some(newest) = newest(frame).filter(|newest| is_live && *newest > known_until) else { return };
        if newest <= self.silenced.until(&frame.runs) || self.is_off {
            return;
        }
        if self.is_due(newest, Instant::now()) {
            (self.play)(Arc::clone(&self.is_mute));
        }
        ctx.request_repaint_after(AGAIN);
    }

    /// Whether the newest alarm is to be heard now.
    fn is_due(&mut self, newest: Stamp, now: Instant) -> bool {
        let is_due = self.heard.is_none_or(|(known, at)| {
            // That of another run may be earlier.
            let wait = if newest == known { AGAIN } else { LEAST };
            now.saturating_duration_since(at) >= wait
        });
        if is_due {
            self.heard = Some((newest, now));
        }
        is_due
    }
}

/// Time of the newest alarm up to the viewed time.
fn newest(frame: &Frame) -> Option<Stamp> {
    Some(frame.events()?.last_alarms(frame.now, 1).first()?.stamp)
}

/// Plays the tones on a thread of its own, with the first player that can.
fn play(is_mute: Arc<AtomicBool>) {
    let played = std::thread::Builder::new().name("alarm".to_owned()).spawn(move || {
        let samples = tones();
        let is_played = PLAYERS.iter().any(|(player, args)| {
            let child = Command::new(player)
                .args(*args)
                .stdin(Stdio::piped())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn();
            let Ok(mut child) = child else { return false };
            // A player without a device closes its input early; its status says so.
            let _ = child.stdin.take().map(|mut input| input.write_all(&samples));
            child.wait().is_ok_and(|status| status.success())
        });
        is_mute.store(!is_played, Ordering::Relaxed);
    });
    if let Err(error) = played {
        tracing::debug!("no thread for the sound of an alarm: {error}");
    }
}

/// Two tones with soft edges, 16-bit little-endian samples.
fn tones() -> Vec<u8> {
    let mut samples = Vec::new();
    for frequency_hz in [880.0, 660.0] {
        let count = RATE_HZ / 5;
        for index in 0..count {
            let time_s = f64::from(index) / f64::from(RATE_HZ);
            let edge = f64::from(index.min(count - index)) / f64::from(RATE_HZ / 100);
            let level = 0.4 * edge.min(1.0) * (std::f64::consts::TAU * frequency_hz * time_s).sin();
            samples.extend_from_slice(&((level * f64::from(i16::MAX)) as i16).to_le_bytes());
        }
    }
    samples
}

#[cfg(test)]
mod tests {
    use super::super::body::{Options, Shown, Window};
    use super::*;
    use rcs_msg::AnyMessage;
    use rcs_runtime::source::{
        Control, Driver, Event, EventKind, EventLevel, Events, RunTag, Runs, Source, SourceError, SourceInfo,
        Step, Task,
    };
    use std::sync::atomic::AtomicUsize;

    /// A run at this time, with an alarm 10 ns after its start.
    struct Failing(Stamp);

    impl Source for Failing {
        fn info(&self) -> Arc<SourceInfo> {
            Arc::new(SourceInfo { kind: SourceKind::Stack, ..SourceInfo::default() })
        }

        fn now(&self) -> Stamp {
            self.0
        }

        fn frame(&mut self) -> Frame {
            let (kind, level) = (EventKind::Error, EventLevel::Error);
            let alarm =
                Event { stamp: Stamp(10), kind, level, source: "process".into(), text: "fails".into() };
            let events = Arc::new([Events::of(RunTag::FIRST, [alarm])]);
            let runs = Runs { is_at_end: true, ..Runs::default() };
            Frame { events, runs, ..Frame::empty(self.info(), self.now()) }
        }

        fn seek(&mut self, to: Stamp, _task: &Task) -> Result<(), SourceError> {
            self.0 = to;
            Ok(())
        }

        fn step(&mut self, _step: &Step, _task: &Task) -> Result<bool, SourceError> {
            Ok(false)
        }

        fn write(&mut self, _buffer: &str, _message: AnyMessage) -> Result<(), SourceError> {
            Ok(())
        }
    }

    #[test]
    fn an_alarm_is_heard_while_the_window_is_hidden_and_nothing_is_painted() {
        static SOUNDS: AtomicUsize = AtomicUsize::new(0);
        let ctx = egui::Context::default();
        ocu_ui::install(&ctx);
        let mut window = Window::new(&ctx, Options::default());
        window.alarm_sound.play = |_| {
            SOUNDS.fetch_add(1, Ordering::Relaxed);
        };
        let driver = Driver::spawn(Box::new(Failing(Stamp(20))), || {}).unwrap();
        driver.send(Control::Play);
        window.shown = Shown::Live(driver);
        let start = Instant::now();
        while SOUNDS.load(Ordering::Relaxed) == 0 {
            assert!(start.elapsed() < Duration::from_mins(1), "no sound");
            window.logic(&ctx);
            std::thread::yield_now();
        }
        window.logic(&ctx);
        assert_eq!(SOUNDS.load(Ordering::Relaxed), 1, "again only after some seconds");
    }

    #[test]
    fn a_new_alarm_is_heard_at_once_and_an_old_one_again_after_a_while() {
        let mut sound = AlarmSound::default();
        let start = Instant::now();
        let after = |ms: u64| start + Duration::from_millis(ms);
        let due = [(10, 0), (10, 500), (11, 700), (11, 1_200), (11, 5_000), (11, 6_300)]
            .map(|(newest, ms)| sound.is_due(Stamp(newest), after(ms)));
        assert_eq!(due, [true, false, false, true, false, true]);
    }

    #[test]
    fn the_tones_are_short_and_do_not_clip() {
        let samples: Vec<i16> =
            tones().chunks_exact(2).map(|pair| i16::from_le_bytes([pair[0], pair[1]])).collect();
        assert_eq!(samples.len(), 2 * (RATE_HZ as usize / 5));
        let most = samples.iter().map(|sample| sample.unsigned_abs()).max().unwrap();
        assert!((8_000..20_000).contains(&most), "{most}");
        assert_eq!(samples[0], 0);
    }
}
