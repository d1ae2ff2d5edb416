//! Sets what Copper's macros require of a crate that uses them.

fn main() {
    cu29_build::setup();
}
