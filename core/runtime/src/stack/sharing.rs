//! Checks what processes of a stack share: buffers with several writers, and pools of threads.

use super::error::StackError;
use super::file::{BufferEntry, Class, StackFile, WritersEntry};
use super::plan::{BufferPlan, InputPlan, ProcessPlan};
use std::collections::BTreeMap;
use std::ops::Range;
use toml::Spanned;

/// Refuses a buffer with a second writer unless the stack allows it, and a pool whose processes have different classes.
pub(super) fn check(
    file: &StackFile,
    buffers: &[BufferPlan],
    inputs: &[InputPlan],
    processes: &[ProcessPlan],
) -> Result<(), StackError> {
    check_writers(file, buffers, inputs, processes)?;
    check_pools(file, processes)
}

fn check_writers(
    file: &StackFile,
    buffers: &[BufferPlan],
    inputs: &[InputPlan],
    processes: &[ProcessPlan],
) -> Result<(), StackError> {
    let is_shared = |buffer: usize| {
        let name = &buffers[buffer].spec.name;
        let entry = file.content.buffers.iter().find(|(entry, _)| entry.get_ref() == name);
        entry.is_some_and(|(_, entry): (_, &Spanned<BufferEntry>)| {
            entry.get_ref().writers == Some(WritersEntry::Many)
        })
    };
    let mut writers: BTreeMap<usize, String> = BTreeMap::new();
    let mut add = |buffer: usize, writer: String, span: Range<usize>| match writers.get(&buffer) {
        Some(first) if !is_shared(buffer) => {
            let name = &buffers[buffer].spec.name;
            let message = format!(
                "{name} is written by {first} and by {writer}; expected one writer, or writers = \"many\" in \
                 [buffers.\"{name}\"]"
            );
            Err(file.error(&span, message))
        }
        Some(_) => Ok(()),
        None => {
            writers.insert(buffer, writer);
            Ok(())
        }
    };
    for (input, entry) in inputs.iter().zip(&file.content.inputs) {
        add(input.buffer, format!("topic {}", input.topic), entry.get_ref().buffer.span())?;
    }
    for (process, entry) in processes.iter().zip(&file.content.processes) {
        add(process.status_buffer, format!("process {}", process.name), entry.span())?;
    }
    for (process, entry) in processes.iter().zip(&file.content.processes) {
        for (def, &buffer) in process.kind.outputs().iter().zip(&process.outputs) {
            let wire = entry.get_ref().outputs.iter().find(|(port, _)| port.get_ref() == def.name);
            let span = wire.map_or(entry.span(), |(_, buffer)| buffer.span());
            add(buffer, format!("process {}", process.name), span)?;
        }
    }
    Ok(())
}

fn check_pools(file: &StackFile, processes: &[ProcessPlan]) -> Result<(), StackError> {
    let mut pools: BTreeMap<&str, (Class, &str)> = BTreeMap::new();
    for (process, entry) in processes.iter().zip(&file.content.processes) {
        let Some(pool) = &entry.get_ref().pool else { continue };
        let name = pool.get_ref().as_str();
        if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
            let message = format!("{name:?} cannot name a pool; expected letters, digits and underscores");
            return Err(file.error(&pool.span(), message));
        }
        let (class, first) = *pools.entry(name).or_insert((process.class, &process.name));
        if class != process.class {
            let message = format!(
                "pool {name} serves {first} of class {} and {} of class {}; expected processes of one class",
                class.name(),
                process.name,
                process.class.name()
            );
            return Err(file.error(&pool.span(), message));
        }
    }
    Ok(())
}
