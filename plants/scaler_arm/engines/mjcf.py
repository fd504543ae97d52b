"""The arm as MJCF: the loop held by a `connect` between two sites, the motors as position actuators."""

from dataclasses import dataclass

from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER, Arm, Body, Frame, Joint, Triple

TIMESTEP = 0.002  # s: five steps a command
# The loop as hard as the step allows. Softer, the rods give by tenths of a millimetre under the arm's own weight.
SOLREF = "0.004 1"
SOLIMP = "0.999 0.9999 0.001 0.5 2"


@dataclass(frozen=True)
class Options:
    """How the arm is simulated: s a step, with or without gravity, damping and motors."""

    timestep: float = TIMESTEP
    gravity: bool = True
    friction: bool = True
    motors: bool = True


def mjcf(arm: Arm = SCALER, options: Options | None = None) -> str:
    """The text of the model. Site `tool` is the tool point; sites `loop_b` and `loop_e` are held together."""
    how = options or Options()
    inside: dict[str, list[str]] = {}
    for joint in arm.joints:
        inside.setdefault(joint.parent, []).append(joint.name)
    actuators = _actuators(arm) if how.motors else ""
    return f"""<mujoco model="scaler_arm">
  <compiler angle="radian" eulerseq="XYZ" autolimits="true"/>
  <option timestep="{how.timestep:g}" integrator="implicitfast" gravity="0 0 {-9.81 if how.gravity else 0}"/>
  <worldbody>
{_tree("body", arm, inside, how, 2)}
  </worldbody>
  <equality>
    <connect name="loop" site1="loop_b" site2="loop_e" solref="{SOLREF}" solimp="{SOLIMP}"/>
  </equality>
{actuators}</mujoco>
"""


def _tree(parent: str, arm: Arm, inside: dict[str, list[str]], how: Options, depth: int) -> str:
    pad = "  " * depth
    lines = []
    for name in inside.get(parent, ()):
        joint = arm.joint(name)
        lines.append(f'{pad}<body name="{name}" {_place(joint.frame)}>')
        lines.append(f"{pad}  {_joint(joint, arm, how)}")
        lines.append(f"{pad}  {_inertial(joint.body)}")
        lines.extend(f"{pad}  {extra}" for extra in _extras(name, arm))
        below = _tree(name, arm, inside, how, depth + 1)
        lines.extend([below] if below else [])
        lines.append(f"{pad}</body>")
    return "\n".join(lines)


def _joint(joint: Joint, arm: Arm, how: Options) -> str:
    driven = joint.name in MOTORS
    friction = (arm.servo.friction if driven else arm.passive_friction) if how.friction else 0.0
    rotor = f' armature="{arm.servo.armature:g}"' if driven else ""
    stops = ""  # the loop holds the passive joints
    if driven:
        low, high = arm.limits[MOTORS.index(joint.name)]
        stops = f' range="{low:g} {high:g}"'
    return f'<joint name="{joint.name}" axis="0 0 1" damping="{friction:g}"{rotor}{stops}/>'


def _extras(name: str, arm: Arm) -> list[str]:
    if name == "b":
        return [f'<site name="loop_b" pos="{_text(arm.on_b)}"/>', _rod(arm.on_b)]
    if name == "e":
        return [f'<site name="loop_e" pos="{_text(arm.on_e)}"/>', _rod(arm.joint("wrist1").frame.xyz)]
    if name in ("a", "f"):
        return [_rod(arm.joint({"a": "b", "f": "e"}[name]).frame.xyz)]
    if name == "wrist3":
        return [
            f'<body name="gripper" {_place(arm.gripper)}>{_inertial(arm.gripper_body)}'
            f'<site name="tool" pos="{_text(arm.tool)}"/>{_rod(arm.tool)}</body>'
        ]
    return []


def _rod(end: Triple) -> str:
    """Something to see: it weighs nothing and touches nothing."""
    return f'<geom type="capsule" size="0.006" fromto="0 0 0 {_text(end)}" mass="0" contype="0" conaffinity="0"/>'


def _actuators(arm: Arm) -> str:
    s = arm.servo
    lines = [
        f'    <position name="{m}" joint="{m}" kp="{s.stiffness:g}" kv="{s.damping:g}" '
        f'forcerange="{-s.torque:g} {s.torque:g}"/>'
        for m in MOTORS
    ]
    return "  <actuator>\n" + "\n".join(lines) + "\n  </actuator>\n"


def _place(frame: Frame) -> str:
    return f'pos="{_text(frame.xyz)}" euler="{_text(frame.rpy)}"'


def _inertial(body: Body) -> str:
    return f'<inertial pos="{_text(body.com)}" mass="{body.mass!r}" diaginertia="{_text(body.inertia)}"/>'


def _text(v: Triple) -> str:
    return " ".join(repr(x) for x in v)
