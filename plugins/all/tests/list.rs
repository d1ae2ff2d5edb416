//! One loop over the list: what must hold of every process type.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::disallowed_methods, reason = "a test reads files; plugins do not")]

use rcs_msg::params::{self, ParamKind};
use rcs_plugins::all;
use rcs_runtime::{PortDef, ProcessType};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

#[test]
fn names_are_unique_and_in_order() {
    let names: Vec<&str> = all().iter().map(|kind| kind.def().plugin).collect();
    let sorted: Vec<&str> = names.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
    assert_eq!(names, sorted);
}

#[test]
fn every_process_says_what_it_is_how_often_it_runs_and_what_it_obeys() {
    for kind in all() {
        let def = kind.def();
        assert!(
            def.summary.len() > 20 && !def.summary.ends_with('.'),
            "{}: summary {:?}",
            def.plugin,
            def.summary
        );
        assert!(def.period_ms.is_finite() && def.period_ms > 0.0, "{}: period {}", def.plugin, def.period_ms);
        for command in def.commands {
            assert!(!command.help.is_empty(), "{}: command {}", def.plugin, command.name);
            assert!(
                !["RUN", "HALT"].contains(&command.name),
                "{}: the runtime has {}",
                def.plugin,
                command.name
            );
        }
    }
}

#[test]
fn every_port_has_help_and_a_name_of_its_own() {
    for kind in all() {
        let (inputs, outputs) = (kind.inputs(), kind.outputs());
        let names: BTreeSet<&str> = inputs.iter().chain(&outputs).map(|port| port.name).collect();
        assert_eq!(
            names.len(),
            inputs.len() + outputs.len(),
            "{}: a port's name comes twice",
            kind.def().plugin
        );
        for port in inputs.iter().chain(&outputs) {
            assert!(!port.help.is_empty(), "{}.{} has no help", kind.def().plugin, port.name);
        }
        for output in &outputs {
            let role = output.metadata.get("rcs.role");
            assert!(role.is_some(), "{}.{} has no role", kind.def().plugin, output.name);
            if let Some(of) = output.metadata.get("rcs.overlay_of") {
                assert!(
                    inputs.iter().any(|input| input.name == of),
                    "{}.{} lies on {of}",
                    kind.def().plugin,
                    output.name
                );
            }
        }
    }
}

#[test]
fn every_parameter_has_unit_range_default_and_help() {
    for kind in all() {
        let schema = kind.params_schema();
        let descriptor = schema.descriptor().expect("parameters are messages of ours");
        let specs = params::specs(&descriptor);
        assert_eq!(
            specs.len(),
            descriptor.fields().len(),
            "{}: not every field is a parameter",
            schema.name()
        );
        for spec in &specs {
            let name = format!("{}.{}", schema.name(), spec.name);
            assert!(spec.help.ends_with('.') && spec.help.len() > 10, "{name}: help {:?}", spec.help);
            if matches!(spec.kind, ParamKind::Integer | ParamKind::Number) {
                assert!(!spec.unit.is_empty(), "{name} has no unit");
                assert!(spec.min.is_some() && spec.max.is_some(), "{name} has no range");
            }
        }
        params::check(&params::defaults(&descriptor)).expect("defaults are in range");
    }
}

#[test]
fn every_port_table_in_the_documentation_is_the_definition() {
    let texts: Vec<String> = sources().iter().map(|file| fs::read_to_string(file).unwrap()).collect();
    for kind in all() {
        let table = port_table(kind);
        assert!(
            texts.iter().any(|text| text.contains(&table)),
            "no file under plugins/ holds the port table of {}, expected\n{table}",
            kind.def().plugin
        );
    }
}

/// The table as module documentation writes it.
fn port_table(kind: &ProcessType) -> String {
    let line = |port: &PortDef, direction: &str| {
        let direction = if direction == "in" && !port.required { "in, optional" } else { direction };
        format!("//! | `{}` | {direction} | `{}` | {} |\n", port.name, port.schema.name(), port.help)
    };
    let inputs = kind.inputs();
    let outputs = kind.outputs();
    let lines =
        inputs.iter().map(|port| line(port, "in")).chain(outputs.iter().map(|port| line(port, "out")));
    format!(
        "//! | port | direction | type | what |\n//! | --- | --- | --- | --- |\n{}",
        lines.collect::<String>()
    )
}

fn sources() -> Vec<PathBuf> {
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("..")];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.push(path);
            }
        }
    }
    files
}
