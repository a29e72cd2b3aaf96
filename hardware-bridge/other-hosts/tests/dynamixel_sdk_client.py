"""Drives the emulated servos with ROBOTIS' own SDK: argument is the port. Prints "all good" or fails an assertion."""

import sys
import time

import dynamixel_sdk.port_handler
from dynamixel_sdk import (
    COMM_SUCCESS,
    DXL_HIBYTE,
    DXL_HIWORD,
    DXL_LOBYTE,
    DXL_LOWORD,
    GroupBulkRead,
    GroupBulkWrite,
    GroupSyncRead,
    GroupSyncWrite,
    PacketHandler,
    PortHandler,
)

# Twice this, in ms, is how long the SDK waits for an answer: the emulator may share its processor with other tests.
dynamixel_sdk.port_handler.LATENCY_TIMER = 250

IDS = [1, 2, 3, 4, 5, 6]
OPERATING_MODE, TORQUE_ENABLE, GOAL_CURRENT, GOAL_POSITION, PRESENT_POSITION = 11, 64, 102, 116, 132
REGISTERED_INSTRUCTION, VOLTAGE, TEMPERATURE = 69, 144, 146

port = PortHandler(sys.argv[1])
assert port.openPort()
assert port.setBaudRate(3_000_000)
servos = PacketHandler(2.0)

for number in IDS:
    model, result, error = servos.ping(port, number)
    assert (model, result, error) == (1220, COMM_SUCCESS, 0), (number, model, result, error)
found, result = servos.broadcastPing(port)
assert sorted(found) == IDS, found

for number in IDS:
    assert servos.write1ByteTxRx(port, number, OPERATING_MODE, 5) == (COMM_SUCCESS, 0)
    assert servos.write1ByteTxRx(port, number, TORQUE_ENABLE, 1) == (COMM_SUCCESS, 0)
    result, error = servos.write1ByteTxRx(port, number, OPERATING_MODE, 3)
    assert (result, error) == (COMM_SUCCESS, 7), "EEPROM is locked while torque is on"
    assert servos.write2ByteTxRx(port, number, GOAL_CURRENT, 300) == (COMM_SUCCESS, 0)


def positions(fast):
    group = GroupSyncRead(port, servos, PRESENT_POSITION, 4)
    for number in IDS:
        assert group.addParam(number)
    result = group.fastSyncRead() if fast else group.txRxPacket()
    assert result == COMM_SUCCESS, servos.getTxRxResult(result)
    values = [group.getData(number, PRESENT_POSITION, 4) for number in IDS]
    return [value - 2**32 if value >= 2**31 else value for value in values]


start = positions(False)
group = GroupSyncWrite(port, servos, GOAL_POSITION, 4)
for number, at in zip(IDS, start):
    goal = (at + 400) & 0xFFFFFFFF
    words = (DXL_LOWORD(goal), DXL_HIWORD(goal))
    assert group.addParam(number, [part(word) for word in words for part in (DXL_LOBYTE, DXL_HIBYTE)])
assert group.txPacket() == COMM_SUCCESS

deadline = time.monotonic() + 5
while True:
    moved = [now - then for now, then in zip(positions(False), start)]
    if all(abs(distance - 400) < 60 for distance in moved):
        break
    assert time.monotonic() < deadline, moved
again = [now - then for now, then in zip(positions(True), start)]
assert all(abs(distance - 400) < 60 for distance in again), again

bulk = GroupBulkRead(port, servos)
for number in IDS:
    assert bulk.addParam(number, *((VOLTAGE, 2) if number % 2 else (TEMPERATURE, 1)))
assert bulk.txRxPacket() == COMM_SUCCESS
assert [bulk.getData(number, VOLTAGE, 2) for number in (1, 3, 5)] == [111] * 3
assert all(20 < bulk.getData(number, TEMPERATURE, 1) < 60 for number in (2, 4, 6))

bulk = GroupBulkWrite(port, servos)
assert bulk.addParam(1, GOAL_CURRENT, 2, [250, 0])
assert bulk.addParam(2, 65, 1, [1])
assert bulk.txPacket() == COMM_SUCCESS
assert servos.read2ByteTxRx(port, 1, GOAL_CURRENT) == (250, COMM_SUCCESS, 0)
assert servos.read1ByteTxRx(port, 2, 65) == (1, COMM_SUCCESS, 0)

assert servos.regWriteTxRx(port, 3, GOAL_CURRENT, 2, [240, 0]) == (COMM_SUCCESS, 0)
assert servos.read1ByteTxRx(port, 3, REGISTERED_INSTRUCTION) == (1, COMM_SUCCESS, 0)
assert servos.read2ByteTxRx(port, 3, GOAL_CURRENT) == (300, COMM_SUCCESS, 0)
# To all, because the SDK does not wait for the answer of a single servo.
assert servos.action(port, 254) == COMM_SUCCESS
assert servos.read2ByteTxRx(port, 3, GOAL_CURRENT) == (240, COMM_SUCCESS, 0)

assert servos.reboot(port, 6) == (COMM_SUCCESS, 0)
time.sleep(0.5)
value, result, error = servos.read1ByteTxRx(port, 6, TORQUE_ENABLE)
assert (value, result, error) == (0, COMM_SUCCESS, 0), "a reboot takes the torque away"
port.closePort()
print("all good")
