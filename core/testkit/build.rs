//! Compiles the messages of tests with `rcs-msg-build`.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    rcs_msg_build::compile()
}
