//! What the waypoint generator reads each cycle: the frames, its position, and the path of the planner of the far map.

use super::{Ports, WaypointGenerator};
use crate::grip::Gripped;
use crate::proto::WaypointGeneratorParams;
use crate::settings::FAR_TIMEOUT_S;
use crate::shortcut::{LONGEST_STEP_M, WayPoint};
use rcs_geom::DVec2;
use rcs_msg::Stamp;
use rcs_msg::foxglove::{FrameTransform, FrameTransforms, Odometry, PosesInFrame};
use rcs_runtime::Cycle;
use rcs_sense::pose_of;

/// Distance between the points of the track, m, and their greatest number; then the oldest ones are dropped.
const TRACK_STEP_M: f64 = 0.5;
const MOST_TRACK: usize = 20_000;

impl WaypointGenerator {
    /// The newest transform is used until there is another one: the frames drift slowly.
    pub(super) fn take_transforms(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        cx: &mut Cycle<'_>,
    ) {
        let mut at = self.global_from_local.map(|(_, at)| at);
        while let Some(message) = cx.read(&ports.transforms) {
            let (time, now) = (message.acq_time(), cx.now());
            let added = self.frames.add_transforms(&message, time, now);
            let placing = placing_local(&message, params);
            // After an error, those that place the local frame are added again alone: others may be wrong.
            let is_placed = !placing.transforms.is_empty()
                && (added.is_ok() || self.frames.add_transforms(&placing, time, now).is_ok());
            if is_placed {
                at = Some(time);
            }
            if let Err(error) = added {
                cx.fault(format!("transforms: {error}; skipped"));
            }
        }
        let (global, local) = (&params.global_frame, &params.local_frame);
        let mut placed = self.frames.lookup(global, local, cx.now(), f64::INFINITY);
        // After `INIT` no frame is known, and the local one may be sent only once. Of several messages, only the newest can
        // be read again. What is refused in it has been reported before.
        if placed.is_err()
            && let Some(message) = cx.latest(&ports.transforms)
        {
            let _ = self.frames.add_transforms(&message, message.acq_time(), cx.now());
            at = Some(message.acq_time());
            placed = self.frames.lookup(global, local, cx.now(), f64::INFINITY);
        }
        if let Ok(pose) = placed {
            self.global_from_local = Some((pose, at.unwrap_or(cx.now())));
        }
    }

    /// Reads the newest position in the global frame.
    pub(super) fn take_global(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        cx: &mut Cycle<'_>,
    ) {
        let Some(odometry) = cx.read_newest(&ports.global) else { return };
        match self.take_position(&odometry, &params.global_frame, cx.now()) {
            Ok(None) => {}
            Ok(Some(leap_m)) => cx.fault(format!(
                "the position in the local frame leapt by {leap_m:.1} m; the far path is forgotten, and the way before is not cut"
            )),
            Err(why) => cx.fault(format!("global: {why}; skipped")),
        }
    }

    /// Adds a position in the global frame to the track. Returns by how much the vehicle has leapt in the local frame, m, if
    /// that has begun again.
    fn take_position(
        &mut self,
        odometry: &Odometry,
        global_frame: &str,
        now: Stamp,
    ) -> Result<Option<f64>, String> {
        if odometry.frame_id != global_frame {
            return Err(format!("frame is {:?}, expected {global_frame:?}", odometry.frame_id));
        }
        self.error_m = position_error_m(odometry);
        let pose = pose_of(odometry.pose.as_ref(), &odometry.frame_id).map_err(|error| error.to_string())?;
        let at = pose.translation.truncate();
        self.yaw_rad = pose.yaw();
        self.position = Some((at.x, at.y));
        let local_from_global =
            self.global_from_local.map(|(global_from_local, _)| global_from_local.inverse());
        let local =
            local_from_global.map(|local_from_global| (local_from_global * at.extend(0.0)).truncate());
        let leap_m = local.and_then(|local| self.frame_watch.leap_m(local, now));
        if leap_m.is_some() {
            self.way.leave_frame();
            self.far_path.clear();
            self.gripped = Gripped::default();
        }
        let from_last_m = |track: &[(f64, f64)]| track.last().map(|&last| at.distance(DVec2::from(last)));
        if self.way.is_closed() && from_last_m(&self.track).is_some_and(|away_m| away_m > LONGEST_STEP_M) {
            // It did not drive here: another way begins.
            (self.track, self.way, self.began) = Default::default();
        }
        if from_last_m(&self.track).is_none_or(|step_m| step_m >= TRACK_STEP_M) {
            if self.track.len() >= MOST_TRACK {
                self.track.remove(0);
            }
            self.began.get_or_insert(now);
            self.track.push((at.x, at.y));
            if let Some(local) = local {
                self.way.add(WayPoint { local, global: at });
            }
        }
        Ok(leap_m)
    }

    /// Reads the path of the planner of the far map.
    pub(super) fn take_far_path(
        &mut self,
        ports: &Ports,
        params: &WaypointGeneratorParams,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        let Some(path) = cx.read_newest(&ports.far_path) else {
            if self.far_path_at.is_some_and(|at| now.seconds_since(at) > FAR_TIMEOUT_S) {
                self.far_path.clear();
            }
            return;
        };
        match points(&path, &params.local_frame) {
            Ok(points) => {
                self.far_path = points.iter().map(|point| (point.x, point.y)).collect();
                self.far_path_at = Some(now);
            }
            Err(why) => cx.fault(format!("far_path: {why}; skipped")),
        }
    }
}

/// What of a message says where the local frame is, and not only where the vehicle and its parts are.
fn placing_local(message: &FrameTransforms, params: &WaypointGeneratorParams) -> FrameTransforms {
    let places = |transform: &&FrameTransform| {
        let (parent, child) = (&transform.parent_frame_id, &transform.child_frame_id);
        *child == params.local_frame || (*parent == params.local_frame && *child == params.global_frame)
    };
    FrameTransforms { transforms: message.transforms.iter().filter(places).cloned().collect() }
}

/// Standard deviation of a position, m: the greater one of east and north. 0 without a covariance; infinite where a
/// variance is negative or no number, because then the position is not known.
fn position_error_m(odometry: &Odometry) -> f64 {
    let variance = |at: usize| odometry.pose_covariance.get(at).copied().unwrap_or(0.0);
    let deviation_m = |variance: f64| if variance >= 0.0 { variance.sqrt() } else { f64::INFINITY };
    deviation_m(variance(0)).max(deviation_m(variance(7)))
}

/// The points of a path in the local frame, m.
pub(super) fn points(path: &PosesInFrame, local_frame: &str) -> Result<Vec<DVec2>, String> {
    if path.frame_id != local_frame {
        return Err(format!("frame is {:?}, expected {local_frame:?}", path.frame_id));
    }
    let poses = path.poses.iter().map(|pose| pose_of(Some(pose), &path.frame_id));
    poses.map(|pose| Ok(pose.map_err(|error| error.to_string())?.translation.truncate())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_geom::Pose;
    use rcs_runtime::Process as _;
    use rcs_sense::pose_message;

    #[test]
    fn a_long_track_keeps_its_newest_points() {
        let mut generator = WaypointGenerator::default();
        for step in 0..=MOST_TRACK + 5 {
            let pose = Some(pose_message(&Pose::from_xy_yaw(step as f64, 0.0, 0.0)));
            let odometry = Odometry { frame_id: "global".to_owned(), pose, ..Odometry::default() };
            generator.take_position(&odometry, "global", Stamp(0)).unwrap_or_default();
        }
        assert_eq!((generator.track.len(), generator.track[0]), (MOST_TRACK, (6.0, 0.0)));
        assert_eq!(generator.track.last(), Some(&((MOST_TRACK + 5) as f64, 0.0)));
        let elsewhere = Odometry { frame_id: "local".to_owned(), ..Odometry::default() };
        let refused = generator.take_position(&elsewhere, "global", Stamp(0));
        assert_eq!(refused, Err("frame is \"local\", expected \"global\"".to_owned()));
    }

    #[test]
    fn where_the_local_frame_begins_again_the_far_path_is_forgotten_and_the_way_is_left() {
        let mut generator = WaypointGenerator {
            global_from_local: Some((Pose::IDENTITY, Stamp(0))),
            far_path: vec![(1.0, 0.0)],
            ..WaypointGenerator::default()
        };
        let take = |generator: &mut WaypointGenerator, x_m: f64, second: u64| {
            let pose = Some(pose_message(&Pose::from_xy_yaw(x_m, 0.0, 0.0)));
            let odometry = Odometry { frame_id: "global".to_owned(), pose, ..Odometry::default() };
            generator.take_position(&odometry, "global", Stamp(second * 1_000_000_000)).unwrap()
        };
        assert_eq!([take(&mut generator, 0.0, 0), take(&mut generator, 1.0, 1)], [None; 2]);
        assert!(generator.way.start().is_some());
        generator.global_from_local = Some((Pose::from_xy_yaw(100.0, 0.0, 0.0), Stamp(0)));
        let leap_m = take(&mut generator, 1.5, 2).unwrap();
        assert!((leap_m - 99.5).abs() < 1e-9, "{leap_m}");
        assert_eq!((generator.way.start(), generator.far_path.len()), (None, 0));
    }

    #[test]
    fn after_init_the_way_goes_on_where_the_vehicle_is_and_another_one_begins_where_it_was_carried_to() {
        let take = |generator: &mut WaypointGenerator, x_m: f64, second: u64| {
            let pose = Some(pose_message(&Pose::from_xy_yaw(x_m, 0.0, 0.0)));
            let odometry = Odometry { frame_id: "global".to_owned(), pose, ..Odometry::default() };
            generator.take_position(&odometry, "global", Stamp(second * 1_000_000_000)).unwrap();
        };
        let params = WaypointGeneratorParams::default();
        let frames = Some((Pose::IDENTITY, Stamp(0)));
        let mut stood = WaypointGenerator { global_from_local: frames, ..WaypointGenerator::default() };
        take(&mut stood, 0.0, 0);
        let mut drove = stood.clone();
        (1..8).for_each(|second| take(&mut drove, second as f64, second));
        for (before, x_m, points, has_start) in
            [(&stood, 0.0, 1, true), (&drove, 8.0, 9, false), (&drove, 60.0, 1, true)]
        {
            let mut renewed = before.renew(&params);
            renewed.global_from_local = frames;
            take(&mut renewed, x_m, 20);
            assert_eq!((renewed.track.len(), renewed.way.start().is_some()), (points, has_start), "{x_m}");
        }
    }
}
