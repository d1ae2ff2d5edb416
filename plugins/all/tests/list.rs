//! Rules for every process type in the list. (Parameters and port tables are checked by the architecture tests in the
//! package of cross-crate tests.)

use rcs_plugins::all;
use rcs_runtime::Role;
use std::collections::BTreeSet;

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
        for command in kind.commands() {
            assert!(!command.help.is_empty(), "{}: command {}", def.plugin, command.name);
            assert!(
                !rcs_runtime::BUILT_IN.iter().any(|known| known.name == command.name),
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
            let role: Option<Role> = output.metadata.get("rcs.role").and_then(|role| role.parse().ok());
            let fits = role.is_some_and(|role| role.fits(output.schema.name()));
            assert!(fits, "{}.{}: {role:?} of {}", kind.def().plugin, output.name, output.schema.name());
            if let Some(of) = output.metadata.get("rcs.overlay_of") {
                assert!(
                    inputs.iter().chain(&outputs).any(|port| port.name == of),
                    "{}.{} lies on {of}",
                    kind.def().plugin,
                    output.name
                );
            }
        }
    }
}
