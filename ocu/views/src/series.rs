//! The values of formulas over time: a field directly from the frame, another formula computed from its fields.
//!
//! A formula of few points is computed at once, one of many on a thread of its own, while the last result is shown. An
//! array of the newest message is over its index.

use crate::cached::SameMessage;
use crate::fields::MOST_BYTES;
use crate::prepare::prepared;
use crate::view::RunChoice;
use egui::{Context, Id};
use rcs_formula::{FieldRef, Formula, Names, Over, Points};
use rcs_msg::{FieldPath, Scalar, Stamp, Value};
use rcs_runtime::source::{FieldPoint, FieldSeries, Frame, RunTag, Series, points_of, series_of};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// A first result of at most this many points is computed at once.
const AT_ONCE: usize = 200_000;
/// A further one of at most this many.
const AGAIN_AT_ONCE: usize = 20_000;
/// Most numbers of an array that are drawn.
const MOST_NUMBERS: usize = 1 << 20;

/// What there is to draw for a formula.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shown {
    pub(crate) points: Series<FieldPoint>,
    /// Names of the values, if they are states.
    pub(crate) names: Names,
    /// Progress of reading; `None` when everything was read.
    pub(crate) reading: Option<f64>,
    /// Why there are no values, or not all of them.
    pub(crate) problem: Option<Arc<str>>,
    /// Whether the values are over time, or over frequency.
    pub(crate) over: Over,
}

impl Shown {
    pub(crate) fn are_states(&self) -> bool {
        !self.names.is_empty()
    }

    /// All values.
    pub(crate) fn all(&self) -> Points {
        points_of(&self.points, &self.names)
    }
}

/// A series as it was used: its records, and their number.
type Used = (Series<FieldPoint>, usize);

type Computed = Result<(Series<FieldPoint>, Names, Over), Arc<str>>;

/// A computed formula.
#[derive(Default)]
struct Derived {
    /// The series that the result is of, and those of the result being computed.
    used: Option<Vec<Used>>,
    result: Option<Computed>,
    coming: Option<(Vec<Used>, Receiver<Computed>)>,
}

/// The parsed formulas and computed results of a view.
#[derive(Default)]
pub(crate) struct Shelf {
    formulas: BTreeMap<String, Result<Formula, Arc<str>>>,
    derived: BTreeMap<(String, RunChoice), Derived>,
}

fn same(used: &[Used], now: &[Used]) -> bool {
    used.len() == now.len() && used.iter().zip(now).all(|(a, b)| a.0.same(&b.0) && a.1 == b.1)
}

fn compute(formula: &Formula, inputs: &[Points]) -> Computed {
    let points = formula.eval(inputs).map_err(|error| Arc::from(error.to_string()))?;
    Ok((series_of(&points), Arc::clone(&points.names), points.over))
}

impl Shelf {
    /// The formula of a text.
    pub(crate) fn formula(&mut self, text: &str) -> &Result<Formula, Arc<str>> {
        if !self.formulas.contains_key(text) {
            let parsed = text.parse::<Formula>().map_err(|error| error.to_string().into());
            self.formulas.insert(text.to_owned(), parsed);
        }
        &self.formulas[text]
    }

    /// What there is to draw for a formula in a frame.
    pub(crate) fn shown(&mut self, ctx: &Context, frame: &Frame, text: &str, run: RunChoice) -> Shown {
        let formula = match self.formula(text) {
            Ok(formula) => formula.clone(),
            Err(problem) => return Shown { problem: Some(Arc::clone(problem)), ..Shown::default() },
        };
        if let Some(problem) = absent(frame, run) {
            return Shown { problem: Some(problem), ..Shown::default() };
        }
        let tag = run.tag(frame);
        let series: Vec<Option<&FieldSeries>> =
            formula.fields().iter().map(|field| frame.field(field, tag)).collect();
        if let (Some(_), [one]) = (formula.as_field(), series.as_slice()) {
            return match one {
                Some(one) => Shown {
                    points: one.points.clone(),
                    names: Arc::clone(&one.names),
                    reading: one.reading,
                    problem: one.problem.clone(),
                    over: Over::Time,
                },
                None => {
                    Shown { problem: Some(missing(frame, &formula.fields()[0], run)), ..Shown::default() }
                }
            };
        }
        for (field, series) in formula.fields().iter().zip(&series) {
            let problem = match series {
                None => Some(missing(frame, field, run)),
                Some(series) if series.points.is_empty() => series.problem.clone(),
                Some(_) => None,
            };
            if problem.is_some() {
                return Shown { problem, ..Shown::default() };
            }
        }
        let series: Vec<&FieldSeries> = series.into_iter().flatten().collect();
        let reading = series.iter().filter_map(|series| series.reading).reduce(f64::min);
        let derived = self.derived.entry((text.to_owned(), run)).or_default();
        derived.update(ctx, &formula, &series);
        match &derived.result {
            Some(Ok((points, names, over))) => {
                let lost = series.iter().find_map(|series| series.problem.clone());
                let (points, names) = (points.clone(), Arc::clone(names));
                Shown { points, names, reading, problem: lost, over: *over }
            }
            Some(Err(problem)) => Shown { problem: Some(Arc::clone(problem)), reading, ..Shown::default() },
            None => Shown { reading: reading.or(Some(1.0)), ..Shown::default() },
        }
    }

    /// Drops what no curve uses.
    pub(crate) fn keep(&mut self, is_used: impl Fn(&str) -> bool) {
        self.formulas.retain(|text, _| is_used(text));
        self.derived.retain(|(text, _), _| is_used(text));
    }
}

impl Derived {
    /// Takes a result that has been computed, and begins to compute the next one.
    fn update(&mut self, ctx: &Context, formula: &Formula, series: &[&FieldSeries]) {
        if let Some((used, coming)) = &self.coming {
            match coming.try_recv() {
                Ok(result) => {
                    self.used = Some(used.clone());
                    self.result = Some(result);
                    self.coming = None;
                }
                Err(TryRecvError::Empty) => return,
                Err(TryRecvError::Disconnected) => self.coming = None,
            }
        }
        let now: Vec<Used> =
            series.iter().map(|series| (series.points.clone(), series.points.len())).collect();
        if self.used.as_ref().is_some_and(|used| same(used, &now)) {
            return;
        }
        let size: usize = now.iter().map(|(_, length)| length).sum();
        let most = if self.result.is_some() { AGAIN_AT_ONCE } else { AT_ONCE };
        let (formula, series) = (formula.clone(), series.iter().map(|&series| series.clone()));
        if size <= most {
            let inputs: Vec<Points> = series.map(|series| series.all()).collect();
            (self.result, self.used) = (Some(compute(&formula, &inputs)), Some(now));
            return;
        }
        let series: Vec<FieldSeries> = series.collect();
        let (sender, receiver) = channel();
        let ctx = ctx.clone();
        let spawned = std::thread::Builder::new().name("formula".to_owned()).spawn(move || {
            let inputs: Vec<Points> = series.iter().map(FieldSeries::all).collect();
            // Fails if the plot has been closed.
            let _ = sender.send(compute(&formula, &inputs));
            ctx.request_repaint();
        });
        match spawned {
            Ok(_) => self.coming = Some((now, receiver)),
            Err(error) => self.result = Some(Err(format!("no thread to compute it: {error}").into())),
        }
    }
}

/// What is said if a curve is of a run that the source does not have: values of another one must not have its name.
fn absent(frame: &Frame, run: RunChoice) -> Option<Arc<str>> {
    let run = run.id()?;
    let is_there = frame.runs.all.iter().any(|known| known.id == run);
    (!is_there).then(|| format!("there is no {run}").into())
}

/// Why a field has no series.
fn missing(frame: &Frame, field: &FieldRef, run: RunChoice) -> Arc<str> {
    let (topic, what) = match run {
        RunChoice::Recorded => (frame.topic_of(&field.topic, RunTag::Recorded), "recorded topic"),
        RunChoice::Shown | RunChoice::Run(_) => (frame.topic(&field.topic), "buffer"),
    };
    match topic {
        Some(_) => "is being gathered".into(),
        None => format!("there is no {what} {}", field.topic).into(),
    }
}

/// The array of numbers at a path of the newest message, over its index: an index is a second. It is made once for each
/// message, by threads. `None` if there is another value, and until the first array is made. The error says why the
/// message is not decoded, so that it is not known what is there.
pub(crate) fn array(
    ctx: &Context,
    frame: &Frame,
    field: &FieldRef,
    run: RunChoice,
) -> Option<Result<Shown, String>> {
    if absent(frame, run).is_some() {
        return None;
    }
    let frame = frame.of_run(run.id())?;
    let of = |run| frame.topic_of(&field.topic, run);
    let topic = of(run.tag(frame)).or_else(|| of(RunTag::Recorded))?;
    let message = topic.latest.as_ref()?.message.clone();
    if message.size_hint() > MOST_BYTES {
        let mib = MOST_BYTES >> 20;
        return Some(Err(format!("its message is larger than {mib} MiB, so it is not drawn")));
    }
    let slot = Id::unique(("array", &*topic.name, topic.run, &field.path));
    let (key, path) = (SameMessage(message.clone()), field.path.clone());
    let made = prepared(ctx, slot, key, move || by_index(&message.value().ok()?, &path))?;
    (*made).clone().map(Ok)
}

/// The array at a path, of a longer one every so many numbers; `None` if there is another value.
fn by_index(root: &Value, path: &FieldPath) -> Option<Shown> {
    let value = root.get(path).ok()?;
    let count = value.len()?;
    let step = count.div_ceil(MOST_NUMBERS).max(1);
    let numbers: Vec<f64> = match &*value {
        Value::Packed(packed) => packed.iter().step_by(step).map(Scalar::as_f64).collect(),
        Value::Bytes(bytes) => bytes.iter().step_by(step).map(|&byte| f64::from(byte)).collect(),
        Value::List(list) => list.iter().step_by(step).map(Value::as_f64).collect::<Option<Vec<f64>>>()?,
        _ => return None,
    };
    let stamps = (0_u64..).step_by(step).map(|index| Stamp(index * 1_000_000_000));
    let points = stamps.zip(&numbers).map(|(stamp, &value)| FieldPoint { stamp, value }).collect();
    let problem: Option<Arc<str>> = (step > 1).then(|| {
        let [drawn, all] = [numbers.len(), count].map(|count| ocu_ui::format::count(count as u64));
        format!("{drawn} of {all} numbers are drawn").into()
    });
    Some(Shown { points, problem, ..Shown::default() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_long_array_every_so_many_numbers_are_drawn_and_it_says_so() {
        let array = |count: usize| {
            let bytes: Vec<u8> = (0..count).map(|index| index as u8).collect();
            let root = Value::Message(vec![("data".to_owned(), Value::Bytes(bytes.into()))]);
            by_index(&root, &".data".parse().unwrap()).unwrap()
        };
        let last = |shown: &Shown| shown.points.last().map(|point| (point.stamp.0, point.value));
        let whole = array(MOST_NUMBERS);
        assert_eq!((whole.points.len(), &whole.problem), (MOST_NUMBERS, &None));
        assert_eq!(last(&whole), Some((1_048_575_000_000_000, 255.0)));
        let long = array(2 * MOST_NUMBERS + 1);
        assert_eq!(long.points.len(), 699_051);
        assert_eq!(last(&long), Some((2_097_150_000_000_000, 254.0)));
        let problem = long.problem.unwrap().replace('\u{2009}', " ");
        assert_eq!(problem, "699 051 of 2 097 153 numbers are drawn");
    }
}
