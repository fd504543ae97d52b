"""Motor angles over the workspace, and the literal chain of frames that is the oracle of the kinematics."""

from __future__ import annotations

import numpy as np

from plants.scaler_arm.kinematics.geometry import SCALER, Arm, Frame

LOW, HIGH = np.array(SCALER.limits).T


def anywhere(rows: int, seed: int = 0) -> np.ndarray:
    """(rows, 6) rad, uniform within the joint limits, the corners of the five-bar's box among them."""
    q = np.random.default_rng(seed).uniform(LOW, HIGH, (rows, 6))
    corners = [(a, f) for a in (LOW[1], HIGH[1]) for f in (LOW[2], HIGH[2])]
    q[: len(corners), 1:3] = corners
    return q


def literal_frames(q: np.ndarray, passive: np.ndarray, arm: Arm = SCALER) -> dict[str, np.ndarray]:
    """Every link's 4x4 transform, multiplied out joint by joint from the published table; q (6,), passive (b, e)."""
    angle = dict(zip(("shoulder", "a", "f", "wrist1", "wrist2", "wrist3", "b", "e"), (*q, *passive), strict=True))
    frames = {"body": np.eye(4)}
    for joint in arm.joints:
        frames[joint.name] = (
            frames[joint.parent] @ transform(joint.frame) @ transform(Frame(rpy=(0.0, 0.0, angle[joint.name])))
        )
    frames["gripper"] = frames["wrist3"] @ transform(arm.gripper)
    return frames


def transform(frame: Frame) -> np.ndarray:
    """4x4 of a URDF frame, by elementary rotations."""
    out = np.eye(4)
    for axis, angle in zip((2, 1, 0), frame.rpy[::-1], strict=True):
        i, j = [k for k in range(3) if k != axis]
        turn = np.eye(4)
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[i, j] = np.sin(angle) * (1 if axis == 1 else -1)
        turn[j, i] = -turn[i, j]
        out = out @ turn
    out[:3, 3] = frame.xyz
    return out


def point(frame: np.ndarray, at: tuple[float, float, float]) -> np.ndarray:
    """A link's point in the mount's frame, m."""
    return np.asarray(frame[:3, :3] @ np.array(at) + frame[:3, 3])
