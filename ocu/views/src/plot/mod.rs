//! Plot view: fields and formulas over time, several graphs on one time axis (Albus 2006a, 6.2, figure 17).
//!
//! Also an array against its index, and one formula against another. The line of the viewed time is that of the
//! timeline: a click goes there. Dragging moves along the time, scrolling zooms it, scrolling with Ctrl zooms the values;
//! dragging with Shift sets two cursors, between which the statistics are taken. What is drawn is reduced to the columns
//! of the screen with their true least and greatest values (`columns.rs`).

mod axis;
mod columns;
mod drawn;
mod entry;
mod graph;
mod legend;
mod menu;
mod paint;
mod saved;
mod stats;

use crate::series::{Shelf, Shown};
use crate::view::{Draws, FieldKey, RunChoice, SavedState, View, ViewContext, Wish};
use axis::GraphKind;
use drawn::{Drawn, Place};
use egui::{Color32, Pos2, Rect, Ui};
use entry::{Entered, Entry};
use menu::Asked;
use ocu_ui::bar::{self, Bar, Choice, Fit, Form};
use ocu_ui::{icons, tokens, widgets};
use paint::Clock;
use rcs_formula::FieldRef;
use rcs_runtime::source::{Control, Frame, Topic};
use saved::{Curve, Graph, Saved, Span};

/// Room for the marks of the vertical axes, points.
const GUTTER: f32 = 56.0;
/// Room for the marks of the time axis.
const BELOW: f32 = 20.0;
/// Room between graphs.
const BETWEEN: f32 = 8.0;

/// The plot view.
#[derive(Default)]
pub(crate) struct Plot {
    saved: Saved,
    shelf: Shelf,
    /// The two cursors, in seconds since the start of the source.
    cursors: Option<(f64, f64)>,
    /// Where the graphs are.
    places: Vec<Rect>,
}

/// A request of the toolbar.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Tool {
    Add,
    Fit,
    Csv,
    Picture,
}

impl View for Plot {
    fn title(&self, _frame: &Frame) -> String {
        let mut formulas = self.saved.formulas();
        match (formulas.next(), formulas.count()) {
            (Some(one), 0) => format!("Plot {one}"),
            _ => "Plot".to_owned(),
        }
    }

    fn accepts(&self, topic: &Topic) -> bool {
        topic.undecodable.is_none()
    }

    fn draws(&self, _frame: &Frame, topic: &Topic) -> Draws {
        if self.accepts(topic) { Draws::OnceDropped } else { Draws::Never }
    }

    fn drop_topic(&mut self, topic: &Topic) {
        // Which field is meant is chosen next.
        self.saved.entry = Some(Entry::new(entry::begun(&topic.name), None));
    }

    fn fields(&self) -> Vec<FieldRef> {
        self.saved.fields()
    }

    fn accepts_fields(&self) -> bool {
        true
    }

    fn drop_field(&mut self, field: &FieldKey, at: Pos2) {
        let formula = FieldRef { topic: field.topic.name.clone(), path: field.path.clone() }.to_string();
        let curve = Curve { run: field.topic.run, ..Curve::new(formula) };
        // The lower quarter of a graph, and the room outside, are for a new graph.
        let place = self.places.iter().position(|place| place.contains(at));
        match place.filter(|&index| at.y < self.places[index].bottom() - 0.25 * self.places[index].height()) {
            Some(index) if index < self.saved.graphs.len() => self.saved.graphs[index].curves.push(curve),
            _ => {
                let index =
                    place.map_or(self.saved.graphs.len(), |index| index + 1).min(self.saved.graphs.len());
                self.saved.graphs.insert(index, Graph { curves: vec![curve], ..Graph::default() });
            }
        }
    }

    fn save(&self) -> SavedState {
        serde_json::to_value(&self.saved).unwrap_or_default()
    }

    fn load(&mut self, saved: &SavedState) -> Result<(), serde_json::Error> {
        self.saved = serde_json::from_value(saved.clone())?;
        if !self.saved.span.is_valid() {
            self.saved.span = Span::All;
        }
        Ok(())
    }

    fn ui(&mut self, ui: &mut Ui, cx: &mut ViewContext<'_>) {
        let asked = self.toolbar(ui);
        self.entry_ui(ui, cx.frame);
        if asked == Some(Tool::Add) {
            self.saved.entry = Some(Entry::new(String::new(), None));
        }
        if self.saved.graphs.is_empty() {
            let hint = "Drag a field here from the fields view, or add one by its path.";
            return widgets::empty(ui, icons::ICON_SHOW_CHART, "Nothing is plotted", hint);
        }
        let area = ui.available_rect_before_wrap();
        let clock = Clock { start: cx.frame.info.start };
        let drawn = self.drawn(ui, cx.frame);
        let range = self.time_range(cx.frame, clock, &drawn);
        self.graphs(ui, cx, &drawn, clock, range);
        if self.saved.statistics {
            let listed: Vec<(String, Color32, Shown)> = drawn
                .iter()
                .filter(|graph| graph.kind == GraphKind::Time)
                .flat_map(|graph| graph.curves.iter().map(|c| (c.label.clone(), c.color, c.shown.clone())))
                .collect();
            stats::table(ui, clock, self.cursors.unwrap_or(range), &listed);
        }
        match asked {
            Some(Tool::Fit) => self.fit(),
            Some(Tool::Csv) => cx.wishes.push(csv(&drawn, clock, range)),
            Some(Tool::Picture) => cx.wishes.push(Wish::SavePicture { area, name: "plot.png".to_owned() }),
            _ => {}
        }
        let formulas: Vec<String> = self.saved.formulas().map(str::to_owned).collect();
        self.shelf.keep(|text| formulas.iter().any(|known| known == text));
    }
}

/// The visible values of all curves over time as a table.
fn csv(drawn: &[Drawn], clock: Clock, range: (f64, f64)) -> Wish {
    let curves = drawn.iter().filter(|graph| graph.kind == GraphKind::Time).flat_map(|graph| &graph.curves);
    let columns: Vec<(String, rcs_formula::Points)> =
        curves.map(|curve| (curve.label.clone(), curve.shown.all())).collect();
    let columns: Vec<_> = columns.iter().map(|(name, points)| (name.clone(), points)).collect();
    let times = clock.stamp(range.0)..=clock.stamp(range.1);
    let text = rcs_formula::csv(&columns, &times, clock.start);
    Wish::SaveFile { name: "plot.csv".to_owned(), content: text.into_bytes().into() }
}

impl Plot {
    fn toolbar(&mut self, ui: &mut Ui) -> Option<Tool> {
        let mut asked = None;
        let has_curves = !self.saved.graphs.is_empty();
        let mut bar: Bar<'_, (&mut Saved, &mut Option<Tool>)> = Bar::new("toolbar");
        let mut tool = |name: &'static str,
                        icon,
                        text: &'static str,
                        what: Tool,
                        worth: u8,
                        enabled: bool,
                        right: bool| {
            let paint = move |ui: &mut Ui, form: Form, (_, asked): &mut (&mut Saved, &mut Option<Tool>)| {
                if bar::tool_of(ui, form, icon, text, false, enabled).clicked() {
                    **asked = Some(what);
                }
            };
            if right {
                bar.right(name, Fit::Leaves(worth), paint);
            } else {
                bar.left(name, Fit::Leaves(worth), paint);
            }
        };
        tool("add", icons::ICON_ADD, "Add a curve", Tool::Add, 10, true, false);
        tool("fit", icons::ICON_FIT_SCREEN, "Fit to graph", Tool::Fit, 9, has_curves, false);
        tool("csv", icons::ICON_TABLE_VIEW, "Save the values as text (CSV)", Tool::Csv, 2, has_curves, true);
        tool("picture", icons::ICON_PHOTO_CAMERA, "Save as a picture", Tool::Picture, 1, has_curves, true);
        bar.left("span", Fit::Stays, |ui, form, (saved, _)| span_choice(ui, form, &mut saved.span));
        bar.left("statistics", Fit::Leaves(5), |ui, form, (saved, _)| {
            bar::tool_toggle(ui, form, icons::ICON_FUNCTIONS, "Statistics", &mut saved.statistics);
        });
        crate::toolbar::show(ui, bar, &mut (&mut self.saved, &mut asked));
        asked
    }

    fn entry_ui(&mut self, ui: &mut Ui, frame: &Frame) {
        let edited = self.saved.edited();
        let Some(entry) = &mut self.saved.entry else { return };
        match entry.ui(ui, frame) {
            Entered::Open => return,
            Entered::Closed => {}
            Entered::Formula(formula) => {
                if let Some((graph, curve)) = edited {
                    self.saved.graphs[graph].curves[curve].formula = formula;
                } else {
                    let curve = Curve::new(formula);
                    match self.saved.graphs.first_mut().filter(|graph| graph.against.is_none()) {
                        Some(graph) => graph.curves.push(curve),
                        None => self.saved.graphs.push(Graph { curves: vec![curve], ..Graph::default() }),
                    }
                }
            }
        }
        self.saved.entry = None;
    }

    /// What each graph has to draw.
    fn drawn(&mut self, ui: &Ui, frame: &Frame) -> Vec<Drawn> {
        let mut color = 0;
        let shelf = &mut self.shelf;
        let graphs = self.saved.graphs.iter().map(|graph| Drawn::new(ui, frame, shelf, graph, &mut color));
        graphs.collect()
    }

    /// The visible part of the time axis.
    fn time_range(&self, frame: &Frame, clock: Clock, drawn: &[Drawn]) -> (f64, f64) {
        match self.saved.span {
            Span::Fixed(from, to) => (from, to),
            Span::Last(s) => {
                let now = clock.seconds(frame.now);
                (now - s, now + 0.02 * s)
            }
            Span::All => {
                let curves = drawn
                    .iter()
                    .filter(|graph| graph.kind == GraphKind::Time)
                    .flat_map(|graph| &graph.curves);
                let series = curves.map(|curve| &curve.shown.points);
                let ends = series.filter_map(|points| Some((points.get(0)?.stamp, points.last()?.stamp)));
                let now = clock.seconds(frame.now);
                let start = (clock.seconds(clock.start), now);
                let (from, to) = ends.fold(start, |(from, to), (first, last)| {
                    (from.min(clock.seconds(first)), to.max(clock.seconds(last)))
                });
                let to = if to - from < 1e-6 { from + 1.0 } else { to };
                (from, to + 0.01 * (to - from))
            }
        }
    }

    /// Shows everything.
    fn fit(&mut self) {
        if !matches!(self.saved.span, Span::Last(_)) {
            self.saved.span = Span::All;
        }
        for graph in &mut self.saved.graphs {
            (graph.ranges, graph.across) = ([None; 2], None);
        }
    }

    fn graphs(
        &mut self,
        ui: &mut Ui,
        cx: &mut ViewContext<'_>,
        drawn: &[Drawn],
        clock: Clock,
        range: (f64, f64),
    ) {
        let area = ui.available_rect_before_wrap();
        let listed: usize =
            drawn.iter().filter(|graph| graph.kind == GraphKind::Time).map(|graph| graph.curves.len()).sum();
        let table = if self.saved.statistics { stats::height(listed) } else { 0.0 };
        let has_right = drawn.iter().any(Drawn::has_right_axis);
        let inner = Rect::from_min_max(
            Pos2::new(area.left() + GUTTER, area.top() + BETWEEN),
            Pos2::new(area.right() - if has_right { GUTTER } else { 12.0 }, area.bottom() - table - 4.0),
        );
        let last_time = drawn.iter().rposition(|graph| graph.kind == GraphKind::Time);
        let labelled = |index: usize| drawn[index].kind != GraphKind::Time || Some(index) == last_time;
        let below: f32 = (0..drawn.len()).map(|index| if labelled(index) { BELOW } else { 0.0 }).sum();
        let height = (inner.height() - below - BETWEEN * (drawn.len() as f32 - 1.0)) / drawn.len() as f32;
        let mut top = inner.top();
        let mut acts = Vec::new();
        self.places.clear();
        for (index, graph) in drawn.iter().enumerate() {
            let plot = Rect::from_x_y_ranges(inner.x_range(), top..=top + height.max(24.0));
            top = plot.bottom() + BETWEEN + if labelled(index) { BELOW } else { 0.0 };
            self.places.push(plot);
            let place = Place { index, plot, labelled: labelled(index), time: range, clock };
            acts.extend(graph::ui(ui, cx, &self.saved, graph, &place, self.cursors));
        }
        ui.allocate_rect(area.with_max_y(area.bottom() - table), egui::Sense::hover());
        for act in acts {
            self.act(ui, cx, act);
        }
    }

    fn act(&mut self, ui: &Ui, cx: &mut ViewContext<'_>, act: graph::Act) {
        match act {
            graph::Act::Time(from, to) => self.saved.span = limited(from, to),
            graph::Act::Values { graph, side, range } => {
                self.saved.graphs[graph].ranges[side] = Some(range).filter(|(from, to)| from < to);
            }
            graph::Act::Across { graph, range } => {
                self.saved.graphs[graph].across = Some(range).filter(|(from, to)| from < to);
            }
            graph::Act::Cursors(cursors) => self.cursors = cursors,
            graph::Act::Fit => self.fit(),
            graph::Act::Seek(to) => {
                if !cx.frame.is_beside {
                    cx.controls.push(Control::Seek(to));
                }
            }
            graph::Act::Curve { graph, curve, asked } => match asked {
                Asked::Edit => {
                    let formula = self.saved.graphs[graph].curves[curve].formula.clone();
                    self.saved.entry = Some(Entry::new(formula, Some((graph, curve))));
                }
                Asked::CopyFormula => {
                    ui.ctx().copy_text(self.saved.graphs[graph].curves[curve].formula.clone());
                }
                asked => self.saved.carry_out(graph, curve, asked),
            },
        }
    }
}

/// A range of time that can be shown: at least a microsecond, at most a thousand years.
fn limited(from: f64, to: f64) -> Span {
    let (from, to) = (from.clamp(-3e10, 3e10), to.clamp(-3e10, 3e10));
    if to - from < 1e-6 { Span::Fixed(from, from + 1e-6) } else { Span::Fixed(from, to) }
}

/// The choice of the visible part of the time axis.
fn span_choice(ui: &mut Ui, form: Form, span: &mut Span) {
    let text = match *span {
        Span::All => "All".to_owned(),
        Span::Last(s) => format!("Last {s} s"),
        Span::Fixed(..) => "Chosen range".to_owned(),
    };
    bar::choice(ui, form, Choice::new("Range of time", &text, [72.0, 112.0]), |ui| {
        ui.selectable_value(span, Span::All, "All");
        for s in [5.0, 10.0, 30.0, 60.0, 300.0] {
            ui.selectable_value(span, Span::Last(s), format!("Last {s} s"));
        }
    });
}

/// The color of a curve.
fn color_of(ui: &Ui, index: usize) -> Color32 {
    tokens(ui).series(index)
}

/// A label of a run that is not the viewed one.
fn run_label(run: RunChoice) -> String {
    if run == RunChoice::Shown { String::new() } else { format!(" · {}", run.name()) }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
