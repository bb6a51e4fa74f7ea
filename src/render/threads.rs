//! How many threads Mesa's software adapter draws with. It takes one for each processor that the process may run on
//! when its instance is made (or as many as `LP_NUM_THREADS` says), and none of its own where that is a single one.

/// Adapters that are opened at the most: each holds the scene.
const MOST_ADAPTERS: usize = 8;

fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Drawing threads of all software adapters of this process.
pub(super) fn of_adapters() -> usize {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return 0 };
    let names = tasks.flatten().filter_map(|task| std::fs::read_to_string(task.path().join("comm")).ok());
    names.filter(|name| name.starts_with("llvmpipe-")).count()
}

/// How many of an adapter that was just opened have room side by side; there were so many drawing threads before.
pub(super) fn adapters_at_once(before: usize) -> usize {
    let threads_each = of_adapters().saturating_sub(before);
    if cfg!(target_os = "linux") { at_once(processors(), threads_each) } else { 1 }
}

fn at_once(processors: usize, threads_each: usize) -> usize {
    (processors / threads_each.max(1)).clamp(1, MOST_ADAPTERS)
}

/// Makes an instance whose software adapter takes few threads.
#[cfg(target_os = "linux")]
pub(super) fn with_few<T: Send>(make: impl FnOnce() -> T + Send) -> T {
    use nix::sched::{sched_getaffinity, sched_setaffinity};
    use nix::unistd::Pid;
    // Mesa counts the processors of the process's first thread. Drivers that start threads while an instance is made
    // shall not have them kept to a few: they are made by a thread that is not.
    let all_of_first = || {
        let first = Pid::this();
        let all = sched_getaffinity(first).ok();
        let few = all.as_ref().and_then(|all| few_of(all, processors().div_ceil(MOST_ADAPTERS)));
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

/// The first processors of a set.
#[cfg(target_os = "linux")]
fn few_of(all: &nix::sched::CpuSet, count: usize) -> Option<nix::sched::CpuSet> {
    let mut few = nix::sched::CpuSet::new();
    let members = (0..nix::sched::CpuSet::count()).filter(|&cpu| all.is_set(cpu) == Ok(true));
    members.take(count).try_for_each(|cpu| few.set(cpu)).ok()?;
    Some(few)
}

#[cfg(not(target_os = "linux"))]
pub(super) fn with_few<T: Send>(make: impl FnOnce() -> T + Send) -> T {
    make()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adapters_share_the_processors() {
        assert_eq!(at_once(2, 0), 2);
        assert_eq!(at_once(2, 2), 1);
        assert_eq!(at_once(16, 2), 8);
        assert_eq!(at_once(64, 1), MOST_ADAPTERS);
        assert_eq!(at_once(1, 4), 1);
    }
}
