//! Specifications of parameters, read from the options of their fields.

use crate::value::Value;
use prost_reflect::{FieldDescriptor, Kind, MessageDescriptor, Value as Reflected};

/// Messages nest at most this deep; deeper fields are not parameters.
const DEEPEST: usize = 8;

/// Kind of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParamKind {
    /// On or off.
    Switch,
    /// A whole number.
    Integer,
    /// A number.
    Number,
    /// A text.
    Text,
    /// One of [`ParamSpec::choices`].
    Choice,
    /// A group: the parameters in [`ParamSpec::fields`].
    Group,
    /// A list of any length; each element is as [`ParamSpec::fields`] specify.
    List,
}

/// Specification of one parameter, for windows, stack files and the command line.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamSpec {
    /// Name of the field.
    pub name: String,
    /// Its kind.
    pub kind: ParamKind,
    /// Unit as shown; `1` for a dimensionless number, empty for texts, choices, switches and groups.
    pub unit: String,
    /// Least accepted value; of a list of messages, the least number of elements.
    pub min: Option<f64>,
    /// Greatest accepted value; of a list of messages, the greatest number of elements.
    pub max: Option<f64>,
    /// Default value.
    pub default: Value,
    /// One sentence that says what the parameter does; empty if the options have no help.
    pub help: String,
    /// Kind of the file whose content the text is: `world`, `vehicle`, `course`, `models`. A stack gives the file's
    /// name.
    pub file: Option<String>,
    /// What the parameter is to windows (`rcs.role` of `options.proto`); empty if it is nothing special.
    pub role: String,
    /// Numbers and names of the choices.
    pub choices: Vec<(i32, String)>,
    /// Parameters of a group, or of one element of a list of messages. A list of plain values has one field without a
    /// name, which specifies its elements.
    pub fields: Vec<ParamSpec>,
}

/// The parameters of a message in the order of declaration, those of nested messages within their group. Fields that
/// cannot be parameters (bytes, maps) are left out.
pub fn specs(descriptor: &MessageDescriptor) -> Vec<ParamSpec> {
    specs_at(descriptor, 0)
}

fn specs_at(descriptor: &MessageDescriptor, depth: usize) -> Vec<ParamSpec> {
    fields(descriptor).iter().filter_map(|field| spec_at(field, depth)).collect()
}

/// Fields in the order of declaration, which is the order in which they are shown.
pub(super) fn fields(descriptor: &MessageDescriptor) -> Vec<FieldDescriptor> {
    let declared = descriptor.descriptor_proto().field.iter();
    declared.filter_map(|field| descriptor.get_field_by_name(field.name())).collect()
}

/// The specification of a field; `None` if it cannot be a parameter.
pub(super) fn spec(field: &FieldDescriptor) -> Option<ParamSpec> {
    spec_at(field, 0)
}

fn spec_at(field: &FieldDescriptor, depth: usize) -> Option<ParamSpec> {
    if field.is_map() || depth == DEEPEST {
        return None;
    }
    let plain = match field.kind() {
        Kind::Bool => ParamKind::Switch,
        Kind::Double | Kind::Float => ParamKind::Number,
        Kind::String => ParamKind::Text,
        Kind::Enum(_) => ParamKind::Choice,
        Kind::Bytes => return None,
        Kind::Message(_) => ParamKind::Group,
        _ => ParamKind::Integer,
    };
    let options = field.options();
    let option = |name: &str| {
        let extension = field.parent_pool().get_extension_by_name(&format!("rcs.{name}"))?;
        options.has_extension(&extension).then(|| options.get_extension(&extension).into_owned())
    };
    let number = |name| option(name).as_ref().and_then(Reflected::as_f64);
    let text = |name| option(name).as_ref().and_then(|value| value.as_str().map(str::to_owned));
    let choices: Vec<(i32, String)> = match field.kind() {
        Kind::Enum(choices) => {
            choices.values().map(|choice| (choice.number(), choice.name().to_owned())).collect()
        }
        _ => Vec::new(),
    };
    let fields = match field.kind() {
        Kind::Message(nested) => specs_at(&nested, depth + 1),
        _ => Vec::new(),
    };
    let mut spec = ParamSpec {
        name: field.name().to_owned(),
        kind: plain,
        unit: text("unit").unwrap_or_default(),
        min: number("min"),
        max: number("max"),
        default: Value::Null,
        help: text("help").unwrap_or_default(),
        file: text("file"),
        role: text("role").unwrap_or_default(),
        choices,
        fields,
    };
    let written = text("default_text").unwrap_or_default();
    let default = number("default").unwrap_or(0.0);
    spec.default = match plain {
        ParamKind::Switch => Value::Bool(default != 0.0),
        ParamKind::Number => Value::Float(default),
        ParamKind::Integer => Value::Int(default as i64),
        ParamKind::Text => Value::Text(if field.is_list() { String::new() } else { written.clone() }),
        ParamKind::Choice => {
            let number = default as i32;
            let name = spec.choices.iter().find(|(choice, _)| *choice == number);
            Value::Enum { number, name: name.map(|(_, name)| name.clone()).unwrap_or_default() }
        }
        ParamKind::Group | ParamKind::List => spec.own_defaults(),
    };
    let written = from_json(&written);
    Some(if field.is_list() {
        let items = match &written {
            Some(Value::List(items)) => items.as_slice(),
            _ => &[],
        };
        let element = |item: &Value| {
            let mut element = spec.default.clone();
            overlay(&mut element, item);
            element
        };
        let default = Value::List(items.iter().map(element).collect());
        let fields = if plain == ParamKind::Group {
            std::mem::take(&mut spec.fields)
        } else {
            vec![ParamSpec { name: String::new(), ..spec.clone() }]
        };
        ParamSpec { kind: ParamKind::List, default, fields, ..spec }
    } else {
        if plain == ParamKind::Group
            && let Some(written) = &written
        {
            spec.overlay_fields(written);
        }
        spec
    })
}

/// Overlays a default with the written fields; other fields keep their defaults.
fn overlay(default: &mut Value, written: &Value) {
    match (default, written) {
        (Value::Message(fields), Value::Message(named)) => {
            for (name, value) in named {
                if let Some((_, field)) = fields.iter_mut().find(|(field, _)| field == name) {
                    overlay(field, value);
                }
            }
        }
        (default, written) => *default = written.clone(),
    }
}

/// JSON as a [`Value`]; `None` if the text is not JSON.
pub(super) fn from_json(text: &str) -> Option<Value> {
    fn value(json: serde_json::Value) -> Value {
        match json {
            serde_json::Value::Null => Value::Null,
            serde_json::Value::Bool(on) => Value::Bool(on),
            serde_json::Value::Number(number) => match (number.as_i64(), number.as_u64()) {
                (Some(signed), _) => Value::Int(signed),
                (None, Some(unsigned)) => Value::Uint(unsigned),
                (None, None) => Value::Float(number.as_f64().unwrap_or(f64::NAN)),
            },
            serde_json::Value::String(text) => Value::Text(text),
            serde_json::Value::Array(items) => Value::List(items.into_iter().map(value).collect()),
            serde_json::Value::Object(fields) => {
                Value::Message(fields.into_iter().map(|(name, field)| (name, value(field))).collect())
            }
        }
    }
    serde_json::from_str(text).ok().map(value)
}

impl ParamSpec {
    /// Gives the fields of a group these defaults; fields that are not written keep their own.
    fn overlay_fields(&mut self, written: &Value) {
        for field in &mut self.fields {
            let Some(written) = written.field(&field.name) else { continue };
            if field.kind == ParamKind::Group {
                field.overlay_fields(written);
            } else {
                field.default = field.typed(written);
            }
        }
        self.default = self.own_defaults();
    }

    /// A value from JSON as a value of the parameter's kind.
    fn typed(&self, written: &Value) -> Value {
        let choice = |(number, name): &(i32, String)| match written {
            Value::Text(text) => text == name,
            other => other.as_i64() == Some(i64::from(*number)),
        };
        let typed = match self.kind {
            ParamKind::Number => written.as_f64().map(Value::Float),
            ParamKind::Choice => {
                let chosen = self.choices.iter().find(|known| choice(known));
                chosen.map(|(number, name)| Value::Enum { number: *number, name: name.clone() })
            }
            _ => None,
        };
        typed.unwrap_or_else(|| written.clone())
    }

    /// A message in which each of [`ParamSpec::fields`] has its default.
    fn own_defaults(&self) -> Value {
        Value::Message(self.fields.iter().map(|field| (field.name.clone(), field.default.clone())).collect())
    }

    /// Whether the parameter is a list of plain values.
    pub(super) fn is_plain_list(&self) -> bool {
        self.kind == ParamKind::List && matches!(self.fields.as_slice(), [only] if only.name.is_empty())
    }

    /// The specification of one element of a list.
    pub(super) fn element(&self) -> Self {
        if self.is_plain_list() {
            return Self { name: self.name.clone(), ..self.fields[0].clone() };
        }
        let default = self.own_defaults();
        Self { kind: ParamKind::Group, min: None, max: None, default, ..self.clone() }
    }

    /// The accepted values in words.
    pub fn expected(&self) -> String {
        let names = |fields: &[Self]| {
            let names: Vec<_> = fields.iter().map(|field| field.name.as_str()).collect();
            names.join(", ")
        };
        let number = match self.kind {
            ParamKind::Switch => return "true or false".to_owned(),
            ParamKind::Text => return "a text".to_owned(),
            ParamKind::Choice => {
                let names: Vec<_> = self.choices.iter().map(|(_, name)| name.as_str()).collect();
                return format!("one of {}", names.join(", "));
            }
            ParamKind::Group => return format!("a table of {}", names(&self.fields)),
            ParamKind::List if self.is_plain_list() => {
                return format!("a list, each {}", self.fields[0].expected());
            }
            ParamKind::List => {
                let count = match (self.min, self.max) {
                    (Some(min), Some(max)) => format!("{min} to {max} "),
                    (Some(min), None) => format!("at least {min} "),
                    (None, Some(max)) => format!("at most {max} "),
                    (None, None) => String::new(),
                };
                return format!("a list of {count}tables of {}", names(&self.fields));
            }
            ParamKind::Integer => "a whole number",
            ParamKind::Number => "a number",
        };
        let range = match (self.min, self.max) {
            (Some(min), Some(max)) => format!("{number} from {min} to {max}"),
            (Some(min), None) => format!("{number} of at least {min}"),
            (None, Some(max)) => format!("{number} of at most {max}"),
            (None, None) => number.to_owned(),
        };
        if self.unit.is_empty() || self.unit == "1" { range } else { format!("{range} {}", self.unit) }
    }

    /// Whether a plain value of the field's own type is accepted.
    pub(super) fn accepts(&self, field: &FieldDescriptor, value: &Reflected) -> bool {
        // The range is compared in the precision of the field: 0.1 as f32 is not 0.1 as f64.
        let narrow = |bound: f64| if field.kind() == Kind::Float { f64::from(bound as f32) } else { bound };
        let number = match value {
            Reflected::F64(v) => *v,
            Reflected::F32(v) => f64::from(*v),
            Reflected::I32(v) => f64::from(*v),
            Reflected::U32(v) => f64::from(*v),
            Reflected::I64(v) => *v as f64,
            Reflected::U64(v) => *v as f64,
            Reflected::EnumNumber(v) => return self.choices.iter().any(|(choice, _)| choice == v),
            _ => return true,
        };
        number.is_finite()
            && self.min.is_none_or(|min| number >= narrow(min))
            && self.max.is_none_or(|max| number <= narrow(max))
    }

    /// Whether a list of messages may have this many elements.
    pub(super) fn accepts_count(&self, count: usize) -> bool {
        self.is_plain_list()
            || self.min.is_none_or(|min| count as f64 >= min)
                && self.max.is_none_or(|max| count as f64 <= max)
    }
}
