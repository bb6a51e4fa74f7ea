//! Virtual and physical vehicles while each of the processes that drive them is killed and started again.

use crate::support::link;
use crate::support::mixed;
use crate::support::ros;
use crate::support::watch;

use city3d_geometry::lab::Pose2;
use city3d_protocol::snapshot::Status;
use city3d_protocol::wire::{ExperimentPhase, ObservedVehicle, Poses};
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use link::{Process, mainframe, serve, serve_at, summary};
use mixed::{PHYSICAL, mixed, testbed};
use std::path::Path;
use watch::{Watcher, hardest_braking, stand, torn_s};

fn is_physical(seen: &ObservedVehicle) -> bool {
    PHYSICAL.iter().any(|(_, id)| *id == u64::from(seen.pose.vehicle.0))
}

/// The laboratory's map, to tell where on its lane a vehicle is.
struct Lanes(Experiment);

impl Lanes {
    fn new() -> Self {
        let (text, library) = Library::scenario("mixed").unwrap();
        Self(read_experiment("mixed", &text, &library, Overrides::default()).unwrap())
    }

    /// How far its front axle is from the nearest lane, laboratory metres, and the curvature there.
    fn under(&self, pose: Pose2) -> (f64, f64) {
        let axle = pose.point_at(0.06, 0.0);
        let lanes = self.0.lab_map.lanes.iter().map(|lane| (lane.curve.project(axle), lane));
        let (foot, lane) = lanes.min_by(|a, b| a.0.distance.total_cmp(&b.0.distance)).unwrap();
        (foot.distance, lane.curve.at(foot.s).curvature)
    }

    fn is_on_arc(&self, seen: &ObservedVehicle) -> bool {
        self.under(seen.pose.pose_in_lab()).1.abs() > 1.0
    }

    /// A car of 2.5 m on a lane of 3.8 m.
    fn assert_in_lane(&self, seen: &[Poses]) {
        for seen in seen.iter().flat_map(|poses| &poses.vehicles) {
            let aside_m = self.under(seen.pose.pose_in_lab()).0 * 25.0;
            assert!(aside_m < 0.65, "vehicle {} is {aside_m} m aside", seen.pose.vehicle);
        }
    }
}

/// Those who move between two poses, by more than noise.
fn moving<'p>(before: &'p Poses, after: &'p Poses) -> impl Iterator<Item = &'p ObservedVehicle> {
    let dt_s = (after.time_s - before.time_s).max(1e-3);
    let pairs = before.vehicles.iter().zip(&after.vehicles);
    let is_fast = move |(a, b): &(&ObservedVehicle, &ObservedVehicle)| {
        (b.pose.position - a.pose.position).length() * 25.0 / dt_s > 2.0
    };
    pairs.filter(is_fast).map(|(_, b)| b)
}

/// An experiment of three virtual and three physical vehicles, and who watches it.
struct Lab<'a> {
    folder: &'a Path,
    /// What all processes are told besides.
    carrier: Vec<String>,
    lanes: Lanes,
    robots: Option<Process>,
    city: Option<Process>,
    far: Option<Process>,
    address: String,
    watcher: Watcher,
    parts: u32,
}

impl<'a> Lab<'a> {
    fn new(folder: &'a Path, carrier: Vec<String>) -> Self {
        mixed(folder, "");
        let carried: Vec<&str> = carrier.iter().map(String::as_str).collect();
        let robots = testbed(&carried, folder);
        let city = serve(&[&["mixed.toml", "--out", "city0"][..], &carried].concat(), folder);
        let address = city.address.clone();
        let watcher = Watcher::new(&address);
        let mut lab = Self {
            folder,
            carrier,
            lanes: Lanes::new(),
            robots: Some(robots),
            city: Some(city),
            far: None,
            address,
            watcher,
            parts: 0,
        };
        lab.start_mainframe();
        lab
    }

    fn arguments<'s>(&'s self, own: &[&'s str]) -> Vec<&'s str> {
        own.iter().copied().chain(self.carrier.iter().map(String::as_str)).collect()
    }

    fn start_mainframe(&mut self) {
        self.parts += 1;
        let out = format!("far{}", self.parts);
        let rest = self.arguments(&["mixed.toml", "--duration", "600", "--out", &out]);
        self.far = Some(mainframe(&self.address, &rest, self.folder));
    }

    fn start_city(&mut self) {
        self.parts += 1;
        let out = format!("city{}", self.parts);
        self.city =
            Some(serve_at(&self.address, &self.arguments(&["mixed.toml", "--out", &out]), self.folder));
    }

    /// Watches for so long in the city's time.
    fn watch(&mut self, lasting_s: f64) -> Vec<Poses> {
        let from_s = self.watcher.next().time_s;
        self.watcher.until("has time gone by", |poses| poses.time_s >= from_s + lasting_s)
    }

    /// Watches until some of the virtual and some of the physical vehicles drive.
    fn watch_them_go(&mut self, what: &str) -> Vec<Poses> {
        for _ in 0..60 {
            let seen = self.watch(0.5);
            let going: Vec<&ObservedVehicle> = moving(&seen[0], &seen[seen.len() - 1]).collect();
            let is_known =
                |poses: &Poses| poses.phase == ExperimentPhase::Running && poses.vehicles.len() == 6;
            if seen.iter().all(is_known)
                && going.iter().any(|one| is_physical(one))
                && going.iter().any(|one| !is_physical(one))
            {
                return seen;
            }
        }
        panic!("{what}: they do not drive on: {:?}", self.watcher.next());
    }

    fn watch_them_stop(&mut self) -> Vec<Poses> {
        let mut seen = self.watch(1.0);
        while !stand(&seen) {
            seen.push(self.watcher.next());
            assert!(seen.len() < 1500, "they do not stop: {:?}", seen.last());
        }
        seen
    }
}

fn kill(process: &mut Option<Process>) {
    let mut process = process.take().unwrap();
    process.signal("-KILL");
    process.wait();
}

/// Kills the mainframe while a virtual and a physical vehicle are on an arc.
fn kill_the_mainframe(lab: &mut Lab<'_>) {
    let mut on_arc = [false; 2];
    for _ in 0..200 {
        let seen = lab.watch(0.1);
        let going: Vec<&ObservedVehicle> = moving(&seen[0], &seen[seen.len() - 1]).collect();
        on_arc = [true, false]
            .map(|wanted| going.iter().any(|one| is_physical(one) == wanted && lab.lanes.is_on_arc(one)));
        if on_arc == [true; 2] {
            break;
        }
    }
    assert_eq!(on_arc, [true; 2], "some of both kinds come by an arc");
    kill(&mut lab.far);
    let seen = lab.watch_them_stop();
    // How hard robots brake is tested where they are stepped in simulated time (`testbed`): in a process of their own
    // they jump when the host takes the processors away.
    let braking = hardest_braking(&seen, 10, |one| !is_physical(one));
    assert!((2.0..5.3).contains(&braking), "virtual ones: {braking} m/s2");
    lab.lanes.assert_in_lane(&seen);
    let lost = seen[seen.len() - 1].vehicles.iter().filter(|one| one.status == Status::LinkLost);
    assert_eq!(lost.count(), 3, "the virtual ones");
}

/// Kills mainframe, city and testbed in turn; `between` is done while all drive.
fn kill_in_turn(lab: &mut Lab<'_>, between: impl FnOnce(&mut Lab<'_>)) {
    lab.watch_them_go("at first");
    // The last second of a log is lost with who writes it.
    lab.watch(3.0);
    kill_the_mainframe(lab);
    lab.start_mainframe();
    let seen = lab.watch_them_go("after the mainframe was killed");
    lab.lanes.assert_in_lane(&seen);

    between(lab);

    // The city: the virtual vehicles are away with it, and come where they were; robots stop for nobody in it.
    let before = lab.watcher.next();
    kill(&mut lab.city);
    lab.start_city();
    let is_new =
        |poses: &Poses| poses.time_s < before.time_s - 0.5 && poses.phase == ExperimentPhase::Running;
    lab.watcher.until("does the new city run", is_new);
    let seen = lab.watch_them_go("after the city was killed");
    for (old, new) in before.vehicles.iter().zip(&seen[0].vehicles).filter(|(old, _)| !is_physical(old)) {
        let way_m = (old.pose.position - new.pose.position).length();
        assert!(way_m < 1.5, "vehicle {} has jumped {way_m} m: {before:?} {:?}", old.pose.vehicle, seen[0]);
    }

    // The robots and their motion capture: who is not seen stands where it would be, and nobody runs into it.
    kill(&mut lab.robots);
    let seen = lab.watch(2.5);
    let unseen = seen[seen.len() - 1].vehicles.iter().filter(|one| one.status == Status::Unseen);
    assert_eq!(unseen.count(), 3, "{:?}", seen.last());
    let carried: Vec<String> = lab.carrier.clone();
    let carried: Vec<&str> = carried.iter().map(String::as_str).collect();
    lab.robots = Some(testbed(&carried, lab.folder));
    lab.watch_them_go("after the robots were put back to their starts");

    let [far, city, robots] =
        [&mut lab.far, &mut lab.city, &mut lab.robots].map(|one| one.take().unwrap().end());
    assert_eq!((far, city, robots), (0, 0, 0));
    let mut logs = 0;
    for entry in std::fs::read_dir(lab.folder).unwrap() {
        let folder = entry.unwrap().path();
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        if folder.is_dir() && (name.starts_with("far") || name.starts_with("city")) {
            assert!(torn_s(&folder.join("run.mcap")) > 1.0, "{name}");
            logs += 1;
        }
    }
    assert_eq!(logs, 4, "two of the city and two of the mainframe");
    let last = format!("city{}", lab.parts);
    assert_eq!(summary(&lab.folder.join(last))["collisions"], 0);
}

#[test]
fn over_ros_the_master_may_be_killed_as_well() {
    if !ros::has_peers() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let ros = ros::Ros::new(folder.path());
    let mut core = Some(ros.core());
    let mut lab = Lab::new(folder.path(), vec![format!("--ros={}", ros.uri())]);
    kill_in_turn(&mut lab, |lab| {
        // Connections that are there go on without a master.
        core.take().unwrap().kill();
        let seen = lab.watch(1.5);
        assert!(seen.windows(2).all(|pair| pair[1].time_s > pair[0].time_s), "the city stood");
        let last = &seen[seen.len() - 1];
        let is_lost = |one: &&ObservedVehicle| matches!(one.status, Status::LinkLost | Status::Unseen);
        assert_eq!(last.vehicles.iter().filter(is_lost).count(), 0, "{last:?}");
        lab.watch_them_go("without a master");
        core = Some(ros.core());
    });
}
