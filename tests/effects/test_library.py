"""The order of the effects: the contract names the first member of a confounded group, by its table."""

from residual_mpc.effects.library import ORDER

# section 6 of the contract
TABLE = (
    "command_delay", "dead_zone", "actuator_lag", "actuator_gain", "saturation", "voltage_sag", "backlash",
    "torque_speed_limit", "rate_limit", "servo_integral", "joint_spring", "torque_offset", "torque_ripple",
    "gear_efficiency", "end_stop", "base_tilt", "coulomb_friction", "viscous_friction", "stribeck_friction",
    "load_dependent_friction", "payload", "link_mass", "armature", "joint_compliance", "link_length", "wheel_radius",
    "wheel_radius_mismatch", "track_width", "lateral_slip", "longitudinal_slip", "wheel_eccentricity", "slope",
    "sensor_delay", "sensor_lag", "sensor_scale", "clock_skew", "sensor_bias", "sensor_mounting", "sensor_outliers",
)  # fmt: skip


def test_effects_come_in_the_order_of_the_contracts_table() -> None:
    assert tuple(ORDER)[: len(TABLE)] == TABLE
