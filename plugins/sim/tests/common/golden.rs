//! Golden traces: what a change does to the numbers is read as a difference of `tests/golden/*.csv`.
//! `UPDATE_GOLDEN=1 cargo nextest run -p rcs-sim` writes them anew.

#![allow(dead_code, unreachable_pub, clippy::unwrap_used, reason = "each test takes what it needs")]

use std::fmt::Write as _;
use std::path::Path;

/// Rows of numbers under a header, as text: six digits after the point are far above the last bits of a double, so the
/// text is the same on every machine.
#[derive(Debug)]
pub struct Trace {
    text: String,
}

impl Trace {
    pub fn new(columns: &[&str]) -> Trace {
        Trace { text: format!("{}\n", columns.join(",")) }
    }

    pub fn row(&mut self, values: &[f64]) {
        for (at, value) in values.iter().enumerate() {
            let comma = if at == 0 { "" } else { "," };
            // −0 and 0 are the same.
            write!(self.text, "{comma}{:.6}", value + 0.0).unwrap();
        }
        self.text.push('\n');
    }

    /// Compares with the committed trace, or writes it.
    #[expect(clippy::disallowed_methods, reason = "a test's own files are no input of a plugin")]
    pub fn check(&self, name: &str) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, &self.text).unwrap();
            return;
        }
        let expected = std::fs::read_to_string(&path).unwrap_or_default();
        for (line, (got, expected)) in (1..).zip(self.text.lines().zip(expected.lines())) {
            assert_eq!(got, expected, "{name}, line {line}");
        }
        assert_eq!(self.text.lines().count(), expected.lines().count(), "{name}: number of lines");
    }
}
