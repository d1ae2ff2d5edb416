//! The layer panel with its switches, and the legend.

use super::entities::OnMap;
use super::grid::{Cells, Shade};
use super::layers::{self, Kind, Layer};
use super::uncertainty::{Covariance, SIGMAS};
use super::{LayerState, Map, picture, undrawn};
use crate::cloud_colors::{CloudColors, intensity_color};
use crate::cloud_look::ONE;
use egui::{Align2, Color32, Rect, RichText, Role, ScrollArea, Ui, UiBuilder, Vec2, WidgetInfo};
use ocu_ui::{format, icons, legend, palette, short_name, tokens, widgets};
use rcs_msg::foxglove::PointCloud;
use rcs_runtime::source::{Frame, Topic};

/// Index of a layer's line colour; only lines and arrows have colours of their own. A track of the run that was left has
/// the colour of the track of the same topic, so that a branch changes no colour.
pub(super) fn series(layers: &[Layer<'_>], index: usize) -> usize {
    let ghost = ghost_of(&layers[index]);
    let is_same = |layer: &Layer<'_>| match layer.kind {
        Kind::Track { track, is_ghost: false } => !track.run.is_recorded() && Some(&*track.topic) == ghost,
        _ => false,
    };
    let end = ghost.map_or(index, |_| layers.iter().position(is_same).unwrap_or(layers.len()));
    layers[..end].iter().filter(|layer| is_line(layer) && ghost_of(layer).is_none()).count()
}

/// The topic of a track of the run that was left; `None` for any other layer.
fn ghost_of<'a>(layer: &Layer<'a>) -> Option<&'a str> {
    match layer.kind {
        Kind::Track { track, is_ghost: true } => Some(&*track.topic),
        _ => None,
    }
}

/// Whether a layer is a line, or arrows, with a colour of its own.
fn is_line(layer: &Layer<'_>) -> bool {
    matches!(layer.kind, Kind::Track { .. } | Kind::Path(_) | Kind::Poses(_) | Kind::Plan(_))
}

/// Height of a line of the legend, screen points.
const LEGEND_LINE: f32 = 16.0;
/// Part of the height and of the width of the map that the legend may have.
const LEGEND_PART: f32 = 1.0 / 3.0;
/// Width that the legend may have on any map.
const LEGEND_WIDTH: f32 = 112.0;
/// On a map of less width, the colours keep to the width of the legend, too.
const NARROW: f32 = 400.0;

impl Map {
    pub(super) fn panel(&mut self, ui: &mut Ui, frame: &Frame, map: &str, layers: &[Layer<'_>], rect: Rect) {
        let tokens = tokens(ui);
        ui.painter().rect_filled(rect, 0.0, tokens.panel());
        ui.painter().vline(rect.left() + 0.5, rect.y_range(), egui::Stroke::new(1.0, tokens.line));
        let mut child = ui.new_child(egui::UiBuilder::new().max_rect(rect.shrink2(Vec2::new(8.0, 4.0))));
        child.set_clip_rect(rect.intersect(ui.clip_rect()));
        ScrollArea::vertical().auto_shrink(false).show(&mut child, |ui| {
            // Ground truth is listed last, under its own heading.
            let truth = layers.iter().position(Layer::is_ground_truth);
            let mut names = widgets::RowNames::default();
            for (index, layer) in layers.iter().enumerate() {
                if truth == Some(index) {
                    ui.separator();
                    ui.label(RichText::new("Truth of the simulation").small().color(tokens.weak));
                    ui.add_space(2.0);
                }
                let mut state = self.state(layer);
                let before = state.clone();
                // Layers and their notes come and go while the mouse is pressed.
                let rows = |ui: &mut Ui| self.layer(ui, frame, map, layers, index, &mut state);
                let (chosen, zoom) = names.named(ui, &layer.name, rows);
                if let Some(frame) = chosen {
                    self.saved.frame = Some(frame);
                    self.saved.viewport = None;
                }
                if zoom {
                    state.shown = true;
                    self.zoom_to = Some(layer.name.clone());
                }
                if state != before {
                    // From now on, it is as it was set by hand.
                    self.led = self.led.take().filter(|led| led.layer != layer.name);
                    self.saved.layers.insert(layer.name.clone(), state);
                }
                ui.add_space(4.0);
            }
            if layers.iter().any(|layer| matches!(layer.kind, Kind::Track { .. })) {
                ui.separator();
                let align = &mut self.saved.align;
                let switch = |ui: &mut Ui| ui.checkbox(align, "Align loose tracks at their start");
                widgets::named(ui, "align", switch).on_hover_text(format!(
                    "A track that no transform connects to the map is turned and shifted onto another one, \
                     by least squares over the first {} m. A visual aid, not a measurement.",
                    super::track::ALIGN_LENGTH_M
                ));
            }
            undrawn::list(ui, frame);
        });
    }

    /// The rows of one layer; returns the frame that the user selects for the map, if any, and whether the layer is to
    /// fill the map.
    fn layer(
        &self,
        ui: &mut Ui,
        frame: &Frame,
        map: &str,
        layers: &[Layer<'_>],
        index: usize,
        state: &mut LayerState,
    ) -> (Option<String>, bool) {
        let mut wish = None;
        let (layer, tokens) = (&layers[index], tokens(ui));
        let zoom = heading(ui, layers, index, state);
        let indent = 22.0;
        let note = |ui: &mut Ui, text: String, color| {
            ui.horizontal(|ui| {
                ui.add_space(indent);
                ui.add(egui::Label::new(RichText::new(text).small().color(color)).wrap());
            });
        };
        let age_s = layer.topic.and_then(|topic| topic.age_s(frame.now));
        let (old, is_area) = (layer.is_stale(frame.now), matches!(layer.kind, Kind::Grid(_) | Kind::Cloud));
        if let Some(age_s) = age_s.filter(|_| is_area || (old && layer.is_of_one_time())) {
            let age = format::age(age_s);
            let text = if old { format!("old: {age}") } else { format!("age {age}") };
            let place = match layer.frame_id {
                own if own == map || !is_area => String::new(),
                own => format!("  in {}", layers::frame_label(own)),
            };
            note(ui, text + &place, if old { tokens.stale } else { tokens.weak });
        }
        let placed = self.tracks.placed.get(&layer.name);
        if let (Kind::Track { is_ghost: false, .. }, Some(covariance)) = (layer.kind, Covariance::of(layer)) {
            let radius = format::metres(SIGMAS * covariance.most_m(), 2);
            note(ui, format!("± {radius}, two standard deviations"), tokens.weak);
        }
        let entities = self.entities.get(&layer.name);
        for (text, is_warning) in entities.map(OnMap::notes).unwrap_or_default() {
            note(ui, text, if is_warning { tokens.warning } else { tokens.weak });
        }
        match (layer.kind, layers::map_from_layer(frame, map, layer)) {
            // Some of them are in other frames, and all is said above.
            (Kind::Entities(_), _) if entities.is_some_and(|entities| entities.count > 0) => {}
            (Kind::Track { .. }, Err(_)) if placed.is_some_and(|track| track.alignment.is_some()) => {
                if let Some(alignment) = placed.and_then(|track| track.alignment) {
                    let rms = format::metres(alignment.rms_m, 2);
                    note(ui, format!("aligned at its start, {rms} off"), tokens.warning);
                }
            }
            (_, Err(reason)) => {
                // A track may be loose for one more reason.
                let reason = placed.and_then(|track| track.error.as_ref()).unwrap_or(&reason);
                note(ui, format!("not drawn: {reason}"), tokens.warning);
                ui.horizontal(|ui| {
                    ui.add_space(indent);
                    let text = format!("Draw in {}", layers::frame_label(layer.frame_id));
                    if ui.link(RichText::new(text).small()).clicked() {
                        wish = Some(layer.frame_id.to_owned());
                    }
                });
            }
            (Kind::Cloud, Ok(pose)) if state.shown => {
                if let Some(Err(reason)) = picture::read_cloud(ui.ctx(), layer, map, pose, &state.cloud) {
                    note(ui, format!("not drawn: {reason}"), tokens.warning);
                }
            }
            (kind, _) if !matches!(kind, Kind::Grid(_) | Kind::Cloud) && layer.frame_id != map => {
                note(ui, format!("in {}", layers::frame_label(layer.frame_id)), tokens.weak);
            }
            _ => {}
        }
        if let Kind::Grid(grid) = layer.kind {
            match Cells::new(grid) {
                Err(reason) => note(ui, reason, tokens.warning),
                Ok(cells) if state.shown => shade_choice(ui, layer, &cells, state, indent),
                Ok(_) => {}
            }
        }
        let cloud = layer.topic.filter(|_| state.shown && matches!(layer.kind, Kind::Cloud));
        if let Some(cloud) = cloud.and_then(Topic::get::<PointCloud>) {
            state.cloud.ui(ui, &layer.name, cloud, indent);
        }
        if state.shown && matches!(layer.kind, Kind::Grid(_) | Kind::Cloud) {
            opacity(ui, layer, state, indent);
        }
        (wish, zoom)
    }

    /// The legend of the map's colours, which can be folded; returns its place.
    pub(super) fn legend(
        &mut self,
        ui: &mut Ui,
        frame: &Frame,
        layers: &[Layer<'_>],
        shown: &[&Layer<'_>],
        canvas: Rect,
        listed: bool,
    ) -> Option<Rect> {
        let placed = |layer: &&&Layer<'_>| layers::map_from_layer(frame, &self.frame_id, layer).is_ok();
        let colored =
            shown.iter().filter(placed).any(|layer| matches!(layer.kind, Kind::Grid(_) | Kind::Cloud));
        // The layer panel lists the lines with their colours.
        let lines = if listed { Vec::new() } else { self.lines(ui, layers, shown) };
        if !colored && lines.is_empty() {
            return None;
        }
        if self.saved.legend == Some(false) {
            let unfolds = |ui: &mut Ui| {
                widgets::icon_button(ui, icons::ICON_UNFOLD_MORE, "Unfold the legend").clicked()
            };
            let (unfolds, place) = legend::plate(ui, canvas, Align2::LEFT_BOTTOM, unfolds);
            self.saved.legend = Some(unfolds);
            return Some(place);
        }
        let palette = self.saved.palette;
        let width = (canvas.width() * LEGEND_PART).max(LEGEND_WIDTH);
        let ((), place) = legend::plate(ui, canvas, Align2::LEFT_BOTTOM, |ui| {
            ui.style_mut().interaction.selectable_labels = false;
            if canvas.width() < NARROW {
                ui.set_max_width(width);
            }
            let mut costs = false;
            for layer in shown {
                match layer.kind {
                    Kind::Grid(grid) => {
                        let Ok(cells) = Cells::new(grid) else { continue };
                        let Some(shade) = cells.shade(self.state(layer).shade.as_deref()) else {
                            continue;
                        };
                        if cells.is_cost(&shade) {
                            costs = true;
                            continue;
                        }
                        // Colours of their own have no scale.
                        if shade == Shade::Colors {
                            continue;
                        }
                        let range = self.ranges.get(&layer.name).copied().unwrap_or([0.0, 255.0]);
                        legend::title(ui, &format!("{}  {}", layer.name, shade.name()));
                        legend::band(
                            ui,
                            96.0,
                            &format::number(range[0]),
                            &format::number(range[1]),
                            palette::even,
                        );
                    }
                    Kind::Cloud => {
                        let Ok(pose) = layers::map_from_layer(frame, &self.frame_id, layer) else { continue };
                        let look = self.state(layer).cloud;
                        let cloud = picture::cloud(ui.ctx(), layer, &self.frame_id, pose, &look);
                        let Some(cloud) = cloud else { continue };
                        cloud_legend(ui, &layer.name, cloud.colors, look.by.as_deref());
                    }
                    _ => {}
                }
            }
            if costs {
                crate::toolbar::cost_legend(ui, palette);
            }
            if !lines.is_empty() {
                let height = canvas.height() * LEGEND_PART - ui.min_rect().height();
                ui.scope(|ui| {
                    ui.set_max_width(width.min(ui.available_width()));
                    line_names(ui, &lines, height);
                });
            }
        });
        // Beside the legend, which needs its rows.
        let button = Rect::from_min_max(
            place.right_bottom() + Vec2::new(2.0, -24.0),
            place.right_bottom() + Vec2::new(26.0, 0.0),
        );
        ui.painter().rect_filled(button, 3.0, tokens(ui).surface[3]);
        ui.scope_builder(UiBuilder::new().max_rect(button), |ui| {
            if widgets::icon_button(ui, icons::ICON_UNFOLD_LESS, "Fold the legend").clicked() {
                self.saved.legend = Some(false);
            }
        });
        Some(place)
    }

    /// The visible lines with their colours.
    fn lines(&self, ui: &Ui, layers: &[Layer<'_>], shown: &[&Layer<'_>]) -> Vec<(Color32, String)> {
        let tokens = tokens(ui);
        let mut lines = Vec::new();
        for (index, layer) in layers.iter().enumerate() {
            let drawn = shown.iter().any(|shown| shown.name == layer.name);
            let placed = self.tracks.placed.get(&layer.name);
            let visible = match layer.kind {
                Kind::Track { .. } => placed.is_some_and(|track| track.error.is_none()),
                Kind::Path(_) | Kind::Poses(_) | Kind::Plan(_) => true,
                _ => false,
            };
            if drawn && visible {
                let aligned = placed.is_some_and(|track| track.alignment.is_some());
                let aligned = if aligned { " (aligned at start)" } else { "" };
                let name = format!("{}{aligned}", layer.name);
                lines.push((tokens.series(series(layers, index)), name));
            }
        }
        lines
    }
}

/// The names of lines in the legend, as many as this height has room for; the last row says how many there are besides.
fn line_names(ui: &mut Ui, lines: &[(Color32, String)], height: f32) {
    let rows = ((height / LEGEND_LINE) as usize).max(2);
    let count = if lines.len() <= rows { lines.len() } else { rows - 1 };
    let names: Vec<&str> = lines.iter().map(|(_, name)| name.as_str()).collect();
    for (color, name) in &lines[..count] {
        legend::swatch_among(ui, *color, name, &names);
    }
    let others = &names[count..];
    if !others.is_empty() {
        let text = RichText::new(format!("and {} more", others.len())).small().color(tokens(ui).weak);
        ui.label(text).on_hover_text(others.join("\n"));
    }
}

/// What the colours of a cloud mean; `by` is what was chosen.
fn cloud_legend(ui: &mut Ui, layer: &str, colors: CloudColors, by: Option<&str>) {
    let name = |what: &str| format!("{layer}  {what}");
    match colors {
        CloudColors::Height(range) => {
            let [low, high] = range.map(|z| format::metres(z, 1));
            legend::title(ui, &name("height"));
            legend::band(ui, 96.0, &low, &high, palette::even);
        }
        CloudColors::Intensity(range) => {
            let [low, high] = range.map(format::number);
            legend::title(ui, &name("intensity"));
            legend::band(ui, 96.0, &low, &high, intensity_color);
        }
        CloudColors::Value(range) => {
            let [low, high] = range.map(format::number);
            legend::title(ui, &name(by.unwrap_or_default()));
            legend::band(ui, 96.0, &low, &high, palette::even);
        }
        CloudColors::Own => {
            legend::title(ui, &name("own colours"));
        }
        // What was chosen may be a field that the cloud does not have.
        CloudColors::Plain => {
            let is_chosen = by == Some(ONE);
            legend::title(ui, &name(if is_chosen { ONE } else { "flat, one colour" }));
        }
    }
}

fn shade_choice(ui: &mut Ui, layer: &Layer<'_>, cells: &Cells<'_>, state: &mut LayerState, indent: f32) {
    let Some(shown) = cells.shade(state.shade.as_deref()) else { return };
    let choices: Vec<Shade> = cells.choices();
    ui.horizontal(|ui| {
        ui.add_space(indent);
        let combo =
            egui::ComboBox::from_id_salt(("shade", &layer.name)).selected_text(shown.name()).width(136.0);
        let combo = combo.show_ui(ui, |ui| {
            for choice in &choices {
                if ui.selectable_label(*choice == shown, choice.name()).clicked() {
                    state.shade = Some(choice.name().to_owned());
                }
            }
        });
        let name = format!("Number shown of {}", layer.name);
        combo.response.widget_info(|| WidgetInfo::labeled(Role::ComboBox, true, &name));
        combo.response.on_hover_text("Which number of the cells is painted");
    });
}

/// The first row of a layer: its switch, its name and, where it has an extent, the button that zooms to it; returns
/// whether that was clicked.
fn heading(ui: &mut Ui, layers: &[Layer<'_>], index: usize, state: &mut LayerState) -> bool {
    let (layer, tokens) = (&layers[index], tokens(ui));
    let mut zoom = false;
    let icon = match layer.kind {
        Kind::Grid(_) => icons::ICON_GRID_ON,
        Kind::Cloud => icons::ICON_GRAIN,
        Kind::Entities(_) => icons::ICON_CATEGORY,
        Kind::Path(_) => icons::ICON_ROUTE,
        Kind::Poses(_) => icons::ICON_NEAR_ME,
        Kind::Goal(_) => icons::ICON_FLAG,
        Kind::Plan(_) => icons::ICON_ALT_ROUTE,
        Kind::Arcs(_) => icons::ICON_TURN_SLIGHT_RIGHT,
        Kind::Mission(_) => icons::ICON_TOUR,
        Kind::Track { .. } => icons::ICON_TIMELINE,
    };
    let color = match layer.kind {
        _ if is_line(layer) => tokens.series(series(layers, index)),
        _ => tokens.weak,
    };
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let checkbox = ui.checkbox(&mut state.shown, "");
        checkbox.widget_info(|| {
            WidgetInfo::selected(Role::CheckBox, true, state.shown, format!("Show {}", layer.name))
        });
        ui.label(icon.rich_text().size(14.0).color(color));
        let has_extent =
            matches!(layer.kind, Kind::Grid(_) | Kind::Cloud | Kind::Entities(_) | Kind::Track { .. });
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if has_extent {
                let name = format!("Zoom to {}", layer.name);
                zoom = widgets::icon_button(ui, icons::ICON_CENTER_FOCUS_STRONG, &name).clicked();
            }
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                let names: Vec<&str> = layers.iter().map(|layer| layer.name.as_str()).collect();
                short_name::label(ui, &layer.name, &names);
            });
        });
    });
    zoom
}

/// How opaque a layer is drawn.
fn opacity(ui: &mut Ui, layer: &Layer<'_>, state: &mut LayerState, indent: f32) {
    ui.horizontal(|ui| {
        ui.add_space(indent);
        ui.spacing_mut().slider_width = 96.0;
        let slider = egui::Slider::new(&mut state.opacity, 0.0..=1.0)
            .custom_formatter(|value, _| format!("{:3.0} %", value * 100.0))
            .custom_parser(|text| text.trim_end_matches('%').trim().parse::<f64>().ok().map(|v| v / 100.0));
        let name = format!("Opacity of {}", layer.name);
        let response = ui.add(slider);
        response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, &name));
        response.on_hover_text(name);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use rcs_runtime::RunId;
    use rcs_runtime::source::RunTag;
    use std::collections::BTreeMap;

    #[test]
    fn a_branch_changes_no_colour_and_the_track_that_was_left_has_that_of_its_topic() {
        let colours = |frame: &Frame| -> BTreeMap<String, usize> {
            let layers = layers::layers(frame);
            let lines = layers.iter().enumerate().filter(|(_, layer)| is_line(layer));
            lines.map(|(index, layer)| (layer.name.clone(), series(&layers, index))).collect()
        };
        let branched = samples::compared();
        let tracks = branched.tracks.iter().filter(|track| track.run == RunTag::Run(RunId(1)));
        let before = colours(&Frame { tracks: tracks.cloned().collect(), ..branched.clone() });
        let mut after = colours(&branched);
        let left = after.remove("/localization/local (run 0)");
        assert!(left.is_some() && left == before.get("/localization/local").copied(), "{after:?}");
        assert_eq!(after, before);
    }

    #[test]
    fn names_of_layers_that_find_no_room_are_still_told_from_each_other() {
        let frame = samples::compared();
        let count = layers::layers(&frame).len();
        let mut harness = Harness::builder()
            .with_size(Vec2::new(190.0, 900.0))
            .with_context_setup(ocu_ui::install)
            .build_ui(move |ui| {
                let layers = layers::layers(&frame);
                for index in 0..layers.len() {
                    widgets::named(ui, index, |ui| heading(ui, &layers, index, &mut LayerState::default()));
                }
            });
        harness.run();
        let mut texts = Vec::new();
        for clipped in &harness.output().shapes {
            let egui::Shape::Text(text) = &clipped.shape else { continue };
            let name = text.galley.text();
            if name.contains('/') || name.contains('…') {
                assert!(!text.galley.elided, "{name}");
                texts.push(name.to_owned());
            }
        }
        assert!(texts.iter().any(|name| name.contains('…')), "{texts:?}");
        texts.sort_unstable();
        texts.dedup();
        assert_eq!(texts.len(), count, "{texts:?}");
    }

    #[test]
    fn a_legend_names_as_many_lines_as_its_height_has_room_for_and_says_how_many_are_left() {
        let lines: Vec<(Color32, String)> =
            (0..9).map(|line| (Color32::WHITE, format!("/line{line}"))).collect();
        for (rows, named, more) in
            [(9.0, 9, None), (8.5, 7, Some("and 2 more")), (0.0, 1, Some("and 8 more"))]
        {
            let lines = lines.clone();
            let mut harness = Harness::builder()
                .with_size(Vec2::new(200.0, 300.0))
                .with_context_setup(ocu_ui::install)
                .build_ui(move |ui| line_names(ui, &lines, rows * LEGEND_LINE));
            harness.run();
            assert_eq!(harness.query_all_by_label_contains("/line").count(), named);
            assert_eq!(harness.query_by_label_contains("more").is_some(), more.is_some());
            assert!(more.is_none_or(|more| harness.query_by_label(more).is_some()), "{more:?}");
        }
    }
}
