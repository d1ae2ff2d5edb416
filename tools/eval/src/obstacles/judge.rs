//! Compares maps with the true map as they come.

use super::Settings;
use super::arc::{Arc, Covered, Sweep, covered};
use super::report::{
    ArcCounts, FirstBlock, IN_TIME_M, JudgedFor, Layer, Report, Shares, ThingReport, bands, pct,
};
use super::sightings::{Eye, Sighting, Sightings};
use super::truth::Truth;
use crate::EvalError;
use rcs_geom::Pose;
use rcs_msg::Stamp;
use rcs_msg::foxglove::Grid;
use rcs_world::{GridView, MAX_COST, OBSTACLE_COST};
use std::collections::{BTreeMap, VecDeque};

/// Name of the fused map among the layers.
pub const FUSED: &str = "fused";
/// Greatest number of poses that are kept, and greatest age of a pose, s.
const POSES: usize = 64;
const POSE_AGE_S: f64 = 0.25;
/// Greatest distance along an arc between a thing and the cell of a map that blocks the arc because of it, m.
const SAME_THING_M: f64 = 0.6;

/// Judges maps along a drive: takes the true map, true poses, poses and maps in the order of their times.
#[derive(Clone, Debug)]
pub struct Judge {
    settings: Settings,
    arcs: Vec<Arc>,
    truth: Option<Truth>,
    true_poses: VecDeque<(Stamp, Pose)>,
    poses: VecDeque<(Stamp, Pose)>,
    begun: Option<Stamp>,
    judged_at: Option<Pose>,
    maps: u64,
    driven_m: f64,
    counts: Vec<ArcCounts>,
    layers: BTreeMap<String, Vec<Wrong>>,
    /// Names of the layers in the order in which they came.
    order: Vec<String>,
    things: BTreeMap<u32, Met>,
    sightings: Sightings,
}

/// Arcs of one length that a layer blocks.
#[derive(Clone, Copy, Debug, Default)]
struct Wrong {
    free_called_blocked: u64,
    blocked_called_blocked: u64,
}

/// A thing that has been in the way.
#[derive(Clone, Debug)]
struct Met {
    in_the_way_m: [f64; 2],
    in_the_way_s: f64,
    /// Whether it was 2 m away or more on each arc at a pose.
    was_far: bool,
    /// When it was first nearer than that on an arc, at a later pose.
    nearer_s: Option<f64>,
    first_blocks: Vec<FirstBlock>,
}

/// What the truth says about one arc.
struct TrueArc {
    /// The first blocked cell under the vehicle's width.
    first: Option<Hit>,
    /// Distance of the first blocked cell within the tolerance.
    near_m: f64,
}

/// A blocked cell of the true map on an arc.
#[derive(Clone, Copy)]
struct Hit {
    along_m: f64,
    thing: u32,
    /// Index of the cell, by rows.
    cell: usize,
}

impl Judge {
    /// A judge that has seen nothing.
    pub fn new(settings: &Settings) -> Judge {
        let count =
            |length_m: &f64| ArcCounts { length_mm: (length_m * 1e3).round() as u32, ..ArcCounts::default() };
        Judge {
            arcs: Arc::fan(settings.arcs, settings.curvature_per_m),
            settings: settings.clone(),
            truth: None,
            true_poses: VecDeque::new(),
            poses: VecDeque::new(),
            begun: None,
            judged_at: None,
            maps: 0,
            driven_m: 0.0,
            counts: settings.lengths_m.iter().map(count).collect(),
            layers: BTreeMap::new(),
            order: Vec::new(),
            things: BTreeMap::new(),
            sightings: Sightings::default(),
        }
    }

    /// Takes the true map, a grid with the field `blocked`. The first one counts.
    pub fn take_truth(&mut self, grid: Grid) -> Result<(), EvalError> {
        if self.truth.is_none() {
            self.truth = Some(Truth::new(grid)?);
        }
        Ok(())
    }

    /// Takes the true pose of the vehicle in the frame of the true map.
    pub fn take_true_pose(&mut self, time: Stamp, pose: Pose) {
        keep(&mut self.true_poses, time, pose);
    }

    /// Takes the vehicle's pose in the frame of the maps.
    pub fn take_pose(&mut self, time: Stamp, pose: Pose) {
        keep(&mut self.poses, time, pose);
    }

    /// Judges a map of this time; leaves it out while the truth or a pose is missing, or before the vehicle has moved by
    /// a step.
    pub fn take_map(&mut self, time: Stamp, view: &GridView<'_>) -> Result<(), EvalError> {
        let (Some(true_pose), Some(pose)) = (at(&self.true_poses, time), at(&self.poses, time)) else {
            return Ok(());
        };
        let Some(truth) = &self.truth else { return Ok(()) };
        let moved_m =
            self.judged_at.map(|last| (true_pose.translation - last.translation).truncate().length());
        if moved_m.is_some_and(|moved_m| moved_m < self.settings.step_m) {
            return Ok(());
        }
        let refused = |error: rcs_world::GridViewError| EvalError::nothing(error.to_string());
        let time_s = time.seconds_since(*self.begun.get_or_insert(time));
        self.judged_at = Some(true_pose);
        self.driven_m += moved_m.unwrap_or(0.0);
        self.maps += 1;

        let sweep = Sweep {
            half_width_m: self.settings.width_m / 2.0,
            along_m: [self.settings.front_m, self.end_m()],
            tolerance_m: self.settings.tolerance_m,
        };
        let true_view = GridView::new(&truth.grid).map_err(refused)?;
        let true_arcs: Vec<TrueArc> = covered(&true_view, &true_pose, &self.arcs, &sweep)
            .iter()
            .map(|cells| TrueArc::new(cells, &truth.thing))
            .collect();
        let (eye, front_m) = (Eye::new(&true_pose, &self.settings), self.settings.front_m);
        let in_view = true_arcs.iter().enumerate().filter_map(|(arc, true_arc)| {
            let hit = true_arc.first.filter(|hit| eye.sees(truth, &true_view, hit.cell))?;
            Some(Sighting { arc, thing: hit.thing, distance_m: hit.along_m - front_m })
        });
        let sightings = self.sightings.take(self.driven_m, in_view);
        let cells = covered(view, &pose, &self.arcs, &sweep);
        let fused: Vec<f64> = view.field("cost").map_err(refused)?.values().collect();
        self.meet(&true_arcs, time_s);
        let decided = self.count(&true_arcs, &cells, &fused);
        self.judge_layer(FUSED, &fused, &true_arcs, &cells, &decided, time_s);
        self.judge_sightings(FUSED, &fused, &cells, &sightings);
        for source in view.sources().iter() {
            let costs: Vec<f64> = view.field(&format!("cost.{source}")).map_err(refused)?.values().collect();
            self.judge_layer(source.name(), &costs, &true_arcs, &cells, &decided, time_s);
            self.judge_sightings(source.name(), &costs, &cells, &sightings);
        }
        Ok(())
    }

    /// Where the longest arcs end, from the origin of the vehicle's frame, m.
    fn end_m(&self) -> f64 {
        self.settings.front_m + self.settings.lengths_m.iter().copied().fold(0.0, f64::max)
    }

    /// Notes how far away the things are that are in the way at a pose.
    fn meet(&mut self, truth: &[TrueArc], time_s: f64) {
        let (front_m, end_m) = (self.settings.front_m, self.end_m());
        let mut distances_m: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
        for Hit { along_m, thing, .. } in truth.iter().filter_map(|arc| arc.hit_before(end_m)) {
            let distance_m = along_m - front_m;
            let known_m = distances_m.entry(thing).or_insert([distance_m; 2]);
            *known_m = [known_m[0].max(distance_m), known_m[1].min(distance_m)];
        }
        for (thing, [far_m, near_m]) in distances_m {
            let met = self.things.entry(thing).or_insert(Met {
                in_the_way_m: [far_m, near_m],
                in_the_way_s: time_s,
                was_far: false,
                nearer_s: None,
                first_blocks: Vec::new(),
            });
            met.in_the_way_m = [met.in_the_way_m[0].max(far_m), met.in_the_way_m[1].min(near_m)];
            if near_m >= IN_TIME_M {
                met.was_far = true;
            } else if met.was_far && met.nearer_s.is_none() {
                met.nearer_s = Some(time_s);
            }
        }
    }

    /// Counts the arcs of each length; returns what each is, `None` where it is not judged.
    fn count(&mut self, truth: &[TrueArc], cells: &[Vec<Covered>], fused: &[f64]) -> Vec<Vec<Option<bool>>> {
        let Settings { front_m, tolerance_m, least_known, .. } = self.settings;
        let lengths_m = self.settings.lengths_m.clone();
        let mut decided = Vec::new();
        for (counts, length_m) in self.counts.iter_mut().zip(lengths_m) {
            let end_m = front_m + length_m;
            let of_arc = |(truth, cells): (&TrueArc, &Vec<Covered>)| {
                let blocked = truth.is_blocked(end_m);
                if !blocked && truth.near_m <= end_m + tolerance_m {
                    counts.grazing += 1;
                    return None;
                }
                let called = Called::new(cells, fused, end_m, tolerance_m);
                let is_known = called.known >= least_known || called.blocks(blocked);
                match (is_known, blocked) {
                    (false, _) => counts.unknown[usize::from(blocked)] += 1,
                    (true, false) => counts.free += 1,
                    (true, true) => counts.blocked += 1,
                }
                is_known.then_some(blocked)
            };
            decided.push(truth.iter().zip(cells).map(of_arc).collect());
        }
        decided
    }

    /// Counts what one layer calls the arcs, and notes the things that it sees for the first time.
    fn judge_layer(
        &mut self,
        name: &str,
        costs: &[f64],
        truth: &[TrueArc],
        cells: &[Vec<Covered>],
        decided: &[Vec<Option<bool>>],
        time_s: f64,
    ) {
        let Settings { front_m, tolerance_m, .. } = self.settings;
        let lengths_m = self.settings.lengths_m.clone();
        if !self.layers.contains_key(name) {
            self.order.push(name.to_owned());
            self.layers.insert(name.to_owned(), vec![Wrong::default(); lengths_m.len()]);
        }
        if let Some(wrong) = self.layers.get_mut(name) {
            for ((wrong, decided), length_m) in wrong.iter_mut().zip(decided).zip(&lengths_m) {
                for (cells, decided) in cells.iter().zip(decided) {
                    let Some(blocked) = *decided else { continue };
                    if Called::new(cells, costs, front_m + length_m, tolerance_m).blocks(blocked) {
                        *(if blocked {
                            &mut wrong.blocked_called_blocked
                        } else {
                            &mut wrong.free_called_blocked
                        }) += 1;
                    }
                }
            }
        }
        let end_m = self.end_m();
        for (truth, cells) in truth.iter().zip(cells) {
            let Some(Hit { along_m, thing, .. }) = truth.hit_before(end_m) else { continue };
            let Some(met) = self.things.get_mut(&thing) else { continue };
            if blocks_at(cells, costs, along_m) {
                met.note_block(name, along_m - front_m, time_s);
            }
        }
    }

    /// Notes for each thing that is sighted whether a layer blocks the way to it.
    fn judge_sightings(
        &mut self,
        layer: &str,
        costs: &[f64],
        cells: &[Vec<Covered>],
        sightings: &[Sighting],
    ) {
        for sighting in sightings {
            let along_m = self.settings.front_m + sighting.distance_m;
            self.sightings.note(layer, sighting, blocks_at(&cells[sighting.arc], costs, along_m));
        }
    }

    /// The figures; an error where nothing was judged.
    pub fn report(&self) -> Result<Report, EvalError> {
        if self.maps == 0 {
            let what = match (&self.truth, self.true_poses.is_empty(), self.poses.is_empty()) {
                (None, ..) => "a true map before the first map",
                (_, true, _) => "true poses of the vehicle",
                (.., true) => "poses of the vehicle in the frame of the map",
                _ => "a map with poses of its time",
            };
            return Err(EvalError::nothing(format!("no map could be judged: expected {what}")));
        }
        let truth = self.truth.as_ref();
        let thing = |(number, met): (&u32, &Met)| {
            let thing = truth.and_then(|truth| truth.things.get(*number as usize))?;
            Some(ThingReport {
                kind: thing.kind.clone(),
                x_m: thing.at.x,
                y_m: thing.at.y,
                in_the_way_m: met.in_the_way_m,
                in_the_way_s: met.in_the_way_s,
                nearer_s: met.nearer_s,
                first_blocks: met.first_blocks.clone(),
                sightings: self.sightings.of(*number),
            })
        };
        let mut things: Vec<ThingReport> = self.things.iter().filter_map(thing).collect();
        things.sort_by(|a, b| a.in_the_way_s.total_cmp(&b.in_the_way_s));
        let layer = |name: &String| Layer {
            name: name.clone(),
            arcs: self.layers[name]
                .iter()
                .zip(&self.counts)
                .map(|(wrong, counts)| Shares {
                    free_called_blocked_pct: pct(wrong.free_called_blocked, counts.free),
                    blocked_called_free_pct: pct(
                        counts.blocked - wrong.blocked_called_blocked,
                        counts.blocked,
                    ),
                })
                .collect(),
            late_things: things.iter().filter(|thing| thing.is_late(name)).count() as u64,
            missed_things: things.iter().filter(|thing| thing.is_missed(name)).count() as u64,
            bands: bands(&things, name),
        };
        let Settings { width_m, front_m, view_rad, eye_height_m, .. } = self.settings;
        Ok(Report {
            vehicle: JudgedFor { width_m, front_m, view_deg: view_rad.to_degrees(), eye_height_m },
            maps: self.maps,
            driven_m: self.driven_m,
            arcs: self.counts.clone(),
            layers: self.order.iter().map(layer).collect(),
            things,
        })
    }
}

impl Met {
    /// Notes that a layer blocks an arc because of it. Of several arcs at one time the one on which it is farthest
    /// counts.
    fn note_block(&mut self, layer: &str, distance_m: f64, time_s: f64) {
        let is_before_near = self.nearer_s.is_none_or(|nearer_s| time_s <= nearer_s);
        match self.first_blocks.iter_mut().find(|block| block.layer == layer) {
            Some(block) => {
                let is_first = block.time_s == time_s;
                if is_first {
                    block.distance_m = block.distance_m.max(distance_m);
                }
                if is_first || is_before_near {
                    block.farthest_m = block.farthest_m.max(distance_m);
                }
            }
            None => self.first_blocks.push(FirstBlock {
                layer: layer.to_owned(),
                distance_m,
                time_s,
                farthest_m: distance_m,
            }),
        }
    }
}

impl TrueArc {
    fn new(cells: &[Covered], thing: &[Option<u32>]) -> TrueArc {
        let (mut first, mut near_m): (Option<Hit>, f64) = (None, f64::INFINITY);
        for cell in cells {
            let Some(number) = thing[cell.cell] else { continue };
            near_m = near_m.min(cell.along_m);
            if cell.inside && first.is_none_or(|hit| cell.along_m < hit.along_m) {
                first = Some(Hit { along_m: cell.along_m, thing: number, cell: cell.cell });
            }
        }
        TrueArc { first, near_m }
    }

    /// The first blocked cell, if the arc has one before this distance, m.
    fn hit_before(&self, end_m: f64) -> Option<Hit> {
        self.first.filter(|hit| hit.along_m <= end_m)
    }

    fn is_blocked(&self, end_m: f64) -> bool {
        self.hit_before(end_m).is_some()
    }
}

/// What a layer calls one arc.
struct Called {
    /// Whether an obstacle lies under the vehicle's width, and whether one lies within the tolerance.
    inside: bool,
    near: bool,
    /// Share of the cells under the vehicle's width that have a cost.
    known: f64,
}

impl Called {
    fn new(cells: &[Covered], costs: &[f64], end_m: f64, tolerance_m: f64) -> Called {
        let (mut called, mut all, mut known) =
            (Called { inside: false, near: false, known: 0.0 }, 0_u32, 0_u32);
        for cell in cells {
            let within = cell.inside && cell.along_m <= end_m;
            if cell.along_m <= end_m + tolerance_m && is_obstacle(costs, cell.cell) {
                called.near = true;
                called.inside |= within;
            }
            if within {
                all += 1;
                known += u32::from(costs[cell.cell] <= f64::from(MAX_COST));
            }
        }
        called.known = f64::from(known) / f64::from(all.max(1));
        called
    }

    /// Whether it calls the arc blocked. The tolerance is in the layer's favour: it need not block an arc at the border
    /// of a thing, and it may block an arc that a thing blocks by a cell beside it.
    fn blocks(&self, truly: bool) -> bool {
        if truly { self.near } else { self.inside }
    }
}

/// Whether a layer blocks an arc because of a thing at this distance along it.
fn blocks_at(cells: &[Covered], costs: &[f64], along_m: f64) -> bool {
    let near = |cell: &&Covered| (cell.along_m - along_m).abs() <= SAME_THING_M;
    cells.iter().filter(near).any(|cell| is_obstacle(costs, cell.cell))
}

fn is_obstacle(costs: &[f64], cell: usize) -> bool {
    (f64::from(OBSTACLE_COST)..=f64::from(MAX_COST)).contains(&costs[cell])
}

fn keep(poses: &mut VecDeque<(Stamp, Pose)>, time: Stamp, pose: Pose) {
    poses.push_back((time, pose));
    if poses.len() > POSES {
        poses.pop_front();
    }
}

/// The pose nearest to a time.
fn at(poses: &VecDeque<(Stamp, Pose)>, time: Stamp) -> Option<Pose> {
    let apart_s = |other: Stamp| other.seconds_since(time).abs();
    let nearest = poses.iter().min_by(|a, b| apart_s(a.0).total_cmp(&apart_s(b.0)))?;
    (apart_s(nearest.0) <= POSE_AGE_S).then_some(nearest.1)
}
