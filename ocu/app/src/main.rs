//! The program `ocu`.
fn main() {}
