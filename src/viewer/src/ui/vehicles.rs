//! The table of all vehicles.

mod columns;

pub use columns::{least_width, usual_width};

use self::columns::{SPACING, TableColumns, scrollbar};
use super::commands::key_map;
use super::vehicle_menu::{MenuSubject, VehicleMenu};
use super::{DecimalSeparator, DriverNames, Selection, SpeedUnit, UiState, ViewModel, status, theme};
use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::{FrameSnapshot, Status, VehicleId};
use city3d_roadmap::CityMap;
use city3d_session::RunPhase;
use egui::{Align, Color32, Layout, RichText, Sense, Ui, Vec2};
use egui_extras::{Column, TableBuilder};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::collections::BTreeMap;

/// Sort column of the table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SortKey {
    /// Number of the vehicle; also orders rows that are equal by another key.
    #[default]
    Id,
    /// Name in the scenario.
    Name,
    /// Control algorithm, or a person.
    Driver,
    /// Label of the status, in alphabetical order.
    Status,
    /// East of the city's middle, city metres.
    X,
    /// North of the city's middle, city metres.
    Y,
    /// Along the heading.
    Speed,
}

impl SortKey {
    /// Whether the order by it changes as vehicles drive.
    fn changes(self) -> bool {
        matches!(self, Self::Status | Self::X | Self::Y | Self::Speed)
    }

    const COLUMNS: [(Self, &'static str, &'static str); 7] = [
        (Self::Id, "ID", "Number and colour; an L marks a lab vehicle"),
        (Self::Name, "Name", "Its name in the scenario"),
        (Self::Driver, "Driver", "The algorithm that drives it, or a person"),
        (Self::Status, "Status", "What it is doing; hover over a row for the meaning"),
        (Self::X, "x (m)", "Metres to the east of the city's middle"),
        (Self::Y, "y (m)", "Metres to the north of the city's middle"),
        (Self::Speed, "Speed", "Speed along its heading"),
    ];
}

/// Sorting and filter of the table.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct TableState {
    /// Column that orders the rows.
    pub key: SortKey,
    /// Largest number or last name first.
    pub descending: bool,
    /// Rows whose texts contain all of these words.
    #[serde(skip)]
    pub filter: String,
    /// Scroll once to the selected vehicle.
    #[serde(skip)]
    pub reveal: bool,
    /// Rows that had room in the last frame.
    #[serde(skip)]
    pub whole_rows: usize,
    #[serde(skip)]
    pub(crate) held: HeldRowOrder,
}

/// Holds the row order while the mouse is on the table, so that a row does not move away under it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct HeldRowOrder {
    by: (SortKey, bool),
    places: BTreeMap<VehicleId, usize>,
}

/// Says that the order is held.
const HELD: &str = "held";
/// Why, and until when.
const HELD_TIP: &str = "Rows keep their places while the mouse is on the table, so that they can be clicked";

impl HeldRowOrder {
    /// Restores the held order, or takes the present one where it is not held.
    fn apply(&mut self, rows: &mut [VehicleRow<'_>], by: (SortKey, bool), is_held: bool) {
        if by != self.by || !is_held {
            let places = rows.iter().enumerate().map(|(place, row)| (row.id, place)).collect();
            *self = Self { by, places };
        }
        rows.sort_by_key(|row| self.places.get(&row.id).copied().unwrap_or(usize::MAX));
    }
}

/// Driver of the vehicle that the user of this window drives.
const YOU: &str = "you";

/// One vehicle in the table.
#[derive(Clone, Debug, PartialEq)]
struct VehicleRow<'a> {
    id: VehicleId,
    colour: Color32,
    is_physical: bool,
    name: &'a str,
    driver: &'a str,
    status: Status,
    x_m: f64,
    y_m: f64,
    speed_mps: f64,
}

impl VehicleRow<'_> {
    fn cmp_by(&self, other: &Self, key: SortKey) -> Ordering {
        match key {
            SortKey::Id => Ordering::Equal,
            SortKey::Name => self.name.cmp(other.name),
            SortKey::Driver => self.driver.cmp(other.driver),
            SortKey::Status => status::label(self.status).cmp(status::label(other.status)),
            SortKey::X => self.x_m.total_cmp(&other.x_m),
            SortKey::Y => self.y_m.total_cmp(&other.y_m),
            SortKey::Speed => self.known_mps().total_cmp(&other.known_mps()),
        }
        .then(self.id.cmp(&other.id))
    }

    /// Its speed; what is not known is below all others.
    fn known_mps(&self) -> f64 {
        if status::is_tracked(self.status) { self.speed_mps } else { f64::NEG_INFINITY }
    }

    fn contains(&self, word: &str) -> bool {
        let kind = if self.is_physical { "lab vehicle" } else { "virtual" };
        let texts = [self.name, self.driver, status::label(self.status), kind];
        texts.iter().any(|text| text.to_lowercase().contains(word)) || self.id.to_string() == word
    }
}

/// Rows that match, in order.
fn rows<'a>(
    snapshot: &'a FrameSnapshot,
    (drivers, driven): (&'a DriverNames, Option<VehicleId>),
    table: &TableState,
) -> Vec<VehicleRow<'a>> {
    let words: Vec<String> = table.filter.split_whitespace().map(str::to_lowercase).collect();
    let row = |(vehicle, info): (
        &'a city3d_protocol::snapshot::VehicleState,
        &'a city3d_protocol::snapshot::VehicleInfo,
    )| {
        let [r, g, b] = info.appearance.colour;
        let driver = drivers.get(&vehicle.id).map_or("", String::as_str);
        VehicleRow {
            id: vehicle.id,
            colour: Color32::from_rgb(r, g, b),
            is_physical: info.is_physical(),
            name: &info.name,
            // A collided vehicle under manual control keeps its status.
            driver: match driven == Some(vehicle.id) {
                true => YOU,
                false if vehicle.status == Status::Manual => "human",
                false => driver,
            },
            status: vehicle.status,
            x_m: vehicle.position.x,
            y_m: vehicle.position.y,
            speed_mps: vehicle.speed_mps,
        }
    };
    let mut rows: Vec<VehicleRow<'a>> = snapshot.iter().map(row).collect();
    rows.retain(|row| words.iter().all(|word| row.contains(word)));
    rows.sort_by(|a, b| a.cmp_by(b, table.key));
    if table.descending {
        rows.reverse();
    }
    rows
}

const ROW_HEIGHT: f32 = 20.0;
/// Height of the filter and the titles above the rows, points.
const ABOVE_ROWS: f32 = 60.0;

/// Height of a table with so many rows, about, points.
pub fn height_of(rows: usize) -> f32 {
    /// Between two rows, points.
    const BETWEEN: f32 = 3.0;
    ABOVE_ROWS + rows as f32 * (ROW_HEIGHT + BETWEEN)
}

/// Room for the number of rows, points.
const COUNT_WIDTH: f32 = 88.0;
/// Shows the table. A click selects, a double click follows. While the vehicles move, the row order changes once a
/// second.
pub fn show(ui: &mut Ui, shown: &ViewModel<'_>, state: &mut UiState) {
    let snapshot = &*shown.run_state.now;
    let drivers = (shown.drivers, state.driving.as_ref().map(|driving| driving.vehicle));
    let (table, selection) = (&mut state.table, &mut state.selection);
    let moves = shown.run_state.phase == RunPhase::Running;
    let map = shown.map;
    // Laid out from the right, so that the row does not widen the panel.
    let line = egui::vec2(ui.available_width(), ui.spacing().interact_size.y);
    // The filter may change in this frame: its count is filled in afterwards.
    let count_place = ui
        .allocate_ui_with_layout(line, Layout::right_to_left(Align::Center), |ui| {
            let clear = ui.add_enabled(!table.filter.is_empty(), egui::Button::new("x"));
            if clear.on_hover_text("Show all").clicked() {
                table.filter.clear();
            }
            let size = egui::vec2(COUNT_WIDTH, ui.spacing().interact_size.y);
            let (place, _) = ui.allocate_exact_size(size, Sense::hover());
            let field = egui::TextEdit::singleline(&mut table.filter)
                .hint_text("Filter by name, status, driver or ID")
                .desired_width(ui.available_width());
            ui.add(field);
            place
        })
        .inner;
    kinds(ui, snapshot);
    let mut listed = rows(snapshot, drivers, table);
    let all = snapshot.vehicles.len();
    let count = if listed.len() == all { all.to_string() } else { format!("{} of {all}", listed.len()) };
    // A child of its own, which moves nothing here.
    let line = egui::UiBuilder::new().max_rect(count_place).layout(Layout::right_to_left(Align::Center));
    let mut line = ui.new_child(line);
    let is_held = moves && table.key.changes() && ui.rect_contains_pointer(ui.max_rect());
    table.held.apply(&mut listed, (table.key, table.descending), is_held);
    let words = RichText::new(if is_held { format!("{count}, {HELD}") } else { count }).weak();
    let count = line.label(words);
    if is_held {
        count.on_hover_text(HELD_TIP);
    }
    if listed.is_empty() {
        let text = if snapshot.vehicles.is_empty() {
            super::link::absence(shown)
        } else {
            "No vehicle matches the filter.".to_owned()
        };
        ui.add_space(8.0);
        ui.label(RichText::new(text).weak());
        return;
    }
    let units = (state.preferences.units, shown.scale(), state.preferences.decimal);
    let asked = grid(ui, &listed, (snapshot, map, units), table, selection);
    if let Some(id) = asked {
        state.menu = Some(VehicleMenu::of(MenuSubject::Vehicle(id)));
    }
}

/// What the marks mean where both kinds of vehicles drive.
fn kinds(ui: &mut Ui, snapshot: &FrameSnapshot) {
    let is_mixed = |kind| snapshot.roster.iter().any(|info| info.is_physical() == kind);
    if !(is_mixed(true) && is_mixed(false)) {
        return;
    }
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = SPACING;
        for (is_physical, words) in [(true, "lab vehicle"), (false, "virtual")] {
            chip(ui, ui.visuals().weak_text_color(), is_physical);
            let tip = if is_physical { status::LAB_VEHICLE } else { "A vehicle of the simulation alone" };
            ui.label(RichText::new(words).small().weak()).on_hover_text(tip);
            ui.add_space(SPACING);
        }
    });
}

/// Shows the rows; returns the vehicle whose menu is asked for.
fn grid(
    ui: &mut Ui,
    shown: &[VehicleRow<'_>],
    (snapshot, map, units): (&FrameSnapshot, &CityMap, NumberStyle),
    table: &mut TableState,
    selection: &mut Selection,
) -> Option<VehicleId> {
    by_keys(ui, shown, table, selection);
    let mut asked = None;
    // A click on a text of a row means the row.
    ui.style_mut().interaction.selectable_labels = false;
    ui.spacing_mut().item_spacing.x = SPACING;
    let width = ui.available_width() - scrollbar(ui);
    let columns = TableColumns::fitting(width);
    let gap = ui.spacing().item_spacing.y;
    let line = ROW_HEIGHT + gap;
    // Whole rows: half a one at the edge looks as if the timeline covered it.
    let whole_rows = ((ui.available_height() - line) / line).floor().max(1.0);
    // A row in sight stays there when the panel becomes lower.
    table.reveal |= std::mem::replace(&mut table.whole_rows, whole_rows as usize) > whole_rows as usize;
    let mut builder = TableBuilder::new(ui)
        // By itself it is as high as 200 points, beyond the edge of a low panel.
        .min_scrolled_height(0.0)
        .striped(true)
        .max_scroll_height(whole_rows * line - gap)
        // All rows are one stop of the Tab key.
        .sense(Sense::CLICK)
        .auto_shrink(false)
        .cell_layout(Layout::left_to_right(Align::Center));
    for (_, width) in &columns.shown {
        builder = builder.column(Column::exact(*width).clip(true));
    }
    if std::mem::take(&mut table.reveal)
        && let Some(row) = shown.iter().position(|row| Some(row.id) == selection.vehicle)
    {
        builder = builder.scroll_to_row(row, None);
    }
    builder
        .header(ROW_HEIGHT, |mut header| {
            for &(k, _) in &columns.shown {
                let (key, title, tip) = SortKey::COLUMNS[k];
                let title = if key == SortKey::Speed { units.0.label() } else { title };
                header.col(|ui| match key {
                    // Above their numbers.
                    SortKey::X | SortKey::Y | SortKey::Speed => {
                        let layout = Layout::right_to_left(Align::Center);
                        ui.with_layout(layout, |ui| heading(ui, table, key, (title, tip)));
                    }
                    _ => heading(ui, table, key, (title, tip)),
                });
            }
        })
        .body(|body| {
            body.rows(ROW_HEIGHT, shown.len(), |mut line| {
                let row = &shown[line.index()];
                line.set_selected(Some(row.id) == selection.vehicle);
                for &(k, _) in &columns.shown {
                    cell(&mut line, (row, units), (SortKey::COLUMNS[k].0, columns.is_compact));
                }
                let response = line.response();
                if response.clicked() {
                    selection.vehicle = Some(row.id);
                }
                if response.double_clicked() {
                    selection.follow = Some(row.id);
                }
                if response.secondary_clicked() {
                    asked = Some(row.id);
                }
                response.on_hover_ui(|ui| {
                    let found = snapshot.vehicle(row.id).zip(snapshot.info(row.id));
                    let keys = key_map::of(ui.ctx());
                    let why = found.map(|(vehicle, info)| status::reason(&keys, vehicle, info, map));
                    ui.label(format!("{} {}, driver: {}", row.id, row.name, driver_words(row.driver)));
                    ui.label(format!("{}: {}", status::label(row.status), why.unwrap_or_default()));
                });
            });
        });
    asked
}

/// The rows as one stop of the Tab key: Up and Down move the selection.
fn by_keys(ui: &Ui, shown: &[VehicleRow<'_>], table: &mut TableState, selection: &mut Selection) {
    let rect = ui.available_rect_before_wrap();
    let response = ui.interact(rect, ui.scope_id().with("rows"), Sense::FOCUSABLE);
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::ListBox, true, "Vehicles of the table"));
    if !response.has_focus() {
        return;
    }
    let filter = egui::EventFilter { vertical_arrows: true, ..egui::EventFilter::default() };
    ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, filter));
    let pressed = |key| ui.input_mut(|input| input.count_and_consume_key(egui::Modifiers::NONE, key));
    let (ups, downs) = (pressed(egui::Key::ArrowUp), pressed(egui::Key::ArrowDown));
    if ups + downs > 0 && !shown.is_empty() {
        let place = shown.iter().position(|row| Some(row.id) == selection.vehicle);
        let place = place.map_or(0, |place| (place + downs).saturating_sub(ups).min(shown.len() - 1));
        selection.vehicle = Some(shown[place].id);
        table.reveal = true;
    }
    let stroke = ui.visuals().selection.stroke;
    ui.painter().rect_stroke(rect, 2.0, stroke, egui::StrokeKind::Inside);
}

/// Size of the mark beside the title of the column that sorts the rows, points.
const SORT_MARK: Vec2 = Vec2::new(6.0, 4.0);

fn heading(ui: &mut Ui, table: &mut TableState, key: SortKey, (title, tip): (&str, &str)) {
    let button = ui.add(egui::Button::new(RichText::new(title).strong()).frame(false));
    let button = button.on_hover_text(format!("{tip}. Click to sort"));
    if button.clicked() {
        table.descending = table.key == key && !table.descending;
        table.key = key;
    }
    let sorts = table.key == key;
    let order = match (sorts, table.descending) {
        (false, _) => "",
        (true, false) => ", ascending",
        (true, true) => ", descending",
    };
    let name = format!("{title}{order}");
    button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
    if sorts {
        // Drawn, as a character would not fit beside the title in a narrow column.
        let left = match ui.layout().prefer_right_to_left() {
            true => (button.rect.left() - SORT_MARK.x).max(ui.max_rect().left()) - 1.0,
            false => button.rect.right().min(ui.max_rect().right() - SORT_MARK.x) + 1.0,
        };
        let rect = egui::Rect::from_center_size(
            egui::pos2(left + SORT_MARK.x / 2.0, button.rect.center().y),
            SORT_MARK,
        );
        let corners = if table.descending {
            [rect.left_top(), rect.right_top(), rect.center_bottom()]
        } else {
            [rect.left_bottom(), rect.right_bottom(), rect.center_top()]
        };
        let colour = ui.visuals().strong_text_color();
        ui.painter().add(egui::Shape::convex_polygon(corners.to_vec(), colour, egui::Stroke::NONE));
    }
}

/// Unit of speeds, scale of the city, and how numbers are written.
type NumberStyle = (SpeedUnit, LengthScale, DecimalSeparator);

fn cell(
    line: &mut egui_extras::TableRow<'_, '_>,
    (row, (units, scale, decimal)): (&VehicleRow<'_>, NumberStyle),
    (key, is_compact): (SortKey, bool),
) {
    // Where metres alone leave room for the name.
    let place = |m: f64| if is_compact { decimal.fixed(m.round(), 0) } else { decimal.tenths(m) };
    line.col(|ui| match key {
        SortKey::Id => {
            chip(ui, row.colour, row.is_physical);
            ui.label(row.id.to_string());
        }
        SortKey::Name => _ = ui.label(row.name),
        SortKey::Driver => _ = ui.label(row.driver),
        SortKey::Status => {
            let colour = theme::on_panel(ui.ctx(), row.status);
            ui.label(RichText::new(in_table(row.status)).color(colour));
        }
        SortKey::X => number(ui, place(row.x_m)),
        SortKey::Y => number(ui, place(row.y_m)),
        SortKey::Speed => {
            let speed = units.number(row.speed_mps, scale, decimal);
            number(ui, status::speed_words(row.status, speed));
        }
    });
}

fn number(ui: &mut Ui, text: String) {
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| ui.monospace(text));
}

/// A status in the narrow column: the whole words stand in the tip.
fn in_table(status: Status) -> &'static str {
    if status == Status::Manual { "by hand" } else { status::label(status) }
}

/// A control algorithm in words.
fn driver_words(name: &str) -> String {
    match name {
        "idm" => "IDM (car following)".to_owned(),
        "cacc" => "CACC (cooperative adaptive cruise control)".to_owned(),
        "ploeg" => "CACC by Ploeg (platoon)".to_owned(),
        "cruise" => "cruise (ignores other vehicles)".to_owned(),
        "parked" => "parked (an obstacle)".to_owned(),
        "human" => "a person".to_owned(),
        YOU => "you, by hand".to_owned(),
        other => other.to_owned(),
    }
}

/// A patch of the colour of a vehicle, with an L for one of the laboratory: round and square marks are those of statuses.
pub fn chip(ui: &mut Ui, colour: Color32, is_physical: bool) {
    let (rect, _) = ui.allocate_exact_size(Vec2::splat(12.0), Sense::hover());
    ui.painter().rect_filled(rect, 2.0, colour);
    let edge = egui::Stroke::new(1.0, ui.visuals().weak_text_color());
    ui.painter().rect_stroke(rect, 2.0, edge, egui::StrokeKind::Inside);
    if is_physical {
        let is_bright = egui::Rgba::from(colour).intensity() > 0.3;
        let ink = if is_bright { Color32::BLACK } else { Color32::WHITE };
        let font = egui::FontId::proportional(10.0);
        ui.painter().text(rect.center(), egui::Align2::CENTER_CENTER, "L", font, ink);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(id: u32, speed_mps: f64) -> VehicleRow<'static> {
        let (id, colour, status) = (VehicleId(id), Color32::RED, Status::Driving);
        VehicleRow {
            id,
            colour,
            is_physical: false,
            name: "",
            driver: "",
            status,
            x_m: 0.0,
            y_m: 0.0,
            speed_mps,
        }
    }

    #[test]
    fn rows_are_sorted_and_keep_their_places_only_under_the_mouse() {
        let mut held = HeldRowOrder::default();
        let mut shown = |speeds: [f64; 3], by: (SortKey, bool), is_held: bool| {
            let mut rows: Vec<VehicleRow<'_>> =
                speeds.iter().zip(1..).map(|(&speed, id)| row(id, speed)).collect();
            rows.sort_by(|a, b| a.cmp_by(b, by.0));
            held.apply(&mut rows, by, is_held);
            rows.iter().map(|row| row.id.0).collect::<Vec<_>>()
        };
        let by = (SortKey::Speed, false);
        assert_eq!(shown([3.0, 1.0, 2.0], by, false), [2, 3, 1]);
        assert_eq!(shown([1.0, 2.0, 3.0], by, true), [2, 3, 1]);
        assert_eq!(shown([1.0, 2.0, 3.0], by, false), [1, 2, 3]);
        // Whoever sorts otherwise sees it at once.
        assert_eq!(shown([3.0, 2.0, 1.0], (SortKey::Id, false), true), [1, 2, 3]);
        assert_eq!(shown([3.0, 2.0, 1.0], by, true), [3, 2, 1]);
    }

    #[test]
    fn usual_texts_are_not_cut_off() {
        let wide = [
            (SortKey::Name, "path2_b", false),
            (SortKey::Driver, "recorded", false),
            (SortKey::Status, "collided", false),
            (SortKey::Status, "no command", false),
            (SortKey::Status, "not tracked", false),
            (SortKey::Status, "lab vehicle", false),
            (SortKey::Status, "by hand", false),
            (SortKey::Status, "yielding", false),
            (SortKey::X, "-165.3", true),
            (SortKey::Y, "-165.3", true),
            (SortKey::Speed, "100.0", true),
            (SortKey::Speed, "0.400", true),
            (SortKey::Speed, "(18.0)", true),
        ];
        let context = egui::Context::default();
        let mut checked = 0;
        let mut output = context.run_ui(egui::RawInput::default(), |ui| {
            for (key, text, is_number) in wide {
                let style = if is_number { egui::TextStyle::Monospace } else { egui::TextStyle::Body };
                let font = style.resolve(ui.style());
                let size = ui.painter().layout_no_wrap(text.to_owned(), font, Color32::WHITE).size();
                let column = SortKey::COLUMNS.iter().position(|(other, ..)| *other == key).unwrap();
                assert!(
                    size.x <= columns::WIDTHS[column],
                    "{text}: {} of {}",
                    size.x,
                    columns::WIDTHS[column]
                );
                checked += 1;
            }
        });
        output.textures_delta.clear();
        assert!(checked >= wide.len());
    }
}
