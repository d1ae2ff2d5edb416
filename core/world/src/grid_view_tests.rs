use proptest::prelude::*;
use rcs_msg::foxglove::{PackedElementField, Vector2};

use super::*;

/// 3 columns, 2 rows, cells of 8 bytes in rows of 28: each row ends with padding.
fn grid() -> Grid {
    let field = |name: &str, offset, kind: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    Grid {
        column_count: 3,
        cell_size: Some(Vector2 { x: 0.5, y: 0.5 }),
        row_stride: 28,
        cell_stride: 8,
        fields: vec![
            field("height", 0, NumericType::Float32),
            field("cost.stereo", 4, NumericType::Uint8),
            field("conf.stereo", 5, NumericType::Uint8),
            field("count", 6, NumericType::Int16),
        ],
        data: (0..2_u8)
            .flat_map(|row| {
                let cells = (0..3_u8).flat_map(move |column| {
                    let height = f32::from(row) + 0.25 * f32::from(column);
                    let mut cell = height.to_le_bytes().to_vec();
                    cell.extend([10 * row + column, column]);
                    cell.extend((-i16::from(column)).to_le_bytes());
                    cell
                });
                cells.chain([0xEE; 4])
            })
            .collect::<Vec<u8>>()
            .into(),
        ..Grid::default()
    }
}

#[test]
fn fields_are_read_by_name_at_their_strides() {
    let grid = grid();
    let view = GridView::new(&grid).unwrap();
    assert_eq!((view.columns(), view.rows()), (3, 2));
    assert_eq!(view.field("height").unwrap().get(2, 1), Some(1.5));
    assert_eq!(view.field("count").unwrap().values().collect::<Vec<_>>(), [0.0, -1.0, -2.0, 0.0, -1.0, -2.0]);
    assert_eq!(view.field("cost.stereo").unwrap().get(1, 1), Some(11.0));
    assert_eq!(view.field("height").unwrap().get(3, 0), None);
    assert_eq!(view.field("height").unwrap().get(0, 2), None);
    assert_eq!(view.sources().iter().collect::<Vec<_>>(), [Source::STEREO]);
    let mut bytes = Vec::new();
    view.field("cost.stereo").unwrap().bytes_into(&mut bytes);
    assert_eq!(bytes, [0, 1, 2, 10, 11, 12]);
}

#[test]
fn a_cell_without_confidence_is_unknown_when_fused() {
    let grid = grid();
    let fused = |least_evidence: f32| {
        let mut costs = Vec::new();
        let mut weights = Weights::default();
        weights.least_evidence = least_evidence;
        fuse_grid(&GridView::new(&grid).unwrap(), &weights, &mut costs).unwrap();
        costs
    };
    assert_eq!(fused(0.0), [255, 1, 2, 255, 11, 12]);
    // The confidences are 0, 1 and 2.
    assert_eq!(fused(2.0), [255, 255, 2, 255, 255, 12]);
}

#[test]
fn malformed_grids_are_refused_with_what_is_wrong() {
    let check = |change: fn(&mut Grid), expected: &str| {
        let mut grid = grid();
        change(&mut grid);
        let error = GridView::new(&grid).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    };
    check(|g| g.column_count = 4, "row stride is 28 bytes, expected at least 4 columns of 8 bytes");
    check(|g| g.column_count = u32::MAX, "row stride");
    check(|g| g.column_count = 0, "0 columns");
    check(|g| g.cell_stride = 0, "row stride");
    check(|g| g.row_stride = 0, "row stride is 0");
    check(
        |g| g.data = g.data.slice(..55),
        "grid data have 55 bytes, expected a multiple of the row stride 28",
    );
    check(|g| g.data = bytes::Bytes::new(), "0 rows");
    check(|g| g.cell_size = None, "cell size is 0 m by 0 m");
    check(|g| g.cell_size = Some(Vector2 { x: f64::NAN, y: 1.0 }), "cell size is NaN m");
    check(|g| g.fields[0].offset = 5, "field \"height\" at offset 5");
    check(|g| g.fields[3].offset = u32::MAX, "field \"count\" at offset 4294967295");
    check(|g| g.fields[1].r#type = 0, "field \"cost.stereo\" at offset 4 with type 0");
    check(|g| g.fields[1].r#type = 77, "with type 77");
    check(|g| g.fields[1].name = "height".to_owned(), "field \"height\" is there twice");
    check(|g| g.fields = vec![g.fields[1].clone(); 1025], "grid has 1025 fields, expected at most 1024");
    check(
        |g| {
            let position = Some(rcs_msg::foxglove::Vector3 { x: f64::NAN, y: 0.0, z: 0.0 });
            g.pose = Some(rcs_msg::foxglove::Pose { position, orientation: None });
        },
        "pose of the grid's corner",
    );
}

#[test]
fn fields_of_the_wrong_type_or_missing_are_named() {
    let mut grid = grid();
    let view = GridView::new(&grid).unwrap();
    assert_eq!(view.field("slope").unwrap_err().to_string(), "grid has no field \"slope\"");
    let error = view.field_of("height", NumericType::Uint8).unwrap_err().to_string();
    assert_eq!(error, "field \"height\" is FLOAT32, expected UINT8");
    let mut costs = Vec::new();
    grid.fields.remove(2);
    let error = fuse_grid(&GridView::new(&grid).unwrap(), &Weights::default(), &mut costs).unwrap_err();
    assert_eq!(error.to_string(), "grid has no field \"conf.stereo\"");
    grid.fields.remove(1);
    let error = fuse_grid(&GridView::new(&grid).unwrap(), &Weights::default(), &mut costs).unwrap_err();
    assert_eq!(error, GridViewError::NoSources);
}

proptest! {
    #[test]
    fn no_grid_panics(
        columns: u32, row_stride in 0..200_u32, cell_stride in 0..64_u32, offset in prop_oneof![0..64_u32, any::<u32>()],
        kind in -1..10_i32, data in prop::collection::vec(any::<u8>(), 0..400), small: bool, conf in 0..64_u32,
    ) {
        let field = |name: &str, offset, kind| PackedElementField { name: name.to_owned(), offset, r#type: kind };
        let grid = Grid {
            column_count: if small { columns % 8 } else { columns },
            cell_size: Some(Vector2 { x: 1.0, y: 1.0 }),
            row_stride,
            cell_stride,
            fields: vec![field("cost.color", offset, kind), field("conf.color", conf, 1)],
            data: data.into(),
            ..Grid::default()
        };
        if let Ok(view) = GridView::new(&grid) {
            let field = view.field("cost.color").unwrap();
            prop_assert_eq!(field.values().count(), view.columns() * view.rows());
            prop_assert!(field.get(view.columns() - 1, view.rows() - 1).is_some());
            let _ = fuse_grid(&view, &Weights::default(), &mut Vec::new());
            let _ = crate::Map::from_grid(&grid);
        }
    }
}
