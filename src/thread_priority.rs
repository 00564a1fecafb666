//! Priority of threads: long computations leave the processor to threads that answer requests.

use std::cell::Cell;

/// Nice value of threads that compute (0 is normal, 19 the lowest priority).
#[cfg(target_os = "linux")]
const COMPUTING_NICE: i32 = 10;

thread_local! {
    static LOWERED: Cell<bool> = const { Cell::new(false) };
}

/// Lowers the priority of this thread for good. Nothing happens on other platforms than Linux, where threads have none of their
/// own, or if the system refuses.
pub fn lower() {
    if LOWERED.replace(true) {
        return;
    }
    #[cfg(target_os = "linux")]
    let _ = rustix::process::setpriority_process(Some(rustix::thread::gettid()), COMPUTING_NICE);
}
