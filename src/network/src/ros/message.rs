//! ROS 1 messages and their TCPROS serialisation.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Type of a ROS message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageType {
    /// Package and name.
    pub name: &'static str,
    /// MD5 sum of the definition.
    pub md5sum: &'static str,
    /// Definition of the type, followed by those of its fields' types.
    pub definition: &'static str,
}

/// Decoding error of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum MessageError {
    /// The bytes end within a field.
    #[error("the message ends early")]
    Torn,
    /// So many bytes follow the last field.
    #[error("{0} bytes too many")]
    Long(usize),
    /// A string field is not UTF-8.
    #[error("a text is not UTF-8")]
    Text,
}

/// A message that can be encoded and decoded; its JSON has the field names of the definition.
pub trait RosMessage: Sized + Serialize + DeserializeOwned {
    /// Name, MD5 sum and definition, as peers compare them.
    const TYPE: MessageType;

    /// Appends the encoded fields to a buffer, without a length prefix.
    fn write(&self, out: &mut Vec<u8>);

    /// Reads the fields of one message; bytes may follow.
    ///
    /// # Errors
    /// [`MessageError`]
    fn read(from: &mut MessageReader<'_>) -> Result<Self, MessageError>;

    /// Decodes the bytes of one message.
    ///
    /// # Errors
    /// When the bytes are not exactly one message of this type.
    fn decode(bytes: &[u8]) -> Result<Self, MessageError> {
        let mut from = MessageReader(bytes);
        let message = Self::read(&mut from)?;
        if from.0.is_empty() { Ok(message) } else { Err(MessageError::Long(from.0.len())) }
    }
}

/// Reads the fields of an encoded message.
#[derive(Debug)]
pub struct MessageReader<'a>(&'a [u8]);

impl<'a> MessageReader<'a> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], MessageError> {
        let (taken, rest) = self.0.split_first_chunk().ok_or(MessageError::Torn)?;
        self.0 = rest;
        Ok(*taken)
    }

    pub(super) fn u8(&mut self) -> Result<u8, MessageError> {
        self.take().map(|[byte]| byte)
    }

    pub(super) fn u32(&mut self) -> Result<u32, MessageError> {
        self.take().map(u32::from_le_bytes)
    }

    pub(super) fn f64(&mut self) -> Result<f64, MessageError> {
        self.take().map(f64::from_le_bytes)
    }

    /// Reads bytes with a length prefix.
    pub(super) fn bytes(&mut self) -> Result<&'a [u8], MessageError> {
        let length = self.u32()? as usize;
        let (bytes, rest) = self.0.split_at_checked(length).ok_or(MessageError::Torn)?;
        self.0 = rest;
        Ok(bytes)
    }

    pub(super) fn text(&mut self) -> Result<&'a str, MessageError> {
        std::str::from_utf8(self.bytes()?).map_err(|_| MessageError::Text)
    }
}

fn write_text(out: &mut Vec<u8>, text: &str) {
    write_bytes(out, text.as_bytes());
}

pub(super) fn write_bytes(out: &mut Vec<u8>, bytes: &[u8]) {
    out.extend((bytes.len() as u32).to_le_bytes());
    out.extend(bytes);
}

/// Time in ROS: `time` of ROS 1, `builtin_interfaces/Time` of ROS 2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds since the epoch or, for simulated time, since its start.
    #[serde(alias = "sec")]
    pub secs: u32,
    /// Nanoseconds after the whole second.
    #[serde(alias = "nanosec")]
    pub nsecs: u32,
}

impl Time {
    /// From seconds since the epoch or, for simulated time, since its start.
    pub fn from_seconds(seconds: f64) -> Self {
        let nanoseconds = (seconds.max(0.0) * 1e9).round() as u64;
        Self {
            secs: u32::try_from(nanoseconds / 1_000_000_000).unwrap_or(u32::MAX),
            nsecs: (nanoseconds % 1_000_000_000) as u32,
        }
    }

    /// Seconds with their fraction.
    pub fn seconds(self) -> f64 {
        f64::from(self.secs) + f64::from(self.nsecs) * 1e-9
    }

    fn write(self, out: &mut Vec<u8>) {
        out.extend(self.secs.to_le_bytes());
        out.extend(self.nsecs.to_le_bytes());
    }

    fn read(from: &mut MessageReader<'_>) -> Result<Self, MessageError> {
        Ok(Self { secs: from.u32()?, nsecs: from.u32()? })
    }
}

/// `std_msgs/Header`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Absent in ROS 2.
    #[serde(default)]
    pub seq: u32,
    /// When the data were measured.
    pub stamp: Time,
    /// Name of the coordinate frame of the data.
    pub frame_id: String,
}

impl Header {
    pub(super) fn write(&self, out: &mut Vec<u8>) {
        out.extend(self.seq.to_le_bytes());
        self.stamp.write(out);
        write_text(out, &self.frame_id);
    }

    pub(super) fn read(from: &mut MessageReader<'_>) -> Result<Self, MessageError> {
        Ok(Self { seq: from.u32()?, stamp: Time::read(from)?, frame_id: from.text()?.to_owned() })
    }
}

/// `geometry_msgs/Vector3`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    /// Component along the x axis, metres in a translation.
    pub x: f64,
    /// Component along the y axis, likewise.
    pub y: f64,
    /// Component along the z axis, likewise.
    pub z: f64,
}

/// `geometry_msgs/Quaternion`; a rotation has norm 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// First component of the vector part.
    pub x: f64,
    /// Second component of the vector part.
    pub y: f64,
    /// Third component of the vector part.
    pub z: f64,
    /// Scalar part.
    pub w: f64,
}

/// `geometry_msgs/Transform`: pose of a child frame in its parent frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Transform {
    /// Origin of the child frame in the parent frame, metres.
    pub translation: Vector3,
    /// Parent from child.
    pub rotation: Quaternion,
}

/// `geometry_msgs/TransformStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TransformStamped {
    /// Stamp, and name of the parent frame.
    pub header: Header,
    /// Name of the child frame.
    pub child_frame_id: String,
    /// Parent from child.
    pub transform: Transform,
}

/// `tf2_msgs/TFMessage`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TfMessage {
    /// Transforms between pairs of frames, each with its own stamp.
    pub transforms: Vec<TransformStamped>,
}

/// `rosgraph_msgs/Clock`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ClockMessage {
    /// Simulated time.
    pub clock: Time,
}

/// Separator before the definition of a nested type.
macro_rules! next_message {
    ($name:literal) => {
        concat!(
            "================================================================================\nMSG: ",
            $name,
            "\n"
        )
    };
}

macro_rules! header {
    () => {
        concat!(next_message!("std_msgs/Header"), "uint32 seq\ntime stamp\nstring frame_id\n")
    };
}

pub(super) use {header, next_message};

macro_rules! transform_stamped {
    () => {
        concat!(
            "Header header\nstring child_frame_id\nTransform transform\n",
            header!(),
            next_message!("geometry_msgs/Transform"),
            "Vector3 translation\nQuaternion rotation\n",
            next_message!("geometry_msgs/Vector3"),
            "float64 x\nfloat64 y\nfloat64 z\n",
            next_message!("geometry_msgs/Quaternion"),
            "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
        )
    };
}

impl RosMessage for TransformStamped {
    const TYPE: MessageType = MessageType {
        name: "geometry_msgs/TransformStamped",
        md5sum: "b5764a33bfeb3588febc2682852579b0",
        definition: transform_stamped!(),
    };

    fn write(&self, out: &mut Vec<u8>) {
        self.header.write(out);
        write_text(out, &self.child_frame_id);
        let (p, q) = (self.transform.translation, self.transform.rotation);
        [p.x, p.y, p.z, q.x, q.y, q.z, q.w].into_iter().for_each(|number| out.extend(number.to_le_bytes()));
    }

    fn read(from: &mut MessageReader<'_>) -> Result<Self, MessageError> {
        let (header, child_frame_id) = (Header::read(from)?, from.text()?.to_owned());
        let translation = Vector3 { x: from.f64()?, y: from.f64()?, z: from.f64()? };
        let rotation = Quaternion { x: from.f64()?, y: from.f64()?, z: from.f64()?, w: from.f64()? };
        Ok(Self { header, child_frame_id, transform: Transform { translation, rotation } })
    }
}

impl RosMessage for TfMessage {
    const TYPE: MessageType = MessageType {
        name: "tf2_msgs/TFMessage",
        md5sum: "94810edda583a504dfda3829e70d7eec",
        definition: concat!(
            "geometry_msgs/TransformStamped[] transforms\n",
            next_message!("geometry_msgs/TransformStamped"),
            transform_stamped!(),
        ),
    };

    fn write(&self, out: &mut Vec<u8>) {
        out.extend((self.transforms.len() as u32).to_le_bytes());
        self.transforms.iter().for_each(|transform| transform.write(out));
    }

    fn read(from: &mut MessageReader<'_>) -> Result<Self, MessageError> {
        // No allocation in advance: the stated count may exceed the data.
        let transforms = (0..from.u32()?).map(|_| TransformStamped::read(from)).collect::<Result<_, _>>()?;
        Ok(Self { transforms })
    }
}

impl RosMessage for ClockMessage {
    const TYPE: MessageType = MessageType {
        name: "rosgraph_msgs/Clock",
        md5sum: "a9c97c1d230cfc112e270351a944ee47",
        definition: "time clock\n",
    };

    fn write(&self, out: &mut Vec<u8>) {
        self.clock.write(out);
    }

    fn read(from: &mut MessageReader<'_>) -> Result<Self, MessageError> {
        Ok(Self { clock: Time::read(from)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn transform(seq: u32) -> TransformStamped {
        TransformStamped {
            header: Header {
                seq,
                stamp: Time { secs: 12, nsecs: 340_000_000 },
                frame_id: "/vicon/world".to_owned(),
            },
            child_frame_id: "vicon/a/a".to_owned(),
            transform: Transform {
                translation: Vector3 { x: 1.5, y: -2.0, z: 0.0 },
                rotation: Quaternion { x: 0.0, y: 0.0, z: 0.6, w: 0.8 },
            },
        }
    }

    #[test]
    fn messages_come_back_as_they_were() {
        let message = TfMessage { transforms: vec![transform(7), transform(8)] };
        let mut bytes = Vec::new();
        message.write(&mut bytes);
        assert_eq!(TfMessage::decode(&bytes), Ok(message));
        assert_eq!(TfMessage::decode(&bytes[..bytes.len() - 1]), Err(MessageError::Torn));
        bytes.push(0);
        assert_eq!(TfMessage::decode(&bytes), Err(MessageError::Long(1)));
    }

    proptest! {
        #[test]
        fn no_bytes_are_too_strange(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            // Any input is decoded or refused, without a panic.
            let _ = TransformStamped::decode(&bytes);
            let _ = TfMessage::decode(&bytes);
        }
    }

    #[test]
    fn seconds_keep_their_nanoseconds() {
        assert_eq!(Time::from_seconds(12.34), Time { secs: 12, nsecs: 340_000_000 });
        assert_eq!(Time::from_seconds(0.999_999_999_9), Time { secs: 1, nsecs: 0 });
        assert_eq!(Time::from_seconds(-1.0), Time::default());
        assert!((Time::from_seconds(12.34).seconds() - 12.34).abs() < 1e-9);
    }
}
