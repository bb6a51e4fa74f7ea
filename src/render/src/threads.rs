//! Number of threads of Mesa's software adapter (llvmpipe, lavapipe), set by CPU affinity. The adapter takes one thread
//! per processor that the process may run on when the instance is made (or `LP_NUM_THREADS`), and none if that is one.

/// Most devices opened on one adapter: each holds a copy of the scene.
const MAX_ADAPTERS: usize = 8;

fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Number of llvmpipe threads of this process.
pub(super) fn llvmpipe_threads() -> usize {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return 0 };
    let names = tasks.flatten().filter_map(|task| std::fs::read_to_string(task.path().join("comm")).ok());
    names.filter(|name| name.starts_with("llvmpipe-")).count()
}

/// Number of devices to open on a software adapter so that they share the processors. `before` is the number of
/// llvmpipe threads before the first device was opened.
pub(super) fn adapter_count(before: usize) -> usize {
    let threads_each = llvmpipe_threads().saturating_sub(before);
    if cfg!(target_os = "linux") { devices_that_fit(processors(), threads_each) } else { 1 }
}

fn devices_that_fit(processors: usize, threads_each: usize) -> usize {
    (processors / threads_each.max(1)).clamp(1, MAX_ADAPTERS)
}

/// Runs `make`, which makes an instance, while the affinity of the first thread allows few processors.
#[cfg(target_os = "linux")]
pub(super) fn with_few_threads<T: Send>(make: impl FnOnce() -> T + Send) -> T {
    use nix::sched::{sched_getaffinity, sched_setaffinity};
    use nix::unistd::Pid;
    // Mesa counts the processors of the process's first thread. A second thread makes the instance, so that threads of
    // other drivers do not inherit the narrow affinity.
    let all_of_first = || {
        let first = Pid::this();
        let all = sched_getaffinity(first).ok();
        let few = all.as_ref().and_then(|all| first_cpus(all, processors().div_ceil(MAX_ADAPTERS)));
        let is_kept = few.is_some_and(|few| sched_setaffinity(first, &few).is_ok());
        let made = make();
        if let Some(all) = all.filter(|_| is_kept)
            && let Err(error) = sched_setaffinity(first, &all)
        {
            tracing::warn!("the first thread stays on few processors: {error}");
        }
        made
    };
    std::thread::scope(|scope| match scope.spawn(all_of_first).join() {
        Ok(made) => made,
        Err(panic) => std::panic::resume_unwind(panic),
    })
}

/// The first `count` processors of a set.
#[cfg(target_os = "linux")]
fn first_cpus(all: &nix::sched::CpuSet, count: usize) -> Option<nix::sched::CpuSet> {
    let mut few = nix::sched::CpuSet::new();
    let members = (0..nix::sched::CpuSet::count()).filter(|&cpu| all.is_set(cpu) == Ok(true));
    members.take(count).try_for_each(|cpu| few.set(cpu)).ok()?;
    Some(few)
}

#[cfg(not(target_os = "linux"))]
pub(super) fn with_few_threads<T: Send>(make: impl FnOnce() -> T + Send) -> T {
    make()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adapters_share_the_processors() {
        assert_eq!(devices_that_fit(2, 0), 2);
        assert_eq!(devices_that_fit(2, 2), 1);
        assert_eq!(devices_that_fit(16, 2), 8);
        assert_eq!(devices_that_fit(64, 1), MAX_ADAPTERS);
        assert_eq!(devices_that_fit(1, 4), 1);
    }
}
