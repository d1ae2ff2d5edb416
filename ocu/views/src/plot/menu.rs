//! The menu of a curve: functions of it, differences from others, its axis and its graph.

use super::saved::{Curve, Graph, Saved};
use egui::Ui;
use rcs_formula::{FieldRef, Formula};

/// What the menu was asked for.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Asked {
    /// Add a curve to the same graph.
    Add(Curve),
    /// Add a graph.
    AddGraph(Graph),
    /// Change the formula.
    Edit,
    /// Move to the other axis.
    OtherAxis,
    /// Move to a graph of its own.
    Separate,
    Remove,
    CopyFormula,
}

/// The functions of one curve, by their names in the menu; whether the result has another unit.
const FUNCTIONS: [(&str, &str, bool); 8] = [
    ("Smooth", "smooth(@, 1)", false),
    ("Standard deviation", "deviation(@, 1)", false),
    ("Derivative", "derivative(@)", true),
    ("Integral", "integral(@)", true),
    ("Differences", "difference(@)", false),
    ("Absolute", "absolute(@)", false),
    ("Negative", "negative(@)", false),
    ("Degrees", "degrees(@)", true),
];

/// A formula as an operand.
fn operand(formula: &str) -> String {
    let is_simple = formula.parse::<Formula>().is_ok_and(|parsed| parsed.as_field().is_some());
    if is_simple { formula.to_owned() } else { format!("({formula})") }
}

/// Paints the menu of a curve.
pub(super) fn ui(ui: &mut Ui, saved: &Saved, curve: &Curve) -> Option<Asked> {
    let mut asked = None;
    let mut item = |ui: &mut Ui, text: &str, what: &dyn Fn() -> Asked| {
        if ui.button(text).clicked() {
            asked = Some(what());
            ui.close();
        }
    };
    ui.menu_button("Function", |ui| {
        for (name, function, other_unit) in FUNCTIONS {
            let formula = function.replace('@', &curve.formula);
            let right = curve.right != other_unit;
            item(ui, name, &|| Asked::Add(Curve { formula: formula.clone(), right, ..curve.clone() }));
        }
        item(ui, "Spectrum", &|| {
            let formula = format!("spectrum({})", curve.formula);
            let curves = vec![Curve { formula, right: false, ..curve.clone() }];
            Asked::AddGraph(Graph { curves, ..Graph::default() })
        });
    });
    let others = saved.others(curve);
    for (title, kind) in [("Minus", 0), ("Minus, modulo 2π", 1), ("Against", 2)] {
        ui.add_enabled_ui(!others.is_empty(), |ui| {
            let menu = ui.menu_button(title, |ui| {
                for other in &others {
                    let (a, b) = (&curve.formula, &other.formula);
                    let formula = match kind {
                        0 => format!("{} - {}", operand(a), operand(b)),
                        _ => format!("angle_difference({a}, {b})"),
                    };
                    item(ui, b, &|| match kind {
                        2 => Asked::AddGraph(Graph {
                            curves: vec![Curve { right: false, ..curve.clone() }],
                            against: Some(b.clone()),
                            ..Graph::default()
                        }),
                        _ => Asked::Add(Curve { formula: formula.clone(), ..curve.clone() }),
                    });
                }
            });
            menu.response.on_disabled_hover_text("There is no other curve of this run.");
        });
    }
    ui.separator();
    item(ui, if curve.right { "Left axis" } else { "Right axis" }, &|| Asked::OtherAxis);
    item(ui, "Graph of its own", &|| Asked::Separate);
    item(ui, "Change the formula…", &|| Asked::Edit);
    item(ui, "Copy the formula", &|| Asked::CopyFormula);
    item(ui, "Remove", &|| Asked::Remove);
    asked
}

impl Saved {
    /// Does what the menu of a curve was asked for, except for what concerns the window.
    pub(super) fn carry_out(&mut self, graph: usize, index: usize, asked: Asked) {
        match asked {
            Asked::Add(curve) => self.graphs[graph].curves.push(curve),
            Asked::AddGraph(added) => self.graphs.insert(graph + 1, added),
            Asked::OtherAxis => {
                let curve = &mut self.graphs[graph].curves[index];
                curve.right = !curve.right;
            }
            Asked::Separate => {
                let curve = self.graphs[graph].curves.remove(index);
                let own = Graph { curves: vec![Curve { right: false, ..curve }], ..Graph::default() };
                self.graphs.insert(graph + 1, own);
            }
            Asked::Remove => drop(self.graphs[graph].curves.remove(index)),
            Asked::Edit | Asked::CopyFormula => {}
        }
        self.graphs.retain(|graph| !graph.curves.is_empty());
    }

    /// The curves that a formula can combine with this one: those of its run, because all fields of a formula are read
    /// from one run.
    fn others(&self, curve: &Curve) -> Vec<&Curve> {
        let curves = self.graphs.iter().flat_map(|graph| &graph.curves);
        curves.filter(|other| other.run == curve.run && other.formula != curve.formula).collect()
    }

    /// Every formula.
    pub(super) fn formulas(&self) -> impl Iterator<Item = &str> {
        let curves = self.graphs.iter().flat_map(|graph| &graph.curves).map(|curve| curve.formula.as_str());
        curves.chain(self.graphs.iter().filter_map(|graph| graph.against.as_deref()))
    }

    /// The fields of every formula.
    pub(super) fn fields(&self) -> Vec<FieldRef> {
        let parsed = self.formulas().filter_map(|text| text.parse::<Formula>().ok());
        let mut fields: Vec<FieldRef> = parsed.flat_map(|formula| formula.fields().to_vec()).collect();
        fields.sort_unstable();
        fields.dedup();
        fields
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::RunChoice;

    fn saved() -> Saved {
        let graph = |names: &[&str]| Graph {
            curves: names.iter().map(|name| Curve::new(*name)).collect(),
            ..Graph::default()
        };
        Saved { graphs: vec![graph(&["/a.x", "/b.y"]), graph(&["/c.z + 1"])], ..Saved::default() }
    }

    #[test]
    fn every_function_of_the_menu_is_a_formula() {
        for (name, function, _) in FUNCTIONS {
            for inner in ["/a.x", "/a.x - 2"] {
                function
                    .replace('@', inner)
                    .parse::<Formula>()
                    .unwrap_or_else(|error| panic!("{name}: {error}"));
            }
        }
        assert_eq!((operand("/a.x"), operand("/a.x - 1")), ("/a.x".into(), "(/a.x - 1)".into()));
    }

    #[test]
    fn a_curve_is_combined_with_others_of_its_run_only() {
        let mut plot = saved();
        let of_run = |name: &str| Curve { run: RunChoice::Run(0), ..Curve::new(name) };
        plot.graphs[0].curves.push(of_run("/a.x"));
        assert_eq!(plot.others(&Curve::new("/a.x")), [&Curve::new("/b.y"), &Curve::new("/c.z + 1")]);
        assert!(plot.others(&of_run("/a.x")).is_empty());
        assert_eq!(plot.others(&of_run("/b.y")), [&of_run("/a.x")]);
    }

    #[test]
    fn curves_move_between_graphs_and_empty_graphs_disappear() {
        let mut plot = saved();
        plot.carry_out(0, 1, Asked::Separate);
        let counts = |plot: &Saved| plot.graphs.iter().map(|graph| graph.curves.len()).collect::<Vec<_>>();
        assert_eq!(counts(&plot), [1, 1, 1]);
        assert_eq!(plot.graphs[1].curves[0].formula, "/b.y");
        plot.carry_out(0, 0, Asked::Remove);
        assert_eq!(counts(&plot), [1, 1]);
        let fields: Vec<String> = plot.fields().iter().map(ToString::to_string).collect();
        assert_eq!(fields, ["/b.y", "/c.z"]);
    }
}
