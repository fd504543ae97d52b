"""The arm as URDF, an open tree: a simulator closes the loop between the links `loop_b` and `loop_e` itself."""

from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER, Arm, Body, Frame, Triple

# PyBullet gives a link without an inertia 1 kg, with a warning on the standard output
NOTHING = Body(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def urdf(arm: Arm = SCALER, friction: bool = True) -> str:
    """The text of the model. Link `tool` is the tool point; `loop_b` and `loop_e` are to be held together."""
    parts = ['<robot name="scaler_arm">', _link("body", NOTHING)]
    for joint in arm.joints:
        driven = joint.name in MOTORS
        damping = (arm.servo.friction if driven else arm.passive_friction) if friction else 0.0
        kind, limit = "continuous", ""  # the loop holds the passive joints
        if driven:
            low, high = arm.limits[MOTORS.index(joint.name)]
            kind = "revolute"
            limit = f'<limit lower="{low:g}" upper="{high:g}" effort="{arm.servo.torque:g}" velocity="{arm.speed:g}"/>'
        parts.append(_link(joint.name, joint.body))
        parts.append(
            f'  <joint name="{joint.name}" type="{kind}"><parent link="{joint.parent}"/><child link="{joint.name}"/>'
            f'{_origin(joint.frame)}<axis xyz="0 0 1"/><dynamics damping="{damping:g}" friction="0"/>{limit}</joint>'
        )
    parts += [_link("gripper", arm.gripper_body), _fixed("gripper", "wrist3", arm.gripper)]
    for name, parent, at in (("tool", "gripper", arm.tool), ("loop_b", "b", arm.on_b), ("loop_e", "e", arm.on_e)):
        parts += [_link(name, NOTHING), _fixed(name, parent, Frame(at))]
    parts.append("</robot>")
    return "\n".join(parts) + "\n"


def _link(name: str, body: Body) -> str:
    ixx, iyy, izz = body.inertia
    return (
        f'  <link name="{name}"><inertial><origin xyz="{_text(body.com)}"/><mass value="{body.mass!r}"/>'
        f'<inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _fixed(name: str, parent: str, frame: Frame) -> str:
    ends = f'<parent link="{parent}"/><child link="{name}"/>'
    return f'  <joint name="to_{name}" type="fixed">{ends}{_origin(frame)}</joint>'


def _origin(frame: Frame) -> str:
    return f'<origin xyz="{_text(frame.xyz)}" rpy="{_text(frame.rpy)}"/>'


def _text(v: Triple) -> str:
    return " ".join(repr(x) for x in v)
