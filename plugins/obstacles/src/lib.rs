//! Positive obstacles from range images by column scan.
