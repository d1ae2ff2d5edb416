//! Buffers of images that wait for matching data: labels and depth of an image arrive later than the image.

use rcs_msg::foxglove::RawImage;
use rcs_msg::{AnyMessage, Stamp};
use rcs_sense::ClockWatch;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::VecDeque;

/// Images are kept for this time, s: labels come some tenths of a second after their image.
const KEPT_S: f64 = 2.0;
/// Least and greatest number of images that are kept. They share their pixels with the messages, which stay in memory.
const KEPT: [usize; 2] = [8, 64];

/// The last images of one port by their acquisition times.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Recent {
    images: VecDeque<(Stamp, Held)>,
    clock: ClockWatch,
    missed: u64,
}

impl Recent {
    /// Keeps an image. An image that is not newer than the newest is refused, with the time of the newest.
    pub fn add(&mut self, time: Stamp, image: RawImage) -> Result<(), Stamp> {
        if let Some(newest) = self.newest().filter(|&newest| newest >= time) {
            return Err(newest);
        }
        self.images.push_back((time, Held(image)));
        let [least, most] = KEPT;
        let recent = self.times().filter(|other| time.seconds_since(*other) <= KEPT_S).count();
        let too_many = self.images.len().saturating_sub(recent.clamp(least, most));
        self.images.drain(..too_many);
        Ok(())
    }

    /// Counts images that the buffer dropped before they were read.
    pub fn miss(&mut self, count: u64) {
        self.missed += count;
    }

    /// Number of images that were missed since the last [`Self::forget_before`].
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// Removes the images from the future if `time`, that of an image that arrives, is not after `now`: by them, all others
    /// would be late until the clock is there.
    pub fn forget_ahead(&mut self, time: Stamp, now: Stamp) {
        if time <= now {
            self.images.retain(|(other, _)| *other <= now);
        }
    }

    /// Whether the clock of the images has begun again with the one of this time that arrives, given the newest time before
    /// ([`ClockWatch`]). If so, those by the old clock are removed.
    pub fn begins_again(&mut self, newest: Option<Stamp>, time: Stamp) -> bool {
        let begins_again = self.clock.begins_again(newest, time);
        if begins_again {
            self.images.clear();
        }
        begins_again
    }

    /// Time of the newest image.
    pub fn newest(&self) -> Option<Stamp> {
        self.images.back().map(|(time, _)| *time)
    }

    /// The image nearest to a time, if it is within the tolerance.
    pub fn at(&self, time: Stamp, tolerance_s: f64) -> Option<(Stamp, &RawImage)> {
        let apart = |other: Stamp| other.0.abs_diff(time.0);
        let nearest = self.images.iter().min_by_key(|(other, _)| apart(*other))?;
        (apart(nearest.0) as f64 <= tolerance_s * 1e9).then_some((nearest.0, &nearest.1.0))
    }

    /// Removes images before this time, up to which all have been used.
    pub fn forget_before(&mut self, time: Stamp) {
        self.images.retain(|(other, _)| *other >= time);
        self.missed = 0;
    }

    /// Times of the images, oldest first.
    pub fn times(&self) -> impl DoubleEndedIterator<Item = Stamp> {
        self.images.iter().map(|(time, _)| *time)
    }
}

/// A kept time, unless it is from the future and `time`, that of an image that arrives, is not.
pub fn not_ahead(kept: Option<Stamp>, time: Stamp, now: Stamp) -> Option<Stamp> {
    kept.filter(|&kept| kept <= now || time > now)
}

/// An image as part of a process's state: its pixels are shared, and it is saved as a message.
#[derive(Clone, Debug, PartialEq)]
struct Held(RawImage);

impl Serialize for Held {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&AnyMessage::new(self.0.clone()).bytes())
    }
}

impl<'de> Deserialize<'de> for Held {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let bytes = Vec::<u8>::deserialize(deserializer)?;
        let message = AnyMessage::decode::<RawImage>(bytes.into()).map_err(D::Error::custom)?;
        message.to::<RawImage>().map(Held).ok_or_else(|| D::Error::custom("not an image"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32) -> RawImage {
        RawImage { width, data: vec![7; 3].into(), ..RawImage::default() }
    }

    #[test]
    fn an_image_is_found_by_its_time_within_the_tolerance() {
        let mut recent = Recent::default();
        for i in 1..=20_u32 {
            assert_eq!(recent.add(Stamp(u64::from(i) * 1000), image(i)), Ok(()));
        }
        assert_eq!(recent.at(Stamp(18_400), 500e-9).map(|(_, image)| image.width), Some(18));
        assert_eq!(recent.at(Stamp(18_600), 500e-9).map(|(_, image)| image.width), Some(19));
        assert_eq!(recent.at(Stamp(18_400), 300e-9), None);
        assert_eq!(recent.add(Stamp(20_000), image(1)), Err(Stamp(20_000)));
        recent.forget_before(Stamp(19_500));
        assert_eq!(recent.times().collect::<Vec<_>>(), [Stamp(20_000)]);
    }

    #[test]
    fn the_images_of_the_last_two_seconds_are_kept_and_at_least_8_and_at_most_64() {
        let kept = |period_ms: u64| {
            let mut recent = Recent::default();
            for i in 1..=100 {
                assert_eq!(recent.add(Stamp(i * period_ms * 1_000_000), image(1)), Ok(()));
            }
            recent.times().count()
        };
        assert_eq!([1_000, 150, 16].map(kept), [8, 14, 64]);
    }

    #[test]
    fn the_image_of_a_fast_camera_is_found_when_its_labels_come_0_3_s_later() {
        let mut recent = Recent::default();
        for i in 0..60_u32 {
            assert_eq!(recent.add(Stamp(u64::from(i) * 16_000_000), image(i)), Ok(()));
        }
        assert_eq!(recent.at(Stamp(40 * 16_000_000), 0.002).map(|(_, image)| image.width), Some(40));
    }

    #[test]
    fn images_by_the_old_clock_are_removed_when_it_has_begun_again_and_not_for_one_that_is_late() {
        let second = |s: u64| Stamp(s * 1_000_000_000);
        let mut recent = Recent::default();
        for (time_s, is_kept) in [(500, true), (1, false), (501, true), (1, false), (2, true), (3, true)] {
            let newest = recent.newest();
            assert_eq!(recent.begins_again(newest, second(time_s)), time_s == 2);
            assert_eq!(recent.add(second(time_s), image(1)).is_ok(), is_kept, "{time_s}");
        }
        assert_eq!(recent.times().collect::<Vec<_>>(), [second(2), second(3)]);
    }

    #[test]
    fn an_image_from_the_future_does_not_make_others_late_and_a_clock_that_is_ahead_loses_none() {
        let mut recent = Recent::default();
        for time in [Stamp(9_000), Stamp(50_000), Stamp(51_000)] {
            recent.forget_ahead(time, Stamp(10_000));
            assert_eq!(recent.add(time, image(1)), Ok(()));
        }
        assert_eq!(recent.times().count(), 3);
        recent.forget_ahead(Stamp(10_500), Stamp(11_000));
        assert_eq!(recent.add(Stamp(10_500), image(1)), Ok(()));
        assert_eq!(recent.times().collect::<Vec<_>>(), [Stamp(9_000), Stamp(10_500)]);
        let kept = |time: u64| not_ahead(Some(Stamp(50_000)), Stamp(time), Stamp(11_000));
        assert_eq!([kept(10_500), kept(49_000)], [None, Some(Stamp(50_000))]);
    }
}
