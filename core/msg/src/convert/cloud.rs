//! Point clouds.

use super::{Conversion, Source, Unusable};
use crate::any::AnyMessage;
use crate::foxglove::packed_element_field::NumericType;
use crate::foxglove::{PackedElementField, PointCloud, Pose, Quaternion, Vector3};
use bytes::Bytes;

pub(super) const POINT_CLOUD2: Conversion = Conversion {
    from: "sensor_msgs/PointCloud2",
    signature: "iIsII[](sIBI)bII[]Bb",
    to: "foxglove.PointCloud",
    convert: point_cloud2,
};

/// Fields with more elements than this (signatures, histograms) are left out.
const MAX_COUNT: u32 = 16;

/// The result shares the bytes of the message, unless rows are padded or numbers are big-endian. A field `f` with
/// several elements becomes `f_0`, `f_1`, ….
fn point_cloud2(source: &mut Source<'_>) -> Result<AnyMessage, Unusable> {
    let header = source.header()?;
    let (height, width) = (source.cursor.u32()?, source.cursor.u32()?);
    let mut fields = Vec::new();
    let mut sizes = Vec::new();
    for _ in 0..source.cursor.length(12)? {
        let name = source.cursor.string()?;
        let (offset, datatype, count) = (source.cursor.u32()?, source.cursor.u8()?, source.cursor.u32()?);
        let Some((kind, size)) = numeric_type(datatype).filter(|_| count <= MAX_COUNT) else { continue };
        for at in 0..count.max(1) {
            let name = if count > 1 { format!("{name}_{at}") } else { name.clone() };
            let offset = offset.saturating_add(at * size as u32);
            fields.push(PackedElementField { name, offset, r#type: kind.into() });
            sizes.push(size);
        }
    }
    let big_endian = source.cursor.u8()? != 0;
    let (point_stride, row_step) = (source.cursor.u32()?, source.cursor.u32()?);
    let data = source.shared()?;
    let mut data = rows(&data, width, height, point_stride, row_step)?;
    if big_endian && point_stride > 0 {
        let mut swapped = data.to_vec();
        for point in swapped.chunks_exact_mut(point_stride as usize) {
            for (field, size) in fields.iter().zip(&sizes) {
                let start = field.offset as usize;
                point.get_mut(start..start.saturating_add(*size)).unwrap_or_default().reverse();
            }
        }
        data = swapped.into();
    }
    Ok(AnyMessage::new(PointCloud {
        timestamp: header.timestamp,
        frame_id: header.frame_id,
        pose: Some(identity()),
        point_stride,
        fields,
        data,
    }))
}

/// The pose of points that are given in the frame of their message.
pub(super) fn identity() -> Pose {
    let orientation = Quaternion { w: 1.0, ..Quaternion::default() };
    Pose { position: Some(Vector3::default()), orientation: Some(orientation) }
}

/// The points of all rows, without padding between rows. A step of 0 is not set: there is no padding. If the size of a point
/// is not set, all bytes are kept, so that whoever reads the points sees that there are some.
fn rows(data: &Bytes, width: u32, height: u32, point_stride: u32, row_step: u32) -> Result<Bytes, Unusable> {
    if point_stride == 0 {
        return Ok(data.clone());
    }
    let row = u64::from(width) * u64::from(point_stride);
    let step = if row_step == 0 { row } else { u64::from(row_step) };
    if height > 1 && step < row {
        return Err(Unusable::Content { what: "row step of the point cloud", got: step, expected: row });
    }
    let whole = if height == 0 { 0 } else { u64::from(height - 1) * step + row };
    let got = data.len() as u64;
    if got < whole {
        return Err(Unusable::Content { what: "bytes of the point cloud", got, expected: whole });
    }
    if height <= 1 || step == row {
        return Ok(data.slice(..whole as usize));
    }
    Ok(data
        .chunks(row_step as usize)
        .take(height as usize)
        .flat_map(|chunk| &chunk[..row as usize])
        .copied()
        .collect())
}

/// Converts ROS 2's number of a type to Foxglove's; also its size in bytes.
fn numeric_type(datatype: u8) -> Option<(NumericType, usize)> {
    Some(match datatype {
        1 => (NumericType::Int8, 1),
        2 => (NumericType::Uint8, 1),
        3 => (NumericType::Int16, 2),
        4 => (NumericType::Uint16, 2),
        5 => (NumericType::Int32, 4),
        6 => (NumericType::Uint32, 4),
        7 => (NumericType::Float32, 4),
        8 => (NumericType::Float64, 8),
        _ => return None,
    })
}
