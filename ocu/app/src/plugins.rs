//! `ocu plugins`: documentation of all plugins for stack files, from the definitions of the processes.

use crate::cli::PluginsArgs;
use crate::table::{Align, Table};
use crate::usage;
use anyhow::Context as _;
use rcs_msg::Value;
use rcs_msg::params::{ParamKind, ParamSpec, specs};
use rcs_runtime::{BUILT_IN, ChildDef, PortDef, ProcessType};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Write;

#[derive(Debug, Serialize)]
struct PluginReport {
    name: &'static str,
    summary: &'static str,
    period_ms: f64,
    latency_ms: f64,
    inputs: Vec<PortReport>,
    outputs: Vec<PortReport>,
    params_schema: String,
    params: Vec<ParamReport>,
    children: Vec<ChildReport>,
    commands: Vec<CommandReport>,
}

#[derive(Debug, Serialize)]
struct PortReport {
    name: &'static str,
    schema: String,
    /// By which the window finds it; empty for none.
    role: String,
    help: &'static str,
    /// Whether a stack must connect it; `false` for outputs.
    required: bool,
    metadata: BTreeMap<String, String>,
}

/// A parameter. Those of a group, and of the elements of a list, are named by their path.
#[derive(Debug, Serialize)]
struct ParamReport {
    name: String,
    kind: &'static str,
    unit: String,
    min: Option<f64>,
    max: Option<f64>,
    default: String,
    choices: Vec<String>,
    /// Kind of the file whose name a stack gives here: `world`, `models`, ….
    file: Option<String>,
    help: String,
}

/// A process that a stack assigns to it with `as`.
#[derive(Debug, Serialize)]
struct ChildReport {
    name: &'static str,
    how_many: &'static str,
    help: &'static str,
}

#[derive(Debug, Serialize)]
struct CommandReport {
    name: String,
    help: String,
    parameters_schema: String,
}

/// Lists all plugins, or everything about one of them.
pub fn plugins(args: &PluginsArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let all = rcs_plugins::all();
    let Some(name) = &args.name else {
        let reports: Vec<_> = all.iter().map(report).collect();
        if args.json {
            return write_json(&reports, out);
        }
        let mut table =
            Table::new(&[("plugin", Align::Left), ("period", Align::Right), ("what it does", Align::Left)]);
        for plugin in &reports {
            table.row([plugin.name.to_owned(), milliseconds(plugin.period_ms), plugin.summary.to_owned()]);
        }
        table.write(out)?;
        writeln!(out, "\nocu plugins NAME tells its ports, parameters and commands.")?;
        return Ok(());
    };
    let known = all.iter().find(|kind| kind.def().plugin == name);
    let kind = known.ok_or_else(|| {
        let names: Vec<_> = all.iter().map(|kind| kind.def().plugin).collect();
        usage(format!("there is no plugin {name:?}; expected {}", names.join(", ")))
    })?;
    let report = report(kind);
    if args.json { write_json(&report, out) } else { human(&report, out) }
}

fn write_json(value: &impl Serialize, out: &mut dyn Write) -> anyhow::Result<()> {
    serde_json::to_writer_pretty(&mut *out, value).context("cannot write the report")?;
    writeln!(out)?;
    Ok(())
}

fn report(kind: &ProcessType) -> PluginReport {
    let def = kind.def();
    let port = |def: PortDef| PortReport {
        name: def.name,
        schema: def.schema.name().to_owned(),
        role: match def.role {
            Some(role) => role.name().to_owned(),
            None => def.metadata.get("rcs.role").cloned().unwrap_or_default(),
        },
        help: def.help,
        required: def.required,
        metadata: def.metadata,
    };
    let mut params = Vec::new();
    if let Some(descriptor) = kind.params_schema().descriptor() {
        list(&specs(descriptor), "", &mut params);
    }
    let child = |def: ChildDef| ChildReport {
        name: def.name,
        how_many: match (def.many, def.required) {
            (true, _) => "any number",
            (false, true) => "one",
            (false, false) => "one, optional",
        },
        help: def.help,
    };
    let commands = BUILT_IN.iter().chain(kind.commands());
    PluginReport {
        name: def.plugin,
        summary: def.summary,
        period_ms: def.period_ms,
        latency_ms: def.latency_ms,
        inputs: kind.inputs().into_iter().map(port).collect(),
        outputs: kind.outputs().into_iter().map(port).collect(),
        params_schema: kind.params_schema().name().to_owned(),
        params,
        children: kind.children().into_iter().map(child).collect(),
        commands: commands
            .map(|command| CommandReport {
                name: command.name.to_owned(),
                help: command.help.to_owned(),
                parameters_schema: command.parameters_schema().to_owned(),
            })
            .collect(),
    }
}

fn list(specs: &[ParamSpec], within: &str, params: &mut Vec<ParamReport>) {
    for spec in specs {
        let name = format!("{within}{}", spec.name);
        params.push(ParamReport {
            name: name.clone(),
            kind: match spec.kind {
                ParamKind::Switch => "switch",
                ParamKind::Integer => "integer",
                ParamKind::Number => "number",
                ParamKind::Text if spec.file.is_some() => "file",
                ParamKind::Text => "text",
                ParamKind::Choice => "choice",
                ParamKind::Group => "group",
                ParamKind::List => "list",
            },
            unit: spec.unit.clone(),
            min: spec.min,
            max: spec.max,
            default: default_text(&spec.default),
            choices: spec.choices.iter().map(|(_, name)| name.clone()).collect(),
            file: spec.file.clone(),
            help: spec.help.clone(),
        });
        match spec.kind {
            ParamKind::Group => list(&spec.fields, &format!("{name}."), params),
            ParamKind::List => {
                let named = spec.fields.iter().filter(|field| !field.name.is_empty());
                list(&named.cloned().collect::<Vec<_>>(), &format!("{name}[]."), params);
            }
            _ => {}
        }
    }
}

fn default_text(value: &Value) -> String {
    match value {
        Value::Text(text) if text.is_empty() => "\"\"".to_owned(),
        Value::Text(text) => format!("{text:?}"),
        Value::Float(number) => number.to_string(),
        Value::Int(number) => number.to_string(),
        Value::Bool(on) => on.to_string(),
        Value::Enum { name, .. } => name.clone(),
        _ => String::new(),
    }
}

fn milliseconds(ms: f64) -> String {
    format!("{ms} ms")
}

fn range(param: &ParamReport) -> String {
    match (&param.file, param.min, param.max) {
        (Some(kind), ..) => format!("file: {kind}"),
        (None, Some(min), Some(max)) => format!("{min} to {max}"),
        (None, Some(min), None) => format!("from {min}"),
        (None, None, Some(max)) => format!("to {max}"),
        (None, None, None) => param.choices.join(", "),
    }
}

fn human(report: &PluginReport, out: &mut dyn Write) -> anyhow::Result<()> {
    writeln!(out, "{}: {}", report.name, report.summary)?;
    let (period, latency) = (milliseconds(report.period_ms), milliseconds(report.latency_ms));
    writeln!(out, "period {period} and latency {latency} where a stack gives no others\n")?;
    let mut ports = Table::new(&[
        ("port", Align::Left),
        ("", Align::Left),
        ("type", Align::Left),
        ("role", Align::Left),
        ("what", Align::Left),
    ]);
    let row = |what: &str, port: &PortReport| {
        [port.name.to_owned(), what.to_owned(), port.schema.clone(), port.role.clone(), port.help.to_owned()]
    };
    for port in &report.inputs {
        ports.row(row(if port.required { "in" } else { "in, optional" }, port));
    }
    for port in &report.outputs {
        ports.row(row("out", port));
    }
    ports.write(out)?;
    writeln!(out)?;
    let mut params = Table::new(&[
        ("parameter", Align::Left),
        ("default", Align::Right),
        ("unit", Align::Left),
        ("range", Align::Left),
        ("what", Align::Left),
    ]);
    for param in &report.params {
        params.row([
            param.name.clone(),
            param.default.clone(),
            param.unit.clone(),
            range(param),
            param.help.clone(),
        ]);
    }
    params.write(out)?;
    writeln!(out)?;
    if !report.children.is_empty() {
        let mut children =
            Table::new(&[("child", Align::Left), ("how many", Align::Left), ("what", Align::Left)]);
        for child in &report.children {
            children.row([child.name.to_owned(), child.how_many.to_owned(), child.help.to_owned()]);
        }
        children.write(out)?;
        writeln!(out)?;
    }
    let mut commands =
        Table::new(&[("command", Align::Left), ("parameters", Align::Left), ("what", Align::Left)]);
    for command in &report.commands {
        commands.row([command.name.clone(), command.parameters_schema.clone(), command.help.clone()]);
    }
    commands.write(out)?;
    Ok(())
}
