//! In how many frames each cell of the cost map was an obstacle. The noise of stereo makes obstacles of single cells in
//! single frames, where texture is fine; what stands there is seen again in the next frame.

use rcs_geom::{CellIndex, GridError, ScrollGrid};
use rcs_sense::CELL_SIZE_M;
use rcs_world::{Label, SIDE};
use serde::{Deserialize, Serialize};

/// Steps of the count for a frame with an obstacle; a frame with ground takes off one. Less, because ground is also seen
/// beside and through what stands there.
const FRAME: u8 = 3;

/// A count for each cell around the vehicle: frames that saw an obstacle there, less those that saw ground, from 0 to
/// the number that confirms one.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Sightings {
    grid: ScrollGrid<u8>,
}

impl Sightings {
    /// No frame yet.
    pub(crate) fn new() -> Result<Sightings, GridError> {
        Ok(Sightings { grid: ScrollGrid::new(SIDE, CELL_SIZE_M, 0)? })
    }

    /// Forgets everything.
    pub(crate) fn clear(&mut self) {
        self.grid.clear();
    }

    /// Moves the window around the vehicle.
    pub(crate) fn recentre(&mut self, centre: CellIndex) {
        self.grid.recentre(centre);
    }

    /// Adds what one frame saw in a cell. Returns whether an obstacle there is confirmed: this frame is sure of it, or so
    /// many frames have seen it.
    pub(crate) fn confirms(&mut self, cell: CellIndex, seen: Label, is_sure: bool, frames: u8) -> bool {
        let Some(count) = self.grid.get(cell).copied() else { return false };
        let enough = frames.saturating_mul(FRAME);
        let now = match seen {
            Label::Obstacle if is_sure => enough,
            Label::Obstacle => count.saturating_add(FRAME).min(enough),
            Label::Ground => count.saturating_sub(1),
            Label::Unknown => count,
        };
        if now != count
            && let Some(count) = self.grid.get_mut(cell)
        {
            *count = now;
        }
        now >= enough
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_obstacle_is_confirmed_by_its_second_frame_and_ground_takes_a_third_off() {
        let mut sightings = Sightings::new().unwrap();
        let cell = CellIndex::new(3, -2);
        let mut see = |label| sightings.confirms(cell, label, false, 2);
        assert!(!see(Label::Obstacle), "one frame");
        assert!(!see(Label::Unknown), "says nothing");
        assert!(see(Label::Obstacle), "two frames");
        assert!(see(Label::Obstacle), "no more than two count");
        assert!(!see(Label::Ground));
        assert!(see(Label::Obstacle), "a third is made up for by one");
        for _ in 0..4 {
            assert!(!see(Label::Ground));
        }
        assert!(!see(Label::Obstacle), "two thirds and one");
    }

    #[test]
    fn a_sure_frame_confirms_alone_and_nothing_is_confirmed_beyond_the_window() {
        let mut sightings = Sightings::new().unwrap();
        let cell = CellIndex::new(3, -2);
        assert!(sightings.confirms(cell, Label::Obstacle, true, 3));
        assert!(sightings.confirms(cell, Label::Obstacle, false, 3), "as after three frames");
        assert!(!sightings.confirms(CellIndex::new(1000, 0), Label::Obstacle, true, 3));
    }
}
