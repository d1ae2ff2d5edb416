//! The arcs that were considered, the best one first, with the terms of their scores as bars.

use super::heading;
use super::terms::{ARC_TERMS, color};
use crate::view::{Hover, TopicKey, ViewContext};
use egui::{Align, FontId, Mesh, Pos2, Rect, Role, Sense, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, icons, legend, tokens, widgets};
use rcs_msg::rcs::scored_arc::Motion;
use rcs_msg::rcs::{ArcChoice, ScoredArc};
use rcs_runtime::source::Topic;

const ROW: f32 = 16.0;
const NAME: f32 = 148.0;
const FREE: f32 = 64.0;
const TOTAL: f32 = 56.0;

pub(super) fn show(ui: &mut Ui, cx: &mut ViewContext<'_>, topic: &Topic, choice: &ArcChoice) {
    heading(ui, cx.frame, topic, "Arcs considered", &sentence(choice));
    if choice.arcs.is_empty() {
        return;
    }
    ui.add_space(4.0);
    let entries = ARC_TERMS.iter().enumerate().map(|(index, (name, _))| (color(ui, index), (*name).into()));
    legend::swatches(ui, entries.collect::<Vec<_>>());
    let most = choice.arcs.iter().map(sum).fold(0.0, f64::max).max(1e-6);
    let meant = cx.selection.hovered.get();
    let is_ours = meant.topic.as_ref().is_some_and(|key| key.is(topic));
    let meant = meant.field.clone().filter(|_| is_ours);
    header(ui);
    ui.spacing_mut().item_spacing.y = 0.0;
    for index in order(choice) {
        let field = field(index);
        let is_meant = meant.as_deref() == Some(&*field);
        if row(ui, &choice.arcs[index], choice.chosen == Some(index as u32), is_meant, most) {
            cx.selection.hovered.set(Hover {
                topic: Some(TopicKey::of(topic)),
                field: Some(field.into()),
                ..Hover::default()
            });
        }
    }
}

/// The field of the message that holds an arc.
fn field(index: usize) -> String {
    format!(".arcs[{index}]")
}

/// The arcs that may be driven by their scores, then the others.
fn order(choice: &ArcChoice) -> Vec<usize> {
    let mut order: Vec<usize> = (0..choice.arcs.len()).collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (&choice.arcs[a], &choice.arcs[b]);
        b.open.cmp(&a.open).then(a.total.total_cmp(&b.total))
    });
    order
}

fn sentence(choice: &ArcChoice) -> String {
    let open = choice.arcs.iter().filter(|arc| arc.open).count();
    let counted = format!("{open} of {} arcs may be driven", choice.arcs.len());
    let chosen = choice.chosen.and_then(|index| choice.arcs.get(index as usize));
    let drives = match chosen {
        None => "; none was chosen".to_owned(),
        Some(arc) => format!(
            "; chosen: {}, at {:.2} m/s and {:.2} rad/s",
            name(arc),
            choice.speed_mps + 0.0,
            choice.yaw_rate_radps + 0.0
        ),
    };
    let mode = if choice.mode.is_empty() { String::new() } else { format!("; mode {}", choice.mode) };
    counted + &drives + &mode
}

/// Sum of what is shown of a score.
fn sum(arc: &ScoredArc) -> f64 {
    let terms = ARC_TERMS.iter().map(|(_, of)| f64::from(of(arc)));
    terms.filter(|term| term.is_finite() && *term > 0.0).sum()
}

/// How the vehicle moves along an arc.
fn name(arc: &ScoredArc) -> String {
    let bend = || match arc.curvature_per_m {
        bend if bend > 0.0 => format!("left {bend:.2} /m"),
        bend if bend < 0.0 => format!("right {:.2} /m", -bend),
        _ => "straight".to_owned(),
    };
    match arc.motion() {
        Motion::Forward => bend(),
        Motion::Backward => format!("back, {}", bend()),
        Motion::TurnLeft => "turn on the spot, left".to_owned(),
        Motion::TurnRight => "turn on the spot, right".to_owned(),
    }
}

/// Places of name, free length, score and bar.
fn places(rect: Rect) -> [Rect; 4] {
    let mut left = rect.left() + 20.0;
    let mut take = |width: f32| {
        let place = Rect::from_x_y_ranges(left..=left + width, rect.y_range());
        left += width + 8.0;
        place
    };
    let (name, free, total) = (take(NAME), take(FREE), take(TOTAL));
    let bar = Rect::from_x_y_ranges(left..=rect.right().max(left), rect.y_range());
    [name, free, total, bar]
}

fn header(ui: &mut Ui) {
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
    let [name, free, total, bar] = places(rect);
    let (font, weak) = (FontId::proportional(11.0), tokens(ui).weak);
    widgets::cell(ui, name, Align::Min, "arc", font.clone(), weak);
    widgets::cell(ui, free, Align::Max, "free", font.clone(), weak);
    widgets::cell(ui, total, Align::Max, "score", font.clone(), weak);
    widgets::cell(ui, bar, Align::Min, "terms of the score; the lowest sum wins", font, weak);
}

/// Paints the row of an arc; returns whether the pointer is on it.
fn row(ui: &mut Ui, arc: &ScoredArc, is_chosen: bool, is_meant: bool, most: f64) -> bool {
    let tokens = tokens(ui);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
    let state = match (is_chosen, arc.open) {
        (true, _) => "chosen",
        (false, true) => "may be driven",
        (false, false) => "blocked",
    };
    let told = format!("{}: {state}, score {:.2}, free {:.1} m", name(arc), arc.total, arc.free_m);
    response.widget_info(|| WidgetInfo::labeled(Role::Label, true, &told));
    if is_chosen {
        ui.painter().rect_filled(rect, 0.0, tokens.selected);
    } else if response.hovered() || is_meant {
        ui.painter().rect_filled(rect, 0.0, tokens.surface[2]);
    }
    let mark = rect.left_center() + Vec2::new(9.0, 0.0);
    if is_chosen {
        widgets::icon_at(ui.painter(), mark, icons::ICON_CHECK, 13.0, tokens.strong);
    } else if !arc.open {
        widgets::icon_at(ui.painter(), mark, icons::ICON_BLOCK, 11.0, tokens.weak);
    }
    let ink = if arc.open { tokens.text } else { tokens.weak };
    let [place, free, total, bar] = places(rect);
    widgets::cell(ui, place, Align::Min, &name(arc), FontId::proportional(12.0), ink);
    let mono = FontId::monospace(11.5);
    let is_turn = matches!(arc.motion(), Motion::TurnLeft | Motion::TurnRight);
    let length = if is_turn { "–".to_owned() } else { format::metres(f64::from(arc.free_m), 1) };
    widgets::cell(ui, free, Align::Max, &length, mono.clone(), ink);
    widgets::cell(ui, total, Align::Max, &format!("{:.2}", arc.total), mono, ink);
    let bar = bar.shrink2(Vec2::new(0.0, 3.0));
    let mut mesh = Mesh::default();
    let mut left = bar.left();
    for (term, (_, of)) in ARC_TERMS.iter().enumerate() {
        let value = f64::from(of(arc));
        if !(value.is_finite() && value > 0.0) {
            continue;
        }
        let right = left + (value / most) as f32 * bar.width();
        let part = Rect::from_min_max(Pos2::new(left, bar.top()), Pos2::new(right, bar.bottom()));
        let color = color(ui, term);
        mesh.add_colored_rect(part, if arc.open { color } else { color.gamma_multiply(0.35) });
        left = right;
    }
    ui.painter().add(mesh);
    response.hovered()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_may_be_driven_comes_first_and_by_its_score() {
        let arc = |total: f32, open: bool| ScoredArc { total, open, ..ScoredArc::default() };
        let arcs = vec![arc(3.0, true), arc(1.0, false), arc(2.0, true), arc(f32::NAN, true)];
        assert_eq!(order(&ArcChoice { arcs, ..ArcChoice::default() }), [2, 0, 3, 1]);
    }

    #[test]
    fn an_arc_is_named_by_its_motion() {
        let name = |motion: Motion, curvature_per_m: f32| {
            name(&ScoredArc { motion: motion.into(), curvature_per_m, ..ScoredArc::default() })
        };
        assert_eq!(name(Motion::Forward, 0.0), "straight");
        assert_eq!(name(Motion::Forward, -0.25), "right 0.25 /m");
        assert_eq!(name(Motion::Backward, 0.5), "back, left 0.50 /m");
    }
}
