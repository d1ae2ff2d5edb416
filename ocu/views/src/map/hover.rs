//! Readout of the position under the pointer: coordinates, all fields of the cell, and the frame from which they come.

use super::Map;
use super::grid::Cells;
use super::layers::{self, Kind, Layer};
use crate::canvas::Viewport;
use crate::view::{HoverPoint, ViewContext};
use egui::{Align2, Rect, Response, RichText, Stroke, Ui};
use ocu_ui::widgets::mono;
use ocu_ui::{format, legend, tokens};
use rcs_geom::DVec3;
use rcs_msg::Stamp;
use rcs_runtime::source::{Frame, WGS84};
use rcs_world::Label;
use std::collections::BTreeSet;

impl Map {
    /// Shares the pointer's position with the other views, and marks positions shared by them.
    pub(super) fn point_at(
        ui: &Ui,
        cx: &mut ViewContext<'_>,
        map: &str,
        response: &Response,
        viewport: Viewport,
        canvas: Rect,
    ) {
        if let Some(at) = response.hover_pos() {
            let [x, y] = viewport.to_plane(canvas, at);
            cx.selection.hovered =
                Some(HoverPoint { frame_id: map.to_owned(), position_m: [x, y, f64::NAN] });
            return;
        }
        let Some(point) = cx.selection.hovered.as_ref() else { return };
        let p = DVec3::from_array(point.position_m.map(|v| if v.is_nan() { 0.0 } else { v }));
        let p = if point.frame_id == map {
            p
        } else {
            let Ok(map_from_point) = cx.frame.transforms.lookup(map, &point.frame_id, cx.frame.now.0) else {
                return;
            };
            map_from_point * p
        };
        let at = viewport.to_screen(canvas, [p.x, p.y]);
        ui.painter_at(canvas).circle_stroke(at, 6.0, Stroke::new(1.5, tokens(ui).accent));
    }

    /// The panel in the corner with the readout.
    pub(super) fn read_out(
        &self,
        ui: &mut Ui,
        frame: &Frame,
        map: &str,
        shown: &[&Layer<'_>],
        pointer: Option<[f64; 2]>,
        canvas: Rect,
    ) {
        let Some([x, y]) = pointer else { return };
        legend::plate(ui, canvas, Align2::RIGHT_BOTTOM, |ui| {
            ui.style_mut().interaction.selectable_labels = false;
            ui.label(mono(format!("x {x:8.2} m  y {y:8.2} m")));
            if let Some(enu) = self.tracks.enu.as_ref().filter(|_| map == WGS84) {
                let place = enu.geodetic_from_enu(DVec3::new(x, y, 0.0));
                ui.label(mono(format!("{:11.6}°  {:11.6}°", place.latitude_deg, place.longitude_deg)));
            }
            for layer in shown {
                if let Kind::Grid(grid) = layer.kind
                    && let Ok(cells) = Cells::new(grid)
                    && let Ok(map_from_grid) = layers::map_from_layer(frame, map, layer)
                    && let Some(cell) = cells.cell_at(map_from_grid.inverse() * DVec3::new(x, y, 0.0))
                {
                    cell_lines(ui, frame, layer, &cells, cell);
                }
            }
        });
    }
}

/// All fields of a cell: each cost with its confidence and source frame on one line.
fn cell_lines(ui: &mut Ui, frame: &Frame, layer: &Layer<'_>, cells: &Cells<'_>, cell: [usize; 2]) {
    let value = |name: &str| cells.read(name, cell);
    let mut told = BTreeSet::new();
    let mut tell = |name: &str| {
        told.insert(name.to_owned());
        value(name)
    };
    let weak = tokens(ui).weak;
    ui.label(RichText::new(format!("{}  cell {}, {}", layer.name, cell[0], cell[1])).small().color(weak));
    if let Some(fused) = tell("cost") {
        let confidence = tell("confidence").map(|conf| format!("  conf {conf:3}")).unwrap_or_default();
        let place = tell("source").unwrap_or(f64::NAN);
        let mut sources = cells.names().filter_map(|name| name.strip_prefix("cost."));
        let source = if place >= 0.0 { sources.nth(place as usize) } else { None };
        let by = source.map(|source| format!(" by {source}")).unwrap_or_default();
        let label = match tell("label") {
            Some(label) if label == f64::from(Label::Ground as u8) => "  ground",
            Some(label) if label == f64::from(Label::Obstacle as u8) => "  obstacle",
            _ => "",
        };
        ui.label(mono(format!("fused      {}{confidence}{label}{by}", cost(fused))));
    }
    for name in cells.names() {
        let Some(source) = name.strip_prefix("cost.") else { continue };
        let cost = tell(name).map(cost).unwrap_or_default();
        let confidence =
            tell(&format!("conf.{source}")).map(|conf| format!("  conf {conf:3}")).unwrap_or_default();
        let made_by = match tell(&format!("seq.{source}")) {
            Some(sequence) if sequence > 0.0 => format!("  by frame {sequence}"),
            Some(_) => "  never seen".to_owned(),
            None => String::new(),
        };
        ui.label(mono(format!("{source:<10} {cost}{confidence}{made_by}")));
    }
    if let (Some(seconds), Some(nanos)) = (tell("updated_s"), tell("updated_ns")) {
        let changed = Stamp(seconds as u64 * 1_000_000_000 + nanos as u64);
        let text = match changed.0 {
            0 => "never".to_owned(),
            _ => format!(
                "{} ago, at {}",
                format::age(frame.now.seconds_since(changed)),
                format::clock(changed.0)
            ),
        };
        ui.label(mono(format!("changed    {text}")));
    }
    let rest: Vec<_> = cells.names().filter(|name| !told.contains(*name)).collect();
    for pair in rest.chunks(2) {
        let one =
            |name: &str| format!("{name:<18} {:<10}", value(name).map(format::number).unwrap_or_default());
        let text = pair.iter().map(|name| one(name)).collect::<Vec<_>>().join(" ");
        ui.label(mono(text.trim_end()));
    }
}

fn cost(value: f64) -> String {
    if value > 250.0 { "unknown ".to_owned() } else { format!("cost {value:3}") }
}
