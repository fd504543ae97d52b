"""Joints whose motor and link are told apart, as a record; see split_gears for the model."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Gears:
    """The joints of a robot that are split; g of them.

    names: every joint of the robot that could be split. joints (g,): places of these in the robot's `joints`.
    numbers, places, dofs (g,): of the added joints in the model, in qpos and in qvel. springs (g,): numbers of the
    tendons that hold motor and link together; links (g,): of those whose length is the link's position. rotor, link
    (g,) kg m^2: the inertias on either side, as modelled. substeps: steps of this model in one of the robot's.
    """

    names: tuple[str, ...]
    joints: np.ndarray
    numbers: np.ndarray
    places: np.ndarray
    dofs: np.ndarray
    springs: np.ndarray
    links: np.ndarray
    rotor: np.ndarray
    link: np.ndarray
    substeps: int
