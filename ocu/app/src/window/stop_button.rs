//! The emergency stop in the top bar. It has a fixed place and size, and each of its states has a look of its own:
//! colour, shape and word.

use super::operate::StopState;
use egui::{Color32, Rect, Role, Sense, Stroke, StrokeKind, Ui, Vec2, WidgetInfo};
use ocu_ui::bar::Form;
use ocu_ui::{Icon, icons, stale, tokens, widgets};

/// Size of the button, and of the button that releases the stop, which keeps its place when it is not shown.
const STOP: Vec2 = Vec2::new(148.0, 24.0);
const RELEASE: Vec2 = Vec2::new(96.0, 24.0);
/// The same in a narrow window.
const SHORT_STOP: Vec2 = Vec2::new(132.0, 24.0);
const SHORT_RELEASE: Vec2 = Vec2::new(28.0, 24.0);

/// How a state looks.
struct Look {
    word: &'static str,
    icon: Icon,
    fill: Color32,
    ink: Color32,
    edge: Stroke,
    /// Whether the vehicle does not do yet what was requested.
    is_open: bool,
    help: &'static str,
}

impl Look {
    fn of(ui: &Ui, state: StopState) -> Option<Self> {
        let tokens = tokens(ui);
        Some(match state {
            StopState::None => return None,
            StopState::Clear => Self {
                word: "STOP",
                icon: icons::ICON_DANGEROUS,
                fill: tokens.stop,
                ink: tokens.on_stop,
                edge: Stroke::NONE,
                is_open: false,
                help: "Emergency stop (Esc)",
            },
            StopState::Asked { active, late, waits } => Self {
                word: match (active, late) {
                    (_, true) => "NOT CONFIRMED",
                    (true, false) => "STOPPING…",
                    (false, false) => "RELEASING…",
                },
                icon: if late { icons::ICON_ERROR } else { icons::ICON_HOURGLASS_TOP },
                fill: tokens.warning,
                ink: tokens.on_warning,
                edge: Stroke::NONE,
                is_open: true,
                help: match (waits, active, late) {
                    (true, true, _) => "Time stands: the stop takes effect when time goes on (space).",
                    (true, false, _) => {
                        "Time stands: the release takes effect when time goes on (space). Press to stop."
                    }
                    (false, _, true) => "The vehicle does not say that it obeys. Press to stop.",
                    (false, _, false) => "Sent; the vehicle has not said yet that it obeys. Press to stop.",
                },
            },
            StopState::Braking { late } => Self {
                word: if late { "STILL MOVING" } else { "STOPPING…" },
                icon: if late { icons::ICON_ERROR } else { icons::ICON_HOURGLASS_TOP },
                fill: tokens.warning,
                ink: tokens.on_warning,
                edge: Stroke::NONE,
                is_open: true,
                help: if late {
                    "The vehicle says that it obeys, and has moved on for more than 3 s: a value that is held may \
                     replace its commands, or it does not obey. Press to stop again and to release what is held."
                } else {
                    "The vehicle says that it obeys, and still rolls. Press to send the stop again."
                },
            },
            StopState::Stopped { has_speed } => Self {
                word: "STOPPED",
                icon: icons::ICON_LOCK,
                fill: tokens.surface[0],
                ink: tokens.strong,
                edge: Stroke::new(2.0, tokens.error),
                is_open: false,
                help: if has_speed {
                    "The vehicle says that it obeys the stop, and it stands. Release it with the button beside this \
                     one."
                } else {
                    "The vehicle says that it obeys the stop; it reports no speed. Release it with the button beside \
                     this one."
                },
            },
        })
    }
}

/// Paints the buttons; returns whether a stop (`true`) or its release (`false`) is requested. Nothing is released while
/// a control is deflected (`pushed`), because a release must not start motion.
pub(super) fn ui(ui: &mut Ui, form: Form, state: StopState, pushed: bool) -> Option<bool> {
    let look = Look::of(ui, state)?;
    let mut wish = None;
    let (stop, release) = if form == Form::Short { (SHORT_STOP, SHORT_RELEASE) } else { (STOP, RELEASE) };
    let (place, _) = ui.allocate_exact_size(release, Sense::hover());
    // Also without the button in it, so that the id of the other one stays the same while it is pressed.
    let mut beside = ui.new_child(egui::UiBuilder::new().max_rect(place));
    if state.can_be_released() {
        let icon = icons::ICON_LOCK_OPEN.codepoint;
        let text = if form == Form::Short { icon.to_owned() } else { format!("{icon}  Release") };
        let button = egui::Button::new(text).min_size(release);
        let release = beside.add_enabled(!pushed, button);
        release.widget_info(|| WidgetInfo::labeled(Role::Button, !pushed, "Release"));
        let release = release
            .on_hover_text(
                "Release the stop: a stack that drives goes on at once; by hand, nothing moves until the controls have \
                 been let go and are used again",
            )
            .on_disabled_hover_text("Let go of the controls first: a release must not start motion.");
        if release.clicked() {
            wish = Some(false);
        }
    }
    let (rect, response) = ui.allocate_exact_size(stop, Sense::click());
    response
        .widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Emergency stop: {}", look.word)));
    paint(ui, rect, &look, response.hovered());
    let has_stopped = matches!(state, StopState::Stopped { .. });
    if response.on_hover_text(look.help).clicked() && !has_stopped {
        wish = Some(true);
    }
    wish
}

fn paint(ui: &Ui, rect: Rect, look: &Look, hovered: bool) {
    let painter = ui.painter_at(rect.expand(1.0));
    let fill = if hovered { look.fill.lerp_to_gamma(look.ink, 0.12) } else { look.fill };
    painter.rect(rect, 3.0, fill, look.edge, StrokeKind::Inside);
    let font = egui::FontId::proportional(13.0);
    let galley = painter.layout_no_wrap(look.word.to_owned(), font, look.ink);
    let left = rect.center().x - 0.5 * (galley.size().x + 24.0);
    if look.is_open {
        // Hatched beside the text, so that the colour is not the only difference.
        for part in [
            Rect::from_min_max(rect.min, egui::pos2(left - 4.0, rect.bottom())),
            Rect::from_min_max(egui::pos2(left + galley.size().x + 28.0, rect.top()), rect.max),
        ] {
            stale::hatch(&painter, part.shrink2(Vec2::new(2.0, 0.0)), look.ink.gamma_multiply(0.6));
        }
    }
    widgets::icon_at(&painter, egui::pos2(left + 8.0, rect.center().y + 1.0), look.icon, 16.0, look.ink);
    let at = egui::pos2(left + 24.0, rect.center().y - galley.size().y / 2.0);
    painter.galley(at, galley, look.ink);
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use std::cell::Cell;

    #[test]
    fn a_press_on_the_stop_counts_although_the_state_changes_before_the_release() {
        let late = StopState::Asked { active: true, late: true, waits: false };
        let braking = StopState::Braking { late: false };
        for [first, then] in [
            [braking, late],
            [late, braking],
            [braking, StopState::Clear],
            [StopState::Clear, braking],
            [braking, StopState::Braking { late: true }],
        ] {
            let (state, stops) = (Cell::new(first), Cell::new(0));
            let mut harness = Harness::builder()
                .with_size(Vec2::new(400.0, 60.0))
                .with_context_setup(ocu_ui::install)
                .build_ui(|ui| {
                    let wish = ui.horizontal(|ui| super::ui(ui, Form::Full, state.get(), false)).inner;
                    stops.set(stops.get() + u32::from(wish == Some(true)));
                });
            harness.run();
            let at = harness.get_by_label_contains("Emergency stop").rect().center();
            harness.drag_at(at);
            harness.step();
            state.set(then);
            harness.step();
            harness.drop_at(at);
            harness.step();
            assert_eq!(stops.get(), 1, "{first:?}, then {then:?}");
        }
    }
}
