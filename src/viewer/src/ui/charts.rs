//! The panel Charts: quantities of several vehicles over time, and the figures of `city3d plot`, while a run goes on.

pub(super) mod hover;
mod labels;
mod plot;

use super::events::named;
use super::{UiAction, UiState, ViewModel};
use city3d_logbook::figures::chart::{Dash, Figure};
use city3d_logbook::figures::{FigureScale, Quantity};
use city3d_protocol::snapshot::VehicleId;
use city3d_session::playback::PlaybackCommand;
use city3d_simulation::scenario::counted;
use egui::{ComboBox, RichText, Ui};

/// What a chart shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChartKind {
    /// A quantity over time.
    Series(Quantity),
    /// Positions along the paths over time, coloured by speed.
    SpaceTime,
    /// Positions of all paths over time, aligned at the merging point.
    Positions,
    /// Speed against position along the first path.
    SpeedAlongPath,
    /// Everybody on the lanes of one vehicle over time, as the panel Traffic shows it.
    Way,
}

impl ChartKind {
    /// The kinds that are not over time for one vehicle each.
    const FIGURES: [Self; 4] = [Self::SpaceTime, Self::Way, Self::Positions, Self::SpeedAlongPath];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Series(quantity) => quantity.label(),
            Self::SpaceTime => "Space-time diagram",
            Self::Way => "Space-time diagram of its way",
            Self::Positions => "Positions, aligned at the merging point",
            Self::SpeedAlongPath => "Speed along the path",
        }
    }

    /// Whether the traces have to be matched to lanes.
    pub fn needs_lanes(self) -> bool {
        match self {
            Self::Series(quantity) => quantity.needs_lanes(),
            Self::SpaceTime | Self::Way | Self::Positions | Self::SpeedAlongPath => true,
        }
    }

    /// Whether it shows paths, which may merge at several points.
    pub fn is_of_paths(self) -> bool {
        matches!(self, Self::SpaceTime | Self::Positions | Self::SpeedAlongPath)
    }

    /// Whether its horizontal axis is the simulated time.
    fn is_over_time(self) -> bool {
        self != Self::SpeedAlongPath
    }
}

/// Time span of a chart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ChartSpan {
    /// From the start.
    #[default]
    Whole,
    /// The last minute.
    Minute,
    /// The last ten seconds.
    TenSeconds,
}

impl ChartSpan {
    const ALL: [Self; 3] = [Self::Whole, Self::Minute, Self::TenSeconds];

    fn label(self) -> &'static str {
        match self {
            Self::Whole => "whole run",
            Self::Minute => "last 60 s",
            Self::TenSeconds => "last 10 s",
        }
    }

    /// Its length, seconds; infinite for the whole run.
    pub fn length_s(self) -> f64 {
        match self {
            Self::Whole => f64::INFINITY,
            Self::Minute => 60.0,
            Self::TenSeconds => 10.0,
        }
    }
}

/// A merging point that figures of paths can show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MergeChoice {
    /// Name of the lane that begins there, as `city3d plot --merge` takes it.
    pub lane: String,
    /// Number of vehicles that have passed.
    pub vehicles: usize,
}

/// What the user has chosen to be charted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChartState {
    /// What is shown.
    pub kind: ChartKind,
    /// Vehicles that stay in the chart, whichever is selected.
    pub vehicles: Vec<VehicleId>,
    /// Name of the merging point whose paths are shown; without it, one that the kept or
    /// the selected vehicles pass.
    pub merge: Option<String>,
    /// How far back it shows.
    pub span: ChartSpan,
    /// In laboratory units, whatever the settings say.
    pub is_lab: bool,
    /// In which metres, by that choice and by the settings.
    pub scale: FigureScale,
}

impl Default for ChartState {
    fn default() -> Self {
        Self {
            kind: ChartKind::Series(Quantity::Speed),
            vehicles: Vec::new(),
            merge: None,
            span: ChartSpan::default(),
            is_lab: false,
            scale: FigureScale::default(),
        }
    }
}

/// Most vehicles in a chart where none is chosen.
const MOST_VEHICLES: usize = 8;

impl ChartState {
    /// The vehicles of the chart: those that were chosen and the selected one, else the first of all.
    pub fn shown(&self, selected: Option<VehicleId>, all: impl Iterator<Item = VehicleId>) -> Vec<VehicleId> {
        let mut shown = self.vehicles.clone();
        shown.extend(selected.filter(|id| !self.vehicles.contains(id)));
        if shown.is_empty() { all.take(MOST_VEHICLES).collect() } else { shown }
    }
}

/// A chart as it has been computed.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChartView<'a> {
    /// The figure; `None` until it is computed, and where there is none.
    pub figure: Option<&'a Figure>,
    /// Why there is none.
    pub trouble: Option<&'a str>,
    /// Merging points of the run, where the figure is of paths.
    pub merges: &'a [MergeChoice],
    /// Name of the one that is shown.
    pub merge: Option<&'a str>,
    /// Which of the wanted vehicles are not in the figure.
    pub absent: Option<&'a str>,
    /// It is being computed anew.
    pub is_busy: bool,
    /// Where it was saved last, in words.
    pub saved: Option<&'a str>,
}

/// The controls and the chart, wherever they are docked.
pub(super) fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    // One row where they find room: the plot has the rest.
    ui.horizontal_wrapped(|ui| {
        controls(ui, state, shown, actions);
        vehicles(ui, state, shown);
    });
    merging_point(ui, &mut state.charts, shown.chart);
    if let Some(absent) = shown.chart.absent {
        ui.label(absent).on_hover_text("They are on no path that leads to this merging point");
    }
    if let Some(saved) = shown.chart.saved {
        ui.label(RichText::new(saved).small());
    }
    let needs_control_data =
        matches!(state.charts.kind, ChartKind::Series(quantity) if quantity.needs_control_data());
    if needs_control_data && !shown.has_control_data {
        ui.weak("Only poses are known of this city: pedals, steering and desired paths are not.");
        return;
    }
    match (shown.chart.figure, shown.chart.trouble) {
        (Some(figure), _) => draw(ui, state, (figure, shown), actions),
        (None, Some(trouble)) => {
            ui.label(trouble);
            let is_of_some = state.charts.kind.is_of_paths() && !state.charts.vehicles.is_empty();
            if is_of_some && ui.button("Show all vehicles").clicked() {
                state.charts.vehicles.clear();
            }
        }
        (None, None) => _ = ui.spinner(),
    }
}

fn controls(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    let charts = &mut state.charts;
    charts.scale = match charts.is_lab {
        true => FigureScale::Laboratory,
        false => state.preferences.units.figure_scale(),
    };
    ComboBox::from_id_salt("chart")
        .selected_text(charts.kind.label())
        .width(150.0)
        .height(400.0)
        .show_ui(ui, |ui| {
            for quantity in Quantity::ALL {
                ui.selectable_value(&mut charts.kind, ChartKind::Series(quantity), quantity.label());
            }
            ui.separator();
            for kind in ChartKind::FIGURES {
                ui.selectable_value(&mut charts.kind, kind, kind.label());
            }
        })
        .response
        .on_hover_text("What the chart shows");
    ComboBox::from_id_salt("chart span")
        .selected_text(charts.span.label())
        .width(80.0)
        .show_ui(ui, |ui| {
            for span in ChartSpan::ALL {
                ui.selectable_value(&mut charts.span, span, span.label());
            }
        })
        .response
        .on_hover_text("How far back the chart shows");
    let tip = "Laboratory metres, as city3d plot draws; else with the unit of speeds of the settings";
    ui.checkbox(&mut charts.is_lab, "laboratory units").on_hover_text(tip);
    let save = ui.add_enabled(shown.chart.figure.is_some(), egui::Button::new("Save"));
    let save = save.on_hover_text("Write the chart as SVG, PNG and CSV into the folder of the run");
    if save.on_disabled_hover_text("There is no chart to write").clicked() {
        actions.push(UiAction::SaveChart);
    }
    if shown.chart.is_busy && shown.chart.figure.is_some() {
        ui.spinner().on_hover_text("Lanes of the vehicles are being found");
    }
}

/// Which of several merging points the paths of the figure meet at.
fn merging_point(ui: &mut Ui, charts: &mut ChartState, chart: ChartView<'_>) {
    if chart.merges.len() < 2 {
        return;
    }
    let shown = chart.merges.iter().find(|merge| Some(merge.lane.as_str()) == chart.merge);
    ui.horizontal_wrapped(|ui| {
        let tip = "Where the paths of the chart come together: the lane that begins there";
        let label = ui.label("Merging point").on_hover_text(tip).id;
        let list = ComboBox::from_id_salt("merging point")
            .selected_text(shown.map_or_else(String::new, merge_words))
            .height(400.0)
            .show_ui(ui, |ui| {
                let own = ui.selectable_value(&mut charts.merge, None, "automatic");
                own.on_hover_text(
                    "One that the kept or the selected vehicles pass, else that of most vehicles",
                );
                ui.separator();
                for merge in chart.merges {
                    let is_shown = Some(&merge.lane) == charts.merge.as_ref();
                    if ui.selectable_label(is_shown, merge_words(merge)).clicked() {
                        charts.merge = Some(merge.lane.clone());
                    }
                }
            });
        list.response.labelled_by(label).on_hover_text(tip);
    });
}

fn merge_words(merge: &MergeChoice) -> String {
    format!("{} ({})", merge.lane, counted(merge.vehicles, "vehicle"))
}

/// The vehicles that stay in the chart, each with a way out of it, and a way in for the selected one. That is first and
/// always there: a second click on it must not meet the way out.
fn vehicles(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>) {
    let name = |id: VehicleId| named(shown.names, id);
    let selected = state.selection.vehicle.filter(|id| !state.charts.vehicles.contains(id));
    let keep = ui.add_enabled(selected.is_some(), egui::Button::new("+ Keep"));
    let keep = match selected {
        Some(id) => {
            keep.on_hover_text(format!("Keep {} in the chart when another one is selected", name(id)))
        }
        None => keep.on_disabled_hover_text("Select a vehicle that is not kept yet"),
    };
    let mut removed = None;
    for id in &state.charts.vehicles {
        let text = format!("{} \u{d7}", name(*id));
        if ui.small_button(text).on_hover_text("Take it out of the chart").clicked() {
            removed = Some(*id);
        }
    }
    state.charts.vehicles.retain(|id| Some(*id) != removed);
    if keep.clicked() {
        state.charts.vehicles.extend(selected);
    }
    match selected {
        Some(id) => whole(ui, &format!("selected: {}", name(id)), "It is in the chart while it is selected"),
        None if state.charts.kind == ChartKind::Way => {
            let text = match (state.selection.vehicle, state.charts.vehicles.first()) {
                (Some(id), _) => format!("way of {}", name(id)),
                (None, Some(kept)) => format!("way of {}, which is kept first", name(*kept)),
                (None, None) => "way of the first vehicle".to_owned(),
            };
            whole(ui, &text, "The way of the selected vehicle, else of the one that is kept first");
        }
        None if state.charts.vehicles.is_empty() && state.charts.kind.is_of_paths() => {
            whole(ui, "all on the paths", "Select a vehicle to keep it alone");
        }
        None if state.charts.vehicles.is_empty() => {
            let tip = "Select a vehicle in the table or in the city to see it alone";
            let all = shown.run_state.now.vehicles.len() <= MOST_VEHICLES;
            let text =
                if all { "all vehicles".to_owned() } else { format!("first {MOST_VEHICLES} vehicles") };
            whole(ui, &text, tip);
        }
        None => {}
    }
}

/// Words that begin a row where they do not fit whole.
fn whole(ui: &mut Ui, text: &str, tip: &str) {
    ui.add(egui::Label::new(RichText::new(text).weak()).extend()).on_hover_text(tip);
}

/// Least height of a plot with its axis, points.
const LEAST_PLOT: f32 = 100.0;
/// Height of the name above it, with its spacing, points.
const TITLE: f32 = 23.0;

/// Draws a figure of the logbook.
fn draw(
    ui: &mut Ui,
    state: &UiState,
    (figure, shown): (&Figure, &ViewModel<'_>),
    actions: &mut Vec<UiAction>,
) {
    legend(ui, figure);
    if let Some(scale) = &figure.scale {
        let [from, to] = [scale.from, scale.to].map(|end| state.preferences.decimal.fixed(end, 2));
        ui.weak(format!("{}: {from} dark to {to} light", scale.label));
    }
    let note = RichText::new(&figure.note).small().weak();
    let note_height = height_of(ui, &note) + 2.0 * ui.spacing().item_spacing.y;
    let count = figure.panels.len().max(1) as f32;
    // In a small panel it is scrolled.
    let height = ((ui.available_height() - note_height) / count - TITLE).max(LEAST_PLOT);
    let is_over_time = state.charts.kind.is_over_time();
    egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        for (index, panel) in figure.panels.iter().enumerate() {
            let across = match is_over_time {
                true => plot::Across::ShownTime(shown.run_state.now.time_s),
                false => plot::Across::Anything,
            };
            if let Some(time_s) = plot::show(ui, (figure, index, panel), height, across) {
                actions.push(UiAction::PlaybackCommand(PlaybackCommand::Seek(time_s)));
            }
        }
        ui.label(note);
    });
}

/// Of a text over the whole width, points.
fn height_of(ui: &Ui, text: &RichText) -> f32 {
    let text = egui::WidgetText::from(text.clone());
    let galley =
        text.into_galley(ui, Some(egui::TextWrapMode::Wrap), ui.available_width(), egui::TextStyle::Small);
    galley.size().y
}

/// What the colours of lines are.
const LINE_COLOURS: &str = "A line has the colour of its vehicle's body, as dark or light as the ground needs, and other dashes \
     where bodies are alike; the colours of instance pictures are others";

fn legend(ui: &mut Ui, figure: &Figure) {
    ui.horizontal_wrapped(|ui| {
        for key in &figure.legend {
            let colour = plot::on_ground(ui.ctx(), key.stroke.colour);
            let text = format!("{} {}", sample(key.stroke.dash), key.name);
            // A name is not cut in two.
            let label = egui::Label::new(RichText::new(text).small().color(colour)).extend();
            ui.add(label).on_hover_text(LINE_COLOURS);
        }
    });
}

/// A figure of the logbook that shows no time of the run.
pub(super) fn draw_over_time(ui: &mut Ui, figure: &Figure) {
    legend(ui, figure);
    for (index, panel) in figure.panels.iter().enumerate() {
        let height = (ui.available_height() - 60.0).max(80.0);
        plot::show(ui, (figure, index, panel), height, plot::Across::Time);
    }
    ui.label(RichText::new(&figure.note).small().weak());
}

/// A dash pattern as text.
fn sample(dash: Dash) -> &'static str {
    match dash {
        Dash::Solid => "\u{2014}",
        Dash::Dashed => "- -",
        Dash::Dotted => "\u{b7}\u{b7}\u{b7}",
        Dash::DashDotted => "-\u{b7}-",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chart_shows_what_was_chosen_and_the_selected_one_else_the_first() {
        let mut charts = ChartState::default();
        let all = || (1..=20).map(VehicleId);
        assert_eq!(charts.shown(None, all()).len(), MOST_VEHICLES);
        assert_eq!(charts.shown(Some(VehicleId(9)), all()), [VehicleId(9)]);
        charts.vehicles = vec![VehicleId(3), VehicleId(4)];
        assert_eq!(charts.shown(Some(VehicleId(9)), all()), [3, 4, 9].map(VehicleId));
        assert_eq!(charts.shown(Some(VehicleId(3)), all()), [3, 4].map(VehicleId));
    }
}
