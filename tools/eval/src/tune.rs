//! Learns the weights of a world model from a drive: the implementation of `ocu tune`.
//!
//! The maps of a recording, or of a stack that runs on it, tell what each source said of cells that the vehicle drove
//! over, bumped into, or saw from near later ([`rcs_world::Experience`]). Weights are fitted to half of the drive, every
//! other stretch of ten seconds, and checked on the rest. They are kept if they do better there, too.

use crate::EvalError;
use crate::messages::each_whole;
use rcs_log::Log;
use rcs_msg::foxglove::Grid;
use rcs_msg::params::with_params;
use rcs_msg::{AnyMessage, Stamp, schema_of};
use rcs_runtime::{Plan, ProcessPlan, RunOptions, Stepped};
use rcs_sense::FrameWatch;
use rcs_world::{Experience, Fit, FitRules, GridView, Judged, MapMessage, Samples, SourceKind, Weighted};
use rcs_world::{Weights, fit, never_judged, weight_field, weights_of};
use serde::Serialize;
use std::fmt;
use std::sync::Arc;

/// Length of the stretches of time on which weights are fitted and checked in turn, s.
const STRETCH_S: f64 = 10.0;

/// What is learned.
#[derive(Clone, Debug)]
pub struct Job<'a> {
    /// The stack whose weights are learned. It runs on the recording if that has no maps of it.
    pub plan: Arc<Plan>,
    /// The process whose weights are learned; `None` for the first one that has some.
    pub process: Option<&'a str>,
    /// Whether the stack runs even if the recording has its maps.
    pub runs: bool,
    /// Options of the run.
    pub options: RunOptions,
}

impl Job<'_> {
    /// Whether the stack runs on this recording.
    pub fn runs_on(&self, log: &Log) -> Result<bool, EvalError> {
        let (process, _) = weighted(self)?;
        let buffer = map_of(&self.plan, process)?;
        Ok(self.runs || log.info().topics_named(buffer).next().is_none())
    }
}

/// A weight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WeightReport {
    /// Name of the source.
    pub source: String,
    /// How its evidence is used.
    pub kind: SourceKind,
    /// The weight of the stack.
    pub before: f32,
    /// The weight that was fitted.
    pub after: f32,
    /// The squared error of all judgements without the source, the other weights as before: what the source is worth.
    /// `None` where the weight does not count.
    pub loss_without: Option<f64>,
}

/// How the weights of the stack judge, and how those that were fitted do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Compared {
    /// Those of the stack.
    pub before: Judged,
    /// Those that were fitted.
    pub after: Judged,
}

/// What was learned.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// The process.
    pub process: String,
    /// Number of maps.
    pub maps: u64,
    /// The weights.
    pub weights: Vec<WeightReport>,
    /// The squared error of all judgements with the weights of the stack.
    pub loss: f64,
    /// On the half of the drive to which they were fitted.
    pub fitted: Compared,
    /// On the other half.
    pub checked: Compared,
    /// Why the other half cannot check them, if so.
    pub unchecked: Option<String>,
    /// Whether they do better on the other half, too.
    pub kept: bool,
}

/// What was learned, and the parameters of the process with the weights that were kept.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// What was learned.
    pub report: Report,
    /// The parameters: those of the stack if nothing was kept.
    pub params: AnyMessage,
}

/// Learns the weights of a stack's process from a recording.
pub fn tune(job: &Job<'_>, log: &Log) -> Result<Tuned, EvalError> {
    let (process, weights) = weighted(job)?;
    let buffer = map_of(&job.plan, process)?;
    let mut maps = Maps { experience: Experience::new(&weights), frame: FrameWatch::default(), count: 0 };
    if job.runs_on(log)? {
        maps.run(job, log, buffer)?;
    } else {
        maps.read(log, buffer)?;
    }
    let Maps { experience, count, .. } = maps;
    if count == 0 {
        return Err(EvalError::nothing(format!("there is no message of {buffer}")));
    }
    let [ours, others] = experience.samples().split(STRETCH_S);
    let fitted = fit(&ours, &weights, &FitRules::default()).map_err(|why| {
        EvalError::nothing(format!("{buffer} holds too little experience: {}", with_cause(why, process)))
    })?;
    report(process, count, &weights, &fitted, [experience.samples(), &others])
}

/// Why experience does not suffice, and the cause where a longer drive does not help.
fn with_cause(why: String, process: &ProcessPlan) -> String {
    match never_judged(&process.params) {
        Some(cause) => format!("{why}; {cause}"),
        None => why,
    }
}

/// The process, and its weights.
fn weighted<'a>(job: &'a Job<'_>) -> Result<(&'a ProcessPlan, Weights), EvalError> {
    let with_weights = |process: &'a ProcessPlan| Some((process, weights_of(&process.params)?));
    let mut found = job.plan.processes.iter().filter_map(with_weights);
    let Some(name) = job.process else {
        return found.next().ok_or_else(|| EvalError::refused("the stack has no process with weights"));
    };
    let names: Vec<&str> = found.clone().map(|(process, _)| &*process.name).collect();
    let expected = if names.is_empty() { "none of the stack has some".to_owned() } else { names.join(", ") };
    found.find(|(process, _)| *process.name == *name).ok_or_else(|| {
        EvalError::refused(format!("no process {name:?} has weights; expected one of: {expected}"))
    })
}

/// The buffer of the maps of a process.
fn map_of<'a>(plan: &'a Plan, process: &ProcessPlan) -> Result<&'a str, EvalError> {
    let buffers = process.outputs.iter().filter_map(|&at| plan.buffers.get(at)).map(|buffer| &buffer.spec);
    let is_map = |spec: &&rcs_bus::BufferSpec| {
        spec.metadata.get("rcs.role").is_some_and(|role| role == "map")
            && spec.schema.name() == schema_of::<Grid>().name()
    };
    buffers
        .clone()
        .find(is_map)
        .map(|spec| &*spec.name)
        .ok_or_else(|| EvalError::refused(format!("{} has no output of maps", process.name)))
}

/// The maps of a drive.
struct Maps {
    experience: Experience,
    /// Of the middles of the maps.
    frame: FrameWatch,
    count: u64,
}

impl Maps {
    fn read(&mut self, log: &Log, buffer: &str) -> Result<(), EvalError> {
        let topics: Vec<_> = log.info().topics_named(buffer).map(|topic| topic.id).collect();
        each_whole(log, &topics, |_, message, time| self.take(message, time))
    }

    fn run(&mut self, job: &Job<'_>, log: &Log, buffer: &str) -> Result<(), EvalError> {
        if job.plan.inputs.is_empty() {
            return Err(EvalError::refused(format!(
                "the recording has no {buffer}, and the stack reads nothing of a recording from which it could make some"
            )));
        }
        let mut run =
            Stepped::new(job.plan.clone(), Some(log), job.options.clone()).map_err(EvalError::Start)?;
        let maps = run.buffers().iter().find(|other| other.name() == buffer).cloned();
        let maps = maps.ok_or_else(|| EvalError::refused(format!("the stack has no buffer {buffer}")))?;
        run.begin()?;
        let end = run.horizon().unwrap_or(Stamp(0));
        let mut seen = 0;
        while run.next_time()?.is_some_and(|time| time <= end) {
            run.advance()?;
            if maps.newest() != seen {
                seen = maps.newest();
                if let Some(sample) = maps.latest() {
                    self.take(&sample.message, sample.header.acq_time)?;
                }
            }
        }
        Ok(())
    }

    fn take(&mut self, message: &AnyMessage, time: Stamp) -> Result<(), EvalError> {
        let told =
            |error: rcs_world::GridViewError| EvalError::nothing(format!("a map is unusable: {error}"));
        // A message of a log is bytes until it is decoded.
        let decoded = if message.source::<MapMessage>().is_some() { None } else { message.to::<Grid>() };
        let view = decoded.as_ref().map_or_else(|| GridView::of(message), GridView::new).map_err(told)?;
        self.count += 1;
        if self.frame.leap_m(view.middle(), time).is_some() {
            self.experience.forget_maps();
        }
        self.experience.take(&view, time).map_err(told)
    }
}

fn report(
    process: &ProcessPlan,
    maps: u64,
    weights: &Weights,
    fit: &Fit,
    [all, others]: [&Samples; 2],
) -> Result<Tuned, EvalError> {
    let checked = Compared { before: others.judge(weights), after: others.judge(&fit.weights) };
    let unchecked = others.suffice().err().map(|why| with_cause(why, process));
    let is_better = unchecked.is_none() && checked.after.loss < checked.before.loss;
    let kept = !fit.changes.is_empty() && is_better;
    let of = |entry: Weighted| WeightReport {
        source: entry.source.to_string(),
        kind: entry.kind,
        before: entry.weight,
        after: fit.weights.get(entry.source).weight,
        loss_without: (entry.kind != SourceKind::Override && entry.weight > 0.0)
            .then(|| all.judge(&weights.clone().with(entry.source, 0.0)).loss),
    };
    let report = Report {
        process: process.name.to_string(),
        maps,
        weights: weights.iter().map(of).collect(),
        loss: all.judge(weights).loss,
        fitted: Compared { before: fit.before, after: fit.after },
        checked,
        unchecked,
        kept,
    };
    let changed = weights.iter().filter(|entry| kept && fit.weights.get(entry.source).weight != entry.weight);
    let changes: Vec<(String, String)> = changed
        .filter_map(|entry| {
            let field = weight_field(&process.params, entry.source)?;
            Some((field, fit.weights.get(entry.source).weight.to_string()))
        })
        .collect();
    let changes = changes.iter().map(|(field, value)| (field.as_str(), value.as_str()));
    let params =
        with_params(&process.params, changes).map_err(|error| EvalError::nothing(error.to_string()))?;
    Ok(Tuned { report, params })
}

impl Report {
    /// Whether the weights that were fitted are kept, and why.
    pub fn verdict(&self) -> String {
        let is_changed = self.weights.iter().any(|weight| weight.before != weight.after);
        match (&self.unchecked, self.kept) {
            _ if !is_changed => "no weight was changed: none judges better".to_owned(),
            (Some(why), _) => format!("not kept: the half that they were not fitted to has {why}"),
            (None, true) => "kept: they do better on the half that they were not fitted to".to_owned(),
            (None, false) => {
                "not kept: on the half that they were not fitted to they do no better".to_owned()
            }
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} after {} maps:\n", self.process, self.maps)?;
        let heads = ["source", "kind", "before", "after", "error without it"];
        writeln!(f, "{:<12} {:<9} {:>7} {:>7} {:>17}", heads[0], heads[1], heads[2], heads[3], heads[4])?;
        for weight in &self.weights {
            let kind = format!("{:?}", weight.kind).to_lowercase();
            let without = weight.loss_without.map_or_else(|| "-".to_owned(), |loss| format!("{loss:.4}"));
            let mark = if weight.before == weight.after { "" } else { "  changed" };
            let (source, before, after) = (&weight.source, weight.before, weight.after);
            writeln!(f, "{source:<12} {kind:<9} {before:>7} {after:>7} {without:>17}{mark}")?;
        }
        writeln!(f, "{:<38} {:>17.4}", "all, with the weights before", self.loss)?;
        writeln!(f, "\n{:<28} {:>16} {:>16}", "wrong of all judgements", "before", "after")?;
        for (half, compared) in [("fitted", &self.fitted), ("checked", &self.checked)] {
            for (at, what) in ["driven over", "hit", "seen from near"].into_iter().enumerate() {
                if compared.before.count[at] == 0 {
                    continue;
                }
                let share = |judged: &Judged| format!("{} of {}", judged.wrong[at], judged.count[at]);
                let name = format!("{half}: {what}");
                writeln!(f, "{name:<28} {:>16} {:>16}", share(&compared.before), share(&compared.after))?;
            }
            let name = format!("{half}: squared error");
            writeln!(f, "{name:<28} {:>16.4} {:>16.4}", compared.before.loss, compared.after.loss)?;
        }
        writeln!(f, "\n{}", self.verdict())
    }
}
