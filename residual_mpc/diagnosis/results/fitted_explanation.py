"""An explanation as it stands before the held-out windows are opened."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.data.outliers import Outliers
from residual_mpc.diagnosis.data.stale import without_repeats
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.results.shrink import Shrink
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.diagnosis.search.rivals import Rivalry
from residual_mpc.diagnosis.search.testable import NotTestable
from residual_mpc.models.settings import Knob, Term, Values


@dataclass(frozen=True, eq=False)
class MarginalisedFit:
    """The last fit once more, with small differences marginalised in every number that it does not free; part, plain:
    the same windows, maybe some of all, and the fit to them without that."""

    problem: Problem
    fit: Fit
    part: Problem
    plain: Fit


@dataclass(frozen=True, eq=False)
class FittedExplanation:
    """raw: all W windows as they were logged; clean: less the samples that jump away. kept, held (W,) bool: what no fit
    has seen; free (W,) bool: what fits may see. problem: the windows that the last fit saw, of one horizon or several,
    on the weights of the search; base, final: the model alone and with the effects, fitted to them; ends: where other
    starts of the last fit ended as well. with_outliers: whether jumping samples are among the causes, unnamed_outliers:
    whether they would be if `sensor_outliers` were not excluded. vetoed: effects that the encoders contradict,
    doubtful: that cannot be told from none on all windows. expected: the shrink, None where nothing explains anything.
    tolerated: None where there are no small differences in other numbers; omitted: how the numbers move beside one of
    these, and beside all optional numbers of their effects. forms: the shape of each fitted law;
    aside: stretches that are unlike everything else, which no fit has seen; serving: effects that would explain
    them; in_parts: where the effects act that act in a part of the runs alone; run_sizes: the sizes of effects that
    have their own in each run; unlikely: effects that are left out as likelier absent, each with its probability."""

    raw: Dataset
    clean: Dataset
    scales: Scales
    kept: tuple[KeptBack, ...]
    held: np.ndarray
    free: np.ndarray
    problem: Problem
    base: Fit
    final: Fit
    ends: Mapping[Knob, tuple[float, ...]]
    rivalry: Rivalry
    untestable: tuple[NotTestable, ...]
    outliers: Outliers
    with_outliers: bool
    unnamed_outliers: bool
    vetoed: tuple[Term, ...]
    doubtful: tuple[Term, ...]
    expected: Shrink | None
    tolerated: MarginalisedFit | None
    omitted: tuple[Values, ...]
    forms: Mapping[Term, str] = field(default_factory=dict)
    aside: tuple[KeptBack, ...] = ()
    serving: tuple[Term, ...] = ()
    in_parts: Mapping[Term, Variation] = field(default_factory=dict)
    run_sizes: Mapping[Term, Variation] = field(default_factory=dict)
    unlikely: Mapping[Term, float] = field(default_factory=dict)

    def take(self, keep: np.ndarray) -> "FittedExplanation":
        """Judged on the windows of `raw` where the mask (W,) is true."""
        return replace(
            self, raw=self.raw.take(keep), clean=self.clean.take(keep), held=self.held[keep], free=self.free[keep]
        )

    def of_new_readings(self) -> "FittedExplanation":
        """Judged without what slow sensors repeat."""
        return replace(self, raw=without_repeats(self.raw))

    @property
    def space(self) -> Space:
        return self.problem.space

    @property
    def left_out(self) -> tuple[Term, ...]:
        """Effects that the search had found."""
        return (*self.vetoed, *self.doubtful, *self.unlikely)

    @property
    def anything(self) -> bool:
        """Whether there is anything in the explanation."""
        return bool(self.final.terms) or self.with_outliers

    @property
    def after_data(self) -> Dataset:
        """What the explanation is judged on: samples that jump away are explained where they are among the causes."""
        return self.clean if self.with_outliers else self.raw

    @property
    def test(self) -> np.ndarray:
        """(W,) bool: the windows that the figures are printed for, all of them where none could be kept back."""
        return self.held if self.held.any() else np.ones(self.raw.count, dtype=bool)
