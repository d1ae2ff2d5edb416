//! Output messages of a pair: images, calibration and points.

use crate::points::Point;
use crate::{NO_DISPARITY, STEPS_PER_PIXEL, StereoCamera};
use rcs_msg::Stamp;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{
    CameraCalibration, PackedElementField, PointCloud, Pose, Quaternion, RawImage, Vector3,
};

/// Header fields common to all messages of a pair.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Heading<'a> {
    pub(crate) time: Stamp,
    pub(crate) frame_id: &'a str,
    pub(crate) size: [usize; 2],
}

impl Heading<'_> {
    fn image(&self, encoding: &str, bytes_per_pixel: usize, data: Vec<u8>) -> RawImage {
        RawImage {
            timestamp: Some(self.time.to_proto()),
            frame_id: self.frame_id.to_owned(),
            width: self.size[0] as u32,
            height: self.size[1] as u32,
            encoding: encoding.to_owned(),
            step: (self.size[0] * bytes_per_pixel) as u32,
            data: data.into(),
        }
    }

    pub(crate) fn rgb(&self, data: Vec<u8>) -> RawImage {
        self.image("rgb8", 3, data)
    }

    pub(crate) fn floats(&self, values: impl Iterator<Item = f32>) -> RawImage {
        let mut data = vec![0; self.size[0] * self.size[1] * 4];
        for (bytes, value) in data.as_chunks_mut::<4>().0.iter_mut().zip(values) {
            *bytes = value.to_le_bytes();
        }
        self.image("32FC1", 4, data)
    }

    /// The rectified left camera: without distortion, the reference camera of its pair.
    pub(crate) fn calibration(&self, camera: &StereoCamera) -> CameraCalibration {
        let camera = camera.left().camera();
        let (fx, fy, cx, cy) = (camera.fx, camera.fy, camera.cx, camera.cy);
        CameraCalibration {
            timestamp: Some(self.time.to_proto()),
            frame_id: self.frame_id.to_owned(),
            width: camera.width,
            height: camera.height,
            distortion_model: "plumb_bob".to_owned(),
            d: vec![0.0; 5],
            k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        }
    }

    /// Points of 20 bytes: `x`, `y`, `z` (f32, m), `red`, `green`, `blue`, `alpha` (u8), `u`, `v` (u16, pixels).
    pub(crate) fn cloud(&self, points: impl Iterator<Item = Point>) -> PointCloud {
        let mut data = Vec::with_capacity(20 * self.size[0] * self.size[1]);
        for Point { pixel, position_m, colour: [r, g, b] } in points {
            let [x, y, z] = position_m.to_array().map(f32::to_le_bytes);
            let [[u0, u1], [v0, v1]] = pixel.map(u16::to_le_bytes);
            // One slice for each point: several would each check the capacity.
            data.extend_from_slice([x, y, z, [r, g, b, u8::MAX], [u0, u1, v0, v1]].as_flattened());
        }
        let field = |name: &str, offset: u32, r#type: NumericType| PackedElementField {
            name: name.to_owned(),
            offset,
            r#type: r#type.into(),
        };
        PointCloud {
            timestamp: Some(self.time.to_proto()),
            frame_id: self.frame_id.to_owned(),
            pose: Some(Pose {
                position: Some(Vector3::default()),
                orientation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
            }),
            point_stride: 20,
            fields: vec![
                field("x", 0, NumericType::Float32),
                field("y", 4, NumericType::Float32),
                field("z", 8, NumericType::Float32),
                field("red", 12, NumericType::Uint8),
                field("green", 13, NumericType::Uint8),
                field("blue", 14, NumericType::Uint8),
                field("alpha", 15, NumericType::Uint8),
                field("u", 16, NumericType::Uint16),
                field("v", 18, NumericType::Uint16),
            ],
            data: data.into(),
        }
    }
}

/// Table of ranges along the optical axis by disparity in 1/16 pixel, m; NaN for those outside of the limits.
pub(crate) fn depths(camera: &StereoCamera, disparities: usize, [min_m, max_m]: [f64; 2]) -> Vec<f32> {
    let depth = |d: usize| {
        let depth_m = camera.depth_m(d as u16).filter(|depth_m| (min_m..=max_m).contains(depth_m));
        depth_m.map_or(f32::NAN, |depth_m| depth_m as f32)
    };
    (0..=disparities * usize::from(STEPS_PER_PIXEL)).map(depth).collect()
}

/// The range of a disparity from the table of [`depths`], m; NaN without a disparity.
pub(crate) fn depth_of(depths: &[f32], disparity: u16) -> f32 {
    // The marker for no disparity is beyond the end of every table.
    depths.get(usize::from(disparity)).copied().unwrap_or(f32::NAN)
}

/// A disparity in pixels; NaN without a disparity.
pub(crate) fn pixels(disparity: u16) -> f32 {
    if disparity == NO_DISPARITY { f32::NAN } else { f32::from(disparity) / f32::from(STEPS_PER_PIXEL) }
}
