"""A learned residual: the network with the names, units and scales of what goes in and what comes out."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.learning.network.mlp import Mlp, forward

FORMS = ("body", "paper", "joint", "task")
KEY = "residual"


@dataclass(frozen=True, eq=False)
class Residual:
    """delta = output_scale * forward(net, theta, (z - input_mean) / input_scale), scaled inputs held within +-limit.

    Attributes:
        theta: (net.size,) weights, unitless.
        inputs, outputs: names of z and delta, in order; velocities in m/s and rad/s, commands in actuator units.
        input_mean, input_scale: (inputs,) in the inputs' units; output_scale: (outputs,) in the outputs' units, 0
            where a channel is left alone.
        form: which equation delta enters; see `residual_mpc.learning.forms.form`.
        step: s, the period at which delta was learned: "previous" velocities lie that far back.
        robot: name of the robot that it was learned on.
        limit: scaled inputs beyond it (far outside of what was learned from) count as it: a velocity that feeds back
            into the network then cannot run away.
    """

    net: Mlp
    theta: np.ndarray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_mean: np.ndarray
    input_scale: np.ndarray
    output_scale: np.ndarray
    form: str
    step: float
    robot: str = ""
    limit: float = math.inf

    def __post_init__(self) -> None:
        wanted = {
            "theta": (self.theta, self.net.size),
            "input_mean": (self.input_mean, self.net.inputs),
            "input_scale": (self.input_scale, self.net.inputs),
            "output_scale": (self.output_scale, self.net.outputs),
        }
        for name, (values, size) in wanted.items():
            if values.shape != (size,) or not np.isfinite(values).all():
                raise ValueError(f"{name} must be ({size},) finite numbers, got shape {values.shape}")
        if (len(self.inputs), len(self.outputs)) != (self.net.inputs, self.net.outputs):
            raise ValueError(
                f"inputs and outputs must be named for {self.net}, got {len(self.inputs)} and {len(self.outputs)} names"
            )
        if not (self.input_scale > 0).all() or not (self.output_scale >= 0).all() or not self.step > 0:
            raise ValueError("input_scale and step must be > 0, output_scale >= 0")
        if not self.limit > 0:
            raise ValueError(f"limit must be > 0 input scales, got {self.limit}")
        if self.form not in FORMS:
            raise ValueError(f"form must be one of {FORMS}, got {self.form!r}")

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """delta (..., outputs) at inputs z (..., inputs), physical units."""
        return np.asarray(self.output_scale * forward(self.net, self.theta, self.scaled(z)))

    def scaled(self, z: np.ndarray) -> np.ndarray:
        """What the network sees of inputs z (..., inputs) in physical units."""
        return np.asarray(np.clip((z - self.input_mean) / self.input_scale, -self.limit, self.limit))

    @property
    def acts(self) -> bool:
        """Whether any output is switched on."""
        return bool(self.output_scale.any())

    def with_theta(self, theta: np.ndarray) -> "Residual":
        """The same residual with other weights (net.size,)."""
        return replace(self, theta=theta)

    def without(self, names: tuple[str, ...]) -> "Residual":
        """The same residual with these outputs switched off."""
        off = np.array([o in names for o in self.outputs])
        return replace(self, output_scale=np.where(off, 0.0, self.output_scale))

    def switched_off(self) -> "Residual":
        """The same residual with all outputs switched off, so that the model is the same as without it."""
        return self.without(self.outputs)


def to_json(residual: Residual) -> dict[str, Any]:
    """Plain lists and numbers, for the key "residual" of model.json."""
    return {
        "form": residual.form,
        "robot": residual.robot,
        "step": residual.step,
        "limit": None if math.isinf(residual.limit) else residual.limit,
        "net": asdict(residual.net),
        "inputs": list(residual.inputs),
        "outputs": list(residual.outputs),
        **{k: getattr(residual, k).tolist() for k in ("input_mean", "input_scale", "output_scale", "theta")},
    }


def from_json(content: Mapping[str, Any], source: str = "") -> Residual:
    """The residual of a model.json. Raises BadInput where anything is missing or does not fit together."""
    try:
        net = content["net"]
        return Residual(
            net=Mlp(int(net["inputs"]), tuple(int(h) for h in net["hidden"]), int(net["outputs"]), float(net["slope"])),
            theta=np.array(content["theta"], dtype=np.float64),
            inputs=tuple(str(n) for n in content["inputs"]),
            outputs=tuple(str(n) for n in content["outputs"]),
            input_mean=np.array(content["input_mean"], dtype=np.float64),
            input_scale=np.array(content["input_scale"], dtype=np.float64),
            output_scale=np.array(content["output_scale"], dtype=np.float64),
            form=str(content["form"]),
            step=float(content["step"]),
            robot=str(content.get("robot", "")),
            limit=math.inf if content.get("limit") is None else float(content["limit"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(
            f"its residual cannot be read: {error!r}", source, "write it again with `residual-mpc learn`"
        ) from error
