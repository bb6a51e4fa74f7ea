//! Converts logged bodies into the commands of the simulation.

use super::{Body, ExperimentAction, Message};
use crate::snapshot::{SimCommand, VehicleSpec};
use city3d_geometry::LengthScale;
use std::collections::BTreeMap;

impl Body {
    /// The simulation commands of a body, in their order; `types` are the vehicle types of the scenario.
    ///
    /// # Errors
    /// When the body is not a command, or names an unknown vehicle type.
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
            Self::Poses(poses) => {
                poses.vehicles.iter().map(|observed| observed.pose.into_command(scale)).collect()
            }
            Self::Remove { vehicle, .. } => vec![SimCommand::Remove(vehicle)],
            Self::Drive { vehicle, pedals, .. } => vec![match pedals {
                Some(pedals) => SimCommand::Drive(vehicle, pedals),
                None => SimCommand::Release(vehicle),
            }],
            Self::Signals(aspects) => vec![SimCommand::Signals(aspects)],
            Self::Command { action, .. } => vec![match action {
                ExperimentAction::Start => SimCommand::Start,
                ExperimentAction::Pause => SimCommand::Pause,
                ExperimentAction::Reset => SimCommand::Reset,
            }],
            _ => return Err(format!("kind {kind} is not a command")),
        })
    }
}
