"""The noise under which a floor is stated: that which the model at hand leaves, the same for every command."""

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.data.noise_model import ChannelNoise
from residual_mpc.diagnosis.fit.noise_fit import fit_noise, no_more_than_left, stated_sizes
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.models.settings import Settings


def noise_left(
    headline: tuple[Dataset, Scales],
    longer: tuple[Dataset, Scales] | None,
    space: Space,
    row: Settings,
    settings: FitSettings,
) -> tuple[ChannelNoise, ...]:
    """The noise of each channel that the model `row` leaves on the windows of the next longer horizon, where there are
    any, since slow noise does not show in short windows, and no more than it leaves on those of the headline. What the
    user states of a channel stands."""
    data, scales = headline if longer is None else longer
    problem = build_problem(data, space, data.sigma, settings=settings.predict)
    noise = fit_noise(problem, scales, predict(data, row)[0], settings=settings)
    return stated_sizes(data, no_more_than_left(noise, *headline, row, settings=settings))
