//! `city3d testbed`: robots in place of the laboratory's, and its motion capture.

#[cfg(feature = "ros")]
use super::ros::{RosArgs, physical_subjects_of};
use super::say::say;
use super::{Failure, LinkArgs, ScenarioArgs, load, on_end};
#[cfg(feature = "ros")]
use crate::link::vicon::{Subject, Vicon, wall_s};
use crate::link::{Allowed, Inbound, Origin, Server, ServerOptions, read_key};
use crate::scenario::Experiment;
use crate::snapshot::{Status, VehicleId};
use crate::testbed::{ExperimentClock, Testbed};
use crate::wire::{Body, Clock, MOST_POSES, Measurement, Outcome, Phase, Poses, Seal, Seen};
use clap::Args;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
pub struct TestbedArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    link: LinkArgs,
    /// Who may send: an address or a network, again for more; without it all that can reach the ports
    #[arg(long, value_name = "IP")]
    allow: Vec<Allowed>,
    #[cfg(feature = "ros")]
    #[command(flatten)]
    ros: RosArgs,
}

/// The robots look so often what has come between two steps.
const LOOK: Duration = Duration::from_millis(1);
/// Steps that are not made in time by so much are let go.
const MOST_BEHIND: Duration = Duration::from_millis(100);
/// Who drives and is silent for so long drives no more.
const SILENT: Duration = Duration::from_secs(1);
/// Who get the poses of a robot, at most.
const MOST_SUBSCRIBERS: usize = 16;
/// Datagrams that a sender may send in a second.
const RATE_PER_S: f64 = 20_000.0;
/// Datagrams that are taken in before the next step.
const AT_ONCE: usize = 256;

pub fn testbed(args: &TestbedArgs) -> Result<(), Failure> {
    let experiment = load::experiment(&args.scenario)?;
    if experiment.physical().next().is_none() {
        return Err(Failure::bad_input(format!(
            "{} has no physical vehicles: set body = \"physical\" on a [[vehicle]]",
            experiment.name
        )));
    }
    let ends = on_end()?;
    let mut laboratory = Laboratory::new(args, &experiment)?;
    for station in &laboratory.stations {
        let robots: Vec<String> = station.robots.iter().map(ToString::to_string).collect();
        say(format_args!("robot {} listens on udp {}", robots.join(", "), station.server.address()))?;
    }
    laboratory.live(&ends);
    Ok(())
}

struct Subscriber {
    origin: Origin,
    until: Instant,
}

/// Robots behind one address.
struct Station {
    robots: Vec<VehicleId>,
    server: Server,
    subscribers: Vec<Subscriber>,
    /// Who drives them, and when it was heard last.
    driver: Option<(Origin, Instant)>,
}

struct Laboratory {
    testbed: Testbed,
    stations: Vec<Station>,
    /// Of the experiment.
    physics_hz: u32,
    length_scale: f64,
    ticks: u64,
    #[cfg(feature = "ros")]
    vicon: Option<Capture>,
}

/// Motion capture over ROS, and what it tracks.
#[cfg(feature = "ros")]
struct Capture {
    vicon: Vicon,
    subjects: Arc<Vec<Subject>>,
}

impl Laboratory {
    fn new(args: &TestbedArgs, experiment: &Arc<Experiment>) -> Result<Self, Failure> {
        let mut by_address: BTreeMap<&str, Vec<VehicleId>> = BTreeMap::new();
        for (planned, physical) in experiment.physical() {
            by_address.entry(&physical.address).or_default().push(planned.id);
        }
        let seal = read_key(args.link.key.as_deref()).map_err(Failure::bad_input)?;
        let stations =
            by_address.into_iter().map(|(address, robots)| Station::new(args, address, robots, &seal));
        Ok(Self {
            testbed: Testbed::new(experiment),
            stations: stations.collect::<Result<_, _>>()?,
            physics_hz: experiment.rates.physics_hz,
            length_scale: experiment.scale.factor(),
            ticks: 0,
            #[cfg(feature = "ros")]
            vicon: capture_of(args, experiment)?,
        })
    }

    fn live(&mut self, ends: &AtomicBool) {
        let step = Duration::from_secs_f64(1.0 / f64::from(self.physics_hz));
        let mut due = Instant::now() + step;
        let mut arrived = Vec::new();
        while !ends.load(Ordering::Relaxed) {
            for station in &mut self.stations {
                station.receive(&mut self.testbed, (self.physics_hz, self.length_scale));
            }
            let now = Instant::now();
            if now < due {
                std::thread::sleep(LOOK.min(due - now));
                continue;
            }
            due += step;
            if now > due + MOST_BEHIND {
                due = now;
            }
            self.ticks += 1;
            self.testbed.step(&mut arrived);
            self.publish(&mut arrived);
        }
    }

    /// Tells the poses that have come from motion capture, those of one stamp at once.
    fn publish(&mut self, arrived: &mut Vec<Measurement>) {
        let mut by_stamp: BTreeMap<u64, Vec<Measurement>> = BTreeMap::new();
        for pose in arrived.drain(..) {
            // Stamps are not negative: their bits are in their order.
            by_stamp.entry(pose.stamp_s.to_bits()).or_default().push(pose);
        }
        let clock = self.testbed.clock();
        for (stamp, mut poses) in by_stamp {
            let stamp_s = f64::from_bits(stamp);
            poses.sort_by_key(|pose| pose.vehicle);
            for station in &mut self.stations {
                station.tell(self.ticks, stamp_s, clock, &poses);
            }
            #[cfg(feature = "ros")]
            if let Some(Capture { vicon, subjects }) = &mut self.vicon {
                // As VICON's bridge does: now, less the latency of the capture.
                vicon.publish(wall_s() - (clock.time_s - stamp_s).max(0.0), subjects, poses);
            }
        }
    }
}

#[cfg(feature = "ros")]
fn capture_of(args: &TestbedArgs, experiment: &Experiment) -> Result<Option<Capture>, Failure> {
    let Some(options) = args.ros.options("/city3d_testbed", false, Vec::new())? else { return Ok(None) };
    let vicon = Vicon::start(options).map_err(Failure::bad_input)?;
    Ok(Some(Capture { vicon, subjects: Arc::new(physical_subjects_of(experiment)) }))
}

impl Station {
    fn new(args: &TestbedArgs, address: &str, robots: Vec<VehicleId>, seal: &Seal) -> Result<Self, Failure> {
        let options = ServerOptions {
            address: address.to_owned(),
            world: args.link.world,
            seal: seal.clone(),
            allowed: args.allow.clone(),
            rate_per_s: RATE_PER_S,
            takes_clock: true,
        };
        let server = Server::bind(&options).map_err(Failure::bad_input)?;
        Ok(Self { robots, server, subscribers: Vec::new(), driver: None })
    }

    fn receive(&mut self, testbed: &mut Testbed, (physics_hz, length_scale): (u32, f64)) {
        for _ in 0..AT_ONCE {
            let Some(Inbound { origin, body, .. }) = self.server.receive(Duration::ZERO) else { return };
            match body {
                Body::Hello { token } => {
                    let ExperimentClock { time_s, is_running } = testbed.clock();
                    let phase = if is_running { Phase::Running } else { Phase::Ready };
                    let clock =
                        Clock { token, tick: 0, time_s, physics_hz, length_scale, phase, is_lockstep: false };
                    self.server.tell(origin, &Body::Clock(clock));
                }
                Body::Clock(clock) if self.is_driven_by(origin, testbed) => {
                    let is_running = clock.phase == Phase::Running;
                    testbed.set_clock(ExperimentClock { time_s: clock.time_s, is_running });
                }
                Body::Trajectories(list) if self.is_driven_by(origin, testbed) => {
                    let own = list.into_iter().filter(|one| self.robots.contains(&one.vehicle));
                    own.for_each(|trajectory| testbed.follow(&trajectory));
                }
                Body::Subscribe { request, lease_s, .. } => {
                    self.subscribe(origin, lease_s);
                    self.answer(origin, request, Outcome::Done, "");
                }
                Body::Setup { request, .. }
                | Body::Remove { request, .. }
                | Body::Command { request, .. } => {
                    self.answer(origin, request, Outcome::Refused, "this is a vehicle, and no city");
                }
                _ => {}
            }
        }
    }

    /// Whether a sender drives: the first one does, until it is silent.
    fn is_driven_by(&mut self, origin: Origin, testbed: &mut Testbed) -> bool {
        match self.driver {
            Some((driver, _)) if driver == origin => {}
            Some((_, heard)) if heard.elapsed() < SILENT => return false,
            _ => self.robots.iter().for_each(|robot| testbed.hear_anew(*robot)),
        }
        self.driver = Some((origin, Instant::now()));
        true
    }

    fn subscribe(&mut self, origin: Origin, lease_s: f64) {
        let now = Instant::now();
        self.subscribers.retain(|subscriber| subscriber.origin != origin && subscriber.until > now);
        if lease_s > 0.0 && self.subscribers.len() < MOST_SUBSCRIBERS {
            self.subscribers.push(Subscriber { origin, until: now + Duration::from_secs_f64(lease_s) });
        }
    }

    fn answer(&self, origin: Origin, request: u32, outcome: Outcome, detail: &str) {
        if request != 0 {
            let detail = detail.to_owned();
            self.server.tell(origin, &Body::Ack { request, outcome, tick: 0, detail });
        }
    }

    /// Tells its subscribers where its robots were at an instant.
    fn tell(&mut self, tick: u64, time_s: f64, clock: ExperimentClock, poses: &[Measurement]) {
        let now = Instant::now();
        self.subscribers.retain(|subscriber| subscriber.until > now);
        let own = poses.iter().filter(|pose| self.robots.contains(&pose.vehicle));
        let seen: Vec<Seen> = own.map(|pose| Seen { pose: *pose, status: Status::Physical }).collect();
        let phase = if clock.is_running { Phase::Running } else { Phase::Ready };
        for vehicles in seen.chunks(MOST_POSES) {
            let vehicles = vehicles.to_vec();
            let poses =
                Body::Poses(Poses { tick, time_s, state_hash: 0, phase, part: 0, parts: 1, vehicles });
            self.subscribers.iter().for_each(|subscriber| self.server.tell(subscriber.origin, &poses));
        }
    }
}
