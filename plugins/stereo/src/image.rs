//! One camera's image as it came, decoded.

use rcs_msg::foxglove::RawImage;
use rcs_sense::luma;
use serde::{Deserialize, Serialize};

/// An image that can be matched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ColourImage {
    pub(crate) frame_id: String,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Red, green, blue by rows, without gaps.
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

    /// Grey levels by rows.
    pub(crate) fn grey(&self) -> Vec<u8> {
        self.rgb.as_chunks::<3>().0.iter().map(|&pixel| luma(pixel)).collect()
    }
}
