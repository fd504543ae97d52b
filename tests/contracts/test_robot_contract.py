"""Both families and a stranger's robot keep the contract; a robot that breaks a law is told which."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cart_plant import Cart
from oracles.arms import FILTERED, MIXED, SERVOS, arm_xml, wheel_xml

from plants.diff_drive import DiffDrive
from plants.mujoco_robot import build
from residual_mpc.models.contract import ContractBroken, check_robot
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile

XML = {
    "servos": arm_xml(SERVOS),
    "mixed": arm_xml(MIXED, "Euler"),
    "filtered": arm_xml(FILTERED),
    "wheel": wheel_xml(),
}


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_the_wheeled_robot_keeps_it(rng: np.random.Generator) -> None:
    check_robot(DiffDrive("rover", 0.033, 0.16), rng, size=5.0)


@pytest.mark.parametrize("model", XML)
def test_a_mujoco_robot_keeps_it(tmp_path: Path, rng: np.random.Generator, model: str) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(XML[model])
    check_robot(build(RobotFile("robot", "mujoco", model=path)), rng)


def test_a_strangers_cart_keeps_it(rng: np.random.Generator) -> None:
    check_robot(Cart("cart", 0.1), rng)


@dataclass(frozen=True)
class Faulty:
    """A cart with one method or attribute replaced."""

    cart: Cart
    name: str = "cart"
    changed: Mapping[str, Any] = None  # type: ignore[assignment]

    def __getattr__(self, name: str) -> Any:
        return self.changed[name] if name in self.changed else getattr(self.cart, name)


CART = Cart("cart", 0.1)
Replay = Callable[..., Mapping[str, np.ndarray]]


def replay_with(change: Callable[..., Mapping[str, np.ndarray]]) -> Replay:
    return lambda start, drive, settings, wanted: change(start, drive, settings, wanted)


def off_by(amount: Callable[..., Any]) -> Replay:
    """The cart's prediction, from the second node on moved by amount(start, drive, settings)."""

    def replay(start: Any, drive: Any, settings: Any, wanted: Any) -> Mapping[str, np.ndarray]:
        out = dict(CART.replay(start, drive, settings, wanted))
        moved = out["position.rail"].copy()
        moved[:, 1:] += amount(start, drive, settings)
        return {**out, "position.rail": moved}

    return replay


def spoiling(start: Any, drive: Any, settings: Any, wanted: Any) -> Mapping[str, np.ndarray]:
    out = CART.replay(start, drive, settings, wanted)
    drive.command[0, -1] += 1e-3
    return out


def without_outputs(start: Any, drive: Any, settings: Any, wanted: Any) -> Mapping[str, np.ndarray]:
    return {c: y for c, y in CART.replay(start, drive, settings, wanted).items() if not c.startswith("output.")}


dice = np.random.default_rng(0)
BREACHES: dict[str, tuple[dict[str, Any], str]] = {
    "no actuator": ({"actuators": ()}, "actuators is a tuple"),
    "twice": ({"channels": ("position.rail", "position.rail")}, "channels are distinct"),
    "kind": ({"command_kinds": ("pressure",)}, "command_kinds"),
    "channel": ({"channels": ("position.rail", "velocity.rail", "mood")}, "names of the run log"),
    "state": ({"channels": ("position.rail",)}, "a state is read from channels"),
    "step": ({"step": -0.1}, "step is a time"),
    "slots": ({"slots": lambda effect: ["motor"]}, "slots of command_delay"),
    "bounds": ({"bounds": lambda effect, parameter, slot: (2.0, 3.0)}, "leave room around its null value"),
    "reference": ({"reference": lambda kind, slot: 0.0}, "a typical magnitude"),
    "nominal": ({"nominal": lambda: {"time_constant": float("nan")}}, "is a number"),
    "output": ({"replay": without_outputs}, "got no output.motor"),
    "shape": ({"replay": replay_with(lambda s, d, e, w: {c: np.zeros(7) for c in w})}, "is (rows, steps + 1)"),
    "start": ({"replay": replay_with(lambda s, d, e, w: {c: np.zeros((3, d.steps + 1)) for c in w})}, "begins at"),
    "finite": ({"replay": off_by(lambda s, d, e: np.nan)}, "is finite"),
    "dice": ({"replay": off_by(lambda s, d, e: dice.standard_normal())}, "the same replay gives the same"),
    "spoils": ({"replay": spoiling}, "leaves its arguments alone"),
    "batch": ({"replay": off_by(lambda s, d, e: float(len(d.clock)))}, "a row alone is the same as in a batch"),
    "enabled": ({"replay": off_by(lambda s, d, e: 0.0 if d.enabled is None else 1e-12)}, "`enabled` of 1"),
    "tuned": ({"replay": off_by(lambda s, d, e: 1e-12 if e.tuned else 0.0)}, "at its nominal value 0.1"),
    "null": ({"replay": off_by(lambda s, d, e: 1e-12 if e.effects else 0.0)}, "command_delay at null"),
    "idle": ({"slots": lambda effect: ("motor",) if effect == "saturation" else ()}, "saturation changes the"),
}


@pytest.mark.parametrize("breach", BREACHES)
def test_a_breach_is_named(rng: np.random.Generator, breach: str) -> None:
    changed, said = BREACHES[breach]
    fields = {k: v for k, v in changed.items() if k in ("actuators", "channels", "command_kinds", "step")}
    methods = {k: v for k, v in changed.items() if k not in fields}
    robot: Robot = Faulty(replace(CART, **fields), changed=methods)
    with pytest.raises(ContractBroken) as broken:
        check_robot(robot, rng)
    assert said in str(broken.value) and ": expected " in str(broken.value)
