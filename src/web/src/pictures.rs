//! Camera pictures for the pages, drawn on a thread in the idle scheduling class. Pages that look alike share a picture;
//! a picture is drawn only when a page that looks at it has shown the last one, so that slow pages get fewer.

use crate::message::PageView;
use city3d_protocol::snapshot::VehicleId;
use city3d_render::{Image, Renderer};
use city3d_sensors::{Camera, Lens, Mount, View};
use city3d_session::pictures::{OpenRenderer, jpeg, lower_priority};
use city3d_session::{PublishedState, RunState};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tokio_tungstenite::tungstenite::Bytes;

/// Opens the renderer, on the thread that draws.
pub type PictureDrawer = OpenRenderer;

/// Different views that are drawn at once, at most.
const MAX_VIEWS: usize = 32;
/// Least time between two pictures of all views.
const DRAW_INTERVAL: Duration = Duration::from_millis(33);
/// A city that stands is looked at again after this time.
const STILL_WAIT: Duration = Duration::from_millis(20);
const JPEG_QUALITY: u8 = 80;
/// Sizes are multiples of this, so that pages of about the same size share pictures.
const SIZE_STEP: u32 = 32;
const SMALLEST: u32 = 96;
const LARGEST: [u32; 2] = [1280, 960];
/// The picture that nobody sees.
const WARM_UP: ViewKey = (PageView::Overhead { x_m: 0, y_m: 0, height_m: 100 }, [SMALLEST; 2]);

/// What is drawn: a camera, and the size of its picture.
type ViewKey = (PageView, [u32; 2]);

/// A state of the city: run and tick.
type StateNumber = (u32, u64);

/// A view that is wanted, and the state of its last picture.
type WantedView = (ViewKey, Option<StateNumber>);

/// A picture and its number, which counts those of its view.
#[derive(Clone, Debug, Default)]
struct Shown {
    number: u64,
    jpeg: Bytes,
}

#[derive(Debug)]
struct SharedView {
    lookers: usize,
    /// A page has shown the last picture, and wants another.
    is_wanted: bool,
    /// State of the last picture: the same one is not drawn twice.
    drawn: Option<StateNumber>,
    latest: watch::Sender<Shown>,
}

#[derive(Debug, Default)]
struct Desk {
    views: BTreeMap<ViewKey, SharedView>,
    is_drawn: bool,
    failure: Option<String>,
    is_over: bool,
}

#[derive(Debug, Default)]
struct SharedDesk {
    desk: Mutex<Desk>,
    wake: Condvar,
}

impl SharedDesk {
    fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for views that are wanted; `None` at the end.
    fn wait(&self) -> Option<Vec<WantedView>> {
        let mut desk = self.desk();
        loop {
            if desk.is_over {
                return None;
            }
            let wanted = desk.views.iter().filter(|(_, view)| view.is_wanted);
            let wanted: Vec<_> = wanted.map(|(key, view)| (*key, view.drawn)).collect();
            if !wanted.is_empty() {
                return Some(wanted);
            }
            desk = self.wake.wait(desk).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Hands on a picture, if somebody still looks.
    fn show(&self, key: &ViewKey, state: StateNumber, jpeg: Vec<u8>) {
        if let Some(view) = self.desk().views.get_mut(key) {
            (view.is_wanted, view.drawn) = (false, Some(state));
            view.latest.send_modify(|shown| {
                *shown = Shown { number: shown.number + 1, jpeg: jpeg.into() };
            });
        }
    }
}

/// The pictures of all pages.
#[derive(Debug)]
pub(crate) struct Pictures {
    shared: Arc<SharedDesk>,
    state: Arc<OnceLock<PublishedState>>,
}

impl Pictures {
    pub(crate) fn new(state: Arc<OnceLock<PublishedState>>) -> Self {
        Self { shared: Arc::default(), state }
    }

    /// Opens the renderer and draws, on a thread of its own.
    pub(crate) fn start(&self, open: PictureDrawer) {
        let (shared, state) = (Arc::clone(&self.shared), Arc::clone(&self.state));
        shared.desk().is_drawn = true;
        let work = move || {
            lower_priority();
            // Threads inherit the priority of their creator: the global pool must keep its own.
            let pool = rayon::ThreadPoolBuilder::new().thread_name(|_| "web pictures".to_owned()).build();
            let outcome = match pool {
                Ok(pool) => pool.install(|| draw(open, &shared, &state)),
                Err(error) => Err(error.to_string()),
            };
            if let Err(why) = outcome {
                tracing::warn!("the web page has no pictures: {why}");
                let mut desk = shared.desk();
                (desk.is_drawn, desk.failure) = (false, Some(why));
                desk.views.clear();
            }
        };
        let thread = std::thread::Builder::new().name("web pictures".to_owned()).spawn(work);
        if let Err(error) = thread {
            let mut desk = self.shared.desk();
            (desk.is_drawn, desk.failure) = (false, Some(error.to_string()));
        }
    }

    /// Ends the thread after the picture that it draws.
    pub(crate) fn stop(&self) {
        self.shared.desk().is_over = true;
        self.shared.wake.notify_one();
    }

    pub(crate) fn are_drawn(&self) -> bool {
        self.shared.desk().is_drawn
    }

    pub(crate) fn failure(&self) -> Option<String> {
        self.shared.desk().failure.clone()
    }

    /// Looks at a view; `None` where too many are looked at, or nothing is drawn.
    pub(crate) fn look(&self, view: PageView, extent: [u32; 2]) -> Option<Look> {
        let [width, height] = [0, 1].map(|k| {
            let size: u32 = extent[k].clamp(SMALLEST, LARGEST[k]);
            size.next_multiple_of(SIZE_STEP).min(LARGEST[k])
        });
        let key = (view, [width, height]);
        let mut desk = self.shared.desk();
        if !desk.is_drawn || (!desk.views.contains_key(&key) && desk.views.len() >= MAX_VIEWS) {
            return None;
        }
        let view = desk.views.entry(key).or_insert_with(|| SharedView {
            lookers: 0,
            is_wanted: true,
            drawn: None,
            latest: watch::Sender::new(Shown::default()),
        });
        view.lookers += 1;
        let mut pictures = view.latest.subscribe();
        let number = pictures.borrow().number;
        if number > 0 {
            // Somebody else looks already: its picture comes at once.
            pictures.mark_changed();
        }
        self.shared.wake.notify_one();
        let shared = Arc::clone(&self.shared);
        Some(Look { key, shared, pictures, number: number.saturating_sub(1), is_waiting: false })
    }
}

/// What one page looks at.
#[derive(Debug)]
pub(crate) struct Look {
    key: ViewKey,
    shared: Arc<SharedDesk>,
    pictures: watch::Receiver<Shown>,
    /// The last picture that was sent.
    number: u64,
    /// The page has not shown it yet.
    is_waiting: bool,
}

impl Look {
    /// The page has shown the picture that was sent last.
    pub(crate) fn seen(&mut self) {
        self.is_waiting = false;
        let mut desk = self.shared.desk();
        if let Some(view) = desk.views.get_mut(&self.key) {
            view.is_wanted = true;
            drop(desk);
            self.shared.wake.notify_one();
        }
    }

    /// Waits for a picture to send, with the number of those in between that the page has missed; `None` where there
    /// will be none.
    pub(crate) async fn next(&mut self) -> Option<(Bytes, u64)> {
        if self.is_waiting {
            std::future::pending::<()>().await;
        }
        self.pictures.changed().await.ok()?;
        let Shown { number, jpeg } = self.pictures.borrow_and_update().clone();
        let skipped = (number - self.number).saturating_sub(1);
        (self.number, self.is_waiting) = (number, true);
        Some((jpeg, skipped))
    }
}

impl Drop for Look {
    fn drop(&mut self) {
        let mut desk = self.shared.desk();
        if let Some(view) = desk.views.get_mut(&self.key) {
            view.lookers -= 1;
            if view.lookers == 0 {
                desk.views.remove(&self.key);
            }
        }
    }
}

fn draw(open: PictureDrawer, shared: &SharedDesk, state: &OnceLock<PublishedState>) -> Result<(), String> {
    let mut renderer = open(1).map_err(|error| error.to_string())?;
    // The first picture prepares the city and its shaders: not while a page waits for it.
    if let Some(run) = first_state(shared, state) {
        draw_views(&mut renderer, &run, &[WARM_UP])?;
    }
    while let Some(wanted) = shared.wait() {
        let begun = Instant::now();
        let Some(run) = state.get().map(PublishedState::run_state) else {
            std::thread::sleep(STILL_WAIT);
            continue;
        };
        let now = (run.run, run.now.tick);
        let due: Vec<ViewKey> =
            wanted.into_iter().filter(|(_, drawn)| *drawn != Some(now)).map(|(key, _)| key).collect();
        let drawn = draw_views(&mut renderer, &run, &due)?;
        if drawn.is_empty() {
            std::thread::sleep(STILL_WAIT);
            continue;
        }
        let jpegs: Vec<_> =
            drawn.into_par_iter().map(|(key, image)| (key, jpeg(&image, JPEG_QUALITY))).collect();
        for (key, jpeg) in jpegs {
            shared.show(&key, now, jpeg.map_err(|error| error.to_string())?);
        }
        std::thread::sleep(DRAW_INTERVAL.saturating_sub(begun.elapsed()));
    }
    Ok(())
}

/// The first state of the city; `None` where the server ends before there is one.
fn first_state(shared: &SharedDesk, state: &OnceLock<PublishedState>) -> Option<Arc<RunState>> {
    loop {
        if let Some(state) = state.get() {
            return Some(state.run_state());
        }
        if shared.desk().is_over {
            return None;
        }
        std::thread::sleep(STILL_WAIT);
    }
}

/// Draws views of a state; a vehicle that has left has no picture.
fn draw_views(
    renderer: &mut Renderer,
    run: &RunState,
    keys: &[ViewKey],
) -> Result<Vec<(ViewKey, Image)>, String> {
    let shown = keys.iter().filter_map(|key| Some((*key, view_of(key, run)?)));
    let (keys, views): (Vec<ViewKey>, Vec<View>) = shown.unzip();
    let mut images = Vec::with_capacity(views.len());
    for batch in renderer.batches(&views) {
        images.extend(renderer.render(&run.now, &batch).map_err(|error| error.to_string())?);
    }
    Ok(keys.into_iter().zip(images).collect())
}

fn view_of((view, extent): &ViewKey, run: &RunState) -> Option<View> {
    let radians = |degrees: i32| f64::from(degrees).to_radians();
    let camera = match *view {
        PageView::Onboard { vehicle } => Camera::onboard(VehicleId(vehicle), Mount::Windscreen),
        PageView::Chase { vehicle } => Camera::chase(VehicleId(vehicle)),
        PageView::Orbit { x_m, y_m, distance_m, azimuth_deg, elevation_deg } => Camera::Orbit {
            target: DVec3::new(f64::from(x_m), f64::from(y_m), 0.0),
            distance_m: f64::from(distance_m.clamp(5, 2000)),
            azimuth_rad: radians(azimuth_deg % 360),
            elevation_rad: radians(elevation_deg.clamp(5, 89)),
        },
        PageView::Overhead { x_m, y_m, height_m } => Camera::Overhead {
            centre: DVec2::new(f64::from(x_m), f64::from(y_m)),
            height_m: f64::from(height_m.clamp(10, 2000)),
        },
    };
    camera.view(&run.now, &Lens { extent: *extent, ..Lens::default() }).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATE: StateNumber = (1, 1);

    fn shared() -> Pictures {
        let pictures = Pictures::new(Arc::default());
        pictures.shared.desk().is_drawn = true;
        pictures
    }

    #[tokio::test]
    async fn a_slow_page_gets_fewer_pictures_and_the_latest_one() {
        let pictures = shared();
        let view = PageView::Chase { vehicle: 1 };
        let look = || pictures.look(view, [320, 240]).unwrap();
        let (mut fast, mut slow) = (look(), look());
        let key = fast.key;
        for number in 1..=10_u8 {
            pictures.shared.show(&key, STATE, vec![number]);
            assert_eq!(fast.next().await.unwrap(), (vec![number].into(), 0));
            fast.seen();
            if number == 1 {
                assert_eq!(slow.next().await.unwrap(), (vec![1].into(), 0));
            }
        }
        // It has not shown the first one: nothing waits for it but the latest.
        assert!(tokio::time::timeout(Duration::ZERO, slow.next()).await.is_err());
        slow.seen();
        assert_eq!(slow.next().await.unwrap(), (vec![10].into(), 8));
    }

    #[test]
    fn a_picture_is_drawn_once_a_page_has_shown_the_last_one_and_while_somebody_looks() {
        let pictures = shared();
        let wanted = || {
            let desk = pictures.shared.desk();
            desk.views.values().map(|view| view.is_wanted).collect::<Vec<_>>()
        };
        let look = |vehicle| pictures.look(PageView::Chase { vehicle }, [320, 240]);
        let mut first = look(1).unwrap();
        assert_eq!(wanted(), [true]);
        pictures.shared.show(&first.key, STATE, vec![1]);
        assert_eq!(wanted(), [false], "nobody has shown it yet");
        first.seen();
        assert_eq!(wanted(), [true]);
        drop(first);
        assert!(wanted().is_empty());
        let many: Vec<_> = (0..MAX_VIEWS as u32).map(|vehicle| look(vehicle).unwrap()).collect();
        assert!(look(99).is_none() && look(0).is_some(), "no more views, but as many who look alike");
        drop(many);
    }
}
