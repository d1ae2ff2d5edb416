//! Compares the port table in a plugin's documentation with the ports that the plugin declares.

use super::assert_kept;
use super::tree::sources;
use rcs_runtime::{PortDef, ProcessType};

/// The table in the form of module documentation.
fn port_table(inputs: &[PortDef], outputs: &[PortDef]) -> String {
    let row = |port: &PortDef, direction: &str| {
        format!("//! | `{}` | {direction} | `{}` | {} |\n", port.name, port.schema.name(), port.help)
    };
    let mut table = "//! | port | direction | type | what |\n//! | --- | --- | --- | --- |\n".to_owned();
    for port in inputs {
        table.push_str(&row(port, if port.required { "in" } else { "in, optional" }));
    }
    for port in outputs {
        table.push_str(&row(port, "out"));
    }
    table
}

fn undocumented(plugins: &[ProcessType], texts: &[String]) -> Vec<String> {
    let mut breaches = Vec::new();
    for plugin in plugins {
        let table = port_table(&plugin.inputs(), &plugin.outputs());
        if !texts.iter().any(|text| text.contains(&table)) {
            breaches.push(format!(
                "no file under plugins/ has the port table of {}:\n{table}",
                plugin.def().plugin
            ));
        }
    }
    breaches
}

#[test]
fn every_port_table_is_the_definition() {
    let texts: Vec<String> = sources("plugins").into_iter().map(|source| source.text).collect();
    assert_kept("a plugin's documentation has its ports", &undocumented(rcs_plugins::all(), &texts));
    // It detects a port that is missing, and a different word.
    let cut: Vec<String> = texts.iter().map(|text| text.replace("`calibration`", "`calib`")).collect();
    let named = |ports: Vec<PortDef>| ports.iter().any(|port| port.name == "calibration");
    let with = rcs_plugins::all().iter().filter(|plugin| named(plugin.inputs()) || named(plugin.outputs()));
    let with = with.count();
    assert!(with > 1, "some plugins have such a port");
    assert_eq!(undocumented(rcs_plugins::all(), &cut).len(), with);
}
