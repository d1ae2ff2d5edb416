//! `ocu stack`: shows the expanded stack file, or checks it without running it.

use crate::cli::{Param, StackCheckArgs, StackCommand, StackShowArgs};
use crate::{Ended, Usage, stacks};
use anyhow::Context as _;
use rcs_runtime::{Plan, PortDef, ProcessPlan, Role};
use serde::Serialize;
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
                    findings.errors.extend(plan.check_log(log.info()).iter().map(ToString::to_string));
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
