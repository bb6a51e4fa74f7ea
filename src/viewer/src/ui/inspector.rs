//! The inspector: why the selected vehicle does what it does. Lane, leader, gap and headway come from poses, and so from
//! every source; reasons are told by the control framework, here, elsewhere or in a log.

use super::commands::{self, PREVIEW, TAKE_CONTROL, key_map};
use super::theme::{self, DecimalSeparator, SpeedUnit};
use super::{CityKind, UiAction, UiState, ViewModel, plans, status};
use city3d_control::PLAN_SLACK_M;
use city3d_control::{CRUISE, PARKED};
use city3d_protocol::snapshot::{
    ControlDecision, DecisionReason, EventKind, Status, VehicleId, VehicleInfo, VehicleState,
};
use city3d_session::ControlInsight;
use city3d_session::playback::{Occurrence, TimelineMark};
use city3d_simulation::measures::{LeaderAhead, TrafficPlace};
use egui::{Color32, Grid, Label, RectAlign, Response, RichText, Tooltip, Ui};

/// What is written where something is not told: in the past and in logs because nobody has recorded it, of other cities because
/// they do not send it.
pub fn not_told(shown: &ViewModel<'_>) -> &'static str {
    if shown.edit.is_some() {
        "known once it runs"
    } else if shown.replay.is_some() || shown.past.is_shown {
        "not recorded"
    } else if shown.city == CityKind::Local {
        "not known"
    } else {
        "not sent by this city"
    }
}
/// In place of an error of tracking.
const OFF_ROUTE: &str = "no path, off its route";
/// Width of the names, points.
const NAMES: f32 = 120.0;
/// Lanes of the route that are listed.
const LISTED_LANES: usize = 4;
/// A lower panel needs the room for its rows, points.
const LOW: f32 = 230.0;

/// Shows what is known of the selected vehicle.
pub fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let now = &shown.run_state.now;
    let found = state.selection.vehicle.and_then(|id| now.vehicle(id).zip(now.info(id)));
    let Some((vehicle, info)) = found else {
        ui.label("Select a vehicle: click it in the city or in the table.");
        return;
    };
    let route = shown.routes.get(&vehicle.id).map_or(&[][..], Vec::as_slice);
    let place = TrafficPlace::of((shown.map, shown.traffic.lanes()), now, vehicle.id, route);
    let insight = shown.run_state.insight.as_deref();
    let decision = insight.and_then(|insight| insight.decision(vehicle.id));
    // Who it is and what can be done with it stay in sight; what is known of it scrolls.
    let is_low = ui.available_height() < LOW;
    if is_low {
        // One row, where it finds room.
        ui.horizontal_wrapped(|ui| {
            heading(ui, shown, (vehicle, info));
            buttons(ui, state, (shown, actions), vehicle.id);
        });
        ui.spacing_mut().interact_size.y = 0.0;
    } else {
        ui.horizontal(|ui| heading(ui, shown, (vehicle, info)));
        ui.horizontal(|ui| buttons(ui, state, (shown, actions), vehicle.id));
        ui.separator();
    }
    // Each vehicle is read from the top, in each run.
    egui::ScrollArea::vertical().id_salt((vehicle.id, shown.run_state.run)).show(ui, |ui| {
        inspected(ui, state, shown, (vehicle, place.as_ref()), (insight, decision));
    });
}

/// What is known of a vehicle: its place in traffic, and what control has told.
fn inspected(
    ui: &mut Ui,
    state: &mut UiState,
    shown: &ViewModel<'_>,
    (vehicle, place): (&VehicleState, Option<&TrafficPlace>),
    (insight, decision): (Option<&ControlInsight>, Option<&ControlDecision>),
) {
    let mut link = None;
    // Values wrap; the names are short.
    let widest = (ui.available_width() - NAMES).max(NAMES);
    Grid::new("inspector").max_col_width(widest).num_columns(2).spacing([10.0, 4.0]).striped(true).show(ui, |ui| {
        why(ui, shown, (vehicle, decision), &mut link);
        hit(ui, shown, vehicle, &mut link);
        if let Some(plan) = plans::inspected(shown, vehicle.id, state.preferences.decimal) {
            let tip = "Its control zone, when its front bumper enters the first conflict there, and how many enter before it";
            row(ui, "Plan", &plan, tip);
        }
        motion(ui, shown, (state.preferences.units, vehicle), decision);
        traffic(ui, shown, place, &mut link);
        // One that a person has driven into something is shown as collided.
        let is_own = state.driven() == Some(vehicle.id);
        let is_driven = vehicle.status == Status::Manual || is_own;
        trajectory(ui, shown, (vehicle, is_driven), decision);
        let delay_s = insight.and_then(|insight| insight.command_delays_s.get(&vehicle.id));
        let delay = delay_s.map_or_else(|| not_told(shown).to_owned(), |s| format!("{:.0} ms", s * 1000.0));
        row(ui, "Command delay", &delay, "From the control step to the arrival of its last trajectory");
        sensors(ui, shown, vehicle.id);
        rest(ui, shown, (vehicle, is_driven, is_own), place);
    });
    if let Some(other) = link {
        (state.selection.vehicle, state.table.reveal) = (Some(other), true);
    }
}

/// What can be done with the vehicle.
fn buttons(
    ui: &mut Ui,
    state: &mut UiState,
    (shown, actions): (&ViewModel<'_>, &mut Vec<UiAction>),
    id: VehicleId,
) {
    let follows = state.viewpoint.follow == Some(id);
    if ui.add_enabled(!follows, egui::Button::new("Follow")).clicked() {
        state.selection.follow = Some(id);
    }
    if ui.button("Camera").on_hover_text(PREVIEW.tip(ui.ctx(), "Open or close its preview")).clicked() {
        state.toggle_preview(id);
    }
    if shown.replay.is_none() && shown.may_drive(id) && state.driven() != Some(id) {
        let tip = TAKE_CONTROL.tip(ui.ctx(), "Drive it with the keyboard");
        let present = commands::PAST_IS_SHOWN.words(&key_map::of(ui.ctx()));
        let button = ui.add_enabled(!shown.past.is_shown, egui::Button::new("Take control"));
        let button = button.on_hover_text(tip).on_disabled_hover_text(present);
        if button.clicked() {
            actions.push(UiAction::Drive(id));
        }
    }
}

fn heading(ui: &mut Ui, shown: &ViewModel<'_>, (vehicle, info): (&VehicleState, &VehicleInfo)) {
    let [r, g, b] = info.appearance.colour;
    super::vehicles::chip(ui, Color32::from_rgb(r, g, b), info.is_physical());
    ui.strong(format!("{} {}", vehicle.id, info.name));
    ui.label(RichText::new(status::label(vehicle.status)).color(theme::on_panel(ui.ctx(), vehicle.status)))
        .on_hover_ui(|ui| _ = ui.label(status::reason(&key_map::of(ui.ctx()), vehicle, info, shown.map)));
}

fn row(ui: &mut Ui, name: &str, text: &str, tip: &str) {
    let (name, value) = (ui.label(RichText::new(name).weak()), ui.add(Label::new(text).wrap()));
    tip_beside(&name, &value, tip);
    tip_beside(&value, &value, tip);
    ui.end_row();
}

/// Tells more beside the value of a row: below it a tip would cover the next row.
fn tip_beside(hovered: &Response, value: &Response, tip: &str) {
    let mut about = Tooltip::for_enabled(hovered);
    about.popup = about.popup.anchor(value.rect).align(RectAlign::RIGHT_START);
    about.show(|ui| ui.label(tip));
}

/// A row with a vehicle, which a click selects.
fn row_with_vehicle(
    ui: &mut Ui,
    (name, text, tip): (&str, &str, &str),
    vehicle: VehicleId,
    link: &mut Option<VehicleId>,
) {
    let (name, value) = (ui.label(RichText::new(name).weak()), ui.link(text));
    tip_beside(&name, &value, tip);
    tip_beside(&value, &value, &format!("{tip}. Click to select vehicle {vehicle}"));
    if value.clicked() {
        *link = Some(vehicle);
    }
    ui.end_row();
}

/// A collision that its status does not tell: a vehicle of the laboratory goes on, and one that was driven off drives again.
fn hit(ui: &mut Ui, shown: &ViewModel<'_>, vehicle: &VehicleState, link: &mut Option<VehicleId>) {
    if vehicle.status == Status::Collided || last_collision(shown, vehicle.id).is_none() {
        return;
    }
    let is_physical = shown.run_state.now.info(vehicle.id).is_some_and(VehicleInfo::is_physical);
    let tip = if is_physical { status::RAMMED_PHYSICAL } else { "Its last collision; it drives again" };
    let (text, other) = collision_words(shown, vehicle.id);
    match other {
        Some(other) => row_with_vehicle(ui, ("Collision", &text, tip), other, link),
        None => row(ui, "Collision", &text, tip),
    }
}

fn why(
    ui: &mut Ui,
    shown: &ViewModel<'_>,
    (vehicle, decision): (&VehicleState, Option<&ControlDecision>),
    link: &mut Option<VehicleId>,
) {
    let tip = "What limits it in the last control step, as the control framework tells";
    // Control goes on deciding for a vehicle that no longer obeys it.
    match vehicle.status {
        Status::Collided => {
            let is_physical = shown.run_state.now.info(vehicle.id).is_some_and(VehicleInfo::is_physical);
            let tip = if is_physical {
                status::RAMMED_PHYSICAL
            } else {
                "It has hit something, and stays where it is"
            };
            let (text, other) = collision_words(shown, vehicle.id);
            let by = if is_by_hand(shown, vehicle.id) { ", driven by hand" } else { "" };
            let text = format!("{text}{by}");
            let tip = if by.is_empty() { tip } else { "It has hit something, and a person drives it" };
            return match other {
                Some(other) => row_with_vehicle(ui, ("Why", &text, tip), other, link),
                None => row(ui, "Why", &text, tip),
            };
        }
        Status::Manual => return row(ui, "Why", "driven by hand", "A person drives it"),
        _ => {}
    }
    let driver = shown.drivers.get(&vehicle.id).map(String::as_str);
    if driver == Some(PARKED) {
        return row(ui, "Why", "parked", "An obstacle: its driver stays where it is");
    }
    let Some(decision) = decision else { return row(ui, "Why", not_told(shown), tip) };
    let text = reason_words(shown, decision);
    if driver == Some(CRUISE) {
        // A free road before an obstacle would mislead.
        let text = match decision.reason {
            DecisionReason::FreeRoad => "at its own speed",
            _ => &text,
        };
        let text = format!("{text}; cruise ignores other vehicles");
        return row(ui, "Why", &text, tip);
    }
    match decision.other {
        Some(other) => row_with_vehicle(ui, ("Why", &text, tip), other, link),
        None => row(ui, "Why", &text, tip),
    }
}

/// The last collision of a vehicle so far, in words, and the other vehicle.
fn collision_words(shown: &ViewModel<'_>, id: VehicleId) -> (String, Option<VehicleId>) {
    let Some((mark, other)) = last_collision(shown, id) else { return ("has collided".to_owned(), None) };
    let with = match (&mark.what, other) {
        (_, Some(other)) => other.to_string(),
        (Occurrence::Event(EventKind::CollisionStatic { with }), None) => with.clone(),
        _ => "something".to_owned(),
    };
    (format!("collided with {with} at {:.2} s", mark.time_s), other)
}

/// Whether a person drives a vehicle at the shown time, which a collision hides in its status.
fn is_by_hand(shown: &ViewModel<'_>, id: VehicleId) -> bool {
    let until_s = shown.run_state.now.time_s + 1e-6;
    let mut so_far = shown.events.iter().rev().filter(|mark| mark.vehicle == id && mark.time_s <= until_s);
    let change = so_far.find(|mark| matches!(mark.what, Occurrence::TakeOver | Occurrence::GiveBack));
    change.is_some_and(|mark| mark.what == Occurrence::TakeOver)
}

/// The last collision of a vehicle up to the shown time, and the vehicle that it was with; `None` for what is no vehicle.
pub(super) fn last_collision<'a>(
    shown: &ViewModel<'a>,
    id: VehicleId,
) -> Option<(&'a TimelineMark, Option<VehicleId>)> {
    let until_s = shown.run_state.now.time_s + 1e-6;
    let mut so_far = shown.events.iter().rev().filter(|mark| mark.time_s <= until_s);
    so_far.find_map(|mark| match &mark.what {
        Occurrence::Event(EventKind::Collision { with }) if mark.vehicle == id => Some((mark, Some(*with))),
        Occurrence::Event(EventKind::Collision { with }) if *with == id => Some((mark, Some(mark.vehicle))),
        Occurrence::Event(EventKind::CollisionStatic { .. }) if mark.vehicle == id => Some((mark, None)),
        _ => None,
    })
}

/// A decision in words.
pub fn reason_words(shown: &ViewModel<'_>, decision: &ControlDecision) -> String {
    let named = |id: VehicleId| {
        let info = shown.run_state.now.info(id);
        info.map_or_else(|| id.to_string(), |info| format!("{id} {}", info.name))
    };
    let other = decision.other.map(named);
    let with = |with: &str, without: &str| match &other {
        Some(other) => format!("{with} {other}"),
        None => without.to_owned(),
    };
    let what = match decision.reason {
        DecisionReason::FreeRoad => "free road".to_owned(),
        DecisionReason::RoadSpeed => "speed of the bend or limit ahead".to_owned(),
        DecisionReason::Leader => with("follows", "follows a vehicle that others control"),
        DecisionReason::Platoon => with("in a platoon behind", "in a platoon"),
        DecisionReason::RouteEnd => "end of its route".to_owned(),
        DecisionReason::StopLine => with("yields at the stop line to", "stops at the stop line"),
        DecisionReason::YieldLine => with("yields at the yield line to", "slows for the yield line"),
        DecisionReason::Signal => "the signal is not green".to_owned(),
        DecisionReason::Junction => with("yields at the junction to", "slows for the junction"),
        DecisionReason::NoRoom => with("no room behind the junction, after", "no room behind the junction"),
        DecisionReason::Crossing => with("waits for the crossing of", "waits before a crossing"),
        // Who is in the ring already merges behind others, too, without giving way.
        DecisionReason::Merging => with("merges behind", "merges behind another vehicle"),
        DecisionReason::Plan => "follows its coordinated plan".to_owned(),
        DecisionReason::SafetyFilter => "the safety filter brakes its plan".to_owned(),
        DecisionReason::NotMeasured => "not measured for too long, stops".to_owned(),
        DecisionReason::OffRoute => "on no lane of its route, stops".to_owned(),
    };
    // How far the leader is says the gap.
    if decision.reason == DecisionReason::Leader {
        return what;
    }
    let now = &shown.run_state.now;
    let front = |(vehicle, info): (&VehicleState, &VehicleInfo)| {
        vehicle.pose().point_at(info.dimensions.length_m / 2.0, 0.0)
    };
    let front = now.vehicle(decision.vehicle).zip(now.info(decision.vehicle)).map(front);
    let away_m = decision.place.zip(front).map(|(place, front)| place.distance(front));
    // Not how far the other vehicle is.
    away_m.map_or(what.clone(), |m| format!("{what}; {m:.0} m to that place"))
}

fn motion(
    ui: &mut Ui,
    shown: &ViewModel<'_>,
    (units, vehicle): (SpeedUnit, &VehicleState),
    decision: Option<&ControlDecision>,
) {
    let (decimal, scale) = (theme::decimal(ui.ctx()), shown.scale());
    let speed = |speed_mps: f64| format!("{} {}", units.number(speed_mps, scale, decimal), units.label());
    // Control goes on deciding for a vehicle that does not obey it.
    let is_parked = shown.drivers.get(&vehicle.id).is_some_and(|driver| driver == PARKED);
    let obeys = obeys_control(vehicle.status) && !is_parked;
    let decision = decision.filter(|_| obeys);
    if !status::is_tracked(vehicle.status) {
        let unknown = format!("{}, not tracked", status::NOT_MEASURED);
        row(ui, "Speed", &unknown, status::NOT_MEASURED_TIP);
        return row(ui, "Acceleration", &unknown, status::NOT_MEASURED_TIP);
    }
    let target = match decision {
        Some(decision) => format!(", target {}", speed(decision.target_mps)),
        None if obeys => format!(", target {}", not_told(shown)),
        None => String::new(),
    };
    let speeds = status::speed_words(vehicle.status, speed(vehicle.speed_mps));
    let speeds = format!("{speeds}{target}");
    row(ui, "Speed", &speeds, "Along its heading, and what road and driver allow here");
    // Decisions are sampled for logs, links and the past: that of a moment ago is not the one of now.
    let is_of_now = shown.city == CityKind::Local && shown.replay.is_none() && !shown.past.is_shown;
    let planned = decision.filter(|_| is_of_now).map_or_else(String::new, |decision| {
        format!(", planned {}", decimal.signed(decision.acceleration_mps2, 2))
    });
    let acceleration = format!("{} m/s\u{b2}{planned}", decimal.signed(vehicle.acceleration_mps2, 2));
    row(
        ui,
        "Acceleration",
        &acceleration,
        "Along its heading, smoothed where it is measured; as in the charts",
    );
}

/// Whether a vehicle follows what control decides.
fn obeys_control(status: Status) -> bool {
    !matches!(status, Status::Manual | Status::Collided)
}

fn traffic(ui: &mut Ui, shown: &ViewModel<'_>, place: Option<&TrafficPlace>, link: &mut Option<VehicleId>) {
    let Some(place) = place else {
        row(ui, "Lane", "none", "Its front axle is on no lane in its direction");
        return;
    };
    let lane = shown.map.lane(place.axle.lane);
    let decimal = theme::decimal(ui.ctx());
    let [at, length] = [place.axle.at_m, lane.curve.length()].map(|metres| decimal.tenths(metres));
    let text = format!("{}, {at} of {length} m", lane.name);
    row(ui, "Lane", &text, "Under its front axle");
    let Some(leader) = &place.leader else {
        row(ui, "Leader", "none within 60 m", "The nearest vehicle ahead on its way");
        return;
    };
    let name = shown.run_state.now.info(leader.vehicle).map_or("", |info| info.name.as_str());
    let text = format!("{} {name}", leader.vehicle);
    let tip = "The nearest vehicle ahead on its way";
    row_with_vehicle(ui, ("Leader", &text, tip), leader.vehicle, link);
    row(
        ui,
        "Gap",
        &gap_words(leader, decimal),
        "From bumper to bumper; time headway: gap over its speed; time to collision: gap over the speed at which it closes, where that is below 20 s",
    );
}

/// Gap, headway and time to collision in words.
fn gap_words(leader: &LeaderAhead, decimal: DecimalSeparator) -> String {
    let seconds = |what: &str, s: f64| format!(", {what} {} s", decimal.fixed(s, 1));
    let headway = leader.headway_s().map_or_else(String::new, |s| seconds("headway", s));
    let ttc_s = leader.following.ttc_s().filter(|s| *s < 20.0);
    let ttc = ttc_s.map_or_else(String::new, |s| seconds("time to collision", s));
    format!("{} m{headway}{ttc}", decimal.tenths(leader.following.gap_m))
}

fn trajectory(
    ui: &mut Ui,
    shown: &ViewModel<'_>,
    (vehicle, is_driven): (&VehicleState, bool),
    decision: Option<&ControlDecision>,
) {
    let decimal = theme::decimal(ui.ctx());
    let centimetres = |error_m: f64| format!("{} cm", decimal.signed(error_m * 100.0, 1));
    // Off its route its path is straight ahead, to a stop: no error of tracking.
    let is_off_route = is_off_route(decision);
    let lateral = match vehicle.tracked_lateral_error_m().filter(|_| !is_driven) {
        _ if !shown.has_control_data => not_told(shown).to_owned(),
        _ if !status::is_tracked(vehicle.status) => format!("{}, not tracked", status::NOT_MEASURED),
        None if vehicle.status == Status::Collided && !is_driven => COLLIDED.to_owned(),
        None => NO_PATH.to_owned(),
        Some(_) if is_off_route => OFF_ROUTE.to_owned(),
        Some(error_m) => centimetres(error_m),
    };
    row(ui, "Lateral error", &lateral, "Front axle from the desired path, left-positive");
    let ahead = match decision {
        None => not_told(shown).to_owned(),
        Some(_) if is_driven => NO_PATH.to_owned(),
        Some(_) if vehicle.status == Status::Collided => COLLIDED.to_owned(),
        Some(_) if is_off_route => OFF_ROUTE.to_owned(),
        Some(decision) => centimetres(decision.longitudinal_error_m),
    };
    let most_m = decimal.fixed(shown.scale().city_from_lab(PLAN_SLACK_M), 1);
    let tip = format!(
        "How far its plan is ahead of its estimated place: {most_m} m at most either way, beyond which the plan keeps to its place"
    );
    row(ui, "Longitudinal error", &ahead, &tip);
    let noise = decision.and_then(|decision| decision.measured).map_or_else(
        || not_told(shown).to_owned(),
        |measured| {
            let off_m = measured.position.distance(vehicle.position.truncate());
            format!("{} cm from where it is now", decimal.fixed(off_m * 100.0, 1))
        },
    );
    row(
        ui,
        "Measured pose",
        &noise,
        "How far its last measurement is from the present pose: what it has driven since, without noise and delay too, and the noise of the environment",
    );
}

/// In place of an error of tracking.
const NO_PATH: &str = "no path, a person drives";
const COLLIDED: &str = "no path, it has collided";

/// Whether a vehicle is on no lane of its route, as after a person has driven it.
pub(super) fn is_off_route(decision: Option<&ControlDecision>) -> bool {
    decision.is_some_and(|decision| decision.reason == DecisionReason::OffRoute)
}

fn sensors(ui: &mut Ui, shown: &ViewModel<'_>, id: VehicleId) {
    let names: Vec<&str> = shown.cameras_of(id).iter().map(|camera| camera.name.as_str()).collect();
    let text = if names.is_empty() { "none in the scenario".to_owned() } else { names.join(", ") };
    row(ui, "Sensors", &text, "Cameras that the scenario gives it");
}

fn rest(
    ui: &mut Ui,
    shown: &ViewModel<'_>,
    (vehicle, is_driven, is_own): (&VehicleState, bool, bool),
    place: Option<&TrafficPlace>,
) {
    let id = vehicle.id;
    let algorithm = shown.drivers.get(&id).map_or("not known", String::as_str);
    let person = if is_own { "you" } else { "a person" };
    let driver = match vehicle.status {
        Status::Manual => format!("{person}; {algorithm} when released"),
        Status::Collided if is_driven => format!("{person}; {algorithm} does not drive it after a collision"),
        Status::Collided => format!("{algorithm}, which no longer drives it"),
        _ => algorithm.to_owned(),
    };
    row(ui, "Driver", &driver, "Its control algorithm");
    let route = shown.routes.get(&id).map_or(&[][..], Vec::as_slice);
    let here = place.and_then(|place| route.iter().position(|lane| *lane == place.axle.lane));
    let text = match here {
        _ if route.is_empty() => not_told(shown).to_owned(),
        None => "it is not on its planned route".to_owned(),
        Some(index) => {
            let ahead = &route[index + 1..];
            let length_m: f64 = route[index..].iter().map(|lane| shown.map.lane(*lane).curve.length()).sum();
            let left_m = length_m - place.map_or(0.0, |place| place.axle.at_m);
            let names: Vec<&str> =
                ahead.iter().take(LISTED_LANES).map(|lane| shown.map.lane(*lane).name.as_str()).collect();
            let more = if ahead.len() > LISTED_LANES { ", ..." } else { "" };
            let then = if names.is_empty() { " on this lane" } else { ": " };
            format!("{left_m:.0} m left{then}{}{more}", names.join(", "))
        }
    };
    ui.label(RichText::new("Route").weak());
    ui.add(Label::new(text).truncate()).on_hover_text("Its planned lanes, by the scenario");
    ui.end_row();
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_simulation::measures::Following;
    use glam::DVec2;

    #[test]
    fn a_closing_gap_has_a_time_to_collision() {
        let words = |leader_mps| {
            let following = Following { gap_m: 13.5, speed_mps: 10.0, leader_mps };
            let leader = LeaderAhead { vehicle: VehicleId(2), following, rear: DVec2::ZERO };
            gap_words(&leader, DecimalSeparator::Point)
        };
        assert_eq!(words(5.0), "13.5 m, headway 1.4 s, time to collision 2.7 s");
        assert_eq!(words(10.0), "13.5 m, headway 1.4 s");
    }
}
