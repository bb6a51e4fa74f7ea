"""Motion capture of one physical vehicle over Zenoh, as ros2_measure.py does it over DDS, with garbage on the same keys.
Arguments: the domain, name of the vehicle, where it begins (x, y), metres per second eastwards, seconds, and the name of a
virtual vehicle, whose trajectory lets the experiment begin; it stands at its place."""

import sys
import time

from zenoh_speaker import STORE, Publisher, header, key, session

domain, name, (x, y, speed, seconds), other = sys.argv[1], sys.argv[2], map(float, sys.argv[3:7]), sys.argv[7]
POSE, TRAJECTORY = "geometry_msgs/msg/PoseStamped", "trajectory_msgs/msg/MultiDOFJointTrajectory"
of = STORE.types
zenoh, seen = session(), []
zenoh.declare_subscriber(key(domain, f"vicon/{other}/{other}", POSE),
                         lambda sample: seen.append(STORE.deserialize_cdr(sample.payload.to_bytes(), POSE).pose))
poses = Publisher(zenoh, domain, f"vicon/{name}/{name}", POSE)
trajectories = Publisher(zenoh, domain, "city3d/trajectory", TRAJECTORY)
begun = time.monotonic()
while not seen and time.monotonic() - begun < 10:
    time.sleep(0.1)
for garbage in (b"", b"\0", b"\0\1\0\0", b"\0\0\0\0" + bytes(80), b"\0\1\0\0" + b"\xff" * 80, bytes(2 << 20)):
    poses.publisher.put(garbage)
    trajectories.publisher.put(garbage)
begun, sent = time.monotonic(), 0
while (now := time.monotonic() - begun) < seconds:
    pose = of["geometry_msgs/msg/Pose"](
        position=of["geometry_msgs/msg/Point"](x=x + speed * now, y=y, z=0.0),
        orientation=of["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0))
    poses.put(of[POSE](header=header(time.time()), pose=pose))
    if seen and sent % 50 == 0:
        place = seen[-1]
        transform = of["geometry_msgs/msg/Transform"](
            translation=of["geometry_msgs/msg/Vector3"](x=place.position.x, y=place.position.y, z=0.0),
            rotation=place.orientation)
        point = of["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"](
            transforms=[transform], velocities=[], accelerations=[],
            time_from_start=of["builtin_interfaces/msg/Duration"](sec=0, nanosec=0))
        trajectories.put(of[TRAJECTORY](header=header(time.time()), joint_names=[other], points=[point]))
    sent += 1
    time.sleep(max(0.0, begun + 0.01 * sent - time.monotonic()))
print(f"{sent} poses of {name}; {other} is {'heard' if seen else 'not heard'}")
zenoh.close()
