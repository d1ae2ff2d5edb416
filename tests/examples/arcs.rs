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
use judged::{TRUTH, replayed, simulated};
use rcs_eval::obstacles::Report;
use rcs_log::Log;
use rcs_runtime::{Assets, Plan, PlanOptions, StackFile};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

fn main() {
    let (mut overrides, mut drives, mut things) = (Vec::new(), Vec::new(), false);
    let (mut stack, mut seconds, mut seed) = ("learning".to_owned(), 45.0, 0);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().unwrap_or_else(|| panic!("a value after {argument}"));
        match argument.as_str() {
            "--things" => things = true,
            "--stack" => stack = value(),
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
    println!(
        "| drive | layer | 3 m: free called blocked, % | blocked called free, % | 5 m | | late things |"
    );
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

fn print(name: &str, report: &Report) {
    for layer in &report.layers {
        let mut shares = String::new();
        for (counts, arcs) in report.arcs.iter().zip(&layer.arcs) {
            let figure = |pct: Option<f64>| pct.map_or("-".to_owned(), |pct| format!("{pct:.1}"));
            let [free, blocked] = [arcs.free_called_blocked_pct, arcs.blocked_called_free_pct].map(figure);
            write!(shares, " {free} of {} | {blocked} of {} |", counts.free, counts.blocked).unwrap();
        }
        println!("| {name} | {} |{shares} {} of {} |", layer.name, layer.late_things, report.things.len());
    }
}

/// The world model of a bundled stack alone, with its inputs, the truth and the poses from the log.
fn world_model(stack: &str, log: &Log, overrides: &[(String, String)]) -> Arc<Plan> {
    let text = Repository.read("stack", stack, "").unwrap().text;
    let table: toml::Table = text.parse().unwrap();
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
