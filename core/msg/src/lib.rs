//! Messages: Foxglove's schemas and our package `rcs` as Rust types, and any message of any encoding as a tree.
//!
//! - [`foxglove`], [`rcs`]: generated types; all of them implement [`Payload`].
//! - [`AnyMessage`]: one message whose type is known at run time; encoded and decoded at most once.
//! - [`Schema`], [`registry`]: descriptions of message types. The registry holds those of this crate from the start,
//!   and those of a plugin once the plugin is in use. [`messages!`] declares the messages of a plugin, from `.proto`
//!   files in its folder.
//! - [`Value`], [`FieldPath`]: any message as a tree, and the position of a value within it.
//! - [`FieldScanner`]: reads one number from each of many messages without decoding the rest.
//! - [`canonical`]: the one registry of conversions from foreign messages to ours.
//! - [`classes`]: names and colours of the values of a label image.
//! - [`DeltaCodec`]: stores the messages of a type as key frames and deltas. [`grid_decoder`]: reads grids of ROS that
//!   were recorded with their updates.
//! - [`guard`]: turns panics of foreign-data readers into errors.
//! - [`params`]: parameters as messages, with units, ranges and defaults. [`image`], [`points()`]: pixels and points.
//!
//! This crate knows no buffers, files or processes: `rcs-bus` passes messages on, `rcs-log` stores them, and
//! `rcs-runtime` runs the processes that read and write them.
//! Begin with [`AnyMessage`] and [`Payload`]; to read a message whose type is not known at compile time, with
//! [`Value`].
//!
//! ```
//! use rcs_msg::{AnyMessage, foxglove::Vector2};
//! // A typed message is read without decoding.
//! let message = AnyMessage::new(Vector2 { x: 1.5, y: -2.0 });
//! assert_eq!(message.get::<Vector2>().map(|v| v.x), Some(1.5));
//! // The same message as a reader sees it that knows the schema and the bytes only.
//! let encoded = AnyMessage::encoded(message.schema(), message.bytes());
//! let tree = encoded.value()?;
//! assert_eq!(tree.get(&".y".parse()?)?.as_f64(), Some(-2.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod any;
pub mod channel;
pub mod classes;
mod convert;
mod definition;
mod delta;
mod descriptors;
mod edit;
mod fix;
pub mod guard;
mod header;
pub mod image;
mod json;
mod packed;
pub mod params;
mod path;
mod points;
mod reader;
mod registry;
mod scan;
mod schema;
mod time;
mod value;

pub use any::{AnyMessage, DeferredSource, Payload, schema_of};
pub use convert::{ConvertError, DELETES_NAMESPACE, GRID_UPDATES, canonical, canonical_name, grid_decoder};
pub use definition::MessageEncoding;
pub use delta::{DELTA_OF, DELTA_SUFFIX, DeltaCodec, DeltaDecoder, DeltaEncoder, Digest, Digester, Stored};
pub use header::{header_frame, header_stamp};
pub use json::{JsonError, from_json, from_json_as, to_json};
pub use packed::{Number, Packed, Scalar};
pub use path::{FieldPath, PathSyntaxError, Segment};
pub use points::{Point, Points, PointsError, points};
pub use prost;
pub use prost_types;
pub use reader::{DecodeError, EncodeError};
pub use registry::{Bundle, DuplicateMessage, Known, Registry, SchemaCell, registry};
pub use scan::{FieldScanner, ScanError};
pub use schema::Schema;
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

/// Declares a module with the messages that `rcs_msg_build::compile` has generated from the `.proto` files of a crate:
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
