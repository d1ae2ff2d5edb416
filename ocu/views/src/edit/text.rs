//! Values as text, and numbers of texts.

use rcs_msg::Value;

/// A plain value as the text in which it is edited; `None` for others.
pub(crate) fn text_of(value: &Value) -> Option<String> {
    Some(match value {
        Value::Bool(on) => on.to_string(),
        Value::Int(number) => number.to_string(),
        Value::Uint(number) => number.to_string(),
        Value::Float(number) => number.to_string(),
        Value::Text(text) => text.clone(),
        Value::Enum { name, number } if name.is_empty() => number.to_string(),
        Value::Enum { name, .. } => name.clone(),
        _ => return None,
    })
}

/// The number that a text states, with a decimal point or a decimal comma.
pub(crate) fn number_of(text: &str) -> Option<f64> {
    let text: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    text.replace('\u{2212}', "-").replace(',', ".").parse().ok()
}
