//! The colour of a box, and of the line to its supervisor (Albus 2006a, figure 15).

use crate::process_state::{NOT_RECORDED, state_color, state_name, status_limit_s};
use egui::{Color32, Stroke};
use ocu_ui::stale::LEAST_S;
use ocu_ui::{Tokens, format};
use rcs_msg::rcs::{ProcessInfo, ProcessState, Status};

/// How long a light fades, in seconds of source time.
pub(super) const MOMENT_S: f64 = 0.5;
/// After this many of its limits without a status a process does not run.
const GONE: f64 = 10.0;

/// Appearance of a box: its colour and its word.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Look {
    pub(super) fill: Color32,
    pub(super) word: String,
}

/// What the look of a process depends on.
#[derive(Clone, Copy, Debug)]
pub(super) struct State<'a> {
    /// `None` if nothing describes it.
    pub(super) process: Option<&'a ProcessInfo>,
    /// Its newest status.
    pub(super) status: Option<&'a Status>,
    /// Age of the status, s.
    pub(super) age_s: Option<f64>,
    /// Whether its buffers and its supervisor are there.
    pub(super) connected: bool,
    /// Whether its status may be absent because it was not recorded yet.
    pub(super) is_before_recording: bool,
}

/// The look of a process.
pub(super) fn look(state: State<'_>) -> Look {
    let rgb = Color32::from_rgb;
    let pink = state_color(ProcessState::Uninitialized);
    let limit_s = state.process.map_or(LEAST_S, status_limit_s);
    let (fill, word) = match (state.connected, state.status, state.age_s) {
        (false, ..) => (rgb(150, 156, 160), "NOT CONNECTED".to_owned()),
        (_, Some(_), Some(age_s)) if age_s > GONE * limit_s => {
            (pink, format!("NOT RUNNING {}", format::age(age_s)))
        }
        (_, Some(_), Some(age_s)) if age_s > limit_s => {
            (rgb(236, 200, 66), format!("NO STATUS {}", format::age(age_s)))
        }
        (_, Some(status), _) => (state_color(status.state()), state_name(status.state()).to_owned()),
        (_, None, _) if state.process.is_none() => (rgb(186, 194, 199), String::new()),
        (_, None, _) if state.is_before_recording => (rgb(186, 194, 199), NOT_RECORDED.to_owned()),
        (_, None, _) => (pink, "NOT RUNNING".to_owned()),
    };
    Look { fill, word }
}

/// The line to the supervisor, by the ages of the last command down and of the last status up: red and white lights that
/// fade; red wins.
pub(super) fn light(tokens: &Tokens, command_age_s: Option<f64>, status_age_s: Option<f64>) -> Stroke {
    let strength = |age_s: Option<f64>| {
        let age_s = age_s.filter(|age_s| (0.0..MOMENT_S).contains(age_s))?;
        Some((1.0 - age_s / MOMENT_S) as f32)
    };
    let dark = tokens.unknown.gamma_multiply(0.8);
    match (strength(command_age_s), strength(status_age_s)) {
        (Some(strength), _) => Stroke::new(1.5 + strength, dark.lerp_to_gamma(tokens.error, strength)),
        (None, Some(strength)) => Stroke::new(1.5, dark.lerp_to_gamma(tokens.strong, strength)),
        (None, None) => Stroke::new(1.5, dark),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::Theme;

    fn process(period_ns: u64) -> ProcessInfo {
        ProcessInfo { period_ns, ..ProcessInfo::default() }
    }

    fn word(period_ns: u64, state: Option<ProcessState>, age_s: f64, connected: bool) -> String {
        let (process, status) =
            (process(period_ns), state.map(|state| Status { state: state.into(), ..Status::default() }));
        let age_s = state.map(|_| age_s);
        let (process, status) = (Some(&process), status.as_ref());
        look(State { process, status, age_s, connected, is_before_recording: false }).word
    }

    #[test]
    fn a_process_whose_status_was_not_recorded_yet_is_not_said_not_to_run() {
        let (process, status) = (process(100_000_000), Status::default());
        let absent = State {
            process: Some(&process),
            status: None,
            age_s: None,
            connected: true,
            is_before_recording: true,
        };
        assert_eq!(look(absent).word, NOT_RECORDED);
        let known = State { status: Some(&status), age_s: Some(0.1), ..absent };
        assert_eq!(look(known).word, state_name(status.state()));
    }

    #[test]
    fn every_state_has_a_word_and_a_colour_of_its_own() {
        let states =
            [ProcessState::Uninitialized, ProcessState::Exec, ProcessState::Done, ProcessState::Error];
        let mut words: Vec<String> =
            states.iter().map(|&state| word(100_000_000, Some(state), 0.1, true)).collect();
        words.push(word(100_000_000, None, 0.0, true));
        words.push(word(100_000_000, None, 0.0, false));
        words.push(word(100_000_000, Some(ProcessState::Exec), 0.5, true));
        assert_eq!(words.last().map(String::as_str), Some("NO STATUS 0.5 s"));
        words.sort();
        words.dedup();
        assert_eq!(words.len(), 7);
    }

    #[test]
    fn a_status_is_late_at_the_limit_of_its_own_period() {
        for (period_s, limit_s) in [(0.02, 0.16), (0.1, 0.4), (1.0, 3.1)] {
            let period_ns = (period_s * 1e9) as u64;
            let at = |age_s: f64| word(period_ns, Some(ProcessState::Exec), age_s, true);
            assert_eq!(at(limit_s - 0.01), "EXEC", "{period_s}");
            assert!(at(limit_s + 0.01).starts_with("NO STATUS"), "{period_s}");
            assert!(at(10.0 * limit_s + 0.1).starts_with("NOT RUNNING"), "{period_s}");
        }
    }

    #[test]
    fn lights_fade_and_a_command_wins_over_a_status() {
        let tokens = ocu_ui::tokens_of(Theme::Dark);
        let dark = light(tokens, None, None);
        let [fresh, half, gone] = [0.0, 0.25, 0.6].map(|age_s| light(tokens, Some(age_s), Some(0.0)));
        assert_eq!(fresh.color, tokens.error);
        assert!(half.color != fresh.color && half.color != dark.color);
        assert_eq!(gone.color, tokens.strong, "only the status is left");
        assert_eq!(light(tokens, None, Some(0.5)), dark);
        assert_eq!(light(tokens, Some(-1.0), None), dark, "a message from the future");
    }
}
