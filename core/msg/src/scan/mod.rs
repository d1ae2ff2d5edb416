//! Reads one number from each of many messages without decoding the rest.
//!
//! [`FieldScanner::scan`] returns what [`Value::get`](crate::Value::get) followed by
//! [`Value::as_f64`](crate::Value::as_f64) returns, and allocates nothing for protobuf and messages of ROS: a plot can read a
//! million messages this way.

mod protobuf;
mod ros;
mod wire;

use crate::path::{FieldPath, Segment};
use crate::reader::{DecodeError, Reader};
use crate::schema::Schema;
use bytes::Bytes;
use std::sync::Arc;

/// Reads the number at one path from messages of one schema.
#[derive(Clone, Debug)]
pub struct FieldScanner(Plan);

#[derive(Clone, Debug)]
enum Plan {
    Protobuf(protobuf::Plan, Arc<str>),
    Ros(ros::Plan, Arc<str>),
    /// JSON, and protobuf maps.
    Tree(Arc<Schema>, FieldPath),
}

/// Why a path cannot be scanned.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScanError {
    /// Messages of this schema cannot be read.
    #[error(transparent)]
    Schema(#[from] DecodeError),
    /// The schema has no field of this name.
    #[error("no field {name:?} in {message}, expected one of {expected}: {path}")]
    NoField {
        /// Name of the field.
        name: String,
        /// The message that lacks it.
        message: String,
        /// The fields of that message.
        expected: String,
        /// The whole path.
        path: FieldPath,
    },
    /// The value at the path is not a number, or the path does not fit the kind of a value along it.
    #[error("got {got}, expected {expected}: {path}")]
    Kind {
        /// The kind found.
        got: String,
        /// The kind expected.
        expected: &'static str,
        /// The whole path.
        path: FieldPath,
    },
}

impl FieldScanner {
    /// Resolves the path against the schema.
    pub fn new(schema: &Arc<Schema>, path: &FieldPath) -> Result<Self, ScanError> {
        let name = || Arc::from(schema.name());
        Ok(Self(match schema.reader()? {
            Reader::Protobuf(descriptor) => match protobuf::Plan::new(descriptor, path)? {
                Some(plan) => Plan::Protobuf(plan, name()),
                None => Plan::Tree(Arc::clone(schema), path.clone()),
            },
            Reader::Ros(layout) => Plan::Ros(ros::Plan::new(layout, schema.name(), path)?, name()),
            Reader::Json => Plan::Tree(Arc::clone(schema), path.clone()),
        }))
    }

    /// Whether messages are read without decoding them, so that their values are numbers and never texts.
    pub fn is_direct(&self) -> bool {
        !matches!(self.0, Plan::Tree(..))
    }

    /// The number in this message; `None` if the message does not contain it (an absent submessage, an index out of
    /// range). The rest of the message is checked only as far as is needed to skip it.
    pub fn scan(&self, message: &[u8]) -> Result<Option<f64>, DecodeError> {
        let malformed = |schema: &str, reason| DecodeError::Malformed { schema: schema.to_owned(), reason };
        match &self.0 {
            Plan::Protobuf(plan, name) => {
                plan.scan(message).map_err(|error| malformed(name, error.to_string()))
            }
            Plan::Ros(plan, name) => plan.scan(message).map_err(|error| malformed(name, error.to_string())),
            Plan::Tree(schema, path) => {
                let value = schema.value(&Bytes::copy_from_slice(message))?;
                Ok(value.get(path).ok().and_then(|value| value.as_f64()))
            }
        }
    }
}

/// The errors of both scanners.
struct Fail<'a>(&'a FieldPath);

impl Fail<'_> {
    fn kind(&self, got: impl Into<String>, expected: &'static str) -> ScanError {
        ScanError::Kind { got: got.into(), expected, path: self.0.clone() }
    }

    fn field<'n>(&self, name: &str, message: &str, fields: impl Iterator<Item = &'n str>) -> ScanError {
        ScanError::NoField {
            name: name.to_owned(),
            message: message.to_owned(),
            expected: fields.collect::<Vec<_>>().join(", "),
            path: self.0.clone(),
        }
    }

    /// Refuses further steps below a value that has no parts.
    fn ends(&self, rest: &[Segment], what: &str) -> Result<(), ScanError> {
        if rest.is_empty() { Ok(()) } else { Err(self.kind(what, "the end of the path")) }
    }
}
