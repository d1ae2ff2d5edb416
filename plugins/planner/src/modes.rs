//! Custom behaviors of the waypoint follower, as a table in a file: when each begins and ends, and how the vehicle is
//! driven meanwhile.
//!
//! Albus 2006a, 5: the waypoint follower has custom modes for special situations, AGGRESSIVE, HILL CLIMB, NARROW
//! CORRIDOR, SLIPPING and REVERSE FROM BUMPER HIT, and a state table decides between them. The paper gives neither
//! the conditions nor the values; here they are in the file (`assets/modes/lagr.toml` is an example).
//!
//! # Format
//!
//! ```toml
//! format = 1
//!
//! [[mode]]
//! name = "REVERSE_FROM_BUMPER"
//! priority = 5                                    # of several that could begin, the highest does
//! enter = [{ signal = "bumper", at_least = 1.0 }] # begins when all of these hold
//! exit = [{ signal = "moved_m", at_least = 0.5 }] # ends when one of these holds
//! action = "REVERSE"                              # FOLLOW, if not given
//! max_speed_mps = 0.25
//! ```
//!
//! A condition names a signal and a bound, `at_least` or `at_most`, and can require that it holds for a time, `for_s`.
//! A mode of higher priority interrupts a mode of lower priority. A mode does not begin again before `pause_s` have
//! passed since its end. Without a mode, the vehicle is driven by the parameters of the process.

use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// What conditions compare: one number for each signal, in the order of [`Signal`].
pub type Signals = [f64; Signal::COUNT];

/// A quantity that conditions are about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// 1 while a switch of the bumper is pressed, else 0.
    Bumper,
    /// Share of the wheels' motion that the vehicle does not make, by the inertial sensors; 0 if unknown.
    Slip,
    /// The same over the last metres since the last change of mode; 0 if unknown.
    WaySlip,
    /// 1 while a motor draws a high current and its wheel hardly turns, else 0.
    Stalled,
    /// The greater of the motors' currents, A; 0 if unknown.
    MotorA,
    /// Upward slope of the ground under the vehicle along its heading, deg.
    ClimbDeg,
    /// Slope of the ground across the heading, deg, without sign.
    RollDeg,
    /// Distance from the side of the vehicle to the nearest obstacle on the map, m; at most the desired clearance
    /// (`costs.wish_clearance_m`), so a bound must be below that.
    RoomM,
    /// Time since there was a path that can be driven, s; 0 while there is one.
    BlockedS,
    /// Time since the planner of a larger map found a way to the goal, s; 0 while it finds one, or sends nothing.
    FarBlockedS,
    /// Time for which no arc has been free although there is a path, s; 0 while one is.
    NoArcS,
    /// Time for which the vehicle has been told to move and has hardly moved, s.
    StuckS,
    /// Time for which the vehicle has been told to move or to turn, and has stayed within a metre, s.
    StayedS,
    /// Distance from the place where the mode began, m.
    MovedM,
    /// Time since the mode began, s.
    ModeS,
}

impl Signal {
    /// Number of signals.
    pub const COUNT: usize = 15;

    /// Name in the file.
    pub fn name(self) -> &'static str {
        match self {
            Signal::Bumper => "bumper",
            Signal::Slip => "slip",
            Signal::WaySlip => "way_slip",
            Signal::Stalled => "stalled",
            Signal::MotorA => "motor_a",
            Signal::ClimbDeg => "climb_deg",
            Signal::RollDeg => "roll_deg",
            Signal::RoomM => "room_m",
            Signal::BlockedS => "blocked_s",
            Signal::FarBlockedS => "far_blocked_s",
            Signal::NoArcS => "no_arc_s",
            Signal::StuckS => "stuck_s",
            Signal::StayedS => "stayed_s",
            Signal::MovedM => "moved_m",
            Signal::ModeS => "mode_s",
        }
    }
}

/// A bound of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Condition {
    /// The signal.
    pub signal: Signal,
    /// It must not be lower.
    pub at_least: Option<f64>,
    /// It must not be higher.
    pub at_most: Option<f64>,
    /// Time for which this must have held, s, 0 to 600; default 0.
    #[serde(default)]
    pub for_s: f64,
}

impl Condition {
    fn holds(&self, signals: &Signals) -> bool {
        let value = signals[self.signal as usize];
        self.at_least.is_none_or(|least| value >= least) && self.at_most.is_none_or(|most| value <= most)
    }

    fn text(&self, signals: &Signals) -> String {
        let bound = match (self.at_least, self.at_most) {
            (Some(least), _) => format!("at least {least}"),
            (None, Some(most)) => format!("at most {most}"),
            (None, None) => "any".to_owned(),
        };
        format!("{} is {:.2}, {bound}", self.signal.name(), signals[self.signal as usize])
    }
}

/// How the vehicle is driven in a mode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Action {
    /// On the best arc.
    #[default]
    Follow,
    /// Backward, with `yaw_rate_radps` to a side that alternates from one time to the next.
    Reverse,
    /// Backward first, then at random speeds and turn rates, each for half a second.
    Shake,
}

/// Which obstacles count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Obstacles {
    /// Those of the map.
    #[default]
    Map,
    /// Those that the bumper hit.
    Bumper,
}

/// Which place a mode bars.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Bars {
    /// The ground ahead of the vehicle.
    #[default]
    Ahead,
    /// The turning point of the path, which the vehicle does not get to.
    Target,
}

/// What is driven to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Towards {
    /// The turning point of the path.
    #[default]
    Path,
    /// The goal, straight.
    Goal,
}

/// One row of the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mode {
    /// Name of its own, for status and events.
    pub name: String,
    /// Of several modes that could begin, that of the highest priority does.
    pub priority: i32,
    /// It begins when all of these hold; at least one.
    pub enter: Vec<Condition>,
    /// It ends when one of these holds; at least one.
    pub exit: Vec<Condition>,
    /// Time after its end during which it does not begin again, s, 0 to 600; default 0.
    #[serde(default)]
    pub pause_s: f64,
    /// How the vehicle is driven; default `FOLLOW`.
    #[serde(default)]
    pub action: Action,
    /// Which obstacles count; default `MAP`.
    #[serde(default)]
    pub obstacles: Obstacles,
    /// What is driven to; default `PATH`.
    #[serde(default)]
    pub towards: Towards,
    /// Greatest speed instead of that of the parameters, m/s, above 0 and at most 600.
    pub max_speed_mps: Option<f64>,
    /// Least speed instead of that of the parameters, m/s, above 0 and at most 600.
    pub min_speed_mps: Option<f64>,
    /// Turn rate of the actions `REVERSE` and `SHAKE`, rad/s; default 0.
    #[serde(default)]
    pub yaw_rate_radps: f64,
    /// Number of arcs per side instead of that of the parameters, 1 to 50.
    pub arcs_per_side: Option<u32>,
    /// Least free length of an arc instead of that of the parameters, m, above 0 and at most 600.
    pub least_free_m: Option<f64>,
    /// Radius of the place that is barred for the rest of the run when the mode begins, m, 0 to 600; default 0, for none.
    /// If it begins with slip, the ground ahead is barred in the next run, too.
    #[serde(default)]
    pub bars_m: f64,
    /// Which place that is; default `AHEAD`.
    #[serde(default)]
    pub bars: Bars,
}

impl Mode {
    /// Whether the place that it bars is one where the wheels slip.
    pub fn is_of_slip(&self) -> bool {
        let slips = |condition: &Condition| {
            matches!(condition.signal, Signal::Slip | Signal::WaySlip) && condition.at_least.is_some()
        };
        self.bars == Bars::Ahead && self.enter.iter().any(slips)
    }
}

/// The table.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Version of the format: 1.
    format: u32,
    /// The modes. Of several with the same priority, the first one counts.
    #[serde(default, rename = "mode")]
    pub modes: Vec<Mode>,
}

/// Why a file is no table.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TableError {
    /// The text is not TOML, or a key is missing or unknown.
    #[error("line {line}, {message}")]
    Toml {
        /// Line of the error, from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// The file has another version.
    #[error("format is {0}, expected 1")]
    Format(u32),
    /// A mode cannot work.
    #[error("mode {mode:?}: {message}")]
    Mode {
        /// Its name.
        mode: String,
        /// What was found and expected.
        message: String,
    },
}

impl Table {
    /// Parses a file.
    pub fn parse(text: &str) -> Result<Table, TableError> {
        let table: Table = toml::from_str(text).map_err(|error: toml::de::Error| {
            let start = error.span().map_or(0, |span| span.start);
            let line = 1 + text.bytes().take(start).filter(|&byte| byte == b'\n').count();
            TableError::Toml { line, message: error.message().trim().to_owned() }
        })?;
        if table.format != 1 {
            return Err(TableError::Format(table.format));
        }
        for (at, mode) in table.modes.iter().enumerate() {
            let refused = |message: String| Err(TableError::Mode { mode: mode.name.clone(), message });
            if mode.name.is_empty() || table.modes[..at].iter().any(|other| other.name == mode.name) {
                return refused("expected a name of its own".to_owned());
            }
            if mode.enter.is_empty() || mode.exit.is_empty() {
                return refused("expected at least one condition in enter and in exit".to_owned());
            }
            for condition in mode.enter.iter().chain(&mode.exit) {
                let bounds = [condition.at_least, condition.at_most];
                if bounds.iter().flatten().count() != 1
                    || bounds.iter().flatten().any(|bound| !bound.is_finite())
                {
                    let signal = condition.signal.name();
                    return refused(format!(
                        "{signal}: expected either at_least or at_most, a finite number"
                    ));
                }
                let for_s = condition.for_s;
                if !(0.0..=600.0).contains(&for_s) {
                    let signal = condition.signal.name();
                    return refused(format!("{signal}: for_s is {for_s}, expected 0 to 600"));
                }
            }
            let numbers = [mode.max_speed_mps, mode.min_speed_mps, mode.least_free_m];
            if numbers.into_iter().flatten().any(|number| !(number > 0.0 && number <= 600.0))
                || !mode.yaw_rate_radps.is_finite()
            {
                return refused("expected speeds and lengths above 0 and at most 600".to_owned());
            }
            for (key, value) in [("pause_s", mode.pause_s), ("bars_m", mode.bars_m)] {
                if !(0.0..=600.0).contains(&value) {
                    return refused(format!("{key} is {value}, expected 0 to 600"));
                }
            }
            if mode.arcs_per_side.is_some_and(|count| !(1..=50).contains(&count)) {
                return refused("arcs_per_side: expected 1 to 50".to_owned());
            }
        }
        Ok(table)
    }

    /// Refuses a bound of `room_m` that is not below `most_m`, the greatest value of that signal, m: such a condition
    /// holds always or never.
    pub fn check_room(&self, most_m: f64) -> Result<(), TableError> {
        for mode in &self.modes {
            let conditions = mode.enter.iter().chain(&mode.exit);
            let mut bounds = conditions
                .filter(|condition| condition.signal == Signal::RoomM)
                .filter_map(|condition| condition.at_least.or(condition.at_most));
            if let Some(bound_m) = bounds.find(|&bound_m| bound_m >= most_m) {
                let message = format!(
                    "room_m: the bound is {bound_m} m, expected less than the desired clearance \
                     (costs.wish_clearance_m), {most_m} m: the signal is never higher"
                );
                return Err(TableError::Mode { mode: mode.name.clone(), message });
            }
        }
        Ok(())
    }
}

/// A change of mode, and its reason.
#[derive(Clone, Debug, PartialEq)]
pub struct Transition {
    /// Name of the mode before; empty for none.
    pub from: String,
    /// Name of the mode after; empty for none.
    pub to: String,
    /// The conditions that held, with the values of their signals.
    pub reason: String,
}

/// Which mode is active.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Modes {
    /// Index in the table, and when it began.
    active: Option<(usize, Stamp)>,
    /// Since when each condition holds, by modes, conditions of enter and then of exit.
    since: Vec<Vec<Option<Stamp>>>,
    /// When each mode ended last.
    ended: Vec<Option<Stamp>>,
    /// Number of modes that have begun.
    begun: u32,
}

impl Modes {
    /// Index of the active mode in the table, and when it began.
    pub fn active(&self) -> Option<(usize, Stamp)> {
        self.active
    }

    /// Number of modes that have begun so far.
    pub fn begun(&self) -> u32 {
        self.begun
    }

    /// Forgets everything: no mode is active.
    pub fn clear(&mut self) {
        *self = Modes { begun: self.begun, ..Modes::default() };
    }

    /// How long conditions have held counts from a change of mode on: what one mode does, such as wheels that spin while it
    /// shakes the vehicle, does not begin the next one.
    fn watch_anew(&mut self) {
        self.since.iter_mut().flatten().for_each(|since| *since = None);
    }

    /// Decides which mode is active from now on. At most one transition happens in a cycle.
    pub fn step(&mut self, table: &Table, signals: &Signals, now: Stamp) -> Option<Transition> {
        let conditions = table.modes.iter().map(|mode| mode.enter.len() + mode.exit.len());
        if !self.since.iter().map(Vec::len).eq(conditions) {
            self.clear();
            self.since =
                table.modes.iter().map(|mode| vec![None; mode.enter.len() + mode.exit.len()]).collect();
            self.ended = vec![None; table.modes.len()];
        }
        let active = self.active.map(|(at, _)| at);
        for (at, (mode, since)) in table.modes.iter().zip(&mut self.since).enumerate() {
            for (number, (condition, since)) in mode.enter.iter().chain(&mode.exit).zip(since).enumerate() {
                // How long an exit condition has held counts from the beginning of the mode.
                let watched = number < mode.enter.len() || active == Some(at);
                *since = (watched && condition.holds(signals)).then(|| since.unwrap_or(now));
            }
        }
        let held = |condition: &Condition, since: Option<Stamp>| {
            since.is_some_and(|since| now.seconds_since(since) >= condition.for_s)
        };
        let priority = active.map(|at| table.modes[at].priority);
        let begins = |&at: &usize| {
            let mode = &table.modes[at];
            let rested = self.ended[at].is_none_or(|end| now.seconds_since(end) >= mode.pause_s);
            let all =
                mode.enter.iter().zip(&self.since[at]).all(|(condition, since)| held(condition, *since));
            Some(at) != active && rested && all && priority.is_none_or(|priority| mode.priority > priority)
        };
        let next = (0..table.modes.len()).filter(begins).reduce(|best, other| {
            if table.modes[other].priority > table.modes[best].priority { other } else { best }
        });
        let name = |at: Option<usize>| at.map_or(String::new(), |at| table.modes[at].name.clone());
        if let Some(next) = next {
            let reasons = table.modes[next].enter.iter().map(|condition| condition.text(signals));
            let reason = reasons.collect::<Vec<_>>().join(" and ");
            if let Some(before) = active {
                self.ended[before] = Some(now);
            }
            self.active = Some((next, now));
            self.begun = self.begun.wrapping_add(1);
            self.watch_anew();
            return Some(Transition { from: name(active), to: name(Some(next)), reason });
        }
        let mode = &table.modes[active?];
        let exits = mode.exit.iter().zip(&self.since[active?][mode.enter.len()..]);
        let (condition, _) = exits.into_iter().find(|(condition, since)| held(condition, **since))?;
        let reason = condition.text(signals);
        self.ended[active?] = Some(now);
        self.active = None;
        self.watch_anew();
        Some(Transition { from: name(active), to: String::new(), reason })
    }
}

#[cfg(test)]
#[path = "modes_tests.rs"]
mod tests;
