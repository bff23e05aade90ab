"""Registration with no first guess as an experiment: how many pairs come out right, and whether the verdict knows."""
