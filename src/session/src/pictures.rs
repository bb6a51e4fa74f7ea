//! The end of onboard pictures, drawn on a separate thread. The session hands over the latest snapshot through a slot
//! of size one and never waits: a newer job replaces the one that waits there, and is counted.

use super::end::{End, EndFailure, EndHealth};
use super::{Moment, MomentKind};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_render::{Image, Pictures, RenderError, RenderRequest, Renderer};
use city3d_sensors::{Camera, Lens, Mount, PictureKind, PictureKinds, View};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
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
pub struct CarriedCamera {
    /// The vehicle that carries it.
    pub vehicle: VehicleId,
    /// Where on the vehicle.
    pub mount: Mount,
    /// Projection and size of its pictures.
    pub lens: Lens,
    /// Simulated seconds from one picture to the next.
    pub every_s: f64,
    /// What its pictures show of each pixel.
    pub kind: PictureKind,
}

/// A finished picture.
#[derive(Debug)]
pub struct TakenPicture {
    /// Index of the camera.
    pub camera: usize,
    /// From where it was taken.
    pub view: View,
    /// When it was taken, by the clock of [`PictureStamps`].
    pub stamp_s: f64,
    /// The picture, of the kind of its camera alone.
    pub pictures: Pictures,
}

/// The clock of pictures: that of the poses beside them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PictureStamps {
    /// Seconds since 1970.
    #[default]
    Wall,
    /// Simulated time.
    Simulated,
}

/// Opens the renderer on the thread that draws; the number tells how many cameras there are.
pub type OpenRenderer = Box<dyn FnOnce(usize) -> Result<Renderer, RenderError> + Send>;

/// Why onboard pictures cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// No adapter can draw.
    #[error(transparent)]
    Renderer(#[from] RenderError),
    /// The operating system refuses a thread.
    #[error("no thread for onboard pictures can be started: {0}")]
    Thread(Box<dyn std::error::Error + Send + Sync>),
    /// A picture cannot be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Encode(#[from] image::ImageError),
    /// The thread that draws has panicked.
    #[error("the thread that draws has ended early")]
    Ended,
}

/// A picture as a JPEG file; the quality is 1 to 100.
///
/// # Errors
/// Where it is too large for the format.
pub fn jpeg(image: &Image, quality: u8) -> Result<Vec<u8>, PictureError> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality).encode(
        &image.rgb,
        image.width,
        image.height,
        ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}

fn no_thread(error: impl std::error::Error + Send + Sync + 'static) -> PictureError {
    PictureError::Thread(Box::new(error))
}

/// Is told the name of the adapter once it is open.
type Opened = Sender<Result<String, PictureError>>;

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
    /// Why the last job was not drawn.
    failure: Option<EndFailure>,
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

    fn fail(&self, error: PictureError) {
        self.slot().failure = Some(EndFailure::new(error));
    }

    /// Waits for a job, and leaves it there; `false` at the end.
    fn is_wanted(&self) -> bool {
        let mut slot = self.slot();
        while slot.job.is_none() && !slot.is_over {
            slot = self.wake.wait(slot).unwrap_or_else(PoisonError::into_inner);
        }
        !slot.is_over
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
pub struct PictureThread {
    shared: Arc<SharedSlot>,
    cameras: Arc<[CarriedCamera]>,
    /// Whether the picture of each camera has subscribers.
    wanted: Arc<[AtomicBool]>,
    stamps: PictureStamps,
    /// Simulated time of the next picture of each camera.
    due_s: Vec<f64>,
    shown_s: f64,
    /// The name of the adapter that draws; empty where it is opened later.
    pub adapter: String,
    thread: Option<JoinHandle<()>>,
}

/// Numbers of onboard pictures; they go on counting.
#[derive(Clone, Debug)]
pub struct PictureCounter(Arc<SharedSlot>);

impl PictureCounter {
    /// Pictures that were drawn.
    pub fn taken(&self) -> u64 {
        self.0.taken.load(Ordering::Relaxed)
    }

    /// Pictures that were due and were not drawn, because drawing fell behind or failed.
    pub fn dropped(&self) -> u64 {
        self.0.dropped.load(Ordering::Relaxed)
    }
}

impl PictureThread {
    /// Opens the renderer; `take` gets the pictures of an instant together.
    ///
    /// # Errors
    /// Where no adapter can draw.
    pub fn start(
        open: OpenRenderer,
        (cameras, stamps): (Vec<CarriedCamera>, PictureStamps),
        wanted: Arc<[AtomicBool]>,
        take: impl FnMut(Vec<TakenPicture>) + Send + 'static,
    ) -> Result<Self, PictureError> {
        let (opened, opening) = channel();
        let mut started = Self::spawn(open, (cameras, stamps), wanted, (take, Some(opened)))?;
        started.adapter = opening.recv().map_err(|_| PictureError::Ended)??;
        Ok(started)
    }

    /// Opens the renderer when the first picture is wanted, on the thread that draws; that no adapter can draw shows with
    /// [`End::health`] then.
    ///
    /// # Errors
    /// Where the operating system refuses a thread.
    pub fn start_when_wanted(
        open: OpenRenderer,
        cameras: (Vec<CarriedCamera>, PictureStamps),
        wanted: Arc<[AtomicBool]>,
        take: impl FnMut(Vec<TakenPicture>) + Send + 'static,
    ) -> Result<Self, PictureError> {
        Self::spawn(open, cameras, wanted, (take, None))
    }

    fn spawn(
        open: OpenRenderer,
        (cameras, stamps): (Vec<CarriedCamera>, PictureStamps),
        wanted: Arc<[AtomicBool]>,
        (take, opened): (impl FnMut(Vec<TakenPicture>) + Send + 'static, Option<Opened>),
    ) -> Result<Self, PictureError> {
        let (cameras, shared) = (Arc::<[CarriedCamera]>::from(cameras), Arc::new(SharedSlot::default()));
        let (inner, carried) = (Arc::clone(&shared), Arc::clone(&cameras));
        let work = move || {
            lower_priority();
            // Threads inherit the priority of their creator: the global pool must keep its own.
            let pool = rayon::ThreadPoolBuilder::new().thread_name(|_| "pictures".to_owned()).build();
            match (pool, opened) {
                (Ok(pool), opened) => pool.install(|| draw(open, &carried, &inner, take, opened.as_ref())),
                (Err(error), Some(opened)) => drop(opened.send(Err(no_thread(error)))),
                (Err(error), None) => inner.fail(no_thread(error)),
            }
        };
        let thread = std::thread::Builder::new().name("pictures".to_owned()).spawn(work);
        let thread = Some(thread.map_err(no_thread)?);
        let due_s = vec![0.0; cameras.len()];
        let adapter = String::new();
        Ok(Self { shared, cameras, wanted, stamps, due_s, shown_s: 0.0, adapter, thread })
    }

    /// Counts its pictures also when a session has taken it.
    pub fn counter(&self) -> PictureCounter {
        PictureCounter(Arc::clone(&self.shared))
    }

    /// The cameras that are due at a time.
    fn due(&mut self, snapshot: &FrameSnapshot) -> Vec<usize> {
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
        cameras
    }
}

impl End for PictureThread {
    fn name(&self) -> &'static str {
        "pictures"
    }

    fn take(&mut self, moment: &Moment<'_>) {
        if matches!(moment.kind, MomentKind::First | MomentKind::Still) {
            return;
        }
        let cameras = self.due(moment.snapshot);
        if cameras.is_empty() {
            return;
        }
        let stamp_s = match self.stamps {
            PictureStamps::Wall => moment.unix_s,
            PictureStamps::Simulated => moment.snapshot.time_s,
        };
        let job = DrawJob { snapshot: moment.snapshot.clone(), stamp_s, cameras };
        let before = self.shared.slot().job.replace(job);
        self.shared.wake.notify_one();
        let dropped = before.map_or(0, |before| before.cameras.len() as u64);
        self.shared.dropped.fetch_add(dropped, Ordering::Relaxed);
    }

    fn health(&self) -> EndHealth {
        let counter = self.counter();
        let has_ended = self.thread.as_ref().is_some_and(JoinHandle::is_finished);
        let failure = self.shared.slot().failure.clone();
        let failure = failure.or_else(|| has_ended.then(|| EndFailure::new(PictureError::Ended)));
        EndHealth { delivered: counter.taken(), dropped: counter.dropped(), failure }
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
pub fn lower_priority() {
    #[cfg(target_os = "linux")]
    {
        let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Idle);
        if let Err(error) = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Min, policy) {
            tracing::debug!("the drawing threads keep their normal priority: {error}");
        }
    }
}

fn draw(
    open: OpenRenderer,
    cameras: &[CarriedCamera],
    shared: &SharedSlot,
    mut take: impl FnMut(Vec<TakenPicture>),
    opened: Option<&Opened>,
) {
    if opened.is_none() && !shared.is_wanted() {
        return;
    }
    let mut renderer = match (open(cameras.len()), opened) {
        (Ok(renderer), _) => renderer,
        // The waiting caller reports it.
        (Err(error), Some(opened)) => return drop(opened.send(Err(PictureError::Renderer(error)))),
        (Err(error), None) => return shared.fail(PictureError::Renderer(error)),
    };
    if let Some(opened) = opened {
        drop(opened.send(Ok(renderer.context().adapter_name.clone())));
    }
    while let Some(job) = shared.wait() {
        match draw_job(&mut renderer, cameras, &job) {
            Ok(pictures) => {
                shared.slot().failure = None;
                shared.taken.fetch_add(pictures.len() as u64, Ordering::Relaxed);
                take(pictures);
            }
            Err(error) => {
                shared.slot().failure = Some(EndFailure::new(error));
                shared.dropped.fetch_add(job.cameras.len() as u64, Ordering::Relaxed);
            }
        }
    }
}

fn draw_job(
    renderer: &mut Renderer,
    cameras: &[CarriedCamera],
    job: &DrawJob,
) -> Result<Vec<TakenPicture>, RenderError> {
    let (mut requests, mut camera_indices) = (Vec::new(), Vec::new());
    for &k in &job.cameras {
        let camera = Camera::onboard(cameras[k].vehicle, cameras[k].mount);
        // A vehicle that has left since has no picture.
        if let Ok(view) = camera.view(&job.snapshot, &cameras[k].lens) {
            requests.push(RenderRequest { view, kinds: PictureKinds::NONE.with(cameras[k].kind) });
            camera_indices.push(k);
        }
    }
    let (mut drawn, mut rest) = (Vec::with_capacity(requests.len()), &requests[..]);
    while !rest.is_empty() {
        let (batch, after) = rest.split_at(renderer.max_batch_len(rest));
        drawn.extend(renderer.render_kinds(&job.snapshot, batch)?);
        rest = after;
    }
    let stamp_s = job.stamp_s;
    let taken = camera_indices.into_iter().zip(&requests).zip(drawn);
    let taken = taken.map(|((camera, request), pictures)| TakenPicture {
        camera,
        view: request.view,
        stamp_s,
        pictures,
    });
    Ok(taken.collect())
}
