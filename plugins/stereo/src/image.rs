//! A decoded image of one camera.

use rcs_msg::foxglove::RawImage;
use rcs_sense::luma;
use serde::{Deserialize, Serialize};

/// A decoded image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ColourImage {
    pub(crate) frame_id: String,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Red, green, blue in row order, without gaps.
    pub(crate) rgb: Vec<u8>,
}

impl ColourImage {
    /// The colours of a message that has been checked.
    pub(crate) fn new(message: &RawImage, rgb: Vec<u8>) -> ColourImage {
        ColourImage {
            frame_id: message.frame_id.clone(),
            width: message.width as usize,
            height: message.height as usize,
            rgb,
        }
    }

    /// Grey levels in row order.
    pub(crate) fn grey(&self) -> Vec<u8> {
        self.rgb.as_chunks::<3>().0.iter().map(|&pixel| luma(pixel)).collect()
    }
}
