//! Running ahead of other programs: first-in-first-out scheduling of a thread.

use thread_priority::unix::{
    RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
};
use thread_priority::{ThreadPriority, ThreadPriorityValue};

/// Above usual threads, below the kernel's own, of 1 to 99.
const PRIORITY: u8 = 40;

/// What permits it to the users of the group `dialout`, from the next login on.
pub const PERMIT: [&str; 2] =
    ["echo '@dialout - rtprio 50' | sudo tee /etc/security/limits.d/ftac.conf", "sudo usermod -a -G dialout $USER"];

/// Lets this thread, and those that it starts from now on, run whenever they have something to do; why that is not permitted, if so.
pub fn run_ahead() -> Result<(), String> {
    let priority = ThreadPriorityValue::try_from(PRIORITY)?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(priority), policy)
        .map_err(|error| error.to_string())
}
