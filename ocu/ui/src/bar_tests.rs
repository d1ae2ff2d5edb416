//! The forms of the items of a bar, and clicks while they change.

use super::*;

fn shape(fit: Fit, full: f32, short: f32) -> Shape {
    Shape { fit, full, short }
}

/// Paints one frame of a bar of 300 points.
fn frame(
    ctx: &egui::Context,
    events: Vec<egui::Event>,
    mut show: impl FnMut(&mut Ui),
) -> egui::PlatformOutput {
    let input = egui::RawInput {
        screen_rect: Some(Rect::from_min_size(Pos2::ZERO, Vec2::new(300.0, 100.0))),
        events,
        ..egui::RawInput::default()
    };
    let mut output = ctx.run_ui(input, &mut show);
    output.textures_delta.clear();
    std::mem::take(&mut output.platform_output)
}

#[test]
fn a_bar_has_its_forms_at_once_and_settles_after_a_change_within_a_frame() {
    let ctx = egui::Context::default();
    crate::theme::install(&ctx);
    let show = |word: &str| {
        let mut painted = Vec::new();
        let output = frame(&ctx, Vec::new(), |ui| {
            let mut bar = Bar::new("bar");
            for name in ["one", "two", "three", "four", "five", "six"] {
                bar.left(name, Fit::Leaves(1), |ui, form, painted: &mut Vec<(Form, bool)>| {
                    painted.push((form, ui.is_visible()));
                    ui.label(if form == Form::Short { "." } else { word });
                });
            }
            painted.clear();
            bar.show(ui, 20.0, &mut painted);
        });
        (output.num_completed_passes, output.requested_discard(), painted)
    };
    let all = |form: Form| vec![(form, true); 6];
    let long = "more than what fits ".repeat(10);
    assert_eq!(show("word"), (2, false, all(Form::Full)));
    assert_eq!(show("word"), (1, false, all(Form::Full)));
    assert_eq!(show(&long), (3, false, all(Form::Short)));
    assert_eq!(show(&long), (1, false, all(Form::Short)));
}

#[test]
fn a_click_counts_although_another_item_appears_while_the_button_is_down() {
    let ctx = egui::Context::default();
    crate::theme::install(&ctx);
    let mut at = Pos2::ZERO;
    let mut show = |events: Vec<egui::Event>, has_more: bool| {
        let mut clicks = 0;
        frame(&ctx, events, |ui| {
            let mut bar = Bar::new("bar");
            if has_more {
                bar.left("alarm", Fit::Leaves(1), |ui, _, _: &mut u32| drop(ui.label("alarm")));
            }
            bar.right("stop", Fit::Stays, |ui, _, clicks: &mut u32| {
                let response = ui.button("Stop");
                at = response.rect.center();
                *clicks += u32::from(response.clicked());
            });
            bar.show(ui, 20.0, &mut clicks);
            let after = ui.button("after the bar");
            clicks += 10 * u32::from(after.clicked());
        });
        (clicks, at)
    };
    let (_, stop) = show(Vec::new(), false);
    for (at, expected) in [(stop, 1), (Pos2::new(20.0, 38.0), 10)] {
        let button = |pressed: bool| egui::Event::PointerButton {
            pos: at,
            button: egui::PointerButton::Primary,
            pressed,
            modifiers: egui::Modifiers::NONE,
        };
        assert_eq!(show(vec![egui::Event::PointerMoved(at)], false).0, 0);
        assert_eq!(show(vec![button(true)], false).0, 0);
        assert_eq!(show(Vec::new(), true).0, 0);
        assert_eq!(show(vec![button(false)], true).0, expected);
    }
}

#[test]
fn a_menu_stays_open_although_its_button_would_move_into_the_menu_of_the_bar() {
    /// The form of the button, and whether its menu is open.
    type Seen = (Option<Form>, bool);
    let ctx = egui::Context::default();
    crate::theme::install(&ctx);
    let mut at = Pos2::ZERO;
    let mut show = |events: Vec<egui::Event>, alarm: &str| {
        let mut seen: Seen = (None, false);
        frame(&ctx, events, |ui| {
            let mut bar = Bar::new("bar");
            bar.left("alarm", Fit::Stays, |ui, _, _: &mut Seen| drop(ui.label(alarm)));
            bar.right("layout", Fit::Leaves(1), |ui, form, seen: &mut Seen| {
                seen.0 = Some(form);
                let menu = menu(ui, form, icons::ICON_LAYERS, "Layout", |_| seen.1 = true);
                at = menu.rect.center();
            });
            seen = (None, false);
            bar.show(ui, 20.0, &mut seen);
        });
        (seen, at)
    };
    let long = "more than what fits ".repeat(3);
    let button = |pos: Pos2, pressed: bool| egui::Event::PointerButton {
        pos,
        button: egui::PointerButton::Primary,
        pressed,
        modifiers: egui::Modifiers::NONE,
    };
    let (seen, layout) = show(Vec::new(), "");
    assert_eq!(seen, (Some(Form::Full), false));
    show(vec![egui::Event::PointerMoved(layout)], "");
    show(vec![button(layout, true)], "");
    assert_eq!(show(vec![button(layout, false)], "").0, (Some(Form::Full), true));
    for _ in 0..3 {
        assert_eq!(show(Vec::new(), &long).0, (Some(Form::Full), true));
    }
    let away = Pos2::new(20.0, 90.0);
    show(vec![egui::Event::PointerMoved(away)], &long);
    show(vec![button(away, true)], &long);
    show(vec![button(away, false)], &long);
    let (form, is_open) = show(Vec::new(), &long).0;
    assert_eq!((form == Some(Form::Full), is_open), (false, false));
}

#[test]
fn a_tag_with_a_short_form_becomes_short_before_a_menu_loses_its_name() {
    use Form::{Full, Listed, Short};
    let items = [shape(Fit::Leaves(40), 60.0, 24.0), shape(Fit::Shortens(85), 100.0, 50.0)];
    let at = |room: f32| forms(&items, room, 8.0);
    assert_eq!(at(168.0), [Some(Full), Some(Full)]);
    assert_eq!(at(167.0), [Some(Full), Some(Short)]);
    assert_eq!(at(117.0), [Some(Short), Some(Short)]);
    assert_eq!(at(81.0), [Some(Listed), Some(Listed)]);
}

#[test]
fn items_become_short_then_move_into_the_menu_by_worth_and_what_stays_stays() {
    use Form::{Full, Listed, Short};
    let items = [
        shape(Fit::Leaves(20), 80.0, 24.0),
        shape(Fit::Leaves(10), 60.0, 24.0),
        shape(Fit::Stretches(40.0), 0.0, 0.0),
        shape(Fit::Stays, 100.0, 50.0),
    ];
    let silent = [shape(Fit::Leaves(1), 0.0, 0.0), shape(Fit::Stays, 100.0, 50.0)];
    assert_eq!(forms(&silent, 60.0, 8.0), [Some(Full), Some(Short)], "no menu of nothing");
    let at = |room: f32| forms(&items, room, 8.0);
    assert_eq!(at(304.0), [Some(Full); 4]);
    assert_eq!(at(303.0), [Some(Full), Some(Short), Some(Full), Some(Full)]);
    assert_eq!(at(230.0), [Some(Short), Some(Short), Some(Full), Some(Full)]);
    assert_eq!(at(200.0)[3], Some(Full), "what stays becomes short last");
    assert_eq!(at(185.0), [Some(Listed), Some(Listed), Some(Full), Some(Full)]);
    assert_eq!(at(140.0), [Some(Listed), Some(Listed), Some(Full), Some(Short)]);
    assert_eq!(at(90.0), [Some(Listed), Some(Listed), None, Some(Short)]);
    for room in 90..400 {
        let forms = at(room as f32);
        let width: f32 = items
            .iter()
            .zip(&forms)
            .map(|(item, form)| match form {
                Some(Full) if matches!(item.fit, Fit::Stretches(_)) => 48.0,
                Some(Full) => item.full + 8.0,
                Some(Short) => item.short + 8.0,
                _ => 0.0,
            })
            .sum();
        let menu = if forms.contains(&Some(Listed)) { MORE } else { -8.0 };
        assert!(width + menu <= room as f32, "{room}: {forms:?}");
    }
}
