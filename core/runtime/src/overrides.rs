//! What an operator's [`rcs::Override`] does to a buffer.

use crate::error::RunError;
use rcs_bus::{Bus, Override, OverrideMode, OverrideValue};
use rcs_msg::{AnyMessage, Value, rcs};

/// Lays an operator's hand on a buffer, or takes it away, as an [`rcs::Override`] says.
pub(crate) fn apply_override(bus: &Bus, message: &AnyMessage) -> Result<(), RunError> {
    let refused = |text: String| RunError::Refused(text);
    let change = message
        .to::<rcs::Override>()
        .ok_or_else(|| refused("an override that does not decode".to_owned()))?;
    let Some(buffer) = bus.get(&change.buffer) else {
        return Err(refused(format!("there is no buffer {} to override", change.buffer)));
    };
    let schema = &buffer.spec().schema;
    let value = if change.path.is_empty() {
        let whole = rcs_msg::canonical(schema, &change.message).and_then(Result::ok);
        let whole =
            whole.ok_or_else(|| refused(format!("the message does not decode as {}", schema.name())))?;
        OverrideValue::Message(whole)
    } else {
        let path = change.path.parse().map_err(|error| refused(format!("{}: {error}", change.path)))?;
        let value = match (change.mode(), serde_json::from_str(&change.value_json)) {
            (rcs::r#override::Mode::Release, _) => Value::Null,
            (_, Ok(serde_json::Value::Bool(on))) => Value::Bool(on),
            (_, Ok(serde_json::Value::String(text))) => Value::Text(text),
            (_, Ok(serde_json::Value::Number(number))) => {
                number.as_i64().map_or_else(|| Value::Float(number.as_f64().unwrap_or(f64::NAN)), Value::Int)
            }
            _ => {
                return Err(refused(format!(
                    "{:?} is no value for a field; expected a number, a text, true or false",
                    change.value_json
                )));
            }
        };
        OverrideValue::Field(path, value)
    };
    let mode = match change.mode() {
        rcs::r#override::Mode::Hold => OverrideMode::Hold,
        rcs::r#override::Mode::Once => OverrideMode::Once,
        rcs::r#override::Mode::Release => OverrideMode::Release,
    };
    buffer.set_override(Override { mode, value });
    Ok(())
}
