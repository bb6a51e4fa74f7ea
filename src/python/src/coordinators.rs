//! Classes of Python as coordination algorithms of control zones.

use crate::trouble::Trouble;
use city3d_control::coordination::{Coordinator, Coordinators, Grant, MotionPlan, ZoneView as ControlView};
use city3d_protocol::snapshot::VehicleId;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

/// Coordination algorithms of one world by name. Each class makes one object for all zones.
#[derive(Clone, Debug)]
pub struct PythonCoordinators {
    by_name: BTreeMap<String, Arc<Py<PyAny>>>,
    trouble: Trouble,
}

impl PythonCoordinators {
    pub fn new(by_name: BTreeMap<String, Py<PyAny>>) -> Self {
        let by_name = by_name.into_iter().map(|(name, make)| (name, Arc::new(make))).collect();
        Self { by_name, trouble: Trouble::default() }
    }

    /// These algorithms beside others.
    pub fn beside(&self, others: Coordinators) -> Coordinators {
        self.by_name.iter().fold(others, |coordinators, (name, make)| {
            let (make, trouble) = (Arc::clone(make), self.trouble.clone());
            coordinators.with(name, move || {
                let made = Python::attach(|py| {
                    let object = make.call0(py)?;
                    let has_due = object.bind(py).hasattr("is_due")?;
                    Ok((object, has_due))
                });
                let made = made.map_err(|error| trouble.keep(error)).ok();
                let has_due = made.as_ref().is_some_and(|(_, has_due)| *has_due);
                let object = made.map(|(object, _)| Arc::new(object));
                Box::new(PythonCoordinator { object, has_due, trouble: trouble.clone() })
            })
        })
    }

    /// Raises what one of them has raised since the last call.
    ///
    /// # Errors
    /// That exception.
    pub fn raise(&self) -> PyResult<()> {
        self.trouble.raise()
    }
}

/// An object with a method `schedule(view)`, and perhaps `is_due(now_s)`.
#[derive(Debug)]
struct PythonCoordinator {
    object: Option<Arc<Py<PyAny>>>,
    has_due: bool,
    trouble: Trouble,
}

impl Coordinator for PythonCoordinator {
    /// The object gets a view whose questions this thread answers, while another one runs the method: what is behind the view is
    /// borrowed for the call, and no object of Python may keep it.
    fn schedule(&mut self, view: &mut ControlView<'_>) {
        let Some(object) = self.object.clone() else { return };
        let (ask, asked) = sync_channel(0);
        let (answer, answered) = sync_channel(0);
        let line = Arc::new(Mutex::new(Some(Line { ask, answered })));
        let seen = ZoneView::of(view, Arc::clone(&line));
        let trouble = self.trouble.clone();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                let called = Python::attach(|py| object.call_method1(py, "schedule", (seen,)).map(drop));
                called.unwrap_or_else(|error| trouble.keep(error));
                // A view that somebody has kept is over.
                line.lock().unwrap_or_else(PoisonError::into_inner).take();
            });
            let mut revoked = BTreeSet::new();
            while let Ok(question) = asked.recv() {
                if answer.send(reply(view, &mut revoked, question)).is_err() {
                    break;
                }
            }
        });
    }

    fn is_due(&self, now_s: f64) -> bool {
        let Some(object) = self.object.as_ref().filter(|_| self.has_due) else { return false };
        let due = Python::attach(|py| object.call_method1(py, "is_due", (now_s,))?.is_truthy(py));
        due.unwrap_or_else(|error| {
            self.trouble.keep(error);
            false
        })
    }
}

/// What a method asks of the control zone.
#[derive(Debug)]
enum Question {
    Grant(VehicleId, Grant),
    Revoke(VehicleId),
    Restore(VehicleId, MotionPlan),
    Replannable,
    Requests,
}

#[derive(Debug)]
enum Answer {
    /// `None` where no plan keeps bounds and gaps, or where there was none.
    Plan(Option<Plan>),
    Vehicles(Vec<u32>),
    Requests(Vec<Request>),
    Done,
    Unknown,
}

/// The way to the thread that has the control zone.
#[derive(Debug)]
struct Line {
    ask: SyncSender<Question>,
    answered: Receiver<Answer>,
}

/// Answers a question; `revoked` has the vehicles whose plans were taken back in this call.
fn reply(view: &mut ControlView<'_>, revoked: &mut BTreeSet<VehicleId>, question: Question) -> Answer {
    let index_of =
        |view: &ControlView<'_>, id: VehicleId| view.vehicles().binary_search_by_key(&id, |cav| cav.id).ok();
    match question {
        Question::Grant(id, grant) => {
            let index = view
                .requests()
                .iter()
                .map(|request| request.vehicle)
                .find(|index| view.vehicles()[*index].id == id);
            let Some(index) = index else { return Answer::Unknown };
            let plan = view.grant(index, grant).ok().cloned();
            Answer::Plan(plan.map(|plan| Plan::of(view, index, plan)))
        }
        Question::Revoke(id) => {
            let Some(index) = index_of(view, id).filter(|index| view.replannable().contains(index)) else {
                return Answer::Unknown;
            };
            // Its way through the zone is known while it has the plan.
            let plan = view.revoke(index);
            revoked.insert(id);
            Answer::Plan(plan.map(|plan| Plan::of(view, index, plan)))
        }
        Question::Restore(id, plan) => {
            let Some(index) = index_of(view, id).filter(|_| revoked.remove(&id)) else {
                return Answer::Unknown;
            };
            view.restore(index, plan);
            Answer::Done
        }
        Question::Replannable => {
            let vehicles = view.replannable();
            Answer::Vehicles(vehicles.into_iter().map(|index| view.vehicles()[index].id.0).collect())
        }
        Question::Requests => Answer::Requests(requests_of(view)),
    }
}

fn requests_of(view: &ControlView<'_>) -> Vec<Request> {
    let request = |request: &city3d_control::coordination::CoordinationRequest| {
        let cav = &view.vehicles()[request.vehicle];
        let passage = cav.coordination.passage();
        Request {
            vehicle: cav.id.0,
            entered_s: request.entered_s,
            earliest_s: request.earliest_s,
            rank: view.rank(request.vehicle),
            speed_mps: cav.speed_mps(),
            distance_m: passage.map_or(f64::NAN, |way| way.from_s - cav.front_s()),
        }
    };
    view.requests().iter().map(request).collect()
}

/// A vehicle that asks for a plan. Laboratory metres; times are simulated seconds.
#[pyclass(module = "city3d", frozen, get_all, from_py_object)]
#[derive(Clone, Debug)]
pub struct Request {
    /// Its id.
    vehicle: u32,
    /// When it entered the control zone.
    entered_s: f64,
    /// When its front can be at its first conflict at the soonest.
    earliest_s: f64,
    /// Priority by the rules of the road: 0 on the major road and in a roundabout.
    rank: u8,
    /// Its speed.
    speed_mps: f64,
    /// From its front bumper to its first conflict.
    distance_m: f64,
}

#[pymethods]
impl Request {
    fn __repr__(&self) -> String {
        let Self { vehicle, entered_s, earliest_s, .. } = self;
        format!("city3d.Request(vehicle={vehicle}, entered_s={entered_s:.2}, earliest_s={earliest_s:.2})")
    }
}

/// The plan of a vehicle through a control zone; times are simulated seconds.
#[pyclass(module = "city3d", frozen)]
#[derive(Clone, Debug)]
pub struct Plan {
    plan: MotionPlan,
    /// Its vehicle's id.
    #[pyo3(get)]
    vehicle: u32,
    /// When its front enters the first conflict.
    #[pyo3(get)]
    entry_s: f64,
    /// When its rear has left the last conflict.
    #[pyo3(get)]
    exit_s: f64,
    /// Half of the integral of the squared acceleration, laboratory m2/s3.
    #[pyo3(get)]
    cost: f64,
}

impl Plan {
    fn of(view: &ControlView<'_>, index: usize, plan: MotionPlan) -> Self {
        let cav = &view.vehicles()[index];
        let from_m = cav.coordination.passage().map(|way| cav.body.axle_of_front(way.from_s));
        Self {
            vehicle: cav.id.0,
            entry_s: from_m.map_or(f64::NAN, |from_m| plan.time_at(from_m)),
            exit_s: plan.end().time_s,
            cost: plan.cost(),
            plan,
        }
    }
}

#[pymethods]
impl Plan {
    fn __repr__(&self) -> String {
        let Self { vehicle, entry_s, exit_s, .. } = self;
        format!("city3d.Plan(vehicle={vehicle}, entry_s={entry_s:.2}, exit_s={exit_s:.2})")
    }
}

/// A control zone as a coordination algorithm sees it, during one call of `schedule`.
#[pyclass(module = "city3d", frozen)]
#[derive(Debug)]
pub struct ZoneView {
    /// Time of the control step, simulated seconds.
    #[pyo3(get)]
    now_s: f64,
    /// Index of the zone.
    #[pyo3(get)]
    zone: usize,
    line: Arc<Mutex<Option<Line>>>,
}

impl ZoneView {
    fn of(view: &ControlView<'_>, line: Arc<Mutex<Option<Line>>>) -> Self {
        Self { now_s: view.now_s(), zone: view.zone(), line }
    }

    fn ask(&self, py: Python<'_>, question: Question) -> PyResult<Answer> {
        let answer = py.detach(|| {
            let line = self.line.lock().unwrap_or_else(PoisonError::into_inner);
            let line = line.as_ref()?;
            line.ask.send(question).ok()?;
            line.answered.recv().ok()
        });
        answer
            .ok_or_else(|| PyRuntimeError::new_err("the view is over: it holds during the call of schedule"))
    }
}

#[pymethods]
impl ZoneView {
    /// The vehicles that ask for a plan, in id order.
    #[getter]
    fn requests(&self, py: Python<'_>) -> PyResult<Vec<Request>> {
        match self.ask(py, Question::Requests)? {
            Answer::Requests(requests) => Ok(requests),
            _ => Ok(Vec::new()),
        }
    }

    /// Plans a vehicle that asks, and keeps the plan: it enters its first conflict no sooner than `not_before_s`, and with
    /// `fills_gaps` perhaps before others that have entered the zone earlier. `None` where no plan keeps bounds and gaps: the
    /// vehicle drives by the rules of the road and asks again.
    #[pyo3(signature = (vehicle, *, not_before_s = None, fills_gaps = true))]
    fn grant(
        &self,
        py: Python<'_>,
        vehicle: u32,
        not_before_s: Option<f64>,
        fills_gaps: bool,
    ) -> PyResult<Option<Plan>> {
        let not_before_s = not_before_s.unwrap_or(f64::NEG_INFINITY);
        if not_before_s.is_nan() {
            return Err(PyValueError::new_err("not_before_s is NaN; simulated seconds are needed"));
        }
        match self.ask(py, Question::Grant(VehicleId(vehicle), Grant { not_before_s, fills_gaps }))? {
            Answer::Plan(plan) => Ok(plan),
            _ => Err(PyValueError::new_err(format!("vehicle {vehicle} asks for no plan here"))),
        }
    }

    /// Ids of the vehicles with plans that may still change: they are not admitted to the junction.
    fn replannable(&self, py: Python<'_>) -> PyResult<Vec<u32>> {
        match self.ask(py, Question::Replannable)? {
            Answer::Vehicles(vehicles) => Ok(vehicles),
            _ => Ok(Vec::new()),
        }
    }

    /// Takes back the plan of a vehicle of `replannable`, which then asks for another one.
    fn revoke(&self, py: Python<'_>, vehicle: u32) -> PyResult<Plan> {
        match self.ask(py, Question::Revoke(VehicleId(vehicle)))? {
            Answer::Plan(Some(plan)) => Ok(plan),
            _ => Err(PyValueError::new_err(format!("vehicle {vehicle} has no plan here that may change"))),
        }
    }

    /// Gives back a plan that was revoked in this call.
    fn restore(&self, py: Python<'_>, plan: &Plan) -> PyResult<()> {
        match self.ask(py, Question::Restore(VehicleId(plan.vehicle), plan.plan.clone()))? {
            Answer::Done => Ok(()),
            _ => Err(PyValueError::new_err(format!(
                "no plan of vehicle {} was revoked in this call",
                plan.vehicle
            ))),
        }
    }
}
