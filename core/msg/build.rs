//! Compiles `proto/**` into Rust types, into the list of those types, and into the descriptor set that every log we
//! write embeds.

use heck::ToUpperCamelCase;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, error::Error, fs};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=proto");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mut files = Vec::new();
    for package in ["foxglove", "rcs"] {
        for entry in fs::read_dir(Path::new("proto").join(package))? {
            files.push(entry?.path());
        }
    }
    files.retain(|file| file.extension().is_some_and(|extension| extension == "proto"));
    files.sort();

    // The embedded set has no comments but keeps our field options, which prost's own types would drop.
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).include_source_info(false).open_files(&files)?;
    fs::write(out.join("descriptors.bin"), compiler.encode_file_descriptor_set())?;

    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).include_source_info(true).open_files(&files)?;
    let set = compiler.file_descriptor_set();
    let mut known = BTreeMap::new();
    for file in set.file.iter().filter(|file| ["foxglove", "rcs"].contains(&file.package())) {
        for message in &file.message_type {
            let has = |name: &str, type_name: &str| {
                message.field.iter().any(|field| field.name() == name && field.type_name() == type_name)
            };
            let rust = format!("crate::{}::{}", file.package(), message.name().to_upper_camel_case());
            let timestamp = if has("timestamp", ".google.protobuf.Timestamp") {
                format!("|message| message.get::<{rust}>()?.timestamp")
            } else {
                "|_| None".to_owned()
            };
            let frame = if has("frame_id", "") {
                format!("|message| Some(message.get::<{rust}>()?.frame_id.as_str())")
            } else {
                "|_| None".to_owned()
            };
            let name = format!("{}.{}", file.package(), message.name());
            let mut entry = String::new();
            writeln!(entry, "Known {{ name: {name:?}, decode: AnyMessage::decode::<{rust}>,")?;
            writeln!(entry, "    timestamp: {timestamp}, frame_id: {frame} }},")?;
            known.insert(name, entry);
        }
    }
    let known: String = known.into_values().collect();
    fs::write(out.join("known.rs"), format!("&[\n{known}]"))?;

    prost_build::Config::new()
        .bytes(["."])
        .enable_type_names()
        .disable_comments([".foxglove"])
        .compile_fds(set)?;
    Ok(())
}
