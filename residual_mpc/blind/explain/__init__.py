"""What explains a wrong answer: the search, the fit or the model."""
