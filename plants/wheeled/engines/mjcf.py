"""The robot as MJCF: a free chassis on two tyres and a frictionless castor."""

from plants.wheeled.engines.geometry import WHEELS, Geometry, Wheel, wheel_inertia

STIFF = "0.999 0.9999 0.001 0.5 2"
HARD = 0.005  # s, time constant of the contacts; MuJoCo wants two of its steps or more


def mjcf(geometry: Geometry, step: float = 0.001) -> str:
    """The model as text; `step` is the engine's, s.

    A tyre touches the ground in one point, as a sphere does: its rolling radius is the wheel's, and nothing scrubs
    in a turn. MuJoCo's contacts are soft: with its default they sink in by 1 % of the radius and roll 0.5 % short
    (HARD makes that 0.03 %), and creep sideways in turns (a large impratio stops that).
    """
    hard = f' solref="{max(HARD, 2.5 * step):.9g} 1"'
    x, y, z = geometry.centre
    back, round_ = geometry.castor
    # the castor reaches the ground where the lower wheel does, so that the robot stands level
    down = round_ - geometry.left.radius
    moments = " ".join(f"{i:.9g}" for i in geometry.inertia)
    bodies = "".join(_wheel(n, w, s) for n, w, s in zip(WHEELS, geometry.wheels, _sides(geometry), strict=True))
    motors = "".join(
        f'    <velocity name="{n}" joint="{n}" kv="{w.gain:.9g}" forcerange="{-w.torque:.9g} {w.torque:.9g}"/>\n'
        for n, w in zip(WHEELS, geometry.wheels, strict=True)
    )
    pairs = "".join(
        f'    <pair name="{n}" geom1="{n}" geom2="ground" condim="3" friction="{w.grip:.9g} {w.grip:.9g}"{hard}/>\n'
        for n, w in zip(WHEELS, geometry.wheels, strict=True)
    )
    return f"""<mujoco model="two_wheels">
  <option timestep="{step:.9g}" integrator="implicitfast" cone="elliptic" impratio="100"/>
  <default>
    <geom contype="0" conaffinity="0"/>
    <joint damping="0"/>
  </default>
  <worldbody>
    <geom name="ground" type="plane" size="0 0 1"/>
    <body name="chassis" pos="0 0 {geometry.left.radius:.9g}">
      <freejoint name="base"/>
      <inertial pos="{x:.9g} {y:.9g} {z:.9g}" mass="{geometry.mass:.9g}" diaginertia="{moments}"/>
      <geom name="castor" type="sphere" size="{round_:.9g}" pos="{back:.9g} 0 {down:.9g}"/>
      <site name="chassis" pos="{x:.9g} {y:.9g} {z:.9g}"/>
{bodies}    </body>
  </worldbody>
  <contact>
{pairs}    <pair name="castor" geom1="castor" geom2="ground" condim="1"{hard}/>
  </contact>
  <actuator>
{motors}  </actuator>
</mujoco>
"""


def _sides(geometry: Geometry) -> tuple[float, float]:
    return 0.5 * geometry.track, -0.5 * geometry.track


def _wheel(name: str, wheel: Wheel, side: float) -> str:
    about, across = wheel_inertia(wheel)
    # MuJoCo's dry friction is a soft constraint, which creeps while it sticks unless it is made stiff
    dry = "" if wheel.plain else f' frictionloss="{wheel.kinetic:.9g}" solimpfriction="{STIFF}"'
    return f"""      <body name="{name}_wheel" pos="0 {side:.9g} 0">
        <joint name="{name}" type="hinge" axis="0 1 0" armature="{wheel.armature:.9g}"{dry}/>
        <inertial pos="0 0 0" mass="{wheel.mass:.9g}" diaginertia="{across:.9g} {about:.9g} {across:.9g}"/>
        <geom name="{name}" type="sphere" size="{wheel.radius:.9g}"/>
      </body>
"""
