//! What the learning map says of a cell.

/// What is known of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Judgement {
    /// 0 to 250.
    pub cost: u8,
    /// How sure it is, 0 to [`SURE`]: less with few points and no experience.
    pub confidence: u8,
    /// How far experience backs it, 0 to 255.
    pub backing: u8,
    /// The model by which it was judged: its number from 1 in the message of models; 0 where none was.
    pub model: u8,
}

/// Confidence of a judgement on a cell with enough points: that of a sensor which is sure of ground, so that the weight
/// of the source alone says how much it counts beside one.
pub const SURE: u8 = 80;
