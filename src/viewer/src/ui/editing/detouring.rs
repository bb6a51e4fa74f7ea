//! The vehicles of the edited scenario whose routes go far round: a warning, which does not keep it from running.

use super::EditView;
use super::detour::Detour;
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::CityMap;

/// Names of vehicles with a detour and what it is, found anew when a route has changed: ways are searched for each of its lanes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct DetouringVehicles {
    /// The routes that they were found in.
    routes: Vec<(VehicleId, Vec<String>)>,
    found: Vec<(String, Detour)>,
}

impl DetouringVehicles {
    /// Each vehicle's first detour in the scenario as it is.
    pub fn of(&mut self, map: &CityMap, edit: &EditView<'_>) -> &[(String, Detour)] {
        let is_known = self.routes.len() == edit.vehicles.len()
            && self
                .routes
                .iter()
                .zip(edit.vehicles)
                .all(|((id, route), now)| *id == now.id && *route == now.route);
        if !is_known {
            self.routes = edit.vehicles.iter().map(|vehicle| (vehicle.id, vehicle.route.clone())).collect();
            let detour =
                |route: &[String]| route.windows(2).find_map(|pair| Detour::between(map, &pair[0], &pair[1]));
            let round = edit.vehicles.iter().filter_map(|of| Some((of.name.clone(), detour(&of.route)?)));
            self.found = round.collect();
        }
        &self.found
    }
}
