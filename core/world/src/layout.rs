//! The map as a `foxglove.Grid`.
//!
//! The caller names the frame of the grid. Its pose is the south-west corner of the map, without rotation; columns go
//! east and rows go north (row 0 is the southernmost), as the message requires. Cells are little-endian, with these
//! fields in this order:
//!
//! | field | type | meaning |
//! | --- | --- | --- |
//! | `updated_s`, `updated_ns` | `UINT32` | acquisition time of the last change: seconds and nanoseconds; both 0 is never |
//! | `seq.<source>` | `UINT32` | acquisition sequence that last changed the evidence of the source |
//! | `ground.mean`, `.variance`, `.min`, `.max` | `FLOAT32` | ground height, m and m², NaN without; only with heights, rounded to 1/1024 m and to 1/256 of the variance |
//! | `ground.count` | `UINT32` | number of heights |
//! | `obstacle.…` | | the same for obstacle points |
//! | `cost`, `confidence` | `UINT8` | fused with the map's weights: 0–250, 255 unknown; 0–255 |
//! | `label` | `UINT8` | 0 unknown, 1 ground, 2 obstacle: the class of the cost |
//! | `source` | `UINT8` | the source with the most evidence for it: its index, from 0, among the `cost.<source>`; 255 none |
//! | `obstacle_seen_from_dm` | `UINT8` | least distance of the vehicle when a vote called the cell an obstacle: decimetres, 255 for 25.5 m and more, 0 for never |
//! | `cost.<source>`, `conf.<source>` | `UINT8` | 0–250, 255 unknown; 0–255 |
//! | `against.<source>` | `UINT8` | the confidence of the other class |
//! | `backing.<source>` | `UINT8` | how far experience backs the cost: 0–255 |
//! | `model.<source>` | `UINT8` | the model by which the cell was judged last: its number from 1 in the source's message of models, 0 none; only of sources that learn |
//! | `conf.elevation` | `UINT8` | confidence of the heights; only with heights |
//!
//! `<source>` stands for each source of the stack. The cell is padded to a multiple of 4 bytes.

use bytes::{BufMut, Bytes};
use rcs_geom::{CellIndex, DVec2, GridError};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{self, Grid, PackedElementField, Quaternion, Vector2, Vector3};

use crate::columns::{HEIGHT_PARTS, OBSTACLE_SEEN_FROM, columns, source_number};
use crate::grid_view::{GridViewError, NumericType};
use crate::options::MapOptions;
use crate::{Cell, Evidence, Fused, GridView, HeightStats, MAX_SIDE, Map, Source};

/// Why a grid is not one of our maps.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MapGridError {
    /// It is not a valid grid.
    #[error(transparent)]
    Grid(#[from] GridViewError),
    /// It has another size than our maps.
    #[error(
        "map has {columns} columns and {rows} rows, expected as many rows as columns, at most {MAX_SIDE}"
    )]
    Size {
        /// Columns of the grid.
        columns: usize,
        /// Rows of the grid.
        rows: usize,
    },
    /// Cells are not square, or the cell size is not valid.
    #[error("cells are {x} m by {y} m, expected square ones")]
    CellSize {
        /// Metres.
        x: f64,
        /// Metres.
        y: f64,
    },
    /// Its cells are not aligned to the raster of the frame.
    #[error("corner is at ({x}, {y}) m, expected an untilted multiple of the cell size {cell_size_m} m")]
    Corner {
        /// Metres.
        x: f64,
        /// Metres.
        y: f64,
        /// Metres.
        cell_size_m: f64,
    },
    /// The scrolling grid refused the cell size.
    #[error(transparent)]
    Scroll(#[from] GridError),
}

/// Names and types of the fields of a cell in order, and its size in bytes.
fn fields(options: &MapOptions) -> (Vec<PackedElementField>, usize) {
    let mut offset = 0;
    let fields = columns(options).into_iter().map(|(name, kind, _)| {
        let field = PackedElementField { name, offset, r#type: kind.into() };
        offset += if kind == NumericType::Uint8 { 1 } else { 4 };
        field
    });
    let fields = fields.collect();
    (fields, (offset as usize).next_multiple_of(4))
}

impl Map {
    /// The map as a message; the fields are listed at the top of this file.
    pub fn to_grid(&self, frame_id: &str, time: Stamp, options: &MapOptions) -> Grid {
        let (fields, cell_stride) = fields(options);
        let side = self.side();
        let mut data = vec![0; side * side * cell_stride];
        let mut places = data.chunks_exact_mut(cell_stride);
        let mut writer = CellWriter::new(self, options);
        // Fused cells are computed in the order of the message.
        self.for_each_cell(&options.weights, |_, cell, said, fused| {
            if let Some(place) = places.next() {
                writer.write(place, cell, said, &fused);
            }
        });
        Grid { data: Bytes::from(data), ..self.empty_grid(frame_id, time, fields, cell_stride) }
    }

    /// Adds the cells of a tile as they are in the message, in the order in which they are stored.
    pub(crate) fn put_tile(&self, tile: usize, writer: &mut CellWriter<'_>, bytes: &mut Vec<u8>) {
        self.for_each_in_tile(tile, &writer.options.weights, |cell, said, fused| {
            let place = bytes.len();
            bytes.resize(place + writer.unknown.len(), 0);
            writer.write(&mut bytes[place..], cell, said, &fused);
        });
    }

    /// The message of [`Map::to_grid`] without its cells, and their size, bytes.
    pub(crate) fn header(&self, frame_id: &str, time: Stamp, options: &MapOptions) -> (Grid, usize) {
        let (fields, cell_stride) = fields(options);
        (self.empty_grid(frame_id, time, fields, cell_stride), self.side() * self.side() * cell_stride)
    }

    /// The message without the cells.
    fn empty_grid(
        &self,
        frame_id: &str,
        time: Stamp,
        fields: Vec<PackedElementField>,
        cell_stride: usize,
    ) -> Grid {
        let corner = self.grid().origin();
        let size = self.grid().cell_size_m();
        Grid {
            timestamp: Some(time.to_proto()),
            frame_id: frame_id.to_owned(),
            pose: Some(foxglove::Pose {
                position: Some(Vector3 { x: corner.x, y: corner.y, z: 0.0 }),
                orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
            }),
            column_count: self.side() as u32,
            cell_size: Some(Vector2 { x: size, y: size }),
            row_stride: (self.side() * cell_stride) as u32,
            cell_stride: cell_stride as u32,
            fields,
            data: Bytes::new(),
        }
    }

    /// The map of a message. Fields that it lacks stay unknown; its fused fields are not read, because they follow from
    /// the others.
    pub fn from_grid(grid: &Grid) -> Result<Map, MapGridError> {
        let view = GridView::new(grid)?;
        let side = view.columns();
        if side != view.rows() || side > MAX_SIDE {
            return Err(MapGridError::Size { columns: view.columns(), rows: view.rows() });
        }
        let DVec2 { x, y } = view.cell_size_m();
        if x != y {
            return Err(MapGridError::CellSize { x, y });
        }
        let mut map = Map::with_side(side, x)?;
        let corner = view.frame_from_grid();
        let south_west = corner.translation.truncate() / x;
        let nearest = south_west.round();
        // Cells count from the frame's origin, so a corner that is not on the raster does not identify cells.
        let aligned = south_west.abs_diff_eq(nearest, 1e-3) && nearest.abs().max_element() < 1e15;
        if !aligned || corner.rotation.w.abs() < 1.0 - 1e-9 {
            let (x, y, cell_size_m) = (corner.translation.x, corner.translation.y, x);
            return Err(MapGridError::Corner { x, y, cell_size_m });
        }
        let half = (side / 2) as i64;
        map.recentre_on(CellIndex::new(nearest.x as i64, nearest.y as i64).offset(half, half));
        let columns = Columns::read(&view)?;
        for (at, index) in map.grid().bounds().iter().enumerate() {
            let cell = columns.cell(at);
            if cell != Cell::default()
                && let Some(slot) = map.cell_mut(index)
            {
                *slot = cell;
            }
            for of_source in &columns.evidence {
                // Contradictory evidence becomes unknown.
                if let Some(evidence) = of_source.at(at)
                    && let Some(slot) = map.layer_mut(of_source.source).get_mut(index)
                {
                    *slot = evidence;
                }
            }
        }
        Ok(map)
    }
}

/// Writes cells of a map as they are in its message.
pub(crate) struct CellWriter<'a> {
    options: &'a MapOptions,
    /// The place of each source of the message in the order of first votes.
    layers: Vec<Option<usize>>,
    /// What each source of the message says of the cell.
    evidence: Vec<Evidence>,
    /// The bytes of an unknown cell, which most are.
    unknown: Vec<u8>,
}

impl<'a> CellWriter<'a> {
    pub(crate) fn new(map: &Map, options: &'a MapOptions) -> Self {
        let layers: Vec<_> = options.sources.iter().map(|source| map.layer_number(source)).collect();
        let evidence = vec![Evidence::NONE; layers.len()];
        let mut unknown = vec![0; fields(options).1];
        write(&mut unknown, &Cell::default(), &evidence, &Fused::UNKNOWN, options);
        Self { options, layers, evidence, unknown }
    }

    /// Writes a cell to its place. `said` is what each source says of it, in the order of first votes.
    fn write(&mut self, place: &mut [u8], cell: &Cell, said: &[Evidence], fused: &Fused) {
        let is_unknown = *cell == Cell::default() && said.iter().all(|evidence| *evidence == Evidence::NONE);
        if is_unknown {
            place.copy_from_slice(&self.unknown);
            return;
        }
        for (evidence, &layer) in self.evidence.iter_mut().zip(&self.layers) {
            *evidence = layer.map_or(Evidence::NONE, |layer| said[layer]);
        }
        write(place, cell, &self.evidence, fused, self.options);
    }
}

fn write(mut data: &mut [u8], cell: &Cell, evidence: &[Evidence], fused: &Fused, options: &MapOptions) {
    data.put_u32_le((cell.updated.0 / 1_000_000_000) as u32);
    data.put_u32_le((cell.updated.0 % 1_000_000_000) as u32);
    for said in evidence {
        data.put_u32_le(said.sequence);
    }
    if options.heights {
        for stats in [cell.ground.rounded(), cell.obstacle.rounded()] {
            let known = |v: f32| if stats.count == 0 { f32::NAN } else { v };
            for value in [stats.mean, stats.variance, stats.min, stats.max] {
                data.put_f32_le(known(value));
            }
            data.put_u32_le(stats.count);
        }
    }
    data.put_slice(&[fused.cost, fused.confidence, fused.label as u8, source_number(fused, options)]);
    data.put_u8(cell.obstacle_seen_from_dm);
    for (said, source) in evidence.iter().zip(options.sources.iter()) {
        data.put_slice(&[said.cost, said.confidence, said.against, said.backing]);
        if options.has_models(source) {
            data.put_u8(said.model);
        }
    }
    if options.heights {
        data.put_u8(cell.elevation_confidence);
    }
}

/// Our fields of a grid, each as a list over the cells; empty if the grid lacks the field.
struct Columns {
    updated: [Vec<f64>; 2],
    evidence: Vec<EvidenceColumns>,
    heights: [[Vec<f64>; 5]; 2],
    elevation: Vec<f64>,
    obstacle_seen_from: Vec<f64>,
}

impl Columns {
    fn read(view: &GridView<'_>) -> Result<Columns, GridViewError> {
        let column = |name: &str, kind: NumericType| match view.field_of(name, kind) {
            Ok(field) => Ok(field.values().collect()),
            Err(GridViewError::Missing { .. }) => Ok(Vec::new()),
            Err(error) => Err(error),
        };
        let mut evidence = Vec::new();
        for source in view.sources().iter() {
            let cost = column(&format!("cost.{source}"), NumericType::Uint8)?;
            let confidence = column(&format!("conf.{source}"), NumericType::Uint8)?;
            let against = column(&format!("against.{source}"), NumericType::Uint8)?;
            let backing = column(&format!("backing.{source}"), NumericType::Uint8)?;
            let model = column(&format!("model.{source}"), NumericType::Uint8)?;
            let sequence = column(&format!("seq.{source}"), NumericType::Uint32)?;
            evidence.push(EvidenceColumns { source, cost, confidence, against, backing, model, sequence });
        }
        let mut heights: [[Vec<f64>; 5]; 2] = Default::default();
        for (class, columns) in ["ground", "obstacle"].into_iter().zip(&mut heights) {
            for (part, values) in HEIGHT_PARTS.into_iter().zip(columns) {
                let kind = if part == "count" { NumericType::Uint32 } else { NumericType::Float32 };
                *values = column(&format!("{class}.{part}"), kind)?;
            }
        }
        Ok(Columns {
            updated: [column("updated_s", NumericType::Uint32)?, column("updated_ns", NumericType::Uint32)?],
            evidence,
            heights,
            elevation: column("conf.elevation", NumericType::Uint8)?,
            obstacle_seen_from: column(OBSTACLE_SEEN_FROM, NumericType::Uint8)?,
        })
    }

    fn cell(&self, at: usize) -> Cell {
        let value = |column: &[f64], otherwise: f64| number(column, at, otherwise);
        let mut cell = Cell::default();
        let seconds = value(&self.updated[0], 0.0) as u64;
        cell.updated = Stamp(seconds * 1_000_000_000 + value(&self.updated[1], 0.0) as u64);
        let stats = |[mean, variance, min, max, count]: &[Vec<f64>; 5]| {
            let count = value(count, 0.0) as u32;
            let numbers = [mean, variance, min, max].map(|column| value(column, f64::NAN) as f32);
            if count == 0 || numbers.iter().any(|v| !v.is_finite()) {
                return HeightStats::default();
            }
            let [mean, variance, min, max] = numbers;
            HeightStats { count, mean, variance: variance.max(0.0), min, max }
        };
        (cell.ground, cell.obstacle) = (stats(&self.heights[0]), stats(&self.heights[1]));
        cell.elevation_confidence = value(&self.elevation, 0.0) as u8;
        cell.obstacle_seen_from_dm = value(&self.obstacle_seen_from, 0.0) as u8;
        cell
    }
}

/// The evidence of one source, each number as a list over the cells.
struct EvidenceColumns {
    source: Source,
    cost: Vec<f64>,
    confidence: Vec<f64>,
    against: Vec<f64>,
    backing: Vec<f64>,
    model: Vec<f64>,
    sequence: Vec<f64>,
}

impl EvidenceColumns {
    /// Its evidence about a cell; `None` if there is none.
    fn at(&self, at: usize) -> Option<Evidence> {
        let confidence = number(&self.confidence, at, 0.0) as u8;
        let evidence = Evidence {
            cost: number(&self.cost, at, 255.0) as u8,
            confidence,
            against: (number(&self.against, at, 0.0) as u8).min(confidence),
            backing: number(&self.backing, at, 0.0) as u8,
            model: number(&self.model, at, 0.0) as u8,
            sequence: number(&self.sequence, at, 0.0) as u32,
        };
        (evidence.confidence > 0 && evidence.cost <= crate::MAX_COST).then_some(evidence)
    }
}

fn number(column: &[f64], at: usize, otherwise: f64) -> f64 {
    column.get(at).copied().unwrap_or(otherwise)
}

#[cfg(test)]
#[path = "layout_tests.rs"]
mod tests;
