//! The sensors of the vehicle: their last readings, taken each cycle and after `INIT`, and which of them are silent.

use super::{Ports, VehicleInterface};
use crate::proto::VehicleInterfaceParams;
use rcs_msg::foxglove::Odometry;
use rcs_msg::rcs::Imu;
use rcs_msg::{Payload, Stamp};
use rcs_runtime::{Cycle, In, Msg};
use rcs_sense::{FASTEST_RADPS, FASTEST_WHEEL_MPS, Repeats, pose_of, text_above};
use serde::{Deserialize, Serialize};

/// Speeds of wheels and turn rates older than this do not correct a turn, s.
pub(super) const SENSED_S: f64 = 0.2;

/// The last readings of the vehicle's sensors.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Sensed {
    /// When the first cycle was: a sensor that has not spoken yet is waited for since then.
    pub(super) since: Option<Stamp>,
    /// Speeds of the left and the right wheel, m/s, and when they came.
    wheels_mps: Option<([f64; 2], Stamp)>,
    /// Turn rate of the vehicle by the inertial sensor, rad/s, and when it came.
    yaw_rate_radps: Option<(f64, Stamp)>,
    /// Roll and pitch by the local estimate or the inertial sensor, rad, and their time.
    attitude_rad: Option<([f64; 2], Stamp)>,
    pub(super) left_a: f64,
    pub(super) right_a: f64,
    pub(super) bumper_left: bool,
    pub(super) bumper_right: bool,
    /// When the bumper spoke.
    bumper_at: Option<Stamp>,
    /// Of encoders, inertial sensor and bumper: one that repeats its last message is silent.
    repeats: [Repeats; 3],
}

impl Sensed {
    /// What a sensor said last, 0 before that; NaN where it is not wired, or has been silent for longer than the timeout, if
    /// there is one.
    fn known(&self, said: Option<(f64, Stamp)>, is_wired: bool, timeout_s: f64, now: Stamp) -> f64 {
        let (value, at) = said.unwrap_or((0.0, self.since.unwrap_or(now)));
        let is_silent = timeout_s > 0.0 && now.seconds_since(at) > timeout_s;
        if is_wired && !is_silent { value } else { f64::NAN }
    }

    /// Speeds of the wheels, m/s, and turn rate of the vehicle, rad/s; `None` where one of them is old.
    pub(super) fn turn(&self, now: Stamp) -> Option<([f64; 2], f64)> {
        let (wheels_mps, wheels_at) = self.wheels_mps?;
        let (yaw_rate_radps, turned_at) = self.yaw_rate_radps?;
        let is_new = |at: Stamp| now.seconds_since(at) <= SENSED_S;
        (is_new(wheels_at) && is_new(turned_at)).then_some((wheels_mps, yaw_rate_radps))
    }

    /// A sensor that has spoken and is silent now.
    pub(super) fn silent(&self, timeout_s: f64, now: Stamp) -> Option<String> {
        if timeout_s <= 0.0 {
            return None;
        }
        let spoke = [
            ("encoders", self.wheels_mps.map(|(_, at)| at)),
            ("imu", self.yaw_rate_radps.map(|(_, at)| at)),
            ("bumper", self.bumper_at),
        ];
        let silent_s = |at: Option<Stamp>| at.map_or(0.0, |at| now.seconds_since(at));
        let mut silent = spoke.into_iter().map(|(name, at)| (name, silent_s(at)));
        let (name, silent_s) = silent.find(|&(_, silent_s)| silent_s > timeout_s)?;
        let silent_s = text_above(silent_s, timeout_s);
        Some(format!("{name} silent for {silent_s} s, expected at most {timeout_s} s"))
    }
}

impl VehicleInterface {
    /// Speed of the vehicle by its wheels, m/s; NaN where no sensor tells it.
    pub(super) fn speed_mps(&self, ports: &Ports, params: &VehicleInterfaceParams, cx: &Cycle<'_>) -> f64 {
        let said = self.sensed.wheels_mps.map(|([left, right], at)| (f64::midpoint(left, right), at));
        self.sensed.known(said, cx.is_wired(&ports.encoders), params.sensor_timeout_s, cx.now())
    }

    /// Turn rate of the vehicle by the inertial sensor, rad/s; NaN where no sensor tells it.
    pub(super) fn yaw_rate_radps(
        &self,
        ports: &Ports,
        params: &VehicleInterfaceParams,
        cx: &Cycle<'_>,
    ) -> f64 {
        let said = self.sensed.yaw_rate_radps;
        self.sensed.known(said, cx.is_wired(&ports.imu), params.sensor_timeout_s, cx.now())
    }

    /// Roll and pitch of the vehicle, rad; NaN where neither the local estimate nor the inertial sensor tells them.
    pub(super) fn attitude_rad(
        &self,
        ports: &Ports,
        params: &VehicleInterfaceParams,
        cx: &Cycle<'_>,
    ) -> [f64; 2] {
        let is_wired = cx.is_wired(&ports.local) || cx.is_wired(&ports.imu);
        [0, 1].map(|axis| {
            let said = self.sensed.attitude_rad.map(|(angles_rad, at)| (angles_rad[axis], at));
            self.sensed.known(said, is_wired, params.sensor_timeout_s, cx.now())
        })
    }

    /// What the sensors last said before the state was created anew, as by `INIT`, at the times at which they said it: one
    /// that is silent since then is missed, and a pressed bumper holds.
    pub(super) fn remember(&mut self, ports: &Ports, cx: &Cycle<'_>) {
        if let Some(encoders) = cx.latest(&ports.encoders) {
            let (wheels_mps, at) = ([encoders.left_mps, encoders.right_mps], encoders.header().log_time);
            if wheels_mps.iter().all(|speed_mps| speed_mps.abs() <= FASTEST_WHEEL_MPS) {
                // Old speeds are not those of the vehicle now.
                let is_recent = cx.now().seconds_since(at) <= SENSED_S;
                self.sensed.wheels_mps = Some((if is_recent { wheels_mps } else { [0.0; 2] }, at));
            }
        }
        if let Some(imu) = cx.latest(&ports.imu)
            && let Some(rate) = imu.angular_velocity.as_ref().map(|rates| rates.z)
            && rate.abs() <= FASTEST_RADPS
        {
            self.sensed.yaw_rate_radps = Some((rate, imu.header().log_time));
        }
        if let Some(local) = cx.latest(&ports.local)
            && let Ok(pose) = pose_of(local.pose.as_ref(), &local.frame_id)
        {
            let [roll_rad, pitch_rad, _] = pose.rpy();
            self.sensed.attitude_rad = Some(([roll_rad, pitch_rad], local.acq_time_on_arrival()));
        }
        if let Some(bumper) = cx.latest(&ports.bumper) {
            (self.sensed.bumper_left, self.sensed.bumper_right) = (bumper.left, bumper.right);
            self.sensed.bumper_at = Some(bumper.header().log_time);
        }
    }

    /// Reads the sensors. Values that are not finite or absurd are faults, and the previous values are kept.
    pub(super) fn sense(&mut self, ports: &Ports, cx: &mut Cycle<'_>) {
        let [encoders_repeat, imu_repeats, bumper_repeats] = &mut self.sensed.repeats;
        let stated = |time: Option<&_>| time.and_then(Stamp::from_proto);
        let encoders =
            newest(&ports.encoders, encoders_repeat, |message| stated(message.timestamp.as_ref()), cx);
        let imu = newest(&ports.imu, imu_repeats, |message| stated(message.timestamp.as_ref()), cx);
        let bumper = newest(&ports.bumper, bumper_repeats, |message| stated(message.timestamp.as_ref()), cx);
        if let Some(encoders) = encoders {
            let wheels_mps = [encoders.left_mps, encoders.right_mps];
            if wheels_mps.iter().all(|speed_mps| speed_mps.abs() <= FASTEST_WHEEL_MPS) {
                self.sensed.wheels_mps = Some((wheels_mps, cx.now()));
            } else {
                cx.fault(format!(
                    "encoders: speeds are {} and {} m/s, expected at most {FASTEST_WHEEL_MPS} m/s; skipped",
                    encoders.left_mps, encoders.right_mps
                ));
            }
        }
        if let Some(odometry) = cx.read_newest(&ports.local) {
            match self.take_local(&odometry) {
                Ok(false) => {}
                Ok(true) => cx.fault("local: the clock of the poses has begun again"),
                Err(error) => cx.fault(format!("local: {error}; skipped")),
            }
        }
        if let Some(imu) = imu {
            self.take_imu(&imu, cx);
        }
        if let Some(motors) = cx.read_newest(&ports.motors) {
            if motors.left_a.is_finite() && motors.right_a.is_finite() {
                (self.sensed.left_a, self.sensed.right_a) = (motors.left_a, motors.right_a);
            } else {
                cx.fault(format!(
                    "motors: currents are {} and {} A, expected finite numbers; skipped",
                    motors.left_a, motors.right_a
                ));
            }
        }
        if let Some(bumper) = bumper {
            (self.sensed.bumper_left, self.sensed.bumper_right) = (bumper.left, bumper.right);
            self.sensed.bumper_at = Some(cx.now());
        }
    }

    /// Takes heading, roll and pitch of the local estimate. Returns whether its clock has begun again: its pose is taken, and
    /// is as old as it says.
    fn take_local(&mut self, odometry: &Msg<Odometry>) -> Result<bool, String> {
        let pose = pose_of(odometry.pose.as_ref(), &odometry.frame_id).map_err(|error| error.to_string())?;
        let time = odometry.acq_time_on_arrival();
        let newest = self.yaw.map(|(_, newest)| newest);
        let begins_again = self.local_clock.begins_again(newest, time);
        if let Some(before) = newest.filter(|&before| before > time && !begins_again) {
            return Err(format!("pose is {:.3} s older than the one before", before.seconds_since(time)));
        }
        self.yaw = Some((pose.yaw(), time));
        let [roll_rad, pitch_rad, _] = pose.rpy();
        self.sensed.attitude_rad = Some(([roll_rad, pitch_rad], time));
        Ok(begins_again)
    }

    /// Roll and pitch come from the local estimate while there is one: it separates acceleration from gravity.
    fn take_imu(&mut self, imu: &Imu, cx: &mut Cycle<'_>) {
        if let Some(rate) = imu.angular_velocity.as_ref().map(|rates| rates.z) {
            if rate.abs() <= FASTEST_RADPS {
                self.sensed.yaw_rate_radps = Some((rate, cx.now()));
            } else {
                cx.fault(format!(
                    "imu: turn rate is {rate} rad/s, expected at most {FASTEST_RADPS} rad/s; skipped"
                ));
            }
        }
        let is_estimated = self.yaw.is_some_and(|(_, at)| cx.now().seconds_since(at) <= SENSED_S);
        if let Some(q) = imu.orientation.as_ref().filter(|_| !is_estimated) {
            match rcs_geom::Pose::from_parts([0.0; 3], [q.x, q.y, q.z, q.w]) {
                Ok(pose) => {
                    let [roll_rad, pitch_rad, _] = pose.rpy();
                    self.sensed.attitude_rad = Some(([roll_rad, pitch_rad], cx.now()));
                }
                Err(error) => cx.fault(format!("imu: {error}; skipped")),
            }
        }
    }
}

/// The newest message since the cycle before, unless it repeats the one before it, by the time that it states.
fn newest<T: Payload>(
    port: &In<T>,
    repeats: &mut Repeats,
    stated: impl Fn(&T) -> Option<Stamp>,
    cx: &mut Cycle<'_>,
) -> Option<Msg<T>> {
    cx.read_newest(port).filter(|message| !repeats.take(stated(message)))
}
