//! Compiles the messages of this plugin: see `rcs-msg-build`.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    rcs_msg_build::compile()
}
