//! Pages that come as guests, each with a car of its own.

use crate::peer::{City, Page, city, served_city};
use serde_json::{Value, json};

/// The car of the first guest.
const FIRST_CAR: u32 = 901;

/// The next state that this is true of.
async fn state(page: &mut Page, is_so: impl Fn(&Value) -> bool) -> Value {
    page.hear(|message| message["t"] == "state" && is_so(message)).await
}

fn vehicle(state: &Value, id: u32) -> Option<&Value> {
    state["vehicles"].as_array().unwrap().iter().find(|vehicle| vehicle[0] == id)
}

/// What is told of a guest: its number, its car, and why it has none.
fn guest_of(state: &Value, number: &Value) -> Option<[Value; 2]> {
    let guests = state["guests"].as_array().unwrap();
    guests.iter().find(|guest| guest[0] == *number).map(|guest| [guest[1].clone(), guest[2].clone()])
}

async fn page_of(city: &City) -> (Page, Value) {
    let mut page = Page::new(city.web.address(), Some(&city.token)).await;
    let number = page.hear_of("welcome").await["guest"].clone();
    (page, number)
}

#[tokio::test]
async fn a_page_drives_a_car_of_its_own_that_goes_with_it() {
    let city = served_city(1);
    let (mut page, number) = page_of(&city).await;
    page.send(json!({ "t": "start" })).await;
    page.send(json!({ "t": "join" })).await;
    state(&mut page, |state| {
        guest_of(state, &number) == Some([json!(FIRST_CAR), Value::Null])
            && vehicle(state, FIRST_CAR).is_some()
    })
    .await;
    let pedals = json!({ "gas": 1.0, "brake": 0.0, "handbrake": 0.0, "steering_rad": 0.0 });
    let drive = json!({ "t": "drive", "vehicle": FIRST_CAR, "pedals": pedals });
    loop {
        page.send(drive.clone()).await;
        let told = state(&mut page, |_| true).await;
        let car = vehicle(&told, FIRST_CAR).unwrap();
        if car[4].as_f64() > Some(1.0) {
            assert_eq!(car[5], "manual");
            break;
        }
    }
    // No more pedals come: the car stays the page's, and brakes.
    state(&mut page, |state| {
        let car = vehicle(state, FIRST_CAR).unwrap();
        car[5] != "manual" && car[4].as_f64() < Some(0.1)
    })
    .await;

    // Another page waits until there is room.
    let (mut other, other_number) = page_of(&city).await;
    other.send(json!({ "t": "join" })).await;
    let outside = state(&mut other, |state| guest_of(state, &other_number).is_some()).await;
    let [car, why] = guest_of(&outside, &other_number).unwrap();
    assert!(car.is_null() && why.as_str().unwrap().contains("--guests"), "{why}");
    drop(page);
    let inside =
        state(&mut other, |state| guest_of(state, &other_number).is_some_and(|[car, _]| car == FIRST_CAR))
            .await;
    assert_eq!(guest_of(&inside, &number), None, "the first one has gone");
    other.send(json!({ "t": "leave" })).await;
    state(&mut other, |state| state["vehicles"] == json!([]) && state["guests"] == json!([])).await;
    city.session.stop().unwrap();
}

#[tokio::test]
async fn who_watches_brings_no_car_and_a_city_of_a_window_has_no_guests() {
    let served = served_city(1);
    let mut watcher = Page::new(served.web.address(), None).await;
    watcher.send(json!({ "t": "join" })).await;
    assert!(watcher.hear_of("notice").await["text"].as_str().unwrap().contains("watches"));
    assert_eq!(state(&mut watcher, |_| true).await["guests"], json!([]));
    served.session.stop().unwrap();

    let local = city();
    let (mut page, _) = page_of(&local).await;
    assert_eq!(state(&mut page, |_| true).await["guests"], Value::Null);
    page.send(json!({ "t": "join" })).await;
    let refused = state(&mut page, |state| !state["refusal"].is_null()).await;
    assert!(refused["refusal"][1].as_str().unwrap().contains("city3d serve"), "{refused}");
    local.session.stop().unwrap();
}
