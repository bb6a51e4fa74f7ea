//! Poses as a laboratory records them: noisy, with gaps, stamps that jitter and outliers; as a table and as a bag of ROS 1.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// A pose of a vehicle, laboratory metres.
#[derive(Clone)]
pub struct Pose {
    pub time_s: f64,
    pub id: u32,
    pub name: String,
    pub x_m: f64,
    pub y_m: f64,
    pub yaw_rad: f64,
}

/// How poses are recorded.
#[derive(Clone, Copy, Default)]
pub struct Recording {
    /// Of the 200 poses a second.
    pub hz: usize,
    pub noise_mm: f64,
    pub yaw_noise_rad: f64,
    /// A stamp is up to so much off when its pose was measured.
    pub jitter_s: f64,
    /// Vehicles are hidden now and then for 0.2 to 0.5 s.
    pub has_gaps: bool,
    /// One in so many poses is 0.3 m and 2 rad off; none for 0.
    pub outliers: usize,
}

/// SplitMix64.
struct Draws(u64);

impl Draws {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

impl Recording {
    /// What it makes of poses that were taken 200 times a second.
    pub fn of(&self, poses: &[Pose]) -> Vec<Pose> {
        let mut draws = Draws(21);
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        let mut hidden: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
        let mut found = Vec::new();
        for pose in poses {
            let count = counts.entry(pose.id).or_default();
            *count += 1;
            if !(*count - 1).is_multiple_of(200 / self.hz) {
                continue;
            }
            let (from_s, to_s) = hidden.entry(pose.id).or_insert((1.0 + 4.0 * draws.uniform(), 0.0));
            if *to_s <= *from_s {
                *to_s = *from_s + 0.2 + 0.3 * draws.uniform();
            }
            if self.has_gaps && (*from_s..*to_s).contains(&pose.time_s) {
                continue;
            }
            if pose.time_s >= *to_s {
                *from_s = pose.time_s + 2.0 + 4.0 * draws.uniform();
            }
            let is_outlier = self.outliers > 0 && *count % self.outliers == self.outliers / 2 + 1;
            let off_m = if is_outlier { 0.3 } else { 0.0 };
            let noise_m = self.noise_mm / 1000.0;
            found.push(Pose {
                time_s: pose.time_s + self.jitter_s * (2.0 * draws.uniform() - 1.0),
                x_m: pose.x_m + off_m + noise_m * draws.normal(),
                y_m: pose.y_m + noise_m * draws.normal(),
                yaw_rad: pose.yaw_rad + 7.0 * off_m + self.yaw_noise_rad * draws.normal(),
                ..pose.clone()
            });
        }
        found
    }
}

/// Writes a table of poses.
pub fn table(path: &Path, poses: &[Pose]) {
    let mut text = "time,id,x,y,yaw\n".to_owned();
    for Pose { time_s, id, x_m, y_m, yaw_rad, .. } in poses {
        writeln!(text, "{time_s},{id},{x_m},{y_m},{yaw_rad}").unwrap();
    }
    std::fs::write(path, text).unwrap();
}

fn part(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat()
}

fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let field = |(name, value): &(&str, &[u8])| part(&[name.as_bytes(), b"=", value].concat());
    let header: Vec<u8> = fields.iter().flat_map(field).collect();
    [part(&header), part(data)].concat()
}

/// Writes a bag of ROS 1 with `geometry_msgs/TransformStamped`, as VICON's bridge publishes them.
pub fn bag(path: &Path, poses: &[Pose]) {
    const EPOCH_S: f64 = 1.7e9;
    let names: BTreeMap<u32, &str> = poses.iter().map(|pose| (pose.id, pose.name.as_str())).collect();
    let mut chunk = Vec::new();
    for (id, name) in &names {
        let topic = format!("/vicon/{name}/{name}");
        let told = [part(b"type=geometry_msgs/TransformStamped"), part(format!("topic={topic}").as_bytes())];
        let fields = [("op", &[7][..]), ("conn", &id.to_le_bytes()), ("topic", topic.as_bytes())];
        chunk.extend(record(&fields, &told.concat()));
    }
    for pose in poses {
        let nanoseconds = ((EPOCH_S + pose.time_s) * 1e9).round() as u64;
        let (secs, nsecs) = ((nanoseconds / 1_000_000_000) as u32, (nanoseconds % 1_000_000_000) as u32);
        let mut data = [0, secs, nsecs].map(u32::to_le_bytes).concat();
        data.extend(part(b"/vicon/world"));
        data.extend(part(format!("vicon/{0}/{0}", pose.name).as_bytes()));
        let (sin, cos) = (pose.yaw_rad / 2.0).sin_cos();
        for number in [pose.x_m, pose.y_m, 0.0, 0.0, 0.0, sin, cos] {
            data.extend(number.to_le_bytes());
        }
        let time = [secs.to_le_bytes(), nsecs.to_le_bytes()].concat();
        chunk.extend(record(&[("op", &[2]), ("conn", &pose.id.to_le_bytes()), ("time", &time)], &data));
    }
    let bytes = [
        b"#ROSBAG V2.0\n".to_vec(),
        record(&[("op", &[3])], b"   "),
        record(&[("op", &[5]), ("compression", b"none")], &chunk),
    ];
    std::fs::write(path, bytes.concat()).unwrap();
}
