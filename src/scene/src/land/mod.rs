//! The land around a town: fields with hedgerows, woods, roads that lead out, farms, and the gardens behind its houses.
//! A pure function of the map, as the town is.

mod country_roads;
mod farms;
mod fields;
mod gardens;
mod greenery;
mod hedgerows;
mod mouth;
mod relief;
mod sheds;
mod sheet;
mod woods;

use super::doorways::Way;
use super::lanes::LaneBoxIndex;
use super::mesh::Mesh;
use super::roads::{RoadField, closed_ground};
use super::surroundings::Surroundings;
use super::trees::TreePrototypes;
use super::{SceneObject, TreeShade};
use city3d_roadmap::CityMap;
pub(super) use country_roads::CountryRoad;
use farms::Farm;
use fields::Fields;
use gardens::Garden;
use glam::DVec2;
use greenery::Greenery;
use relief::Relief;
use sheet::LandSheet;
use woods::Woods;

/// The land around the closed ground of a town.
pub(super) struct Land {
    relief: Relief,
    roads: Vec<CountryRoad>,
    farms: Vec<Farm>,
    gardens: Vec<Garden>,
    /// Nodes along the edge of the closed ground, counter-clockwise.
    rim: Vec<DVec2>,
}

/// The roads that lead out of the town of a map, as the land around it has them.
pub(super) fn roads_out(map: &CityMap) -> Vec<CountryRoad> {
    roads_from(map, &RoadField::new(map))
}

/// [`roads_out`] for the road field of the map.
pub(super) fn roads_from(map: &CityMap, field: &RoadField) -> Vec<CountryRoad> {
    country_roads::roads(map, field, &Relief { town: closed_ground(map), yards: Vec::new() })
}

impl Land {
    /// The land from the rim of the closed ground on; these roads lead out, these ways to doors stay free.
    pub(super) fn new(
        map: &CityMap,
        field: &RoadField,
        rim: Vec<DVec2>,
        (roads, ways): (Vec<CountryRoad>, &[Way]),
    ) -> Self {
        let around = |[low, high]: [DVec2; 2], at: &DVec2| [low.min(*at), high.max(*at)];
        let town = rim.iter().fold([DVec2::INFINITY, DVec2::NEG_INFINITY], around);
        let mut relief = Relief { town, yards: Vec::new() };
        let farms = farms::farms(&relief, &roads, Woods { relief: &relief });
        relief.yards = farms.iter().map(|farm| farm.yard).collect();
        let gardens = gardens::gardens(map, field, &roads, ways);
        Self { relief, roads, farms, gardens, rim }
    }

    /// The ground of the land, which closes around that of the town.
    pub(super) fn ground(&self) -> Mesh {
        let Self { relief, roads, .. } = self;
        let fields = Fields::new(relief);
        let far_fields = Fields::far(relief);
        LandSheet { relief, fields: &fields, far_fields: &far_fields, roads, woods: Woods { relief } }
            .mesh(&self.rim)
    }

    /// The gravel of yards, over the ground.
    pub(super) fn yards(&self) -> Mesh {
        let mut mesh = Mesh::default();
        self.farms.iter().for_each(|farm| farm.ground(&mut mesh));
        mesh
    }

    /// What lies on the closed ground: lawns and paths of gardens, the beginnings of the roads out.
    pub(super) fn lay(&self, mesh: &mut Mesh) {
        self.gardens.iter().for_each(|garden| garden.ground(mesh));
        self.roads.iter().for_each(|road| road.approach_mesh(mesh));
    }

    /// What stands in gardens.
    pub(super) fn gardens(&self, nursery: &TreePrototypes) -> Vec<SceneObject> {
        self.gardens.iter().flat_map(|garden| garden.objects(nursery)).collect()
    }

    /// What stands and grows in the land.
    pub(super) fn objects(
        &self,
        nursery: &TreePrototypes,
        lanes: &LaneBoxIndex<'_>,
        around: &Surroundings<'_>,
    ) -> Vec<SceneObject> {
        let mut objects = self.greenery(nursery, |greenery| greenery.objects());
        objects.extend(self.farms.iter().flat_map(|farm| farm.buildings(lanes, around)));
        objects
    }

    /// Trees in the open: the shadow map does not reach them.
    pub(super) fn shades(&self, nursery: &TreePrototypes) -> Vec<TreeShade> {
        self.greenery(nursery, |greenery| greenery.shades())
    }

    fn greenery<R>(&self, nursery: &TreePrototypes, found: impl FnOnce(&Greenery<'_>) -> R) -> R {
        let Self { relief, roads, farms, .. } = self;
        let fields = Fields::new(relief);
        found(&Greenery { relief, fields: &fields, roads, woods: Woods { relief }, farms, nursery })
    }
}

#[cfg(test)]
mod tests;
