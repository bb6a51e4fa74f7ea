//! A link that delivers each item at its own time.

/// Items on their way, delivered in order of arrival time; equal times keep the order of sending.
#[derive(Clone, Debug)]
pub struct Channel<T> {
    on_the_way: Vec<(f64, T)>,
}

impl<T> Default for Channel<T> {
    fn default() -> Self {
        Self { on_the_way: Vec::new() }
    }
}

/// Arrival times are sums of tick times and delays; this much rounding is not a tick's delay.
const ROUNDING_S: f64 = 1e-9;

impl<T> Channel<T> {
    /// Sends an item that arrives at `at_s`.
    pub fn send(&mut self, at_s: f64, item: T) {
        let place = self.on_the_way.partition_point(|(other_s, _)| *other_s <= at_s);
        self.on_the_way.insert(place, (at_s, item));
    }

    /// Moves everything that has arrived by `now_s` to the end of `arrived`.
    pub fn receive(&mut self, now_s: f64, arrived: &mut Vec<T>) {
        let count = self.on_the_way.partition_point(|(at_s, _)| *at_s <= now_s + ROUNDING_S);
        arrived.extend(self.on_the_way.drain(..count).map(|(_, item)| item));
    }
}
