"""Geometry, measurement noise and what the radar equation predicts: arrays in, numbers out."""
