//! `ocu stack`: shows the expanded stack file, or checks it without running it.

use crate::cli::{Param, StackCheckArgs, StackCommand, StackShowArgs};
use crate::{Ended, Usage, stacks};
use anyhow::Context as _;
use rcs_msg::Value;
use rcs_msg::params::{ParamKind, ParamSpec, specs};
use rcs_msg::rcs::PoseSource;
use rcs_runtime::{Plan, PortDef, ProcessPlan, Role};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Write;

/// Executes `ocu stack …`.
pub fn stack(command: &StackCommand, out: &mut dyn Write) -> anyhow::Result<Ended> {
    match command {
        StackCommand::Show(args) => show(args, out).map(|()| Ended::Well),
        StackCommand::Check(args) => check(args, out),
    }
}

/// Prints the stack with its parts included; each line with the file and line from which it came.
fn show(args: &StackShowArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let stack = stacks::named(&args.stack)?;
    if args.plain {
        write!(out, "{}", stack.text)?;
        return Ok(());
    }
    let width = stack.text.lines().map(|line| line.chars().count()).max().unwrap_or(0).min(100);
    for (line, origin) in stack.text.lines().zip(stack.origins()) {
        if line.trim().is_empty() {
            writeln!(out)?;
        } else {
            writeln!(out, "{line:<width$}  # {}:{}", origin.file, origin.line)?;
        }
    }
    Ok(())
}

#[derive(Debug, Default, Serialize)]
struct Findings {
    /// What a run would refuse.
    errors: Vec<String>,
    /// What is valid but probably a mistake.
    warnings: Vec<String>,
    /// Outputs that no process reads: they are only shown and recorded.
    unread: Vec<String>,
}

fn check(args: &StackCheckArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let overrides: Vec<(String, String)> = args.params.iter().map(Param::to_override).collect();
    let mut findings = Findings::default();
    let mut ended = Ended::Well;
    match stacks::plan(&args.stack, args.course.as_deref(), &overrides) {
        Ok(plan) => {
            match (&args.log, plan.inputs.first()) {
                (Some(path), _) => {
                    let log = stacks::open_log(path)?;
                    findings.errors.extend(plan.check_log(log.info()).err().map(|error| error.to_string()));
                    ended = Ended::after(Some(&log));
                }
                (None, Some(input)) => findings
                    .warnings
                    .push(format!("it reads {} of a recording, which --log would check", input.topic)),
                (None, None) => {}
            }
            findings.warnings.extend(plan.warnings.iter().cloned());
            findings.warnings.extend(useless_outputs(&plan));
            let unread = unread_outputs(&plan).into_iter();
            findings.unread = unread.map(|(_, _, buffer)| plan.buffers[buffer].spec.name.clone()).collect();
            findings.warnings.extend(differing_frames(&plan));
            findings.warnings.extend(plan.processes.iter().flat_map(unused_mounts));
        }
        // There is no stack to check.
        Err(error) if error.is::<Usage>() => return Err(error),
        Err(error) => findings.errors.push(crate::say(&error)),
    }
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &findings).context("cannot write the report")?;
        writeln!(out)?;
    } else {
        for error in &findings.errors {
            writeln!(out, "error: {error}")?;
        }
        for warning in &findings.warnings {
            writeln!(out, "warning: {warning}")?;
        }
        if !findings.unread.is_empty() {
            let count = findings.unread.len();
            writeln!(
                out,
                "{count} outputs are only shown and recorded: no process reads them (--json lists them)"
            )?;
        }
        if findings.errors.is_empty() && findings.warnings.is_empty() {
            writeln!(out, "{}: nothing is wrong with it", args.stack)?;
        }
    }
    Ok(if findings.errors.is_empty() { ended } else { Ended::Failed })
}

/// Outputs that no process reads, in the order of the stack.
fn unread_outputs(plan: &Plan) -> Vec<(&ProcessPlan, PortDef, usize)> {
    let is_read = |buffer: usize| plan.processes.iter().any(|reader| reader.inputs.contains(&Some(buffer)));
    let outputs = plan.processes.iter().flat_map(|process| {
        let ports = process.kind.outputs().into_iter().zip(&process.outputs);
        ports.map(move |(def, &buffer)| (process, def, buffer))
    });
    outputs.filter(|(_, _, buffer)| !is_read(*buffer)).collect()
}

/// A warning for each output that only processes can use and that none reads: commands, and costs and paths where
/// another process has an input for them that is not wired. The window shows other outputs.
fn useless_outputs(plan: &Plan) -> Vec<String> {
    let warning = |(process, def, buffer): (&ProcessPlan, PortDef, usize)| {
        let spec = &plan.buffers[buffer].spec;
        let role = def.metadata.get("rcs.role").and_then(|name| name.parse::<Role>().ok());
        let unwired = plan.processes.iter().filter(|reader| reader.name != process.name).find_map(|reader| {
            let defs = reader.kind.inputs();
            let mut of_type = defs
                .iter()
                .zip(&reader.inputs)
                .filter(|(input, _)| input.schema.name() == spec.schema.name());
            // Who reads a path already does not miss another one.
            if role == Some(Role::Path) && of_type.clone().any(|(_, wire)| wire.is_some()) {
                return None;
            }
            let (input, _) = of_type.find(|(_, wire)| wire.is_none())?;
            Some(format!("; the input {} of {} is not wired", input.name, reader.name))
        });
        let is_useless = match role? {
            Role::Command => true,
            // Costs per pixel are drawn on the camera's image; costs per cell are for a world model.
            Role::Cost => unwired.is_some() && spec.schema.name() == "foxglove.Grid",
            Role::Path => unwired.is_some(),
            _ => false,
        };
        let unwired = unwired.unwrap_or_default();
        is_useless.then(|| format!("{} of {} is read by no process{unwired}", spec.name, process.name))
    };
    unread_outputs(plan).into_iter().filter_map(warning).collect()
}

/// Frame parameters with the same name but different values in two connected processes.
fn differing_frames(plan: &Plan) -> Vec<String> {
    let frames: Vec<BTreeMap<String, String>> = plan.processes.iter().map(frames).collect();
    let mut warnings = Vec::new();
    for (reader, process) in plan.processes.iter().enumerate() {
        for (writer, source) in plan.processes.iter().enumerate() {
            let connected = source.outputs.iter().any(|&buffer| process.inputs.contains(&Some(buffer)));
            if !connected || reader == writer {
                continue;
            }
            for (name, frame) in &frames[reader] {
                let Some(other) = frames[writer].get(name).filter(|other| *other != frame) else { continue };
                warnings.push(format!(
                    "{} is {frame:?} in {} and {other:?} in {}, which it reads",
                    name, process.name, source.name
                ));
            }
        }
    }
    warnings
}

/// Whether a process learns where its vehicle is: from what is wired, or because it is fixed.
fn knows_its_pose(process: &ProcessPlan, tree: &Value, group: &str) -> bool {
    let is_wired = |port: &PortDef, wire: &Option<usize>| {
        wire.is_some() && ["odometry", "pose", "transforms"].contains(&port.name)
    };
    let source = format!(".{group}.source").parse().ok().and_then(|path| tree.get(&path).ok());
    let fixed = PoseSource::PoseFixed as i32;
    let is_fixed = matches!(source.as_deref(), Some(Value::Enum { number, .. }) if *number == fixed);
    is_fixed || process.kind.inputs().iter().zip(&process.inputs).any(|(port, wire)| is_wired(port, wire))
}

/// Mounts of which something is set and that are not used, since transforms give the sensor's pose.
fn unused_mounts(process: &ProcessPlan) -> Vec<String> {
    let Some(descriptor) = process.params.schema().descriptor().cloned() else { return Vec::new() };
    let Ok(tree) = process.params.value() else { return Vec::new() };
    let mut warnings = Vec::new();
    for group in specs(&descriptor).iter().filter(|spec| spec.kind == ParamKind::Group) {
        let is_mount = ["fixed", "height_m"].map(|name| group.fields.iter().any(|field| field.name == name));
        if is_mount != [true, true] {
            continue;
        }
        let value = |field: &ParamSpec| {
            let path = format!(".{}.{}", group.name, field.name).parse().ok()?;
            tree.get(&path).ok().map(std::borrow::Cow::into_owned)
        };
        let is_fixed = |field: &&ParamSpec| field.name == "fixed" && value(field) == Some(Value::Bool(true));
        let is_set = |field: &&ParamSpec| value(field).is_some_and(|value| value != field.default);
        if let Some(set) = group.fields.iter().find(is_set)
            && !group.fields.iter().any(|field| is_fixed(&field))
        {
            let (name, mount) = (&process.name, &group.name);
            warnings.push(format!(
                "{name}: {mount}.{} is set, but {mount}.fixed is not: transforms give the sensor's pose",
                set.name
            ));
        }
    }
    warnings
}

/// The parameters of a process that name coordinate frames, by name.
fn frames(process: &ProcessPlan) -> BTreeMap<String, String> {
    let mut frames = BTreeMap::new();
    let Some(descriptor) = process.params.schema().descriptor().cloned() else { return frames };
    let Ok(tree) = process.params.value() else { return frames };
    let mut take = |path: &str, name: &str| {
        let Ok(path) = path.parse() else { return };
        if let Ok(value) = tree.get(&path)
            && let Value::Text(frame) = &*value
        {
            frames.insert(name.to_owned(), frame.clone());
        }
    };
    for spec in specs(&descriptor) {
        if spec.kind == ParamKind::Text && spec.name.ends_with("_frame") {
            take(&format!(".{}", spec.name), &spec.name);
        }
        // Where nothing tells the vehicle's pose, the names of its frames are not used.
        let is_pose = spec.fields.iter().any(|field| field.name == "stream_frame");
        if is_pose && !knows_its_pose(process, &tree, &spec.name) {
            continue;
        }
        for inner in spec.fields.iter().filter(|_| spec.kind == ParamKind::Group) {
            if inner.kind == ParamKind::Text && inner.name.ends_with("_frame") {
                take(&format!(".{}.{}", spec.name, inner.name), &inner.name);
            }
        }
    }
    frames
}
