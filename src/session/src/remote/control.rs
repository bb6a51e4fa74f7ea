//! Remote control of a city: the control framework in a process of its own, behind the UDP link.

use super::connection::{Connection, RETRANSMIT_INTERVAL, Reply};
use crate::decision_sampler::DecisionSampler;
use crate::plan_sampler::PlanSampler;
use crate::{SessionError, coordination, decisions};
use city3d_control::Mainframe;
use city3d_network::host::Host;
use city3d_network::link::{Client, ClientEvent, PhysicalFleet};
use city3d_protocol::snapshot::{Status, VehicleId, VehicleState};
use city3d_protocol::wire::{
    Authenticator, Body, CityClock, Decisions, ExperimentAction, ExperimentPhase, Message, ObservedVehicle,
    Plans, Poses, VehicleBuild, VehicleSetup, pack,
};
use city3d_simulation::runner::ControlLoop;
use city3d_simulation::scenario::{Experiment, PlannedVehicle};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Feedback of poses in place of the city's own, such as motion capture over ROS.
pub trait PoseFeedback: Send {
    /// A session with a city begins, whose clock may have nothing to do with that of the one before.
    fn begin_session(&mut self);

    /// Receives the next event, poses or an answer of the city.
    fn receive(&mut self, city: &mut Client) -> Option<ClientEvent>;
}

/// Physical vehicles are waited for this long before it is said.
const PATIENCE: Duration = Duration::from_secs(2);

/// The control framework of a city elsewhere: closes the loop over the link, from poses to trajectories.
pub(super) struct RemoteControl {
    experiment: Arc<Experiment>,
    host: Host,
    control: ControlLoop,
    /// Last observed state of each vehicle, kept when the city forgets it.
    last_seen: BTreeMap<VehicleId, VehicleState>,
    /// The experiment was reset, so the robots return to their starts; after a restart of the city they do not.
    pub(super) was_reset: bool,
    /// A session of the city was controlled before this one, which goes on from there.
    is_continued: bool,
    sessions: u32,
    /// Tick of the last poses that control has answered.
    answered: Option<u64>,
    /// Datagrams with the commands for that tick, with their sequence numbers.
    batch: Vec<(u64, Vec<u8>)>,
    /// What the city is told of decisions and plans.
    decisions: DecisionSampler,
    plans: PlanSampler,
    /// In lockstep, the barrier that follows them.
    barrier: Option<Body>,
    /// The experiment has come to its end.
    pub(super) is_over: bool,
    /// Physical vehicles, which get their trajectories at their own addresses.
    physical_fleet: PhysicalFleet,
    /// Since when missing physical vehicles are waited for, and whether that was logged.
    waiting: Option<(Instant, bool)>,
    /// Poses from elsewhere instead of the city's own.
    pub(super) feedback: Option<Box<dyn PoseFeedback>>,
}

impl RemoteControl {
    pub(super) fn new(
        experiment: &Arc<Experiment>,
        authenticator: &Authenticator,
        feedback: Option<Box<dyn PoseFeedback>>,
        host: &Host,
    ) -> Result<Self, SessionError> {
        let physical =
            experiment.physical().map(|(planned, physical)| (planned.id, physical.address.clone()));
        Ok(Self {
            physical_fleet: PhysicalFleet::on(host, physical, false, 0, authenticator)?,
            control: ControlLoop::new(experiment)?,
            experiment: Arc::clone(experiment),
            host: host.clone(),
            last_seen: BTreeMap::new(),
            was_reset: false,
            is_continued: false,
            sessions: 0,
            answered: None,
            batch: Vec::new(),
            decisions: DecisionSampler::default(),
            plans: PlanSampler::default(),
            barrier: None,
            is_over: false,
            waiting: None,
            feedback,
        })
    }

    pub(super) fn mainframe(&self) -> &Mainframe {
        self.control.mainframe()
    }

    /// Sets up the vehicles in the city; `false` when a new handshake is needed.
    pub(super) fn set_up(&mut self, city: &mut Connection, clock: &CityClock) -> Result<bool, SessionError> {
        let action = |action| move |request| Body::Command { request, action };
        if clock.tick >= self.experiment.ticks() {
            tracing::warn!("the city's experiment had ended; it is reset");
            if let Reply::Nothing = city.request_until_done("the reset", action(ExperimentAction::Reset))? {
                return Ok(false);
            }
            self.was_reset = true;
        }
        if self.was_reset {
            // They are at their starts again.
            self.last_seen.clear();
        }
        let experiment = Arc::clone(&self.experiment);
        for planned in &experiment.vehicles {
            let setup = setup_of(&experiment, planned, self.last_seen.get(&planned.id));
            let body = |request| Body::Setup { request, setup: Box::new(setup.clone()) };
            match city.request_until_done(&format!("vehicle {}", planned.id), body)? {
                Reply::Nothing => return Ok(false),
                // After a reset they are all there.
                Reply::Done(detail) if !detail.is_empty() && !self.was_reset => {
                    tracing::warn!("vehicle {}: {detail}", planned.id);
                }
                Reply::Done(_) => {}
            }
        }
        self.begin_session(clock.tick > 0)?;
        Ok(true)
    }

    fn begin_session(&mut self, has_begun: bool) -> Result<(), SessionError> {
        let is_resumed = has_begun && !self.was_reset;
        // A clock at `Ready` would put the robots back to their starts, which is wrong after a restart of the city.
        self.is_continued = !std::mem::take(&mut self.was_reset) && self.sessions > 0;
        let before = std::mem::replace(&mut self.control, ControlLoop::new(&self.experiment)?);
        if is_resumed {
            // Before the first session nobody was held here.
            self.control.resume(Some(&before).filter(|_| self.sessions > 0));
        }
        (self.answered, self.barrier) = (None, None);
        (self.decisions, self.plans) = (DecisionSampler::default(), PlanSampler::default());
        self.sessions += 1;
        if let Some(feedback) = &mut self.feedback {
            feedback.begin_session();
        }
        Ok(())
    }

    /// The poses of physical vehicles come from motion capture or from the city; here only their links are kept up.
    pub(super) fn keep_up_links(&mut self) {
        self.physical_fleet.poll(&mut Vec::new());
    }

    /// Tells the physical vehicles what time it is in the city.
    pub(super) fn pass_clock(&mut self, clock: &CityClock, poses: &Poses) {
        if !self.is_continued || poses.phase != ExperimentPhase::Ready {
            let CityClock { physics_hz, length_scale, is_lockstep, .. } = *clock;
            let Poses { tick, time_s, phase, .. } = *poses;
            let clock = CityClock { token: 0, tick, time_s, physics_hz, length_scale, phase, is_lockstep };
            self.physical_fleet.send_clock(clock);
        }
    }

    /// Whether all physical vehicles are visible; the experiment does not start before.
    pub(super) fn sees_all_physical(&mut self, head: &Poses, vehicles: &[ObservedVehicle]) -> bool {
        if head.phase != ExperimentPhase::Ready || self.physical_fleet.is_empty() {
            return true;
        }
        // The city lists vehicles that it has not seen yet; motion capture does not.
        let has_own_feedback = self.feedback.is_some();
        let is_there = |status| status != Status::Unseen && (has_own_feedback || status != Status::Waiting);
        let is_seen = |id| vehicles.iter().any(|seen| seen.pose.vehicle == id && is_there(seen.status));
        let missing: Vec<String> = self
            .experiment
            .physical()
            .map(|(planned, _)| planned)
            .filter(|planned| !is_seen(planned.id))
            .map(|planned| format!("{} ({})", planned.id, planned.name))
            .collect();
        if missing.is_empty() {
            return true;
        }
        let now = self.host.clock.now();
        let (since, has_logged) = self.waiting.get_or_insert((now, false));
        if !*has_logged && now.saturating_duration_since(*since) > PATIENCE {
            *has_logged = true;
            tracing::warn!("waiting for the first pose of the physical vehicles {}", missing.join(", "));
        }
        false
    }

    /// Remembers where vehicles are, for a city that forgets them.
    pub(super) fn remember(&mut self, vehicles: &[VehicleState]) {
        let has_left = |id: &VehicleId| self.control.demand().has_left(*id);
        self.last_seen.retain(|id, _| !has_left(id));
        let present = vehicles.iter().filter(|state| !has_left(&state.id));
        self.last_seen.extend(present.map(|state| (state.id, state.clone())));
    }

    /// Makes a control step with the poses of a tick and sends the commands.
    pub(super) fn answer(
        &mut self,
        city: &mut Connection,
        (head, vehicles): (&Poses, &[ObservedVehicle]),
        is_lockstep: bool,
    ) -> Result<(), SessionError> {
        let is_first = self.answered.replace(head.tick).is_none();
        if head.tick >= self.experiment.ticks() {
            self.is_over = true;
            if !is_lockstep {
                let pause = |request| Body::Command { request, action: ExperimentAction::Pause };
                city.request_until_done("the pause", pause)?;
            }
            return Ok(());
        }
        let mut delivered = Vec::new();
        // The pose of an unseen vehicle is where the city keeps it, not a measurement.
        let seen = vehicles.iter().filter(|seen| seen.status != Status::Unseen);
        self.control.step((head.tick, head.time_s), seen.map(|seen| seen.pose), &mut delivered);
        self.physical_fleet.send(delivered.iter().filter_map(|message| match message {
            Message::Follow(trajectory) => Some(trajectory),
            Message::Remove(_) | Message::Signals(_) => None,
        }));
        if is_first && !self.take_over_arrivals(city)? {
            return Ok(());
        }
        let entering =
            self.control.entering().iter().map(|vehicle| setup_of(&self.experiment, vehicle, None));
        // Nobody waits for the answers: what the poses do not show is sent again.
        let entering = entering.map(|setup| Body::Setup { request: 0, setup: Box::new(setup) });
        let bodies: Vec<Body> = entering.chain(pack(delivered.into_iter())).collect();
        self.batch.clear();
        for body in bodies {
            if let Some(prepared) = city.client.prepare(&body) {
                city.client.resend(&prepared.1);
                self.batch.push(prepared);
            }
        }
        if is_first && head.phase != ExperimentPhase::Running {
            let start = |request| Body::Command { request, action: ExperimentAction::Start };
            city.request_until_done("the start", start)?;
        }
        if is_lockstep {
            let first = self.batch.first().map_or(0, |(sequence, _)| *sequence);
            let barrier = Body::Barrier { tick: head.tick, first, count: self.batch.len() as u32 };
            city.client.send(&barrier);
            self.barrier = Some(barrier);
        }
        self.tell(city, (head, vehicles));
        Ok(())
    }

    /// Tells the city decisions and plans, after the commands, for which alone it waits. What gets lost is told again soon.
    fn tell(&mut self, city: &mut Connection, (head, vehicles): (&Poses, &[ObservedVehicle])) {
        let (control, experiment) = (&self.control, &self.experiment);
        // The city knows these; it refuses what is told of others.
        let present: BTreeSet<VehicleId> = vehicles.iter().map(|seen| seen.pose.vehicle).collect();
        let is_known = |id: VehicleId| present.contains(&id) && !control.demand().has_left(id);
        let due = self.decisions.sample(head.time_s, || {
            let mut told = decisions(control.mainframe(), experiment);
            told.retain(|decision| is_known(decision.vehicle) && decision.other.is_none_or(is_known));
            Some(told)
        });
        for part in Decisions::parts(head.time_s, &due, experiment.scale) {
            city.client.send(&Body::Decisions(part));
        }
        let mut due = self.plans.sample(head.time_s, || {
            let mut told = coordination(control.mainframe(), experiment, head.time_s)?;
            told.vehicles.retain(|vehicle| is_known(vehicle.id));
            Some(told)
        });
        due.left.retain(|id| is_known(*id));
        for part in Plans::parts(head.time_s, &due, experiment.scale) {
            city.client.send(&Body::Plans(part));
        }
    }

    /// Sets up the vehicles of inflows that are in the city since before this session: whoever has set up a vehicle drives
    /// it. `false` when a new handshake is needed.
    fn take_over_arrivals(&self, city: &mut Connection) -> Result<bool, SessionError> {
        for planned in self.control.demand().inside() {
            let setup = setup_of(&self.experiment, planned, self.last_seen.get(&planned.id));
            let body = |request| Body::Setup { request, setup: Box::new(setup.clone()) };
            if let Reply::Nothing = city.request_until_done(&format!("vehicle {}", planned.id), body)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Sends the commands of the last tick again, with a new barrier.
    pub(super) fn retransmit(&mut self, city: &mut Connection) {
        if let Some(barrier) = self.barrier.clone() {
            self.batch.iter().for_each(|(_, bytes)| city.client.resend(bytes));
            city.client.send(&barrier);
        }
    }

    /// The next event, where poses come from elsewhere.
    pub(super) fn receive(&mut self, city: &mut Connection, most: Duration) -> Option<ClientEvent> {
        match &mut self.feedback {
            Some(feedback) => feedback.receive(&mut city.client),
            None => city.client.receive(most.min(RETRANSMIT_INTERVAL)),
        }
    }
}

/// The setup of a vehicle at its last observed pose, or else at its start.
pub fn setup_of(
    experiment: &Experiment,
    planned: &PlannedVehicle,
    seen: Option<&VehicleState>,
) -> VehicleSetup {
    let scale = experiment.scale;
    let driver = &planned.driver;
    let mut parameters = vec![
        ("desired_speed_mps", driver.desired_speed_mps),
        ("max_acceleration_mps2", driver.max_acceleration_mps2),
        ("min_acceleration_mps2", driver.min_acceleration_mps2),
        ("headway_s", driver.headway_s),
        ("response_time_s", driver.response_time_s),
        ("standstill_gap_m", driver.standstill_gap_m),
        ("exponent", driver.exponent),
        ("lateral_acceleration_mps2", driver.lateral_acceleration_mps2),
    ];
    if driver.amplitude_mps > 0.0 {
        parameters.push(("amplitude_mps", driver.amplitude_mps));
        parameters.push(("frequency_hz", driver.frequency_hz));
    }
    let (pose, speed_mps) = match seen {
        Some(state) => (state.pose().to_lab(scale), 0.0),
        None => (planned.pose_in_lab(&experiment.city_map, scale), planned.start.speed_mps),
    };
    VehicleSetup {
        id: planned.id,
        name: planned.name.clone(),
        controller: planned.controller.clone(),
        parameters: parameters.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        appearance: planned.appearance,
        pose,
        speed_mps,
        build: VehicleBuild::Spec(Box::new(planned.spec.clone())),
    }
}
