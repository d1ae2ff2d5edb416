//! The figures, as text and JSON.

use serde::Serialize;
use std::fmt;

/// Figures of the fused map and of each source alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Number of maps that were judged, and the distance driven meanwhile, m.
    pub maps: u64,
    /// Distance driven, m.
    pub driven_m: f64,
    /// Number of arcs by length.
    pub arcs: Vec<ArcCounts>,
    /// The fused map (`fused`), then each source alone.
    pub layers: Vec<Layer>,
    /// Things that were the first thing on an arc, by the time at which they came into the way.
    pub things: Vec<ThingReport>,
}

/// Arcs of one length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ArcCounts {
    /// Length, mm.
    pub length_mm: u32,
    /// Truly free, and the fused map knows enough of it to judge, or blocks it.
    pub free: u64,
    /// Truly blocked, likewise.
    pub blocked: u64,
    /// Truly blocked by the tolerance alone, which are not counted.
    pub grazing: u64,
    /// Not blocked by the fused map, which knows too little of it: truly free and truly blocked ones.
    pub unknown: [u64; 2],
}

/// Figures of the fused map or of one source.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Layer {
    /// `fused`, or the name of the source.
    pub name: String,
    /// In the order of [`Report::arcs`].
    pub arcs: Vec<Shares>,
    /// Things that were in the way from at least 2 m, came nearer than that, and did not block the way at 2 m or more.
    pub late_things: u64,
}

/// Wrong arcs of one length; `None` (null in JSON) where no arc is truly so.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Shares {
    /// Truly free arcs that are called blocked, percent.
    pub free_called_blocked_pct: Option<f64>,
    /// Truly blocked arcs that are called free, percent.
    pub blocked_called_free_pct: Option<f64>,
}

/// A thing in the way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ThingReport {
    /// Name of its class.
    pub kind: String,
    /// Its middle in the frame of the true map, m.
    pub x_m: f64,
    /// Its middle in the frame of the true map, m.
    pub y_m: f64,
    /// Greatest and least distance along an arc, from the front of the vehicle, at which it was the first thing on it,
    /// m.
    pub in_the_way_m: [f64; 2],
    /// When it came into the way, s since the first judged map.
    pub in_the_way_s: f64,
    /// Where and when it first blocked an arc, for each layer that ever blocked one there.
    pub first_blocks: Vec<FirstBlock>,
}

/// Where and when a thing first blocked an arc.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FirstBlock {
    /// `fused`, or the name of the source.
    pub layer: String,
    /// Distance of the thing along the arc, from the front of the vehicle, m.
    pub distance_m: f64,
    /// Time, s since the first judged map.
    pub time_s: f64,
}

/// Distance at which a thing must block the way, m.
pub(crate) const IN_TIME_M: f64 = 2.0;

impl ThingReport {
    /// Whether the vehicle could have known of it at 2 m, came nearer, and a layer did not block the way there.
    pub fn is_late(&self, layer: &str) -> bool {
        let [far, near] = self.in_the_way_m;
        let block = self.first_blocks.iter().find(|block| block.layer == layer);
        far >= IN_TIME_M && near < IN_TIME_M && block.is_none_or(|block| block.distance_m < IN_TIME_M)
    }
}

impl Report {
    /// The figures of a layer for arcs of a length, m.
    pub fn shares(&self, layer: &str, length_m: f64) -> Option<Shares> {
        let place =
            self.arcs.iter().position(|arcs| (f64::from(arcs.length_mm) - 1e3 * length_m).abs() < 1.0)?;
        self.layers.iter().find(|entry| entry.name == layer)?.arcs.get(place).copied()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "{} maps over {:.1} m", self.maps, self.driven_m)?;
        for (place, arcs) in self.arcs.iter().enumerate() {
            let ArcCounts { length_mm, free, blocked, grazing, unknown } = *arcs;
            writeln!(
                out,
                "arcs of {} m: {free} truly free, {blocked} truly blocked; not judged: {grazing} grazing, \
                 {} free and {} blocked of which too little is known",
                f64::from(length_mm) / 1e3,
                unknown[0],
                unknown[1]
            )?;
            writeln!(out, "  {:12} free called blocked   blocked called free", "")?;
            for layer in &self.layers {
                let shares = layer.arcs.get(place).copied().unwrap_or_default();
                let figure = |pct: Option<f64>| pct.map_or("-".to_owned(), |pct| format!("{pct:.2} %"));
                let [free, blocked] =
                    [shares.free_called_blocked_pct, shares.blocked_called_free_pct].map(figure);
                writeln!(out, "  {:12} {free:>19} {blocked:>21}", layer.name)?;
            }
        }
        writeln!(out, "things in the way: {}", self.things.len())?;
        for thing in &self.things {
            let [far, near] = thing.in_the_way_m;
            write!(
                out,
                "  {:>6.1} s  {:24} at ({:.1}, {:.1}), in the way from {far:.1} m to {near:.1} m",
                thing.in_the_way_s, thing.kind, thing.x_m, thing.y_m
            )?;
            for block in &thing.first_blocks {
                write!(out, "; {} blocks at {:.1} m, {:.1} s", block.layer, block.distance_m, block.time_s)?;
            }
            writeln!(out, "{}", if thing.is_late("fused") { "; LATE" } else { "" })?;
        }
        for layer in &self.layers {
            writeln!(out, "  {:12} {} late (not at {IN_TIME_M} m or more)", layer.name, layer.late_things)?;
        }
        Ok(())
    }
}
