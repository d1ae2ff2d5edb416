//! Rewrites descriptors of protobuf editions as proto2 and proto3.
//!
//! An edition expresses by features what the older syntaxes express by their name: which fields have presence, whether
//! repeated numbers are packed, whether a message is delimited by tags. The reflection library supports the two older
//! syntaxes only, and their field flags can express the same. A file is rewritten as proto2 if all of its fields have
//! presence, else as proto3 with `proto3_optional` at the fields that have it.
//! Features and their defaults: <https://protobuf.dev/editions/features/>, for 2023 and 2024.

use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto, FieldOptions,
    FileDescriptorSet,
};

/// Values of `google.protobuf.Edition`.
const EDITION_2023: i32 = 1000;
const EDITION_2024: i32 = 1001;

const IMPLICIT: i32 = 2;
const LEGACY_REQUIRED: i32 = 3;
const EXPANDED: i32 = 2;
const DELIMITED: i32 = 2;

/// The parts of a descriptor set that have features.
mod featured {
    #[derive(Clone, Copy, PartialEq, prost::Message)]
    pub(super) struct FeatureSet {
        #[prost(int32, optional, tag = "1")]
        pub(super) field_presence: Option<i32>,
        #[prost(int32, optional, tag = "3")]
        pub(super) repeated_field_encoding: Option<i32>,
        #[prost(int32, optional, tag = "5")]
        pub(super) message_encoding: Option<i32>,
    }

    #[derive(Clone, PartialEq, prost::Message)]
    pub(super) struct Set {
        #[prost(message, repeated, tag = "1")]
        pub(super) file: Vec<File>,
    }

    #[derive(Clone, PartialEq, prost::Message)]
    pub(super) struct File {
        #[prost(message, repeated, tag = "4")]
        pub(super) message_type: Vec<Descriptor>,
        #[prost(message, optional, tag = "8")]
        pub(super) options: Option<FileOptions>,
        #[prost(string, optional, tag = "12")]
        pub(super) syntax: Option<String>,
        #[prost(int32, optional, tag = "14")]
        pub(super) edition: Option<i32>,
    }

    #[derive(Clone, Copy, PartialEq, prost::Message)]
    pub(super) struct FileOptions {
        #[prost(message, optional, tag = "50")]
        pub(super) features: Option<FeatureSet>,
    }

    #[derive(Clone, PartialEq, prost::Message)]
    pub(super) struct Descriptor {
        #[prost(message, repeated, tag = "2")]
        pub(super) field: Vec<Field>,
        #[prost(message, repeated, tag = "3")]
        pub(super) nested_type: Vec<Descriptor>,
        #[prost(message, optional, tag = "7")]
        pub(super) options: Option<MessageOptions>,
        #[prost(message, repeated, tag = "8")]
        pub(super) oneof: Vec<Oneof>,
    }

    #[derive(Clone, Copy, PartialEq, prost::Message)]
    pub(super) struct MessageOptions {
        #[prost(message, optional, tag = "12")]
        pub(super) features: Option<FeatureSet>,
    }

    #[derive(Clone, Copy, PartialEq, prost::Message)]
    pub(super) struct Field {
        #[prost(message, optional, tag = "8")]
        pub(super) options: Option<FieldOptions>,
    }

    #[derive(Clone, Copy, PartialEq, prost::Message)]
    pub(super) struct FieldOptions {
        #[prost(message, optional, tag = "21")]
        pub(super) features: Option<FeatureSet>,
    }

    #[derive(Clone, Copy, PartialEq, prost::Message)]
    pub(super) struct Oneof {
        #[prost(message, optional, tag = "2")]
        pub(super) options: Option<OneofOptions>,
    }

    #[derive(Clone, Copy, PartialEq, prost::Message)]
    pub(super) struct OneofOptions {
        #[prost(message, optional, tag = "1")]
        pub(super) features: Option<FeatureSet>,
    }
}

use featured::FeatureSet;

/// The features in force at one place.
#[derive(Clone, Copy)]
struct Resolved {
    presence: i32,
    repeated: i32,
    message: i32,
}

impl Resolved {
    /// Defaults of editions 2023 and 2024: explicit presence, packed numbers, length-prefixed messages.
    const DEFAULT: Self = Self { presence: 1, repeated: 1, message: 1 };

    fn with(self, own: Option<FeatureSet>) -> Self {
        let Some(own) = own else { return self };
        Self {
            presence: own.field_presence.unwrap_or(self.presence),
            repeated: own.repeated_field_encoding.unwrap_or(self.repeated),
            message: own.message_encoding.unwrap_or(self.message),
        }
    }
}

/// The descriptor set without editions; `None` if it has none and can be used unchanged.
pub(super) fn without_editions(set: &[u8]) -> Result<Option<Vec<u8>>, String> {
    let fail = |error: prost::DecodeError| format!("its descriptor set does not decode: {error}");
    let features = featured::Set::decode(set).map_err(fail)?;
    let is_known = |syntax: Option<&str>| matches!(syntax, None | Some("" | "proto2" | "proto3"));
    if features.file.iter().all(|file| is_known(file.syntax.as_deref())) {
        return Ok(None);
    }
    let mut files = FileDescriptorSet::decode(set).map_err(fail)?;
    for (file, features) in files.file.iter_mut().zip(&features.file) {
        match features.syntax.as_deref() {
            syntax if is_known(syntax) => continue,
            Some("editions") => {}
            syntax => {
                let got = syntax.unwrap_or_default();
                return Err(format!(
                    "its syntax is {got:?}, expected \"proto2\", \"proto3\" or \"editions\""
                ));
            }
        }
        let edition = features.edition.unwrap_or(0);
        if !(EDITION_2023..=EDITION_2024).contains(&edition) {
            return Err(format!("its edition has the number {edition}, expected 1000 (2023) or 1001 (2024)"));
        }
        let of_file = Resolved::DEFAULT.with(features.options.and_then(|options| options.features));
        let mut implicit = false;
        for (message, features) in file.message_type.iter_mut().zip(&features.message_type) {
            settle(message, features, of_file, &mut implicit);
        }
        for message in &mut file.message_type {
            if implicit {
                nested_zero_first(message);
            } else {
                forget_optional(message);
            }
        }
        if implicit {
            file.enum_type.iter_mut().for_each(zero_first);
        }
        file.syntax = Some(if implicit { "proto3" } else { "proto2" }.to_owned());
    }
    Ok(Some(files.encode_to_vec()))
}

/// Sets the flags of a message's fields from their features. Sets `implicit` if a field has no presence.
fn settle(
    message: &mut DescriptorProto,
    features: &featured::Descriptor,
    outer: Resolved,
    implicit: &mut bool,
) {
    let here = outer.with(features.options.and_then(|options| options.features));
    let is_entry = message.options.as_ref().is_some_and(prost_types::MessageOptions::map_entry);
    let maps: Vec<String> = message
        .nested_type
        .iter()
        .filter(|nested| nested.options.as_ref().is_some_and(prost_types::MessageOptions::map_entry))
        .map(|nested| format!(".{}", nested.name()))
        .collect();
    for (field, own) in message.field.iter_mut().zip(&features.field) {
        let in_oneof = field.oneof_index.and_then(|index| features.oneof.get(usize::try_from(index).ok()?));
        let oneof = in_oneof.and_then(|oneof| oneof.options?.features);
        let here = here.with(oneof).with(own.options.and_then(|options| options.features));
        let is_map = maps.iter().any(|map| field.type_name().ends_with(map.as_str()));
        settle_field(field, here, is_map || is_entry, implicit);
    }
    for (nested, features) in message.nested_type.iter_mut().zip(&features.nested_type) {
        settle(nested, features, here, implicit);
    }
}

fn settle_field(field: &mut FieldDescriptorProto, features: Resolved, of_map: bool, implicit: &mut bool) {
    let is_message = matches!(field.r#type(), Type::Message | Type::Group);
    if field.r#type() == Type::Message && features.message == DELIMITED && !of_map {
        field.set_type(Type::Group);
    }
    if field.label() == Label::Repeated {
        let packable = !is_message && !matches!(field.r#type(), Type::String | Type::Bytes);
        if packable {
            let options = field.options.get_or_insert_with(FieldOptions::default);
            options.packed = Some(features.repeated != EXPANDED);
        }
        return;
    }
    if features.presence == LEGACY_REQUIRED {
        field.set_label(Label::Required);
        return;
    }
    if is_message || field.oneof_index.is_some() || of_map {
        return;
    }
    if features.presence == IMPLICIT {
        *implicit = true;
    } else {
        field.proto3_optional = Some(true);
    }
}

/// In proto3 the first value of an enumeration is 0; a closed enumeration of an edition may begin with another one, or
/// have no value 0. Fields of such a type have presence, so the first value is never used as a default.
fn zero_first(choices: &mut EnumDescriptorProto) {
    if let Some(at) = choices.value.iter().position(|value| value.number() == 0) {
        choices.value[..=at].rotate_right(1);
    } else {
        let name = format!("{}__0", choices.name());
        let zero = EnumValueDescriptorProto { name: Some(name), number: Some(0), options: None };
        choices.value.insert(0, zero);
    }
}

fn nested_zero_first(message: &mut DescriptorProto) {
    message.enum_type.iter_mut().for_each(zero_first);
    message.nested_type.iter_mut().for_each(nested_zero_first);
}

/// In proto2 every field has presence, so `proto3_optional` is removed.
fn forget_optional(message: &mut DescriptorProto) {
    for field in &mut message.field {
        field.proto3_optional = None;
    }
    for nested in &mut message.nested_type {
        forget_optional(nested);
    }
}
