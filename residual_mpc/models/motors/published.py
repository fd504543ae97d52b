"""Published figures of servos, by the name that a robot file gives: at the output shaft, and each with its source.

A manufacturer states stall torque and stall current at a voltage: torque_constant = stall torque / stall current,
resistance = voltage / stall current. Gear friction makes this torque constant smaller, and the no-load speed that the
same page states slower, than those of the bare motor. Figures from an identification are its fitted values.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Servo:
    """voltage: V at which the figures hold. resistance: ohm. torque_constant: N m/A. duty_per_rad: duty cycle per
    radian of error and unit of the P register, None where nobody published it. registers: what the manufacturer calls
    the settings that an owner can change, by the names of `residual_mpc.effects.servo.changes`."""

    voltage: float
    resistance: float
    torque_constant: float
    source: str
    duty_per_rad: float | None = None
    registers: Mapping[str, str] = field(default_factory=dict)


def _stalled(voltage: float, torque: float, current: float, page: str, duty_per_rad: float | None = None) -> Servo:
    """From stall torque, N m, and stall current, A, of a page of the manufacturer's e-manual."""
    source = f"ROBOTIS e-manual, {page}: {torque:g} N m and {current:g} A at stall with {voltage:g} V"
    registers = {} if page in ("XL-320", "AX-18A") else DYNAMIXEL_X
    return Servo(voltage, voltage / current, torque / current, source, duty_per_rad, registers)


# Control tables: ROBOTIS e-manual of the X series; Feetech's memory table of the STS series as LeRobot names it.
DYNAMIXEL_X = {
    "p_gain": "Position P Gain",
    "i_gain": "Position I Gain",
    "offset": "Homing Offset",
    "profile": "Profile Velocity",
    "acceleration": "Profile Acceleration",
    "limit": "PWM Limit and Current Limit",
    "reply": "Return Delay Time and Baud Rate",
}
FEETECH_STS = {
    "p_gain": "P_Coefficient",
    "i_gain": "I_Coefficient",
    "offset": "Homing_Offset",
    "profile": "Goal_Velocity",
    "acceleration": "Acceleration",
    "limit": "Torque_Limit and Max_Torque_Limit",
    "dead_band": "CW_Dead_Zone and CCW_Dead_Zone",
    "reply": "Return_Delay_Time and Baud_Rate",
}

# github.com/Rhoban/bam (Duclusaud and Passault): identified models of servos, and duty cycles per unit of the P
# register that were measured with an oscilloscope or observed.
BAM = "identification published in Rhoban/bam"
XL330_DUTY = 4096 / (2.0 * math.pi) / (256 * 885)  # bam/xl330/actuator.py @d73e7c4; the e-manual has 128 for the 256
XL320_DUTY = 0.05048199  # bam/dynamixel/actuator.py @039bf23
STS_DUTY = 0.166  # bam/feetech/actuator.py @060af88

SERVOS: Mapping[str, Servo] = {
    # emanual.robotis.com/docs/en/dxl/..., "Specifications"
    "xl330-m288": _stalled(5.0, 0.52, 1.47, "XL330-M288-T", XL330_DUTY),
    "xl330-m077": _stalled(5.0, 0.215, 1.47, "XL330-M077-T", XL330_DUTY),
    "xc330-m288": _stalled(5.0, 0.93, 1.80, "XC330-M288-T"),
    "xc330-m181": _stalled(5.0, 0.60, 1.80, "XC330-M181-T"),
    "xc330-t288": _stalled(11.1, 0.92, 0.80, "XC330-T288-T"),
    "2xl430-w250": _stalled(11.1, 1.4, 1.3, "2XL430-W250"),
    "xh430-w350": _stalled(12.0, 3.4, 1.3, "XH430-W350"),
    "mx-28": _stalled(12.0, 2.5, 1.4, "MX-28 (Protocol 2.0)"),
    "xl320": _stalled(7.4, 0.39, 1.1, "XL-320", XL320_DUTY),
    "ax-18a": _stalled(12.0, 1.8, 2.2, "AX-18A"),
    # params/feetech_sts3215_*/m1.json @2d26b69 (7.4 V) and @c08dcca (12 V): fits with dry and viscous friction
    "sts3215": Servo(7.4, 2.6762, 1.2116, f"{BAM}, STS3215 at 7.4 V, model m1", STS_DUTY, FEETECH_STS),
    "sts3215-12v": Servo(12.0, 2.0296, 1.4440, f"{BAM}, STS3215 at 12 V, model m1", STS_DUTY, FEETECH_STS),
}
