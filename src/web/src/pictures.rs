//! Camera pictures for the pages, drawn on a thread in the idle scheduling class. Pages that look alike share a picture;
//! a picture is drawn only when a page that looks at it has shown the last one, so that slow pages get fewer. Of H.264 a
//! page needs each frame since a key frame: one that has missed some gets nothing before the next key frame.

use crate::h264::ViewEncoder;
use crate::message::PageView;
use crate::picture::{Picture, PictureKind};
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

/// Opens the renderer, on the thread that draws.
pub type PictureDrawer = OpenRenderer;

/// Different streams that are made at once, at most.
const MAX_STREAMS: usize = 32;
/// Those of H.264 among them, at most: an encoder has 13 MB for 1280x960. Further ones are JPEG.
const MAX_VIDEOS: usize = 12;
/// Least time between two pictures of all views.
const DRAW_INTERVAL: Duration = Duration::from_millis(33);
/// A city that stands is looked at again after this time.
const STILL_WAIT: Duration = Duration::from_millis(20);
const JPEG_QUALITY: u8 = 80;
/// Least time between two key frames of a stream.
const KEY_INTERVAL: Duration = Duration::from_millis(500);
/// Sizes are multiples of this, so that pages of about the same size share pictures.
const SIZE_STEP: u32 = 32;
const SMALLEST: u32 = 96;
const LARGEST: [u32; 2] = [1280, 960];
/// The picture that nobody sees.
const WARM_UP: ViewKey = (PageView::Overhead { x_m: 0, y_m: 0, height_m: 100 }, [SMALLEST; 2]);

/// What is drawn: a camera, and the size of its picture.
type ViewKey = (PageView, [u32; 2]);

/// A view, and whether it is sent as H.264.
type StreamKey = (ViewKey, bool);

/// A state of the city: run and tick.
type StateNumber = (u32, u64);

/// A stream that is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct WantedStream {
    key: StreamKey,
    /// State of its last picture.
    drawn: Option<StateNumber>,
    /// A page can show nothing but a key frame.
    wants_key: bool,
}

/// A picture and its number, which counts those of its stream.
#[derive(Clone, Debug, Default)]
struct Shown {
    number: u64,
    picture: Picture,
}

/// The pictures of a view that pages look at.
#[derive(Debug)]
struct SharedStream {
    lookers: usize,
    /// A page has shown the last picture, and wants another.
    is_wanted: bool,
    /// A page has missed a frame of H.264, or has just come.
    wants_key: bool,
    /// Time of the last key frame.
    key_at: Option<Instant>,
    /// State of the last picture: the same one is not drawn twice.
    drawn: Option<StateNumber>,
    latest: watch::Sender<Shown>,
}

#[derive(Debug, Default)]
struct Desk {
    streams: BTreeMap<StreamKey, SharedStream>,
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

    /// Waits for streams that are wanted; `None` at the end.
    fn wait(&self) -> Option<Vec<WantedStream>> {
        let mut desk = self.desk();
        loop {
            if desk.is_over {
                return None;
            }
            let wanted: Vec<_> = desk.wanted(Instant::now()).collect();
            if !wanted.is_empty() {
                return Some(wanted);
            }
            desk = self.wake.wait(desk).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Hands on a picture, if somebody still looks.
    fn show(&self, key: &StreamKey, state: StateNumber, picture: Picture) {
        if let Some(stream) = self.desk().streams.get_mut(key) {
            (stream.is_wanted, stream.drawn) = (false, Some(state));
            if picture.kind == PictureKind::KeyFrame {
                (stream.wants_key, stream.key_at) = (false, Some(Instant::now()));
            }
            stream.latest.send_modify(|shown| *shown = Shown { number: shown.number + 1, picture });
        }
    }
}

impl Desk {
    /// Whether a view can be H.264.
    fn has_room_for_video(&self, view: ViewKey) -> bool {
        let videos = self.streams.keys().filter(|(_, is_video)| *is_video).count();
        self.streams.contains_key(&(view, true)) || videos < MAX_VIDEOS
    }

    /// The streams of which a page wants a picture. A slow page cannot have key frames as often as it likes: they are large,
    /// and all who look alike get them.
    fn wanted(&self, now: Instant) -> impl Iterator<Item = WantedStream> + '_ {
        let is_due = move |stream: &SharedStream| {
            stream.key_at.is_none_or(|at| now.saturating_duration_since(at) >= KEY_INTERVAL)
        };
        self.streams.iter().filter(|(_, stream)| stream.is_wanted).map(move |(key, stream)| WantedStream {
            key: *key,
            drawn: stream.drawn,
            wants_key: stream.wants_key && is_due(stream),
        })
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
                desk.streams.clear();
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

    /// Looks at a view, as JPEG or as H.264; `None` where too many are looked at, or nothing is drawn.
    pub(crate) fn look(&self, view: PageView, extent: [u32; 2], is_video: bool) -> Option<Look> {
        let [width, height] = [0, 1].map(|k| {
            let size: u32 = extent[k].clamp(SMALLEST, LARGEST[k]);
            size.next_multiple_of(SIZE_STEP).min(LARGEST[k])
        });
        let mut desk = self.shared.desk();
        let is_video = is_video && desk.has_room_for_video((view, [width, height]));
        let key = ((view, [width, height]), is_video);
        if !desk.is_drawn || (!desk.streams.contains_key(&key) && desk.streams.len() >= MAX_STREAMS) {
            return None;
        }
        let stream = desk.streams.entry(key).or_insert_with(|| SharedStream {
            lookers: 0,
            is_wanted: true,
            wants_key: is_video,
            key_at: None,
            drawn: None,
            latest: watch::Sender::new(Shown::default()),
        });
        stream.lookers += 1;
        let mut pictures = stream.latest.subscribe();
        let Shown { mut number, picture } = pictures.borrow().clone();
        if number > 0 && picture.kind != PictureKind::DeltaFrame {
            // Somebody else looks already: its picture comes at once.
            pictures.mark_changed();
            number -= 1;
        } else {
            (stream.is_wanted, stream.wants_key) = (true, is_video);
        }
        self.shared.wake.notify_one();
        let shared = Arc::clone(&self.shared);
        Some(Look { key, shared, pictures, number, has_key: false, is_waiting: false })
    }
}

/// What one page looks at.
#[derive(Debug)]
pub(crate) struct Look {
    key: StreamKey,
    shared: Arc<SharedDesk>,
    pictures: watch::Receiver<Shown>,
    /// The last picture that was sent.
    number: u64,
    /// A key frame was sent, and each frame since then.
    has_key: bool,
    /// The page has not shown it yet.
    is_waiting: bool,
}

impl Look {
    /// The page has shown the picture that was sent last.
    pub(crate) fn seen(&mut self) {
        self.is_waiting = false;
        self.want(false);
    }

    fn want(&self, wants_key: bool) {
        let mut desk = self.shared.desk();
        if let Some(stream) = desk.streams.get_mut(&self.key) {
            stream.is_wanted = true;
            stream.wants_key |= wants_key;
            drop(desk);
            self.shared.wake.notify_one();
        }
    }

    /// Waits for a picture to send, with the number of those in between that the page has missed; `None` where there
    /// will be none.
    pub(crate) async fn next(&mut self) -> Option<(Picture, u64)> {
        if self.is_waiting {
            std::future::pending::<()>().await;
        }
        loop {
            self.pictures.changed().await.ok()?;
            let Shown { number, picture } = self.pictures.borrow_and_update().clone();
            let skipped = (number - self.number).saturating_sub(1);
            self.has_key &= skipped == 0;
            self.has_key |= picture.kind == PictureKind::KeyFrame;
            if picture.kind == PictureKind::DeltaFrame && !self.has_key {
                self.want(true);
                continue;
            }
            (self.number, self.is_waiting) = (number, true);
            return Some((picture, skipped));
        }
    }
}

impl Drop for Look {
    fn drop(&mut self) {
        let mut desk = self.shared.desk();
        if let Some(stream) = desk.streams.get_mut(&self.key) {
            stream.lookers -= 1;
            if stream.lookers == 0 {
                desk.streams.remove(&self.key);
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
    let mut encoders = BTreeMap::new();
    while let Some(wanted) = shared.wait() {
        let begun = Instant::now();
        let Some(run) = state.get().map(PublishedState::run_state) else {
            std::thread::sleep(STILL_WAIT);
            continue;
        };
        let now = (run.run, run.now.tick);
        let mut due = wanted;
        due.retain(|stream| stream.drawn != Some(now) || stream.wants_key);
        let mut views: Vec<ViewKey> = due.iter().map(|stream| stream.key.0).collect();
        views.dedup();
        let drawn = draw_views(&mut renderer, &run, &views)?;
        if drawn.is_empty() {
            std::thread::sleep(STILL_WAIT);
            continue;
        }
        for (key, picture) in encode(&drawn, &due, &mut encoders)? {
            shared.show(&key, now, picture);
        }
        let desk = shared.desk();
        encoders.retain(|key, _| desk.streams.contains_key(&(*key, true)));
        drop(desk);
        std::thread::sleep(DRAW_INTERVAL.saturating_sub(begun.elapsed()));
    }
    Ok(())
}

/// Encodes the pictures of streams, whose encoders of H.264 go on where they were.
fn encode(
    drawn: &[(ViewKey, Image)],
    due: &[WantedStream],
    encoders: &mut BTreeMap<ViewKey, ViewEncoder>,
) -> Result<Vec<(StreamKey, Picture)>, String> {
    let mut work = Vec::with_capacity(due.len());
    for stream in due {
        let (view, is_video) = stream.key;
        let Some((_, image)) = drawn.iter().find(|(key, _)| *key == view) else { continue };
        let encoder = match (is_video, encoders.remove(&view)) {
            (false, kept) => {
                encoders.extend(kept.map(|kept| (view, kept)));
                None
            }
            (true, Some(encoder)) => Some(encoder),
            (true, None) => Some(ViewEncoder::new()?),
        };
        work.push((stream, image, encoder));
    }
    let encoded: Vec<_> = work
        .into_par_iter()
        .map(|(stream, image, mut encoder)| {
            let picture = match &mut encoder {
                Some(encoder) => encoder.encode(image, stream.wants_key),
                None => jpeg(image, JPEG_QUALITY)
                    .map_err(|error| error.to_string())
                    .map(|bytes| Picture { kind: PictureKind::Jpeg, bytes: bytes.into() }),
            };
            (stream.key, encoder, picture)
        })
        .collect();
    let mut pictures = Vec::with_capacity(encoded.len());
    for (key, encoder, picture) in encoded {
        encoders.extend(encoder.map(|encoder| (key.0, encoder)));
        pictures.push((key, picture?));
    }
    Ok(pictures)
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

    fn picture(kind: PictureKind, number: u8) -> Picture {
        Picture { kind, bytes: vec![number].into() }
    }

    #[tokio::test]
    async fn a_slow_page_gets_fewer_pictures_and_the_latest_one() {
        let pictures = shared();
        let view = PageView::Chase { vehicle: 1 };
        let look = || pictures.look(view, [320, 240], false).unwrap();
        let (mut fast, mut slow) = (look(), look());
        let (key, of) = (fast.key, |number| picture(PictureKind::Jpeg, number));
        for number in 1..=10_u8 {
            pictures.shared.show(&key, STATE, of(number));
            assert_eq!(fast.next().await.unwrap(), (of(number), 0));
            fast.seen();
            if number == 1 {
                assert_eq!(slow.next().await.unwrap(), (of(1), 0));
            }
        }
        // It has not shown the first one: nothing waits for it but the latest.
        assert!(tokio::time::timeout(Duration::ZERO, slow.next()).await.is_err());
        slow.seen();
        assert_eq!(slow.next().await.unwrap(), (of(10), 8));
    }

    #[tokio::test]
    async fn a_page_that_has_missed_a_frame_of_video_waits_for_a_key_frame() {
        use PictureKind::{DeltaFrame, KeyFrame};
        let pictures = shared();
        let look = || pictures.look(PageView::Chase { vehicle: 1 }, [320, 240], true).unwrap();
        let wants_key = || pictures.shared.desk().streams.values().any(|stream| stream.wants_key);
        let mut fast = look();
        let key = fast.key;
        assert!(wants_key(), "who comes first begins with a key frame");
        let show = |kind, number| pictures.shared.show(&key, STATE, picture(kind, number));
        show(KeyFrame, 1);
        assert!(!wants_key());
        let mut slow = look();
        for page in [&mut fast, &mut slow] {
            assert_eq!(page.next().await.unwrap(), (picture(KeyFrame, 1), 0));
        }
        for number in 2..=4 {
            fast.seen();
            show(DeltaFrame, number);
            assert_eq!(fast.next().await.unwrap().0, picture(DeltaFrame, number));
        }
        slow.seen();
        assert!(tokio::time::timeout(Duration::ZERO, slow.next()).await.is_err(), "it cannot show this one");
        assert!(wants_key());
        show(DeltaFrame, 5);
        assert!(tokio::time::timeout(Duration::ZERO, slow.next()).await.is_err(), "nor that one");
        show(KeyFrame, 6);
        assert_eq!(slow.next().await.unwrap(), (picture(KeyFrame, 6), 4));
        slow.seen();
        show(DeltaFrame, 7);
        assert_eq!(slow.next().await.unwrap().0, picture(DeltaFrame, 7));
        // Who comes later begins with a key frame too.
        let mut late = look();
        assert!(tokio::time::timeout(Duration::ZERO, late.next()).await.is_err() && wants_key());
    }

    #[test]
    fn views_beyond_those_that_can_be_encoded_at_once_are_jpeg() {
        let pictures = shared();
        let look = |vehicle| pictures.look(PageView::Chase { vehicle }, [320, 240], true).unwrap();
        let looks: Vec<_> = (0..=MAX_VIDEOS as u32).map(look).collect();
        let videos = looks.iter().filter(|look| look.key.1).count();
        assert_eq!((videos, looks[MAX_VIDEOS].key.1, look(0).key.1), (MAX_VIDEOS, false, true));
    }

    #[test]
    fn key_frames_are_made_at_intervals_however_often_they_are_wanted() {
        let pictures = shared();
        let look = pictures.look(PageView::Chase { vehicle: 1 }, [320, 240], true).unwrap();
        let wanted = |passed| {
            let desk = pictures.shared.desk();
            desk.wanted(Instant::now() + passed).map(|stream| stream.wants_key).collect::<Vec<_>>()
        };
        assert_eq!(wanted(Duration::ZERO), [true]);
        pictures.shared.show(&look.key, STATE, picture(PictureKind::KeyFrame, 1));
        look.want(true);
        assert_eq!(wanted(Duration::ZERO), [false]);
        assert_eq!(wanted(KEY_INTERVAL), [true]);
    }

    #[test]
    fn a_picture_is_drawn_once_a_page_has_shown_the_last_one_and_while_somebody_looks() {
        let pictures = shared();
        let wanted = || {
            let desk = pictures.shared.desk();
            desk.streams.values().map(|stream| stream.is_wanted).collect::<Vec<_>>()
        };
        let look = |vehicle| pictures.look(PageView::Chase { vehicle }, [320, 240], false);
        let mut first = look(1).unwrap();
        assert_eq!(wanted(), [true]);
        pictures.shared.show(&first.key, STATE, picture(PictureKind::Jpeg, 1));
        assert_eq!(wanted(), [false], "nobody has shown it yet");
        first.seen();
        assert_eq!(wanted(), [true]);
        drop(first);
        assert!(wanted().is_empty());
        let many: Vec<_> = (0..MAX_STREAMS as u32).map(|vehicle| look(vehicle).unwrap()).collect();
        assert!(look(99).is_none() && look(0).is_some(), "no more views, but as many who look alike");
        drop(many);
    }
}
