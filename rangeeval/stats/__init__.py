"""Estimators, their intervals and the tests on them: arrays in, numbers out."""
