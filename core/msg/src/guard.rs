//! Turns panics of foreign-data readers into errors.
//!
//! Schemas and messages from logs are read by libraries that were made for the output of compilers. Some of them panic
//! on input that no compiler writes. The content of a log must never end the program, so [`guarded`] catches such
//! panics.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    static DEPTH: Cell<u32> = const { Cell::new(0) };
}

/// Runs a reader of foreign bytes; if it panics, returns the panic message as the error.
///
/// `read` must not leave anything that outlives it half changed: it takes bytes and returns a value.
pub fn guarded<T>(read: impl FnOnce() -> T) -> Result<T, String> {
    DEPTH.set(DEPTH.get() + 1);
    let result = catch_unwind(AssertUnwindSafe(read));
    DEPTH.set(DEPTH.get() - 1);
    result.map_err(|panic| format!("its reader failed: {}", panic_text(&*panic)))
}

/// Whether this thread is inside of [`guarded`]: a panic hook need not print such a panic.
pub fn is_guarded() -> bool {
    DEPTH.get() > 0
}

/// The text of a panic.
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
