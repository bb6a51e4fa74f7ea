//! What the city has done with datagrams that it took: the commands that came of them.

use super::{Action, Body, Message};
use crate::geom::LengthScale;
use crate::snapshot::{SimCommand, VehicleSpec};
use std::collections::BTreeMap;

impl Body {
    /// The commands that a body became in the city, in their order; `types` are the builds of its scenario.
    ///
    /// # Errors
    /// Where it is no command, or names a vehicle type that is not there.
    pub fn into_commands(
        self,
        scale: LengthScale,
        types: &BTreeMap<String, VehicleSpec>,
    ) -> Result<Vec<SimCommand>, String> {
        let kind = self.kind();
        Ok(match self {
            Self::Trajectories(list) => {
                list.into_iter().map(|one| Message::Follow(one).into_command(scale)).collect()
            }
            Self::Setup { setup, .. } => {
                let spec = setup.build.resolve(types)?;
                vec![SimCommand::Spawn(Box::new(setup.in_city(scale, spec)))]
            }
            Self::Poses(poses) => poses.vehicles.iter().map(|seen| seen.pose.into_command(scale)).collect(),
            Self::Remove { vehicle, .. } => vec![SimCommand::Remove(vehicle)],
            Self::Command { action, .. } => vec![match action {
                Action::Start => SimCommand::Start,
                Action::Pause => SimCommand::Pause,
                Action::Reset => SimCommand::Reset,
            }],
            _ => return Err(format!("kind {kind} is no command")),
        })
    }
}
