//! Reads a process's CPU time, memory and open files from `/proc`.

use std::fs;

/// CPU seconds of a process and all its threads since it started; `None` if it is gone or `/proc` is missing.
pub(crate) fn cpu_secs(pid: u32) -> Option<f64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name may contain spaces; fields after its closing bracket do not.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |field: usize| fields.get(field)?.parse::<f64>().ok();
    // User and system time, fields 14 and 15 counted from 1, in hundredths of a second on every Linux.
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

/// Resident memory in bytes; `None` if the process is gone or `/proc` is missing.
pub(crate) fn resident_bytes(pid: u32) -> Option<u64> {
    kib_of(&pid.to_string(), "VmRSS:")
}

/// Largest resident memory of this process in bytes since it started or [`reset_peak`]; `None` if `/proc` is missing.
pub(crate) fn peak_bytes() -> Option<u64> {
    kib_of("self", "VmHWM:")
}

/// Makes the largest resident memory of this process that of now. Without permission it stays as it is.
pub(crate) fn reset_peak() {
    // See proc_pid_clear_refs(5).
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// A field of a process's status that is in KiB, in bytes.
fn kib_of(process: &str, field: &str) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(field))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Number of open files and connections of a process; `None` if it is gone or `/proc` is missing.
pub(crate) fn open_files(pid: u32) -> Option<usize> {
    Some(fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count())
}

/// Raises this process's limit of open files as far as allowed, for its children too. Returns the limit.
pub(crate) fn most_open_files() -> usize {
    use rustix::process::{Resource, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    // Without permission the limit stays as it is.
    let _ = setrlimit(Resource::Nofile, rustix::process::Rlimit { current: limit.maximum, ..limit });
    // Unlimited: more than there are ports.
    getrlimit(Resource::Nofile).current.map_or(1 << 20, |most| most.try_into().unwrap_or(usize::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_has_cpu_time_and_memory_and_a_missing_one_has_neither() {
        let me = std::process::id();
        let before = cpu_secs(me).unwrap();
        let begin = std::time::Instant::now();
        while begin.elapsed().as_millis() < 60 {}
        assert!(cpu_secs(me).unwrap() > before);
        assert!(resident_bytes(me).unwrap() > 1 << 20);
        assert_eq!((cpu_secs(u32::MAX), resident_bytes(u32::MAX)), (None, None));
    }

    #[test]
    fn the_peak_counts_memory_that_was_given_back() {
        let before = peak_bytes().unwrap();
        let size = before as usize + (64 << 20);
        drop(std::hint::black_box(vec![1u8; size]));
        assert!(peak_bytes().unwrap() >= size as u64);
    }

    #[test]
    fn an_opened_file_is_counted() {
        let me = std::process::id();
        assert!(most_open_files() >= 64);
        // Other tests of this process open files too.
        let before = open_files(me).unwrap();
        let many: Vec<fs::File> = (0..50).map(|_| fs::File::open("/dev/null").unwrap()).collect();
        let after = open_files(me).unwrap();
        assert!(after + 10 >= before + many.len(), "{before} {after}");
        assert_eq!(open_files(u32::MAX), None);
    }
}
