//! The numbers of a cell by name: the fields of the message, in its order, read directly from the map.

use rcs_geom::CellIndex;
use rcs_msg::foxglove::packed_element_field::NumericType;

use crate::{Cell, Evidence, Fused, HeightStats, MapMessage, MapOptions, Source};

/// Parts of the statistics of heights, in the order of the message.
pub(crate) const HEIGHT_PARTS: [&str; 5] = ["mean", "variance", "min", "max", "count"];

/// Field of [`Cell::obstacle_seen_from_dm`].
pub const OBSTACLE_SEEN_FROM: &str = "obstacle_seen_from_dm";

/// One number of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Column {
    UpdatedS,
    UpdatedNs,
    Sequence(Source),
    /// Index in [`HEIGHT_PARTS`].
    Ground(usize),
    /// Index in [`HEIGHT_PARTS`].
    Obstacle(usize),
    FusedCost,
    FusedConfidence,
    Label,
    SurestSource,
    ObstacleSeenFrom,
    Cost(Source),
    Confidence(Source),
    Against(Source),
    Backing(Source),
    Model(Source),
    ElevationConfidence,
}

/// Name, type and meaning of every number of a cell, in the order of the message.
pub(crate) fn columns(options: &MapOptions) -> Vec<(String, NumericType, Column)> {
    let mut list = vec![
        ("updated_s".to_owned(), NumericType::Uint32, Column::UpdatedS),
        ("updated_ns".to_owned(), NumericType::Uint32, Column::UpdatedNs),
    ];
    let sources = || options.sources.iter();
    list.extend(
        sources().map(|source| (format!("seq.{source}"), NumericType::Uint32, Column::Sequence(source))),
    );
    if options.heights {
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
    list.push((OBSTACLE_SEEN_FROM.to_owned(), NumericType::Uint8, Column::ObstacleSeenFrom));
    for source in sources() {
        list.push((format!("cost.{source}"), NumericType::Uint8, Column::Cost(source)));
        list.push((format!("conf.{source}"), NumericType::Uint8, Column::Confidence(source)));
        list.push((format!("against.{source}"), NumericType::Uint8, Column::Against(source)));
        list.push((format!("backing.{source}"), NumericType::Uint8, Column::Backing(source)));
        if options.has_models(source) {
            list.push((format!("model.{source}"), NumericType::Uint8, Column::Model(source)));
        }
    }
    if options.heights {
        list.push(("conf.elevation".to_owned(), NumericType::Uint8, Column::ElevationConfidence));
    }
    list
}

impl Column {
    /// The number of a cell as it is in the message; `None` outside of the map.
    pub(crate) fn at(self, message: &MapMessage, index: CellIndex) -> Option<f64> {
        let (map, options) = (message.map(), message.options());
        let cell = map.grid().get(index)?;
        Some(match self.source() {
            Some(source) => self.of_evidence(map.evidence(source, index)),
            None if self.is_fused() => self.of_fused(&map.fused(index, &options.weights), options),
            None => self.of_cell(cell),
        })
    }

    /// Calls `visit` with the number of each cell by rows.
    pub(crate) fn each(self, message: &MapMessage, mut visit: impl FnMut(f64)) {
        let (map, options) = (message.map(), message.options());
        let side = map.grid().side();
        match self.source() {
            Some(source) => match map.layer(source) {
                Some(layer) => layer.for_each_run(|_, _, cells| {
                    for evidence in cells {
                        visit(self.of_evidence(*evidence));
                    }
                }),
                None => (0..side * side).for_each(|_| visit(self.of_evidence(Evidence::NONE))),
            },
            None if self == Column::FusedCost => {
                message.each_cost(|cost| visit(f64::from(cost)));
            }
            None if self.is_fused() => {
                map.for_each_fused(&options.weights, |_, fused| visit(self.of_fused(&fused, options)));
            }
            None => map.grid().for_each_run(|_, _, cells| {
                for cell in cells {
                    visit(self.of_cell(cell));
                }
            }),
        }
    }

    fn source(self) -> Option<Source> {
        match self {
            Column::Sequence(source)
            | Column::Cost(source)
            | Column::Confidence(source)
            | Column::Against(source)
            | Column::Backing(source)
            | Column::Model(source) => Some(source),
            _ => None,
        }
    }

    fn is_fused(self) -> bool {
        matches!(self, Column::FusedCost | Column::FusedConfidence | Column::Label | Column::SurestSource)
    }

    fn of_evidence(self, evidence: Evidence) -> f64 {
        match self {
            Column::Sequence(_) => f64::from(evidence.sequence),
            Column::Cost(_) => f64::from(evidence.cost),
            Column::Against(_) => f64::from(evidence.against),
            Column::Backing(_) => f64::from(evidence.backing),
            Column::Model(_) => f64::from(evidence.model),
            _ => f64::from(evidence.confidence),
        }
    }

    fn of_fused(self, fused: &Fused, options: &MapOptions) -> f64 {
        f64::from(match self {
            Column::FusedCost => fused.cost,
            Column::FusedConfidence => fused.confidence,
            Column::Label => fused.label as u8,
            _ => source_number(fused, options),
        })
    }

    fn of_cell(self, cell: &Cell) -> f64 {
        match self {
            Column::UpdatedS => (cell.updated.0 / 1_000_000_000) as f64,
            Column::UpdatedNs => (cell.updated.0 % 1_000_000_000) as f64,
            Column::Ground(part) => height(&cell.ground, part),
            Column::Obstacle(part) => height(&cell.obstacle, part),
            Column::ObstacleSeenFrom => f64::from(cell.obstacle_seen_from_dm),
            _ => f64::from(cell.elevation_confidence),
        }
    }
}

/// The number of the surest source in the message: its index among the sources with fields in the message; 255 for
/// none.
pub(crate) fn source_number(fused: &Fused, options: &MapOptions) -> u8 {
    let place = fused.source.and_then(|source| options.sources.iter().position(|other| other == source));
    place.map_or(u8::MAX, |place| place.min(254) as u8)
}

fn height(stats: &HeightStats, part: usize) -> f64 {
    let stats = stats.rounded();
    let known = |value: f32| if stats.count == 0 { f64::NAN } else { f64::from(value) };
    match part {
        0 => known(stats.mean),
        1 => known(stats.variance),
        2 => known(stats.min),
        3 => known(stats.max),
        _ => f64::from(stats.count),
    }
}
