//! Reads a CSV table of poses that were measured elsewhere: motion capture, another simulator.

use super::{RecordError, input};
use city3d_geometry::lab::Pose2;
use city3d_protocol::snapshot::VehicleId;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Error, ErrorKind, Read};
use std::path::Path;

/// A pose of one vehicle at one time. Laboratory metres, radians counter-clockwise from east.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordedPose {
    /// Time of the measurement, seconds on the clock of the file.
    pub time_s: f64,
    /// Middle of the outline.
    pub pose: Pose2,
}

/// Required columns of the table; others are ignored.
pub const POSE_COLUMNS: [&str; 5] = ["time", "id", "x", "y", "yaw"];
/// Larger numbers are errors.
const LARGEST_M: f64 = 1000.0;
const LARGEST_S: f64 = 1e12;

/// Largest table that is read.
const LARGEST_TABLE_BYTES: u64 = 1 << 30;
/// Most bytes from one row to the next.
const LARGEST_ROW_BYTES: usize = 1 << 20;
/// Most vehicles of a table.
const MOST_VEHICLES: usize = 10_000;

/// The poses of each vehicle in order of time; of equal times the last row wins.
///
/// # Errors
/// [`RecordError::Unreadable`] where the file cannot be read, [`RecordError::Poses`] with the line where a number is none.
pub fn read_poses(path: &Path) -> Result<BTreeMap<VehicleId, Vec<RecordedPose>>, RecordError> {
    let wrong = |line: u64, reason: String| RecordError::Poses { path: path.to_path_buf(), line, reason };
    let unreadable = |reason| RecordError::Unreadable { path: path.to_path_buf(), reason };
    let (file, size) = input::open(path).map_err(unreadable)?;
    if size > LARGEST_TABLE_BYTES {
        let most = LARGEST_TABLE_BYTES >> 20;
        return Err(wrong(1, format!("the table has {size} bytes; at most {most} MiB are read: split it")));
    }
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        // The CR of CRLF is trimmed; as a pair, line numbers would be one too high.
        .terminator(csv::Terminator::Any(b'\n'))
        .from_reader(RowLimiter { file: file.take(size), since_row: 0 });
    let headers = reader.headers().map_err(|error| wrong(1, error.to_string()))?.clone();
    let mut places = [0; POSE_COLUMNS.len()];
    for (place, column) in places.iter_mut().zip(POSE_COLUMNS) {
        let found = headers.iter().position(|header| header.eq_ignore_ascii_case(column));
        let needed =
            || format!("there is no column \"{column}\"; a header with {} is needed", POSE_COLUMNS.join(","));
        *place = found.ok_or_else(|| wrong(1, needed()))?;
    }
    let mut found: BTreeMap<VehicleId, Vec<RecordedPose>> = BTreeMap::new();
    let mut record = csv::StringRecord::new();
    loop {
        let from = reader.position().line();
        match reader.read_record(&mut record) {
            Ok(true) => reader.get_mut().since_row = 0,
            Ok(false) => break,
            Err(error) => {
                let line = error.position().map_or(from, csv::Position::line);
                return Err(wrong(line, error.to_string()));
            }
        }
        let line = record.position().map_or(from, csv::Position::line);
        let number = |index: usize, most: f64| {
            let text = record.get(places[index]).unwrap_or_default();
            let number = text.parse::<f64>().ok().filter(|number| number.abs() <= most);
            let column = POSE_COLUMNS[index];
            number.ok_or_else(|| {
                wrong(line, format!("{column} is \"{text}\"; a number between -{most} and {most} is needed"))
            })
        };
        let id = record.get(places[1]).unwrap_or_default();
        let id: u32 =
            id.parse().map_err(|_| wrong(line, format!("id is \"{id}\"; a whole number is needed")))?;
        let time_s = number(0, LARGEST_S)?;
        let pose = Pose2::new(number(2, LARGEST_M)?, number(3, LARGEST_M)?, number(4, LARGEST_M)?);
        found.entry(VehicleId(id)).or_default().push(RecordedPose { time_s, pose });
        if found.len() > MOST_VEHICLES {
            return Err(wrong(line, format!("more than {MOST_VEHICLES} vehicles; is id the right column?")));
        }
    }
    if found.is_empty() {
        return Err(wrong(1, "it has no poses".to_owned()));
    }
    Ok(found.into_iter().map(|(vehicle, poses)| (vehicle, in_order(poses))).collect())
}

/// Sorts by time; of equal times the last one wins.
pub(super) fn in_order(mut poses: Vec<RecordedPose>) -> Vec<RecordedPose> {
    poses.reverse();
    poses.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    poses.dedup_by(|later, kept| later.time_s == kept.time_s);
    poses
}

/// Reads a table, and refuses a row without an end before it fills the memory.
struct RowLimiter {
    file: std::io::Take<File>,
    /// Bytes that were read since the last row.
    since_row: usize,
}

impl Read for RowLimiter {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if self.since_row > LARGEST_ROW_BYTES {
            let most = LARGEST_ROW_BYTES >> 10;
            let why = format!("a row of more than {most} KiB; is a line end or a quotation mark missing?");
            return Err(Error::new(ErrorKind::InvalidData, why));
        }
        let read = self.file.read(buffer)?;
        self.since_row += read;
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<BTreeMap<VehicleId, Vec<RecordedPose>>, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read_poses(file.path()).map_err(|error| error.to_string())
    }

    #[test]
    fn tables_are_read_in_any_order_of_rows_and_columns() {
        let found =
            read("id, yaw, x, y, speed, time\n2,0,1,2,9,0.5\n# a note\n2,3,1.5,2,9,0.25\n7,0,0,0,9,1\n")
                .unwrap();
        let poses = &found[&VehicleId(2)];
        assert_eq!(poses.iter().map(|pose| pose.time_s).collect::<Vec<_>>(), [0.25, 0.5]);
        assert_eq!((poses[0].pose.position.x, poses[0].pose.yaw_rad, found.len()), (1.5, 3.0, 2));
        // The last row of a time counts.
        let twice = read("time,id,x,y,yaw\n1,1,5,0,0\n1,1,6,0,0\n").unwrap();
        assert_eq!(twice[&VehicleId(1)].iter().map(|pose| pose.pose.position.x).collect::<Vec<_>>(), [6.0]);
    }

    #[test]
    fn rows_without_an_end_and_vehicles_without_number_are_refused() {
        let good = "time,id,x,y,yaw\n0,1,0,0,0\n";
        for (rest, told) in [
            ("1".repeat(3 << 20), "line 3: a row of more than 1024 KiB"),
            (
                format!("1,1,0,0,\"0\n{}", "1,1,0,0,0\n".repeat(300_000)),
                "line 3: a row of more than 1024 KiB",
            ),
            (
                (0..=10_000).map(|id| format!("1,{id},0,0,0\n")).collect(),
                "line 10003: more than 10000 vehicles",
            ),
        ] {
            let said = read(&format!("{good}{rest}")).unwrap_err();
            assert!(said.contains(told), "{said}");
        }
        let said = read(&"x".repeat(3 << 20)).unwrap_err();
        assert!(said.contains("line 1: a row of more than 1024 KiB"), "{said}");
        let sparse = tempfile::NamedTempFile::new().unwrap();
        sparse.as_file().set_len(20 << 30).unwrap();
        let said = read_poses(sparse.path()).unwrap_err().to_string();
        assert!(said.contains("the table has 21474836480 bytes; at most 1024 MiB are read"), "{said}");
        // What lies between two rows is not one.
        let commented = format!("{good}{}1,1,0,0,0\n", "# a note\n".repeat(50_000));
        assert_eq!(read(&commented).unwrap()[&VehicleId(1)].len(), 2);
    }

    #[test]
    fn faults_are_told_with_their_line() {
        for (text, told) in [
            ("time,id,x,y\n", "no column \"yaw\""),
            ("time,id,x,y,yaw\n", "no poses"),
            ("time,id,x,y,yaw\n0,1,0,0,0\n1,1,nan,0,0\n", "line 3: x is \"nan\""),
            ("time,id,x,y,yaw\n0,a,0,0,0\n", "line 2: id is \"a\""),
            ("time,id,x,y,yaw\r\n0,1,0,0,0\r\n1,1,0,0,zero\r\n", "line 3: yaw is \"zero\""),
            ("time,id,x,y,yaw\n0,1,0\n", "line 2"),
        ] {
            let said = read(text).unwrap_err();
            assert!(said.contains(told), "{text}: {said}");
        }
    }
}
