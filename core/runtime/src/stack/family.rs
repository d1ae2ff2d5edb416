//! Supervisors and children: assigns children to supervisors, and checks that they fit.

use super::error::{StackError, one_of};
use super::file::{ProcessEntry, StackFile, VIEWER};
use super::plan::{ChildPlan, ProcessPlan};
use crate::children::ChildDef;
use toml::Spanned;

/// Assigns to every supervisor its children; an error if a child does not fit, or a mandatory one is missing.
pub(super) fn join(file: &StackFile, processes: &mut [ProcessPlan]) -> Result<(), StackError> {
    for (index, entry) in file.content.processes.iter().enumerate() {
        let Some(parent) = processes[index].supervisor else { continue };
        let slot = slot_of(file, processes, index, parent, entry)?;
        let at = processes[parent].children.partition_point(|child| child.slot <= slot);
        processes[parent].children.insert(at, ChildPlan { slot, process: index });
    }
    for (process, entry) in processes.iter().zip(&file.content.processes) {
        for (slot, def) in process.kind.children().iter().enumerate() {
            if def.required && !process.children.iter().any(|child| child.slot == slot) {
                let name = &process.name;
                let message = format!(
                    "process {name} has no child {}; expected a process with supervisor = \"{name}\" and as = \"{}\" \
                     ({})",
                    def.name, def.name, def.help
                );
                return Err(file.error(&entry.span(), message));
            }
        }
    }
    Ok(())
}

/// Which of its supervisor's children a process is.
fn slot_of(
    file: &StackFile,
    processes: &[ProcessPlan],
    index: usize,
    parent: usize,
    entry: &Spanned<ProcessEntry>,
) -> Result<usize, StackError> {
    let entry = entry.get_ref();
    let (child, parent) = (&processes[index], &processes[parent]);
    let (name, above) = (&child.name, &parent.name);
    let span = entry.child.as_ref().or(entry.supervisor.as_ref()).map_or(entry.name.span(), Spanned::span);
    let error = |message: String| Err(file.error(&span, message));
    let defs = parent.kind.children();
    if defs.is_empty() {
        let able = processes.iter().filter(|process| !process.kind.children().is_empty());
        let able = one_of([VIEWER].into_iter().chain(able.map(|process| &*process.name)));
        return error(format!(
            "{above} ({}) supervises no one, so it cannot be the supervisor of {name}; expected {able}",
            parent.kind.def().plugin
        ));
    }
    let named = |wanted: &str| defs.iter().position(|def| def.name == wanted);
    let names = || one_of(defs.iter().map(|def| def.name));
    let slot = match &entry.child {
        Some(wanted) => named(wanted.get_ref()),
        None => named(name)
            .or_else(|| named(child.kind.def().plugin))
            .or_else(|| defs.iter().position(|def| def.many)),
    };
    let Some(slot) = slot else {
        let wanted = entry.child.as_ref().map_or(&**name, |wanted| wanted.get_ref().as_str());
        return error(format!("{above} has no child {wanted:?}; expected as = {}", names()));
    };
    let def = &defs[slot];
    if let Some(other) = parent.children.iter().find(|other| other.slot == slot && !def.many) {
        let other = &processes[other.process].name;
        return error(format!(
            "{above} has one child {}, which is {other}; {name} cannot be it, too",
            def.name
        ));
    }
    match missing_command(def, child) {
        None => Ok(slot),
        Some(missing) => error(format!(
            "{name} ({}) does not obey {missing}, which {above} sends to its child {}",
            child.kind.def().plugin,
            def.name
        )),
    }
}

/// A command of a supervisor that the process does not obey, or obeys with other parameters.
fn missing_command(def: &ChildDef, child: &ProcessPlan) -> Option<String> {
    let obeys = child.kind.commands();
    let serves = |wanted: &crate::command::CommandDef| {
        obeys
            .iter()
            .any(|own| own.name == wanted.name && own.parameters_schema() == wanted.parameters_schema())
    };
    let missing = def.commands.iter().find(|wanted| !serves(wanted))?;
    Some(match missing.parameters_schema() {
        "" => missing.name.to_owned(),
        schema => format!("{} ({schema})", missing.name),
    })
}
