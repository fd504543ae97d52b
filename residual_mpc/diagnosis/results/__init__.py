"""The answer: causes, support, verdict and figures, as frozen records and as diagnosis.json."""
