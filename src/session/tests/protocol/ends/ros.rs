//! ROS whose master is not there.

use super::{Stage, passes};
use city3d_network::link::vicon::{RosTransport, ViconOptions};
use city3d_network::ros::NodeOptions;
use city3d_session::ros::RosNode;

#[test]
fn without_a_master_the_city_goes_on_and_says_so_once() {
    // The port for reserved use: nothing listens there.
    let master = "http://127.0.0.1:1".parse().unwrap();
    let node = NodeOptions { name: "/city3d_alone".to_owned(), master, bind: None };
    let transport = RosTransport::Node(node);
    let node = RosNode::start(ViconOptions {
        transport,
        has_clock: true,
        subscribed: Vec::new(),
        cameras: Vec::new(),
    });
    let stages = vec![
        Stage::new("it is away", |health| health.failure.is_some()),
        Stage::new("it stays away", |health| health.failure.is_some()),
    ];
    let (health, accounts) = passes(Box::new(node.unwrap().poses()), 0, stages);
    assert_eq!(health.failure.as_deref(), Some("its master or server is away"));
    assert_eq!(accounts[0].failures, 1, "said once");
}
