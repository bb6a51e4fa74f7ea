//! Poses over UDP, and what the control framework tells of its decisions and plans: subscribers with their leases, and the
//! end that sends to them.

use super::decision_sampler::DecisionSampler;
use super::end::{End, EndHealth};
use super::plan_sampler::PlanSampler;
use super::{Moment, MomentKind};
use city3d_network::host::Host;
use city3d_network::link::{SenderId, Server};
use city3d_protocol::wire::{Body, Decisions, Plans};
use city3d_simulation::runner::pose_bodies;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Subscription to poses, with a lease.
#[derive(Debug)]
pub(crate) struct PoseSubscriber {
    pub sender: SenderId,
    every_ticks: u64,
    lease_end: Instant,
    /// It leads the experiment, or did when it subscribed last.
    leads: bool,
}

/// Those who get poses over the link of a server.
#[derive(Debug)]
pub struct PoseSubscribers {
    server: Arc<Server>,
    host: Host,
    /// Subscribers at once; one more is let in if it leads.
    most: usize,
    subscribers: Vec<PoseSubscriber>,
    decisions: DecisionSampler,
    plans: PlanSampler,
    delivered: u64,
    refused: u64,
}

impl PoseSubscribers {
    pub(crate) fn new(server: Arc<Server>, host: Host, most: usize) -> Self {
        Self {
            server,
            host,
            most,
            subscribers: Vec::new(),
            decisions: DecisionSampler::default(),
            plans: PlanSampler::default(),
            delivered: 0,
            refused: 0,
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.subscribers.is_empty()
    }

    pub(crate) fn count(&self) -> usize {
        self.subscribers.len()
    }

    /// Those whose lease has not ended.
    pub(crate) fn present(&mut self) -> &[PoseSubscriber] {
        let now = self.host.clock.now();
        self.subscribers.retain(|subscriber| subscriber.lease_end > now);
        &self.subscribers
    }

    /// Adds, renews or ends a subscription. A place is kept for who leads.
    ///
    /// # Errors
    /// When there is no room.
    pub(crate) fn subscribe(
        &mut self,
        (sender, leads): (SenderId, bool),
        every_ticks: u64,
        lease_s: f64,
    ) -> Result<(), String> {
        let now = self.host.clock.now();
        self.subscribers.retain(|subscriber| {
            subscriber.sender != sender && subscriber.lease_end > now && self.server.knows(subscriber.sender)
        });
        if self.subscribers.len() >= self.most + usize::from(leads) {
            self.refused += 1;
            return Err(format!("there are {} subscribers already", self.subscribers.len()));
        }
        if lease_s > 0.0 {
            let lease_end = now + Duration::from_secs_f64(lease_s);
            self.subscribers.push(PoseSubscriber { sender, every_ticks, lease_end, leads });
        }
        Ok(())
    }

    /// What subscribers are told of decisions and plans at a moment; all of them while the clock stands, for whoever has come.
    fn control_notes(&mut self, moment: &Moment<'_>) -> Vec<Body> {
        let (time_s, scale) = (moment.snapshot.time_s, moment.scale());
        let (decisions, plans) = match (moment.kind, moment.heard) {
            (MomentKind::Still, None) => return Vec::new(),
            (MomentKind::Still, Some(held)) => (
                held.decisions.at(time_s).unwrap_or_default(),
                held.plans.at(time_s).unwrap_or_default().into(),
            ),
            _ => (self.decisions.of_moment(moment), self.plans.of_moment(moment)),
        };
        let decisions = Decisions::parts(time_s, &decisions, scale).into_iter().map(Body::ShownDecisions);
        decisions.chain(Plans::parts(time_s, &plans, scale).into_iter().map(Body::ShownPlans)).collect()
    }

    fn send(&mut self, moment: &Moment<'_>) {
        if self.present().is_empty() {
            return;
        }
        let notes = self.control_notes(moment);
        let poses = pose_bodies(moment.snapshot, moment.phase, moment.scale());
        let is_due =
            |every_ticks| moment.kind != MomentKind::Tick || moment.snapshot.tick.is_multiple_of(every_ticks);
        for subscriber in &self.subscribers {
            // Whoever leads has told them.
            if !subscriber.leads {
                self.server.send_all(subscriber.sender, &notes);
            }
            if is_due(subscriber.every_ticks) {
                self.server.send_all(subscriber.sender, &poses);
                self.delivered += 1;
            }
        }
    }
}

/// The end that sends poses to subscribers. The system drops what finds no room in their sockets; they see it by the
/// gaps in the sequence numbers.
#[derive(Debug)]
pub struct UdpPoses(Arc<Mutex<PoseSubscribers>>);

impl UdpPoses {
    pub(crate) fn new(subscribers: Arc<Mutex<PoseSubscribers>>) -> Self {
        Self(subscribers)
    }

    fn subscribers(&self) -> MutexGuard<'_, PoseSubscribers> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl End for UdpPoses {
    fn name(&self) -> &'static str {
        "udp"
    }

    fn take(&mut self, moment: &Moment<'_>) {
        if moment.kind != MomentKind::First {
            self.subscribers().send(moment);
        }
    }

    fn health(&self) -> EndHealth {
        let subscribers = self.subscribers();
        EndHealth { delivered: subscribers.delivered, dropped: subscribers.refused, failure: None }
    }
}
