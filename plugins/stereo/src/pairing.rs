//! Pairs the images of two cameras that were taken at the same time.
//!
//! The images of one camera arrive in the order of their acquisition. So the two oldest waiting images either are a
//! pair, or the counterpart of the older one is missing and will not arrive. Where the clock of a camera begins again, the
//! images that wait by the old one have no counterpart any more.

use rcs_msg::Stamp;
use rcs_sense::ClockWatch;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Left or right camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Side {
    Left,
    Right,
}

impl Side {
    pub(crate) const BOTH: [Side; 2] = [Side::Left, Side::Right];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Side::Left => "left",
            Side::Right => "right",
        }
    }

    fn other(self) -> Side {
        match self {
            Side::Left => Side::Right,
            Side::Right => Side::Left,
        }
    }
}

/// Maximum time difference of a pair, and maximum waiting time, ns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Patience {
    pub(crate) max_difference_ns: u64,
    pub(crate) max_wait_ns: u64,
}

/// Images that wait for their counterpart.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Pairing<T> {
    cameras: [VecDeque<Waiting<T>>; 2],
    /// Acquisition time of the newest image of each camera.
    newest: [Option<Stamp>; 2],
    clocks: [ClockWatch; 2],
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Waiting<T> {
    taken: Stamp,
    arrived: Stamp,
    image: T,
}

impl<T> Default for Pairing<T> {
    fn default() -> Self {
        Self {
            cameras: [VecDeque::new(), VecDeque::new()],
            newest: [None; 2],
            clocks: [ClockWatch::default(); 2],
        }
    }
}

/// Two images taken at the same time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pair<T> {
    /// Acquisition times.
    pub(crate) taken: [Stamp; 2],
    pub(crate) images: [T; 2],
}

/// Why an image is not matched.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum PairingError {
    #[error("{} image is of {taken}, not newer than the one before of {before}", side.name())]
    Past { side: Side, taken: Stamp, before: Stamp },
    #[error("{} image of {taken} is missing: the {} camera's next is of {next}", side.other().name(), side.other().name())]
    Missing { side: Side, taken: Stamp, next: Stamp },
    #[error("{} image of {taken} is late by more than {max_wait_ms} ms", side.other().name())]
    Late { side: Side, taken: Stamp, max_wait_ms: u64 },
}

impl<T> Pairing<T> {
    /// Adds an image that was taken at `taken` and arrived at `now`. If it is not from the future, the images of its camera
    /// that are later than `now` are forgotten: by them, all others would be refused until the clock is there.
    ///
    /// If the clock of its camera has begun again ([`ClockWatch`]), the images of both cameras that wait by the old clock are
    /// dropped, and their number is returned.
    pub(crate) fn push(
        &mut self,
        side: Side,
        taken: Stamp,
        now: Stamp,
        image: T,
    ) -> Result<Option<usize>, PairingError> {
        let newest = &mut self.newest[side as usize];
        let waiting = &mut self.cameras[side as usize];
        if taken <= now {
            *newest = newest.filter(|&newest| newest <= now);
            waiting.retain(|image| image.taken <= now);
        }
        let begins_again = self.clocks[side as usize].begins_again(*newest, taken);
        if let Some(before) = newest.filter(|&before| taken <= before && !begins_again) {
            return Err(PairingError::Past { side, taken, before });
        }
        *newest = Some(taken);
        let dropped = begins_again.then(|| self.drop_far_after(taken));
        self.cameras[side as usize].push_back(Waiting { taken, arrived: now, image });
        Ok(dropped)
    }

    /// Drops the waiting images that are as far after a time as those of an old clock; returns their number.
    fn drop_far_after(&mut self, time: Stamp) -> usize {
        let mut dropped = 0;
        for waiting in &mut self.cameras {
            let before = waiting.len();
            waiting.retain(|image| !ClockWatch::is_far_behind(image.taken, time));
            dropped += before - waiting.len();
        }
        dropped
    }

    /// Returns all pairs, oldest first, and the discarded images with their reasons.
    pub(crate) fn pairs(&mut self, now: Stamp, patience: Patience) -> (Vec<Pair<T>>, Vec<(PairingError, T)>) {
        let (mut pairs, mut given_up) = (Vec::new(), Vec::new());
        loop {
            let [left, right] = &mut self.cameras;
            let (Some(a), Some(b)) = (left.front(), right.front()) else { break };
            let (side, taken, next) = if a.taken.0.abs_diff(b.taken.0) <= patience.max_difference_ns {
                if let (Some(a), Some(b)) = (left.pop_front(), right.pop_front()) {
                    pairs.push(Pair { taken: [a.taken, b.taken], images: [a.image, b.image] });
                }
                continue;
            } else if a.taken < b.taken {
                (Side::Left, a.taken, b.taken)
            } else {
                (Side::Right, b.taken, a.taken)
            };
            let lost = self.cameras[side as usize].pop_front();
            given_up.extend(lost.map(|lost| (PairingError::Missing { side, taken, next }, lost.image)));
        }
        for side in Side::BOTH {
            let waiting = &mut self.cameras[side as usize];
            let too_long =
                |image: &mut Waiting<T>| now.0.saturating_sub(image.arrived.0) > patience.max_wait_ns;
            while let Some(late) = waiting.pop_front_if(too_long) {
                let max_wait_ms = patience.max_wait_ns / 1_000_000;
                given_up.push((PairingError::Late { side, taken: late.taken, max_wait_ms }, late.image));
            }
        }
        (pairs, given_up)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Patience = Patience { max_difference_ns: 2, max_wait_ns: 100 };

    /// Pushes images (side, taken, arrived) and compares the times of all pairs and the errors, at each arrival and at
    /// `end`.
    fn check(images: &[(Side, u64, u64)], end: u64, pairs: &[[u64; 2]], said: &[&str]) {
        let mut pairing = Pairing::default();
        let (mut found, mut faults) = (Vec::new(), Vec::new());
        let mut ask = |pairing: &mut Pairing<u64>, now: u64, faults: &mut Vec<String>| {
            let (pairs, given_up) = pairing.pairs(Stamp(now), PATIENCE);
            found.extend(pairs.into_iter().map(|pair| pair.images));
            faults.extend(given_up.into_iter().map(|(error, _)| error.to_string()));
        };
        for &(side, taken, arrived) in images {
            if let Err(error) = pairing.push(side, Stamp(taken), Stamp(arrived), taken) {
                faults.push(error.to_string());
            }
            ask(&mut pairing, arrived, &mut faults);
        }
        ask(&mut pairing, end, &mut faults);
        assert_eq!(found, pairs);
        assert_eq!(faults.len(), said.len(), "{faults:?}");
        for (fault, said) in faults.iter().zip(said) {
            assert!(fault.contains(said), "got {fault:?}, expected {said:?}");
        }
    }

    use Side::{Left, Right};

    #[test]
    fn images_taken_together_are_a_pair_whichever_comes_first() {
        check(
            &[(Left, 10, 20), (Right, 11, 90), (Right, 50, 95), (Left, 52, 140)],
            500,
            &[[10, 11], [52, 50]],
            &[],
        );
    }

    #[test]
    fn a_missing_camera_costs_one_pair_and_is_named() {
        let images = [(Left, 10, 20), (Left, 50, 60), (Right, 50, 61), (Left, 90, 91), (Right, 90, 92)];
        check(&images, 100, &[[50, 50], [90, 90]], &["right image of"]);
        check(&[(Right, 10, 20), (Left, 50, 60), (Right, 50, 61)], 100, &[[50, 50]], &["left image of"]);
    }

    #[test]
    fn an_camera_that_stays_away_is_late_after_the_wait_and_not_before() {
        check(&[(Left, 10, 1000), (Left, 50, 1050)], 1100, &[], &[]);
        check(&[(Left, 10, 1000), (Left, 50, 1050)], 1101, &[], &["right image of"]);
        check(&[(Left, 10, 1000), (Left, 50, 1050)], 1151, &[], &["is late", "is late"]);
    }

    #[test]
    fn an_image_from_the_past_is_refused_and_changes_nothing() {
        let images = [(Left, 50, 60), (Left, 50, 61), (Left, 40, 62), (Right, 50, 63)];
        check(&images, 70, &[[50, 50]], &["not newer", "not newer"]);
    }

    #[test]
    fn an_image_from_the_future_does_not_refuse_those_after_it_and_a_camera_that_is_ahead_loses_none() {
        let images = [(Left, 90, 10), (Left, 20, 21), (Right, 20, 22), (Left, 30, 31), (Right, 30, 32)];
        check(&images, 40, &[[20, 20], [30, 30]], &[]);
        let ahead = [(Left, 90, 10), (Right, 90, 11), (Left, 95, 15), (Right, 95, 16), (Left, 95, 17)];
        check(&ahead, 40, &[[90, 90], [95, 95]], &["not newer"]);
    }

    #[test]
    fn after_the_clock_of_both_cameras_has_begun_again_new_images_are_pairs_and_those_that_waited_are_none() {
        const S: u64 = 1_000_000_000;
        let old = [(Left, 500 * S), (Right, 500 * S), (Left, 501 * S)];
        let new = [1, 2, 3].map(|s| [(Left, s * S), (Right, s * S)]);
        let mut pairing = Pairing::default();
        let (mut pairs, mut said) = (Vec::new(), Vec::new());
        for (side, taken) in old.into_iter().chain(new.into_iter().flatten()) {
            // All come at once, so that none waits too long.
            said.push(pairing.push(side, Stamp(taken), Stamp(900 * S), taken).ok());
            let (found, given_up) = pairing.pairs(Stamp(900 * S), PATIENCE);
            pairs.extend(found.into_iter().map(|pair| pair.images));
            assert!(given_up.is_empty(), "{given_up:?}");
        }
        assert_eq!(pairs, [[500 * S; 2], [2 * S; 2], [3 * S; 2]]);
        let next = Some(None);
        let (left, right) = (Some(Some(1)), Some(Some(0)));
        assert_eq!(said, [next, next, next, None, None, left, right, next, next]);
    }

    #[test]
    fn images_too_far_apart_are_no_pair() {
        check(&[(Left, 50, 60), (Right, 53, 61)], 62, &[], &["right image of"]);
        check(&[(Left, 50, 60), (Right, 52, 61)], 62, &[[50, 52]], &[]);
    }
}
