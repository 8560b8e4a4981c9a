"""A gymnasium vector environment whose observations are rendered in one batch a step: python vector_env.py [STEPS] [SCENE]

Cameras fly over a landscape. Each wants to be near the ground ahead of it, and ends where it hits something.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

import argus_render

#: Metres of a step, and radians of a turn.
SPEED, TURN = 1.0, 0.15
#: A camera that is nearer than this to something has hit it, metres.
HIT = 0.5


class Flight(VectorEnv[Any, Any, Any]):
    """`num_envs` cameras. Actions: turn left or right, −1 to 1, and climb, −1 to 1."""

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(self, renderer: argus_render.Renderer, num_envs: int = 16, size: tuple[int, int] = (64, 64)) -> None:
        self.renderer, self.num_envs, self.size = renderer, num_envs, size
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.single_observation_space = gymnasium.spaces.Dict(
            {
                "rgb": gymnasium.spaces.Box(0, 255, (*size, 3), np.uint8),
                "range": gymnasium.spaces.Box(0.0, np.inf, (*size, 1), np.float32),
            }
        )
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.bounds = renderer.describe().bounds
        self.eye, self.heading = np.zeros((num_envs, 3)), np.zeros(num_envs)
        self.ended = np.ones(num_envs, bool)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.ended[:] = True
        self._begin()
        return self._observe(), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        flying = ~self.ended
        turn, climb = np.asarray(actions, np.float64).T
        self.heading += np.where(flying, turn * TURN, 0.0)
        ahead = np.stack([np.sin(self.heading), 0.5 * climb, -np.cos(self.heading)], axis=1)
        self.eye += np.where(flying[:, None], ahead * SPEED, 0.0)
        self._begin()
        seen = self._observe()
        nearest = seen["range"].reshape(self.num_envs, -1).min(axis=1)
        least, most = self.bounds
        self.ended = flying & (nearest < HIT)
        truncated = flying & ((self.eye < least - 10.0) | (self.eye > most + 50.0)).any(axis=1)
        reward = np.where(flying, 1.0 / (1.0 + nearest) - self.ended, 0.0)
        terminated, self.ended = self.ended, self.ended | truncated
        return seen, reward, terminated, truncated, {}

    def _begin(self) -> None:
        """Puts the cameras whose flight has ended above the middle of the scene."""
        new = int(self.ended.sum())
        least, most = self.bounds
        middle, reach = (least + most) / 2, (most - least) / 8
        self.eye[self.ended] = middle + self.np_random.uniform(-reach, reach, (new, 3))
        self.eye[self.ended, 1] = most[1] + 2.0
        self.heading[self.ended] = self.np_random.uniform(-np.pi, np.pi, new)

    def _observe(self) -> dict[str, Any]:
        # OpenGL poses: a turn about the vertical axis, and a look 20° down.
        sin, cos = np.sin(self.heading), np.cos(self.heading)
        zero, one, tilt = np.zeros(self.num_envs), np.ones(self.num_envs), np.radians(20.0)
        yaw = np.array([[cos, zero, -sin], [zero, one, zero], [sin, zero, cos]]).transpose(2, 0, 1)
        pitch = np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
        poses = np.tile(np.eye(4), (self.num_envs, 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = yaw @ pitch, self.eye
        frames = self.renderer.render(
            poses, fov_deg=70.0, size=self.size, convention="opengl", outputs=("rgb", "range"), direct=True
        )
        return {"rgb": frames.rgb, "range": frames.range}


if __name__ == "__main__":
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    with argus_render.open(sys.argv[2] if len(sys.argv) > 2 else "terrain") as service:
        flight = Flight(service)
        flight.reset(seed=1)
        begin, rewards = time.perf_counter(), 0.0
        for _step in range(steps):
            _, reward, _, _, _ = flight.step(flight.action_space.sample())
            rewards += reward.mean()
        secs = time.perf_counter() - begin
        print(f"{steps * flight.num_envs / secs:.0f} frames a second, mean reward {rewards / steps:.4f}")
