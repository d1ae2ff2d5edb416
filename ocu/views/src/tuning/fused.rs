//! What the newest map of a process says of its parameters: with which weights it was fused, which of these are learned
//! ones, and whether it was made before the parameters were sent.

use rcs_msg::params::with_params;
use rcs_msg::{AnyMessage, Stamp, rcs};
use rcs_runtime::Role;
use rcs_runtime::source::{Frame, Topic};
use rcs_world::{LEARNED_WEIGHTS, MapMessage, Weights, weights_beside, weights_learned, weights_of};
use std::collections::BTreeMap;

/// The weights of the newest map that differ from those of the parameters.
#[derive(Default)]
pub(super) struct Counting {
    /// The parameters, the weights of the map and the message of learned weights from which they were found.
    of: Option<(AnyMessage, Weights, Option<AnyMessage>)>,
    by_path: BTreeMap<String, f32>,
    /// The parameters with those of these weights that are no learned ones; `None` if there are none.
    made_with: Option<AnyMessage>,
}

impl Counting {
    /// By the path of the parameter. They are found again only when the parameters, the weights of the map or the
    /// learned weights change.
    pub(super) fn follow(
        &mut self,
        params: &AnyMessage,
        fused: Option<&Weights>,
        learned: Option<&AnyMessage>,
    ) -> &BTreeMap<String, f32> {
        let is_known = match (&self.of, fused) {
            (Some((of, weights, from)), Some(fused)) => {
                let is_from_it = from.as_ref().zip(learned).is_none_or(|(from, learned)| from.same(learned));
                of.same(params) && weights == fused && from.is_some() == learned.is_some() && is_from_it
            }
            (None, None) => true,
            _ => false,
        };
        if !is_known {
            self.of = fused.map(|fused| (params.clone(), fused.clone(), learned.cloned()));
            let differing = fused.map(|fused| weights_beside(params, fused));
            self.by_path = differing.into_iter().flatten().collect();
            let learned = learned.map(|learned| weights_learned(params, learned)).unwrap_or_default();
            let others = self.by_path.iter().filter(|(path, _)| !learned.contains(path));
            let texts: Vec<(&str, String)> =
                others.map(|(path, weight)| (path.as_str(), weight.to_string())).collect();
            let changes = texts.iter().map(|(path, weight)| (*path, weight.as_str()));
            self.made_with = if texts.is_empty() { None } else { with_params(params, changes).ok() };
        }
        &self.by_path
    }

    /// The parameters that were followed last, with the weights of the map; a weight that is replaced by a learned one
    /// stays as it is. `None` if no other one differs.
    pub(super) fn made_with(&self) -> Option<&AnyMessage> {
        self.made_with.as_ref()
    }
}

/// The newest maps of a process, of the run of its parameters.
fn maps<'a>(frame: &'a Frame, info: &'a rcs::ProcessInfo) -> impl Iterator<Item = &'a Topic> {
    let run = frame.topic(&info.params_buffer).map(|params| params.run);
    let is_its_map = move |topic: &&Topic| {
        *topic.writer == *info.name && Some(topic.run) == run && topic.role() == Some(Role::Map)
    };
    frame.topics.iter().filter(is_its_map)
}

/// The weights with which the newest map of a process was fused; `None` if no map of it states them.
pub(super) fn weights<'a>(frame: &'a Frame, info: &'a rcs::ProcessInfo) -> Option<&'a Weights> {
    maps(frame, info).find_map(message).map(|map| &map.options().weights)
}

/// The newest message of learned weights that a process has received; `None` if it has no such input.
pub(super) fn learned<'a>(frame: &'a Frame, info: &rcs::ProcessInfo) -> Option<&'a AnyMessage> {
    let input = info.inputs.iter().find(|input| input.schema == LEARNED_WEIGHTS)?;
    frame.topic(&input.buffer)?.canonical()
}

/// Whether the newest map of a process was made before it took its parameters, which have weights.
pub(super) fn awaits_map(frame: &Frame, info: &rcs::ProcessInfo) -> bool {
    let Some(params) = frame.topic(&info.params_buffer) else { return false };
    let Some(sent) = params.latest.as_ref().map(|sample| sample.header.log_time) else { return false };
    maps(frame, info).any(|map| made_at(map).is_some_and(|made| made <= sent))
        && params.canonical().is_some_and(|params| weights_of(params).is_some())
}

/// The newest map of a topic with its weights, if a process of this program has published it.
fn message(map: &Topic) -> Option<&MapMessage> {
    map.latest.as_ref()?.message.source()
}

/// Start of the cycle in which a map was made, where it says so, else when it was published.
fn made_at(map: &Topic) -> Option<Stamp> {
    let published = map.latest.as_ref()?.header.log_time;
    Some(message(map).map_or(published, MapMessage::time))
}
