"""Streaming estimators: Kalman filter, Hilbert envelope, growth rate."""
