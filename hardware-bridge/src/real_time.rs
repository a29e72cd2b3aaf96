//! Real-time priority: first-in-first-out scheduling of a thread.

use thread_priority::unix::{
    RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
};
use thread_priority::{ThreadPriority, ThreadPriorityValue};

/// Priority, of 1 to 99: above usual threads, below the kernel's own.
const PRIORITY: u8 = 40;

/// Commands that permit real-time priority to the users of the group `dialout`, from the next login on.
pub const PERMIT_COMMANDS: [&str; 2] =
    ["echo '@dialout - rtprio 50' | sudo tee /etc/security/limits.d/ftac.conf", "sudo usermod -a -G dialout $USER"];

/// Gives real-time priority to this thread and to those that it starts from now on. The error is the reason why that is
/// not permitted.
pub fn set_real_time_priority() -> Result<(), String> {
    let priority = ThreadPriorityValue::try_from(PRIORITY)?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(priority), policy)
        .map_err(|error| error.to_string())
}
