//! Grids of ROS that are sent whole from time to time and by updates in between, such as the costmaps of Nav2 and of
//! `move_base`. An update (`map_msgs/OccupancyGridUpdate`) holds new cells for a rectangle of the last
//! `nav_msgs/OccupancyGrid`; its topic has the name of that of the grids, with [`GRID_UPDATES`] behind it.
//!
//! The decoder gives whole grids, in the encoding of the log, so that they are read like those that were sent. A grid has
//! the time of the last update; costmaps leave the time of their updates 0, which counts as none.
//!
//! As in RViz, an update that does not fit the grid is left out, and those after it apply. RViz also takes the cells of
//! an update in another frame for those of the grid; here it is left out.

use super::grid::{OCCUPANCY_GRID, Occupancy};
use super::{Source, Unusable, expect};
use crate::any::AnyMessage;
use crate::delta::DeltaDecoder;
use crate::reader::Reader;
use crate::reader::rosmsg::Wire;
use crate::schema::Schema;
use bytes::Bytes;
use std::ops::Range;
use std::sync::Arc;

/// Suffix of a topic of updates, after the topic of the grids.
pub const GRID_UPDATES: &str = "_updates";

const UPDATE: &str = "map_msgs/OccupancyGridUpdate";
/// The types on the wire, in order: see `Layout::signature`.
const SIGNATURE: &str = "iIsiiII[]c";

/// Where a message with a header has its time: in ROS 1 after `seq`, in ROS 2 after the encapsulation header.
const STAMP: Range<usize> = 4..12;

/// A decoder whose key frames are grids and whose deltas are updates; `None` if these are not schemas of
/// `nav_msgs/OccupancyGrid` and `map_msgs/OccupancyGridUpdate`, both of ROS 1 or of ROS 2, as ROS defines them.
pub fn grid_decoder(grids: &Schema, updates: &Schema) -> Option<Box<dyn DeltaDecoder>> {
    let wire = super::wire(grids).filter(|wire| super::wire(updates) == Some(*wire))?;
    let is_grid = super::conversion(grids)?.is_ok_and(|conversion| conversion.from == OCCUPANCY_GRID.from);
    let is_update = updates.name().replacen("/msg/", "/", 1) == UPDATE
        && match updates.reader() {
            Ok(Reader::Ros(layout)) => layout.signature() == SIGNATURE,
            // As of every message: a definition that cannot be read (ros2idl) is taken for the one of that name.
            _ => wire == Wire::Cdr,
        };
    (is_grid && is_update).then(|| Box::new(Decoder::new(wire)) as Box<dyn DeltaDecoder>)
}

struct Decoder {
    wire: Wire,
    /// The grid with the updates so far, or why there is none.
    grid: Result<Grid, String>,
}

struct Grid {
    schema: Arc<Schema>,
    /// The message, in the encoding of the log.
    bytes: Vec<u8>,
    big_endian: bool,
    frame_id: String,
    /// Number of cells along x and y.
    width: u32,
    height: u32,
    /// Where its cells begin in `bytes`: one byte each, row by row.
    cells: usize,
}

/// New cells of a rectangle.
struct Update {
    /// As on the wire.
    stamp: [u8; 8],
    big_endian: bool,
    frame_id: String,
    /// Its first cell in the grid.
    x: i32,
    y: i32,
    /// Number of cells along x and y.
    width: u32,
    height: u32,
    /// Row by row.
    cells: Bytes,
}

impl Decoder {
    fn new(wire: Wire) -> Self {
        Self { wire, grid: Err("no whole grid is before it".to_owned()) }
    }
}

impl DeltaDecoder for Decoder {
    fn take_whole(&mut self, _sequence: u32, message: &AnyMessage) {
        let grid = Grid::read(message, self.wire);
        self.grid = grid.map_err(|error| format!("the whole grid before it does not decode: {error}"));
    }

    fn take_delta(&mut self, _sequence: u32, delta: &[u8]) -> Result<(), String> {
        let grid = self.grid.as_mut().map_err(|why| why.clone())?;
        let update = Update::read(&Bytes::copy_from_slice(delta), self.wire);
        grid.apply(&update.map_err(|error| error.to_string())?)
    }

    fn message(&self) -> Option<AnyMessage> {
        let grid = self.grid.as_ref().ok()?;
        Some(AnyMessage::encoded(Arc::clone(&grid.schema), Bytes::copy_from_slice(&grid.bytes)))
    }

    fn forget(&mut self) {
        *self = Self::new(self.wire);
    }
}

impl Grid {
    fn read(message: &AnyMessage, wire: Wire) -> Result<Self, Unusable> {
        let bytes = message.bytes();
        let mut source = Source::new(&bytes, wire)?;
        let Occupancy { header, width, height, cells, .. } = Occupancy::read(&mut source)?;
        Ok(Self {
            schema: message.schema(),
            big_endian: source.cursor.big_endian(),
            frame_id: header.frame_id,
            width,
            height,
            // They are what was read last.
            cells: source.cursor.position() - cells.len(),
            bytes: bytes.to_vec(),
        })
    }

    /// Replaces the cells of a rectangle; an error says why it does not fit, and then nothing has changed.
    fn apply(&mut self, update: &Update) -> Result<(), String> {
        if plain(&update.frame_id) != plain(&self.frame_id) {
            return Err(format!(
                "it is in the frame \"{}\", expected \"{}\" as of the grid",
                update.frame_id, self.frame_id
            ));
        }
        let Update { x, y, width, height, .. } = *update;
        let is_within = |from: i32, count: u32, all: u32| {
            from >= 0 && i64::from(from) + i64::from(count) <= i64::from(all)
        };
        if !is_within(x, width, self.width) || !is_within(y, height, self.height) {
            return Err(format!(
                "it has {width} × {height} cells from ({x}, {y}) on, expected cells of a grid of {} × {}",
                self.width, self.height
            ));
        }
        let row_cells = width as usize;
        let first = self.cells + y as usize * self.width as usize + x as usize;
        // An update without cells has no rows.
        for (row, cells) in update.cells.chunks_exact(row_cells.max(1)).enumerate() {
            let from = first + row * self.width as usize;
            self.bytes[from..from + row_cells].copy_from_slice(cells);
        }
        let mut stamp = update.stamp;
        if update.big_endian != self.big_endian {
            // Seconds and nanoseconds.
            stamp[..4].reverse();
            stamp[4..].reverse();
        }
        self.bytes[STAMP].copy_from_slice(&stamp);
        Ok(())
    }
}

impl Update {
    fn read(bytes: &Bytes, wire: Wire) -> Result<Self, Unusable> {
        let mut source = Source::new(bytes, wire)?;
        let frame_id = source.header()?.frame_id;
        let (x, y) = (source.cursor.i32()?, source.cursor.i32()?);
        let (width, height) = (source.cursor.u32()?, source.cursor.u32()?);
        let cells = source.shared()?;
        expect("cells of the update", cells.len() as u64, u64::from(width) * u64::from(height))?;
        let mut stamp = [0; 8];
        stamp.copy_from_slice(&bytes[STAMP]);
        Ok(Self { stamp, big_endian: source.cursor.big_endian(), frame_id, x, y, width, height, cells })
    }
}

/// The name of a frame as ROS 2 writes it.
fn plain(frame_id: &str) -> &str {
    frame_id.strip_prefix('/').unwrap_or(frame_id)
}
