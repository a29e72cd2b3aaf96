"""Answers for a policy: ``python -m ftac.policy_host FILE.py:CLASS ARGUMENTS``, started by ``ftac bench --policy``; or for an object in this process.

A question is JSON with arrays of bytes, an answer is JSON. Both ways of asking lead to `Host.answer`.
"""

from __future__ import annotations

import json
import traceback
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftac._hosting import Bytes, main
from ftac.bench import Situation
from ftac.features import Features, Spec
from ftac.grasps import pick_up


class Host:
    """Answers for `policy`: an object with a method ``choose(situation)`` or ``act(observation)`` (see `ftac.bench.Policy`)."""

    def __init__(self, policy: Any) -> None:
        if isinstance(policy, type):
            raise ValueError(f"policy: found the class {policy.__name__}, expected an object of it: {policy.__name__}()")
        levels = [name for name in ("choose", "act") if callable(getattr(policy, name, None))]
        if len(levels) != 1:
            found = " and ".join(levels) or "neither"
            raise ValueError(
                f"policy: found {type(policy).__name__} with {found}, "
                "expected an object with a method choose(situation) or act(observation)"
            )
        self.policy, self.level = policy, levels[0]
        self.spec = Spec.of(policy) if self.level == "act" else Spec()
        self._reset_question: tuple[dict[str, Any], NDArray[np.uint8] | None] | None = None
        self._features: Features | None = None

    def introduction(self) -> dict[str, Any]:
        """Name, decision level and image size of the policy."""
        return {"name": type(self.policy).__name__, "level": self.level, "images": self.spec.images}

    def answer(self, question: dict[str, Any], arrays: Bytes) -> dict[str, Any]:
        """The answer to a question; ``{"error": traceback}`` if the policy raises an exception."""
        try:
            pictures = [np.frombuffer(data, dtype=np.uint8).reshape(shape) for shape, data in arrays]
            if question["ask"] == "reset":
                return self._reset(question, pictures)
            return self._choose(question, pictures) if question["ask"] == "choose" else self._act(question, pictures)
        except Exception:
            return {"error": traceback.format_exc().strip()}

    def answer_text(self, question: str, arrays: Bytes) -> str:
        """The same with JSON's text."""
        return json.dumps(self.answer(json.loads(question), arrays))

    def _reset(self, question: dict[str, Any], pictures: list[NDArray[np.uint8]]) -> dict[str, Any]:
        # The poses of the objects come with the first observation.
        self._reset_question, self._features = (question, pictures[0] if pictures else None), None
        reset = getattr(self.policy, "reset", None)
        if reset is not None:
            info = question["info"]
            told = {**info, "objects": tuple(info["objects"]), "yaws": tuple(info["yaws"])}
            if pictures:
                told["untouched"] = pictures[0]
            reset(told)
        return {}

    def _choose(self, question: dict[str, Any], pictures: list[NDArray[np.uint8]]) -> dict[str, Any]:
        told = question["situation"]
        candidates = told.pop("candidates")
        for name in ("servos", "arm", "palm", "detected"):
            told[name] = np.array(told[name])
        for name in ("in_hand", "in_hand_covariance"):
            told[name] = None if told[name] is None else np.array(told[name])
        for name in ("objects", "yaws", "holding"):
            told[name] = tuple(told[name])
        situation = Situation(
            first=pick_up(told.pop("first")),
            candidates=tuple(pick_up(candidate["grasp"]) for candidate in candidates),
            scores=np.array([candidate["score"] for candidate in candidates]),
            tactile=dict(zip(question["cameras"], pictures)),
            untouched=dict(zip(question["untouched"], pictures[len(question["cameras"]) :])),
            **told,
        )
        answer = self.policy.choose(situation)
        if answer is None:
            return {"choice": None}
        if isinstance(answer, (bool, np.bool_)):
            raise ValueError(f"choose: found {answer}, expected the number of a candidate, None, or a number and an aim")
        index, aim = (answer, (0.0, 0.0, 0.0)) if isinstance(answer, (int, np.integer)) else answer
        x, y, yaw = (float(value) for value in aim)
        if not 0 <= index < len(candidates):
            raise ValueError(f"choose: found candidate {index}, expected 0 to {len(candidates) - 1}")
        if not np.all(np.isfinite([x, y, yaw])):
            raise ValueError(f"choose: found the aim {x}, {y}, {yaw}, which is not finite (NaN), expected numbers")
        return {"choice": [int(index), x, y, yaw]}

    def _act(self, question: dict[str, Any], pictures: list[NDArray[np.uint8]]) -> dict[str, Any]:
        measured = question["observation"]
        if pictures:
            measured["tactile"] = pictures[0]
        features = self._features or self._first_features(measured)
        observation = features.observe(measured)
        observation["time_left"] = measured["time_left"]
        action = self.policy.act(observation)
        if action is None:
            return {"action": None}
        twist, joints, tensions, opposition, spools = features.act(action)
        arm = {"twist": twist.tolist()} if joints is None else {"joints": joints.tolist()}
        if spools is None:
            hand: dict[str, Any] = {"tensions": {"tensions": tensions.tolist(), "opposition": opposition}}
        else:
            hand = {"spools": spools.tolist()}
        return {"action": {"arm": arm, "hand": hand}}

    def _first_features(self, measured: dict[str, Any]) -> Features:
        assert self._reset_question is not None, "reset comes first"
        question, untouched = self._reset_question
        info = question["info"]
        self._features = Features(
            self.spec,
            question["limits"],
            detected=measured["detected"],
            objects=info["objects"],
            yaws=info["yaws"],
            shape=question["object_features"],
            untouched=untouched,
        )
        return self._features


if __name__ == "__main__":
    main("policy", Host)
