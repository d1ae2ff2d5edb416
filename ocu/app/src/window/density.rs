//! How many messages of the selected topic there are over time, as bars behind the ticks of the timeline.

use super::scale::Scale;
use egui::{Rect, Ui};
use ocu_ui::{format, tokens};
use ocu_views::{Selection, TopicKey};
use rcs_formula::FieldRef;
use rcs_msg::{FieldPath, Stamp};
use rcs_runtime::source::{FieldSeries, Frame};

/// Widths of the steps in which messages are counted: the first one with enough messages in a step, so that steps with
/// one message more than others do not look like a pattern.
const STEPS: [f32; 4] = [2.0, 4.0, 8.0, 16.0];
const ENOUGH: f32 = 8.0;
/// Least height of a bar, as a share.
const LEAST: f32 = 0.15;
/// Strength of the colour, so that labels stay readable.
const STRENGTH: f32 = 0.4;

/// What must be gathered to know the times of a topic's messages.
pub(super) fn field(frame: &Frame, key: &TopicKey) -> Option<FieldRef> {
    let topic = key.find(frame)?;
    Some(FieldRef { topic: topic.name.to_string(), path: FieldPath::default() })
}

/// The messages of a topic as far as they are known.
pub(super) struct Density<'a> {
    series: &'a FieldSeries,
    from: Stamp,
}

impl<'a> Density<'a> {
    pub(super) fn of(frame: &'a Frame, selection: &Selection) -> Option<Self> {
        let key = selection.topic.as_ref()?;
        let topic = key.find(frame)?;
        let series = frame.field(&field(frame, key)?, topic.run)?;
        Some(Self { series, from: frame.info.start })
    }

    /// Number of messages from a time until before another.
    fn count(&self, from: Stamp, to: Stamp) -> usize {
        self.series.points.count_before(to).saturating_sub(self.series.points.count_before(from))
    }

    /// Paints the bars: the higher the more messages a step has. Returns what is under the pointer, for a tooltip.
    pub(super) fn paint(&self, ui: &Ui, rect: Rect, scale: &Scale) -> Option<String> {
        let painter = ui.painter_at(rect);
        let color = tokens(ui).accent.gamma_multiply(STRENGTH);
        let all = self.count(scale.stamp(rect.left()), scale.stamp(rect.right())) as f32;
        let is_enough = |width: &&f32| all * **width >= ENOUGH * rect.width();
        let width = *STEPS.iter().find(is_enough).unwrap_or(&STEPS[STEPS.len() - 1]);
        let steps = (rect.width() / width).ceil() as usize;
        let x = |step: usize| rect.left() + step as f32 * width;
        let ends: Vec<usize> =
            (0..=steps).map(|step| self.series.points.count_before(scale.stamp(x(step)))).collect();
        let counts: Vec<usize> = ends.windows(2).map(|pair| pair[1].saturating_sub(pair[0])).collect();
        let most = counts.iter().copied().max().unwrap_or(0).max(1) as f32;
        for (step, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let share = LEAST + (1.0 - LEAST) * *count as f32 / most;
            let top = rect.bottom() - share * rect.height();
            let bar = Rect::from_x_y_ranges(x(step)..=x(step + 1), top..=rect.bottom());
            painter.rect_filled(bar, 0.0, color);
        }
        let pointer = ui.input(|input| input.pointer.hover_pos()).filter(|at| rect.contains(*at))?;
        let begin = x(((pointer.x - rect.left()) / width) as usize);
        let (at, end) = (scale.stamp(begin), scale.stamp(begin + width));
        let (count, topic) = (self.count(at, end), &self.series.field.topic);
        let plural = if count == 1 { "" } else { "s" };
        let time = format::elapsed(at.seconds_since(self.from));
        let over = format::number((end.seconds_since(at) * 1000.0).round() / 1000.0);
        Some(format!("{time}  {topic}: {count} message{plural} in {over} s"))
    }
}
