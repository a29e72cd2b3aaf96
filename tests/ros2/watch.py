"""Subscribes to a published robot and checks what RViz needs. Prints the counts as JSON.

watch.py DOMAIN CAMERA
"""

import json
import sys
import xml.etree.ElementTree as xml

from messages import CameraInfo, Image, JointState, String, TFMessage
from peer import Peer, first

peer = Peer(int(sys.argv[1]))
camera = sys.argv[2]
readers = {
    "states": peer.subscribe("/joint_states", JointState),
    "transforms": peer.subscribe("/tf", TFMessage),
    "fixed": peer.subscribe("/tf_static", TFMessage, latched=True, depth=1),
    "description": peer.subscribe("/robot_description", String, latched=True, depth=1),
    "image": peer.subscribe(f"/tactile/{camera}/image_raw", Image),
    "info": peer.subscribe(f"/tactile/{camera}/camera_info", CameraInfo),
    "goals": peer.subscribe("/hand/servo_commands", JointState),
    # A subscriber of sensor data: best effort.
    "servos": peer.subscribe("/hand/servo_states", JointState, reliable=False, depth=5),
}
seen = {name: first(reader) for name, reader in readers.items()}

robot = xml.fromstring(seen["description"].data)
movable = {joint.get("name") for joint in robot.iter("joint") if joint.get("type") != "fixed"}
states = seen["states"]
assert set(states.name) == movable, set(states.name) ^ movable
assert len(states.position) == len(states.name) and all(abs(angle) < 7 for angle in states.position)
assert states.header.stamp.sec > 1_600_000_000

parents = {frame.child_frame_id: frame.header.frame_id for name in ["transforms", "fixed"] for frame in seen[name].transforms}
links = {link.get("name") for link in robot.iter("link")}
drawn = {link for link in links if link.endswith("_tube")}
assert set(parents) | {"world"} == links - drawn, (set(parents) | {"world"}) ^ (links - drawn)
for frame in seen["transforms"].transforms + seen["fixed"].transforms:
    rotation = frame.transform.rotation
    norm = sum(part * part for part in [rotation.x, rotation.y, rotation.z, rotation.w])
    assert abs(norm - 1) < 1e-9, frame


def root(frame):
    while frame in parents:
        frame = parents[frame]
    return frame


image, info = seen["image"], seen["info"]
assert (image.height, image.width, image.encoding, image.step) == (240, 240, "rgb8", 720), image.encoding
assert len(image.data) == 240 * 240 * 3 and len(set(image.data)) > 3
assert image.header.frame_id == info.header.frame_id == f"camera_{camera}"
assert root(image.header.frame_id) == "world"
assert (info.height, info.width, info.distortion_model) == (240, 240, "plumb_bob")
assert info.k[0] > 0 and info.k[2] == 119.5 and info.p[0] == info.k[0] and list(info.r)[::4] == [1.0, 1.0, 1.0]
assert seen["goals"].name == seen["servos"].name and len(seen["servos"].effort) == len(seen["servos"].name)
print(json.dumps({"joints": len(states.name), "frames": len(parents), "links": len(links)}))
