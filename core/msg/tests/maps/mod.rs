//! Costmaps, grid maps, polygons and updates of grids: what lies where, and what is refused.

use super::{HEADER, POSE, Writer, convert, named, schema};
use bytes::Bytes;
use rcs_msg::foxglove::{Grid, PosesInFrame, Vector2};
use rcs_msg::{
    AnyMessage, MessageEncoding, Schema, canonical, canonical_name, grid_decoder, header_frame, header_stamp,
};
use std::sync::Arc;

const COSTMAP: &str = "nav2_msgs/msg/Costmap";
const GRID_MAP: &str = "grid_map_msgs/msg/GridMap";
const POLYGON: &str = "geometry_msgs/msg/PolygonStamped";

/// Why a message is refused, without the name of its schema.
fn refusal(name: &str, bytes: &Bytes) -> String {
    let error = canonical(&named(name), bytes).expect("a conversion is known").expect_err("it is refused");
    error.to_string().replace(&format!("{name} does not decode: "), "")
}

/// A costmap with cells of 0.5 m, whose corner lies at (1, 2).
fn costmap(width: u32, height: u32, cells: &[u8]) -> Bytes {
    let mut writer = Writer::new(false);
    writer.header().u32(0).u32(0).u32(6).u32(0).text("master");
    writer.fixed(0.5f32.to_le_bytes()).u32(width).u32(height);
    writer.floats(&[1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0]).data(cells).done()
}

#[test]
fn a_costmap_becomes_costs_and_keeps_its_own_values() {
    let message = convert(COSTMAP, &costmap(3, 2, &[0, 1, 127, 253, 254, 255]));
    let grid = message.get::<Grid>().expect("it is a grid");
    // Cost and own value of each cell.
    assert_eq!(grid.data, [0, 0, 1, 1, 125, 127, 249, 253, 250, 254, 255, 255][..]);
    assert_eq!((grid.column_count, grid.row_stride, grid.cell_stride), (3, 6, 2));
    assert_eq!(grid.cell_size, Some(Vector2 { x: 0.5, y: 0.5 }));
    let names: Vec<_> = grid.fields.iter().map(|field| (field.name.as_str(), field.offset)).collect();
    assert_eq!(names, [("cost", 0), ("costmap", 1)]);
    let corner = grid.pose.and_then(|pose| pose.position).expect("it has a corner");
    assert_eq!((corner.x, corner.y), (1.0, 2.0));
    assert_eq!(header_frame(&message).as_deref(), Some("map"));
    assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(5_000_000_007));

    assert_eq!(refusal(COSTMAP, &costmap(3, 2, &[0])), "cells of the grid: got 1, expected 6");
    let refused = refusal(COSTMAP, &costmap(u32::MAX, u32::MAX, &[0]));
    assert!(refused.starts_with("cells of the grid: got 1"), "{refused}");
    let empty = convert(COSTMAP, &costmap(u32::MAX, 0, &[]));
    assert!(empty.get::<Grid>().is_some_and(|grid| grid.data.is_empty()));
}

/// A map of three rows along x and two columns along y, with cells of 0.5 m, whose centre lies at (10, 20).
struct Map {
    resolution: f64,
    /// Along x and y, m.
    lengths: [f64; 2],
    /// Position and orientation of the centre.
    center: [f64; 7],
    /// Names and numbers.
    layers: Vec<(&'static str, Vec<f32>)>,
    arrays: usize,
    /// Labels and sizes of the dimensions of an array.
    dimensions: Vec<(&'static str, u32)>,
    padding: u32,
    /// Of rows and columns.
    start: [u16; 2],
}

impl Default for Map {
    fn default() -> Self {
        Self {
            resolution: 0.5,
            lengths: [1.5, 1.0],
            center: [10.0, 20.0, 3.0, 0.0, 0.0, 0.0, 1.0],
            // Ten times the row, plus the column, both of the matrix.
            layers: vec![("elevation", vec![0.0, 10.0, 20.0, 1.0, 11.0, 21.0])],
            arrays: 1,
            dimensions: vec![("column_index", 2), ("row_index", 3)],
            padding: 0,
            start: [0, 0],
        }
    }
}

impl Map {
    fn bytes(&self, big_endian: bool) -> Bytes {
        let mut writer = Writer::new(big_endian);
        writer.header().floats(&[self.resolution]).floats(&self.lengths).floats(&self.center);
        writer.u32(self.layers.len() as u32);
        for (name, _) in &self.layers {
            writer.text(name);
        }
        writer.u32(1).text("elevation").u32(self.arrays as u32);
        for (_, numbers) in self.layers.iter().take(self.arrays) {
            writer.u32(self.dimensions.len() as u32);
            for (label, size) in &self.dimensions {
                writer.text(label).u32(*size).u32(6);
            }
            writer.u32(self.padding).u32(numbers.len() as u32);
            for number in numbers {
                writer.fixed(number.to_le_bytes());
            }
        }
        writer.fixed(self.start[0].to_le_bytes()).fixed(self.start[1].to_le_bytes()).done()
    }

    fn grid(&self) -> Grid {
        let message = convert(GRID_MAP, &self.bytes(false));
        message.get::<Grid>().expect("it is a grid").clone()
    }

    fn refusal(&self) -> String {
        refusal(GRID_MAP, &self.bytes(false))
    }
}

/// The number of a field at a place; the grid is not rotated.
fn number_at(grid: &Grid, field: usize, [x, y]: [f64; 2]) -> f32 {
    let corner = grid.pose.and_then(|pose| pose.position).expect("it has a corner");
    let cell = grid.cell_size.expect("its cells have a size");
    let (column, row) = (((x - corner.x) / cell.x).floor(), ((y - corner.y) / cell.y).floor());
    let at = row as usize * grid.row_stride as usize + column as usize * grid.cell_stride as usize;
    let at = at + grid.fields[field].offset as usize;
    f32::from_le_bytes(grid.data[at..at + 4].try_into().expect("four bytes"))
}

/// The centres of the cells, by rows of the map and then by columns: from the greatest x and y to the least.
const PLACES: [[f64; 2]; 6] =
    [[10.5, 20.25], [10.5, 19.75], [10.0, 20.25], [10.0, 19.75], [9.5, 20.25], [9.5, 19.75]];

#[test]
fn rows_of_a_grid_map_run_against_x_and_columns_against_y() {
    let by_rows = Map {
        layers: vec![("elevation", vec![0.0, 1.0, 10.0, 11.0, 20.0, 21.0])],
        dimensions: vec![("row_index", 3), ("column_index", 2)],
        ..Map::default()
    };
    let padded = Map {
        layers: vec![("elevation", vec![-1.0, 0.0, 10.0, 20.0, 1.0, 11.0, 21.0])],
        padding: 1,
        ..Map::default()
    };
    for map in [Map::default(), by_rows, padded] {
        let grid = map.grid();
        let numbers = PLACES.map(|place| number_at(&grid, 0, place));
        assert_eq!(numbers, [0.0, 1.0, 10.0, 11.0, 20.0, 21.0], "{:?}", map.dimensions);
        assert_eq!((grid.column_count, grid.row_stride, grid.cell_stride), (3, 12, 4));
        assert_eq!(grid.cell_size, Some(Vector2 { x: 0.5, y: 0.5 }));
        assert_eq!(grid.fields[0].name, "elevation");
        let corner = grid.pose.and_then(|pose| pose.position).expect("it has a corner");
        assert_eq!((corner.x, corner.y, corner.z), (9.25, 19.5, 3.0));
        assert_eq!(grid.frame_id, "map");
    }
    let big_endian = convert(GRID_MAP, &Map::default().bytes(true));
    assert_eq!(big_endian.get::<Grid>(), Some(&Map::default().grid()));
}

#[test]
fn the_start_indices_say_which_row_and_column_lie_at_the_corner() {
    for (start, expect) in [
        ([1, 0], [10.0, 11.0, 20.0, 21.0, 0.0, 1.0]),
        ([0, 1], [1.0, 0.0, 11.0, 10.0, 21.0, 20.0]),
        ([2, 1], [21.0, 20.0, 1.0, 0.0, 11.0, 10.0]),
    ] {
        let grid = Map { start, ..Map::default() }.grid();
        assert_eq!(PLACES.map(|place| number_at(&grid, 0, place)), expect, "{start:?}");
    }
}

#[test]
fn each_layer_of_a_grid_map_is_a_field_and_what_is_no_number_is_unknown() {
    let gaps = vec![f32::NAN, 0.5, f32::INFINITY, f32::NEG_INFINITY, 0.25, 0.125];
    let mut map = Map { arrays: 2, ..Map::default() };
    map.layers.push(("variance", gaps));
    let grid = map.grid();
    assert_eq!((grid.row_stride, grid.cell_stride, grid.fields[1].offset), (24, 8, 4));
    assert_eq!(grid.fields[1].name, "variance");
    assert_eq!(number_at(&grid, 0, [10.5, 20.25]), 0.0);
    let known = PLACES.map(|place| Some(number_at(&grid, 1, place)).filter(|number| !number.is_nan()));
    assert_eq!(known, [None, None, Some(0.5), Some(0.25), None, Some(0.125)]);
}

#[test]
fn a_rotated_grid_map_turns_about_its_centre() {
    let half = 0.5f64.sqrt();
    // A quarter to the left: the rows run along y.
    let grid = Map { center: [10.0, 20.0, 0.0, 0.0, 0.0, half, half], ..Map::default() }.grid();
    let pose = grid.pose.expect("it has a pose");
    let corner = pose.position.expect("it has a corner");
    assert!((corner.x - 10.5).abs() < 1e-12 && (corner.y - 19.25).abs() < 1e-12, "{corner:?}");
    assert_eq!(pose.orientation.map(|q| q.z), Some(half));
    let unset = Map { center: [10.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0], ..Map::default() }.grid();
    assert_eq!(unset.pose.and_then(|pose| pose.position).map(|p| (p.x, p.y)), Some((9.25, 19.5)));
}

#[test]
fn a_grid_map_without_layers_has_no_cells() {
    let grid = Map { layers: Vec::new(), arrays: 0, lengths: [1e4, 1e4], ..Map::default() }.grid();
    assert_eq!((grid.column_count, grid.data.len(), grid.fields.len()), (0, 0, 0));
}

#[test]
fn a_grid_map_that_contradicts_itself_is_refused_with_the_reason() {
    let map = Map::default;
    let resolution = |resolution: f64| Map { resolution, ..map() }.refusal();
    let expect = "expected a finite number above 0";
    assert_eq!(resolution(0.0), format!("resolution of the grid map: got 0, {expect}"));
    assert_eq!(resolution(-0.5), format!("resolution of the grid map: got -0.5, {expect}"));
    assert_eq!(resolution(f64::NAN), format!("resolution of the grid map: got NaN, {expect}"));
    assert_eq!(resolution(f64::INFINITY), format!("resolution of the grid map: got inf, {expect}"));

    let lengths = |x: f64, y: f64| Map { lengths: [x, y], ..map() }.refusal();
    assert_eq!(lengths(f64::NAN, 1.0), "rows of the grid map: got NaN, expected 0 to 32768");
    assert_eq!(lengths(1.5, -1.0), "columns of the grid map: got -2, expected 0 to 32768");
    assert_eq!(lengths(1.5, 1e5), "columns of the grid map: got 200000, expected 0 to 32768");
    assert_eq!(lengths(2.0, 1.0), "rows of a layer: got 3, expected 4");
    assert_eq!(lengths(1.5, 1.5), "columns of a layer: got 2, expected 3");

    let started = |row: u16, column: u16| Map { start: [row, column], ..map() }.refusal();
    assert_eq!(started(3, 0), "start index of the rows: got 3, expected at most 2");
    assert_eq!(started(0, u16::MAX), "start index of the columns: got 65535, expected at most 1");

    let short = Map { layers: vec![("elevation", vec![0.0; 5])], ..map() };
    assert_eq!(short.refusal(), "numbers of a layer: got 5, expected 6");
    let padded = Map { padding: u32::MAX, ..map() };
    assert_eq!(padded.refusal(), "numbers of a layer: got 6, expected 4294967301");
    let flat = Map { dimensions: vec![("column_index", 6)], ..map() };
    assert_eq!(flat.refusal(), "dimensions of a layer: got 1, expected 2");
    assert_eq!(Map { arrays: 0, ..map() }.refusal(), "arrays of the grid map: got 0, expected 1");
    let many = Map { layers: vec![("a", Vec::new()); 1025], ..map() };
    assert_eq!(many.refusal(), "layers of the grid map: got 1025, expected at most 1024");
}

/// A polygon with these corners, 0.5 m above the ground.
fn polygon(corners: &[[f32; 2]]) -> Vec<(f64, f64)> {
    let mut writer = Writer::new(false);
    writer.header().u32(corners.len() as u32);
    for [x, y] in corners {
        writer.fixed(x.to_le_bytes()).fixed(y.to_le_bytes()).fixed(0.5f32.to_le_bytes());
    }
    let message = convert(POLYGON, &writer.done());
    let path = message.get::<PosesInFrame>().expect("it is a path");
    assert_eq!((path.frame_id.as_str(), path.timestamp.map(|time| time.seconds)), ("map", Some(5)));
    let place = |pose: &rcs_msg::foxglove::Pose| {
        assert_eq!(pose.orientation.map(|q| q.w), Some(1.0));
        pose.position.map(|p| {
            assert_eq!(p.z, 0.5);
            (p.x, p.y)
        })
    };
    path.poses.iter().filter_map(place).collect()
}

#[test]
fn a_polygon_is_a_path_that_returns_to_its_first_corner() {
    let closed = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 0.0)];
    assert_eq!(polygon(&[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]]), closed);
    assert_eq!(polygon(&[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 0.0]]), closed);
    assert_eq!(polygon(&[[0.0, 0.0], [2.0, 0.0]]), closed[..2]);
    assert!(polygon(&[]).is_empty());
    let truncated = Writer::new(false).header().u32(u32::MAX).done();
    assert!(refusal(POLYGON, &truncated).starts_with("got 0 bytes"), "{}", refusal(POLYGON, &truncated));
}

#[test]
fn definitions_of_maps_and_polygons_are_those_that_the_conversions_expect() {
    let metadata = "===\nMSG: nav2_msgs/CostmapMetaData\nbuiltin_interfaces/Time map_load_time\n\
        builtin_interfaces/Time update_time\nstring layer\nfloat32 resolution\nuint32 size_x\nuint32 size_y\n\
        geometry_msgs/Pose origin\n";
    let grid_map = "std_msgs/Header header\nGridMapInfo info\nstring[] layers\nstring[] basic_layers\n\
        std_msgs/Float32MultiArray[] data\nuint16 outer_start_index\nuint16 inner_start_index";
    let info = "===\nMSG: grid_map_msgs/GridMapInfo\nfloat64 resolution\nfloat64 length_x\nfloat64 length_y\n\
        geometry_msgs/Pose pose\n";
    let array = "===\nMSG: std_msgs/Float32MultiArray\nMultiArrayLayout layout\nfloat32[] data\n\
        ===\nMSG: std_msgs/MultiArrayLayout\nMultiArrayDimension[] dim\nuint32 data_offset\n\
        ===\nMSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n";
    let polygon = "===\nMSG: geometry_msgs/Polygon\nPoint32[] points\n\
        ===\nMSG: geometry_msgs/Point32\nfloat32 x\nfloat32 y\nfloat32 z\n";
    for (name, text, expect) in [
        (
            COSTMAP,
            format!("std_msgs/Header header\nCostmapMetaData metadata\nuint8[] data{HEADER}{metadata}{POSE}"),
            "foxglove.Grid",
        ),
        (GRID_MAP, format!("{grid_map}{HEADER}{info}{array}{POSE}"), "foxglove.Grid"),
        (
            POLYGON,
            format!("std_msgs/Header header\nPolygon polygon{HEADER}{polygon}"),
            "foxglove.PosesInFrame",
        ),
    ] {
        assert_eq!(canonical_name(&schema(name, &text)), Some(expect), "{name}");
    }
}

const OCCUPANCY: &str = "nav_msgs/msg/OccupancyGrid";
const UPDATE: &str = "map_msgs/msg/OccupancyGridUpdate";

/// A grid of three by two cells.
fn occupancy(big_endian: bool) -> Bytes {
    let mut writer = Writer::new(big_endian);
    writer.header().u32(0).u32(0).fixed(0.5f32.to_le_bytes()).u32(3).u32(2);
    writer.floats(&[1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0]).data(&[0; 6]).done()
}

/// New cells for a rectangle of a grid, of 9.000000003 s.
fn update(big_endian: bool, frame_id: &str, [x, y, width, height]: [i32; 4], cells: &[u8]) -> Bytes {
    let mut writer = Writer::new(big_endian);
    writer.u32(9).u32(3).text(frame_id).fixed(x.to_le_bytes()).fixed(y.to_le_bytes());
    writer.fixed(width.to_le_bytes()).fixed(height.to_le_bytes()).data(cells).done()
}

#[test]
fn updates_replace_cells_of_a_grid_and_give_it_their_time() {
    for orders in [[false, false], [false, true], [true, false], [true, true]] {
        let [of_grid, of_update] = orders;
        let schema = named(OCCUPANCY);
        let mut decoder = grid_decoder(&schema, &named(UPDATE)).expect("they belong together");
        assert!(decoder.message().is_none());
        decoder.take_whole(1, &AnyMessage::encoded(Arc::clone(&schema), occupancy(of_grid)));
        decoder.take_delta(1, &update(of_update, "map", [1, 0, 2, 2], &[10, 20, 30, 0xff])).expect("it fits");
        decoder.take_delta(2, &update(of_update, "/map", [0, 1, 2, 1], &[100, 40])).expect("it fits");
        decoder.take_delta(3, &update(of_update, "map", [3, 2, 0, 0], &[])).expect("it has no cells");
        let whole = decoder.message().expect("a grid is there");
        assert_eq!(whole.schema().name(), OCCUPANCY);
        let message = convert(OCCUPANCY, &whole.bytes());
        let grid = message.get::<Grid>().expect("it is a grid");
        assert_eq!(grid.data, [0, 25, 50, 250, 100, 255][..], "{orders:?}");
        assert_eq!(grid.cell_size, Some(Vector2 { x: 0.5, y: 0.5 }));
        assert_eq!(header_stamp(&message).map(|stamp| stamp.0), Some(9_000_000_003), "{orders:?}");
        decoder.forget();
        assert!(decoder.message().is_none());
    }
}

#[test]
fn an_update_that_does_not_fit_its_grid_is_refused_and_changes_nothing() {
    let schema = named(OCCUPANCY);
    let mut decoder = grid_decoder(&schema, &named(UPDATE)).expect("they belong together");
    let fitting = update(false, "map", [0, 0, 1, 1], &[50]);
    assert_eq!(decoder.take_delta(1, &fitting), Err("no whole grid is before it".to_owned()));
    let whole = |bytes: Bytes| AnyMessage::encoded(Arc::clone(&schema), bytes);
    decoder.take_whole(1, &whole(occupancy(false).slice(..50)));
    let refusal = decoder.take_delta(2, &fitting).expect_err("there is no grid");
    assert!(refusal.starts_with("the whole grid before it does not decode: "), "{refusal}");

    decoder.take_whole(2, &whole(occupancy(false)));
    decoder.take_delta(3, &fitting).expect("it fits");
    let before = decoder.message().expect("a grid is there").bytes();
    for (rectangle, count) in [
        ([2, 0, 2, 1], 2),
        ([0, 2, 1, 1], 1),
        ([-1, 0, 2, 1], 2),
        ([0, i32::MIN, 1, 1], 1),
        ([i32::MAX, 0, 1, 1], 1),
        ([0, 0, -1, 0], 0),
    ] {
        let refusal = decoder.take_delta(4, &update(false, "map", rectangle, &vec![1; count]));
        let refusal = refusal.expect_err("it is outside");
        assert!(refusal.ends_with("on, expected cells of a grid of 3 × 2"), "{refusal}");
    }
    for count in [1, 4] {
        let refusal = decoder.take_delta(5, &update(false, "map", [0, 0, 3, 1], &vec![1; count]));
        assert_eq!(refusal, Err(format!("cells of the update: got {count}, expected 3")));
    }
    let refusal = decoder.take_delta(6, &update(false, "odom", [0, 0, 1, 1], &[1]));
    assert_eq!(refusal, Err("it is in the frame \"odom\", expected \"map\" as of the grid".to_owned()));
    for end in 0..fitting.len() {
        assert!(decoder.take_delta(7, &fitting[..end]).is_err(), "{end} bytes");
    }
    assert_eq!(decoder.message().expect("a grid is there").bytes(), before);
}

#[test]
fn grids_have_updates_of_their_encoding_and_with_the_definition_of_ros_alone() {
    let definition = |height: &str| {
        let fields = "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\n";
        schema(UPDATE, &format!("{fields}{height} height\nint8[] data{HEADER}"))
    };
    let grids = named(OCCUPANCY);
    assert!(grid_decoder(&grids, &definition("uint32")).is_some());
    assert!(grid_decoder(&grids, &definition("uint64")).is_none());
    assert!(grid_decoder(&grids, &named(OCCUPANCY)).is_none());
    assert!(grid_decoder(&named(COSTMAP), &named(UPDATE)).is_none());
    let of_ros_1 =
        Schema::new("map_msgs/OccupancyGridUpdate", MessageEncoding::Ros1, "ros1msg", Bytes::new());
    assert!(grid_decoder(&grids, &of_ros_1).is_none());
}
