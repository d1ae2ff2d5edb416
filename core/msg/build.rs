//! Compiles `proto/**` with `rcs-msg-build`.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    rcs_msg_build::compile_shared()
}
