//! The policy of frames: how many are drawn in a second while time runs.
//!
//! A graphics processor draws at the rate of the screen. Where the processor draws, it does so on the cores that the
//! stack runs on: there are at most 30 frames a second, and as long as the stack falls behind, fewer, down to 10. What
//! does not change is not drawn: the driver wakes the window for new content only.

use rcs_runtime::source::Playback;
use std::time::{Duration, Instant};

const HARDWARE: Duration = Duration::from_millis(16);
const SOFTWARE: Duration = Duration::from_millis(33);
/// The longest time between two frames, whatever the stack needs.
const LONGEST: Duration = Duration::from_millis(100);
/// Time in which pictures that are prepared together are finished.
const SOON: Duration = Duration::from_millis(4);
/// Time between two decisions: over this time the achieved speed is measured.
const DECIDE: Duration = Duration::from_millis(500);

/// Time between frames, adapted to what the machine can do.
#[derive(Debug)]
pub(super) struct FramePolicy {
    least: Duration,
    every: Duration,
    decided: Option<Instant>,
}

impl Default for FramePolicy {
    fn default() -> Self {
        Self { least: HARDWARE, every: HARDWARE, decided: None }
    }
}

impl FramePolicy {
    /// The policy where the processor draws.
    pub(super) fn software() -> Self {
        Self { least: SOFTWARE, every: SOFTWARE, ..Self::default() }
    }

    /// Draws again for views that were painted before the one that changed what all of them show, as the hovered time.
    /// Where the processor draws, the frame of the next movement of the pointer usually does it.
    pub(super) fn again(&self, ctx: &egui::Context) {
        let is_software = self.least == SOFTWARE;
        ctx.request_repaint_after(if is_software { SOFTWARE } else { Duration::ZERO });
    }

    /// The time within which a picture is drawn that another thread has prepared: while time runs, it comes with the next
    /// frame, so that pictures cause no frames of their own.
    pub(super) fn within(&self, playback: &Playback) -> Duration {
        if playback.playing { self.every } else { SOON }
    }

    /// The time between frames, after a look at how well the source keeps up.
    pub(super) fn every(&mut self, now: Instant, playback: &Playback) -> Duration {
        if !playback.playing {
            (self.every, self.decided) = (self.least, None);
            return self.every;
        }
        let decided = *self.decided.get_or_insert(now);
        if now.saturating_duration_since(decided) >= DECIDE {
            self.decided = Some(now);
            let achieved = playback.achieved.unwrap_or(playback.speed);
            let is_slow = playback.speed.is_infinite() || achieved < 0.97 * playback.speed;
            let next = if is_slow { self.every.mul_f64(1.5) } else { self.every.mul_f64(0.9) };
            self.every = next.clamp(self.least, LONGEST);
        }
        self.every
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(policy: &mut FramePolicy, start: Instant, seconds: f64, achieved: f64) -> Duration {
        let playback = Playback { playing: true, achieved: Some(achieved), ..Playback::default() };
        let mut every = Duration::ZERO;
        for step in 0..(seconds * 20.0) as u32 {
            every = policy.every(start + Duration::from_millis(50) * step, &playback);
        }
        every
    }

    #[test]
    fn a_stack_that_falls_behind_gets_the_time_of_drawing_until_it_keeps_up() {
        let start = Instant::now();
        for (mut policy, least) in [(FramePolicy::software(), SOFTWARE), (FramePolicy::default(), HARDWARE)] {
            assert_eq!(after(&mut policy, start, 5.0, 1.0), least);
            let slow = after(&mut policy, start + Duration::from_secs(5), 5.0, 0.3);
            assert_eq!(slow, LONGEST, "at least ten frames a second remain");
            assert_eq!(after(&mut policy, start + Duration::from_secs(10), 20.0, 1.0), least);
        }
    }

    #[test]
    fn a_pause_ends_what_was_decided() {
        let (start, mut policy) = (Instant::now(), FramePolicy::software());
        after(&mut policy, start, 5.0, 0.3);
        let paused = Playback::default();
        assert_eq!(policy.every(start + Duration::from_secs(6), &paused), SOFTWARE);
        assert_eq!(policy.within(&paused), SOON, "then a picture is drawn as soon as it is there");
        assert_eq!(policy.within(&Playback { playing: true, ..paused }), SOFTWARE);
    }
}
