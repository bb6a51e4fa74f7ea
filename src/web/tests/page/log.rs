//! A page on a log: who has the token plays it, and all see the same.

use crate::peer::Page;
use city3d_logbook::record::LogOrigin;
use city3d_session::playback::SharedPlayer;
use city3d_session::{FileOptions, Host, LocalCity, RunFiles, RunFolders, Session, SessionEnd, Speed, Token};
use city3d_simulation::scenario::{Overrides, ScenarioRequest};
use city3d_web::{PageOrders, WebOptions, WebServer};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

/// Records some seconds of the roundabout.
fn record(folder: &Path, duration_s: f64) {
    let overrides = Overrides { duration_s: Some(duration_s), ..Overrides::default() };
    let request =
        ScenarioRequest { scenario: "roundabout".to_owned(), overrides, ..ScenarioRequest::default() };
    let experiment = city3d_session::load(&request).unwrap();
    let host = Host::system();
    let city = LocalCity::new(Arc::clone(&experiment), host.clone()).unwrap().started();
    let folders = RunFolders::parts(Some(folder.to_path_buf()));
    let files = RunFiles::new(folders, LogOrigin::Run, FileOptions::default());
    let session = Session::new(city, host).at_speed(Speed::Unlimited).with_end(Box::new(files));
    session.until(SessionEnd::AtTick(experiment.ticks())).run().unwrap();
}

fn state(wanted: impl Fn(&Value) -> bool) -> impl Fn(&Value) -> bool {
    move |message| message["t"] == "state" && wanted(message)
}

#[tokio::test]
async fn a_page_plays_a_log_and_shows_any_time_of_it() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path(), 12.0);
    let player = SharedPlayer::open(&folder.path().join("run.mcap")).unwrap();
    let token = Token::draw().unwrap();
    let text = token.text().to_owned();
    let (address, experiment) = ("127.0.0.1:0".to_owned(), Arc::clone(player.experiment()));
    let orders = PageOrders::Log(player.remote());
    let web = WebServer::start(WebOptions::new(address, token, experiment, orders)).unwrap();
    web.watch(player.published());

    let mut page = Page::new(web.address(), Some(&text)).await;
    let mut watcher = Page::new(web.address(), None).await;
    assert_eq!(page.hear_of("welcome").await["is_log"], true);
    let first = page.hear(state(|_| true)).await;
    assert_eq!((&first["phase"], &first["log"]), (&json!("paused"), &json!([0.0, 12.0, 0.0])));

    page.send(json!({ "t": "seek", "time_s": 8.0 })).await;
    for page in [&mut page, &mut watcher] {
        let sought = page.hear(state(|state| state["time"] == 8.0)).await;
        assert_eq!((&sought["phase"], &sought["log"][2]), (&json!("paused"), &json!(8.0)));
        assert!(sought["vehicles"].as_array().unwrap().len() == 6);
    }
    page.send(json!({ "t": "speed", "factor": 5.0 })).await;
    page.send(json!({ "t": "start" })).await;
    page.hear(state(|state| state["phase"] == "running" && state["time"].as_f64() > Some(9.0))).await;
    page.hear(state(|state| state["phase"] == "paused" && state["time"] == 12.0)).await;
    page.send(json!({ "t": "reset" })).await;
    page.hear(state(|state| state["time"] == 0.0)).await;

    // All events of the log are known, also those after the shown time.
    let mut late = Page::new(web.address(), None).await;
    let events = late.hear(|message| message["t"] == "events" && message["count"].as_u64() > Some(0)).await;
    let last = events["events"].as_array().unwrap().last().unwrap().clone();
    assert!(last[0].as_f64().unwrap() > 1.0, "{last}");

    // Nobody drives in a log, and who watches plays nothing.
    let pedals = json!({ "gas": 1.0, "brake": 0.0, "handbrake": 0.0, "steering_rad": 0.0 });
    page.send(json!({ "t": "drive", "vehicle": 1, "pedals": pedals })).await;
    assert!(page.hear_of("notice").await["text"].as_str().unwrap().contains("log"));
    watcher.send(json!({ "t": "start" })).await;
    assert!(watcher.hear_of("notice").await["text"].as_str().unwrap().contains("watches"));
    assert!(!player.remote().head().is_playing);
}
