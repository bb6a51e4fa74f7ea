//! Closed forms of queueing theory, which a scheduler is measured against.

/// Mean waiting time in the queue M/D/1: Poisson arrivals, one server, constant service time (Pollaczek and
/// Khinchine; Kleinrock 1975, Queueing Systems 1, section 5.6). `None` where the queue grows without bound.
///
/// A conflict point that admits one vehicle every `service_s` is such a server, as long as vehicles are points and
/// arrive independently.
///
/// ```
/// use city3d_control::coordination::queueing::mean_wait_md1;
///
/// // 1200 vehicles an hour in gaps of 1.5 s.
/// let wait_s = mean_wait_md1(1200.0 / 3600.0, 1.5).unwrap();
/// assert!((wait_s - 0.75).abs() < 1e-12);
/// assert_eq!(mean_wait_md1(2400.0 / 3600.0, 1.5), None);
/// ```
pub fn mean_wait_md1(arrivals_per_s: f64, service_s: f64) -> Option<f64> {
    let utilisation = arrivals_per_s * service_s;
    (0.0..1.0).contains(&utilisation).then(|| utilisation * service_s / (2.0 * (1.0 - utilisation)))
}

#[cfg(test)]
#[path = "queueing_tests.rs"]
mod server;

#[cfg(test)]
mod tests {
    use super::*;

    /// The waits of the queue itself, one after the other (Lindley 1952): W' = max(0, W + service - gap).
    #[test]
    fn the_closed_form_is_the_mean_of_the_queue() {
        for (per_hour, expected_s) in [(600.0, 0.25), (1200.0, 0.75), (1800.0, 2.25)] {
            let (rate_per_s, service_s) = (per_hour / 3600.0, 1.5);
            let closed_s = mean_wait_md1(rate_per_s, service_s).unwrap();
            assert!((closed_s - expected_s).abs() < 1e-12, "{per_hour}: {closed_s}");
            // Multiplicative congruential draws of L'Ecuyer 1988.
            let mut state = 12_345_u64;
            let (mut wait_s, mut sum_s, vehicles) = (0.0_f64, 0.0, 1_000_000);
            for _ in 0..vehicles {
                sum_s += wait_s;
                state = state * 40_692 % 2_147_483_399;
                let share = state as f64 / 2_147_483_399.0;
                #[allow(clippy::disallowed_methods, reason = "a test's draw, which no state depends on")]
                let gap_s = -share.ln() / rate_per_s;
                wait_s = (wait_s + service_s - gap_s).max(0.0);
            }
            let mean_s = sum_s / f64::from(vehicles);
            assert!((mean_s / closed_s - 1.0).abs() < 0.02, "{per_hour}: {mean_s} for {closed_s}");
        }
    }
}
