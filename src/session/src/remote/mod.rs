//! A city elsewhere, seen over the UDP link: watched, controlled by the control framework here, or visited with a car
//! that a person drives.

mod connection;
mod control;
mod guest;
mod reassembly;
mod source;

pub use connection::served_scenario;
pub use control::{PoseFeedback, setup_of};

use super::SessionError;
use city3d_network::host::Host;
use city3d_network::link::{Client, ClientEvent};
use city3d_protocol::snapshot::{VehicleId, VehicleInfo};
use city3d_protocol::wire::{
    Authenticator, Body, CityClock, CityDescription, Decisions, ExperimentAction, ExperimentPhase,
    ObservedVehicle, Plans, Poses, RequestOutcome,
};
use city3d_simulation::runner::{HeldControl, ObservedCity};
use city3d_simulation::scenario::Experiment;
use connection::{Connection, HANDSHAKE_INTERVAL, REQUEST_TIMEOUT, Reply, subscription};
use control::RemoteControl;
use guest::GuestCar;
use reassembly::PoseReassembly;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Which city is watched or controlled.
#[derive(Clone, Debug)]
pub struct RemoteOptions {
    /// Address and port of the served city.
    pub city: String,
    /// World number, which tells several cities on one network apart; 0 matches any.
    pub world: u32,
    /// Seals and verifies the datagrams of the city and of physical vehicles.
    pub authenticator: Authenticator,
    /// Ends waits for the city when it is set.
    pub stop: Arc<AtomicBool>,
}

impl RemoteOptions {
    /// The city at an address, in whichever world, without a key.
    pub fn to(city: &str) -> Self {
        let (authenticator, stop) = (Authenticator::Checksum, Arc::default());
        Self { city: city.to_owned(), world: 0, authenticator, stop }
    }
}

/// A city that has sent no poses for this long gets a heartbeat request, again at this interval.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(1);
/// The same with a city that has said why it does not.
const DENIED_INTERVAL: Duration = Duration::from_millis(500);
/// This many consecutive pose datagrams of a city that is `Ready` again mean that it was reset.
const RESET_CONFIRMATIONS: u32 = 3;
/// Interval at which the lease is renewed. It is a heartbeat as well: while the clock stands nothing else is sent, and a leader that is silent for a second
/// loses the lead.
const LEASE_RENEWAL_INTERVAL: Duration = Duration::from_millis(300);
/// Interval at which a watcher asks what the city is; sooner when it sees a vehicle that it does not know.
const DESCRIBE_INTERVAL: Duration = Duration::from_secs(3);
const UNKNOWN_INTERVAL: Duration = Duration::from_millis(250);

/// How far the connection has come.
enum Stage {
    /// Sends `Hello` until the city answers with its clock.
    Handshake {
        since: Instant,
        has_logged: bool,
    },
    Connected(Box<Link>),
}

/// A connection that is up.
struct Link {
    clock: CityClock,
    reassembly: PoseReassembly,
    /// Consecutive pose datagrams of a city that is `Ready` again.
    resets: u32,
    last_heard: Instant,
    renewed: Instant,
    described: Option<Instant>,
    /// Tick of the newest poses that were complete.
    newest: Option<u64>,
    is_away: bool,
}

/// What this process does with the city.
enum Role {
    Watch,
    Visit(Box<GuestCar>),
    Control(Box<RemoteControl>),
}

/// A city elsewhere.
pub struct RemoteCity {
    options: RemoteOptions,
    experiment: Arc<Experiment>,
    connection: Connection,
    role: Role,
    city: ObservedCity,
    stage: Stage,
    /// Came while the session slept.
    event: Option<ClientEvent>,
    /// Poses of a tick that are not told yet.
    pending: Option<(Poses, Vec<ObservedVehicle>)>,
    /// The poses that were told last, which control answers.
    told: Option<(Poses, Vec<ObservedVehicle>)>,
    /// A snapshot of this session of the city was told.
    has_begun: bool,
    /// The run in the files ends before the pending poses.
    ends_run: bool,
    has_seen: bool,
    failure: Option<SessionError>,
    infos: BTreeMap<VehicleId, VehicleInfo>,
    /// Decisions and plans of its control framework, as the city tells them.
    heard: HeldControl,
    leader: Option<String>,
    scenario: Option<String>,
    received: u64,
    rate: (Instant, u64, f64),
    on_set_up: Box<dyn FnMut(usize) + Send>,
}

impl RemoteCity {
    /// Watches a city; nothing is sent yet. The experiment is what is known of it here: its map and its looks.
    ///
    /// # Errors
    /// When the address is wrong.
    pub fn watch(
        options: RemoteOptions,
        experiment: Arc<Experiment>,
        host: Host,
    ) -> Result<Self, SessionError> {
        Self::open(options, experiment, Role::Watch, host)
    }

    /// Visits a city with a car of one's own.
    ///
    /// # Errors
    /// When the address is wrong.
    pub fn visit(
        options: RemoteOptions,
        experiment: Arc<Experiment>,
        name: String,
        host: Host,
    ) -> Result<Self, SessionError> {
        let car = GuestCar::new(&experiment, name);
        Self::open(options, experiment, Role::Visit(Box::new(car)), host)
    }

    /// Controls the vehicles of a city by the control framework here.
    ///
    /// # Errors
    /// When an address is wrong, the control framework cannot take a vehicle, or poses from elsewhere would have to show the
    /// vehicles of inflows.
    pub fn control(
        options: RemoteOptions,
        experiment: Arc<Experiment>,
        feedback: Option<Box<dyn PoseFeedback>>,
        host: Host,
    ) -> Result<Self, SessionError> {
        if feedback.is_some() && !experiment.inflows.is_empty() {
            return Err(SessionError::InflowsOverRos);
        }
        let control = RemoteControl::new(&experiment, &options.authenticator, feedback, &host)?;
        Self::open(options, experiment, Role::Control(Box::new(control)), host)
    }

    fn open(
        options: RemoteOptions,
        experiment: Arc<Experiment>,
        role: Role,
        host: Host,
    ) -> Result<Self, SessionError> {
        let client = Client::on(&host, &options.city, options.world, options.authenticator.clone())?;
        let now = host.clock.now();
        let stop = Arc::clone(&options.stop);
        Ok(Self {
            city: ObservedCity::new(Arc::clone(&experiment)),
            options,
            experiment,
            connection: Connection { client, host, stop },
            role,
            stage: Stage::Handshake { since: now, has_logged: false },
            event: None,
            pending: None,
            told: None,
            has_begun: false,
            ends_run: false,
            has_seen: false,
            failure: None,
            infos: BTreeMap::new(),
            heard: HeldControl::default(),
            leader: None,
            scenario: None,
            received: 0,
            rate: (now, 0, 0.0),
            on_set_up: Box::new(|_| {}),
        })
    }

    /// Calls this with the number of vehicles whenever they have been set up in the city.
    #[must_use]
    pub fn on_set_up(mut self, on_set_up: Box<dyn FnMut(usize) + Send>) -> Self {
        self.on_set_up = on_set_up;
        self
    }

    /// Whether the city has sent poses.
    pub fn has_seen(&self) -> bool {
        self.has_seen
    }

    /// The guest's car, once the city has it.
    pub fn own_vehicle(&self) -> Option<VehicleId> {
        if let Role::Visit(car) = &self.role { car.vehicle() } else { None }
    }

    fn has_own_feedback(&self) -> bool {
        matches!(&self.role, Role::Control(control) if control.feedback.is_some())
    }

    /// One handshake: `Hello`, and the city's clock if it answers.
    fn shake_hands(&mut self) -> Result<(), SessionError> {
        let Connection { client, host, .. } = &mut self.connection;
        let now = host.clock.now();
        match self.stage {
            // It may have been restarted since it was known.
            Stage::Handshake { since, .. } if now.saturating_duration_since(since) > HEARTBEAT_TIMEOUT => {
                client.probe();
            }
            _ => _ = client.send(&Body::Hello { token: 0 }),
        }
        let interval = if client.trouble().is_some() { DENIED_INTERVAL } else { HANDSHAKE_INTERVAL };
        match client.receive(interval) {
            Some(ClientEvent::Body(Body::Clock(clock))) => {
                self.check(&clock)?;
                return self.connect(clock);
            }
            Some(ClientEvent::Restarted) => {
                self.lose();
                return Ok(());
            }
            _ => {}
        }
        if let Stage::Handshake { since, has_logged } = &mut self.stage
            && !*has_logged
            && now.saturating_duration_since(*since) > HEARTBEAT_TIMEOUT
        {
            *has_logged = true;
            match client.trouble() {
                Some(why) => tracing::warn!("waiting for a city at {}: {why}", self.options.city),
                None => tracing::warn!("waiting for a city at {}", self.options.city),
            }
        }
        Ok(())
    }

    fn check(&self, clock: &CityClock) -> Result<(), SessionError> {
        let (ours, theirs) = (self.experiment.rates.physics_hz, clock.physics_hz);
        let (scale, other) = (self.experiment.scale.factor(), clock.length_scale);
        if ours != theirs || scale != other {
            return Err(SessionError::OtherCity {
                city: self.options.city.clone(),
                found_hz: theirs,
                found_scale: other,
                wanted_hz: ours,
                wanted_scale: scale,
            });
        }
        if clock.is_lockstep && self.has_own_feedback() {
            return Err(SessionError::LockstepWithoutCity);
        }
        Ok(())
    }

    /// Sets up what this process brings, and subscribes to poses.
    fn connect(&mut self, clock: CityClock) -> Result<(), SessionError> {
        let connection = &mut self.connection;
        let is_set_up = match &mut self.role {
            Role::Watch => true,
            Role::Visit(car) => {
                car.set_up(connection);
                true
            }
            Role::Control(control) => control.set_up(connection, &clock)?,
        };
        if !is_set_up {
            self.lose();
            return Ok(());
        }
        if !self.has_own_feedback()
            && let Reply::Nothing = self.connection.request_until_done("the subscription", subscription)?
        {
            self.lose();
            return Ok(());
        }
        if let Role::Control(_) = &self.role {
            (self.on_set_up)(self.experiment.vehicles.len());
        }
        let now = self.connection.host.clock.now();
        self.ends_run |= std::mem::take(&mut self.has_begun);
        self.heard.clear();
        self.stage = Stage::Connected(Box::new(Link {
            clock,
            reassembly: PoseReassembly::default(),
            resets: 0,
            last_heard: now,
            renewed: now,
            described: None,
            newest: None,
            is_away: false,
        }));
        Ok(())
    }

    /// Begins anew, as somebody whom the city does not know.
    fn lose(&mut self) {
        self.connection.client.reset_session();
        self.shake_hands_again();
    }

    fn shake_hands_again(&mut self) {
        self.stage = Stage::Handshake { since: self.connection.host.clock.now(), has_logged: false };
    }

    /// Renews what has to be renewed while the connection is up.
    fn keep_up(&mut self) {
        let now = self.connection.host.clock.now();
        let has_own_feedback = self.has_own_feedback();
        let Stage::Connected(link) = &mut self.stage else { return };
        let client = &mut self.connection.client;
        if now.saturating_duration_since(link.renewed) > LEASE_RENEWAL_INTERVAL {
            link.renewed = now;
            client.send(&if has_own_feedback { Body::Hello { token: 0 } } else { subscription(0) });
        }
        let is_unknown = self.city.snapshot().vehicles.iter().any(|state| !self.city.knows(state.id));
        let is_due = |every| link.described.is_none_or(|at| now.saturating_duration_since(at) > every);
        let asks = match &mut self.role {
            Role::Control(control) => {
                control.keep_up_links();
                // It has brought all others itself.
                is_unknown && is_due(UNKNOWN_INTERVAL)
            }
            Role::Watch | Role::Visit(_) => {
                is_due(if is_unknown { UNKNOWN_INTERVAL } else { DESCRIBE_INTERVAL })
            }
        };
        if asks {
            link.described = Some(now);
            client.send(&Body::Describe { request: 1 });
        }
        if let Role::Visit(car) = &mut self.role {
            car.keep_up(&mut self.connection);
        }
    }

    /// Nothing has come for a while.
    fn notice_silence(&mut self) {
        let now = self.connection.host.clock.now();
        let has_own_feedback = self.has_own_feedback();
        let Stage::Connected(link) = &mut self.stage else { return };
        if link.clock.is_lockstep
            && let Role::Control(control) = &mut self.role
        {
            control.retransmit(&mut self.connection);
        }
        if now.saturating_duration_since(link.last_heard) > HEARTBEAT_TIMEOUT {
            if !link.is_away {
                tracing::warn!("the city at {} does not answer any more", self.options.city);
            }
            (link.last_heard, link.is_away) = (now, true);
            self.connection.client.probe();
            if !has_own_feedback {
                self.connection.client.send(&subscription(0));
            }
        }
    }

    fn take(&mut self, event: ClientEvent) {
        match event {
            ClientEvent::Restarted => {
                tracing::warn!("the city has been restarted");
                self.lose();
            }
            ClientEvent::Body(Body::Poses(poses)) => self.take_poses(poses),
            ClientEvent::Body(Body::ShownSignals(aspects)) => self.city.show_signals(&aspects),
            ClientEvent::Body(Body::ShownDecisions(told)) => self.take_decisions(&told),
            ClientEvent::Body(Body::ShownPlans(told)) => self.take_plans(&told),
            ClientEvent::Body(Body::Description(description)) => self.take_description(description),
            ClientEvent::Body(_) => {}
        }
    }

    fn take_poses(&mut self, poses: Poses) {
        let now = self.connection.host.clock.now();
        self.received += 1;
        let Stage::Connected(link) = &mut self.stage else { return };
        if std::mem::take(&mut link.is_away) {
            tracing::warn!("the city at {} answers again", self.options.city);
        }
        link.last_heard = now;
        let is_old = link.newest.is_some_and(|tick| poses.tick <= tick);
        let is_before = link.newest.is_some_and(|tick| poses.tick < tick);
        // A single one may be a late datagram.
        link.resets = if is_before && poses.phase == ExperimentPhase::Ready { link.resets + 1 } else { 0 };
        if link.resets >= RESET_CONFIRMATIONS {
            tracing::warn!("the city has been reset");
            if let Role::Control(control) = &mut self.role {
                // The city knows this session, and whose its vehicles are.
                control.was_reset = true;
                self.shake_hands_again();
            } else {
                (link.newest, link.resets) = (None, 0);
                self.ends_run |= std::mem::take(&mut self.has_begun);
            }
            return;
        }
        if let Role::Control(control) = &mut self.role {
            control.pass_clock(&link.clock, &poses);
        } else if is_old && !is_before {
            // A watcher sees what changes while the clock stands.
            link.newest = None;
        }
        let is_old = is_old && link.newest.is_some();
        if !is_old && let Some(vehicles) = link.reassembly.add(&poses) {
            let sees_all = match &mut self.role {
                Role::Control(control) => control.sees_all_physical(&poses, &vehicles),
                Role::Watch | Role::Visit(_) => true,
            };
            if sees_all {
                link.newest = Some(poses.tick);
                self.pending = Some((poses, vehicles));
            }
        }
    }

    /// Keeps the decisions for the vehicles that are seen.
    fn take_decisions(&mut self, told: &Decisions) {
        let now = self.city.snapshot();
        self.heard.expire(now.time_s);
        for decision in told.vehicles.iter().filter(|decision| now.vehicle(decision.vehicle).is_some()) {
            // One that was overtaken on its way is told anew soon.
            self.heard.decisions.take(told.time_s, decision.in_city(self.experiment.scale));
        }
    }

    /// Keeps the control zones, and the plans of the vehicles that are seen.
    fn take_plans(&mut self, told: &Plans) {
        let now = self.city.snapshot();
        self.heard.expire(now.time_s);
        let mut update = told.in_city(self.experiment.scale);
        update.vehicles.retain(|vehicle| now.vehicle(vehicle.id).is_some());
        update.left.retain(|id| now.vehicle(*id).is_some());
        self.heard.plans.take(told.time_s, update);
    }

    fn take_description(&mut self, description: CityDescription) {
        let CityDescription { scenario, leader, part, vehicles, .. } = description;
        if part == 0 {
            self.infos.clear();
        }
        self.infos.extend(vehicles.into_iter().map(|info| (info.id, info)));
        self.city.describe(self.infos.values().cloned());
        self.leader = Some(leader).filter(|leader| !leader.is_empty());
        self.scenario = Some(scenario);
    }

    fn update_rate(&mut self, now: Instant) {
        let (at, received, _) = self.rate;
        let passed_s = now.saturating_duration_since(at).as_secs_f64();
        if passed_s >= 1.0 {
            self.rate = (now, self.received, (self.received - received) as f64 / passed_s);
        }
    }

    /// What is wrong with the connection, as a sentence.
    fn trouble(&self) -> Option<String> {
        let city = &self.options.city;
        match &self.stage {
            Stage::Connected(link) if link.is_away => Some(format!("{city} does not answer any more")),
            Stage::Connected(_) => match &self.role {
                Role::Visit(car) => car.trouble().map(str::to_owned),
                Role::Watch | Role::Control(_) => None,
            },
            Stage::Handshake { .. } => Some(
                self.connection
                    .client
                    .trouble()
                    .map_or_else(|| format!("waiting for a city at {city}"), |why| format!("{city}: {why}")),
            ),
        }
    }

    fn request(&mut self, action: ExperimentAction) -> Result<(), String> {
        if let Stage::Handshake { .. } = self.stage {
            return Err("there is no city yet".to_owned());
        }
        let body = |request| Body::Command { request, action };
        match self.connection.client.request(REQUEST_TIMEOUT, body) {
            Some((RequestOutcome::Done, _)) => Ok(()),
            Some((_, detail)) => Err(format!("the city refuses: {detail}")),
            None => Err("the city does not answer".to_owned()),
        }
    }
}

impl Drop for RemoteCity {
    fn drop(&mut self) {
        if let Role::Visit(car) = &mut self.role {
            car.leave(&mut self.connection);
        }
    }
}
