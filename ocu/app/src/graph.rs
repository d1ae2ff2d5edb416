//! `ocu graph`: prints the hierarchy of the processes of a stack or of a recording.

use crate::assets::looks_like_path;
use crate::cli::{GraphArgs, GraphFormat};
use crate::open::FileKind;
use crate::{Ended, bundled, stacks, usage};
use prost::Message as _;
use rcs_log::{CursorOptions, Log};
use rcs_msg::rcs::ProcessInfo;
use rcs_runtime::source::{BufferInfo, Hierarchy};
use std::io::Write;
use std::path::Path;

/// Prints the hierarchy named on the command line.
pub fn graph(args: &GraphArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let log = if is_stack(&args.source) {
        None
    } else if args.course.is_some() {
        return Err(usage(format!("--course is for a stack; {} is a recording", args.source)));
    } else {
        Some(stacks::open_log(&args.source)?)
    };
    let (processes, buffers) = match &log {
        Some(log) => of_log(log)?,
        None => of_stack(args)?,
    };
    let found = Hierarchy::new(&processes, &buffers, log.is_none());
    if found.nodes.is_empty() {
        return Err(usage(format!("nothing in it says who wrote its messages: {}", args.source)));
    }
    let text = match args.format {
        GraphFormat::Text => found.to_text(),
        GraphFormat::Dot => found.to_dot(),
    };
    write!(out, "{text}")?;
    Ok(Ended::after(log.as_ref()))
}

/// Whether a stack is meant: a bundled one, a `.toml` file, or a word that is no file.
fn is_stack(source: &str) -> bool {
    let is_file = FileKind::of(Path::new(source)) == FileKind::Stack;
    is_file || bundled::file("stack", source).is_some() || !looks_like_path(source)
}

fn of_stack(args: &GraphArgs) -> anyhow::Result<(Vec<ProcessInfo>, Vec<BufferInfo>)> {
    let plan = stacks::plan(&args.source, args.course.as_deref(), &[])?;
    let buffers = plan.buffers.iter().map(|buffer| {
        BufferInfo::new(&buffer.spec.name, buffer.spec.schema.name(), "", &buffer.spec.metadata)
    });
    Ok((plan.process_infos(), buffers.collect()))
}

fn of_log(log: &Log) -> anyhow::Result<(Vec<ProcessInfo>, Vec<BufferInfo>)> {
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
