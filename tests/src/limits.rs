//! Runs every plugin at the limits of its parameters, and sends it each of its commands: no process panics, and a
//! process that refuses a limit says what it expects.

use crate::{bundled, determinism};
use rcs_msg::params::{ParamKind, ParamSpec, defaults, specs, with_params};
use rcs_msg::prost::Message as _;
use rcs_msg::{AnyMessage, Stamp, rcs};
use rcs_runtime::{CommandDef, ExternalEvent, Plan, ProcessPlan, RunOptions, Stepped};
use rcs_testkit::bench;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Each number is at its limit together with every third other one of its process, so that it meets the defaults of the
/// others, too.
const GROUPS: usize = 3;

/// Limits at which nothing runs: plugin, parameter, limit, and why.
const LEFT_OUT: [(&str, &str, f64, &str); 1] =
    [("sim_cameras", "width_px", 4096.0, "a simulated image of this width takes seconds")];

/// A run, and the serial of the last command that was sent.
struct Trial {
    run: Stepped,
    until_s: f64,
    serial: u64,
}

impl Trial {
    fn new(plan: Arc<Plan>) -> Trial {
        let options = RunOptions { threads: 2, seed: 3, ..RunOptions::default() };
        let mut run = Stepped::new(plan, None, options).unwrap();
        run.begin().unwrap();
        Trial { run, until_s: 0.0, serial: 100 }
    }

    fn run_for(&mut self, seconds: f64) {
        self.until_s += seconds;
        self.run.run_until(Stamp((self.until_s * 1e9) as u64)).unwrap();
    }

    fn send(&mut self, buffer: usize, message: AnyMessage) {
        let name = self.run.plan().buffers[buffer].spec.name.clone();
        self.run.take(ExternalEvent::operator(name, message)).unwrap();
    }

    fn command(&mut self, process: &ProcessPlan, name: &str, parameters: (&str, Vec<u8>)) {
        self.serial += 1;
        let command = rcs::Command {
            serial: self.serial,
            name: name.to_owned(),
            parameters_schema: parameters.0.to_owned(),
            parameters: parameters.1.into(),
            ..rcs::Command::default()
        };
        self.send(process.command_buffer, AnyMessage::new(command));
    }

    /// Sends a command of the process's own, with its parameters at their defaults.
    fn command_with_defaults(&mut self, process: &ProcessPlan, command: &CommandDef) {
        let parameters = command.parameters.map_or(("", Vec::new()), |schema| {
            let descriptor = schema().descriptor().expect("parameters are protobuf");
            (schema().name(), defaults(descriptor).encode_to_vec())
        });
        self.command(process, command.name, parameters);
    }

    /// Sends a command of the runtime to all processes.
    fn command_all(&mut self, name: &str) {
        let plan = Arc::clone(self.run.plan());
        for process in &plan.processes {
            self.command(process, name, ("", Vec::new()));
        }
    }

    /// The processes that have panicked, with the text of the panic.
    fn panics(&self) -> Vec<String> {
        let plan = self.run.plan();
        let told = |process: &ProcessPlan| {
            let buffer = &plan.buffers[process.status_buffer].spec.name;
            let status: rcs::Status = bench::newest(&self.run, buffer)?;
            status
                .state_text
                .starts_with("panicked")
                .then(|| format!("{}: {}", process.name, status.state_text))
        };
        plan.processes.iter().filter_map(told).collect()
    }
}

/// The numbers of parameters by path, with their limits; of lists those of the first element.
fn numbers(specs: &[ParamSpec], within: &str) -> Vec<(String, [f64; 2])> {
    let mut found = Vec::new();
    for spec in specs {
        // The elements of a list of numbers have no name.
        let path = format!("{within}{}", spec.name).trim_end_matches('.').to_owned();
        match (spec.kind, spec.min.zip(spec.max)) {
            (ParamKind::Number | ParamKind::Integer, Some((min, max))) => found.push((path, [min, max])),
            (ParamKind::Group, _) => found.extend(numbers(&spec.fields, &format!("{path}."))),
            (ParamKind::List, _) => found.extend(numbers(&spec.fields, &format!("{path}[0]."))),
            _ => {}
        }
    }
    found
}

/// The parameters of a process with the numbers of a group at their lower (0) or upper (1) limit, except those that the
/// process refuses there: the error must say what is wrong.
fn at_limits(run: &Stepped, process: &ProcessPlan, side: usize, group: usize) -> AnyMessage {
    let plugin = process.kind.def().plugin;
    let descriptor = process.kind.params_schema().descriptor().expect("parameters are protobuf");
    let buffer = run.plan().buffers[process.params_buffer].spec.name.as_str();
    let mut params = process.params.clone();
    for (path, limits) in numbers(&specs(descriptor), "").into_iter().skip(group).step_by(GROUPS) {
        let limit = limits[side];
        let is_left_out = LEFT_OUT.iter().any(|&(of, name, at, _)| (of, name, at) == (plugin, &*path, limit));
        if is_left_out {
            continue;
        }
        let text = limit.to_string();
        let changed = match with_params(&params, [(path.as_str(), text.as_str())]) {
            Ok(changed) => changed,
            // The list has no element.
            Err(_) if path.contains("[0]") => continue,
            Err(error) => panic!("{plugin}: {path} refuses its own limit {text}: {error}"),
        };
        match run.check(&ExternalEvent::operator(buffer, changed.clone())) {
            Ok(()) => params = changed,
            Err(error) => {
                let (error, name) = (error.to_string(), path.rsplit('.').next().unwrap_or_default());
                // The limit must stand alone: a 0 is a digit of many other numbers.
                let mut numbers = error.split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'));
                let is_clear =
                    error.contains(name) || error.contains("expected") || numbers.any(|found| found == text);
                assert!(is_clear, "{plugin}: {path} = {text}: {error}");
                println!("{plugin}: {path} = {text} is refused: {error}");
            }
        }
    }
    params
}

/// Runs a stack with its parameters at their limits, then sends every command.
fn check(plan: &Arc<Plan>) {
    let mut trial = Trial::new(Arc::clone(plan));
    let stack = plan.file.name();
    trial.run_for(0.5);
    for (side, what) in ["lower", "upper"].into_iter().enumerate() {
        for group in 0..GROUPS {
            for process in &plan.processes {
                let params = at_limits(&trial.run, process, side, group);
                trial.send(process.params_buffer, params);
            }
            let told = format!("{stack}: {what} limits, group {group}");
            trial.run_for(0.5);
            assert_eq!(trial.panics(), [""; 0], "{told}: while it runs");
            // States are made again from these parameters.
            trial.command_all("INIT");
            trial.run_for(0.1);
            trial.command_all("RUN");
            trial.run_for(0.5);
            assert_eq!(trial.panics(), [""; 0], "{told}: from the beginning");
        }
    }
    for process in &plan.processes {
        trial.send(process.params_buffer, process.params.clone());
        for command in process.kind.commands() {
            trial.command_with_defaults(process, command);
        }
    }
    trial.run_for(1.1);
    assert_eq!(trial.panics(), [""; 0], "{stack}: commands");
}

fn stacks() -> [Arc<Plan>; 3] {
    [
        bundled::plan("lagr", "mulch_path", &[]),
        bundled::plan("truth_driver", "corridor", &[]),
        bundled::plan_from_text("rest.toml", &determinism::rest()),
    ]
}

#[test]
fn no_plugin_panics_at_the_limits_of_its_parameters_or_at_a_command() {
    stacks().iter().for_each(check);
}

#[test]
fn every_plugin_runs_at_its_limits() {
    let run: BTreeSet<_> = stacks().iter().flat_map(|plan| determinism::plugins_of(plan)).collect();
    let all: BTreeSet<_> = rcs_plugins::all().iter().map(|kind| kind.def().plugin).collect();
    assert_eq!(run, all, "a new plugin belongs into a stack of this test");
    for (plugin, path, limit, _) in LEFT_OUT {
        let kind = rcs_plugins::all().iter().find(|kind| kind.def().plugin == plugin).expect(plugin);
        let known = numbers(&specs(kind.params_schema().descriptor().expect(plugin)), "");
        assert!(
            known.iter().any(|(name, limits)| name == path && limits.contains(&limit)),
            "{plugin}.{path}"
        );
    }
}
