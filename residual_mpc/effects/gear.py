"""What play and springs of a gear have in common."""

from residual_mpc.effects.effect import Parameter

# A model gives a joint one damping; of motor and link it acts on the motor unless this says otherwise. More than all of
# it would be another viscous friction, which a rigid gear has as well.
DAMPING_BEHIND = Parameter(
    "damping_behind",
    "1",
    0.0,
    0.0,
    1.0,
    (0.5,),
    shape=True,
    quantity="damping behind the gear",
    optional=True,
    tried=1.0,
    limits=True,
)
