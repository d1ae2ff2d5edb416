//! The path of the planner of the larger map, which says where the planner of the near map plans to.
//!
//! What is sensed at one moment may close a way for a moment. A path that leads back is therefore followed only when the
//! planner has held to it for [`TURN_BACK_S`]: in a narrow passage the vehicle does not turn again once it has turned.

use crate::waypoints::nearest;
use rcs_geom::DVec2;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// Time for which the planner must hold to a path that leads back, s.
const TURN_BACK_S: f64 = 2.0;
/// Length of path that tells where it leads, m.
const LEADS_M: f64 = 4.0;

/// The path that is followed.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct FarPath {
    /// Local frame, m.
    points: Vec<DVec2>,
    /// When the planner began to send paths that lead back.
    leads_back_since: Option<Stamp>,
}

impl FarPath {
    /// Takes a path of the planner; `vehicle` is the position of the vehicle, local frame, m.
    pub fn take(&mut self, path: Vec<DVec2>, vehicle: Option<DVec2>, now: Stamp) {
        let leads_back = vehicle.is_some_and(|vehicle| {
            let leads = |path: &[DVec2]| ahead(path, vehicle, LEADS_M).map(|to| to - vehicle);
            leads(&self.points).zip(leads(&path)).is_some_and(|(before, now)| before.dot(now) < 0.0)
        });
        let since = self.leads_back_since.filter(|_| leads_back).unwrap_or(now);
        self.leads_back_since = leads_back.then_some(since);
        if !leads_back || now.seconds_since(since) >= TURN_BACK_S {
            self.points = path;
            self.leads_back_since = None;
        }
    }

    /// The point that lies a distance along the path from the vehicle, m; `None` where the path is shorter.
    pub fn ahead(&self, vehicle: DVec2, distance_m: f64) -> Option<DVec2> {
        ahead(&self.points, vehicle, distance_m)
    }
}

/// The first point of a path that lies a distance along it from a position, which may lie beside it, m.
fn ahead(path: &[DVec2], from: DVec2, distance_m: f64) -> Option<DVec2> {
    let nearest = nearest(path, from)?;
    let mut along_m = path[nearest].distance(from);
    path[nearest..].windows(2).find_map(|pair| {
        along_m += pair[0].distance(pair[1]);
        (along_m >= distance_m).then_some(pair[1])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(to: f64) -> Vec<DVec2> {
        (0..=20).map(|at| DVec2::new(to * f64::from(at) / 20.0, 0.0)).collect()
    }

    #[test]
    fn a_path_that_leads_back_is_followed_when_the_planner_holds_to_it() {
        let mut path = FarPath::default();
        let here = Some(DVec2::ZERO);
        let at = |seconds: f64| Stamp((seconds * 1e9) as u64);
        let leads_to = |path: &FarPath| path.ahead(DVec2::ZERO, 8.0).map(|to| to.x);
        path.take(line(10.0), here, at(1.0));
        assert_eq!(leads_to(&path), Some(8.0));
        // For a moment.
        path.take(line(-10.0), here, at(1.2));
        path.take(line(10.0), here, at(1.4));
        path.take(line(-20.0), here, at(3.0));
        path.take(line(-20.0), here, at(4.8));
        assert_eq!(leads_to(&path), Some(8.0));
        path.take(line(-20.0), here, at(5.0));
        assert_eq!(leads_to(&path), Some(-8.0));
        // One that turns less is followed at once, and so is none.
        path.take(line(-10.0).iter().map(|at| DVec2::new(at.x, -at.x)).collect(), here, at(5.2));
        assert_eq!(path.ahead(DVec2::ZERO, 8.0).map(|to| to.y), Some(6.0));
        path.take(Vec::new(), here, at(5.4));
        assert_eq!(path.ahead(DVec2::ZERO, 8.0), None);
    }
}
