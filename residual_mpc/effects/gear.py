"""What play and springs of a gear have in common."""

from residual_mpc.effects.effect import Parameter

# A model gives a joint one damping and one dry friction. All of it acts on the motor unless this moves a share to the
# link. A share above 1 would be further friction, which is an effect of its own.
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
    physical_bounds=True,
)
