//! Messages whose type is known at run time.

use crate::schema::{MessageEncoding, Schema, registry};
use bytes::Bytes;
use std::any::Any;
use std::sync::{Arc, OnceLock};

/// A message type of ours: what a buffer can carry typed.
pub trait Payload: prost::Message + prost::Name + Default + Clone + PartialEq + 'static {}
impl<T: prost::Message + prost::Name + Default + Clone + PartialEq + 'static> Payload for T {}

/// One message: typed or encoded, shared without a copy, encoded at most once.
#[derive(Clone)]
pub struct AnyMessage(Arc<dyn Body>);

trait Body: Send + Sync {
    fn schema_name(&self) -> &str;
    fn schema(&self) -> Arc<Schema>;
    fn bytes(&self) -> &Bytes;
    fn value(&self) -> Option<&(dyn Any + Send + Sync)>;
}

struct Typed<T> {
    value: T,
    bytes: OnceLock<Bytes>,
}

struct Encoded {
    schema: Arc<Schema>,
    bytes: Bytes,
}

impl<T: Payload> Body for Typed<T> {
    fn schema_name(&self) -> &str {
        T::NAME
    }

    #[expect(clippy::expect_used, reason = "the registry is compiled from the same files as the types")]
    fn schema(&self) -> Arc<Schema> {
        Arc::clone(registry().schema(&T::full_name()).expect("a generated type is in the registry"))
    }

    fn bytes(&self) -> &Bytes {
        self.bytes.get_or_init(|| self.value.encode_to_vec().into())
    }

    fn value(&self) -> Option<&(dyn Any + Send + Sync)> {
        Some(&self.value)
    }
}

impl Body for Encoded {
    fn schema_name(&self) -> &str {
        self.schema.name()
    }

    fn schema(&self) -> Arc<Schema> {
        Arc::clone(&self.schema)
    }

    fn bytes(&self) -> &Bytes {
        &self.bytes
    }

    fn value(&self) -> Option<&(dyn Any + Send + Sync)> {
        None
    }
}

impl AnyMessage {
    /// A typed message. Nothing is encoded until someone asks for bytes.
    pub fn new<T: Payload>(value: T) -> Self {
        Self(Arc::new(Typed { value, bytes: OnceLock::new() }))
    }

    /// A message as bytes of a schema.
    pub fn encoded(schema: Arc<Schema>, bytes: Bytes) -> Self {
        Self(Arc::new(Encoded { schema, bytes }))
    }

    /// Decodes bytes into a typed message that keeps those bytes.
    pub fn decode<T: Payload>(bytes: Bytes) -> Result<Self, prost::DecodeError> {
        let value = T::decode(bytes.clone())?;
        Ok(Self(Arc::new(Typed { value, bytes: OnceLock::from(bytes) })))
    }

    /// The typed value; `None` if the message is of another type, or only encoded.
    pub fn get<T: Payload>(&self) -> Option<&T> {
        self.0.value()?.downcast_ref()
    }

    /// The value as `T`, decoded if need be; `None` if it is of another type or does not decode.
    pub fn to<T: Payload>(&self) -> Option<T> {
        if let Some(value) = self.get::<T>() {
            return Some(value.clone());
        }
        let schema = self.0.schema();
        let ours = *schema.message_encoding() == MessageEncoding::Protobuf && schema.name() == T::full_name();
        if ours { T::decode(self.bytes()).ok() } else { None }
    }

    /// The schema of the message.
    pub fn schema(&self) -> Arc<Schema> {
        self.0.schema()
    }

    /// The encoded message; made at the first call and shared from then on.
    pub fn bytes(&self) -> Bytes {
        self.0.bytes().clone()
    }

    /// Whether a typed value is at hand.
    pub fn is_typed(&self) -> bool {
        self.0.value().is_some()
    }

    /// Whether both are the same message in memory.
    pub fn same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl std::fmt::Debug for AnyMessage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "AnyMessage({})", self.0.schema_name())
    }
}
