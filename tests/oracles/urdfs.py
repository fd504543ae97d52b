"""A two-joint arm as a URDF."""

from __future__ import annotations

LINK = """<link name="{name}"><inertial><origin xyz="0.1 0 0.02"/><mass value="0.5"/>
  <inertia ixx="0.01" iyy="0.012" izz="0.008" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at} 0 0"/>
  <axis xyz="0 1 0"/><limit lower="{low}" upper="{high}" effort="50" velocity="9"/>
  <dynamics damping="0.1" friction="0.02"/></joint>"""


def arm_urdf(joints: tuple[str, str], low: float, high: float) -> str:
    """Links `upper` and `lower` of 0.3 m on joints from low to high, rad; effort up to 50 N m."""
    first, second = (
        JOINT.format(name=name, parent=parent, child=child, at=at, low=low, high=high)
        for name, parent, child, at in zip(joints, ("base", "upper"), ("upper", "lower"), (0, 0.3), strict=True)
    )
    links = "".join(LINK.format(name=name) for name in ("upper", "lower"))
    return f'<robot name="arm"><link name="base"/>{links}{first}{second}</robot>'
