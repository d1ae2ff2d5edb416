//! Evaluates the planner's search on the maps and scenarios of MovingAI (Sturtevant 2012): lengths of paths against the
//! optimal ones, and times.
//!
//! A step to a neighbour costs 1, a diagonal one √2 and only where both cells beside it are free, as the optimal lengths
//! of the scenarios assume.

mod files;

use crate::EvalError;
use files::{Scenario, read_map, read_scenarios};
use rcs_planner::costs::{BLOCKED, CostGrid};
use rcs_planner::search::{NoPath, Path as Found, STRAIGHT, Search};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// What is evaluated.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The map, a `.map` file.
    pub map: &'a Path,
    /// Its scenarios, a `.scen` file.
    pub scenarios: &'a Path,
}

/// The figures, in the order in which they are printed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Number of scenarios for which a path was found.
    pub solved: usize,
    /// Greatest ratio of the length found to the optimal one; `None` (null in JSON) if no path was found.
    pub cost_ratio_max: Option<f64>,
    /// Median time of a search, ms.
    pub ms_median: f64,
    /// Longest time of a search, ms.
    pub ms_max: f64,
    /// Number of scenarios.
    pub scenarios: usize,
    /// Lowest ratio: below 1 by more than the rounding of the file, a path is not a valid one.
    pub cost_ratio_min: Option<f64>,
    /// Greatest difference from the optimal length, cells.
    pub cost_error_max: Option<f64>,
}

/// Searches a path for every scenario, once.
pub fn measure(job: &Job<'_>) -> Result<Report, EvalError> {
    let map = read_map(job.map)?;
    let scenarios = read_scenarios(job.scenarios, &map)?;
    if let Some(blocked) = blocked(&map, &scenarios) {
        tracing::warn!("{}, {blocked}", job.scenarios.display());
    }
    let mut search = Search::default();
    let mut found = Found::default();
    let mut times_ms = Vec::with_capacity(scenarios.len());
    let mut lengths = Vec::with_capacity(scenarios.len());
    // The first search allocates the memory that all others use.
    let _ = find(&mut search, &map, &scenarios[0], &mut found);
    for scenario in &scenarios {
        let start = Instant::now();
        let result = find(&mut search, &map, scenario, &mut found);
        times_ms.push(start.elapsed().as_secs_f64() * 1e3);
        let is_solved = is_solved(result, job.scenarios, scenario.line)?;
        lengths.push(is_solved.then_some((found.cost, scenario.optimal)));
    }
    times_ms.sort_by(f64::total_cmp);
    let solved = || lengths.iter().flatten();
    let ratios = || solved().map(|&(length, optimal)| ratio(length, optimal));
    Ok(Report {
        solved: solved().count(),
        cost_ratio_max: ratios().reduce(f64::max),
        ms_median: times_ms[times_ms.len() / 2],
        ms_max: times_ms[times_ms.len() - 1],
        scenarios: scenarios.len(),
        cost_ratio_min: ratios().reduce(f64::min),
        cost_error_max: solved().map(|(length, optimal)| (length - optimal).abs()).reduce(f64::max),
    })
}

/// What is said of scenarios whose start or goal is blocked, which no path solves: those of another map have such.
fn blocked(map: &CostGrid, scenarios: &[Scenario]) -> Option<String> {
    let is_blocked = |place| map.get(place) == Some(BLOCKED);
    let mut ends = scenarios.iter().filter_map(|scenario| {
        let ends = [("start", scenario.start), ("goal", scenario.goal)];
        let (name, place) = ends.into_iter().find(|&(_, place)| is_blocked(place))?;
        Some((scenario.line, name, place))
    });
    let (line, name, place) = ends.next()?;
    let (count, all) = (1 + ends.count(), scenarios.len());
    Some(format!(
        "line {line}: {name} ({}, {}) is blocked; {count} of {all} scenarios have a blocked start or goal, as those of \
         another map would",
        place.column, place.row
    ))
}

fn find(search: &mut Search, map: &CostGrid, scenario: &Scenario, found: &mut Found) -> Result<(), NoPath> {
    // The start of a scenario must be free like every other cell of its path.
    if map.get(scenario.start) == Some(BLOCKED) {
        return Err(NoPath::NotConnected);
    }
    search.path(map, scenario.start, scenario.goal, 1, found)
}

/// Whether a search found a path for the scenario of this line; an error where it ended before it knew.
fn is_solved(result: Result<(), NoPath>, file: &Path, line: usize) -> Result<bool, EvalError> {
    match result {
        Ok(()) => Ok(true),
        Err(NoPath::TooDear) => Err(EvalError::refused(format!(
            "{}, line {line}: no path of up to about {} cells leads to the goal, and longer ones cannot be searched; \
             expected a scenario with a shorter one",
            file.display(),
            u32::MAX / STRAIGHT
        ))),
        Err(_) => Ok(false),
    }
}

/// Ratio of the lengths; a path from a cell to itself has none, and counts as 1.
fn ratio(length: f64, optimal: f64) -> f64 {
    if length == optimal { 1.0 } else { length / optimal }
}

#[cfg(test)]
#[path = "plan_tests.rs"]
mod tests;
