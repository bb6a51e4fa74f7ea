//! Onboard pictures of a city that is served, drawn on a thread of its own from the latest instant. The simulation
//! hands instants over and never waits: what the thread does not keep up with is dropped and counted.

use super::Failure;
use super::look::{self, LookArgs, in_batches};
use crate::camera::{Camera, Lens, Mount, View};
use crate::render::{Image, Renderer};
use crate::scenario::Experiment;
use crate::sensor::{CameraSensor, SensorKind};
use crate::snapshot::{FrameSnapshot, VehicleId};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
#[cfg(target_os = "linux")]
use thread_priority::{
    NormalThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};

/// Where a scenario gives no vehicle a camera: so many pictures a second behind each windscreen.
const USUAL_HZ: f64 = 10.0;
const USUAL_NAME: &str = "windscreen";

/// A camera that a vehicle carries.
#[derive(Clone, Debug)]
pub(super) struct Onboard {
    pub(super) vehicle: VehicleId,
    /// Name of the vehicle.
    pub(super) owner: String,
    pub(super) name: String,
    pub(super) mount: Mount,
    pub(super) lens: Lens,
    /// Simulated seconds from one picture to the next.
    pub(super) every_s: f64,
}

/// The cameras that a scenario gives its vehicles, or one behind each windscreen where it gives none.
pub(super) fn onboard(experiment: &Experiment, extent: Option<[u32; 2]>) -> Vec<Onboard> {
    let sized = |lens: Lens| Lens { extent: extent.unwrap_or(lens.extent), ..lens };
    let mut cameras: Vec<Onboard> = Vec::new();
    for planned in &experiment.vehicles {
        cameras.extend(planned.sensors.iter().map(|sensor| {
            let SensorKind::Camera(CameraSensor { mount, lens, .. }) = sensor.kind;
            Onboard {
                vehicle: planned.id,
                owner: planned.name.clone(),
                name: sensor.name.clone(),
                mount,
                lens: sized(lens),
                every_s: 1.0 / sensor.rate_hz,
            }
        }));
    }
    if cameras.is_empty() {
        cameras.extend(experiment.vehicles.iter().map(|planned| Onboard {
            vehicle: planned.id,
            owner: planned.name.clone(),
            name: USUAL_NAME.to_owned(),
            mount: Mount::Windscreen,
            lens: sized(Lens::default()),
            every_s: 1.0 / USUAL_HZ,
        }));
    }
    cameras
}

/// A picture that has been taken.
#[derive(Debug)]
pub(super) struct Taken {
    /// Which of the cameras has taken it.
    pub(super) camera: usize,
    pub(super) view: View,
    pub(super) stamp_s: f64,
    pub(super) image: Image,
}

/// What is to be drawn next.
#[derive(Debug)]
struct Order {
    snapshot: FrameSnapshot,
    stamp_s: f64,
    cameras: Vec<usize>,
}

#[derive(Debug, Default)]
struct Desk {
    order: Option<Order>,
    is_over: bool,
}

#[derive(Debug, Default)]
struct Shared {
    desk: Mutex<Desk>,
    has_news: Condvar,
    taken: AtomicU64,
    dropped: AtomicU64,
}

impl Shared {
    fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next order, once there is one; `None` when there will be no more.
    fn wait(&self) -> Option<Order> {
        let mut desk = self.desk();
        loop {
            if desk.is_over {
                return None;
            }
            if let Some(order) = desk.order.take() {
                return Some(order);
            }
            desk = self.has_news.wait(desk).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// The thread that draws. Dropped, it ends it.
#[derive(Debug)]
pub(super) struct Pictures {
    shared: Arc<Shared>,
    cameras: Arc<[Onboard]>,
    /// Whose pictures anybody wants.
    wanted: Arc<[AtomicBool]>,
    /// Simulated time of the next picture of each.
    due_s: Vec<f64>,
    shown_s: f64,
    /// The name of the adapter that draws.
    pub(super) adapter: String,
    thread: Option<JoinHandle<()>>,
}

impl Pictures {
    /// Opens the renderer; pictures go to `take`, those of an instant together.
    ///
    /// # Errors
    /// Where there is nothing that draws.
    pub(super) fn start(
        experiment: &Arc<Experiment>,
        look: LookArgs,
        cameras: Vec<Onboard>,
        wanted: Arc<[AtomicBool]>,
        take: impl FnMut(Vec<Taken>) + Send + 'static,
    ) -> Result<Self, Failure> {
        let (cameras, shared) = (Arc::<[Onboard]>::from(cameras), Arc::new(Shared::default()));
        let (opened, opening) = channel();
        let (experiment, inner, worn) = (Arc::clone(experiment), Arc::clone(&shared), Arc::clone(&cameras));
        let work = move || {
            be_patient();
            // Threads are as urgent as the one that has made them: those of the usual pool are not for this.
            match rayon::ThreadPoolBuilder::new().thread_name(|_| "pictures".to_owned()).build() {
                Ok(pool) => pool.install(|| draw(&experiment, &look, &worn, &inner, take, &opened)),
                Err(error) => drop(opened.send(Err(Failure::failed(error)))),
            }
        };
        let thread = std::thread::Builder::new().name("pictures".to_owned()).spawn(work);
        let thread = Some(thread.map_err(Failure::failed)?);
        let adapter = opening.recv().map_err(Failure::failed)??;
        let due_s = vec![0.0; cameras.len()];
        Ok(Self { shared, cameras, wanted, due_s, shown_s: 0.0, adapter, thread })
    }

    /// Tells what the city looks like now, and never waits.
    pub(super) fn show(&mut self, snapshot: &FrameSnapshot, stamp_s: f64) {
        let time_s = snapshot.time_s;
        if time_s < self.shown_s {
            self.due_s.fill(time_s);
        }
        self.shown_s = time_s;
        let mut cameras = Vec::new();
        for (k, (camera, due_s)) in self.cameras.iter().zip(&mut self.due_s).enumerate() {
            let is_wanted =
                self.wanted[k].load(Ordering::Relaxed) && snapshot.vehicle(camera.vehicle).is_some();
            // Half a microsecond is less than any tick.
            if is_wanted && time_s + 5e-7 >= *due_s {
                // The beat is kept, unless it was lost.
                let next_s = *due_s + camera.every_s;
                *due_s = if next_s > time_s { next_s } else { time_s + camera.every_s };
                cameras.push(k);
            }
        }
        if cameras.is_empty() {
            return;
        }
        let order = Order { snapshot: snapshot.clone(), stamp_s, cameras };
        let before = self.shared.desk().order.replace(order);
        self.shared.has_news.notify_one();
        let dropped = before.map_or(0, |before| before.cameras.len() as u64);
        self.shared.dropped.fetch_add(dropped, Ordering::Relaxed);
    }

    /// How many have been taken, and how many not because drawing fell behind.
    pub(super) fn figures(&self) -> (u64, u64) {
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        (of(&self.shared.taken), of(&self.shared.dropped))
    }
}

impl Drop for Pictures {
    fn drop(&mut self) {
        self.shared.desk().is_over = true;
        self.shared.has_news.notify_one();
        if let Some(thread) = self.thread.take() {
            // It has nothing to say.
            let _ = thread.join();
        }
    }
}

/// Lets everybody else go first: drawing takes the time that nobody else wants. Who is merely less urgent (`nice`) is
/// not interrupted at once on Linux, which a tick and the control framework on the same machine would notice.
fn be_patient() {
    #[cfg(target_os = "linux")]
    {
        let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Idle);
        if let Err(error) = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Min, policy) {
            tracing::debug!("drawing is as urgent as the simulation: {error}");
        }
    }
}

fn draw(
    experiment: &Experiment,
    look: &LookArgs,
    cameras: &[Onboard],
    shared: &Shared,
    mut take: impl FnMut(Vec<Taken>),
    opened: &Sender<Result<String, Failure>>,
) {
    let pictures = if cameras.len() > 1 { look::Pictures::Many } else { look::Pictures::Few };
    let mut renderer = match look::open(look, experiment, (look::Quality::Low, pictures)) {
        Ok(renderer) => renderer,
        // Who waits for it tells why.
        Err(failure) => return drop(opened.send(Err(failure))),
    };
    drop(opened.send(Ok(renderer.context().adapter_name.clone())));
    while let Some(order) = shared.wait() {
        match draw_order(&mut renderer, cameras, &order) {
            Ok(pictures) => {
                shared.taken.fetch_add(pictures.len() as u64, Ordering::Relaxed);
                take(pictures);
            }
            Err(failure) => {
                shared.dropped.fetch_add(order.cameras.len() as u64, Ordering::Relaxed);
                tracing::warn!("no onboard pictures at {} s: {}", order.snapshot.time_s, failure.message);
            }
        }
    }
}

fn draw_order(renderer: &mut Renderer, cameras: &[Onboard], order: &Order) -> Result<Vec<Taken>, Failure> {
    let (mut views, mut takers) = (Vec::new(), Vec::new());
    for &k in &order.cameras {
        let camera = Camera::onboard(cameras[k].vehicle, cameras[k].mount);
        views.push(camera.view(&order.snapshot, &cameras[k].lens).map_err(Failure::failed)?);
        takers.push(k);
    }
    let mut images = Vec::with_capacity(views.len());
    for batch in in_batches(renderer, &views) {
        images.extend(renderer.render(&order.snapshot, &batch).map_err(look::failure)?);
    }
    let taken = takers.into_iter().zip(views).zip(images);
    let stamp_s = order.stamp_s;
    Ok(taken.map(|((camera, view), image)| Taken { camera, view, stamp_s, image }).collect())
}
