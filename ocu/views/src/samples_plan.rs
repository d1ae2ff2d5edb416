//! A plan and a choice of arcs, for the tests of the views.

use rcs_geom::Pose;
use rcs_msg::foxglove;
use rcs_msg::rcs::scored_arc::Motion;
use rcs_msg::rcs::{ArcChoice, Plan, PlanCandidate, PlanState, PlanStep, PlanTerms, ScoredArc};

/// A path to the east, and a rejected one that bends to the north.
pub(crate) fn plan() -> Plan {
    let (chosen, rejected) = (candidate(0.0, 8.0), candidate(4.0, 20.0));
    Plan {
        frame_id: "local".into(),
        reason: "the other way costs 216 more: clearance +216".into(),
        chosen: Some(chosen),
        rejected: Some(rejected),
        state: PlanState::PlanPath.into(),
        ..Plan::default()
    }
}

fn candidate(bend_m: f64, clearance: f32) -> PlanCandidate {
    let mut path = PlanCandidate::default();
    let mut sum = PlanTerms::default();
    for at in 0..60_u8 {
        let part = f64::from(at) / 59.0;
        let (x_m, y_m) = ((12.0 * part - 3.0) as f32, (bend_m * (part * 3.1).sin() - 1.0) as f32);
        let near = 1.0 - part as f32;
        let terms = PlanTerms {
            terrain: if (20..40).contains(&at) { 18.0 } else { 10.0 },
            clearance: if at % 20 < 6 { clearance } else { 0.0 },
            heading: -3.0 * near,
            ..PlanTerms::default()
        };
        sum.terrain += terms.terrain;
        sum.clearance += terms.clearance;
        sum.heading += terms.heading;
        path.cost += f64::from(terms.terrain + terms.clearance + terms.heading);
        if let Some(before) = path.steps.last() {
            path.length_m += f64::from(x_m - before.x_m).hypot(f64::from(y_m - before.y_m));
        }
        path.steps.push(PlanStep { x_m, y_m, cost: path.cost as f32, terms: Some(terms) });
    }
    path.terms = Some(sum);
    path
}

/// Seven arcs ahead, of which two are blocked, and both turns on the spot.
pub(crate) fn arcs() -> ArcChoice {
    let forward = |at: i8| ScoredArc {
        motion: Motion::Forward.into(),
        curvature_per_m: f32::from(at) * 0.25,
        free_m: if at <= -2 { 0.4 } else { 3.0 },
        goal: f32::from(at.abs()) * 0.2,
        heading: f32::from(at.abs()) * 0.15,
        cost: 0.4,
        turn: f32::from(at.abs()) * 0.05,
        change: 0.1,
        short: if at <= -2 { 3.0 } else { 0.0 },
        total: 0.5 + f32::from(at.abs()) * 0.4 + if at <= -2 { 3.0 } else { 0.0 },
        open: at > -2,
    };
    let turn = |motion: Motion| ScoredArc {
        motion: motion.into(),
        goal: 3.0,
        turn: 1.2,
        total: 4.2,
        open: true,
        ..ScoredArc::default()
    };
    let mut arcs: Vec<ScoredArc> = (-3..=3).map(forward).collect();
    arcs.extend([turn(Motion::TurnLeft), turn(Motion::TurnRight)]);
    let start = Pose::from_xy_yaw(-3.0, -1.0, 0.1);
    let position = foxglove::Vector3 { x: start.translation.x, y: start.translation.y, z: 0.0 };
    let q = start.rotation;
    let orientation = foxglove::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w };
    ArcChoice {
        frame_id: "local".into(),
        target_y_m: -1.0,
        arcs,
        chosen: Some(3),
        speed_mps: 0.8,
        start: Some(foxglove::Pose { position: Some(position), orientation: Some(orientation) }),
        ..ArcChoice::default()
    }
}
