"""Mass matrix, bias force and tool position of a described robot in CasADi, by the algorithms of adam-robotics."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from plants.mujoco_robot.symbolic.description import WORLD, Description, JointPlace
from residual_mpc.extras import extra


def mass_and_bias(d: Description, gravity: Sequence[Any], q: Any, v: Any) -> tuple[Any, Any]:
    """M(q) (n, n) without rotor inertias and c(q, v) (n,) of M v' + c = torques, for SX columns q, v (n,).

    gravity: (3,) m/s^2, numbers or SX.
    """
    with extra("arm"):
        import casadi as ca

    algorithms = _algorithms(d)
    mass, _ = algorithms.crba(ca.SX.eye(4), q - ca.DM([j.zero for j in d.joints]))
    return mass.array[6:, 6:], _bias(algorithms, d, gravity, q, v)


def gravity_torques(d: Description, gravity: Sequence[Any], q: Any) -> Any:
    """g(q) (n,) N m (N): c(q, 0) of `mass_and_bias`."""
    with extra("arm"):
        import casadi as ca

    return _bias(_algorithms(d), d, gravity, q, ca.SX.zeros(len(d.joints)))


def _bias(algorithms: Any, d: Description, gravity: Sequence[Any], q: Any, v: Any) -> Any:
    import casadi as ca

    pull = ca.vertcat(*[ca.SX(g) for g in gravity], ca.SX.zeros(3))
    turned = q - ca.DM([j.zero for j in d.joints])
    return algorithms.rnea(ca.SX.eye(4), turned, ca.SX.zeros(6), v, pull).array[6:]


def tool_place(d: Description, q: Any) -> tuple[Any, Any]:
    """Position of the payload site in the world, (3,) m, and rotation of its link, (3, 3)."""
    with extra("arm"):
        import casadi as ca

    by_name = {j.name: (i, j) for i, j in enumerate(d.joints)}
    chain: list[tuple[int, JointPlace]] = []
    link = d.tool_link
    while link != WORLD:
        chain.append(by_name[link])
        link = chain[-1][1].parent
    place, turn = ca.SX.zeros(3), ca.SX.eye(3)
    for i, joint in reversed(chain):
        at, own = _moved(joint, q[i] - joint.zero)
        place, turn = place + ca.mtimes(turn, at), ca.mtimes(turn, own)
    return place + ca.mtimes(turn, d.tool), turn


def _moved(joint: JointPlace, q: Any) -> tuple[Any, Any]:
    """Position (3,) m and rotation (3, 3) of the joint's link in its parent's frame, q counted from qpos0."""
    import casadi as ca

    fixed, axis = ca.DM(joint.turn), ca.DM(joint.axis)
    if joint.slides:
        return joint.place + ca.mtimes(fixed, axis) * q, ca.SX(fixed)
    k = ca.skew(axis)
    own = ca.DM.eye(3) + ca.sin(q) * k + (1.0 - ca.cos(q)) * ca.mtimes(k, k)  # Rodrigues
    return joint.place, ca.mtimes(fixed, own)


def _algorithms(d: Description) -> Any:
    with extra("arm"):
        from adam.casadi.casadi_like import SpatialMath
        from adam.core import RBDAlgorithms
        from adam.core.constants import Representations
        from adam.model import Model

    math = SpatialMath()
    names = [j.name for j in d.joints]
    algorithms = RBDAlgorithms(Model.build(_Factory(d, math), names), math)
    algorithms.set_frame_velocity_representation(Representations.BODY_FIXED_REPRESENTATION)
    return algorithms


class _Factory:
    """A description in the interface of adam.model.ModelFactory."""

    name = "robot"

    def __init__(self, d: Description, math: Any) -> None:
        self._links = [_Link(name, inertia, math) for name, inertia in d.inertias.items()]
        self._joints = [_Joint(joint, math) for joint in d.joints]

    def get_links(self) -> "list[_Link]":
        return self._links

    def get_joints(self) -> "list[_Joint]":
        return self._joints

    def get_frames(self) -> "list[_Link]":
        return []


@dataclass(eq=False)
class _Link:
    """A link in adam's interface."""

    name: str
    inertia: Any
    math: Any

    def spatial_inertia(self) -> Any:
        import casadi as ca
        from adam.casadi.casadi_like import CasadiLike

        return CasadiLike(ca.SX(self.inertia))


class _Joint:
    """A joint in adam's interface; adam assigns its number (`idx`)."""

    type = "moving"

    def __init__(self, joint: JointPlace, math: Any) -> None:
        self._joint, self._math = joint, math
        self.name, self.parent, self.child = joint.name, joint.parent, joint.name
        self.idx: int | None = None

    def spatial_transform(self, q: Any) -> Any:
        """(6, 6) from the parent's to the link's coordinates."""
        import casadi as ca
        from adam.casadi.casadi_like import CasadiLike

        place, turn = _moved(self._joint, q.array)
        back = CasadiLike(ca.SX(turn).T)
        return self._math.spatial_transform(back, CasadiLike(-ca.mtimes(back.array, place)))

    def motion_subspace(self) -> Any:
        import casadi as ca
        from adam.casadi.casadi_like import CasadiLike

        axis, none = ca.SX(ca.DM(self._joint.axis)), ca.SX.zeros(3)
        return CasadiLike(ca.vertcat(axis, none) if self._joint.slides else ca.vertcat(none, axis))
