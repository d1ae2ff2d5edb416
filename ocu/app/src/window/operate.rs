//! Manual driving and the emergency stop: converts keys and joystick to controls for the source.

use super::joystick::Joystick;
use super::keymap::Keymap;
use egui::Key;
use ocu_ui::{stale, typing};
use ocu_views::Selection;
use ocu_views::operator::{self, DriveLimits, Hand, Inputs};
use rcs_msg::{Stamp, rcs};
use rcs_runtime::Moment;
use rcs_runtime::source::{Control, Frame, HeldControl, Topic};
use std::time::{Duration, Instant};

/// Interval at which a held command is repeated.
const RENEW: Duration = Duration::from_millis(100);
/// Interval at which an unconfirmed emergency stop is sent again.
const RESEND: Duration = Duration::from_millis(500);
/// After this time, a missing confirmation is shown as an alarm.
const LATE: Duration = Duration::from_secs(1);
/// After this time of the run, a vehicle that obeys a stop and still rolls is shown as an alarm, s.
const ROLLS_ON_S: f64 = 3.0;
/// Slower than this, a vehicle stands, m/s.
const STANDS_MPS: f64 = 0.05;
/// The keys that drive.
const DRIVE_KEYS: [Key; 4] = [Key::W, Key::A, Key::S, Key::D];

/// State of the emergency stop, from the user's request and the vehicle's status.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum StopState {
    /// No process has an emergency stop.
    #[default]
    None,
    /// The vehicle may move.
    Clear,
    /// The vehicle reports that it obeys the stop, and still rolls.
    Braking {
        /// Whether it has rolled on for too long.
        late: bool,
    },
    /// The vehicle reports that it obeys the stop, and does not report that it moves.
    Stopped {
        /// Whether it reports a speed, by which it stands.
        has_speed: bool,
    },
    /// The stop (or its release) was requested, and the vehicle has not confirmed it yet, or not lately.
    Asked {
        /// Whether a stop was requested, rather than a release.
        active: bool,
        /// Whether the confirmation is overdue.
        late: bool,
        /// Whether time stands, so that the vehicle cannot confirm it yet.
        waits: bool,
    },
}

impl StopState {
    /// Whether the user can ask for its release.
    pub(super) fn can_be_released(self) -> bool {
        matches!(self, StopState::Braking { .. } | StopState::Stopped { .. })
    }
}

/// A request that the vehicle has not confirmed. It holds from one moment of a run on. At other moments, which the user
/// looks at or plays, it is not shown, and it is not sent again.
#[derive(Debug)]
struct Asked {
    /// Whether a stop was requested, rather than a release.
    active: bool,
    /// The moment from which it holds: the one that was viewed at the request, then the one at which the run has the
    /// message.
    from: Moment,
    /// Whether the run has the message.
    has_arrived: bool,
    /// Time in the last message that was sent.
    stamp: Stamp,
    /// Time of the request, if the vehicle may still be about to confirm one for the contrary: a report of before says
    /// nothing.
    newer_than: Option<Stamp>,
    /// Since when the vehicle could have confirmed it.
    since: Instant,
    /// When it was last sent.
    sent: Instant,
}

impl Asked {
    fn new(frame: &Frame, active: bool, now: Instant) -> Self {
        let (from, stamp) = (frame.runs.moment, frame.now);
        Self { active, from, has_arrived: false, stamp, newer_than: None, since: now, sent: now }
    }

    /// Whether it holds at the viewed moment.
    fn holds(&self, frame: &Frame) -> bool {
        has_passed(frame, self.from)
    }

    /// Whether the vehicle says at the viewed moment that it does what was requested.
    fn is_confirmed(&self, frame: &Frame) -> bool {
        operator::vehicle(frame).is_some_and(|(topic, status)| {
            let at = topic.latest.as_ref().map(|latest| latest.header.log_time);
            let is_newer = self.newer_than.is_none_or(|than| at > Some(than));
            status.emergency_stopped == self.active && is_newer && !is_silent(frame, topic)
        })
    }

    /// Looks for the message in the run. If the user has just gone elsewhere, it may be at another moment than the
    /// viewed one.
    fn find(&mut self, frame: &Frame) {
        let is_it = |newest: &rcs::EmergencyStop| {
            newest.active == self.active && newest.timestamp == Some(self.stamp.to_proto())
        };
        if !self.has_arrived && newest_message(frame).is_some_and(is_it) {
            (self.from, self.has_arrived) = (frame.runs.moment, true);
        }
    }

    /// Whether it is sent again at a moment at which it holds. A message that the run has is not sent again in the past,
    /// because it would begin another run.
    fn is_repeated(&self, frame: &Frame) -> bool {
        frame.runs.is_at_end || !self.has_arrived
    }

    /// No confirmation can come now, so the time until it is overdue begins later. A message that the run has takes
    /// effect by itself when time runs.
    fn wait(&mut self, now: Instant) {
        self.since = now;
        if self.has_arrived {
            self.sent = now;
        }
    }
}

/// State of manual operation.
#[derive(Debug, Default)]
pub(super) struct Operating {
    /// The command being held, and the deflection from which it was made.
    held: Option<([f64; 2], HeldControl)>,
    asked: Option<Asked>,
    /// Since when the vehicle has rolled on although it reports that it obeys the stop.
    braking_since: Option<Stamp>,
    joystick: Joystick,
    /// Whether the controls must be neutral before they drive: after a stop, a pause and a jump in time, and at the
    /// start.
    wait_for_neutral: bool,
    /// Whether a control was deflected in the last pass.
    pushed: bool,
    /// Whether a drive key was typed, as a text or with a modifier, or was down before the window got the focus, and
    /// not all of them have been let go since.
    has_typed: bool,
}

impl Operating {
    /// Resets the state for another source.
    pub(super) fn forget(&mut self) {
        (self.held, self.asked, self.braking_since) = (None, None, None);
        (self.wait_for_neutral, self.pushed) = (true, false);
    }

    /// Whether a control is deflected that must be let go before anything drives.
    pub(super) fn is_blocked(&self) -> bool {
        self.wait_for_neutral && self.pushed
    }

    /// Whether a control is deflected.
    pub(super) fn is_pushed(&self) -> bool {
        self.pushed
    }

    /// The deflection from keys and joystick.
    pub(super) fn take_keys(&mut self, ui: &egui::Ui, frame: &Frame, keymap: &Keymap) -> Hand {
        let inputs = Inputs::of(frame);
        if inputs.teleop.is_none() {
            return Hand::default();
        }
        self.joystick.start(ui.ctx());
        let types = types(ui) || keymap.is_from_elsewhere(&DRIVE_KEYS);
        let is_key_down = ui.input(|input| DRIVE_KEYS.iter().any(|&key| input.key_down(key)));
        // A key that is still down when the text, the modifier or another window is left must not start motion.
        self.has_typed = is_key_down && (types || self.has_typed);
        let keys = if types || self.has_typed { Hand::default() } else { keys(ui) };
        keys.with(self.joystick.hand())
    }

    /// Requests an emergency stop, or its release.
    pub(super) fn emergency_stop(&mut self, frame: &Frame, active: bool, controls: &mut Vec<Control>) {
        let now = Instant::now();
        let again = self.asked.as_mut().filter(|asked| asked.active == active && asked.holds(frame));
        if let Some(asked) = again {
            (asked.stamp, asked.sent) = (frame.now, now);
        } else {
            let newer_than = self.asked.as_ref().filter(|asked| asked.holds(frame)).map(|_| frame.now);
            self.asked = Some(Asked { newer_than, ..Asked::new(frame, active, now) });
        }
        send(frame, active, controls);
    }

    /// State of the emergency stop at the viewed moment.
    pub(super) fn stop_state(&self, frame: &Frame) -> StopState {
        if Inputs::of(frame).emergency_stop.is_none() {
            return StopState::None;
        }
        match self.asked.as_ref().filter(|asked| asked.holds(frame)) {
            Some(asked) if !asked.is_confirmed(frame) => StopState::Asked {
                active: asked.active,
                late: frame.playback.playing && asked.since.elapsed() > LATE,
                waits: !frame.playback.playing,
            },
            _ => match operator::vehicle(frame) {
                Some((topic, status)) if status.emergency_stopped => {
                    let speed_mps = status.speed_mps.abs();
                    if is_silent(frame, topic) {
                        StopState::Asked { active: true, late: true, waits: false }
                    } else if speed_mps >= STANDS_MPS {
                        let braked_s = self.braking_since.map_or(0.0, |since| frame.now.seconds_since(since));
                        StopState::Braking { late: braked_s > ROLLS_ON_S }
                    } else {
                        StopState::Stopped { has_speed: !speed_mps.is_nan() }
                    }
                }
                _ => StopState::Clear,
            },
        }
    }

    /// Called after each pass: sends the drive command for the deflection, and repeats an unconfirmed stop.
    pub(super) fn finish(
        &mut self,
        ui: &egui::Ui,
        frame: &Frame,
        selection: &Selection,
        controls: &mut Vec<Control>,
    ) {
        self.repeat(ui, frame, controls);
        let inputs = Inputs::of(frame);
        let may_drive =
            frame.playback.playing && matches!(self.stop_state(frame), StopState::None | StopState::Clear);
        self.pushed = selection.hand.pushes();
        // Releasing a stop, or letting time run, must not start motion because a control is still deflected; nor must
        // looking back, which would begin another run.
        let goes_elsewhere = controls.iter().any(Control::goes_elsewhere);
        self.note_braking(frame, goes_elsewhere);
        self.wait_for_neutral = !may_drive || goes_elsewhere || (self.wait_for_neutral && self.pushed);
        let teleop = inputs.teleop.filter(|_| self.pushed && !self.wait_for_neutral);
        let Some(teleop) = teleop else {
            if let Some((_, held)) = self.held.take() {
                controls.push(Control::LetGo(operator::drive(&held.buffer, [0.0; 2])));
            }
            return;
        };
        let wanted = selection.drive.within(DriveLimits::of(frame)).wanted(selection.hand);
        let held = match &self.held {
            Some((same, held)) if *same == wanted && *held.buffer == *teleop => held.clone(),
            _ => operator::drive(&teleop, wanted),
        };
        self.held = Some((wanted, held.clone()));
        controls.push(Control::Hold(held));
        ui.ctx().request_repaint_after(RENEW);
    }

    /// Notes since when the vehicle has rolled on. After a jump in time, that begins again.
    fn note_braking(&mut self, frame: &Frame, goes_elsewhere: bool) {
        let is_braking = matches!(self.stop_state(frame), StopState::Braking { .. }) && !goes_elsewhere;
        let known = self.braking_since.filter(|since| *since <= frame.now);
        self.braking_since = is_braking.then(|| known.unwrap_or(frame.now));
    }

    /// Repeats a request until the vehicle confirms it.
    fn repeat(&mut self, ui: &egui::Ui, frame: &Frame, controls: &mut Vec<Control>) {
        let Some(asked) = &mut self.asked else { return };
        asked.find(frame);
        let holds = asked.holds(frame);
        if holds && asked.is_confirmed(frame) {
            self.asked = None;
        } else if !holds || !frame.playback.playing {
            asked.wait(Instant::now());
        } else if asked.is_repeated(frame) {
            ui.ctx().request_repaint_after(RESEND);
            if asked.sent.elapsed() >= RESEND {
                (asked.stamp, asked.sent) = (frame.now, Instant::now());
                send(frame, asked.active, controls);
            }
        }
    }
}

/// Whether the viewed run has passed a moment, of its own or of a run that it branched from after that moment.
fn has_passed(frame: &Frame, moment: Moment) -> bool {
    let mut at = frame.runs.moment;
    while at.run > moment.run {
        let branched = frame.runs.all.get(at.run.0 as usize).and_then(|run| run.branched_from);
        let Some((from, _)) = branched.filter(|(from, _)| from.run < at.run) else { return false };
        // A moment before the branch is shared with the other run.
        let (event, write) = (at.event, at.write).min((from.event, from.write));
        at = Moment { run: from.run, event, write };
    }
    at.run == moment.run && at >= moment
}

/// The newest message of the emergency stop at the viewed moment.
fn newest_message(frame: &Frame) -> Option<&rcs::EmergencyStop> {
    let buffer = Inputs::of(frame).emergency_stop?;
    frame.topic(&buffer)?.get()
}

/// Whether the vehicle has said nothing for so long that its last report is no confirmation: more than three periods,
/// and at least 1.2 s. While time stands and in the past, no report is missed.
fn is_silent(frame: &Frame, topic: &Topic) -> bool {
    let is_due = frame.playback.playing && frame.runs.is_at_end && !topic.pending;
    is_due && is_overdue(topic, frame.now)
}

/// Whether the newest message is older than its rate allows.
pub(super) fn is_overdue(topic: &Topic, now: Stamp) -> bool {
    let limit_s = topic.due_hz().and_then(stale::limit_s).unwrap_or(stale::LEAST_S);
    topic.age_s(now).is_some_and(|age_s| age_s > limit_s)
}

fn send(frame: &Frame, active: bool, controls: &mut Vec<Control>) {
    if let Some(buffer) = Inputs::of(frame).emergency_stop {
        let message = operator::emergency_stop(frame.now, active);
        controls.push(Control::Write { buffer: buffer.to_string(), message });
    }
}

/// Whether keys are typed, as a text or as a command, or would be in an open menu or dialog.
fn types(ui: &egui::Ui) -> bool {
    typing::takes_keys(ui.ctx()) || ui.input(|input| input.modifiers.command || input.modifiers.alt)
}

/// The deflection from held keys. Arrow keys never drive: they step.
fn keys(ui: &egui::Ui) -> Hand {
    ui.input(|input| {
        let axis = |plus: Key, minus: Key| {
            f64::from(i8::from(input.key_down(plus)) - i8::from(input.key_down(minus)))
        };
        Hand { forward: axis(Key::W, Key::S), left: axis(Key::A, Key::D), slow: input.modifiers.shift }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_bus::{Header, Sample, WriterId};
    use rcs_msg::{AnyMessage, schema_of};
    use rcs_runtime::source::{RunTag, Runs, SourceInfo, SourceKind};
    use rcs_runtime::{InputRole, RunId, RunSummary};
    use std::sync::Arc;

    fn moment(run: u32, event: u64, write: u32) -> Moment {
        Moment { run: RunId(run), event, write }
    }

    /// A moment of a source with three runs: run 1 began in run 0 after 100 events, run 2 in run 1 after 150.
    fn frame(at: Moment) -> Frame {
        let info = SourceInfo { kind: SourceKind::Stack, ..SourceInfo::default() };
        let began = [None, Some(moment(0, 100, 0)), Some(moment(1, 150, 2))];
        let runs = began.into_iter().zip(0..).map(|(from, id)| RunSummary {
            id: RunId(id),
            branched_from: from.map(|from| (from, Stamp(from.event))),
            end: Stamp(200),
            events: 200,
            writes: 1,
        });
        let runs = Runs { all: runs.collect(), moment: at, ..Runs::default() };
        Frame { runs, ..Frame::empty(Arc::new(info), Stamp(at.event)) }
    }

    #[test]
    fn a_moment_is_passed_in_its_run_and_in_those_that_branched_from_it_later() {
        for (passed, viewed, is_passed) in [
            ((0, 80, 1), (0, 80, 1), true),
            ((0, 80, 1), (0, 81, 0), true),
            ((0, 80, 1), (0, 80, 0), false),
            ((0, 80, 1), (2, 160, 0), true),
            ((0, 80, 1), (2, 79, 0), false),
            ((0, 100, 1), (1, 180, 0), false),
            ((0, 100, 0), (1, 100, 1), true),
            ((1, 120, 0), (2, 130, 0), true),
            ((1, 151, 0), (2, 160, 0), false),
            ((1, 120, 0), (0, 180, 0), false),
        ] {
            let of = |(run, event, write): (u32, u64, u32)| moment(run, event, write);
            assert_eq!(has_passed(&frame(of(viewed)), of(passed)), is_passed, "{passed:?} at {viewed:?}");
        }
    }

    /// A moment at which the last report of the vehicle, the only one, is `age_s` old.
    fn reported(emergency_stopped: bool, speed_mps: f64, age_s: f64) -> Frame {
        let role = InputRole::EmergencyStop.name().to_owned();
        let input = rcs::PortInfo { buffer: "/stop".to_owned(), role, ..rcs::PortInfo::default() };
        let process = rcs::ProcessInfo { inputs: vec![input], ..rcs::ProcessInfo::default() };
        let status = rcs::VehicleStatus { emergency_stopped, speed_mps, ..rcs::VehicleStatus::default() };
        let (log_time, acq_time) = (Stamp(1), Stamp(1));
        let header = Header { sequence: 1, log_time, acq_time, writer: WriterId::RUNTIME };
        let schema = Arc::clone(schema_of::<rcs::VehicleStatus>());
        let topic = Topic::new("/vehicle", RunTag::FIRST, schema)
            .with_latest(Sample { header, message: AnyMessage::new(status) });
        let (topics, processes) = (Arc::new([topic]), Arc::new([process]));
        let now = log_time.after_ns((age_s * 1e9) as u64);
        Frame { now, topics, processes, ..frame(moment(0, 50, 0)) }
    }

    #[test]
    fn a_vehicle_that_obeys_a_stop_and_still_rolls_is_not_shown_as_stopped() {
        let state = |emergency_stopped, speed_mps| {
            Operating::default().stop_state(&reported(emergency_stopped, speed_mps, 0.0))
        };
        assert_eq!(state(true, -0.89), StopState::Braking { late: false });
        assert_eq!(state(true, 0.04), StopState::Stopped { has_speed: true });
        assert_eq!(state(true, f64::NAN), StopState::Stopped { has_speed: false });
        assert_eq!(state(false, 0.89), StopState::Clear);
    }

    #[test]
    fn a_vehicle_that_rolls_on_for_three_seconds_of_the_run_although_it_obeys_a_stop_is_an_alarm() {
        let mut operating = Operating::default();
        let mut state = |speed_mps: f64, now_s: f64, goes_elsewhere: bool| {
            let frame = reported(true, speed_mps, now_s);
            operating.note_braking(&frame, goes_elsewhere);
            operating.stop_state(&frame)
        };
        let braking = |late: bool| StopState::Braking { late };
        assert_eq!(state(0.5, 10.0, false), braking(false));
        assert_eq!(state(0.5, 12.9, false), braking(false));
        assert_eq!(state(0.5, 13.1, false), braking(true));
        assert_eq!(state(0.0, 14.0, false), StopState::Stopped { has_speed: true });
        assert_eq!(state(0.5, 15.0, false), braking(false), "it begins to roll");
        assert_eq!(state(0.5, 5.0, false), braking(false), "an earlier moment");
        assert_eq!(state(0.5, 9.0, true), braking(false), "a jump in time");
    }

    #[test]
    fn a_report_that_is_old_while_time_runs_confirms_no_stop() {
        let old = |age_s: f64, playing: bool, is_at_end: bool| {
            let mut frame = reported(true, 0.0, age_s);
            (frame.playback.playing, frame.runs.is_at_end) = (playing, is_at_end);
            frame
        };
        let state = |frame: &Frame| Operating::default().stop_state(frame);
        let stopped = StopState::Stopped { has_speed: true };
        assert_eq!(state(&old(1.1, true, true)), stopped);
        assert_eq!(state(&old(1.3, false, true)), stopped, "time stands");
        assert_eq!(state(&old(1.3, true, false)), stopped, "the past");
        let silent = old(1.3, true, true);
        assert_eq!(state(&silent), StopState::Asked { active: true, late: true, waits: false });
        assert!(!Asked::new(&silent, true, Instant::now()).is_confirmed(&silent), "pressed again");
    }
}
