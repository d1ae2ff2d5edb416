//! Random encoded messages of a descriptor: fields in any order, repeated scalars, split submessages, packed and
//! unpacked lists, unknown fields and groups.

use prost::encoding::{WireType, encode_key, encode_varint};
use prost_reflect::{FieldDescriptor, Kind, MessageDescriptor};
use rcs_msg::{FieldPath, MessageEncoding, Schema};
use std::sync::Arc;

/// Random choices taken from bytes, so that failures shrink.
pub(crate) struct Entropy<'a>(pub(crate) &'a [u8]);

impl Entropy<'_> {
    pub(crate) fn byte(&mut self) -> u8 {
        let (first, rest) = self.0.split_first().unwrap_or((&0, &[]));
        self.0 = rest;
        *first
    }

    pub(crate) fn below(&mut self, end: usize) -> usize {
        usize::from(self.byte()) % end.max(1)
    }

    fn number(&mut self) -> u64 {
        let mut bytes = [0; 8];
        for byte in bytes.iter_mut().take(self.0.first().map_or(0, |b| usize::from(*b) % 9)) {
            *byte = self.byte();
        }
        u64::from_le_bytes(bytes)
    }
}

/// Appends a random message.
pub(crate) fn message(
    descriptor: &MessageDescriptor,
    depth: usize,
    entropy: &mut Entropy<'_>,
    out: &mut Vec<u8>,
) {
    let fields: Vec<FieldDescriptor> = descriptor.fields().filter(|field| !field.is_map()).collect();
    for _ in 0..entropy.below(8) {
        match fields.get(entropy.below(fields.len() + 1)) {
            Some(field) => write_field(field, depth, entropy, out),
            None => unknown(entropy, out),
        }
    }
}

fn write_field(field: &FieldDescriptor, depth: usize, entropy: &mut Entropy<'_>, out: &mut Vec<u8>) {
    let number = field.number();
    match field.kind() {
        Kind::Message(inner) => {
            let mut body = Vec::new();
            if depth > 0 {
                message(&inner, depth - 1, entropy, &mut body);
            }
            if field.is_group() {
                encode_key(number, WireType::StartGroup, out);
                out.extend(body);
                encode_key(number, WireType::EndGroup, out);
            } else {
                delimited(number, &body, out);
            }
        }
        Kind::String => delimited(number, &b"text text text"[..entropy.below(10)], out),
        Kind::Bytes => {
            let bytes: Vec<u8> = (0..entropy.below(6)).map(|_| entropy.byte()).collect();
            delimited(number, &bytes, out);
        }
        kind if field.is_list() && entropy.byte().is_multiple_of(2) => {
            let mut packed = Vec::new();
            for _ in 0..entropy.below(5) {
                scalar(&kind, entropy, &mut packed);
            }
            delimited(number, &packed, out);
        }
        kind => {
            let wire = match kind {
                Kind::Fixed32 | Kind::Sfixed32 | Kind::Float => WireType::ThirtyTwoBit,
                Kind::Fixed64 | Kind::Sfixed64 | Kind::Double => WireType::SixtyFourBit,
                _ => WireType::Varint,
            };
            encode_key(number, wire, out);
            scalar(&kind, entropy, out);
        }
    }
}

fn delimited(number: u32, body: &[u8], out: &mut Vec<u8>) {
    encode_key(number, WireType::LengthDelimited, out);
    encode_varint(body.len() as u64, out);
    out.extend_from_slice(body);
}

fn scalar(kind: &Kind, entropy: &mut Entropy<'_>, out: &mut Vec<u8>) {
    let number = entropy.number();
    match kind {
        Kind::Fixed32 | Kind::Sfixed32 | Kind::Float => out.extend((number as u32).to_le_bytes()),
        Kind::Fixed64 | Kind::Sfixed64 | Kind::Double => out.extend(number.to_le_bytes()),
        Kind::Bool => encode_varint(number % 2, out),
        // Encoders write negative 32-bit integers sign-extended to 64 bits.
        Kind::Int32 | Kind::Enum(_) => encode_varint(i64::from(number as i32) as u64, out),
        Kind::Uint32 | Kind::Sint32 => encode_varint(u64::from(number as u32), out),
        _ => encode_varint(number, out),
    }
}

/// A field or group that no descriptor has.
fn unknown(entropy: &mut Entropy<'_>, out: &mut Vec<u8>) {
    const NUMBER: u32 = 1000;
    match entropy.below(5) {
        0 => {
            encode_key(NUMBER, WireType::Varint, out);
            encode_varint(entropy.number(), out);
        }
        1 => delimited(NUMBER, &[1, 2, 3], out),
        2 => {
            encode_key(NUMBER, WireType::SixtyFourBit, out);
            out.extend([7; 8]);
        }
        3 => {
            encode_key(NUMBER, WireType::ThirtyTwoBit, out);
            out.extend([7; 4]);
        }
        _ => {
            encode_key(NUMBER, WireType::StartGroup, out);
            delimited(1, &[8, 1], out);
            encode_key(2, WireType::StartGroup, out);
            encode_key(2, WireType::EndGroup, out);
            encode_key(NUMBER, WireType::EndGroup, out);
        }
    }
}

/// A random path that the descriptor allows, to a number or a length.
pub(crate) fn path(descriptor: &MessageDescriptor, entropy: &mut Entropy<'_>) -> FieldPath {
    let mut descriptor = descriptor.clone();
    let mut path = FieldPath::root();
    loop {
        let fields: Vec<FieldDescriptor> = descriptor.fields().filter(|field| !field.is_map()).collect();
        let Some(field) = fields.get(entropy.below(fields.len())) else { return path };
        path = path.field(field.name());
        if field.is_list() {
            if entropy.below(4) == 0 {
                return path.length();
            }
            path = path.index(entropy.below(4));
        }
        match field.kind() {
            // Some messages contain themselves.
            Kind::Message(_) if path.segments().len() > 20 => return path,
            Kind::Message(inner) => descriptor = inner,
            Kind::Bytes if entropy.below(2) == 0 => return path.index(entropy.below(4)),
            Kind::Bytes | Kind::String => return path.length(),
            _ => return path,
        }
    }
}

/// Groups, oneofs, proto2 defaults and every width of integer, which Foxglove's messages do not use.
pub(crate) fn odd_schemas() -> Vec<Arc<Schema>> {
    const PROTO2: &str = r#"syntax = "proto2"; package odd;
        message Old {
          optional int32 a = 1 [default = -7]; required double b = 2; repeated sint64 c = 3;
          optional group Inner = 4 { optional sint32 d = 1; repeated group Deep = 2 { optional float e = 1; } }
          optional bytes f = 5 [default = "abc"]; optional string g = 6 [default = "ab"];
          enum Level { LOW = 3; HIGH = 9; }
          optional Level level = 7; repeated fixed64 h = 8 [packed = true]; repeated bool i = 9; optional Old old = 10;
        }"#;
    const PROTO3: &str = r#"syntax = "proto3"; package odd;
        message New {
          oneof one { New left = 1; Leaf right = 2; int64 number = 3; string text = 4; }
          optional uint32 maybe = 5; repeated uint64 many = 6; repeated Leaf leaves = 7; Leaf leaf = 8;
          sfixed32 x = 9; sfixed64 y = 10; repeated string texts = 11; repeated bytes blobs = 12;
          map<string, Leaf> map = 13; map<int32, double> numbers = 14;
        }
        message Leaf { double v = 1; repeated float w = 2; uint32 u = 3; Leaf more = 4; }"#;
    let dir = tempfile::tempdir().expect("a folder can be made");
    std::fs::write(dir.path().join("old.proto"), PROTO2).expect("it can be written");
    std::fs::write(dir.path().join("new.proto"), PROTO3).expect("it can be written");
    let mut compiler = protox::Compiler::new([dir.path()]).expect("the folder is there");
    compiler.open_files(["old.proto", "new.proto"]).expect("both compile");
    let set: bytes::Bytes = compiler.encode_file_descriptor_set().into();
    ["odd.Old", "odd.New"]
        .map(|name| Arc::new(Schema::new(name, MessageEncoding::Protobuf, "protobuf", set.clone())))
        .to_vec()
}
