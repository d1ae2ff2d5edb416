//! What the vehicle experiences, and what the operator says, as lessons for the learning maps: bumper hits, outlines,
//! slip, and the ground under the vehicle (Albus 2006a, 3.2, step 5).

use crate::camera::extrinsics;
use crate::map::{Experience, Patch, TerrainMap, Vehicle};
use crate::models::ModelRules;
use crate::proto::TerrainLearnerParams;
use glam::{DVec2, DVec3};
use rcs_geom::Pose;
use rcs_msg::Stamp;
use rcs_msg::rcs::{Bumper, ExampleKind, PlanePoint, SlipReport, TractionState, TrainingExample, WaySlip};
use rcs_runtime::{Cycle, In, InputRole, PortBuilder};
use rcs_sense::{LastSlip, Localizer, SensorTime, is_slippery, pose_of};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// The driven wheels touch the ground within this distance ahead of and behind the vehicle frame's origin, m.
const WHEELS_REACH_M: f64 = 0.2;

/// The inputs that teach by experience.
#[derive(Debug)]
pub(crate) struct TeacherPorts {
    bumper: In<Bumper>,
    examples: In<TrainingExample>,
    slip: In<SlipReport>,
    way_slip: In<WaySlip>,
}

impl TeacherPorts {
    /// Declares them.
    pub(crate) fn declare(b: &mut PortBuilder) -> TeacherPorts {
        TeacherPorts {
            bumper: b.optional_input("bumper", "switches of the bumper"),
            examples: b.operator_input(
                InputRole::Training,
                "examples",
                "places that the operator says are obstacles or ground",
            ),
            slip: b.optional_input("slip", "slip of the wheels: ground on which they begin to spin is dear; while they slip, driving teaches nothing"),
            way_slip: b.optional_input("way_slip", "slip over the last metres: ground on which it lasts is dear"),
        }
    }
}

/// What bumper and wheels said last.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Teachers {
    /// Which bumper switches are pressed.
    pressed: [bool; 2],
    /// Whether the wheels spin or a motor is stalled.
    slips: bool,
    /// Whether the wheels slipped over the last metres.
    last_slip: LastSlip,
    /// The ways over the ground of the last seconds, of which slip may yet be told; oldest first.
    lately: VecDeque<(Stamp, Pose)>,
}

impl Teachers {
    /// Forgets where the vehicle was: the local frame has begun again.
    pub(crate) fn forget_places(&mut self) {
        self.lately.clear();
    }

    /// Teaches the maps from the ground under the vehicle, from bumper hits and from the operator; returns whether driving
    /// taught anything, and whether the others did.
    pub(crate) fn teach(
        &mut self,
        maps: &mut [TerrainMap],
        localizer: &Localizer,
        ports: &TeacherPorts,
        params: &TerrainLearnerParams,
        rules: &ModelRules,
        cx: &mut Cycle<'_>,
    ) -> [bool; 2] {
        let extrinsics = extrinsics(params);
        let before: Vec<_> = maps.iter().map(TerrainMap::experienced).collect();
        let half = half_width_m(params);
        while let Some(bumper) = cx.read(&ports.bumper) {
            let pressed = [bumper.left, bumper.right];
            let hit: [bool; 2] = std::array::from_fn(|side| pressed[side] && !self.pressed[side]);
            self.pressed = pressed;
            if hit == [false; 2] {
                continue;
            }
            match extrinsics.local_from_vehicle(localizer, SensorTime::of(&bumper)) {
                Ok(pose) => {
                    let y = [if hit[1] { -half } else { 0.0 }, if hit[0] { half } else { 0.0 }];
                    let patch = Patch { x: [params.front_m, params.front_m + params.bumper_reach_m], y };
                    for map in maps.iter_mut() {
                        map.bump(&vehicle(pose, params), &patch, params.bumper_gain, rules);
                    }
                }
                Err(error) => cx.fault(format!("bumper: {error}; hit skipped")),
            }
        }
        while let Some(example) = cx.read(&ports.examples) {
            if let Err(error) = mark(maps, localizer, &example, params, rules, cx.now()) {
                cx.fault(format!("example of the operator: {error}; skipped"));
            }
        }
        for place in self.slippery_places(localizer, ports, params, cx) {
            let wheels = Patch { x: [-WHEELS_REACH_M, WHEELS_REACH_M], y: [-half, half] };
            for map in maps.iter_mut() {
                map.spin(&vehicle(place, params), &wheels, params.slip_gain, rules);
            }
        }
        // Without a pose no cell can be found; frames report it. A vehicle whose pose is fixed drives over nothing.
        let here = extrinsics.local_from_vehicle(localizer, cx.now()).ok();
        let outline = Patch { x: [-params.rear_m, params.front_m], y: [-half, half] };
        let moves = here.filter(|_| !extrinsics.fixed_pose);
        let driven = self.driven(moves, params.driven_delay_s, cx.now());
        for map in maps.iter_mut() {
            if let Some(pose) = here {
                map.stand(&vehicle(pose, params));
            }
            for pose in &driven {
                map.drive(&vehicle(*pose, params), &outline, params.driven_gain, rules);
            }
        }
        let differs = |part: std::ops::Range<usize>| {
            let mut maps = maps.iter().zip(&before);
            maps.any(|(map, before)| map.experienced()[part.clone()] != before[part.clone()])
        };
        [differs(0..1), differs(1..3)]
    }

    /// Where the vehicle was `delay_s` ago, oldest first, if no slip has been told since: wheels slip for a metre before it is
    /// told, and a vehicle whose wheels slip is not where odometry says. `here`: where it is now.
    fn driven(&mut self, here: Option<Pose>, delay_s: f64, now: Stamp) -> Vec<Pose> {
        if self.slips || self.last_slip.is_on(now) {
            self.lately.clear();
        } else {
            self.lately.extend(here.map(|pose| (now, pose)));
        }
        let is_due = |(at, _): &&(Stamp, Pose)| now.seconds_since(*at) >= delay_s;
        let due = self.lately.iter().take_while(is_due).count();
        self.lately.drain(..due).map(|(_, pose)| pose).collect()
    }

    /// Where wheels have begun to spin, and where they have slipped over some metres, which is told later.
    fn slippery_places(
        &mut self,
        localizer: &Localizer,
        ports: &TeacherPorts,
        params: &TerrainLearnerParams,
        cx: &mut Cycle<'_>,
    ) -> Vec<Pose> {
        let extrinsics = extrinsics(params);
        let slipped = self.slips;
        let mut places = Vec::new();
        if let Some(report) = cx.read_newest(&ports.slip) {
            self.slips =
                matches!(report.state(), TractionState::TractionSpins | TractionState::TractionStalled);
            if report.state() == TractionState::TractionSpins && !slipped && !extrinsics.fixed_pose {
                places.extend(extrinsics.local_from_vehicle(localizer, SensorTime::of(&report)));
            }
        }
        while let Some(report) = cx.read(&ports.way_slip) {
            self.last_slip.take(&report, cx.now());
            if is_slippery(&report) {
                match pose_of(report.middle.as_ref(), extrinsics.frames.local) {
                    Ok(pose) => places.push(pose),
                    Err(error) => cx.fault(format!("way_slip: {error}; skipped")),
                }
            }
        }
        places
    }
}

/// Half the width of the ground of which the vehicle teaches something, m.
fn half_width_m(params: &TerrainLearnerParams) -> f64 {
    (params.width_m - params.side_margin_m - params.side_margin_m).max(0.0) / 2.0
}

/// The vehicle with this pose in the local frame.
fn vehicle(local_from_vehicle: Pose, params: &TerrainLearnerParams) -> Vehicle {
    let height_m = params.height_m * params.driven_height_share;
    Vehicle { local_from_vehicle, wheels_below_m: params.wheels_below_m, height_m }
}

/// Teaches the maps what an operator has drawn.
fn mark(
    maps: &mut [TerrainMap],
    localizer: &Localizer,
    example: &TrainingExample,
    params: &TerrainLearnerParams,
    rules: &ModelRules,
    now: Stamp,
) -> Result<(), String> {
    let extrinsics = extrinsics(params);
    let (local, frame_id) = (extrinsics.frames.local, &example.frame_id);
    let local_from_outline = localizer.lookup(local, frame_id, now, extrinsics.max_age_s);
    let local_from_outline = local_from_outline.map_err(|error| error.to_string())?;
    let points = example.outline.iter().flat_map(|outline| &outline.points);
    let place = |point: &PlanePoint| local_from_outline * DVec3::new(point.x_m, point.y_m, 0.0);
    let outline: Vec<DVec2> = points.map(|point| place(point).truncate()).collect();
    if outline.len() < 3 || !outline.iter().all(|corner| corner.is_finite()) {
        return Err(format!("outline has {} corners, expected at least 3 places", outline.len()));
    }
    let what = match ExampleKind::try_from(example.kind) {
        Ok(ExampleKind::ExampleObstacle) => Experience::Bumped,
        Ok(ExampleKind::ExampleGround) => Experience::Driven,
        Err(_) => return Err(format!("kind is {}, expected 0 or 1", example.kind)),
    };
    let marked: u64 = maps.iter_mut().map(|map| map.mark(&outline, what, params.marked_gain, rules)).sum();
    if marked == 0 { Err("it lies outside of the map".to_owned()) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a vehicle of this width and height, m, teaches of: half the width of the ground, and the height, m.
    fn taught(width_m: f64, height_m: f64) -> [f64; 2] {
        let defaults: TerrainLearnerParams = rcs_msg::params::default();
        let params = TerrainLearnerParams { width_m, height_m, ..defaults };
        [half_width_m(&params), vehicle(Pose::IDENTITY, &params).height_m]
    }

    #[test]
    fn the_vehicle_teaches_of_its_own_width_and_height_within_margins() {
        assert_eq!(taught(0.66, 1.0), [0.3, 0.8], "exactly: the bundled vehicle");
        let [half_width_m, height_m] = taught(2.0, 2.6);
        assert!((half_width_m - 0.97).abs() < 1e-9 && (height_m - 2.08).abs() < 1e-9);
        assert_eq!(taught(0.05, 0.5), [0.0, 0.4]);
    }
}
