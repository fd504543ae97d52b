"""The parameters that a robot's step takes as arguments: those of the model and those of the effects."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from plants.mujoco_robot.edits.batch import tunable_values
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.effect import Quantity, Site
from residual_mpc.effects.library import BY_NAME, ORDER, present
from residual_mpc.effects.ops import Array
from residual_mpc.models.settings import TUNE, Settings, is_null
from residual_mpc.models.stepping import Number, finite

HOSTED: tuple[Site, ...] = (
    "command", "strength", "limit", "speed limit", "damping", "dry friction", "friction", "elastic", "rotor", "tool",
    "link", "length", "gravity", "compensation", "law", "law friction", "servo", "position gain",
)  # fmt: skip
LEFT_OUT: Mapping[str, str] = {
    "spring": "this step has one inertia per joint and does not separate motor and link",
    "stop": "the step has no joint stops",
    "play": "this step has one inertia per joint and does not separate motor and link",
}
# each target adds operations: only those that are not null
LAWS: tuple[Site, ...] = ("law", "law friction")
LENGTHENS: tuple[Site, ...] = ("link", "length", "servo", "compensation", *LAWS)
UNITS = {
    "kp": "N m/rad", "kv": "N m s/rad", "damping": "N m s/rad", "armature": "kg m^2", "frictionloss": "N m",
    "mass": "kg",
}  # fmt: skip
DRY = "frictionloss"
COSTLY = (DRY, "mass")  # arguments only if they have an effect, since they add operations to the step


@dataclass(frozen=True, eq=False)
class Parameters:
    """numbers: p, in order. effects: those in the step, in the chain's order. left_out: the others, with reasons."""

    robot: CompiledRobot
    numbers: tuple[Number, ...]
    effects: tuple[str, ...]
    left_out: tuple[str, ...]
    index: Mapping[tuple[str, str, str], int]  # (effect, slot, parameter) -> place in p

    @property
    def now(self) -> tuple[float, ...]:
        """The present values of p."""
        return tuple(n.value for n in self.numbers)

    def change(self, *quantities: Quantity) -> bool:
        """Whether an argument changes one of these quantities of the model."""
        return any(e != TUNE and BY_NAME[e].parameter(name).quantity in quantities for e, _, name in self.index)

    def own(self, name: str, p: Sequence[Array]) -> Array:
        """A nominal number such as "joint.j1.damping"; one that is not an argument has its compiled value."""
        at = self.index.get((TUNE, "", name))
        return tunable_values(self.robot.model)[name] if at is None else p[at]

    def values(self, effect: str, target: str, p: Sequence[Array]) -> dict[str, Array]:
        """The parameters of an effect at a target; null values if it does not act there."""
        slot = "" if target == self.robot.name else target
        found = {q.name: self.index.get((effect, slot, q.name)) for q in BY_NAME[effect].parameters}
        every = BY_NAME[effect].parameters
        return {q.name: finite(q.null) if (i := found[q.name]) is None else p[i] for q in every}

    def at(self, target: str, p: Sequence[Array], *sites: Site) -> dict[str, dict[str, Array]]:
        """The effects at these sites of a target, with their parameters there; without the laws of others."""
        here = [e for e in self.effects if BY_NAME[e].place in sites]
        own = {(effect, slot) for effect, slot, _ in self.index}
        return {e: self.values(e, target, p) for e in here if BY_NAME[e].place not in LAWS or (e, target) in own}


def parameters(robot: CompiledRobot, settings: Settings) -> Parameters:
    """The parameters of a step for settings with one row."""
    live = sorted((e for e in settings.effects if BY_NAME[e].stage != "sensor"), key=ORDER.__getitem__)
    reasons = {e: _not_hosted(e, robot) for e in live}
    hosted = [e for e in live if not reasons[e]]
    left_out = tuple(f"{e}: {why}" for e, why in reasons.items() if why)
    null = {e: is_null(e, settings.effects[e])[0] for e in hosted}
    numbers = _own(robot, settings)
    for effect in hosted:
        for q in BY_NAME[effect].parameters:
            for i, (slot, value) in enumerate(
                zip(robot.slots(effect), settings.effects[effect][q.name][0], strict=True)
            ):
                if BY_NAME[effect].place in LENGTHENS and null[effect][i]:
                    continue
                if q.optional and value == q.null:
                    continue
                at = "" if slot == robot.name else slot
                numbers.append(Number(effect, at, q.name, finite(float(value)), q.unit))
    index = {(n.effect, n.slot, n.parameter): i for i, n in enumerate(numbers)}
    order = tuple(e.name for e, _ in present({e: settings.effects[e] for e in hosted}, *HOSTED))
    return Parameters(robot, tuple(numbers), order, left_out, index)


def _not_hosted(effect: str, robot: CompiledRobot) -> str:
    """The reason why an effect is not in the step; empty if it is."""
    found = BY_NAME[effect]
    if found.place not in HOSTED:
        return LEFT_OUT.get(found.place, "not part of this step")
    if found.on_error and found.remembers and robot.servo.any():
        return "this step has no effects with memory on a servo's error"
    return ""


def _own(robot: CompiledRobot, settings: Settings) -> list[Number]:
    """Gains, dampings, rotor inertias, dry friction if the model has any, and masses that were retuned (each mass adds
    operations to the dynamics)."""
    rubs = bool(robot.model.dof_frictionloss.any())
    out = []
    for name, value in tunable_values(robot.model).items():
        short = name.rpartition(".")[2]
        tuned = name in settings.tuned
        if tuned or short not in COSTLY or (short == DRY and rubs):
            now = float(settings.tuned[name][0]) if tuned else value
            out.append(Number(TUNE, "", name, now, UNITS[short], stalls=short == DRY))
    return out


def unit_of(state: str, sliding: frozenset[str]) -> str:
    """The unit of a state, from its name."""
    kind, _, name = state.partition(".")
    length = "m" if name in sliding else "rad"
    known = {"position": length, "velocity": f"{length}/s", "clock": "s", "disturbance": "N m"}
    labelled = next((e.memory_unit for e in BY_NAME.values() if e.label == kind and e.memory_unit), "")
    return known.get(kind) or labelled or "command unit"
