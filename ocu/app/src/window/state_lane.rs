//! The states of the selected process over time, as a lane of the timeline.

use super::scale::Scale;
use egui::{Rect, Ui};
use ocu_ui::{format, tokens};
use ocu_views::process_state::{state_color, state_name, status_limit_s};
use rcs_formula::FieldRef;
use rcs_msg::Stamp;
use rcs_msg::rcs::{ProcessInfo, ProcessState};
use rcs_runtime::source::{FieldSeries, Frame, RunTag, moments};

/// Height of the lane, with the room above it.
pub(super) const HEIGHT: f32 = 9.0;
const MARGIN: f32 = 2.0;
/// Width of the steps in which states are searched. A step has the gravest state that occurs in it.
const STEP: f32 = 2.0;

/// The field with the state of a process; `None` if the process has no status.
pub(super) fn field(frame: &Frame, process: &str) -> Option<FieldRef> {
    let info = frame.processes.iter().find(|info| info.name == process)?;
    frame.topic(&info.status_buffer)?;
    Some(FieldRef { topic: info.status_buffer.clone(), path: "state".parse().ok()? })
}

/// What the lane shows.
pub(super) struct States<'a> {
    process: &'a ProcessInfo,
    series: &'a FieldSeries,
    /// The age from which a status is outdated, s. A recording may have fewer statuses than there were.
    limit_s: f64,
    /// The time before which a status may be absent because it was not recorded yet.
    recorded_from: Stamp,
}

impl<'a> States<'a> {
    /// The states of a process as far as they are known.
    pub(super) fn of(frame: &'a Frame, process: &str) -> Option<Self> {
        let info = frame.processes.iter().find(|info| info.name == process)?;
        let series = frame.field(&field(frame, process)?, RunTag::Run(frame.runs.current()))?;
        let (first, last) = (series.points.get(0)?, series.points.last()?);
        let spacing_s = last.stamp.seconds_since(first.stamp) / series.points.len() as f64;
        let limit_s = status_limit_s(info).max(3.0 * spacing_s);
        let recorded_from = frame.recorded_from().unwrap_or_default();
        Some(Self { process: info, series, limit_s, recorded_from })
    }

    /// The state from `from` until before `to`: the gravest of the statuses in between, else that of the last one while it
    /// is valid.
    fn state(&self, from: Stamp, to: Stamp) -> Option<ProcessState> {
        let points = &self.series.points;
        self.state_of(from, [points.count_before(from), points.count_before(to)])
    }

    /// The same where the indices of the statuses in between are known.
    fn state_of(&self, from: Stamp, [first, last]: [usize; 2]) -> Option<ProcessState> {
        let points = &self.series.points;
        let value = if first < last {
            moments(points, first..last)?.max
        } else {
            // What comes after the last status is not known yet.
            let before = points.get(first.checked_sub(1)?).filter(|_| first < points.len())?;
            (from.seconds_since(before.stamp) <= self.limit_s).then_some(before.value)?
        };
        ProcessState::try_from(value as i32).ok()
    }

    /// The state from `from` until before `to` in words.
    fn word(&self, from: Stamp, to: Stamp) -> &'static str {
        let absent = if from < self.recorded_from { "not recorded yet" } else { "no status" };
        self.state(from, to).map_or(absent, state_name)
    }

    /// Paints the lane. Returns what is under the pointer, for a tooltip.
    pub(super) fn paint(&self, ui: &Ui, rect: Rect, scale: &Scale) -> Option<String> {
        let painter = ui.painter_at(rect);
        let lane = rect.with_min_y(rect.top() + MARGIN);
        painter.rect_filled(lane, 0.0, tokens(ui).surface[0]);
        let steps = (lane.width() / STEP).ceil() as usize;
        let x = |step: usize| lane.left() + step as f32 * STEP;
        let mut begun: (usize, Option<ProcessState>) = (0, None);
        let mut first = self.series.points.count_before(scale.stamp(x(0)));
        for step in 0..=steps {
            let last = self.series.points.count_before(scale.stamp(x(step + 1)));
            let now = if step < steps { self.state_of(scale.stamp(x(step)), [first, last]) } else { None };
            first = last;
            if now == begun.1 {
                continue;
            }
            if let Some(state) = begun.1 {
                let part = Rect::from_x_y_ranges(x(begun.0)..=x(step), lane.y_range());
                painter.rect_filled(part, 0.0, state_color(state));
            }
            begun = (step, now);
        }
        let pointer = ui.input(|input| input.pointer.hover_pos()).filter(|at| rect.contains(*at))?;
        let at = scale.stamp(pointer.x);
        let state = self.word(at, scale.stamp(pointer.x + STEP));
        Some(format!("{}  {}: {state}", format::elapsed(at.seconds_since(scale.origin())), self.process.name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_formula::Points;
    use rcs_runtime::source::series_of;

    #[test]
    fn a_step_has_its_gravest_state_and_none_where_there_was_no_status() {
        let at = |ms: u64| Stamp(ms * 1_000_000);
        // EXEC for a second, with one ERROR at 0.5 s; one more status at 3 s.
        let stamps: Vec<Stamp> = (0..=100).map(|i| at(i * 10)).chain([at(3000)]).collect();
        let values: Vec<f64> = (0..=101).map(|i| if i == 50 { 3.0 } else { 1.0 }).collect();
        let process = ProcessInfo { name: "a".into(), period_ns: 10_000_000, ..ProcessInfo::default() };
        let series = FieldSeries {
            field: FieldRef { topic: "/a/status".into(), path: "state".parse().unwrap() },
            run: RunTag::Recorded,
            points: series_of(&Points::new(stamps, values)),
            names: Points::default().names,
            states: Points::default().states,
            reading: None,
            problem: None,
        };
        let limit_s = status_limit_s(&process);
        let states = States { process: &process, series: &series, limit_s, recorded_from: at(1250) };
        let state = |from: u64, to: u64| states.state(at(from), at(to));
        assert_eq!(state(0, 100), Some(ProcessState::Exec));
        assert_eq!(state(400, 600), Some(ProcessState::Error));
        assert_eq!(state(503, 506), Some(ProcessState::Error), "until the next status");
        assert_eq!(state(510, 600), Some(ProcessState::Exec));
        assert_eq!(state(203, 204), Some(ProcessState::Exec), "between two statuses");
        assert_eq!(state(1100, 1101), Some(ProcessState::Exec), "a status is valid for a while");
        assert_eq!(state(1200, 1300), None);
        assert_eq!(state(2990, 3010), Some(ProcessState::Exec));
        assert_eq!(state(3001, 3002), None, "after the last one");
        let word = |from: u64| states.word(at(from), at(from + 1));
        assert_eq!([1100, 1249, 1250].map(word), ["EXEC", "not recorded yet", "no status"]);
    }
}
