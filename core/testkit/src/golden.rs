//! Golden traces: numbers in `tests/golden/*.csv`, so that a change of results is reviewed as a diff.
//!
//! `just golden` rewrites them by setting `UPDATE_GOLDEN=1`.

use std::fmt::Write as _;
use std::path::Path;

/// Rows of numbers under a header, as text. The few printed digits are far above the last bits of a double, so that the
/// text is the same on every machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trace {
    text: String,
    digits: usize,
}

impl Trace {
    /// A trace without rows; six decimals.
    pub fn new(columns: &[&str]) -> Trace {
        Trace::with_digits(columns, 6)
    }

    /// A trace without rows; with the given number of decimals, and none for whole numbers if they are fewer than six.
    pub fn with_digits(columns: &[&str], digits: usize) -> Trace {
        Trace { text: format!("{}\n", columns.join(",")), digits }
    }

    /// Adds a row. NaN is written as an empty field.
    pub fn row(&mut self, values: &[f64]) {
        let values: Vec<String> = values.iter().map(|&value| self.number(value)).collect();
        let _ = writeln!(self.text, "{}", values.join(","));
    }

    fn number(&self, value: f64) -> String {
        if value.is_nan() {
            return String::new();
        }
        if self.digits < 6 && value == value.trunc() {
            return format!("{:.0}", value + 0.0);
        }
        let text = format!("{value:.*}", self.digits);
        // −0 is written as 0.
        let is_zero = text.bytes().all(|byte| b"-0.".contains(&byte));
        if is_zero { text.trim_start_matches('-').to_owned() } else { text }
    }

    /// Compares with the committed trace `tests/golden/<name>` of a package, or writes it if `UPDATE_GOLDEN` is set.
    /// `package` is the test's `env!("CARGO_MANIFEST_DIR")`.
    ///
    /// # Panics
    /// If a line differs, or the file cannot be read or written.
    pub fn check(&self, package: &str, name: &str) {
        if let Some(difference) = self.differs(package, name) {
            panic!("{difference}");
        }
    }

    /// The first line that differs from the committed trace, or why there is no trace to compare with; `None` if they
    /// are equal. Writes the trace instead if `UPDATE_GOLDEN` is set.
    pub fn differs(&self, package: &str, name: &str) -> Option<String> {
        let path = Path::new(package).join("tests/golden").join(name);
        if std::env::var_os("UPDATE_GOLDEN").is_none() {
            return self.differs_from_file(&path);
        }
        let folder = path.parent().map_or(Ok(()), std::fs::create_dir_all);
        let written = folder.and_then(|()| std::fs::write(&path, &self.text));
        written.err().map(|error| format!("{}: {error}", path.display()))
    }

    fn differs_from_file(&self, path: &Path) -> Option<String> {
        let name = path.display();
        let expected = match std::fs::read_to_string(path) {
            Ok(expected) => expected,
            Err(error) => return Some(format!("{name}: {error}")),
        };
        let lines = (1..).zip(self.text.lines().zip(expected.lines()));
        if let Some((line, (got, expected))) = lines.into_iter().find(|(_, (got, expected))| got != expected)
        {
            return Some(format!("{name}, line {line}:\n  got      {got}\n  expected {expected}"));
        }
        let [got, expected] = [&self.text, &expected].map(|text| text.lines().count());
        (got != expected).then(|| format!("{name}: {got} lines, expected {expected}"))
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
    fn with_fewer_digits_whole_numbers_have_none_and_what_is_no_number_is_empty() {
        let mut trace = Trace::with_digits(&["a", "b", "c", "d"], 3);
        trace.row(&[12.0, -0.0001, f64::NAN, 0.5]);
        assert_eq!(trace.text, "a,b,c,d\n12,0.000,,0.500\n");
    }

    #[test]
    fn a_trace_without_a_file_differs() {
        let difference = Trace::new(&["a"]).differs_from_file(Path::new("tests/golden/nowhere.csv"));
        assert!(difference.is_some_and(|difference| difference.contains("nowhere.csv")));
    }
}
