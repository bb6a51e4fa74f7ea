//! Onboard pictures: who takes them is slow, works again, or dies; or nobody can draw them.

use super::{Stage, passes};
use city3d_protocol::snapshot::VehicleId;
use city3d_render::{AdapterPreference, Context, Quality, RenderError, Renderer, Settings};
use city3d_scene::SceneDescription;
use city3d_sensors::{Lens, Mount, PictureKind};
use city3d_session::OrderSender;
use city3d_session::pictures::{CarriedCamera, PictureError, PictureStamps, PictureThread};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::time::Duration;

/// What the one who takes the pictures does.
const QUICK: u8 = 0;
const SLOW: u8 = 1;
const DYING: u8 = 2;

/// A camera of the first vehicle with fifty small pictures a second, in a city that is not there.
fn pictures(mood: &Arc<AtomicU8>, taken: &Arc<AtomicU64>) -> Result<PictureThread, PictureError> {
    let open = Box::new(|_| {
        let context = Context::headless(&AdapterPreference::parse("software"))?;
        let settings = Settings { quality: Quality::LOW, ..Settings::default() };
        Renderer::new(&context, &SceneDescription::default(), settings)
    });
    let lens = Lens { extent: [64, 48], ..Lens::default() };
    let (vehicle, mount, kind) = (VehicleId(1), Mount::Windscreen, PictureKind::Rgb);
    let camera = CarriedCamera { vehicle, mount, lens, every_s: 0.02, kind };
    let (mood, taken) = (Arc::clone(mood), Arc::clone(taken));
    let wanted: Arc<[AtomicBool]> = Arc::new([AtomicBool::new(true)]);
    PictureThread::start(open, (vec![camera], PictureStamps::Simulated), wanted, move |_| {
        match mood.load(Ordering::Relaxed) {
            SLOW => std::thread::sleep(Duration::from_millis(300)),
            DYING => panic!("this end dies"),
            _ => {}
        }
        taken.fetch_add(1, Ordering::Relaxed);
    })
}

#[test]
fn who_takes_pictures_slowly_or_dies_delays_nobody() {
    let (mood, taken) = (Arc::new(AtomicU8::new(QUICK)), Arc::<AtomicU64>::default());
    let thread = match pictures(&mood, &taken) {
        Ok(thread) => thread,
        Err(error) => {
            assert!(std::env::var_os("CI").is_none(), "{error}");
            eprintln!("SKIPPED: {error}");
            return;
        }
    };
    let becomes = |now: u8| {
        let mood = Arc::clone(&mood);
        move |_: &OrderSender| mood.store(now, Ordering::Relaxed)
    };
    let at = Arc::new(AtomicU64::new(0));
    let (mark, since) = (Arc::clone(&at), Arc::clone(&at));
    let slow = becomes(QUICK);
    let stages = vec![
        Stage::new("pictures are taken", |health| health.delivered > 3).then(becomes(SLOW)),
        Stage::new("some are dropped", |health| health.dropped > 20).then(move |orders| {
            slow(orders);
            mark.store(taken.load(Ordering::Relaxed), Ordering::Relaxed);
        }),
        Stage::new("they are taken again", move |health| {
            health.failure.is_none() && health.delivered > since.load(Ordering::Relaxed) + 5
        })
        .then(becomes(DYING)),
        Stage::new("it is dead", |health| health.failure.is_some()),
    ];
    let (health, accounts) = passes(Box::new(thread), 0, stages);
    assert!(health.failure.unwrap().to_string().contains("ended early"));
    assert_eq!(accounts.last().map(|account| account.failures), Some(1));
}

#[test]
fn a_renderer_that_cannot_be_opened_is_an_error_at_the_start() {
    let open = Box::new(|_| Err(RenderError::NoAdapter { wanted: " of the kind none".to_owned() }));
    let cameras = (Vec::new(), PictureStamps::Simulated);
    let started = PictureThread::start(open, cameras, Arc::new([]), |_| panic!("there are no pictures"));
    match started {
        Err(PictureError::Renderer(error)) => {
            assert!(error.to_string().contains("of the kind none"), "{error}");
        }
        other => panic!("{other:?}"),
    }
}
