//! The process `weight_learner`: adjusts the weights of a world model while the vehicle drives (Albus 2006b, 3.4). Its
//! port table is in the crate's documentation.
//!
//! It compares what each source had said of cells with what they turned out to be ([`rcs_world::Experience`]), and fits
//! the weights to half of that. New weights are sent if they do better on the other half, too, and never differ from the
//! parameters of the world model by more than a factor. Each change is a message that says why. Where the parameters say
//! that it does not adjust, the message says which weights would be better, and has those of the parameters. Where the
//! local frame begins again, what was said of cells before is forgotten, and what was learned stays.

use crate::proto::{FusionWeight, FusionWeights, WeightLearnerParams, WorldModelParams};
use crate::sources::Listed;
use rcs_msg::Stamp;
use rcs_msg::foxglove::Grid;
use rcs_runtime::{Cycle, In, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::FrameWatch;
use rcs_world::{
    Experience, Fit, FitRules, GridView, GridViewError, Judged, Outcome, Weights, fit, never_judged,
};
use serde::{Deserialize, Serialize};

/// Length of the stretches of time on which weights are fitted and checked in turn, s.
const STRETCH_S: f64 = 10.0;

/// State: the maps of the last seconds, the samples, the weights in use, and when they were fitted last.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WeightLearner {
    /// The weights of the world model's parameters, the better ones, and the experience with their sources.
    learned: Option<Learned>,
    fitted: Option<Stamp>,
    text: String,
    /// Whether the better weights were sent last, or else those of the parameters.
    adjusts: bool,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Learned {
    given: Weights,
    now: Weights,
    experience: Experience,
    /// Of the middles of the maps.
    frame: FrameWatch,
}

impl Learned {
    fn new(given: Weights) -> Learned {
        let (experience, frame) = (Experience::new(&given), FrameWatch::default());
        Learned { now: given.clone(), given, experience, frame }
    }

    /// Looks at a map. Where its middle leapt, the local frame has begun again.
    fn take(&mut self, view: &GridView<'_>, time: Stamp) -> Result<(), GridViewError> {
        if self.frame.leap_m(view.middle(), time).is_some() {
            self.experience.forget_maps();
        }
        self.experience.take(view, time)
    }

    /// The weights that the world model uses: the better ones if the process adjusts them, else those of its parameters.
    fn used(&self, adjusts: bool) -> &Weights {
        if adjusts { &self.now } else { &self.given }
    }
}

rcs_runtime::commands! {
    /// Commands of [`WeightLearner`].
    pub enum WeightLearnerCommand {
        Reset = "RESET" once: "Forget what was learned: the weights are those of the parameters again.",
    }
}

/// Ports of [`WeightLearner`].
#[derive(Debug)]
pub struct Ports {
    map: In<Grid>,
    params: In<WorldModelParams>,
    weights: Out<FusionWeights>,
}

impl Process for WeightLearner {
    type Params = WeightLearnerParams;
    type Ports = Ports;
    type Command = WeightLearnerCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "weight_learner",
        summary: "Adjusts the weights of a world model by how each source agreed with what was driven over and hit",
        period_ms: 1000.0,
        latency_ms: 200.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            map: b.input("map", "the world model's map, with the evidence of each source"),
            params: b.input("params", "the world model's parameters, which give the weights to begin with"),
            weights: b
                .output("weights", "weights of the sources, and why they are these")
                .role(Role::Stats)
                .build(),
        }
    }

    fn new(_params: &WeightLearnerParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &WeightLearnerParams, cx: &mut Cycle<'_>) {
        let now = cx.now();
        while let Some(command) = cx.next_command::<Self>() {
            let WeightLearnerCommand::Reset = command;
            if let Some(learned) = &mut self.learned {
                *learned = Learned::new(learned.given.clone());
                (self.fitted, self.text) = (None, String::new());
                send(ports, learned, self.adjusts, "reset".to_owned(), [Judged::default(); 2], cx);
            }
        }
        if let Some(given) = cx.latest(&ports.params).map(|params| Listed::of(&params).weights)
            && self.learned.as_ref().is_none_or(|learned| learned.given != given)
        {
            let learned = self.learned.insert(Learned::new(given));
            (self.fitted, self.text) = (None, String::new());
            let reason = "weights of the parameters".to_owned();
            send(ports, learned, self.adjusts, reason, [Judged::default(); 2], cx);
        }
        if self.adjusts != params.adjusts {
            self.adjusts = params.adjusts;
            if let Some(learned) = self.learned.as_ref().filter(|learned| learned.now != learned.given) {
                let reason = if params.adjusts { "adjusts as told" } else { "does not adjust as told" };
                send(ports, learned, self.adjusts, reason.to_owned(), [Judged::default(); 2], cx);
            }
        }
        let map = cx.read_newest(&ports.map);
        let (Some(learned), Some(map)) = (&mut self.learned, map) else {
            return match self.text.as_str() {
                "" => cx.exec("waits for maps and parameters"),
                text => cx.exec(text.to_owned()),
            };
        };
        let taken = match GridView::of(map.message()) {
            Ok(view) => learned.take(&view, map.acq_time()),
            Err(error) => Err(error),
        };
        if let Err(error) = taken {
            return cx.fault(format!("map: {error}; skipped"));
        }
        learned.experience.keep_newest(params.judgements as usize);
        let fitted = *self.fitted.get_or_insert(now);
        if now.seconds_since(fitted) >= params.fit_every_s {
            self.fitted = Some(now);
            self.text = match refit(learned, params) {
                Ok(Some(Better { reason, judged, is_new })) => {
                    let reason = if self.adjusts { reason } else { format!("better would be {reason}") };
                    if is_new {
                        send(ports, learned, self.adjusts, reason.clone(), judged, cx);
                    }
                    reason
                }
                Ok(None) => {
                    format!("no better weights for {} judgements", learned.experience.samples().len())
                }
                Err(why) => {
                    let cause = cx.latest(&ports.params).and_then(|params| never_judged(params.message()));
                    let cause = cause.map_or_else(String::new, |cause| format!("; {cause}"));
                    format!("too little experience: {why}{cause}")
                }
            };
        }
        match self.text.as_str() {
            "" => cx.exec("collects experience"),
            text => cx.exec(text.to_owned()),
        }
    }
}

/// Weights that are better than those in use.
struct Better {
    /// Why.
    reason: String,
    /// How those in use and the better ones judge the half of the experience to which they were not fitted.
    judged: [Judged; 2],
    /// Whether the fit before did not call them better.
    is_new: bool,
}

/// Weights that are better than those in use, if there are some.
fn refit(learned: &mut Learned, params: &WeightLearnerParams) -> Result<Option<Better>, String> {
    let [ours, others] = learned.experience.samples().split(STRETCH_S);
    let rules = FitRules { greatest_factor: params.greatest_factor as f32, ..FitRules::default() };
    // From the weights of the parameters each time, so that the factor bounds the whole change.
    let Fit { weights, .. } = fit(&ours, &learned.given, &rules)?;
    let used = learned.used(params.adjusts).clone();
    let judged = [&used, &weights].map(|weights| others.judge(weights));
    if weights == used || judged[1].loss >= judged[0].loss * (1.0 - rules.least_gain) {
        // What an earlier fit called better and is not used would count once the process adjusts.
        learned.now = used;
        return Ok(None);
    }
    let changes = weights.iter().filter_map(|entry| {
        let before = used.get(entry.source).weight;
        (entry.weight != before).then(|| format!("{} {before} to {}", entry.source, entry.weight))
    });
    let changes: Vec<String> = changes.collect();
    let wrong = |judged: &Judged| judged.wrong.iter().sum::<u64>();
    let count: u64 = judged[0].count.iter().sum();
    let reason = format!(
        "{}: {} instead of {} of {count} judgements are wrong, squared error {:.3} instead of {:.3}",
        changes.join(", "),
        wrong(&judged[1]),
        wrong(&judged[0]),
        judged[1].loss,
        judged[0].loss,
    );
    let is_new = weights != learned.now;
    learned.now = weights;
    Ok(Some(Better { reason, judged, is_new }))
}

fn send(
    ports: &Ports,
    learned: &Learned,
    adjusts: bool,
    reason: String,
    judged: [Judged; 2],
    cx: &mut Cycle<'_>,
) {
    let now = cx.now();
    let used = learned.used(adjusts);
    let weight = |entry: rcs_world::Weighted| FusionWeight {
        source: entry.source.to_string(),
        weight: f64::from(entry.weight),
        given: f64::from(learned.given.get(entry.source).weight),
    };
    let [driven, hit, seen] = Outcome::ALL.map(|outcome| judged[1].count[outcome as usize]);
    let message = FusionWeights {
        timestamp: Some(now.to_proto()),
        weights: used.iter().map(weight).collect(),
        reason,
        loss_before: judged[0].loss,
        loss_after: judged[1].loss,
        driven,
        hit,
        seen,
    };
    cx.write(&ports.weights, now, message);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_geom::DVec2;
    use rcs_world::{Map, MapMessage, MapOptions, Source, SourceKind, VoteRule, Weighted};

    /// The number of samples from two maps, 1 s apart, whose middles are so far apart, m. Colour judges a cell that both
    /// have, and then the bumper says that it was driven over.
    fn samples(apart_m: f64) -> usize {
        let kinds = [(Source::COLOR, SourceKind::Learned), (Source::BUMPER, SourceKind::Override)];
        let weights: Weights =
            kinds.into_iter().map(|(source, kind)| Weighted { source, weight: 1.0, kind }).collect();
        let sources = kinds.into_iter().map(|(source, _)| source).collect();
        let options = MapOptions { sources, heights: false, weights: weights.clone() };
        let mut learned = Learned::new(weights);
        for (second, middle_m, source) in [(1, 0.0, Source::COLOR), (2, apart_m, Source::BUMPER)] {
            let mut map = Map::new(0.2).unwrap();
            map.recentre(DVec2::new(middle_m, 0.0));
            let cell = map.grid().cell_at(DVec2::new(0.5 * apart_m, 0.1)).unwrap();
            map.vote(cell, source, 0, 1, Stamp(1), VoteRule::default());
            let time = Stamp(second * 1_000_000_000);
            let message = MapMessage::new(map, "local", time, options.clone());
            learned.take(&GridView::of_map(&message), time).unwrap();
        }
        learned.experience.samples().len()
    }

    #[test]
    fn what_was_said_before_the_local_frame_began_again_is_no_judgement_of_the_ground_there_now() {
        assert_eq!(samples(2.0), 1);
        assert_eq!(samples(30.0), 0);
    }
}
