//! Cycle and splits of a fixed-time signal for least delay (Webster 1958, "Traffic signal settings", Road Research
//! Technical Paper 39).

/// Bounds of the cycle, and what is lost of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WebsterLimits {
    /// Time of the cycle in which no phase is served: the yellow and all-red times of all phases.
    pub lost_s: f64,
    /// No phase has a shorter green.
    pub min_green_s: f64,
    /// Longest cycle; demand at or beyond capacity gets it.
    pub max_cycle_s: f64,
}

/// Green times of a cycle.
#[derive(Clone, Debug, PartialEq)]
pub struct WebsterTiming {
    /// Green times and lost time together.
    pub cycle_s: f64,
    /// One for each phase.
    pub green_s: Vec<f64>,
}

/// Webster's cycle `C0 = (1.5 L + 5) / (1 - Y)` and splits `g_i = (y_i / Y) (C0 - L)`, where `L` is the lost time,
/// `y_i` the critical flow of phase `i` over its saturation flow, and `Y` their sum.
///
/// Without bounds in effect it is the formula:
///
/// ```
/// use city3d_control::{WebsterLimits, webster};
///
/// let limits = WebsterLimits { lost_s: 16.0, min_green_s: 1.0, max_cycle_s: 200.0 };
/// let timing = webster(limits, &[0.3, 0.2]);
/// assert!((timing.cycle_s - 58.0).abs() < 1e-9);
/// assert!((timing.green_s[0] - 25.2).abs() < 1e-9);
/// ```
pub fn webster(limits: WebsterLimits, flow_ratios: &[f64]) -> WebsterTiming {
    let WebsterLimits { lost_s, min_green_s, max_cycle_s } = limits;
    let total: f64 = flow_ratios.iter().sum();
    let optimal_s = if total < 1.0 { (1.5 * lost_s + 5.0) / (1.0 - total) } else { f64::INFINITY };
    let for_green_s = (optimal_s.min(max_cycle_s) - lost_s).max(0.0);
    let share = |ratio: f64| {
        if total > 0.0 { ratio / total } else { 1.0 / flow_ratios.len() as f64 }
    };
    let green_s: Vec<f64> =
        flow_ratios.iter().map(|&ratio| (share(ratio) * for_green_s).max(min_green_s)).collect();
    WebsterTiming { cycle_s: lost_s + green_s.iter().sum::<f64>(), green_s }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cycle_of(lost_s: f64, ratios: &[f64]) -> f64 {
        webster(WebsterLimits { lost_s, min_green_s: 0.0, max_cycle_s: 1000.0 }, ratios).cycle_s
    }

    /// Two conflicting lanes that share a total flow; saturation flow in vehicles an hour.
    fn two_lanes(total_veh_h: f64, saturation_veh_h: f64) -> f64 {
        cycle_of(8.0, &[total_veh_h / 2.0 / saturation_veh_h; 2])
    }

    #[test]
    fn cycles_are_those_of_the_formula() {
        for (found, published) in [
            (cycle_of(16.0, &[0.25, 0.25]), 58.0),
            (cycle_of(12.0, &[0.4, 0.3]), 76.7),
            (two_lanes(600.0, 1800.0), 25.5),
            (two_lanes(1200.0, 1800.0), 51.0),
            (two_lanes(1600.0, 1800.0), 153.0),
            (two_lanes(600.0, 1500.0), 28.3),
            (two_lanes(1200.0, 1500.0), 85.0),
            // Four lanes in two phases: each phase has a quarter of the total in either lane.
            (cycle_of(8.0, &[300.0 / 1800.0; 2]), 25.5),
            (cycle_of(8.0, &[450.0 / 1800.0; 2]), 34.0),
        ] {
            assert!((found - published).abs() < 0.05, "{found} {published}");
        }
    }

    #[test]
    fn greens_share_what_is_left_of_the_cycle_by_flow() {
        let limits = WebsterLimits { lost_s: 12.0, min_green_s: 1.0, max_cycle_s: 200.0 };
        let timing = webster(limits, &[0.4, 0.3]);
        let left_s = 23.0 / 0.3 - 12.0;
        assert!((timing.green_s[0] - left_s * 4.0 / 7.0).abs() < 1e-9, "{timing:?}");
        assert!((timing.green_s[1] - left_s * 3.0 / 7.0).abs() < 1e-9, "{timing:?}");
        assert!((timing.cycle_s - 23.0 / 0.3).abs() < 1e-9);
    }

    #[test]
    fn demand_beyond_capacity_gets_the_longest_cycle_and_no_demand_the_shortest_greens() {
        let limits = WebsterLimits { lost_s: 8.0, min_green_s: 4.0, max_cycle_s: 120.0 };
        let over = webster(limits, &[0.6, 0.6]);
        assert_eq!((over.cycle_s, &over.green_s[..]), (120.0, &[56.0, 56.0][..]));
        assert_eq!(webster(limits, &[0.0, 0.0]).green_s, [4.5, 4.5]);
        // A phase with little flow keeps its shortest green, beside the others' shares.
        let uneven = webster(limits, &[0.5, 0.01]);
        assert_eq!(uneven.green_s[1], 4.0);
        assert!((uneven.cycle_s - uneven.green_s[0] - 12.0).abs() < 1e-9);
    }
}
