//! Plan view: why this path and not another one.
//!
//! Of a planner's `rcs.Plan`: the cost of the chosen path beside that of the best rejected one, term by term, and both
//! along their lengths. Of a follower's `rcs.ArcChoice`: every arc that was considered with the terms of its score. What
//! is under the pointer is marked on the maps, and what is under the pointer of a map is marked here.

mod arc_rows;
mod chart;
mod terms;

use crate::toolbar::topic_choice;
use crate::view::{Draws, Hover, HoverPoint, SavedState, TopicKey, View, ViewContext, is_old};
use egui::{Align, FontId, Rect, RichText, ScrollArea, Sense, Ui, Vec2};
use ocu_ui::bar::{Bar, Fit};
use ocu_ui::{format, icons, legend, tokens, widgets};
use rcs_msg::rcs::{ArcChoice, Plan as PlanMessage, PlanCandidate, PlanState};
use rcs_runtime::source::{Frame, Topic, frame_name};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use terms::{PLAN_TERMS, color, in_plan};

const ROW: f32 = 18.0;
/// Width of the first column of the comparison.
const NAME: f32 = 76.0;
/// Distance from a path within which the pointer of a map means a step of it, m.
const NEAR_M: f64 = 0.5;

/// Names of the two paths, as fields of the message.
const PATHS: [&str; 2] = ["chosen", "rejected"];

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Saved {
    /// The plan; the only one where `None`.
    plan: Option<TopicKey>,
    /// The choice of arcs; the only one where `None`.
    arcs: Option<TopicKey>,
}

/// The view of plans and arcs.
#[derive(Default)]
pub(crate) struct Plan {
    saved: Saved,
}

impl View for Plan {
    fn title(&self, _frame: &Frame) -> String {
        "Plan".to_owned()
    }

    fn accepts(&self, topic: &Topic) -> bool {
        matches!(topic.type_name(), "rcs.Plan" | "rcs.ArcChoice")
    }

    fn draws(&self, frame: &Frame, topic: &Topic) -> Draws {
        let (plans, choices) = (topics(frame, "rcs.Plan"), topics(frame, "rcs.ArcChoice"));
        let plan = chosen(self.saved.plan.as_ref(), frame, &plans);
        let arcs = chosen(self.saved.arcs.as_ref(), frame, &choices);
        let is_shown = plan.into_iter().chain(arcs).any(|shown| TopicKey::of(topic).is(shown));
        if is_shown { Draws::Now } else { Draws::Never }
    }

    fn drop_topic(&mut self, topic: &Topic) {
        let chosen =
            if topic.type_name() == "rcs.Plan" { &mut self.saved.plan } else { &mut self.saved.arcs };
        *chosen = Some(TopicKey::of(topic));
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let plans = topics(cx.frame, "rcs.Plan");
        let choices = topics(cx.frame, "rcs.ArcChoice");
        if plans.len() > 1 || choices.len() > 1 {
            self.toolbar(ui, cx.frame, &plans, &choices);
        }
        let plan = chosen(self.saved.plan.as_ref(), cx.frame, &plans)
            .and_then(|topic| Some((topic, topic.get::<PlanMessage>()?)));
        let arcs = chosen(self.saved.arcs.as_ref(), cx.frame, &choices)
            .and_then(|topic| Some((topic, topic.get::<ArcChoice>()?)));
        if plan.is_none() && arcs.is_none() {
            let is_planned = |topic: &&Topic| matches!(topic.type_name(), "rcs.Plan" | "rcs.ArcChoice");
            if cx.frame.topics.iter().any(|topic| is_planned(&topic)) {
                let hint = "Play or step on to the first plan.";
                return widgets::empty(ui, icons::ICON_ALT_ROUTE, "Nothing was planned yet", hint);
            }
            let hint = "A planner's plan (rcs.Plan) or a follower's choice of arcs (rcs.ArcChoice) would fill \
                        it: run the stack lagr_stereo_only, or open a recording of it.";
            return widgets::empty(ui, icons::ICON_ALT_ROUTE, "Nothing was planned", hint);
        }
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            egui::Frame::new().inner_margin(egui::Margin::symmetric(8, 4)).show(ui, |ui| {
                ui.spacing_mut().item_spacing.y = 2.0;
                if let Some((topic, plan)) = plan {
                    show_plan(ui, cx, topic, plan);
                }
                if plan.is_some() && arcs.is_some() {
                    ui.add_space(4.0);
                    ui.separator();
                }
                if let Some((topic, choice)) = arcs {
                    arc_rows::show(ui, cx, topic, choice);
                }
            });
        });
    }
}

impl Plan {
    fn toolbar(&mut self, ui: &mut Ui, frame: &Frame, plans: &[&Topic], choices: &[&Topic]) {
        let mut bar: Bar<'_, Saved> = Bar::new("toolbar");
        let lists = [("plan", "Plan to show", plans), ("arcs", "Arcs to show", choices)];
        for (name, title, topics) in lists.into_iter().filter(|(.., topics)| topics.len() > 1) {
            bar.left(name, Fit::Leaves(20), move |ui, form, saved: &mut Saved| {
                let kept = if name == "plan" { &mut saved.plan } else { &mut saved.arcs };
                let shown = chosen(kept.as_ref(), frame, topics);
                if let Some(key) = topic_choice(ui, form, frame, title, shown, topics) {
                    *kept = Some(key);
                }
            });
        }
        crate::toolbar::show(ui, bar, &mut self.saved);
    }
}

/// The topics of a type, those of the viewed run first.
fn topics<'a>(frame: &'a Frame, type_name: &'a str) -> Vec<&'a Topic> {
    let mut topics: Vec<_> = frame.topics_of_type(type_name).filter(|topic| topic.latest.is_some()).collect();
    topics.sort_by_key(|topic| topic.run.is_recorded());
    topics
}

fn chosen<'a>(key: Option<&TopicKey>, frame: &'a Frame, topics: &[&'a Topic]) -> Option<&'a Topic> {
    key.and_then(|key| key.find(frame)).or_else(|| topics.first().copied())
}

/// Name and age of what is shown, and one sentence about it.
pub(super) fn heading(ui: &mut Ui, frame: &Frame, topic: &Topic, what: &str, sentence: &str) {
    let tokens = tokens(ui);
    let age_s = topic.age_s(frame.now).unwrap_or(0.0);
    ui.horizontal(|ui| {
        ui.label(RichText::new(what).color(tokens.strong));
        ui.label(RichText::new(&*topic.name).small().color(tokens.weak));
        if is_old(topic, frame.now) {
            widgets::tag(ui, &format!("old: {}", format::age(age_s)), tokens.stale);
        } else {
            ui.label(RichText::new(format!("age {}", format::age(age_s))).small().color(tokens.weak));
        }
    });
    if !sentence.is_empty() {
        ui.add(egui::Label::new(sentence).wrap());
    }
}

fn show_plan(ui: &mut Ui, cx: &mut ViewContext<'_>, topic: &Topic, plan: &PlanMessage) {
    let state = match plan.state() {
        PlanState::PlanPath => "Path planned",
        PlanState::PlanAtGoal => "At the goal",
        PlanState::PlanNoWay => "No way",
        PlanState::PlanGoalBlocked => "Goal blocked",
        PlanState::PlanUnusable => "Map or pose unusable",
        PlanState::PlanForbidden => "Closed by zones",
        PlanState::PlanNone => "Nothing planned",
    };
    heading(ui, cx.frame, topic, state, &plan.reason);
    let paths = [plan.chosen.as_ref(), plan.rejected.as_ref()];
    if paths.iter().all(Option::is_none) {
        return;
    }
    ui.add_space(4.0);
    comparison(ui, paths);
    ui.add_space(4.0);
    let entries = PLAN_TERMS.iter().enumerate().map(|(index, (name, _))| (color(ui, index), (*name).into()));
    legend::swatches(ui, entries.collect::<Vec<_>>());
    ui.label(RichText::new("cost per metre along each path").small().color(tokens(ui).weak));
    let meant = meant(cx, topic, plan);
    let scale = chart::Scale::of(&paths);
    let mut pointed = None;
    for (index, path) in paths.into_iter().enumerate() {
        let Some(path) = path else { continue };
        let meant = meant.filter(|(of, _)| *of == index).map(|(_, step)| step);
        pointed = chart::show(ui, PATHS[index], path, scale, meant).map(|step| (index, step)).or(pointed);
    }
    if let Some((index, step)) = pointed
        && let Some(place) = paths[index].and_then(|path| path.steps.get(step))
    {
        let position_m = [f64::from(place.x_m), f64::from(place.y_m), f64::NAN];
        cx.selection.hovered.set(Hover {
            topic: Some(TopicKey::of(topic)),
            field: Some(field(index, step)),
            point: Some(HoverPoint { frame_id: frame_name(&plan.frame_id).to_owned(), position_m }),
            ..Hover::default()
        });
    }
}

/// The field of the message that holds a step.
fn field(path: usize, step: usize) -> Arc<str> {
    format!(".{}.steps[{step}]", PATHS[path]).into()
}

/// The step that another view points at: by its field, or by the place.
fn meant(cx: &ViewContext<'_>, topic: &Topic, plan: &PlanMessage) -> Option<(usize, usize)> {
    let hover = cx.selection.hovered.get();
    let point = hover.point.as_ref()?;
    let p = rcs_geom::DVec3::from_array(point.position_m.map(|v| if v.is_nan() { 0.0 } else { v }));
    let own = frame_name(&plan.frame_id);
    let p = if point.frame_id == own {
        p
    } else {
        let now = cx.frame.transform_time(cx.frame.now);
        cx.frame.transforms.lookup(own, &point.frame_id, now.0).ok()? * p
    };
    let is_ours = hover.topic.as_ref().is_some_and(|key| key.is(topic));
    let paths = [plan.chosen.as_ref(), plan.rejected.as_ref()];
    let steps = paths.into_iter().enumerate().flat_map(|(index, path)| {
        path.into_iter().flat_map(|path| path.steps.iter().enumerate()).map(move |(at, step)| {
            ((index, at), (f64::from(step.x_m) - p.x).hypot(f64::from(step.y_m) - p.y))
        })
    });
    let (found, away_m) = steps.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (is_ours || away_m <= NEAR_M).then_some(found)
}

/// A column of the table of both paths: its name, the value of each path and how much more the second one has, rounded to
/// what is shown, and the number of decimals.
type Column<'a> = (&'a str, [Option<f64>; 3], usize);

/// The column of these values. Its difference is that of the exact values, as a planner's sentence has it.
fn column(name: &str, [ours, theirs]: [Option<f64>; 2], digits: usize) -> Column<'_> {
    let difference = ours.zip(theirs).map(|(ours, theirs)| theirs - ours);
    (name, [ours, theirs, difference].map(|value| Some(round(value?, digits))), digits)
}

/// The table of both paths: their lengths, costs and terms, and how they differ.
fn comparison(ui: &mut Ui, paths: [Option<&PlanCandidate>; 2]) {
    let tokens = tokens(ui);
    // Terms that are 0 in both say nothing.
    let terms =
        PLAN_TERMS.iter().filter(|(_, of)| paths.iter().flatten().any(|path| in_plan(path, *of) != 0.0));
    let mut columns: Vec<Column<'_>> = vec![
        column("length, m", paths.map(|path| path.map(|path| path.length_m)), 1),
        column("cost", paths.map(|path| path.map(|path| path.cost)), 0),
    ];
    columns.extend(terms.map(|(name, of)| {
        let values = paths.map(|path| path.map(|path| in_plan(path, *of)));
        column(name, values, 0)
    }));
    if paths.iter().flatten().any(|path| path.beyond_cost != 0.0) {
        columns.push(column("beyond map", paths.map(|path| path.map(|path| path.beyond_cost)), 0));
    }
    // What is shown adds up in each row.
    let rests = [0, 1, 2].map(|row| rest(&columns, row));
    if rests.into_iter().flatten().any(|rest| rest.abs() >= 0.5) {
        columns.push(("rounding", rests, 0));
    }
    let width = ((ui.available_width() - NAME) / columns.len() as f32).min(84.0);
    let rows = ["", PATHS[0], PATHS[1], "difference"];
    let (font, mono) = (FontId::proportional(11.0), FontId::monospace(11.5));
    for (row, title) in rows.into_iter().enumerate() {
        let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), ROW), Sense::hover());
        let place = |at: usize| {
            let right = rect.left() + NAME + width * (at + 1) as f32;
            Rect::from_x_y_ranges(right - width + 4.0..=right, rect.y_range())
        };
        let name = Rect::from_x_y_ranges(rect.left()..=rect.left() + NAME, rect.y_range());
        widgets::cell(ui, name, Align::Min, title, FontId::proportional(12.0), tokens.text);
        let mut told = title.to_owned();
        for (at, (name, values, digits)) in columns.iter().enumerate() {
            let text = match row.checked_sub(1).map(|row| values[row]) {
                None => (*name).to_owned(),
                Some(None) => "–".to_owned(),
                Some(Some(value)) if row == 3 => format!("{value:+.digits$}"),
                Some(Some(value)) => format!("{value:.digits$}"),
            };
            let (font, color) = match row {
                0 => (font.clone(), tokens.weak),
                3 => (mono.clone(), tokens.weak),
                _ => (mono.clone(), if at < 2 { tokens.strong } else { tokens.text }),
            };
            widgets::cell(ui, place(at), Align::Max, &text, font, color);
            for part in [", ", name, " ", &text] {
                told.push_str(part);
            }
        }
        if row > 0 {
            response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Label, true, &told));
        }
    }
}

/// What the terms of a row lack of its cost, as they are shown: a planner may count whole numbers for each step, and the
/// table shows whole numbers. The terms are the columns after the length and the cost.
fn rest(columns: &[Column<'_>], row: usize) -> Option<f64> {
    let [_, (_, costs, _), terms @ ..] = columns else { return None };
    let terms: f64 = terms.iter().filter_map(|(_, values, _)| values[row]).sum();
    Some(costs[row]? - terms)
}

/// Rounded to what is shown, halves as in texts to an even digit, so that a small negative number is not shown as "-0".
fn round(value: f64, digits: usize) -> f64 {
    let scale = 10_f64.powi(digits as i32);
    (value * scale).round_ties_even() / scale + 0.0
}
