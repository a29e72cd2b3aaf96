#!/usr/bin/env python3
"""A vision system for `ftac trial --detector 127.0.0.1:PORT`, as an example: it sends the objects' places ten times a second.

    ftac bridge sheet 0 --json > places.json       # or a file of your own: {"objects": [{"object", "x_m", "y_m", "z_m", "turn_rad"}]}
    object_detector.py --port 7700 --sigma 0.002 places.json

Replace `measure` by your pose estimator. One JSON line a measurement: name, Unix time, frame (`table` or `arm_base`), position (m), quaternion
(x, y, z, w) and the covariance of x, y, z and the rotation vector (36 numbers, row by row); or name, time and `"hidden": true`.
"""

import argparse
import json
import math
import random
import socket
import time


def measure(places, sigma, generator):
    """Every object where the file has it, wrong by `sigma` (m)."""
    for place in places:
        turn = 0.5 * place["turn_rad"]
        variances = [sigma**2] * 3 + [0.02**2] * 3
        covariance = [variances[n // 6] if n % 7 == 0 else 0.0 for n in range(36)]
        yield {
            "object": place["object"],
            "time": time.time(),
            "frame": "table",
            "position": [place[axis] + generator.gauss(0.0, sigma) for axis in ("x_m", "y_m", "z_m")],
            "quaternion": [0.0, 0.0, math.sin(turn), math.cos(turn)],
            "covariance": covariance,
        }


def serve(client, places, sigma, generator):
    """Until the client goes."""
    while True:
        for measurement in measure(places, sigma, generator):
            client.sendall((json.dumps(measurement) + "\n").encode())
        time.sleep(0.1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("places", help="a JSON file of places")
    parser.add_argument("--port", type=int, default=7700)
    parser.add_argument("--sigma", type=float, default=0.002, help="standard deviation of x, y and z, m")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with open(options.places, encoding="utf-8") as file:
        places = json.load(file)["objects"]
    generator = random.Random(options.seed)
    with socket.create_server(("127.0.0.1", options.port)) as server:
        print(f"eyes on 127.0.0.1:{server.getsockname()[1]}", flush=True)
        while True:
            client, _ = server.accept()
            with client:
                try:
                    serve(client, places, options.sigma, generator)
                except OSError:
                    continue


if __name__ == "__main__":
    main()
