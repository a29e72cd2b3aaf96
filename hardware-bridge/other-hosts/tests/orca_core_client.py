"""Drives the emulated servos with the ORCA hand's own client (PyPI orca_core): argument is the port. Prints "all good" or fails an assertion."""

import sys
import time

import dynamixel_sdk.port_handler
import numpy as np
from orca_core.hardware.dynamixel_client import DynamixelClient

# Twice this, in ms, is how long the SDK below it waits for an answer: the emulator may share its processor with other tests.
dynamixel_sdk.port_handler.LATENCY_TIMER = 250

IDS = [1, 2, 3, 4, 5, 6]
CURRENT_BASED_POSITION = 5

hand = DynamixelClient(IDS, port=sys.argv[1], baudrate=3_000_000)
hand.connect()
assert sorted(hand.responding_motor_ids()) == IDS
hand.set_operating_mode(IDS, CURRENT_BASED_POSITION)
hand.set_torque_enabled(IDS, True)
hand.write_desired_current(IDS, np.full(6, 90.0))
start = np.array(hand.read_position_velocity_current()[0])
hand.write_desired_pos(IDS, start + 0.8)
deadline = time.monotonic() + 20
while True:
    position = np.array(hand.read_position_velocity_current()[0])
    if np.all(np.abs(position - start - 0.8) < 0.1):
        break
    assert time.monotonic() < deadline, f"went from {start} to {position}"
    time.sleep(0.05)
temperature = np.array(hand.read_temperature())
assert np.all((temperature > 10) & (temperature < 70)), temperature
hand.set_torque_enabled(IDS, False)
hand.disconnect()
print("all good")
