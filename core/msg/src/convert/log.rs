//! Lines of a log.

use super::{Conversion, Source, Unusable};
use crate::any::AnyMessage;
use crate::foxglove::Log;
use crate::foxglove::log::Level;

pub(super) const LOG: Conversion =
    Conversion { from: "rcl_interfaces/Log", signature: "iIBssssI", to: "foxglove.Log", convert: log };

pub(super) const ROS1_LOG: Conversion = Conversion {
    from: "rosgraph_msgs/Log",
    signature: "iIscssssI[]s",
    to: "foxglove.Log",
    convert: ros1_log,
};

/// Foxglove's message has no name of the function; it is left out.
fn log(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let timestamp = Some(source.time()?);
    let level = level(source.cursor.u8()?);
    let (name, message) = (source.cursor.string()?, source.cursor.string()?);
    let (file, _function) = (source.cursor.string()?, source.cursor.text()?);
    let line = source.cursor.u32()?;
    Ok(AnyMessage::new(Log { timestamp, level: level.into(), message, name, file, line }))
}

/// The names of the function and of the topics of the node are left out.
fn ros1_log(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let timestamp = source.header()?.timestamp;
    let level = match source.cursor.u8()? {
        1 => Level::Debug,
        2 => Level::Info,
        4 => Level::Warning,
        8 => Level::Error,
        16 => Level::Fatal,
        _ => Level::Unknown,
    };
    let (name, message) = (source.cursor.string()?, source.cursor.string()?);
    let (file, _function) = (source.cursor.string()?, source.cursor.text()?);
    let line = source.cursor.u32()?;
    Ok(AnyMessage::new(Log { timestamp, level: level.into(), message, name, file, line }))
}

/// ROS 2 counts levels in tens; a number between two of them belongs to the lower one.
fn level(number: u8) -> Level {
    match number {
        0..10 => Level::Unknown,
        10..20 => Level::Debug,
        20..30 => Level::Info,
        30..40 => Level::Warning,
        40..50 => Level::Error,
        50.. => Level::Fatal,
    }
}
