//! Tells the name of the node and its topics (`rmw_dds_common/ParticipantEntitiesInfo` on `ros_discovery_info`), so that
//! `ros2 node list` and `ros2 topic info -v` show them.

use super::RawWriter;
use city3d_protocol::cdr::CdrWriter;

pub(super) const TOPIC: &str = "ros_discovery_info";
pub(super) const TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";

/// Identifier of DDS of a participant, a reader or a writer.
type Guid = [u8; 16];

/// Bytes of a `Gid`; the first 16 of them are the identifier of DDS.
fn gid_bytes() -> usize {
    // Iron and later have 16.
    if std::env::var("ROS_DISTRO").is_ok_and(|name| name == "humble") { 24 } else { 16 }
}

/// The node with its readers and writers.
pub(super) struct NodeGraph {
    name: String,
    gid_bytes: usize,
    by: Option<(Guid, RawWriter)>,
    readers: Vec<Guid>,
    writers: Vec<Guid>,
}

impl NodeGraph {
    pub(super) fn new(name: &str) -> Self {
        let (readers, writers) = (Vec::new(), Vec::new());
        Self { name: name.to_owned(), gid_bytes: gid_bytes(), by: None, readers, writers }
    }

    /// Sets the participant and its writer of the topic.
    pub(super) fn publish_by(&mut self, participant: Guid, writer: RawWriter) {
        self.by = Some((participant, writer));
    }

    pub(super) fn add_reader(&mut self, reader: Guid) {
        self.readers.push(reader);
    }

    pub(super) fn add_writer(&mut self, writer: Guid) {
        self.writers.push(writer);
    }

    pub(super) fn remove_writer(&mut self, writer: Guid) {
        self.writers.retain(|other| *other != writer);
    }

    /// Publishes the present state.
    pub(super) fn announce(&self) {
        let Some((participant, writer)) = &self.by else { return };
        let mut cdr = CdrWriter::reusing(Vec::new());
        self.write_gid(&mut cdr, participant);
        cdr.u32(1);
        cdr.string("/");
        cdr.string(&self.name);
        for endpoints in [&self.readers, &self.writers] {
            cdr.u32(endpoints.len() as u32);
            endpoints.iter().for_each(|endpoint| self.write_gid(&mut cdr, endpoint));
        }
        if writer.write(cdr.into_bytes().into(), None).is_err() {
            tracing::debug!("the topics of the node are not told: too many changes at once");
        }
    }

    fn write_gid(&self, cdr: &mut CdrWriter, of: &Guid) {
        (0..self.gid_bytes).for_each(|k| cdr.u8(of.get(k).copied().unwrap_or(0)));
    }
}
