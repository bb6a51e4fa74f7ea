//! `vehicles.csv`: one row for each vehicle and sample.

use city3d_geometry::trig;
use city3d_protocol::snapshot::FrameSnapshot;
use std::fmt::Write as _;
use std::io::{self, Write};

/// Columns of the table: seconds, full-scale metres, radians.
pub const COLUMNS: [&str; 17] = [
    "t",
    "tick",
    "id",
    "name",
    "status",
    "x",
    "y",
    "z",
    "yaw",
    "speed",
    "acceleration",
    "steering",
    "gas",
    "brake",
    "handbrake",
    "lateral_error",
    "distance",
];

/// Writes the table row by row.
#[derive(Debug)]
pub struct VehicleTable<W: Write> {
    sink: W,
    row: String,
}

impl<W: Write> VehicleTable<W> {
    /// Begins the table with its header.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn new(mut sink: W) -> io::Result<Self> {
        writeln!(sink, "{}", COLUMNS.join(","))?;
        Ok(Self { sink, row: String::new() })
    }

    /// Adds a row for each vehicle. Names need no quotes: scenarios allow letters, digits and
    /// underscores in them.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn rows(&mut self, snapshot: &FrameSnapshot) -> io::Result<()> {
        self.row.clear();
        for (v, info) in snapshot.iter() {
            let (p, yaw) = (v.position, v.pose().yaw_rad);
            let row = &mut self.row;
            fixed(row, snapshot.time_s, 3);
            let (tick, id, name, status) = (snapshot.tick, v.id, &info.name, v.status.label());
            let has_control = info.has_control_data();
            // Writing to a string cannot fail.
            let _ = write!(row, ",{tick},{id},{name},{status}");
            for (number, decimals, is_known) in [
                (p.x, 4, true),
                (p.y, 4, true),
                (p.z, 4, true),
                (yaw, 5, true),
                (v.speed_mps, 4, true),
                (v.acceleration_mps2, 4, true),
                (v.steering_rad, 5, has_control),
                (v.gas, 4, has_control),
                (v.brake, 4, has_control),
                (v.handbrake, 4, has_control),
                (v.lateral_error_m, 4, has_control && v.tracked_lateral_error_m().is_some()),
                (v.distance_m, 3, true),
            ] {
                row.push(',');
                if is_known {
                    fixed(row, number, decimals);
                }
            }
            row.push('\n');
        }
        self.sink.write_all(self.row.as_bytes())
    }

    /// Writes out the rows so far.
    ///
    /// # Errors
    /// When the rows so far cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }

    /// Writes out the last rows.
    ///
    /// # Errors
    /// When the last rows cannot be written.
    pub fn finish(mut self) -> io::Result<()> {
        self.sink.flush()
    }
}

/// Appends a fixed-point number with so many decimals. Faster than `{:.N}`, which was a tenth of the writer's work;
/// only the last digit of ties differs.
fn fixed(row: &mut String, number: f64, decimals: usize) {
    const EXACT: f64 = 1e15;
    let scaled = (number.abs() * trig::powi(10.0, decimals as u32)).round_ties_even();
    if scaled.is_nan() || scaled >= EXACT {
        let _ = write!(row, "{number:.decimals$}");
        return;
    }
    let (mut digits, mut rest, mut start) = ([b'0'; 17], scaled as u64, 17);
    while rest > 0 || start + decimals > 16 {
        start -= 1;
        digits[start] = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    let digits = digits[start..].iter().map(|&digit| char::from(digit));
    let whole = 17 - start - decimals;
    if number.is_sign_negative() {
        row.push('-');
    }
    row.extend(digits.clone().take(whole));
    row.push('.');
    row.extend(digits.skip(whole));
}

#[cfg(test)]
mod tests {
    use super::fixed;

    #[test]
    fn numbers_are_written_as_the_standard_library_does() {
        let mut numbers: Vec<f64> =
            (-4000..4000).map(|k| f64::from(k) * std::f64::consts::PI / 300.0).collect();
        numbers.extend([0.0, -0.0, 0.000_04, -0.000_049, 0.999_96, 9.999_99, 1e10, 1e14, -3e200]);
        numbers.extend([f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MIN_POSITIVE]);
        for number in numbers {
            for decimals in [3, 4, 5] {
                let mut row = "before,".to_owned();
                fixed(&mut row, number, decimals);
                assert_eq!(row, format!("before,{number:.decimals$}"));
            }
        }
    }
}
