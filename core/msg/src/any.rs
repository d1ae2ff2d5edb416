//! Messages whose type is known at run time.

use crate::definition::MessageEncoding;
use crate::reader::DecodeError;
use crate::schema::Schema;
use crate::value::Value;
use bytes::Bytes;
use std::any::{Any, TypeId};
use std::sync::{Arc, OnceLock};

/// A message type that a buffer can carry as a Rust value. `rcs-msg-build` implements it for the types that it
/// generates.
pub trait Payload: prost::Message + prost::Name + Default + Clone + PartialEq + 'static {
    /// Its schema. The first call adds it to the registry.
    fn schema() -> &'static Arc<Schema>;
}

/// A value that becomes a message of type `T` when someone looks at it: see [`AnyMessage::deferred`].
pub trait DeferredSource<T: Payload>: Send + Sync + 'static {
    /// The message.
    fn to_message(&self) -> T;

    /// The encoded message: for a source that can give it without making the message first.
    fn encode(&self) -> Vec<u8> {
        self.to_message().encode_to_vec()
    }

    /// About how many bytes of memory the source takes, without what it shares with the source before it.
    fn size_hint(&self) -> usize {
        size_of_val(self)
    }
}

/// One message: typed or encoded, shared without a copy, encoded at most once.
#[derive(Clone)]
pub struct AnyMessage(Arc<dyn Body>);

trait Body: Send + Sync {
    fn is_a(&self, schema: &Schema) -> bool;
    fn schema(&self) -> Arc<Schema>;
    fn bytes(&self) -> &Bytes;
    /// The encoded message; the result is not cached.
    fn encode(&self) -> Bytes;
    fn size_hint(&self) -> usize;
    fn encoded_len(&self) -> Option<usize>;
    fn value(&self) -> Option<&(dyn Any + Send + Sync)>;
    /// Type of the value. Does not convert a deferred value.
    fn value_type(&self) -> Option<TypeId>;
    fn source(&self) -> Option<&(dyn Any + Send + Sync)>;
}

struct Typed<T> {
    value: T,
    bytes: OnceLock<Bytes>,
}

/// A value that is converted to a message at the first access.
struct Deferred<S, T> {
    source: S,
    /// Boxed, so that a message that is never accessed stays small.
    value: OnceLock<Box<T>>,
    bytes: OnceLock<Bytes>,
}

struct Encoded {
    schema: Arc<Schema>,
    bytes: Bytes,
}

/// The schema of a generated type.
pub fn schema_of<T: Payload>() -> &'static Arc<Schema> {
    T::schema()
}

/// Whether `schema` is that of `T`, mostly the one in the registry itself. It does not allocate, because every write
/// calls it.
fn is_schema_of<T: Payload>(schema: &Schema) -> bool {
    std::ptr::eq(schema, &raw const **schema_of::<T>()) || is_named_as::<T>(schema)
}

fn is_named_as<T: Payload>(schema: &Schema) -> bool {
    *schema.message_encoding() == MessageEncoding::Protobuf
        && schema.name().strip_prefix(T::PACKAGE).and_then(|rest| rest.strip_prefix('.')) == Some(T::NAME)
}

impl<T: Payload> Body for Typed<T> {
    fn is_a(&self, schema: &Schema) -> bool {
        is_schema_of::<T>(schema)
    }

    fn schema(&self) -> Arc<Schema> {
        Arc::clone(schema_of::<T>())
    }

    fn bytes(&self) -> &Bytes {
        self.bytes.get_or_init(|| self.value.encode_to_vec().into())
    }

    fn encode(&self) -> Bytes {
        self.bytes.get().cloned().unwrap_or_else(|| self.value.encode_to_vec().into())
    }

    fn size_hint(&self) -> usize {
        size_of::<T>() + self.value.encoded_len() + self.bytes.get().map_or(0, Bytes::len)
    }

    fn encoded_len(&self) -> Option<usize> {
        self.bytes.get().map(Bytes::len)
    }

    fn value(&self) -> Option<&(dyn Any + Send + Sync)> {
        Some(&self.value)
    }

    fn value_type(&self) -> Option<TypeId> {
        Some(TypeId::of::<T>())
    }

    fn source(&self) -> Option<&(dyn Any + Send + Sync)> {
        None
    }
}

impl<S, T> Body for Deferred<S, T>
where
    S: DeferredSource<T>,
    T: Payload,
{
    fn is_a(&self, schema: &Schema) -> bool {
        is_schema_of::<T>(schema)
    }

    fn schema(&self) -> Arc<Schema> {
        Arc::clone(schema_of::<T>())
    }

    fn bytes(&self) -> &Bytes {
        self.bytes.get_or_init(|| self.source.encode().into())
    }

    fn encode(&self) -> Bytes {
        self.bytes.get().cloned().unwrap_or_else(|| self.source.encode().into())
    }

    fn size_hint(&self) -> usize {
        let value = self.value.get().map_or(0, |value| size_of::<T>() + value.encoded_len());
        self.source.size_hint() + value + self.bytes.get().map_or(0, Bytes::len)
    }

    fn encoded_len(&self) -> Option<usize> {
        self.bytes.get().map(Bytes::len)
    }

    fn value(&self) -> Option<&(dyn Any + Send + Sync)> {
        Some(&**self.value.get_or_init(|| Box::new(self.source.to_message())))
    }

    fn value_type(&self) -> Option<TypeId> {
        Some(TypeId::of::<T>())
    }

    fn source(&self) -> Option<&(dyn Any + Send + Sync)> {
        Some(&self.source)
    }
}

impl Body for Encoded {
    fn is_a(&self, schema: &Schema) -> bool {
        self.schema.name() == schema.name() && self.schema.message_encoding() == schema.message_encoding()
    }

    fn schema(&self) -> Arc<Schema> {
        Arc::clone(&self.schema)
    }

    fn bytes(&self) -> &Bytes {
        &self.bytes
    }

    fn encode(&self) -> Bytes {
        self.bytes.clone()
    }

    fn size_hint(&self) -> usize {
        self.bytes.len()
    }

    fn encoded_len(&self) -> Option<usize> {
        Some(self.bytes.len())
    }

    fn value(&self) -> Option<&(dyn Any + Send + Sync)> {
        None
    }

    fn value_type(&self) -> Option<TypeId> {
        None
    }

    fn source(&self) -> Option<&(dyn Any + Send + Sync)> {
        None
    }
}

impl AnyMessage {
    /// A typed message. It is encoded when [`AnyMessage::bytes`] is first called.
    pub fn new<T: Payload>(value: T) -> Self {
        Self(Arc::new(Typed { value, bytes: OnceLock::new() }))
    }

    /// A message that is converted from `source` at the first access: for messages that are written every cycle and
    /// seldom read. Readers that know `S` use it without a conversion: [`AnyMessage::source`].
    pub fn deferred<S, T>(source: S) -> Self
    where
        S: DeferredSource<T>,
        T: Payload,
    {
        Self(Arc::new(Deferred::<S, T> { source, value: OnceLock::new(), bytes: OnceLock::new() }))
    }

    /// A message as encoded bytes of a schema.
    pub fn encoded(schema: Arc<Schema>, bytes: Bytes) -> Self {
        Self(Arc::new(Encoded { schema, bytes }))
    }

    /// Decodes bytes into a typed message that keeps these bytes.
    pub fn decode<T: Payload>(bytes: Bytes) -> Result<Self, prost::DecodeError> {
        let value = T::decode(bytes.clone())?;
        Ok(Self(Arc::new(Typed { value, bytes: OnceLock::from(bytes) })))
    }

    /// The typed value; `None` if the message has another type, or exists in encoded form only.
    pub fn get<T: Payload>(&self) -> Option<&T> {
        // The type is checked first, so that a deferred message is not converted for a reader of another type.
        if self.holds::<T>() { self.0.value()?.downcast_ref() } else { None }
    }

    /// The source of a deferred message, if it is an `S` ([`AnyMessage::deferred`]). Nothing is converted.
    pub fn source<S: 'static>(&self) -> Option<&S> {
        self.0.source()?.downcast_ref()
    }

    /// The value as `T`, decoded if necessary; `None` if the message has another type or does not decode.
    pub fn to<T: Payload>(&self) -> Option<T> {
        if let Some(value) = self.get::<T>() {
            return Some(value.clone());
        }
        let schema = self.0.schema();
        let ours = *schema.message_encoding() == MessageEncoding::Protobuf && schema.name() == T::full_name();
        if ours { T::decode(self.bytes()).ok() } else { None }
    }

    /// Whether the message has this schema.
    pub fn is_a(&self, schema: &Schema) -> bool {
        self.0.is_a(schema)
    }

    /// The schema of the message.
    pub fn schema(&self) -> Arc<Schema> {
        self.0.schema()
    }

    /// The encoded message; encoded at the first call and cached.
    pub fn bytes(&self) -> Bytes {
        self.0.bytes().clone()
    }

    /// The encoded message like [`AnyMessage::bytes`], but not cached: for messages that are written to disk once, so
    /// that the encoded form does not stay in memory.
    pub fn encode(&self) -> Bytes {
        self.0.encode()
    }

    /// Approximate memory of the message in bytes, without encoding it. For a deferred message it is what its source
    /// says ([`DeferredSource::size_hint`]).
    pub fn size_hint(&self) -> usize {
        // The reference counter, the pointers to the shared cells, and the overhead of an allocation.
        64 + self.0.size_hint()
    }

    /// A number that no other message has while this one exists.
    pub fn address(&self) -> usize {
        Arc::as_ptr(&self.0).cast::<()>() as usize
    }

    /// Size of the encoded message if it has been encoded already. Does not encode.
    pub fn encoded_len(&self) -> Option<usize> {
        self.0.encoded_len()
    }

    /// Whether a typed value exists, or can be made without decoding.
    pub fn is_typed(&self) -> bool {
        self.0.value_type().is_some()
    }

    /// Whether [`AnyMessage::get`] returns a `T`. Does not convert a deferred message.
    pub fn holds<T: Payload>(&self) -> bool {
        self.0.value_type() == Some(TypeId::of::<T>())
    }

    /// The message as a tree.
    pub fn value(&self) -> Result<Value, DecodeError> {
        self.schema().value(&self.bytes())
    }

    /// Whether both refer to the same message in memory.
    pub fn same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl std::fmt::Debug for AnyMessage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "AnyMessage({})", self.0.schema().name())
    }
}
