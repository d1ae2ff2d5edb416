//! The four inputs from which a process can learn the pose of its vehicle.

use crate::clock::ClockWatch;
use crate::localizer::{FrameNames, Localizer, LocalizerError};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{FrameTransforms, Odometry, PoseInFrame};
use rcs_runtime::{Cycle, In, PortBuilder};

/// The optional inputs `odometry`, `pose`, `transforms` and `static_transforms`; a stack wires those that its robot
/// has.
#[derive(Debug)]
pub struct PosePorts {
    odometry: In<Odometry>,
    pose: In<PoseInFrame>,
    transforms: In<FrameTransforms>,
    static_transforms: In<FrameTransforms>,
}

impl PosePorts {
    /// Declares the four ports, in this order.
    pub fn declare(builder: &mut PortBuilder) -> Self {
        Self {
            odometry: builder.optional_input("odometry", "pose of the vehicle in the local frame"),
            pose: builder.optional_input(
                "pose",
                "pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame",
            ),
            transforms: builder.optional_input("transforms", "transforms between frames at their times"),
            static_transforms: builder
                .optional_input("static_transforms", "transforms that hold at all times"),
        }
    }

    /// Adds all unread messages to the localizer. A refused message is a fault of the process, and is skipped.
    ///
    /// Returns whether the clock of the vehicle's poses has begun again: the newest one is far behind the newest one before
    /// ([`ClockWatch::is_far_behind`]). The poses of the old clock are forgotten then, from the third one of the new clock
    /// on.
    pub fn read(&self, localizer: &mut Localizer, names: FrameNames<'_>, cx: &mut Cycle<'_>) -> bool {
        let now = cx.now();
        let source = localizer.source(names);
        // Poses from the future are forgotten when others come: that is no other clock.
        let before = localizer.newest_until(names.local, source, now);
        while let Some(message) = cx.read(&self.static_transforms) {
            report(cx, localizer.add_static_transforms(&message));
        }
        // After `INIT` the localizer is empty, and static transforms may be sent only once. Of several messages of a process,
        // only the newest can be read again; that of a log has all of them. What is refused in it has been reported before.
        if localizer.is_empty()
            && let Some(message) = cx.latest(&self.static_transforms)
        {
            let _ = localizer.add_static_transforms(&message);
        }
        while let Some(message) = cx.read(&self.transforms) {
            report(cx, localizer.add_transforms(&message, message.acq_time(), now));
        }
        while let Some(message) = cx.read(&self.odometry) {
            report(cx, localizer.add_odometry(&message, message.acq_time(), names, now));
        }
        while let Some(message) = cx.read(&self.pose) {
            report(cx, localizer.add_pose(&message, message.acq_time(), now));
        }
        let newest = localizer.newest_until(names.local, source, Stamp(u64::MAX));
        before.zip(newest).is_some_and(|(before, newest)| ClockWatch::is_far_behind(before, newest))
    }
}

fn report(cx: &mut Cycle<'_>, result: Result<(), LocalizerError>) {
    if let Err(error) = result {
        cx.fault(format!("{error}; skipped"));
    }
}
