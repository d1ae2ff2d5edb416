//! Images of disparities.

use super::{HEADER, Writer, convert, schema};
use rcs_msg::foxglove::RawImage;
use rcs_msg::{canonical_name, header_frame, header_stamp};

const DISPARITY: &str = "stereo_msgs/msg/DisparityImage";

/// The disparities of an image of three pixels, of which `least_px` was the least that was searched for.
fn disparities(frame: &str, least_px: f32) -> Vec<f32> {
    let mut writer = Writer::new(false);
    writer.u32(5).u32(7).text(frame).u32(5).u32(9).text("camera").u32(1).u32(3).text("32FC1").u8(0).u32(12);
    let pixels: Vec<u8> = [15.0f32, 16.0, 46.5].iter().flat_map(|v| v.to_le_bytes()).collect();
    writer.data(&pixels);
    // Focal length and baseline, the window of valid pixels, and the disparities that were searched.
    writer.fixed(500.0f32.to_le_bytes()).fixed(0.1f32.to_le_bytes()).u32(0).u32(0).u32(1).u32(3).u8(0);
    for number in [least_px, 64.0, 0.0625] {
        writer.fixed(number.to_le_bytes());
    }
    let message = convert(DISPARITY, &writer.done());
    assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));
    assert_eq!(header_frame(&message).as_deref(), Some(if frame.is_empty() { "camera" } else { frame }));
    let image = message.get::<RawImage>().expect("it is an image");
    assert_eq!((image.width, image.height, image.step, image.encoding.as_str()), (3, 1, 12, "32FC1"));
    image.data.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
}

#[test]
fn a_disparity_image_is_an_image_without_the_disparities_that_are_invalid() {
    assert_eq!(disparities("left_camera", 0.0), [15.0, 16.0, 46.5]);
    let valid = disparities("", 16.0);
    assert!(valid[0].is_nan() && valid[1..] == [16.0, 46.5], "{valid:?}");
}

#[test]
fn the_definition_of_a_disparity_image_is_the_one_that_the_conversion_expects() {
    let image = "===\nMSG: sensor_msgs/Image\nstd_msgs/Header header\nuint32 height\nuint32 width\n\
        string encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n";
    let window = "===\nMSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\n\
        uint32 width\nbool do_rectify\n";
    let text = format!(
        "std_msgs/Header header\nsensor_msgs/Image image\nfloat32 f\nfloat32 t\n\
         sensor_msgs/RegionOfInterest valid_window\nfloat32 min_disparity\nfloat32 max_disparity\n\
         float32 delta_d{HEADER}{image}{window}"
    );
    assert_eq!(canonical_name(&schema(DISPARITY, &text)), Some("foxglove.RawImage"));
}
