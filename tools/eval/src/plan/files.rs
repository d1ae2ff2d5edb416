//! Readers of MovingAI's files: maps (`.map`) and scenarios (`.scen`).

use crate::EvalError;
use rcs_planner::costs::{BLOCKED, CostGrid, MAX_SIDE};
use rcs_planner::search::Place;
use std::path::Path;
use std::str::FromStr;

/// A path to find.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scenario {
    /// Its line in the file, from 1.
    pub(super) line: usize,
    pub(super) start: Place,
    pub(super) goal: Place,
    /// Length of the shortest path, cells.
    pub(super) optimal: f64,
}

/// A file with the place in it, for errors.
struct Lines<'a> {
    path: &'a Path,
    text: &'a str,
}

impl<'a> Lines<'a> {
    /// The lines with their numbers, without what ends them.
    fn iter(&self) -> impl Iterator<Item = (usize, &'a str)> + use<'a> {
        (1..).zip(self.text.lines().map(|line| line.trim_end_matches('\r')))
    }

    fn error(&self, line: usize, what: &str) -> EvalError {
        EvalError::refused(format!("{}, line {line}: {what}", self.path.display()))
    }

    /// The error for a file that ends too early.
    fn ends(&self, expected: &str) -> EvalError {
        let last = self.text.lines().count();
        self.error(last.max(1), &format!("the file ends here, expected {expected}"))
    }
}

fn read(path: &Path) -> Result<String, EvalError> {
    let bytes = std::fs::read(path).map_err(|error| EvalError::read(path, error))?;
    String::from_utf8(bytes).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = valid.split(|&byte| byte == b'\n').count();
        EvalError::refused(format!("{}, line {line}: not text, expected a file of MovingAI", path.display()))
    })
}

/// A map: free cells cost 1. Row 0 is the first line.
pub(super) fn read_map(path: &Path) -> Result<CostGrid, EvalError> {
    let text = read(path)?;
    let file = Lines { path, text: &text };
    let mut lines = file.iter();
    let (mut width, mut height) = (None, None);
    loop {
        let Some((number, line)) = lines.next() else { return Err(file.ends("a line \"map\"")) };
        let mut words = line.split_whitespace();
        match (words.next(), words.next()) {
            (Some("type"), Some("octile")) | (None, _) => {}
            (Some(name @ ("width" | "height")), Some(value)) => {
                let known = if name == "width" { &mut width } else { &mut height };
                if known.replace(side(&file, number, name, value)?).is_some() {
                    return Err(file.error(number, &format!("{name} is given again, expected it once")));
                }
            }
            (Some("map"), None) => break,
            _ => {
                let expected = "\"type octile\", \"height <rows>\", \"width <columns>\" or \"map\"";
                return Err(file.error(number, &format!("got {:?}, expected {expected}", shown(line))));
            }
        }
    }
    let (Some(width), Some(height)) = (width, height) else {
        let lacking = if width.is_none() { "width" } else { "height" };
        return Err(
            file.error(1, &format!("the head of the file has no {lacking}, expected \"{lacking} <number>\""))
        );
    };
    let mut cells = Vec::with_capacity(width * height);
    for row in 0..height {
        let Some((number, line)) = lines.next() else {
            return Err(file.ends(&format!("{height} rows of cells, got {row}")));
        };
        let line = line.trim_end();
        let count = line.chars().count();
        if count != width {
            return Err(file.error(number, &format!("row {row} has {count} cells, expected {width}")));
        }
        for (column, cell) in line.chars().enumerate() {
            cells.push(match cell {
                '.' | 'G' | 'S' => 1,
                '@' | 'O' | 'T' | 'W' => BLOCKED,
                _ => {
                    let expected = "free . G S, or blocked @ O T W";
                    let what = format!("cell {column} of row {row} is {cell:?}, expected {expected}");
                    return Err(file.error(number, &what));
                }
            });
        }
    }
    if let Some((number, line)) = lines.find(|(_, line)| !line.trim().is_empty()) {
        return Err(file.error(number, &format!("got {:?} after the {height} rows of the map", shown(line))));
    }
    CostGrid::new(width, height, cells).map_err(|error| file.error(1, &error.to_string()))
}

fn side(file: &Lines<'_>, number: usize, name: &str, value: &str) -> Result<usize, EvalError> {
    let side = value.parse().ok().filter(|side| (1..=MAX_SIDE).contains(side));
    let what = || format!("{name} is {:?}, expected a whole number from 1 to {MAX_SIDE}", shown(value));
    side.ok_or_else(|| file.error(number, &what()))
}

/// The scenarios of a map, at least one.
pub(super) fn read_scenarios(path: &Path, map: &CostGrid) -> Result<Vec<Scenario>, EvalError> {
    let text = read(path)?;
    let file = Lines { path, text: &text };
    let mut scenarios = Vec::new();
    let filled = file.iter().filter(|(_, line)| !line.trim().is_empty());
    for (index, (number, line)) in filled.enumerate() {
        let Some(version) = line.trim().strip_prefix("version") else {
            scenarios.push(scenario(&file, number, line, map)?);
            continue;
        };
        let is_known = version.trim().parse() == Ok(1.0);
        let expected = match (index, is_known) {
            (0, true) => continue,
            (0, false) => "\"version 1\"",
            _ => "the version once, on the first line",
        };
        return Err(file.error(number, &format!("got {:?}, expected {expected}", shown(line))));
    }
    if scenarios.is_empty() {
        return Err(file.ends("a scenario"));
    }
    Ok(scenarios)
}

/// The columns after the name of the map, which may contain spaces where columns are separated by tabs.
const COLUMNS: [&str; 7] =
    ["map width", "map height", "start x", "start y", "goal x", "goal y", "optimal length"];

fn scenario(file: &Lines<'_>, number: usize, line: &str, map: &CostGrid) -> Result<Scenario, EvalError> {
    let columns = columns_of(line);
    if columns.len() != 2 + COLUMNS.len() {
        let what = format!("has {} columns, expected 9: bucket, map, {}", columns.len(), COLUMNS.join(", "));
        return Err(file.error(number, &what));
    }
    let field = |column: usize| columns[2 + column];
    let expected = format!("a whole number up to {}", i32::MAX);
    let whole = |column: usize| number_of::<i32>(file, number, COLUMNS[column], field(column), &expected);
    let size = [whole(0)?, whole(1)?];
    let got = [map.columns() as i32, map.rows() as i32];
    if size != got {
        let what = format!(
            "the scenario is for a map of {}x{} cells, expected one for {}x{}",
            size[0], size[1], got[0], got[1]
        );
        return Err(file.error(number, &what));
    }
    let place = |what: &str, column: usize| -> Result<Place, EvalError> {
        let place = Place::new(whole(column)?, whole(column + 1)?);
        let told = || {
            let ends = [got[0] - 1, got[1] - 1];
            format!(
                "{what} is ({}, {}), expected columns 0 to {} and rows 0 to {}",
                place.column, place.row, ends[0], ends[1]
            )
        };
        if map.contains(place) { Ok(place) } else { Err(file.error(number, &told())) }
    };
    let (start, goal) = (place("start", 2)?, place("goal", 4)?);
    let optimal: f64 = number_of(file, number, COLUMNS[6], field(6), "a number")?;
    // Without anything in the way. A file rounds lengths to eight places.
    let apart = [(start.column - goal.column).abs(), (start.row - goal.row).abs()].map(f64::from);
    let diagonal = apart[0].min(apart[1]);
    let least = apart[0].max(apart[1]) + diagonal * (std::f64::consts::SQRT_2 - 1.0);
    if !optimal.is_finite() || optimal < least * (1.0 - 1e-3) {
        let what = format!("optimal length is {:?}, expected a finite number from {least:.8} up", field(6));
        return Err(file.error(number, &what));
    }
    Ok(Scenario { line: number, start, goal, optimal })
}

/// The columns of a line, which are separated by tabs; where it has none, by spaces.
fn columns_of(line: &str) -> Vec<&str> {
    if !line.contains('\t') {
        return line.split_whitespace().collect();
    }
    line.split('\t').map(str::trim).filter(|column| !column.is_empty()).collect()
}

fn number_of<T: FromStr>(
    file: &Lines<'_>,
    number: usize,
    name: &str,
    word: &str,
    expected: &str,
) -> Result<T, EvalError> {
    let what = || format!("{name} is {:?}, expected {expected}", shown(word));
    word.parse().map_err(|_| file.error(number, &what()))
}

/// The beginning of a text, for errors.
fn shown(text: &str) -> String {
    text.chars().take(40).collect()
}
