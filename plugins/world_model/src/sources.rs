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
            let rule = |source| Rule { source, votes: VoteRule::default(), fade_per_s };
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
        };
        Listed {
            weights: with_least(named.clone().map(weighted).collect()),
            rules: named.map(rule).collect(),
        }
    }

    pub(crate) fn rule(&self, source: Source) -> Option<VoteRule> {
        self.rules.iter().find(|rule| rule.source == source).map(|rule| rule.votes)
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
