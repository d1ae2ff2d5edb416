//! The keyboard focus: it is shown, and Escape leaves it where nothing can be stopped.

/// Does what Escape does where nothing can be stopped: closes menus and dialogs, and leaves a field.
pub(super) fn cancel(ctx: &egui::Context) {
    ctx.memory_mut(|memory| {
        if let Some(id) = memory.focused() {
            memory.surrender_focus(id);
        }
    });
    egui::Popup::close_all(ctx);
    ctx.input_mut(|input| {
        input.events.push(egui::Event::Key {
            key: egui::Key::Escape,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers: egui::Modifiers::NONE,
        });
    });
}

/// Marks the widget that has the keyboard focus. Where Escape stops a vehicle, it does not also take the focus away.
pub(super) fn show_focus(ctx: &egui::Context, stops: bool) {
    let Some(id) = ctx.memory(egui::Memory::focused) else { return };
    if stops {
        let keeps = egui::EventFilter {
            escape: true,
            horizontal_arrows: ctx.text_edit_focused(),
            vertical_arrows: ctx.text_edit_focused(),
            tab: false,
        };
        ctx.memory_mut(|memory| memory.set_focus_lock_filter(id, keeps));
    }
    if ctx.text_edit_focused() {
        return;
    }
    let Some(response) = ctx.read_response(id) else { return };
    let accent = ocu_ui::tokens_of(ctx.theme()).accent;
    let painter = ctx.layer_painter(egui::LayerId::new(egui::Order::Foreground, egui::Id::unique("focus")));
    let rect = response.rect.expand(2.0);
    painter.rect_stroke(rect, 4.0, egui::Stroke::new(2.0, accent), egui::StrokeKind::Inside);
}
