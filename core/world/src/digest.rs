//! Hashes of maps, for the hash of a run.
//!
//! A map of 301×301 cells takes 9 MB as a message, and most of it is the same from one message to the next. So each tile
//! has a hash of its own, that of its cells as the message has them, and only the tiles that are not shared with the map
//! before are encoded and hashed. The hash of a map is that of its message without the cells, and of the hashes of all
//! tiles. The message has the same one, which is computed from its bytes: as such a map comes back from a snapshot.

use rcs_geom::{CellIndex, ScrollGrid, TILE};
use rcs_msg::foxglove::Grid;
use rcs_msg::prost::{Message as _, length_delimiter_len};
use rcs_msg::{AnyMessage, Digest, Digester};
use twox_hash::XxHash3_128;

use crate::layout::CellWriter;
use crate::{Map, MapMessage, MapOptions};

/// Hashes the maps of one buffer.
#[derive(Default)]
pub(crate) struct MapDigester {
    /// The last map, whose tiles stay in memory as long as their addresses are compared.
    last: Option<MapMessage>,
    /// By tile.
    hashes: Vec<u128>,
}

impl Digester for MapDigester {
    fn digest(&mut self, message: &AnyMessage) -> Option<Digest> {
        if let Some(map) = message.source::<MapMessage>() {
            self.update(map);
            let (header, cell_bytes) = map.header();
            return Some(digest(&header, cell_bytes, &self.hashes));
        }
        let grid = message.to::<Grid>()?;
        let hashes = hashes_of_grid(&grid)?;
        let cell_bytes = grid.data.len();
        Some(digest(&Grid { data: bytes::Bytes::new(), ..grid }, cell_bytes, &hashes))
    }
}

impl MapDigester {
    /// Computes the hashes of the tiles that are not shared with the last map.
    fn update(&mut self, message: &MapMessage) {
        let (map, options) = (message.map(), message.options());
        let count = map.grid().tile_count();
        let last = self.last.as_ref().filter(|last| is_alike(last, map, options));
        let written =
            last.map_or_else(|| (0..count).collect(), |last| message.tiles_written_since(last.map()));
        self.hashes.resize(count, 0);
        let mut writer = CellWriter::new(map, options);
        let mut bytes = Vec::new();
        for tile in written {
            bytes.clear();
            map.put_tile(tile, &mut writer, &mut bytes);
            self.hashes[tile] = XxHash3_128::oneshot(&bytes);
        }
        self.last = Some(message.clone());
    }
}

/// Whether the same cells have the same bytes and the same places in both messages.
fn is_alike(last: &MapMessage, map: &Map, options: &MapOptions) -> bool {
    last.map().side() == map.side() && last.options() == options
}

/// The hashes of the tiles in which a map of this message would be stored; `None` if it is no map of ours.
fn hashes_of_grid(grid: &Grid) -> Option<Vec<u128>> {
    let (side, stride) = (grid.column_count as usize, grid.cell_stride as usize);
    let size = grid.cell_size.filter(|size| size.x == size.y)?.x;
    let corner = grid.pose.as_ref()?.position.as_ref()?;
    let mut cells = ScrollGrid::new(side, size, ()).ok()?;
    let [west, south] = [corner.x, corner.y].map(|v| (v / size).round() as i64);
    let half = (side / 2) as i64;
    cells.set_centre(CellIndex::new(west, south).offset(half, half));
    let is_at_corner = cells.bounds().south_west == CellIndex::new(west, south);
    if stride == 0
        || !is_at_corner
        || grid.row_stride as usize != side * stride
        || grid.data.len() != side * side * stride
    {
        return None;
    }
    let mut bytes = Vec::new();
    let hash = |tile: usize| {
        bytes.clear();
        for cell in (0..TILE * TILE).filter_map(|at| cells.cell_in(tile, at)) {
            let [column, row] = [(cell.x - west) as usize, (cell.y - south) as usize];
            let place = (row * side + column) * stride;
            bytes.extend_from_slice(&grid.data[place..place + stride]);
        }
        XxHash3_128::oneshot(&bytes)
    };
    Some((0..cells.tile_count()).map(hash).collect())
}

/// The digest of a message, from what it holds besides its cells, their size, and the hashes of its tiles.
fn digest(header: &Grid, cell_bytes: usize, tiles: &[u128]) -> Digest {
    let mut content = header.encode_to_vec();
    let header_bytes = content.len();
    content.extend(tiles.iter().flat_map(|hash| hash.to_le_bytes()));
    content.extend((header_bytes as u64).to_le_bytes());
    // The cells are one field of the message: its number, their size, and the bytes.
    let bytes = header_bytes + 1 + length_delimiter_len(cell_bytes) + cell_bytes;
    Digest { hash: XxHash3_128::oneshot(&content), bytes }
}

#[cfg(test)]
#[path = "digest_tests.rs"]
mod tests;
