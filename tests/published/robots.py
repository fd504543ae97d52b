"""Four robots with the kinematics and inertias that their makers and model collections publish; none has its meshes.

UR5e: masses, lengths and torques of the maker's data sheet, as MuJoCo Menagerie and ur_description have them. Panda:
inertias and servos as in MuJoCo Menagerie. SO-101: the calibrated model of its makers. Rover: the size, masses and
wheels of a Clearpath Jackal.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

STEP = 0.002  # s, of the models
FINE_STEP = 0.001  # s, of wheels in contact


# ---------------------------------------------------------------- UR5e, a URDF as its ROS package has it

UR5E_JOINTS = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
)  # fmt: skip
# link, origin of its joint: xyz (m), rpy (rad); mass (kg), centre (m), moments xx, yy, zz (kg m^2); effort (N m)
UR5E_LINKS = (
    ("shoulder_link", (0, 0, 0.1625), (0, 0, 0), 3.7, (0, 0, 0), (0.0102675, 0.0102675, 0.00666), 150),
    ("upper_arm_link", (0, 0, 0), (pi / 2, 0, 0), 8.393, (-0.2125, 0, 0.138), (0.0151074, 0.133886, 0.133886), 150),
    ("forearm_link", (-0.425, 0, 0), (0, 0, 0), 2.275, (-0.1961, 0, 0.007), (0.004095, 0.0311796, 0.0311796), 150),
    ("wrist_1_link", (-0.3922, 0, 0.1333), (0, 0, 0), 1.219, (0, 0, 0), (0.0025599, 0.0025599, 0.0021942), 28),
    ("wrist_2_link", (0, -0.0997, 0), (pi / 2, 0, 0), 1.219, (0, 0, 0), (0.0025599, 0.0025599, 0.0021942), 28),
    ("wrist_3_link", (0, 0.0996, 0), (pi / 2, pi, pi), 0.1889, (0, 0, -0.0229), (9.909e-5, 9.909e-5, 1.321e-4), 28),
)


def ur5e_urdf() -> str:
    """With the meshes of a ROS package that is not there, and a tool frame."""
    parts = ['<robot name="ur5e">', '<link name="base_link"/>']
    parent = "base_link"
    for joint, (link, xyz, rpy, mass, centre, moments, effort) in zip(UR5E_JOINTS, UR5E_LINKS, strict=True):
        mesh = f"package://ur_description/meshes/ur5e/visual/{link}.dae"
        parts += [
            f'<link name="{link}"><inertial><origin xyz="{_row(centre)}"/><mass value="{mass}"/>',
            '<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial>'.format(*moments),
            f'<visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>',
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{link}"/>',
            f'<origin xyz="{_row(xyz)}" rpy="{_row(rpy)}"/><axis xyz="0 0 1"/>',
            f'<limit lower="-6.2832" upper="6.2832" effort="{effort}" velocity="3.14"/></joint>',
        ]
        parent = link
    parts += [
        '<link name="tool0"/><joint name="tool0_joint" type="fixed"><parent link="wrist_3_link"/><child link="tool0"/>',
        "</joint></robot>",
    ]
    return "\n".join(parts)


# ---------------------------------------------------------------- Panda, an MJCF with its gripper on a tendon

# name, pos (m), quat; mass, centre, inertia xx yy zz xy xz yz; joint range; gain, damping (servo), force
PANDA_LINKS = (
    ("link1", (0, 0, 0.333), (1, 0, 0, 0), 4.970684, (0.003875, 0.002081, -0.04762),
     (0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169), (-2.8973, 2.8973), 4500, 450, 87),
    ("link2", (0, 0, 0), (1, -1, 0, 0), 0.646926, (-0.003141, -0.02872, 0.003495),
     (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704), (-1.7628, 1.7628), 4500, 450, 87),
    ("link3", (0, -0.316, 0), (1, 1, 0, 0), 3.228604, (0.027518, 0.039252, -0.066502),
     (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805), (-2.8973, 2.8973), 3500, 350, 87),
    ("link4", (0.0825, 0, 0), (1, 1, 0, 0), 3.587895, (-0.05317, 0.104419, 0.027454),
     (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641), (-3.0718, -0.0698), 3500, 350, 87),
    ("link5", (-0.0825, 0.384, 0), (1, -1, 0, 0), 1.225946, (-0.011953, 0.041065, -0.038437),
     (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229), (-2.8973, 2.8973), 2000, 200, 12),
    ("link6", (0, 0, 0), (1, 1, 0, 0), 1.666555, (0.060149, -0.014117, -0.010517),
     (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341), (-0.0175, 3.7525), 2000, 200, 12),
    ("link7", (0.088, 0, 0), (1, 1, 0, 0), 0.735522, (0.010517, -0.004252, 0.061597),
     (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741), (-2.8973, 2.8973), 2000, 200, 12),
)  # fmt: skip
PANDA_JOINTS = tuple(f"joint{k}" for k in range(1, 8))
FINGER = """<body name="{name}" pos="0 0 0.0584" quat="{quat}">
<inertial mass="0.015" pos="0 0 0" diaginertia="2.375e-6 2.375e-6 7.5e-7"/>
<joint name="{joint}" axis="0 1 0" type="slide" range="0 0.04"/><geom mesh="finger" type="mesh"/></body>"""
PANDA_END = """<tendon><fixed name="split"><joint joint="finger_joint1" coef="0.5"/>
<joint joint="finger_joint2" coef="0.5"/></fixed></tendon>
<equality><joint joint1="finger_joint1" joint2="finger_joint2" solref="0.005 1"/></equality>"""


def panda_mjcf() -> str:
    """Seven servos, a gripper that nobody drives in the logs, a camera and a sensor."""
    hand = (
        '<body name="hand" pos="0 0 0.107" quat="0.9238795 0 0 -0.3826834"><inertial mass="0.73" pos="-0.01 0 0.03" '
        'diaginertia="0.001 0.0025 0.0017"/><geom mesh="hand" type="mesh"/><site name="tcp" pos="0 0 0.1034"/>'
        '<camera name="wrist"/>'
        + FINGER.format(name="left_finger", quat="1 0 0 0", joint="finger_joint1")
        + FINGER.format(name="right_finger", quat="0 0 0 1", joint="finger_joint2")
        + "</body>"
    )
    body = hand
    for joint, (name, pos, quat, mass, centre, inertia, span, *_) in reversed(
        [*zip(PANDA_JOINTS, PANDA_LINKS, strict=True)]
    ):
        body = (
            f'<body name="{name}" pos="{_row(pos)}" quat="{_row(quat)}"><inertial mass="{mass}" pos="{_row(centre)}" '
            f'fullinertia="{_row(inertia)}"/><joint name="{joint}" axis="0 0 1" range="{_row(span)}" armature="0.1" '
            f'damping="1"/><geom mesh="{name}" type="mesh"/>{body}</body>'
        )
    servos = "".join(
        f'<general name="actuator{k + 1}" joint="{joint}" biastype="affine" gainprm="{kp}" biasprm="0 -{kp} -{kv}" '
        f'forcerange="-{force} {force}" ctrlrange="{_row(span)}"/>'
        for k, (joint, (*_, span, kp, kv, force)) in enumerate(zip(PANDA_JOINTS, PANDA_LINKS, strict=True))
    )
    gripper = (
        '<general name="actuator8" tendon="split" biastype="affine" forcerange="-100 100" ctrlrange="0 255" '
        'gainprm="0.0157" biasprm="0 -100 -10"/>'
    )
    meshes = "".join(f'<mesh file="{name}.stl"/>' for name in (*(link[0] for link in PANDA_LINKS), "hand", "finger"))
    return (
        f'<mujoco model="panda"><compiler angle="radian" meshdir="assets" autolimits="true"/>'
        f'<option integrator="implicitfast" timestep="{STEP}"/><asset>{meshes}</asset><worldbody>{body}</worldbody>'
        f'{PANDA_END}<actuator>{servos}{gripper}</actuator><sensor><force name="wrench" site="tcp"/></sensor></mujoco>'
    )


# ---------------------------------------------------------------- SO-101, an MJCF

# name, joint, pos, quat; mass, centre, inertia xx yy zz xy xz yz; joint range
SO101_LINKS = (
    ("shoulder", "shoulder_pan", (0.0388353, 0, 0.0624), (0, 0, -1, 0), 0.100006,
     (-0.0307604, -1.66727e-05, -0.0252713),
     (8.3759e-05, 8.10403e-05, 2.39783e-05, 7.55525e-08, -1.16342e-06, 1.54663e-07), (-1.91986, 1.91986)),
    ("upper_arm", "shoulder_lift", (-0.0303992, -0.0182778, -0.0542), (0.5, -0.5, -0.5, -0.5), 0.103,
     (-0.0898471, -0.00838224, 0.0184089),
     (4.08002e-05, 0.000147318, 0.000142487, -1.97819e-05, -4.03016e-08, 8.97326e-09), (-1.74533, 1.74533)),
    ("lower_arm", "elbow_flex", (-0.11257, -0.028, 0), (0.707107, 0, 0, 0.707107), 0.104,
     (-0.0980701, 0.00324376, 0.0182831),
     (2.87438e-05, 0.000159844, 0.00014529, 7.41152e-06, 1.26409e-06, -4.90188e-08), (-1.69, 1.69)),
    ("wrist", "wrist_flex", (-0.1349, 0.0052, 0), (0.707107, 0, 0, -0.707107), 0.079,
     (-0.000103312, -0.0386143, 0.0281156),
     (3.68263e-05, 2.5391e-05, 2.1e-05, 1.7893e-08, -5.28128e-08, 3.6412e-06), (-1.65806, 1.65806)),
    ("gripper", "wrist_roll", (0, -0.0611, 0.0181), (0.0172091, -0.0172091, 0.706897, 0.706897), 0.087,
     (0.000213627, 0.000245138, -0.025187),
     (2.75087e-05, 4.33657e-05, 3.45059e-05, -3.35241e-07, -5.7352e-06, -5.17847e-08), (-2.74385, 2.84121)),
    ("moving_jaw", "gripper", (0.0202, 0.0188, -0.0234), (0.707107, 0.707107, 0, 0), 0.012,
     (-0.00157495, -0.0300244, 0.0192755),
     (6.61427e-06, 1.89032e-06, 5.28738e-06, -3.19807e-07, -5.90717e-09, -1.09945e-07), (-0.174533, 1.74533)),
)  # fmt: skip
SO101_JOINTS = tuple(link[1] for link in SO101_LINKS)
SO101_GAIN, SO101_FORCE = 50.0, 3.35  # N m/rad, N m


def so101_mjcf() -> str:
    """Six STS3215 servos and a frame at the gripper; its shapes are absent."""
    body = ""
    for name, joint, pos, quat, mass, centre, inertia, span in reversed(SO101_LINKS):
        site = '<site name="gripperframe" pos="-0.0079 -0.0002 -0.0981"/>' if name == "gripper" else ""
        body = (
            f'<body name="{name}" pos="{_row(pos)}" quat="{_row(quat)}"><inertial mass="{mass}" pos="{_row(centre)}" '
            f'fullinertia="{_row(inertia)}"/><joint name="{joint}" axis="0 0 1" range="{_row(span)}" damping="0.6" '
            f'frictionloss="0.052" armature="0.028"/><geom mesh="{name}" type="mesh"/>{site}{body}</body>'
        )
    servos = "".join(
        f'<position name="{j}" joint="{j}" kp="{SO101_GAIN}" forcerange="-{SO101_FORCE} {SO101_FORCE}"/>'
        for j in SO101_JOINTS
    )
    meshes = "".join(f'<mesh file="{link[0]}.stl"/>' for link in SO101_LINKS)
    return (
        f'<mujoco model="so101"><compiler angle="radian" meshdir="assets" autolimits="true"/>'
        f'<option integrator="implicitfast" timestep="{STEP}"/><asset>{meshes}</asset>'
        f"<worldbody>{body}</worldbody><actuator>{servos}</actuator></mujoco>"
    )


# ---------------------------------------------------------------- a rover that steers by skidding, an MJCF

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
WHEEL_RADIUS, TRACK, WHEELBASE = 0.098, 0.3756, 0.262  # m


def rover_mjcf() -> str:
    """Four driven wheels on a ground."""
    wheels = "".join(
        f'<body name="{w}_wheel" pos="{(1 if "front" in w else -1) * WHEELBASE / 2} '
        f'{(1 if "left" in w else -1) * TRACK / 2} 0.0345"><joint name="{w}_wheel" axis="0 1 0" armature="0.01"/>'
        f'<inertial pos="0 0 0" mass="0.477" diaginertia="0.0013 0.0024 0.0013"/>'
        f'<geom type="ellipsoid" size="{WHEEL_RADIUS} 0.03 {WHEEL_RADIUS}" mass="0" friction="0.7 0.005 0.0001" '
        f'condim="3"/></body>'
        for w in WHEELS
    )
    servos = "".join(f'<velocity name="{w}" joint="{w}_wheel" kv="3" forcerange="-20 20"/>' for w in WHEELS)
    return (
        f'<mujoco model="rover"><compiler angle="radian" autolimits="true"/><option integrator="implicitfast" '
        f'timestep="{FINE_STEP}"/><worldbody><geom name="ground" type="plane" size="0 0 1"/>'
        f'<body name="base_link" pos="0 0 0.0635"><freejoint/><inertial pos="0.012 0.002 0.067" mass="16.523" '
        f'diaginertia="0.3136 0.3922 0.4485"/>{wheels}</body></worldbody><actuator>{servos}</actuator></mujoco>'
    )


def _row(values: Sequence[float]) -> str:
    return " ".join(f"{v:.10g}" for v in values)
