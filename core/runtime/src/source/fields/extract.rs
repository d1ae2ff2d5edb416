//! Reads one field from messages of one schema: a number by the scanner, a state with its name, a text by its content.

use rcs_formula::{Names, States};
use rcs_msg::{AnyMessage, DecodeError, FieldPath, FieldScanner, ScanError, Schema, Value};
use std::collections::HashMap;
use std::sync::Arc;

/// For a plot, texts beyond this number of different ones have no value.
pub(super) const MOST_TEXTS: usize = 10_000;

/// Messages without the field whose tree is looked at.
const MOST_LOOKS: u32 = 8;

/// What the values of a field are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Not known yet.
    Unknown,
    /// Of a message as a whole, there is nothing but its time; the value is 1.
    Time,
    Number,
    Bool,
    Enum,
    Text,
}

/// Messages that do not decode, so that they have no value.
#[derive(Clone, Default)]
pub(super) struct Undecoded {
    count: u64,
    /// Why the first of them does not decode.
    first: Option<Arc<str>>,
}

impl Undecoded {
    fn add(&mut self, error: &DecodeError) {
        self.count += 1;
        self.first.get_or_insert_with(|| match error {
            // Its schema is that of the topic, which is named beside it.
            DecodeError::Malformed { reason, .. } => reason.as_str().into(),
            DecodeError::NoReader { .. } => error.to_string().into(),
        });
    }
}

/// Reads one field.
#[derive(Clone)]
pub(super) struct Extractor {
    path: FieldPath,
    /// `None` for a text, which is read from the decoded message.
    scanner: Option<FieldScanner>,
    kind: Kind,
    pub(super) names: Names,
    /// The names of all states of an enum whose definition is known.
    pub(super) states: States,
    /// The keys of texts.
    texts: HashMap<Arc<str>, i64>,
    /// Greatest number of different texts.
    most_texts: usize,
    /// Whether there were more.
    lacks_texts: bool,
    /// Number of messages without the field whose tree was looked at.
    looks: u32,
    undecoded: Undecoded,
}

impl Extractor {
    /// A reader of messages of this schema; an error text if they cannot have such a field.
    pub(super) fn new(schema: &Arc<Schema>, path: &FieldPath) -> Result<Self, String> {
        let (scanner, kind) = match FieldScanner::new(schema, path) {
            _ if path.segments().is_empty() => (None, Kind::Time),
            Ok(scanner) => (Some(scanner), Kind::Unknown),
            Err(ScanError::Kind { got, expected: "a number", .. }) if got == "a text" => (None, Kind::Text),
            Err(error) => return Err(error.to_string()),
        };
        Ok(Self {
            path: path.clone(),
            scanner,
            kind,
            names: Names::default(),
            states: schema.state_names(path).unwrap_or_default().into(),
            texts: HashMap::new(),
            most_texts: MOST_TEXTS,
            lacks_texts: false,
            looks: 0,
            undecoded: Undecoded::default(),
        })
    }

    /// The same reader, which gives every text a value, however many different ones there are.
    pub(super) fn with_all_texts(self) -> Self {
        Self { most_texts: usize::MAX, ..self }
    }

    /// What is said if messages have no value that may have the field.
    pub(super) fn lacking(&self) -> Option<Arc<str>> {
        let Undecoded { count, first } = &self.undecoded;
        if let Some(reason) = first {
            let count =
                if *count == 1 { "1 message does".to_owned() } else { format!("{count} messages do") };
            return Some(format!("{count} not decode, the first: {reason}").into());
        }
        let text =
            || format!("only the first {MOST_TEXTS} different texts are shown; an export has all").into();
        self.lacks_texts.then(text)
    }

    /// Whether messages are read without decoding them, so that several threads can read different ones in any order.
    pub(super) fn is_direct(&self) -> bool {
        self.is_time() || self.scanner.as_ref().is_some_and(FieldScanner::is_direct)
    }

    /// Whether the times of messages are all that is read.
    pub(super) fn is_time(&self) -> bool {
        self.kind == Kind::Time
    }

    /// Takes the names over that another reader of the field has learned.
    pub(super) fn learn_from(&mut self, other: &Self) {
        let is_new = |key: &&i64| !self.names.contains_key(key);
        if other.names.keys().any(|key| is_new(&key)) {
            let names = other.names.iter().map(|(key, name)| (*key, Arc::clone(name)));
            Arc::make_mut(&mut self.names).extend(names);
        }
    }

    /// Takes the messages that did not decode since this was last called.
    pub(super) fn take_undecoded(&mut self) -> Undecoded {
        std::mem::take(&mut self.undecoded)
    }

    /// Counts messages that another reader of the field did not decode, which come after its own.
    pub(super) fn count_undecoded(&mut self, later: Undecoded) {
        self.undecoded.count += later.count;
        self.undecoded.first = self.undecoded.first.take().or(later.first);
    }

    /// The value in a message; NaN if it has none.
    pub(super) fn read(&mut self, message: &AnyMessage) -> f64 {
        if self.is_time() {
            return 1.0;
        }
        self.read_bytes(&message.bytes(), || message.clone())
    }

    /// The value in an encoded message, which is made only if it must be decoded.
    pub(super) fn read_bytes(&mut self, bytes: &[u8], message: impl Fn() -> AnyMessage) -> f64 {
        let Some(scanner) = &self.scanner else {
            return if self.is_time() { 1.0 } else { self.text(&message()).unwrap_or(f64::NAN) };
        };
        let scanned = scanner.scan(bytes).inspect_err(|error| self.undecoded.add(error));
        let value = scanned.ok().flatten().unwrap_or(f64::NAN);
        let known = match self.kind {
            Kind::Number => true,
            // Where the schema does not tell, as of JSON, a text is found by looking at a few messages.
            Kind::Unknown if value.is_nan() => {
                self.looks += 1;
                self.looks > MOST_LOOKS
            }
            Kind::Unknown => false,
            _ => value.is_nan() || self.names.contains_key(&(value as i64)),
        };
        if !known {
            let message = message();
            self.learn(&message, value);
            if self.kind == Kind::Text {
                return self.text(&message).unwrap_or(f64::NAN);
            }
        }
        value
    }

    fn learn(&mut self, message: &AnyMessage, value: f64) {
        let Ok(root) = message.value() else { return };
        let Ok(found) = root.get(&self.path) else { return };
        self.kind = match &*found {
            Value::Bool(_) => {
                self.names = Arc::new([(0, "false".into()), (1, "true".into())].into());
                Kind::Bool
            }
            Value::Enum { name, .. } => {
                let name = if name.is_empty() { value.to_string() } else { name.clone() };
                Arc::make_mut(&mut self.names).insert(value as i64, name.into());
                Kind::Enum
            }
            Value::Text(_) => {
                self.scanner = None;
                Kind::Text
            }
            // An element that is absent now may be there later.
            Value::Null => Kind::Unknown,
            _ => Kind::Number,
        };
    }

    fn text(&mut self, message: &AnyMessage) -> Option<f64> {
        let root = message.value().inspect_err(|error| self.undecoded.add(error)).ok()?;
        let found = root.get(&self.path).ok()?;
        let text = found.as_text()?;
        if let Some(&key) = self.texts.get(text) {
            return Some(key as f64);
        }
        if self.texts.len() >= self.most_texts {
            self.lacks_texts = true;
            return None;
        }
        let (key, text) = (self.texts.len() as i64, Arc::<str>::from(text));
        self.texts.insert(Arc::clone(&text), key);
        Arc::make_mut(&mut self.names).insert(key, text);
        Some(key as f64)
    }
}
