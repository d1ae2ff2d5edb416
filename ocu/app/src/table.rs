//! Text tables with aligned columns.

use crate::plain::plain;
use std::io::{self, Write};

/// Alignment of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Align {
    /// Left, for text.
    Left,
    /// Right, for numbers.
    Right,
}

/// A table with a header row.
#[derive(Debug)]
pub(crate) struct Table {
    columns: Vec<(&'static str, Align)>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with these columns.
    pub(crate) fn new(columns: &[(&'static str, Align)]) -> Self {
        Self { columns: columns.to_vec(), rows: Vec::new() }
    }

    /// Appends a row; missing cells are empty, and control characters are escaped.
    pub(crate) fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().map(|cell| plain(&cell)).collect());
    }

    /// Writes the table with two spaces between columns and no trailing spaces; writes nothing without rows.
    pub(crate) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        if self.rows.is_empty() {
            return Ok(());
        }
        let heading: Vec<String> = self.columns.iter().map(|(name, _)| (*name).to_owned()).collect();
        let lines: Vec<&Vec<String>> = std::iter::once(&heading).chain(&self.rows).collect();
        let cell = |line: &[String], index: usize| line.get(index).cloned().unwrap_or_default();
        let width =
            |index: usize| lines.iter().map(|line| cell(line, index).chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        for line in &lines {
            let cells = self.columns.iter().zip(&widths).enumerate().map(|(index, ((_, align), &width))| {
                let text = cell(line, index);
                if *align == Align::Right { format!("{text:>width$}") } else { format!("{text:<width$}") }
            });
            writeln!(out, "{}", cells.collect::<Vec<_>>().join("  ").trim_end())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_lines_have_no_trailing_space() {
        let mut table =
            Table::new(&[("topic", Align::Left), ("messages", Align::Right), ("note", Align::Left)]);
        table.row(["/imu", "16806"].map(str::to_owned));
        table.row(["/gps/fix", "7", "x"].map(str::to_owned));
        let mut out = Vec::new();
        table.write(&mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        assert_eq!(text, "topic     messages  note\n/imu         16806\n/gps/fix         7  x\n");
    }
}
