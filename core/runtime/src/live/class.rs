//! Scheduling of a live run's threads by the operating system: the best that it permits; never an error.

use crate::stack::Class;
use std::io;
use thread_priority::{ThreadPriority, ThreadPriorityValue, set_current_thread_priority};

/// Gives the calling thread the priority of its class.
///
/// `Realtime` is `SCHED_FIFO` if the system permits it. The other classes lower their own priority, which every system
/// permits, so that the order of the classes also holds where real-time scheduling is refused.
pub(crate) fn apply(class: Class, thread: &str) {
    let result = match class {
        Class::Realtime => realtime(),
        // Nice values 5 and 15 on Linux.
        Class::Normal => lower(37),
        Class::Background => lower(12),
    };
    if let Err(error) = result {
        tracing::warn!("{thread} runs without the priority of class {}: {error}", class.name());
    }
}

/// Lowers the priority of the calling thread below that of a window and of live processes, for work in the background;
/// threads that it starts inherit it.
pub fn lower_priority() {
    let name = std::thread::current().name().unwrap_or("a thread").to_owned();
    apply(Class::Background, &name);
}

fn lower(priority: u8) -> io::Result<()> {
    let value = ThreadPriorityValue::try_from(priority).map_err(io::Error::other)?;
    set_current_thread_priority(ThreadPriority::Crossplatform(value)).map_err(told)
}

#[cfg(unix)]
fn realtime() -> io::Result<()> {
    use thread_priority::unix::{
        RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
    };
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Min, policy).map_err(told)
}

#[cfg(not(unix))]
fn realtime() -> io::Result<()> {
    set_current_thread_priority(ThreadPriority::Max).map_err(told)
}

fn told(error: thread_priority::Error) -> io::Error {
    match error {
        thread_priority::Error::OS(code) => io::Error::from_raw_os_error(code),
        other => io::Error::other(format!("{other:?}")),
    }
}
