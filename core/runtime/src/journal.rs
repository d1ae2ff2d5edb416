//! What comes from outside a stack.

use rcs_msg::AnyMessage;

/// A write of the operator's: a command, a parameter message, an edited message.
#[derive(Clone, Debug)]
pub struct OperatorWrite {
    /// Buffer that it goes to.
    pub buffer: String,
    /// The message.
    pub message: AnyMessage,
}
