//! The driver's seat: who may drive which vehicle from this window, and what a person who leaves it is told.

use super::{ViewedRun, ViewerState};
use crate::ui::{self, CameraMode, CityKind, KeyMap, ManualDrive, commands};
use city3d_protocol::snapshot::{Status, VehicleId, VehicleInfo};
use city3d_session::{Order, RunState};

impl ViewerState {
    /// Gives the user the vehicle that the scenario reserves for a person, or the car that this window has brought,
    /// once per run.
    pub(super) fn seat_user(&mut self, now_s: f64) {
        let run_state = self.run_state();
        let is_new = matches!(self.source, ViewedRun::Run(_)) && self.seated_in_run != run_state.run;
        let own = match self.city {
            CityKind::Local => self.scenario_info.own,
            CityKind::Served => None,
            CityKind::Elsewhere => run_state.link.as_ref().and_then(|link| link.own_vehicle),
        };
        let is_there = own.is_some_and(|vehicle| run_state.now.vehicle(vehicle).is_some());
        if is_new && (is_there || self.city == CityKind::Local) {
            self.seated_in_run = run_state.run;
            if let Some(vehicle) = own {
                self.take_over(vehicle, now_s);
            }
        }
    }

    /// Why a vehicle cannot be driven from here.
    fn reason_against_driving(&self, vehicle: VehicleId, run_state: &RunState) -> Option<String> {
        let is_physical = run_state.now.info(vehicle).is_some_and(VehicleInfo::is_physical);
        if is_physical || self.experiment.is_physical(vehicle) {
            return Some(format!("Vehicle {vehicle} is in the laboratory: it is measured here, not driven."));
        }
        let own = run_state.link.as_ref().and_then(|link| link.own_vehicle);
        match (self.city, own) {
            (CityKind::Elsewhere, None) => Some(
                "This window watches a city elsewhere; city3d view --city ADDR --guest brings a car of your own."
                    .to_owned(),
            ),
            (CityKind::Elsewhere, Some(own)) if own != vehicle => {
                Some(format!("Vehicle {vehicle} is not yours; your car is number {own}."))
            }
            _ => None,
        }
    }

    pub(super) fn take_over(&mut self, vehicle: VehicleId, now_s: f64) {
        let run_state = self.run_state();
        if let Some(why) = self.reason_against_driving(vehicle, &run_state) {
            self.state.say(why, now_s);
            return;
        }
        self.give_back(now_s);
        self.past.go_live();
        let Some(state) = run_state.now.vehicle(vehicle) else { return };
        self.released.retain(|released| *released != vehicle);
        self.state.driving = Some(ManualDrive::take_over(vehicle, run_state.run, state.steering_rad));
        self.state.selection.vehicle = Some(vehicle);
        self.state.viewpoint.set_mode(CameraMode::Chase, Some(vehicle));
        self.state.viewpoint.follow = Some(vehicle);
    }

    pub(super) fn give_back(&mut self, now_s: f64) {
        let Some(driving) = self.state.driving.take() else { return };
        if self.send(Order::Release(driving.vehicle)) {
            self.released.push(driving.vehicle);
        }
        self.state.viewpoint.rear = false;
        let run_state = self.run_state();
        let found = run_state.now.vehicle(driving.vehicle).zip(run_state.now.info(driving.vehicle));
        let Some((vehicle, info)) = found else { return };
        let name = &info.name;
        if vehicle.status == Status::Collided {
            self.state.say(stays_collided(&self.state.keys, name), now_s);
        } else if ui::is_off_lanes(vehicle, info, &self.experiment.city_map) {
            let text = format!(
                "{name} is off the lanes: its algorithm has no route from there, and stops it. \
                 Reset the run, or drive it back onto a lane"
            );
            self.state.say(self.state.keys.tip(&text, &commands::TAKE_CONTROL), now_s);
        }
    }
}

/// What to do with a vehicle that has collided and is left alone.
fn stays_collided(keys: &KeyMap, name: &str) -> String {
    let drive = keys.tip("Drive it off", &commands::TAKE_CONTROL);
    let reverse = keys.tip("with the reverse gear", &commands::REVERSE);
    let reset = keys.tip("or reset the run", &commands::RESET);
    format!("{name} has collided and stays where it is. {drive}, {reverse} if need be, {reset}.")
}
