"""The robot as URDF, for PyBullet; the same figures as in MJCF."""

from plants.wheeled.engines.geometry import WHEELS, Geometry, Wheel, wheel_inertia


def urdf(geometry: Geometry) -> str:
    """The model as text. A tyre is a sphere, as in MJCF. URDF knows no motors: `bullet_drive` adds them."""
    x, y, z = geometry.centre
    back, round_ = geometry.castor
    down = round_ - geometry.left.radius
    ixx, iyy, izz = geometry.inertia
    sides = (0.5 * geometry.track, -0.5 * geometry.track)
    wheels = "".join(_wheel(n, w, s) for n, w, s in zip(WHEELS, geometry.wheels, sides, strict=True))
    return f"""<robot name="two_wheels">
  <link name="chassis">
    <inertial>
      <origin xyz="{x:.9g} {y:.9g} {z:.9g}"/>
      <mass value="{geometry.mass:.9g}"/>
      <inertia ixx="{ixx:.9g}" iyy="{iyy:.9g}" izz="{izz:.9g}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision>
      <origin xyz="{back:.9g} 0 {down:.9g}"/>
      <geometry><sphere radius="{round_:.9g}"/></geometry>
    </collision>
  </link>
{wheels}</robot>
"""


def _wheel(name: str, wheel: Wheel, side: float) -> str:
    about, across = wheel_inertia(wheel)
    return f"""  <link name="{name}_wheel">
    <inertial>
      <mass value="{wheel.mass:.9g}"/>
      <inertia ixx="{across:.9g}" iyy="{about:.9g}" izz="{across:.9g}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision><geometry><sphere radius="{wheel.radius:.9g}"/></geometry></collision>
  </link>
  <joint name="{name}" type="continuous">
    <parent link="chassis"/><child link="{name}_wheel"/>
    <origin xyz="0 {side:.9g} 0"/><axis xyz="0 1 0"/>
  </joint>
"""
