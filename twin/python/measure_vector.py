"""Steps per second of many ``ftac/PickOne-v1`` side by side with 17 images of 240 x 240, formed on the CPU and on a GPU.

The scripted pick-up is run, so that hand and object touch for part of the time; the time that the scripts take is left out, and that of an episode that begins
anew is not. Times are of the clock: leave the machine idle. Needs the packages ftac and gymnasium:

    python twin/python/measure_vector.py [STEPS] [ENVIRONMENTS]
"""

import os
import statistics
import sys
import time

import numpy as np

from ftac.scripted import Script
from ftac.vector import VectorPick

SKIPPED = 20
"""Steps before the first that counts: the hand is on its way."""


def measure(renderer: str, images: int | None, count: int, steps: int, jobs: int) -> tuple[float, float]:
    """Steps per second of all environments together in the mean, and the median time of a call (s)."""
    many = VectorPick(count, task="pick_one", images=images, renderer=renderer, jobs=jobs, max_episode_steps=SKIPPED + steps)
    observations, _ = many.reset(seed=1)
    scripts = [Script(env.features) for env in many.envs]
    spent = []
    for step in range(SKIPPED + steps):
        actions = [script.act({name: value[n] for name, value in observations.items()}) for n, script in enumerate(scripts)]
        begun = time.perf_counter()
        observations, *_ = many.step(np.array(actions, dtype=np.float32))
        if step >= SKIPPED:
            spent.append(time.perf_counter() - begun)
    return count * len(spent) / sum(spent), statistics.median(spent)


if __name__ == "__main__":
    asked = [int(word) for word in sys.argv[1:]]
    steps, count = asked[0] if asked else 60, asked[1] if len(asked) > 1 else 32
    cores = os.cpu_count() or 1
    print(f"{count} environments on {cores} cores, {steps} steps each")
    for renderer, images, jobs in [("cpu", None, cores), ("cpu", 240, cores), ("gpu", 240, cores), ("gpu", 240, 2 * cores)]:
        name = "no images" if images is None else f"images from the {renderer.upper()}"
        try:
            rate, median = measure(renderer, images, count, steps, jobs)
        except RuntimeError as error:
            print(f"{name}: LEFT OUT, {error}")
            continue
        pictures = "" if images is None else f", {17 * rate:.0f} images/s"
        print(f"{name}, {jobs} threads: {rate:.0f} steps/s{pictures}; a step of all in {1e3 * median:.0f} ms (median)", flush=True)
