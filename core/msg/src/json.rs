//! Messages as JSON text, in protobuf's JSON mapping: readable, and for programs to save and load.

use crate::any::{AnyMessage, Payload, schema_of};
use crate::schema::Schema;
use prost::Message as _;
use prost_reflect::DynamicMessage;
use std::sync::Arc;

/// Why a message cannot be converted to JSON or from JSON.
#[derive(Debug, thiserror::Error)]
pub enum JsonError {
    /// The message has no protobuf descriptor, or does not decode.
    #[error("{schema} cannot be written as JSON: {reason}")]
    Message {
        /// Name of its schema.
        schema: String,
        /// What is wrong.
        reason: String,
    },
    /// The text is not a message of this schema.
    #[error("line {line}, column {column}: {reason}; expected the JSON of a {schema}")]
    Text {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What is wrong.
        reason: String,
        /// Name of the schema.
        schema: String,
    },
}

/// The message as indented JSON.
pub fn to_json(message: &AnyMessage) -> Result<String, JsonError> {
    let schema = message.schema();
    let error = |reason: String| JsonError::Message { schema: schema.name().to_owned(), reason };
    let descriptor = schema.descriptor().ok_or_else(|| error("it is no protobuf type".to_owned()))?;
    let dynamic = DynamicMessage::decode(descriptor.clone(), message.bytes())
        .map_err(|reason| error(reason.to_string()))?;
    serde_json::to_string_pretty(&dynamic).map_err(|reason| error(reason.to_string()))
}

/// Parses a message of the named schema from JSON. Unknown fields are refused.
pub fn from_json<T: Payload>(text: &str) -> Result<T, JsonError> {
    let schema = schema_of::<T>();
    read(schema, text)?
        .transcode_to()
        .map_err(|error| JsonError::Message { schema: schema.name().to_owned(), reason: error.to_string() })
}

/// Parses a message of a generated type from JSON. Unknown fields are refused.
pub fn from_json_as(schema: &Arc<Schema>, text: &str) -> Result<AnyMessage, JsonError> {
    let bytes = read(schema, text)?.encode_to_vec().into();
    match crate::canonical(schema, &bytes) {
        Some(Ok(message)) => Ok(message),
        _ => Err(JsonError::Message {
            schema: schema.name().to_owned(),
            reason: "it is none of the program's types".to_owned(),
        }),
    }
}

fn read(schema: &Schema, text: &str) -> Result<DynamicMessage, JsonError> {
    let unreadable = |reason: String| JsonError::Message { schema: schema.name().to_owned(), reason };
    let descriptor = schema.descriptor().ok_or_else(|| unreadable("it has no descriptor".to_owned()))?;
    let mut reader = serde_json::Deserializer::from_str(text);
    let read = DynamicMessage::deserialize(descriptor.clone(), &mut reader);
    read.and_then(|message| reader.end().map(|()| message)).map_err(|error| {
        let (line, column) = (error.line(), error.column());
        // serde_json appends the position to its text; it is a field of its own here.
        let reason = error.to_string();
        let reason = reason.split(" at line ").next().unwrap_or(&reason).to_owned();
        JsonError::Text { line, column, reason, schema: schema.name().to_owned() }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rcs::{RangeReading, RangeReadings};

    #[test]
    fn what_is_written_is_read_back() {
        let reading = RangeReading {
            frame_id: "infrared_left".to_owned(),
            range_m: 1.25,
            seen: true,
            max_range_m: 2.5,
            cone_rad: 0.1,
        };
        let message = RangeReadings { timestamp: None, readings: vec![reading] };
        let text = to_json(&AnyMessage::new(message.clone())).unwrap();
        assert!(text.contains("\"infrared_left\""), "{text}");
        assert_eq!(from_json::<RangeReadings>(&text).unwrap(), message);
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        let error = from_json::<RangeReadings>("{\n  \"reading\": []\n}").unwrap_err().to_string();
        assert!(error.starts_with("line 2, column ") && error.contains("rcs.RangeReadings"), "{error}");
        let error = from_json::<RangeReadings>("{} x").unwrap_err().to_string();
        assert!(error.starts_with("line 1"), "{error}");
    }
}
