//! `ocu graph`: prints the hierarchy of the processes of a stack or of a recording.

use crate::cli::{GraphArgs, GraphFormat};
use crate::{stacks, usage};
use prost::Message as _;
use rcs_log::{CursorOptions, Log};
use rcs_msg::rcs::ProcessInfo;
use rcs_runtime::source::{BufferInfo, Hierarchy};
use std::io::Write;
use std::path::Path;

/// Prints the hierarchy named on the command line.
pub fn graph(args: &GraphArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let is_stack = !args.source.to_lowercase().ends_with(".mcap");
    let (processes, buffers) = if is_stack { of_stack(args)? } else { of_log(&args.source)? };
    let found = Hierarchy::new(&processes, &buffers, is_stack);
    if found.nodes.is_empty() {
        return Err(usage(format!("nothing in it says who wrote its messages: {}", args.source)));
    }
    let text = match args.format {
        GraphFormat::Text => found.to_text(),
        GraphFormat::Dot => found.to_dot(),
    };
    write!(out, "{text}")?;
    Ok(())
}

fn of_stack(args: &GraphArgs) -> anyhow::Result<(Vec<ProcessInfo>, Vec<BufferInfo>)> {
    let plan = stacks::plan(&args.source, args.course.as_deref(), &[])?;
    let buffers = plan.buffers.iter().map(|buffer| {
        BufferInfo::new(&buffer.spec.name, buffer.spec.schema.name(), "", &buffer.spec.metadata)
    });
    Ok((plan.process_infos(), buffers.collect()))
}

fn of_log(path: &str) -> anyhow::Result<(Vec<ProcessInfo>, Vec<BufferInfo>)> {
    let log: Log = stacks::open_log(Path::new(path))?;
    let info = log.info();
    let described = info.topics.iter().filter(|topic| topic.schema.name() == "rcs.ProcessInfo");
    let ids: Vec<_> = described.map(|topic| topic.id).collect();
    let mut processes: Vec<ProcessInfo> = Vec::new();
    if !ids.is_empty() {
        for message in log.cursor(CursorOptions { topics: Some(ids), ..CursorOptions::default() }) {
            if let Ok(info) = ProcessInfo::decode(message?.data)
                && !processes.iter().any(|known| known.name == info.name)
            {
                processes.push(info);
            }
        }
    }
    let buffers = info.topics.iter().map(|topic| {
        let type_name = rcs_msg::canonical_name(&topic.schema).unwrap_or_else(|| topic.schema.name());
        BufferInfo::new(&topic.name, type_name, "", &topic.metadata)
    });
    Ok((processes, buffers.collect()))
}
