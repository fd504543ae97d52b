"""Both families and a stranger's robot keep the contract; a robot that breaks a law is told which."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cart_plant import Cart
from oracles.arms import FILTERED, MIXED, SERVOS, arm_xml, random_drive, random_start, robot_of, wheel_xml

from plants.diff_drive import DiffDrive
from plants.mujoco_robot import build
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.predict.references import measure_references
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models import optional
from residual_mpc.models.contract import ContractBroken, check_robot
from residual_mpc.models.contract.optional_members import check_optional
from residual_mpc.models.load import load_robot
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import RobotFile, read_robot_file
from residual_mpc.models.settings import Settings
from residual_mpc.models.wrapped import Wrapped

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


class Minimal:
    """The cart with the members of `Robot` and nothing else; its only actuator is called like its joint."""

    name, actuators, command_kinds, step = "cart", ("rail",), ("velocity",), None
    states, channels = CART.states, CART.channels
    bounds, reference, nominal = CART.bounds, CART.reference, CART.nominal

    def slots(self, effect: str) -> tuple[str, ...]:
        return tuple(s.replace("motor", "rail") for s in CART.slots(effect))

    def replay(self, start: Any, drive: Any, settings: Any, wanted: tuple[str, ...]) -> Mapping[str, np.ndarray]:
        return CART.replay(start, drive, settings, wanted)


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


def test_a_robot_without_optional_members_keeps_it(rng: np.random.Generator) -> None:
    """What a minimal robot does not say has a default."""
    robot = Minimal()
    assert {n for n in dir(robot) if n[0] != "_"} == {n for n in vars(Robot) if n[0] != "_"}
    check_robot(robot, rng)
    assert optional.actuator_joints(robot) == optional.joints(robot) == robot.actuators == ("rail",)
    assert (optional.sliding(robot), optional.limits(robot), optional.command_limits(robot)) == (frozenset(), {}, {})
    assert (optional.rest(robot), optional.held(robot), optional.period(robot)) == ({}, (), 0.05)


def test_a_robot_that_lacks_required_members_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    half = "class Half:\n    name, actuators, states, channels = 'half', (), (), ()\n    slots = replay = step = None\n"
    (tmp_path / "half_plant.py").write_text(half + "def make(robot):\n    return Half()\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(BadInput, match="a Half without command_kinds, bounds, reference, nominal"):
        load_robot(RobotFile("half", "half_plant:make"))


@pytest.mark.parametrize("robot", ["diff_drive", "scaler_arm", "scaler_arm_servo", "diff_drive_mujoco"])
def test_built_in_robots_keep_their_optional_members(robot: str) -> None:
    check_optional(load_robot(read_robot_file(robot)))


ODD: dict[str, tuple[dict[str, Any], str]] = {
    "one joint too many": ({"actuator_joints": ("rail", "hook")}, "actuator_joints has one joint an actuator"),
    "joints by number": ({"actuator_joints": (1,)}, "actuator_joints is a tuple of names"),
    "a list of joints": ({"joints": ["rail"]}, "joints is a tuple of names"),
    "a joint twice": ({"joints": ("rail", "rail")}, "joints are distinct"),
    "no driven joint": ({"joints": ("hook",)}, "an actuator drives one of the joints: expected one of"),
    "sliding in a list": ({"sliding": ["rail"]}, "sliding is a frozenset"),
    "an unknown slide": ({"sliding": frozenset({"hook"})}, "sliding names joints: expected one of"),
    "limits in a list": ({"limits": [(-1.0, 1.0)]}, "limits is a mapping"),
    "limits of nothing": ({"limits": {"hook": (-1.0, 1.0)}}, "limits is by name: expected one of"),
    "limits upside down": ({"limits": {"rail": (1.0, -1.0)}}, "limits of rail is a range"),
    "one limit": ({"limits": {"rail": 1.0}}, "limits of rail is a range"),
    "no limit": ({"limits": {"rail": (float("nan"), 1.0)}}, "limits of rail is a range"),
    "forces in a list": ({"force_limits": [3.0]}, "force_limits is a mapping"),
    "a force of a joint": ({"force_limits": {"rail": 3.0}}, "force_limits is by actuator"),
    "a range of forces": ({"force_limits": {"motor": (-3.0, 3.0)}}, "force_limits of motor is a force"),
    "limits of a joint's command": ({"command_limits": {"rail": (-1.0, 1.0)}}, "command_limits is by name"),
    "commands upside down": ({"command_limits": {"motor": (1.0, -1.0)}}, "command_limits of motor is a range"),
    "rest of a speed": ({"rest": {"velocity.rail": 0.0}}, "rest is by position channel"),
    "rest nowhere": ({"rest": {"position.rail": float("inf")}}, "rest of position.rail is a number"),
    "rest in a tuple": ({"rest": (0.0,)}, "rest is a mapping"),
    "held and commanded": ({"held": ("motor",)}, "an actuator that is held is not commanded"),
    "held in a list": ({"held": ["hook"]}, "held is a tuple of names"),
    "no time": ({"period": 0.0}, "period is a time"),
    "a word for a time": ({"period": "fast"}, "period is a time"),
}


@pytest.mark.parametrize("odd", ODD)
def test_a_breach_by_an_optional_member_is_named(rng: np.random.Generator, odd: str) -> None:
    members, said = ODD[odd]
    robot = type("Odd", (Cart,), {})("cart", 0.1)
    for name, value in members.items():
        object.__setattr__(robot, name, value)
    with pytest.raises(ContractBroken) as broken:
        check_robot(robot, rng)
    assert said in str(broken.value) and ": expected " in str(broken.value)


@pytest.mark.parametrize(
    ("members", "said"),
    [
        ({"disturbed": ("body.up",)}, "disturbed names signals of the step: expected"),
        ({"disturbed": "body.yaw"}, "disturbed is a tuple of names"),
        ({"actuators": ("right", "left")}, "the step takes the robot's commands"),
    ],
)
def test_a_breach_by_a_step_is_named(members: dict[str, Any], said: str) -> None:
    robot = type("Odd", (DiffDrive,), {})("rover", 0.033, 0.16)
    for name, value in members.items():
        object.__setattr__(robot, name, value)
    with pytest.raises(ContractBroken) as broken:
        check_optional(robot)
    assert said in str(broken.value)


def as_it_is(base: Robot, *arguments: Any) -> Mapping[str, np.ndarray]:
    return base.replay(*arguments)


def test_a_wrapped_robot_is_described_by_its_base(tmp_path: Path) -> None:
    """Its joints, limits and rest are those of the robot whose replay it replaces."""
    path = tmp_path / "robot.xml"
    path.write_text(XML["servos"])
    base = build(RobotFile("robot", "mujoco", model=path))
    robot = Wrapped(Wrapped(base, as_it_is), as_it_is)
    assert optional.actuator_joints(robot) == base.actuator_joints
    assert optional.joints(robot) == base.joints == ("j1", "j2")
    assert optional.limits(robot) == base.limits != {}
    assert optional.command_limits(robot) == base.command_limits != {}
    assert optional.rest(robot) == base.rest != {}


def test_robots_that_are_wrapped_alike_are_merged_as_their_bases_are(tmp_path: Path) -> None:
    one, other = robot_of(tmp_path, arm_xml()), robot_of(tmp_path, arm_xml().replace('kp="20"', 'kp="35"'))
    whole = Wrapped(one, as_it_is).merged([Wrapped(other, as_it_is)])
    assert whole is not None
    drive, start = random_drive(one, 2, 100), random_start(one, 2)
    both = whole.replay(start, replace(drive, setting=np.array([0, 1])), Settings(2), ("position.j1",))
    for row, robot in enumerate((one, other)):
        alone = robot.replay(start, drive, Settings(2), ("position.j1",))
        np.testing.assert_array_equal(both["position.j1"][row], alone["position.j1"][row])
    assert Wrapped(one, as_it_is).merged([Wrapped(other, lambda base, *a: base.replay(*a))]) is None
    assert Wrapped(one, as_it_is).merged([other]) is None
    rover = Wrapped(DiffDrive("rover", 0.033, 0.16), as_it_is)
    assert rover.merged([rover]) is None


def test_the_page_lists_every_member() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "guide" / "your-own-model.md").read_text(encoding="utf-8")
    required, optional_ones = page.split("## Optional members")
    listed = [re.findall(r"^\| `(\w+)", part, flags=re.M) for part in (required, optional_ones.split("Five larger")[0])]
    assert set(listed[0]) == {n for n in vars(Robot) if n[0] != "_"}
    read = {n for n, f in vars(optional).items() if inspect.isfunction(f) and f.__module__ == optional.__name__}
    assert set(listed[1]) == {n for n in read if n[0] != "_"}


@pytest.mark.parametrize("breach", BREACHES)
def test_a_breach_is_named(rng: np.random.Generator, breach: str) -> None:
    changed, said = BREACHES[breach]
    fields = {k: v for k, v in changed.items() if k in ("actuators", "channels", "command_kinds", "step")}
    methods = {k: v for k, v in changed.items() if k not in fields}
    robot: Robot = Faulty(replace(CART, **fields), changed=methods)
    with pytest.raises(ContractBroken) as broken:
        check_robot(robot, rng)
    assert said in str(broken.value) and ": expected " in str(broken.value)


class WithoutOutputs:
    """The cart without what its actuator puts out."""

    def __getattr__(self, name: str) -> Any:
        return getattr(CART, name)

    def replay(self, start: Any, drive: Any, settings: Settings, wanted: tuple[str, ...]) -> dict[str, np.ndarray]:
        known = CART.replay(start, drive, settings, CART.channels)
        return {c: known[c] for c in wanted}


def test_a_replay_that_knows_no_outputs_is_told_so(rng: np.random.Generator) -> None:
    robot: Robot = WithoutOutputs()
    with pytest.raises(ContractBroken, match="requested channel.*output.motor"):
        check_robot(robot, rng)
    t = np.arange(0.0, 10.0, 0.05)
    run = Run("r", t, {"command.motor": np.sin(t), "position.rail": np.cos(t)})
    with pytest.raises(BadInput, match="must also give output.motor") as refused:
        measure_references(build_dataset([run], [robot], {}))
    assert "what each actuator puts out" in refused.value.remedy
