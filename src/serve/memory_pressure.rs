//! Whether the process is about to run out of memory: a job that runs then may be the one that ends the server.

use std::fs;
use std::path::Path;

/// Fraction of the available memory above which it is scarce.
const SCARCE_FRACTION: f64 = 0.7;

/// Whether the process uses most of the available memory, bytes; false where this cannot be found out.
pub fn is_memory_scarce(available: u64) -> bool {
    resident_bytes().is_some_and(|used| used as f64 > SCARCE_FRACTION * available as f64)
}

/// Resident memory of the process, bytes.
fn resident_bytes() -> Option<u64> {
    status_kilobytes(&fs::read_to_string("/proc/self/status").ok()?, "VmRSS:")
}

/// Memory of the machine, or of the control group if it has less, bytes; `None` where this cannot be found out.
pub fn available_bytes() -> Option<u64> {
    let machine =
        fs::read_to_string("/proc/meminfo").ok().and_then(|text| status_kilobytes(&text, "MemTotal:"));
    [machine, control_group_bytes()].into_iter().flatten().min()
}

/// `memory.max` of the process's control group (version 2) and of those around it, the least.
fn control_group_bytes() -> Option<u64> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    let own = groups.lines().find_map(|line| line.strip_prefix("0::/"))?.to_string();
    let root = Path::new("/sys/fs/cgroup");
    let limit = |group: &Path| fs::read_to_string(group.join("memory.max")).ok()?.trim().parse::<u64>().ok();
    root.join(own).ancestors().take_while(|group| group.starts_with(root)).filter_map(limit).min()
}

fn status_kilobytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    Some(1024 * line.split_whitespace().next()?.parse::<u64>().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_memory_of_the_process() {
        assert_eq!(status_kilobytes("VmPeak:\t 9 kB\nVmRSS:\t 7 kB\n", "VmRSS:"), Some(7168));
        assert_eq!(status_kilobytes("", "VmRSS:"), None);
        if cfg!(target_os = "linux") {
            let (used, available) = (resident_bytes().unwrap(), available_bytes().unwrap());
            assert!(used > 0 && used < available);
            assert!(is_memory_scarce(used) && !is_memory_scarce(2 * used));
        }
    }
}
