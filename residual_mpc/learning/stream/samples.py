"""Velocities at even steps, as they come in from a robot: what the model says, what was seen, what the network sees.

This is the paper's own setting: the residual is an error of velocities, and velocities are what localisation reports.
No window of positions is replayed, so that a sample costs one evaluation of the network.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.learning.network.mlp import input_slope
from residual_mpc.learning.network.residual import Residual


@dataclass(frozen=True, eq=False)
class Samples:
    """n samples in a row, `step` s apart.

    t (n,) s. z (n, inputs): the network's inputs, physical units. model, reference (n, outputs): velocities by the
    model alone and as seen (NaN where nothing was), m/s or rad/s. With `fed_back` the first `outputs` columns of z are
    the velocities of the sample before, corrected: they are filled in as the samples are rolled out.
    """

    t: np.ndarray
    z: np.ndarray
    model: np.ndarray
    reference: np.ndarray
    step: float
    fed_back: bool = False

    def __post_init__(self) -> None:
        n, o = self.model.shape
        if self.t.shape != (n,) or self.reference.shape != (n, o) or len(self.z) != n:
            raise ValueError(f"t {self.t.shape}, z {self.z.shape}, model {(n, o)}, reference {self.reference.shape}: "
                             "must have one row per sample")  # fmt: skip
        if not self.step > 0.0 or (self.fed_back and self.z.shape[1] < o):
            raise ValueError(f"step must be > 0 and z must have room for the fed-back values, got step {self.step} s")

    def __len__(self) -> int:
        return len(self.t)

    def take(self, rows: slice) -> "Samples":
        """Rows in a row."""
        return replace(self, t=self.t[rows], z=self.z[rows], model=self.model[rows], reference=self.reference[rows])

    def then(self, later: "Samples") -> "Samples":
        """These samples and later ones."""
        t, z, model, reference = (
            np.concatenate([getattr(self, k), getattr(later, k)]) for k in ("t", "z", "model", "reference")
        )
        return replace(self, t=t, z=z, model=model, reference=reference)


@dataclass(frozen=True, eq=False)
class Memory:
    """What a prediction remembers: the corrected velocity of the sample before, and the low-pass filter's output,
    (outputs,) each."""

    velocity: np.ndarray
    delta: np.ndarray


@dataclass(frozen=True, eq=False)
class Prediction:
    """z (n, inputs) as the network saw them; delta and velocity (n, outputs), filtered and corrected; before: the
    memory before each sample, and after the last, n + 1 of them."""

    z: np.ndarray
    delta: np.ndarray
    velocity: np.ndarray
    before: tuple[Memory, ...]


def initial_memory(samples: Samples) -> Memory:
    """Before the first sample: the model's velocity, no correction."""
    return Memory(samples.model[0].copy(), np.zeros(samples.model.shape[1]))


def passed(step: float, time_constant: float) -> float:
    """Share of a new output that the paper's low-pass filter lets through in a step; 1 for a time constant of 0 s."""
    return 1.0 if time_constant == 0.0 else float(-np.expm1(-step / time_constant))


def predict(residuals: Sequence[Residual], samples: Samples, memory: Memory, time_constant: float = 0.0) -> Prediction:
    """velocity_k = model_k + low pass of the summed residuals at z_k; time_constant: s of the low pass, 0 for none."""
    n, o = samples.model.shape
    share = passed(samples.step, time_constant)
    z, delta = samples.z.copy(), np.zeros((n, o))
    if not samples.fed_back:
        delta = _sum(residuals, z, o)
    velocity = np.empty((n, o))
    before = [memory]
    for k in range(n):
        if samples.fed_back:
            z[k, :o] = memory.velocity
            delta[k] = _sum(residuals, z[k : k + 1], o)[0]
        delta[k] = memory.delta + share * (delta[k] - memory.delta)
        velocity[k] = samples.model[k] + delta[k]
        memory = Memory(velocity[k], delta[k])
        before.append(memory)
    return Prediction(z, delta, velocity, tuple(before))


def response(
    residuals: Sequence[Residual], samples: Samples, at: Prediction, time_constant: float = 0.0
) -> np.ndarray | None:
    """(outputs * n, outputs * n): what an output at one sample does to the velocities from there on, to first order.

    Stacked component by component over the samples, as in `learning.filter.window`. None where an output acts on its
    own sample alone.
    """
    share = passed(samples.step, time_constant)
    if share == 1.0 and not samples.fed_back:
        return None
    n, o = samples.model.shape
    keep = _kept(residuals, samples, at, share)
    out = np.zeros((o, n, o, n))
    effect = np.zeros((o, o, n))  # on the velocity at hand, of each output at each sample
    for k in range(n):
        effect = np.einsum("ab,bcj->acj", keep[k], effect)
        effect[np.arange(o), np.arange(o), k] = share
        out[:, k] = effect
    return out.reshape(o * n, o * n)


def feedback_growth(residuals: Sequence[Residual], z: np.ndarray, outputs: int) -> float:
    """Largest factor at inputs z (n, inputs) by which a velocity that feeds back lives on from one sample to the next
    through the residuals: 1 or more runs away."""
    slope = sum((input_slope_of(r, z)[:, :, :outputs] for r in residuals), np.zeros((len(z), outputs, outputs)))
    return float(np.abs(np.linalg.eigvals(slope)).max())


def _kept(residuals: Sequence[Residual], samples: Samples, at: Prediction, share: float) -> np.ndarray:
    """(n, outputs, outputs): what is left of a change of velocity at the next sample, to first order."""
    n, o = samples.model.shape
    keep = np.broadcast_to((1.0 - share) * np.eye(o), (n, o, o)).copy()
    if samples.fed_back:
        for r in residuals:
            keep += share * input_slope_of(r, at.z)[:, :, :o]
    return keep


def input_slope_of(residual: Residual, z: np.ndarray) -> np.ndarray:
    """(n, outputs, inputs): d delta / d z at z (n, inputs), physical units; 0 where an input is held at its limit."""
    scaled = (z - residual.input_mean) / residual.input_scale
    inside = np.abs(scaled) < residual.limit
    slope = input_slope(residual.net, residual.theta, residual.scaled(z))
    return np.asarray(residual.output_scale[:, None] * slope * (inside / residual.input_scale)[:, None, :])


def h2_norms(samples: Samples, velocity: np.ndarray) -> np.ndarray:
    """(n,) |x_ref - x_pred|, the paper's H2 norm at each sample; NaN where a component was not seen."""
    return np.asarray(np.linalg.norm(samples.reference - velocity, axis=1))


def reference_outliers(samples: Samples, far: float = 6.0) -> np.ndarray:
    """(n,) bool: references more than `far` standard deviations from the median of the six samples about them.

    Found from the reference alone, whatever a model says.
    """
    y = samples.reference
    around = np.lib.stride_tricks.sliding_window_view(np.pad(y, ((3, 3), (0, 0)), mode="edge"), 7, axis=0)
    around = np.delete(around, 3, axis=-1)  # on a slope the sample itself is the median
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # seven missing samples in a row: nothing is flagged
        off = np.abs(y - np.nanmedian(around, axis=-1))
        sigma = 1.4826 * np.nanmedian(off, axis=0)
    return np.asarray((off > far * sigma).any(axis=1))


def _sum(residuals: Sequence[Residual], z: np.ndarray, outputs: int) -> np.ndarray:
    total = np.zeros((len(z), outputs))
    for r in residuals:
        total = total + r(z)
    return total
