//! The guard at the door where foreign bytes come in.
//!
//! Schemas and messages of others are read by libraries that were made for what compilers write, and some panic on what
//! a compiler would not write. What a log holds must never end the program: here a panic becomes a reason.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    static DEPTH: Cell<u32> = const { Cell::new(0) };
}

/// Runs a reader of foreign bytes; where it panics, gives what it said.
///
/// Nothing that outlives `read` may be left half changed by it: it gets bytes and gives a value.
pub fn guarded<T>(read: impl FnOnce() -> T) -> Result<T, String> {
    DEPTH.set(DEPTH.get() + 1);
    let result = catch_unwind(AssertUnwindSafe(read));
    DEPTH.set(DEPTH.get() - 1);
    result.map_err(|panic| format!("its reader failed: {}", panic_text(&*panic)))
}

/// Whether this thread is within [`guarded`]: a panic there is dealt with, and is no news for the terminal.
pub fn is_guarded() -> bool {
    DEPTH.get() > 0
}

/// What a panic said.
pub fn panic_text(panic: &(dyn Any + Send)) -> &str {
    panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("a panic without a message")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_its_message_and_the_guard_ends_with_the_reader() {
        let result: Result<(), String> = guarded(|| {
            assert!(is_guarded());
            panic!("not a {}", "descriptor")
        });
        assert_eq!(result, Err("its reader failed: not a descriptor".to_owned()));
        assert_eq!(guarded(|| guarded(|| 3)), Ok(Ok(3)));
        assert!(!is_guarded());
    }
}
