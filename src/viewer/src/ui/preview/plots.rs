//! Running plots of a preview.

use super::{PlotPlaces, PreviewLayout};
use crate::ui::theme::SpeedUnit;
use crate::ui::{ViewModel, events, inspector, status, theme};
use city3d_geometry::{KMH_PER_MPS, trig};
use city3d_protocol::snapshot::{Status, VehicleState};
use egui::{Color32, RichText, Ui};
use egui_plot::{AxisHints, GridMark, Line, Plot, PlotPoints};

/// End of the axis of speeds, unless a vehicle is faster.
const USUAL_KMH: f64 = 50.0;
/// Time span of the running plots, simulated seconds.
pub const KEPT_S: f64 = 30.0;

/// Speed and lateral error over the last [`KEPT_S`].
pub(super) fn plots(
    ui: &mut Ui,
    (shown, units): (&ViewModel<'_>, SpeedUnit),
    vehicle: &VehicleState,
    layout: PreviewLayout,
) {
    if layout.plots == PlotPlaces::Nowhere {
        let text = RichText::new("Plots: in a taller window, or with one preview").small().weak();
        ui.add(egui::Label::new(text).truncate());
        return;
    }
    let is_compact = layout.plots == PlotPlaces::SideBySide;
    let scale = shown.scale();
    // The last point is the present value: samples are some ticks apart.
    let now_s = shown.run_state.now.time_s;
    let past = shown.history.between(now_s - KEPT_S, now_s);
    let earlier = past.iter().filter_map(|state| Some((state.time_s(), state.vehicle(vehicle.id)?)));
    let mut states: Vec<(f64, VehicleState)> = earlier.filter(|(time_s, _)| *time_s < now_s).collect();
    states.push((now_s, vehicle.clone()));
    let series = |of: &dyn Fn(&VehicleState) -> Option<f64>| series(&states, of);
    let height = if is_compact { 58.0 } else { 78.0 };
    let whose = events::named(shown.names, vehicle.id);
    let blue = theme::on_panel(ui.ctx(), Status::Manual);
    let speeds = |ui: &mut Ui| {
        let of = |speed_mps: f64| units.of(speed_mps, scale);
        let speeds = series(&|sample| Some(of(sample.speed_mps)));
        let plot = SmallPlot { quantity: "Speed", unit: units.label(), whose: &whose, height };
        plot.show(ui, speeds, (0.0, of(USUAL_KMH / KMH_PER_MPS)), blue);
    };
    let orange = theme::on_panel(ui.ctx(), Status::Stopped);
    let errors = |ui: &mut Ui| {
        let has_no_path = vehicle.tracked_lateral_error_m().is_none();
        let insight = shown.run_state.insight.as_deref();
        let is_off_route = inspector::is_off_route(insight.and_then(|insight| insight.decision(vehicle.id)));
        if has_no_path || is_off_route || !shown.has_control_data {
            let tip = if vehicle.status == Status::Collided {
                "It has collided: there is no path to follow"
            } else if has_no_path {
                "A person drives: there is no path to follow"
            } else if is_off_route {
                "It is off its route: there is no path to follow"
            } else {
                "Only poses are known: the log does not have its desired path"
            };
            ui.label(RichText::new("Lateral error, cm: -").small()).on_hover_text(tip);
            return;
        }
        let errors = series(&|sample| Some(sample.tracked_lateral_error_m()? * 100.0));
        let plot = SmallPlot { quantity: "Lateral error", unit: "cm", whose: &whose, height };
        plot.show(ui, errors, (-10.0, 10.0), orange);
    };
    if is_compact {
        ui.columns(2, |columns| {
            speeds(&mut columns[0]);
            errors(&mut columns[1]);
        });
    } else {
        speeds(ui);
        errors(ui);
    }
}

/// Values over the time before the last one; NaN, which is a gap, where it was not measured, or has no value.
fn series(states: &[(f64, VehicleState)], of: &dyn Fn(&VehicleState) -> Option<f64>) -> Vec<[f64; 2]> {
    let now_s = states.last().map_or(0.0, |(time_s, _)| *time_s);
    let known = |state: &VehicleState| of(state).filter(|_| status::is_tracked(state.status));
    states.iter().map(|(time_s, state)| [time_s - now_s, known(state).unwrap_or(f64::NAN)]).collect()
}

/// A running plot of one quantity of one vehicle.
struct SmallPlot<'a> {
    quantity: &'a str,
    unit: &'a str,
    whose: &'a str,
    height: f32,
}

impl SmallPlot<'_> {
    fn show(&self, ui: &mut Ui, points: Vec<[f64; 2]>, (low, high): (f64, f64), colour: Color32) {
        let decimal = theme::decimal(ui.ctx());
        let name = format!("{}, {}", self.quantity, self.unit);
        let last = points.last().map_or_else(String::new, |[_, value]| match value.is_finite() {
            true => format!(" {}", decimal.tenths(*value)),
            false => format!(" {}", status::NOT_MEASURED),
        });
        ui.label(RichText::new(format!("{name}:{last}")).small())
            .on_hover_text(format!("The last {KEPT_S:.0} simulated seconds"));
        let time = theme::small_axis(ui, AxisHints::new_x()).min_thickness(13.0).formatter(|mark, _| {
            match mark.value {
                ago if ago > -0.5 => "0 s".to_owned(),
                ago => format!("{ago:.0}"),
            }
        });
        let value = theme::value_axis(ui);
        let axes = ["From now [s]", &format!("{} [{}]", self.quantity, self.unit)];
        let pieces = points.split(|[_, value]| !value.is_finite()).filter(|piece| !piece.is_empty());
        let line = |piece: &[[f64; 2]]| Line::new(self.whose, PlotPoints::from(piece.to_vec())).color(colour);
        let lines: Vec<Line<'_>> = pieces.map(line).collect();
        Plot::new(name)
            .height(self.height)
            .include_x(-KEPT_S)
            .include_x(0.0)
            .include_y(low)
            .include_y(high)
            .allow_zoom(false)
            .allow_drag(false)
            .allow_scroll(false)
            .custom_x_axes(vec![time])
            .custom_y_axes(vec![value])
            .label_formatter(crate::ui::charts::hover::words_near(axes, decimal))
            .x_grid_spacer(|_| marks((-KEPT_S, 0.0), KEPT_S / 2.0))
            .y_grid_spacer(|grid| marks(grid.bounds, round_step(grid.bounds.1 - grid.bounds.0, 3.0)))
            .show(ui, |plot| lines.into_iter().for_each(|line| plot.line(line)));
    }
}

/// Grid marks at multiples of a step.
pub(in crate::ui) fn marks((from, to): (f64, f64), step: f64) -> Vec<GridMark> {
    let (first, last) = ((from / step).ceil() as i64, (to / step).floor() as i64);
    (first..=last).map(|k| GridMark { value: k as f64 * step, step_size: step }).collect()
}

/// The smallest of 1, 2, 5, 10, 20 ..., and of tenths and hundredths, that divides a span into at most so many.
pub(in crate::ui) fn round_step(span: f64, parts: f64) -> f64 {
    let least = (span / parts).max(1e-3);
    let power = trig::pow(10.0, trig::log10(least).floor());
    let step = [1.0, 2.0, 5.0].into_iter().find(|step| step * power >= least);
    step.unwrap_or(10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_two_or_three_round_numbers_whatever_they_span() {
        let values = |from: f64, to: f64| -> Vec<f64> {
            marks((from, to), round_step(to - from, 3.0)).iter().map(|mark| mark.value).collect()
        };
        assert_eq!(values(-2.5, 52.5), [0.0, 20.0, 40.0]);
        assert_eq!(values(-11.0, 11.0), [-10.0, 0.0, 10.0]);
        assert_eq!(values(-11.0, 190.0), [0.0, 100.0]);
        assert_eq!(values(-2.75, 57.75), [0.0, 50.0]);
        assert_eq!(values(-0.03, 0.58), [0.0, 0.5], "metres a second in the laboratory");
        assert!(values(-0.03, 1.3).len() > 1);
    }

    #[test]
    fn an_error_that_is_unknown_for_a_while_is_a_gap_and_no_line() {
        let at = |status: Status, lateral_error_m: f64| VehicleState {
            status,
            lateral_error_m,
            ..VehicleState::default()
        };
        let states = [
            (1.0, at(Status::Driving, 0.01)),
            (1.1, at(Status::Manual, 0.0)),
            (1.2, at(Status::Collided, -0.08)),
            (1.3, at(Status::Unseen, 0.0)),
            (1.4, at(Status::Driving, 0.02)),
        ];
        let errors = series(&states, &|state| state.tracked_lateral_error_m());
        assert_eq!(
            errors.iter().map(|[_, value]| value.is_nan()).collect::<Vec<_>>(),
            [false, true, true, true, false]
        );
        assert!((errors[0][0] + 0.4).abs() < 1e-9 && errors[4] == [0.0, 0.02], "{errors:?}");
    }
}
