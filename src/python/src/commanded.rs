//! Drivers whose acceleration can be ordered from outside.

use city3d_control::{
    CONTROLLERS, Controller, DriverParams, Drivers, LeaderState, OwnMotion, PlatoonBroadcast, controller,
};
use city3d_protocol::snapshot::VehicleId;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Name of the driver of vehicles that environments command: IDM, until it is told otherwise.
pub const AGENT: &str = "agent";
/// The speed that the road allows is approached within this time.
const APPROACHES_S: f64 = 0.1;

/// An ordered acceleration, laboratory m/s2; NaN for none.
#[derive(Debug)]
struct Wanted(AtomicU64);

impl Wanted {
    fn set(&self, mps2: Option<f64>) {
        self.0.store(mps2.unwrap_or(f64::NAN).to_bits(), Ordering::Relaxed);
    }

    fn get(&self) -> Option<f64> {
        Some(f64::from_bits(self.0.load(Ordering::Relaxed))).filter(|mps2| !mps2.is_nan())
    }
}

/// The ordered accelerations of a world by vehicle. They change between steps only.
#[derive(Clone, Debug, Default)]
pub struct CommandedAccelerations(Arc<Mutex<BTreeMap<VehicleId, Arc<Wanted>>>>);

impl CommandedAccelerations {
    fn all(&self) -> std::sync::MutexGuard<'_, BTreeMap<VehicleId, Arc<Wanted>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Orders an acceleration, laboratory m/s2, or none.
    pub fn set(&self, vehicle: VehicleId, mps2: Option<f64>) {
        if let Some(wanted) = self.all().get(&vehicle) {
            wanted.set(mps2);
        }
    }

    /// Forgets all vehicles, before their drivers are made again.
    pub fn clear(&self) {
        self.all().clear();
    }

    /// The drivers that every scenario knows and [`AGENT`], all of which obey.
    pub fn drivers(&self) -> Drivers {
        let names = CONTROLLERS.into_iter().map(|name| (name, name)).chain([(AGENT, "idm")]);
        names.fold(Drivers::standard(), |drivers, (name, algorithm)| {
            let all = self.clone();
            drivers.with_each(name, move |vehicle, params| {
                let own = controller(algorithm, params)
                    .unwrap_or_else(|| unreachable!("{algorithm} is one of CONTROLLERS"));
                all.obeying(own, (vehicle, params))
            })
        })
    }

    /// A driver that does as ordered, and else what another one does.
    pub fn obeying(
        &self,
        own: Box<dyn Controller>,
        (vehicle, params): (VehicleId, DriverParams),
    ) -> Box<dyn Controller> {
        let wanted = Arc::new(Wanted(AtomicU64::new(f64::NAN.to_bits())));
        self.all().insert(vehicle, Arc::clone(&wanted));
        Box::new(Obeying { own, wanted, params })
    }
}

/// A driver that does as ordered: it heeds no leader then, but the speed that the road allows.
#[derive(Debug)]
struct Obeying {
    own: Box<dyn Controller>,
    wanted: Arc<Wanted>,
    params: DriverParams,
}

impl Obeying {
    fn ordered(&self, own: OwnMotion, desired_mps: f64) -> Option<f64> {
        let mps2 = self.wanted.get()?.min((desired_mps - own.measured_mps) / APPROACHES_S);
        Some(mps2.clamp(self.params.min_acceleration_mps2, self.params.max_acceleration_mps2))
    }
}

impl Controller for Obeying {
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<LeaderState>) -> f64 {
        self.ordered(own, desired_mps).unwrap_or_else(|| self.own.acceleration(own, desired_mps, ahead))
    }

    fn platoon_acceleration(&self, own: OwnMotion, desired_mps: f64, platoon: &PlatoonBroadcast) -> f64 {
        let ordered = self.ordered(own, desired_mps);
        ordered.unwrap_or_else(|| self.own.platoon_acceleration(own, desired_mps, platoon))
    }

    fn can_platoon(&self) -> bool {
        self.own.can_platoon()
    }
}
