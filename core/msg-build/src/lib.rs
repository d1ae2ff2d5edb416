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
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FileDescriptorProto, FileDescriptorSet};
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
    let package = one_package(set.own_files())?;
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

/// The protobuf package of some files: there must be one, the same for all.
fn one_package<'a>(files: impl Iterator<Item = &'a FileDescriptorProto>) -> Result<&'a str, String> {
    let mut packages = BTreeSet::new();
    for file in files {
        if file.package().is_empty() {
            return Err(format!("{} has no package, expected a line like `package acme;`", file.name()));
        }
        packages.insert(file.package());
    }
    let packages: Vec<_> = packages.into_iter().collect();
    match packages.as_slice() {
        &[package] => Ok(package),
        _ => Err(format!("proto/ has packages {packages:?}, expected one")),
    }
}

/// Whether a message has a field `timestamp` that is an `Option<Timestamp>` in Rust.
fn has_timestamp(message: &DescriptorProto) -> bool {
    message.field.iter().any(|field| {
        // A field with `optional` is in a oneof of its own.
        let is_alone = field.oneof_index.is_none() || field.proto3_optional();
        field.name() == "timestamp"
            && field.type_name() == ".google.protobuf.Timestamp"
            && field.label() == Label::Optional
            && is_alone
    })
}

/// Whether a message has a field `frame_id` that is a `String` in Rust.
fn has_frame_id(message: &DescriptorProto, syntax: &str) -> bool {
    message.field.iter().any(|field| {
        field.name() == "frame_id"
            && field.r#type() == Type::String
            && field.label() == Label::Optional
            && field.oneof_index.is_none()
            // In proto2 the field is an `Option<String>`.
            && syntax == "proto3"
    })
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
                let rust = format!("{}::{}", module(file.package()), rust_name(message.name()));
                let timestamp = if has_timestamp(message) {
                    format!("|message| message.get::<{rust}>()?.timestamp")
                } else {
                    "|_| None".to_owned()
                };
                let frame = if has_frame_id(message, file.syntax()) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use prost_types::FieldDescriptorProto;

    fn message_with(field: FieldDescriptorProto) -> DescriptorProto {
        DescriptorProto { field: vec![field], ..DescriptorProto::default() }
    }

    #[test]
    fn a_frame_id_is_one_text_that_is_always_there() {
        let frame_id = FieldDescriptorProto {
            name: Some("frame_id".to_owned()),
            r#type: Some(Type::String.into()),
            label: Some(Label::Optional.into()),
            ..FieldDescriptorProto::default()
        };
        let has = |field: FieldDescriptorProto| has_frame_id(&message_with(field), "proto3");
        assert!(has(frame_id.clone()));
        assert!(!has(FieldDescriptorProto { r#type: Some(Type::Uint32.into()), ..frame_id.clone() }));
        assert!(!has(FieldDescriptorProto { label: Some(Label::Repeated.into()), ..frame_id.clone() }));
        assert!(!has(FieldDescriptorProto { oneof_index: Some(0), ..frame_id.clone() }), "one of several");
        let (oneof_index, proto3_optional) = (Some(0), Some(true));
        assert!(!has(FieldDescriptorProto { oneof_index, proto3_optional, ..frame_id.clone() }));
        assert!(!has_frame_id(&message_with(frame_id), "proto2"));
    }

    #[test]
    fn a_timestamp_is_one_that_may_be_absent() {
        let timestamp = FieldDescriptorProto {
            name: Some("timestamp".to_owned()),
            r#type: Some(Type::Message.into()),
            type_name: Some(".google.protobuf.Timestamp".to_owned()),
            label: Some(Label::Optional.into()),
            ..FieldDescriptorProto::default()
        };
        let has = |field: FieldDescriptorProto| has_timestamp(&message_with(field));
        assert!(has(timestamp.clone()));
        let (oneof_index, proto3_optional) = (Some(0), Some(true));
        assert!(has(FieldDescriptorProto { oneof_index, proto3_optional, ..timestamp.clone() }));
        assert!(!has(FieldDescriptorProto { oneof_index, ..timestamp.clone() }), "one of several");
        assert!(!has(FieldDescriptorProto { label: Some(Label::Repeated.into()), ..timestamp.clone() }));
        assert!(!has(FieldDescriptorProto { type_name: Some(".rcs.Stamp".to_owned()), ..timestamp }));
    }

    #[test]
    fn files_without_a_package_and_of_two_are_refused() {
        let file = |name: &str, package: Option<&str>| FileDescriptorProto {
            name: Some(name.to_owned()),
            package: package.map(str::to_owned),
            ..FileDescriptorProto::default()
        };
        let files = [file("a.proto", Some("acme")), file("b.proto", Some("acme"))];
        assert_eq!(one_package(files.iter()), Ok("acme"));
        let files = [file("a.proto", Some("acme")), file("b.proto", None)];
        let refused = one_package(files.iter()).unwrap_err();
        assert_eq!(refused, "b.proto has no package, expected a line like `package acme;`");
        let files = [file("a.proto", Some("acme")), file("b.proto", Some("rcs"))];
        let refused = one_package(files.iter()).unwrap_err();
        assert_eq!(refused, "proto/ has packages [\"acme\", \"rcs\"], expected one");
        assert!(one_package(std::iter::empty()).is_err());
    }
}
