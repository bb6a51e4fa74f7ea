//! Work on several processors, with results that do not depend on how many there are: each item is worked on by one thread
//! alone, with what the others read unchanged meanwhile.
//!
//! A step of control or physics takes a fraction of a millisecond, and to wake a sleeping thread takes a twentieth of one. So
//! threads that are [at hand](Workers::at_hand) spin between the parts of a step that are shared out, and sleep between steps.

mod prefetch;

pub use prefetch::{prefetch, prefetch_at, prefetch_slice};

use rayon::{ThreadPool, ThreadPoolBuilder, Yield};
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Threads that share out the work of a step. A copy shares them.
///
/// ```
/// use city3d_workers::Workers;
/// use std::num::NonZeroUsize;
///
/// let workers = Workers::new(NonZeroUsize::new(4).unwrap());
/// let mut squares: Vec<u64> = (0..1000).collect();
/// workers.at_hand(squares.len(), || workers.each(&mut squares, |_, number| *number *= *number));
/// assert_eq!(squares[999], 998_001);
/// ```
#[derive(Clone, Debug, Default)]
pub struct Workers {
    /// `None` where the caller works alone.
    others: Option<Arc<Others>>,
}

/// The threads beside the caller's.
#[derive(Debug)]
struct Others {
    count: usize,
    /// Made when first needed.
    pool: OnceLock<Option<ThreadPool>>,
    /// So many are at hand.
    ready: AtomicUsize,
}

/// Least and most items that one thread takes at a time: few, so that all end together, and many, so that most are asked for
/// before their turn.
const GROUP: [usize; 2] = [16, 64];
/// Groups where there are enough items for them.
const GROUPS: usize = 32;
/// With fewer items for each thread, waking it costs more than it saves.
const LEAST_SHARE: usize = 128;

/// Groups of neighbours into which so many items are shared out; a thread takes one at a time.
pub fn group_count(items: usize) -> usize {
    items.div_ceil(group_size(items))
}

fn group_size(items: usize) -> usize {
    let [least, most] = GROUP;
    (items / GROUPS).clamp(least, most)
}

impl Workers {
    /// The caller's thread alone.
    pub fn alone() -> Self {
        Self::default()
    }

    /// So many threads, the caller's among them.
    pub fn new(threads: NonZeroUsize) -> Self {
        let others = |count| Arc::new(Others { count, pool: OnceLock::new(), ready: AtomicUsize::new(0) });
        Self { others: (threads.get() > 1).then(|| others(threads.get() - 1)) }
    }

    /// A thread for each processor that the process may run on.
    pub fn of_machine() -> Self {
        Self::new(std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN))
    }

    /// Threads, the caller's among them.
    pub fn count(&self) -> usize {
        1 + self.others.as_ref().map_or(0, |others| others.count)
    }

    /// Keeps threads ready during a step in which work on about `items` things is shared out several times; with few of them, or
    /// on a system that gives no threads, the caller works alone.
    pub fn at_hand<R>(&self, items: usize, step: impl FnOnce() -> R) -> R {
        let Some(others) = &self.others else { return step() };
        let wanted = others.count.min((items / LEAST_SHARE).saturating_sub(1));
        if wanted == 0 || others.ready.load(Ordering::Relaxed) > 0 {
            return step();
        }
        let Some(pool) = others.pool() else { return step() };
        let (is_over, at_work) = (AtomicBool::new(false), AtWork::default());
        others.ready.store(wanted, Ordering::Relaxed);
        pool.in_place_scope(|scope| {
            for _ in 0..wanted {
                scope.spawn(|_| {
                    at_work.during(|| {
                        while !is_over.load(Ordering::Acquire) {
                            if rayon::yield_now() != Some(Yield::Executed) {
                                std::hint::spin_loop();
                            }
                        }
                    });
                });
            }
            let result = {
                // Also when the step panics.
                let _over = Over { is_over: &is_over, ready: &others.ready };
                step()
            };
            at_work.await_end();
            result
        })
    }

    /// Calls `work` with the index and the item, for each item, in any order.
    pub fn each<T: Send>(&self, items: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
        self.each_with(items, || (), |(), index, item| work(index, item));
    }

    /// [`Self::each`] with buffers of its own for each thread, which `buffers` makes.
    pub fn each_with<T: Send, B>(
        &self,
        items: &mut [T],
        buffers: impl Fn() -> B + Sync,
        work: impl Fn(&mut B, usize, &mut T) + Sync,
    ) {
        let size = group_size(items.len());
        self.share(items.chunks_mut(size).enumerate(), buffers, |buffers, (job, items)| {
            items.iter_mut().enumerate().for_each(|(k, item)| work(buffers, job * size + k, item));
        });
    }

    /// Calls `work` with the index of the first item of a group, its items, which follow one another, and what there is for this
    /// group; for all of the [`group_count`] groups, in any order.
    ///
    /// # Panics
    /// With another number of groups.
    pub fn each_group<T: Send, G: Send>(
        &self,
        items: &mut [T],
        groups: &mut [G],
        work: impl Fn(usize, &mut [T], &mut G) + Sync,
    ) {
        assert_eq!(group_count(items.len()), groups.len(), "each group has its own");
        let size = group_size(items.len());
        let jobs = items.chunks_mut(size).zip(groups).enumerate();
        self.share(jobs, || (), |(), (job, (items, group))| work(job * size, items, group));
    }

    /// [`Self::each_group`] of two lists of the same length.
    ///
    /// # Panics
    /// With lists of different lengths.
    pub fn each_group_of_two<A: Send, B: Send>(
        &self,
        (first, second): (&mut [A], &mut [B]),
        work: impl Fn(&mut [A], &mut [B]) + Sync,
    ) {
        assert_eq!(first.len(), second.len(), "each item has its partner");
        let size = group_size(first.len());
        let jobs = first.chunks_mut(size).zip(second.chunks_mut(size));
        self.share(jobs, || (), |(), (first, second)| work(first, second));
    }

    /// [`Self::each_group`] of three lists of the same length.
    ///
    /// # Panics
    /// With lists of different lengths.
    pub fn each_group_of_three<A: Send, B: Send, C: Send>(
        &self,
        (first, second, third): (&mut [A], &mut [B], &mut [C]),
        work: impl Fn(usize, &mut [A], &mut [B], &mut [C]) + Sync,
    ) {
        assert_eq!([first.len(); 2], [second.len(), third.len()], "each item has its partners");
        let size = group_size(first.len());
        let groups = first.chunks_mut(size).zip(second.chunks_mut(size)).zip(third.chunks_mut(size));
        self.share(
            groups.enumerate(),
            || (),
            |(), (group, ((first, second), third))| {
                work(group * size, first, second, third);
            },
        );
    }

    /// Does two things at once, where a thread is [at hand](Self::at_hand), else one after the other.
    pub fn both<A, B: Send>(&self, one: impl FnOnce() -> A, other: impl FnOnce() -> B + Send) -> (A, B) {
        let Some((pool, _)) = self.ready() else { return (one(), other()) };
        let (at_work, mut done) = (AtWork::default(), None);
        let first = pool.in_place_scope(|scope| {
            let done = &mut done;
            let at_work = &at_work;
            scope.spawn(move |_| at_work.during(|| *done = Some(other())));
            let first = one();
            at_work.await_end();
            first
        });
        (first, done.expect("the scope ends after both"))
    }

    /// The threads at hand and how many they are; `None` where there are none.
    fn ready(&self) -> Option<(&ThreadPool, usize)> {
        let others = self.others.as_ref()?;
        let ready = others.ready.load(Ordering::Relaxed);
        if ready == 0 { None } else { others.pool().map(|pool| (pool, ready)) }
    }

    /// The caller takes jobs from the front, the others from the back: in the next part of a step each finds most of what it
    /// had in its cache.
    fn share<I: DoubleEndedIterator + ExactSizeIterator + Send, B>(
        &self,
        jobs: I,
        buffers: impl Fn() -> B + Sync,
        work: impl Fn(&mut B, I::Item) + Sync,
    ) {
        let mut own = buffers();
        let Some((pool, ready)) = self.ready() else { return jobs.for_each(|job| work(&mut own, job)) };
        let (jobs, at_work) = (Mutex::new(jobs), AtWork::default());
        pool.in_place_scope(|scope| {
            for _ in 0..ready {
                scope.spawn(|_| {
                    at_work.during(|| {
                        let mut own = buffers();
                        while let Some(job) = taken(&jobs, DoubleEndedIterator::next_back) {
                            work(&mut own, job);
                        }
                    });
                });
            }
            while let Some(job) = taken(&jobs, Iterator::next) {
                work(&mut own, job);
            }
            at_work.await_end();
        });
    }
}

/// Ends the spinning of threads at hand.
struct Over<'s> {
    is_over: &'s AtomicBool,
    ready: &'s AtomicUsize,
}

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.ready.store(0, Ordering::Relaxed);
        self.is_over.store(true, Ordering::Release);
    }
}

impl Others {
    /// `None` where the system gives no threads.
    fn pool(&self) -> Option<&ThreadPool> {
        let build = || {
            ThreadPoolBuilder::new().num_threads(self.count).thread_name(|k| format!("worker {k}")).build()
        };
        self.pool.get_or_init(|| build().ok()).as_ref()
    }
}

/// Takes a job; the lock is free again while it is worked on.
fn taken<I: Iterator>(jobs: &Mutex<I>, take: impl FnOnce(&mut I) -> Option<I::Item>) -> Option<I::Item> {
    // No job runs under the lock, so none can have panicked there.
    take(&mut jobs.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Threads that have begun on a part of the work, so that the caller can spin for their last moments in place of sleeping.
#[derive(Debug, Default)]
struct AtWork(AtomicUsize);

/// About ten microseconds.
const SPINS: u32 = 2000;

impl AtWork {
    fn during(&self, work: impl FnOnce()) {
        self.0.fetch_add(1, Ordering::Relaxed);
        work();
        self.0.fetch_sub(1, Ordering::Release);
    }

    fn await_end(&self) {
        for _ in 0..SPINS {
            if self.0.load(Ordering::Acquire) == 0 {
                return;
            }
            std::hint::spin_loop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::thread::ThreadId;

    fn workers(threads: usize) -> Workers {
        Workers::new(NonZeroUsize::new(threads).unwrap())
    }

    #[test]
    fn every_item_is_worked_on_once_whatever_the_number_of_threads() {
        for threads in [1, 2, 3, 8] {
            let [least, most] = GROUP;
            for count in [0, 1, least, 2 * least + 1, 1000, GROUPS * most + 1] {
                let workers = workers(threads);
                let mut items = vec![0; count];
                let mut partners: Vec<usize> = (0..count).collect();
                let mut thirds = partners.clone();
                workers.at_hand(count, || {
                    workers.each(&mut items, |index, item| *item += index);
                    let mut sums = vec![0; group_count(count)];
                    workers.each_group(&mut items, &mut sums, |first, items, sum| {
                        assert_eq!(items[0], first);
                        *sum = items.iter().sum::<usize>();
                    });
                    assert_eq!(sums.iter().sum::<usize>(), (0..count).sum());
                    workers.each_group_of_two((&mut items, &mut partners), |items, partners| {
                        assert_eq!(items, partners);
                    });
                    workers.each_group_of_three(
                        (&mut items, &mut partners, &mut thirds),
                        |first, items, partners, thirds| {
                            for (k, item) in items.iter().enumerate() {
                                assert_eq!(
                                    (*item, partners[k], thirds[k]),
                                    (first + k, first + k, first + k)
                                );
                                partners[k] += *item + thirds[k];
                            }
                        },
                    );
                });
                assert!(partners.iter().enumerate().all(|(index, partner)| *partner == 3 * index));
            }
        }
    }

    #[test]
    fn threads_at_hand_share_the_work_and_go_to_sleep_after_it() {
        let workers = workers(2);
        let mut seen = BTreeSet::new();
        let name = |id: ThreadId| format!("{id:?}");
        // To wake a thread takes longer than a short step: these take a millisecond.
        let busy = || (0..1000).fold(1_u64, |value, k| std::hint::black_box(value.wrapping_mul(k | 1)));
        for _ in 0..1000 {
            let mut by = vec![None; 1000];
            workers.at_hand(by.len(), || {
                workers.each(&mut by, |_, by| {
                    *by = (busy() != 0).then(|| std::thread::current().id());
                });
            });
            seen.extend(by.into_iter().flatten().map(name));
            if seen.len() == 2 {
                break;
            }
        }
        assert_eq!(seen.len(), 2, "{seen:?}");
        assert_eq!(workers.others.as_ref().unwrap().ready.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn two_things_are_both_done_whatever_the_number_of_threads() {
        for threads in [1, 2, 3] {
            let workers = workers(threads);
            let mut sum = 0;
            let both = workers.at_hand(1000, || {
                workers.both(|| sum += 1, || std::thread::current().name().map(str::to_owned))
            });
            assert_eq!((sum, both.0), (1, ()));
            let is_on_worker = both.1.is_some_and(|name| name.starts_with("worker"));
            assert_eq!(is_on_worker, threads > 1);
        }
    }

    #[test]
    fn few_items_start_no_thread() {
        let workers = workers(4);
        let mut items = vec![0; LEAST_SHARE];
        workers.at_hand(items.len(), || workers.each(&mut items, |_, item| *item = 1));
        assert!(workers.others.as_ref().unwrap().pool.get().is_none_or(|pool| pool.is_none()));
    }

    #[test]
    fn a_job_that_panics_ends_the_step_and_the_next_one_goes_on() {
        let workers = workers(2);
        let mut items = vec![0; 1000];
        let step = || {
            workers.at_hand(1000, || {
                workers.each(&mut items, |index, _| assert_ne!(index, 999, "as asked for"));
            });
        };
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(step)).is_err());
        let mut items = vec![0; 1000];
        workers.at_hand(1000, || workers.each(&mut items, |_, item| *item = 1));
        assert!(items.iter().all(|item| *item == 1));
    }
}
