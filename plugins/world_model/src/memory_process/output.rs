//! What the map memory sends: the costs of the remembered map, where its frame lies, and the map to save.

use super::{IN_TURN, MapMemoryKeeper, Now, Ports};
use crate::memory::{MemoryError, Rectangle, check, parse, statement};
use crate::proto::{MapMemory, MapMemoryParams};
use crate::register::{Placed, Remembered, moved_m};
use rcs_geom::Pose;
use rcs_msg::Stamp;
use rcs_msg::foxglove::{FrameTransform, FrameTransforms, Quaternion, Vector3};
use rcs_runtime::Cycle;
use rcs_sense::{GridFrame, Origin};
use rcs_world::{Source, UNKNOWN_COST};

/// Frame of the remembered map: the global frame as the run that saved it knew it.
const FRAME: &str = "remembered";
/// Confidence of what is remembered: that of a sensor which is sure of ground.
const CONFIDENCE: u8 = 80;
/// Time after which the costs are sent again, s: the world model may have been cleared.
const RESEND_S: f64 = 5.0;

impl MapMemoryKeeper {
    /// States what a remembered map that lies here says of the ground around the vehicle, if that is due.
    pub(super) fn state_costs(
        &mut self,
        ports: &Ports,
        params: &MapMemoryParams,
        placed: Placed,
        remembered: &Remembered,
        now: &Now<'_>,
        cx: &mut Cycle<'_>,
    ) {
        let frame_now = placed.local_from_remembered();
        let is_due = self.sent.is_none_or(|(sent, before)| {
            let by_m = moved_m(&frame_now, &before, now.vehicle);
            cx.now().seconds_since(sent) >= RESEND_S || by_m > 0.5 * remembered.map.cell_size_m
        });
        if is_due {
            let frame = now.frame();
            let middles =
                (0..frame.side * frame.side).map(|slot| frame.middle(slot % frame.side, slot / frame.side));
            let cost = |middle| remembered.map.most(placed.to_remembered(middle), frame.cell_size_m);
            let costs: Vec<u8> = middles.map(cost).collect();
            self.send(ports, params, &frame, &costs, frame_now, cx);
        }
    }

    /// The frame of the remembered map in the local one; no transform while it is not believed. A route of an earlier run is
    /// placed by it: there is none either for a map of this run that lies in a frame of its own.
    pub(super) fn registration(&self, params: &MapMemoryParams, now: Stamp) -> FrameTransforms {
        let transform = |placed: Placed| {
            let Pose { translation: shift, rotation: q } = placed.local_from_remembered();
            FrameTransform {
                timestamp: Some(now.to_proto()),
                parent_frame_id: params.local_frame.clone(),
                child_frame_id: FRAME.to_owned(),
                translation: Some(Vector3 { x: shift.x, y: shift.y, z: shift.z }),
                rotation: Some(Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }),
            }
        };
        let placed = self.placed.filter(|_| self.own.as_ref().is_none_or(|own| own.is_in_given_frame));
        FrameTransforms { transforms: placed.map(transform).into_iter().collect() }
    }

    /// Takes back what was stated.
    pub(super) fn withdraw(
        &mut self,
        ports: &Ports,
        params: &MapMemoryParams,
        now: &Now<'_>,
        cx: &mut Cycle<'_>,
    ) {
        self.place(None);
        if self.sent.is_some() {
            let frame = now.frame();
            let unknown = vec![UNKNOWN_COST; frame.side * frame.side];
            self.send(ports, params, &frame, &unknown, Pose::IDENTITY, cx);
            self.sent = None;
        }
    }

    fn send(
        &mut self,
        ports: &Ports,
        params: &MapMemoryParams,
        frame: &GridFrame,
        costs: &[u8],
        local_from_remembered: Pose,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        self.sent = Some((now, local_from_remembered));
        let message = statement(frame, costs, CONFIDENCE, Source::MEMORY, &params.local_frame, now);
        cx.write(&ports.cost, now, message);
    }

    /// Sends the map to save if it is told to, or if it is time. What could not be saved is still asked for.
    pub(super) fn save(
        &mut self,
        ports: &Ports,
        params: &MapMemoryParams,
        origin: &Origin,
        seen: &Now<'_>,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        let is_due = self.saved.is_none_or(|saved| now.seconds_since(saved) >= params.save_every_s);
        if !(self.asked || is_due) {
            return;
        }
        // What was near, but behind a wall, was only seen from far.
        let sensed = match Rectangle::sensed_from_near(seen.map, params.near_m) {
            Ok(sensed) => sensed,
            Err(error) => return cx.fault(format!("map: {error}; not saved")),
        };
        self.saved = Some(now);
        match self.gather(params, origin, &sensed, seen) {
            Ok(Some(saved)) => {
                (self.asked, self.unsaved) = (false, None);
                self.jump.begin(seen.global_from_local);
                cx.write(&ports.memory, now, saved);
            }
            Ok(None) => {}
            Err(error) => self.unsaved = Some(error.to_string()),
        }
    }

    /// The map to save: what the vehicle has come near to, the newest last, and what it remembers. Until it is decided
    /// whether the remembered map fits, that is the remembered one as it was: it would be lost with a run that ends before,
    /// and where what is sensed lies in it is not known. What this run has saved itself stays until then: that is an error,
    /// and so is a map that the next run would refuse.
    fn gather(
        &mut self,
        params: &MapMemoryParams,
        origin: &Origin,
        sensed: &Rectangle,
        now: &Now<'_>,
    ) -> Result<Option<MapMemory>, MemoryError> {
        self.kept.take(sensed, &self.track, params.near_m)?;
        let old = self.remembered.map.as_ref().and_then(|map| map.as_ref().ok());
        if old.is_some() && self.is_undecided() {
            return match (&self.own, self.saved_in) {
                (Some(_), _) => Err(MemoryError::Unregistered),
                // What this run has saved is newer than what it was given.
                (None, Some(_)) => Ok(None),
                (None, None) => parse(&params.memory),
            };
        }
        // It would lie where the fixes have jumped to, and not be found by the next run.
        if let Some(by_m) = now.jumped_m {
            return Err(MemoryError::Jumped { by_m });
        }
        let old = old.zip(self.settled).map(|(old, placed)| (&old.map, placed.local_from_remembered()));
        let Some(saved) = self.kept.saved(old, now.global_from_local)? else { return Ok(None) };
        let saved = saved.to_memory(&origin.0);
        check(&saved)?;
        self.saved_in = Some(*now.global_from_local);
        Ok(Some(saved))
    }

    /// Whether a remembered map has neither been believed nor rejected. That of this run is not rejected because it does not
    /// fit: what was saved of it would be lost.
    pub(super) fn is_undecided(&self) -> bool {
        let may_fit = self.misfits < IN_TURN || self.own.is_some();
        self.settled.is_none() && self.dropped.is_none() && may_fit
    }
}
