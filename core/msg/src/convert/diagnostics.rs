//! Diagnostics: what the parts of a robot say of themselves, again and again.

use super::{Conversion, Source, Unusable};
use crate::any::AnyMessage;
use crate::rcs::diagnostic::Level;
use crate::rcs::{Diagnostic, Diagnostics};

pub(super) const DIAGNOSTIC_ARRAY: Conversion = Conversion {
    from: "diagnostic_msgs/DiagnosticArray",
    signature: "iIs[](Bsss[](ss))",
    to: "rcs.Diagnostics",
    convert: diagnostic_array,
};

/// A `byte` of ROS 1 is signed.
pub(super) const ROS1_DIAGNOSTIC_ARRAY: Conversion =
    Conversion { signature: "iIs[](csss[](ss))", ..DIAGNOSTIC_ARRAY };

/// Bytes of a status without its texts, at least. A sequence cannot have more than the message has room for.
const STATUS_SIZE: usize = 17;
/// Bytes of a key and a value without their texts.
const PAIR_SIZE: usize = 8;

/// The values of a part, pairs of texts, are left out. A level that ROS does not define counts as an error.
fn diagnostic_array(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let timestamp = source.header()?.timestamp;
    let mut parts = Vec::new();
    for _ in 0..source.cursor.length(STATUS_SIZE)? {
        let level = match source.cursor.u8()? {
            0 => Level::Ok,
            1 => Level::Warn,
            3 => Level::Stale,
            _ => Level::Error,
        };
        let (name, message) = (source.cursor.string()?, source.cursor.string()?);
        let hardware_id = source.cursor.string()?;
        for _ in 0..source.cursor.length(PAIR_SIZE)? {
            let (_key, _value) = (source.cursor.text()?, source.cursor.text()?);
        }
        parts.push(Diagnostic { level: level.into(), name, message, hardware_id });
    }
    Ok(AnyMessage::new(Diagnostics { timestamp, parts }))
}
