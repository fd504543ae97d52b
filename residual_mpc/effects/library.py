"""All effects, in the order of the contract's table (the order decides which of a confounded group is named); a user's
own come last."""

from residual_mpc.effects import actuator, body, command, contact, sensor
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.plugged import plugged_in

BUILT_IN: tuple[Effect, ...] = (
    command.COMMAND_DELAY,
    command.DEAD_ZONE,
    actuator.ACTUATOR_LAG,
    actuator.ACTUATOR_GAIN,
    actuator.SATURATION,
    actuator.VOLTAGE_SAG,
    actuator.BACKLASH,
    body.COULOMB,
    body.VISCOUS,
    body.STRIBECK,
    body.LOAD_FRICTION,
    body.PAYLOAD,
    body.LINK_MASS,
    body.ARMATURE,
    body.JOINT_COMPLIANCE,
    body.LINK_LENGTH,
    contact.WHEEL_RADIUS,
    contact.WHEEL_RADIUS_MISMATCH,
    contact.TRACK_WIDTH,
    contact.LATERAL_SLIP,
    contact.LONGITUDINAL_SLIP,
    contact.SLOPE,
    sensor.SENSOR_DELAY,
    sensor.SENSOR_BIAS,
    sensor.SENSOR_MOUNTING,
    sensor.SENSOR_OUTLIERS,
)
PLUGGED: tuple[Effect, ...] = plugged_in(frozenset(effect.name for effect in BUILT_IN))
LIBRARY: tuple[Effect, ...] = BUILT_IN + PLUGGED

BY_NAME: dict[str, Effect] = {effect.name: effect for effect in LIBRARY}
ORDER: dict[str, int] = {effect.name: place for place, effect in enumerate(LIBRARY)}
