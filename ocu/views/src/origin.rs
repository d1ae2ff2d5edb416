//! Who wrote this: from a value back to the message that last changed it.

use crate::view::{RunChoice, TopicKey, ViewContext};
use egui::{RichText, Ui};
use ocu_ui::{format, icons, tokens, widgets};
use rcs_formula::FieldRef;
use rcs_msg::{FieldPath, Stamp};
use rcs_runtime::source::{Control, FieldPoint, Frame, Series};

/// A search for the last change of a field, and what it found.
#[derive(Default)]
pub(crate) struct Origin {
    field: Option<FieldRef>,
    /// The run of its topic.
    run: RunChoice,
    /// The time from which it looks back.
    from: Stamp,
    found: Option<Found>,
}

/// The last change.
#[derive(Clone, Debug, PartialEq)]
struct Found {
    at: Stamp,
    /// Whether it was the first message, so that nothing is known from before.
    is_first: bool,
    value: String,
    before: String,
}

/// The first of the equal values at and before a time: its index, and whether none is known before it.
fn last_change(points: &Series<FieldPoint>, now: Stamp) -> Option<(usize, bool)> {
    let same = |a: f64, b: f64| a == b || (a.is_nan() && b.is_nan());
    let (mut index, mut change, mut before) = (0, None, None);
    points.each(0..points.count_until(now), |point| {
        if before.is_none_or(|before| !same(before, point.value)) {
            change = Some((index, index == 0));
        }
        (index, before) = (index + 1, Some(point.value));
    });
    change
}

impl Origin {
    /// Begins to look for the last change of a field before the viewed time.
    pub(crate) fn begin(&mut self, frame: &Frame, topic: &TopicKey, path: &FieldPath) {
        self.field = Some(FieldRef { topic: topic.name.clone(), path: path.clone() });
        (self.run, self.from, self.found) = (topic.run, frame.now, None);
    }

    /// The field whose values it needs.
    pub(crate) fn field(&self) -> Option<FieldRef> {
        self.field.clone()
    }

    /// Paints what was found; goes to the change once it is known.
    pub(crate) fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let Some(field) = &self.field else { return };
        let frame = cx.frame;
        let series = frame.field(field, self.run.tag(frame));
        let topic = TopicKey { name: field.topic.clone(), run: self.run }.find(frame);
        let writer = topic.map(|topic| topic.writer.clone()).unwrap_or_default();
        if let (None, Some(series)) = (&self.found, series.filter(|series| series.reading.is_none()))
            && let Some((index, is_first)) = last_change(&series.points, self.from)
        {
            let text = |index: usize| {
                let value = series.points.get(index).map_or(f64::NAN, |point| point.value);
                let name = series.names.get(&(value as i64)).filter(|_| value.is_finite());
                name.map_or_else(|| format::number(value), ToString::to_string)
            };
            let at = series.points.get(index).map_or(self.from, |point| point.stamp);
            let before = if is_first { String::new() } else { text(index - 1) };
            self.found = Some(Found { at, is_first, value: text(index), before });
            if !frame.is_beside {
                cx.controls.extend(Control::pause_at(at));
            }
            if !writer.is_empty() {
                cx.selection.process = Some(writer.clone());
            }
        }
        let margin = egui::Margin::symmetric(8, 4);
        let mut closed = false;
        egui::Frame::new().inner_margin(margin).fill(tokens(ui).surface[3]).show(ui, |ui| {
            ui.set_width(ui.available_width());
            ui.horizontal_wrapped(|ui| {
                let text = match (&self.found, series.and_then(|series| series.problem.as_ref())) {
                    (Some(found), _) => {
                        let at = format::elapsed(found.at.seconds_since(frame.info.start));
                        let by = if writer.is_empty() {
                            "nobody that is known".to_owned()
                        } else {
                            writer.to_string()
                        };
                        let was = if found.is_first {
                            "its first value".to_owned()
                        } else {
                            format!("before: {}", found.before)
                        };
                        format!("{field} = {} was written at {at} by {by} ({was})", found.value)
                    }
                    (None, Some(problem)) => format!("{field}: {problem}"),
                    (None, None) => format!("looking for the last change of {field} …"),
                };
                ui.label(RichText::new(text).small());
                let back = egui::Button::new("Back").small();
                if self.found.is_some() && ui.add(back).on_hover_text("Go back to where you were").clicked() {
                    cx.controls.push(Control::Seek(self.from));
                }
                closed = widgets::icon_button(ui, icons::ICON_CLOSE, "Close who wrote this").clicked();
            });
        });
        if closed {
            *self = Self::default();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_change_is_where_the_value_began() {
        let values = [1.0, 1.0, 2.0, 2.0, f64::NAN, f64::NAN, 3.0];
        let points: Series<FieldPoint> =
            values.iter().zip(1..).map(|(&value, i)| FieldPoint { stamp: Stamp(i * 10), value }).collect();
        for (now, wanted) in [
            (5, None),
            (10, Some((0, true))),
            (29, Some((0, true))),
            (30, Some((2, false))),
            (49, Some((2, false))),
            (69, Some((4, false))),
            (99, Some((6, false))),
        ] {
            assert_eq!(last_change(&points, Stamp(now)), wanted, "{now}");
        }
    }
}
