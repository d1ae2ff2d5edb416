//! ROS message definitions (`.msg` with its dependencies appended, as logs carry them), resolved into a layout.
//!
//! ROS 1 has built-in types `time` and `duration`, which are read as messages of `secs` and `nsecs`, and its header begins
//! with a number `seq`.
//!
//! We do not use `re_ros_msg`: it panics on a single quote as a default value, reads messages into maps that lose the
//! order of fields, and reserves memory by lengths that it has not checked. A test compares the two readers on every
//! recorded message.

use crate::packed::Number;
use std::collections::{BTreeSet, HashMap};
use std::fmt::Write;

/// A deeper nesting is refused; the deepest common message has 6 levels.
const MAX_DEPTH: usize = 32;
const MAX_FIXED_LENGTH: usize = 1 << 24;
/// A definition of ROS 1 with more fields that take no bytes is refused.
const MAX_EMPTY_FIELDS: usize = 100;

/// Name that ROS 2 gives the one byte of a message without fields.
const NO_FIELDS: &str = "structure_needs_at_least_one_member";

/// How the values of a message follow each other: see `ros.rs`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wire {
    /// ROS 2.
    Cdr,
    Ros1,
}

/// Fields of all messages in a definition; the first is the message itself.
#[derive(Debug, PartialEq)]
pub(crate) struct Layout {
    messages: Vec<Vec<Field>>,
    signature: String,
    wire: Wire,
}

/// One field, in wire order.
#[derive(Debug, PartialEq)]
pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) element: Element,
    pub(crate) count: Count,
}

/// Type of a field, or of one element of an array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Element {
    Number(Number),
    Text,
    WideText,
    /// Index of a message in the layout.
    Message(usize),
}

/// Number of elements of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Count {
    One,
    /// An array of this length, which is not on the wire.
    Fixed(usize),
    /// A sequence: its length is on the wire.
    Sequence,
}

/// Why a definition is refused.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("definition of {message}: got {got:?}, expected {expected}")]
pub(crate) struct LayoutError {
    message: String,
    got: String,
    expected: &'static str,
}

/// A field whose type has not been resolved yet.
struct Parsed<'a> {
    name: &'a str,
    ty: &'a str,
    count: Count,
}

impl Layout {
    /// Parses a definition with its dependencies.
    pub(crate) fn parse(name: &str, text: &str, wire: Wire) -> Result<Self, LayoutError> {
        let mut sections = sections(name, text);
        if wire == Wire::Ros1 {
            sections.extend(ROS1_TIMES.map(|(name, lines)| (name.to_owned(), lines.to_vec())));
        }
        let mut parsed = Vec::new();
        let mut index = HashMap::new();
        for (at, (name, lines)) in sections.iter().enumerate() {
            parsed.push(fields(name, lines, wire)?);
            index.entry(short(name)).or_insert(at);
        }
        let mut messages = Vec::new();
        for ((name, _), fields) in sections.iter().zip(&parsed) {
            let package = name.split_once('/').map_or("", |(package, _)| package);
            let resolve = |ty: &str| {
                primitive(ty, wire).or_else(|| {
                    let is_time = wire == Wire::Ros1 && ROS1_TIMES.iter().any(|(name, _)| *name == ty);
                    let is_full = ty.contains('/') || is_time;
                    let full = if is_full { short(ty) } else { format!("{package}/{ty}") };
                    // Old definitions write `Header` for the one in std_msgs.
                    let full = if full.ends_with("/Header") && !index.contains_key(&full) {
                        "std_msgs/Header".to_owned()
                    } else {
                        full
                    };
                    index.get(&full).copied().map(Element::Message)
                })
            };
            let fields: Result<Vec<Field>, LayoutError> = fields
                .iter()
                .map(|field| {
                    let element = resolve(field.ty).ok_or_else(|| LayoutError {
                        message: name.clone(),
                        got: field.ty.to_owned(),
                        expected: "a type that the definition holds",
                    })?;
                    Ok(Field { name: field.name.to_owned(), element, count: field.count })
                })
                .collect();
            let fields = fields?;
            let mut names = BTreeSet::new();
            if let Some(again) = fields.iter().find(|field| !names.insert(field.name.as_str())) {
                return Err(LayoutError {
                    message: name.clone(),
                    got: again.name.clone(),
                    expected: "a name that no other field has",
                });
            }
            messages.push(fields);
        }
        let mut layout = Self { messages, signature: String::new(), wire };
        let mut depths = vec![None; layout.messages.len()];
        if layout.depth(0, MAX_DEPTH, &mut depths).is_none() {
            return Err(LayoutError {
                message: name.to_owned(),
                got: "a message within itself".to_owned(),
                expected: "at most 32 levels",
            });
        }
        if wire == Wire::Ros1 {
            let reached = (0..depths.len()).filter(|&message| depths[message].is_some()).collect();
            layout.without_empty_messages(reached).map_err(|(got, expected)| LayoutError {
                message: name.to_owned(),
                got,
                expected,
            })?;
        }
        let mut signature = String::new();
        layout.sign(layout.root(), &mut signature);
        layout.signature = signature;
        Ok(layout)
    }

    /// How messages of this layout are read.
    pub(crate) fn wire(&self) -> Wire {
        self.wire
    }

    /// Fields of the message itself.
    pub(crate) fn root(&self) -> &[Field] {
        &self.messages[0]
    }

    /// Whether the message itself is one of ROS 2 without fields.
    pub(crate) fn is_empty_cdr(&self) -> bool {
        matches!(self.root(), [only] if only.is_one(NO_FIELDS, Element::Number(Number::U8)))
    }

    /// Fields of a message of the layout.
    pub(crate) fn message(&self, index: usize) -> &[Field] {
        &self.messages[index]
    }

    /// The types on the wire in order, one letter each; `iIs` is a header, also one of ROS 1, and `iI` a time. A converter
    /// that knows a message by its name compares it to see whether the log has the same definition. Truncated at 400
    /// characters, more than any known message has.
    pub(crate) fn signature(&self) -> &str {
        &self.signature
    }

    fn sign(&self, fields: &[Field], out: &mut String) {
        if let Some(known) = self.ros1_signature(fields) {
            return out.push_str(known);
        }
        for field in fields {
            if out.len() > 400 {
                return;
            }
            match field.count {
                Count::One => {}
                Count::Fixed(length) => write!(out, "[{length}]").unwrap_or_default(),
                Count::Sequence => out.push_str("[]"),
            }
            match field.element {
                Element::Number(number) => out.push(match number {
                    Number::Bool => 'b',
                    Number::U8 => 'B',
                    Number::I8 => 'c',
                    Number::U16 => 'H',
                    Number::I16 => 'h',
                    Number::U32 => 'I',
                    Number::I32 => 'i',
                    Number::U64 => 'Q',
                    Number::I64 => 'q',
                    Number::F32 => 'f',
                    Number::F64 => 'd',
                }),
                Element::Text => out.push('s'),
                Element::WideText => out.push('w'),
                Element::Message(index) if field.count == Count::One => self.sign(self.message(index), out),
                Element::Message(index) => {
                    out.push('(');
                    self.sign(self.message(index), out);
                    out.push(')');
                }
            }
        }
    }

    /// The signature of a header or a time of ROS 1, which is that of ROS 2; `None` for other fields, and in ROS 2.
    fn ros1_signature(&self, fields: &[Field]) -> Option<&'static str> {
        if self.wire == Wire::Cdr {
            return None;
        }
        let (unsigned, signed) = (Element::Number(Number::U32), Element::Number(Number::I32));
        let is_time = |fields: &[Field], number: Element| match fields {
            [secs, nsecs] => secs.is_one("secs", number) && nsecs.is_one("nsecs", number),
            _ => false,
        };
        if is_time(fields, unsigned) || is_time(fields, signed) {
            return Some("iI");
        }
        let [seq, stamp, frame_id] = fields else { return None };
        let Element::Message(time) = stamp.element else { return None };
        let is_header = seq.is_one("seq", unsigned)
            && stamp.is_one("stamp", stamp.element)
            && is_time(self.message(time), unsigned)
            && frame_id.is_one("frame_id", Element::Text);
        is_header.then_some("iIs")
    }

    /// Removes the fields of messages that take no bytes, so that nothing is read within them. Such messages exist in
    /// ROS 1 alone. An array of them, which could be of any length, is refused, and so are too many fields of them: the
    /// steps of skipping a message stay in proportion to its bytes. `reached` are the messages that the root holds. An
    /// error is what was found, and what is expected.
    fn without_empty_messages(&mut self, reached: Vec<usize>) -> Result<(), (String, &'static str)> {
        let mut known = vec![None; self.messages.len()];
        for &message in &reached {
            if self.is_empty(message, &mut known) {
                self.messages[message].clear();
            }
        }
        let takes_no_bytes = |field: &&Field| match field.element {
            Element::Message(inner) => self.messages[inner].is_empty(),
            _ => false,
        };
        let fields = reached.into_iter().flat_map(|message| &self.messages[message]);
        let empty: Vec<&Field> = fields.filter(takes_no_bytes).collect();
        if let Some(array) = empty.iter().find(|field| field.count != Count::One) {
            return Err((array.name.clone(), "elements that take at least one byte"));
        }
        if empty.len() > MAX_EMPTY_FIELDS {
            return Err((format!("{} fields that take no bytes", empty.len()), "at most 100"));
        }
        Ok(())
    }

    /// Whether a message takes no bytes.
    fn is_empty(&self, message: usize, known: &mut [Option<bool>]) -> bool {
        if let Some(is_empty) = known[message] {
            return is_empty;
        }
        let is_empty = self.message(message).iter().all(|field| match field.element {
            Element::Message(inner) => field.count != Count::Sequence && self.is_empty(inner, known),
            _ => false,
        });
        known[message] = Some(is_empty);
        is_empty
    }

    /// Number of nesting levels of a message; `None` if more than `left`, as in one that contains itself.
    fn depth(&self, message: usize, left: usize, known: &mut [Option<usize>]) -> Option<usize> {
        if let Some(depth) = known[message] {
            return (depth <= left).then_some(depth);
        }
        let left = left.checked_sub(1)?;
        let mut depth = 1;
        for field in self.message(message) {
            if let Element::Message(inner) = field.element {
                depth = depth.max(1 + self.depth(inner, left, known)?);
            }
        }
        known[message] = Some(depth);
        Some(depth)
    }
}

impl Field {
    /// Whether it is a single element of this name and type.
    fn is_one(&self, name: &str, element: Element) -> bool {
        self.name == name && self.element == element && self.count == Count::One
    }
}

/// `time` and `duration` of ROS 1.
const ROS1_TIMES: [(&str, [&str; 2]); 2] =
    [("time", ["uint32 secs", "uint32 nsecs"]), ("duration", ["int32 secs", "int32 nsecs"])];

/// `pkg/msg/Type` and `pkg/Type` as `pkg/Type`.
fn short(name: &str) -> String {
    match (name.split_once('/'), name.rsplit_once('/')) {
        (Some((package, _)), Some((_, ty))) => format!("{package}/{ty}"),
        _ => name.to_owned(),
    }
}

/// Names and lines of the message and of its dependencies.
fn sections<'a>(name: &str, text: &'a str) -> Vec<(String, Vec<&'a str>)> {
    let mut sections = vec![(name.to_owned(), Vec::new())];
    let mut skipping = false;
    for line in text.lines().map(str::trim) {
        if line.len() >= 3 && line.bytes().all(|b| b == b'=') {
            skipping = true;
        } else if let Some(name) = line.strip_prefix("MSG: ") {
            sections.push((name.trim().to_owned(), Vec::new()));
            skipping = false;
        } else if let Some((_, lines)) = sections.last_mut().filter(|_| !skipping) {
            lines.push(line);
        }
    }
    service_event(&mut sections);
    sections
}

/// The definition of a service event is that of the service, request and response separated by `---`. The event on the
/// wire is information about the call, with an optional request and an optional response.
fn service_event(sections: &mut Vec<(String, Vec<&str>)>) {
    const EVENT: [&str; 3] =
        ["service_msgs/ServiceEventInfo info", "Request[<=1] request", "Response[<=1] response"];
    const INFO: [&str; 4] =
        ["uint8 event_type", "builtin_interfaces/Time stamp", "char[16] client_gid", "int64 sequence_number"];
    let (name, lines) = &mut sections[0];
    let package = name.split_once('/').map_or("", |(package, _)| package);
    let Some(divider) = lines.iter().position(|line| *line == "---").filter(|_| name.ends_with("_Event"))
    else {
        return;
    };
    let parts = [
        (format!("{package}/Request"), lines[..divider].to_vec()),
        (format!("{package}/Response"), lines[divider + 1..].to_vec()),
        ("service_msgs/ServiceEventInfo".to_owned(), INFO.to_vec()),
        ("builtin_interfaces/Time".to_owned(), vec!["int32 sec", "uint32 nanosec"]),
    ];
    *lines = EVENT.to_vec();
    sections.extend(parts);
}

fn fields<'a>(message: &str, lines: &[&'a str], wire: Wire) -> Result<Vec<Parsed<'a>>, LayoutError> {
    let mut fields = Vec::new();
    for line in lines {
        // A `#` in a text default truncates it, which does no harm, because defaults are not read.
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let fail = |expected| LayoutError { message: message.to_owned(), got: line.to_owned(), expected };
        let (ty, rest) = line.split_once(char::is_whitespace).ok_or_else(|| fail("a type and a name"))?;
        let rest = rest.trim_start();
        let end = rest.find(|c: char| c.is_whitespace() || c == '=').unwrap_or(rest.len());
        let (name, rest) = rest.split_at(end);
        if name.is_empty() {
            return Err(fail("a type and a name"));
        }
        if rest.trim_start().starts_with('=') {
            // Constants are not on the wire.
            continue;
        }
        let (ty, count) = match ty.split_once('[') {
            None => (ty, Count::One),
            Some((ty, "]")) => (ty, Count::Sequence),
            Some((ty, bound)) if bound.starts_with("<=") => (ty, Count::Sequence),
            Some((ty, length)) => {
                let length = length.strip_suffix(']').and_then(|length| length.parse().ok());
                let length = length.filter(|length| (1..=MAX_FIXED_LENGTH).contains(length));
                (ty, Count::Fixed(length.ok_or_else(|| fail("a length from 1 to 16,777,216"))?))
            }
        };
        fields.push(Parsed { name, ty, count });
    }
    if fields.is_empty() && wire == Wire::Cdr {
        // An empty message takes one byte on the wire of ROS 2. So everything that is read takes at least one byte.
        fields.push(Parsed { name: NO_FIELDS, ty: "uint8", count: Count::One });
    }
    Ok(fields)
}

fn primitive(ty: &str, wire: Wire) -> Option<Element> {
    let base = ty.split_once("<=").map_or(ty, |(base, _)| base);
    Some(match base {
        "bool" => Element::Number(Number::Bool),
        "byte" if wire == Wire::Ros1 => Element::Number(Number::I8),
        "byte" | "char" | "uint8" => Element::Number(Number::U8),
        "int8" => Element::Number(Number::I8),
        "int16" => Element::Number(Number::I16),
        "uint16" => Element::Number(Number::U16),
        "int32" => Element::Number(Number::I32),
        "uint32" => Element::Number(Number::U32),
        "int64" => Element::Number(Number::I64),
        "uint64" => Element::Number(Number::U64),
        "float32" => Element::Number(Number::F32),
        "float64" => Element::Number(Number::F64),
        "string" => Element::Text,
        "wstring" => Element::WideText,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "\n===\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n===\n\
        MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

    #[test]
    fn a_definition_becomes_the_order_of_the_wire() {
        let text = format!(
            "# a comment\nint8 SIDE=1\nstd_msgs/Header header\nfloat64[9] k\nuint8[<=4] few\nstring<=10 name \"#x\"\nwstring w\n\
             Part[] parts{HEADER}===\nMSG: my_msgs/Part\nbool on true\nint16 q \"\n"
        );
        let layout = Layout::parse("my_msgs/msg/Demo", &text, Wire::Cdr).expect("it is a definition");
        assert_eq!(layout.signature(), "iIs[9]d[]Bsw[](bh)");
        assert_eq!(layout.root()[5].name, "parts");
    }

    #[test]
    fn definitions_that_cannot_be_laid_out_are_refused() {
        for (text, expect) in [
            ("int32", "a type and a name"),
            ("other/Thing x", "a type that the definition holds"),
            ("uint8[0] x", "a length from 1"),
            ("uint8[99999999999999999999] x", "a length from 1"),
            ("Self me\n===\nMSG: a/Self\nSelf me", "at most 32 levels"),
            ("int8 a\nint16 a", "a name that no other field has"),
        ] {
            let error = Layout::parse("a/msg/Self", text, Wire::Cdr).expect_err(text).to_string();
            assert!(error.contains(expect), "{error}");
        }
    }

    #[test]
    fn events_of_a_service_are_laid_out_from_the_service() {
        let layout = Layout::parse("a/srv/Add_Event", "int64 a\nint64 b\n---\nint64 sum\n", Wire::Cdr)
            .expect("it is a service");
        assert_eq!(layout.signature(), "BiI[16]Bq[](qq)[](q)");
        Layout::parse("a/srv/Add", "int64 a\n---\nint64 sum\n", Wire::Cdr)
            .expect_err("a service is no message");
    }

    #[test]
    fn a_message_without_fields_is_one_byte() {
        let layout = Layout::parse("std_msgs/msg/Empty", "", Wire::Cdr).expect("it is a definition");
        assert_eq!(layout.signature(), "B");
    }

    #[test]
    fn a_definition_of_ros_1_is_signed_like_that_of_ros_2() {
        let text = "Header header\ntime at\nduration[] each\nbyte b\nchar c\nPart[2] parts\nNone nothing\n===\n\
            MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n===\nMSG: my_msgs/Part\nuint32 seq\n===\n\
            MSG: my_msgs/None\n";
        let layout = Layout::parse("my_msgs/Demo", text, Wire::Ros1).expect("it is a definition");
        assert_eq!(layout.signature(), "iIsiI[](iI)cB[2](I)");
    }

    #[test]
    fn fields_of_other_types_are_no_header_and_no_time_of_ros_1() {
        for (text, signature) in [
            ("uint32 secs\nuint32 nsecs", "iI"),
            ("int32 secs\nint32 nsecs", "iI"),
            ("float64 secs", "d"),
            ("float64 secs\nuint32 nsecs", "dI"),
            ("uint32[] secs\nuint32 nsecs", "[]II"),
            ("uint32 seq\ntime stamp\nstring frame_id", "iIs"),
            ("uint64 seq\ntime stamp\nstring frame_id", "QiIs"),
            ("uint32 seq\nfloat64 stamp\nstring frame_id", "Ids"),
            ("uint32 seq\ntime[2] stamp\nstring frame_id", "I[2](iI)s"),
            ("uint32 seq\nduration stamp\nstring frame_id", "IiIs"),
            ("uint32 seq\ntime stamp\nstring[] frame_id", "IiI[]s"),
        ] {
            let layout = Layout::parse("a/Demo", text, Wire::Ros1).expect(text);
            assert_eq!(layout.signature(), signature, "{text}");
        }
    }

    #[test]
    fn a_message_within_itself_does_no_harm_where_no_field_has_it() {
        for wire in [Wire::Cdr, Wire::Ros1] {
            let text = "int8 a\n===\nMSG: a/X\nX x\n";
            let layout = Layout::parse("a/Top", text, wire).expect("it is a definition");
            assert_eq!(layout.signature(), "c");
        }
    }

    #[test]
    fn very_many_fields_without_bytes_are_refused() {
        let parse = |count: usize| {
            let mut text = "Part[] parts\n===\nMSG: a/None\n===\nMSG: a/Part\nint8 a\n".to_owned();
            for field in 0..count {
                writeln!(text, "None n{field}").expect("a text takes all");
            }
            Layout::parse("a/Top", &text, Wire::Ros1)
        };
        assert_eq!(parse(100).expect("it is a definition").signature(), "[](c)");
        let error = parse(101).expect_err("so many steps for each byte").to_string();
        assert_eq!(error, "definition of a/Top: got \"101 fields that take no bytes\", expected at most 100");
    }

    #[test]
    fn messages_without_bytes_are_no_elements_of_arrays() {
        // Each message holds two of the next, and the last one nothing: 2^30 of them take no bytes.
        let mut text = "C0 a\nC0 b\nint8 end\n".to_owned();
        for depth in 0..29 {
            write!(text, "===\nMSG: a/C{depth}\nC{0} a\nC{0} b\n", depth + 1).expect("a text takes all");
        }
        text += "===\nMSG: a/C29\n";
        let layout = Layout::parse("a/Top", &text, Wire::Ros1).expect("it is a definition");
        assert_eq!(layout.signature(), "c");
        let error = Layout::parse("a/Top", &text.replace("C0 a", "C0[3] some"), Wire::Ros1)
            .expect_err("an array of nothing")
            .to_string();
        assert_eq!(error, "definition of a/Top: got \"some\", expected elements that take at least one byte");
    }
}
