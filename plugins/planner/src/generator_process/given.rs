//! What the parameters of the waypoint generator give as texts: the route, the world's origin and the goal, and why what
//! they give is not used.

use super::goals::zones_of_files;
use crate::goal::Goal;
use crate::proto::{Route, SlipMemory, WaypointGeneratorParams};
use crate::zones::Zones;
use crate::{route, slips};
use rcs_runtime::Cycle;
use rcs_sense::{Origin, fingerprint_of_texts};
use serde::{Deserialize, Serialize};

/// Why something that is given was not used when it was read last; a reason is reported when it changes.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Refused(Option<String>);

impl Refused {
    /// What was read, or nothing where it is refused; then another reason than before is a fault.
    pub(super) fn or_none<T: Default>(
        &mut self,
        what: &str,
        read: Result<T, String>,
        cx: &mut Cycle<'_>,
    ) -> T {
        let why = read.as_ref().err();
        if let Some(why) = why.filter(|why| self.0.as_ref() != Some(why)) {
            cx.fault(format!("{what}: {why}; not used"));
        }
        self.0 = why.cloned();
        read.unwrap_or_default()
    }
}

/// What the texts of the parameters say: each is read once.
#[derive(Clone, Debug, Default)]
pub(super) struct Given {
    route: Read<Option<Route>>,
    slips: Read<Option<SlipMemory>>,
    world: Read<Option<Result<Origin, String>>>,
    goal: Read<Option<Result<Goal, String>>>,
    fingerprint: Option<(WaypointGeneratorParams, u64)>,
    /// The zones of the files with the parameters of this fingerprint.
    zones: Option<(u64, Result<Zones, String>)>,
}

/// A text, and what was read from it.
#[derive(Clone, Debug, Default)]
struct Read<T> {
    text: String,
    value: T,
}

impl<T> Read<T> {
    fn of(&mut self, text: &str, read: impl FnOnce(&str) -> T) -> &T {
        if self.text != text {
            self.value = read(text);
            text.clone_into(&mut self.text);
        }
        &self.value
    }
}

impl Given {
    /// A fingerprint of all parameters.
    pub(super) fn fingerprint(&mut self, params: &WaypointGeneratorParams) -> u64 {
        match &self.fingerprint {
            Some((known, fingerprint)) if known == params => *fingerprint,
            _ => {
                let fingerprint = fingerprint_of_texts(&[&format!("{params:?}")]);
                self.fingerprint = Some((params.clone(), fingerprint));
                fingerprint
            }
        }
    }

    /// The route of an earlier run; `None` without one.
    pub(super) fn route(&mut self, params: &WaypointGeneratorParams) -> Option<&Route> {
        self.route.of(&params.route, |text| route::parse(text).ok().flatten()).as_ref()
    }

    /// Where the wheels of an earlier run slipped; `None` without one.
    pub(super) fn slips(&mut self, params: &WaypointGeneratorParams) -> Option<&SlipMemory> {
        self.slips.of(&params.slips, |text| slips::parse(text).ok().flatten()).as_ref()
    }

    /// The origin of the global frame.
    pub(super) fn origin(&mut self, params: &WaypointGeneratorParams) -> Result<Origin, String> {
        let read = |text: &str| Some(Origin::from_toml(text).map_err(|error| format!("world: {error}")));
        let none = "world: expected a file with the [origin] of the global frame";
        self.world.of(&params.world, read).clone().unwrap_or_else(|| Err(none.to_owned()))
    }

    /// The zones of goal file and world file, global frame, m.
    pub(super) fn zones(&mut self, params: &WaypointGeneratorParams) -> Result<Zones, String> {
        let fingerprint = self.fingerprint(params);
        if let Some((known, zones)) = &self.zones
            && *known == fingerprint
        {
            return zones.clone();
        }
        let zones = self.origin(params).and_then(|origin| zones_of_files(params, &origin));
        self.zones = Some((fingerprint, zones.clone()));
        zones
    }

    /// The goal of the file.
    pub(super) fn goal(&mut self, params: &WaypointGeneratorParams) -> Result<Goal, String> {
        let read = |text: &str| Some(Goal::from_toml(text).map_err(|error| format!("goal: {error}")));
        let none = "there is no goal: expected a goal file, or GO_TO";
        self.goal.of(&params.goal, read).clone().unwrap_or_else(|| Err(none.to_owned()))
    }
}
