//! Settings of a node of ROS 2.

use crate::Ros2Error;
use city3d_network::link::exchange::{OnboardCamera, PictureForm, Subject};
use std::net::Ipv4Addr;

/// The last domain whose ports exist on all systems (RTPS 2.5, section 9.6.2.4).
pub(crate) const MAX_DOMAIN: u16 = 232;

/// From where a node can be reached.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ros2Network {
    /// From this machine alone.
    #[default]
    Loopback,
    /// From the network of this address of this machine.
    Interface(Ipv4Addr),
    /// From all networks of this machine.
    All,
}

/// What carries the messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ros2Middleware {
    /// DDS, as `rmw_fastrtps` and `rmw_cyclonedds` speak it.
    #[default]
    Dds,
    /// Zenoh, as `rmw_zenoh` speaks it.
    #[cfg(feature = "zenoh")]
    Zenoh,
}

/// Type of the topics of single vehicles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum VehicleTopics {
    /// `geometry_msgs/PoseStamped`, as ros2-vicon-receiver publishes it.
    #[default]
    Poses,
    /// `geometry_msgs/TransformStamped`, as bridges of VICON to ROS 1 did.
    Transforms,
}

/// Settings of a node.
#[derive(Clone, Debug)]
pub struct Ros2Options {
    /// Domain: nodes of others do not hear it.
    pub domain: u16,
    /// What carries its messages.
    pub middleware: Ros2Middleware,
    /// From where it can be reached.
    pub network: Ros2Network,
    /// Name of the node, without a slash.
    pub name: String,
    /// Type of the topics of single vehicles, published and subscribed.
    pub vehicle_topics: VehicleTopics,
    /// Publish `/tf` and `/tf_static`.
    pub has_tf: bool,
    /// Publish simulated time on `/clock` and in the stamps, instead of wall-clock time.
    pub has_clock: bool,
    /// Subjects whose poses are subscribed.
    pub subscribed: Vec<Subject>,
    /// Vehicles whose trajectories are received.
    pub driven: Vec<Subject>,
    /// Cameras whose pictures are published.
    pub cameras: Vec<OnboardCamera>,
    /// How their pictures are published.
    pub picture_form: PictureForm,
}

impl Ros2Options {
    /// A node of a name in a domain, which does nothing yet and is reached from this machine alone.
    ///
    /// # Errors
    /// When there is no such domain.
    pub fn new(name: &str, domain: u16) -> Result<Self, Ros2Error> {
        if domain > MAX_DOMAIN {
            return Err(Ros2Error::Domain { domain });
        }
        Ok(Self {
            domain,
            middleware: Ros2Middleware::default(),
            network: Ros2Network::Loopback,
            name: name.to_owned(),
            vehicle_topics: VehicleTopics::Poses,
            has_tf: false,
            has_clock: false,
            subscribed: Vec::new(),
            driven: Vec::new(),
            cameras: Vec::new(),
            picture_form: PictureForm::Jpeg,
        })
    }
}
