"""Policies of LeRobot in the environments and in the benchmark."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ftac import features
from ftac.features import Row, Spec
from ftac.lerobot.episodes import words
from ftac.lerobot.layout import PER_OBJECT, Layout


class PolicyAdapter:
    """Makes a policy that was trained on a data set act: in an environment of `ftac.envs`, and as a policy of the benchmark (`ftac.bench`, ``ftac bench
    --policy``), on simulated, emulated and real robots. In a trial with more objects than the data have, it gets the first ones.

    Parameters
    ----------
    policy: a function of a batch of one (see `ftac.lerobot.layout.Layout.batch`; arrays of numpy) that returns the action, (n,) or (1, n), as an array or a
        tensor. Its method ``reset()`` is called before each episode if it has one. Normalisation belongs to it: with LeRobot
        0.4.4 it is ``lambda batch: post(model.select_action(pre(tensors(batch))))`` with the processors that are saved beside the weights.
    dataset: folder of the data set, its file ``meta/ftac.json``, or its `Layout`.
    task: the task in words; None for the words that `ftac.lerobot.record` writes.
    """

    def __init__(
        self, policy: Callable[[dict[str, Any]], Any], dataset: str | os.PathLike[str] | Layout, task: str | None = None
    ) -> None:
        if not callable(policy):
            raise ValueError(f"policy: found {type(policy).__name__}, expected a function of a batch")
        self.policy = policy
        self.layout = dataset if isinstance(dataset, Layout) else Layout.read(dataset)
        self._task = task
        self._words = task

    @property
    def features(self) -> Spec:
        """The choice of observations and actions, which the benchmark asks for."""
        return self.layout.spec

    def reset(self, info: Mapping[str, Any]) -> None:
        """Begins an episode."""
        objects = list(info["objects"])[: self.layout.objects]
        task = self.layout.task or ("pick_one" if self.layout.objects == 1 else "pick_two")
        self._words = self._task or words(task, objects, self.layout.goal)
        reset = getattr(self.policy, "reset", None)
        if callable(reset):
            reset()

    def act(self, observation: Mapping[str, Any]) -> Row:
        """The action of the policy, clipped to -1 to 1. ``ValueError`` if it has another number of values, or one that is no number."""
        count = self.layout.objects
        known = {name: value[:count] if name in PER_OBJECT else value for name, value in observation.items()}
        answer = self.policy(self.layout.batch(known, self._words))
        if hasattr(answer, "detach"):
            answer = answer.detach().cpu().numpy()
        action = np.asarray(answer, dtype=np.float32)
        action = action[0] if action.ndim == 2 and len(action) == 1 else action
        size = features.action_size(self.layout.spec, self.layout.joints)
        if action.shape != (size,) or not np.all(np.isfinite(action)):
            raise ValueError(f"policy: found an action {action}, expected {size} finite numbers")
        clipped: Row = np.clip(action, -1.0, 1.0)
        return clipped
