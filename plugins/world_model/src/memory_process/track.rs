//! Where the vehicle was, as the map memory knows it: the track along which the map is saved and compared.

use super::jump::JumpWatch;
use super::{MapMemoryKeeper, Ports};
use crate::proto::MapMemoryParams;
use crate::saved::Kept;
use rcs_geom::DVec2;
use rcs_msg::Stamp;
use rcs_msg::foxglove::Odometry;
use rcs_runtime::Cycle;
use rcs_sense::pose_of;

/// Distance between the points of the track, m, and their greatest number.
const TRACK_STEP_M: f64 = 2.0;
pub(super) const MOST_TRACK: usize = 5000;
/// Length of the track along which what is sensed is compared, in points: so far the local frame is one frame, and a map
/// that is turned differs at one of its ends.
const COMPARED_TRACK: usize = 20;

impl MapMemoryKeeper {
    /// Reads where the vehicle was since the last cycle. Returns where it is in the local frame, m; `None` where that is not
    /// known, or may be a single wrong pose.
    pub(super) fn read_positions(
        &mut self,
        ports: &Ports,
        params: &MapMemoryParams,
        cx: &mut Cycle<'_>,
    ) -> Option<DVec2> {
        let mut is_new = false;
        while let Some(odometry) = cx.read(&ports.odometry) {
            is_new = true;
            let Ok(position) = position_of(&odometry, &params.local_frame) else { continue };
            if let Some(leap_m) = self.follow(position, odometry.header().log_time, cx.now()) {
                let before = if self.own.is_some() {
                    "what was saved before is registered anew"
                } else {
                    "what was seen before is not saved"
                };
                cx.fault(format!("the pose in the local frame leapt by {leap_m:.1} m; {before}"));
            }
        }
        let position = position_of(&*cx.latest(&ports.odometry)?, &params.local_frame);
        if let Err(error) = position.as_ref()
            && is_new
        {
            cx.fault(format!("odometry: {error}; skipped"));
        }
        position.ok().filter(|_| self.leapt.is_none())
    }

    /// Follows the position of the vehicle in the local frame, m, that came at a time. One that leaps counts only if the next
    /// one is near it. Returns the length of a leap that is believed, m: the local frame has begun again, and what lies at
    /// places of the one before is forgotten.
    fn follow(&mut self, vehicle: DVec2, came: Stamp, now: Stamp) -> Option<f64> {
        let mut watch = self.frame_watch;
        let leap_m = watch.leap_m(vehicle, came);
        if leap_m.is_some() {
            let follows = self.leapt.take().is_some_and(|mut last| last.leap_m(vehicle, came).is_none());
            if !follows {
                self.leapt = Some(watch);
                return None;
            }
            self.forget_places(now);
        }
        (self.frame_watch, self.leapt) = (watch, None);
        leap_m
    }

    /// Adds the position of the vehicle in the local frame, m, to the track, if it is far enough from the one before.
    pub(super) fn extend_track(&mut self, vehicle: DVec2) {
        let last = self.recent.back();
        let step_m = last.map_or(f64::INFINITY, |last| last.distance(vehicle));
        if step_m >= TRACK_STEP_M {
            if self.track.len() < MOST_TRACK {
                self.track.push(vehicle);
            }
            if self.recent.len() >= COMPARED_TRACK {
                self.recent.pop_front();
            }
            self.recent.push_back(vehicle);
        }
    }

    /// Forgets what lies at places of the local frame before, and where the remembered map lies in it. What was saved of both
    /// is remembered. Maps that came before are not used.
    fn forget_places(&mut self, now: Stamp) {
        self.remember_own();
        self.cleared = Some(now);
        self.kept = Kept::default();
        self.track.clear();
        self.recent.clear();
        self.place(None);
        (self.settled, self.proposed, self.elsewhere, self.no_way) = (None, None, 0, None);
        self.jump = JumpWatch::default();
        self.use_again();
    }

    /// Positions along which what is sensed is compared, to that of the vehicle, local frame, m.
    pub(super) fn compared(&self, vehicle: DVec2) -> Vec<DVec2> {
        self.recent.iter().copied().chain([vehicle]).collect()
    }
}

/// Position of the vehicle in the local frame, m.
fn position_of(odometry: &Odometry, local: &str) -> Result<DVec2, String> {
    if odometry.frame_id != local {
        return Err(format!("frame is {:?}, expected {local:?}", odometry.frame_id));
    }
    let pose = pose_of(odometry.pose.as_ref(), &odometry.frame_id).map_err(|error| error.to_string())?;
    Ok(pose.translation.truncate())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::{Fit, Placed};
    use rcs_geom::Pose;

    /// Takes a position each second.
    fn drive(keeper: &mut MapMemoryKeeper, second: usize, x_m: f64) -> Option<f64> {
        let (vehicle, time) = (DVec2::new(x_m, 0.0), Stamp(second as u64 * 1_000_000_000));
        let leap_m = keeper.follow(vehicle, time, time);
        if keeper.leapt.is_none() {
            keeper.extend_track(vehicle);
        }
        leap_m
    }

    #[test]
    fn the_status_says_that_new_ground_is_not_saved_once_the_track_is_full() {
        let mut keeper = MapMemoryKeeper::default();
        for step in 0..MOST_TRACK {
            assert_eq!(keeper.told(), "nothing is remembered; saves the map");
            drive(&mut keeper, step, TRACK_STEP_M * step as f64);
        }
        let full = "; new ground is not saved: the track has 5000 points, the most that it can have";
        assert_eq!(keeper.told(), format!("nothing is remembered{full}"));
        keeper.text = "remembers".to_owned();
        assert_eq!(keeper.told(), format!("remembers{full}"));
        keeper.unsaved = Some("too large".to_owned());
        assert_eq!(keeper.told(), "remembers; the map is not saved: too large");
    }

    #[test]
    fn what_is_compared_lies_within_42_m_of_the_vehicle_also_once_the_track_is_full() {
        let mut keeper = MapMemoryKeeper::default();
        for step in 0..MOST_TRACK + 50 {
            let vehicle = DVec2::new(TRACK_STEP_M * step as f64, 0.0);
            drive(&mut keeper, step, vehicle.x);
            let compared = keeper.compared(vehicle);
            assert_eq!(compared.len(), (step + 1).min(COMPARED_TRACK) + 1);
            assert!(compared.iter().all(|place| place.distance(vehicle) <= 42.0), "{vehicle}: {compared:?}");
        }
        assert_eq!(keeper.track.len(), MOST_TRACK);
        keeper.clear(Stamp(0));
        assert_eq!(keeper.compared(DVec2::ZERO), [DVec2::ZERO]);
    }

    #[test]
    fn a_local_frame_that_begins_again_forgets_the_places_of_the_one_before_and_one_wrong_pose_does_not() {
        let placed = Placed { global_from_local: Pose::IDENTITY, fit: Fit::default() };
        let mut keeper = MapMemoryKeeper::default();
        (0..5).for_each(|step| assert_eq!(drive(&mut keeper, step, 5.0 * step as f64), None));
        keeper.place(Some(placed));
        assert_eq!([drive(&mut keeper, 5, 900.0), drive(&mut keeper, 6, 21.0)], [None; 2]);
        assert_eq!((keeper.track.len(), keeper.placed), (5, Some(placed)));
        assert_eq!([drive(&mut keeper, 7, -19.0), drive(&mut keeper, 8, -18.0)], [None, Some(39.0)]);
        assert_eq!((&keeper.track[..], keeper.placed), (&[DVec2::new(-18.0, 0.0)][..], None));
        assert_eq!((keeper.settled, keeper.cleared), (None, Some(Stamp(8_000_000_000))));
    }
}
