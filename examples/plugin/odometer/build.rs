//! Compiles `proto/`: see `rcs-msg-build`.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    rcs_msg_build::compile()
}
