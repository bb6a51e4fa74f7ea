//! Quantities of vehicles over time: one figure for several vehicles.

use super::chart::{ChartLine, Dash, Figure, LegendEntry, LineStyle, PALETTE, Panel};
use super::gap::gaps;
use super::labels::conditions;
use super::run::Trace;
use super::style::{STYLES, distinct_styles};
use super::table::{TidyTable, number};
use city3d_geometry::KMH_PER_MPS;
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeSet;

/// Below this speed a time headway means nothing, city m/s.
const LEAST_SPEED_MPS: f64 = 0.5;

/// A quantity of a vehicle over time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quantity {
    /// Along the heading; negative in reverse.
    #[default]
    Speed,
    /// Along the heading.
    Acceleration,
    /// Front-axle centre from the desired path, left-positive.
    LateralError,
    /// Steering angle, left-positive.
    Steering,
    /// Rate of the heading, counter-clockwise.
    YawRate,
    /// Accelerator pedal.
    Gas,
    /// Brake pedal.
    Brake,
    /// Distance driven.
    Distance,
    /// To the vehicle ahead on the same lanes, bumper to bumper.
    Gap,
    /// Time until the front bumper is where the vehicle ahead has its rear bumper.
    Headway,
}

/// In which metres a figure is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FigureScale {
    /// Full scale, with speeds in km/h.
    #[default]
    City,
    /// Full scale, with speeds in m/s.
    CityMetresPerSecond,
    /// Of the laboratory, as `city3d plot` draws.
    Laboratory,
}

impl Quantity {
    /// All quantities.
    pub const ALL: [Self; 10] = [
        Self::Speed,
        Self::Acceleration,
        Self::Gap,
        Self::Headway,
        Self::LateralError,
        Self::Steering,
        Self::YawRate,
        Self::Gas,
        Self::Brake,
        Self::Distance,
    ];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Speed => "Speed",
            Self::Acceleration => "Acceleration",
            Self::LateralError => "Lateral error",
            Self::Steering => "Steering angle",
            Self::YawRate => "Yaw rate",
            Self::Gas => "Gas",
            Self::Brake => "Brake",
            Self::Distance => "Distance",
            Self::Gap => "Gap",
            Self::Headway => "Time headway",
        }
    }

    /// Whether it follows from the lanes of all vehicles, to which their traces have to be matched.
    pub fn needs_lanes(self) -> bool {
        matches!(self, Self::Gap | Self::Headway)
    }

    /// Whether poses alone do not tell it.
    pub fn needs_control_data(self) -> bool {
        matches!(self, Self::LateralError | Self::Steering | Self::Gas | Self::Brake)
    }

    /// Unit on the axis, and its factor over SI units of that scale.
    fn unit(self, scale: FigureScale) -> (&'static str, f64) {
        let is_city = scale != FigureScale::Laboratory;
        match self {
            Self::Speed if scale == FigureScale::City => ("km/h", KMH_PER_MPS),
            Self::Speed => ("m/s", 1.0),
            Self::Acceleration => ("m/s\u{b2}", 1.0),
            Self::LateralError if is_city => ("cm", 100.0),
            Self::LateralError => ("mm", 1000.0),
            Self::Steering => ("\u{b0}", 180.0 / std::f64::consts::PI),
            Self::YawRate => ("\u{b0}/s", 180.0 / std::f64::consts::PI),
            Self::Gas | Self::Brake => ("", 1.0),
            Self::Distance | Self::Gap => ("m", 1.0),
            Self::Headway => ("s", 1.0),
        }
    }

    /// Column of a table: SI units, but for speeds in km/h where the figure has them.
    fn column(self, scale: FigureScale) -> &'static str {
        match self {
            Self::Speed if scale == FigureScale::City => "speed_kmh",
            Self::Speed => "speed_mps",
            Self::Acceleration => "acceleration_mps2",
            Self::LateralError => "lateral_error_m",
            Self::Steering => "steering_rad",
            Self::YawRate => "yaw_rate_radps",
            Self::Gas => "gas",
            Self::Brake => "brake",
            Self::Distance => "distance_m",
            Self::Gap => "gap_m",
            Self::Headway => "headway_s",
        }
    }

    fn is_length(self) -> bool {
        matches!(self, Self::Speed | Self::Acceleration | Self::LateralError | Self::Distance | Self::Gap)
    }

    /// What a figure says of it.
    fn note(self) -> &'static str {
        match self {
            Self::Speed => "Along the heading.",
            Self::Acceleration => {
                "Along the heading; in a collision the change of the speed from one state to the next."
            }
            Self::LateralError => "Front-axle centre from its desired path, positive to the left.",
            Self::Steering => "Of the front axle's middle, positive to the left.",
            Self::YawRate => "Counter-clockwise seen from above.",
            Self::Gas | Self::Brake => "1 is a pedal that is fully down.",
            Self::Distance => "Driven since the start.",
            Self::Gap => {
                "Bumper to bumper to the next vehicle ahead on the lanes that were driven, and on those of the route."
            }
            Self::Headway => {
                "Gap to the next vehicle ahead on the lanes that were driven, and on those of the route, over the own speed."
            }
        }
    }

    /// Values of a trace over time in SI units at full scale; NaN where there is none, and where it was not measured. `all`: every trace of the run,
    /// matched to lanes where the quantity needs them.
    fn values(self, trace: &Trace, all: &[Trace], experiment: &Experiment) -> Vec<(f64, f64)> {
        let direct = |of: fn(&super::run::TraceSample) -> f64| {
            trace.samples.iter().map(|sample| (sample.time_s, of(sample))).collect()
        };
        let mut values: Vec<(f64, f64)> = match self {
            Self::Speed => direct(|sample| sample.speed_mps),
            Self::Acceleration => accelerations(trace),
            Self::LateralError => direct(|sample| sample.lateral_error_m),
            Self::Steering => direct(|sample| sample.steering_rad),
            Self::YawRate => direct(|sample| sample.yaw_rate_radps),
            Self::Gas => direct(|sample| sample.gas),
            Self::Brake => direct(|sample| sample.brake),
            Self::Distance => direct(|sample| sample.distance_m),
            Self::Gap => gaps(trace, all, experiment),
            Self::Headway => gaps(trace, all, experiment)
                .into_iter()
                .zip(&trace.samples)
                .map(|((time_s, gap_m), sample)| match sample.speed_mps {
                    speed_mps if speed_mps > LEAST_SPEED_MPS => (time_s, gap_m / speed_mps),
                    _ => (time_s, f64::NAN),
                })
                .collect(),
        };
        for ((_, value), sample) in values.iter_mut().zip(&trace.samples) {
            *value = if sample.is_seen { *value } else { f64::NAN };
        }
        values
    }
}

/// Speed changes faster in collisions alone, m/s2.
const MOST_OF_TYRES_MPS2: f64 = 12.0;

/// Accelerations at the states of a trace; where speed has changed faster than tyres allow, by how much since the state before: those
/// at the states miss what happens between two of them.
fn accelerations(trace: &Trace) -> Vec<(f64, f64)> {
    let mut before = None;
    let of = |sample: &super::run::TraceSample| {
        let [time_s, speed_mps] = [sample.time_s, sample.speed_mps];
        let change = before.replace([time_s, speed_mps]).map(|[t, v]| (speed_mps - v) / (time_s - t));
        let struck = change.filter(|change| change.abs() > MOST_OF_TYRES_MPS2);
        (time_s, struck.unwrap_or(sample.acceleration_mps2))
    };
    trace.samples.iter().map(of).collect()
}

/// What a figure of a quantity over time shows.
#[derive(Clone, Debug)]
pub struct SeriesFigure<'a> {
    /// The quantity.
    pub quantity: Quantity,
    /// In which metres.
    pub scale: FigureScale,
    /// The experiment of the run: its name, scale and routes.
    pub experiment: &'a Experiment,
    /// Simulated times of its left and right end, seconds.
    pub span_s: (f64, f64),
    /// The vehicles, from first to last in the legend.
    pub shown: Vec<&'a Trace>,
    /// Every trace of the run, matched to lanes where the quantity needs them.
    pub all: &'a [Trace],
}

impl SeriesFigure<'_> {
    /// The figure; its table is left empty unless it is asked for.
    pub fn draw(&self, with_table: bool) -> Figure {
        let Self { quantity, scale, .. } = *self;
        let (unit, factor) = quantity.unit(scale);
        let in_unit = if unit.is_empty() { String::new() } else { format!(" [{unit}]") };
        let metres = match scale {
            FigureScale::Laboratory if quantity.is_length() => self.experiment.scale.lab_from_city(1.0),
            _ => 1.0,
        };
        let mut panel = Panel {
            x_label: "Time [s]".to_owned(),
            y_label: format!("{}{in_unit}", quantity.label()),
            ..Panel::default()
        };
        let mut table = TidyTable::new(&["run", "vehicle", "name", "time_s", quantity.column(scale)]);
        let of_run = self.conditions();
        let in_table = if quantity == Quantity::Speed { factor } else { 1.0 };
        let mut legend = Vec::new();
        let within = |&(time_s, _): &(f64, f64)| (self.span_s.0..=self.span_s.1).contains(&time_s);
        for (trace, stroke) in self.shown.iter().zip(styles_of(&self.shown)) {
            let values: Vec<(f64, f64)> = quantity
                .values(trace, self.all, self.experiment)
                .into_iter()
                .filter(within)
                .map(|(time_s, value)| (time_s, value * metres))
                .collect();
            if with_table {
                let row = |&(time_s, value): &(f64, f64)| {
                    let (id, name) = (trace.id.to_string(), trace.name.clone());
                    vec![of_run.clone(), id, name, number(time_s, 3), number(value * in_table, 6)]
                };
                table.rows.extend(values.iter().map(row));
            }
            let follows = !quantity.needs_lanes() || values.iter().any(|(_, value)| value.is_finite());
            let points = values.into_iter().map(|(time_s, value)| (time_s, value * factor)).collect();
            panel.lines.push(ChartLine { points, stroke });
            let name = format!("{} {}", trace.id, trace.name);
            let name = if follows { name } else { format!("{name} (no leader)") };
            legend.push(LegendEntry { name, stroke });
        }
        panel.fit(&[self.span_s.0, self.span_s.1], &[0.0]);
        let frame = match scale {
            FigureScale::City | FigureScale::CityMetresPerSecond => "Full scale.",
            FigureScale::Laboratory => "Laboratory metres.",
        };
        let frame = if quantity.is_length() { frame } else { "" };
        Figure {
            name: quantity.label().to_lowercase().replace(' ', "_"),
            title: format!("{of_run}: {}", quantity.label().to_lowercase()),
            panels: vec![panel],
            columns: 1,
            row_height: 0.5,
            legend,
            scale: None,
            note: format!("{} {frame}", quantity.note()).trim_end().to_owned()
                + &self.rate_note()
                + self.gaps_note(),
            table,
        }
    }

    /// What the run is of.
    fn conditions(&self) -> String {
        conditions(self.experiment, self.experiment.physical().next().is_some())
    }

    /// How far samples are apart, where much may happen between them.
    fn rate_note(&self) -> String {
        const TOLD_S: f64 = 0.05;
        let samples = self.shown.first().map_or(&[][..], |trace| &trace.samples);
        let mut steps: Vec<f64> = samples.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
        steps.sort_by(f64::total_cmp);
        let usual_s = steps.get(steps.len() / 2).copied().unwrap_or_default();
        let note =
            || format!(" A state every {usual_s:.2} s, and at collisions: shorter peaks are not seen.");
        if usual_s > TOLD_S - 1e-9 { note() } else { String::new() }
    }

    /// Why lines have gaps, where a vehicle was not measured.
    fn gaps_note(&self) -> &'static str {
        let (from_s, to_s) = self.span_s;
        let mut samples = self.shown.iter().flat_map(|trace| &trace.samples);
        let has_gap = samples.any(|sample| !sample.is_seen && (from_s..=to_s).contains(&sample.time_s));
        if has_gap { " A gap: the vehicle was not tracked." } else { "" }
    }
}

/// A style for each vehicle, which it has whoever else is shown; where two would be alike, styles by their order.
fn styles_of(shown: &[&Trace]) -> Vec<LineStyle> {
    let styles: Vec<LineStyle> = distinct_styles(STYLES).collect();
    let places: Vec<usize> = shown.iter().map(|trace| trace.id.0.wrapping_sub(1) as usize % STYLES).collect();
    let are_distinct = places.iter().collect::<BTreeSet<_>>().len() == places.len();
    match are_distinct {
        true => places.into_iter().map(|place| styles[place]).collect(),
        false => distinct_styles(shown.len()).collect(),
    }
}

/// The lines of two runs on one pair of axes: those of the first are solid and called A, those of the second dashed and
/// called B. The table is left empty.
pub fn compared(runs: [&SeriesFigure<'_>; 2]) -> Figure {
    let [mut figure, other] = runs.map(|run| run.draw(false));
    let solid = LineStyle::solid(PALETTE[0]);
    let dashed = LineStyle { dash: Dash::Dashed, ..LineStyle::solid(PALETTE[1]) };
    let lines = |figure: &Figure, stroke: LineStyle| -> Vec<ChartLine> {
        let all = figure.panels.iter().flat_map(|panel| &panel.lines);
        all.map(|line| ChartLine { points: line.points.clone(), stroke }).collect()
    };
    let names = |figure: &Figure, letter: &str, stroke: LineStyle| -> Vec<LegendEntry> {
        let name = |entry: &LegendEntry| format!("{letter}  {}", entry.name);
        figure.legend.iter().map(|entry| LegendEntry { name: name(entry), stroke }).collect()
    };
    figure.legend = [names(&figure, "A", solid), names(&other, "B", dashed)].concat();
    let lines = [lines(&figure, solid), lines(&other, dashed)].concat();
    let [a, b] = runs.map(|run| run.span_s);
    if let Some(panel) = figure.panels.first_mut() {
        panel.lines = lines;
        panel.fit(&[a.0.min(b.0), a.1.max(b.1)], &[0.0]);
    }
    figure
}

#[cfg(test)]
mod tests {
    use super::super::run::TraceBuilder;
    use super::*;
    use crate::record::LogOrigin;
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};
    use std::sync::Arc;

    /// Two cars on one lane, one behind the other.
    fn followers() -> (Run, Vec<Trace>) {
        let (text, library) = Library::scenario("straight").unwrap();
        let experiment = read_experiment("straight", &text, &library, Overrides::default()).unwrap();
        let mut run = Run::new(Arc::new(experiment)).unwrap();
        let mut builder = TraceBuilder::new(Arc::clone(run.experiment()));
        for _ in 0..80 {
            for vehicle in &run.snapshot().vehicles {
                builder.see(run.snapshot().time_s, vehicle);
            }
            (0..10).for_each(|_| _ = run.step());
        }
        let traces = builder.finish(LogOrigin::Run).vehicles;
        (run, traces)
    }

    fn figure(quantity: Quantity, scale: FigureScale, run: &Run, traces: &[Trace]) -> Figure {
        let shown = traces.iter().collect();
        let (experiment, span_s) = (run.experiment(), (0.0, 8.0));
        SeriesFigure { quantity, scale, experiment, span_s, shown, all: traces }.draw(true)
    }

    #[test]
    fn accelerations_have_what_happens_between_two_states() {
        let (run, mut traces) = followers();
        let trace = &mut traces[0];
        for (k, sample) in trace.samples.iter_mut().enumerate() {
            // It is stopped between two states, and its acceleration at both is small.
            (sample.speed_mps, sample.acceleration_mps2) = (if k < 40 { 5.0 } else { 0.0 }, 0.1);
        }
        let dt_s = trace.samples[40].time_s - trace.samples[39].time_s;
        let values = Quantity::Acceleration.values(&traces[0], &traces, run.experiment());
        assert!((values[40].1 + 5.0 / dt_s).abs() < 1e-9, "{:?}", &values[38..43]);
        assert_eq!([values[0].1, values[39].1, values[41].1], [0.1; 3], "else that of the state");
    }

    #[test]
    fn gap_and_headway_are_those_between_the_bumpers() {
        let (run, traces) = followers();
        assert!(traces.len() >= 2, "one follows another");
        let figure = figure(Quantity::Gap, FigureScale::City, &run, &traces);
        assert_eq!(figure.panels[0].y_label, "Gap [m]");
        let mut checked = 0;
        for (line, trace) in figure.panels[0].lines.iter().zip(&traces) {
            for (&(time_s, gap_m), sample) in line.points.iter().zip(&trace.samples) {
                // All go along the same straight lane: distances between middles less a length are gaps.
                let ahead = traces.iter().filter(|other| other.id != trace.id).filter_map(|other| {
                    let there = other.samples.iter().find(|there| there.time_s == time_s)?;
                    let along_m = (there.pose.position - sample.pose.position).dot(sample.pose.forward());
                    let half_m = (other.dimensions.length_m + trace.dimensions.length_m) / 2.0;
                    (along_m > 0.0).then_some(along_m - half_m)
                });
                let nearest_m = ahead.fold(f64::INFINITY, f64::min);
                if gap_m.is_finite() {
                    assert!((gap_m - nearest_m).abs() < 0.3, "{time_s}: {gap_m}, {nearest_m} m");
                    checked += 1;
                }
            }
        }
        assert!(checked > 40, "{checked}");
        let leads = figure.panels[0].lines.iter().filter(|line| line.points.iter().all(|p| p.1.is_nan()));
        assert_eq!(leads.count(), 1, "who leads follows nobody");
        let lead = figure.legend.iter().filter(|entry| entry.name.ends_with("(no leader)"));
        assert_eq!(lead.count(), 1, "the legend says why it has no line");
    }

    #[test]
    fn speeds_are_those_of_the_traces_in_the_units_of_the_axis_and_in_the_table() {
        let (run, traces) = followers();
        let city = figure(Quantity::Speed, FigureScale::City, &run, &traces);
        let lab = figure(Quantity::Speed, FigureScale::Laboratory, &run, &traces);
        let labels = [&city, &lab].map(|figure| figure.panels[0].y_label.clone());
        assert_eq!(labels, ["Speed [km/h]", "Speed [m/s]"]);
        let sample = traces[0].samples[30];
        let [kmh, mps] = [&city, &lab].map(|figure| figure.panels[0].lines[0].points[30].1);
        assert!((kmh - sample.speed_mps * 3.6).abs() < 1e-9 && (mps - sample.speed_mps / 25.0).abs() < 1e-9);
        assert_eq!(city.table.columns, ["run", "vehicle", "name", "time_s", "speed_kmh"]);
        assert_eq!(city.table.rows[30][4], number(sample.speed_mps * 3.6, 6));
        assert_eq!(city.title, "straight, seed 1, ideal environment: speed");
        assert_eq!(city.table.rows[30][0], "straight, seed 1, ideal environment");
        assert_eq!(city.legend.len(), traces.len());
    }

    #[test]
    fn two_runs_are_on_one_pair_of_axes_that_has_room_for_both() {
        let (run, traces) = followers();
        let series = |trace, scale, end_s| SeriesFigure {
            quantity: Quantity::Speed,
            scale,
            experiment: run.experiment(),
            span_s: (0.0, end_s),
            shown: vec![trace],
            all: &[],
        };
        let scale = FigureScale::CityMetresPerSecond;
        let figure = compared([&series(&traces[0], scale, 4.0), &series(&traces[1], scale, 7.9)]);
        let names: Vec<&str> = figure.legend.iter().map(|entry| entry.name.as_str()).collect();
        assert!(names[0].starts_with("A  1 ") && names[1].starts_with("B  2 "), "{names:?}");
        let panel = &figure.panels[0];
        assert_eq!(panel.y_label, "Speed [m/s]");
        assert_eq!(
            panel.lines.iter().map(|line| line.stroke.dash).collect::<Vec<_>>(),
            [Dash::Solid, Dash::Dashed]
        );
        assert_ne!(panel.lines[0].stroke.colour, panel.lines[1].stroke.colour);
        assert!(panel.x.1 >= 7.9, "{:?}", panel.x);
        assert_eq!(panel.lines[1].points[30].1, traces[1].samples[30].speed_mps);
    }

    #[test]
    fn only_the_span_is_drawn() {
        let (run, traces) = followers();
        let shown = vec![&traces[0]];
        let figure = SeriesFigure {
            quantity: Quantity::Distance,
            scale: FigureScale::City,
            experiment: run.experiment(),
            span_s: (3.0, 5.0),
            shown,
            all: &traces,
        };
        let times: Vec<f64> = figure.draw(false).panels[0].lines[0].points.iter().map(|p| p.0).collect();
        assert!(times[0] >= 3.0 && times[times.len() - 1] <= 5.0 && times.len() == 21, "{times:?}");
    }
}
