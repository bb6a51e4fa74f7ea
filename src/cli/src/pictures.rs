//! Onboard pictures of a served city, drawn on a separate thread. The simulation hands over the latest snapshot
//! through a slot of size one and never waits: a newer job replaces the one that waits there, and is counted.

use super::Failure;
use super::look::{self, LookArgs};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_render::{Image, Renderer};
use city3d_sensors::{Camera, Lens, Mount, View};
use city3d_session::served::{PictureCounts, PictureEnd};
use city3d_simulation::scenario::Experiment;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
#[cfg(target_os = "linux")]
use thread_priority::{
    NormalThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy,
    thread_native_id,
};

/// A camera on a vehicle.
#[derive(Clone, Copy, Debug)]
pub(super) struct CarriedCamera {
    pub(super) vehicle: VehicleId,
    pub(super) mount: Mount,
    pub(super) lens: Lens,
    /// Simulated seconds from one picture to the next.
    pub(super) every_s: f64,
}

/// A finished picture.
#[derive(Debug)]
#[cfg_attr(not(feature = "ros"), allow(dead_code, reason = "only ROS publishes where it was taken"))]
pub(super) struct TakenPicture {
    /// Index of the camera.
    pub(super) camera: usize,
    pub(super) view: View,
    pub(super) stamp_s: f64,
    pub(super) image: Image,
}

/// A snapshot to draw, with the cameras that are due.
#[derive(Debug)]
struct DrawJob {
    snapshot: FrameSnapshot,
    stamp_s: f64,
    cameras: Vec<usize>,
}

#[derive(Debug, Default)]
struct JobSlot {
    job: Option<DrawJob>,
    is_over: bool,
}

#[derive(Debug, Default)]
struct SharedSlot {
    slot: Mutex<JobSlot>,
    wake: Condvar,
    taken: AtomicU64,
    dropped: AtomicU64,
}

impl SharedSlot {
    fn slot(&self) -> MutexGuard<'_, JobSlot> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for the next job; `None` at the end.
    fn wait(&self) -> Option<DrawJob> {
        let mut slot = self.slot();
        loop {
            if slot.is_over {
                return None;
            }
            if let Some(job) = slot.job.take() {
                return Some(job);
            }
            slot = self.wake.wait(slot).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Handle of the drawing thread. Dropping it ends the thread.
#[derive(Debug)]
pub(super) struct PictureThread {
    shared: Arc<SharedSlot>,
    cameras: Arc<[CarriedCamera]>,
    /// Whether the picture of each camera has subscribers.
    wanted: Arc<[AtomicBool]>,
    /// Simulated time of the next picture of each camera.
    due_s: Vec<f64>,
    shown_s: f64,
    /// The name of the adapter that draws.
    pub(super) adapter: String,
    thread: Option<JoinHandle<()>>,
}

impl PictureThread {
    /// Opens the renderer; `take` gets the pictures of an instant together.
    ///
    /// # Errors
    /// Where no adapter can draw.
    pub(super) fn start(
        experiment: &Arc<Experiment>,
        look: LookArgs,
        cameras: Vec<CarriedCamera>,
        wanted: Arc<[AtomicBool]>,
        take: impl FnMut(Vec<TakenPicture>) + Send + 'static,
    ) -> Result<Self, Failure> {
        let (cameras, shared) = (Arc::<[CarriedCamera]>::from(cameras), Arc::new(SharedSlot::default()));
        let (opened, opening) = channel();
        let (experiment, inner, carried) =
            (Arc::clone(experiment), Arc::clone(&shared), Arc::clone(&cameras));
        let work = move || {
            lower_priority();
            // Threads inherit the priority of their creator: the global pool must keep its own.
            match rayon::ThreadPoolBuilder::new().thread_name(|_| "pictures".to_owned()).build() {
                Ok(pool) => pool.install(|| draw(&experiment, &look, &carried, &inner, take, &opened)),
                Err(error) => drop(opened.send(Err(Failure::failed(error)))),
            }
        };
        let thread = std::thread::Builder::new().name("pictures".to_owned()).spawn(work);
        let thread = Some(thread.map_err(Failure::failed)?);
        let adapter = opening.recv().map_err(Failure::failed)??;
        let due_s = vec![0.0; cameras.len()];
        Ok(Self { shared, cameras, wanted, due_s, shown_s: 0.0, adapter, thread })
    }
}

impl PictureEnd for PictureThread {
    /// Submits the present snapshot without blocking.
    fn show(&mut self, snapshot: &FrameSnapshot, stamp_s: f64) {
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
                // Keeps the period; skips periods that were missed.
                let next_s = *due_s + camera.every_s;
                *due_s = if next_s > time_s { next_s } else { time_s + camera.every_s };
                cameras.push(k);
            }
        }
        if cameras.is_empty() {
            return;
        }
        let job = DrawJob { snapshot: snapshot.clone(), stamp_s, cameras };
        let before = self.shared.slot().job.replace(job);
        self.shared.wake.notify_one();
        let dropped = before.map_or(0, |before| before.cameras.len() as u64);
        self.shared.dropped.fetch_add(dropped, Ordering::Relaxed);
    }

    fn counts(&self) -> PictureCounts {
        let of = |count: &AtomicU64| count.load(Ordering::Relaxed);
        PictureCounts { taken: of(&self.shared.taken), published: 0, dropped: of(&self.shared.dropped) }
    }
}

impl Drop for PictureThread {
    fn drop(&mut self) {
        self.shared.slot().is_over = true;
        self.shared.wake.notify_one();
        if let Some(thread) = self.thread.take() {
            // It has nothing to say.
            let _ = thread.join();
        }
    }
}

/// Moves the thread to the idle scheduling class (`SCHED_IDLE`). A merely nice thread is not preempted at once on
/// Linux, which would delay ticks and the control framework on the same machine.
fn lower_priority() {
    #[cfg(target_os = "linux")]
    {
        let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Idle);
        if let Err(error) = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Min, policy) {
            tracing::debug!("the drawing threads keep their normal priority: {error}");
        }
    }
}

fn draw(
    experiment: &Experiment,
    look: &LookArgs,
    cameras: &[CarriedCamera],
    shared: &SharedSlot,
    mut take: impl FnMut(Vec<TakenPicture>),
    opened: &Sender<Result<String, Failure>>,
) {
    let pictures = if cameras.len() > 1 { look::PictureCount::Many } else { look::PictureCount::Few };
    let mut renderer = match look::open(look, experiment, (look::QualityArg::Low, pictures)) {
        Ok(renderer) => renderer,
        // The waiting caller reports it.
        Err(failure) => return drop(opened.send(Err(failure))),
    };
    drop(opened.send(Ok(renderer.context().adapter_name.clone())));
    while let Some(job) = shared.wait() {
        match draw_job(&mut renderer, cameras, &job) {
            Ok(pictures) => {
                shared.taken.fetch_add(pictures.len() as u64, Ordering::Relaxed);
                take(pictures);
            }
            Err(failure) => {
                shared.dropped.fetch_add(job.cameras.len() as u64, Ordering::Relaxed);
                tracing::warn!("no onboard pictures at {} s: {}", job.snapshot.time_s, failure.message);
            }
        }
    }
}

fn draw_job(
    renderer: &mut Renderer,
    cameras: &[CarriedCamera],
    job: &DrawJob,
) -> Result<Vec<TakenPicture>, Failure> {
    let (mut views, mut camera_indices) = (Vec::new(), Vec::new());
    for &k in &job.cameras {
        let camera = Camera::onboard(cameras[k].vehicle, cameras[k].mount);
        views.push(camera.view(&job.snapshot, &cameras[k].lens).map_err(Failure::failed)?);
        camera_indices.push(k);
    }
    let mut images = Vec::with_capacity(views.len());
    for batch in renderer.batches(&views) {
        images.extend(renderer.render(&job.snapshot, &batch).map_err(look::failure)?);
    }
    let taken = camera_indices.into_iter().zip(views).zip(images);
    let stamp_s = job.stamp_s;
    Ok(taken.map(|((camera, view), image)| TakenPicture { camera, view, stamp_s, image }).collect())
}
