//! Mapping between time and the width of the timeline's bar. Periods without messages are shown as narrow gaps,
//! whatever their duration.

use egui::{Align2, FontId, Rect, Stroke};
use ocu_ui::{format, stale};
use rcs_log::Gap;
use rcs_msg::Stamp;

/// Width of a gap as a share of the bar; less if there are many gaps.
const GAP_PART: f64 = 0.03;
/// Maximum share of the bar for all gaps together.
const GAPS_PART: f64 = 0.4;
/// Distance at which the pointer means a mark.
const NEAR: f32 = 4.0;

/// A period of time and its share of the bar.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    from: Stamp,
    to: Stamp,
    /// Where it begins and ends on the bar, 0 to 1.
    at: [f64; 2],
    is_gap: bool,
}

/// Mapping between time and the width of the bar.
pub(super) struct Scale {
    rect: Rect,
    /// The time that ticks and labels count from.
    origin: Stamp,
    /// Periods in ascending order without holes; at least one.
    stretches: Vec<Stretch>,
}

impl Scale {
    /// A scale from `start` to `end`, whose labels count from `origin`.
    pub(super) fn new(rect: Rect, origin: Stamp, [start, end]: [Stamp; 2], gaps: &[Gap]) -> Self {
        let inside: Vec<&Gap> = gaps.iter().filter(|gap| gap.from >= start && gap.to <= end).collect();
        let gap_part = GAP_PART.min(GAPS_PART / inside.len().max(1) as f64);
        let silent: u64 = inside.iter().map(|gap| gap.to.0 - gap.from.0).sum();
        let spoken = end.0.saturating_sub(start.0).saturating_sub(silent).max(1) as f64;
        let room = 1.0 - gap_part * inside.len() as f64;
        let mut stretches = Vec::with_capacity(inside.len() * 2 + 1);
        let (mut from, mut at) = (start, 0.0);
        let mut add = |from: Stamp, to: Stamp, part: f64, is_gap: bool| {
            stretches.push(Stretch { from, to, at: [at, at + part], is_gap });
            at += part;
        };
        for gap in inside {
            add(from, gap.from, room * gap.from.0.saturating_sub(from.0) as f64 / spoken, false);
            add(gap.from, gap.to, gap_part, true);
            from = gap.to;
        }
        add(from, end.max(from), room * end.0.saturating_sub(from.0) as f64 / spoken, false);
        Self { rect, origin, stretches }
    }

    /// The times at both ends.
    pub(super) fn range(&self) -> [Stamp; 2] {
        [self.stretches[0].from, self.stretches[self.stretches.len() - 1].to]
    }

    /// The time that labels count from.
    pub(super) fn origin(&self) -> Stamp {
        self.origin
    }

    /// Left end on the screen.
    pub(super) fn left(&self) -> f32 {
        self.rect.left()
    }

    pub(super) fn x(&self, stamp: Stamp) -> f32 {
        let last = self.stretches.len() - 1;
        let index = self.stretches.partition_point(|stretch| stretch.to < stamp).min(last);
        let Stretch { from, to, at, .. } = self.stretches[index];
        let part = (stamp.seconds_since(from) / to.seconds_since(from).max(1e-9)).clamp(0.0, 1.0);
        self.rect.left() + self.rect.width() * (at[0] + (at[1] - at[0]) * part) as f32
    }

    pub(super) fn stamp(&self, x: f32) -> Stamp {
        let place = f64::from(((x - self.rect.left()) / self.rect.width().max(1.0)).clamp(0.0, 1.0));
        let index = self.stretches.partition_point(|stretch| stretch.at[1] < place);
        let Stretch { from, to, at, is_gap } = self.stretches[index.min(self.stretches.len() - 1)];
        // A gap contains no messages, so any position in it selects its end.
        if is_gap {
            return to;
        }
        let part = ((place - at[0]) / (at[1] - at[0]).max(1e-12)).clamp(0.0, 1.0);
        from.after_ns((part * (to.0 - from.0) as f64).round() as u64)
    }

    /// Paints the time under the pointer next to a line.
    pub(super) fn paint_pointer(&self, painter: &egui::Painter, tokens: &ocu_ui::Tokens, x: f32, to: Stamp) {
        painter.vline(x, self.rect.y_range(), Stroke::new(1.0, tokens.weak));
        let text = format::elapsed(to.seconds_since(self.origin));
        let galley = painter.layout_no_wrap(text, FontId::monospace(11.0), tokens.strong);
        let room = x + galley.size().x + 12.0 < self.rect.right();
        let left = if room { x + 4.0 } else { x - galley.size().x - 4.0 };
        let at = egui::pos2(left, self.rect.center().y - galley.size().y / 2.0);
        painter.rect_filled(Rect::from_min_size(at, galley.size()).expand(2.0), 2.0, tokens.surface[3]);
        painter.galley(at, galley, tokens.strong);
    }

    /// Paints the part of the bar that lies in the future.
    pub(super) fn paint_unknown(
        &self,
        painter: &egui::Painter,
        tokens: &ocu_ui::Tokens,
        bar: Rect,
        from: Stamp,
    ) {
        let rest = Rect::from_min_max(egui::pos2(self.x(from), bar.top()), bar.right_bottom());
        painter.rect_filled(rest, 0.0, tokens.surface[2].gamma_multiply(0.6));
    }

    /// Paints where a recording that was begun in the middle of its run becomes complete: the part before is darker,
    /// and a line ends it.
    pub(super) fn paint_beginning(
        &self,
        painter: &egui::Painter,
        tokens: &ocu_ui::Tokens,
        bar: Rect,
        from: Stamp,
    ) {
        let before = Rect::from_x_y_ranges(bar.left()..=self.x(from), bar.y_range());
        painter.rect_filled(before, 0.0, tokens.surface[2].gamma_multiply(0.6));
        if self.shows(from) {
            painter.vline(self.x(from), bar.y_range(), Stroke::new(1.0, tokens.text));
        }
    }

    /// Whether a time is in the shown range.
    fn shows(&self, stamp: Stamp) -> bool {
        let [first, last] = self.range();
        (first..=last).contains(&stamp)
    }

    /// Whether a place on the screen means the mark of a time that the bar shows.
    pub(super) fn is_near(&self, x: f32, stamp: Stamp) -> bool {
        self.shows(stamp) && (x - self.x(stamp)).abs() <= NEAR
    }

    /// Paints the gaps, with their durations where there is room.
    pub(super) fn paint_gaps(&self, painter: &egui::Painter, tokens: &ocu_ui::Tokens, bar: Rect) {
        for gap in self.stretches.iter().filter(|stretch| stretch.is_gap) {
            let [left, right] = gap.at.map(|part| self.rect.left() + self.rect.width() * part as f32);
            let band = Rect::from_x_y_ranges(left..=right, bar.y_range());
            painter.rect_filled(band, 0.0, tokens.surface[2]);
            stale::hatch(painter, band, tokens.weak);
            let text = format!("{} without messages", format::age(gap.to.seconds_since(gap.from)));
            let galley = painter.layout_no_wrap(text, FontId::proportional(10.0), tokens.weak);
            let at = egui::pos2(right + 4.0, bar.top() + 4.0);
            if at.x + galley.size().x < self.rect.right() {
                painter.galley(at, galley, tokens.weak);
            }
        }
    }

    pub(super) fn paint_ticks(&self, painter: &egui::Painter, tokens: &ocu_ui::Tokens) {
        let spoken = self.stretches.iter().filter(|stretch| !stretch.is_gap);
        let spoken_s: f64 = spoken.clone().map(|it| it.to.seconds_since(it.from)).sum();
        let step_s = tick_step_s(spoken_s.max(1e-9), self.rect.width() / 96.0);
        for stretch in spoken {
            let [first_s, last_s] = [stretch.from, stretch.to].map(|at| at.seconds_since(self.origin));
            let first = (first_s / step_s).ceil();
            let count = ((last_s / step_s).floor() - first).clamp(-1.0, 1000.0) as i64;
            let until = self.rect.left() + self.rect.width() * stretch.at[1] as f32;
            for index in 0..=count {
                let time_s = (first + index as f64) * step_s;
                self.paint_tick(painter, tokens, time_s, tick_text(time_s, step_s), until);
            }
        }
    }

    /// Paints a tick, and its label if it ends before `until`, where a gap begins.
    fn paint_tick(
        &self,
        painter: &egui::Painter,
        tokens: &ocu_ui::Tokens,
        time_s: f64,
        text: String,
        until: f32,
    ) {
        let x = self.x(self.origin.after_ns((time_s * 1e9) as u64));
        let bottom = self.rect.bottom();
        painter.vline(x, (bottom - 6.0)..=bottom, Stroke::new(1.0, tokens.line));
        if x + 56.0 < self.rect.right() {
            let galley = painter.layout_no_wrap(text, FontId::monospace(10.0), tokens.weak);
            let label = Align2::LEFT_BOTTOM.anchor_size(egui::pos2(x + 4.0, bottom), galley.size());
            if label.right() <= until {
                painter.galley(label.min, galley, tokens.weak);
            }
        }
    }
}

/// A round step that gives at most `most` ticks.
fn tick_step_s(duration_s: f64, most: f32) -> f64 {
    const STEPS_S: [f64; 19] = [
        0.001, 0.01, 0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1800.0,
        3600.0, 21_600.0, 86_400.0,
    ];
    let least = duration_s / f64::from(most.max(1.0));
    STEPS_S
        .into_iter()
        .find(|&step_s| step_s >= least)
        .unwrap_or_else(|| (least / 86_400.0).ceil() * 86_400.0)
}

/// Minutes and seconds, hours if there are any, and as many decimals as the step needs.
fn tick_text(time_s: f64, step_s: f64) -> String {
    let whole = time_s.floor() as u64;
    let decimals = if step_s < 0.01 {
        3
    } else if step_s < 0.1 {
        2
    } else {
        usize::from(step_s < 1.0)
    };
    let width = if decimals == 0 { 2 } else { decimals + 3 };
    let seconds = time_s - (whole / 60 * 60) as f64;
    let minutes = format!("{:02}:{seconds:0width$.decimals$}", whole / 60 % 60);
    if whole >= 3600 { format!("{}:{minutes}", whole / 3600) } else { minutes }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_never_too_many() {
        for duration_s in [0.0005, 0.02, 1.0, 19.0, 61.0, 4000.0, 1e5, 1e7] {
            let step_s = tick_step_s(duration_s, 10.0);
            assert!(duration_s / step_s <= 10.0 + 1e-9, "{duration_s}: {step_s}");
        }
        assert_eq!(tick_step_s(20.0, 12.0), 2.0);
        assert_eq!(tick_text(62.0, 2.0), "01:02");
        assert_eq!(tick_text(3725.5, 0.5), "1:02:05.5");
    }

    #[test]
    fn no_label_of_a_time_reaches_into_a_gap() {
        const SECOND: u64 = 1_000_000_000;
        let (from, to) = (Stamp(30 * SECOND), Stamp(5030 * SECOND));
        for width in [500.0, 620.0, 740.0, 860.0, 980.0] {
            let rect = Rect::from_min_size(egui::pos2(0.0, 0.0), egui::vec2(width, 20.0));
            let scale = Scale::new(rect, Stamp(0), [Stamp(0), Stamp(5060 * SECOND)], &[Gap { from, to }]);
            let output = egui::Context::default().run_ui(egui::RawInput::default(), |ui| {
                scale.paint_ticks(ui.painter(), ocu_ui::tokens(ui));
            });
            let shapes = output.shapes.iter().map(|clipped| &clipped.shape);
            let texts = shapes.filter(|shape| matches!(shape, egui::Shape::Text(_)));
            let labels: Vec<Rect> = texts.map(egui::Shape::visual_bounding_rect).collect();
            output.drop_without_applying_deltas();
            let gap = [from, to].map(|at| scale.x(at));
            assert!(labels.len() > 1, "{width}: {labels:?}");
            let in_gap = |label: &Rect| label.left() < gap[1] && label.right() > gap[0] + 0.5;
            assert!(!labels.iter().any(in_gap), "{width}: {labels:?}, a gap at {gap:?}");
        }
    }

    #[test]
    fn the_bar_maps_both_ways() {
        let rect = Rect::from_min_size(egui::pos2(10.0, 0.0), egui::vec2(200.0, 20.0));
        let scale = Scale::new(rect, Stamp(1_000), [Stamp(1_000), Stamp(2_001_000)], &[]);
        assert_eq!(scale.stamp(-5.0), Stamp(1_000));
        assert_eq!(scale.stamp(500.0), Stamp(2_001_000));
        let middle = scale.stamp(110.0);
        assert_eq!(middle, Stamp(1_001_000));
        assert!((scale.x(middle) - 110.0).abs() < 0.01);
    }

    #[test]
    fn a_gap_of_decades_leaves_the_rest_of_the_bar_to_what_was_recorded() {
        const SECOND: u64 = 1_000_000_000;
        let rect = Rect::from_min_size(egui::pos2(0.0, 0.0), egui::vec2(1000.0, 20.0));
        let late = 1_700_000_000 * SECOND;
        let gap = Gap { from: Stamp(SECOND), to: Stamp(late) };
        let scale = Scale::new(rect, Stamp(0), [Stamp(0), Stamp(late + 89 * SECOND)], &[gap]);
        let width = scale.x(Stamp(late + 89 * SECOND)) - scale.x(Stamp(late));
        assert!(width > 900.0, "{width}");
        for seconds in [0, 1, 40, 89] {
            let stamp = Stamp(late + seconds * SECOND);
            let back = scale.stamp(scale.x(stamp));
            assert!(back.seconds_since(stamp).abs() < 0.1, "{seconds}: {}", back.seconds_since(stamp));
        }
        let within = scale.stamp(scale.x(Stamp(SECOND)) + 10.0);
        assert_eq!(within, Stamp(late), "within the gap there is nothing to go to but its end");
    }
}
