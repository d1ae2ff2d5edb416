//! The controls of time above the timeline: play, steps, speed, and the clock.

use super::bookmarks::Bookmarks;
use crate::time::date_and_time;
use egui::PopupCloseBehavior;
use ocu_ui::bar::{self, Bar, Choice, Fit, Form};
use ocu_ui::{format, icons, tokens, typing, widgets};
use rcs_runtime::source::{Control, Frame, Step};

/// Selectable playback speeds.
const SPEEDS: [f64; 10] = [0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0, f64::INFINITY];
/// Least width of the list of step units, and most height of what scrolls below its field, points.
const UNITS_WIDTH: f32 = 220.0;
const UNITS_HEIGHT: f32 = 320.0;

/// Unit of a step.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Unit {
    /// A message of this topic, or of any.
    Message(Option<String>),
    /// A cycle of this process, or of any.
    Cycle(Option<String>),
    /// A time in milliseconds.
    Time(i64),
}

impl Unit {
    pub(super) fn step(&self, back: bool) -> Step {
        match self {
            Self::Message(topic) => Step::Message { topic: topic.clone(), back },
            Self::Cycle(process) => Step::Cycle { process: process.clone(), back },
            Self::Time(ms) => Step::Time { ns: ms * 1_000_000 * if back { -1 } else { 1 } },
        }
    }

    fn text(&self) -> String {
        match self {
            Self::Message(None) => "any message".to_owned(),
            Self::Message(Some(topic)) => topic.clone(),
            Self::Cycle(None) => "any cycle".to_owned(),
            Self::Cycle(Some(process)) => format!("cycle of {process}"),
            Self::Time(ms) if ms % 1000 == 0 => format!("{} s", ms / 1000),
            Self::Time(ms) => format!("{ms} ms"),
        }
    }
}

/// What the controls change.
struct Acts<'a> {
    unit: &'a mut Unit,
    controls: &'a mut Vec<Control>,
    marks: &'a mut Bookmarks,
    wish: Option<Wish>,
}

/// What the controls ask of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wish {
    /// To show the whole time again.
    Whole,
    /// To ask for a time to go to.
    GoTo,
}

/// Paints the controls; returns what they ask for.
pub(super) fn ui(
    ui: &mut egui::Ui,
    frame: &Frame,
    unit: &mut Unit,
    zoomed: bool,
    busy: Option<f64>,
    marks: &mut Bookmarks,
    controls: &mut Vec<Control>,
) -> Option<Wish> {
    let playback = &frame.playback;
    let mut bar: Bar<'_, Acts<'_>> = Bar::new("transport");
    bar.left("back", Fit::Leaves(80), |ui, form, acts| {
        if bar::tool(ui, form, icons::ICON_SKIP_PREVIOUS, "Step back").clicked() {
            acts.controls.push(Control::Step(acts.unit.step(true)));
        }
    });
    bar.left("play", Fit::Stays, |ui, form, acts| {
        let (icon, name, control) = if playback.playing {
            (icons::ICON_PAUSE, "Pause", Control::Pause)
        } else {
            (icons::ICON_PLAY_ARROW, "Play", Control::Play)
        };
        let button = bar::tool_of(ui, form, icon, name, playback.playing, true);
        // Where playing ends by itself while the mouse is pressed, a press on Pause does not play on.
        let is_meant = widgets::as_pressed(&button, playback.playing) == playback.playing;
        if button.clicked() && is_meant {
            acts.controls.push(control);
        }
    });
    bar.left("forward", Fit::Leaves(81), |ui, form, acts| {
        if bar::tool(ui, form, icons::ICON_SKIP_NEXT, "Step forward").clicked() {
            acts.controls.push(Control::Step(acts.unit.step(false)));
        }
    });
    bar.left("unit", Fit::Leaves(30), |ui, form, acts| unit_menu(ui, form, frame, acts.unit));
    bar.left("loop", Fit::Leaves(20), |ui, form, acts| {
        let mut looping = playback.looping;
        let name = "Start again at the end";
        if bar::tool_toggle(ui, form, icons::ICON_REPEAT, name, &mut looping).clicked() {
            acts.controls.push(Control::Loop(looping));
        }
    });
    bar.left("speed", Fit::Leaves(40), |ui, form, acts| speed(ui, form, frame, acts.controls));
    bar.left("bookmarks", Fit::Leaves(15), |ui, form, acts| acts.marks.menu(ui, form, frame, acts.controls));
    bar.left("clock", Fit::Stays, |ui, form, acts| {
        bar::divider(ui, form);
        if form == Form::Full {
            ui.label(egui::RichText::new("elapsed").small().color(tokens(ui).weak));
        }
        let now = widgets::mono(format::elapsed(frame.time_s()));
        let size = if form == Form::Short { 12.0 } else { 16.0 };
        let now = egui::Label::new(now.size(size).color(tokens(ui).strong));
        let clock = ui.add(now.selectable(false).sense(egui::Sense::click()));
        if clock.on_hover_text("Time since the start; click to go to another one").clicked() {
            acts.wish = Some(Wish::GoTo);
        }
    });
    if let Some(end) = frame.info.end {
        bar.left("length", Fit::Leaves(25), move |ui, _, _| {
            let length = format::elapsed(end.seconds_since(frame.info.start));
            let length = widgets::mono(format!("/ {length}")).color(tokens(ui).weak);
            ui.label(length).on_hover_text("Length of the recording");
        });
    }
    // A clock that starts at 0 would say the same again.
    let is_dated = frame.info.start.0 > 0;
    bar.left("date", Fit::Leaves(10), move |ui, form, _| {
        if !is_dated {
            return;
        }
        bar::divider(ui, form);
        let date = widgets::mono(date_and_time(frame.now)).color(tokens(ui).weak);
        ui.label(date).on_hover_text(format!("Time of the source: {} ns", frame.now.0));
    });
    if playback.playing {
        state(&mut bar, frame);
    }
    // While time runs the source is always busy.
    if let Some(fraction) = busy.filter(|_| !playback.playing) {
        bar.right("busy", Fit::Leaves(120), move |ui, form, acts| {
            let width = if form == Form::Short { 48.0 } else { 120.0 };
            let progress = egui::ProgressBar::new(fraction as f32).desired_width(width).desired_height(14.0);
            let text = format!("{:3.0} %", fraction * 100.0);
            ui.add(progress.text(egui::RichText::new(text).small())).on_hover_text("Computing the moment");
            if widgets::icon_button(ui, icons::ICON_CANCEL, "Stop this work").clicked() {
                acts.controls.push(Control::Cancel);
            }
        });
    }
    if zoomed {
        bar.right("whole", Fit::Leaves(90), |ui, form, acts| {
            if bar::tool(ui, form, icons::ICON_ZOOM_OUT_MAP, "Show the whole time").clicked() {
                acts.wish = Some(Wish::Whole);
            }
        });
    }
    let mut acts = Acts { unit, controls, marks, wish: None };
    bar.show(ui, 24.0, &mut acts);
    acts.wish
}

fn speed(ui: &mut egui::Ui, form: Form, frame: &Frame, controls: &mut Vec<Control>) {
    let playback = &frame.playback;
    let mut speed = playback.speed;
    let text = |speed: f64| {
        if speed.is_infinite() { "max".to_owned() } else { format!("× {}", format::number(speed)) }
    };
    let shown = text(speed);
    let list = bar::choice(ui, form, Choice::new("Speed", &shown, [56.0; 2]), |ui| {
        for choice in SPEEDS {
            ui.selectable_value(&mut speed, choice, text(choice));
        }
    });
    list.response.on_hover_text("Speed: seconds of the source a second; max is as fast as it goes");
    if speed != playback.speed {
        controls.push(Control::Speed(speed));
    }
}

/// The unit of a step, with the list of all units.
fn unit_menu(ui: &mut egui::Ui, form: Form, frame: &Frame, unit: &mut Unit) {
    // What is searched for is kept while the list is open.
    let id = egui::Id::unique("search of steps");
    let kept: Option<String> = ui.data(|data| data.get_temp(id));
    let is_fresh = kept.is_none();
    let mut search = kept.unwrap_or_default();
    let shown = unit.text();
    let choice = Choice {
        closes: PopupCloseBehavior::CloseOnClickOutside,
        ..Choice::new("What a step is", &shown, [64.0, 128.0])
    };
    let list = bar::choice(ui, form, choice, |ui| unit_list(ui, frame, unit, &mut search, is_fresh));
    ui.data_mut(|data| match list.inner {
        Some(false) => {
            data.insert_temp(id, search);
        }
        Some(true) | None => data.remove::<String>(id),
    });
    list.response.on_hover_text("What a step is (arrow keys; with shift, a cycle)");
}

/// The list of all units, and a field above it that leaves those with the typed words. Returns whether one was chosen,
/// which closes the list. `is_fresh` says that the list was opened in this pass.
fn unit_list(ui: &mut egui::Ui, frame: &Frame, unit: &mut Unit, search: &mut String, is_fresh: bool) -> bool {
    ui.set_min_width(UNITS_WIDTH);
    let field = widgets::search(ui, search, "Search steps");
    let entered = typing::entered(&field);
    let wanted = search.trim().to_lowercase();
    let [general, topics] =
        units(frame).map(|units| units.into_iter().filter(|unit| fits(unit, &wanted)).collect::<Vec<_>>());
    let is_searched = !wanted.is_empty();
    // Enter chooses the first one that was found.
    let mut chosen = general.iter().chain(&topics).next().filter(|_| entered && is_searched).cloned();
    // While something is searched for, the list keeps its height, so that the field stays where it is.
    let list = egui::ScrollArea::vertical().max_height(UNITS_HEIGHT).auto_shrink([true, !is_searched]);
    list.show(ui, |ui| {
        let mut choice = |ui: &mut egui::Ui, other: &Unit| {
            if ui.selectable_label(*unit == *other, other.text()).clicked() {
                chosen = Some(other.clone());
            }
        };
        for other in &general {
            choice(ui, other);
        }
        if !topics.is_empty() {
            if !general.is_empty() {
                ui.separator();
            }
            ui.label(egui::RichText::new("A message of").small().color(tokens(ui).weak));
        }
        for other in &topics {
            choice(ui, other);
        }
        if general.is_empty() && topics.is_empty() {
            ui.label(egui::RichText::new("Nothing has this name.").color(tokens(ui).weak));
        }
    });
    if let Some(chosen) = chosen {
        *unit = chosen;
        ui.close();
        return true;
    }
    if is_fresh {
        field.request_focus();
    }
    false
}

/// All units: those of any source with the cycles of its processes, and the messages of its topics.
fn units(frame: &Frame) -> [Vec<Unit>; 2] {
    let mut general = vec![Unit::Message(None)];
    if !frame.processes.is_empty() {
        general.push(Unit::Cycle(None));
        general.extend(frame.processes.iter().map(|process| Unit::Cycle(Some(process.name.clone()))));
    }
    general.extend([100, 1000, 10_000].map(Unit::Time));
    let topics = frame.topics.iter().filter(|topic| topic.messages > 0);
    let mut names: Vec<&str> = topics.map(|topic| &*topic.name).collect();
    // A topic that is both recorded and computed is listed once.
    names.dedup();
    [general, names.into_iter().map(|name| Unit::Message(Some(name.to_owned()))).collect()]
}

/// Whether the text of a unit has all of these lower-case words.
fn fits(unit: &Unit, words: &str) -> bool {
    let text = unit.text().to_lowercase();
    words.split_whitespace().all(|word| text.contains(word))
}

/// State of playback: its measured speed, and how far it lags behind the clock.
fn state<'a>(bar: &mut Bar<'a, Acts<'_>>, frame: &'a Frame) {
    let playback = &frame.playback;
    let slow = playback.achieved.is_some_and(|achieved| achieved < 0.95 * playback.speed)
        && playback.speed.is_finite();
    let color = move |ui: &egui::Ui| if slow { tokens(ui).warning } else { tokens(ui).weak };
    if playback.lag_s > 0.25 {
        bar.right("lag", Fit::Leaves(60), move |ui, form, _| {
            let age = format::age(playback.lag_s);
            let text = if form == Form::Short { format!("-{age}") } else { format!("{age} behind the clock") };
            widgets::tag(ui, &text, color(ui)).on_hover_text(
                "What could not be done in time since playing began. It is not caught up with: time goes on at the \
                 speed that was asked for.",
            );
        });
    }
    if let Some(achieved) = playback.achieved {
        bar.right("achieved", Fit::Leaves(50), move |ui, form, _| {
            let unit = if form == Form::Short { "" } else { " × real time" };
            ui.label(widgets::mono(format!("{achieved:6.2}{unit}")).color(color(ui)))
                .on_hover_text("Seconds of the source a second, over the last half second");
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use rcs_msg::Stamp;
    use std::cell::{Cell, RefCell};
    use std::sync::Arc;

    #[test]
    fn a_press_on_pause_does_not_play_where_playing_ends_before_the_release() {
        for (then, expected) in [(true, 1), (false, 0)] {
            let (playing, asked) = (Cell::new(true), RefCell::new(Vec::<Control>::new()));
            let mut harness = Harness::builder()
                .with_size(egui::Vec2::new(900.0, 60.0))
                .with_context_setup(ocu_ui::install)
                .build_ui(|ui| {
                    let mut frame = Frame::empty(Arc::default(), Stamp(0));
                    frame.playback.playing = playing.get();
                    let (mut unit, mut marks) = (Unit::Time(100), Bookmarks::default());
                    let mut controls = asked.borrow_mut();
                    super::ui(ui, &frame, &mut unit, false, None, &mut marks, &mut controls);
                });
            harness.run_steps(3);
            let at = harness.get_by_label("Pause").rect().center();
            harness.drag_at(at);
            harness.step();
            playing.set(then);
            harness.step();
            harness.drop_at(at);
            harness.step();
            drop(harness);
            let asked = asked.into_inner();
            assert_eq!(asked.len(), expected, "{asked:?}");
            assert!(asked.iter().all(|control| matches!(control, Control::Pause)), "{asked:?}");
        }
    }

    #[test]
    fn a_unit_is_found_by_words_of_its_text_in_any_order() {
        let cycle = Unit::Cycle(Some("WM1".to_owned()));
        for words in ["", "wm1", "cycle", "wm1 cycle", "  wm  of "] {
            assert!(fits(&cycle, words), "{words:?}");
        }
        assert!(!fits(&cycle, "wm1 message") && !fits(&cycle, "wm2"));
        assert!(fits(&Unit::Message(Some("/vehicle/gps".to_owned())), "gps"));
        assert!(fits(&Unit::Time(100), "100 ms") && !fits(&Unit::Time(10_000), "ms"));
    }
}
