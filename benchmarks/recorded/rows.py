"""The rows of the page: which recordings are diagnosed by which command, and what is known of them from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Row:
    """One line of the page: the command on the runs of `folder`, and what is known of them from elsewhere.

    `mass` (kg), where it is given, replaces the mass in a copy of the model. `true` holds what is known of a
    parameter, by (effect, parameter), in its unit.
    """

    name: str
    folder: str
    what: str
    known: str
    command: str = "diagnose"
    options: tuple[str, ...] = ()
    mass: float | None = None
    true: Mapping[tuple[str, str], float] = field(default_factory=dict)


MOTIONS = (
    "actuator_bandwidth", "boundary_exploration", "center_workspace", "circular_motion", "coupled_joints",
    "custom_motion", "diagonal_sweep", "dual_joint_elbow_wrist", "dual_joint_rotation_pitch", "end_effector",
    "fast_transitions", "frequency_sweep", "gripper_cycles", "hold_under_gravity", "hover_positions",
    "large_amplitude", "oscillation_low_freq", "oscillation_med_freq", "perturbation_test", "prbs_excitation",
    "ramp_motion", "reach_and_return", "reaching_points", "repetitive_motion", "single_joint_rotation",
    "single_joint_wrist_pitch", "single_joint_wrist_roll", "sinusoidal_sweep", "slow_precision",
    "square_pattern", "staircase_motion", "symmetric_motion", "trapezoidal_profile", "triangle_wave",
    "wave_motion",
)  # fmt: skip
GAINS = ("kp100", "kp200", "kp400", "kp800")
SWINGS = ("lift_and_drop", "sin_sin", "sin_time_square", "up_and_down")
ROWS = (
    Row("xl330", "xl330", "one servo swinging 0.49 kg, 4 position gains x 4 motions, all 16 runs",
        "The nominal model has no friction at all. Published fits of the same logs have Coulomb friction of 0.013 N m "
        "with viscous friction of 0.0037 N m s/rad in the simplest model, and load-dependent friction of 0.12 to 0.27 "
        "in richer ones. The observed static stiffness is 0.4 to 0.8 of the nominal one."),
    Row("xl330, half the mass", "xl330", "the same runs, with 0.245 kg in the model in place of 0.49 kg",
        "0.245 kg is missing at the payload site, beside the effects that the row above names.", mass=0.245,
        true={("payload", "mass"): 0.245}),
    Row("xl330, motor off", "xl330",
        "fitted with the motor on throughout, judged on the four runs in which it is mostly off",
        "With the motor off, its gain, limit and delay have no effect: only the effects of the link itself are left.",
        options=("--held-out", "*_lift_and_drop")),
    *(Row(f"xl330, fourth {k + 1}", "xl330", "one servo, four runs held out: each gain and each motion once",
          "Together with the other three fourths, each run is held out once.",
          options=tuple(f"--held-out={gain}_{SWINGS[(k + i) % 4]}" for i, gain in enumerate(GAINS))) for k in range(4)),
    Row("husky_drive", "husky_drive", "skid-steered base, 402 runs of 2 s",
        "Half of the rows command more than 6.9 rad/s, which the wheels never exceed. The robot turns about 0.38 times "
        "as far as the encoders give (a track 2.6 times as wide), and drives 0.82 times as far. Four numbers describe "
        "its steady motion, fitted to the same recording: the mean of the wheels' speeds is 1.81 times the commanded "
        "mean, half of their difference is 0.79 times the commanded one and at most 3.08 rad/s, and above 6.0 rad/s "
        "both wheels slow down in proportion (169 windows, root mean square error 0.06 rad/s of 4.2; with one gain and "
        "one limit for both wheels 2.1).",
        true={("turn_limit", "limit"): 3.08, ("shared_limit", "limit"): 6.0, ("track_width", "scale"): 2.6}),
    Row("husky_terrain", "husky_terrain", "the same base driven by its wheel speeds, gyro alone, 15 runs",
        "Yaw rate over ideal: flooring 0.68, asphalt 0.58, asphalt_05 alone 0.2."),
    Row("husky_terrain, new ground", "husky_terrain", "fitted on flooring, judged on asphalt",
        "The ground differs from that of the fit: a track of 1 / 0.68 = 1.5 there, 1 / 0.58 = 1.7 here.",
        options=("--held-out", "asphalt_*")),
    Row("so101", "so101", "arm of six servos, 35 motions, 54 min",
        "Nobody knows the cause. The servos of the published model are far too stiff (kp 998 N m/rad, observed 6 to "
        "30). Observed are also 20 to 40 ms of dead time, 60 to 120 ms to 63 % of a step, and an elbow that stands "
        "about 4 degrees off its command. `check` warns of a stop at -1.03 rad in the wrist's roll that the model "
        "lacks. The one motion that meets it was held out, and makes two fifths of the remaining squared gap. In this "
        "diagnosis and those of the four fourths the servos are weak (18 to 32 N m/rad, within the observed range), "
        "with dry friction in shoulder_lift and elbow_flex and friction that falls with the speed. The size of each "
        "friction depends on the fitted motions by a factor of three to six, which is beyond the intervals. Dead time, "
        "lag, play and sag were tried and are not named."),
    *(Row(f"so101, fourth {k + 1}", "so101", f"the same arm, every fourth motion by name held out, from number {k + 1}",
          "Together with the other three fourths, each motion is held out once.",
          options=tuple(f"--held-out={name}" for name in MOTIONS[k::4])) for k in range(4)),
)  # fmt: skip

PICTURED = "so101"  # the row whose stages are drawn beside the page

SOURCES = """\
- `xl330`: github Rhoban/bam, history at af22604, Apache-2.0.
- `husky_drive`: github norlab-ulaval/DRIVE at e158a19, BSD-3-Clause, arXiv 2309.10718.
- `husky_terrain`: github norlab-ulaval/BorealTC at fe64e38, CC0, LaRocque et al., IROS 2024.
- `so101`: github isaac-sim2real/sage at 4ffd262, Apache-2.0; model from TheRobotStudio/SO-ARM100 at fda892c,
  Apache-2.0.
"""
