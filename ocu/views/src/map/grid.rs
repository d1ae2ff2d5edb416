//! A `foxglove.Grid`, or a map that can be converted to one: the position of its cells, their fields, and painting.

use egui::{Color32, ColorImage};
use ocu_ui::palette::{self, MapPalette};
use rcs_geom::DVec3;
use rcs_msg::AnyMessage;
use rcs_msg::foxglove::Grid;
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_world::{GridView, MapMessage, Weights, fuse_grid};

/// Frame of a grid, valid or not; `None` for other messages.
pub(super) fn frame_of(message: &AnyMessage) -> Option<&str> {
    match message.source::<MapMessage>() {
        Some(map) => Some(map.frame_id()),
        None => Some(&message.get::<Grid>()?.frame_id),
    }
}

/// Whether a grid has no cells, as a map before its first measurement: there is nothing to draw, and nothing is wrong.
pub(super) fn is_empty(message: &AnyMessage) -> bool {
    // A map of ours has cells, and is not converted to a grid to see that.
    let grid = || message.get::<Grid>().is_some_and(|grid| grid.data.is_empty() && grid.column_count == 0);
    message.source::<MapMessage>().is_none() && grid()
}

/// Where a grid lies. Of our own maps it is read without their fields, which have to be named.
pub(super) struct Extent {
    /// Side of the cells along x, m.
    pub(super) cell_m: f64,
    /// The four corners in the grid's frame, counter-clockwise from (0, 0) along x.
    pub(super) corners: [DVec3; 4],
}

impl Extent {
    /// `None` for a grid that is not valid.
    pub(super) fn of(message: &AnyMessage) -> Option<Self> {
        let Some(map) = message.source::<MapMessage>().map(MapMessage::map) else {
            let cells = Cells::new(message).ok()?;
            return Some(Self { cell_m: cells.0.cell_size_m().x, corners: cells.corners() });
        };
        let (corner, cell_m) = (map.grid().origin(), map.grid().cell_size_m());
        let side_m = map.side() as f64 * cell_m;
        let parts = [(0.0, 0.0), (side_m, 0.0), (side_m, side_m), (0.0, side_m)];
        Some(Self { cell_m, corners: parts.map(|(x, y)| DVec3::new(corner.x + x, corner.y + y, 0.0)) })
    }
}

/// The fields of the colour of a cell, bytes.
const COLOR_FIELDS: [&str; 3] = ["red", "green", "blue"];

/// A validated grid.
#[derive(Clone, Debug)]
pub(super) struct Cells<'a>(GridView<'a>);

impl<'a> Cells<'a> {
    /// Validates a grid; the error says what is inconsistent.
    pub(super) fn new(message: &'a AnyMessage) -> Result<Self, String> {
        GridView::of(message).map(Self).map_err(|error| error.to_string())
    }

    /// Number of cells along x and y.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.0.columns(), self.0.rows()]
    }

    /// Names of the fields.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.0.names()
    }

    /// Whether it has a field.
    pub(super) fn has(&self, name: &str) -> bool {
        self.0.field(name).is_ok()
    }

    /// Value of a field in a cell; `None` where the field or cell does not exist.
    pub(super) fn read(&self, name: &str, [column, row]: [usize; 2]) -> Option<f64> {
        self.0.field(name).ok()?.get(column, row)
    }

    /// The cell that contains a point of the grid's frame.
    pub(super) fn cell_at(&self, p_frame: DVec3) -> Option<[usize; 2]> {
        let p = self.0.frame_from_grid().inverse() * p_frame;
        let cell_m = self.0.cell_size_m();
        let (column, row) = (p.x / cell_m.x, p.y / cell_m.y);
        let [columns, rows] = self.size();
        let inside = column >= 0.0 && row >= 0.0 && column < columns as f64 && row < rows as f64;
        inside.then_some([column as usize, row as usize])
    }

    /// The four corners in the grid's frame, counter-clockwise from (0, 0) along x.
    pub(super) fn corners(&self) -> [DVec3; 4] {
        let ([columns, rows], cell_m) = (self.size(), self.0.cell_size_m());
        let (x, y) = (columns as f64 * cell_m.x, rows as f64 * cell_m.y);
        [DVec3::ZERO, DVec3::new(x, 0.0, 0.0), DVec3::new(x, y, 0.0), DVec3::new(0.0, y, 0.0)]
            .map(|p| self.0.frame_from_grid() * p)
    }

    /// What can be painted: first the fused cost, where there are costs of sources, then the colours of the cells, where
    /// they have some, then every field.
    pub(super) fn choices(&self) -> Vec<Shade> {
        let fused = (!self.0.sources().is_empty()).then_some(Shade::Fused);
        let colors = COLOR_FIELDS.iter().all(|name| self.is_byte(name)).then_some(Shade::Colors);
        let fields = self.names().map(|name| Shade::Field(name.to_owned()));
        fused.into_iter().chain(colors).chain(fields).collect()
    }

    /// Whether a field is one of bytes, such as costs.
    pub(super) fn is_byte(&self, name: &str) -> bool {
        self.0.field_of(name, NumericType::Uint8).is_ok()
    }

    /// The colours that the cells themselves have; `None` if they have none.
    fn colors(&self) -> Option<Vec<Color32>> {
        let channel = |name: &str| {
            let mut bytes = Vec::new();
            self.0.field_of(name, NumericType::Uint8).ok()?.bytes_into(&mut bytes);
            Some(bytes)
        };
        let [Some(red), Some(green), Some(blue)] = COLOR_FIELDS.map(channel) else { return None };
        let alpha = channel("alpha").unwrap_or_else(|| vec![u8::MAX; red.len()]);
        let rgba = red.iter().zip(&green).zip(&blue).zip(&alpha);
        let color =
            |(((r, g), b), a): (((&u8, &u8), &u8), &u8)| Color32::from_rgba_unmultiplied(*r, *g, *b, *a);
        Some(rgba.map(color).collect())
    }

    /// The shade with a saved name; otherwise the map's own fused cost, otherwise the first choice.
    pub(super) fn shade(&self, name: Option<&str>) -> Option<Shade> {
        let choices = self.choices();
        let found = choices.iter().find(|choice| Some(choice.name()) == name);
        let cost = choices.iter().find(|choice| choice.name() == "cost");
        found.or(cost).or(choices.first()).cloned()
    }

    /// Whether a shade is a cost. Costs are bytes; a field of another type with such a name has a scale of its own.
    pub(super) fn is_cost(&self, shade: &Shade) -> bool {
        match shade {
            Shade::Fused => true,
            Shade::Colors => false,
            Shade::Field(name) => (name == "cost" || name.starts_with("cost.")) && self.is_byte(name),
        }
    }

    /// The 2nd and 98th percentile of a field; `None` for costs and confidences, whose range is fixed.
    pub(super) fn range(&self, shade: &Shade) -> Option<[f64; 2]> {
        let Shade::Field(name) = shade else { return None };
        if self.is_cost(shade) || (name.starts_with("conf") && self.is_byte(name)) {
            return None;
        }
        let every = (self.0.columns() * self.0.rows() / 20_000).max(1);
        let field = self.0.field(name).ok()?;
        let mut values: Vec<f64> = field.values().step_by(every).filter(|value| value.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let at =
            |fraction: f64| values.get((values.len().saturating_sub(1) as f64 * fraction) as usize).copied();
        Some([at(0.02)?, at(0.98)?])
    }

    /// One pixel per cell, row 0 first. With `weights`, the fused cost is that of these weights.
    pub(super) fn paint(
        &self,
        shade: &Shade,
        palette: MapPalette,
        range: Option<[f64; 2]>,
        weights: Option<&Weights>,
    ) -> ColorImage {
        if *shade == Shade::Colors
            && let Some(pixels) = self.colors()
        {
            return ColorImage::new(self.size(), pixels);
        }
        let costs: [Color32; 256] = std::array::from_fn(|cost| palette.cost(cost as u8));
        let mut bytes = Vec::new();
        let equal = Weights::default();
        let weights =
            weights.filter(|_| shade.is_fused()).or(matches!(shade, Shade::Fused).then_some(&equal));
        let fused = weights.is_some_and(|weights| fuse_grid(&self.0, weights, &mut bytes).is_ok());
        let field = self.0.field(shade.name()).ok();
        let pixels: Vec<Color32> = match field {
            _ if fused => bytes.iter().map(|cost| costs[usize::from(*cost)]).collect(),
            Some(field) if self.is_cost(shade) => {
                let cost = |value: f64| if (0.0..=250.0).contains(&value) { value as u8 } else { u8::MAX };
                field.values().map(|value| costs[usize::from(cost(value))]).collect()
            }
            Some(field) => {
                let [low, high] = range.unwrap_or([0.0, 255.0]);
                let span = (high - low).max(1e-9);
                field.values().map(|value| palette::even((value - low) / span)).collect()
            }
            None => vec![palette.unknown(); self.0.columns() * self.0.rows()],
        };
        ColorImage::new(self.size(), pixels)
    }
}

/// The value by which a grid is coloured.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shade {
    /// Costs of all sources, fused again with equal weights.
    Fused,
    /// The colours that the cells themselves have.
    Colors,
    /// One field.
    Field(String),
}

impl Shade {
    /// Name in lists and layouts.
    pub(super) fn name(&self) -> &str {
        match self {
            Self::Fused => "fused, equal weights",
            Self::Colors => "colour",
            Self::Field(name) => name,
        }
    }

    /// Whether it is the fused cost, of whatever weights.
    pub(super) fn is_fused(&self) -> bool {
        matches!(self, Self::Fused) || self.name() == "cost"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use rcs_msg::foxglove::PackedElementField;

    #[test]
    fn a_cell_is_found_by_its_place_and_gives_every_number() {
        let grid = AnyMessage::new(samples::grid(4, 3));
        let cells = Cells::new(&grid).unwrap();
        let corner = cells.corners()[0];
        let cell = cells.cell_at(corner + DVec3::new(0.5, 0.3, 0.0)).unwrap();
        assert_eq!(cell, [2, 1]);
        let values: Vec<_> = cells.names().map(|name| cells.read(name, cell).unwrap()).collect();
        assert_eq!(values, [f64::from(samples::cost(2, 1)), 200.0, 7.0]);
        assert_eq!(cells.cell_at(corner + DVec3::new(-0.1, 0.0, 0.0)), None);
        assert_eq!(cells.cell_at(corner + DVec3::new(0.81, 0.0, 0.0)), None);
    }

    #[test]
    fn costs_are_painted_in_the_palettes_colours_and_row_0_comes_first() {
        let grid = AnyMessage::new(samples::grid(4, 3));
        let cells = Cells::new(&grid).unwrap();
        for shade in [Shade::Field("cost.stereo".into()), Shade::Fused] {
            let image = cells.paint(&shade, MapPalette::Papers, None, None);
            assert_eq!(image.size, [4, 3]);
            for (i, pixel) in image.pixels.iter().enumerate() {
                assert_eq!(*pixel, MapPalette::Papers.cost(samples::cost(i % 4, i / 4)), "{shade:?}");
            }
        }
    }

    #[test]
    fn a_source_that_no_view_knows_is_shown_weighed_and_read_like_any_other() {
        let radar = rcs_world::Source::new("radar").unwrap();
        let mut map = rcs_world::Map::new(0.2).unwrap();
        let cell = map.grid().centre();
        for (source, cost) in [(rcs_world::Source::STEREO, 100), (radar, 200)] {
            map.vote(cell, source, cost, 1, rcs_msg::Stamp(1), rcs_world::VoteRule::default());
        }
        let weights = Weights::default();
        let options = rcs_world::MapOptions { sources: map.sources(), heights: false, weights };
        let map = MapMessage::new(map, "local", rcs_msg::Stamp(1), options);
        // Once as published by a process, and once as stored in a log.
        let grid = AnyMessage::new(Grid::from(map.clone()));
        for message in [map.into_message(), grid] {
            let cells = Cells::new(&message).unwrap();
            let extent = Extent::of(&message).unwrap();
            assert_eq!((extent.cell_m, extent.corners), (0.2, cells.corners()));
            let choices = cells.choices();
            assert!(choices.contains(&Shade::Field("cost.radar".into())), "{choices:?}");
            assert_eq!(cells.read("cost.radar", [100, 100]), Some(200.0));
            let pixel =
                |shade: &Shade| cells.paint(shade, MapPalette::Papers, None, None).pixels[100 * 201 + 100];
            assert_eq!(pixel(&Shade::Field("cost.radar".into())), MapPalette::Papers.cost(200));
            // Both are range sensors: the higher cost counts.
            assert_eq!(pixel(&Shade::Fused), MapPalette::Papers.cost(200));
            // With weights that are being edited, the map's own fused cost follows them.
            let edited = Weights::default().with(radar, 0.0);
            let image = cells.paint(&Shade::Field("cost".into()), MapPalette::Papers, None, Some(&edited));
            assert_eq!(image.pixels[100 * 201 + 100], MapPalette::Papers.cost(100));
            let image =
                cells.paint(&Shade::Field("cost.radar".into()), MapPalette::Papers, None, Some(&edited));
            assert_eq!(image.pixels[100 * 201 + 100], MapPalette::Papers.cost(200));
        }
    }

    #[test]
    fn cells_with_colours_are_painted_in_them() {
        let field = |name: &str, offset, kind: NumericType| PackedElementField {
            name: name.into(),
            offset,
            r#type: kind.into(),
        };
        let byte = NumericType::Uint8;
        let opaque = [field("red", 0, byte), field("green", 1, byte), field("blue", 2, byte)];
        let clear = [&opaque[..], &[field("alpha", 3, byte)][..]].concat();
        let number = [&opaque[..2], &[field("blue", 2, NumericType::Uint16)][..]].concat();
        let grid = |fields: &[PackedElementField]| {
            let (column_count, row_stride, cell_stride) = (2, 8, 4);
            let data = vec![200_u8, 100, 50, 255, 1, 2, 3, 0].into();
            let fields = fields.to_vec();
            Grid { fields, data, column_count, row_stride, cell_stride, ..samples::grid(1, 1) }
        };
        let first = Color32::from_rgb(200, 100, 50);
        for (fields, second) in
            [(&opaque[..], Color32::from_rgb(1, 2, 3)), (&clear[..], Color32::TRANSPARENT)]
        {
            let message = AnyMessage::new(grid(fields));
            let cells = Cells::new(&message).unwrap();
            let shade = cells.shade(None).unwrap();
            assert_eq!((&shade, cells.is_cost(&shade)), (&Shade::Colors, false));
            assert_eq!(cells.range(&shade), None);
            assert_eq!(cells.paint(&shade, MapPalette::Papers, None, None).pixels, [first, second]);
        }
        let message = AnyMessage::new(grid(&number));
        assert_eq!(Cells::new(&message).unwrap().shade(None), Some(Shade::Field("red".into())));
    }

    #[test]
    fn a_costmap_is_painted_on_the_scale_of_costs_and_read_with_its_own_values() {
        let grid = AnyMessage::new(samples::costmap(5, &[0, 127, 253, 254, 255]));
        let cells = Cells::new(&grid).unwrap();
        let shade = cells.shade(None).unwrap();
        assert_eq!(shade, Shade::Field("cost".into()));
        assert!(cells.is_cost(&shade) && cells.range(&shade).is_none());
        let palette = MapPalette::Papers;
        let image = cells.paint(&shade, palette, None, None);
        assert_eq!(image.size, [5, 1]);
        let colors = [0, 125, 249, 250].map(|cost| palette.cost(cost));
        assert_eq!(image.pixels[..4], colors);
        assert_eq!(image.pixels[4], palette.unknown());
        let column = cells.cell_at(DVec3::new(1.0 + 3.5 * 0.5, 2.1, 0.0)).unwrap();
        assert_eq!(["cost", "costmap"].map(|name| cells.read(name, column)), [Some(250.0), Some(254.0)]);
    }

    #[test]
    fn fields_of_floats_have_scales_of_their_own_whatever_their_names() {
        let numbers = [0.25_f32, 0.75, f32::NAN];
        for name in ["cost", "cost.stereo", "confidence", "elevation"] {
            let fields = vec![PackedElementField {
                name: name.into(),
                offset: 0,
                r#type: NumericType::Float32.into(),
            }];
            let data = numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>().into();
            let (column_count, row_stride, cell_stride) = (3, 12, 4);
            let grid = Grid { fields, data, column_count, row_stride, cell_stride, ..samples::grid(1, 1) };
            let grid = AnyMessage::new(grid);
            let cells = Cells::new(&grid).unwrap();
            let shade = Shade::Field(name.into());
            assert!(!cells.is_cost(&shade), "{name}");
            let range = cells.range(&shade).unwrap();
            let pixels = cells.paint(&shade, MapPalette::Papers, Some(range), None).pixels;
            assert_ne!(pixels[0], pixels[2], "{name}");
            assert_eq!(pixels[2], Color32::TRANSPARENT, "{name}");
        }
    }

    #[test]
    fn a_layout_that_names_another_grids_field_falls_back_to_the_first_choice() {
        let grid = AnyMessage::new(samples::grid(4, 3));
        let cells = Cells::new(&grid).unwrap();
        assert_eq!(cells.shade(Some("height")), Some(Shade::Fused));
        assert_eq!(cells.shade(Some("conf.stereo")), Some(Shade::Field("conf.stereo".into())));
    }
}
