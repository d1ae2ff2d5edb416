//! What maps and scenes draw of a topic, and the frame of a new one that is opened for a topic.

use super::layers::{self, Kind, Layer};
use super::{Map, for_scene};
use crate::view::Draws;
use rcs_runtime::source::{Frame, Topic};
use std::collections::BTreeMap;

/// What is drawn of a topic with these layers. `lies` says whether a layer has a place in the frame, `shown` whether it
/// is switched on. A topic without a layer, such as one without a message yet, is drawn once it has one.
fn draws(own: &[&Layer<'_>], lies: impl Fn(&Layer<'_>) -> bool, shown: impl Fn(&Layer<'_>) -> bool) -> Draws {
    let mut placed = own.iter().filter(|&&layer| lies(layer)).peekable();
    if placed.peek().is_none() && !own.is_empty() {
        return Draws::Never;
    }
    if placed.any(|&layer| shown(layer)) { Draws::Now } else { Draws::OnceDropped }
}

/// What a map draws of a topic that it accepts.
pub(super) fn on_map(map: &Map, frame: &Frame, topic: &Topic) -> Draws {
    let layers = layers::layers(frame);
    let own: Vec<_> = layers.iter().filter(|layer| layer.is_of(topic)).collect();
    let name = layers::map_frame(frame, &layers, map.saved.frame.as_deref());
    // A track without a transform may be aligned with another one.
    let is_aligned = |layer: &Layer<'_>| {
        map.tracks.placed.get(&layer.name).is_some_and(|placed| placed.map_from_track.is_some())
    };
    let lies = |layer: &Layer<'_>| {
        name.is_some_and(|name| layers::map_from_layer(frame, name, layer).is_ok()) || is_aligned(layer)
    };
    draws(&own, lies, |layer| map.state(layer).shown)
}

/// What a scene draws of a topic that it accepts. `chosen` is its frame, if a person has chosen one, and `switched` the
/// layers that a person has switched.
pub(crate) fn in_scene(
    frame: &Frame,
    chosen: Option<&str>,
    switched: &BTreeMap<String, bool>,
    topic: &Topic,
) -> Draws {
    let layers = layers::layers(frame);
    let own: Vec<_> = layers.iter().filter(|layer| layer.is_of(topic)).collect();
    let name = layers::map_frame(frame, &layers, chosen);
    let lies = |layer: &Layer<'_>| {
        let is_drawn = !matches!(layer.kind, Kind::Goal(_));
        is_drawn && name.is_some_and(|name| layers::map_from_layer(frame, name, layer).is_ok())
    };
    let has_map = layers.iter().any(Layer::is_map);
    draws(&own, lies, |layer| {
        switched.get(&layer.name).copied().unwrap_or_else(|| for_scene::is_usual(layer, has_map))
    })
}

/// A frame in which a topic can be drawn: the one above all others to which it is connected.
pub(crate) fn frame_for(frame: &Frame, topic: &Topic) -> Option<String> {
    let layers = layers::layers(frame);
    let own = layers.iter().find(|layer| layer.is_of(topic))?;
    Some(layers::root_above(frame, own.frame_id).to_owned())
}
