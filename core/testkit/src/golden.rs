//! Golden traces: what a change does to numbers is read as a difference of `tests/golden/*.csv`.
//!
//! `UPDATE_GOLDEN=1 cargo nextest run -p …` writes them anew.

use std::fmt::Write as _;
use std::path::Path;

/// Rows of numbers under a header, as text: six digits after the point are far above the last bits of a double, so the
/// text is the same on every machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trace {
    text: String,
}

impl Trace {
    /// No rows yet.
    pub fn new(columns: &[&str]) -> Trace {
        Trace { text: format!("{}\n", columns.join(",")) }
    }

    /// Adds a row.
    pub fn row(&mut self, values: &[f64]) {
        // −0 and 0 are the same.
        let values: Vec<String> = values.iter().map(|value| format!("{:.6}", value + 0.0)).collect();
        let _ = writeln!(self.text, "{}", values.join(",").replace("-0.000000", "0.000000"));
    }

    /// Compares with the committed trace `tests/golden/<name>` of a package, or writes it where `UPDATE_GOLDEN` is set.
    /// `package` is the test's `env!("CARGO_MANIFEST_DIR")`.
    ///
    /// # Panics
    /// Where a line differs, or the file cannot be read or written.
    pub fn check(&self, package: &str, name: &str) {
        let path = Path::new(package).join("tests/golden").join(name);
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, &self.text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            return;
        }
        let expected =
            std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        for (line, (got, expected)) in (1..).zip(self.text.lines().zip(expected.lines())) {
            assert_eq!(got, expected, "{name}, line {line}");
        }
        assert_eq!(self.text.lines().count(), expected.lines().count(), "{name}: number of lines");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_have_six_digits_and_no_sign_at_zero() {
        let mut trace = Trace::new(&["a", "b"]);
        trace.row(&[1.0, -0.0]);
        trace.row(&[-1.5, -1e-9]);
        assert_eq!(trace.text, "a,b\n1.000000,0.000000\n-1.500000,0.000000\n");
    }

    #[test]
    #[should_panic(expected = "nowhere.csv")]
    fn a_trace_without_a_file_fails() {
        Trace::new(&["a"]).check(env!("CARGO_MANIFEST_DIR"), "nowhere.csv");
    }
}
