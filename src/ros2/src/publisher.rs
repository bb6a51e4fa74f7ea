//! Publishes instants and pictures: the topics of a node, made as vehicles come and withdrawn as they go.

use crate::Ros2Error;
use crate::middleware::{Middleware, Offer, TopicPublisher};
use crate::options::{Ros2Options, VehicleTopics};
use city3d_network::link::exchange::{CameraShows, OnboardCamera, OnboardPicture, PictureForm, Subject};
use city3d_protocol::cdr::CdrWriter;
use city3d_protocol::ros2::{
    CAMERA_INFO, CLOCK, COMPRESSED_IMAGE, IMAGE, POSE_STAMPED, Pixels, Pose, Stamp, TF_MESSAGE,
    TRANSFORM_STAMPED, write_camera_info, write_clock, write_compressed_image, write_image, write_pose,
    write_transform, write_transforms,
};
use city3d_protocol::wire::{Measurement, vicon_frame};
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Frames of ros2-vicon-receiver: the world, and motion capture's origin in it.
const WORLD: &str = "map";
const VICON: &str = "vicon";

/// A reader that does not acknowledge any more counts as gone after its lease, which is 20 s and less in ROS 2. Until then
/// it must not hold others up: so many instants come in 40 s at 100 Hz.
const POSES: Offer = Offer { window: 4096, is_latched: false };
const TRANSFORMS: Offer = Offer { window: 2048, is_latched: false };
const STATIC: Offer = Offer { window: 16, is_latched: true };
const PICTURES: Offer = Offer { window: 64, is_latched: false };

/// Topic of a vehicle.
pub(crate) fn vehicle_topic(name: &str) -> String {
    format!("/{}", vicon_frame(name))
}

/// Frame of a vehicle.
fn vehicle_frame(name: &str) -> String {
    format!("{name}_{name}")
}

/// Poses of all subjects at one instant.
#[derive(Clone, Debug)]
pub(crate) struct PoseFrame {
    pub(crate) stamp: Stamp,
    /// Whether its stamp differs from the one before: tf rejects repeated stamps.
    pub(crate) is_later: bool,
    /// In id order.
    pub(crate) subjects: Arc<Vec<Subject>>,
    /// Poses of the visible subjects, laboratory metres.
    pub(crate) poses: Vec<Measurement>,
}

/// What was handed on, and what was dropped because subscribers were too slow.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Published {
    pub(crate) messages: u64,
    pub(crate) slow: u64,
}

struct VehicleTopic {
    frame: String,
    publisher: Box<dyn TopicPublisher>,
}

struct CameraTopics {
    frame: String,
    image: Box<dyn TopicPublisher>,
    info: Box<dyn TopicPublisher>,
}

/// The topics that a node publishes.
pub(crate) struct PublishedTopics {
    vehicle_topics: VehicleTopics,
    subjects: Arc<Vec<Subject>>,
    vehicles: BTreeMap<String, VehicleTopic>,
    tf: Option<Box<dyn TopicPublisher>>,
    tf_static: Option<Box<dyn TopicPublisher>>,
    clock: Option<Box<dyn TopicPublisher>>,
    cameras: Vec<CameraTopics>,
    pub(crate) published: Published,
}

impl PublishedTopics {
    /// Advertises what does not depend on the vehicles.
    pub(crate) fn new(middleware: &mut dyn Middleware, options: &Ros2Options) -> Result<Self, Ros2Error> {
        let mut only_if = |wanted: bool, topic: &str, kind, offer| {
            wanted.then(|| middleware.publisher(topic, kind, offer)).transpose()
        };
        let tf = only_if(options.has_tf, "/tf", TF_MESSAGE, TRANSFORMS)?;
        let tf_static = only_if(options.has_tf, "/tf_static", TF_MESSAGE, STATIC)?;
        let clock = only_if(options.has_clock, "/clock", CLOCK, POSES)?;
        let camera = |camera| advertise_camera(middleware, camera, options.picture_form);
        let cameras = options.cameras.iter().map(camera).collect::<Result<_, _>>()?;
        let mut topics = Self {
            vehicle_topics: options.vehicle_topics,
            subjects: Arc::default(),
            vehicles: BTreeMap::new(),
            tf,
            tf_static,
            clock,
            cameras,
            published: Published::default(),
        };
        topics.publish_static();
        Ok(topics)
    }

    /// The world and motion capture have one origin here.
    fn publish_static(&mut self) {
        let here = Pose { position: DVec3::ZERO, orientation: DQuat::IDENTITY };
        let write = |cdr: &mut CdrWriter| {
            write_transforms(cdr, (Stamp::default(), WORLD), [(VICON, here)].into_iter());
        };
        publish(self.tf_static.as_deref_mut(), &mut self.published, write);
    }

    /// Advertises the topics of new subjects, and withdraws those of subjects that are gone.
    fn update(&mut self, middleware: &mut dyn Middleware, subjects: &Arc<Vec<Subject>>) {
        if Arc::ptr_eq(&self.subjects, subjects) {
            return;
        }
        self.subjects = Arc::clone(subjects);
        let gone: Vec<String> = self
            .vehicles
            .keys()
            .filter(|name| !subjects.iter().any(|subject| subject.name == **name))
            .cloned()
            .collect();
        for name in gone {
            if let Some(topic) = self.vehicles.remove(&name) {
                middleware.withdraw(topic.publisher);
            }
        }
        let kind = match self.vehicle_topics {
            VehicleTopics::Poses => POSE_STAMPED,
            VehicleTopics::Transforms => TRANSFORM_STAMPED,
        };
        for Subject { name, .. } in &**subjects {
            if self.vehicles.contains_key(name) {
                continue;
            }
            match middleware.publisher(&vehicle_topic(name), kind, POSES) {
                Ok(publisher) => {
                    let topic = VehicleTopic { frame: vehicle_frame(name), publisher };
                    self.vehicles.insert(name.clone(), topic);
                }
                Err(error) => tracing::warn!("the poses of {name} are not published: {error}"),
            }
        }
        middleware.announce();
    }

    /// Publishes an instant.
    pub(crate) fn publish_frame(&mut self, middleware: &mut dyn Middleware, frame: &PoseFrame) {
        self.update(middleware, &frame.subjects);
        let Self { vehicles, published, tf, clock, .. } = self;
        publish(clock.as_deref_mut(), published, |cdr| write_clock(cdr, frame.stamp));
        let name_of = |pose: &Measurement| {
            let at = frame.subjects.binary_search_by_key(&pose.vehicle, |subject| subject.vehicle).ok()?;
            Some(&frame.subjects[at].name)
        };
        let mut children = Vec::new();
        for measured in &frame.poses {
            let Some(topic) = name_of(measured).and_then(|name| vehicles.get_mut(name)) else { continue };
            let pose = Pose::of(measured);
            publish(Some(&mut *topic.publisher), published, |cdr| match self.vehicle_topics {
                VehicleTopics::Poses => write_pose(cdr, (frame.stamp, WORLD), &pose),
                VehicleTopics::Transforms => write_transform(cdr, (frame.stamp, VICON), &topic.frame, &pose),
            });
            if tf.is_some() {
                children.push((topic.frame.clone(), pose));
            }
        }
        if frame.is_later && !children.is_empty() {
            let children = children.iter().map(|(child, pose)| (child.as_str(), *pose));
            publish(tf.as_deref_mut(), published, |cdr| {
                write_transforms(cdr, (frame.stamp, VICON), children);
            });
        }
    }

    /// Whether the pictures of each camera have subscribers.
    pub(crate) fn wanted(&mut self) -> impl Iterator<Item = bool> {
        self.cameras.iter_mut().map(|camera| camera.image.has_subscribers() | camera.info.has_subscribers())
    }

    /// Publishes a picture, with intrinsics and extrinsics of its camera.
    pub(crate) fn publish_picture(&mut self, picture: &OnboardPicture) {
        let Self { cameras, published, tf, .. } = self;
        let Some(camera) = cameras.get_mut(picture.camera) else { return };
        let stamp = Stamp::from_seconds(picture.stamp_s);
        let header = (stamp, camera.frame.as_str());
        publish(Some(&mut *camera.image), published, |cdr| match picture.form {
            PictureForm::Png => {
                write_compressed_image(cdr, header, "rgb8; png compressed bgr8", &picture.bytes);
            }
            PictureForm::Jpeg => {
                write_compressed_image(cdr, header, "rgb8; jpeg compressed bgr8", &picture.bytes);
            }
            PictureForm::Rgb8 => write_pixels(cdr, header, picture, ("rgb8", 3)),
            PictureForm::Depth => write_pixels(cdr, header, picture, ("32FC1", 4)),
            PictureForm::Classes => write_pixels(cdr, header, picture, ("8UC1", 1)),
        });
        publish(Some(&mut *camera.info), published, |cdr| {
            write_camera_info(cdr, header, picture.extent, picture.pinhole);
        });
        let pose = Pose { position: picture.position, orientation: picture.orientation };
        let child = [(camera.frame.as_str(), pose)].into_iter();
        publish(tf.as_deref_mut(), published, |cdr| write_transforms(cdr, (stamp, VICON), child));
    }
}

fn write_pixels(
    cdr: &mut CdrWriter,
    header: (Stamp, &str),
    picture: &OnboardPicture,
    (encoding, pixel_bytes): (&str, u32),
) {
    let (extent, bytes) = (picture.extent, &picture.bytes);
    write_image(cdr, header, &Pixels { extent, encoding, pixel_bytes, bytes });
}

fn advertise_camera(
    middleware: &mut dyn Middleware,
    camera: &OnboardCamera,
    form: PictureForm,
) -> Result<CameraTopics, Ros2Error> {
    let is_file = camera.shows == CameraShows::Colour && matches!(form, PictureForm::Png | PictureForm::Jpeg);
    let (topic, kind) =
        if is_file { (camera.image_topic(), COMPRESSED_IMAGE) } else { (camera.raw_topic(), IMAGE) };
    Ok(CameraTopics {
        frame: camera.frame(),
        image: middleware.publisher(&topic, kind, PICTURES)?,
        info: middleware.publisher(&camera.info_topic(), CAMERA_INFO, PICTURES)?,
    })
}

/// Publishes a message, where there is a topic for it.
fn publish(
    publisher: Option<&mut (dyn TopicPublisher + 'static)>,
    published: &mut Published,
    write: impl FnOnce(&mut CdrWriter),
) {
    let Some(publisher) = publisher else { return };
    let mut cdr = CdrWriter::reusing(Vec::new());
    write(&mut cdr);
    match publisher.publish(cdr.into_bytes()) {
        true => published.messages += 1,
        false => published.slow += 1,
    }
}
