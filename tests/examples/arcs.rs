//! Evaluates maps as `ocu eval obstacles` does: of simulated drives, or of recordings on whose cost maps the world model
//! runs again, with other parameters.
//!
//! `cargo run -p ocu-tests --example arcs -- [OPTIONS] COURSE… | RUN.mcap…`
//!
//! | option | what |
//! | --- | --- |
//! | `--stack S` | bundled stack; default `learning` |
//! | `--set wm1.sources[1].weight=0` | parameter of the stack; may be given several times |
//! | `--seconds T`, `--seed N` | length and seed of simulated drives; default 45 s, seed 0 |
//! | `--things` | lists each thing in the way, too |
//! | `--docs docs/perception.md` | drives each course with the seeds 0 and 1, also without each source, and writes the tables of the page anew |
//!
//! In a recording, the world model and its parameters are those of the stack, and its inputs are the topics of the same
//! names. Sources that read the map (the gate of the colour models) do not run again.

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "its output is what it is for")]
#![allow(unreachable_pub, dead_code, reason = "shared with the tests")]

#[path = "../src/bundled.rs"]
mod bundled;
#[path = "../src/judged.rs"]
mod judged;

use bundled::Repository;
use judged::{TRUTH, ablated, replayed, simulated};
use rcs_eval::obstacles::{FUSED, Layer, Report};
use rcs_log::Log;
use rcs_runtime::{Assets, Plan, PlanOptions, StackFile};
use rcs_world::Source;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

fn main() {
    let (mut overrides, mut drives, mut things) = (Vec::new(), Vec::new(), false);
    let (mut stack, mut seconds, mut seed, mut docs) = ("learning".to_owned(), 45.0, 0, None);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().unwrap_or_else(|| panic!("a value after {argument}"));
        match argument.as_str() {
            "--things" => things = true,
            "--stack" => stack = value(),
            "--docs" => docs = Some(value()),
            "--seconds" => seconds = value().parse().unwrap(),
            "--seed" => seed = value().parse().unwrap(),
            "--set" => {
                let text = value();
                let (path, value) = text.split_once('=').expect("process.field=value after --set");
                overrides.push((path.to_owned(), value.to_owned()));
            }
            _ => drives.push(argument),
        }
    }
    if let Some(file) = docs {
        let params: Vec<_> = overrides.iter().map(|(path, value)| (&**path, &**value)).collect();
        return write_tables(Path::new(&file), &drives, |drive, seed| {
            ablated(&stack, drive, seed, seconds, &params, &ABLATED)
        });
    }
    println!("| drive | layer | 3 m: free called blocked, % | blocked called free, % | 5 m | | things |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    for drive in &drives {
        let report = if Path::new(drive).exists() {
            let log = Log::open(drive).unwrap().with_codecs(rcs_runtime::codecs(rcs_plugins::all()));
            replayed(world_model(&stack, &log, &overrides), &log)
        } else {
            let params: Vec<_> = overrides.iter().map(|(path, value)| (&**path, &**value)).collect();
            simulated(&stack, drive, seed, seconds, &params)
        };
        print(&Path::new(drive).file_stem().unwrap().to_string_lossy(), &report);
        if things {
            println!("{report}");
        }
    }
}

/// Sources that are left out one by one.
const ABLATED: [Source; 5] =
    [Source::STEREO, Source::INFRARED, Source::COLOR, Source::TERRAIN, Source::CLASSIFIER];
/// Lines of the page around what is written.
const MARKS: [&str; 2] =
    ["<!-- written by the example arcs: begin -->", "<!-- written by the example arcs: end -->"];

fn figure(pct: Option<f64>) -> String {
    pct.map_or("–".to_owned(), |pct| format!("{pct:.1}"))
}

/// What one layer says of things: late ones of all in the way; percent of the poses that sighted a thing from which it
/// blocks the way to it, by distance; missed ones of all that were sighted in the nearest band.
fn things(report: &Report, layer: &Layer) -> String {
    let shares: Vec<String> = layer.bands.iter().map(|band| figure(band.blocking_pct)).collect();
    let sighted = layer.bands.first().map_or(0, |band| band.things);
    let (late, missed) = (layer.late_things, layer.missed_things);
    format!("{late} of {} \u{b7} {} \u{b7} {missed} of {sighted}", report.things.len(), shares.join(" / "))
}

/// Shares of one layer at 3 m and 5 m: truly free arcs called blocked, truly blocked arcs called free.
fn shares(report: &Report, layer: &str) -> String {
    let at = |length_m: f64| report.shares(layer, length_m).unwrap();
    let free = [3.0, 5.0].map(|length_m| figure(at(length_m).free_called_blocked_pct));
    let blocked = [3.0, 5.0].map(|length_m| figure(at(length_m).blocked_called_free_pct));
    format!("{} / {} \u{b7} {} / {}", free[0], free[1], blocked[0], blocked[1])
}

/// Writes the table of the courses, and that of the ablation, into a page. A line is written as soon as it is measured,
/// so an interrupted run leaves what it has; courses that the page already has lines of are kept unless they are given.
fn write_tables(file: &Path, drives: &[String], drive: impl Fn(&str, u64) -> (Report, Vec<Report>)) {
    for course in drives {
        for seed in [0, 1] {
            let (report, without) = drive(course, seed);
            let [arcs_3_m, _] = [0, 1].map(|i| report.arcs.get(i).copied().unwrap_or_default());
            let things = report.layers.first().map(|layer| things(&report, layer)).unwrap_or_default();
            let mut line = format!(
                "| {course} | {seed} | {} | {} | {} | {things} | {} |",
                arcs_3_m.free,
                arcs_3_m.blocked,
                shares(&report, FUSED),
                shares(&report, "stereo"),
            );
            for report in &without {
                write!(line, " {} |", shares(report, FUSED)).unwrap();
            }
            println!("{line}");
            let text = std::fs::read_to_string(file).unwrap();
            std::fs::write(file, with_line(&text, &format!("| {course} | {seed} |"), &line)).unwrap();
        }
    }
}

/// The page with a line of the table in place of the one that begins the same, or added in the order of their texts.
fn with_line(text: &str, key: &str, line: &str) -> String {
    let (before, rest) = text.split_once(MARKS[0]).expect("the page has the marks");
    let (table, after) = rest.split_once(MARKS[1]).expect("the page has the marks");
    let is_line =
        |old: &&str| old.starts_with("| ") && !old.starts_with("| course") && !old.starts_with("| ---");
    let mut lines: Vec<&str> = table.lines().filter(is_line).filter(|old| !old.starts_with(key)).collect();
    lines.push(line);
    lines.sort_unstable();
    let names: Vec<String> = ABLATED.iter().map(|source| format!(" without {source} |")).collect();
    let head = format!(
        "| course | seed | free arcs | blocked arcs | fused | things | stereo alone |{}",
        names.concat()
    );
    let rule = format!("|{}", " --- |".repeat(7 + ABLATED.len()));
    format!("{before}{}\n{head}\n{rule}\n{}\n{}{after}", MARKS[0], lines.join("\n"), MARKS[1])
}

fn print(name: &str, report: &Report) {
    for layer in &report.layers {
        let mut shares = String::new();
        for (counts, arcs) in report.arcs.iter().zip(&layer.arcs) {
            let [free, blocked] = [arcs.free_called_blocked_pct, arcs.blocked_called_free_pct].map(figure);
            write!(shares, " {free} of {} | {blocked} of {} |", counts.free, counts.blocked).unwrap();
        }
        println!("| {name} | {} |{shares} {} |", layer.name, things(report, layer));
    }
}

/// The world model of a bundled stack alone, with its inputs, the truth and the poses from the log.
fn world_model(stack: &str, log: &Log, overrides: &[(String, String)]) -> Arc<Plan> {
    let text = Repository.read("stack", stack, "").unwrap().text;
    let composed = StackFile::compose(stack, &text, &Repository).unwrap_or_else(|error| panic!("{error}"));
    let table: toml::Table = composed.text.parse().unwrap();
    let processes = table["process"].as_array().unwrap();
    let is_world_model = |process: &&toml::Value| process["plugin"].as_str() == Some("world_model");
    let mut process = processes.iter().find(is_world_model).unwrap().as_table().unwrap().clone();
    process.insert("supervisor".to_owned(), "robot".into());
    process.remove("as");
    let inputs = process["inputs"].as_table_mut().unwrap();
    inputs.retain(|_, topic| log.info().topics_named(topic.as_str().unwrap()).next().is_some());
    let mut topics: BTreeSet<String> =
        inputs.iter().map(|(_, topic)| topic.as_str().unwrap().to_owned()).collect();
    let mut text = String::from("format = 1\nname = \"world_model\"\n");
    for (topic, kind) in TRUTH {
        write!(text, "[[input]]\nbuffer = \"{topic}\"\ntopic = \"{topic}\"\ntype = \"{kind}\"\n").unwrap();
        topics.remove(topic);
    }
    for topic in &topics {
        write!(text, "[[input]]\nbuffer = \"{topic}\"\ntopic = \"{topic}\"\n").unwrap();
    }
    text.push_str("[[process]]\nname = \"robot\"\nplugin = \"supervisor\"\nsupervisor = \"viewer\"\n");
    let mut rest = toml::Table::new();
    rest.insert("process".to_owned(), toml::Value::Array(vec![process.into()]));
    text.push_str(&rest.to_string());
    for topic in &topics {
        write!(text, "\n[buffers.\"{topic}\"]\nqueue = 32\n").unwrap();
    }
    let file =
        StackFile::compose("world_model.toml", &text, &Repository).unwrap_or_else(|error| panic!("{error}"));
    let options = PlanOptions { overrides, course: None, assets: &Repository };
    Arc::new(Plan::with(file, rcs_plugins::all(), &options).unwrap_or_else(|error| panic!("{error}")))
}
