//! The vehicles of the edited scenario whose routes go far round: a warning, which does not keep it from running.

use super::EditView;
use super::detour::Detour;
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::CityMap;

/// Names of vehicles with a detour, found anew when a route has changed: ways are searched for each of its lanes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct DetouringVehicles {
    /// The routes that they were found in.
    of: Vec<(VehicleId, Vec<String>)>,
    names: Vec<String>,
}

impl DetouringVehicles {
    /// The names for the scenario as it is.
    pub fn names(&mut self, map: &CityMap, edit: &EditView<'_>) -> &[String] {
        let is_known = self.of.len() == edit.vehicles.len()
            && self
                .of
                .iter()
                .zip(edit.vehicles)
                .all(|((id, route), now)| *id == now.id && *route == now.route);
        if !is_known {
            self.of = edit.vehicles.iter().map(|vehicle| (vehicle.id, vehicle.route.clone())).collect();
            let goes_round = |route: &[String]| {
                route.windows(2).any(|pair| Detour::between(map, &pair[0], &pair[1]).is_some())
            };
            let round = edit.vehicles.iter().filter(|vehicle| goes_round(&vehicle.route));
            self.names = round.map(|vehicle| vehicle.name.clone()).collect();
        }
        &self.names
    }
}
