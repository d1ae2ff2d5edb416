//! The signals of the table of modes, from what the follower receives and senses.

use crate::modes::{Signal, Signals};
use rcs_geom::{DVec2, Pose};
use rcs_msg::Stamp;
use rcs_msg::rcs::{SlipReport, TractionState, WaySlip};
use serde::{Deserialize, Serialize};

/// Motion by less than this within a time counts as none, m.
const HARDLY_M: f64 = 0.15;
/// Motion within this distance of a place gains no ground, m.
const STAYED_M: f64 = 1.0;
/// A slip report that is older than this says nothing, s.
const SLIP_TIMEOUT_S: f64 = 0.5;
/// The same of slip over the last metres, which is told each time that the wheels have rolled on for some decimetres.
const WAY_SLIP_TIMEOUT_S: f64 = 2.0;

/// What the signals follow from, over time.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Watch {
    /// Slip, whether a motor is stalled, current; and when.
    traction: Option<([f64; 3], Stamp)>,
    /// Slip over the last metres; and when.
    way_slip: Option<(f64, Stamp)>,
    /// Since when there has been no path that can be driven.
    blocked: Option<Stamp>,
    /// Since when there has been no way to the goal on a larger map.
    far_blocked: Option<Stamp>,
    /// Since when no arc has been free, although there is a path.
    no_arc: Option<Stamp>,
    /// Where and when the vehicle, told to move, was when it had moved last.
    still: Option<((f64, f64), Stamp)>,
    /// The same with [`STAYED_M`], and for turns on the spot, too.
    stayed: Option<((f64, f64), Stamp)>,
    /// Where the mode began or ended last, m, and when.
    began: (f64, f64),
    changed: Option<Stamp>,
    /// Whether the vehicle is told to drive back.
    backs: bool,
}

/// What is closed to the vehicle.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Closed {
    /// The planner finds no way.
    pub(crate) way: bool,
    /// The planner of a larger map finds no way.
    pub(crate) far_way: bool,
    /// No arc is free.
    pub(crate) arcs: bool,
}

impl Watch {
    pub(crate) fn take_slip(&mut self, report: &SlipReport, at: Stamp) {
        let stalled = report.state() == TractionState::TractionStalled;
        let amperes = report.left_a.abs().max(report.right_a.abs());
        let values = [report.slip, f64::from(u8::from(stalled)), amperes];
        if values.iter().all(|value| value.is_finite()) {
            self.traction = Some((values, at));
        }
    }

    /// Takes slip over metres all of which were driven since the last change of mode: what a mode does to get free shall not
    /// be taken for slip, nor slip before it counted again.
    pub(crate) fn take_way_slip(&mut self, report: &WaySlip, at: Stamp) {
        let since = report.since.as_ref().and_then(Stamp::from_proto);
        if report.slip.is_finite() && since.is_some_and(|since| self.changed.is_none_or(|at| since >= at)) {
            self.way_slip = Some((report.slip, at));
        }
    }

    /// What is closed from now on.
    pub(crate) fn take_closed(&mut self, Closed { way, far_way, arcs }: Closed, now: Stamp) {
        let since = |is_so: bool, before: Option<Stamp>| is_so.then(|| before.unwrap_or(now));
        self.blocked = since(way || arcs, self.blocked);
        self.far_blocked = since(far_way, self.far_blocked);
        self.no_arc = since(arcs && !way, self.no_arc);
    }

    /// What the vehicle is told to do from now on, m/s and rad/s.
    pub(crate) fn take_order(&mut self, [speed_mps, yaw_rate_radps]: [f64; 2], position: DVec2, now: Stamp) {
        self.backs = speed_mps < 0.0;
        let left = self.stayed.is_none_or(|(place, _)| position.distance(DVec2::from(place)) > STAYED_M);
        if speed_mps == 0.0 && yaw_rate_radps == 0.0 {
            self.stayed = None;
        } else if left {
            self.stayed = Some(((position.x, position.y), now));
        }
        let moved = self.still.is_none_or(|(place, _)| position.distance(DVec2::from(place)) > HARDLY_M);
        if speed_mps == 0.0 {
            self.still = None;
        } else if moved {
            self.still = Some(((position.x, position.y), now));
        }
    }

    /// Whether the vehicle was told last to drive back.
    pub(crate) fn backs(&self) -> bool {
        self.backs
    }

    /// A mode begins or ends here.
    pub(crate) fn begin(&mut self, position: DVec2, now: Stamp) {
        self.began = (position.x, position.y);
        self.changed = Some(now);
        self.way_slip = None;
        self.still = None;
        self.stayed = None;
    }

    pub(crate) fn signals(
        &self,
        vehicle: &Pose,
        pressed: bool,
        room_m: f64,
        mode_began: Option<Stamp>,
        now: Stamp,
    ) -> Signals {
        let mut signals = [0.0; Signal::COUNT];
        let mut set = |signal: Signal, value: f64| signals[signal as usize] = value;
        let since = |at: Option<Stamp>| at.map_or(0.0, |at| now.seconds_since(at));
        let recent = self.traction.filter(|(_, at)| now.seconds_since(*at) <= SLIP_TIMEOUT_S);
        let [slip, stalled, amperes] = recent.map_or([0.0; 3], |(values, _)| values);
        let way_slip = self.way_slip.filter(|(_, at)| now.seconds_since(*at) <= WAY_SLIP_TIMEOUT_S);
        let [roll_rad, pitch_rad, _] = vehicle.rpy();
        set(Signal::Bumper, f64::from(u8::from(pressed)));
        set(Signal::Slip, slip);
        set(Signal::WaySlip, way_slip.map_or(0.0, |(slip, _)| slip));
        set(Signal::Stalled, stalled);
        set(Signal::MotorA, amperes);
        set(Signal::ClimbDeg, -pitch_rad.to_degrees());
        set(Signal::RollDeg, roll_rad.to_degrees().abs());
        set(Signal::RoomM, room_m);
        set(Signal::BlockedS, since(self.blocked));
        set(Signal::FarBlockedS, since(self.far_blocked));
        set(Signal::NoArcS, since(self.no_arc));
        set(Signal::StayedS, since(self.stayed.map(|(_, at)| at)));
        set(Signal::StuckS, since(self.still.map(|(_, at)| at)));
        let began = DVec2::from(self.began);
        set(Signal::MovedM, mode_began.map_or(0.0, |_| vehicle.translation.truncate().distance(began)));
        set(Signal::ModeS, since(mode_began));
        signals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_count_times_and_distances() {
        let at = |seconds: u64| Stamp(seconds * 1_000_000_000);
        let mut watch = Watch::default();
        let closed = |way, far_way, arcs| Closed { way, far_way, arcs };
        watch.take_closed(closed(true, false, false), at(1));
        watch.take_closed(closed(false, true, true), at(2));
        watch.take_order([0.5, 0.0], DVec2::ZERO, at(1));
        watch.take_order([0.5, 0.0], DVec2::new(0.1, 0.0), at(3));
        watch.begin(DVec2::new(0.0, 1.0), at(1));
        watch.take_order([0.0, 0.9], DVec2::new(0.2, 0.0), at(2));
        watch.take_order([0.5, 0.0], DVec2::ZERO, at(3));
        watch.take_slip(&SlipReport { slip: 0.7, left_a: -12.0, ..SlipReport::default() }, at(4));
        let climbs = Pose::from_xy_yaw(0.0, 0.0, 0.0);
        let signals = watch.signals(&climbs, true, 0.3, Some(at(2)), at(4));
        let expected = [
            (Signal::Bumper, 1.0),
            (Signal::Slip, 0.7),
            (Signal::MotorA, 12.0),
            (Signal::BlockedS, 3.0),
            (Signal::FarBlockedS, 2.0),
            (Signal::NoArcS, 2.0),
            (Signal::StuckS, 1.0),
            (Signal::StayedS, 2.0),
            (Signal::MovedM, 1.0),
            (Signal::ModeS, 2.0),
            (Signal::RoomM, 0.3),
        ];
        for (signal, value) in expected {
            assert!((signals[signal as usize] - value).abs() < 1e-9, "{signal:?}: {signals:?}");
        }
        assert!(
            watch.signals(&climbs, true, 0.3, None, at(6))[Signal::Slip as usize].abs() < 1e-9,
            "too old"
        );
        let slipped =
            |since: u64| WaySlip { slip: 0.8, since: Some(at(since).to_proto()), ..WaySlip::default() };
        let way_slip =
            |watch: &Watch| watch.signals(&climbs, true, 0.3, Some(at(2)), at(5))[Signal::WaySlip as usize];
        watch.take_way_slip(&slipped(0), at(4));
        assert_eq!(way_slip(&watch), 0.0, "it began before the mode changed");
        watch.take_way_slip(&slipped(1), at(4));
        assert_eq!(way_slip(&watch), 0.8);
        let blocked = |watch: &Watch| {
            let signals = watch.signals(&climbs, true, 0.3, None, at(7));
            [Signal::BlockedS, Signal::FarBlockedS, Signal::NoArcS].map(|signal| signals[signal as usize])
        };
        watch.take_closed(closed(true, true, true), at(6));
        assert_eq!(blocked(&watch), [6.0, 5.0, 0.0], "there is no path");
        watch.take_closed(Closed::default(), at(6));
        assert_eq!(blocked(&watch), [0.0; 3]);
    }
}
