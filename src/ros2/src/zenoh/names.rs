//! Keys and tokens of rmw_zenoh, as its design document has them.

use crate::middleware::Offer;
use city3d_protocol::ros2::MessageKind;
use twox_hash::XxHash3_128;

/// Bytes of the identifier of an endpoint.
pub(super) const GID_BYTES: usize = 16;

/// What an endpoint does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EndpointKind {
    Publisher,
    Subscriber,
}

/// A publisher or a subscriber, as it is told.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Endpoint {
    /// Key of its liveliness token.
    pub token: String,
    /// Its identifier: a hash of that key.
    pub gid: [u8; GID_BYTES],
}

/// Names of a node's keys.
#[derive(Debug)]
pub(super) struct Names {
    domain: u16,
    session: String,
    node: String,
    /// Number of the next endpoint; the node has the first one.
    next: u32,
    /// Humble knows no hashes of types.
    has_hashes: bool,
}

impl Names {
    /// Names in a domain, of the node of a session.
    pub fn new(domain: u16, session: &str, node: &str) -> Self {
        let has_hashes = std::env::var("ROS_DISTRO").map_or(true, |name| name != "humble");
        Self { domain, session: session.to_owned(), node: node.to_owned(), next: 1, has_hashes }
    }

    /// Token of the node.
    pub fn node(&self) -> String {
        format!("{}/0/0/NN/%/%/{}", self.begin(), self.node)
    }

    fn begin(&self) -> String {
        format!("@ros2_lv/{}/{}", self.domain, self.session)
    }

    /// The next endpoint.
    pub fn endpoint(&mut self, of: EndpointKind, topic: &str, kind: MessageKind, offer: Offer) -> Endpoint {
        let number = self.next;
        self.next += 1;
        let letters = match of {
            EndpointKind::Publisher => "MP",
            EndpointKind::Subscriber => "MS",
        };
        // Reliable, keeping the last messages; whatever is the default is left out.
        let durability = if offer.is_latched { "1" } else { "" };
        let token = format!(
            "{}/0/{number}/{letters}/%/%/{}/{}/{}/{}/:{durability}:,{}:,:,:,,",
            self.begin(),
            self.node,
            mangled(topic),
            kind.dds_name(),
            self.hash(kind),
            offer.window,
        );
        let gid = XxHash3_128::oneshot(token.as_bytes()).to_le_bytes();
        Endpoint { token, gid }
    }

    /// Key under which the messages of a topic are published.
    pub fn key(&self, topic: &str, kind: MessageKind) -> String {
        format!("{}/{}/{}/{}", self.domain, topic.trim_matches('/'), kind.dds_name(), self.hash(kind))
    }

    /// The same for publishers with any hash.
    pub fn any_hash(&self, topic: &str, kind: MessageKind) -> String {
        format!("{}/{}/{}/*", self.domain, topic.trim_matches('/'), kind.dds_name())
    }

    /// Tokens of the subscribers of a topic.
    pub fn subscribers_of(&self, topic: &str) -> String {
        format!("@ros2_lv/{}/*/*/*/MS/*/*/*/{}/**", self.domain, mangled(topic))
    }

    fn hash(&self, kind: MessageKind) -> String {
        match self.has_hashes {
            true => format!("RIHS01_{}", kind.hash),
            false => "TypeHashNotSupported".to_owned(),
        }
    }
}

/// A name as one part of a key.
fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::ros2::{POSE_STAMPED, TF_MESSAGE};

    fn names() -> Names {
        Names { has_hashes: true, ..Names::new(3, "aac3178e146ba6f1fc6e6a4085e77f21", "city3d") }
    }

    #[test]
    fn keys_and_tokens_have_the_form_of_rmw_zenoh() {
        let mut names = names();
        let pose = "geometry_msgs::msg::dds_::PoseStamped_/RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8";
        assert_eq!(names.key("/vicon/car/car", POSE_STAMPED), format!("3/vicon/car/car/{pose}"));
        let session = "@ros2_lv/3/aac3178e146ba6f1fc6e6a4085e77f21";
        assert_eq!(names.node(), format!("{session}/0/0/NN/%/%/city3d"));
        let offer = Offer { window: 10, is_latched: false };
        let endpoint = names.endpoint(EndpointKind::Publisher, "/vicon/car/car", POSE_STAMPED, offer);
        let token = format!("{session}/0/1/MP/%/%/city3d/%vicon%car%car/{pose}/::,10:,:,:,,");
        assert_eq!(endpoint.token, token);
        let latched = Offer { window: 1, is_latched: true };
        let endpoint = names.endpoint(EndpointKind::Subscriber, "/tf_static", TF_MESSAGE, latched);
        assert!(
            endpoint.token.contains("/0/2/MS/%/%/city3d/%tf_static/tf2_msgs::msg::dds_::TFMessage_/RIHS01_")
        );
        assert!(endpoint.token.ends_with("/:1:,1:,:,:,,"));
    }

    #[test]
    fn humble_has_no_hashes() {
        let names = Names { has_hashes: false, ..names() };
        assert!(names.key("/clock", city3d_protocol::ros2::CLOCK).ends_with("/TypeHashNotSupported"));
    }
}
