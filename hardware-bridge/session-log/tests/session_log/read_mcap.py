"""Reads a session with other people's packages (mcap, mcap-protobuf-support) and prints what is in it as JSON."""

import hashlib
import json
import struct
import sys

from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

path, finished = sys.argv[1], sys.argv[2] == "finished"
topics, arm, servo_angle, images, raw, log_times = {}, [], [], [], [], []
cut, files, pixels = False, {}, {}
with open(path, "rb") as file:
    factories = [DecoderFactory()]
    reader = make_reader(file, decoder_factories=factories) if finished else NonSeekingReader(
        file, decoder_factories=factories
    )
    try:
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            topics[channel.topic] = topics.get(channel.topic, 0) + 1
            log_times.append(message.log_time)
            if channel.topic in ("configuration", "calibration", "task"):
                files[channel.topic] = hashlib.sha256(message.data).hexdigest()
                continue
            if schema is None:
                raw.append(message.data.hex())
                continue
            decoded = factories[0].decoder_for(channel.message_encoding, schema)(message.data)
            if channel.topic == "command/sent":
                arm.append([value.hex() for value in decoded.arm])
                servo_angle.append(list(decoded.servo_angle))
            if channel.topic == "observation":
                for frame in decoded.tactile:
                    if frame.rgb:
                        pixels[frame.camera] = frame.rgb
                    elif frame.rgb_change:
                        both = zip(pixels[frame.camera], frame.rgb_change, strict=True)
                        pixels[frame.camera] = bytes((one + change) % 256 for one, change in both)
                    images.append(pixels[frame.camera].hex())
    except (EndOfFile, struct.error):  # 1.6.0 raises either, by where in a record the file ends
        cut = True

found = {"topics": topics, "arm": arm, "images": images, "raw": raw, "sorted": log_times == sorted(log_times), "cut": cut}
if finished:
    with open(path, "rb") as file:
        reader = make_reader(file)
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        found["session"] = metadata["session"]
        found["files"] = files
        found["statistics"] = reader.get_summary().statistics.message_count
json.dump(found, sys.stdout)
