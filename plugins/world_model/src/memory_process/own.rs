//! The map of this run after its local frame has begun again. Where it lies in the new frame is not known. So it is
//! remembered like the map of an earlier run: it is registered against what is sensed, and saved together with that.

use super::MapMemoryKeeper;
use crate::memory::Rectangle;
use crate::register::Remembered;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What this run had saved when its local frame began again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Own {
    /// In a global frame; shared between snapshots.
    map: Arc<Rectangle>,
    /// Whether that is the frame of the map of the parameters, in which the route of the earlier run lies, too. Else it is
    /// the frame of this run.
    pub(super) is_in_given_frame: bool,
}

impl MapMemoryKeeper {
    /// Remembers what this run has saved, which contains what it remembered, if that was registered. A remembered map that is
    /// neither believed nor rejected stays the remembered one: nothing that was seen with it is saved.
    pub(super) fn remember_own(&mut self) {
        let Some(global_from_local) = self.saved_in else { return };
        let old = self.remembered.map.as_ref().and_then(|map| map.as_ref().ok());
        if old.is_some() && self.is_undecided() {
            return;
        }
        let old = old.zip(self.settled).map(|(old, placed)| (&old.map, placed.local_from_remembered()));
        let frame = old.map_or(global_from_local, |(_, local_from_old)| local_from_old.inverse());
        let Ok(Some(map)) = self.kept.saved(old, &frame) else { return };
        let is_in_given_frame = old.is_some() && self.own.as_ref().is_none_or(|own| own.is_in_given_frame);
        self.own = Some(Own { map: Arc::new(map), is_in_given_frame });
        // What was said of the map before does not hold for this one.
        (self.dropped, self.misfits) = (None, 0);
        self.take_own();
    }

    /// Takes the map of this run for the remembered one, instead of that of the parameters, if there is one.
    pub(super) fn take_own(&mut self) {
        if let Some(own) = &self.own {
            self.remembered.map = Some(Ok(Arc::new(Remembered::new(Rectangle::clone(&own.map)))));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::IN_TURN;
    use super::*;
    use rcs_geom::{DVec2, Pose};
    use rcs_msg::Stamp;

    /// One that has seen and saved free ground within 2 m of the origin.
    fn keeper() -> MapMemoryKeeper {
        let mut keeper = MapMemoryKeeper { saved_in: Some(Pose::IDENTITY), ..MapMemoryKeeper::default() };
        let mut ground = Rectangle::around(&[DVec2::ZERO], 4.0, 0.4).unwrap();
        ground.costs.fill(0);
        keeper.kept.take(&ground, &[DVec2::ZERO], 2.0).unwrap();
        keeper
    }

    #[test]
    fn what_is_cleared_or_was_never_saved_is_not_remembered_when_the_local_frame_begins_again() {
        let mut saved = keeper();
        saved.remember_own();
        let own = saved.own.clone().unwrap();
        assert_eq!((own.map.at(DVec2::ZERO), own.is_in_given_frame), (0, false));
        let mut cleared = keeper();
        cleared.clear(Stamp(0));
        cleared.remember_own();
        assert_eq!(cleared.own, None);
        let mut unsaved = MapMemoryKeeper { saved_in: None, ..keeper() };
        unsaved.remember_own();
        assert_eq!(unsaved.own, None);
        // A second time, before it is registered, and once it is cleared.
        saved.kept = keeper().kept;
        saved.saved_in = Some(Pose::from_xy_yaw(50.0, 0.0, 0.0));
        saved.remember_own();
        assert_eq!(saved.own, Some(own));
        saved.clear(Stamp(0));
        assert_eq!(saved.own, None);
    }

    #[test]
    fn the_map_of_this_run_is_not_rejected_as_one_of_an_earlier_run_is() {
        let mut keeper = keeper();
        keeper.misfits = IN_TURN;
        assert!(!keeper.is_undecided());
        keeper.remember_own();
        keeper.misfits = IN_TURN;
        assert!(keeper.is_undecided());
    }
}
