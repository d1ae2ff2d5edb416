//! Text fields of one line: what Enter does in them, and which of them have the keys.
//!
//! `egui` takes the keyboard from a field when Enter is pressed in it. What is typed after a text that was refused would
//! then be keys of the window, which step through time and drive.

use egui::{Context, Id, Key, Order, Response};

/// Whether Enter was pressed in a field in this pass. The field keeps the keyboard: one whose text is accepted closes, or
/// is ready for the next text.
pub fn entered(field: &Response) -> bool {
    note(field);
    let entered = field.lost_focus() && field.ctx.input(|input| input.key_pressed(Key::Enter));
    if entered {
        field.request_focus();
    }
    entered
}

/// Gives the keyboard to the field of a dialog that has just been opened, and to that of an open one whenever no other
/// widget has it.
pub fn keep_keyboard(field: &Response, is_fresh: bool) {
    note(field);
    if is_fresh || field.ctx.memory(|memory| memory.focused().is_none()) {
        field.request_focus();
    }
}

/// Notes a field that lies over the views, in a menu or a dialog. [`entered`] and [`keep_keyboard`] do so, too.
pub fn note(field: &Response) {
    if field.layer_id.order != Order::Background {
        let pass = field.ctx.cumulative_pass_nr();
        field.ctx.data_mut(|data| data.insert_temp(noted(), pass));
    }
}

/// Whether keys that can be typed belong to a text field: it has the keyboard, or a menu or a dialog with one is open.
pub fn takes_keys(ctx: &Context) -> bool {
    let noted: Option<u64> = ctx.data(|data| data.get_temp(noted()));
    // The keys of a pass are read before its fields are painted.
    let is_open = noted.is_some_and(|pass| pass + 1 >= ctx.cumulative_pass_nr());
    is_open || ctx.text_edit_focused()
}

/// Where the last pass with a noted field is stored.
fn noted() -> Id {
    Id::unique("a text field over the views is open")
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::{CentralPanel, Event, Modifiers, RawInput, TextEdit, Window};

    /// A pass with a field in the panel, or in a dialog that is open or not. Returns whether Enter was pressed in the field,
    /// whether it has the keyboard, and whether a field had the keys when the pass began.
    fn pass(ctx: &Context, in_dialog: Option<bool>, pressed: Option<Key>) -> (bool, bool, bool) {
        let press = |key| Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers: Modifiers::NONE,
        };
        let input = RawInput { events: pressed.map(press).into_iter().collect(), ..RawInput::default() };
        let (mut text, mut seen) = ("refused".to_owned(), (false, false, false));
        let output = ctx.run_ui(input, |ui| {
            seen = (false, false, takes_keys(ui.ctx()));
            let field = |ui: &mut egui::Ui| {
                let response = ui.add(TextEdit::singleline(&mut text));
                seen.0 = entered(&response);
                seen.1 = response.has_focus();
                if pressed.is_none() && in_dialog.is_none() {
                    response.request_focus();
                }
            };
            match in_dialog {
                Some(true) => drop(Window::new("dialog").show(ui.ctx(), field)),
                Some(false) => {}
                None => drop(CentralPanel::default().show(ui, field)),
            }
        });
        output.drop_without_applying_deltas();
        seen
    }

    #[test]
    fn a_field_keeps_the_keyboard_when_enter_is_pressed_in_it() {
        let ctx = Context::default();
        crate::install(&ctx);
        pass(&ctx, None, None);
        pass(&ctx, None, None);
        assert_eq!(pass(&ctx, None, Some(Key::Enter)), (true, true, true));
        assert_eq!(pass(&ctx, None, Some(Key::A)), (false, true, true));
    }

    #[test]
    fn a_dialog_with_a_field_takes_the_keys_until_it_is_closed_although_the_field_has_no_keyboard() {
        let ctx = Context::default();
        crate::install(&ctx);
        pass(&ctx, Some(true), None);
        assert_eq!(pass(&ctx, Some(true), None), (false, false, true));
        pass(&ctx, Some(false), None);
        assert_eq!(pass(&ctx, Some(false), None), (false, false, false));
    }
}
