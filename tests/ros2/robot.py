"""A simulated robot on ROS 2 topics: it follows the commands of forward command controllers and publishes its joint states
and, with `images`, those of its cameras. It runs until it is ended, and then prints what it was told as JSON.

robot.py DOMAIN [images]
"""

import json
import math
import signal
import sys
import time

from messages import Float64MultiArray, Header, Image, JointState, Time
from peer import Peer, take

ARM = [f"joint_{joint}" for joint in range(1, 8)]
SERVOS = ["thumb", "index", "middle", "ring", "little", "opposition"]
LONG_DIGITS = ["index", "middle", "ring", "little"]
CAMERAS = [f"{digit}_{phalanx}" for digit in LONG_DIGITS for phalanx in ["proximal", "middle", "distal"]]
CAMERAS += ["thumb_metacarpal", "thumb_proximal", "thumb_distal", "palm_ulnar_0", "palm_ulnar_1", "palm_radial"]
# The home posture of the arm, rad.
HOME = [0.0, 0.26, 3.14, -2.27, 0.0, 0.96, 1.57]
RATE = 200.0
# Speed with which a joint follows its goal, rad/s.
ARM_SPEED, SERVO_SPEED = 1.5, 8.0
# Torque of the spring that opens a digit, N m/rad, and the angle at which its closed stop is, rad.
SPRING, STOP = 0.02, 3.5

# States between two images; the cameras take turns, because Python takes long to encode an image.
IMAGE_INTERVAL = 8

peer = Peer(int(sys.argv[1]))
states = peer.publish("/joint_states", JointState)
cameras = CAMERAS if sys.argv[2:] == ["images"] else []
images = [peer.publish(f"/tactile/{name}/image_raw", Image, reliable=False, depth=1) for name in cameras]
arm_commands = peer.subscribe("/arm_position_controller/commands", Float64MultiArray)
positions = peer.subscribe("/hand_position_controller/commands", Float64MultiArray)
efforts = peer.subscribe("/hand_effort_controller/commands", Float64MultiArray)

arm, arm_goal = list(HOME), list(HOME)
servos, servo_goal, limit = [0.0] * 6, [0.0] * 6, [0.0] * 6
told = {"arm": 0, "positions": 0, "efforts": 0, "largest_step": 0.0, "largest_effort": 0.0}
running = True


def stop(*_):
    global running
    running = False


signal.signal(signal.SIGTERM, stop)
signal.signal(signal.SIGINT, stop)


def stamp():
    now = time.time_ns()
    return Time(now // 1_000_000_000, now % 1_000_000_000)


def toward(value, goal, reach):
    return value + max(-reach, min(reach, goal - value))


last = time.monotonic()
count = 0
while running:
    now = time.monotonic()
    dt, last = min(now - last, 0.05), now
    for message in take(arm_commands):
        step = max(abs(new - old) for new, old in zip(message.data, arm_goal))
        told["largest_step"] = max(told["largest_step"], step)
        arm_goal = list(message.data)
        told["arm"] += 1
    for message in take(efforts):
        limit = list(message.data)
        told["efforts"] += 1
        told["largest_effort"] = max(told["largest_effort"], *limit)
    for message in take(positions):
        servo_goal = list(message.data)
        told["positions"] += 1
    before, servos_before = list(arm), list(servos)
    arm = [toward(value, goal, ARM_SPEED * dt) for value, goal in zip(arm, arm_goal)]
    # A servo without torque is opened by its spring; with torque it winds as far as the torque lasts.
    reach = [min(goal, torque / SPRING, STOP) for goal, torque in zip(servo_goal, limit)]
    servos = [toward(value, goal, SERVO_SPEED * dt) for value, goal in zip(servos, reach)]
    speed = [(new - old) / max(dt, 1e-3) for new, old in zip(arm + servos, before + servos_before)]
    torque = [0.0] * 7 + [min(SPRING * angle, torque) for angle, torque in zip(servos, limit)]
    states.write(JointState(Header(stamp(), ""), ARM + SERVOS, arm + servos, speed, torque))
    count += 1
    if images and count % IMAGE_INTERVAL == 0:
        turn = count // IMAGE_INTERVAL % len(images)
        pixels = bytes([10 * turn, 128, 90]) * (240 * 240)
        images[turn].write(Image(Header(stamp(), f"camera_{cameras[turn]}"), 240, 240, "bgr8", 0, 720, pixels))
    time.sleep(max(0.0, 1.0 / RATE - (time.monotonic() - now)))
told["states"] = count
told["arm_moved"] = math.dist(arm, HOME)
print(json.dumps(told))
