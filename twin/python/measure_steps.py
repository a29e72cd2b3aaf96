"""Steps per second of ``ftac/PickTwo-v1`` on one core: without images, with 17 of 64 x 64, and with 17 of 240 x 240; and, where gymnasium-robotics is
installed, of its Shadow hand with touch sensors on MuJoCo, which turns an egg.

The scripted pick-up of the first object is run, so that hand and object touch for most of the time. Times are of the processor, so that other work on the machine counts little. Prints a line for each size. Needs the
packages ftac and gymnasium:

    python twin/python/measure_steps.py [STEPS]
"""

import importlib.util
import os
import sys
import time

os.environ["RAYON_NUM_THREADS"] = "1"

import gymnasium  # noqa: E402

import ftac  # noqa: E402, F401
from ftac.scripted import Script  # noqa: E402


def measure(images: int | None, steps: int) -> float:
    """Steps per second over `steps` steps, resets left out."""
    env = gymnasium.make("ftac/PickTwo-v1", images=images).unwrapped
    spent, done, seed = 0.0, 0, 0
    while done < steps:
        observation, _ = env.reset(seed=seed)
        script = Script(env.features)
        for _ in range(min(200, steps - done)):
            action = script.act(observation)
            begun = time.process_time()
            observation, _, over, _, _ = env.step(action)
            spent += time.process_time() - begun
            done += 1
            if over:
                break
        seed += 1
    return done / spent


def measure_shadow(steps: int) -> tuple[float, float]:
    """The same of the Shadow hand with random actions, and the length of its step, s."""
    import gymnasium_robotics

    gymnasium.register_envs(gymnasium_robotics)
    env = gymnasium.make("HandManipulateEggRotate_ContinuousTouchSensors-v1")
    env.action_space.seed(1)
    spent = 0.0
    for step in range(steps):
        if step % 100 == 0:
            env.reset(seed=step)
        action = env.action_space.sample()
        begun = time.process_time()
        env.step(action)
        spent += time.process_time() - begun
    return steps / spent, env.unwrapped.dt


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    for size in (None, 64, 240):
        name = "no images" if size is None else f"17 images of {size} x {size}"
        rate = measure(size, count)
        print(f"{name}: {rate:.0f} steps/s, {rate / 20:.1f} times real time")
    if importlib.util.find_spec("gymnasium_robotics") is None:
        print("Shadow hand: LEFT OUT, gymnasium-robotics is not installed")
    else:
        rate, length = measure_shadow(count)
        print(f"Shadow hand with touch sensors, MuJoCo: {rate:.0f} steps/s of {length:.3f} s, {rate * length:.1f} times real time")
