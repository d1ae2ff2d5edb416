//! The sources that the parameters list, as the algorithms use them.

use crate::proto::{WorldModelParams, WorldModelSource, WorldModelSourceKind};
use rcs_world::{Source, SourceKind, Sources, VoteRule, Weighted, Weights};

/// The sources listed in the parameters.
pub(crate) struct Listed {
    pub(crate) weights: Weights,
    /// In the same order.
    rules: Vec<Rule>,
}

/// How the evidence of a source changes.
struct Rule {
    source: Source,
    votes: VoteRule,
    fade_per_s: f64,
    least_backing: u8,
}

impl Listed {
    /// The sources listed in the parameters; the built-in ones if none is listed.
    pub(crate) fn of(params: &WorldModelParams) -> Listed {
        let with_least = |mut weights: Weights| {
            weights.least_evidence = params.least_evidence as f32;
            weights
        };
        if params.sources.is_empty() {
            let fade_per_s = WorldModelSource::default().fade_per_s;
            let rule = |source| Rule { source, votes: VoteRule::default(), fade_per_s, least_backing: 0 };
            return Listed {
                weights: with_least(Weights::default()),
                rules: Source::BUNDLED.into_iter().map(rule).collect(),
            };
        }
        // Names were checked when the parameters were set.
        let named = params.sources.iter().filter_map(|entry| Some((Source::new(&entry.name).ok()?, entry)));
        let weighted = |(source, entry): (Source, &WorldModelSource)| {
            let kind = match entry.kind() {
                WorldModelSourceKind::SourceRange => SourceKind::Range,
                WorldModelSourceKind::SourceOverride => SourceKind::Override,
                WorldModelSourceKind::SourceLearned => SourceKind::Learned,
            };
            Weighted { source, weight: entry.weight as f32, kind }
        };
        let byte = |value: u32| value.min(255) as u8;
        let rule = |(source, entry): (Source, &WorldModelSource)| Rule {
            source,
            votes: VoteRule {
                rise: byte(entry.gain_up),
                fall: byte(entry.gain_down),
                obstacle_fall: byte(entry.obstacle_gain_down),
                max: byte(entry.max_confidence),
                ground_max: byte(entry.max_ground_confidence),
            },
            fade_per_s: entry.fade_per_s,
            least_backing: (entry.least_backing * 255.0 + 0.5) as u8,
        };
        Listed {
            weights: with_least(named.clone().map(weighted).collect()),
            rules: named.map(rule).collect(),
        }
    }

    /// The same with weights that were learned: source, weight, and the weight of the parameters from which it was
    /// learned. One that was learned from another weight than that of the parameters does not count.
    pub(crate) fn with_learned(mut self, learned: &[(Source, f32, f32)]) -> Listed {
        for &(source, weight, given) in learned {
            if self.rule(source).is_some() && self.weights.get(source).weight == given {
                self.weights = self.weights.with(source, weight);
            }
        }
        self
    }

    pub(crate) fn rule(&self, source: Source) -> Option<VoteRule> {
        self.rules.iter().find(|rule| rule.source == source).map(|rule| rule.votes)
    }

    /// Backing, 0 to 255, below which costs of a source are left out.
    pub(crate) fn least_backing(&self, source: Source) -> u8 {
        self.rules.iter().find(|rule| rule.source == source).map_or(0, |rule| rule.least_backing)
    }

    /// How much the confidences of a source decrease per second.
    pub(crate) fn fade_per_s(&self, source: Source) -> f64 {
        self.rules.iter().find(|rule| rule.source == source).map_or(0.0, |rule| rule.fade_per_s)
    }
}

/// Refuses invalid names and sources that are listed twice.
pub(crate) fn check_sources(params: &WorldModelParams) -> Result<(), String> {
    let mut names = Sources::default();
    for (place, entry) in params.sources.iter().enumerate() {
        let source = Source::new(&entry.name).map_err(|error| format!("sources[{place}].name: {error}"))?;
        if names.contains(source) {
            return Err(format!("sources[{place}].name: {source} is listed twice"));
        }
        names.insert(source);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{FusionWeight, FusionWeights};
    use rcs_msg::AnyMessage;
    use rcs_world::{Fused, LEARNED_WEIGHTS, weight_field, weights_beside, weights_learned, weights_of};

    #[test]
    fn a_learned_weight_counts_with_the_weight_of_the_parameters_from_which_it_was_learned() {
        let entry =
            |name: &str| WorldModelSource { name: name.to_owned(), weight: 0.5, ..Default::default() };
        let params =
            WorldModelParams { sources: vec![entry("stereo"), entry("color")], ..Default::default() };
        let given = Listed::of(&params).weights;
        let learned =
            |source, weight, given| Listed::of(&params).with_learned(&[(source, weight, given)]).weights;
        assert_eq!(learned(Source::COLOR, 0.2, 0.5), given.clone().with(Source::COLOR, 0.2));
        assert_eq!(learned(Source::COLOR, 0.2, 0.4), given, "the parameters have changed");
        assert_eq!(learned(Source::TERRAIN, 0.2, 1.0), given, "not listed");
    }

    #[test]
    fn a_window_finds_the_weights_with_which_a_map_was_fused_beside_those_of_the_parameters() {
        let entry =
            |name: &str| WorldModelSource { name: name.to_owned(), weight: 0.5, ..Default::default() };
        let params =
            WorldModelParams { sources: vec![entry("stereo"), entry("color")], ..Default::default() };
        let fused = Listed::of(&params).with_learned(&[(Source::COLOR, 0.25, 0.5)]).weights;
        let message = AnyMessage::new(params.clone());
        assert_eq!(weights_beside(&message, &fused), [("sources[1].weight".to_owned(), 0.25_f32)]);
        assert!(weights_beside(&message, &Listed::of(&params).weights).is_empty());
    }

    #[test]
    fn a_window_finds_the_weights_of_the_parameters_that_are_replaced_by_learned_ones() {
        let entry =
            |name: &str| WorldModelSource { name: name.to_owned(), weight: 0.5, ..Default::default() };
        let params =
            WorldModelParams { sources: vec![entry("stereo"), entry("color")], ..Default::default() };
        let of = |source: Source, weight: f64, given: f64| {
            let learned = [(source, weight as f32, given as f32)];
            let is_other = Listed::of(&params).with_learned(&learned).weights != Listed::of(&params).weights;
            let weights = vec![FusionWeight { source: source.to_string(), weight, given }];
            let message = AnyMessage::new(FusionWeights { weights, ..Default::default() });
            assert_eq!(message.schema().name(), LEARNED_WEIGHTS);
            let found = weights_learned(&AnyMessage::new(params.clone()), &message);
            assert_eq!(is_other, !found.is_empty(), "the process does what the window finds");
            found
        };
        assert_eq!(of(Source::COLOR, 0.2, 0.5), ["sources[1].weight"]);
        assert_eq!(of(Source::COLOR, 0.0, 0.5), ["sources[1].weight"]);
        assert!(of(Source::COLOR, 0.5, 0.5).is_empty(), "nothing was learned");
        assert!(of(Source::COLOR, 0.2, 0.4).is_empty(), "the parameters have changed");
        assert!(of(Source::TERRAIN, 0.2, 1.0).is_empty(), "not listed");
    }

    /// A window fuses a map again with weights that it reads from the parameters: they must be those of the process.
    #[test]
    fn a_window_reads_the_same_weights_from_the_parameters() {
        let entry = |name: &str, kind, weight| WorldModelSource {
            name: name.to_owned(),
            kind: i32::from(kind),
            weight,
            ..Default::default()
        };
        let sources = vec![
            entry("stereo", WorldModelSourceKind::SourceRange, 0.7),
            entry("color", WorldModelSourceKind::SourceLearned, 0.2),
            entry("bumper", WorldModelSourceKind::SourceOverride, 1.0),
        ];
        for sources in [sources, Vec::new()] {
            let params = WorldModelParams { sources, least_evidence: 7.0, ..Default::default() };
            let message = AnyMessage::new(params.clone());
            let read = weights_of(&message).unwrap();
            assert_eq!(read, Listed::of(&params).weights);
            assert_eq!(read.least_evidence, 7.0);
        }
        let params = AnyMessage::new(WorldModelParams::default());
        assert_eq!(weight_field(&params, Source::COLOR), None, "the defaults list no sources");
        assert_eq!(weights_of(&AnyMessage::new(rcs_msg::foxglove::Grid::default())), None);
        assert_eq!(rcs_world::fuse(&[], &weights_of(&params).unwrap()), Fused::UNKNOWN);
    }
}
