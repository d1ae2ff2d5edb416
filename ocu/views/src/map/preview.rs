//! A map with weights that are being edited, or that were sent and count from the next map on.
//!
//! Only the weights that differ from those of the parameters before replace the ones with which the map was fused: some of
//! these may have been learned, and count until the parameter is changed.

use super::layers::Layer;
use crate::tuning::{in_force, is_equal};
use crate::view::{Preview, PreviewStage};
use rcs_runtime::source::Frame;
use rcs_world::{MapMessage, Weights, weights_of};

/// A preview and its weights.
pub(super) struct Edited {
    pub(super) preview: Preview,
    /// Those of its parameters, and those of the parameters before; `None` for a process that fuses no costs.
    weights: Option<[Weights; 2]>,
}

/// Whether a preview shows what will be: parameters that were in force must be so still. The view that states it may be
/// hidden while the run goes back to before it.
pub(super) fn holds(preview: &Preview, frame: &Frame) -> bool {
    let process = || frame.processes.iter().find(|info| *info.name == *preview.process);
    let is_in_force = || {
        process().and_then(|info| in_force(frame, info)).is_some_and(|now| is_equal(&now, &preview.params))
    };
    preview.stage != PreviewStage::InForce || is_in_force()
}

impl Edited {
    pub(super) fn of(preview: &Preview) -> Self {
        let [edited, before] = [&preview.params, &preview.before].map(weights_of);
        Self {
            preview: preview.clone(),
            weights: edited.zip(before).map(|(edited, before)| [edited, before]),
        }
    }

    /// The weights with which a layer is to be fused; `None` where it is none of the maps that are previewed, or was fused
    /// with them. A map that states no weights is taken as fused with those of the parameters before.
    pub(super) fn weights_for(&self, layer: &Layer<'_>) -> Option<Weights> {
        let [edited, before] = self.weights.as_ref()?;
        let topic = layer.topic.filter(|_| layer.is_map())?;
        if (&topic.writer, topic.run) != (&self.preview.process, self.preview.run) {
            return None;
        }
        let fused = topic.canonical()?.source::<MapMessage>().map_or(before, |map| &map.options().weights);
        let weights = on(fused, edited, before);
        (weights != *fused).then_some(weights)
    }

    /// What is said of the maps with these names.
    pub(super) fn text(&self, names: &[&str]) -> String {
        let state = match self.preview.stage {
            PreviewStage::Edited => "edited weights, not sent",
            PreviewStage::OnItsWay => "weights sent, on their way",
            PreviewStage::InForce => "weights sent, in force from the next map",
        };
        format!("preview of {}: {state}", names.join(", "))
    }
}

/// The edited weights, with those of the map for sources whose weight is as before.
fn on(fused: &Weights, edited: &Weights, before: &Weights) -> Weights {
    let unchanged = edited.iter().filter(|entry| entry.weight == before.get(entry.source).weight);
    unchanged
        .fold(edited.clone(), |weights, entry| weights.with(entry.source, fused.get(entry.source).weight))
}

#[cfg(test)]
impl Edited {
    /// Weights of `wm1` that are being edited in the first run, and those before.
    pub(super) fn of_wm1(edited: Weights, before: Weights) -> Self {
        // Any message will do: the weights are read already.
        let params = rcs_msg::AnyMessage::new(rcs_msg::rcs::SpeedLimit { max_speed_mps: 1.0 });
        let run = rcs_runtime::source::RunTag::FIRST;
        let stage = PreviewStage::Edited;
        let preview = Preview { process: "wm1".into(), run, before: params.clone(), params, stage };
        Self { preview, weights: Some([edited, before]) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::layers::layers;
    use super::*;
    use crate::samples;
    use rcs_runtime::source::{RunTag, Topic};
    use rcs_world::Source;
    use std::sync::Arc;

    /// A map of `wm1` that was fused with these weights.
    fn map(weights: Weights) -> Topic {
        let map = rcs_world::Map::new(0.2).unwrap();
        let options = rcs_world::MapOptions { sources: map.sources(), heights: false, weights };
        let message = MapMessage::new(map, "local", samples::NOW, options).into_message();
        let driving = samples::driving();
        let topic = driving.topic("/wm1/map").unwrap().clone();
        let sample = topic.latest.clone().unwrap();
        topic.with_latest(rcs_bus::Sample { message, ..sample })
    }

    fn weights_for(edited: &Edited, topic: Topic) -> Option<Weights> {
        let frame = Frame { topics: Arc::new([topic]), ..samples::driving() };
        layers(&frame).iter().find_map(|layer| edited.weights_for(layer))
    }

    #[test]
    fn edited_weights_count_on_a_map_beside_those_that_were_learned() {
        let given = Weights::default();
        let learned = given.clone().with(Source::COLOR, 0.25).with(Source::TERRAIN, 0.5);
        let stereo = Edited::of_wm1(given.clone().with(Source::STEREO, 0.0), given.clone());
        let expected = learned.clone().with(Source::STEREO, 0.0);
        assert_eq!(weights_for(&stereo, map(learned.clone())), Some(expected));
        // A weight that is edited is no longer the one that was learned.
        let color = Edited::of_wm1(given.clone().with(Source::COLOR, 0.75), given.clone());
        let expected = learned.clone().with(Source::COLOR, 0.75);
        assert_eq!(weights_for(&color, map(learned.clone())), Some(expected));
        let nothing = Edited::of_wm1(given.clone(), given);
        assert_eq!(weights_for(&nothing, map(learned)), None, "no weight was edited");
    }

    #[test]
    fn edited_weights_repaint_the_map_of_their_run_and_no_recorded_one() {
        let before = Weights::default();
        let edited = Edited::of_wm1(before.clone().with(Source::STEREO, 0.0), before.clone());
        let of_run = map(before);
        let mut recorded = of_run.clone();
        recorded.run = RunTag::Recorded;
        assert!(weights_for(&edited, of_run).is_some());
        assert_eq!(weights_for(&edited, recorded), None);
    }

    #[test]
    fn a_map_that_was_made_with_the_weights_that_were_sent_is_no_preview() {
        let before = Weights::default();
        let sent = before.clone().with(Source::STEREO, 0.0);
        let edited = Edited::of_wm1(sent.clone(), before.clone());
        assert!(weights_for(&edited, map(before)).is_some());
        assert_eq!(weights_for(&edited, map(sent)), None);
    }

    #[test]
    fn what_was_sent_is_no_preview_where_it_is_not_in_force_any_more() {
        let speed = |max_speed_mps: f64| rcs_msg::AnyMessage::new(rcs_msg::rcs::SpeedLimit { max_speed_mps });
        let preview = |stage: PreviewStage| Preview { stage, params: speed(2.0), ..edited().preview };
        let frame = |in_force: f64| {
            let limit = rcs_msg::rcs::SpeedLimit { max_speed_mps: in_force };
            let params = samples::topic("/wm1/params", 0.0, 1.0, limit);
            let info = rcs_msg::rcs::ProcessInfo {
                name: "wm1".into(),
                params_buffer: "/wm1/params".into(),
                ..Default::default()
            };
            Frame { topics: Arc::new([params]), processes: Arc::new([info]), ..samples::driving() }
        };
        let sent = preview(PreviewStage::InForce);
        assert_eq!([2.0, 1.0].map(|in_force| holds(&sent, &frame(in_force))), [true, false]);
        for stage in [PreviewStage::Edited, PreviewStage::OnItsWay] {
            assert!(holds(&preview(stage), &frame(1.0)), "{stage:?} is not in force");
        }
    }

    fn edited() -> Edited {
        Edited::of_wm1(Weights::default(), Weights::default())
    }
}
