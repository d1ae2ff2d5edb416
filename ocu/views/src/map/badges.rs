//! Notes at the top of a map: what is left out of it, and that it is a preview.

use super::grid::Extent;
use super::layers::{self, Kind, Layer};
use super::{Map, paint, picture};
use crate::badge;
use crate::canvas::Viewport;
use crate::clip::{Near, is_place};
use egui::{Rect, Ui};
use ocu_ui::{icons, legend};
use rcs_runtime::source::Frame;

impl Map {
    /// Shows the number of implausible points in the visible layers, which are left out of the fitted region, and that a
    /// map is shown as it would be with the weights that are being edited. Returns how far the note about the preview
    /// reaches down, from the upper edge of the canvas, screen points; 0 without one.
    pub(super) fn badges(
        &self,
        ui: &Ui,
        frame: &Frame,
        map: &str,
        shown: &[&Layer<'_>],
        viewport: Viewport,
        canvas: Rect,
    ) -> f32 {
        let mut counts = Vec::new();
        for layer in shown {
            let pose = layers::map_from_layer(frame, map, layer);
            let far = match (layer.kind, pose) {
                (Kind::Track { .. }, _) => {
                    self.tracks.placed.get(&layer.name).map_or(0, |track| track.judged.far)
                }
                (Kind::Grid(grid), Ok(pose)) => {
                    let corners = Extent::of(grid).map(|extent| extent.corners).unwrap_or_default();
                    usize::from(!corners.iter().all(|p| is_place(&(pose * *p).to_array())))
                }
                (Kind::Cloud, Ok(pose)) => {
                    let cloud = picture::cloud(ui.ctx(), layer, map, pose, &self.state(layer).cloud);
                    cloud.map_or(0, |cloud| cloud.far)
                }
                (Kind::Entities(_), _) => self.flat(layer).map_or(0, |flat| flat.far),
                (Kind::Path(path) | Kind::Poses(path), Ok(pose)) => {
                    let points: Vec<_> = paint::path_points(path, &pose).collect();
                    let near = Near::of(points.iter().copied());
                    points.iter().filter(|point| !near.has(**point)).count()
                }
                (Kind::Goal(goal), Ok(pose)) => {
                    let goal = crate::pose::from_message(goal.pose.as_ref());
                    usize::from(goal.is_ok_and(|goal| !is_place(&(pose * goal.translation).to_array())))
                }
                (Kind::Plan(_) | Kind::Arcs(_) | Kind::Mission(_), Ok(_)) | (_, Err(_)) => 0,
            };
            counts.push((far, layer.name.as_str()));
        }
        let mut preview_down = 0.0;
        if let Some(text) = self.preview_text(shown) {
            let scale_bar = legend::scale_bar_place(ui, paint::scale_bar_at(canvas), viewport.scale);
            let plate = paint::badge(ui, canvas, scale_bar, icons::ICON_TUNE, &text);
            preview_down = plate.bottom() - canvas.top();
        }
        badge::implausible(ui, canvas, badge::DOWN.max(preview_down + 4.0), "places", counts);
        preview_down
    }

    /// Which maps are shown with other weights than those with which they were fused; `None` for none.
    fn preview_text(&self, shown: &[&Layer<'_>]) -> Option<String> {
        let previewed = shown.iter().filter(|layer| self.edited_weights(layer).is_some());
        let names: Vec<&str> = previewed.map(|layer| layer.name.as_str()).collect();
        self.preview.as_ref().filter(|_| !names.is_empty()).map(|edited| edited.text(&names))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::LayerState;
    use crate::map::preview::Edited;
    use crate::samples;
    use crate::view::{PreviewStage, Selection, View, ViewContext};
    use egui::Vec2;
    use egui_kittest::Harness;
    use rcs_msg::foxglove::{Grid, Vector2};
    use rcs_msg::rcs::{ProcessInfo, SpeedLimit};
    use rcs_world::{Source, Weights};

    /// A preview of the map of `wm1` in which stereo, its only source, has no weight.
    fn preview() -> Edited {
        Edited::of_wm1(Weights::default().with(Source::STEREO, 0.0), Weights::default())
    }

    /// A window of this size, screen points, with a map.
    fn harness(size: Vec2, shown: (Map, Frame, Selection)) -> Harness<'static, (Map, Frame, Selection)> {
        let builder = Harness::builder().with_size(size).with_context_setup(ocu_ui::install);
        builder.build_ui_state(
            |ui, (map, frame, selection): &mut (Map, Frame, Selection)| {
                let (mut controls, mut wishes) = (Vec::new(), Vec::new());
                let (controls, wishes) = (&mut controls, &mut wishes);
                map.ui(ui, &mut ViewContext { frame, controls, selection, wishes });
            },
            shown,
        )
    }

    /// A drive with another grid, with cells of this side, on a part of the map of `wm1`.
    fn with_grid(cell_m: f64) -> Frame {
        let mut frame = samples::driving();
        let cell_size = Some(Vector2 { x: cell_m, y: cell_m });
        let grid = samples::topic("/other", 5.0, 0.1, Grid { cell_size, ..samples::grid(10, 10) });
        frame.topics = frame.topics.iter().cloned().chain([grid]).collect();
        frame
    }

    #[test]
    fn a_map_with_edited_weights_lies_above_finer_grids_and_its_note_names_it() {
        let frame = with_grid(0.1);
        let layers = layers::layers(&frame);
        let shown: Vec<_> = layers.iter().filter(|layer| !layer.is_ground_truth()).collect();
        let top = |map: &Map| {
            let layers = map.by_preview(&shown);
            let mut grids = layers.into_iter().filter(|layer| matches!(layer.kind, Kind::Grid(_)));
            grids.next_back().map(|layer| layer.name.clone())
        };
        let mut map = Map::default();
        assert_eq!((top(&map).as_deref(), map.preview_text(&shown)), (Some("/other"), None));
        map.preview = Some(preview());
        let text = map.preview_text(&shown);
        assert_eq!(text.as_deref(), Some("preview of /wm1/map: edited weights, not sent"));
        assert_eq!(top(&map).as_deref(), Some("/wm1/map"));
        for (stage, expected) in [
            (PreviewStage::OnItsWay, "preview of /wm1/map: weights sent, on their way"),
            (PreviewStage::InForce, "preview of /wm1/map: weights sent, in force from the next map"),
        ] {
            let mut sent = preview();
            sent.preview.stage = stage;
            map.preview = Some(sent);
            assert_eq!(map.preview_text(&shown).as_deref(), Some(expected));
        }
    }

    #[test]
    fn what_edited_weights_take_away_is_not_seen_on_a_coarser_grid_below() {
        let picture = |is_shown: bool| {
            let edited = preview();
            let mut selection = Selection::default();
            selection.preview.set(&std::sync::Arc::new(()), edited.preview.clone());
            selection.preview.turn();
            let mut map = Map { preview: Some(edited), ..Map::default() };
            let other = LayerState { shown: is_shown, ..LayerState::default() };
            map.saved.layers.insert("/other".to_owned(), other);
            let mut harness = harness(Vec2::new(500.0, 400.0), (map, with_grid(0.4), selection));
            harness.run_steps(3);
            assert!(harness.state().0.preview.is_some());
            // The part of the map on which the other grid lies.
            let image = harness.render().unwrap();
            let middle = (190..310).flat_map(|x| (160..280).map(move |y| (x, y)));
            middle.map(|(x, y)| *image.get_pixel(x, y)).collect::<Vec<_>>()
        };
        assert!(picture(true) == picture(false));
    }

    #[test]
    fn a_read_out_lies_below_the_note_about_a_preview_in_a_narrow_map() {
        // The parameters of the preview are in force.
        let params = samples::topic("/tuned/params", 0.0, 1.0, SpeedLimit { max_speed_mps: 1.0 });
        let process = ProcessInfo {
            name: "wm1".to_owned(),
            params_buffer: "/tuned/params".to_owned(),
            ..ProcessInfo::default()
        };
        let mut frame = samples::driving();
        frame.topics = frame.topics.iter().cloned().chain([params]).collect();
        frame.processes = std::sync::Arc::new([process]);
        let mut edited = preview();
        edited.preview.stage = PreviewStage::InForce;
        let mut selection = Selection::default();
        selection.preview.set(&std::sync::Arc::new(()), edited.preview.clone());
        selection.preview.turn();
        let mut map = Map { preview: Some(edited), ..Map::default() };
        let viewport = Viewport { center: [0.0; 2], scale: 11.0, y_up: true, turned_rad: 0.0 };
        (map.saved.viewport, map.saved.panel) = (Some(viewport), Some(false));
        let mut harness = harness(Vec2::new(540.0, 520.0), (map, frame, selection));
        // The first pass fits the map to its source.
        harness.run_steps(1);
        // The place that is read lies in the lower half.
        harness.state_mut().0.kept = Some([0.0, -10.0]);
        harness.run_steps(3);
        let note = harness.output().shapes.iter().find_map(|painted| match &painted.shape {
            egui::Shape::Text(text) if text.galley.text().contains("in force from the next map") => {
                assert!(text.galley.rows.len() > 1, "it has several lines");
                Some(text.galley.rect.translate(text.pos.to_vec2()))
            }
            _ => None,
        });
        let (note, read_out) = (note.unwrap(), harness.state().0.kept_plate.unwrap());
        assert!(!note.intersects(read_out), "{note} {read_out}");
    }
}
