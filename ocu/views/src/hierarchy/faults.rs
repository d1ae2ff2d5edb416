//! Faults on demand of a process: the menu that sets them, and what is in force.

use crate::edit;
use crate::view::ViewContext;
use egui::{Button, RichText, Ui};
use ocu_ui::{tokens, widgets};
use rcs_msg::rcs::fault::Kind;
use rcs_msg::rcs::{Fault, OverrideInForce, ProcessInfo};
use rcs_runtime::source::{Control, SourceKind};

/// The faults in the menu.
fn choices() -> [(&'static str, &'static str, Fault); 9] {
    let of = |kind: Kind| Fault { kind: kind.into(), ..Fault::default() };
    let delay = |kind: Kind, delay_ms: f64| Fault { delay_ms, ..of(kind) };
    let slowed = "Each cycle takes longer; cycles that would begin before the last one has ended are skipped";
    let late = "Its messages become visible later";
    [
        ("Stopped", "Its cycles do not run", of(Kind::Stopped)),
        ("Slowed by 100 ms", slowed, delay(Kind::Slowed, 100.0)),
        ("Slowed by 500 ms", slowed, delay(Kind::Slowed, 500.0)),
        ("Frozen", "Its outputs repeat their newest messages", of(Kind::Frozen)),
        ("NaN", "The floating-point numbers of its outputs are NaN", of(Kind::Nan)),
        ("All messages dropped", "Its outputs are not published", of(Kind::Dropped)),
        ("One of 3 messages dropped", "Every third message", Fault { every: 3, ..of(Kind::Dropped) }),
        ("200 ms late", late, delay(Kind::Late, 200.0)),
        ("1 s late", late, delay(Kind::Late, 1000.0)),
    ]
}

/// The faults of a process that are in force, in words.
pub(super) fn text(held: &[OverrideInForce], process: &str) -> Option<String> {
    let faults = held.iter().filter(|held| !held.fault.is_empty() && held.process == process);
    let faults: Vec<&str> = faults.map(|held| held.fault.as_str()).collect();
    (!faults.is_empty()).then(|| faults.join(", "))
}

/// The part of the menu of a box that sets and releases faults.
pub(super) fn menu(ui: &mut Ui, cx: &mut ViewContext<'_>, process: &ProcessInfo, refused: Option<&str>) {
    let mut control: Option<Control> = None;
    for held in edit::overrides(cx.frame) {
        if held.process != process.name || held.fault.is_empty() {
            continue;
        }
        let text = RichText::new(format!("End: {}", held.fault)).color(tokens(ui).warning);
        let button = |ui: &mut Ui| ui.add_enabled(refused.is_none(), Button::new(text)).clicked();
        // One that ends while the mouse is pressed moves those after it.
        if widgets::named(ui, held.id, button) {
            control = edit::release(cx.frame, Some(held.id));
        }
    }
    let is_stack = cx.frame.info.kind != SourceKind::Log;
    let faults = |ui: &mut Ui| {
        for (name, help, fault) in choices() {
            if ui.button(name).on_hover_text(help).clicked() {
                control = edit::fault(cx.frame, &process.name, fault);
            }
        }
    };
    widgets::named(ui, "faults", |ui| {
        ui.add_enabled_ui(refused.is_none() && is_stack, |ui| ui.menu_button("Fault on demand", faults));
    });
    if let Some(control) = control {
        cx.controls.push(control);
        ui.close();
    }
}
