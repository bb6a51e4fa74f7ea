//! Software prefetching: of thousands of vehicles the caches of a processor hold few, and the time of a step is that of
//! reading memory. What a vehicle needs is asked for some vehicles before its turn, and arrives while those are worked on. It
//! changes no result.

/// Bytes that a processor reads at once.
const LINE_BYTES: usize = 64;

/// Asks for a value, without what it points to.
pub fn prefetch<T>(value: &T) {
    prefetch_slice(std::slice::from_ref(value));
}

/// Asks for values that follow one another in memory.
pub fn prefetch_slice<T>(values: &[T]) {
    let first = values.as_ptr().cast::<u8>();
    let bytes = first.addr() % LINE_BYTES + size_of_val(values);
    for line in 0..bytes.div_ceil(LINE_BYTES) {
        branches::prefetch_read_data::<u8, 0>(first.wrapping_add(line * LINE_BYTES));
    }
}

/// Asks for the value at a place, where there is one.
pub fn prefetch_at<T>(values: &[T], place: usize) {
    values.get(place).into_iter().for_each(prefetch);
}
