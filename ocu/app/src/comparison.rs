//! How two runs differ, as text and as JSON: of `ocu diff`, and of `ocu run --replay`.

use crate::plain::plain;
use crate::table::{Align, Table};
use rcs_log::Log;
use rcs_msg::channel::WRITER;
use rcs_runtime::{Difference, LaterRecording, RunDifference, ShorterRecording};
use serde::Serialize;
use std::io::{self, Write};

/// Greatest number of parameters that are told above the first difference.
const MOST_PARAMETERS: usize = 20;

/// Whether two runs have equal outputs, and if not, how they differ.
#[derive(Debug, Serialize)]
pub(crate) struct Comparison {
    pub(crate) equal: bool,
    /// What two recordings say differently of their runs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    runs: Vec<OfRuns>,
    /// Why the messages of two recordings are not compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    not_compared: Option<String>,
    /// Which of two recordings begins after the other one: from there on their messages are compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    later: Option<Later>,
    /// Which of two recordings ends before the other one: up to there their messages are compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    shorter: Option<Shorter>,
    /// The first message that differs.
    first: Option<OfMessage>,
    /// The first difference of each buffer, in the order of time, if that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    all: Option<Vec<OfMessage>>,
}

/// What two recordings say differently of their runs.
#[derive(Debug, Serialize)]
struct OfRuns {
    field: String,
    values: [String; 2],
}

/// The one of two recordings that begins later.
#[derive(Debug, Serialize)]
struct Later {
    /// `first` or `second`.
    recording: &'static str,
    /// Seconds since the start of the first one.
    start_s: f64,
}

/// The one of two recordings that ends first.
#[derive(Debug, Serialize)]
struct Shorter {
    /// `first` or `second`.
    recording: &'static str,
    /// Seconds since the start of the first one.
    end_s: f64,
}

/// A message that differs.
#[derive(Clone, Debug, Serialize)]
struct OfMessage {
    time_s: f64,
    buffer: String,
    /// The processes that write the buffer; empty if that is not known.
    writer: String,
    sequence: u64,
    field: String,
    /// Both values; empty where a run has none.
    values: [String; 2],
    #[serde(skip)]
    detail: String,
}

impl Comparison {
    /// A recording, and the first message in which a run that repeats it differs.
    pub(crate) fn with_recording(log: &Log, first: Option<&Difference>) -> Self {
        let first = first.map(|first| OfMessage::new(&[log], first));
        let equal = first.is_none();
        Self { equal, runs: Vec::new(), not_compared: None, later: None, shorter: None, first, all: None }
    }

    /// Two recordings whose messages are not compared for this reason, and what they say differently of their runs.
    pub(crate) fn without_messages(runs: Vec<RunDifference>, reason: String) -> Self {
        Self {
            equal: false,
            runs: OfRuns::all(runs),
            not_compared: Some(reason),
            later: None,
            shorter: None,
            first: None,
            all: None,
        }
    }

    /// Two recordings: what they say differently of their runs, which of them begins later or ends first, and the
    /// differences of their messages in the order of time, of which all are told or the first one.
    pub(crate) fn of_recordings(
        logs: [&Log; 2],
        runs: Vec<RunDifference>,
        later: Option<LaterRecording>,
        shorter: Option<ShorterRecording>,
        differences: &[Difference],
        tells_all: bool,
    ) -> Self {
        let all: Vec<OfMessage> = differences.iter().map(|found| OfMessage::new(&logs, found)).collect();
        Self {
            equal: runs.is_empty() && later.is_none() && shorter.is_none() && all.is_empty(),
            runs: OfRuns::all(runs),
            not_compared: None,
            later: later
                .map(|later| Later { recording: first_or_second(later.is_first), start_s: later.start_s }),
            shorter: shorter.map(|shorter| Shorter {
                recording: first_or_second(shorter.is_first),
                end_s: shorter.end_s,
            }),
            first: all.first().cloned(),
            all: tells_all.then_some(all),
        }
    }

    /// One line about the messages.
    pub(crate) fn line(&self) -> String {
        match (&self.not_compared, &self.first) {
            (Some(reason), _) => reason.clone(),
            (None, None) => {
                let equal = if self.runs.is_empty() { "equal" } else { "no message differs" };
                let limits = self.limits().map(|limits| format!(" {limits}"));
                equal.to_owned() + &limits.unwrap_or_default()
            }
            (None, Some(first)) => {
                let OfMessage { time_s, buffer, writer, sequence, field, detail, .. } = first;
                let writer = if writer.is_empty() { String::new() } else { format!(" ({writer})") };
                let text = format!("{buffer} message {sequence}{writer}, {field}: {detail}");
                format!("differs from {time_s:.6} s on: {}", plain(&text))
            }
        }
    }

    /// From when on and up to when messages are compared; `None` if both recordings begin and end together.
    fn limits(&self) -> Option<String> {
        let later = self.later.as_ref().map(Later::text);
        let limits: Vec<String> = later.into_iter().chain(self.shorter.as_ref().map(Shorter::text)).collect();
        (!limits.is_empty()).then(|| limits.join(", "))
    }

    /// Writes a line for each thing that differs of the runs, of many parameters only for some unless all is told, and
    /// the difference of the messages, or a table of all with the times from which and up to which they are compared.
    pub(crate) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let tells_all = self.all.is_some() || self.not_compared.is_some();
        let most = if tells_all { usize::MAX } else { MOST_PARAMETERS };
        let mut parameters = 0;
        for run in &self.runs {
            let is_parameter = run.field == "params";
            parameters += usize::from(is_parameter);
            if !is_parameter || parameters <= most {
                writeln!(out, "{}", plain(&run.line()))?;
            }
        }
        if parameters > most {
            writeln!(out, "{} more different parameters: --all names them", parameters - most)?;
        }
        match &self.all {
            Some(all) if !all.is_empty() => {
                if let Some(limits) = self.limits() {
                    writeln!(out, "compared {limits}")?;
                }
                table(all).write(out)
            }
            _ => writeln!(out, "{}", self.line()),
        }
    }
}

fn first_or_second(is_first: bool) -> &'static str {
    if is_first { "first" } else { "second" }
}

impl Later {
    /// `from 2.000000 s on, where the second begins`.
    fn text(&self) -> String {
        format!("from {:.6} s on, where the {} begins", self.start_s, self.recording)
    }
}

impl Shorter {
    /// `up to 6.000000 s, where the first ends`.
    fn text(&self) -> String {
        format!("up to {:.6} s, where the {} ends", self.end_s, self.recording)
    }
}

impl OfRuns {
    fn all(runs: Vec<RunDifference>) -> Vec<Self> {
        runs.into_iter().map(|run| Self { field: run.field, values: run.values }).collect()
    }

    /// `different seeds: 0 and 1`.
    fn line(&self) -> String {
        let what = match self.field.as_str() {
            "run" if self.values[1].is_empty() => {
                return "only the first is the recording of a run".to_owned();
            }
            "run" => return "only the second is the recording of a run".to_owned(),
            "stack" => "stacks",
            "seed" => "seeds",
            "build" => "builds",
            "log" => "logs",
            "live" => "executors",
            "stack_text" => "texts of the stack",
            "params" => "parameters",
            "branched_from" => "runs that they branched from",
            "" => "identities",
            other => other,
        };
        let shown = |value: &String| if value.is_empty() { "none".to_owned() } else { value.clone() };
        let [one, other] = self.values.each_ref().map(shown);
        // Files of the same kinds.
        if one == other {
            format!("different {what}: {one}")
        } else {
            format!("different {what}: {one} and {other}")
        }
    }
}

impl OfMessage {
    /// `logs` are the recordings in which the buffer can be.
    fn new(logs: &[&Log], found: &Difference) -> Self {
        Self {
            time_s: found.time_s,
            buffer: found.buffer.clone(),
            writer: writer(logs, found),
            sequence: found.sequence,
            field: found.field.clone(),
            values: found.values.clone(),
            detail: found.detail.clone(),
        }
    }
}

/// Who writes the buffer of a difference, as the recordings say; "" if none says so. The parameters with which a run
/// begins are nobody's act.
fn writer(logs: &[&Log], found: &Difference) -> String {
    let said = logs.iter().find_map(|log| {
        let topic = log.info().topics_named(&found.buffer).next()?;
        Some((topic.metadata.get(WRITER)?.as_str(), log.info().start))
    });
    let Some((writer, start)) = said else { return String::new() };
    let is_initial = writer == "operator" && found.sequence == 1 && found.time <= start;
    if is_initial { "initial value".to_owned() } else { writer.to_owned() }
}

/// The columns of the view *Compare*.
fn table(all: &[OfMessage]) -> Table {
    let mut table = Table::new(&[
        ("first differs at", Align::Right),
        ("buffer", Align::Left),
        ("written by", Align::Left),
        ("field", Align::Left),
        ("in the first", Align::Left),
        ("in the second", Align::Left),
    ]);
    let value = |text: &str| if text.is_empty() { "–".to_owned() } else { text.to_owned() };
    for found in all {
        let [one, other] = found.values.each_ref().map(|text| value(text));
        table.row([
            format!("{:.6} s", found.time_s),
            found.buffer.clone(),
            found.writer.clone(),
            found.field.trim_start_matches('.').to_owned(),
            one,
            other,
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::Stamp;

    /// The text about two runs of which one value and, if `time_s` is given, one field differ.
    fn told(field: &str, values: [&str; 2], time_s: Option<f64>, tells_all: bool) -> String {
        let log = Log::from_bytes(Vec::from(*b"\x89MCAP0\r\n").into()).unwrap();
        let run = RunDifference { field: field.to_owned(), values: values.map(str::to_owned) };
        let found = time_s.map(|time_s| Difference {
            time: Stamp(20_000_000),
            time_s,
            buffer: "/a/drive".to_owned(),
            sequence: 3,
            field: ".speed_mps".to_owned(),
            detail: "1 in the first, 2 in the second".to_owned(),
            values: ["1", "2"].map(str::to_owned),
        });
        let found: Vec<Difference> = found.into_iter().collect();
        let mut out = Vec::new();
        let comparison = Comparison::of_recordings([&log, &log], vec![run], None, None, &found, tells_all);
        comparison.write(&mut out).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn what_differs_of_the_runs_is_a_heading_above_the_first_difference_of_their_messages() {
        let first = "different seeds: 0 and 1\n\
                     differs from 0.020000 s on: /a/drive message 3, .speed_mps: 1 in the first, 2 in the second\n";
        assert_eq!(told("seed", ["0", "1"], Some(0.02), false), first);
        let all = "different seeds: 0 and 1\n\
                   first differs at  buffer    written by  field      in the first  in the second\n      \
                   0.020000 s  /a/drive              speed_mps  1             2\n";
        assert_eq!(told("seed", ["0", "1"], Some(0.02), true), all);
        assert_eq!(told("log", ["", "ab"], None, true), "different logs: none and ab\nno message differs\n");
        assert_eq!(
            told("files", ["world", "world"], None, false),
            "different files: world\nno message differs\n"
        );
        let one = "only the first is the recording of a run\nno message differs\n";
        assert_eq!(told("run", ["a run", ""], None, false), one);
    }

    #[test]
    fn all_parameters_that_differ_are_told_where_all_is_asked_for_and_else_as_many_as_fit_on_a_screen() {
        let log = Log::from_bytes(Vec::from(*b"\x89MCAP0\r\n").into()).unwrap();
        let text = |count: usize, tells_all: bool| {
            let of = |number: usize| RunDifference {
                field: "params".to_owned(),
                values: [1, 2].map(|value| format!("p.x{number} = {value}")),
            };
            let runs = (0..count).map(of).collect();
            let mut out = Vec::new();
            let comparison = Comparison::of_recordings([&log, &log], runs, None, None, &[], tells_all);
            comparison.write(&mut out).unwrap();
            String::from_utf8(out).unwrap()
        };
        assert!(text(2, false).contains("different parameters: p.x1 = 1 and p.x1 = 2\nno message differs\n"));
        assert_eq!(text(MOST_PARAMETERS, false), text(MOST_PARAMETERS, true));
        let (most, all) = (text(MOST_PARAMETERS + 3, false), text(MOST_PARAMETERS + 3, true));
        assert!(most.contains("3 more different parameters: --all names them\n"), "{most}");
        let lines = [&most, &all].map(|text| text.lines().count());
        assert_eq!(lines, [MOST_PARAMETERS + 2, MOST_PARAMETERS + 4]);
    }

    #[test]
    fn the_end_of_a_shorter_recording_is_told_apart_from_messages_that_differ() {
        let log = Log::from_bytes(Vec::from(*b"\x89MCAP0\r\n").into()).unwrap();
        let shorter = ShorterRecording { is_first: true, end: Stamp(6_000_000_000), end_s: 6.0 };
        let run = RunDifference { field: "seed".to_owned(), values: ["0", "1"].map(str::to_owned) };
        let of = |runs| Comparison::of_recordings([&log, &log], runs, None, Some(shorter), &[], false);
        let (alike, other) = (of(Vec::new()), of(vec![run]));
        assert_eq!(alike.line(), "equal up to 6.000000 s, where the first ends");
        assert_eq!(other.line(), "no message differs up to 6.000000 s, where the first ends");
        let json = serde_json::to_value(&alike).unwrap();
        let expected = serde_json::json!({"recording": "first", "end_s": 6.0});
        assert_eq!((&json["equal"], &json["shorter"]), (&false.into(), &expected));
        let later = LaterRecording { is_first: false, start: Stamp(2_000_000_000), start_s: 2.0 };
        let both =
            Comparison::of_recordings([&log, &log], Vec::new(), Some(later), Some(shorter), &[], false);
        let expected =
            "equal from 2.000000 s on, where the second begins, up to 6.000000 s, where the first ends";
        assert_eq!(both.line(), expected);
    }
}
