//! Figures over time, vehicle by vehicle: speeds, lateral errors, pedals, distances between two runs.

use super::chart::{BLACK, ChartLine, Colour, Figure, GREY, LegendEntry, LineStyle, PALETTE, Panel};
use super::run::Trace;
use super::series::{AVERAGED_S, differences, moving_average};
use super::table::number;
use super::views::{FigureSet, LEAST_SPEED_MPS, MOST_STYLES};
use city3d_protocol::snapshot::VehicleId;

/// Most vehicles with panels of their own.
const MOST_ROWS: usize = 8;

/// Whether all values of a figure are more than half of the largest one.
fn is_narrow(figure: &Figure) -> bool {
    let points = || figure.panels.iter().flat_map(|panel| &panel.lines).flat_map(|line| &line.points);
    let values = || points().map(|(_, value)| *value).filter(|value| value.is_finite());
    let most = values().fold(0.0, f64::max);
    most > LEAST_SPEED_MPS && values().all(|value| value > 0.5 * most)
}

impl FigureSet<'_> {
    /// Speed over time.
    pub(super) fn speed_over_time(&self) -> Figure {
        let columns = ["run", "vehicle", "name", "time_s", "speed_mps"];
        let mut figure = self.figure("speed_time", "speed over time", &columns);
        let note = self.series(&mut figure, "Speed [m/s]", 1.0, &|trace| {
            moving_average(trace).into_iter().map(|mps| self.metres(mps)).collect()
        });
        // Small changes of a speed are not seen on an axis from 0.
        let is_narrow = is_narrow(&figure);
        let speeds: &[f64] = if is_narrow { &[] } else { &[0.0, LEAST_SPEED_MPS] };
        Self::fit_alike(&mut figure, &[0.0], speeds);
        let axis = if is_narrow { " The axis of speeds does not begin at 0." } else { "" };
        figure.note = format!("Speeds are means over {AVERAGED_S} s. Laboratory metres.{axis}{note}");
        figure
    }

    /// Distance of the front axle from the desired path.
    pub(super) fn lateral_error(&self) -> Figure {
        let columns = ["run", "vehicle", "name", "time_s", "lateral_error_m"];
        let mut figure = self.figure("lateral_error", "lateral error of the front axle", &columns);
        let note = self.series(&mut figure, "Lateral error [mm]", 1000.0, &|trace| {
            trace.samples.iter().map(|sample| self.metres(sample.lateral_error_m)).collect()
        });
        Self::fit_alike(&mut figure, &[0.0], &[0.0]);
        let of = match self.runs.iter().any(|run| !run.origin.has_world()) {
            true => "the middle of its lane (in a log of poses alone), else from its desired path",
            false => "its desired path",
        };
        figure.note =
            format!("Front-axle centre from {of}, positive to the left. Laboratory millimetres.{note}");
        figure
    }

    /// Adds a panel for each run with a quantity of the first vehicles over time, and their legend. The table has the
    /// quantity, the axis so many times that. Returns a note where vehicles are left out.
    fn series(
        &self,
        figure: &mut Figure,
        label: &str,
        factor: f64,
        values: &dyn Fn(&Trace) -> Vec<f64>,
    ) -> String {
        let (ids, note) = self.some(MOST_STYLES);
        let styles = self.styles_of(&ids);
        for (run, log) in self.runs.iter().enumerate() {
            let mut panel = Panel {
                title: self.panel_title(run),
                x_label: "Time [s]".to_owned(),
                y_label: label.to_owned(),
                ..Panel::default()
            };
            for trace in ids.iter().filter_map(|id| log.vehicle(*id)) {
                let values: Vec<(f64, f64)> =
                    trace.samples.iter().map(|sample| sample.time_s).zip(values(trace)).collect();
                let row = |&(time_s, value): &(f64, f64)| {
                    let (id, name) = (trace.id.to_string(), trace.name.clone());
                    vec![self.labels[run].clone(), id, name, number(time_s, 3), number(value, 6)]
                };
                figure.table.rows.extend(values.iter().map(row));
                let points = values.into_iter().map(|(time_s, value)| (time_s, value * factor)).collect();
                let stroke = LineStyle { width_pt: 0.8, ..styles[&trace.id] };
                panel.lines.push(ChartLine { points, stroke });
            }
            figure.panels.push(panel);
        }
        figure.legend = self.keys_of(&ids);
        note
    }

    pub(super) fn keys_of(&self, ids: &[VehicleId]) -> Vec<LegendEntry> {
        let styles = self.styles_of(ids);
        ids.iter().map(|id| LegendEntry { name: self.name(*id), stroke: styles[id] }).collect()
    }

    /// Gas, brake and handbrake, a row for each vehicle.
    pub(super) fn pedals(&self) -> Figure {
        const GAS: Colour = PALETTE[1];
        const BRAKE: Colour = PALETTE[0];
        const HANDBRAKE: Colour = BLACK;
        let columns = ["run", "vehicle", "name", "time_s", "gas", "brake", "handbrake"];
        let mut figure = self.figure("pedals", "pedals", &columns);
        let (ids, word) = self.some(MOST_ROWS);
        for (row, &id) in ids.iter().enumerate() {
            for (run, log) in self.runs.iter().enumerate() {
                let title = match self.runs.len() {
                    1 => self.name(id),
                    _ => format!("{}: {}", self.panel_title(run), self.name(id)),
                };
                let is_last = row + 1 == ids.len();
                let mut panel = Panel {
                    title,
                    x_label: if is_last { "Time [s]".to_owned() } else { String::new() },
                    y_label: "Pedal".to_owned(),
                    ..Panel::default()
                };
                let samples = log.vehicle(id).map_or(&[][..], |trace| &trace.samples);
                let line = |of: &dyn Fn(usize) -> f64, colour| ChartLine {
                    points: (0..samples.len()).map(|k| (samples[k].time_s, of(k))).collect(),
                    stroke: LineStyle { width_pt: 0.8, ..LineStyle::solid(colour) },
                };
                // A released pedal has no line.
                let down = |value: f64| if value > 1e-3 { value } else { f64::NAN };
                panel.lines.push(line(&|_| 0.0, GREY));
                panel.lines.push(line(&|k| down(samples[k].gas), GAS));
                panel.lines.push(line(&|k| -down(samples[k].brake), BRAKE));
                panel.lines.push(line(&|k| -down(samples[k].handbrake), HANDBRAKE));
                for sample in samples {
                    figure.table.rows.push(vec![
                        self.labels[run].clone(),
                        id.to_string(),
                        self.name(id),
                        number(sample.time_s, 3),
                        number(sample.gas, 4),
                        number(sample.brake, 4),
                        number(sample.handbrake, 4),
                    ]);
                }
                figure.panels.push(panel);
            }
        }
        let last_s = self.runs.iter().map(|run| run.end_s).fold(0.0, f64::max);
        Self::fit_alike(&mut figure, &[0.0, last_s], &[]);
        figure.panels.iter_mut().for_each(|panel| panel.y = (-1.05, 1.05));
        figure.row_height = if self.runs.len() == 1 { 0.1 } else { 0.085 };
        let key =
            |name: &str, colour| LegendEntry { name: name.to_owned(), stroke: LineStyle::solid(colour) };
        figure.legend = vec![
            key("gas, upwards", GAS),
            key("brake, downwards", BRAKE),
            key("handbrake, downwards", HANDBRAKE),
        ];
        figure.note = format!("1 is a pedal that is fully down.{word}");
        figure
    }

    /// Distance between the positions of a vehicle in two runs over time.
    ///
    /// # Panics
    /// When there are fewer than two runs.
    pub fn difference(&self) -> Figure {
        let columns = ["vehicle", "name", "time_s", "difference_m"];
        let mut figure = self.figure("difference", "distance between the two runs", &columns);
        (figure.columns, figure.row_height) = (1, 0.5);
        let (ids, word) = self.some(MOST_STYLES);
        let styles = self.styles_of(&ids);
        let mut panel =
            Panel { x_label: "Time [s]".to_owned(), y_label: "Distance [m]".to_owned(), ..Panel::default() };
        for &id in &ids {
            let (Some(a), Some(b)) = (self.runs[0].vehicle(id), self.runs[1].vehicle(id)) else { continue };
            let points: Vec<(f64, f64)> =
                differences(a, b).into_iter().map(|(time_s, m)| (time_s, self.metres(m))).collect();
            for &(time_s, apart) in &points {
                figure.table.rows.push(vec![
                    id.to_string(),
                    self.name(id),
                    number(time_s, 3),
                    number(apart, 5),
                ]);
            }
            panel.lines.push(ChartLine { points, stroke: styles[&id] });
        }
        panel.fit(&[0.0], &[0.0]);
        figure.panels.push(panel);
        figure.legend = self.keys_of(&ids);
        figure.note = format!(
            "Between the middles of a vehicle's outline in \"{}\" and in \"{}\" at the same time. Laboratory metres.{word}",
            self.labels[0], self.labels[1]
        );
        figure
    }
}
