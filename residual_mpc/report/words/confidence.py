"""How sure an answer is, in the words of the IPCC's likelihood scale.

Mastrandrea et al., Guidance Note for Lead Authors of the IPCC Fifth Assessment Report on Consistent Treatment of
Uncertainties, 2010, table 1.
"""

SCALE = (
    (0.99, "virtually certain"),
    (0.95, "extremely likely"),
    (0.90, "very likely"),
    (0.66, "likely"),
    (0.33, "about as likely as not"),
    (0.0, "unlikely"),
)

UNCERTAIN = 0.2  # probability below which an effect is listed, and not shown with its numbers


def likelihood(probability: float) -> str:
    """The word for a probability from 0 to 1."""
    return next(word for least, word in SCALE if probability >= least)
