"""Tracking filters, their closed-form statistics and simulated tracks: arrays in, numbers out."""
