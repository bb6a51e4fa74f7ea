//! Logs of runs, read into tables and figures.

use crate::convert::{bad_input, object};
use crate::tables::{self, Table};
use arrow_array::types::Int32Type;
use arrow_array::{ArrayRef, DictionaryArray, Float64Array, RecordBatch, UInt32Array};
use city3d_logbook::figures::chart::Figure as Chart;
use city3d_logbook::figures::{
    FigureSet, FigureSize, RunLog, StreamLayout, Trace, TraceSample, png, svg, write,
};
use city3d_protocol::snapshot::VehicleId;
use pyo3::exceptions::{PyOSError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyCapsule, PyDict, PyList};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

/// Reads the log of a run: a file, or the folder of a run with `run.mcap` in it.
#[pyfunction]
pub fn read(py: Python<'_>, log: PathBuf) -> PyResult<Log> {
    py.detach(|| {
        let path = if log.is_dir() { log.join("run.mcap") } else { log };
        let run = RunLog::read(&path).map_err(bad_input)?;
        let vehicles = vehicles_of(&run).map_err(tables::failed)?;
        Ok(Log { runs: Arc::new([run]), vehicles })
    })
}

/// The log of a run. Full-scale metres, SI units, simulated seconds.
#[pyclass(module = "city3d", frozen)]
#[derive(Debug)]
pub struct Log {
    runs: Arc<[RunLog; 1]>,
    vehicles: RecordBatch,
}

#[pymethods]
impl Log {
    /// A row for each vehicle and snapshot, by vehicle and time. Values that are not known are missing.
    #[getter]
    fn vehicles(&self) -> Table {
        Table::new(self.vehicles.clone())
    }

    /// What happened, as `World.events` tells it.
    #[getter]
    fn events<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let list = PyList::empty(py);
        for event in &self.runs[0].events {
            let value =
                serde_json::to_value(event).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
            list.append(object(py, &value)?)?;
        }
        Ok(list)
    }

    /// Name of the scenario.
    #[getter]
    fn scenario(&self) -> &str {
        &self.runs[0].experiment.name
    }

    /// Seed of the run.
    #[getter]
    fn seed(&self) -> u64 {
        self.runs[0].experiment.seed
    }

    /// Time of the last snapshot.
    #[getter]
    fn end_s(&self) -> f64 {
        self.runs[0].end_s
    }

    /// Version of City3D that wrote it.
    #[getter]
    fn version(&self) -> &str {
        &self.runs[0].version
    }

    /// Why it ends early, or `None`.
    #[getter]
    fn truncation(&self) -> Option<&str> {
        self.runs[0].truncation.as_deref()
    }

    /// The figures that `city3d plot` draws, by name: of the merging point that begins with the lane `merge`, with positions
    /// from `origin_m` laboratory metres before it, of these vehicles alone.
    #[pyo3(signature = (*, merge = None, origin_m = None, vehicles = None, size = "page"))]
    fn figures<'py>(
        &self,
        py: Python<'py>,
        merge: Option<&str>,
        origin_m: Option<f64>,
        vehicles: Option<Vec<u32>>,
        size: &str,
    ) -> PyResult<Bound<'py, PyDict>> {
        let size = match size {
            "page" => FigureSize::Page,
            "column" => FigureSize::Column,
            other => return Err(bad_input(format!("no size {other:?}: it is \"page\" or \"column\""))),
        };
        let only: BTreeSet<VehicleId> = vehicles.unwrap_or_default().into_iter().map(VehicleId).collect();
        let run = &self.runs[0];
        if let Some(unknown) = only.iter().find(|id| run.vehicle(**id).is_none()) {
            return Err(bad_input(format!("the run has no vehicle {unknown}")));
        }
        let charts = py.detach(|| {
            let origin_m = origin_m.map(|lab_m| run.experiment.scale.city_from_lab(lab_m));
            let layout = StreamLayout::of(run, merge, origin_m).map_err(bad_input)?;
            let (charts, _) = FigureSet::new(&*self.runs, &layout, &only).all();
            PyResult::Ok(charts)
        })?;
        let figures = PyDict::new(py);
        for chart in charts {
            figures.set_item(chart.name.clone(), Figure { chart, size })?;
        }
        Ok(figures)
    }

    /// The table of the vehicles as a stream of Arrow.
    #[pyo3(signature = (requested_schema = None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        self.vehicles().stream(py)
    }

    fn __repr__(&self) -> String {
        let run = &self.runs[0];
        let (scenario, end_s, vehicles) = (&run.experiment.name, run.end_s, run.vehicles.len());
        format!("<city3d.Log of {scenario:?}: {end_s:.2} s, {vehicles} vehicles>")
    }
}

/// A column of numbers and how it is read from a sample.
type NumberColumn = (&'static str, fn(&TraceSample) -> f64);

const NUMBERS: [NumberColumn; 13] = [
    ("time_s", |sample| sample.time_s),
    ("x_m", |sample| sample.pose.position.x),
    ("y_m", |sample| sample.pose.position.y),
    ("heading_rad", |sample| sample.pose.yaw_rad),
    ("speed_mps", |sample| sample.speed_mps),
    ("acceleration_mps2", |sample| sample.acceleration_mps2),
    ("yaw_rate_radps", |sample| sample.yaw_rate_radps),
    ("steering_rad", |sample| sample.steering_rad),
    ("gas", |sample| sample.gas),
    ("brake", |sample| sample.brake),
    ("handbrake", |sample| sample.handbrake),
    ("distance_m", |sample| sample.distance_m),
    ("lateral_error_m", |sample| sample.lateral_error_m),
];

/// The samples of all vehicles as columns.
fn vehicles_of(run: &RunLog) -> Result<RecordBatch, arrow_schema::ArrowError> {
    let samples = || run.vehicles.iter().flat_map(|trace| trace.samples.iter());
    let ids = run.vehicles.iter().flat_map(|trace| trace.samples.iter().map(|_| trace.id.0));
    let names = run.vehicles.iter().flat_map(|trace| trace.samples.iter().map(|_| trace.name.as_str()));
    let ids: ArrayRef = Arc::new(UInt32Array::from_iter_values(ids));
    let names: ArrayRef = Arc::new(names.collect::<DictionaryArray<Int32Type>>());
    let numbers = |number: fn(&TraceSample) -> f64| -> ArrayRef { known(samples().map(number)) };
    let mut columns: Vec<(&str, ArrayRef, bool)> = vec![("id", ids, false), ("name", names, false)];
    columns.extend(NUMBERS.into_iter().map(|(name, number)| (name, numbers(number), true)));
    let lanes = run.vehicles.iter().flat_map(|trace| lanes_of(run, trace));
    columns.push(("lane", Arc::new(lanes.collect::<DictionaryArray<Int32Type>>()), true));
    let stations = run.vehicles.iter().flat_map(|trace| trace.track.stations_m.iter().copied());
    columns.push(("station_m", known(stations), true));
    RecordBatch::try_from_iter_with_nullable(columns)
}

/// Numbers, of which NaN is none.
fn known(numbers: impl Iterator<Item = f64>) -> ArrayRef {
    Arc::new(numbers.map(|number| Some(number).filter(|number| !number.is_nan())).collect::<Float64Array>())
}

/// The lane of each sample of a vehicle, where its front axle is on one.
fn lanes_of<'a>(run: &'a RunLog, trace: &'a Trace) -> impl Iterator<Item = Option<&'a str>> {
    trace.track.stations_m.iter().map(|station_m| {
        let after = trace.track.visits.partition_point(|visit| visit.start_m <= *station_m);
        let visit = after.checked_sub(1).filter(|_| station_m.is_finite())?;
        Some(run.experiment.city_map.lane(trace.track.visits[visit].lane).name.as_str())
    })
}

/// A figure of `city3d plot`. Notebooks show it.
#[pyclass(module = "city3d", frozen)]
#[derive(Debug)]
pub struct Figure {
    chart: Chart,
    size: FigureSize,
}

#[pymethods]
impl Figure {
    /// Base name of its files.
    #[getter]
    fn name(&self) -> &str {
        &self.chart.name
    }

    /// Its heading.
    #[getter]
    fn title(&self) -> &str {
        &self.chart.title
    }

    /// The figure as SVG.
    fn svg(&self) -> PyResult<String> {
        svg(&self.chart, self.size).map_err(|error| PyRuntimeError::new_err(error.to_string()))
    }

    /// The figure as PNG, 254 pixels to the inch.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = py.detach(|| png(&self.chart, self.size));
        let bytes = bytes.map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// The plotted data as CSV.
    fn csv(&self) -> PyResult<String> {
        let bytes = self.chart.table.to_csv()?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Writes SVG, PNG and CSV into a folder, under its name.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        py.detach(|| write(&self.chart, self.size, &folder))
            .map_err(|error| PyOSError::new_err(error.to_string()))
    }

    fn _repr_svg_(&self) -> PyResult<String> {
        self.svg()
    }

    fn __repr__(&self) -> String {
        format!("<city3d.Figure {:?}: {}>", self.chart.name, self.chart.title)
    }
}
