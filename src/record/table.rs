//! `vehicles.csv`: one row for each vehicle and sample.

use crate::snapshot::FrameSnapshot;
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
            let status = v.status.label();
            // Writing to a string cannot fail.
            let _ = writeln!(
                self.row,
                "{:.3},{},{},{},{status},{:.4},{:.4},{:.4},{yaw:.5},{:.4},{:.4},{:.5},{:.4},{:.4},{:.4},{:.4},{:.3}",
                snapshot.time_s,
                snapshot.tick,
                v.id,
                info.name,
                p.x,
                p.y,
                p.z,
                v.speed_mps,
                v.acceleration_mps2,
                v.steering_rad,
                v.gas,
                v.brake,
                v.handbrake,
                v.lateral_error_m,
                v.distance_m,
            );
        }
        self.sink.write_all(self.row.as_bytes())
    }

    /// # Errors
    /// When the rows so far cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }

    /// # Errors
    /// When the last rows cannot be written.
    pub fn finish(mut self) -> io::Result<()> {
        self.sink.flush()
    }
}
