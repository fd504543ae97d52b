"""A pendulum behind a gear, written out: rotor and link as two inertias with a spring, or play with two stops, between.

Integrated by SciPy's LSODA between the changes of the command, apart from any engine; angles of both sides at the
link's scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import odeint
from scipy.optimize import brentq

GRAVITY = 9.81  # m/s^2
SLOW = 0.002  # rad/s, from which on dry friction is there in full


@dataclass(frozen=True)
class Gear:
    """SI units. stiffness and damping of the spring, or of the stops where there is play; `feedback` and `sensor`:
    which side the servo and the log see."""

    stiffness: float
    damping: float
    play: float = 0.0
    feedback: str = "motor"
    sensor: str = "link"
    rotor: float = 0.01
    friction: float = 0.05  # N m s/rad, of the rotor
    dry: float = 0.0  # N m, of the rotor, in full from a few mrad/s on
    behind: float = 0.0  # share of both frictions that acts on the link instead
    inertia: float = 0.02  # of the link about its centre
    mass: float = 0.5
    length: float = 0.2
    kp: float = 12.0
    kv: float = 0.4

    @property
    def xml(self) -> str:
        """The model without the gear, %s the step and the integrator."""
        return f"""
<mujoco>
  <option timestep="%s" integrator="%s"/>
  <worldbody>
    <body name="arm">
      <joint name="shoulder" axis="0 1 0" armature="{self.rotor}" damping="{self.friction}"
        frictionloss="{self.dry}"/>
      <inertial pos="0 0 -{self.length}" mass="{self.mass}" diaginertia="{self.inertia} {self.inertia} 0.001"/>
    </body>
  </worldbody>
  <actuator><position name="shoulder" joint="shoulder" kp="{self.kp}" kv="{self.kv}"/></actuator>
</mujoco>"""

    def at_rest(self, command: float) -> np.ndarray:
        """(4,) motor and link angle and their speeds under a command held for long; without play."""

        def left(link: float) -> float:
            seen = link + (self._weight(link) / self.stiffness if self.feedback == "motor" else 0.0)
            return self.kp * (command - seen) - self._weight(link)

        link = float(brentq(left, -1.5, 1.5))
        return np.array([link + self._weight(link) / self.stiffness, link, 0.0, 0.0])

    def driven(self, start: np.ndarray, commands: np.ndarray, dt: float) -> np.ndarray:
        """(K + 1, 4) states under commands (K,) held for dt s each."""
        states, most = [np.array(start)[None]], dt / 4 if self.play else 0.0  # 0: as long as the tolerances allow
        changes = np.flatnonzero(np.diff(commands)) + 1
        for held in np.split(commands, changes):
            t = dt * np.arange(len(held) + 1)
            found = odeint(
                self._rates, states[-1][-1], t, (float(held[0]),), rtol=1e-8, atol=1e-10, hmax=most, tfirst=True
            )
            states.append(found[1:])
        return np.concatenate(states)

    def logged(self, states: np.ndarray) -> np.ndarray:
        """(K,) angles that the sensor reports."""
        return states[:, 1 if self.sensor == "link" else 0]

    def _weight(self, link: float) -> float:
        return self.mass * GRAVITY * self.length * math.sin(link)

    def _rates(self, _: float, x: np.ndarray, command: float) -> list[float]:
        motor, link, w_motor, w_link = x.tolist()
        wound = motor - link
        wound -= min(max(wound, -self.play / 2), self.play / 2)
        through = self.stiffness * wound + self.damping * (w_motor - w_link) * (wound != 0.0 or not self.play)
        seen, rate = (motor, w_motor) if self.feedback == "motor" else (link, w_link)
        servo = self.kp * (command - seen) - self.kv * rate
        drag = [self.friction * w + self.dry * math.tanh(w / SLOW) for w in (w_motor, w_link)]
        return [
            w_motor,
            w_link,
            (servo - (1.0 - self.behind) * drag[0] - through) / self.rotor,
            (through - self._weight(link) - self.behind * drag[1]) / (self.inertia + self.mass * self.length**2),
        ]
