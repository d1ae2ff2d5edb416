//! Bundled files are compiled in; a new file in their folders triggers a rebuild.

fn main() {
    println!("cargo:rerun-if-changed=../../assets");
    println!("cargo:rerun-if-changed=../../layouts");
}
