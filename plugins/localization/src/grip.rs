//! What part of the wheels' motion the vehicle makes, by the images of a camera ([`crate::visual`]).
//!
//! Where images and wheels agree, the wheels count: they are told 50 times a second, and without noise. Where they do not,
//! the wheels slip, and the images count: the next motion of the wheels by the share that the vehicle has made of the last
//! one, and what was reckoned wrongly meanwhile is made up for, because images come late.
//!
//! Slip is told over each metre of the wheels ([`Grip::slipped`]); by position fixes it takes five ([`crate::way_slip`]).

use crate::way_slip::Slipped;
use glam::DVec3;
use rcs_geom::Pose;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Wheels and images that differ by less than this, m, or by less than this share of the wheels' way, agree.
const AGREE_M: f64 = 0.02;
const AGREE_SHARE: f64 = 0.1;
/// Cameras whose calibration is off by 0.2° and a pixel tell up to a tenth too little: what they tell for each metre of
/// wheels that grip is learned over this way, m, and is within these bounds.
const SCALE_LENGTH_M: f64 = 20.0;
const SCALES: [f64; 2] = [0.85, 1.15];
/// The least and greatest share of the wheels' motion that the vehicle makes: on a slope it may slide back, or on.
const SHARES: [f64; 2] = [-0.5, 1.5];
/// After this time without images that tell the motion, they say nothing, s.
const TIMEOUT_S: f64 = 0.8;
/// Images come at most this late, s.
const LATEST_S: f64 = 2.0;
/// Way of the wheels over which slip is told, m, within at most this time, s; and way between two reports, m.
const WINDOW_M: f64 = 1.0;
const WINDOW_S: f64 = 30.0;
const REPORT_M: f64 = 0.4;

/// Sums since the start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Sample {
    time: Stamp,
    rolled_m: f64,
    reckoned_m: f64,
}

/// What wheels and vehicle did between two images.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Step {
    since: Stamp,
    until: Stamp,
    rolled_m: f64,
    moved_m: f64,
}

/// The motion of the last seconds, and what images have told of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grip {
    samples: VecDeque<Sample>,
    /// Share of the wheels' motion that the vehicle makes, the way in which the wheels turned, m, and the time of the image.
    told: Option<(f64, f64, Stamp)>,
    /// What images tell for each metre of wheels that grip.
    scale: f64,
    owed_m: f64,
    /// Images that follow one another, of the last [`WINDOW_M`].
    steps: VecDeque<Step>,
    /// What the wheels have rolled since the last report, m.
    unreported_m: f64,
}

impl Default for Grip {
    fn default() -> Grip {
        Grip {
            samples: VecDeque::new(),
            told: None,
            scale: 1.0,
            owed_m: 0.0,
            steps: VecDeque::new(),
            unreported_m: 0.0,
        }
    }
}

impl Grip {
    /// Takes a way of the wheels, and that of wheels which grip and take the vehicle as far as it is reckoned to have moved, m.
    pub fn roll(&mut self, time: Stamp, rolled_m: f64, reckoned_m: f64) {
        let sums = self.samples.back().map_or([0.0; 2], |last| [last.rolled_m, last.reckoned_m]);
        let [rolled_m, reckoned_m] = [sums[0] + rolled_m, sums[1] + reckoned_m];
        self.samples.push_back(Sample { time, rolled_m, reckoned_m });
        while self.samples.front().is_some_and(|first| time.seconds_since(first.time) > LATEST_S) {
            self.samples.pop_front();
        }
    }

    /// Takes the way of the vehicle between two images, m. Of a time in which the wheels' way is not known, or which has been
    /// told before, it says nothing.
    pub fn take(&mut self, since: Stamp, until: Stamp, moved_m: f64) {
        if self.told.is_some_and(|(.., before)| since < before) {
            return;
        }
        let (Some(from), Some(to)) = (self.sums_at(since), self.sums_at(until)) else { return };
        let [rolled_m, reckoned_m] = [to[0] - from[0], to[1] - from[1]];
        let as_rolled_m = moved_m / self.scale;
        let tolerance_m = AGREE_M.max(AGREE_SHARE * rolled_m.abs());
        let slips = (rolled_m - as_rolled_m).abs() > tolerance_m;
        // When wheels grip again, their way is still reckoned by images until the next one has come.
        if slips || (rolled_m - reckoned_m).abs() > tolerance_m {
            self.owed_m += as_rolled_m - reckoned_m;
        }
        let share = if slips && rolled_m.abs() > AGREE_M {
            (as_rolled_m / rolled_m).clamp(SHARES[0], SHARES[1])
        } else {
            1.0
        };
        if !slips && rolled_m.abs() > AGREE_M {
            let part = (rolled_m.abs() / SCALE_LENGTH_M).min(1.0);
            self.scale += part * (moved_m / rolled_m - self.scale);
            self.scale = self.scale.clamp(SCALES[0], SCALES[1]);
        }
        self.told = Some((share, rolled_m, until));
        if self.steps.back().is_some_and(|last| last.until != since) {
            self.steps.clear();
        }
        self.steps.push_back(Step { since, until, rolled_m, moved_m: as_rolled_m });
        self.unreported_m += rolled_m.abs();
        let is_full = |steps: &VecDeque<Step>| {
            let is_old = steps.front().is_some_and(|first| until.seconds_since(first.since) > WINDOW_S);
            is_old || rolled_m_of(steps, 1..) >= WINDOW_M
        };
        while self.steps.len() > 1 && is_full(&self.steps) {
            self.steps.pop_front();
        }
    }

    /// Slip over the last metre of the wheels, each 0.4 m of them, given the pose with all that was owed.
    pub fn slipped(&mut self, local_from_vehicle: &Pose) -> Option<Slipped> {
        if self.unreported_m < REPORT_M {
            return None;
        }
        let rolled_m = rolled_m_of(&self.steps, 0..);
        if rolled_m < WINDOW_M {
            return None;
        }
        self.unreported_m = 0.0;
        let (first, last) = (self.steps.front()?, self.steps.back()?);
        let with_wheels_m = self.steps.iter().map(|step| step.moved_m * step.rolled_m.signum()).sum();
        let since_last_m = self.samples.back()?.reckoned_m - self.sums_at(last.until)?[1];
        let middle =
            (0..self.steps.len()).rev().find(|&at| rolled_m_of(&self.steps, at..) >= rolled_m / 2.0)?;
        let back_m = since_last_m + self.steps.range(middle..).map(|step| step.moved_m).sum::<f64>();
        Some(Slipped {
            since: first.since,
            rolled_m,
            reckoned_m: with_wheels_m,
            moved_m: with_wheels_m,
            middle: *local_from_vehicle * Pose::from_translation(DVec3::X * -back_m),
        })
    }

    /// Whether images tell the motion at a time.
    pub fn is_known(&self, time: Stamp) -> bool {
        self.told.is_some_and(|(.., at)| time.seconds_since(at) <= TIMEOUT_S)
    }

    /// The share that counts of a way of the wheels, m; `None` where images tell nothing.
    pub fn share(&self, time: Stamp, rolled_m: f64) -> Option<f64> {
        let (share, before_m, _) = self.told.filter(|_| self.is_known(time))?;
        // Of wheels that have turned around nothing is known yet.
        Some(if rolled_m * before_m >= 0.0 { share } else { 1.0 })
    }

    /// What has to be added to the way of wheels that grip, m, once.
    pub fn owed_m(&mut self) -> f64 {
        std::mem::take(&mut self.owed_m)
    }

    /// Both sums at a time.
    fn sums_at(&self, time: Stamp) -> Option<[f64; 2]> {
        let after = self.samples.iter().position(|sample| sample.time >= time)?;
        let to = &self.samples[after];
        let from = if after > 0 { &self.samples[after - 1] } else { to };
        if from.time > time {
            return None;
        }
        let span_s = to.time.seconds_since(from.time);
        let part = if span_s > 0.0 { time.seconds_since(from.time) / span_s } else { 1.0 };
        let between = |from: f64, to: f64| from + (to - from) * part;
        Some([between(from.rolled_m, to.rolled_m), between(from.reckoned_m, to.reckoned_m)])
    }
}

/// Way of the wheels in some of the steps, without sign, m.
fn rolled_m_of(steps: &VecDeque<Step>, some: std::ops::RangeFrom<usize>) -> f64 {
    steps.range(some).map(|step| step.rolled_m.abs()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64) -> Stamp {
        Stamp((seconds * 1e9).round() as u64)
    }

    /// What is known of a vehicle for 10 s.
    struct Known {
        /// Its way, m, and its true way.
        ways_m: [f64; 2],
        /// What is told of slip, its true way at the time, and that in the middle of the last metre of the wheels.
        slips: Vec<(Slipped, [f64; 2])>,
    }

    /// Wheels roll like this, m/s over time, for 9 s, and stand for one, and the vehicle moves by this share of it. Images
    /// come five times a second, 0.25 s late.
    fn known(roll_mps: impl Fn(f64) -> f64, share: impl Fn(f64) -> f64, has_images: bool) -> Known {
        let mut grip = Grip::default();
        let (mut way_m, mut true_m, mut truths) = (0.0, 0.0, vec![0.0]);
        let mut slips = Vec::new();
        for step in 1..=500_usize {
            let time_s = step as f64 / 50.0;
            let rolled_m = if time_s < 9.0 { roll_mps(time_s) / 50.0 } else { 0.0 };
            true_m += share(time_s) * rolled_m;
            truths.push(true_m);
            let step_m = grip.share(at(time_s), rolled_m).unwrap_or(1.0) * rolled_m;
            grip.roll(at(time_s), rolled_m, step_m);
            way_m += step_m + grip.owed_m();
            if let Some(slipped) = grip.slipped(&Pose::from_xy_yaw(way_m, 0.0, 0.0)) {
                let halfway = 0.5 * (slipped.since.seconds_since(at(0.0)) + (step - 13) as f64 / 50.0);
                slips.push((slipped, [true_m, truths[(halfway * 50.0) as usize]]));
            }
            if has_images && step.is_multiple_of(10) && step >= 25 {
                let (since, until) = ((step - 22) as f64 / 50.0, (step - 12) as f64 / 50.0);
                grip.take(at(since), at(until), truths[step - 12] - truths[step - 22]);
            }
        }
        Known { ways_m: [way_m, true_m], slips }
    }

    #[test]
    fn slip_counts_as_images_show_it_also_in_short_spells_and_with_wheels_that_turn_around() {
        let ahead = |_: f64| 1.2;
        let shaken = |time_s: f64| if time_s % 1.2 < 0.6 { 0.6 } else { -0.4 };
        let mud = |time_s: f64| if (3.0..7.0).contains(&time_s) { 0.5 } else { 1.0 };
        let spells = |time_s: f64| if time_s % 2.0 < 0.7 { 0.2 } else { 1.0 };
        let stands = |time_s: f64| if time_s < 2.0 { 1.0 } else { 0.0 };
        for (roll, share) in [
            (&ahead as &dyn Fn(f64) -> f64, &mud as &dyn Fn(f64) -> f64),
            (&ahead, &spells),
            (&ahead, &stands),
            (&shaken, &mud),
            (&shaken, &stands),
        ] {
            let [way_m, true_m] = known(roll, share, true).ways_m;
            assert!((way_m - true_m).abs() < 0.1, "{way_m} m instead of {true_m} m");
        }
        let [way_m, true_m] = known(ahead, mud, false).ways_m;
        assert!(way_m - true_m > 2.0, "without images the wheels count");
    }

    #[test]
    fn slip_is_told_within_a_metre_and_lies_where_the_vehicle_was() {
        // Mud from 3.6 m on, until 7 s.
        let mud = |time_s: f64| if (3.0..7.0).contains(&time_s) { 0.5 } else { 1.0 };
        for direction in [1.0, -1.0] {
            let told = known(|_| direction * 1.2, mud, true).slips;
            assert!((17..=22).contains(&told.len()), "each 0.48 m: {}", told.len());
            for (slipped, [_, middle_m]) in &told {
                assert!((1.0..1.3).contains(&slipped.rolled_m), "{slipped:?}");
                let told_m = slipped.middle.translation.x;
                assert!((told_m - middle_m).abs() < 0.2, "{told_m} m instead of {middle_m} m");
            }
            let (_, [first_m, _]) = told.iter().find(|(slipped, _)| slipped.slip() >= 0.35).expect("mud");
            assert!((3.9..4.6).contains(&(direction * first_m)), "{first_m}");
            let slip_at = |place_m: f64| {
                let near =
                    told.iter().find(|(slipped, _)| direction * slipped.middle.translation.x >= place_m);
                near.map_or(f64::NAN, |(slipped, _)| slipped.slip())
            };
            assert!(slip_at(2.0) < 0.01 && (0.45..0.51).contains(&slip_at(4.5)) && slip_at(6.8) < 0.01);
        }
        assert_eq!(known(|_| 1.2, mud, false).slips.len(), 0);
        assert_eq!(known(|_| 0.0, mud, true).slips.len(), 0, "wheels that stand");
        let mut stands = Grip::default();
        for step in 0..3000 {
            stands.roll(at(f64::from(step) * 0.2), 0.0, 0.0);
            stands.take(at(f64::from(step - 1) * 0.2), at(f64::from(step) * 0.2), 0.0);
        }
        assert!((100..200).contains(&stands.steps.len()), "it does not grow: {}", stands.steps.len());
        let (slipped, _) = known(|_| 1.2, |_| 0.0, true).slips.remove(3);
        assert!((slipped.slip() - 1.0).abs() < 1e-9 && slipped.middle.translation.length() < 0.4);
    }

    #[test]
    fn wheels_that_grip_count_as_they_are_although_images_tell_too_little() {
        let [way_m, _] = known(|_| 1.2, |_| 0.95, true).ways_m;
        assert!((way_m - 1.2 * 449.0 / 50.0).abs() < 1e-9, "{way_m}");
        // Images that are 8 % too short: half of the way slips, after it has been learned.
        let slip = |time_s: f64| if time_s < 7.0 { 0.92 } else { 0.46 };
        let [way_m, _] = known(|_| 1.2, slip, true).ways_m;
        let (firm_m, slipped_m) = (1.2 * 7.0, 1.2 * 0.5 * 2.0);
        assert!((way_m - firm_m - slipped_m).abs() < 0.1, "{way_m}");
    }

    #[test]
    fn images_of_a_time_that_is_not_known_say_nothing() {
        let mut grip = Grip::default();
        grip.take(at(0.0), at(0.2), 0.1);
        assert_eq!((grip.is_known(at(0.2)), grip.owed_m()), (false, 0.0));
        grip.roll(at(1.0), 0.1, 0.1);
        grip.roll(at(1.2), 0.1, 0.1);
        for (since, until) in [(0.9, 1.1), (1.1, 1.3)] {
            grip.take(at(since), at(until), 0.0);
            assert_eq!(grip.share(at(1.2), 0.1), None, "{since} to {until}");
        }
        grip.take(at(1.0), at(1.2), 0.0);
        assert_eq!(grip.share(at(1.2), 0.1), Some(0.0));
        assert_eq!(grip.share(at(1.2), -0.1), Some(1.0), "they have turned around");
        assert!((grip.owed_m() + 0.1).abs() < 1e-12 && grip.owed_m() == 0.0);
        grip.roll(at(1.4), 0.1, 0.0);
        grip.take(at(1.1), at(1.4), 0.1);
        assert_eq!(grip.owed_m(), 0.0, "it overlaps the one before");
        assert_eq!(grip.share(at(2.1), 0.1), None, "too old");
    }
}
