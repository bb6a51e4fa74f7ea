//! The drivers that a program knows by name: those of City3D, and its own.

use super::{CONTROLLERS, Controller, DriverParams, controller};
use city3d_protocol::snapshot::VehicleId;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

type MakeController = dyn Fn(VehicleId, DriverParams) -> Box<dyn Controller> + Send + Sync;

/// Control algorithms by name. A scenario names one of them as the `controller` of a `[driver.NAME]`.
///
/// ```
/// use city3d_control::{Controller, DriverParams, Drivers, LeaderState, OwnMotion};
///
/// /// Full throttle on a free road, full brake behind anybody.
/// #[derive(Debug)]
/// struct BangBang(DriverParams);
///
/// impl Controller for BangBang {
///     fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<LeaderState>) -> f64 {
///         let may_accelerate = ahead.is_none() && own.measured_mps < desired_mps;
///         if may_accelerate { self.0.max_acceleration_mps2 } else { self.0.min_acceleration_mps2 }
///     }
/// }
///
/// let drivers = Drivers::standard().with("bang-bang", |params| Box::new(BangBang(params)));
/// assert!(drivers.knows("bang-bang"));
/// let names = ["bang-bang", "cacc", "cruise", "idm", "parked", "ploeg", "sinusoid"];
/// assert_eq!(drivers.names().collect::<Vec<_>>(), names);
/// ```
#[derive(Clone)]
pub struct Drivers {
    by_name: BTreeMap<String, Arc<MakeController>>,
}

impl Drivers {
    /// Those of [`CONTROLLERS`].
    pub fn standard() -> Self {
        let mut drivers = Self { by_name: BTreeMap::new() };
        for name in CONTROLLERS {
            drivers.by_name.insert(
                name.to_owned(),
                Arc::new(move |_, params| {
                    controller(name, params).unwrap_or_else(|| unreachable!("{name} is one of CONTROLLERS"))
                }),
            );
        }
        drivers
    }

    /// With another one, or with another algorithm under a name.
    #[must_use]
    pub fn with(
        self,
        name: &str,
        make: impl Fn(DriverParams) -> Box<dyn Controller> + Send + Sync + 'static,
    ) -> Self {
        self.with_each(name, move |_, params| make(params))
    }

    /// The same for an algorithm that knows which vehicle it drives.
    #[must_use]
    pub fn with_each(
        mut self,
        name: &str,
        make: impl Fn(VehicleId, DriverParams) -> Box<dyn Controller> + Send + Sync + 'static,
    ) -> Self {
        self.by_name.insert(name.to_owned(), Arc::new(make));
        self
    }

    /// The algorithm of a name, for one vehicle; `None` for an unknown name.
    pub fn controller(
        &self,
        name: &str,
        (vehicle, params): (VehicleId, DriverParams),
    ) -> Option<Box<dyn Controller>> {
        self.by_name.get(name).map(|make| make(vehicle, params))
    }

    /// Whether there is an algorithm of this name.
    pub fn knows(&self, name: &str) -> bool {
        self.by_name.contains_key(name)
    }

    /// All names, in alphabetical order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.by_name.keys().map(String::as_str)
    }
}

impl Default for Drivers {
    fn default() -> Self {
        Self::standard()
    }
}

impl fmt::Debug for Drivers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.by_name.keys()).finish()
    }
}
