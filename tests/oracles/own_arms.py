"""Arms like a UR5e and a Panda without meshes: published kinematics, link masses and servos, inertias of the links as
given for simulation; and a crooked arm for the corner cases of a description.

UR5e: the manufacturer's DH table and link masses, position servos as in common MuJoCo models of it. Panda: the DH table
of its data sheet, masses from Gaz et al., IEEE RA-L 4(4), 2019, table V, moments rounded.
"""

from __future__ import annotations

UR5E = """
<mujoco model="ur5e_like">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <joint axis="0 1 0" range="-6.2831 6.2831" armature="0.1" damping="1"/>
    <general biastype="affine" gainprm="2000" biasprm="0 -2000 -400" forcerange="-150 150" ctrlrange="-6.2831 6.2831"/>
    <default class="wrist">
      <general gainprm="500" biasprm="0 -500 -100" forcerange="-28 28"/>
    </default>
  </default>
  <worldbody>
    <body name="base" quat="0 0 0 1">
      <inertial mass="4" pos="0 0 0" diaginertia="0.0044 0.0044 0.0072"/>
      <body name="shoulder" pos="0 0 0.163">
        <inertial pos="0 0 0" mass="3.7" diaginertia="0.0103 0.0103 0.0067"/>
        <joint name="shoulder_pan" axis="0 0 1"/>
        <body name="upper_arm" pos="0 0.138 0" quat="1 0 1 0">
          <inertial pos="0 0 0.2125" mass="8.393" diaginertia="0.1339 0.1339 0.0151"/>
          <joint name="shoulder_lift"/>
          <body name="forearm" pos="0 -0.131 0.425">
            <inertial pos="0 0 0.196" mass="2.275" diaginertia="0.0312 0.0312 0.0041"/>
            <joint name="elbow" range="-3.1415 3.1415"/>
            <body name="wrist1" pos="0 0 0.392" quat="1 0 1 0">
              <inertial pos="0 0.127 0" mass="1.219" diaginertia="0.0026 0.0026 0.0022"/>
              <joint name="wrist1"/>
              <body name="wrist2" pos="0 0.127 0">
                <inertial pos="0 0 0.1" mass="1.219" diaginertia="0.0026 0.0026 0.0022"/>
                <joint name="wrist2" axis="0 0 1"/>
                <body name="wrist3" pos="0 0 0.1">
                  <inertial pos="0 0.0771683 0" quat="1 0 0 1" mass="0.1889" diaginertia="0.0001 0.0001 0.00013"/>
                  <joint name="wrist3"/>
                  <site name="tool" pos="0 0.1 0"/>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general name="shoulder_pan" joint="shoulder_pan"/>
    <general name="shoulder_lift" joint="shoulder_lift"/>
    <general name="elbow" joint="elbow"/>
    <general class="wrist" name="wrist1" joint="wrist1"/>
    <general class="wrist" name="wrist2" joint="wrist2"/>
    <general class="wrist" name="wrist3" joint="wrist3"/>
  </actuator>
</mujoco>"""

_PANDA_JOINTS = (  # place (m), turn, mass (kg), centre (m), moments (kg m^2), range (rad)
    ("0 0 0.333", "1 0 0 0", 4.97, "0.0039 0.0021 -0.0476", "0.7034 0.7066 0.0091", "-2.8973 2.8973"),
    ("0 0 0", "1 -1 0 0", 0.647, "-0.0031 -0.0287 0.0035", "0.0080 0.0281 0.0260", "-1.7628 1.7628"),
    ("0 -0.316 0", "1 1 0 0", 3.229, "0.0275 0.0393 -0.0665", "0.0372 0.0361 0.0108", "-2.8973 2.8973"),
    ("0.0825 0 0", "1 1 0 0", 3.588, "-0.0532 0.1044 0.0275", "0.0259 0.0196 0.0283", "-3.0718 -0.0698"),
    ("-0.0825 0.384 0", "1 -1 0 0", 1.226, "-0.0120 0.0411 -0.0384", "0.0355 0.0295 0.0086", "-2.8973 2.8973"),
    ("0 0 0", "1 1 0 0", 1.667, "0.0601 -0.0141 -0.0105", "0.0020 0.0043 0.0054", "-0.0175 3.7525"),
    ("0.088 0 0", "1 1 0 0", 0.735, "0.0105 -0.0043 0.0616", "0.0125 0.0100 0.0048", "-2.8973 2.8973"),
)
_PANDA_SERVOS = ((4500, 450, 87), (4500, 450, 87), (3500, 350, 87), (3500, 350, 87)) + ((2000, 200, 12),) * 3


def panda(kind: str = "position") -> str:
    """The Panda with servos of one kind: "position", "velocity", or "torque"."""
    bodies, actuators = [], []
    for k, (place, turn, mass, centre, moments, span) in enumerate(_PANDA_JOINTS, start=1):
        bodies.append(
            f'<body name="link{k}" pos="{place}" quat="{turn}"><joint name="joint{k}" axis="0 0 1" range="{span}" '
            f'armature="0.1" damping="1"/><inertial mass="{mass}" pos="{centre}" diaginertia="{moments}"/>'
        )
        kp, kv, most = _PANDA_SERVOS[k - 1]
        own = {
            "position": f'<position kp="{kp}" kv="{kv}" ctrlrange="{span}"',
            "velocity": f'<velocity kv="{kv}" ctrlrange="-2 2"',
            "torque": f'<motor ctrlrange="{-most} {most}"',
        }[kind]
        actuators.append(f'{own} name="joint{k}" joint="joint{k}" forcerange="{-most} {most}"/>')
    return (
        '<mujoco model="panda_like"><compiler angle="radian" balanceinertia="true"/>'
        '<option timestep="0.002" integrator="implicitfast"/><worldbody>'
        + "".join(bodies)
        + '<body name="hand" pos="0 0 0.107" quat="0.92388 0 0 -0.38268"><inertial mass="0.73" pos="-0.01 0 0.03" '
        'diaginertia="0.001 0.0025 0.0017"/><site name="tool" pos="0 0 0.1034"/></body>'
        + "</body>" * len(_PANDA_JOINTS)
        + f"</worldbody><actuator>{''.join(actuators)}</actuator></mujoco>"
    )


CROOKED = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast" gravity="1 -2 -9"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="stand" pos="0.1 0.2 0.3" euler="0.3 0.2 0.1">
      <geom type="box" size="0.1 0.1 0.1" mass="5"/>
      <body name="rail" pos="0 0 0.2" euler="0.1 0 0.4">
        <joint name="rail" type="slide" axis="1 0.2 0" ref="0.1" range="-1 1" stiffness="3" springref="0.2"/>
        <joint name="turret" axis="0 0.1 1" pos="0.05 0.02 0" damping="0.3"/>
        <geom type="box" pos="0.1 0.01 0" size="0.1 0.02 0.03" euler="0.1 0.2 0.3" mass="2"/>
        <body name="bracket" pos="0.2 0 0.1" euler="0.5 0 0">
          <geom type="capsule" fromto="0 0 0 0.1 0 0.05" size="0.02" mass="0.5"/>
          <body name="arm" pos="0.1 0 0.05">
            <joint name="arm" axis="0 1 0.2" pos="0 0.03 0.01" armature="0.02" damping="0.2" range="-2 2"/>
            <geom type="capsule" fromto="0 0 0 0.3 0.1 0" size="0.02" mass="0.7"/>
            <site name="tool" pos="0.3 0.1 0"/>
          </body>
        </body>
        <body name="side" pos="-0.1 0 0.1">
          <joint name="side" axis="1 0 0" damping="0.1"/>
          <geom type="box" pos="0 0.1 0" size="0.02 0.1 0.02" mass="0.4"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="rail" joint="rail" kp="400" kv="60" forcerange="-80 80"/>
    <velocity name="turret" joint="turret" kv="20" gear="2"/>
    <position name="arm" joint="arm" kp="50" kv="1" gear="2"/>
    <motor name="side" joint="side" gear="3" ctrlrange="-2 2"/>
  </actuator>
</mujoco>"""
