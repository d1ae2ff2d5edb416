//! Reads the points of point-cloud messages.

use crate::foxglove::packed_element_field::NumericType;
use crate::foxglove::{PackedElementField, PointCloud};
use crate::packed::{Number, Scalar};
use glam::DVec3;

/// One point of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// In the cloud's own coordinates: [`PointCloud::pose`] is not applied. NaN where the sensor has no return.
    pub position: DVec3,
    /// Red, green, blue, if the cloud has colours.
    pub rgb: Option<[u8; 3]>,
    /// Strength of the return, in the sensor's own scale, if the cloud has intensities.
    pub intensity: Option<f32>,
}

/// Why a cloud cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PointsError {
    /// The fields `x`, `y` and `z` are required.
    #[error("no field {name:?} in the point cloud, expected x, y and z among {got}")]
    NoField {
        /// The missing field.
        name: &'static str,
        /// The fields of the cloud.
        got: String,
    },
    /// A field is not a number, or does not lie within the point.
    #[error("field {name} of the point cloud: got {got}, expected {expected}")]
    Field {
        /// The field.
        name: String,
        /// Its type, or the offset of its end.
        got: String,
        /// The expected type or end.
        expected: String,
    },
    /// The size of a point is not set.
    #[error("point cloud: size of a point is 0 bytes, expected at least {least}")]
    NoSize {
        /// Where the last field ends, bytes.
        least: u64,
    },
    /// The length of the data is not a multiple of the size of a point.
    #[error("point cloud: got {bytes} bytes, expected a multiple of {stride}")]
    Stride {
        /// Length of the data, bytes.
        bytes: usize,
        /// Size of a point, bytes.
        stride: usize,
    },
}

/// Position and type of a number within a point.
#[derive(Clone, Copy, Debug)]
struct At {
    offset: usize,
    number: Number,
}

#[derive(Clone, Copy, Debug)]
enum Colour {
    /// PCL's packed colour: blue, green, red in the bytes of one number.
    Packed(usize),
    /// Separate fields: 8-bit integers, or floats from 0 to 1.
    Apart([At; 3]),
}

/// A cloud whose fields have been located and checked: reading its points cannot fail.
#[derive(Clone, Debug)]
pub struct Points<'a> {
    data: &'a [u8],
    stride: usize,
    position: [At; 3],
    colour: Option<Colour>,
    intensity: Option<At>,
}

/// The points of a cloud. One without data and fields is empty.
pub fn points(cloud: &PointCloud) -> Result<Points<'_>, PointsError> {
    if cloud.data.is_empty() && cloud.fields.is_empty() {
        let position = [At { offset: 0, number: Number::F32 }; 3];
        return Ok(Points { data: &[], stride: 1, position, colour: None, intensity: None });
    }
    let stride = cloud.point_stride as usize;
    if stride == 0 {
        let ends = cloud.fields.iter().filter_map(number_and_end).map(|(_, end)| end);
        return Err(PointsError::NoSize { least: ends.max().unwrap_or(1) });
    }
    if !cloud.data.len().is_multiple_of(stride) {
        return Err(PointsError::Stride { bytes: cloud.data.len(), stride });
    }
    let find = |name: &str| cloud.fields.iter().find(|field| field.name == name);
    let need = |name: &'static str| {
        let field = find(name).ok_or_else(|| PointsError::NoField {
            name,
            got: cloud.fields.iter().map(|field| field.name.as_str()).collect::<Vec<_>>().join(", "),
        })?;
        at(field, stride)
    };
    let position = [need("x")?, need("y")?, need("z")?];
    let colour = if let Some(field) = find("rgb").or_else(|| find("rgba")) {
        let at = at(field, stride)?;
        (at.number.size() == 4).then_some(Colour::Packed(at.offset))
    } else {
        let apart = |names: [&str; 3]| {
            let [Some(r), Some(g), Some(b)] = names.map(find) else { return Ok(None) };
            Ok(Some(Colour::Apart([at(r, stride)?, at(g, stride)?, at(b, stride)?])))
        };
        match apart(["red", "green", "blue"])? {
            None => apart(["r", "g", "b"])?,
            found => found,
        }
    };
    let intensity = find("intensity").map(|field| at(field, stride)).transpose()?;
    Ok(Points { data: &cloud.data, stride, position, colour, intensity })
}

/// The number in a field, and where it ends within a point, bytes; `None` if its type is unknown.
fn number_and_end(field: &PackedElementField) -> Option<(Number, u64)> {
    let number = match field.r#type() {
        NumericType::Uint8 => Number::U8,
        NumericType::Int8 => Number::I8,
        NumericType::Uint16 => Number::U16,
        NumericType::Int16 => Number::I16,
        NumericType::Uint32 => Number::U32,
        NumericType::Int32 => Number::I32,
        NumericType::Float32 => Number::F32,
        NumericType::Float64 => Number::F64,
        NumericType::Unknown => return None,
    };
    Some((number, u64::from(field.offset) + number.size() as u64))
}

fn at(field: &PackedElementField, stride: usize) -> Result<At, PointsError> {
    let fail = |got: String, expected: String| PointsError::Field { name: field.name.clone(), got, expected };
    let (number, end) =
        number_and_end(field).ok_or_else(|| fail("an unknown type".to_owned(), "a number".to_owned()))?;
    if end > stride as u64 {
        return Err(fail(format!("an end at byte {end}"), format!("at most {stride}, the size of a point")));
    }
    Ok(At { offset: field.offset as usize, number })
}

impl At {
    fn read(self, point: &[u8]) -> f64 {
        let bytes = &point[self.offset..][..self.number.size()];
        // Nearly all clouds have 32-bit floats.
        if self.number == Number::F32
            && let Ok(bytes) = bytes.try_into()
        {
            return f64::from(f32::from_le_bytes(bytes));
        }
        self.number.read(bytes, false).map_or(f64::NAN, Scalar::as_f64)
    }

    fn channel(self, point: &[u8]) -> u8 {
        let value = self.read(point);
        let float = matches!(self.number, Number::F32 | Number::F64);
        (if float { (value * 255.0).round() } else { value }) as u8
    }
}

impl Points<'_> {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.data.len() / self.stride
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// Whether its points have colours of their own.
    pub fn has_colours(&self) -> bool {
        self.colour.is_some()
    }

    /// The numbers of a field of the cloud, in the order of the points; `None` if it has no numbers, or does not lie
    /// within a point.
    pub fn values(&self, field: &PackedElementField) -> Option<Vec<f64>> {
        let at = at(field, self.stride).ok()?;
        Some(self.data.chunks_exact(self.stride).map(|point| at.read(point)).collect())
    }

    /// All points, in the order of the message.
    pub fn iter(&self) -> impl Iterator<Item = Point> + '_ {
        self.data.chunks_exact(self.stride).map(|point| Point {
            position: DVec3::from_array(self.position.map(|at| at.read(point))),
            rgb: self.colour.map(|colour| match colour {
                Colour::Packed(offset) => [point[offset + 2], point[offset + 1], point[offset]],
                Colour::Apart(channels) => channels.map(|at| at.channel(point)),
            }),
            intensity: self.intensity.map(|at| at.read(point) as f32),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(fields: &[(&str, u32, NumericType)], stride: u32, data: Vec<u8>) -> PointCloud {
        let fields = fields
            .iter()
            .map(|(name, offset, kind)| PackedElementField {
                name: (*name).to_owned(),
                offset: *offset,
                r#type: (*kind).into(),
            })
            .collect();
        PointCloud { point_stride: stride, fields, data: data.into(), ..PointCloud::default() }
    }

    const XYZ: [(&str, u32, NumericType); 3] =
        [("x", 0, NumericType::Float32), ("y", 4, NumericType::Float32), ("z", 8, NumericType::Float32)];

    #[test]
    fn position_colour_and_intensity_come_from_their_fields() {
        let mut fields = XYZ.to_vec();
        fields.extend([("rgb", 12, NumericType::Uint32), ("intensity", 16, NumericType::Uint8)]);
        let mut data: Vec<u8> = [1.0f32, 2.0, 3.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        data.extend([30, 20, 10, 0, 7]);
        let cloud = cloud(&fields, 17, data);
        let points: Vec<_> = points(&cloud).expect("it is a cloud").iter().collect();
        let expect =
            Point { position: DVec3::new(1.0, 2.0, 3.0), rgb: Some([10, 20, 30]), intensity: Some(7.0) };
        assert_eq!(points, [expect]);
    }

    #[test]
    fn the_numbers_of_any_field_within_a_point_are_read() {
        let mut fields = XYZ.to_vec();
        fields.extend([("ring", 12, NumericType::Uint16), ("outside", 13, NumericType::Uint16)]);
        let data: Vec<u8> = [[0_u8; 12].as_slice(), &[7, 0], &[0; 12], &[0, 1]].concat();
        let cloud = cloud(&fields, 14, data);
        let read = points(&cloud).expect("it is a cloud");
        assert_eq!(read.values(&cloud.fields[3]), Some(vec![7.0, 256.0]));
        assert_eq!(read.values(&cloud.fields[4]), None);
        assert!(!read.has_colours());
    }

    #[test]
    fn a_cloud_without_data_and_fields_is_empty() {
        for stride in [0, 12] {
            let cloud = cloud(&[], stride, vec![]);
            let points = points(&cloud).expect("it is empty");
            assert_eq!((points.len(), points.is_empty(), points.iter().count()), (0, true, 0));
        }
    }

    #[test]
    fn fields_that_are_missing_or_outside_the_point_are_refused() {
        let cases = [
            (cloud(&XYZ[..2], 12, vec![0; 12]), "no field \"z\""),
            (cloud(&XYZ, 11, vec![0; 11]), "field z of the point cloud: got an end at byte 12"),
            (cloud(&XYZ, 12, vec![0; 13]), "point cloud: got 13 bytes, expected a multiple of 12"),
            (cloud(&XYZ, 0, vec![0; 24]), "point cloud: size of a point is 0 bytes, expected at least 12"),
            (cloud(&XYZ, 0, vec![]), "point cloud: size of a point is 0 bytes, expected at least 12"),
            (cloud(&[], 0, vec![0; 24]), "point cloud: size of a point is 0 bytes, expected at least 1"),
        ];
        for (cloud, expect) in cases {
            let error = points(&cloud).expect_err(expect).to_string();
            assert!(error.starts_with(expect), "{error}");
        }
    }
}
