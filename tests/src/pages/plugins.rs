//! `docs/reference/plugins.md`: processes with ports, parameters and commands.

use super::{check_reference, code, table};
use rcs_msg::Value;
use rcs_msg::params::{ParamKind, ParamSpec, specs};
use rcs_runtime::{BUILT_IN, CommandDef, PortDef, ProcessType};
use std::fmt::Write as _;

fn ports(inputs: &[PortDef], outputs: &[PortDef]) -> String {
    let row = |port: &PortDef, what: &str| {
        vec![code(port.name), what.to_owned(), code(port.schema.name()), role(port), port.help.to_owned()]
    };
    let inputs = inputs.iter().map(|port| row(port, if port.required { "in" } else { "in, optional" }));
    let rows: Vec<_> = inputs.chain(outputs.iter().map(|port| row(port, "out"))).collect();
    table(&["port", "direction", "type", "role", "what"], &rows)
}

fn role(port: &PortDef) -> String {
    let input = port.role.map(rcs_runtime::InputRole::name);
    code(input.unwrap_or_else(|| port.metadata.get("rcs.role").map_or("", String::as_str)))
}

fn value(value: &Value) -> String {
    match value {
        Value::Text(text) => format!("{text:?}"),
        Value::Float(number) => number.to_string(),
        Value::Int(number) => number.to_string(),
        Value::Bool(on) => on.to_string(),
        Value::Enum { name, .. } => name.clone(),
        _ => String::new(),
    }
}

fn range(spec: &ParamSpec) -> String {
    match (spec.min, spec.max) {
        _ if spec.file.is_some() => format!("file: {}", spec.file.as_deref().unwrap_or_default()),
        (Some(min), Some(max)) => format!("{min} to {max}"),
        _ => spec.choices.iter().map(|(_, name)| code(name)).collect::<Vec<_>>().join(", "),
    }
}

fn parameters(specs: &[ParamSpec], within: &str, rows: &mut Vec<Vec<String>>) {
    for spec in specs {
        let name = format!("{within}{}", spec.name);
        rows.push(vec![
            code(&name),
            code(&value(&spec.default)),
            spec.unit.clone(),
            range(spec),
            spec.help.clone(),
        ]);
        match spec.kind {
            ParamKind::Group => parameters(&spec.fields, &format!("{name}."), rows),
            ParamKind::List if spec.fields.iter().any(|field| !field.name.is_empty()) => {
                parameters(&spec.fields, &format!("{name}[]."), rows);
            }
            _ => {}
        }
    }
}

fn commands(commands: &[CommandDef]) -> String {
    let row = |command: &CommandDef| {
        vec![code(command.name), code(command.parameters_schema()), command.help.to_owned()]
    };
    table(&["command", "parameters", "what"], &commands.iter().map(row).collect::<Vec<_>>())
}

fn section(kind: &ProcessType) -> String {
    let def = kind.def();
    let mut text = format!(
        "## {}\n\n{}.\nPeriod {} ms and latency {} ms where a stack says no others.\n\n",
        def.plugin, def.summary, def.period_ms, def.latency_ms
    );
    text += &ports(&kind.inputs(), &kind.outputs());
    let mut rows = Vec::new();
    if let Some(descriptor) = kind.params_schema().descriptor() {
        parameters(&specs(descriptor), "", &mut rows);
    }
    if !rows.is_empty() {
        writeln!(text, "Parameters, `{}`:\n", kind.params_schema().name()).expect("a text takes a line");
        text += &table(&["parameter", "default", "unit", "range", "what"], &rows);
    }
    let children = kind.children();
    if !children.is_empty() {
        let row = |child: &rcs_runtime::ChildDef| {
            let many = if child.many {
                "any number"
            } else if child.required {
                "one"
            } else {
                "one, optional"
            };
            vec![code(child.name), many.to_owned(), child.help.to_owned()]
        };
        text += &table(&["child", "how many", "what"], &children.iter().map(row).collect::<Vec<_>>());
    }
    if !kind.commands().is_empty() {
        text += &commands(kind.commands());
    }
    text
}

#[test]
fn the_reference_of_plugins_is_made_from_their_definitions() {
    let mut text = "# Processes\n\nWhat a stack file can name, made from the definitions; `ocu plugins NAME` prints the \
                    same.\nA parameter within a group or a list is named by its path, in `--param`, too: \
                    `mount.height_m`, `sources[0].weight`.\nEvery process obeys these commands:\n\n"
        .to_owned();
    text += &commands(BUILT_IN);
    for kind in rcs_plugins::all() {
        text += &section(kind);
    }
    check_reference("plugins", &format!("{}\n", text.trim_end()));
}
