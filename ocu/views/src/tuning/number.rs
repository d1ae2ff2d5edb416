//! The control of a number: a slider where its range is narrow, else a number that can be dragged. What is typed and is not
//! accepted is refused: the number stays as it was, and the reason is kept beside it.

use crate::edit::text::number_of;
use egui::emath::{format_with_decimals_in_range, round_to_decimals};
use egui::{DragValue, Id, Response, Slider, SliderClamping, Ui};
use rcs_msg::params::{ParamKind, ParamSpec};
use std::cell::Cell;
use std::ops::RangeInclusive;

/// Most decimals that a slider shows, and to which it rounds what is dragged.
const DECIMALS: usize = 4;
/// Least length of a slider, and the width of the number beside it, screen points.
const LEAST_SLIDER: f32 = 32.0;
const NUMBER: f32 = 96.0;

/// Why what was typed was refused.
#[derive(Clone, Debug)]
struct Refusal {
    reason: String,
    /// The number that stays. The reason goes with it.
    number: f64,
    /// Whether it is still being typed, and may become a number that is accepted, or a button is down since it was.
    is_hidden: bool,
}

/// What a text that is being typed replaces.
#[derive(Clone, Copy, Debug)]
struct Begun {
    /// The number that was shown when typing began.
    shown: f64,
    /// The value that it stands for.
    value: f64,
    /// The value that the control gave back last. Where it is another one now, that has come from elsewhere.
    last: f64,
}

/// Why what was typed last was refused by the control that keeps its refusal at `id`.
pub(super) fn refused(ui: &Ui, id: Id) -> Option<String> {
    let refusal = ui.data(|data| data.get_temp::<Refusal>(id))?;
    (!refusal.is_hidden).then_some(refusal.reason)
}

/// Forgets why what was typed last was refused by the control that keeps its refusal at `id`.
pub(super) fn forget_refused(ui: &Ui, id: Id) {
    ui.data_mut(|data| data.remove::<Refusal>(id));
}

/// Whether a parameter accepts a number.
fn accepts(spec: &ParamSpec, number: f64) -> bool {
    number.is_finite()
        && (spec.kind != ParamKind::Integer || number.fract() == 0.0)
        && spec.min.is_none_or(|min| number >= min)
        && spec.max.is_none_or(|max| number <= max)
}

/// A slider of a number with a narrow range where there is room for one, else a number that can be dragged. Neither showing
/// nor leaving it changes the value, which may have more decimals than are shown; what is typed is taken with all
/// decimals. What is refused leaves the number from before it was typed, and the reason at `id` ([`refused`]).
pub(super) fn number_control(ui: &mut Ui, spec: &ParamSpec, id: Id, new: &mut f64, unit: String) -> Response {
    let before = *new;
    let is_whole = spec.kind == ParamKind::Integer;
    let bounds = spec.min.zip(spec.max).filter(|(min, max)| max - min <= 1e4);
    let typed_id = id.with("typed");
    let begun =
        ui.data(|data| data.get_temp::<Begun>(typed_id)).filter(|begun| begun.last as f32 == before as f32);
    let written = Cell::new(before);
    let write = |value: f64, decimals: RangeInclusive<usize>| {
        let most = if bounds.is_some() && !is_whole { DECIMALS } else { *decimals.end() };
        let text = format_with_decimals_in_range(value, (*decimals.start()).min(most)..=most);
        written.set(text.parse().unwrap_or(value));
        text
    };
    let (is_read, reason) = (Cell::new(false), Cell::new(None));
    let read = |text: &str| {
        let (shown, value) = begun.map_or((written.get(), before), |begun| (begun.shown, begun.value));
        let typed = number_of(text);
        let accepted = typed.filter(|typed| *typed != shown && accepts(spec, *typed));
        let is_refused = accepted.is_none() && typed != Some(shown);
        let refusal = || format!("got {:?}, expected {}", text.trim(), spec.expected());
        is_read.set(true);
        reason.set(is_refused.then(refusal));
        Some(accepted.unwrap_or(value))
    };
    let has_room = ui.available_width() >= LEAST_SLIDER + NUMBER;
    let response = if let Some((min, max)) = bounds.filter(|_| has_room) {
        ui.spacing_mut().slider_width = ui.available_width() - NUMBER;
        let wide = !is_whole && min > 0.0 && max / min > 500.0;
        let slider = Slider::new(new, min..=max).suffix(unit).logarithmic(wide);
        let slider = if is_whole { slider.integer() } else { slider }.clamping(SliderClamping::Edits);
        ui.add(slider.custom_formatter(write).custom_parser(read))
    } else {
        let range = spec.min.unwrap_or(f64::MIN)..=spec.max.unwrap_or(f64::MAX);
        let drag = DragValue::new(new).range(range).suffix(unit).clamp_existing_to_range(false);
        let drag = if is_whole {
            drag.speed(0.25).max_decimals(0)
        } else {
            drag.speed((before.abs() * 0.01).max(0.001))
        };
        ui.add(drag.custom_formatter(write).custom_parser(read))
    };
    let is_typed = response.has_focus() || response.lost_focus();
    // Where the arrow keys or the pointer change the number, what is typed after that begins with it.
    let is_moved = !is_read.get() && *new != before;
    let is_typing = response.has_focus() && !is_moved;
    let begins = Begun { shown: written.get(), value: before, last: before };
    ui.data_mut(|data| {
        if is_typing {
            data.insert_temp(typed_id, Begun { last: *new, ..begun.unwrap_or(begins) });
        } else {
            data.remove::<Begun>(typed_id);
        }
    });
    if bounds.is_some() && !is_typed && *new != before {
        *new = round_to_decimals(*new, DECIMALS);
    }
    let kept = ui.data(|data| data.get_temp::<Refusal>(id)).filter(|refusal| refusal.number == *new);
    // The reason is a line more: with a button down, it would move what is being pressed.
    let is_pressed = ui.input(|input| input.pointer.any_down());
    let refusal = if is_read.get() {
        let is_hidden = response.has_focus() || is_pressed;
        reason.take().map(|reason| Refusal { reason, number: *new, is_hidden })
    } else {
        kept.map(|kept| Refusal { is_hidden: response.has_focus() || (kept.is_hidden && is_pressed), ..kept })
    };
    ui.data_mut(|data| match refusal {
        Some(refusal) => {
            data.insert_temp(id, refusal);
        }
        None => data.remove::<Refusal>(id),
    });
    response
}

/// The shortest number that a 32-bit field stores as this value; other values as they are.
pub(super) fn shortest(number: f64) -> f64 {
    let narrow = number as f32;
    if f64::from(narrow) == number { narrow.to_string().parse().unwrap_or(number) } else { number }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::params::specs;
    use rcs_msg::rcs::SpeedLimit;
    use rcs_msg::schema_of;

    #[test]
    fn a_number_of_32_bits_is_shown_as_it_was_written() {
        assert_eq!(shortest(f64::from(0.1_f32)), 0.1);
        assert_eq!((shortest(0.003_906_25), shortest(0.1)), (0.003_906_25, 0.1));
        assert!(shortest(f64::NAN).is_nan());
    }

    #[test]
    fn a_number_is_read_with_a_decimal_point_or_comma_and_accepted_within_its_range() {
        let speed = &specs(schema_of::<SpeedLimit>().descriptor().unwrap())[0];
        let whole = ParamSpec { kind: ParamKind::Integer, ..speed.clone() };
        let accepted = |spec: &ParamSpec, text: &str| number_of(text).filter(|number| accepts(spec, *number));
        for (text, number) in [
            ("1.5", Some(1.5)),
            (" 1,5 ", Some(1.5)),
            ("10", Some(10.0)),
            ("10.1", None),
            ("\u{2212}1", None),
            ("nan", None),
            ("inf", None),
            ("1,234.5", None),
            ("fast", None),
            ("", None),
        ] {
            assert_eq!(accepted(speed, text), number, "{text:?}");
        }
        assert_eq!((accepted(&whole, "2"), accepted(&whole, "2,5")), (Some(2.0), None));
    }
}
