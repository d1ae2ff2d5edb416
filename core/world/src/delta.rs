//! Recorded maps: key frames and deltas.
//!
//! A key frame is the complete map as a `foxglove.Grid`, which any other tool can read. A delta (`rcs.MapDelta`) holds
//! the cells that differ from the previous map. Tiles that were not written since the previous message are still shared
//! with it, so that comparing their addresses finds the few tiles that may differ, and only their cells are compared.
//! This also holds for a map that has scrolled, because cells keep their place in memory.
//!
//! A delta names the message that it applies to, and a decoder applies it to no other: if a message is missing, deltas
//! are refused until the next key frame. The message that it applies to may also be stored as a complete map with its own
//! sequence number, as at the start of a part of a recording.

use std::sync::Arc;

use rcs_geom::{CellIndex, TILE};
use rcs_msg::foxglove::Grid;
use rcs_msg::rcs::{MapColumn, MapDelta, MapWeight};
use rcs_msg::{
    AnyMessage, DeltaCodec, DeltaDecoder, DeltaEncoder, Digester, Schema, Stamp, Stored, schema_of,
};

use crate::cell::{HEIGHTS_PER_M, ROUNDED_BELOW_M, VARIANCE_SHIFT};
use crate::columns::{HEIGHT_PARTS, OBSTACLE_SEEN_FROM};
use crate::digest::MapDigester;
use crate::{
    Cell, Evidence, HeightStats, Map, MapMessage, MapOptions, Source, SourceKind, Weighted, Weights,
};

/// A key frame is stored when the last one is this old. Reading from any time starts at a key frame and applies the
/// deltas after it.
pub const KEY_FRAME_NS: u64 = 10_000_000_000;

/// [`MapCodec`] as a value, for lists of codecs.
pub static MAP_CODEC: MapCodec = MapCodec;

/// The codec of recorded maps: `foxglove.Grid` as key frames, `rcs.MapDelta` between them.
#[derive(Clone, Copy, Debug)]
pub struct MapCodec;

impl DeltaCodec for MapCodec {
    fn delta_schema(&self) -> Arc<Schema> {
        Arc::clone(schema_of::<MapDelta>())
    }

    fn encoder(&self) -> Box<dyn DeltaEncoder> {
        Box::new(Encoder::default())
    }

    fn decoder(&self) -> Box<dyn DeltaDecoder> {
        Box::new(Decoder::default())
    }

    fn digester(&self) -> Box<dyn Digester> {
        Box::new(MapDigester::default())
    }
}

/// The map that was stored last.
#[derive(Default)]
struct Encoder {
    last: Option<Last>,
}

struct Last {
    key_sequence: u32,
    key_time: Stamp,
    sequence: u32,
    message: MapMessage,
}

impl DeltaEncoder for Encoder {
    fn encode(&mut self, sequence: u32, log_time: Stamp, message: &AnyMessage) -> Stored {
        let Some(map) = message.source::<MapMessage>() else {
            // A grid that is not one of our maps is stored as it is, and no delta applies to it.
            self.last = None;
            return Stored::Whole;
        };
        let young =
            |last: &&mut Last| log_time >= last.key_time && log_time < last.key_time.after_ns(KEY_FRAME_NS);
        if let Some(last) = self.last.as_mut().filter(young).filter(|last| follows(&last.message, map)) {
            let delta = difference(last, map);
            (last.sequence, last.message) = (sequence, map.clone());
            return Stored::Delta(AnyMessage::new(delta).bytes());
        }
        self.last = Some(Last { key_sequence: sequence, key_time: log_time, sequence, message: map.clone() });
        Stored::Whole
    }

    fn lost(&mut self) {
        self.last = None;
    }
}

/// Whether a delta can express the change: the shape is the same, and everything stored before is still stored.
fn follows(before: &MapMessage, after: &MapMessage) -> bool {
    let shape = |message: &MapMessage| (message.map().side(), message.map().grid().cell_size_m());
    let has_same_models = |source| before.options().has_models(source) == after.options().has_models(source);
    shape(before) == shape(after)
        && before.options().heights == after.options().heights
        && before.options().sources.iter().all(|source| after.options().sources.contains(source))
        && before.options().sources.iter().all(has_same_models)
}

fn difference(last: &Last, message: &MapMessage) -> MapDelta {
    let (before, after) = (last.message.map(), message.map());
    let (mut tiles, mut cells, mut changed) = (Vec::new(), Vec::new(), Vec::new());
    for tile in message.tiles_written_since(before) {
        let mask = changed_cells(before, message, tile);
        if mask != 0 {
            tiles.push(tile as u32);
            cells.push(mask);
            changed.extend((0..TILE * TILE).filter(|at| mask >> at & 1 == 1).map(|at| (tile, at)));
        }
    }
    let columns = stored_columns(message.options()).filter_map(|(name, column)| {
        let mut values = Vec::with_capacity(changed.len());
        let mut before_it = 0;
        for &place in &changed {
            let (old, new) = (column.get(before, place), column.get(after, place));
            if old == new {
                values.push(0);
                continue;
            }
            let reference = if column.follows_last() { before_it } else { old };
            before_it = new;
            put(&mut values, zigzag(new.wrapping_sub(reference) as i64).saturating_add(1));
        }
        values.iter().any(|&byte| byte != 0).then(|| MapColumn { name, values: values.into() })
    });
    let columns = columns.collect();
    let centre = after.grid().centre();
    MapDelta {
        timestamp: Some(message.time().to_proto()),
        frame_id: message.frame_id().to_string(),
        key_sequence: last.key_sequence,
        base_sequence: last.sequence,
        centre_x: centre.x,
        centre_y: centre.y,
        heights: message.options().heights,
        sources: message.options().sources.iter().map(|source| source.name().to_owned()).collect(),
        weights: message.options().weights.iter().map(stored_weight).collect(),
        least_evidence: message.options().weights.least_evidence,
        tiles,
        cells,
        columns,
    }
}

/// The cells of a tile that differ, one bit per cell.
fn changed_cells(before: &Map, after: &MapMessage, tile: usize) -> u64 {
    let map = after.map();
    let differ = |mask: u64, (at, differs): (usize, bool)| mask | u64::from(differs) << at;
    let pairs = before.grid().tile(tile).iter().zip(map.grid().tile(tile));
    let mut mask = pairs.map(|(old, new)| old != new).enumerate().fold(0, differ);
    for source in after.options().sources.iter() {
        let said = |map: &Map, at| evidence(map, source, (tile, at));
        let changed = (0..TILE * TILE).map(|at| said(before, at) != said(map, at));
        mask = changed.enumerate().fold(mask, differ);
    }
    mask
}

fn evidence(map: &Map, source: Source, (tile, at): (usize, usize)) -> Evidence {
    map.layer(source).and_then(|layer| layer.tile(tile).get(at)).copied().unwrap_or_default()
}

/// The last complete map.
#[derive(Default)]
struct Decoder {
    held: Option<Held>,
}

struct Held {
    key_sequence: u32,
    sequence: u32,
    what: What,
    /// A delta after it did not decode, so that no other one applies to it.
    is_lost: bool,
}

enum What {
    /// A key frame that has not been converted to a map yet.
    Grid(AnyMessage),
    Map(Box<MapMessage>),
}

impl DeltaDecoder for Decoder {
    fn take_whole(&mut self, sequence: u32, message: &AnyMessage) {
        let what = match message.source::<MapMessage>() {
            Some(map) => What::Map(Box::new(map.clone())),
            None => What::Grid(message.clone()),
        };
        self.held = Some(Held { key_sequence: sequence, sequence, what, is_lost: false });
    }

    fn take_delta(&mut self, sequence: u32, delta: &[u8]) -> Result<(), String> {
        let bytes = bytes::Bytes::copy_from_slice(delta);
        let delta = AnyMessage::decode::<MapDelta>(bytes).ok().and_then(|message| message.to::<MapDelta>());
        let Some(delta) = delta else {
            if let Some(held) = &mut self.held {
                held.is_lost = true;
            }
            return Err(format!("map delta {sequence} does not decode"));
        };
        let Some(held) = self.held.as_mut().filter(|held| !held.is_lost) else {
            return Err(format!("map delta {sequence} has no key frame {} before it", delta.key_sequence));
        };
        // A whole map with the sequence of the base is the base: a part of a recording begins with it.
        let is_whole = held.key_sequence == held.sequence;
        let is_base = held.sequence == delta.base_sequence;
        if !is_base || (held.key_sequence != delta.key_sequence && !is_whole) {
            return Err(format!(
                "map delta {sequence} follows map {} of key frame {}, the last here is map {} of key frame {}",
                delta.base_sequence, delta.key_sequence, held.sequence, held.key_sequence
            ));
        }
        let base = match &held.what {
            What::Map(message) => message.map().clone(),
            What::Grid(grid) => {
                let grid: Grid = grid.to().ok_or("the key frame does not decode")?;
                Map::from_grid(&grid).map_err(|error| format!("key frame {}: {error}", held.key_sequence))?
            }
        };
        match applied(base, &delta) {
            Ok(message) => {
                (held.key_sequence, held.sequence) = (delta.key_sequence, sequence);
                held.what = What::Map(Box::new(message));
                Ok(())
            }
            Err(error) => {
                held.is_lost = true;
                Err(format!("map delta {sequence}: {error}"))
            }
        }
    }

    fn message(&self) -> Option<AnyMessage> {
        Some(match &self.held.as_ref()?.what {
            What::Grid(grid) => grid.clone(),
            What::Map(map) => MapMessage::clone(map).into_message(),
        })
    }

    fn forget(&mut self) {
        self.held = None;
    }
}

fn applied(mut map: Map, delta: &MapDelta) -> Result<MapMessage, String> {
    let source = |name: &String| name.parse::<Source>().map_err(|error| error.to_string());
    let weighted = |stored: &MapWeight| {
        let kind = match (stored.overrides, stored.learned) {
            (true, _) => SourceKind::Override,
            (false, true) => SourceKind::Learned,
            (false, false) => SourceKind::Range,
        };
        Ok(Weighted { source: source(&stored.name)?, weight: stored.weight, kind })
    };
    let mut weights = delta.weights.iter().map(weighted).collect::<Result<Weights, String>>()?;
    weights.least_evidence = delta.least_evidence;
    let options = MapOptions {
        sources: delta.sources.iter().map(source).collect::<Result<_, String>>()?,
        heights: delta.heights,
        weights,
    };
    let count = map.grid().tile_count();
    let tiles: Vec<usize> = delta.tiles.iter().map(|&tile| tile as usize).collect();
    let ascending = tiles.windows(2).all(|pair| pair[0] < pair[1]);
    if !ascending || tiles.last().is_some_and(|&last| last >= count) || tiles.len() != delta.cells.len() {
        return Err(format!(
            "{} tiles with {} masks, expected as many of {count}",
            tiles.len(),
            delta.cells.len()
        ));
    }
    map.set_centre(CellIndex::new(delta.centre_x, delta.centre_y));
    let places: Vec<(usize, usize)> = tiles
        .iter()
        .zip(&delta.cells)
        .flat_map(|(&tile, &mask)| {
            (0..TILE * TILE).filter(move |at| mask >> at & 1 == 1).map(move |at| (tile, at))
        })
        .collect();
    let known: Vec<(String, StoredColumn)> = stored_columns(&options).collect();
    for column in &delta.columns {
        let Some((_, stored)) = known.iter().find(|(name, _)| *name == column.name) else {
            return Err(format!("column \"{}\" is none of the map's", column.name));
        };
        let mut values: &[u8] = &column.values;
        let mut before_it = 0;
        for &place in &places {
            let code = take(&mut values).ok_or_else(|| format!("column \"{}\" is cut", column.name))?;
            let Some(code) = code.checked_sub(1) else { continue };
            let reference = if stored.follows_last() { before_it } else { stored.get(&map, place) };
            before_it = reference.wrapping_add(unzigzag(code) as u64);
            stored.set(&mut map, place, before_it);
        }
        if !values.is_empty() {
            return Err(format!("column \"{}\" has {} bytes too many", column.name, values.len()));
        }
    }
    let time = delta.timestamp.as_ref().and_then(Stamp::from_proto).unwrap_or_default();
    Ok(MapMessage::new(map, delta.frame_id.as_str(), time, options))
}

fn stored_weight(entry: Weighted) -> MapWeight {
    let overrides = entry.kind == SourceKind::Override;
    let learned = entry.kind == SourceKind::Learned;
    MapWeight { name: entry.source.name().to_owned(), weight: entry.weight, overrides, learned }
}

/// One number of a cell in a delta. Numbers that follow from others are not stored.
#[derive(Clone, Copy)]
enum StoredColumn {
    Updated,
    ObstacleSeenFrom,
    Sequence(Source),
    Cost(Source),
    Confidence(Source),
    Against(Source),
    Backing(Source),
    Model(Source),
    Ground(usize),
    Obstacle(usize),
    ElevationConfidence,
}

fn stored_columns(options: &MapOptions) -> impl Iterator<Item = (String, StoredColumn)> + use<> {
    let of_source = |source: Source| {
        let model = (format!("model.{source}"), StoredColumn::Model(source));
        let model = options.has_models(source).then_some(model);
        let columns = [
            (format!("seq.{source}"), StoredColumn::Sequence(source)),
            (format!("cost.{source}"), StoredColumn::Cost(source)),
            (format!("conf.{source}"), StoredColumn::Confidence(source)),
            (format!("against.{source}"), StoredColumn::Against(source)),
            (format!("backing.{source}"), StoredColumn::Backing(source)),
        ];
        columns.into_iter().chain(model)
    };
    let sources: Vec<_> = options.sources.iter().flat_map(of_source).collect();
    let heights = HEIGHT_PARTS.iter().enumerate().flat_map(|(part, name)| {
        [
            (format!("ground.{name}"), StoredColumn::Ground(part)),
            (format!("obstacle.{name}"), StoredColumn::Obstacle(part)),
        ]
    });
    let elevation = ("conf.elevation".to_owned(), StoredColumn::ElevationConfidence);
    let heights: Vec<_> = if options.heights { heights.chain([elevation]).collect() } else { Vec::new() };
    let of_cell = [
        ("updated".to_owned(), StoredColumn::Updated),
        (OBSTACLE_SEEN_FROM.to_owned(), StoredColumn::ObstacleSeenFrom),
    ];
    of_cell.into_iter().chain(sources).chain(heights)
}

impl StoredColumn {
    /// Whether the numbers of neighbouring cells are alike, rather than successive numbers of one cell.
    fn follows_last(self) -> bool {
        matches!(self, StoredColumn::Updated | StoredColumn::Sequence(_))
    }

    /// Position of a cell: number of its tile, index in the tile.
    fn get(self, map: &Map, place: (usize, usize)) -> u64 {
        let cell = || map.grid().tile(place.0).get(place.1).copied().unwrap_or_default();
        match self {
            StoredColumn::Updated => cell().updated.0,
            StoredColumn::ObstacleSeenFrom => cell().obstacle_seen_from_dm.into(),
            StoredColumn::Sequence(source) => evidence(map, source, place).sequence.into(),
            StoredColumn::Cost(source) => evidence(map, source, place).cost.into(),
            StoredColumn::Confidence(source) => evidence(map, source, place).confidence.into(),
            StoredColumn::Against(source) => evidence(map, source, place).against.into(),
            StoredColumn::Backing(source) => evidence(map, source, place).backing.into(),
            StoredColumn::Model(source) => evidence(map, source, place).model.into(),
            StoredColumn::Ground(part) => height(&cell().ground, part),
            StoredColumn::Obstacle(part) => height(&cell().obstacle, part),
            StoredColumn::ElevationConfidence => cell().elevation_confidence.into(),
        }
    }

    fn set(self, map: &mut Map, (tile, at): (usize, usize), value: u64) {
        let source = match self {
            StoredColumn::Sequence(source)
            | StoredColumn::Cost(source)
            | StoredColumn::Confidence(source)
            | StoredColumn::Against(source)
            | StoredColumn::Backing(source)
            | StoredColumn::Model(source) => source,
            of_ground => {
                if let Some(cell) = map.grid_mut().tile_mut(tile).get_mut(at) {
                    of_ground.set_ground(cell, value);
                }
                return;
            }
        };
        let Some(evidence) = map.layer_mut(source).tile_mut(tile).get_mut(at) else { return };
        match self {
            StoredColumn::Sequence(_) => evidence.sequence = value as u32,
            StoredColumn::Cost(_) => evidence.cost = value as u8,
            StoredColumn::Against(_) => evidence.against = value as u8,
            StoredColumn::Backing(_) => evidence.backing = value as u8,
            StoredColumn::Model(_) => evidence.model = value as u8,
            _ => evidence.confidence = value as u8,
        }
    }

    fn set_ground(self, cell: &mut Cell, value: u64) {
        match self {
            StoredColumn::Updated => cell.updated = Stamp(value),
            StoredColumn::ObstacleSeenFrom => cell.obstacle_seen_from_dm = value as u8,
            StoredColumn::Ground(part) => set_height(&mut cell.ground, part, value),
            StoredColumn::Obstacle(part) => set_height(&mut cell.obstacle, part, value),
            _ => cell.elevation_confidence = value as u8,
        }
    }
}

/// A part of rounded statistics as an integer. Successive heights of a cell give integers that are close together.
fn height(stats: &HeightStats, part: usize) -> u64 {
    let stats = stats.rounded();
    match part {
        0 => height_code(stats.mean),
        1 => (stats.variance.to_bits() >> VARIANCE_SHIFT).into(),
        2 => height_code(stats.min),
        3 => height_code(stats.max),
        _ => stats.count.into(),
    }
}

fn set_height(stats: &mut HeightStats, part: usize, value: u64) {
    match part {
        0 => stats.mean = height_of(value),
        1 => stats.variance = f32::from_bits((value as u32) << VARIANCE_SHIFT),
        2 => stats.min = height_of(value),
        3 => stats.max = height_of(value),
        _ => stats.count = value as u32,
    }
}

/// A rounded height as the number of its steps; one that is not rounded as its bits, with bit 32 set.
fn height_code(height_m: f32) -> u64 {
    let small = height_m.abs() < ROUNDED_BELOW_M;
    if small { (height_m * HEIGHTS_PER_M) as i64 as u64 } else { UNROUNDED | u64::from(height_m.to_bits()) }
}

fn height_of(code: u64) -> f32 {
    match code as i64 {
        steps if steps < UNROUNDED as i64 => steps as f32 / HEIGHTS_PER_M,
        _ => f32::from_bits(code as u32),
    }
}

/// Bit of a code that holds the bits of a float.
const UNROUNDED: u64 = 1 << 32;

fn zigzag(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)) as u64
}

fn unzigzag(code: u64) -> i64 {
    (code >> 1) as i64 ^ -((code & 1) as i64)
}

fn put(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// The next number; `None` if the bytes end within it or it is too long.
fn take(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u64::from(byte & 0x7F).checked_shl(shift)?;
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
#[path = "delta_tests.rs"]
mod tests;
