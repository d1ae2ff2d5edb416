//! The terms of a path's cost along its length: stacked bars whose area is the cost, so that steps of different lengths
//! compare. Terms that lower the cost hang below the zero line.

use super::terms::{PLAN_TERMS, color};
use egui::{Align2, FontId, Mesh, Pos2, Rect, Role, Sense, Stroke, Ui, Vec2, WidgetInfo};
use ocu_ui::{format, legend::round_step, tokens};
use rcs_msg::rcs::{PlanCandidate, PlanStep};

const HEIGHT: f32 = 84.0;
/// Room for the labels of the axis.
const AXIS: f32 = 36.0;

/// What the axes of both charts show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    length_m: f64,
    /// Lowest and highest cost per metre.
    low: f64,
    high: f64,
}

impl Scale {
    /// A scale on which all paths fit.
    pub(super) fn of(paths: &[Option<&PlanCandidate>]) -> Self {
        let mut scale = Self { length_m: 1.0, low: 0.0, high: 1.0 };
        for path in paths.iter().flatten() {
            for (along, length, step) in steps(path) {
                let [down, up] = sums(step, length);
                scale.length_m = scale.length_m.max(along + length);
                scale.low = scale.low.min(down);
                scale.high = scale.high.max(up);
            }
        }
        let tick = round_step(scale.high / 2.0);
        scale.high = (scale.high / tick).ceil() * tick;
        scale
    }
}

/// Distance at the start of each step, m; its length, m; and the step. The start of the path is a step of no length.
fn steps(path: &PlanCandidate) -> impl Iterator<Item = (f64, f64, &PlanStep)> {
    let mut along = 0.0;
    let mut before: Option<&PlanStep> = None;
    path.steps.iter().map(move |step| {
        let length = before
            .map_or(0.0, |before| f64::from(step.x_m - before.x_m).hypot(f64::from(step.y_m - before.y_m)));
        // A step that cannot be measured takes no room.
        let length = if length.is_finite() { length } else { 0.0 };
        before = Some(step);
        let from = along;
        along += length;
        (from, length, step)
    })
}

/// Sums of the negative and of the positive terms, per metre.
fn sums(step: &PlanStep, length_m: f64) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for value in terms(step, length_m) {
        sums[usize::from(value > 0.0)] += value;
    }
    sums
}

/// Terms of a step per metre; 0 where it has no length.
fn terms(step: &PlanStep, length_m: f64) -> [f64; PLAN_TERMS.len()] {
    let of = |of: fn(&rcs_msg::rcs::PlanTerms) -> f32| {
        let value = step.terms.as_ref().map_or(0.0, |terms| f64::from(of(terms))) / length_m;
        if length_m > 0.0 && value.is_finite() { value } else { 0.0 }
    };
    PLAN_TERMS.map(|(_, read)| of(read))
}

/// Paints the chart of a path; `meant` is the step that another view points at. Returns the step under the pointer.
pub(super) fn show(
    ui: &mut Ui,
    name: &str,
    path: &PlanCandidate,
    scale: Scale,
    meant: Option<usize>,
) -> Option<usize> {
    let tokens = tokens(ui);
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), HEIGHT), Sense::hover());
    let told = format!("Cost along the {name} path: {:.1} m, cost {:.0}", path.length_m, path.cost);
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, &told));
    let plot = Rect::from_min_max(rect.min + Vec2::new(AXIS, 4.0), rect.max - Vec2::new(0.0, 14.0));
    let x = |along: f64| plot.left() + (along / scale.length_m) as f32 * plot.width();
    let span = scale.high - scale.low;
    let y = |value: f64| plot.bottom() - ((value - scale.low) / span) as f32 * plot.height();
    let painter = ui.painter_at(rect);
    painter.rect_filled(plot, 0.0, tokens.canvas());
    axes(&painter, plot, scale, tokens, (&x, &y));

    let mut mesh = Mesh::default();
    let mut marked = None;
    let mut under = None;
    let pointer = response.hover_pos().filter(|at| plot.expand(2.0).contains(*at));
    for (index, (along, length, step)) in steps(path).enumerate() {
        let (left, right) = (x(along), x(along + length));
        let mut tops = [0.0, 0.0];
        for (term, value) in terms(step, length).into_iter().enumerate() {
            let base = &mut tops[usize::from(value > 0.0)];
            let bar = Rect::from_two_pos(Pos2::new(left, y(*base)), Pos2::new(right, y(*base + value)));
            if bar.height() > 0.0 {
                mesh.add_colored_rect(bar, color(ui, term));
            }
            *base += value;
        }
        if pointer.is_some_and(|at| (left..right).contains(&at.x)) {
            under = Some(index);
        }
        if under == Some(index) || meant == Some(index) {
            marked = Some((left, right, along, step, length));
        }
    }
    painter.add(mesh);
    let label = format!("{name}  {:.1} m, cost {:.0}", path.length_m, path.cost);
    let galley = painter.layout_no_wrap(label, FontId::proportional(11.0), tokens.strong);
    let plate = Rect::from_min_size(plot.left_top() + Vec2::new(4.0, 2.0), galley.size());
    painter.rect_filled(plate.expand2(Vec2::new(3.0, 1.0)), 2.0, tokens.surface[3].gamma_multiply(0.9));
    painter.galley(plate.min, galley, tokens.strong);
    if let Some((left, right, along, step, length)) = marked {
        let stroke = Stroke::new(1.5, tokens.accent);
        let width = (right - left).max(2.0);
        let mark = Rect::from_x_y_ranges(left..=left + width, plot.y_range());
        painter.rect_stroke(mark, 0.0, stroke, egui::StrokeKind::Outside);
        let text = read_out(along, step, length);
        let galley = painter.layout_no_wrap(text, FontId::monospace(11.0), tokens.strong);
        let room = plot.right() - galley.size().x - 4.0;
        let at = Pos2::new((right + 8.0).min(room), plot.top() + 18.0);
        let plate = Rect::from_min_size(at, galley.size()).expand2(Vec2::new(4.0, 1.0));
        painter.rect_filled(plate, 2.0, tokens.surface[3].gamma_multiply(0.92));
        painter.galley(at, galley, tokens.strong);
    }
    under
}

/// Marks of the axes: cost per metre at the left, metres below.
fn axes(
    painter: &egui::Painter,
    plot: Rect,
    scale: Scale,
    tokens: &ocu_ui::Tokens,
    (x, y): (&dyn Fn(f64) -> f32, &dyn Fn(f64) -> f32),
) {
    let font = FontId::monospace(10.0);
    let line = Stroke::new(1.0, tokens.weak.gamma_multiply(0.3));
    for value in [0.0, scale.high / 2.0, scale.high] {
        painter.hline(plot.x_range(), y(value), line);
        let at = Pos2::new(plot.left() - 4.0, y(value));
        painter.text(at, Align2::RIGHT_CENTER, format::number(value), font.clone(), tokens.weak);
    }
    let step = round_step(scale.length_m * 64.0 / f64::from(plot.width().max(1.0)));
    for tick in 0..=(scale.length_m / step) as u32 {
        let value = f64::from(tick) * step;
        let at = Pos2::new(x(value), plot.bottom() + 2.0);
        let align = match at.x {
            _ if tick == 0 => Align2::LEFT_TOP,
            x if x > plot.right() - 20.0 => Align2::RIGHT_TOP,
            _ => Align2::CENTER_TOP,
        };
        painter.text(at, align, format!("{} m", format::number(value)), font.clone(), tokens.weak);
    }
}

/// The terms of a step in words.
fn read_out(along: f64, step: &PlanStep, length_m: f64) -> String {
    let values = PLAN_TERMS.iter().zip(terms(step, length_m)).filter(|(_, value)| *value != 0.0);
    let terms: Vec<String> = values.map(|((name, _), value)| format!("{name} {value:.0}")).collect();
    format!("{along:.1} m  {}  up to here {:.0}", terms.join("  "), step.cost)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::rcs::PlanTerms;

    fn path() -> PlanCandidate {
        let step = |x_m: f32, terrain: f32, relief: f32| PlanStep {
            x_m,
            y_m: 0.0,
            cost: 0.0,
            terms: Some(PlanTerms { terrain, relief, ..PlanTerms::default() }),
        };
        PlanCandidate {
            steps: vec![step(0.0, 0.0, 0.0), step(0.2, 10.0, -4.0), step(0.6, 10.0, 0.0)],
            ..Default::default()
        }
    }

    #[test]
    fn the_area_of_the_bars_is_the_cost() {
        let path = path();
        let area: f64 =
            steps(&path).map(|(_, length, step)| sums(step, length).iter().sum::<f64>() * length).sum();
        assert!((area - 16.0).abs() < 1e-5, "{area}");
    }

    #[test]
    fn the_scale_holds_every_bar_and_survives_what_is_no_number() {
        let mut path = path();
        path.steps.push(PlanStep { x_m: f32::NAN, ..path.steps[1] });
        path.steps.push(PlanStep { x_m: 0.7, cost: f32::INFINITY, ..path.steps[1] });
        let scale = Scale::of(&[Some(&path), None]);
        assert!(scale.high >= 50.0 && scale.low <= -19.9 && scale.high.is_finite(), "{scale:?}");
        assert!((0.6..1.1).contains(&scale.length_m), "{scale:?}");
        assert_eq!(Scale::of(&[None, None]).length_m, 1.0);
    }
}
