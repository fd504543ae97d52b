"""Closed chains: the joints that no motor drives and the loops determine, solved from the others."""

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from plants.mujoco_robot.structure.base import hinges_and_slides
from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    import mujoco

NEAR = 0.2  # rad or m that the given joints may move at once: on longer ways Newton could land on another branch
SWEEPS = 20
CLOSED = 1e-10  # m or rad
CLOSES_AT_REST = 1e-4  # m or rad: how far a model's loop may be open as it is drawn, after Newton
INDEPENDENT = 1e-6  # smallest singular value, m/rad, of joints that a loop determines


class Loops(Protocol):
    """What closes a robot's loops."""

    @property
    def passive(self) -> tuple[str, ...]:
        """Names of the joints that follow from the others."""
        ...

    def close(self, q: np.ndarray, v: np.ndarray) -> None:
        """Overwrite the passive joints' entries in positions (B, nq) and velocities (B, nv), in place."""
        ...


@dataclass(frozen=True, eq=False)
class SolvedLoops:
    """The loops of any compiled model, closed by Newton's method on the engine's own constraint, row by row.

    The branch is that of the model as it is drawn: every solution is reached from it, or from one reached before, in
    ways no longer than NEAR.
    """

    model: "mujoco.MjModel"  # with nothing but its equality constraints
    passive: tuple[str, ...]
    places: np.ndarray  # (p,) of the passive joints in qpos
    dofs: np.ndarray  # (p,) in qvel
    given: np.ndarray  # (joints - p,) in qpos, all others
    rest: np.ndarray  # (nq,) a pose whose loops are closed

    def close(self, q: np.ndarray, v: np.ndarray) -> None:
        """See Loops. What cannot be closed (a measurement that no pose explains) ends at the least opening."""
        import mujoco

        data = mujoco.MjData(self.model)
        distinct, back = np.unique(q[:, self.given], axis=0, return_inverse=True)
        solved = self.rest[None].copy()
        found = np.empty((len(distinct), len(self.places)))
        slopes = np.empty((len(distinct), len(self.places), self.model.nv))
        for row, target in enumerate(distinct):
            distance = np.abs(solved[:, self.given] - target).max(axis=1)
            pose = solved[int(np.argmin(distance))].copy()
            begin = pose[self.given].copy()
            for part in np.linspace(0.0, 1.0, 1 + max(1, int(np.ceil(distance.min() / NEAR))))[1:]:
                pose[self.given] = begin + part * (target - begin)
                jacobian = self._newton(data, pose)
            solved = np.concatenate([solved, pose[None]])
            found[row] = pose[self.places]
            slopes[row] = self._slope(jacobian)
        q[:, self.places] = found[back.reshape(-1)]
        others = v.copy()
        others[:, self.dofs] = 0.0
        v[:, self.dofs] = np.einsum("bpv,bv->bp", slopes[back.reshape(-1)], others)

    def _newton(self, data: "mujoco.MjData", pose: np.ndarray) -> np.ndarray:
        """Close the loops at the given joints of `pose` (nq,), in place; the constraint's Jacobian (c, nv) there."""
        for _ in range(SWEEPS):
            opening, jacobian = constraint(self.model, data, pose)
            if np.abs(opening).max() < CLOSED:
                break
            step = np.linalg.lstsq(jacobian[:, self.dofs], opening, rcond=None)[0]
            pose[self.places] -= step
        return jacobian

    def _slope(self, jacobian: np.ndarray) -> np.ndarray:
        """(p, nv): what the velocities of all others make of the passive ones'."""
        return np.asarray(-np.linalg.pinv(jacobian[:, self.dofs]) @ jacobian)


def constraint(model: "mujoco.MjModel", data: "mujoco.MjData", pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(opening (c,), its Jacobian (c, nv)) of the equality constraints at a pose (nq,), m or rad."""
    import mujoco

    data.qpos[:] = pose
    mujoco.mj_fwdPosition(model, data)
    equal = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    jacobian = np.asarray(data.efc_J).reshape(-1, model.nv)
    return np.asarray(data.efc_pos[equal]).copy(), jacobian[equal].copy()


def find_loops(model: "mujoco.MjModel", path: str) -> SolvedLoops | None:
    """The loops that a model's active equality constraints close; None where it has none.

    A joint without a motor that they leave undetermined moves freely, and the others follow it. Raises BadInput where
    they cannot be closed.
    """
    import mujoco

    if not (model.neq and model.eq_active0.any()):
        return None
    alone = copy.copy(model)
    alone.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    for off in ("CONTACT", "LIMIT", "FRICTIONLOSS"):
        alone.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{off}"))
    _, jacobian = constraint(alone, mujoco.MjData(alone), model.qpos0)
    simple, driven = hinges_and_slides(model), {int(j) for j in model.actuator_trnid[:, 0]}
    joints = [j for j in simple.tolist() if j not in driven]
    joints = [j for j in joints if np.abs(jacobian[:, model.jnt_dofadr[j]]).max() > INDEPENDENT]
    joints = _determined(joints, jacobian[:, model.jnt_dofadr[joints]])
    names = tuple(model.joint(j).name for j in joints)
    places, dofs = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    given = np.setdiff1d(model.jnt_qposadr[simple], places)
    loops = SolvedLoops(alone, names, places, dofs, given, model.qpos0.copy())
    rest = model.qpos0[None].copy()
    loops.close(rest, np.zeros((1, model.nv)))
    left, _ = constraint(alone, mujoco.MjData(alone), rest[0])
    if np.abs(left).max() > CLOSES_AT_REST:
        raise BadInput(
            f"the closed loops have gaps of {np.abs(left).max():.3g} m or rad with every motor at its reference",
            path,
            "change the model so that its loops are closed in the reference pose",
        )
    return SolvedLoops(alone, names, places, dofs, given, rest[0])


def _determined(joints: list[int], jacobian: np.ndarray) -> list[int]:
    """Those of the joints that the constraint's Jacobian (c, joints) determines, given the others; the last first."""
    chosen: list[int] = []
    for k in reversed(range(len(joints))):
        if np.linalg.matrix_rank(jacobian[:, [k, *chosen]], tol=INDEPENDENT) > len(chosen):
            chosen = [k, *chosen]
    return [joints[k] for k in chosen]
