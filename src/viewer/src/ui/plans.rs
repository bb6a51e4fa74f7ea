//! Plans of coordinated vehicles: where and when each will be, over the city and in words.

use super::control_zones::zone_colour;
use super::layers::Canvas;
use super::overlay::{self, body_colour};
use super::{DecimalSeparator, UiState, ViewModel, theme, traffic};
use city3d_geometry::City;
use city3d_protocol::snapshot::{CoordinationState, NoPlan, PlannedPassage, VehicleId, ZoneVehicle};
use city3d_render::Overlay;
use egui::{Color32, Grid, Rect, RichText, Ui, Vec2};
use glam::{DVec2, DVec3};

/// Half the width of the bar at the entry of the junction.
const BAR_HALF_M: f64 = 1.9;
/// From a dot to its number, points.
const BESIDE_DOT: Vec2 = Vec2::new(20.0, 0.0);
/// Height of a row of times at an entry, points, and the most rows.
const ROW: f32 = 17.0;
const ROWS: u8 = 5;
/// Vehicles that the order of a zone lists at most.
const LISTED: usize = 8;
/// Time between two places of a way, seconds: a whole number of them is a second.
const PLACE_STEP_S: f64 = 0.5;
/// Most places of a way: those of the longest plan.
const PLACES: u32 = (PlannedPassage::<City>::LONGEST_S / PLACE_STEP_S) as u32;

/// Where a vehicle will be.
struct PlannedPlace {
    /// Seconds from now.
    in_s: f64,
    /// Of the front bumper.
    position: DVec2,
}

/// Where the front bumper of a vehicle will be: now and every [`PLACE_STEP_S`] until it leaves, as far as its plan tells.
fn places(plan: &PlannedPassage, now_s: f64) -> impl Iterator<Item = PlannedPlace> + '_ {
    let times = (0..=PLACES).map(|k| f64::from(k) * PLACE_STEP_S);
    times.filter_map(move |in_s| Some(PlannedPlace { in_s, position: plan.position_at(now_s + in_s)? }))
}

/// The way of the front bumper from now until the vehicle leaves, as far as its plan tells.
fn way(plan: &PlannedPassage, now_s: f64) -> Vec<DVec3> {
    let end = plan.motion.last().filter(|end| end.time_s > now_s).map(|end| end.pose.position);
    places(plan, now_s).map(|place| place.position).chain(end).map(overlay::above).collect()
}

/// Whether a vehicle has a plan that can be drawn.
pub(super) fn has_any(shown: &ViewModel<'_>) -> bool {
    !planned(shown).is_empty()
}

/// Vehicles with plans, in the order of entry.
fn planned<'a>(shown: &'a ViewModel<'_>) -> Vec<(VehicleId, &'a PlannedPassage)> {
    let vehicles = shown.run_state.coordination.iter().flat_map(|coordination| &coordination.vehicles);
    let mut planned: Vec<_> =
        vehicles.filter_map(|vehicle| Some((vehicle.id, vehicle.plan.as_ref().ok()?))).collect();
    planned.sort_by(|a, b| a.1.enters_s.total_cmp(&b.1.enters_s));
    planned
}

/// Adds the plans to the overlay: the way to the exit of the zone with a dot every second, and a bar where the first
/// conflict begins.
pub(super) fn add(to: &mut Overlay, state: &UiState, shown: &ViewModel<'_>) {
    if !state.layers.plans {
        return;
    }
    let now_s = shown.run_state.now.time_s;
    for (id, plan) in planned(shown) {
        let colour = body_colour(shown, id);
        let is_selected = state.selection.vehicle == Some(id);
        to.polyline(&way(plan, now_s), if is_selected { 3.0 } else { 1.5 }, overlay::paint(colour, 0.8));
        let radius_m = if is_selected { 0.55 } else { 0.35 };
        for place in places(plan, now_s).filter(is_second) {
            overlay::disc(to, place.position, radius_m, overlay::paint(colour, 1.0));
        }
        if plan.enters_s > now_s {
            let bar = bar(plan);
            to.line(bar, 4.0, overlay::paint(Color32::BLACK, 0.7));
            to.line(bar, 2.5, overlay::paint(colour, 1.0));
        }
    }
}

/// Writes the times of entry, and numbers the seconds of the selected vehicle.
pub(super) fn paint(canvas: &Canvas<'_>, state: &UiState, shown: &ViewModel<'_>) {
    let now_s = shown.run_state.now.time_s;
    let decimal = theme::decimal(canvas.painter().ctx());
    let planned = planned(shown);
    let mut taken: Vec<Rect> = Vec::new();
    for (id, plan) in planned.iter().filter(|(_, plan)| plan.enters_s > now_s) {
        let text = format!("{id} in {} s", decimal.fixed(plan.enters_s - now_s, 1));
        let colour = theme::text_on_picture(body_colour(shown, *id));
        entry(canvas, plan, (colour, &text), &mut taken);
    }
    if let Some((_, plan)) = planned.iter().find(|(id, _)| Some(*id) == state.selection.vehicle) {
        seconds(canvas, (plan, now_s), &mut taken);
    }
}

/// Numbers the seconds, beside the dots.
fn seconds(canvas: &Canvas<'_>, (plan, now_s): (&PlannedPassage, f64), taken: &mut Vec<Rect>) {
    for place in places(plan, now_s).filter(is_second) {
        if let Some(at) = canvas.place(overlay::above(place.position)) {
            canvas.text(at + BESIDE_DOT, &format!("{:.0} s", place.in_s), Color32::WHITE, taken);
        }
    }
}

fn is_second(place: &PlannedPlace) -> bool {
    place.in_s > 0.0 && place.in_s.fract() == 0.0
}

/// Ends of the bar where a vehicle enters the first conflict.
fn bar(plan: &PlannedPassage) -> [DVec3; 2] {
    [BAR_HALF_M, -BAR_HALF_M].map(|left_m| overlay::above(plan.entry.point_at(0.0, left_m)))
}

/// The time at the bar of a vehicle; those of one entry stand above one another.
fn entry(canvas: &Canvas<'_>, plan: &PlannedPassage, (colour, text): (Color32, &str), taken: &mut Vec<Rect>) {
    if let [Some(from), Some(to)] = bar(plan).map(|end| canvas.place(end)) {
        let top = if from.y < to.y { from } else { to };
        let is_painted = |row: u8| {
            let place = top - egui::vec2(0.0, 12.0 + ROW * f32::from(row));
            canvas.text(place, text, colour, taken)
        };
        let _ = (0..ROWS).any(is_painted);
    }
}

/// Whether there are control zones: in the scenario, or as a control framework elsewhere tells of them.
pub(super) fn has_zones(shown: &ViewModel<'_>) -> bool {
    !shown.control_zones.is_empty() || shown.run_state.coordination.is_some()
}

/// The plan of a vehicle in words, and what they mean; `None` where there are no control zones.
pub(super) fn words(
    shown: &ViewModel<'_>,
    id: VehicleId,
    decimal: DecimalSeparator,
) -> Option<(String, &'static str)> {
    if !has_zones(shown) {
        return None;
    }
    let Some(coordination) = &shown.run_state.coordination else {
        let tip =
            "Not told by this source: its control framework coordinates nobody, or does not tell its plans";
        return Some(("Plan: -".to_owned(), tip));
    };
    let Some(vehicle) = coordination.vehicle(id) else {
        return Some((
            "Plan: none outside of control zones".to_owned(),
            "It gets a plan when it enters a zone",
        ));
    };
    let now_s = shown.run_state.now.time_s;
    let (words, tip) = match &vehicle.plan {
        Ok(plan) if plan.enters_s > now_s => (
            format!(
                "enters junction in {} s, leaves in {} s",
                decimal.fixed(plan.enters_s - now_s, 1),
                decimal.fixed(plan.leaves_s - now_s, 1)
            ),
            "Front bumper at the first conflict, rear bumper behind the last one",
        ),
        Ok(plan) => (
            format!("in the junction, leaves in {} s", decimal.fixed((plan.leaves_s - now_s).max(0.0), 1)),
            "Rear bumper behind the last conflict",
        ),
        Err(why) => (format!("none, {}", why_not(*why)), "It drives by the rules of the road"),
    };
    Some((format!("Plan: {words}"), tip))
}

/// The plan of a vehicle for the inspector: its control zone, when it enters the first conflict, and its place in the queue;
/// `None` where there are no control zones.
pub(super) fn inspected(shown: &ViewModel<'_>, id: VehicleId, decimal: DecimalSeparator) -> Option<String> {
    if !has_zones(shown) {
        return None;
    }
    let Some(coordination) = &shown.run_state.coordination else {
        return Some(super::inspector::not_told(shown).to_owned());
    };
    let Some(vehicle) = coordination.vehicle(id) else {
        return Some("in no control zone".to_owned());
    };
    let zone = coordination.zones.iter().find(|zone| zone.number == vehicle.zone);
    let zone = zone.map_or_else(|| format!("zone {}", vehicle.zone + 1), |zone| zone.name.clone());
    let now_s = shown.run_state.now.time_s;
    let plan = match &vehicle.plan {
        Err(why) => return Some(format!("{zone}: none, {}", why_not(*why))),
        Ok(plan) => plan,
    };
    if plan.enters_s <= now_s {
        let left_s = (plan.leaves_s - now_s).max(0.0);
        return Some(format!("{zone}: in the junction, leaves in {} s", decimal.fixed(left_s, 1)));
    }
    // Who is in the junction waits no more.
    let queue = queue_of(coordination, vehicle.zone);
    let waiting: Vec<_> = queue.iter().filter(|(enters_s, _)| *enters_s > now_s).collect();
    let place = waiting.iter().position(|(_, other)| other.id == id).map_or(0, |place| place + 1);
    let at = decimal.fixed(plan.enters_s, 1);
    let in_s = decimal.fixed(plan.enters_s - now_s, 1);
    Some(format!("{zone}: first conflict at {at} s (in {in_s} s), {place} of {} in the queue", waiting.len()))
}

fn why_not(why: NoPlan) -> &'static str {
    match why {
        NoPlan::NotCoordinated => "not coordinated",
        NoPlan::LeftItsPlans => "has left its plans",
        NoPlan::AmongUncoordinated => "among vehicles without",
        NoPlan::Infeasible => "infeasible, asks again",
    }
}

const NUMBERS: [(&str, &str); 7] = [
    ("In zone", "Vehicles between the entry lines and the last conflicts"),
    ("With a plan", "Vehicles in the zone with a plan"),
    ("Without a plan", "Vehicles in the zone without a plan; they drive by the rules of the road"),
    (
        "Waiting",
        "Vehicles in the zone that stand; where nobody coordinates, its queue with those that wait outside for room",
    ),
    ("Plans", "Plans given so far"),
    ("Replans", "Plans that were dropped: the vehicle, or another one, did not do what was expected"),
    ("Infeasible", "Requests for which no plan kept bounds and gaps; a vehicle asks more than once"),
];

/// The queue of each control zone: numbers, and who enters its conflicts next.
pub(super) fn queue(ui: &mut Ui, shown: &ViewModel<'_>) {
    let (coordination, zones) = (shown.run_state.coordination.as_deref(), zones(shown));
    ui.label(RichText::new("Queue and plans").strong());
    let measured: Vec<_> = shown.traffic.measures().zones().collect();
    let of_zone = |zone: &ListedZone<'_>| match (coordination, measured.get(zone.place)) {
        (Some(coordination), _) => numbers(coordination, zone.number),
        (None, Some((_, traffic))) => {
            let mut numbers = ["-"; NUMBERS.len()].map(str::to_owned);
            (numbers[0], numbers[3]) = (traffic.inside().len().to_string(), traffic.queue.now.to_string());
            numbers
        }
        (None, None) => ["-"; NUMBERS.len()].map(str::to_owned),
    };
    let numbers: Vec<_> = zones.iter().map(of_zone).collect();
    // A column for each zone: there are few, and the panel is narrow.
    Grid::new("queue").striped(true).spacing([traffic::BETWEEN_COLUMNS, 3.0]).show(ui, |ui| {
        ui.label("");
        for zone in &zones {
            ui.label(RichText::new(zone.name).color(theme::on_ground(ui.ctx(), zone.colour())));
        }
        ui.end_row();
        for (row, (title, tip)) in NUMBERS.into_iter().enumerate() {
            ui.label(RichText::new(title).small()).on_hover_text(tip);
            for numbers in &numbers {
                ui.monospace(&numbers[row]);
            }
            ui.end_row();
        }
    });
    let Some(coordination) = coordination else {
        let text =
            "No plans are known: the control framework coordinates nobody, or does not tell its plans.";
        ui.add(egui::Label::new(RichText::new(text).small().weak()).wrap());
        return;
    };
    let decimal = theme::decimal(ui.ctx());
    for zone in &zones {
        let text = format!("{}: {}", zone.name, order(coordination, zone.number, (shown, decimal)));
        ui.label(RichText::new(text).small())
            .on_hover_text("By the time at which the front bumper enters the first conflict");
    }
}

/// A control zone in the panel.
struct ListedZone<'a> {
    name: &'a str,
    /// Its number in what is told.
    number: u16,
    /// Its place in the scenario; behind all of them for a zone that the scenario here does not have.
    place: usize,
}

impl ListedZone<'_> {
    fn colour(&self) -> Color32 {
        zone_colour(self.place)
    }
}

/// The zones that are told, or else those of the scenario.
fn zones<'a>(shown: &ViewModel<'a>) -> Vec<ListedZone<'a>> {
    let areas = shown.control_zones;
    let told = shown.run_state.coordination.as_ref().map_or(&[][..], |told| &told.zones[..]);
    if told.is_empty() {
        let own = areas.iter().enumerate().zip(0..);
        return own.map(|((place, area), number)| ListedZone { name: &area.name, number, place }).collect();
    }
    let listed = told.iter().map(|zone| {
        let known = areas.iter().position(|area| area.name == zone.name);
        let place = known.unwrap_or(areas.len() + usize::from(zone.number));
        ListedZone { name: &zone.name, number: zone.number, place }
    });
    listed.collect()
}

fn numbers(coordination: &CoordinationState, zone: u16) -> [String; NUMBERS.len()] {
    let inside = || coordination.vehicles.iter().filter(move |vehicle| vehicle.zone == zone);
    let planned = inside().filter(|vehicle| vehicle.plan.is_ok()).count();
    let told = coordination.zones.iter().find(|told| told.number == zone);
    let counts = told.map(|told| told.counts).unwrap_or_default();
    [
        inside().count().to_string(),
        planned.to_string(),
        (inside().count() - planned).to_string(),
        inside().filter(|vehicle| vehicle.is_standing).count().to_string(),
        counts.plans.to_string(),
        counts.replans.to_string(),
        counts.infeasible.to_string(),
    ]
}

/// The vehicles in a zone by when they enter its conflicts, seconds; infinite without a plan.
fn queue_of(coordination: &CoordinationState, zone: u16) -> Vec<(f64, &ZoneVehicle)> {
    let enters_s = |plan: &Result<PlannedPassage, NoPlan>| match plan {
        Ok(plan) => plan.enters_s,
        Err(_) => f64::INFINITY,
    };
    let inside = coordination.vehicles.iter().filter(|vehicle| vehicle.zone == zone);
    let mut queue: Vec<_> = inside.map(|vehicle| (enters_s(&vehicle.plan), vehicle)).collect();
    queue.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.entered_s.total_cmp(&b.1.entered_s)));
    queue
}

/// Who enters the conflicts of a zone next, and in how many seconds; then those without plans.
fn order(
    coordination: &CoordinationState,
    zone: u16,
    (shown, decimal): (&ViewModel<'_>, DecimalSeparator),
) -> String {
    let now_s = shown.run_state.now.time_s;
    let queue = queue_of(coordination, zone);
    if queue.is_empty() {
        return "nobody is inside".to_owned();
    }
    let listed = queue.iter().take(LISTED).map(|(enters_s, vehicle)| {
        let info = shown.run_state.now.info(vehicle.id);
        let name = info.map_or_else(|| vehicle.id.to_string(), |info| info.name.clone());
        let when = match &vehicle.plan {
            Ok(_) if *enters_s > now_s => format!("in {} s", decimal.fixed(enters_s - now_s, 1)),
            Ok(_) => "in the junction".to_owned(),
            Err(why) => format!("({})", why_not(*why)),
        };
        format!("{name} {when}")
    });
    let mut parts: Vec<String> = listed.collect();
    if queue.len() > LISTED {
        parts.push(format!("and {} more", queue.len() - LISTED));
    }
    parts.join(", ")
}
