//! Messages: Foxglove's schemas and our `rcs` package as Rust types, and any message of any encoding as a tree.
//!
//! - [`foxglove`], [`rcs`]: generated types; [`Payload`] is what all of them are.
//! - [`AnyMessage`]: one message whose type is known at run time; encoded and decoded at most once.
//! - [`Schema`], [`registry`]: what describes a message; ours are all in [`registry`].

mod any;
mod schema;
mod time;

pub use any::{AnyMessage, Payload, schema_of};
pub use schema::{MessageEncoding, Registry, Schema, registry};
pub use time::Stamp;

/// Foxglove's published schemas, generated from `proto/foxglove`.
#[allow(clippy::all, clippy::pedantic, missing_docs, unreachable_pub, reason = "generated code")]
pub mod foxglove {
    include!(concat!(env!("OUT_DIR"), "/foxglove.rs"));
}

/// Our own messages, generated from `proto/rcs`.
#[allow(clippy::all, clippy::pedantic, missing_docs, unreachable_pub, reason = "generated code")]
pub mod rcs {
    include!(concat!(env!("OUT_DIR"), "/rcs.rs"));
}
