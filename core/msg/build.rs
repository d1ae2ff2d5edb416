//! Compiles `proto/**` into Rust types and into the descriptor set that every log we write embeds.

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
    prost_build::Config::new()
        .bytes(["."])
        .enable_type_names()
        .disable_comments([".foxglove"])
        .compile_fds(compiler.file_descriptor_set())?;
    Ok(())
}
