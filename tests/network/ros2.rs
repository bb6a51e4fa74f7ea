//! A city and its mainframe over ROS 2. Peers of other makers: `scripts/peers.sh ros2`.

use crate::support::link;

use link::{city3d, mainframe, serve, summary};

/// A domain that other tests hardly have: they run beside this one.
fn domain() -> u32 {
    100 + std::process::id() % 100
}

#[test]
fn a_mainframe_drives_by_poses_of_ros2() {
    let folder = tempfile::tempdir().unwrap();
    let over = format!("--ros2={}", domain());
    let length = ["roundabout", "--duration", "6", &over];
    let mut city =
        serve(&[&length[..], &["--ros2-clock", "--ros2-tf", "--out", "served"]].concat(), folder.path());
    let mut far = mainframe(&city.address, &[&length[..], &["--out", "far"]].concat(), folder.path());
    assert_eq!((far.wait(), city.wait()), (0, 0));
    let served = summary(&folder.path().join("served"));
    for id in 1..=6 {
        let way_m = served["vehicles"][id.to_string()]["distance_m"].as_f64().unwrap();
        assert!(way_m > 10.0, "vehicle {id}: {way_m} m");
    }
    let end = &served["ends"]["ros2"];
    assert!(end["delivered"].as_u64().unwrap() >= 600, "{end}");
    assert_eq!((&end["dropped"], &end["failures"]), (&0.into(), &0.into()), "{end}");
}

#[test]
fn one_middleware_is_chosen_and_a_domain_that_exists() {
    let folder = tempfile::tempdir().unwrap();
    let fails = |arguments: &[&str], words: &str| {
        let output = city3d(arguments, folder.path()).output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && told.contains(words), "{arguments:?}: {told}");
    };
    fails(&["serve", "straight", "--headless", "--ros2=233"], "233 is no ROS 2 domain");
    fails(&["serve", "straight", "--headless", "--ros2", "--ros"], "cannot be used with");
    fails(&["mainframe", "straight", "--ros2-network", "127.0.0.1"], "--ros2");
}
