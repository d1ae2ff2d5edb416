//! The numbers of a cell by name: the fields of the message, in its order, read from the cell itself.

use rcs_msg::foxglove::packed_element_field::NumericType;

use crate::fusion::{Fused, WeightTable, fuse_by_table};
use crate::{Cell, HeightStats, Source, Sources};

/// Parts of the statistics of heights, in the order of the message.
pub(crate) const HEIGHT_PARTS: [&str; 5] = ["mean", "variance", "min", "max", "count"];

/// One number of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Column {
    UpdatedS,
    UpdatedNs,
    Sequence(Source),
    /// By its place in [`HEIGHT_PARTS`].
    Ground(usize),
    /// By its place in [`HEIGHT_PARTS`].
    Obstacle(usize),
    FusedCost,
    FusedConfidence,
    Label,
    SurestSource,
    Cost(Source),
    Confidence(Source),
    ElevationConfidence,
}

/// Name, type and meaning of every number of a cell, in the order of the message.
pub(crate) fn columns(sources: Sources, heights: bool) -> Vec<(String, NumericType, Column)> {
    let mut list = vec![
        ("updated_s".to_owned(), NumericType::Uint32, Column::UpdatedS),
        ("updated_ns".to_owned(), NumericType::Uint32, Column::UpdatedNs),
    ];
    list.extend(
        sources.iter().map(|source| (format!("seq.{source}"), NumericType::Uint32, Column::Sequence(source))),
    );
    if heights {
        for class in ["ground", "obstacle"] {
            list.extend(HEIGHT_PARTS.iter().enumerate().map(|(part, &name)| {
                let kind = if name == "count" { NumericType::Uint32 } else { NumericType::Float32 };
                let column = if class == "ground" { Column::Ground(part) } else { Column::Obstacle(part) };
                (format!("{class}.{name}"), kind, column)
            }));
        }
    }
    let fused = [
        ("cost", Column::FusedCost),
        ("confidence", Column::FusedConfidence),
        ("label", Column::Label),
        ("source", Column::SurestSource),
    ];
    list.extend(fused.map(|(name, column)| (name.to_owned(), NumericType::Uint8, column)));
    for source in sources.iter() {
        list.push((format!("cost.{source}"), NumericType::Uint8, Column::Cost(source)));
        list.push((format!("conf.{source}"), NumericType::Uint8, Column::Confidence(source)));
    }
    if heights {
        list.push(("conf.elevation".to_owned(), NumericType::Uint8, Column::ElevationConfidence));
    }
    list
}

impl Column {
    /// The number of a cell as the message holds it.
    pub(crate) fn of(self, cell: &Cell, weights: &WeightTable) -> f64 {
        let fused = || fuse_by_table(&cell.costs(), &cell.confidences(), weights);
        match self {
            Column::UpdatedS => (cell.updated.0 / 1_000_000_000) as f64,
            Column::UpdatedNs => (cell.updated.0 % 1_000_000_000) as f64,
            Column::Sequence(source) => f64::from(cell.evidence[source.index()].sequence),
            Column::Ground(part) => height(&cell.ground, part),
            Column::Obstacle(part) => height(&cell.obstacle, part),
            Column::FusedCost => f64::from(fused().cost),
            Column::FusedConfidence => f64::from(fused().confidence),
            Column::Label => f64::from(fused().label as u8),
            Column::SurestSource => f64::from(source_number(&fused())),
            Column::Cost(source) => f64::from(cell.evidence[source.index()].cost),
            Column::Confidence(source) => f64::from(cell.evidence[source.index()].confidence),
            Column::ElevationConfidence => f64::from(cell.elevation_confidence),
        }
    }
}

/// The number of the surest source in the message.
pub(crate) fn source_number(fused: &Fused) -> u8 {
    fused.source.map_or(u8::MAX, |source| source.index() as u8)
}

fn height(stats: &HeightStats, part: usize) -> f64 {
    let known = |value: f32| if stats.count == 0 { f64::NAN } else { f64::from(value) };
    match part {
        0 => known(stats.mean),
        1 => known(stats.variance),
        2 => known(stats.min),
        3 => known(stats.max),
        _ => f64::from(stats.count),
    }
}
