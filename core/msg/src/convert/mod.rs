//! The one registry of conversions: from messages of logs and links to the messages that stacks and views read.
//!
//! | from | to | file |
//! | --- | --- | --- |
//! | every message of the registry, by name | itself, typed | `schema.rs` |
//! | `foxglove.*` in JSON, `foxglove_msgs/*` of ROS | the same message, typed | `by_name.rs` |
//! | `foxglove.LaserScan` of a log | `foxglove.PointCloud` | `scan.rs` |
//! | `sensor_msgs/Image`, `stereo_msgs/DisparityImage` | `foxglove.RawImage` | `image.rs` |
//! | `sensor_msgs/CompressedImage` | `foxglove.CompressedImage` | `image.rs` |
//! | `sensor_msgs/CameraInfo` | `foxglove.CameraCalibration` | `image.rs` |
//! | `sensor_msgs/PointCloud2` | `foxglove.PointCloud` | `cloud.rs` |
//! | `sensor_msgs/LaserScan` | `foxglove.PointCloud` | `scan.rs` |
//! | `sensor_msgs/Imu` | `rcs.Imu` | `navigation.rs` |
//! | `sensor_msgs/NavSatFix` | `foxglove.LocationFix` | `navigation.rs` |
//! | `nav_msgs/Odometry` | `foxglove.Odometry` | `navigation.rs` |
//! | `geometry_msgs/PoseStamped` | `foxglove.PoseInFrame` | `pose.rs` |
//! | `geometry_msgs/PoseWithCovarianceStamped` | `foxglove.Odometry` | `pose.rs` |
//! | `geometry_msgs/PoseArray` | `foxglove.PosesInFrame` | `pose.rs` |
//! | `nav_msgs/Path` | `foxglove.PosesInFrame` | `pose.rs` |
//! | `tf2_msgs/TFMessage`, `tf/tfMessage` | `foxglove.FrameTransforms` | `pose.rs` |
//! | `geometry_msgs/PolygonStamped` | `foxglove.PosesInFrame` | `pose.rs` |
//! | `nav_msgs/OccupancyGrid` | `foxglove.Grid` | `grid.rs`; its updates: `grid_updates.rs` |
//! | `nav2_msgs/Costmap` | `foxglove.Grid` | `grid.rs` |
//! | `grid_map_msgs/GridMap` | `foxglove.Grid` | `grid_map.rs` |
//! | `visualization_msgs/Marker`, `visualization_msgs/MarkerArray` | `foxglove.SceneUpdate` | `markers.rs` |
//! | `rcl_interfaces/Log`, `rosgraph_msgs/Log` | `foxglove.Log` | `log.rs` |
//! | `diagnostic_msgs/DiagnosticArray` | `rcs.Diagnostics` | `diagnostics.rs` |
//!
//! Other messages of ROS are read directly from their bytes; pixels and points share those bytes. If the definition in
//! a log differs from the definitions of that name in ROS, its messages are refused. A name has several conversions
//! where releases define it differently; without a readable definition the first one counts, for ROS 2. Messages of
//! ROS 1 have the same conversions, since their definitions differ by the header and by times alone, which [`Source`]
//! reads.

mod by_name;
mod cloud;
mod diagnostics;
mod grid;
mod grid_map;
mod grid_updates;
mod image;
mod log;
mod markers;
mod navigation;
mod pose;
mod scan;

use crate::any::AnyMessage;
use crate::definition::MessageEncoding;
use crate::foxglove::LaserScan;
use crate::guard::guarded;
use crate::reader::Reader;
use crate::reader::ros::{Cursor, RosError};
use crate::reader::rosmsg::Wire;
use crate::registry::{Known, registry};
use crate::schema::Schema;
use bytes::Bytes;
pub use grid_updates::{GRID_UPDATES, grid_decoder};
pub use markers::DELETES_NAMESPACE;
use prost_types::Timestamp;
use std::sync::Arc;

/// Why a message cannot be converted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConvertError {
    /// The bytes are not a message of this schema.
    #[error("{schema} does not decode: {reason}")]
    Malformed {
        /// Name of the schema.
        schema: String,
        /// Why it does not decode.
        reason: String,
    },
    /// The log has another definition of this name. Types are listed in wire order, one letter each.
    #[error("{schema} is laid out as {got}, expected {expected}")]
    Definition {
        /// Name of the schema.
        schema: String,
        /// Types in the log's definition.
        got: String,
        /// Types that the conversion expects.
        expected: &'static str,
    },
}

/// The conversion of one ROS type that has a canonical counterpart.
struct Conversion {
    /// `package/Type`.
    from: &'static str,
    /// The types on the wire, in order, that the conversion reads: see `Layout::signature`.
    signature: &'static str,
    to: &'static str,
    convert: fn(&mut Source<'_>) -> Result<AnyMessage, Unusable>,
}

const ROS: &[&Conversion] = &[
    &image::IMAGE,
    &image::DISPARITY_IMAGE,
    &image::COMPRESSED_IMAGE,
    &image::CAMERA_INFO,
    &cloud::POINT_CLOUD2,
    &scan::LASER_SCAN,
    &navigation::IMU,
    &navigation::NAV_SAT_FIX,
    &navigation::ODOMETRY,
    &pose::POSE_STAMPED,
    &pose::POSE_WITH_COVARIANCE_STAMPED,
    &pose::POSE_ARRAY,
    &pose::PATH,
    &pose::TF_MESSAGE,
    &pose::ROS1_TF_MESSAGE,
    &pose::POLYGON_STAMPED,
    &grid::OCCUPANCY_GRID,
    &grid::COSTMAP,
    &grid_map::GRID_MAP,
    &log::LOG,
    &log::ROS1_LOG,
    &diagnostics::DIAGNOSTIC_ARRAY,
    &diagnostics::ROS1_DIAGNOSTIC_ARRAY,
    &markers::MARKER,
    &markers::MARKER_ARRAY,
    &markers::FOXY_MARKER,
    &markers::FOXY_MARKER_ARRAY,
];

/// Converts a message of a topic to its canonical message; `None` if no conversion exists for its schema.
pub fn canonical(topic_schema: &Schema, bytes: &Bytes) -> Option<Result<AnyMessage, ConvertError>> {
    let malformed =
        |reason: String| ConvertError::Malformed { schema: topic_schema.name().to_owned(), reason };
    if let Some(known) = ours(topic_schema) {
        let message = guarded(|| typed(topic_schema, known, bytes));
        return Some(message.and_then(|message| message).map_err(malformed));
    }
    Some(conversion(topic_schema)?.and_then(|conversion| {
        let message = guarded(|| {
            let wire = wire(topic_schema).unwrap_or(Wire::Cdr);
            let message = Source::new(bytes, wire).and_then(|mut source| (conversion.convert)(&mut source));
            message.map_err(|error| error.to_string())
        });
        message.and_then(|message| message).map_err(malformed)
    }))
}

/// Full name of the schema of the messages that [`canonical`] makes from this schema; `None` if it makes none.
pub fn canonical_name(schema: &Schema) -> Option<&'static str> {
    if is_scan(schema) {
        return Some(scan::CLOUD);
    }
    ours(schema).map(|known| known.name).or_else(|| conversion(schema)?.ok().map(|conversion| conversion.to))
}

/// The type of the registry whose fields messages of this schema have.
fn ours(schema: &Schema) -> Option<&'static Known> {
    let name = schema.name();
    match schema.message_encoding() {
        MessageEncoding::Protobuf => registry().known(name),
        MessageEncoding::Json => name.starts_with("foxglove.").then(|| registry().known(name))?,
        MessageEncoding::Cdr | MessageEncoding::Ros1 => {
            let name = name.strip_prefix("foxglove_msgs/")?;
            // Without a readable definition nobody knows where its fields lie.
            schema.decodable().ok()?;
            registry().known(&format!("foxglove.{}", name.strip_prefix("msg/").unwrap_or(name)))
        }
        MessageEncoding::Other(_) => None,
    }
}

/// Whether messages of this schema are scans of a log, which become clouds. Scans that a stack itself writes have the
/// registry's own schema and keep their type, which is that of their buffer.
fn is_scan(schema: &Schema) -> bool {
    let is_own =
        || registry().schema(scan::FOXGLOVE).is_some_and(|own| std::ptr::eq(schema, Arc::as_ptr(own)));
    ours(schema).is_some_and(|known| known.name == scan::FOXGLOVE) && !is_own()
}

/// A message of the registry in its typed form.
fn typed(schema: &Schema, known: &Known, bytes: &Bytes) -> Result<AnyMessage, String> {
    let message = if *schema.message_encoding() == MessageEncoding::Protobuf {
        (known.decode)(bytes.clone()).map_err(|error| error.to_string())?
    } else {
        let reader = schema.reader().map_err(|error| error.to_string())?;
        by_name::typed(known, reader.read(bytes)?)?
    };
    match message.get::<LaserScan>().filter(|_| is_scan(schema)) {
        Some(scan) => scan::of_foxglove(scan).map_err(|error| error.to_string()),
        None => Ok(message),
    }
}

/// How messages of ROS are laid out; `None` for others.
fn wire(schema: &Schema) -> Option<Wire> {
    match schema.message_encoding() {
        MessageEncoding::Cdr => Some(Wire::Cdr),
        MessageEncoding::Ros1 => Some(Wire::Ros1),
        MessageEncoding::Protobuf | MessageEncoding::Json | MessageEncoding::Other(_) => None,
    }
}

fn conversion(schema: &Schema) -> Option<Result<&'static Conversion, ConvertError>> {
    let wire = wire(schema)?;
    let (package, rest) = schema.name().split_once('/')?;
    let name = rest.strip_prefix("msg/").unwrap_or(rest);
    let mut named = ROS.iter().copied().filter(|known| known.from.split_once('/') == Some((package, name)));
    let first = named.next()?;
    // If the definition cannot be read (ros2idl), the conversion goes by the name alone.
    let Ok(Reader::Ros(layout)) = schema.reader() else {
        return (wire == Wire::Cdr).then_some(Ok(first));
    };
    let found = std::iter::once(first).chain(named).find(|known| known.signature == layout.signature());
    Some(found.ok_or_else(|| ConvertError::Definition {
        schema: schema.name().to_owned(),
        got: layout.signature().to_owned(),
        expected: first.signature,
    }))
}

/// Why a message of ROS cannot be used.
#[derive(Debug, thiserror::Error)]
enum Unusable {
    #[error(transparent)]
    Ros(#[from] RosError),
    #[error("{what}: got {got}, expected {expected}")]
    Content { what: &'static str, got: u64, expected: u64 },
    #[error("{what}: got {got}, expected at most {most}")]
    Above { what: &'static str, got: u64, most: u64 },
    #[error("{what}: got {got}, expected {expected}")]
    Number { what: &'static str, got: f64, expected: &'static str },
}

/// Refuses a number other than the expected one.
fn expect(what: &'static str, got: u64, expected: u64) -> Result<(), Unusable> {
    if got == expected { Ok(()) } else { Err(Unusable::Content { what, got, expected }) }
}

/// Reads a message of ROS.
struct Source<'a> {
    bytes: &'a Bytes,
    cursor: Cursor<'a>,
}

/// `std_msgs/Header`, without the `seq` of ROS 1.
struct Header {
    timestamp: Option<Timestamp>,
    frame_id: String,
}

impl<'a> Source<'a> {
    fn new(bytes: &'a Bytes, wire: Wire) -> Result<Self, Unusable> {
        Ok(Self { bytes, cursor: Cursor::new(bytes, wire)? })
    }

    fn time(&mut self) -> Result<Timestamp, Unusable> {
        let seconds = match self.cursor.wire() {
            Wire::Cdr => self.cursor.i32()?.into(),
            Wire::Ros1 => self.cursor.u32()?.into(),
        };
        let nanos = self.cursor.u32()?;
        let nanos =
            i32::try_from(nanos).ok().filter(|nanos| *nanos < 1_000_000_000).ok_or(Unusable::Content {
                what: "nanoseconds of a time",
                got: nanos.into(),
                expected: 999_999_999,
            })?;
        Ok(Timestamp { seconds, nanos })
    }

    fn header(&mut self) -> Result<Header, Unusable> {
        if self.cursor.wire() == Wire::Ros1 {
            let _seq = self.cursor.u32()?;
        }
        Ok(Header { timestamp: Some(self.time()?), frame_id: self.cursor.string()? })
    }

    /// A sequence of bytes, shared with the message.
    fn shared(&mut self) -> Result<Bytes, Unusable> {
        Ok(self.bytes.slice_ref(self.cursor.bytes()?))
    }

    fn floats(&mut self, count: usize) -> Result<Vec<f64>, Unusable> {
        (0..count).map(|_| Ok(self.cursor.f64()?)).collect()
    }

    fn vector(&mut self) -> Result<crate::foxglove::Vector3, Unusable> {
        let (x, y, z) = (self.cursor.f64()?, self.cursor.f64()?, self.cursor.f64()?);
        Ok(crate::foxglove::Vector3 { x, y, z })
    }

    fn quaternion(&mut self) -> Result<crate::foxglove::Quaternion, Unusable> {
        let (x, y) = (self.cursor.f64()?, self.cursor.f64()?);
        let (z, w) = (self.cursor.f64()?, self.cursor.f64()?);
        Ok(crate::foxglove::Quaternion { x, y, z, w })
    }

    fn pose(&mut self) -> Result<crate::foxglove::Pose, Unusable> {
        Ok(crate::foxglove::Pose { position: Some(self.vector()?), orientation: Some(self.quaternion()?) })
    }
}
