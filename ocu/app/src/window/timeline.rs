//! The timeline at the bottom of the window: the current time, and playback controls.

use super::bookmarks::Bookmarks;
use super::commands::Command;
use super::density::Density;
use super::lanes;
use super::scale::Scale;
use super::state_lane::{self, States};
use super::transport::{self, Unit, Wish};
use egui::{Rect, Role, Sense, Stroke, WidgetInfo};
use ocu_ui::{Tokens, tokens};
use ocu_views::{Hover, Selection};
use rcs_msg::Stamp;
use rcs_runtime::RunId;
use rcs_runtime::source::{Control, EventKind, Frame, Step};
use std::collections::BTreeMap;

/// Height of the bar.
const BAR: f32 = 28.0;
const SECOND_NS: i64 = 1_000_000_000;
/// What the mark of a recording that was begun in the middle of its run means.
const BEGUN: &str = "The recording is complete from here on. It was begun in the middle of its run: before this moment \
                     it has only the newest message of each buffer.";
/// The shortest period that the bar shows, ns.
const LEAST_RANGE_NS: f64 = 1e6;

/// State of the timeline.
pub(super) struct Timeline {
    unit: Unit,
    /// The last time requested by dragging, so that a resting pointer sends one request.
    asked: Option<Stamp>,
    /// The latest time reached by a source without an end.
    furthest: Stamp,
    /// The newest time of each run at which it was seen.
    newest: BTreeMap<RunId, Stamp>,
    /// Where the user went, until the source is there.
    going_to: Option<Stamp>,
    /// What the bar shows; everything where `None`.
    range: Option<[Stamp; 2]>,
    /// Whether the clock was clicked in this pass.
    clock_clicked: bool,
}

impl Default for Timeline {
    fn default() -> Self {
        Self {
            unit: Unit::Message(None),
            asked: None,
            furthest: Stamp(0),
            newest: BTreeMap::new(),
            going_to: None,
            range: None,
            clock_clicked: false,
        }
    }
}

impl Timeline {
    /// Resets the state for another source.
    pub(super) fn forget(&mut self) {
        *self = Self { unit: self.unit.clone(), ..Self::default() };
    }

    /// The control for a command about time; `None` for other commands.
    pub(super) fn command(&self, command: Command, frame: &Frame, selection: &Selection) -> Option<Control> {
        let playback = &frame.playback;
        Some(match command {
            Command::PlayPause if playback.playing => Control::Pause,
            Command::PlayPause => Control::Play,
            Command::Step { back } => Control::Step(self.unit.step(back)),
            Command::StepCycle { back } => {
                let process = match &self.unit {
                    Unit::Cycle(process) => process.clone(),
                    _ => selection.process.as_ref().map(ToString::to_string),
                };
                Control::Step(Step::Cycle { process, back })
            }
            Command::StepSecond { back } => {
                Control::Step(Step::Time { ns: if back { -SECOND_NS } else { SECOND_NS } })
            }
            Command::ToStart => Control::Seek(frame.info.start),
            Command::ToEnd => Control::Seek(frame.info.end.unwrap_or_else(|| self.newest(frame))),
            Command::Loop => Control::Loop(!playback.looping),
            Command::NextEvent { back } => {
                let wanted = &EventKind::ALL[..EventKind::ALL.len() - 1];
                Control::Seek(frame.events()?.beside(frame.now, back, wanted)?.stamp)
            }
            _ => return None,
        })
    }

    /// The newest time of the run that is shown. It can be later than its last event.
    pub(super) fn newest(&self, frame: &Frame) -> Stamp {
        let current = frame.runs.current();
        let last = frame.runs.all.iter().find(|run| run.id == current).map(|run| run.end);
        last.max(self.newest.get(&current).copied()).unwrap_or(self.furthest)
    }

    /// Whether the clock was clicked since this was last asked.
    pub(super) fn take_clock_click(&mut self) -> bool {
        std::mem::take(&mut self.clock_clicked)
    }

    /// Paints the timeline.
    pub(super) fn ui(
        &mut self,
        ui: &mut egui::Ui,
        frame: &Frame,
        selection: &mut Selection,
        busy: Option<f64>,
        marks: &mut Bookmarks,
        controls: &mut Vec<Control>,
    ) {
        if let Some(wanted) = marks.turn(self.range) {
            self.range = Some(wanted);
        }
        let zoomed = self.range.is_some();
        match transport::ui(ui, frame, &mut self.unit, zoomed, busy, marks, controls) {
            Some(Wish::Whole) => self.range = None,
            Some(Wish::GoTo) => self.clock_clicked = true,
            None => {}
        }
        self.bar(ui, frame, selection, busy, marks, controls);
    }

    /// The bar: click or drag to go to a time.
    fn bar(
        &mut self,
        ui: &mut egui::Ui,
        frame: &Frame,
        selection: &mut Selection,
        busy: Option<f64>,
        marks: &Bookmarks,
        controls: &mut Vec<Control>,
    ) {
        let tokens = tokens(ui);
        let events = frame.events();
        let states = selection.process.as_deref().and_then(|process| States::of(frame, process));
        // The bar keeps its height when a process is selected.
        let state_height = if frame.processes.is_empty() { 0.0 } else { state_lane::HEIGHT };
        let kinds = lanes::lanes(frame);
        let lanes = lanes::height(&kinds);
        let size = egui::vec2(ui.available_width(), BAR + lanes + state_height);
        let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
        response.widget_info(|| {
            let mut info = WidgetInfo::labeled(Role::Slider, true, "Time");
            info.value = Some(frame.time_s());
            info
        });
        let painter = ui.painter_at(rect);
        painter.rect_filled(rect, 2.0, tokens.canvas());
        self.furthest = self.furthest.max(frame.now);
        if frame.runs.is_at_end {
            self.newest.insert(frame.runs.current(), frame.now);
        }
        // For a source without an end, the bar ends at a whole minute ahead.
        let end = frame.info.end.unwrap_or_else(|| {
            let minutes = (self.furthest.seconds_since(frame.info.start) / 60.0).floor() as u64 + 1;
            frame.info.start.after_ns(minutes * 60_000_000_000)
        });
        let inner = rect.shrink2(egui::vec2(8.0, 0.0));
        let whole = [frame.info.start, end];
        self.follow(frame, whole);
        let shown = self.range.unwrap_or(whole);
        let scale = Scale::new(inner, frame.info.start, shown, &frame.info.gaps);
        match zoomed(ui, &response, &scale, whole) {
            None => {}
            Some(Zoomed::Whole) => self.range = None,
            Some(Zoomed::Part(range)) => self.range = Some(range),
        }
        let begun = paint_beginning(&painter, tokens, &scale, rect, frame, response.hover_pos());
        let mark = events.and_then(|events| {
            let place = Rect::from_min_size(
                egui::pos2(inner.left(), rect.top() + 5.0),
                egui::vec2(inner.width(), lanes),
            );
            lanes::paint(ui, events, &kinds, place, &scale)
        });
        let place = egui::vec2(inner.width(), state_height);
        let place = Rect::from_min_size(egui::pos2(inner.left(), rect.top() + 5.0 + lanes), place);
        let state = states.and_then(|states| states.paint(ui, place, &scale));
        let counts = Density::of(frame, selection).and_then(|density| {
            let top = place.bottom() + 3.0;
            density.paint(ui, Rect::from_x_y_ranges(inner.x_range(), top..=rect.bottom()), &scale)
        });
        scale.paint_ticks(&painter, tokens);
        scale.paint_gaps(&painter, tokens, rect);
        if frame.info.end.is_none() {
            scale.paint_unknown(&painter, tokens, rect, self.furthest);
        }
        marks.paint(ui, rect, &scale);
        if let Some(range) = self.range {
            paint_overview(&painter, tokens, rect, whole, range);
        }
        self.paint_now(&painter, tokens, &scale, rect, frame.now);
        // A far moment may have to be computed: until it is there, its place has a hollow head.
        self.going_to = self.going_to.filter(|to| busy.is_some() && *to != frame.now);
        if let Some(to) = self.going_to {
            let x = scale.x(to);
            painter.vline(x, rect.y_range(), Stroke::new(1.0, tokens.accent));
            let head =
                [(-5.0, 0.0), (5.0, 0.0), (0.0, 6.0)].map(|(dx, dy)| egui::pos2(x + dx, rect.top() + dy));
            painter.add(egui::Shape::closed_line(head.to_vec(), Stroke::new(1.0, tokens.accent)));
        }
        if let Some(time) = selection.hovered.get().time.filter(|_| !response.hovered()) {
            painter.vline(scale.x(time), rect.y_range(), Stroke::new(1.0, tokens.weak));
        }

        let response = match (&mark, begun.or(state).or(counts)) {
            (Some(event), _) => {
                response.on_hover_ui_at_pointer(|ui| lanes::describe(ui, event, frame.info.start))
            }
            (None, Some(text)) => response.on_hover_text_at_pointer(text),
            (None, None) => response,
        };
        let Some(pointer) = response.hover_pos().or_else(|| response.interact_pointer_pos()) else {
            self.asked = None;
            return;
        };
        // A click on a mark goes to its very time and pauses there; elsewhere on the bar, time goes on from the click.
        let event = mark.filter(|_| !response.dragged());
        let to = event.as_ref().map_or_else(|| scale.stamp(pointer.x), |event| event.stamp);
        // The last move and the release may fall into one pass, and with slow passes so may the whole drag.
        let is_drag = response.dragged() || response.drag_stopped() || pressed_and_released_in(ui, rect);
        if response.clicked() || is_drag {
            if self.asked != Some(to) {
                if event.is_some() && response.clicked() {
                    controls.push(Control::Pause);
                }
                controls.push(Control::Seek(to));
                (self.asked, self.going_to) = (Some(to), Some(to));
            }
        } else {
            self.asked = None;
        }
        selection.hovered.set(Hover { time: Some(to), ..Hover::default() });
        scale.paint_pointer(&painter, tokens, pointer.x, to);
    }

    /// Keeps the viewed time in a zoomed bar while time runs, and the range within the source.
    fn follow(&mut self, frame: &Frame, whole: [Stamp; 2]) {
        let Some([from, to]) = self.range else { return };
        let width = to.0 - from.0;
        let is_outside = frame.now < from || frame.now > to;
        if frame.playback.playing && is_outside {
            let from = frame.now.0.saturating_sub(width / 10).max(whole[0].0);
            self.range = Some([Stamp(from), Stamp(from + width)]);
        }
    }

    fn paint_now(&self, painter: &egui::Painter, tokens: &Tokens, scale: &Scale, rect: Rect, now: Stamp) {
        let [from, to] = scale.range();
        let x = scale.x(now);
        let done = Rect::from_min_max(egui::pos2(scale.left(), rect.top()), egui::pos2(x, rect.top() + 4.0));
        painter.rect_filled(done, 0.0, tokens.selected);
        if self.range.is_some() && (now < from || now > to) {
            return;
        }
        painter.vline(x, rect.y_range(), Stroke::new(2.0, tokens.accent));
        let head = [(-5.0, 0.0), (5.0, 0.0), (0.0, 6.0)].map(|(dx, dy)| egui::pos2(x + dx, rect.top() + dy));
        painter.add(egui::Shape::convex_polygon(head.to_vec(), tokens.accent, Stroke::NONE));
    }
}

/// What the bar shows after a turn of the wheel.
enum Zoomed {
    Whole,
    Part([Stamp; 2]),
}

/// Paints from when on a recording is complete; returns what that means if the pointer is there.
fn paint_beginning(
    painter: &egui::Painter,
    tokens: &Tokens,
    scale: &Scale,
    rect: Rect,
    frame: &Frame,
    pointer: Option<egui::Pos2>,
) -> Option<String> {
    let from = frame.info.complete_from?;
    scale.paint_beginning(painter, tokens, rect, from);
    scale.is_near(pointer?.x, from).then(|| BEGUN.to_owned())
}

/// What a turn of the wheel over the bar shows next: it zooms at the pointer, and shift (or a horizontal wheel) pans.
/// `None` where it is not turned.
fn zoomed(ui: &egui::Ui, response: &egui::Response, scale: &Scale, whole: [Stamp; 2]) -> Option<Zoomed> {
    let pointer = response.hover_pos()?;
    let (scroll, pinch) = ui.input(|input| (input.smooth_scroll_delta(), input.zoom_delta()));
    let [from, to] = scale.range();
    let width = to.0.saturating_sub(from.0).max(1) as f64;
    let factor = if pinch == 1.0 { (f64::from(scroll.y) * 0.005).exp() } else { f64::from(pinch) };
    if factor == 1.0 && scroll.x == 0.0 {
        return None;
    }
    let all = whole[1].0.saturating_sub(whole[0].0).max(1) as f64;
    let next = (width / factor).max(LEAST_RANGE_NS);
    if next >= all {
        return Some(Zoomed::Whole);
    }
    // The time under the pointer keeps its place.
    let at = scale.stamp(pointer.x).0 as f64;
    let part = (at - from.0 as f64) / width;
    let panned = f64::from(scroll.x) / f64::from(response.rect.width().max(1.0)) * next;
    let start = (at - part * next - panned).clamp(whole[0].0 as f64, whole[1].0 as f64 - next);
    Some(Zoomed::Part([Stamp(start as u64), Stamp((start + next) as u64)]))
}

/// Which part of the whole a zoomed bar shows, as a thin line at its top.
fn paint_overview(
    painter: &egui::Painter,
    tokens: &Tokens,
    rect: Rect,
    whole: [Stamp; 2],
    [from, to]: [Stamp; 2],
) {
    let all = whole[1].seconds_since(whole[0]).max(1e-9);
    let x = |at: Stamp| rect.left() + rect.width() * (at.seconds_since(whole[0]) / all) as f32;
    let line = Rect::from_x_y_ranges(x(from)..=x(to).max(x(from) + 2.0), rect.bottom() - 2.0..=rect.bottom());
    painter.rect_filled(line, 0.0, tokens.accent);
}

/// Whether the pointer was pressed in `rect` and released since the last pass.
fn pressed_and_released_in(ui: &egui::Ui, rect: Rect) -> bool {
    let is_button = |event: &egui::Event, down: bool| match event {
        egui::Event::PointerButton { pos, button: egui::PointerButton::Primary, pressed, .. } => {
            *pressed == down && (!down || rect.contains(*pos))
        }
        _ => false,
    };
    ui.input(|input| {
        let press = input.events.iter().position(|event| is_button(event, true));
        press.is_some_and(|press| input.events[press..].iter().any(|event| is_button(event, false)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use rcs_msg::rcs::Status;
    use rcs_msg::schema_of;
    use rcs_runtime::source::{Event, EventLevel, Events, RunTag, SourceInfo, Topic};
    use std::sync::Arc;

    /// Whether the timeline of a recording of ten seconds that is complete from `from_s` on says so under the pointer
    /// at this part of its bar.
    fn is_told(from_s: Option<u64>, part: f32) -> bool {
        let complete_from = from_s.map(|s| Stamp(s * 1_000_000_000));
        let info = SourceInfo { end: Some(Stamp(10_000_000_000)), complete_from, ..SourceInfo::default() };
        let frame = Frame::empty(Arc::new(info), Stamp(0));
        let (mut timeline, mut selection) = (Timeline::default(), Selection::default());
        let mut marks = Bookmarks::default();
        let mut harness = Harness::builder()
            .with_size(egui::vec2(600.0, 120.0))
            .with_context_setup(ocu_ui::install)
            .build_ui(|ui| timeline.ui(ui, &frame, &mut selection, None, &mut marks, &mut Vec::new()));
        harness.run_steps(4);
        let bar = harness.get_by_label("Time").rect().shrink2(egui::vec2(8.0, 0.0));
        harness.hover_at(egui::pos2(bar.left() + part * bar.width(), bar.center().y));
        harness.run_steps(8);
        harness.query_by_label(BEGUN).is_some()
    }

    /// What a click at this part of a timeline asks for, in the lane of the only event: an error at 4 s of 10 s.
    fn clicked(part: f32) -> Vec<Control> {
        let topic = Topic::new("/a/status", RunTag::FIRST, Arc::clone(schema_of::<Status>()));
        let error = Event {
            stamp: Stamp(4_000_000_000),
            kind: EventKind::Error,
            level: EventLevel::Error,
            source: "a".into(),
            text: "fails".into(),
        };
        let info = SourceInfo { end: Some(Stamp(10_000_000_000)), ..SourceInfo::default() };
        let frame = Frame {
            topics: Arc::new([topic]),
            events: Arc::new([Events::of(RunTag::FIRST, [error])]),
            ..Frame::empty(Arc::new(info), Stamp(0))
        };
        let (mut timeline, mut selection) = (Timeline::default(), Selection::default());
        let (mut marks, mut controls) = (Bookmarks::default(), Vec::new());
        let mut harness = Harness::builder()
            .with_size(egui::vec2(600.0, 120.0))
            .with_context_setup(ocu_ui::install)
            .build_ui(|ui| timeline.ui(ui, &frame, &mut selection, None, &mut marks, &mut controls));
        harness.run_steps(4);
        let bar = harness.get_by_label("Time").rect().shrink2(egui::vec2(8.0, 0.0));
        // The lane of errors is the first one.
        let at = egui::pos2(bar.left() + part * bar.width(), bar.top() + 8.0);
        harness.hover_at(at);
        harness.run_steps(2);
        harness.drag_at(at);
        harness.run_steps(1);
        harness.drop_at(at);
        harness.run_steps(2);
        drop(harness);
        controls
    }

    #[test]
    fn a_click_on_an_event_pauses_there_and_one_beside_it_goes_on_playing() {
        let on_it = clicked(0.4);
        let at = Stamp(4_000_000_000);
        assert!(matches!(on_it[..], [Control::Pause, Control::Seek(to)] if to == at), "{on_it:?}");
        let beside = clicked(0.6);
        assert!(matches!(beside[..], [Control::Seek(to)] if to > at), "{beside:?}");
    }

    #[test]
    fn a_click_on_the_clock_asks_for_a_time() {
        let info = SourceInfo { end: Some(Stamp(10_000_000_000)), ..SourceInfo::default() };
        let frame = Frame::empty(Arc::new(info), Stamp(0));
        let (mut timeline, mut selection) = (Timeline::default(), Selection::default());
        let (mut marks, mut controls) = (Bookmarks::default(), Vec::new());
        let mut harness = Harness::builder()
            .with_size(egui::vec2(900.0, 120.0))
            .with_context_setup(ocu_ui::install)
            .build_ui(|ui| timeline.ui(ui, &frame, &mut selection, None, &mut marks, &mut controls));
        harness.run_steps(4);
        harness.get_by_label("00:00:00.000").click();
        harness.run_steps(3);
        drop(harness);
        assert!(timeline.take_clock_click());
        assert!(!timeline.take_clock_click() && controls.is_empty());
    }

    #[test]
    fn the_moment_from_which_a_recording_is_complete_is_told_under_the_pointer() {
        assert!(is_told(Some(4), 0.4));
        assert!(!is_told(Some(4), 0.6) && !is_told(None, 0.4));
    }
}
