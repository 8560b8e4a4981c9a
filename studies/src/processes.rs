//! What the operating system says of a process: time on cores, memory.

use std::fs;

/// Seconds on a core since the process started, its threads together; `None` where it is gone or nothing tells.
pub(crate) fn cpu_secs(pid: u32) -> Option<f64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name may hold spaces; what follows its bracket does not.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |field: usize| fields.get(field)?.parse::<f64>().ok();
    // User and system time, fields 14 and 15 counted from 1, in hundredths of a second on every Linux there is.
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

/// Bytes of memory that are resident; `None` where the process is gone or nothing tells.
pub(crate) fn resident_bytes(pid: u32) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Files that a process has open, connections among them; `None` where it is gone or nothing tells.
pub(crate) fn open_files(pid: u32) -> Option<usize> {
    Some(fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count())
}

/// Files that this process and those that it starts may have open, once it has asked for as many as it may ask for.
pub(crate) fn most_open_files() -> usize {
    use rustix::process::{Resource, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    // Whoever may not raise it keeps what there is.
    let _ = setrlimit(Resource::Nofile, rustix::process::Rlimit { current: limit.maximum, ..limit });
    // Without a limit, more than there are ports.
    getrlimit(Resource::Nofile).current.map_or(1 << 20, |most| most.try_into().unwrap_or(usize::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_takes_time_and_memory_and_one_that_is_not_there_neither() {
        let me = std::process::id();
        let before = cpu_secs(me).unwrap();
        let begin = std::time::Instant::now();
        while begin.elapsed().as_millis() < 60 {}
        assert!(cpu_secs(me).unwrap() > before);
        assert!(resident_bytes(me).unwrap() > 1 << 20);
        assert_eq!((cpu_secs(u32::MAX), resident_bytes(u32::MAX)), (None, None));
    }

    #[test]
    fn a_file_that_is_opened_counts() {
        let me = std::process::id();
        assert!(most_open_files() >= 64);
        // Tests beside this one open files, too.
        let before = open_files(me).unwrap();
        let many: Vec<fs::File> = (0..50).map(|_| fs::File::open("/dev/null").unwrap()).collect();
        let after = open_files(me).unwrap();
        assert!(after + 10 >= before + many.len(), "{before} {after}");
        assert_eq!(open_files(u32::MAX), None);
    }
}
