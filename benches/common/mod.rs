//! What benches share.

use city3d_workers::Workers;

/// So many threads as `THREADS=N` in the environment says; all processors otherwise.
pub fn workers() -> Workers {
    let threads = std::env::var("THREADS").map(|threads| threads.parse().expect("a number of threads"));
    threads.map_or_else(|_| Workers::of_machine(), Workers::new)
}
