//! The table `[platoon]` of a scenario.

use super::fields::TableFields;
use city3d_control::coordination::platoon::PlatoonParams;

/// Reads `[platoon]`; missing fields keep their defaults. Without the table no platoons are formed.
pub fn read_platoons(root: &TableFields<'_, '_>) -> Option<PlatoonParams> {
    let fields = root.table("platoon")?;
    let mut params = PlatoonParams::default();
    if let Some(most) = fields.integer("max_vehicles", 1..=100) {
        params.max_vehicles = most as usize;
    }
    fields.number("max_gap_m", 0.05..=10.0, &mut params.max_gap_m);
    fields.number("catch_up_distance_m", 0.0..=10.0, &mut params.catch_up_distance_m);
    fields.number("catch_up_speed_factor", 1.0..=2.0, &mut params.catch_up_speed_factor);
    fields.number("split_time_s", 0.0..=60.0, &mut params.split_time_s);
    fields.number("spacing_m", 0.05..=10.0, &mut params.spacing_m);
    fields.number("headway_s", 0.1..=10.0, &mut params.headway_s);
    fields.finish();
    Some(params)
}
