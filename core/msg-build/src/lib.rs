//! Compiles `.proto` files into Rust message types: for the build scripts of this repository and of plugins outside of
//! it.
//!
//! A plugin keeps its messages (parameters, statistics) in `proto/` of its own folder and has this `build.rs`:
//!
//! ```no_run
//! fn main() -> Result<(), Box<dyn std::error::Error>> {
//!     rcs_msg_build::compile()
//! }
//! ```
//!
//! Its `lib.rs` says `rcs_msg::messages!(pub mod proto);`. Its `.proto` files may import those of `rcs-msg`, such as
//! `rcs/options.proto` for units, ranges, defaults and help.
//!
//! [`compile`] writes to `OUT_DIR`: the Rust types, their descriptors with our field options, and `messages.rs`, which
//! includes the types and implements `Payload` for each. A change of a plugin's `.proto` file rebuilds only that plugin
//! and what depends on it.
//!
//! This crate is not used at run time; reading and writing messages is the task of `rcs-msg`.

#![expect(clippy::print_stdout, reason = "a build script tells cargo by its output")]

use heck::ToUpperCamelCase;
use prost_build::Config;
use prost_types::{FileDescriptorProto, FileDescriptorSet};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, error::Error, fs};

/// Compiles all `.proto` files in `proto/` and below. They must belong to one protobuf package.
pub fn compile() -> Result<(), Box<dyn Error>> {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../msg/proto");
    println!("cargo:rerun-if-changed=proto");
    println!("cargo:rerun-if-changed={}", shared.join("rcs").display());
    let own = names_below(Path::new("proto"))?;
    let set = Compiled::new(&["proto".into(), shared], &own)?;
    let packages = set.packages();
    let [package] = packages.as_slice() else {
        return Err(format!("proto/ has packages {packages:?}, expected one").into());
    };
    let mut config = Config::new();
    config.prost_path("::rcs_msg::prost").prost_types_path("::rcs_msg::prost_types");
    for (from, name) in set.imported() {
        config.extern_path(format!(".{from}.{name}"), format!("::rcs_msg::{from}::{}", rust_name(&name)));
    }
    set.write_types(config)?;
    let include = format!("include!(concat!(env!(\"OUT_DIR\"), \"/{package}.rs\"));\n");
    set.write_messages(&include, "::rcs_msg", |_| "self".to_owned())
}

/// Compiles the messages of `rcs-msg` itself: packages `foxglove` and `rcs` in `proto/`.
pub fn compile_shared() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=proto");
    let own = names_below(Path::new("proto"))?;
    let set = Compiled::new(&["proto".into()], &own)?;
    let mut config = Config::new();
    config.disable_comments([".foxglove"]);
    set.write_types(config)?;
    set.write_messages("", "crate", |package| format!("crate::{package}"))
}

/// Names of all `.proto` files below a folder, relative to it, sorted.
fn names_below(root: &Path) -> Result<Vec<String>, Box<dyn Error>> {
    let mut names = Vec::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder)? {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "proto") {
                let name = path.strip_prefix(root)?;
                names.push(name.to_str().ok_or("a file's name is no text")?.replace('\\', "/"));
            }
        }
    }
    names.sort();
    Ok(names)
}

fn rust_name(message: &str) -> String {
    message.to_upper_camel_case()
}

struct Compiled {
    out: PathBuf,
    own: BTreeSet<String>,
    /// With comments, which become the documentation of the Rust types.
    set: FileDescriptorSet,
    /// Without comments, and with our field options, which prost's own types would drop.
    encoded: Vec<u8>,
}

impl Compiled {
    fn new(includes: &[PathBuf], own: &[String]) -> Result<Self, Box<dyn Error>> {
        let compiled = |with_comments: bool| -> Result<protox::Compiler, Box<dyn Error>> {
            let mut compiler = protox::Compiler::new(includes)?;
            compiler.include_imports(true).include_source_info(with_comments).open_files(own)?;
            Ok(compiler)
        };
        Ok(Self {
            out: PathBuf::from(env::var("OUT_DIR")?),
            own: own.iter().cloned().collect(),
            set: compiled(true)?.file_descriptor_set(),
            encoded: compiled(false)?.encode_file_descriptor_set(),
        })
    }

    fn own_files(&self) -> impl Iterator<Item = &FileDescriptorProto> {
        self.set.file.iter().filter(|file| self.own.contains(file.name()))
    }

    fn packages(&self) -> Vec<&str> {
        self.own_files().map(FileDescriptorProto::package).collect::<BTreeSet<_>>().into_iter().collect()
    }

    /// Package and name of the messages and enums of imported files, except those of protobuf itself.
    fn imported(&self) -> Vec<(String, String)> {
        let files = self.set.file.iter();
        let imported =
            files.filter(|file| !self.own.contains(file.name()) && file.package() != "google.protobuf");
        let names = |file: &FileDescriptorProto| {
            let messages = file.message_type.iter().map(|message| message.name().to_owned());
            let enums = file.enum_type.iter().map(|choice| choice.name().to_owned());
            let package = file.package().to_owned();
            messages.chain(enums).map(move |name| (package.clone(), name)).collect::<Vec<_>>()
        };
        imported.flat_map(names).collect()
    }

    fn write_types(&self, mut config: Config) -> Result<(), Box<dyn Error>> {
        fs::write(self.out.join("descriptors.bin"), &self.encoded)?;
        config.bytes(["."]).enable_type_names().compile_fds(self.set.clone())?;
        Ok(())
    }

    /// The list of types by name, and an implementation of `Payload` for each. `msg` is the path of `rcs-msg`.
    fn write_messages(
        &self,
        head: &str,
        msg: &str,
        module: impl Fn(&str) -> String,
    ) -> Result<(), Box<dyn Error>> {
        let mut known = BTreeMap::new();
        let mut payloads = String::new();
        for file in self.own_files() {
            for message in &file.message_type {
                let has = |name: &str, type_name: &str| {
                    let mut fields = message.field.iter();
                    fields.any(|field| field.name() == name && field.type_name() == type_name)
                };
                let rust = format!("{}::{}", module(file.package()), rust_name(message.name()));
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
                writeln!(
                    entry,
                    "    {msg}::Known {{ name: {name:?}, decode: {msg}::AnyMessage::decode::<{rust}>,"
                )?;
                writeln!(entry, "        timestamp: {timestamp}, frame_id: {frame} }},")?;
                known.insert(name.clone(), entry);
                writeln!(payloads, "impl {msg}::Payload for {rust} {{")?;
                writeln!(payloads, "    fn schema() -> &'static ::std::sync::Arc<{msg}::Schema> {{")?;
                writeln!(payloads, "        static SCHEMA: {msg}::SchemaCell = {msg}::SchemaCell::new();")?;
                writeln!(payloads, "        SCHEMA.get(&BUNDLE, {name:?})")?;
                writeln!(payloads, "    }}\n}}")?;
            }
        }
        let known: String = known.into_values().collect();
        let bundle = format!(
            "/// The messages that are compiled here, for the registry.\n\
             pub static BUNDLE: {msg}::Bundle = {msg}::Bundle::new(\n    \
             include_bytes!(concat!(env!(\"OUT_DIR\"), \"/descriptors.bin\")),\n    &[\n{known}]);\n"
        );
        fs::write(self.out.join("messages.rs"), format!("{head}{bundle}{payloads}"))?;
        Ok(())
    }
}
