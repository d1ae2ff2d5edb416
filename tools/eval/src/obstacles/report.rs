//! The figures, as text and JSON.

use serde::Serialize;
use std::fmt;

/// Figures of the fused map and of each source alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// The vehicle for which the arcs were judged.
    pub vehicle: JudgedFor,
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

/// What was taken as the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct JudgedFor {
    /// Width, m.
    pub width_m: f64,
    /// Distance of the front ahead of the origin of the vehicle's frame, m.
    pub front_m: f64,
    /// Angle of view of all cameras together, degrees.
    pub view_deg: f64,
    /// Height of the cameras above the ground, m.
    pub eye_height_m: f64,
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
    /// Things that were in the way from at least 2 m, came nearer than that later, and did not block the way at 2 m or
    /// more by then.
    pub late_things: u64,
    /// Things sighted from less than 3 m, to which it did not block the way from the nearest pose at 2 m or more.
    pub missed_things: u64,
    /// Things that were sighted, by distance.
    pub bands: Vec<Band>,
}

/// Bands of distance from the front of the vehicle in which sightings are counted, m.
pub const BANDS_M: [[f64; 2]; 3] = [[IN_TIME_M, 3.0], [3.0, 4.0], [4.0, 5.0]];

/// The things sighted in one band of distance, and what a layer says of them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Band {
    /// Least distance of the things, m.
    pub from_m: f64,
    /// Distance that all things are nearer than, m.
    pub to_m: f64,
    /// Things that were sighted.
    pub things: u64,
    /// Those to which the layer blocked the way from all of these poses.
    pub steady_things: u64,
    /// Poses from which a thing was sighted, once for each thing.
    pub poses: u64,
    /// Those from which the layer blocked the way to it, percent; `None` (null in JSON) without poses.
    pub blocking_pct: Option<f64>,
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
    /// When it was first nearer than 2 m on an arc after a pose at which it was 2 m away or more on each one, s since
    /// the first judged map; `None` (null in JSON) if it never was.
    pub nearer_s: Option<f64>,
    /// Where and when it first blocked an arc, for each layer that ever blocked one there.
    pub first_blocks: Vec<FirstBlock>,
    /// Whether it blocked the way at the poses from which it was sighted, for each layer; empty where it never was.
    pub sightings: Vec<ThingSightings>,
}

/// The poses from which a thing was sighted, and what a layer said of it there.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ThingSightings {
    /// `fused`, or the name of the source.
    pub layer: String,
    /// Number of poses by distance, in the order of [`BANDS_M`].
    pub poses: [u64; 3],
    /// Number of those from which the layer blocked the way to it.
    pub blocking: [u64; 3],
    /// Greatest distance of a sighting from which on the layer blocked the way to it from each nearer pose, too, m;
    /// `None` (null in JSON) where it did not from the nearest one.
    pub steady_from_m: Option<f64>,
}

impl ThingSightings {
    /// Counts sightings, at least one: distance, m, and whether the layer blocked the way.
    pub(crate) fn new(layer: &str, sightings: &[(f64, bool)]) -> ThingSightings {
        let count = |[from_m, to_m]: [f64; 2], all: bool| {
            let is_counted = |&&(distance_m, blocks): &&(f64, bool)| {
                (from_m..to_m).contains(&distance_m) && (all || blocks)
            };
            sightings.iter().filter(is_counted).count() as u64
        };
        let missed = sightings.iter().filter(|(_, blocks)| !blocks);
        let missed_m = missed.map(|&(distance_m, _)| distance_m).fold(f64::INFINITY, f64::min);
        let distances_m = sightings.iter().map(|&(distance_m, _)| distance_m);
        ThingSightings {
            layer: layer.to_owned(),
            poses: BANDS_M.map(|band| count(band, true)),
            blocking: BANDS_M.map(|band| count(band, false)),
            steady_from_m: distances_m.filter(|&distance_m| distance_m < missed_m).reduce(f64::max),
        }
    }
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
    /// Greatest distance at which it blocked an arc at that time, or at another one up to [`ThingReport::nearer_s`],
    /// m.
    pub farthest_m: f64,
}

/// Distance at which a thing must block the way, m.
pub(crate) const IN_TIME_M: f64 = 2.0;

impl ThingReport {
    /// Whether the vehicle could have known of it at 2 m, came nearer, and a layer did not block the way there by then.
    pub fn is_late(&self, layer: &str) -> bool {
        let block = self.first_blocks.iter().find(|block| block.layer == layer);
        self.nearer_s.is_some() && block.is_none_or(|block| block.farthest_m < IN_TIME_M)
    }

    /// Whether it was sighted in the nearest band, and a layer did not block the way to it from the nearest pose.
    pub fn is_missed(&self, layer: &str) -> bool {
        self.sightings_of(layer).is_some_and(|seen| seen.poses[0] > 0 && seen.steady_from_m.is_none())
    }

    fn sightings_of(&self, layer: &str) -> Option<&ThingSightings> {
        self.sightings.iter().find(|seen| seen.layer == layer)
    }
}

/// What a layer says of the things that were sighted, in the order of [`BANDS_M`].
pub(crate) fn bands(things: &[ThingReport], layer: &str) -> Vec<Band> {
    let band = |(place, [from_m, to_m]): (usize, [f64; 2])| {
        let of_layer = things.iter().filter_map(|thing| thing.sightings_of(layer));
        let seen: Vec<[u64; 2]> = of_layer
            .map(|seen| [seen.poses[place], seen.blocking[place]])
            .filter(|&[poses, _]| poses > 0)
            .collect();
        let poses: u64 = seen.iter().map(|&[poses, _]| poses).sum();
        Band {
            from_m,
            to_m,
            things: seen.len() as u64,
            steady_things: seen.iter().filter(|[poses, blocking]| poses == blocking).count() as u64,
            poses,
            blocking_pct: pct(seen.iter().map(|&[_, blocking]| blocking).sum(), poses),
        }
    };
    BANDS_M.into_iter().enumerate().map(band).collect()
}

/// A share in percent; `None` of nothing.
pub(crate) fn pct(part: u64, of: u64) -> Option<f64> {
    (of > 0).then(|| 100.0 * part as f64 / of as f64)
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
        let JudgedFor { width_m, front_m, view_deg, eye_height_m } = self.vehicle;
        writeln!(
            out,
            "vehicle: {width_m:.2} m wide, front {front_m:.2} m ahead of its origin, view of {view_deg:.0} degrees from \
             {eye_height_m:.2} m above the ground"
        )?;
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
            if let Some(from_m) = thing.sightings_of("fused").and_then(|seen| seen.steady_from_m) {
                write!(out, "; fused blocks steadily from {from_m:.1} m")?;
            }
            let late = if thing.is_late("fused") { "; LATE" } else { "" };
            writeln!(out, "{late}{}", if thing.is_missed("fused") { "; MISSED" } else { "" })?;
        }
        for Layer { name, late_things, missed_things, bands, .. } in &self.layers {
            write!(
                out,
                "  {name:12} {late_things} late (not at {IN_TIME_M} m or more), {missed_things} missed"
            )?;
            for Band { from_m, to_m, things, steady_things, poses, blocking_pct } in bands {
                let share = blocking_pct.map_or("-".to_owned(), |pct| format!("{pct:.1} %"));
                write!(out, "; {from_m} to {to_m} m: {share} of {poses} poses")?;
                write!(out, ", {steady_things} of {things} things from all")?;
            }
            writeln!(out)?;
        }
        Ok(())
    }
}
