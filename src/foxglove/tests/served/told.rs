//! What clients are told, and what they order.

use crate::peer::{Heard, PAUSE, Peer, RESET, SET_SPEED, START, city};
use foxglove::Decode;
use foxglove::messages::{FrameTransforms, SceneUpdate};
use serde_json::{Value, json};

#[tokio::test]
async fn a_client_reads_the_city_before_it_starts_and_while_it_runs() {
    let city = city("roundabout");
    let mut peer = Peer::new(&city.foxglove.url()).await;
    let info = peer.text(|text| text["op"] == "serverInfo").await;
    assert_eq!(info["capabilities"], json!(["time", "parameters", "parametersSubscribe", "services"]));
    for topic in ["/city3d/snapshot", "/city3d/scene", "/city3d/map", "/tf", "/city3d/metrics"] {
        peer.subscribe(topic).await;
    }
    // It stands: the roads, then what stands on them.
    let (_, roads) = peer.message("/city3d/map").await;
    let roads = SceneUpdate::decode(roads).unwrap();
    assert!(roads.entities[0].triangles.len() > 20);
    assert!(roads.entities[0].triangles.iter().all(|lane| lane.indices.len() % 3 == 0));
    let (time_s, scene) = peer.message("/city3d/scene").await;
    let scene = SceneUpdate::decode(scene).unwrap();
    assert_eq!((time_s, scene.entities.len()), (0.0, 6));
    let standing = scene.entities[0].cubes[0].pose.unwrap().position.unwrap();

    assert_eq!(peer.call(START, json!({})).await["success"], true);
    let (time_s, moved) = loop {
        let (time_s, scene) = peer.message("/city3d/scene").await;
        if time_s > 3.0 {
            break (time_s, SceneUpdate::decode(scene).unwrap());
        }
    };
    let now = moved.entities[0].cubes[0].pose.unwrap().position.unwrap();
    let way_m = (now.x - standing.x).abs() + (now.y - standing.y).abs();
    assert!(way_m > 2.0, "{way_m} m at {time_s} s");
    let (_, transforms) = peer.message("/tf").await;
    let transforms = FrameTransforms::decode(transforms).unwrap().transforms;
    assert_eq!(transforms.len(), 6);
    assert!(transforms.iter().all(|it| it.parent_frame_id == "city"));
    let (_, metrics) = peer.message("/city3d/metrics").await;
    let metrics: Value = serde_json::from_slice(&metrics).unwrap();
    assert_eq!((&metrics["phase"], &metrics["vehicles"]), (&json!("running"), &json!(6)));
    assert_eq!(city.foxglove.counts().dropped(), 0);
    city.session.stop().unwrap();
}

#[tokio::test]
async fn the_messages_of_the_log_come_one_for_each_tick_with_simulated_time() {
    let city = city("roundabout");
    let mut peer = Peer::new(&city.foxglove.url()).await;
    let channel = peer.channel("/city3d/tick").await;
    assert_eq!((&channel["encoding"], &channel["schemaEncoding"]), (&json!("cdr"), &json!("ros2msg")));
    assert!(channel["schema"].as_str().unwrap().contains("uint64 state_hash"));
    for topic in ["/city3d/tick", "/city3d/trajectory", "/city3d/event"] {
        peer.subscribe(topic).await;
    }
    peer.call(START, json!({})).await;
    let mut last = None;
    for _ in 0..100 {
        let (time_s, tick) = peer.message("/city3d/tick").await;
        let number = u64::from_le_bytes(tick[4..12].try_into().unwrap());
        assert!((time_s - number as f64 / 100.0).abs() < 1e-9, "{time_s} {number}");
        assert!(last.is_none_or(|last| number == last + 1), "{last:?} {number}");
        last = Some(number);
    }
    let (_, trajectory) = peer.message("/city3d/trajectory").await;
    assert!(trajectory.len() > 100 && trajectory[..4] == [0, 1, 0, 0]);
    city.session.stop().unwrap();
}

#[tokio::test]
async fn services_and_parameters_order_and_a_reset_turns_the_time_back() {
    let city = city("roundabout");
    let mut peer = Peer::new(&city.foxglove.url()).await;
    peer.subscribe("/city3d/scene").await;
    peer.send(json!({ "op": "subscribeParameterUpdates", "parameterNames": ["/city3d/state", "/unknown"] }))
        .await;
    assert_eq!(peer.call(SET_SPEED, json!({ "factor": 2.0 })).await["success"], true);
    assert_eq!(peer.call(SET_SPEED, json!({ "factor": "fast" })).await["success"], false);
    let value = |text: &Value, name: &str| {
        let found = text["parameters"].as_array().into_iter().flatten().find(|it| it["name"] == name);
        found.map(|it| it["value"].clone())
    };
    let set = json!([{ "name": "/city3d/state", "value": "running" }]);
    peer.send(json!({ "op": "setParameters", "parameters": set, "id": "a" })).await;
    let answer = peer.text(|text| text["id"] == "a").await;
    assert_eq!(value(&answer, "/city3d/state"), Some(json!("running")));
    assert_eq!(value(&answer, "/city3d/speed"), Some(json!(2.0)));
    while peer.message("/city3d/scene").await.0 < 0.5 {}
    assert_eq!(peer.call(PAUSE, json!({})).await["success"], true);
    peer.text(|text| value(text, "/city3d/state") == Some(json!("paused"))).await;
    peer.ask(RESET, json!({})).await;
    let first = loop {
        match peer.heard().await {
            Heard::Message { topic, stamp_ns: 0, payload } if topic == "/city3d/scene" => break payload,
            _ => {}
        }
    };
    let scene = SceneUpdate::decode(first).unwrap();
    assert_eq!((scene.deletions.len(), scene.entities.len()), (1, 6), "all of before is deleted");
    assert!(matches!(peer.times_ns[..], [.., before, 0] if before > 0), "{:?}", peer.times_ns);
    city.session.stop().unwrap();
}

#[tokio::test]
async fn without_the_token_a_client_watches() {
    let city = city("roundabout");
    let mut peer = Peer::new(&city.watched()).await;
    let answer = peer.call(START, json!({})).await;
    assert_eq!(answer["success"], false);
    assert!(answer["message"].as_str().unwrap().contains("watches"), "{answer}");
    peer.send(
        json!({ "op": "setParameters", "parameters": [{ "name": "/city3d/state", "value": "running" }] }),
    )
    .await;
    peer.text(|text| text["op"] == "status").await;
    peer.text(|text| text["op"] == "parameterValues").await;
    assert_eq!((city.foxglove.counts().peers.forbidden, city.session.run_state().now.tick), (2, 0));
    let wrong = format!("{}?token=0123456789abcdef0123456789abcdef", city.watched());
    let mut wrong = Peer::new(&wrong).await;
    let status = wrong.text(|text| text["op"] == "status").await;
    assert!(status["message"].as_str().unwrap().contains("token"), "{status}");
    assert_eq!(wrong.call(START, json!({})).await["success"], false);
    assert_eq!(city.foxglove.counts().peers.wrong_tokens, 1);
    city.session.stop().unwrap();
}

#[tokio::test]
async fn vehicles_have_channels_of_their_own() {
    let city = city("roundabout");
    let mut peer = Peer::new(&city.watched()).await;
    let channel = peer.channel("/vicon/path1_a/path1_a").await;
    assert_eq!(channel["schemaName"], "geometry_msgs/msg/TransformStamped");
    peer.subscribe("/vicon/path1_a/path1_a").await;
    let (_, pose) = peer.message("/vicon/path1_a/path1_a").await;
    assert!(String::from_utf8_lossy(&pose).contains("/vicon/world"));
    peer.send(json!({ "op": "subscribe", "subscriptions": [{ "id": 5, "channelId": 4242 }] })).await;
    let status = peer.text(|text| text["op"] == "status").await;
    assert!(status["message"].as_str().unwrap().contains("4242"), "{status}");
    city.session.stop().unwrap();
}

#[tokio::test]
async fn channels_without_subscribers_cost_nothing() {
    let city = city("roundabout");
    let mut peer = Peer::new(&city.foxglove.url()).await;
    peer.call(START, json!({})).await;
    let until = async |tick: u64| {
        while city.session.run_state().now.tick < tick {
            tokio::task::yield_now().await;
        }
    };
    until(20).await;
    let before = city.foxglove.counts().peers.messages;
    until(70).await;
    assert_eq!(city.foxglove.counts().peers.messages, before, "not even the time is told");
    city.session.stop().unwrap();
}
