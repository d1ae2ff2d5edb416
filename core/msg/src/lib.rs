//! Messages: Foxglove's schemas and our `rcs` package as Rust types, and any message of any encoding as a tree.
//!
//! - [`foxglove`], [`rcs`]: generated types; [`Payload`] is what all of them are.
//! - [`AnyMessage`]: one message whose type is known at run time; encoded and decoded at most once.
//! - [`Schema`], [`registry`]: what describes a message; ours are all in [`registry`], and those of plugins once they are
//!   named. [`messages!`]: the messages of a plugin, from `.proto` files in its own folder.
//! - [`Value`], [`FieldPath`]: any message as a tree, and where something is in it.
//! - [`FieldScanner`]: one number out of many messages, without decoding the rest.
//! - [`canonical`]: the one registry of conversions, from foreign messages to ours.
//! - [`classes`]: names and colours of the values of a label image.
//! - [`DeltaCodec`]: messages of a type stored as key frames and what changed between them.
//! - [`guard`]: what keeps a reader of foreign bytes from ending the program.
//! - [`params`]: parameters as messages: their units, ranges, defaults. [`image`], [`points()`]: pixels and points.

mod any;
pub mod classes;
mod convert;
mod delta;
mod edit;
pub mod guard;
mod header;
pub mod image;
mod json;
mod packed;
pub mod params;
mod path;
mod points;
mod reader;
mod scan;
mod schema;
mod time;
mod value;

pub use any::{AnyMessage, Payload, schema_of};
pub use convert::{ConvertError, canonical, canonical_name};
pub use delta::{DELTA_OF, DELTA_SUFFIX, DeltaCodec, DeltaDecoder, DeltaEncoder, Stored};
pub use header::{header_frame, header_stamp};
pub use json::{JsonError, from_json, from_json_as, to_json};
pub use packed::{Number, Packed};
pub use path::{FieldPath, PathSyntaxError, Segment};
pub use points::{Point, Points, PointsError, points};
pub use prost;
pub use prost_types;
pub use reader::{DecodeError, EncodeError};
pub use scan::{FieldScanner, ScanError};
pub use schema::{Bundle, DuplicateMessage, Known, MessageEncoding, Registry, Schema, SchemaCell, registry};
pub use time::Stamp;
pub use value::{PathError, Value};

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

#[allow(unreachable_pub, reason = "generated code")]
mod messages {
    include!(concat!(env!("OUT_DIR"), "/messages.rs"));
}

/// A module with the messages that `rcs_msg_build::compile` has made of the `.proto` files of a crate:
/// `rcs_msg::messages!(pub mod proto);`
#[macro_export]
macro_rules! messages {
    ($(#[$meta:meta])* $vis:vis mod $name:ident) => {
        $(#[$meta])*
        #[allow(clippy::all, clippy::pedantic, missing_docs, unreachable_pub, reason = "generated code")]
        $vis mod $name {
            include!(concat!(env!("OUT_DIR"), "/messages.rs"));
        }
    };
}
