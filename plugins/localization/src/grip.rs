//! What part of the wheels' motion the vehicle makes, by the images of a camera ([`crate::visual`]).
//!
//! Where images and wheels agree, the wheels count: they are told 50 times a second, and without noise. Where they do not,
//! the wheels slip, and the images count: the next motion of the wheels by the share that the vehicle has made of the last
//! one, and what was reckoned wrongly meanwhile is made up for, because images come late.

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

/// Sums since the start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Sample {
    time: Stamp,
    rolled_m: f64,
    reckoned_m: f64,
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
}

impl Default for Grip {
    fn default() -> Grip {
        Grip { samples: VecDeque::new(), told: None, scale: 1.0, owed_m: 0.0 }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64) -> Stamp {
        Stamp((seconds * 1e9).round() as u64)
    }

    /// Way of the vehicle as it is reckoned while its wheels roll like this, m/s over time, for 9 s, and stand for one, and the
    /// vehicle moves by this share of it; and its true way, m. Images come five times a second, 0.25 s late.
    fn reckoned(roll_mps: impl Fn(f64) -> f64, share: impl Fn(f64) -> f64, has_images: bool) -> [f64; 2] {
        let mut grip = Grip::default();
        let (mut way_m, mut true_m, mut truths) = (0.0, 0.0, vec![0.0]);
        for step in 1..=500_usize {
            let time_s = step as f64 / 50.0;
            let rolled_m = if time_s < 9.0 { roll_mps(time_s) / 50.0 } else { 0.0 };
            true_m += share(time_s) * rolled_m;
            truths.push(true_m);
            let step_m = grip.share(at(time_s), rolled_m).unwrap_or(1.0) * rolled_m;
            grip.roll(at(time_s), rolled_m, step_m);
            way_m += step_m + grip.owed_m();
            if has_images && step.is_multiple_of(10) && step >= 25 {
                let (since, until) = ((step - 22) as f64 / 50.0, (step - 12) as f64 / 50.0);
                grip.take(at(since), at(until), truths[step - 12] - truths[step - 22]);
            }
        }
        [way_m, true_m]
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
            let [way_m, true_m] = reckoned(roll, share, true);
            assert!((way_m - true_m).abs() < 0.1, "{way_m} m instead of {true_m} m");
        }
        let [way_m, true_m] = reckoned(ahead, mud, false);
        assert!(way_m - true_m > 2.0, "without images the wheels count");
    }

    #[test]
    fn wheels_that_grip_count_as_they_are_although_images_tell_too_little() {
        let [way_m, _] = reckoned(|_| 1.2, |_| 0.95, true);
        assert!((way_m - 1.2 * 449.0 / 50.0).abs() < 1e-9, "{way_m}");
        // Images that are 8 % too short: half of the way slips, after it has been learned.
        let slip = |time_s: f64| if time_s < 7.0 { 0.92 } else { 0.46 };
        let [way_m, _] = reckoned(|_| 1.2, slip, true);
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
