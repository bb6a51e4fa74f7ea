//! The coordination algorithms that a program knows by name: those of City3D, and its own.

use super::scheduler::{COORDINATORS, Coordinator, coordinator};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

type MakeCoordinator = dyn Fn() -> Box<dyn Coordinator> + Send + Sync;

/// Coordination algorithms by name. A scenario names one of them as the `algorithm` of `[coordination]`.
///
/// ```
/// use city3d_control::coordination::{Coordinator, Coordinators, Grant, ZoneView};
///
/// /// Lets the vehicle with the largest id go first.
/// #[derive(Debug)]
/// struct LastComeFirstServed;
///
/// impl Coordinator for LastComeFirstServed {
///     fn schedule(&mut self, view: &mut ZoneView<'_>) {
///         for request in view.requests().to_vec().into_iter().rev() {
///             let _ = view.grant(request.vehicle, Grant { not_before_s: view.now_s(), fills_gaps: true });
///         }
///     }
/// }
///
/// let coordinators = Coordinators::standard().with("lifo", || Box::new(LastComeFirstServed));
/// assert!(coordinators.coordinator("lifo").is_some());
/// assert_eq!(coordinators.names().collect::<Vec<_>>(), ["fifo", "insert", "lifo", "priority", "replan"]);
/// ```
#[derive(Clone)]
pub struct Coordinators {
    by_name: BTreeMap<String, Arc<MakeCoordinator>>,
}

impl Coordinators {
    /// Those of [`COORDINATORS`].
    pub fn standard() -> Self {
        let mut coordinators = Self { by_name: BTreeMap::new() };
        for name in COORDINATORS {
            let make =
                move || coordinator(name).unwrap_or_else(|| unreachable!("{name} is one of COORDINATORS"));
            coordinators.by_name.insert(name.to_owned(), Arc::new(make));
        }
        coordinators
    }

    /// With another one, or with another algorithm under a name.
    #[must_use]
    pub fn with(
        mut self,
        name: &str,
        make: impl Fn() -> Box<dyn Coordinator> + Send + Sync + 'static,
    ) -> Self {
        self.by_name.insert(name.to_owned(), Arc::new(make));
        self
    }

    /// The algorithm of a name; `None` for an unknown name.
    pub fn coordinator(&self, name: &str) -> Option<Box<dyn Coordinator>> {
        self.by_name.get(name).map(|make| make())
    }

    /// All names, in alphabetical order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.by_name.keys().map(String::as_str)
    }
}

impl Default for Coordinators {
    fn default() -> Self {
        Self::standard()
    }
}

impl fmt::Debug for Coordinators {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.by_name.keys()).finish()
    }
}
